/* Derivative of order `order` of c_k(w) = sum_i (-w)^i/(k + 2i)! for k = 0..K; order, K <= 8. It is computed
 * in double for every type.
 *
 * For |w| <= 16 the series is used. Where the series cancels (w > 4, or near the zero of c_0), cos and sin of
 * x = sqrt(w) are used, corrected for the rounding error of x. For |w| > 16, c_0, c_1 and c_2 = 2
 * sin(x/2)^2/w have closed forms; the others follow from c_{k+2} = (1/k! - c_k)/w and 2w c_k^(d+1) =
 * c_{k-1}^(d) - (k + 2d) c_k^(d), except where the series hardly cancels and is used instead. */

/* The series by Horner's rule, with coefficients (i + order)!/i!/(k + 2 (i + order))!. */
static void stumpff_series(double w, int K, int order, double *c) {
    const double size = fabs(w);
    const int terms = size <= 1.0 ? 10 : size <= 4.0 ? 14 : 18;
    double falling[18] = {0.0};
    falling[0] = 1.0;
    for (int i = 1; i <= order; i++) falling[0] *= (double)i;
    for (int i = 1; i < terms; i++)
        falling[i] = order == 0 ? 1.0 : falling[i - 1] * (double)(i + order) / (double)i;
    for (int k = 0; k <= K; k++) {
        double sum = 0.0;
        for (int i = terms - 1; i >= 0; i--)
            sum = falling[i] * inverse_factorial[k + 2 * (i + order)] - w * sum;
        c[k] = order % 2 == 0 ? sum : -sum;
    }
}

/* Derivative d of one function c_k by its series; each term is computed from the term before it. */
static double stumpff_one(double w, int k, int d) {
    double term = d % 2 == 0 ? inverse_factorial[k + 2 * d] : -inverse_factorial[k + 2 * d], total;
    for (int i = 2; i <= d; i++) term *= (double)i;
    total = term;
    for (int i = 0; i < 100 && fabs(term) > 1e-18 * fabs(total); i++) {
        const double n = k + 2.0 * (i + d);
        term *= -w * (i + d + 1) / ((i + 1) * (n + 1.0) * (n + 2.0));
        total += term;
    }
    return total;
}

/* Returns x = sqrt(|w|) and sets dx to the correction for its rounding error: x + dx is more accurate than x.
 * For this, x is split in two halves, so that its square is computed accurately. */
static double stumpff_root(double w, double *dx) {
    const double x = sqrt(fabs(w)), high = (double)(float)x, low = x - high;
    *dx = -(((high * high - fabs(w)) + 2.0 * high * low) + low * low) / (2.0 * x);
    return x;
}
