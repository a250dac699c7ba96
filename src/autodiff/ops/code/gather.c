/* Rows index[0], index[1], ... of x. */
static NOINLINE void gather(int n, int length, const int *index, const real *RESTRICT x, real *RESTRICT y) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < length; j++) y[i * length + j] = x[index[i] * length + j];
}
