/* y (batch, count, outputs) = the windows of x times w (size, channels, outputs), plus b (outputs; or
 * NULL) */
static NOINLINE void conv1d(int batch, conv_windows w, int outputs, const real *x, const real *weight,
                            const real *b, real *y) {
    const int n = w.channels;
    int from, to;
    whole_windows(&w, &from, &to);
    const int tiled = to - from >= TILE_PLACES && outputs >= TILE_COLUMNS;
    for (int s = 0; s < batch; s++, x += w.length * n, y += w.count * outputs) {
        if (tiled)
            conv_tiles(to - from, w.size * n, w.stride * n, outputs, x + (from * w.stride - w.padding) * n,
                       weight, b, y + from * outputs);
        for (int t = 0; t < w.count; t++) {
            int first, rows, at;
            if (tiled && t == from) t = to;
            if (t == w.count) break;
            window_rows(&w, t, &first, &rows, &at);
            for (int o = 0; o < outputs; o++) y[t * outputs + o] = b != NULL ? b[o] : REAL(0.0);
            dense_add(rows * n, outputs, weight + first * n * outputs, x + at * n, y + t * outputs);
        }
    }
}
