/* Results y (n) of inputs x (m) of which one is not finite become NaN, whether or not they depend on it: a
 * branch of ReLU or a maximum would hide it. Otherwise 0 is added. */
static NOINLINE void mark_unfit(int m, const real *x, int n, real *y) {
    real mark = REAL(0.0);
    for (int i = 0; i < m; i++) mark += REAL(0.0) * x[i];
    for (int i = 0; i < n; i++) y[i] += mark;
}
