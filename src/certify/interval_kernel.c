/* Interval forms of scalar code. This file is compiled once for each instruction set, with LG_KERNEL_ISA =
 * baseline, avx2, avx512 or neon, and LG_KERNEL_ISA_<set> defined. Its only external symbol is the function
 * lg_intervals_<set>.
 *
 * A register holds LG_INTERVAL_BLOCK intervals: all lower bounds,
 * then all upper bounds. Every form contains the exact result of the operation for all numbers of its
 * operands.
 *
 * Invariant of every register: no bound is NaN, no lower bound is +inf, no upper bound is -inf. A result
 * whose bound is not representable, or that is not defined on the whole operand, gets the bound -inf or inf.
 *
 * Rounding. For c = fl(a op b), fl(c - fl(phi |c| + eta)) with phi = u (1 + 2u), u = 2^-53, is below the
 * exact a op b (Rump, Zimmermann, Boldo & Melquiond 2009). A sum below 2^-1021 is exact, as all numbers are
 * multiples of eta. Functions of math.inc have errors of at most 3 units in the last place; they are
 * widened by LG_WIDE_ULPS, functions of libm as well. */
#define LG_KERNEL_f64
#include "certify/interval.h"
#include "kernels/stumpff.h"

#include "kernels/common.inc"
#include "kernels/math.inc"

enum { IB = LG_INTERVAL_BLOCK };
#define PHI          (0x1p-53 * (1.0 + 0x1p-52))
#define ETA          0x1p-1074
#define LG_WIDE_ULPS 8.0
#define EACH         INDEPENDENT for (size_t i = 0; i < IB; i++)

/* Bounds that are not defined become infinite. */
INLINE double not_above(double c, double by) {
    const double r = c - by;
    return r == r ? r : -(double)INFINITY;
}
INLINE double not_below(double c, double by) {
    const double r = c + by;
    return r == r ? r : (double)INFINITY;
}
INLINE double least(double a, double b) {
    return a < b ? a : b;
}
INLINE double most(double a, double b) {
    return a > b ? a : b;
}
/* Error bound of a sum or a difference with the result y */
INLINE double half_unit(double y) {
    return fabs(y) < 0x1p-1021 ? 0.0 : PHI * fabs(y) + ETA;
}
/* Error bound of a function of math.inc or libm with the result y; 0 for an exact 0. */
INLINE double wide(double y) {
    return LG_WIDE_ULPS * 0x1p-52 * fabs(y) + (y == 0.0 ? 0.0 : 4.0 * ETA);
}

#define ANY __attribute__((unused))
#define FORM(name)                                                                                           \
    static void interval_##name(const double *a, ANY const double *b, ANY const lg_interval_code *code,      \
                                double *restrict y)
#define AL a[i]
#define AH a[IB + i]
#define BL b[i]
#define BH b[IB + i]
#define YL y[i]
#define YH y[IB + i]

FORM(add) {
    EACH {
        const double l = AL + BL, h = AH + BH;
        YL = not_above(l, half_unit(l));
        YH = not_below(h, half_unit(h));
    }
}

FORM(sub) {
    EACH {
        const double l = AL - BH, h = AH - BL;
        YL = not_above(l, half_unit(l));
        YH = not_below(h, half_unit(h));
    }
}

FORM(neg) {
    EACH {
        const double l = AL;
        YL = -AH;
        YH = -l;
    }
}

/* x x */
FORM(square) {
    EACH {
        const double u = fabs(AL), v = fabs(AH), h = most(u, v), zero = AL <= 0.0 && AH >= 0.0 ? 0.0 : 1.0;
        const double low = least(u, v) * zero, l = low * low, p = h * h, eta = h == 0.0 ? 0.0 : ETA;
        YL = most(0.0, not_above(l, PHI * l + ETA));
        YH = not_below(p, PHI * p + eta);
    }
}

/* A product with the interval [0, 0] is 0, and one that has no negative numbers keeps the bound 0: without
 * eta, so that an equilibrium stays exact. A corner 0 inf is NaN: it is passed over, because its neighbour
 * is 0, or it makes the bound infinite. */
