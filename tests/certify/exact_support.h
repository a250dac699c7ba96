/* Operations on numbers by MPFR, and boxes of difficult kinds. */
#ifndef LG_EXACT_SUPPORT_H
#define LG_EXACT_SUPPORT_H

#include "test_support.h"

#include <float.h>
#include <math.h>
#ifdef LG_MPFR
#include <mpfr.h>
#endif

#include "certify/interval.h"
#include "kernels/stumpff.h"

enum {
    BITS = 256,        /* of points and values */
    SERIES_BITS = 640, /* of the series and closed forms */
    POLES = 24,        /* of the dexpinv coefficients, which are subtracted */
    TERMS = 100,
    OPERANDS = 3
};

/* ---- boxes ---- */

/* Where something happens: edges of domains, poles, limits of formulas, overflow and underflow, and the
 * number below 1e6 that is closest to a multiple of pi/2. */
static inline double exact_edge(lg_rng *r) {
    static const double edges[] = {0,
                                   0,
                                   1,
                                   2,
                                   16,
                                   20,
                                   100,
                                   300,
                                   22,
                                   36.7,
                                   709.7,
                                   745,
                                   1000,
                                   1e6,
                                   1e15,
                                   39.478,
                                   38.9,
                                   39.47841760435743,
                                   0.5,
                                   1e-9,
                                   1e16,
                                   0x1p-26,
                                   0x1p-53,
                                   0x1p511,
                                   0x1p-537,
                                   1e100,
                                   DBL_MAX,
                                   DBL_MIN,
                                   0x1p-1074,
                                   0x1p-1021,
                                   0x1p-1022,
                                   0x1p1022,
                                   1e300,
                                   1e-300,
                                   0x1.39c6fd67805a7p+19};
    return edges[lg_rng_below(r, sizeof edges / sizeof *edges)];
}

static inline double exact_neighbour(lg_rng *r, double x, uint64_t most) {
    const double to = lg_rng_below(r, 2) ? DBL_MAX : -DBL_MAX;
    for (uint64_t k = lg_rng_below(r, most + 1); k > 0; k--) x = nextafter(x, to);
    return x;
}

static inline double exact_number(lg_rng *r) {
    const double sign = lg_rng_below(r, 2) ? 1 : -1;
    switch (lg_rng_below(r, 9)) {
    case 0:
    case 1:
        return lg_rng_uniform_in(r, -4, 4);
    case 2:
        return exact_neighbour(r, sign * exact_edge(r), 3);
    case 3: /* near a multiple of pi/2 */
        return exact_neighbour(
            r, sign * 1.5707963267948966 * floor(ldexp(1 + lg_rng_uniform(r), (int)lg_rng_below(r, 56))), 2);
    case 4:
        return sign * ldexp(1 + lg_rng_uniform(r), (int)lg_rng_below(r, 2046) - 1022);
    case 5: /* denormal */
        return sign * 0x1p-1074 * floor(ldexp(1 + lg_rng_uniform(r), (int)lg_rng_below(r, 52)));
    case 6:
        return sign * ldexp(1 + lg_rng_uniform(r), (int)lg_rng_below(r, 40) - 20);
    case 7:
        return lg_rng_uniform_in(r, -2000, 1000);
    default: /* below the pole at 4 pi^2 */
        return 39.47841760435743 - ldexp(lg_rng_uniform(r), 6 - (int)lg_rng_below(r, 54));
    }
}

static inline void exact_box(lg_rng *r, double *low, double *high) {
    const double a = exact_number(r);
    double b = a;
    switch (lg_rng_below(r, 9)) {
    case 0:
    case 1:
        break;
    case 2:
        b = exact_neighbour(r, a, 1);
        break;
    case 3:
        b = exact_neighbour(r, a, 8);
        break;
    case 4:
    case 5:
        b = a * (1 + ldexp(lg_rng_uniform(r), -(int)lg_rng_below(r, 52)));
        break;
    case 6:
        b = a + lg_rng_uniform_in(r, 0, 3);
        break;
    case 7: /* about 0 */
        b = -a * lg_rng_uniform(r);
        break;
    default:
        b = exact_number(r);
    }
    if (!(fabs(b) <= DBL_MAX)) b = copysign(DBL_MAX, b);
    *low = fmin(a, b);
    *high = fmax(a, b);
}

