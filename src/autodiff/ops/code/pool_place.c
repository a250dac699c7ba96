/* The adjoint of pool_pick in h: g (batch, count, channels) is added where x is largest. */
static NOINLINE void pool_place(int batch, conv_windows w, const real *g, const real *x, real *y) {
    const int n = w.channels;
    for (int s = 0; s < batch; s++, x += w.length * n, y += w.length * n) {
        for (int i = 0; i < w.length * n; i++) y[i] = REAL(0.0);
        for (int t = 0; t < w.count; t++, g += n)
            for (int i = 0; i < n; i++) {
                const int at = t * w.stride * n + i;
                y[at + first_maximum(w.size, n, x + at)] += g[i];
            }
    }
}
