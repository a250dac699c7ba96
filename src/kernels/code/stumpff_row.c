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
