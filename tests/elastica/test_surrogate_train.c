/* Losses of the surrogates: on a tape and computed from the curves, parts of batches, gradients, refusals.
 * ctest-labels: src/elastica */
#include "elastica/surrogate_support.h"
#include "support/narrow_tape.h"

#include "elastica/surrogate_internal.h"

enum { CURVES = 7, MANY = 2000 };

static size_t samples_of(const lg_surrogate_problem *problem, uint32_t *samples) {
    lg_fit_problem fit;
    lg_surrogate_fit_problem(problem, &fit);
    assert_true(fit.samples <= MANY);
    for (size_t i = 0; i < fit.samples; i++) samples[i] = (uint32_t)i;
    return fit.samples;
}

/* The part of the loss that belongs to these samples, and its gradient if requested (f64). */
static double loss_of(const lg_surrogate_problem *problem, lg_dtype dtype, const double *theta,
                      const uint32_t *samples, size_t count, size_t batch, double *gradient) {
    lg_fit_problem fit;
    lg_tape *tape = test_tape(dtype);
    lg_var loss = LG_NONE;
    double value = NAN;
    lg_surrogate_fit_problem(problem, &fit);
    const lg_shape shape = lg_shape1((uint32_t)fit.parameters);
    const lg_var parameters =
        gradient != NULL ? lg_parameter(tape, shape, theta) : lg_input_f64(tape, shape, theta);
    const lg_status status = fit.loss(fit.user, tape, parameters, samples, count, batch, &loss);
    if (status != LG_OK) fail_msg("%s: %s", lg_status_name(status), lg_tape_message(tape));
    assert_ok(lg_read(tape, loss, 1, &value));
    void *out = gradient;
    if (gradient != NULL) assert_ok(lg_backward_set(tape, loss, &parameters, 1, &out));
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

/* q at the nodes, by Gauss's rule with 3 points on each interval of the data, from the model's tangents. */
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

/* Makes q end at qN by distributing the difference evenly. */
static void spread(const double *x, size_t n, double *q) {
    const double rest[2] = {x[4] - q[2 * n], x[5] - q[2 * n + 1]};
    for (size_t i = 0; i < 2 * (n + 1); i++) q[i] += (double)(i / 2) / (double)n * rest[i % 2];
}

/* |W e|^2 of (5.4.1) with W as a matrix; e has the inner numbers of q and v (N + 1, 2). */
static double weighted_square(const double *q, const double *v, size_t n, double gamma) {
    const size_t inner = 2 * (n - 1), m = 2 * inner;
    double *g = TEST_ARRAY(double, m *m), sum = 0.0;
    for (size_t i = 0; i < m; i++) {
        g[m * i + i] = -1.0;
        if (i + 1 < m) g[m * i + i + 1] = 1.0;
    }
    for (size_t i = 0; i < m; i++) {
        double we = 0.0;
        for (size_t j = 0; j < m; j++) {
            double w = i == j ? 1.0 : 0.0;
            for (size_t k = 0; k < m; k++) w += gamma * g[m * k + i] * g[m * k + j];
            we += w * (j < inner ? q[2 + j] : v[2 + j - inner]);
        }
        sum += square(we);
    }
    return sum;
}

/* The loss as the header defines it, computed from the model's curves without a tape. */
static double loss_from_curves(const small *s, const lg_surrogate_problem *problem) {
    const lg_elastica_curves *set = problem->curves;
    const size_t n = set->intervals, nodes = n + 1;
    double *at = TEST_ARRAY(double, nodes), *q = TEST_ARRAY(double, 4 * nodes), *v = q + 2 * nodes;
    double fit = 0.0, rough = 0.0, length = 0.0, weighted = 0.0;
    for (size_t k = 0; k < nodes; k++) at[k] = TEST_LENGTH * (double)k / (double)n;
    at[n] = TEST_LENGTH;
    for (size_t i = 0; i < problem->training_count; i++) {
        const size_t j = problem->training[i];
        curve_of(s, set->boundary + 8 * j, at, nodes, q, v);
        if (s->model.options.kind == LG_SURROGATE_ANGLE) integrate(s, set->boundary + 8 * j, n, q);
        if (s->model.options.symmetric) spread(set->boundary + 8 * j, n, q);
        for (size_t c = 0; c < 2 * nodes; c++) {
            q[c] -= set->q[2 * nodes * j + c];
            if (c % 2 == 1) length += square(square(v[c - 1]) + square(v[c]) - 1.0);
        }
        for (size_t c = 0; c < 2 * nodes; c++) v[c] -= set->v[2 * nodes * j + c];
        for (size_t c = 0; c < 2 * nodes; c++) fit += square(q[c]) + square(v[c]);
        if (s->model.options.penalty == LG_SURROGATE_WEIGHTED)
            weighted += weighted_square(q, v, n, s->model.options.gamma);
        for (size_t c = 0; c < 2 * n; c++) rough += square(q[c + 2] - q[c]) + square(v[c + 2] - v[c]);
    }
    const double m = (double)problem->training_count, gamma = s->model.options.gamma;
    if (s->model.options.penalty == LG_SURROGATE_WEIGHTED) return weighted / (m * 4.0 * (double)(n - 1));
    if (s->model.options.kind == LG_SURROGATE_DISCRETE)
        return fit / (m * 4.0 * (double)(n - 1)) + gamma * rough / (m * 4.0 * (double)n);
    if (s->model.options.kind == LG_SURROGATE_CONTINUOUS)
        return (fit + gamma * length) / (2.0 * m * (double)nodes);
    return fit / (2.0 * m * (double)nodes);
}

static const uint32_t everything[CURVES] = {0, 1, 2, 3, 4, 5, 6};

static void check_loss(const small *s, const lg_elastica_curves *set) {
    const lg_surrogate_problem problem = problem_of(s, set, everything, CURVES);
    assert_ok(lg_surrogate_problem_check(&problem, NULL));
    double expected = loss_from_curves(s, &problem), truncation = 0.0;
    if (problem.coefficients != NULL) {
        double *again = TEST_ARRAY(double, CURVES * s->model.options.modes);
        assert_ok(
            lg_surrogate_coefficients(NULL, &s->model, set, everything, CURVES, again, &truncation, NULL));
        assert_true(truncation > 1e-6 && truncation < expected);
    }
    if (s->model.options.gamma == 0.0) expected -= truncation;
    assert_true(expected > 1e-3);
    assert_close(whole_loss(&problem, s->theta, NULL), expected, 1e-12, 0.0);
}

/* Networks of a continuous s can learn from curves with any number of nodes. */
TEST("the loss on a tape agrees with the loss computed from curves") {
    static const uint32_t intervals[] = {24, 31, 7, 2};
    for (size_t n = 0; n < LG_COUNT(intervals); n++) {
        const lg_elastica_curves set = make_curves(CURVES, intervals[n]);
        for (size_t which = 0; which < TEST_OPTIONS; which++) {
            const small s = make_small(which, intervals[n], TEST_LENGTH, 5);
            const small other = make_small(which, 12, TEST_LENGTH, 12);
            lg_error error;
            check_loss(&s, &set);
            if (s.model.options.kind != LG_SURROGATE_DISCRETE) {
                check_loss(&other, &set);
                continue;
            }
            const lg_surrogate_problem problem = {&other.model, &set, everything, CURVES, NULL};
            assert_status(lg_surrogate_problem_check(&problem, &error), LG_SHAPE);
            assert_non_null(strstr(error.message, "a discrete network for 12 intervals;"));
        }
    }
}

/* E L/EI with continued angles, computed from tangents (N + 1, 2). */
static double energy_of(const double *x, const double *v, uint32_t n) {
    double *theta = TEST_ARRAY(double, n + 1);
    theta[0] = atan2(v[1], v[0]);
    for (size_t k = 0; k < n; k++)
        theta[k + 1] = theta[k] + atan2(v[2 * k] * v[2 * k + 3] - v[2 * k + 1] * v[2 * k + 2],
                                        v[2 * k] * v[2 * k + 2] + v[2 * k + 1] * v[2 * k + 3]);
    const lg_elastica problem = {
        .length = TEST_LENGTH, .stiffness = 7.0, .q0 = {x[0], x[1]}, .qN = {x[4], x[5]}, .intervals = n};
    return lg_elastica_energy(&problem, theta) * TEST_LENGTH / 7.0;
}

TEST("the loss of energies is the model's energy over that of the data, and its gradient does not use "
     "the curves") {
    enum { M = 12, NODES = M + 1 };
    for (size_t which = TEST_INNER; which < TEST_OPTIONS; which++) {
        small s = make_small(which, M, TEST_LENGTH, 5);
        lg_elastica_curves set = make_curves(CURVES, M);
        double at[NODES], v[2 * NODES], expected = 0.0, given = 0.0;
        double *gradient = TEST_ARRAY(double, 2 * s.parameters);
        s.model.options.loss = LG_SURROGATE_ENERGY;
        for (size_t k = 0; k < NODES; k++) at[k] = TEST_LENGTH * (double)k / M;
        for (size_t i = 0; i < CURVES; i++) {
            const double *x = set.boundary + 8 * i;
            curve_of(&s, x, at, NODES, NULL, v);
            expected += energy_of(x, v, M) / CURVES;
            given += energy_of(x, set.v + 2 * NODES * i, M) / CURVES;
        }
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
        assert_ok(lg_surrogate_problem_check(&problem, NULL));
        assert_close(whole_loss(&problem, s.theta, gradient), expected - given, 0.0, 1e-12 * expected);
        for (size_t i = 0; i < CURVES; i++)
            for (size_t k = 1; k < M; k++) set.v[2 * (NODES * i + k)] = set.q[2 * (NODES * i + k)] = 0.1;
        const double moved = whole_loss(&problem, s.theta, gradient + s.parameters);
        assert_true(fabs(moved - (expected - given)) > 1.0);
        assert_memory_equal(gradient, gradient + s.parameters, s.parameters * sizeof *gradient);
    }
}

TEST("trained on boundary conditions alone, the network finds the same beams as the solver") {
    enum { M = 10, BEAMS = 12 };
    lg_elastica_sampling sampling;
    lg_elastica_curves set;
    lg_surrogate_errors errors;
    uint32_t all[BEAMS];
    lg_elastica_sampling_init(&sampling);
    sampling.count = BEAMS;
    sampling.gap = 0.1;
    sampling.problem.intervals = M;
    assert_ok(lg_elastica_generate(NULL, &sampling, &set, NULL));
    small s = make_small(TEST_INNER + 1, M, TEST_LENGTH, 3);
    s.model.options.loss = LG_SURROGATE_ENERGY;
    for (uint32_t i = 0; i < BEAMS; i++) all[i] = i;
    const lg_surrogate_problem problem = problem_of(&s, &set, all, BEAMS);
    lg_fit_problem fit_problem;
    lg_fit_options options;
    lg_fit *fit;
    lg_surrogate_fit_problem(&problem, &fit_problem);
    lg_fit_options_init(&options);
    assert_ok(lg_fit_plan_parse("ssbroyden", true, &options.plan, NULL));
    options.epochs = 600;
    assert_ok(lg_fit_create(NULL, &fit_problem, &options, s.theta, &fit, NULL));
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, s.theta);
    assert_ok(lg_surrogate_evaluate(NULL, &s.model, s.theta, &set, NULL, 0, NULL, &errors, NULL));
    print_message("energy above the minimum %.2e, mean square error %.2e\n", lg_fit_loss(fit), errors.mse);
    assert_true(errors.mse < 1e-8 && fabs(lg_fit_loss(fit)) < 1e-5);
    lg_fit_destroy(fit);
    lg_elastica_curves_destroy(&set);
}

