/* Boundary value problems of the elastica: description, families of problems, energy, curve, and the discrete
 * Euler-Lagrange equations. */
#include <float.h>
#include <math.h>

#include "elastica/elastica.h"

/* Larger angles would lose digits by rounding; more turns would make the continuation very long. */
#define ANGLE_MAX 1e6
#define TURNS_MAX 20.0

void lg_elastica_init(lg_elastica *problem) {
    *problem = (lg_elastica){.length = 3.3, .stiffness = 10.0, .qN = {3.0, 0.0}, .intervals = 50};
}

void lg_elastica_options_init(lg_elastica_options *options) {
    *options = (lg_elastica_options){.size = sizeof(lg_elastica_options),
                                     .gradient_tolerance = 1e-12,
                                     .max_iterations = 200,
                                     .max_step = 0.05};
}

/* ---- the two families of boundary conditions ---- */

/* Factors of w in theta(0) and theta(L). */
static const struct {
    const char *name;
    double first, last;
} families[LG_ELASTICA_CASE_COUNT] = {
    [LG_ELASTICA_BOTH_ENDS] = {"both-ends", 1.0, -1.0}, [LG_ELASTICA_RIGHT_END] = {"right-end", 0.0, -1.0}};

const char *lg_elastica_case_name(lg_elastica_case kind) {
    return (unsigned)kind < LG_ELASTICA_CASE_COUNT ? families[kind].name : "unknown";
}

double lg_elastica_wrap(double x) {
    const double w = remainder(x, 2.0 * LG_PI);
    return w <= -LG_PI ? LG_PI : w;
}

void lg_elastica_set_case(lg_elastica *problem, lg_elastica_case kind, double x) {
    if ((unsigned)kind >= LG_ELASTICA_CASE_COUNT) return;
    const double w = lg_elastica_wrap(x);
    problem->theta0 = families[kind].first * w;
    problem->rotation = families[kind].last * w - problem->theta0;
}

/* ---- checks ---- */

lg_status lg_elastica_check(const lg_elastica *problem, lg_error *error) {
    if (!problem) return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: the problem is NULL");
    const double numbers[] = {problem->length, problem->stiffness, problem->q0[0],  problem->q0[1],
                              problem->qN[0],  problem->qN[1],     problem->theta0, problem->rotation};
    static const char *const names[] = {"length", "stiffness", "q0", "q0", "qN", "qN", "theta0", "rotation"};
    for (size_t i = 0; i < LG_COUNT(numbers); i++)
        if (!isfinite(numbers[i]))
            return lg_fail(error, LG_NOT_FINITE, "elastica: %s is not finite", names[i]);
    const double L = problem->length, n = problem->intervals;
    if (!(L > 0.0)) return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: length %g is not positive", L);
    if (!(problem->stiffness > 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: stiffness %g is not positive",
                       problem->stiffness);
    const double force = problem->stiffness / L / L;
    if (!(force >= DBL_MIN && force <= 1e-30 * DBL_MAX && problem->stiffness / L <= 1e-30 * DBL_MAX &&
          problem->stiffness / L >= DBL_MIN))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: length %g and stiffness %g leave the range of numbers", L,
                       problem->stiffness);
    if (problem->intervals < LG_ELASTICA_MIN_INTERVALS || problem->intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: %u intervals; %d to %d are possible",
                       problem->intervals, LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    const double distance = hypot(problem->qN[0] - problem->q0[0], problem->qN[1] - problem->q0[1]);
    if (!(distance < L))
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "elastica: the ends are %.9g apart, but the beam has length %.9g; it must be longer: change the "
            "positions of the ends or the length",
            distance, L);
    if (!(fabs(problem->theta0) <= ANGLE_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: theta0 = %g is too large: its absolute value must be at most %g",
                       problem->theta0, ANGLE_MAX);
    const double turns = fmin(TURNS_MAX, 0.5 * n);
    if (!(fabs(problem->rotation) <= turns * 2.0 * LG_PI))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: a rotation by %g is more than %g turns, the maximum for %u intervals",
                       problem->rotation, turns, problem->intervals);
    return LG_OK;
}

