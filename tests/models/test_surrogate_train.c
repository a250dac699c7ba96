/* Losses of the surrogates: on a tape and from the curves, their parts, gradients, and what is refused. */
#include "models/surrogate_support.h"

#include "liegrad/ops.h"
#include "models/surrogate_internal.h"

enum { CURVES = 7, MANY = 2000 };

static size_t samples_of(const lg_surrogate_problem *problem, uint32_t *samples) {
    lg_fit_problem fit;
    lg_surrogate_fit_problem(problem, &fit);
    assert_true(fit.samples <= MANY);
    for (size_t i = 0; i < fit.samples; i++) samples[i] = (uint32_t)i;
    return fit.samples;
}

/* The part of the loss that belongs to these samples, and its gradient where asked for (f64). */
static double loss_of(const lg_surrogate_problem *problem, lg_dtype dtype, const void *theta,
                      const uint32_t *samples, size_t count, size_t batch, double *gradient) {
    lg_fit_problem fit;
    lg_tape_options options;
    lg_tape *tape;
    lg_var loss = LG_NONE;
    double value = NAN;
    lg_surrogate_fit_problem(problem, &fit);
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    const lg_var parameters = lg_parameter(tape, lg_shape1((uint32_t)fit.parameters), theta);
    const lg_status status = fit.loss(fit.user, tape, parameters, samples, count, batch, &loss);
    if (status != LG_OK) fail_msg("%s: %s", lg_status_name(status), lg_tape_message(tape));
    assert_ok(lg_read(tape, loss, &value, 1));
    void *out = gradient;
    if (gradient != NULL) assert_ok(lg_backward_set(tape, loss, &parameters, 1, &out));
    lg_tape_destroy(tape);
    return value;
}

static double whole_loss(const lg_surrogate_problem *problem, const double *theta, double *gradient) {
    uint32_t samples[MANY];
    const size_t n = samples_of(problem, samples);
    return loss_of(problem, LG_F64, theta, samples, n, n, gradient);
}

static double square(double x) {
    return x * x;
}