FORM(mul) {
    if (a == b) {
        interval_square(a, b, code, y);
        return;
    }
    EACH {
        const double al = AL, ah = AH, bl = BL, bh = BH;
        const double p = al * bl, q = al * bh, r = ah * bl, s = ah * bh;
        double l = least(r, least(s, least(q, p))), h = most(r, most(s, most(q, p)));
        const double eta = most(-al, ah) * 0x1p600 * (most(-bl, bh) * 0x1p600) == 0.0 ? 0.0 : ETA;
        l = not_above(l, PHI * fabs(l) + eta);
        h = not_below(h, PHI * fabs(h) + eta);
        const double same = most(least(al, bl), least(-ah, -bh));  /* >= 0: the operands have one sign */
        const double other = most(least(al, -bh), least(-ah, bl)); /* >= 0: opposite signs */
        YL = most(l, same >= 0.0 ? 0.0 : -(double)INFINITY);
        YH = least(h, other >= 0.0 ? 0.0 : (double)INFINITY);
    }
}

/* By a number that is exactly known. 0 x is 0 for every x. */
FORM(scale) {
    const double p = code->p;
    const size_t low = p < 0.0 ? IB : 0, high = IB - low;
    if (p == 0.0) {
        memset(y, 0, 2 * IB * sizeof *y);
        return;
    }
    EACH {
        const double al = a[low + i], ah = a[high + i], l = p * al, h = p * ah;
        YL = not_above(l, PHI * fabs(l) + (al == 0.0 ? 0.0 : ETA));
        YH = not_below(h, PHI * fabs(h) + (ah == 0.0 ? 0.0 : ETA));
    }
}

FORM(shift) {
    const double p = code->p;
    EACH {
        const double l = AL + p, h = AH + p;
        YL = not_above(l, half_unit(l));
        YH = not_below(h, half_unit(h));
    }
}

FORM(div) {
    EACH {
        const double al = AL, ah = AH, bl = BL, bh = BH;
        const double p = al / bl, q = al / bh, r = ah / bl, s = ah / bh;
        const double l = least(r, least(s, least(q, p))), h = most(r, most(s, most(q, p)));
        const double eta = al == 0.0 && ah == 0.0 ? 0.0 : ETA;
        const int defined = ((bl > 0.0) | (bh < 0.0)) & (p == p) & (q == q) & (r == r) & (s == s);
        YL = defined ? not_above(l, PHI * fabs(l) + eta) : -(double)INFINITY;
        YH = defined ? not_below(h, PHI * fabs(h) + eta) : (double)INFINITY;
    }
}

FORM(max) {
    EACH {
        YL = most(AL, BL);
        YH = most(AH, BH);
    }
}

FORM(ge) {
    EACH {
        const double l = AL >= BH ? 1.0 : 0.0, h = AH >= BL ? 1.0 : 0.0;
        YL = l;
        YH = h;
    }
}

FORM(abs) {
    EACH {
        const double u = most(AL, -AH), v = most(-AL, AH);
        YL = most(u, 0.0);
        YH = v;
    }
}

FORM(sign) {
    EACH {
        const double l = AL >= 0.0 ? 1.0 : -1.0, h = AH >= 0.0 ? 1.0 : -1.0;
        YL = l;
        YH = h;
    }
}

FORM(sqrt) {
    EACH {
        const double al = AL, l = sqrt(most(al, 0.0)), h = sqrt(most(AH, 0.0));
        YL = al >= 0.0 ? most(0.0, not_above(l, PHI * l)) : -(double)INFINITY;
        YH = al >= 0.0 ? not_below(h, PHI * h) : (double)INFINITY;
    }
}

FORM(exp) {
    EACH {
        const double l = exp_f64(AL), h = exp_f64(AH);
        YL = most(0.0, not_above(l, wide(l)));
        YH = not_below(h, wide(h) + 4.0 * ETA);
    }
}

