/* z <- z sigmoid(z), with the limit -0 at minus infinity. */
static void activate(int n, real *z) {
    for (int i = 0; i < n; i++) {
        const real s = sigmoid_of(z[i]), y = z[i] * s;
        z[i] = s == REAL(0.0) ? -REAL(0.0) : y;
    }
}
