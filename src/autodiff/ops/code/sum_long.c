/* sum_axis with many terms: sums of 64 terms are added with compensation (Kahan), so that rounding errors
 * do not grow with the number of terms. */
static NOINLINE void sum_long(int outer, int length, int inner, const real *RESTRICT x, real *RESTRICT y) {
    for (int o = 0; o < outer; o++, x += length * inner, y += inner)
        for (int i = 0; i < inner; i++) {
            real total = REAL(0.0), lost = REAL(0.0);
            for (int l = 0; l < length;) {
                const int end = length - l > 64 ? l + 64 : length;
                real term = -lost;
                for (; l < end; l++) term += x[l * inner + i];
                const real next = total + term;
                lost = (next - total) - term;
                total = next;
            }
            y[i] = total;
        }
}
