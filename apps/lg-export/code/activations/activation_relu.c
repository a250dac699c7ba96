/* z <- max(z, 0) */
static void activate(int n, real *z) {
    for (int i = 0; i < n; i++) z[i] = z[i] <= REAL(0.0) ? REAL(0.0) : z[i];
}
