/* y = dexp_a^-1(b) for n rows */
static NOINLINE void so3_dexpinv(int n, const real *a, const real *b, real *y) {
    for (int r = 0; r < n; r++, a += 3, b += 3, y += 3)
        so3_function(REAL(-0.5), dexpinv_coef(dot3(a, a), 0), a, b, y);
}
