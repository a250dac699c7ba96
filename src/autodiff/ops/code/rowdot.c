/* y[i] = a[i, :] . b[i, :], rows of n numbers */
static NOINLINE void rowdot(int rows, int n, const real *a, const real *b, real *y) {
    for (int i = 0; i < rows; i++) y[i] = dot(n, a + i * n, b + i * n);
}
