/* y (m, parts) becomes the covariances of rows of x and z (m, n) in each of their parts, times the squares of
 * s (m). Where s is 0, so is y. work: 3 BLOCK. */
static void covariance(int m, int n, int parts, const real *x, const real *s, const real *z, real *y,
                       real *RESTRICT work) {
    real *a = work + BLOCK, *b = x == z ? a : a + BLOCK, mean[2], other[2];
    for (int i = 0; i < m; i++, x += n, z += n)
        for (int p = 0; p < parts; p++, y++) {
            const int begin = (int)((long long)p * n / parts), end = (int)((long long)(p + 1) * n / parts);
            *y = REAL(0.0);
            if (s[i] == REAL(0.0)) continue;
            mean_of(end - begin, x + begin, mean, work);
            if (b != a) mean_of(end - begin, z + begin, other, work);
            for (int j = 0; j < BLOCK; j++) work[j] = REAL(0.0);
            for (int t = begin; t < end; t += BLOCK) {
                const int some = end - t < BLOCK ? end - t : BLOCK;
                deviate(some, x + t, mean, s[i], a);
                if (b != a) deviate(some, z + t, other, s[i], b);
                for (int j = 0; j < some; j++) work[j] += a[j] * b[j];
            }
            *y = sum_of(work) / (real)(end - begin);
        }
}
