/* x += g times a panel at `count` places, which may overlap; count is a multiple of TILE_PLACES. */
static NOINLINE void conv_panel_add(int count, int step, int outputs, int rows, const real *panel,
                                    const real *g, real *x) {
    real sum[TILE_PLACES * TILE_COLUMNS];
    for (int i = 0; i < count; i += TILE_PLACES) {
        conv_tile(rows, outputs, TILE_COLUMNS, TILE_COLUMNS, g + i * outputs, panel, tile_zero, sum);
        for (int t = 0; t < TILE_PLACES; t++, x += step)
            for (int j = 0; j < TILE_COLUMNS; j++) x[j] += sum[t * TILE_COLUMNS + j];
    }
}