FORM(log) {
    EACH {
        const int defined = AL > 0.0;
        const double l = log_core(defined ? AL : 1.0), h = log_core(defined ? AH : 1.0);
        YL = defined ? not_above(l, wide(l)) : -(double)INFINITY;
        YH = defined ? not_below(h, wide(h)) : (double)INFINITY;
    }
}

FORM(tanh) {
    EACH {
        const double l = tanh_f64(AL), h = tanh_f64(AH);
        YL = most(-1.0, l - wide(l));
        YH = least(1.0, h + wide(h));
    }
}

FORM(sigmoid) {
    EACH {
        const double l = sigmoid_f64(AL), h = sigmoid_f64(AH);
        YL = most(0.0, l - wide(l));
        YH = least(1.0, h + wide(h) + 4.0 * ETA);
    }
}

/* Whether [l, h] + shift contains a whole number, in units of a turn; true in doubt. */
INLINE int has_turn(double l, double h, double shift) {
    const double low = l * 0x1.45f306dc9c883p-3 + shift, high = h * 0x1.45f306dc9c883p-3 + shift;
    const double doubt = 0x1p-50 * (most(fabs(low), fabs(high)) + 1.0);
    return floor(high + doubt) >= low - doubt;
}

/* sin (shift 0) and cos (shift 1). The reduction of an argument x in math.inc has an error below 2^-100 |x|,
 * which matters near the zeros. sin has its maxima at a quarter of a turn and its minima at three. */
INLINE void trig(const double *a, double *restrict y, int shift) {
    const double top = shift == 0 ? -0.25 : 0.0, bottom = shift == 0 ? 0.25 : 0.5;
    EACH {
        const double al = AL, ah = AH;
        const int near = (al >= -TRIG_LIMIT) & (ah <= TRIG_LIMIT);
        const double l = near ? al : 0.0, h = near ? ah : 0.0;
        const double u = shift == 0 ? sin_core(l) : cos_core(l), v = shift == 0 ? sin_core(h) : cos_core(h);
        const double p = wide(u) + 0x1p-100 * fabs(l), q = wide(v) + 0x1p-100 * fabs(h);
        const double low = least(u - p, v - q), high = most(u + p, v + q);
        YL = (near == 0) | has_turn(l, h, bottom) ? -1.0 : most(low, -1.0);
        YH = (near == 0) | has_turn(l, h, top) ? 1.0 : least(high, 1.0);
    }
}
FORM(sin) {
    trig(a, y, 0);
}
FORM(cos) {
    trig(a, y, 1);
}

/* Over a box without the origin and the cut (y = 0, x <= 0), the angle has its extremes at corners. */
FORM(atan2) {
    for (size_t i = 0; i < IB; i++) {
        const double yl = AL, yh = AH, xl = BL, xh = BH;
        YL = -0x1.921fb54442d19p+1;
        YH = 0x1.921fb54442d19p+1;
        if (!(yl > 0.0 || yh < 0.0 || xl > 0.0)) continue;
        const double p = atan2(yl, xl), q = atan2(yl, xh), r = atan2(yh, xl), s = atan2(yh, xh);
        const double l = least(least(p, q), least(r, s)), h = most(most(p, q), most(r, s));
        /* An angle that is not 0 may underflow. */
        YL = most(YL, l - wide(l) - (l == 0.0 && yl != 0.0 ? 4.0 * ETA : 0.0));
        YH = least(YH, h + wide(h) + (h == 0.0 && yh != 0.0 ? 4.0 * ETA : 0.0));
    }
}

/* a: the condition; b: what is chosen where it is not 0; y: what is chosen else, and the result */
FORM(select) {
    EACH {
        const int yes = AL > 0.0 || AH < 0.0, no = AL == 0.0 && AH == 0.0;
        const double l = YL, h = YH;
        YL = yes ? BL : no ? l : least(BL, l);
        YH = yes ? BH : no ? h : most(BH, h);
    }
}

