/* y (outer, inner) = sum over the middle of x (outer, length, inner); eight sums side by side where
 * numbers lie in a row. */
static NOINLINE void sum_axis(int outer, int length, int inner, const real *RESTRICT x, real *RESTRICT y) {
    for (int o = 0; o < outer; o++, x += length * inner, y += inner) {
        if (inner == 1) {
            real part[8] = {REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0),
                            REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0)};
            for (int l = 0; l < length; l++) part[l % 8] += x[l];
            y[0] = ((part[0] + part[4]) + (part[2] + part[6])) + ((part[1] + part[5]) + (part[3] + part[7]));
        } else {
            for (int i = 0; i < inner; i++) y[i] = REAL(0.0);
            for (int l = 0; l < length; l++)
                for (int i = 0; i < inner; i++) y[i] += x[l * inner + i];
        }
    }
}
