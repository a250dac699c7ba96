/* x (batch, length, channels), the adjoint of conv1d in its first argument: g (batch, count, outputs) */
static NOINLINE void conv1d_input(int batch, conv_windows w, int outputs, const real *g, const real *weight,
                                  real *x) {
    const int n = w.channels;
    int from, to;
    whole_windows(&w, &from, &to);
    if (w.size * n < TILE_COLUMNS) to = from;
    to = from + (to - from) / TILE_PLACES * TILE_PLACES;
    for (int s = 0; s < batch; s++, x += w.length * n, g += w.count * outputs) {
        for (int i = 0; i < w.length * n; i++) x[i] = REAL(0.0);
        if (to > from)
            conv_back(to - from, w.size * n, w.stride * n, outputs, g + from * outputs, weight,
                      x + (from * w.stride - w.padding) * n);
        for (int t = 0; t < w.count; t++) {
            int first, rows, at;
            if (t == from) t = to;
            if (t == w.count) break;
            window_rows(&w, t, &first, &rows, &at);
            for (int i = 0; i < rows * n; i++)
                x[at * n + i] += dot(outputs, weight + (first * n + i) * outputs, g + t * outputs);
        }
    }
}