/* |x|^n for a whole n >= 1; the relative error is below n u. */
INLINE double whole_power(double x, unsigned n) {
    double y = x;
    for (unsigned k = 1; k < n; k++) y *= x;
    return y;
}

/* x^p for a whole p of small size: monotone in |x|, and the sign is known. */
INLINE void whole(const double *a, double *restrict y, double p) {
    const unsigned n = (unsigned)fabs(p);
    const int odd = n % 2 == 1;
    EACH {
        const double al = AL, ah = AH, big = most(-al, ah), zero = al <= 0.0 && ah >= 0.0 ? 0.0 : 1.0;
        const double small = most(al, -ah) * zero, eta = big == 0.0 ? 0.0 : (double)n * ETA;
        const double r = PHI * ((double)n + 1.0), s = whole_power(small, n), t = whole_power(big, n);
        const double u = whole_power(fabs(al), n), v = whole_power(fabs(ah), n);
        const double even_low = most(0.0, not_above(s, r * s + eta)), even_high = not_below(t, r * t + eta);
        const double l = al < 0.0 ? -u : u, h = ah < 0.0 ? -v : v;
        const double odd_low = not_above(l, r * u + (al == 0.0 ? 0.0 : eta));
        const double odd_high = not_below(h, r * v + (ah == 0.0 ? 0.0 : eta));
        YL = odd ? odd_low : even_low;
        YH = odd ? odd_high : even_high;
    }
    if (p > 0.0) return;
    EACH {
        const double l = YL, h = YH;
        const int defined = l > 0.0 || h < 0.0;
        const double low = 1.0 / h, high = 1.0 / l;
        YL = defined ? not_above(low, PHI * fabs(low) + ETA) : -(double)INFINITY;
        YH = defined ? not_below(high, PHI * fabs(high) + ETA) : (double)INFINITY;
    }
}

/* x^p for x >= 0 is monotone. */
FORM(pow) {
    const double p = code->p;
    if (p == 0.0) {
        for (size_t i = 0; i < 2 * IB; i++) y[i] = 1.0;
        return;
    }
    if (p == 1.0) { /* lg_s_stopped */
        memcpy(y, a, 2 * IB * sizeof *y);
        return;
    }
    if (p == floor(p) && fabs(p) <= 32.0) {
        whole(a, y, p);
        return;
    }
    for (size_t i = 0; i < IB; i++) {
        const int defined = p > 0.0 ? AL >= 0.0 : AL > 0.0;
        const double u = defined ? pow(AL, p) : 0.0, v = defined ? pow(AH, p) : 0.0;
        const double l = p > 0.0 ? u : v, h = p > 0.0 ? v : u;
        YL = defined ? most(0.0, not_above(l, wide(l))) : -(double)INFINITY;
        YH = defined ? not_below(h, wide(h) + (h == 0.0 && AH == 0.0 ? 0.0 : 4.0 * ETA)) : (double)INFINITY;
    }
}

/* The derivative of order d of c_k, f. For w >= 0, |f(w)| <= |f(0)| by induction with c_k(w) = 1/(k - 1)!
 * int_0^1 (1 - s)^(k - 1) cos(s sqrt w) ds and c_0' = -c_1/2; so the slope of f is at most |f'(0)|. For w <=
 * 0 the terms of f have one sign, and f is monotone. Errors of the kernel: below 64 units of |f| + |f(0)|. */
static double stumpff_one(double w, uint32_t number) {
    double all[LG_STUMPFF_MAX_K + 1];
    lg_stumpff(w, (int)(number % 16), (int)(number / 16), all);
    return all[number % 16];
}

/* c_k^(d)(w) by its series (-1)^d sum_i (-w)^i (i + d)!/i!/(k + 2 (i + d))! in long double; *size: the sum of
 * the terms' sizes. The error is below a few units of long double of *size for each term; for w < 0 all terms
 * have one sign. */
