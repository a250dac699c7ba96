/* y = exp(u) x for n rows; x: vectors (columns 1), or matrices by rows (columns 3) */
static NOINLINE void so3_exp(int n, int columns, const real *u, const real *x, real *y) {
    for (int r = 0; r < n; r++, u += 3, x += 3 * columns, y += 3 * columns) {
        real c[4];
        real b[3];
        so3_coefficients(dot3(u, u), c);
        for (int j = 0; j < columns; j++) {
            for (int i = 0; i < 3; i++) b[i] = x[i * columns + j];
            so3_function(c[1], c[2], u, b, b);
            for (int i = 0; i < 3; i++) y[i * columns + j] = b[i];
        }
    }
}