/* A cubic in s, different for each curve and component, and its derivative. */
static void cubic(size_t curve, double s, double *q, double *v) {
    const double a = 0.3 + 0.1 * (double)curve;
    q[0] = a + s - 0.2 * s * s + 0.05 * a * s * s * s, v[0] = 1.0 - 0.4 * s + 0.15 * a * s * s;
    q[1] = 0.1 - a * s + 0.3 * s * s - 0.02 * s * s * s, v[1] = -a + 0.6 * s - 0.06 * s * s;
}

TEST("samples between the nodes are points of cubics, which both interpolations reproduce") {
    enum { ENDS = 20 };
    uint32_t ends = 0;
    for (size_t which = 0; which < 8; which++) {
        const uint32_t M = which < 4 ? 9 : 4;
        lg_elastica_curves set = make_curves(CURVES, M);
        for (size_t i = 0; i < CURVES; i++)
            for (size_t k = 0; k <= M; k++)
                cubic(i, TEST_LENGTH * (double)k / M, set.q + 2 * ((M + 1) * i + k),
                      set.v + 2 * ((M + 1) * i + k));
        small s = make_small(3 + which % 4 / 2, M, TEST_LENGTH, 6);
        set.continuous = which % 2 == 1;
        s.model.options.between = true;
        const double gamma = s.model.options.gamma;
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
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
    }
    assert_true(ends >= ENDS);
}

