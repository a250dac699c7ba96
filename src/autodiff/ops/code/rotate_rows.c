/* Rotates pairs of rows of g (m, m) until all are orthogonal (Hestenes 1958): they become singular values of
 * z times singular vectors, each as accurate as the largest one, which eigenvalues of the covariance are not.
 * Rows that are nothing beside the largest stay. */
static void rotate_rows(int m, real *g) {
    const real least = REAL_EPSILON * REAL_EPSILON * dot(m * m, g, g);
    int rotated = 1;
    for (int sweep = 0; sweep < 60 && rotated; sweep++) {
        rotated = 0;
        for (int p = 0; p < m; p++)
            for (int q = p + 1; q < m; q++) {
                real *a = g + p * m, *b = g + q * m;
                const real aa = dot(m, a, a), bb = dot(m, b, b), ab = dot(m, a, b);
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
