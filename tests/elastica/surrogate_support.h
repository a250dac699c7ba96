/* Small surrogates, and smooth curves with unit tangents as training data, made without the solver. */
#ifndef LG_SURROGATE_SUPPORT_H
#define LG_SURROGATE_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/elastica.h"
#include "support/modes.h"

#define TEST_LENGTH 3.3
#define TEST_PI     3.14159265358979323846

/* Options used in the tests: every kind, with and without its options. */
static const lg_surrogate_options test_options[] = {
    SURROGATE(DISCRETE, MLP, 0, 13, 2, TANH, .gamma = 0.0),
    SURROGATE(DISCRETE, RESNET, 0, 13, 1, TANH, .normalise = true, .mirror = true, .gamma = 0.3),
    SURROGATE(CONTINUOUS, MULT_AFFINE, 0, 11, 2, TANH, .gamma = 0.0),
    SURROGATE(CONTINUOUS, MULT, 7, 11, 2, TANH, .normalise = true, .mirror = true, .gamma = 0.02),
    SURROGATE(CONTINUOUS, MULT_AFFINE, 7, 10, 1, TANH, .normalise = true, .gamma = 2.0),
    SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .gamma = 0.3, .penalty = LG_SURROGATE_WEIGHTED),
    SURROGATE(CONTINUOUS, MULT, 7, 11, 1, TANH, .normalise = true, .mirror = true, .boundary = true,
              .gamma = 0.02),
    SURROGATE(CONTINUOUS, MLP, 0, 9, 1, TANH, .boundary = true),
    SURROGATE(ANGLE, MULT, 0, 9, 2, TANH, .gamma = 0.0),
    SURROGATE(ANGLE, MULT_AFFINE, 5, 9, 2, TANH, .boundary = true),
    SURROGATE(ANGLE, MLP, 0, 9, 2, TANH, .mirror = true, .boundary = true),
    SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .mirror = true, .symmetric = true),
    SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .boundary = true, .symmetric = true),
    SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .mirror = true, .modes = 3),
    SURROGATE(DISCRETE, MULT, 0, 8, 1, TANH, .normalise = true, .modes = 2, .gamma = 0.4),
    SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .modes = 2, .gamma = 2.0, .penalty = LG_SURROGATE_WEIGHTED),
    SURROGATE(DISCRETE, MULT, 0, 8, 1, TANH, .angles = true),
    SURROGATE(DISCRETE, MLP, 0, 9, 1, TANH, .normalise = true, .mirror = true, .angles = true, .gamma = 0.3),
};
/* Index of the first row of each group, and the number of rows. */
enum { TEST_ANGLE = 8, TEST_MODES = 13, TEST_INNER = 16, TEST_OPTIONS = LG_COUNT(test_options) };

/* A surrogate that the running test owns. */
typedef struct small {
    lg_surrogate model;
    size_t parameters;
    double *theta;
} small;

/* Row `which` of the options, with tanh and parameters drawn by `seed`. */
static inline small make_small(size_t which, uint32_t intervals, double length, uint64_t seed) {
    small s;
    lg_surrogate_options options = test_options[which];
    options.activation = LG_TANH;
    assert_ok(lg_surrogate_init(&s.model, &options, intervals, length, 1.5, NULL));
    give_modes(&s.model);
    s.parameters = lg_surrogate_parameters(&s.model);
    s.theta = TEST_ARRAY(double, s.parameters);
    lg_rng rng = test_rng(seed, which);
    lg_net_initialise(&s.model.net, &rng, s.theta);
    return s;
}

/* Evaluates the curve by a new plan, with the parameters as they are now. */
static inline void typed_curve_of(const small *s, lg_dtype dtype, const double *x, const double *at,
                                  size_t points, double *q, double *v) {
    lg_surrogate_curves *curves;
    const size_t mark = lg_test_owned();
    assert_told(lg_surrogate_curves_create(NULL, &s->model, s->theta, dtype, points, &curves, &told));
    lg_surrogate_curve(curves, x, at, points, q, v, test_work(lg_surrogate_curves_work_size(curves)));
    lg_surrogate_curves_destroy(curves);
    lg_test_give_back(mark);
}

