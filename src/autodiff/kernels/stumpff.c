#include "autodiff/kernels/stumpff.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* ---- Stumpff functions ----
 *
 * c_k^(d)(w) = (-1)^d sum_i (-w)^i ((i+d)!/i!) / (k + 2(i+d))!.
 *
 * |w| <= 16: this series. Next to the zeros of c_0, c_1 and c_0' = -c_1/2 (the others have none there) they
 * are taken from cos and sin of x = sqrt(w), with the rounding error of x carried along: relative accuracy is
 * kept. |w| > 16: c_0, c_1, c_2 = 2 sin(x/2)^2/w in closed form, then c_{k+2} = (1/k! - c_k)/w,   c_0' =
 * -c_1/2,   2w c_k^(d+1) = c_{k-1}^(d) - (k + 2d) c_k^(d) (from d/dx (x^k c_k) = x^(k-1) c_{k-1}), except
 * where the series hardly cancels: then these recursions would. */

enum {
    SHORT_TERMS = 10,
    MIDDLE_TERMS = 14,
    TERMS = 18,
    MAX_K = LG_STUMPFF_MAX_K,
    MAX_ORDER = LG_STUMPFF_MAX_ORDER
};

/* 1/n! */
static const double inverse_factorial[64] = {1.0,
                                             1.0,
                                             0.5,
                                             0.16666666666666667,
                                             0.041666666666666667,
                                             0.0083333333333333333,
                                             0.0013888888888888889,
                                             0.00019841269841269841,
                                             2.4801587301587302e-5,
                                             2.7557319223985891e-6,
                                             2.7557319223985891e-7,
                                             2.5052108385441719e-8,
                                             2.0876756987868099e-9,
                                             1.6059043836821615e-10,
                                             1.1470745597729725e-11,
                                             7.6471637318198165e-13,
                                             4.7794773323873853e-14,
                                             2.8114572543455208e-15,
                                             1.5619206968586226e-16,
                                             8.2206352466243297e-18,
                                             4.1103176233121649e-19,
                                             1.9572941063391261e-20,
                                             8.8967913924505733e-22,
                                             3.868170170630684e-23,
                                             1.6117375710961183e-24,
                                             6.4469502843844734e-26,
                                             2.4795962632247975e-27,
                                             9.1836898637955461e-29,
                                             3.2798892370698379e-30,
                                             1.1309962886447717e-31,
                                             3.7699876288159056e-33,
                                             1.2161250415535179e-34,
                                             3.8003907548547436e-36,
                                             1.151633562077195e-37,
                                             3.3871575355211618e-39,
                                             9.677592958631891e-41,
                                             2.6882202662866364e-42,
                                             7.2654601791530713e-44,
                                             1.9119632050402819e-45,
                                             4.9024697565135434e-47,
                                             1.2256174391283858e-48,
                                             2.9893108271424045e-50,
                                             7.1174067312914393e-52,
                                             1.6552108677421952e-53,
                                             3.7618428812322618e-55,
                                             8.359650847182804e-57,
                                             1.8173154015614791e-58,
                                             3.8666285139605939e-60,
                                             8.0554760707512373e-62,
                                             1.643974708316579e-63,
                                             3.2879494166331581e-65,
                                             6.4469596404571727e-67,
                                             1.2397999308571486e-68,
                                             2.3392451525606577e-70,
                                             4.3319354677049217e-72,
                                             7.8762463049180395e-74,
                                             1.4064725544496499e-75,
                                             2.4674957095607893e-77,
                                             4.2543029475186023e-79,
                                             7.210682961895936e-81,
                                             1.2017804936493227e-82,
                                             1.9701319568021683e-84,
                                             3.1776321883905941e-86,
                                             5.0438606164930064e-88};

/* (i + d)!/i!, exact */
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

/* Four values of k at a time: their coefficients are neighbours in the table of 1/n!. Two chains, of the even
 * and of the odd powers of w, halve the waiting. */
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

/* One function by the series, for |w| (d+1) <= 2 (k+2d+1)(k+2d+2). */
static double series_one(double w, int k, int d) {
    double term = (d % 2 == 0 ? 1.0 : -1.0) * falling[d][0] * inverse_factorial[k + 2 * d], total = term;
    for (int i = 0; i < 100 && fabs(term) > 0x1p-60 * fabs(total); i++) {
        const double n = k + 2.0 * (i + d);
        term *= -w * (i + d + 1) / ((i + 1) * (n + 1.0) * (n + 2.0));
        total += term;
    }
    return total;
}

/* x = sqrt(|w|) without and with what rounding took from it */
static double root(double w, double *dx) {
    const double x = sqrt(fabs(w));
    *dx = fma(-x, x, fabs(w)) / (2.0 * x);
    return x;
}