static double stumpff_series(double w, uint32_t number, double *size) {
    const uint32_t k = number % 16, d = number / 16;
    long double term = d % 2 == 0 ? 1 : -1, sum = 0, all = 0;
    for (uint32_t j = 2; j <= k + 2 * d; j++) term /= j;
    for (uint32_t j = 2; j <= d; j++) term *= j;
    for (uint32_t i = 0; fabsl(term) > 0x1p-70L * all && all <= (long double)DBL_MAX; i++) {
        const long double n = k + 2.0L * (i + d);
        sum += term;
        all += fabsl(term);
        term *= -(long double)w * (i + 1 + d) / ((i + 1) * (n + 1) * (n + 2));
    }
    *size = (double)all;
    return (double)sum;
}

/* For w >= 0, with an error below 64 units of |f(w)| + `size`. The recursions of the kernel lose up to four
 * digits of high orders between 16 and 300, where the series still loses none. */
static double stumpff_above(double w, uint32_t number, double size) {
    double all = (double)INFINITY, f = 0.0;
    if (w > 16.0 && number / 16 >= 5) f = stumpff_series(w, number, &all);
    return all <= 0x1p-52 / (double)LDBL_EPSILON * size ? f : stumpff_one(w, number);
}

FORM(stumpff) {
    const uint32_t number = code->n, order = number / 16;
    const double slack = 64 * 0x1p-52, size = fabs(stumpff_one(0.0, number)) * (1 + slack);
    const double n = number % 16 + 2.0 * order,
                 slope = size * (order + 1) / ((n + 1) * (n + 2)) * (1 + slack);
    for (size_t i = 0; i < IB; i++) {
        const double al = AL, ah = AH;
        double l = INFINITY, h = -INFINITY;
        if (!(al >= -DBL_MAX && ah <= DBL_MAX)) {
            YL = -(double)INFINITY;
            YH = (double)INFINITY;
            continue;
        }
        if (ah >= 0.0) {
            const double low = most(al, 0.0), middle = low + 0.5 * (ah - low),
                         f = stumpff_above(middle, number, size);
            const double radius = most(middle - low, ah - middle) * (1 + slack);
            const double root = 0x1p-104 * sqrt(ah); /* at most the error of x = sqrt(w) in cos x */
            const double by = radius * slope + slack * (fabs(f) + size) + root * size;
            l = most(f - by, -size);
            h = least(f + by, size);
        }
        if (al < 0.0) {
            double all;
            const double p = stumpff_series(al, number, &all);
            const double q = stumpff_series(least(ah, 0.0), number, &all);
            l = least(l, not_above(least(p, q), slack * fabs(least(p, q)) + ETA));
            h = most(h, not_below(most(p, q), slack * fabs(most(p, q)) + ETA));
        }
        YL = not_above(l, 0.0);
        YH = not_below(h, 0.0);
    }
}

/* The derivative of order n of g_2 at w = -t below -20. With x = sqrt(t) and e = exp(-x), g_2 = (1 + e)/(2 x
 * (1 - e)) - 1/t, whose Taylor coefficients about t follow from those of x, e and the quotient. The terms of
 * these sums have one sign; only the last difference loses up to four digits, of long double. */
static double dexpinv_below(double w, uint32_t n) {
    long double x[9] = {sqrtl(-(long double)w)}, e[9] = {expl(-x[0])}, b[9], q[9],
                power = -1 / (long double)w;
    double factorial = 1;
    for (uint32_t k = 0; k <= n; k++) {
        if (k > 0) x[k] = k == 1, e[k] = 0, factorial *= k, power /= (long double)w;
        for (uint32_t j = 1; j < k; j++) x[k] -= x[j] * x[k - j];
        if (k > 0) x[k] /= 2 * x[0];
        for (uint32_t j = 1; j <= k; j++) e[k] -= (long double)j / k * x[j] * e[k - j];
        b[k] = 2 * x[k];
        for (uint32_t j = 0; j <= k; j++) b[k] -= 2 * x[j] * e[k - j];
        q[k] = e[k] + (k == 0);
        for (uint32_t j = 1; j <= k; j++) q[k] -= b[j] * q[k - j];
        q[k] /= b[0];
    }
    return (double)(factorial * (n % 2 == 0 ? q[n] - power : power - q[n]));
}

