/* Bounds of quadratic forms. */
#include <math.h>

#include "certify/certify.h"

/* The largest a k + b k^2 for a in [low, high] and |k| <= r */
static double parabola(double low, double high, double b, double r) {
    const double a = fmax(-low, high);
    if (b < 0.0 && a < -2.0 * b * r) return lg_certify_up(a * a / (-4.0 * b));
    return lg_certify_up(r * lg_certify_up(a + b * r));
}

/* A product k_i k_j counts as half of (r_j/r_i) k_i^2 + (r_i/r_j) k_j^2, which negative squares absorb. */
double lg_certify_form(size_t n, const double *l, const double *h, const double *r, double *part) {
    double rise = 0;
    for (size_t k = 0; k < n; k++) {
        double b = 0.5 * h[n + k * n + k], both = 0;
        for (size_t j = 0; j < n; j++) {
            const size_t of = n + (j < k ? k * n + j : j * n + k);
            if (j != k) both = lg_certify_up(both + 0.5 * lg_certify_size(l[of], h[of]) * r[j]);
        }
        if (r[k] > 0.0) b = lg_certify_up(b + both / r[k]);
        rise = lg_certify_up(rise + parabola(l[k], h[k], b, r[k]));
        if (part != NULL)
            part[k] = r[k] * (lg_certify_size(l[k], h[k]) + both +
                              0.5 * r[k] * lg_certify_size(l[n + k * n + k], h[n + k * n + k]));
    }
    return rise;
}
