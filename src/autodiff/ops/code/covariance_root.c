/* s (m, m) becomes the symmetric root of the covariance of the rows of x (m, n), of which row i is multiplied
 * by factor[i]: the sum over k of u_k s_k u_k^T/sqrt(n) with the singular values s_k and left vectors u_k of
 * the centred rows. Their triangle grows by `chunk` samples at a time. work: m (2 m + chunk + 2)
 * and BLOCK. */
static void covariance_root(int m, int n, int chunk, const real *x, const real *factor, real *s, real *work) {
    real *g = work + BLOCK, *mean = g + m * m, *z = mean + 2 * m;
    for (int i = 0; i < m; i++) mean_of(n, x + i * n, mean + 2 * i, work);
    for (int begin = 0; begin < n; begin += chunk) {
        const int before = begin > 0 ? m : 0, some = n - begin < chunk ? n - begin : chunk,
                  width = before + some;
        for (int i = 0; i < m; i++) {
            for (int k = 0; k < before; k++) z[i * width + k] = g[k * m + i];
            deviate(some, x + i * n + begin, mean + 2 * i, factor[i], z + i * width + before);
        }
        factor_rows(m, width, z, g);
    }
    rotate_rows(m, g);
    for (int i = 0; i < m * m; i++) s[i] = REAL(0.0);
    for (int k = 0; k < m; k++) {
        const real *row = g + k * m;
        const real norm = SQRT(dot(m, row, row)),
                   inverse = norm > REAL(0.0) ? REAL(1.0) / norm / SQRT((real)n) : norm;
        for (int i = 0; i < m; i++)
            for (int j = 0; j < m; j++) s[i * m + j] += row[i] * inverse * row[j];
    }
}
