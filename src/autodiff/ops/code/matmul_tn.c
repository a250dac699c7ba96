/* y (m, n) += the transpose of a (k, m) times b (k, n) */
static NOINLINE void matmul_tn(int m, int n, int k, const real *RESTRICT a, const real *RESTRICT b,
                               real *RESTRICT y) {
    if (n == 1) {
        dense_add(k, m, a, b, y);
        return;
    }
    for (int i = 0; i < m; i++, a++, y += n) {
        const real *RESTRICT x = a, *RESTRICT w = b;
        int l = 0;
        for (; l + 4 <= k; l += 4, x += 4 * m, w += 4 * n)
            for (int j = 0; j < n; j++)
                y[j] += (x[0] * w[j] + x[m] * w[n + j]) + (x[2 * m] * w[2 * n + j] + x[3 * m] * w[3 * n + j]);
        for (; l < k; l++, x += m, w += n)
            for (int j = 0; j < n; j++) y[j] += x[0] * w[j];
    }
}
