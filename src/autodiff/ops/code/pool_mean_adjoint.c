/* x (batch, length, channels), the adjoint of pool_mean: g (batch, count, channels) */
static NOINLINE void pool_mean_adjoint(int batch, conv_windows w, const real *RESTRICT g, real *RESTRICT x) {
    const int n = w.channels;
    const real part = REAL(1.0) / (real)w.size;
    for (int s = 0; s < batch; s++, x += w.length * n) {
        for (int i = 0; i < w.length * n; i++) x[i] = REAL(0.0);
        for (int t = 0; t < w.count; t++, g += n)
            for (int j = 0; j < w.size; j++)
                for (int i = 0; i < n; i++) x[(t * w.stride + j) * n + i] += g[i] * part;
    }
}