TEST("parts of a batch, down to single samples, add up to the same loss and gradient") {
    static const uint32_t training[3] = {5, 0, 2};
    lg_elastica_curves set = make_curves(CURVES, 6);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 6, TEST_LENGTH, 7);
        uint32_t samples[MANY];
        const lg_surrogate_problem problem = problem_of(&s, &set, training, 3);
        const size_t n = samples_of(&problem, samples);
        double *gradient = TEST_ARRAY(double, 3 * s.parameters), *part = gradient + s.parameters;
        double *sum = part + s.parameters, total = 0.0;
        assert_int_equal(n, s.model.options.kind == LG_SURROGATE_CONTINUOUS ? 21 : 3);
        const double whole = loss_of(&problem, LG_F64, s.theta, samples, n, n, gradient);
        for (size_t i = 0; i < n; i++) {
            total += loss_of(&problem, LG_F64, s.theta, samples + i, 1, n, part);
            for (size_t k = 0; k < s.parameters; k++) sum[k] += part[k];
        }
        assert_close(total, whole, 1e-13, 0.0);
        for (size_t k = 0; k < s.parameters; k++) assert_close(sum[k], gradient[k], 1e-11, 1e-13);
    }
}

TEST("single precision agrees with double precision to rounding") {
    lg_elastica_curves set = make_curves(CURVES, 20);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 20, TEST_LENGTH, 9);
        uint32_t samples[MANY];
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
        const size_t n = samples_of(&problem, samples);
        const double exact = loss_of(&problem, LG_F64, s.theta, samples, n, n, NULL);
        assert_close(loss_of(&problem, LG_F32, s.theta, samples, n, n, NULL), exact, 2e-5, 0.0);
    }
}

