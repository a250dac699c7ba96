/* Shared by the tests of systems: making a system, integrating it, drawing states. */
#ifndef LG_SYSTEM_CHECK_H
#define LG_SYSTEM_CHECK_H

#include "support/fixtures.h"

#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"

enum { SYSTEM_MAX_DIM = 128 };

RELEASES(release_system, lg_system_destroy)

/* Makes a system that the running test owns. */
static inline lg_system *make_system_with(const char *name, const lg_system_options *options) {
    lg_system *system = NULL;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_system_create(NULL, name, options, &system, &error);
    assert_string_equal(error.message, "");
    assert_int_equal(status, LG_OK);
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

/* Makes a system with these numbers as all its parameters, in the order of the table. */
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

/* Makes a chain of pendulums. An array that is NULL stands for ones. */
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

/* The velocity y' = f(t, y) . y. */
static inline void velocity(const lg_system *system, double t, const double *y, double *out) {
    double algebra[SYSTEM_MAX_DIM];
    evaluate(system, t, y, algebra);
    lg_space_generator(lg_system_space(system), algebra, y, out);
}

/* The states at `times` from y0 at t = 0, by RKMK(5,4) with this relative tolerance. */
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

/* Draws (q, omega) of each link: q uniformly on the sphere, omega orthogonal to it. */
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

/* Sorts the plain algebra element in the order of the parts: for factors with parts (u, v), the u of all
 * copies come first. */
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

#endif
