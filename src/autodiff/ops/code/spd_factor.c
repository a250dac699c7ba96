/* Cholesky factors l of the symmetric parts of n matrices a (k, k); NaN where a pivot is not positive. */
static NOINLINE void spd_factor(int n, int k, const real *RESTRICT a, real *RESTRICT l) {
    for (int s = 0; s < n; s++, a += k * k, l += k * k) {
        int good = 1;
        for (int i = 0; i < k; i++)
            for (int j = 0; j < k; j++) {
                real v = REAL(0.5) * (a[i * k + j] + a[j * k + i]);
                for (int p = 0; p < j && j <= i; p++) v -= l[i * k + p] * l[j * k + p];
                if (j == i) good = good && v > REAL(0.0) && v <= REAL_LARGEST;
                l[i * k + j] = j > i ? REAL(0.0) : j < i ? v / l[j * k + j] : good ? SQRT(v) : REAL(1.0);
            }
        for (int i = 0; i < k * k && !good; i++) l[i] = (real)NAN;
    }
}
