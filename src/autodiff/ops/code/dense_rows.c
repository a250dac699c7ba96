/* y (m, n) = x (m, k) w (k, n) + b (n; or NULL) */
static NOINLINE void dense_rows(int m, int n, int k, const real *x, const real *w, const real *b, real *y) {
    for (int i = 0; i < m; i++, x += k, y += n) {
        for (int j = 0; j < n; j++) y[j] = b == NULL ? REAL(0.0) : b[j];
        dense_add(k, n, w, x, y);
    }
}
