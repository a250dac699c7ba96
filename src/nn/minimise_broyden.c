/* Self-scaled Broyden family with a dense inverse Hessian H (Al-Baali; Urban, Stefanou, Pons 2025). The first
 * FIRST_PAIRS pairs are kept as in L-BFGS, whose H_0 follows them; then they are put into H. */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

enum { FIRST_PAIRS = 3 };
static const double LEAST_SCALE = 0.5;

/* Computes the scale tau and the weight phi of the update from b = s.Bs/y.s and h = y.Hy/y.s: SSBroyden2,
 * with tau kept above LEAST_SCALE. */
static void coefficients(size_t n, double b, double h, double *tau, double *phi) {
    const double a = fmax(h * b - 1.0, 1e-16), c = sqrt(a / (1.0 + a));
    const double r = fmin(1.0, h * (1.0 - c));
    const double theta = fmax((r - 1.0) / a, fmin(1.0 / r, (1.0 - b) / b));
    const double sigma = 1.0 + a * theta, root = pow(fabs(sigma), 1.0 / (1.0 - (double)n));
    const double k = fmin(1.0, 1.0 / b), factor = n > 1 ? root : 1.0;
    *tau = fmax(theta > 0.0 ? k * fmin(factor, 1.0 / theta) : fmin(k * factor, sigma), LEAST_SCALE);
    *phi = (1.0 - theta) / (1.0 + a * theta);
}

/* m->curvature holds the rows of H, at a stride, then the vector Hy, then the first pairs. With ranks, each
 * rank holds only its own rows of H. */
static size_t length(size_t n, const lg_minimise_options *options) {
    return (n + 1) * lg_minimise_stride(n) + lg_minimise_pairs_length(n, FIRST_PAIRS);
}

static double *product(const lg_minimiser *m) {
    return m->curvature + (m->end - m->first) * lg_minimise_stride(m->n);
}

static double *pairs_of(const lg_minimiser *m) {
    return product(m) + lg_minimise_stride(m->n);
}

/* y = H x */
static void multiply(lg_minimiser *m, const double *x, double *y) {
    m->k->matvec(m->end - m->first, lg_minimise_stride(m->n), m->curvature, x, y + m->first, false);
    lg_minimise_gather(m, y);
}

/* H <- (H - Hy Hy'/q + phi q v v')/tau + rho s s', where v = rho s - Hy/q, q = y.Hy and rho = 1/y.s. So each
 * row of H becomes a combination of s, Hy and the row itself. */
static void change(lg_minimiser *m, const double *s, double rho, double q, double tau, double phi) {
    const double *hy = product(m);
    for (size_t i = m->first; i < m->end; i++) {
        const double v = rho * s[i] - hy[i] / q;
        m->k->combine(m->n, phi * q * rho * v / tau + rho * s[i], s, -(hy[i] / q + phi * v) / tau, hy,
                      1.0 / tau, m->curvature + (i - m->first) * lg_minimise_stride(m->n));
    }
}

/* H from the first pairs: BFGS updates of H_0. */
static void begin_dense(lg_minimiser *m) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    const double *H = lg_minimise_pairs_diagonal(m, pairs_of(m), FIRST_PAIRS);
    m->k->fill((m->end - m->first) * stride, 0.0, m->curvature);
    for (size_t i = m->first; i < m->end; i++) m->curvature[(i - m->first) * stride + i] = H[i];
    for (size_t i = 0; i < FIRST_PAIRS; i++) {
        const double *s = pairs_of(m) + 2 * i * stride, *y = s + stride;
        multiply(m, y, product(m));
        change(m, s, 1.0 / m->k->dot(n, y, s), m->k->dot(n, y, product(m)), 1.0, 1.0);
    }
}

/* The new d = -H g needs no second product: with the old H, Hg = Hy - d. */
static void update(lg_minimiser *m, double *s, double *y) {
    const lg_kernels *k = m->k;
    const size_t n = m->n;
    double *hy = product(m), tau, phi;
    if (m->counts.pairs < FIRST_PAIRS) {
        lg_minimise_pairs_add(m, pairs_of(m), FIRST_PAIRS, s, y);
        if (m->counts.pairs + 1 == FIRST_PAIRS) begin_dense(m);
        return;
    }
    multiply(m, m->g, hy);
    for (size_t i = 0; i < n; i++) hy[i] += m->d[i];
    /* Before the step d = -H g, and s = alpha d; so s.Bs = -alpha g.s = alpha^2 (-g.d). */
    const double q = k->dot(n, y, hy), rho = 1.0 / k->dot(n, y, s);
    coefficients(n, -m->numbers.alpha * m->numbers.alpha * m->numbers.slope * rho, q * rho, &tau, &phi);
    if (!(q > 0.0) || !isfinite(tau) || !isfinite(phi)) {
        m->counts.pairs = 0;
        update(m, s, y);
        return;
    }
    change(m, s, rho, q, tau, phi);
    const double sg = k->dot(n, s, m->g), hyg = k->dot(n, hy, m->g), vg = rho * sg - hyg / q;
    for (size_t i = 0; i < n; i++) {
        const double v = rho * s[i] - hy[i] / q, hg = hy[i] - m->d[i];
        m->d[i] = -((hg - hy[i] * hyg / q + phi * q * v * vg) / tau + rho * s[i] * sg);
    }
}

static void direction(lg_minimiser *m) {
    if (m->counts.pairs < FIRST_PAIRS) {
        lg_minimise_pairs_direction(m, pairs_of(m), FIRST_PAIRS, m->counts.pairs);
        return;
    }
    multiply(m, m->g, m->d);
    for (size_t i = 0; i < m->n; i++) m->d[i] = -m->d[i];
}

static void invert(lg_minimiser *m, const double *scale) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    const int order = (int)n;
    double *h = m->curvature;
    int info = 0;
    dpotri_("U", &order, h, &order, &info);
    if (info != 0) return;
    for (size_t i = n; i-- > 0;) { /* rows move to their stride, the last row first */
        memmove(h + i * stride, h + i * n, n * sizeof *h);
        memset(h + i * stride + n, 0, (stride - n) * sizeof *h);
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++)
            h[i * stride + j] = h[j * stride + i] = h[i * stride + j] * scale[i] * scale[j];
    m->counts.pairs = FIRST_PAIRS;
}

const lg_minimise_row lg_minimise_ssbroyden = {.name = "ssbroyden",
                                               .dense = true,
                                               .slow = 200,
                                               .creep = 50,
                                               .length = length,
                                               .by_rows = true,
                                               .update = update,
                                               .direction = direction,
                                               .invert = invert};
