/* y (m, n) += a (m, k) times the transpose of b (n, k) */
static NOINLINE void matmul_nt(int m, int n, int k, const real *RESTRICT a, const real *RESTRICT b,
                               real *RESTRICT y) {
    for (int i = 0; i < m; i++)
        if (k == 1)
            for (int j = 0; j < n; j++) y[i * n + j] += a[i] * b[j];
        else
            for (int j = 0; j < n; j++) y[i * n + j] += dot(k, b + j * k, a + i * k);
}
