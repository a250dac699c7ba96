/* n systems l l^T y = b; y, b (k, m) */
static NOINLINE void spd_solve(int n, int k, int m, const real *RESTRICT l, const real *RESTRICT b,
                               real *RESTRICT y) {
    for (int s = 0; s < n; s++, l += k * k, b += k * m, y += k * m) {
        for (int i = 0; i < k * m; i++) y[i] = b[i];
        for (int i = 0; i < k; i++) {
            for (int p = 0; p < i; p++)
                for (int c = 0; c < m; c++) y[i * m + c] -= l[i * k + p] * y[p * m + c];
            for (int c = 0; c < m; c++) y[i * m + c] /= l[i * k + i];
        }
        for (int i = k - 1; i >= 0; i--) {
            for (int p = i + 1; p < k; p++)
                for (int c = 0; c < m; c++) y[i * m + c] -= l[p * k + i] * y[p * m + c];
            for (int c = 0; c < m; c++) y[i * m + c] /= l[i * k + i];
        }
    }
}