/* q at the nodes by Gauss's rule of 3 points on each interval of the data, from the model's tangents. */
static void integrate(const small *s, const double *x, size_t n, double *q) {
    static const double weights[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
    const double h = TEST_LENGTH / (double)n;
    q[0] = x[0];
    q[1] = x[1];
    for (size_t k = 0; k < n; k++) {
        double at[3], v[6];
        for (size_t g = 0; g < 3; g++) at[g] = h * ((double)k + 0.5 * (1.0 + ((double)g - 1.0) * sqrt(0.6)));
        curve_of(s, x, at, 3, NULL, v);
        for (size_t c = 0; c < 2; c++) {
            q[2 * k + 2 + c] = q[2 * k + c];
            for (size_t g = 0; g < 3; g++) q[2 * k + 2 + c] += h * weights[g] * v[2 * g + c];
        }
    }
}

/* The loss of the header from the curves that the model gives without a tape. */
static double loss_from_curves(const small *s, const lg_surrogate_problem *problem) {
    const lg_elastica_curves *set = problem->curves;
    const size_t n = set->intervals, nodes = n + 1;
    double *at = malloc(nodes * sizeof *at), *q = malloc(4 * nodes * sizeof *q), *v = q + 2 * nodes;
    double fit = 0.0, rough = 0.0, length = 0.0;
    for (size_t k = 0; k < nodes; k++) at[k] = TEST_LENGTH * (double)k / (double)n;
    at[n] = TEST_LENGTH;
    for (size_t i = 0; i < problem->training_count; i++) {
        const size_t j = problem->training[i];
        curve_of(s, set->boundary + 8 * j, at, nodes, q, v);
        if (s->model.options.kind == LG_SURROGATE_ANGLE) integrate(s, set->boundary + 8 * j, n, q);
        for (size_t c = 0; c < 2 * nodes; c++) {
            q[c] -= set->q[2 * nodes * j + c];
            if (c % 2 == 1) length += square(square(v[c - 1]) + square(v[c]) - 1.0);
        }
        for (size_t c = 0; c < 2 * nodes; c++) v[c] -= set->v[2 * nodes * j + c];
        for (size_t c = 0; c < 2 * nodes; c++) fit += square(q[c]) + square(v[c]);
        for (size_t c = 0; c < 2 * n; c++) rough += square(q[c + 2] - q[c]) + square(v[c + 2] - v[c]);
    }
    free(at);
    free(q);
    const double m = (double)problem->training_count, gamma = s->model.options.gamma;
    if (s->model.options.kind == LG_SURROGATE_DISCRETE)
        return fit / (m * 4.0 * (double)(n - 1)) + gamma * rough / (m * 4.0 * (double)n);
    if (s->model.options.kind == LG_SURROGATE_CONTINUOUS)
        return (fit + gamma * length) / (2.0 * m * (double)nodes);
    return fit / (2.0 * m * (double)nodes);
}

static const uint32_t everything[CURVES] = {0, 1, 2, 3, 4, 5, 6};

static void the_loss_is_that_of_the_curves(void **state) {
    (void)state;
    static const uint32_t intervals[] = {50, 63, 7};
    for (size_t n = 0; n < 3; n++) {
        lg_elastica_curves set;
        make_curves(&set, CURVES, intervals[n]);
        for (size_t which = 0; which < TEST_OPTIONS; which++) {
            small s;
            make_small(&s, which, intervals[n], TEST_LENGTH, 5);
            const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
            assert_ok(lg_surrogate_problem_check(&problem, NULL));
            const double expected = loss_from_curves(&s, &problem);
            assert_true(expected > 1e-3);
            assert_close(whole_loss(&problem, s.theta, NULL), expected, 1e-12, 0.0);
            free_small(&s);
        }
        free_curves(&set);
    }
}

/* A cubic in s, another one for each curve and component, and its derivative. */
static void cubic(size_t curve, double s, double *q, double *v) {
    const double a = 0.3 + 0.1 * (double)curve;
    q[0] = a + s - 0.2 * s * s + 0.05 * a * s * s * s, v[0] = 1.0 - 0.4 * s + 0.15 * a * s * s;
    q[1] = 0.1 - a * s + 0.3 * s * s - 0.02 * s * s * s, v[1] = -a + 0.6 * s - 0.06 * s * s;
}

/* Both interpolations give cubics back: samples between the nodes are then points of the cubics. */
static void samples_between_the_nodes(void **state) {
    (void)state;
    enum { M = 9, ENDS = 20 };
    lg_elastica_curves set;
    uint32_t ends = 0;
    make_curves(&set, CURVES, M);
    for (size_t i = 0; i < CURVES; i++)
        for (size_t k = 0; k <= M; k++)
            cubic(i, TEST_LENGTH * (double)k / M, set.q + 2 * ((M + 1) * i + k),
                  set.v + 2 * ((M + 1) * i + k));
    for (size_t which = 0; which < 4; which++) {
        small s;
        make_small(&s, 3 + which / 2, M, TEST_LENGTH, 6);
        set.continuous = which % 2 == 1;
        s.model.options.between = true;
        const double gamma = s.model.options.gamma;
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        double expected = 0.0;
        for (size_t i = 0; i < CURVES; i++)
            for (size_t k = 0; k <= M; k++) {
                const double shift = lg_surrogate_shift(i * (M + 1) + k);
                const double place = fmin(fmax((double)k + shift, 0.0), M);
                double q[2], v[2], got_q[2], got_v[2];
                const double at = TEST_LENGTH * place / M;
                assert_true(shift >= -0.5 && shift < 0.5);
                ends += place == 0.0 || place == M;
                cubic(i, at, q, v);
                curve_of(&s, set.boundary + 8 * i, &at, 1, got_q, got_v);
                for (size_t c = 0; c < 2; c++) expected += square(got_q[c] - q[c]) + square(got_v[c] - v[c]);
                expected += gamma * square(square(got_v[0]) + square(got_v[1]) - 1.0);
            }
        assert_close(whole_loss(&problem, s.theta, NULL), expected / (2.0 * CURVES * (M + 1)), 1e-11, 0.0);
        free_small(&s);
    }
    assert_true(ends >= ENDS);
    free_curves(&set);
}

static void two_intervals(void **state) {
    (void)state;
    lg_elastica_curves set;
    make_curves(&set, CURVES, 2);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        make_small(&s, which, 2, TEST_LENGTH, 6);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        assert_ok(lg_surrogate_problem_check(&problem, NULL));
        assert_close(whole_loss(&problem, s.theta, NULL), loss_from_curves(&s, &problem), 1e-12, 0.0);
        free_small(&s);
    }
    free_curves(&set);
}

/* Parts of a batch add up, down to single samples, and to the same gradient; only some curves are taken. */
static void parts_add_up(void **state) {
    (void)state;
    static const uint32_t training[3] = {5, 0, 2};
    lg_elastica_curves set;
    make_curves(&set, CURVES, 6);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        uint32_t samples[MANY];
        make_small(&s, which, 6, TEST_LENGTH, 7);
        const lg_surrogate_problem problem = {&s.model, &set, training, 3};
        const size_t n = samples_of(&problem, samples);
        double *gradient = calloc(3 * s.parameters, sizeof *gradient), *part = gradient + s.parameters;
        double *sum = part + s.parameters, total = 0.0;
        assert_int_equal(n, s.model.options.kind == LG_SURROGATE_CONTINUOUS ? 21 : 3);
        const double whole = loss_of(&problem, LG_F64, s.theta, samples, n, n, gradient);
        for (size_t i = 0; i < n; i++) {
            total += loss_of(&problem, LG_F64, s.theta, samples + i, 1, n, part);
            for (size_t k = 0; k < s.parameters; k++) sum[k] += part[k];
        }
        assert_close(total, whole, 1e-13, 0.0);
        for (size_t k = 0; k < s.parameters; k++) assert_close(sum[k], gradient[k], 1e-11, 1e-13);
        free(gradient);
        free_small(&s);
    }
    free_curves(&set);
}

