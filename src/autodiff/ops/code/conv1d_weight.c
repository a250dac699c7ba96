/* weight (size, channels, outputs), the adjoint of conv1d in its second argument: x, g */
static NOINLINE void conv1d_weight(int batch, conv_windows w, int outputs, const real *RESTRICT x,
                                   const real *RESTRICT g, real *RESTRICT weight) {
    const int n = w.channels;
    for (int i = 0; i < w.size * n * outputs; i++) weight[i] = REAL(0.0);
    for (int s = 0; s < batch; s++, x += w.length * n)
        for (int t = 0; t < w.count; t++, g += outputs) {
            int first, rows, at;
            window_rows(&w, t, &first, &rows, &at);
            for (int i = 0; i < rows * n; i++)
                for (int o = 0; o < outputs; o++)
                    weight[(first * n + i) * outputs + o] += x[at * n + i] * g[o];
        }
}
