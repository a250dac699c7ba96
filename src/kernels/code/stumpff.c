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
