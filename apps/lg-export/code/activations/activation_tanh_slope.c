/* z <- tanh(z), and its derivative. */
static void activate_slope(int n, real *RESTRICT z, real *RESTRICT slope) {
    for (int i = 0; i < n; i++) {
        const real y = tanh_of(z[i]);
        slope[i] = (REAL(1.0) - y) * (REAL(1.0) + y);
        z[i] = y;
    }
}