/* Along a random direction, by differences extrapolated to h^4. */
static void gradients(void **state) {
    (void)state;
    lg_elastica_curves set;
    make_curves(&set, CURVES, 9);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        lg_rng rng;
        make_small(&s, which, 9, TEST_LENGTH, 8);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        double *gradient = malloc(3 * s.parameters * sizeof *gradient), *d = gradient + s.parameters;
        double *moved = d + s.parameters, along = 0.0, quotient[2];
        lg_rng_seed(&rng, 2, which);
        (void)whole_loss(&problem, s.theta, gradient);
        for (size_t k = 0; k < s.parameters; k++) {
            d[k] = lg_rng_uniform_in(&rng, -1.0, 1.0);
            along += d[k] * gradient[k];
        }
        for (size_t e = 0; e < 2; e++) {
            const double h = e == 0 ? 2e-4 : 1e-4;
            for (size_t k = 0; k < s.parameters; k++) moved[k] = s.theta[k] + h * d[k];
            quotient[e] = whole_loss(&problem, moved, NULL);
            for (size_t k = 0; k < s.parameters; k++) moved[k] = s.theta[k] - h * d[k];
            quotient[e] = (quotient[e] - whole_loss(&problem, moved, NULL)) / (2.0 * h);
        }
        assert_close(along, (4.0 * quotient[1] - quotient[0]) / 3.0, 1e-7, 1e-9);
        free(gradient);
        free_small(&s);
    }
    free_curves(&set);
}

static void single_precision(void **state) {
    (void)state;
    lg_elastica_curves set;
    make_curves(&set, CURVES, 20);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        uint32_t samples[MANY];
        make_small(&s, which, 20, TEST_LENGTH, 9);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        const size_t n = samples_of(&problem, samples);
        const double exact = loss_of(&problem, LG_F64, s.theta, samples, n, n, NULL);
        assert_close(loss_of(&problem, LG_F32, s.theta32, samples, n, n, NULL), exact, 2e-5, 0.0);
        free_small(&s);
    }
    free_curves(&set);
}

static void reflect(lg_elastica_curves *set) {
    const size_t nodes = ((size_t)set->intervals + 1) * set->count;
    for (size_t i = 1; i < 8 * set->count; i += 2) set->boundary[i] = -set->boundary[i];
    for (size_t i = 1; i < 2 * nodes; i += 2) set->q[i] = -set->q[i];
    for (size_t i = 1; i < 2 * nodes; i += 2) set->v[i] = -set->v[i];
}

/* With `mirror` a set and its mirror image are the same set; without, they are not. */
static void mirror_images_are_one(void **state) {
    (void)state;
    lg_elastica_curves set, image;
    make_curves(&set, CURVES, 8);
    make_curves(&image, CURVES, 8);
    reflect(&image);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        make_small(&s, which, 8, TEST_LENGTH, 10);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        const lg_surrogate_problem mirrored = {&s.model, &image, everything, CURVES};
        const double a = whole_loss(&problem, s.theta, NULL), b = whole_loss(&mirrored, s.theta, NULL);
        assert_true(s.model.options.mirror ? a == b : fabs(a - b) > 1e-6);
        free_small(&s);
    }
    free_curves(&set);
    free_curves(&image);
}

/* A network that gives the curve itself: loss 0, or what one wrong number costs. Its last bias is what it
 * gives, all else is zero. */
static void a_discrete_network_that_is_right(void **state) {
    (void)state;
    enum { N = 5 };
    small s;
    lg_elastica_curves set;
    make_curves(&set, 1, N);
    make_small(&s, 1, N, TEST_LENGTH, 11);
    const lg_surrogate_problem problem = {&s.model, &set, everything, 1};
    double *bias = s.theta + s.parameters - 4 * (N - 1);
    memset(s.theta, 0, s.parameters * sizeof *s.theta);
    memcpy(bias, set.q + 2, 2 * (N - 1) * sizeof *bias);
    memcpy(bias + 2 * (N - 1), set.v + 2, 2 * (N - 1) * sizeof *bias);
    assert_close(whole_loss(&problem, s.theta, NULL), 0.0, 0.0, 0.0);
    bias[3] += 0.5; /* q_2y: two differences */
    assert_close(whole_loss(&problem, s.theta, NULL), 0.25 / 16.0 + 0.3 * 2.0 * 0.25 / 20.0, 1e-14, 0.0);
    bias[3] -= 0.5;
    bias[15] += 0.5; /* v_4y, beside the end: still two, one of them to the end */
    assert_close(whole_loss(&problem, s.theta, NULL), 0.25 / 16.0 + 0.3 * 2.0 * 0.25 / 20.0, 1e-14, 0.0);
    free_small(&s);
    free_curves(&set);
}

