/* Energy and residual in the losses of the surrogates: against beams of the solver, against plain code, and
 * as the only thing that a network learns from.
 * ctest-labels: src/elastica */
#include "elastica/surrogate_support.h"

#include "elastica/surrogate_internal.h"

/* With N = 50 the curves are integrated over the same panels as in the loss. */
enum { CURVES = 7, N = 50, NODES = N + 1, STENCIL = 3 };

static const lg_surrogate_options cases[] = {
    SURROGATE(CONTINUOUS, MLP, 0, 9, 1, TANH, .mirror = true, .residual = 0.3),
    SURROGATE(CONTINUOUS, MULT, 5, 8, 1, TANH, .normalise = true, .boundary = true, .residual = 0.3),
    SURROGATE(CONTINUOUS, MLP, 0, 9, 1, TANH, .mirror = true, .boundary = true, .energy = 0.2, .gamma = 0.5),
    SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .mirror = true, .residual = 0.3),
    SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .symmetric = true, .boundary = true, .residual = 0.3),
    SURROGATE(ANGLE, MULT, 0, 8, 1, TANH, .mirror = true, .boundary = true, .energy = 0.2, .residual = 0.1),
};

/* A network whose parameters are `scale` times the initial ones. */
static small make_case(const lg_surrogate_options *options, uint32_t intervals, double scale, uint64_t seed) {
    small s;
    lg_rng rng = test_rng(seed, 1);
    assert_ok(lg_surrogate_init(&s.model, options, intervals, TEST_LENGTH, 1.5, NULL));
    s.parameters = lg_surrogate_parameters(&s.model);
    s.theta = TEST_ARRAY(double, s.parameters);
    lg_net_initialise(&s.model.net, &rng, s.theta);
    for (size_t i = 0; i < s.parameters; i++) s.theta[i] *= scale;
    return s;
}

/* The loss of all samples in parts of `each` samples; gradient (parameters), or NULL. */
static double loss_of(const lg_surrogate_problem *problem, lg_dtype dtype, const double *theta, size_t each,
                      double *gradient) {
    lg_fit_problem fit;
    double total = 0.0;
    lg_surrogate_fit_problem(problem, &fit);
    for (size_t i = 0; gradient != NULL && i < fit.parameters; i++) gradient[i] = 0.0;
    for (size_t first = 0; first < fit.samples; first += each) {
        lg_tape *tape = test_tape(dtype);
        const lg_shape shape = lg_shape1((uint32_t)fit.parameters);
        const lg_var parameters =
            gradient != NULL ? lg_parameter(tape, shape, theta) : lg_input_f64(tape, shape, theta);
        uint32_t samples[CURVES];
        double value = NAN;
        lg_var loss = LG_NONE;
        void *out = gradient;
        const size_t count = fit.samples - first < each ? fit.samples - first : each;
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)(first + i);
        assert_ok(fit.loss(fit.user, tape, parameters, samples, count, fit.samples, &loss));
        assert_ok(lg_read(tape, loss, 1, &value));
        if (gradient != NULL) assert_ok(lg_backward(tape, loss, &parameters, 1, &out));
        total += value;
    }
    return total;
}

static const uint32_t everything[CURVES] = {0, 1, 2, 3, 4, 5, 6};

/* Calls lg_surrogate_moments for one curve: errors (n). Returns the largest. */
static double moments_of(const small *s, const double *turning, const double *x, const double *y, size_t n,
                         double *errors) {
    lg_tape *tape = test_tape(LG_F64);
    const lg_shape row = lg_shape2(1, (uint32_t)n);
    double largest = 0.0;
    const lg_var e = lg_surrogate_moments(tape, &s->model, lg_input_f64(tape, row, turning),
                                          lg_input_f64(tape, row, x), lg_input_f64(tape, row, y));
    assert_ok(lg_read(tape, e, n, errors));
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(errors[i]));
    return largest;
}

