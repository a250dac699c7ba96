#include "kernels/stumpff.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { TERMS = 18 };

#include "kernels/code/inverse_factorial.c" /* inverse_factorial[n] = 1/n!, n <= 63 */

/* (i + d)!/i! in row d, column i; exact */
static const double falling[LG_STUMPFF_MAX_ORDER + 1][TERMS] = {
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

/* The functions of code/stumpff_series.c, which has the formulas; here they are faster. The recursions follow
 * from d/dx (x^k c_k) = x^(k-1) c_{k-1} and c_0' = -c_1/2. */

/* Computes four values of k at a time, because their coefficients are neighbours in the table of 1/n!.
 * Separate chains for even and odd powers of w halve the latency. */
typedef double pair __attribute__((vector_size(16), may_alias, aligned(8)));

static void stumpff_series(double w, int K, int order, double *c) {
    const double size = fabs(w), sign = order % 2 == 0 ? 1.0 : -1.0, square = w * w;
    const int terms = size <= 1.0 ? 10 : size <= 4.0 ? 14 : TERMS;
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
static double stumpff_one(double w, int k, int d) {
    double term = (d % 2 == 0 ? 1.0 : -1.0) * falling[d][0] * inverse_factorial[k + 2 * d], total = term;
    for (int i = 0; i < 100 && fabs(term) > 0x1p-60 * fabs(total); i++) {
        const double n = k + 2.0 * (i + d);
        term *= -w * (i + d + 1) / ((i + 1) * (n + 1.0) * (n + 2.0));
        total += term;
    }
    return total;
}

/* Returns x = sqrt(|w|) and sets dx to its rounding error, so that x + dx is more exact. */
static double stumpff_root(double w, double *dx) {
    const double x = sqrt(fabs(w));
    *dx = fma(-x, x, fabs(w)) / (2.0 * x);
    return x;
}

/* ---- the same source text as in exported code ---- */

#define real double
#include "kernels/code/dexpinv_coef.c"
#include "kernels/code/stumpff.c"
#undef real

/* Recomputes the values in which the series cancels, for 1 < w <= 16. This is faster than code/stumpff_row.c.
 * 1 - c_0 does not cancel for w > 4. */
static void mend_series(double w, int K, int order, double *c) {
    double dx;
    const double x = stumpff_root(w, &dx), c0 = stumpff_cosine(x, dx), c1 = stumpff_sine(x, dx) / x;
    const double slope = (c0 - c1) / (2.0 * w); /* c_1' */
    const double mended[3][3] = {
        {c0, c1, (1.0 - c0) / w}, {-0.5 * c1, slope, 0.5 * (c1 - 2.0 * (1.0 - c0) / w) / w}, {-0.5 * slope}};
    const int most = w <= 4.0 || order == 2 ? 0 : K < 2 ? K : 2;
    memcpy(c, mended[order], ((size_t)most + 1) * sizeof *c);
}

static __attribute__((noinline)) void recursion(double w, int K, int order, double *out) {
    double c[LG_STUMPFF_MAX_K + 1];
    stumpff_beyond(w, K, order, c);
    memcpy(out, c, ((size_t)K + 1) * sizeof *c);
}

void lg_stumpff(double w, int K, int order, double *c) {
    if (!(fabs(w) <= 16.0)) {
        recursion(w, K, order, c);
        return;
    }
    stumpff_series(w, K, order, c);
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

double lg_dexpinv_coef(double w, int order) {
    return dexpinv_coef(w, order);
}
