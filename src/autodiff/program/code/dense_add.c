/* y += x W. Four rows of W are used at a time, so that y is read and written less often. */
static NOINLINE void dense_add(int in, int out, const real *RESTRICT w, const real *RESTRICT x,
                               real *RESTRICT y) {
    int i = 0;
    if (out == 1) {
        y[0] += dot(in, w, x);
        return;
    }
    for (; i + 4 <= in; i += 4, w += 4 * out) {
        const real *RESTRICT w1 = w + out, *RESTRICT w2 = w1 + out, *RESTRICT w3 = w2 + out;
        const real x0 = x[i], x1 = x[i + 1], x2 = x[i + 2], x3 = x[i + 3];
        for (int j = 0; j < out; j++) y[j] += (x0 * w[j] + x1 * w1[j]) + (x2 * w2[j] + x3 * w3[j]);
    }
    for (; i < in; i++, w += out)
        for (int j = 0; j < out; j++) y[j] += x[i] * w[j];
}
