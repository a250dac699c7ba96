/* If one of the inputs x (m) is not finite, all results y (n) become NaN, even those that do not depend on
 * it: a branch of ReLU or a maximum could hide it. Otherwise 0 is added to y. */
static NOINLINE void mark_unfit(int m, const real *x, int n, real *y) {
    real mark = REAL(0.0), lane[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    const int whole = m - m % 8;
    for (int i = 0; i < whole; i += 8)
        for (int j = 0; j < 8; j++) lane[j] += REAL(0.0) * x[i + j];
    for (int i = whole; i < m; i++) mark += REAL(0.0) * x[i];
    for (int j = 0; j < 8; j++) mark += lane[j];
    for (int i = 0; i < n; i++) y[i] += mark;
}
