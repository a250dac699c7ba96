/* y (n, most + 1) = derivative number `order` of c_0, c_1, ... at w (n) */
static NOINLINE void stumpff_rows(int n, int most, int order, const real *w, real *y) {
    for (int i = 0; i < n; i++) stumpff_row(w[i], most, order, y + i * (most + 1));
}
