/* Levenberg-Marquardt: steps of damped Gauss-Newton, the damping after Nielsen (1999). */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

enum { MOST_REFUSALS = 40 };
static const double FIRST_DAMPING = 1e-3, LEAST_GAIN = 1e-4;

/* memory: A, then the damped matrix, rows of n at a stride; then D (n). */
static size_t length(size_t n, const lg_minimise_options *options) {
    (void)options;
    return (2 * n + 1) * lg_minimise_stride(n);
}

static double *damped(lg_minimiser *m) {
    return m->curvature + m->n * lg_minimise_stride(m->n);
}

static double *scales(lg_minimiser *m) {
    return m->curvature + 2 * m->n * lg_minimise_stride(m->n);
}

/* d from (A + mu D) d = -g; a parameter without influence stays. False: not positive definite. */
static bool solve(lg_minimiser *m) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    const int order = (int)n, leading = (int)stride, one = 1;
    double *system = damped(m);
    int info = 0;
    memcpy(system, m->curvature, n * stride * sizeof *system);
    for (size_t i = 0; i < n; i++) {
        const double scale = scales(m)[i];
        system[i * stride + i] += scale > 0.0 ? scale * m->numbers.damping : 1.0;
        m->d[i] = -m->g[i];
    }
    dposv_("L", &order, &one, system, &leading, m->d, &order, &info);
    return info == 0 && m->k->all_finite(n, m->d);
}

static void refuse(lg_minimiser *m) {
    m->counts.failures++;
    m->numbers.damping *= m->numbers.growth;
    m->numbers.growth *= 2.0;
}

/* The next trial; raises the damping until there is one that differs from x. */
static void propose(lg_minimiser *m) {
    for (; m->counts.failures < MOST_REFUSALS; refuse(m)) {
        if (!solve(m)) continue;
        for (size_t i = 0; i < m->n; i++) m->point[i] = m->x[i] + m->d[i];
        m->counts.stage = LG_STAGE_SEARCH;
        m->numbers.slope = m->k->dot(m->n, m->g, m->d);
        if (memcmp(m->point, m->x, m->n * sizeof *m->x) != 0) return;
        break;
    }
    lg_minimise_finish(m, lg_minimise_no_step(m));
}

static void take(lg_minimiser *m, double value, const double *gradient, const double *matrix) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    memcpy(m->x, m->point, n * sizeof *m->x);
    memcpy(m->g, gradient, n * sizeof *m->g);
    for (size_t i = 0; i < n; i++) {
        memcpy(m->curvature + i * stride, matrix + i * n, n * sizeof *matrix);
        scales(m)[i] = fmax(scales(m)[i], matrix[i * n + i]);
    }
    m->numbers.value = value;
}

/* f - f(x + d) as the model f + g.d + d.A d/2 foretells it. */
static double foretold(lg_minimiser *m) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    m->k->matvec(n, stride, m->curvature, m->d, m->y, false);
    return -m->numbers.slope - 0.5 * m->k->dot(n, m->d, m->y);
}

static bool tell_step(lg_minimiser *m, double value, const double *gradient, const double *matrix,
                      bool finite) {
    const double gain = finite ? (m->numbers.value - value) / foretold(m) : (double)NAN;
    if (!(gain > LEAST_GAIN)) {
        m->numbers.high_value = finite ? value : INFINITY;
        refuse(m);
        propose(m);
        return false;
    }
    take(m, value, gradient, matrix);
    m->counts.iterations++;
    m->counts.failures = 0;
    m->numbers.damping *= fmax(1.0 / 3.0, 1.0 - pow(2.0 * gain - 1.0, 3.0));
    m->numbers.growth = 2.0;
    m->numbers.high_value = 0.0;
    if (lg_minimise_flat(m))
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    else if (lg_minimise_slow(m))
        lg_minimise_finish(m, LG_MINIMISE_SLOW);
    else
        propose(m);
    return true;
}

bool lg_minimiser_tell_squares(lg_minimiser *m, double value, const double *gradient, const double *matrix) {
    if (m->counts.stage == LG_STAGE_DONE || m->row != &lg_minimise_lm) return false;
    const bool finite =
        isfinite(value) && m->k->all_finite(m->n, gradient) && m->k->all_finite(m->n * m->n, matrix);
    m->counts.evaluations++;
    if (m->counts.stage == LG_STAGE_SEARCH) return tell_step(m, value, gradient, matrix, finite);
    if (!finite) {
        lg_minimise_finish(m, LG_MINIMISE_NOT_FINITE);
        return false;
    }
    take(m, value, gradient, matrix);
    m->numbers.reference_value = value;
    m->numbers.damping = FIRST_DAMPING;
    m->numbers.growth = 2.0;
    if (lg_minimise_flat(m))
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    else
        propose(m);
    return false;
}

const lg_minimise_row lg_minimise_lm = {.name = "lm", .length = length};
