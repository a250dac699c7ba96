/* Learned Hamiltonians on a tape: their gradient and steps; rows of a batch; refusals. */
#include "support/model_support.h"
#include "support/plan_support.h"

enum { BATCH = 3 };

typedef struct learned {
    const lg_hamiltonian_family *family;
    uint32_t n;
    lg_potential_kind potential;
    lg_activation activation;
} learned;

static const learned models[] = {
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, LG_TANH},
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, LG_TANH},
    {&lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, LG_SWISH},
    {&lg_hamiltonian_chain, 4, LG_POTENTIAL_LINEAR, LG_TANH},
    {&lg_hamiltonian_separable, 1, LG_POTENTIAL_MLP, LG_TANH},
    {&lg_hamiltonian_separable, 3, LG_POTENTIAL_MLP, LG_SINE},
    {&lg_hamiltonian_separable, 2, LG_POTENTIAL_LINEAR, LG_TANH},
};
enum { MODELS = LG_COUNT(models) };

/* A model with states, inputs and step sizes, which are variables on the tape. */
typedef struct setting {
    built built;
    size_t d, m, parameters;
    double state[BATCH * MOST_STATE], input[BATCH * MOST_INPUT], h[BATCH];
    lg_tape *tape;
    lg_var theta, y, u, steps;
    lg_hamiltonian_vars vars;
} setting;

static const lg_hamiltonian *hamiltonian_of(const setting *s) {
    return &s->built.hamiltonian;
}

static void record_inputs(setting *s) {
    lg_tape_reset(s->tape);
    s->theta = lg_parameter(s->tape, lg_shape1((uint32_t)s->parameters), s->built.theta);
    s->y = lg_parameter(s->tape, lg_shape2(BATCH, (uint32_t)s->d), s->state);
    s->u = lg_parameter(s->tape, lg_shape2(BATCH, (uint32_t)s->m), s->input);
    s->steps = lg_parameter(s->tape, lg_shape2(BATCH, 1), s->h);
    assert_ok(lg_hamiltonian_bind(s->tape, hamiltonian_of(s), s->theta, &s->vars));
}

/* `on`: states on the manifold; otherwise anywhere in the ambient space. */
static setting *make_setting(const learned *of, bool on) {
    setting *s = TEST_ARRAY(setting, 1);
    s->built = build_hamiltonian(of->family, of->n, of->potential, of->activation);
    s->d = lg_model_inputs(s->built.model);
    s->m = lg_model_input_dim(s->built.model);
    s->parameters = lg_model_parameters(s->built.model);
    assert_true(s->d <= MOST_STATE && s->m <= MOST_INPUT);
    lg_rng rng = test_rng(31, of->n);
    for (size_t i = 0; i < BATCH * s->d; i++) s->state[i] = lg_rng_normal(&rng);
    for (size_t i = 0; i < BATCH * s->m; i++) s->input[i] = lg_rng_normal(&rng);
    for (size_t b = 0; b < BATCH; b++) s->h[b] = lg_rng_uniform_in(&rng, -0.05, 0.1);
    const lg_space space = space_of(&s->built);
    for (size_t b = 0; on && b < BATCH; b++) lg_space_project(&space, s->state + b * s->d);
    s->tape = test_tape(LG_F64);
    record_inputs(s);
    return s;
}

static void assert_rows(const setting *s, lg_var got, const double *expected, size_t width) {
    double values[BATCH * MOST_STATE];
    const lg_shape shape = lg_var_shape(s->tape, got);
    if (lg_tape_status(s->tape) != LG_OK) fail_msg("%s", lg_tape_message(s->tape));
    assert_true(shape.rank == 2 && shape.dims[0] == BATCH && shape.dims[1] == width);
    assert_ok(lg_read(s->tape, got, BATCH * width, values));
    for (size_t i = 0; i < BATCH * width; i++) assert_close(values[i], expected[i], 2e-13, 2e-13);
}

TEST("the recorded gradient agrees with the tape's gradient of the value, on the manifold and off it") {
    for (size_t i = 0; i < MODELS; i++) {
        lg_var by_tape;
        double expected[BATCH * MOST_STATE];
        setting s = *make_setting(&models[i], false);
        lg_var gradient = lg_hamiltonian_record_gradient(s.tape, &s.vars, s.y);
        assert_ok(lg_read(s.tape, gradient, BATCH * s.d, expected));
        lg_var sum = lg_sum(s.tape, lg_hamiltonian_record_value(s.tape, &s.vars, s.y));
        assert_ok(lg_grad(s.tape, sum, &s.y, 1, &by_tape));
        assert_rows(&s, by_tape, expected, s.d);
    }
}

/* ---- steps ---- */

/* Compares a step with each row's own step size, with or without an input, with the model's stepper. Returns
 * false if there is no stepper for the scheme. */
