/* Cases of Riccati equations, held inputs, minimisers, least squares, elastica, classifier measures and
 * spectra. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hard.h"
#include "liegrad/control.h"
#include "liegrad/elastica.h"
#include "liegrad/minimise.h"
#include "liegrad/series.h"

static lg_status riccati(const double *in, double *out, bool discrete) {
    const size_t n = (size_t)in[0], m = (size_t)in[1], bytes = lg_riccati_work_size(n, m);
    const double *A = in + 3, *B = A + n * n, *Q = B + n * m, *R = Q + n * n, *S = R + m * m;
    const lg_riccati equation = {sizeof equation, n, m, A, B, Q, R, in[2] != 0 ? S : NULL};
    void *work = aligned_alloc(64, (bytes + 63) / 64 * 64);
    const lg_status status =
        (discrete ? lg_dare : lg_care)(&equation, out, NULL, NULL, NULL, work, bytes, NULL);
    free(work);
    return status;
}

static lg_status care(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return riccati(in, out, false);
}

static lg_status dare(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return riccati(in, out, true);
}

/* inputs: n, m, h, A, B; outputs: Ad, Bd */
static lg_status hold(const double *in, size_t n, double *out, size_t m) {
    (void)m;
    const size_t states = (size_t)in[0], inputs = (size_t)in[1];
    const size_t bytes = lg_zero_order_hold_work_size(states, inputs);
    void *work = aligned_alloc(64, (bytes + 63) / 64 * 64);
    (void)n;
    const lg_status status = lg_zero_order_hold(states, inputs, in + 3, in + 3 + states * states, in[2], out,
                                                out + states * states, work, bytes, NULL);
    free(work);
    return status;
}

/* ---- minimisers: sums of squares of r_i(b); the rows of J are dr_i/db ---- */

typedef struct problem {
    double id;
    size_t n, m;
    const double *x, *y; /* data (m) */
} problem;

/* Residual number i of the model p->id of of_methods.py, and its derivatives d (n), which are zero on
 * entry. */