TEST("a problem with modes needs the modes' numbers, and targets if its loss is on coefficients") {
    const lg_elastica_curves set = make_curves(CURVES, 6);
    for (size_t which = TEST_MODES; which < TEST_INNER; which++) {
        small s = make_small(which, 6, TEST_LENGTH, 13);
        const lg_surrogate_problem bare = {&s.model, &set, everything, CURVES, NULL};
        const bool targets = s.model.options.gamma == 0.0;
        assert_status(lg_surrogate_problem_check(&bare, NULL), targets ? LG_INVALID_ARGUMENT : LG_OK);
        const lg_surrogate_problem whole = problem_of(&s, &set, everything, CURVES);
        assert_ok(lg_surrogate_problem_check(&whole, NULL));
        s.model.modes = NULL;
        assert_status(lg_surrogate_problem_check(&whole, NULL), LG_INVALID_ARGUMENT);
    }
}

TEST("problems without curves, with other curves or with another length are refused") {
    static const uint32_t beyond[2] = {0, CURVES};
    const small s = make_small(2, 6, TEST_LENGTH, 13);
    const lg_elastica_curves set = make_curves(CURVES, 6);
    lg_elastica_curves longer = set, endless = set;
    longer.length = 3.4;
    endless.length = NAN;
    lg_elastica_curves bad[5];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = set;
    bad[0].boundary = bad[1].q = bad[2].v = NULL, bad[3].intervals = 1;
    bad[4].intervals = LG_ELASTICA_MAX_INTERVALS + 1;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        const lg_surrogate_problem problem = {&s.model, &bad[i], everything, CURVES, NULL};
        assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    }
    const struct {
        lg_surrogate_problem problem;
        lg_status status;
    } cases[] = {{{&s.model, &set, everything, CURVES, NULL}, LG_OK},
                 {{&s.model, &set, everything, 0, NULL}, LG_INVALID_ARGUMENT},
                 {{&s.model, NULL, everything, CURVES, NULL}, LG_INVALID_ARGUMENT},
                 {{NULL, &set, everything, CURVES, NULL}, LG_INVALID_ARGUMENT},
                 {{&s.model, &set, NULL, CURVES, NULL}, LG_INVALID_ARGUMENT},
                 {{&s.model, &set, beyond, 2, NULL}, LG_INVALID_ARGUMENT},
                 {{&s.model, &longer, everything, CURVES, NULL}, LG_SHAPE},
                 {{&s.model, &endless, everything, CURVES, NULL}, LG_SHAPE}};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_status(lg_surrogate_problem_check(&cases[i].problem, NULL), cases[i].status);
}

