/* Bounds of quadratic forms. */
#include <math.h>

#include "certify/certify.h"

/* The largest a k + b k^2 for a in [low, high] and |k| <= r */
static double parabola(double low, double high, double b, double r) {
    const double a = fmax(-low, high);
    if (b < 0.0 && a < -2.0 * b * r) return lg_certify_up(a * a / (-4.0 * b));
    return lg_certify_up(r * lg_certify_up(a + b * r));
}

double lg_certify_form(size_t n, const double *l, const double *h, const double *r, double *part) {
    double rise = 0;
    for (size_t k = 0; k < n; k++) {
        if (part != NULL)
            part[k] = r[k] * (lg_certify_size(l[k], h[k]) +
                              0.5 * r[k] * lg_certify_size(l[n + k * n + k], h[n + k * n + k]));
        for (size_t j = 0; j < k; j++) {
            const double both = lg_certify_size(l[n + k * n + j], h[n + k * n + j]) * r[k] * r[j];
            rise = lg_certify_up(rise + both);
            if (part == NULL) continue;
            part[k] += 0.5 * both;
            part[j] += 0.5 * both;
        }
        rise = lg_certify_up(rise + parabola(l[k], h[k], 0.5 * h[n + k * n + k], r[k]));
    }
    return rise;
}