static double residual(const problem *p, const double *b, size_t i, double *d) {
    const double x = p->x[i], y = p->y[i];
    double value = 0, e, f;
    switch ((int)p->id) {
    case 0: /* b1 (1 - exp(-b2 x)) */
        e = exp(-b[1] * x), d[0] = 1 - e, d[1] = b[0] * x * e;
        return b[0] * (1 - e) - y;
    case 1: /* b1 exp(b2/(x + b3)) */
        e = exp(b[1] / (x + b[2])), d[0] = e, d[1] = b[0] * e / (x + b[2]);
        d[2] = -d[1] * b[1] / (x + b[2]);
        return b[0] * e - y;
    case 2: /* b1 (x^2 + b2 x)/(x^2 + b3 x + b4) */
        e = x * x + b[1] * x, f = x * x + b[2] * x + b[3];
        d[0] = e / f, d[1] = b[0] * x / f, d[2] = -b[0] * e * x / (f * f), d[3] = -b[0] * e / (f * f);
        return b[0] * e / f - y;
    case 3: /* b1 + b2 exp(-b4 x) + b3 exp(-b5 x) */
        e = exp(-b[3] * x), f = exp(-b[4] * x);
        d[0] = 1, d[1] = e, d[2] = f, d[3] = -x * b[1] * e, d[4] = -x * b[2] * f;
        return b[0] + b[1] * e + b[2] * f - y;
    case 4: /* sum of b_2k exp(-b_2k+1 x) */
        for (size_t k = 0; k < p->n; k += 2)
            e = exp(-b[k + 1] * x), d[k] = e, d[k + 1] = -x * b[k] * e, value += b[k] * e;
        return value - y;
    case 5: /* Rosenbrock: 10 (b2 - b1^2), 1 - b1 */
        d[0] = i ? -1 : -20 * b[0], d[1] = i ? 0 : 10;
        return i ? 1 - b[0] : 10 * (b[1] - b[0] * b[0]);
    case 6: /* Brown badly scaled: b1 - 1e6, b2 - 2e-6, b1 b2 - 2 */
        d[0] = i == 0 ? 1 : i == 1 ? 0 : b[1], d[1] = i == 0 ? 0 : i == 1 ? 1 : b[0];
        return i == 0 ? b[0] - 1e6 : i == 1 ? b[1] - 2e-6 : b[0] * b[1] - 2;
    case 7: /* Powell badly scaled: 1e4 b1 b2 - 1, exp(-b1) + exp(-b2) - 1.0001 */
        d[0] = i ? -exp(-b[0]) : 1e4 * b[1], d[1] = i ? -exp(-b[1]) : 1e4 * b[0];
        return i ? exp(-b[0]) + exp(-b[1]) - 1.0001 : 1e4 * b[0] * b[1] - 1;
    case 8: /* Powell singular */
        d[0] = i == 0 ? 1 : i == 3 ? 2 * sqrt(10) * (b[0] - b[3]) : 0;
        d[1] = i == 0 ? 10 : i == 2 ? 2 * (b[1] - 2 * b[2]) : 0;
        d[2] = i == 1 ? sqrt(5) : i == 2 ? -4 * (b[1] - 2 * b[2]) : 0;
        d[3] = i == 1 ? -sqrt(5) : i == 3 ? -2 * sqrt(10) * (b[0] - b[3]) : 0;
        return i == 0   ? b[0] + 10 * b[1]
               : i == 1 ? sqrt(5) * (b[2] - b[3])
               : i == 2 ? (b[1] - 2 * b[2]) * (b[1] - 2 * b[2])
                        : sqrt(10) * (b[0] - b[3]) * (b[0] - b[3]);
    default: /* 9: y (b_i/x - 1) + b_i^3/x^3 - 1; x is the unit of variable i, y the unit of f */
        e = b[i] / x, d[i] = y * (1 + 3 * e * e) / x;
        return y * (e - 1 + e * e * e - 1);
    }
}

static lg_status residuals(void *user, const double *b, double *r, double *jacobian) {
    const problem *p = user;
    memset(jacobian, 0, p->n * p->m * sizeof(*jacobian));
    for (size_t i = 0; i < p->m; i++) r[i] = residual(p, b, i, jacobian + i * p->n);
    return LG_OK;
}

static lg_status squares(void *user, const double *b, double *value, double *gradient) {
    const problem *p = user;
    double d[8];
    *value = 0;
    memset(gradient, 0, p->n * sizeof(*gradient));
    for (size_t i = 0; i < p->m; i++) {
        memset(d, 0, sizeof(d));
        const double r = residual(p, b, i, d);
        *value += r * r;
        for (size_t k = 0; k < p->n; k++) gradient[k] += 2 * r * d[k];
    }
    return LG_OK;
}

/* inputs: model, n, m, start (n), x (m), y (m); outputs: b (n) */
static lg_status minimise(const double *in, double *out, lg_minimise_method method) {
    problem p = {.id = in[0], .n = (size_t)in[1], .m = (size_t)in[2]};
    p.x = in + 3 + p.n, p.y = p.x + p.m;
    memcpy(out, in + 3, p.n * sizeof(*out));
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    options.method = method;
    if (method == LG_MINIMISE_LM)
        return lg_least_squares(NULL, p.n, p.m, residuals, &p, &options, out, NULL, NULL, NULL);
    return lg_minimise(NULL, p.n, squares, &p, &options, out, NULL, NULL);
}

static lg_status least_squares(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return minimise(in, out, LG_MINIMISE_LM);
}

static lg_status ssbroyden(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return minimise(in, out, LG_MINIMISE_SSBROYDEN);
}

static lg_status lbfgs(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    return minimise(in, out, LG_MINIMISE_LBFGS);
}

