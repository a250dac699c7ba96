/* Row i of x is added to row index[i] of y (rows, length), which is zero at first. */
static NOINLINE void scatter(int n, int length, int rows, const int *index, const real *RESTRICT x,
                             real *RESTRICT y) {
    for (int i = 0; i < rows * length; i++) y[i] = REAL(0.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < length; j++) y[index[i] * length + j] += x[i * length + j];
}
