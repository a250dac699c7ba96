/* z <- sin(z), and its derivative. */
static void activate_slope(int n, real *RESTRICT z, real *RESTRICT slope) {
    for (int i = 0; i < n; i++) {
        const real x = z[i];
        slope[i] = COS(x);
        z[i] = SIN(x);
    }
}
