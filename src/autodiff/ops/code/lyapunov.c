/* x (m, m) becomes the symmetric solution of s x + x s = w, for the symmetric parts of s >= 0 and w: between
 * the eigenvectors u_i and u_j of s it is w_ij/(s_i + s_j). Eigenvalues below 2^-22 of the largest, or what
 * rounding leaves of nothing, count as 0; between null vectors, which need not be known, x is 0. For the
 * other vectors
 *   x = a + a^T,   a = sum_j (w u_j - sum_i u_i (u_i.w u_j) (2 s_i + s_j)/(2 (s_i + s_j)))/s_j u_j^T
 * work: m (m + 2). */
static void lyapunov(int m, const real *s, const real *w, real *x, real *work) {
    real *row = work + m * m, *root = row + m, largest = REAL(0.0);
    for (int i = 0; i < m * m; i++) {
        work[i] = REAL(0.5) * (s[i] + s[i % m * m + i / m]);
        x[i] = REAL(0.0);
    }
    rotate_rows(m, work);
    for (int j = 0; j < m; j++) {
        root[j] = SQRT(dot(m, work + j * m, work + j * m));
        if (root[j] > largest) largest = root[j];
    }
    largest *= REAL(2.384185791015625e-7) + REAL_EPSILON * (real)m;
    for (int j = 0; j < m; j++) {
        const real *gj = work + j * m;
        if (root[j] <= largest) continue;
        for (int a = 0; a < m; a++) {
            row[a] = REAL(0.0);
            for (int b = 0; b < m; b++) row[a] += REAL(0.5) * (w[a * m + b] + w[b * m + a]) * gj[b] / root[j];
        }
        for (int i = 0; i < m; i++) {
            const real *gi = work + i * m;
            if (root[i] <= largest) continue;
            const real share = (REAL(2.0) * root[i] + root[j]) / (REAL(2.0) * (root[i] + root[j])),
                       common = share * dot(m, row, gi) / root[i] / root[i];
            for (int a = 0; a < m; a++) row[a] -= common * gi[a];
        }
        for (int a = 0; a < m; a++)
            for (int b = 0; b < m; b++) {
                const real part = row[a] / root[j] * (gj[b] / root[j]);
                x[a * m + b] += part;
                x[b * m + a] += part;
            }
    }
}