static inline double exact_point(lg_rng *r, double low, double high) {
    double x = low + (high - low) * lg_rng_uniform(r);
    if (!(fabs(high - low) <= DBL_MAX)) x = low * 0.5 + high * 0.5;
    switch (lg_rng_below(r, 4)) {
    case 0:
        x = exact_number(r);
        break;
    case 1: /* of any size between */
        x = low > 0 ? exp(lg_rng_uniform_in(r, log(low), log(high))) : x;
        break;
    default:
        break;
    }
    return x < low ? low : x > high ? high : x;
}

#ifdef LG_MPFR
/* ---- Stumpff functions and dexpinv coefficients ---- */

/* The sum (-1)^d sum_i (-w)^i (i + d)!/i!/(k + 2 (i + d))!. Its terms are below e^sqrt(|w|). */
static inline void exact_stumpff_series(mpfr_t y, mpfr_srcptr w, uint32_t k, uint32_t d) {
    const mpfr_prec_t bits = mpfr_get_prec(y) + 96;
    mpfr_t term, sum;
    mpfr_inits2(bits, term, sum, NULL);
    mpfr_fac_ui(sum, k + 2 * d, MPFR_RNDN);
    mpfr_fac_ui(term, d, MPFR_RNDN);
    mpfr_div(term, term, sum, MPFR_RNDN);
    if (d % 2 == 1) mpfr_neg(term, term, MPFR_RNDN);
    mpfr_set(sum, term, MPFR_RNDN);
    for (unsigned long i = 0; i < 4000 && !mpfr_zero_p(term); i++) {
        const unsigned long n = k + 2 * (i + d);
        mpfr_mul(term, term, w, MPFR_RNDN);
        mpfr_mul_si(term, term, -(long)(i + 1 + d), MPFR_RNDN);
        mpfr_div_ui(term, term, (i + 1) * (n + 1) * (n + 2), MPFR_RNDN);
        mpfr_add(sum, sum, term, MPFR_RNDN);
        if (!mpfr_zero_p(term) && !mpfr_zero_p(sum) && mpfr_get_exp(term) < mpfr_get_exp(sum) - bits) break;
    }
    mpfr_set(y, sum, MPFR_RNDN);
    mpfr_clears(term, sum, NULL);
}

/* For |w| > 16: c_0 and c_1 from cos and sin, then c_{k+2} = (1/k! - c_k)/w, c_0' = -c_1/2 and 2 w
 * c_k^(d+1) = c_{k-1}^(d) - (k + 2 d) c_k^(d). */
static inline void exact_stumpff_beyond(mpfr_t y, mpfr_srcptr w, uint32_t k, uint32_t d) {
    enum { MOST = LG_STUMPFF_MAX_K + 2 };
    const mpfr_prec_t bits = mpfr_get_prec(y) + 96 + mpfr_get_exp(w); /* 50 of 96 bits are lost at most */
    mpfr_t c[MOST], root, next;
    for (int i = 0; i < MOST; i++) mpfr_init2(c[i], bits);
    mpfr_inits2(bits, root, next, NULL);
    mpfr_abs(root, w, MPFR_RNDN);
    mpfr_sqrt(root, root, MPFR_RNDN);
    if (mpfr_sgn(w) > 0)
        mpfr_sin_cos(c[1], c[0], root, MPFR_RNDN);
    else
        mpfr_sinh_cosh(c[1], c[0], root, MPFR_RNDN);
    mpfr_div(c[1], c[1], root, MPFR_RNDN);
    for (unsigned long i = 2; i <= k; i++) {
        mpfr_fac_ui(c[i], i - 2, MPFR_RNDN);
        mpfr_ui_div(c[i], 1, c[i], MPFR_RNDN);
        mpfr_sub(c[i], c[i], c[i - 2], MPFR_RNDN);
        mpfr_div(c[i], c[i], w, MPFR_RNDN);
    }
    for (unsigned long e = 0; e < d; e++)
        for (unsigned long i = k > 1 ? k + 1 : 2; i-- > 0;) {
            if (i == 0) {
                mpfr_div_si(c[0], root, -2, MPFR_RNDN);
                break;
            }
            if (i == 1) mpfr_set(root, c[1], MPFR_RNDN); /* c_1 before this derivative */
            mpfr_mul_ui(next, c[i], i + 2 * e, MPFR_RNDN);
            mpfr_sub(c[i], c[i - 1], next, MPFR_RNDN);
            mpfr_div(c[i], c[i], w, MPFR_RNDN);
            mpfr_div_2ui(c[i], c[i], 1, MPFR_RNDN);
        }
    mpfr_set(y, c[k], MPFR_RNDN);
    for (int i = 0; i < MOST; i++) mpfr_clear(c[i]);
    mpfr_clears(root, next, NULL);
}