TEST("along beams of the solver the moment is linear in the position, with the solver's force") {
    enum { FINE = 600, INNER = FINE + 1 - 2 * STENCIL };
    static const double weights[STENCIL] = {3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0};
    static double theta[FINE + 1], q[2 * (FINE + 1)], v[2 * (FINE + 1)];
    static double turning[INNER], x[INNER], y[INNER], errors[INNER];
    const small s = make_case(&cases[3], FINE, 1.0, 1);
    for (size_t beam = 0; beam < 4; beam++) {
        lg_elastica problem;
        lg_elastica_solution solution;
        double force[2], largest = 0.0;
        lg_elastica_init(&problem);
        problem.intervals = FINE;
        lg_elastica_set_case(&problem, beam < 2 ? LG_ELASTICA_BOTH_ENDS : LG_ELASTICA_RIGHT_END,
                             beam % 2 == 0 ? 0.9 : 1.9);
        assert_ok(lg_elastica_solve_continuous(NULL, &problem, NULL, theta, q, &solution, NULL));
        for (size_t i = 0; i < INNER; i++) {
            const size_t k = i + STENCIL;
            turning[i] = 0.0, x[i] = q[2 * k], y[i] = q[2 * k + 1];
            for (size_t j = 0; j < STENCIL; j++)
                turning[i] += weights[j] * (theta[k + j + 1] - theta[k - j - 1]) * FINE / problem.length;
        }
        for (size_t i = 0; i < INNER; i++) largest = fmax(largest, fabs(problem.length * turning[i]));
        assert_true(moments_of(&s, turning, x, y, INNER, errors) < 1e-6 * largest);
        for (size_t i = 0; i < INNER; i++) turning[i] += 0.1 * largest * sin(20.0 * (double)i / INNER);
        assert_true(moments_of(&s, turning, x, y, INNER, errors) > 0.01 * largest);
        lg_elastica_curve(&problem, theta, NULL, v);
        lg_surrogate_force(problem.length, FINE, q, v, force);
        for (size_t c = 0; c < 2; c++)
            assert_close(force[c], solution.force[c] * problem.length * problem.length / problem.stiffness,
                         1e-6, 1e-6 * largest);
    }
}

TEST("a straight curve along an axis has no force") {
    double x[2 * NODES] = {0.0}, v[2 * NODES] = {0.0}, force[2] = {7.0, 7.0};
    for (size_t k = 0; k < NODES; k++) x[2 * k] = TEST_LENGTH * (double)k / N, v[2 * k] = 1.0;
    lg_surrogate_force(TEST_LENGTH, N, x, v, force);
    assert_true(force[0] == 0.0 && force[1] == 0.0);
}

/* ---- the same terms by plain code ---- */

/* dv/ds at n places by central differences of order 6: (n, 2). The places are farther apart than the
 * differences reach. */
static void slopes_of(const small *s, const double *x, const double *places, size_t n, double *out) {
    static const double weights[STENCIL] = {3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0};
    enum { AROUND = 2 * STENCIL };
    const double step = 2e-3;
    double *at = TEST_ARRAY(double, AROUND *n), *v = TEST_ARRAY(double, 2 * AROUND * n);
    for (size_t i = 0; i < AROUND * n; i++) {
        const double k = (double)(i % AROUND) - STENCIL;
        at[i] = places[i / AROUND] + step * (k < 0.0 ? k : k + 1.0);
    }
    curve_of(s, x, at, AROUND * n, NULL, v);
    for (size_t i = 0; i < 2 * n; i++) {
        const double *here = v + 2 * AROUND * (i / 2) + i % 2;
        out[i] = 0.0;
        for (size_t j = 0; j < STENCIL; j++)
            out[i] += weights[j] * (here[2 * (STENCIL + j)] - here[2 * (STENCIL - 1 - j)]) / step;
    }
}

static double cross(const double *v, const double *a) {
    return v[0] * a[1] - v[1] * a[0];
}

/* Positions, tangents and q' x q'' at points of a curve: at the nodes, or (angle network) the Gauss
 * points. */
enum { MOST = LG_GAUSS_POINTS * N };
typedef struct beam {
    size_t points;
    double q[2 * MOST], v[2 * MOST], turning[MOST];
} beam;

/* Least squares of three unknowns: L turning = m + fx y/L - fy x/L. Returns the mean square left. */
static double left_of(const beam *b) {
    double a[3][4] = {{0.0}}, sum = 0.0, unknown[3];
    for (size_t k = 0; k < b->points; k++) {
        const double row[4] = {1.0, b->q[2 * k + 1] / TEST_LENGTH, -b->q[2 * k] / TEST_LENGTH,
                               TEST_LENGTH * b->turning[k]};
        for (size_t i = 0; i < 3; i++)
            for (size_t j = 0; j < 4; j++) a[i][j] += row[i] * row[j];
    }
    for (size_t p = 0; p < 3; p++)
        for (size_t i = 0; i < 3; i++) {
            const double factor = i == p ? 0.0 : a[i][p] / a[p][p];
            for (size_t j = p; j < 4; j++) a[i][j] -= factor * a[p][j];
        }
    for (size_t p = 0; p < 3; p++) unknown[p] = a[p][3] / a[p][p];
    for (size_t k = 0; k < b->points; k++) {
        const double load =
            unknown[0] + unknown[1] * b->q[2 * k + 1] / TEST_LENGTH - unknown[2] * b->q[2 * k] / TEST_LENGTH;
        sum += (TEST_LENGTH * b->turning[k] - load) * (TEST_LENGTH * b->turning[k] - load);
    }
    return sum / (double)b->points;
}

/* Weight of point k in an integral over the curve: Gauss's rule on the intervals, or Gregory's over the
 * nodes. */
