/* y (m, n) = c, whose elements are so far apart down and along; NULL: 0. */
static NOINLINE void start(int m, int n, const real *c, int down, int along, real *RESTRICT y) {
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) y[i * n + j] = c == NULL ? REAL(0.0) : c[i * down + j * along];
}
