/* What control code calls of a model allocates nothing and takes no lock. */
#include "model_support.h"

#include "support/malloc_count.h"

/* Value and derivative, of any kind. */
static void count_function(const built *b) {
    const size_t n = lg_model_inputs(b->model), outputs = lg_model_outputs(b->model);
    double *x = room(n), *y = room(outputs), *jacobian = room(outputs * n);
    size_t sizes = 0;
    for (size_t i = 0; i < n; i++) x[i] = 0.1 * (double)(i % 7);
    assert_no_malloc_no_lock(sizes += lg_model_inputs(b->model) + lg_model_outputs(b->model) +
                                      lg_model_parameters(b->model) + lg_model_work_size(b->model));
    assert_no_malloc_no_lock(lg_model_eval(b->model, x, y, b->work));
    assert_no_malloc_no_lock(lg_model_jacobian(b->model, x, y, jacobian, b->work));
    assert_true(sizes > 0 && isfinite(y[0]));
    free(x), free(y), free(jacobian);
}

/* The first step after the set-up too. */
static void count_steps(const built *b, const double *start, const double *input) {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        lg_stepper *stepper = NULL;
        lg_status status = LG_OK;
        double y[MOST_STATE];
        size_t bytes = 0;
        void *memory = NULL;
        assert_no_malloc_no_lock(bytes = lg_model_stepper_size(b->model, scheme));
        if (bytes == 0) continue;
        assert_int_equal(posix_memalign(&memory, 64, bytes), 0);
        memcpy(y, start, sizeof y);
        assert_no_malloc_no_lock(status = lg_model_stepper_init(memory, bytes, b->model, scheme, &stepper));
        assert_ok(status);
        for (int n = 0; n < 4; n++) {
            assert_no_malloc_no_lock(status = lg_step(stepper, 0.0, 0.01, y, n < 2 ? input : NULL, y));
            assert_ok(status);
        }
        free(memory);
    }
}

static void count_motion(const built *b) {
    lg_rng rng;
    double y[MOST_STATE], u[MOST_INPUT], field[MOST_STATE], A[MOST_TANGENT * MOST_TANGENT],
        B[MOST_TANGENT * MOST_INPUT], basis[MOST_STATE * MOST_TANGENT], c[MOST_TANGENT];
    lg_model_user user;
    lg_ode ode;
    lg_status status = LG_OK;
    lg_rng_seed(&rng, 1, 0);
    draw_state(b, &rng, y);
    for (size_t i = 0; i < lg_model_input_size(b->model); i++) u[i] = lg_rng_normal(&rng);
    assert_no_malloc_no_lock(status = lg_model_field(b->model, y, u, field, b->work));
    assert_ok(status);
    assert_no_malloc_no_lock(status = lg_model_linearise(b->model, y, u, A, B, basis, b->work));
    assert_ok(status);
    assert_no_malloc_no_lock(status = lg_model_deviation(b->model, y, y, c, b->work));
    assert_ok(status);
    assert_no_malloc_no_lock(status = lg_model_ode(b->model, &user, b->work, &ode));
    assert_ok(status);
    count_steps(b, y, u);
}

static void hamiltonians(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t links = 1; links <= 3; links++) {
            built b;
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), links, LG_POTENTIAL_MLP, LG_TANH);
            count_function(&b);
            count_motion(&b);
            build_free(&b);
        }
}

/* As wide as trained ones are, where products are large. */
static void wide_networks(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    const uint32_t hidden[3] = {100, 100, 100};
    lg_hamiltonian model;
    lg_rng rng;
    built b;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, hidden, 3, LG_SWISH));
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng_seed(&rng, 24, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    build_from(&b, &model, theta);
    b.theta = theta;
    count_function(&b);
    count_motion(&b);
    build_free(&b);
}

static void surrogates(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        built b;
        build_surrogate(&b, (lg_surrogate_kind)kind);
        count_function(&b);
        build_free(&b);
    }
}

static void detectors(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    built b;
    build_detector(&b, LG_SWISH);
    count_function(&b);
    build_free(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hamiltonians),
        cmocka_unit_test(wide_networks),
        cmocka_unit_test(surrogates),
        cmocka_unit_test(detectors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