/* c_0 and c_1 in closed form, |w| > 1 */
static void closed_form(double w, double c[2]) {
    double dx;
    const double x = root(w, &dx);
    const double s = w > 0 ? sin(x) : sinh(x), co = w > 0 ? cos(x) : cosh(x);
    c[0] = w > 0 ? co - dx * s : co + dx * s;
    c[1] = (s + dx * co) / x;
}

/* c_2 = 2 sin(x/2)^2/w */
static double closed_form_2(double w) {
    double dx;
    const double x = 0.5 * root(w, &dx);
    const double half = w > 0 ? sin(x) + 0.5 * dx * cos(x) : sinh(x) + 0.5 * dx * cosh(x);
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

void lg_stumpff(double w, int K, int order, double *c) {
    if (!(fabs(w) <= 16.0)) {
        recursion(w, K, order, c);
        return;
    }
    series_row(w, K, order, c);
    const bool near_0 = order < 2 && fabs(c[0]) < 0.25, near_1 = order == 0 && K > 0 && fabs(c[1]) < 0.1;
    if (w <= 1.0 || !(near_0 || near_1)) return;
    double closed[2];
    closed_form(w, closed);
    if (near_0) c[0] = order == 0 ? closed[0] : -0.5 * closed[1];
    if (near_1) c[1] = closed[1];
}

/* ---- dexpinv ----
 *
 * The partial fractions of the cotangent give g2(w) = sum_m 2/((2 pi m)^2 - w). The first pole is kept, the
 * rest is a power series: g2 = 2/(4 pi^2 - w) + sum_j c_j w^j, c_j = 2 (zeta(2j+2) - 1)/(2 pi)^(2j+2), radius
 * 16 pi^2. */

enum { POLE_TERMS = 40 };

static const double pole_rest[POLE_TERMS] = {
    0.032672741512164448,   0.00010564110705334699, 5.6373702828768453e-7,  3.3571419266574514e-9,
    2.0742872904166046e-11, 1.3000482138698974e-13, 8.1960520556910086e-16, 5.1801181961697243e-18,
    3.2775391747017918e-20, 2.0747401878593605e-22, 1.3136241807166534e-24, 8.3180031951892641e-27,
    5.2672629968342309e-29, 3.3354842988221443e-31, 2.1122063323183885e-33, 1.3375664093215244e-35,
    8.4702273286502466e-38, 5.3638310466556986e-40, 3.3966848266497807e-42, 2.1509755511832567e-44,
    1.3621211117593843e-46, 8.625732514113179e-49,  5.4623088714895593e-51, 3.4590474864883952e-53,
    2.1904674057436383e-55, 1.3871296880408167e-57, 8.784101362706072e-60,  5.5625971696904569e-62,
    3.5225558082215214e-64, 2.2306845245191415e-66, 1.4125974772094366e-68, 8.9453780250049516e-71,
    5.6647268101184646e-73, 3.5872301588182866e-75, 2.2716400355546614e-77, 1.4385328575728765e-79,
    9.1096157398538359e-82, 5.7687315580550838e-84, 3.6530919348564687e-86, 2.3133474924620718e-88};

/* 4 pi^2 = high + low */
static const double pole_high = 39.478417604357432, pole_low = 2.5061182034958847e-15;

static double pole_form(double w, int order) {
    const int terms = fabs(w) <= 1.0 ? 10 + order : fabs(w) <= 10.0 ? 20 + order : POLE_TERMS;
    double rest = 0;
    for (int j = terms - 1; j >= order; j--) {
        double factor = 1;
        for (int i = 0; i < order; i++) factor *= j - i;
        rest = rest * w + factor * pole_rest[j];
    }
    const double distance = (pole_high - w) + pole_low;
    double pole = 2.0 / distance;
    for (int i = 1; i <= order; i++) pole *= i / distance;
    return pole + rest;
}

/* Far from 0: q = (x/2) cot(x/2) satisfies 2w q' = q - q^2 - w/4, and g2 = (1 - q)/w; both differentiated. */
static double quotient_form(double w, int order) {
    double q[MAX_ORDER + 1], g = 0;
    const double x = sqrt(fabs(w));
    q[0] = w > 0 ? 0.5 * x / tan(0.5 * x) : 0.5 * x / tanh(0.5 * x);
    for (int d = 0; d <= order; d++) {
        g = ((d == 0 ? 1.0 : 0.0) - q[d] - d * g) / w;
        if (d == order) break;
        double square = 0, binomial = 1;
        for (int i = 0; i <= d; i++) {
            square += binomial * q[i] * q[d - i];
            binomial *= (double)(d - i) / (i + 1);
        }
        q[d + 1] = ((1 - 2 * d) * q[d] - square - (d == 0 ? 0.25 * w : d == 1 ? 0.25 : 0.0)) / (2.0 * w);
    }
    return g;
}

double lg_dexpinv_coef(double w, int order) {
    return fabs(w) <= 45.0 ? pole_form(w, order) : quotient_form(w, order);
}
