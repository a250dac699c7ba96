#include "kernels/stumpff.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* ---- Stumpff functions ----
 *
 *     c_k^(d)(w) = (-1)^d sum_i (-w)^i ((i+d)!/i!) / (k + 2(i+d))!.
 *
 * w| <= 16: this series. Its terms cancel for w > 4, and near the zero of c_0. There c_0, c_1 and the
 * functions that the last recursion below gives from them are computed from cos and sin of x = sqrt(w), and
 * the rounding error of x is taken into account. This keeps the relative accuracy, also near zeros of the
 * functions.
 *
 * w| > 16: c_0, c_1 and c_2 = 2 sin(x/2)^2/w in closed form, then
 *
 *     c_{k+2} = (1/k! - c_k)/w,   c_0' = -c_1/2,   2w c_k^(d+1) = c_{k-1}^(d) - (k + 2d) c_k^(d).
 *
 * The last recursion follows from d/dx (x^k c_k) = x^(k-1) c_{k-1}. Functions whose series hardly cancels are
 * computed from the series here too, because these recursions would lose digits.
 */

enum {
    SHORT_TERMS = 10,
    MIDDLE_TERMS = 14,
    TERMS = 18,
    MAX_K = LG_STUMPFF_MAX_K,
    MAX_ORDER = LG_STUMPFF_MAX_ORDER
};

#include "kernels/code/inverse_factorial.c" /* inverse_factorial[n] = 1/n!, n <= 63 */