/* inputs: n, ridge, A^T A (n, n), A^T y (n); outputs: the solution */
static lg_status normal_equations(const double *in, size_t n, double *out, size_t m) {
    double matrix[64];
    (void)n;
    memcpy(matrix, in + 2, m * m * sizeof(*matrix));
    memcpy(out, in + 2 + m * m, m * sizeof(*out));
    return lg_normal_equations(m, 1, in[1], matrix, out);
}

/* ---- elastica ---- */

/* inputs: L, EI, q(0), q(L), theta(0), rotation, intervals; outputs: energy, force */
static lg_status elastica(const double *in, bool continuous, double *out, size_t m) {
    lg_elastica beam = {.length = in[0],
                        .stiffness = in[1],
                        .q0 = {in[2], in[3]},
                        .qN = {in[4], in[5]},
                        .theta0 = in[6],
                        .rotation = in[7],
                        .intervals = (uint32_t)in[8]};
    double *theta = malloc((beam.intervals + 1) * sizeof(*theta));
    lg_elastica_solution solution;
    const lg_status status =
        continuous ? lg_elastica_solve_continuous(NULL, &beam, NULL, theta, NULL, &solution, NULL)
                   : lg_elastica_solve(NULL, &beam, NULL, theta, &solution, NULL);
    const double all[] = {solution.energy, solution.force[0], solution.force[1]};
    if (status == LG_OK) memcpy(out, all, m * sizeof(*out));
    free(theta);
    return status;
}

static lg_status continuous_elastica(const double *in, size_t n, double *out, size_t m) {
    (void)n;
    return elastica(in, true, out, m);
}

static lg_status discrete_elastica(const double *in, size_t n, double *out, size_t m) {
    (void)n;
    return elastica(in, false, out, m);
}

/* ---- measures of classifiers ---- */

/* inputs: the scores of n windows, then their classes (0 or 1); output: area under the curve */
static lg_status area(const double *in, size_t n, double *out, size_t m) {
    (void)m;
    uint32_t truth[64];
    double score[128];
    for (size_t i = 0; i < n / 2; i++)
        truth[i] = (uint32_t)in[n / 2 + i], score[2 * i] = 0, score[2 * i + 1] = in[i];
    return lg_metrics_auc(NULL, truth, score, n / 2, 2, out);
}

/* inputs: a confusion matrix; outputs: accuracy, precision, recall, f1 */
static lg_status measures(const double *in, size_t n, double *out, size_t m) {
    (void)m;
    uint64_t confusion[64];
    uint32_t classes = 1;
    for (size_t i = 0; i < n; i++) confusion[i] = (uint64_t)in[i];
    while (classes * classes < n) classes++;
    const lg_metrics all = lg_metrics_of(confusion, classes, 0);
    out[0] = all.accuracy, out[1] = all.precision, out[2] = all.recall, out[3] = all.f1;
    return LG_OK;
}

/* inputs: a series; outputs: the powers in m bands */
static lg_status spectrum(const double *in, size_t n, double *out, size_t m) {
    lg_spectrum of = {0};
    const lg_status status = lg_spectrum_create(NULL, (uint32_t)n, (uint32_t)m, &of, NULL);
    if (status != LG_OK) return status;
    double *work = malloc(lg_spectrum_work(&of) * sizeof(*work));
    lg_spectrum_powers(&of, in, out, work);
    free(work);
    lg_spectrum_destroy(&of);
    return LG_OK;
}

const hard_function hard_methods[] = {
    {"Riccati, continuous", .measure = care},
    {"Riccati, discrete", .measure = dare},
    {"zero-order hold", .measure = hold},
    {"least squares", .measure = least_squares},
    {"ssbroyden", .measure = ssbroyden},
    {"lbfgs", .measure = lbfgs},
    {"normal equations", .measure = normal_equations},
    {"elastica", .measure = continuous_elastica},
    {"elastica, discrete", .measure = discrete_elastica},
    {"area under the curve", .measure = area},
    {"accuracy, precision, recall, f1", .measure = measures},
    {"powers of a spectrum", .measure = spectrum},
    {.name = NULL},
};
