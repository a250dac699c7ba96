/* Self-scaled Broyden family with a dense inverse Hessian H (Urban, Stefanou, Pons 2025, SSBroyden2). */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

/* Computes the scale tau and the weight phi of the update from b = s.Bs/y.s and h = y.Hy/y.s. */
static void coefficients(size_t n, double b, double h, double *tau, double *phi) {
    const double a = fmax(h * b - 1.0, 1e-16), c = sqrt(a / (1.0 + a));
    const double r = fmin(1.0, h * (1.0 - c));
    const double theta = fmax((r - 1.0) / a, fmin(1.0 / r, (1.0 - b) / b));
    const double sigma = 1.0 + a * theta, root = pow(fabs(sigma), 1.0 / (1.0 - (double)n));
    const double k = fmin(1.0, 1.0 / b), factor = n > 1 ? root : 1.0;
    *tau = theta > 0.0 ? k * fmin(factor, 1.0 / theta) : fmin(k * factor, sigma);
    *phi = (1.0 - theta) / (1.0 + a * theta);
}

/* m->curvature holds the rows of H, at a stride, and then the vector Hy. With ranks, each rank holds only its
 * own rows of H. */
static size_t length(size_t n, const lg_minimise_options *options) {
    (void)options;
    return (n + 1) * lg_minimise_stride(n);
}

static void start(lg_minimiser *m, double scale) {
    const size_t rows = m->end - m->first, stride = lg_minimise_stride(m->n);
    m->k->fill(rows * stride, 0.0, m->curvature);
    for (size_t i = 0; i < rows; i++) m->curvature[i * stride + m->first + i] = scale;
}

/* y = H x */
static void multiply(lg_minimiser *m, const double *x, double *y) {
    m->k->matvec(m->end - m->first, lg_minimise_stride(m->n), m->curvature, x, y + m->first, false);
    lg_minimise_gather(m, y);
}

/* H <- (H - Hy Hy'/q + phi q v v')/tau + rho s s', where v = rho s - Hy/q, q = y.Hy and rho = 1/y.s. So each
 * row of H becomes a combination of s, Hy and the row itself. The new d = -H g needs no second product: with
 * the old H, Hg = Hy - d. */
static void update(lg_minimiser *m, double *s, double *y) {
    const lg_kernels *k = m->k;
    const size_t n = m->n, stride = lg_minimise_stride(n);
    double *h = m->curvature, *hy = h + (m->end - m->first) * stride;
    const double ys = k->dot(n, y, s), rho = 1.0 / ys, scale = ys / k->dot(n, y, y);
    const bool first = m->counts.pairs == 0;
    if (first) {
        start(m, scale);
        for (size_t i = 0; i < n; i++) hy[i] = scale * y[i], m->d[i] = scale * (y[i] - m->g[i]);
    } else {
        multiply(m, m->g, hy);
        for (size_t i = 0; i < n; i++) hy[i] += m->d[i];
    }
    /* Before the step d = -H g, and s = alpha d; so s.Bs = -alpha g.s = alpha^2 (-g.d). */
    const double q = k->dot(n, y, hy);
    const double sbs =
        first ? k->dot(n, s, s) / scale : -m->numbers.alpha * m->numbers.alpha * m->numbers.slope;
    double tau, phi;
    coefficients(n, sbs * rho, q * rho, &tau, &phi);
    if (!(q > 0.0) || !isfinite(tau) || !isfinite(phi) || !(tau > 0.0)) {
        start(m, scale);
        for (size_t i = 0; i < n; i++) m->d[i] = -scale * m->g[i];
        return;
    }
    for (size_t i = m->first; i < m->end; i++) {
        const double v = rho * s[i] - hy[i] / q;
        k->combine(n, phi * q * rho * v / tau + rho * s[i], s, -(hy[i] / q + phi * v) / tau, hy, 1.0 / tau,
                   h + (i - m->first) * stride);
    }
    /* With H from before the update, H g = Hy - d. */
    const double sg = k->dot(n, s, m->g), hyg = k->dot(n, hy, m->g), vg = rho * sg - hyg / q;
    for (size_t i = 0; i < n; i++) {
        const double v = rho * s[i] - hy[i] / q, hg = hy[i] - m->d[i];
        m->d[i] = -((hg - hy[i] * hyg / q + phi * q * v * vg) / tau + rho * s[i] * sg);
    }
}

static void direction(lg_minimiser *m) {
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
    m->counts.pairs = 1;
}

const lg_minimise_row lg_minimise_ssbroyden = {.name = "ssbroyden",
                                               .dense = true,
                                               .slow = 200,
                                               .creep = 100,
                                               .length = length,
                                               .by_rows = true,
                                               .update = update,
                                               .direction = direction,
                                               .invert = invert};
