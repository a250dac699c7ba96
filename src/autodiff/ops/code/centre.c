/* y (m, n) becomes the deviations of x (m, n) from the mean of each of `parts` parts of a row, times
 * s (m, parts) over the part's length. Where s is 0, so is y. work: BLOCK. */
static void centre(int m, int n, int parts, const real *x, const real *s, real *y, real *work) {
    for (int i = 0; i < m; i++, x += n, y += n)
        for (int p = 0; p < parts; p++, s++) {
            const int begin = (int)((long long)p * n / parts), end = (int)((long long)(p + 1) * n / parts);
            real mean[2] = {0, 0};
            if (*s != REAL(0.0)) mean_of(end - begin, x + begin, mean, work);
            deviate(end - begin, x + begin, mean, *s / (real)(end - begin), y + begin);
        }
}
