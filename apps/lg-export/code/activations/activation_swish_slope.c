/* z <- z sigmoid(z), and its derivative. */
static void activate_slope(int n, real *RESTRICT z, real *RESTRICT slope) {
    for (int i = 0; i < n; i++) {
        const real x = z[i], s = sigmoid_of(x), y = x * s;
        slope[i] = x * (s * (REAL(1.0) - s)) + s;
        z[i] = s == REAL(0.0) ? -REAL(0.0) : y;
    }
}