/* (i + d)!/i! in row d, column i; exact */
static const double falling[MAX_ORDER + 1][TERMS] = {
    {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
    {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18},
    {2, 6, 12, 20, 30, 42, 56, 72, 90, 110, 132, 156, 182, 210, 240, 272, 306, 342},
    {6, 24, 60, 120, 210, 336, 504, 720, 990, 1320, 1716, 2184, 2730, 3360, 4080, 4896, 5814, 6840},
    {24, 120, 360, 840, 1680, 3024, 5040, 7920, 11880, 17160, 24024, 32760, 43680, 57120, 73440, 93024,
     116280, 143640},
    {120, 720, 2520, 6720, 15120, 30240, 55440, 95040, 154440, 240240, 360360, 524160, 742560, 1028160,
     1395360, 1860480, 2441880, 3160080},
    {720, 5040, 20160, 60480, 151200, 332640, 665280, 1235520, 2162160, 3603600, 5765760, 8910720, 13366080,
     19535040, 27907200, 39070080, 53721360, 72681840},
    {5040, 40320, 181440, 604800, 1663200, 3991680, 8648640, 17297280, 32432400, 57657600, 98017920,
     160392960, 253955520, 390700800, 586051200, 859541760, 1235591280, 1744364160},
    {40320, 362880, 1814400, 6652800, 19958400, 51891840, 121080960, 259459200, 518918400, 980179200,
     1764322560, 3047466240, 5079110400, 8204716800, 12893126400, 19769460480, 29654190720, 43609104000}};

/* Computes four values of k at a time, because their coefficients are neighbours in the table of 1/n!.
 * Separate chains for even and odd powers of w halve the latency. */
typedef double pair __attribute__((vector_size(16), may_alias, aligned(8)));

static void series_row(double w, int K, int order, double *c) {
    const double size = fabs(w), sign = order % 2 == 0 ? 1.0 : -1.0, square = w * w;
    const int terms = size <= 1.0 ? SHORT_TERMS : size <= 4.0 ? MIDDLE_TERMS : TERMS;
    const double *factor = falling[order];
    for (int k = 0; k <= K; k += 4) {
        const double *table = inverse_factorial + k + 2 * order;
        pair even_low = {0, 0}, even_high = {0, 0}, odd_low = {0, 0}, odd_high = {0, 0};
        for (int i = terms - 2; i >= 0; i -= 2) {
            const pair *row = (const pair *)(table + 2 * i);
            even_low = even_low * square + row[0] * factor[i];
            even_high = even_high * square + row[1] * factor[i];
            odd_low = odd_low * square + row[1] * factor[i + 1];
            odd_high = odd_high * square + row[2] * factor[i + 1];
        }
        const pair low = (even_low - odd_low * w) * sign, high = (even_high - odd_high * w) * sign;
        const double values[4] = {low[0], low[1], high[0], high[1]};
        const int count = K - k < 3 ? K - k + 1 : 4;
        for (int j = 0; j < count; j++) c[k + j] = values[j];
    }
}

/* c_k^(d)(w) from the series, for |w| (d+1) <= 2 (k+2d+1)(k+2d+2). */
static double series_one(double w, int k, int d) {
    double term = (d % 2 == 0 ? 1.0 : -1.0) * falling[d][0] * inverse_factorial[k + 2 * d], total = term;
    for (int i = 0; i < 100 && fabs(term) > 0x1p-60 * fabs(total); i++) {
        const double n = k + 2.0 * (i + d);
        term *= -w * (i + d + 1) / ((i + 1) * (n + 1.0) * (n + 2.0));
        total += term;
    }
    return total;
}

/* Returns x = sqrt(|w|) and sets dx to its rounding error, so that x + dx is more exact. */
static double root(double w, double *dx) {
    const double x = sqrt(fabs(w));
    *dx = fma(-x, x, fabs(w)) / (2.0 * x);
    return x;
}

/* sin(x + dx) and cos(x + dx). dx is not small if x is large. */
static double sine_of(double x, double dx) {
    return fabs(dx) > 1e-9 ? sin(x) * cos(dx) + cos(x) * sin(dx) : sin(x) + dx * cos(x);
}

static double cosine_of(double x, double dx) {
    return fabs(dx) > 1e-9 ? cos(x) * cos(dx) - sin(x) * sin(dx) : cos(x) - dx * sin(x);
}

/* c_0 and c_1 in closed form, |w| > 1 */
static void closed_form(double w, double c[2]) {
    double dx;
    const double x = root(w, &dx);
    c[0] = w > 0 ? cosine_of(x, dx) : cosh(x) + dx * sinh(x);
    c[1] = (w > 0 ? sine_of(x, dx) : sinh(x) + dx * cosh(x)) / x;
}

/* c_2 = 2 sin(x/2)^2/w */
static double closed_form_2(double w) {
    double dx;
    const double x = 0.5 * root(w, &dx);
    const double half = w > 0 ? sine_of(x, 0.5 * dx) : sinh(x) + 0.5 * dx * cosh(x);
    return 2.0 * half * half / fabs(w);
}

static bool cancels_little(double w, int k, int d) {
    return fabs(w) * (d + 1) <= 2.0 * (k + 2 * d + 1) * (k + 2 * d + 2);
}

static void recursion(double w, int K, int order, double *out) {
    const int top = K > 1 ? K : 1;
    double c[MAX_ORDER + 1][MAX_K + 4];
    closed_form(w, c[0]);
    c[0][2] = closed_form_2(w);
    for (int k = 3; k <= top; k++)
        c[0][k] =
            cancels_little(w, k - 2, 0) ? series_one(w, k, 0) : (inverse_factorial[k - 2] - c[0][k - 2]) / w;
    for (int d = 1; d <= order; d++) {
        c[d][0] = -0.5 * c[d - 1][1];
        for (int k = 1; k <= top; k++)
            c[d][k] = cancels_little(w, k, d)
                          ? series_one(w, k, d)
                          : (c[d - 1][k - 1] - (k + 2 * (d - 1)) * c[d - 1][k]) / (2.0 * w);
    }
    memcpy(out, c[order], ((size_t)K + 1) * sizeof *out);
}

/* Recomputes the values in which the series cancels, for 1 < w <= 16. 1 - c_0 does not cancel for w > 4. */
static void mend_series(double w, int K, int order, double *c) {
    double value[2];
    closed_form(w, value);
    const double slope = (value[0] - value[1]) / (2.0 * w); /* c_1' */
    const double mended[3][3] = {{value[0], value[1], (1.0 - value[0]) / w},
                                 {-0.5 * value[1], slope, 0.5 * (value[1] - 2.0 * (1.0 - value[0]) / w) / w},
                                 {-0.5 * slope}};
    const int most = w <= 4.0 || order == 2 ? 0 : K < 2 ? K : 2;
    memcpy(c, mended[order], ((size_t)most + 1) * sizeof *c);
}

void lg_stumpff(double w, int K, int order, double *c) {
    if (!(fabs(w) <= 16.0)) {
        recursion(w, K, order, c);
        return;
    }
    series_row(w, K, order, c);
    if ((w > 4.0 && order <= 2) || (w > 1.0 && order < 2 && fabs(c[0]) < 0.25)) mend_series(w, K, order, c);
}

/* 2 dc_k/dw is k c_{k+2} - c_{k+1}, which cancels for large w, or (c_{k-1} - k c_k)/w, which cancels for
 * small w. */
void lg_stumpff_slopes(double w, double out[5]) {
    const bool large = w > 16.0;
    double c[6];
    lg_stumpff(w, large ? 3 : 5, 0, c);
    memcpy(out, c + 1, 3 * sizeof *out);
    out[3] = large ? (c[1] - 2.0 * c[2]) / w : 2.0 * c[4] - c[3];
    out[4] = large ? (c[2] - 3.0 * c[3]) / w : 3.0 * c[5] - c[4];
}

/* ---- dexpinv: the same source text as in exported code ---- */

#define real double
#include "kernels/code/dexpinv.c"
#undef real

double lg_dexpinv_coef(double w, int order) {
    return dexpinv_coef(w, order);
}
