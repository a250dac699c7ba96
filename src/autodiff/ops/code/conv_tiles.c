/* y (count, outputs) = windows of x, `in` numbers one every `step`, times weight (in, outputs), plus b. If
 * the number of windows or columns is not a multiple of the tile size, the last tile is moved back and
 * computes some of them a second time. */
static NOINLINE void conv_tiles(int count, int in, int step, int outputs, const real *x, const real *weight,
                                const real *b, real *y) {
    for (int j = 0; j < outputs; j += TILE_COLUMNS) {
        const int o = j + TILE_COLUMNS > outputs ? outputs - TILE_COLUMNS : j;
        for (int i = 0; i < count; i += TILE_PLACES) {
            const int t = i + TILE_PLACES > count ? count - TILE_PLACES : i;
            conv_tile(in, step, outputs, outputs, x + t * step, weight + o, b != NULL ? b + o : tile_zero,
                      y + t * outputs + o);
        }
    }
}