/* Networks of a continuous s learn from curves of any N. */
static void another_number_of_nodes(void **state) {
    (void)state;
    lg_elastica_curves set;
    make_curves(&set, CURVES, 50);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        lg_error error;
        make_small(&s, which, 12, TEST_LENGTH, 12);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        if (s.model.options.kind == LG_SURROGATE_DISCRETE) {
            assert_status(lg_surrogate_problem_check(&problem, &error), LG_SHAPE);
            assert_non_null(strstr(error.message, "50"));
        } else {
            assert_ok(lg_surrogate_problem_check(&problem, NULL));
            assert_close(whole_loss(&problem, s.theta, NULL), loss_from_curves(&s, &problem), 1e-12, 0.0);
        }
        free_small(&s);
    }
    free_curves(&set);
}

static void refusals(void **state) {
    (void)state;
    static const uint32_t beyond[2] = {0, CURVES};
    lg_elastica_curves set, longer;
    small s;
    make_curves(&set, CURVES, 6);
    longer = set;
    longer.length = 3.4;
    make_small(&s, 2, 6, TEST_LENGTH, 13);
    const lg_surrogate_problem good = {&s.model, &set, everything, CURVES};
    lg_surrogate_problem problem = good;
    assert_ok(lg_surrogate_problem_check(&problem, NULL));
    problem.training_count = 0;
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    problem = good;
    problem.curves = NULL;
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    problem = good;
    problem.training = beyond;
    problem.training_count = 2;
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    problem = good;
    problem.curves = &longer;
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_SHAPE);
    longer.length = NAN;
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_SHAPE);
    free_small(&s);
    free_curves(&set);
}

/* 2^32 points: 43000 curves of 100001 nodes, all the same one. */
static void too_many_samples(void **state) {
    (void)state;
    enum { LEARNED = 43000 };
    small s;
    double number = 0.0;
    const lg_elastica_curves set = {.count = 1,
                                    .intervals = 100000,
                                    .length = TEST_LENGTH,
                                    .boundary = &number,
                                    .q = &number,
                                    .v = &number};
    uint32_t *training = calloc(LEARNED, sizeof *training);
    make_small(&s, 2, 6, TEST_LENGTH, 13);
    lg_surrogate_problem problem = {&s.model, &set, training, LEARNED};
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    problem.training_count = 42900;
    assert_ok(lg_surrogate_problem_check(&problem, NULL));
    free(training);
    free_small(&s);
}

/* A few epochs through lg_fit, the batch no multiple of the chunk, for every kind: the loss falls to a
 * fraction. */
static void training_learns(void **state) {
    (void)state;
    lg_elastica_curves set;
    make_curves(&set, CURVES, 50);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        lg_fit_problem fit_problem;
        lg_fit_options options;
        lg_fit *fit;
        make_small(&s, which, 50, TEST_LENGTH, 14);
        const lg_surrogate_problem problem = {&s.model, &set, everything, CURVES};
        lg_surrogate_fit_problem(&problem, &fit_problem);
        lg_fit_options_init(&options);
        options.epochs = 30;
        options.dtype = LG_F32;
        options.shards = 2;
        options.batch = s.model.options.kind == LG_SURROGATE_CONTINUOUS ? 300 : 5;
        options.adam.lr = 1e-2;
        const double before = whole_loss(&problem, s.theta, NULL);
        assert_ok(lg_fit_create(NULL, &fit_problem, &options, s.theta, &fit, NULL));
        assert_ok(lg_fit_run(fit, NULL));
        lg_fit_parameters(fit, s.theta);
        const double after = whole_loss(&problem, s.theta, NULL);
        lg_fit_destroy(fit);
        assert_true(after < 0.6 * before);
        free_small(&s);
    }
    free_curves(&set);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_loss_is_that_of_the_curves),
        cmocka_unit_test(samples_between_the_nodes),
        cmocka_unit_test(two_intervals),
        cmocka_unit_test(parts_add_up),
        cmocka_unit_test(gradients),
        cmocka_unit_test(single_precision),
        cmocka_unit_test(mirror_images_are_one),
        cmocka_unit_test(a_discrete_network_that_is_right),
        cmocka_unit_test(another_number_of_nodes),
        cmocka_unit_test(refusals),
        cmocka_unit_test(too_many_samples),
        cmocka_unit_test(training_learns),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