static double dexpinv_one(double w, uint32_t order) {
    return w < -20.0 ? dexpinv_below(w, order) : lg_dexpinv_coef(w, (int)order);
}

/* g_2(w) = sum_k 2/(4 pi^2 k^2 - w): all derivatives are positive and grow with w below the pole at 4 pi^2,
 * which is no double. */
#define BELOW_POLE 39.478417604357432
FORM(dexpinv) {
    const double slack = 128 * 0x1p-52 + 0x1p13 * (double)LDBL_EPSILON;
    for (size_t i = 0; i < IB; i++) {
        const double al = most(AL, -DBL_MAX), ah = most(AH, -DBL_MAX);
        const int defined = ah <= BELOW_POLE;
        const double l = defined ? dexpinv_one(al, code->n) : 0.0,
                     h = defined ? dexpinv_one(ah, code->n) : 0.0;
        YL = !defined ? -(double)INFINITY : AL < -DBL_MAX ? 0.0 : most(0.0, l - slack * l - ETA);
        YH = !defined ? (double)INFINITY : not_below(h, slack * h + 4.0 * ETA);
    }
}

/* ---- what holds on all of a box ----
 *
 * One row for each operation: its number of operands, and where it loses a level (lg_interval_flag) on the
 * operands A, B and with the number P; the first column that holds counts. Where a box touches a cut or a
 * tie from one side only, the level is lost too: two boxes that meet there would both pass otherwise. The
 * level of a result is the minimum of the levels of its operands and of the operation. */
