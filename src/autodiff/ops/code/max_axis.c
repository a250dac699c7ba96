/* y (outer, inner): the largest along the middle of x (outer, length, inner). */
static NOINLINE void max_axis(int outer, int length, int inner, const real *x, real *y) {
    for (int o = 0; o < outer; o++, x += length * inner, y += inner)
        for (int i = 0; i < inner; i++) y[i] = x[i + first_maximum(length, inner, x + i)];
}