lg_status lg_elastica_options_take(const lg_elastica_options *options, lg_elastica_options *out,
                                   lg_error *error) {
    lg_elastica_options_init(out);
    if (!options) return LG_OK;
    if (options->size != sizeof(*options))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: the options were not initialised: their size is unknown");
    if (!(options->gradient_tolerance > 0.0 && options->gradient_tolerance < 1.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: gradient_tolerance is %g, expected a number in (0, 1)",
                       options->gradient_tolerance);
    if (!(options->max_step > 1e-4 && options->max_step <= 1.0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: max_step is %g, expected a number in (1e-4, 1]",
                       options->max_step);
    if (options->max_iterations < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "elastica: max_iterations must be at least 1");
    *out = *options;
    return LG_OK;
}

/* ---- the frame of the chord ---- */

/* If the ends coincide there is no chord. Then the frame is turned so that the end angles are -rotation/2 and
 * rotation/2, symmetric to the x axis, as in a drop. */
lg_beam_frame lg_beam_frame_make(const lg_elastica *problem) {
    const double L = problem->length, EI = problem->stiffness;
    const double x = problem->qN[0] - problem->q0[0], y = problem->qN[1] - problem->q0[1];
    lg_beam_frame frame = {.energy = EI / L, .force = EI / L / L};
    frame.beam.n = problem->intervals;
    frame.beam.d = hypot(x, y) / L;
    const bool closed = frame.beam.d == 0.0;
    frame.chord = closed ? problem->theta0 + 0.5 * problem->rotation : atan2(y, x);
    const double from = problem->theta0 - frame.chord;
    frame.beam.first = closed ? from : lg_elastica_wrap(from);
    frame.beam.last = frame.beam.first + problem->rotation;
    frame.turn = problem->theta0 - frame.beam.first;
    return frame;
}

/* ---- energy and curve ---- */

double lg_elastica_energy(const lg_elastica *problem, const double *theta) {
    const size_t n = problem->intervals;
    const double L = problem->length, h = 1.0 / (double)n;
    double bend = 0.0, x = 0.0, y = 0.0;
    for (size_t k = 0; k < n; k++) {
        const double s = sin(0.5 * (theta[k + 1] - theta[k]));
        bend += 2.0 * s * s;
        x += 0.5 * (cos(theta[k]) + cos(theta[k + 1]));
        y += 0.5 * (sin(theta[k]) + sin(theta[k + 1]));
    }
    const double rx = (problem->qN[0] - problem->q0[0]) / L - h * x;
    const double ry = (problem->qN[1] - problem->q0[1]) / L - h * y;
    const double P = 18.0 * (double)n * (double)n;
    return problem->stiffness / L * (bend * (double)n + P * (rx * rx + ry * ry));
}

void lg_elastica_curve(const lg_elastica *problem, const double *theta, double *q, double *v) {
    const size_t n = problem->intervals;
    const double h = problem->length / (double)n;
    double sum[2] = {0.0, 0.0}, before[2] = {cos(theta[0]), sin(theta[0])};
    for (size_t k = 0; k < n; k++) {
        const double next[2] = {cos(theta[k + 1]), sin(theta[k + 1])};
        for (int c = 0; c < 2; c++) {
            if (v) v[2 * k + c] = before[c];
            if (q) q[2 * k + c] = sum[c];
            sum[c] += 0.5 * h * (before[c] + next[c]);
            before[c] = next[c];
        }
    }
    for (int c = 0; v && c < 2; c++) v[2 * n + c] = before[c];
    for (int c = 0; q && c < 2; c++) {
        const double r = problem->qN[c] - problem->q0[c] - sum[c];
        for (size_t k = 0; k < n; k++)
            q[2 * k + c] = problem->q0[c] + q[2 * k + c] + (double)k / (double)n * r;
        q[2 * n + c] = problem->qN[c];
    }
}

/* ---- discrete Euler-Lagrange equations ---- */

/* Formulas for lg_elastica_euler_lagrange. With e_k = (q_{k+1} - q_k)/h - (v_k + v_{k+1})/2 the action is
 * (EI/(4 h)) sum (72 |e_k|^2 + 2 |v_{k+1} - v_k|^2) + h sum Lambda_k (|v_k|^2 - 1). Its derivatives with
 * respect to q_k and v_k, multiplied by h^2/EI and h/EI, are
 *   36 (e_{k-1} - e_k),   2 v_k - v_{k-1} - v_{k+1} - 18 (e_{k-1} + e_k) + 2 h^2 Lambda_k v_k/EI. */
static double relative(double value, double term) {
    return value == 0.0 ? 0.0 : value / term;
}

double lg_elastica_euler_lagrange(const lg_elastica *problem, const double *q, const double *v,
                                  double *lambda) {
    const size_t n = problem->intervals;
    const double h = problem->length / (double)n;
    double worst_q = 0.0, worst_v = 0.0, worst_unit = 0.0, term_q = 0.0, term_v = 0.0, e[2][2];
    for (int c = 0; c < 2; c++) e[0][c] = (q[2 + c] - q[c]) / h - 0.5 * (v[c] + v[2 + c]);
    for (size_t k = 1; k < n; k++) {
        const double *a = v + 2 * (k - 1), *b = a + 2, *d = b + 2, *before = e[(k - 1) % 2];
        double *after = e[k % 2], f[2];
        for (int c = 0; c < 2; c++) {
            after[c] = (q[2 * k + 2 + c] - q[2 * k + c]) / h - 0.5 * (b[c] + d[c]);
            f[c] = (b[c] - a[c]) - (d[c] - b[c]) - 18.0 * (before[c] + after[c]);
            worst_q = fmax(worst_q, 36.0 * fabs(before[c] - after[c]));
            term_q = fmax(term_q, 36.0 * fmax(fabs(before[c]), fabs(after[c])));
            term_v = fmax(term_v, fmax(fabs(b[c] - a[c]), fabs(d[c] - b[c])));
        }
        const double norm = b[0] * b[0] + b[1] * b[1];
        const double multiplier = -(f[0] * b[0] + f[1] * b[1]) / norm; /* 2 h^2 Lambda/EI */
        for (int c = 0; c < 2; c++) worst_v = fmax(worst_v, fabs(f[c] + multiplier * b[c]));
        worst_unit = fmax(worst_unit, fabs(norm - 1.0));
        term_v = fmax(term_v, fabs(multiplier));
        if (lambda) lambda[k - 1] = multiplier * problem->stiffness / (2.0 * h * h);
        if (!isfinite(norm) || !isfinite(f[0] + f[1])) return NAN;
    }
    const double in_q = relative(worst_q, fmax(term_q, term_v / (double)n));
    const double in_v = relative(worst_v, fmax(term_q, term_v));
    return fmax(worst_unit, fmax(in_q, in_v));
}
