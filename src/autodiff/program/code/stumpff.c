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

/* Sine and cosine of x + dx. If x is large, dx is not small. */
static double stumpff_sine(double x, double dx) {
    return fabs(dx) > 1e-9 ? sin(x) * cos(dx) + cos(x) * sin(dx) : sin(x) + dx * cos(x);
}

static double stumpff_cosine(double x, double dx) {
    return fabs(dx) > 1e-9 ? cos(x) * cos(dx) - sin(x) * sin(dx) : cos(x) - dx * sin(x);
}

/* c_0, c_1 and c_2 for |w| > 1. */
static void stumpff_closed(double w, double *c) {
    double dx, half;
    const double x = stumpff_root(w, &dx);
    c[0] = w > 0.0 ? stumpff_cosine(x, dx) : cosh(x) + dx * sinh(x);
    c[1] = (w > 0.0 ? stumpff_sine(x, dx) : sinh(x) + dx * cosh(x)) / x;
    half = w > 0.0 ? stumpff_sine(0.5 * x, 0.5 * dx) : sinh(0.5 * x) + 0.5 * dx * cosh(0.5 * x);
    c[2] = 2.0 * half * half / fabs(w);
}

static int stumpff_cancels_little(double w, int k, int d) {
    return fabs(w) * (d + 1) <= 2.0 * (k + 2 * d + 1) * (k + 2 * d + 2);
}

/* Values and derivatives for |w| > 16. Each order overwrites the order before it in c, from the last k down
 * to 0. */
static void stumpff_beyond(double w, int K, int order, double *c) {
    stumpff_closed(w, c);
    for (int k = 3; k <= K; k++)
        c[k] = stumpff_cancels_little(w, k - 2, 0) ? stumpff_one(w, k, 0)
                                                   : (inverse_factorial[k - 2] - c[k - 2]) / w;
    for (int d = 1; d <= order; d++) {
        const double slope = -0.5 * c[1];
        for (int k = K > 1 ? K : 1; k >= 1; k--)
            c[k] = stumpff_cancels_little(w, k, d) ? stumpff_one(w, k, d)
                                                   : (c[k - 1] - (k + 2 * (d - 1)) * c[k]) / (2.0 * w);
        c[0] = slope;
    }
}

static void stumpff_row(real argument, int K, int order, real *out) {
    const double w = (double)argument;
    double c[9] = {0.0}, closed[3] = {0.0};
    if (!(fabs(w) <= 16.0)) {
        stumpff_beyond(w, K, order, c);
    } else {
        stumpff_series(w, K, order, c);
        if ((w > 4.0 && order <= 2) || (w > 1.0 && order < 2 && fabs(c[0]) < 0.25)) {
            const int most = w <= 4.0 || order == 2 ? 0 : K < 2 ? K : 2;
            stumpff_closed(w, closed);
            for (int d = 0; d < order; d++) {
                const double slope = -0.5 * closed[1];
                for (int k = 2; k >= 1; k--)
                    closed[k] = (closed[k - 1] - (k + 2 * d) * closed[k]) / (2.0 * w);
                closed[0] = slope;
            }
            for (int k = 0; k <= most; k++) c[k] = closed[k];
        }
    }
    for (int k = 0; k <= K; k++) out[k] = (real)c[k];
}
