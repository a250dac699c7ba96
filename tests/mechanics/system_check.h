/* What the tests of systems share: making one, integrating it, random states. */
#ifndef LG_SYSTEM_CHECK_H
#define LG_SYSTEM_CHECK_H

#include "support/fixtures.h"

#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"

enum { SYSTEM_MAX_DIM = 128 };

static inline void release_system(void *system) {
    lg_system_destroy(system);
}

/* A system of the running test. */
static inline lg_system *make_system_with(const char *name, const lg_system_options *options) {
    lg_system *system = NULL;
    lg_error error;
    if (lg_system_create(NULL, name, options, &system, &error) != LG_OK) fail_msg("%s", error.message);
    assert_string_equal(error.message, "");
    lg_test_owns(system, release_system);
    return system;
}

static inline lg_system *make_system(const char *name, const char *form, const lg_named_values *parameters,
                                     size_t count) {
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = form;
    options.parameters = parameters;
    options.parameter_count = count;
    return make_system_with(name, &options);
}

static inline size_t system_numbers(const lg_parameter_entry *row, size_t links) {
    return row->count > 0 ? row->count : links;
}

/* With these numbers for all parameters, in the order of the table. */
static inline lg_system *make_system_of(const char *name, const char *form, size_t links,
                                        const double *numbers) {
    enum { MOST = 32 };
    const lg_parameter_entry *row = lg_system_parameters(name, form);
    lg_named_values given[MOST];
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = form;
    options.links = links > 0 ? links : 1;
    options.parameters = given;
    for (; row->key; row++, options.parameter_count++) {
        assert_true(options.parameter_count < MOST);
        given[options.parameter_count] = (lg_named_values){row->key, numbers, system_numbers(row, links)};
        numbers += system_numbers(row, links);
    }
    return make_system_with(name, &options);
}

/* Pendulums; arrays NULL: ones. */
static inline lg_system *make_chain(const char *form, size_t links, double gravity, const double *masses,
                                    const double *lengths) {
    const lg_named_values given[] = {
        {"gravity", &gravity, 1}, {"masses", masses, links}, {"lengths", lengths, links}};
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = form;
    options.links = links;
    options.parameters = given;
    options.parameter_count = masses ? 3 : 1;
    return make_system_with("pendulum-chain", &options);
}

/* f(t, y) in the algebra. */
static inline void evaluate(const lg_system *system, double t, const double *y, double *algebra) {
    double work[SYSTEM_MAX_DIM];
    lg_system_user user;
    lg_ode ode;
    assert_true(lg_system_work_size(system) / sizeof(double) <= SYSTEM_MAX_DIM);
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
    assert_ok(ode.field(ode.user, t, y, NULL, algebra));
}

/* y' = f(t, y) . y */
static inline void velocity(const lg_system *system, double t, const double *y, double *out) {
    double algebra[SYSTEM_MAX_DIM];
    evaluate(system, t, y, algebra);
    lg_space_generator(lg_system_space(system), algebra, y, out);
}

/* The states at `times` from y0 at 0 with RKMK(5,4) at this relative tolerance. */
static inline void integrate(const lg_system *system, double tolerance, const double *y0, const double *times,
                             size_t count, double *out) {
    double work[SYSTEM_MAX_DIM];
    lg_system_user user;
    lg_ode ode;
    lg_stepper *stepper = NULL;
    lg_step_controller control;
    lg_run_stats stats;
    lg_step_controller_init(&control);
    control.rtol = tolerance;
    control.atol = tolerance;
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
    assert_ok(lg_stepper_create(NULL, lg_scheme_find("rkmk54"), &ode, &stepper));
    assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, y0, times, count, out, &stats));
    lg_stepper_destroy(stepper);
}

static inline void random_rotation(lg_rng *rng, double R[9]) {
    double u[3];
    for (int i = 0; i < 3; i++) u[i] = lg_rng_uniform_in(rng, -2, 2);
    lg_so3_exp(u, R);
}

/* (q, omega) of each link: q uniform on the sphere, omega orthogonal to it. */
static inline void random_links(lg_rng *rng, size_t links, double *y) {
    for (size_t i = 0; i < links; i++, y += 6) {
        double u[3];
        for (int c = 0; c < 3; c++) y[c] = lg_rng_normal(rng);
        const double norm = sqrt(lg_dot3(y, y));
        for (int c = 0; c < 3; c++) y[c] /= norm;
        for (int c = 0; c < 3; c++) u[c] = lg_rng_uniform_in(rng, -2.0, 2.0);
        lg_cross3(y, u, y + 3);
    }
}

/* ---- taped fields ---- */

<<<<<<< HEAD
typedef struct taped_check {
    const lg_system *system;
    double t;
    bool rows; /* the time is x[2], (B, 1), added to t */
} taped_check;