static inline void exact_stumpff(mpfr_t y, mpfr_srcptr w, uint32_t k, uint32_t d) {
    if (mpfr_cmpabs_ui(w, 40) <= 0)
        exact_stumpff_series(y, w, k, d);
    else if (mpfr_cmp_si(w, -100000000) < 0) /* beyond all doubles */
        mpfr_set_inf(y, d % 2 == 0 ? 1 : -1);
    else
        exact_stumpff_beyond(y, w, k, d);
}

/* The derivative of order n of g_2(w) = sum_k 2/(4 pi^2 k^2 - w) for -2000 <= w < 4 pi^2: the first poles,
 * and the power series of the others. */
static inline void exact_dexpinv_poles(mpfr_t y, mpfr_srcptr w, unsigned long n) {
    static mpfr_t rest[TERMS], pole[POLES + 1];
    static bool known;
    mpfr_t power, sum, term, factorial;
    mpfr_inits2(mpfr_get_prec(y) + 96, power, sum, term, factorial, NULL);
    if (!known) {
        mpfr_t fine, part;
        mpfr_inits2(3000, fine, part, NULL);
        for (unsigned long k = 0; k <= POLES; k++) {
            mpfr_init2(pole[k], SERIES_BITS);
            mpfr_const_pi(fine, MPFR_RNDN);
            mpfr_mul_ui(fine, fine, 2 * k, MPFR_RNDN);
            mpfr_sqr(pole[k], fine, MPFR_RNDN);
        }
        for (unsigned long m = 0; m < TERMS; m++) { /* 2 sum_{k > POLES} (4 pi^2 k^2)^-(m + 1) */
            mpfr_init2(rest[m], SERIES_BITS);
            mpfr_zeta_ui(fine, 2 * m + 2, MPFR_RNDN);
            for (unsigned long k = 1; k <= POLES; k++) {
                mpfr_ui_pow_ui(part, k, 2 * m + 2, MPFR_RNDN);
                mpfr_ui_div(part, 1, part, MPFR_RNDN);
                mpfr_sub(fine, fine, part, MPFR_RNDN);
            }
            mpfr_pow_ui(part, pole[1], m + 1, MPFR_RNDN);
            mpfr_div(fine, fine, part, MPFR_RNDN);
            mpfr_mul_2ui(rest[m], fine, 1, MPFR_RNDN);
        }
        mpfr_clears(fine, part, NULL);
        known = true;
    }
    mpfr_set_zero(sum, 1);
    for (unsigned long m = TERMS; m-- > n;) {
        mpfr_mul(sum, sum, w, MPFR_RNDN);
        mpfr_set(term, rest[m], MPFR_RNDN);
        unsigned long factor = 1; /* m!/(m - n)! < 100^8 */
        for (unsigned long j = 0; j < n; j++) factor *= m - j;
        mpfr_mul_ui(term, term, factor, MPFR_RNDN);
        mpfr_add(sum, sum, term, MPFR_RNDN);
    }
    mpfr_fac_ui(factorial, n, MPFR_RNDN);
    mpfr_mul_2ui(factorial, factorial, 1, MPFR_RNDN);
    for (unsigned long k = 1; k <= POLES; k++) {
        mpfr_sub(power, pole[k], w, MPFR_RNDN);
        mpfr_pow_ui(power, power, n + 1, MPFR_RNDN);
        mpfr_div(term, factorial, power, MPFR_RNDN);
        mpfr_add(sum, sum, term, MPFR_RNDN);
    }
    mpfr_set(y, sum, MPFR_RNDN);
    mpfr_clears(power, sum, term, factorial, NULL);
}

