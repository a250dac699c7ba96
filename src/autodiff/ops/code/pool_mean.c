/* y (batch, count, channels): means of the windows of x. */
static NOINLINE void pool_mean(int batch, conv_windows w, const real *RESTRICT x, real *RESTRICT y) {
    const int n = w.channels;
    const real part = REAL(1.0) / (real)w.size;
    for (int s = 0; s < batch; s++, x += w.length * n)
        for (int t = 0; t < w.count; t++, y += n) {
            for (int i = 0; i < n; i++) y[i] = REAL(0.0);
            for (int j = 0; j < w.size; j++)
                for (int i = 0; i < n; i++) y[i] += x[(t * w.stride + j) * n + i];
            for (int i = 0; i < n; i++) y[i] *= part;
        }
}