static bool compare_step(setting *s, const lg_scheme *scheme, bool driven) {
    double expected[BATCH * MOST_STATE];
    lg_taped_ode ode;
    lg_var parts[2];
    if (lg_model_stepper_size(s->built.model, scheme) == 0) return false;
    lg_stepper *stepper = stepper_of(&s->built, scheme);
    for (size_t b = 0; b < BATCH; b++)
        assert_ok(lg_stepper_step(stepper, 0.0, s->h[b], s->state + b * s->d,
                                  driven ? s->input + b * s->m : NULL, expected + b * s->d));
    record_inputs(s);
    assert_ok(lg_hamiltonian_training_ode(s->tape, &s->vars, scheme, NULL, &ode));
    assert_ok(lg_taped_split(s->tape, &ode.space, s->y, parts));
    const lg_taped_interval over = {.h_rows = s->steps, .input = driven ? s->u : LG_NONE};
    const lg_status status = lg_taped_step(s->tape, scheme, &ode, &over, parts, parts);
    if (status != LG_OK) fail_msg("%s: %s", scheme->name, lg_tape_message(s->tape));
    assert_rows(s, lg_taped_join(s->tape, &ode.space, parts), expected, s->d);
    return true;
}

TEST("steps on a tape agree with the model's stepper, for every scheme that it accepts") {
    for (size_t i = 0; i < MODELS; i++) {
        bool any = false;
        setting s = *make_setting(&models[i], true);
        for (size_t j = 0; j < 2 * lg_scheme_count(); j++)
            any = compare_step(&s, lg_scheme_at(j / 2), j % 2 == 0) || any;
        assert_true(any);
    }
}

/* ---- rows and refusals ---- */

TEST("a row with NaN does not affect the other rows") {
    for (size_t i = 0; i < MODELS; i++) {
        double before[BATCH * MOST_STATE], after[BATCH * MOST_STATE];
        setting s = *make_setting(&models[i], true);
        assert_ok(
            lg_read(s.tape, lg_hamiltonian_record_field(s.tape, &s.vars, s.y, s.u), BATCH * s.d, before));
        for (size_t j = 0; j < s.d; j++) s.state[s.d + j] = NAN;
        record_inputs(&s);
        assert_ok(
            lg_read(s.tape, lg_hamiltonian_record_field(s.tape, &s.vars, s.y, s.u), BATCH * s.d, after));
        for (size_t b = 0; b < BATCH; b += 2)
            assert_memory_equal(after + b * s.d, before + b * s.d, s.d * sizeof *after);
        assert_true(isnan(after[s.d]));
    }
}

TEST("states, inputs and parameters of a wrong shape are refused") {
    for (size_t i = 0; i < MODELS; i++) {
        setting s = *make_setting(&models[i], true);
        const uint32_t m = (uint32_t)s.m, d = (uint32_t)s.d;
        const lg_shape wrong[] = {lg_shape2(BATCH, m + 1), lg_shape2(1, m), lg_shape1(m),
                                  lg_shape3(BATCH, m, 1)};
        for (size_t j = 0; j < LG_COUNT(wrong); j++) {
            record_inputs(&s);
            lg_var input = lg_full(s.tape, wrong[j], 0.1);
            assert_true(lg_is_none(lg_hamiltonian_record_field(s.tape, &s.vars, s.y, input)));
            assert_status(lg_tape_status(s.tape), LG_SHAPE);
            assert_non_null(strstr(lg_tape_message(s.tape), "one row of forces"));
        }
        record_inputs(&s);
        lg_var longer = lg_full(s.tape, lg_shape2(BATCH, d + 1), 0.1);
        assert_true(lg_is_none(lg_hamiltonian_record_value(s.tape, &s.vars, longer)));
        assert_true(lg_is_none(lg_hamiltonian_record_gradient(s.tape, &s.vars, longer)));
        assert_true(lg_is_none(lg_hamiltonian_record_field(s.tape, &s.vars, longer, s.u)));
        assert_true(lg_is_none(lg_hamiltonian_record_velocity(s.tape, &s.vars, longer, s.u)));
        assert_status(lg_tape_status(s.tape), LG_SHAPE);
        lg_tape_reset(s.tape);
        lg_var shorter = lg_full(s.tape, lg_shape1((uint32_t)s.parameters - 1), 0.1);
        s.vars.model = NULL;
        assert_status(lg_hamiltonian_bind(s.tape, hamiltonian_of(&s), shorter, &s.vars), LG_SHAPE);
        lg_tape_reset(s.tape);
        const lg_var row = lg_full(s.tape, lg_shape2(1, (uint32_t)s.parameters), 0.1);
        assert_status(lg_hamiltonian_bind(s.tape, hamiltonian_of(&s), row, &s.vars), LG_SHAPE);
        lg_tape_reset(s.tape);
        assert_int_not_equal(lg_hamiltonian_bind(s.tape, hamiltonian_of(&s), LG_NONE, &s.vars), LG_OK);
        assert_null(s.vars.model);
    }
}
