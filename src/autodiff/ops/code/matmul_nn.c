/* y (m, n) += a (m, k) b (k, n) */
static NOINLINE void matmul_nn(int m, int n, int k, const real *a, const real *b, real *y) {
    for (int i = 0; i < m; i++) dense_add(k, n, b, a + i * k, y + i * n);
}
