/* Copies `rows` blocks of `run` numbers, which begin x_apart numbers apart in x, and y_apart in y. */
static NOINLINE void copy_rows(int rows, int run, const real *RESTRICT x, int x_apart, real *RESTRICT y,
                               int y_apart) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < run; j++) y[i * y_apart + j] = x[i * x_apart + j];
}
