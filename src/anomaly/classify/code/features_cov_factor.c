/* Rows of z (m, n), orthogonalised one after the other (Gram and Schmidt's method in its modified form, whose
 * triangle is as accurate as Householder's: Bjorck 1967): z = R Q with orthonormal rows of Q. Row k of
 * g (m, m) is column k of R. */
static void factor_rows(int m, int n, real *z, real *g) {
    for (int k = 0; k < m; k++) {
        real *row = z + k * n;
        const real norm = SQRT(dot_of(n, row, row)), inverse = norm > REAL(0.0) ? REAL(1.0) / norm : norm;
        for (int j = 0; j < k; j++) g[k * m + j] = REAL(0.0);
        g[k * m + k] = norm;
        for (int t = 0; t < n; t++) row[t] *= inverse;
        for (int j = k + 1; j < m; j++) {
            real *other = z + j * n;
            const real along = dot_of(n, row, other);
            g[k * m + j] = along;
            for (int t = 0; t < n; t++) other[t] -= along * row[t];
        }
    }
}

/* Rotates pairs of rows of g (m, m) until all are orthogonal (Hestenes 1958): they become singular values of
 * z times singular vectors, each as accurate as the largest one, which eigenvalues of the covariance are not.
 * Rows that are nothing beside the largest stay. */
static void rotate_rows(int m, real *g) {
    const real least = REAL_EPSILON * REAL_EPSILON * dot_of(m * m, g, g);
    int rotated = 1;
    for (int sweep = 0; sweep < 60 && rotated; sweep++) {
        rotated = 0;
        for (int p = 0; p < m; p++)
            for (int q = p + 1; q < m; q++) {
                real *a = g + p * m, *b = g + q * m;
                const real aa = dot_of(m, a, a), bb = dot_of(m, b, b), ab = dot_of(m, a, b);
                if (aa <= least || bb <= least) continue;
                if (FABS(ab) <= REAL(2.0) * REAL_EPSILON * SQRT(aa) * SQRT(bb)) continue;
                const real middle = (bb - aa) / (REAL(2.0) * ab),
                           size = REAL(1.0) / (FABS(middle) + SQRT(REAL(1.0) + middle * middle)),
                           tangent = middle < REAL(0.0) ? -size : size,
                           cosine = REAL(1.0) / SQRT(REAL(1.0) + tangent * tangent), sine = cosine * tangent;
                rotated = 1;
                for (int i = 0; i < m; i++) {
                    const real u = a[i], v = b[i];
                    a[i] = cosine * u - sine * v;
                    b[i] = sine * u + cosine * v;
                }
            }
    }
}