static double weight_of(const beam *b, size_t k) {
    static const double ends[3] = {3.0 / 8.0, 7.0 / 6.0, 23.0 / 24.0};
    const double h = TEST_LENGTH / N;
    const size_t from = k < N - k ? k : N - k;
    if (b->points != NODES) return h * lg_gauss_weight[k % LG_GAUSS_POINTS];
    return h * (from < 3 ? ends[from] : 1.0);
}

static beam beam_of(const small *s, const double *x) {
    const bool angle = s->model.options.kind == LG_SURROGATE_ANGLE;
    const double h = TEST_LENGTH / N;
    double at[NODES], q[2 * NODES], v[2 * NODES], places[MOST], a[2 * MOST];
    beam b = {.points = angle ? MOST : NODES};
    for (size_t k = 0; k < NODES; k++) at[k] = h * (double)k;
    curve_of(s, x, at, NODES, q, v);
    for (size_t k = 0; k < b.points; k++)
        places[k] = angle ? h * ((double)(k / LG_GAUSS_POINTS) + lg_gauss_at[k % LG_GAUSS_POINTS]) : at[k];
    curve_of(s, x, places, b.points, b.q, b.v);
    slopes_of(s, x, places, b.points, a);
    for (size_t k = 0; k < b.points; k++) {
        const size_t node = k / LG_GAUSS_POINTS;
        if (angle) test_cubic(q + 2 * node, v + 2 * node, h, lg_gauss_at[k % LG_GAUSS_POINTS], b.q + 2 * k);
        b.turning[k] = cross(b.v + 2 * k, a + 2 * k);
    }
    return b;
}

/* residual and energy of curve i of a set. */
static void terms_of(const small *s, const lg_elastica_curves *set, size_t i, double *residual,
                     double *energy) {
    const double *x = set->boundary + 8 * i;
    beam b = beam_of(s, x);
    double force[2], reached[2] = {0.0, 0.0};
    *residual = left_of(&b);
    *energy = 0.0;
    for (size_t k = 0; k < b.points; k++) {
        const double *v = b.v + 2 * k, square = v[0] * v[0] + v[1] * v[1], weight = weight_of(&b, k);
        b.turning[k] /= square;
        *energy += 0.5 * TEST_LENGTH * weight * b.turning[k] * b.turning[k];
        for (size_t c = 0; c < 2; c++) reached[c] += weight * v[c] / sqrt(square);
    }
    lg_surrogate_force(TEST_LENGTH, N, set->q + 2 * NODES * i, set->v + 2 * NODES * i, force);
    for (size_t c = 0; c < 2; c++) {
        const double r = (x[4 + c] - x[c] - reached[c]) / TEST_LENGTH;
        *energy += force[c] * r + 18.0 * N * N * r * r;
    }
}

/* The weights are chosen so that each term adds the number in the table. */
TEST("both terms agree with plain code, and their weights multiply them") {
    lg_elastica_curves set = make_curves(CURVES, N);
    double known[CURVES];
    for (size_t which = 0; which < LG_COUNT(cases); which++) {
        small s = make_case(&cases[which], N, 3.0, 3);
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
        const lg_surrogate_options weights = s.model.options;
        double residual = 0.0, energy = 0.0;
        for (size_t i = 0; i < CURVES; i++) {
            double r, e;
            terms_of(&s, &set, i, &r, &e);
            residual += r / CURVES, energy += e / CURVES;
            known[i] = (double)i;
        }
        s.model.options.energy = s.model.options.residual = 0.0;
        double plain = 0.0;
        {
            lg_fit_problem fit;
            lg_tape *tape = test_tape(LG_F64);
            uint32_t samples[CURVES * NODES];
            lg_var loss = LG_NONE;
            lg_surrogate_fit_problem(&problem, &fit);
            for (size_t i = 0; i < fit.samples; i++) samples[i] = (uint32_t)i;
            const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)fit.parameters), s.theta);
            assert_ok(fit.loss(fit.user, tape, theta, samples, fit.samples, fit.samples, &loss));
            assert_ok(lg_read(tape, loss, 1, &plain));
        }
        s.model.options.energy = weights.energy / energy;
        s.model.options.residual = weights.residual / residual;
        const double more = weights.energy + weights.residual;
        assert_close(loss_of(&problem, LG_F64, s.theta, CURVES, NULL) - plain, more, 1e-7, 0.0);
        set.energy = known;
        assert_close(loss_of(&problem, LG_F64, s.theta, CURVES, NULL) - plain,
                     more - weights.energy / energy * 3.0 * TEST_LENGTH / set.stiffness, 1e-7, 0.0);
        set.energy = NULL;
    }
}