static inline void curve_of(const small *s, const double *x, const double *at, size_t points, double *q,
                            double *v) {
    typed_curve_of(s, LG_F64, x, at, points, q, v);
}

/* The cubic on an interval of length h between two nodes q (2, 2) with the tangents v (2, 2), at t in
 * [0, 1], in Hermite's basis. */
static inline void test_cubic(const double *q, const double *v, double h, double t, double *point) {
    const double u = 1.0 - t;
    for (size_t c = 0; c < 2; c++)
        point[c] = u * u * ((1.0 + 2.0 * t) * q[c] + h * t * v[c]) +
                   t * t * ((1.0 + 2.0 * u) * q[2 + c] - h * u * v[2 + c]);
}

/* theta(s) of curve i; even and odd curves bend to opposite sides. */
static inline double test_angle(size_t i, double t) {
    const double a = 0.4 + 0.23 * (double)i, side = i % 2 == 0 ? 1.0 : -1.0;
    return side * (a * (1.0 - 2.0 * t) + 0.3 * a * t * t + 0.1 * sin(2.0 * TEST_PI * t));
}

/* n curves of N intervals; q by Simpson's rule on fine panels. */
static inline lg_elastica_curves make_curves(size_t n, uint32_t intervals) {
    enum { FINE = 20 };
    const size_t nodes = (size_t)intervals + 1;
    const lg_elastica_curves set = {.count = n,
                                    .intervals = intervals,
                                    .length = TEST_LENGTH,
                                    .stiffness = 10.0,
                                    .boundary = TEST_ARRAY(double, 8 * n),
                                    .q = TEST_ARRAY(double, 2 * nodes * n),
                                    .v = TEST_ARRAY(double, 2 * nodes * n)};
    for (size_t i = 0; i < n; i++) {
        double *q = set.q + 2 * nodes * i, *v = set.v + 2 * nodes * i, *x = set.boundary + 8 * i;
        const double h = 1.0 / ((double)intervals * FINE);
        q[0] = 0.01 * (double)i;
        q[1] = -0.02 * (double)i;
        for (size_t k = 0; k < nodes; k++) {
            const double t = (double)k / intervals;
            v[2 * k] = cos(test_angle(i, t));
            v[2 * k + 1] = sin(test_angle(i, t));
            if (k + 1 == nodes) break;
            double sum[2] = {0.0, 0.0};
            for (size_t j = 0; j < FINE; j++)
                for (size_t e = 0; e < 3; e++) {
                    const double angle = test_angle(i, t + ((double)j + 0.5 * (double)e) * h);
                    sum[0] += (e == 1 ? 4.0 : 1.0) * cos(angle);
                    sum[1] += (e == 1 ? 4.0 : 1.0) * sin(angle);
                }
            for (size_t c = 0; c < 2; c++) q[2 * k + 2 + c] = q[2 * k + c] + TEST_LENGTH * h / 6.0 * sum[c];
        }
        memcpy(x, q, 2 * sizeof *x);
        memcpy(x + 2, v, 2 * sizeof *x);
        memcpy(x + 4, q + 2 * nodes - 2, 2 * sizeof *x);
        memcpy(x + 6, v + 2 * nodes - 2, 2 * sizeof *x);
    }
    return set;
}

/* A training problem with these curves, including the targets if the network has modes. */
static inline lg_surrogate_problem problem_of(const small *s, const lg_elastica_curves *set,
                                              const uint32_t *training, size_t count) {
    const size_t modes = s->model.options.modes;
    lg_surrogate_problem problem = {&s->model, set, training, count, NULL};
    if (modes == 0) return problem;
    double *coefficients = TEST_ARRAY(double, modes *count);
    assert_ok(lg_surrogate_coefficients(NULL, &s->model, set, training, count, coefficients, NULL, NULL));
    problem.coefficients = coefficients;
    return problem;
}

#endif
