/* Rows of z (m, n), orthogonalised one after the other (Gram and Schmidt's method in its modified form, whose
 * triangle is as accurate as Householder's: Bjorck 1967): z = R Q with orthonormal rows of Q. Row k of
 * g (m, m) is column k of R. */
static void factor_rows(int m, int n, real *z, real *g) {
    for (int k = 0; k < m; k++) {
        real *row = z + k * n;
        const real norm = SQRT(dot(n, row, row)), inverse = norm > REAL(0.0) ? REAL(1.0) / norm : norm;
        for (int j = 0; j < k; j++) g[k * m + j] = REAL(0.0);
        g[k * m + k] = norm;
        for (int t = 0; t < n; t++) row[t] *= inverse;
        for (int j = k + 1; j < m; j++) {
            real *other = z + j * n;
            const real along = dot(n, row, other);
            g[k * m + j] = along;
            for (int t = 0; t < n; t++) other[t] -= along * row[t];
        }
    }
}
