/* y (outer, length, inner): x (outer, inner), repeated along the middle. */
static NOINLINE void repeat(int outer, int length, int inner, const real *RESTRICT x, real *RESTRICT y) {
    for (int o = 0; o < outer; o++, x += inner)
        for (int l = 0; l < length; l++, y += inner)
            for (int i = 0; i < inner; i++) y[i] = x[i];
}
