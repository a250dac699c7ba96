/* z <- max(z, 0), and its derivative. */
static void activate_slope(int n, real *RESTRICT z, real *RESTRICT slope) {
    for (int i = 0; i < n; i++) {
        const real x = z[i];
        slope[i] = x > REAL(0.0) ? REAL(1.0) : REAL(0.0);
        z[i] = x <= REAL(0.0) ? REAL(0.0) : x;
    }
}
