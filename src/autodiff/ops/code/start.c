/* y (m, n) = c with the strides `down` and `along`, or 0 if c is NULL. */
static NOINLINE void start(int m, int n, const real *c, int down, int along, real *RESTRICT y) {
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) y[i * n + j] = c == NULL ? REAL(0.0) : c[i * down + j * along];
}
