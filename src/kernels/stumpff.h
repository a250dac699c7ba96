/* Scalar coefficients of exp, dexp and dexp^-1 on so(3) and se(3), as functions of w = |u|^2 that are
 * analytic at 0. In double; the functions have no state. */
#ifndef LG_STUMPFF_H
#define LG_STUMPFF_H

#define LG_STUMPFF_MAX_K     8
#define LG_STUMPFF_MAX_ORDER 8

/* c[k] = d^order/dw^order c_k(w) for k = 0..K, where c_k(w) = sum_j (-w)^j/(k + 2j)!. With x^2 = w: c_0 = cos
 * x, c_1 = sin x/x, c_2 = (1 - cos x)/x^2, c_3 = (x - sin x)/x^3; for negative w these are hyperbolic
 * functions. w may be any finite number. 0 <= K <= 8, 0 <= order <= 8. NaN gives NaN. */
void lg_stumpff(double w, int K, int order, double *c);

/* out = c_1, c_2, c_3, 2 dc_2/dw, 2 dc_3/dw, as dexp and its derivatives need them. */
void lg_stumpff_slopes(double w, double out[5]);

/* d^order/dw^order of g2(w) = (1 - (x/2) cot(x/2))/x^2 with x^2 = w; 0 <= order <= 8. The first pole is at w
 * = 4 pi^2. */
double lg_dexpinv_coef(double w, int order);

#endif
