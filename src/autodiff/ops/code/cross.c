/* y[i, :] = a[i, :] x b[i, :] */
static NOINLINE void cross(int rows, const real *RESTRICT a, const real *RESTRICT b, real *RESTRICT y) {
    for (int i = 0; i < rows; i++, a += 3, b += 3, y += 3) {
        y[0] = a[1] * b[2] - a[2] * b[1];
        y[1] = a[2] * b[0] - a[0] * b[2];
        y[2] = a[0] * b[1] - a[1] * b[0];
    }
}