TEST("the discrete network adds its energy times the weight") {
    static const lg_surrogate_options options =
        SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .mirror = true, .angles = true);
    const lg_elastica_curves set = make_curves(CURVES, N);
    small s = make_case(&options, N, 1.0, 6);
    const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
    const double curves = loss_of(&problem, LG_F64, s.theta, CURVES, NULL);
    s.model.options.energy = 0.2;
    const double both = loss_of(&problem, LG_F64, s.theta, CURVES, NULL);
    s.model.options.energy = 0.0;
    s.model.options.loss = LG_SURROGATE_ENERGY;
    const double energy = loss_of(&problem, LG_F64, s.theta, CURVES, NULL);
    assert_true(fabs(energy) > curves);
    assert_close(both, curves + 0.2 * energy, 1e-12, 0.0);
}

TEST("curves one by one add up to the same loss and gradient, and single precision agrees") {
    const lg_elastica_curves set = make_curves(CURVES, N);
    for (size_t which = 0; which < LG_COUNT(cases); which++) {
        const small s = make_case(&cases[which], N, 2.0, 4);
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, CURVES);
        double *whole = TEST_ARRAY(double, 2 * s.parameters), *sum = whole + s.parameters;
        const double loss = loss_of(&problem, LG_F64, s.theta, CURVES, whole);
        assert_close(loss_of(&problem, LG_F64, s.theta, 1, sum), loss, 1e-12, 0.0);
        for (size_t k = 0; k < s.parameters; k++) assert_close(sum[k], whole[k], 1e-9, 1e-10 * loss);
        assert_close(loss_of(&problem, LG_F32, s.theta, CURVES, NULL), loss, 1e-3, 0.0);
    }
}

TEST("a network that is told the energy alone finds the beams of the solver") {
    enum { BEAMS = 2 };
    static const struct {
        lg_surrogate_options options;
        double error;
    } learned[] = {
        {SURROGATE(ANGLE, MLP, 0, 12, 1, TANH, .mirror = true, .boundary = true, .energy = 1e4), 1e-5},
        {SURROGATE(DISCRETE, MLP, 0, 12, 1, TANH, .mirror = true, .angles = true, .energy = 1e4), 1e-5},
    };
    for (size_t which = 0; which < LG_COUNT(learned); which++) {
        lg_elastica_sampling sampling;
        lg_elastica_curves set;
        lg_fit_problem fit_problem;
        lg_fit_options options;
        lg_surrogate_errors errors;
        lg_fit *fit;
        lg_elastica_sampling_init(&sampling);
        sampling.count = BEAMS;
        sampling.gap = 0.2;
        sampling.continuous = learned[which].options.kind != LG_SURROGATE_DISCRETE;
        sampling.problem.intervals = N;
        assert_ok(lg_elastica_generate(NULL, &sampling, &set, NULL));
        const small s = make_case(&learned[which].options, N, 1.0, 5);
        const lg_surrogate_problem problem = problem_of(&s, &set, everything, BEAMS);
        lg_surrogate_fit_problem(&problem, &fit_problem);
        lg_fit_options_init(&options);
        assert_ok(lg_fit_plan_parse("ssbroyden", true, &options.plan, NULL));
        options.epochs = 600;
        assert_ok(lg_fit_create(NULL, &fit_problem, &options, s.theta, &fit, NULL));
        assert_ok(lg_fit_run(fit, NULL));
        lg_fit_parameters(fit, s.theta);
        assert_ok(lg_surrogate_evaluate(NULL, &s.model, s.theta, &set, NULL, 0, NULL, &errors, NULL));
        print_message("%s network: mean square error %.2e, loss %.2e\n",
                      lg_surrogate_kind_name(learned[which].options.kind), errors.mse, lg_fit_loss(fit));
        assert_true(errors.mse < learned[which].error);
        lg_fit_destroy(fit);
        lg_elastica_curves_destroy(&set);
    }
}

TEST("terms that a network does not have are refused, with a sentence") {
    static const struct {
        lg_surrogate_options options;
        const char *sentence;
    } refused[] = {
        {SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .residual = 0.1), "no residual"},
        {SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .energy = 0.1), "inner angles"},
        {SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .energy = 0.1, .angles = true, .loss = LG_SURROGATE_ENERGY),
         "the loss mse"},
        {SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .energy = 0.1), "needs `boundary`"},
        {SURROGATE(CONTINUOUS, MLP, 0, 9, 1, TANH, .energy = 0.1, .boundary = true, .between = true),
         "`between` false"},
        {SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .residual = -0.1), "not negative"},
        {SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .boundary = true, .energy = NAN), "must be finite"},
    };
    for (size_t i = 0; i < LG_COUNT(refused); i++) {
        lg_surrogate model;
        lg_error error;
        assert_status(lg_surrogate_init(&model, &refused[i].options, N, TEST_LENGTH, 1.5, &error),
                      LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, refused[i].sentence));
    }
}