/* x: states (B, dim), parameters (P), times -> algebra (B, algebra_dim), parts one after another */
static inline lg_var build_field(const void *user, lg_tape *tape, const lg_var *x) {
    const taped_check *check = user;
    const lg_space *space = lg_system_space(check->system);
    const uint32_t batch = lg_var_shape(tape, x[0]).dims[0];
    const size_t parts = lg_taped_parts(space);
    const lg_taped_time t = {.value = check->t, .rows = check->rows ? x[2] : LG_NONE};
    lg_var y[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
    lg_system_taped_user taped;
    lg_taped_ode ode;
    if (lg_system_taped_ode(check->system, LG_COORDINATES_LIE, x[1], &ode, &taped) != LG_OK ||
        lg_taped_split(tape, space, x[0], y) != LG_OK ||
        ode.field(ode.user, tape, t, y, LG_NONE, algebra) != LG_OK)
        return LG_NONE;
    for (size_t i = 0; i < parts; i++) {
        const uint32_t count = (uint32_t)lg_shape_count(lg_var_shape(tape, algebra[i]));
        algebra[i] = lg_reshape(tape, algebra[i], lg_shape2(batch, count / batch));
    }
    return lg_concat(tape, algebra, parts, 1);
}

=======
>>>>>>> 6b87377 (Tests of systems leave to the tables what the tables say)
/* Plain algebra in the order of the parts: on factors with parts (u, v) the u of all copies come first. */
static inline void algebra_in_parts(const lg_space *space, const double *algebra, double *out) {
    for (size_t f = 0; f < space->factors; f++) {
        const size_t copies = space->factor[f].count,
                     size = lg_space_kind_entry(space->factor[f].kind)->algebra;
        for (size_t i = 0; i < copies; i++)
            for (size_t j = 0; j < size; j++)
                out[size < 6 ? i * size + j : (j / 3) * 3 * copies + 3 * i + j % 3] = algebra[i * size + j];
        algebra += copies * size;
        out += copies * size;
    }
}

<<<<<<< HEAD
/* Later times for the rows of a batch. */
static const double system_check_delays[SYSTEM_MAX_BATCH] = {0.3, -0.2, 0.9, 0.5};

/* `states` (batch, dim) at the time t, or with `rows` each later by its delay: values equal to rounding. */
static inline void check_taped_values(const lg_system *system, double t, bool rows, const double *states,
                                      uint32_t batch) {
    const lg_space *space = lg_system_space(system);
    const uint32_t dim = (uint32_t)lg_system_dim(system), n = (uint32_t)space->algebra_dim;
    const uint32_t count = (uint32_t)lg_system_parameter_count(system);
    const taped_check check = {system, t, rows};
    double taped[SYSTEM_MAX_BATCH * SYSTEM_MAX_DIM], algebra[SYSTEM_MAX_DIM], plain[SYSTEM_MAX_DIM];
    lg_tape *tape = NULL;
    assert_true(batch <= SYSTEM_MAX_BATCH);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var x[3] = {lg_input_f64(tape, lg_shape2(batch, dim), states),
                         lg_input_f64(tape, lg_shape1(count), lg_system_parameter_values(system)),
                         lg_input_f64(tape, lg_shape2(batch, 1), system_check_delays)};
    lg_var field = build_field(&check, tape, x);
    if (lg_tape_status(tape) != LG_OK) fail_msg("%s", lg_tape_message(tape));
    assert_ok(lg_read(tape, field, taped, batch * n));
    for (uint32_t b = 0; b < batch; b++) {
        double size = 0.0;
        evaluate(system, rows ? t + system_check_delays[b] : t, states + b * dim, algebra);
        algebra_in_parts(space, algebra, plain);
        for (uint32_t i = 0; i < n; i++) size = fmax(size, fabs(plain[i]));
        for (uint32_t i = 0; i < n; i++) assert_close(taped[b * n + i], plain[i], 0.0, 1e-13 * size);
    }
    lg_tape_destroy(tape);
}

/* The same, both ways, and derivatives to second order in the states, all parameters and the times. */
static inline void check_taped_field(const lg_system *system, double t, const double *states, uint32_t batch,
                                     double parameter_scale) {
    const uint32_t dim = (uint32_t)lg_system_dim(system);
    const uint32_t count = (uint32_t)lg_system_parameter_count(system);
    const taped_check check = {system, t, true};
    check_taped_values(system, t, false, states, batch);
    check_taped_values(system, t, true, states, batch);

    const lg_gradcheck_argument arguments[3] = {
        {.shape = lg_shape2(batch, dim), .values = states, .scale = 0.1},
        {.shape = lg_shape1(count), .values = lg_system_parameter_values(system), .scale = parameter_scale},
        {.shape = lg_shape2(batch, 1), .values = system_check_delays}};
    const lg_gradcheck_function function = {.name = lg_system_name(system),
                                            .inputs = 3,
                                            .arguments = arguments,
                                            .build = build_field,
                                            .user = &check};
    lg_gradcheck_result result;
    (void)lg_gradcheck(NULL, &function, NULL, &result);
    printf("%s %s: slopes %.3f %.3f, errors %.1e %.1e\n", lg_system_name(system),
           lg_system_form(system) ? lg_system_form(system) : "", result.order[0].slope, result.order[1].slope,
           result.order[0].error, result.order[1].error);
    if (!result.passed) fail_msg("%s", result.message);
}

=======
>>>>>>> 6b87377 (Tests of systems leave to the tables what the tables say)
#endif
