/* y = dexp_u(v) for n rows */
static NOINLINE void so3_dexp(int n, const real *u, const real *v, real *y) {
    for (int r = 0; r < n; r++, u += 3, v += 3, y += 3) {
        real c[4];
        so3_coefficients(dot3(u, u), c);
        so3_function(c[2], c[3], u, v, y);
    }
}
