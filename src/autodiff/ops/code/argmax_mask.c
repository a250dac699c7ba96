/* y: 1 where x (outer, length, inner) is largest along the middle, else 0. */
static NOINLINE void argmax_mask(int outer, int length, int inner, const real *x, real *y) {
    for (int o = 0; o < outer; o++, x += length * inner, y += length * inner) {
        for (int i = 0; i < length * inner; i++) y[i] = REAL(0.0);
        for (int i = 0; i < inner; i++) y[i + first_maximum(length, inner, x + i)] = REAL(1.0);
    }
}