typedef struct narrow_loss {
    lg_fit_problem fit;
    const double *theta;
} narrow_loss;

static lg_status record_loss(lg_tape *tape, const void *user) {
    const narrow_loss *l = user;
    uint32_t samples[MANY];
    lg_var loss;
    const size_t count = l->fit.samples < CURVES ? l->fit.samples : CURVES;
    for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)i;
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)l->fit.parameters), l->theta);
    return l->fit.loss(l->fit.user, tape, theta, samples, count, count, &loss);
}

TEST("recording a loss may run out of memory at any point") {
    const lg_elastica_curves set = make_curves(CURVES, 6);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        const small s = make_small(which, 6, TEST_LENGTH, 13);
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
        narrow_loss l = {.theta = s.theta};
        lg_surrogate_fit_problem(&problem, &l.fit);
        assert_true(record_narrow(LG_F64, record_loss, &l) > 0);
    }
}

TEST("more points than a sample index can number are refused") {
    enum { LEARNED = 43000 };
    const small s = make_small(2, 6, TEST_LENGTH, 13);
    double number = 0.0;
    const lg_elastica_curves set = {.count = 1,
                                    .intervals = 100000,
                                    .length = TEST_LENGTH,
                                    .boundary = &number,
                                    .q = &number,
                                    .v = &number};
    uint32_t *training = TEST_ARRAY(uint32_t, LEARNED);
    lg_surrogate_problem problem = {&s.model, &set, training, LEARNED, NULL};
    assert_status(lg_surrogate_problem_check(&problem, NULL), LG_INVALID_ARGUMENT);
    problem.training_count = 42900;
    assert_ok(lg_surrogate_problem_check(&problem, NULL));
    const small turned = make_small(TEST_ANGLE, 6, TEST_LENGTH, 13);
    const uint32_t most = UINT32_MAX / (4 * set.intervals + 1);
    lg_fit_problem fit;
    lg_var loss;
    problem.model = &turned.model;
    lg_surrogate_fit_problem(&problem, &fit);
    assert_int_equal(fit.chunk, 1);
    lg_tape *tape = test_tape(LG_F64);
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)fit.parameters), turned.theta);
    assert_status(fit.loss(fit.user, tape, theta, training, most + 1, most + 1, &loss), LG_SHAPE);
}

TEST("a few epochs reduce the loss of every kind to a fraction") {
    lg_elastica_curves set = make_curves(CURVES, 50);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s = make_small(which, 50, TEST_LENGTH, 14);
        double *modes = TEST_ARRAY(double, lg_surrogate_modes_size(&s.model) + 1);
        if (s.model.options.modes > 0) {
            assert_ok(lg_surrogate_find_modes(NULL, &s.model, &set, everything, CURVES, modes, NULL));
            s.model.modes = modes;
        }
        lg_fit_problem fit_problem;
        lg_fit_options options;
        lg_fit *fit;
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
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
        assert_true(after < 0.6 * before);
        lg_fit_destroy(fit);
    }
}