/* The same for w < -1000 from g_2 = coth(x/2)/(2 x) - 1/t with t = -w, x = sqrt t: e^-x is below 2^-45, and
 * coth(x/2) = 1 + 2 sum_j e^(-j x). The derivatives of x^-1 e^(-j x) by t follow from D = d/dt = (2 x)^-1
 * d/dx on polynomials of 1/x. */
static inline void exact_dexpinv_far(mpfr_t y, mpfr_srcptr w, unsigned long n) {
    enum { J = 8, MOST = 20 };
    mpfr_t a[MOST], x, t, e, sum, part;
    mpfr_inits2(SERIES_BITS, x, t, e, sum, part, NULL);
    for (int i = 0; i < MOST; i++) mpfr_init2(a[i], SERIES_BITS);
    mpfr_neg(t, w, MPFR_RNDN);
    mpfr_sqrt(x, t, MPFR_RNDN);
    mpfr_fac_ui(sum, n, MPFR_RNDN); /* -1/t: (-1)^(n + 1) n!/t^(n + 1) */
    mpfr_pow_ui(part, t, n + 1, MPFR_RNDN);
    mpfr_div(sum, sum, part, MPFR_RNDN);
    if (n % 2 == 0) mpfr_neg(sum, sum, MPFR_RNDN);
    for (long j = 0; j <= J; j++) { /* a[i] x^-i e^(-j x): D gives -j/2 x^-(i+1) - i/2 x^-(i+2) */
        for (int i = 0; i < MOST; i++) mpfr_set_zero(a[i], 1);
        mpfr_set_d(a[1], j == 0 ? 0.5 : 1.0, MPFR_RNDN);
        for (unsigned long k = 0; k < n; k++)
            for (long i = MOST; i-- > 0;) {
                mpfr_set_zero(part, 1);
                if (i >= 1) mpfr_mul_si(part, a[i - 1], -j, MPFR_RNDN);
                if (i >= 2) {
                    mpfr_mul_si(e, a[i - 2], -(i - 2), MPFR_RNDN);
                    mpfr_add(part, part, e, MPFR_RNDN);
                }
                mpfr_div_2ui(a[i], part, 1, MPFR_RNDN);
            }
        mpfr_set_zero(part, 1);
        for (int i = MOST; i-- > 0;) {
            mpfr_div(part, part, x, MPFR_RNDN);
            mpfr_add(part, part, a[i], MPFR_RNDN);
        }
        mpfr_mul_si(e, x, -j, MPFR_RNDN);
        mpfr_exp(e, e, MPFR_RNDN);
        mpfr_mul(part, part, e, MPFR_RNDN);
        mpfr_add(sum, sum, part, MPFR_RNDN);
    }
    mpfr_set(y, sum, MPFR_RNDN);
    if (n % 2 == 1) mpfr_neg(y, y, MPFR_RNDN);
    for (int i = 0; i < MOST; i++) mpfr_clear(a[i]);
    mpfr_clears(x, t, e, sum, part, NULL);
}

static inline void exact_dexpinv(mpfr_t y, mpfr_srcptr w, unsigned long n) {
    mpfr_t limit;
    mpfr_init2(limit, BITS);
    mpfr_const_pi(limit, MPFR_RNDN);
    mpfr_mul_2ui(limit, limit, 1, MPFR_RNDN);
    mpfr_sqr(limit, limit, MPFR_RNDN);
    if (!(mpfr_cmp(w, limit) < 0))
        mpfr_set_nan(y);
    else if (mpfr_cmp_si(w, -1000) < 0)
        exact_dexpinv_far(y, w, n);
    else
        exact_dexpinv_poles(y, w, n);
    mpfr_clear(limit);
}

/* ---- every operation ---- */

/* y = op(x), NaN where it is not defined, infinite where it is not known. Returns the sign of y minus the
 * exact value; 0: y is exact, or closer than 2^-200 of it. */
