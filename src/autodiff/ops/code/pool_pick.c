/* y (batch, count, channels): of each window the number of h where x is largest. */
static NOINLINE void pool_pick(int batch, conv_windows w, const real *h, const real *x, real *y) {
    const int n = w.channels;
    for (int s = 0; s < batch; s++, h += w.length * n, x += w.length * n)
        for (int t = 0; t < w.count; t++, y += n)
            for (int i = 0; i < n; i++) {
                const int at = t * w.stride * n + i;
                y[i] = h[at + first_maximum(w.size, n, x + at)];
            }
}