#define NEVER     0
#define HAS_0(X)  (X##L <= 0.0 && X##H >= 0.0)
#define MEET      (AL <= BH && BL <= AH)
#define IS_BROKEN (p != floor(p))
#define ROWS(ROW)                                                                                            \
    /*  operation  operands, undefined              may jump              not Lipschitz      has a kink */   \
    ROW(ADD, add, 2, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(SUB, sub, 2, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(MUL, mul, 2, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(DIV, div, 2, HAS_0(B), NEVER, NEVER, NEVER)                                                          \
    ROW(NEG, neg, 1, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(MAX, max, 2, NEVER, NEVER, NEVER, MEET)                                                              \
    ROW(GE, ge, 2, NEVER, MEET, NEVER, NEVER)                                                                \
    ROW(SQRT, sqrt, 1, AL < 0.0, NEVER, AL <= 0.0, NEVER)                                                    \
    ROW(ABS, abs, 1, NEVER, NEVER, NEVER, HAS_0(A))                                                          \
    ROW(SIGN, sign, 1, NEVER, HAS_0(A), NEVER, NEVER)                                                        \
    ROW(POW, pow, 1, POWER_UNDEFINED, NEVER, POWER_STEEP, NEVER)                                             \
    ROW(EXP, exp, 1, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(LOG, log, 1, AL <= 0.0, NEVER, NEVER, NEVER)                                                         \
    ROW(SIN, sin, 1, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(COS, cos, 1, NEVER, NEVER, NEVER, NEVER)                                                             \
    ROW(TANH, tanh, 1, NEVER, NEVER, NEVER, NEVER)                                                           \
    ROW(SIGMOID, sigmoid, 1, NEVER, NEVER, NEVER, NEVER)                                                     \
    ROW(ATAN2, atan2, 2, HAS_0(A) && HAS_0(B), HAS_0(A) && BL <= 0.0, NEVER, NEVER)                          \
    ROW(STUMPFF, stumpff, 1, NEVER, NEVER, NEVER, NEVER)                                                     \
    ROW(DEXPINV, dexpinv, 1, AH > BELOW_POLE, NEVER, NEVER, NEVER)                                           \
    ROW(SCALE, scale, 1, NEVER, NEVER, NEVER, NEVER)                                                         \
    ROW(SHIFT, shift, 1, NEVER, NEVER, NEVER, NEVER)
#define POWER_UNDEFINED (p < 0.0 ? IS_BROKEN ? AL <= 0.0 : HAS_0(A) : IS_BROKEN && AL < 0.0)
#define POWER_STEEP     (p == 1.0 || (IS_BROKEN && p > 0.0 && p < 1.0 && AL <= 0.0))

#define FLAGS(name)                                                                                          \
    static void flags_##name(ANY const double *a, ANY const double *b, const uint8_t *fa,                    \
                             ANY const uint8_t *fb, ANY const lg_interval_code *code, uint8_t *restrict fy)
#define ROW_FLAGS(OP, form, operands, undefined, jump, steep, kink)                                          \
    FLAGS(form) {                                                                                            \
        ANY const double p = code->p;                                                                        \
        EACH {                                                                                               \
            uint8_t own = (kink) ? LG_INTERVAL_LIPSCHITZ : LG_INTERVAL_DIFFERENTIABLE;                       \
            own = (steep) ? LG_INTERVAL_CONTINUOUS : own;                                                    \
            own = (jump) ? LG_INTERVAL_DEFINED : own;                                                        \
            own = (undefined) ? LG_INTERVAL_UNDEFINED : own;                                                 \
            const uint8_t of = operands == 1 || fa[i] < fb[i] ? fa[i] : fb[i];                               \
            fy[i] = of < own ? of : own;                                                                     \
        }                                                                                                    \
    }
ROWS(ROW_FLAGS)

/* A choice that the box decides has the level of what is chosen; else it may jump. fy: the level of what is
 * chosen where the condition is 0 */
FLAGS(select) {
    EACH {
        const int yes = AL > 0.0 || AH < 0.0, no = AL == 0.0 && AH == 0.0;
        const uint8_t top = LG_INTERVAL_DIFFERENTIABLE, then = no ? top : fb[i], other = yes ? top : fy[i];
        const uint8_t own = fa[i] == LG_INTERVAL_UNDEFINED ? fa[i] : yes || no ? top : LG_INTERVAL_DEFINED;
        const uint8_t of = then < other ? then : other;
        fy[i] = of < own ? of : own;
    }
}

typedef void (*interval_form)(const double *, const double *, const lg_interval_code *, double *restrict);
typedef void (*interval_flags)(const double *, const double *, const uint8_t *, const uint8_t *,
                               const lg_interval_code *, uint8_t *restrict);

#define PASTE_(a, b) a##b
#define PASTE(a, b)  PASTE_(a, b)
#define RUN          PASTE(lg_intervals_, LG_KERNEL_ISA)

lg_interval_run RUN;
void RUN(size_t count, const lg_interval_code *code, double *registers, uint8_t *flags) {
    enum { LG_S_SCALE = LG_INTERVAL_SCALE, LG_S_SHIFT = LG_INTERVAL_SHIFT };
#define ROW_FORM(OP, form, operands, undefined, jump, steep, kink)                                           \
    [LG_S_##OP] = {interval_##form, flags_##form},
    static const struct {
        interval_form form;
        interval_flags flags;
    } rows[] = {ROWS(ROW_FORM)[LG_S_SELECT] = {interval_select, flags_select}};
    const size_t apart = 2 * IB;
    for (const lg_interval_code *c = code; c < code + count; c++) {
        const double *a = registers + c->x[0] * apart, *b = registers + c->x[1] * apart;
        double *y = registers + c->y * apart;
        if (c->op == LG_S_SELECT) memcpy(y, registers + c->x[2] * apart, apart * sizeof *y);
        rows[c->op].form(a, b, c, y);
        if (flags == NULL) continue;
        if (c->op == LG_S_SELECT) memcpy(flags + c->y * IB, flags + c->x[2] * IB, IB);
        rows[c->op].flags(a, b, flags + c->x[0] * IB, flags + c->x[1] * IB, c, flags + c->y * IB);
    }
}