static inline int exact_operation(mpfr_t y, const lg_scalar_code *c, mpfr_t *x) {
    mpfr_ptr a = x[0], b = x[1];
    int sign = 0;
    const uint32_t operands = lg_scalar_instructions(c->op), reads = c->op == LG_S_SELECT ? 1 : operands;
    for (uint32_t k = 0; k < reads; k++)
        if (!mpfr_number_p(x[k])) {
            mpfr_set_nan(y);
            return 0;
        }
    const bool turns = c->op == LG_S_SIN || c->op == LG_S_COS || c->op == LG_S_STUMPFF;
    if (turns && !mpfr_zero_p(a) && mpfr_get_exp(a) > 1100) { /* pi would need too many bits */
        mpfr_set_inf(y, 1);
        return 0;
    }
    switch (c->op) {
    case LG_S_ADD:
        return mpfr_add(y, a, b, MPFR_RNDN);
    case LG_S_SUB:
        return mpfr_sub(y, a, b, MPFR_RNDN);
    case LG_S_MUL:
        return mpfr_mul(y, a, b, MPFR_RNDN);
    case LG_S_DIV:
        if (mpfr_zero_p(b)) break;
        return mpfr_div(y, a, b, MPFR_RNDN);
    case LG_S_NEG:
        return mpfr_neg(y, a, MPFR_RNDN);
    case LG_S_MAX:
        return mpfr_max(y, a, b, MPFR_RNDN);
    case LG_S_GE:
        return mpfr_set_si(y, mpfr_cmp(a, b) >= 0, MPFR_RNDN);
    case LG_S_SELECT:
        return mpfr_set(y, mpfr_zero_p(a) ? x[2] : b, MPFR_RNDN);
    case LG_S_SQRT:
        return mpfr_sqrt(y, a, MPFR_RNDN);
    case LG_S_ABS:
        return mpfr_abs(y, a, MPFR_RNDN);
    case LG_S_SIGN:
        return mpfr_set_si(y, mpfr_sgn(a) >= 0 ? 1 : -1, MPFR_RNDN);
    case LG_S_POW: {
        const bool whole = c->p == floor(c->p);
        mpfr_t p;
        if ((c->p < 0 && mpfr_zero_p(a)) || (!whole && mpfr_sgn(a) < 0)) break;
        mpfr_init2(p, 53);
        mpfr_set_d(p, c->p, MPFR_RNDN);
        sign = mpfr_pow(y, a, p, MPFR_RNDN);
        mpfr_clear(p);
        return sign;
    }
    case LG_S_EXP:
        return mpfr_exp(y, a, MPFR_RNDN);
    case LG_S_LOG:
        if (mpfr_sgn(a) <= 0) break;
        return mpfr_log(y, a, MPFR_RNDN);
    case LG_S_SIN:
        return mpfr_sin(y, a, MPFR_RNDN);
    case LG_S_COS:
        return mpfr_cos(y, a, MPFR_RNDN);
    case LG_S_TANH:
        return mpfr_tanh(y, a, MPFR_RNDN);
    case LG_S_SIGMOID: /* 1/(1 + e^-x); 1 + 2^-BITS is not exact in so many bits: x > BITS is just below 1 */
        mpfr_neg(y, a, MPFR_RNDN);
        mpfr_exp(y, y, MPFR_RNDN);
        mpfr_add_ui(y, y, 1, MPFR_RNDN);
        mpfr_ui_div(y, 1, y, MPFR_RNDN);
        return mpfr_cmp_ui(y, 1) == 0 ? 1 : mpfr_zero_p(y) ? -1 : 0;
    case LG_S_ATAN2:
        if (mpfr_zero_p(a) && mpfr_zero_p(b)) break;
        sign = mpfr_atan2(y, a, b, MPFR_RNDN);
        if (mpfr_zero_p(a) && mpfr_sgn(b) < 0) { /* pi, not -pi for a negative 0 */
            mpfr_abs(y, y, MPFR_RNDN);
            sign = 0;
        }
        return sign;
    case LG_S_STUMPFF:
        exact_stumpff(y, a, c->n % 16, c->n / 16);
        return 0;
    case LG_S_DEXPINV:
        exact_dexpinv(y, a, c->n);
        return 0;
    case LG_S_INPUT:
    case LG_S_CONSTANT:
    case LG_SCALAR_OPS:
        break;
    }
    mpfr_set_nan(y);
    return 0;
}

/* Whether low <= the exact value <= high, where y is rounded with the sign `above`. */
static inline bool exact_is_within(double low, double high, mpfr_srcptr y, int above) {
    const int l = mpfr_cmp_d(y, low), h = mpfr_cmp_d(y, high);
    return (l > 0 || (l == 0 && above <= 0)) && (h < 0 || (h == 0 && above >= 0));
}

#endif

#endif
