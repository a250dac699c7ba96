/* x += g (count, outputs) times the transpose of weight (in, outputs), at places `step` apart; count is a
 * multiple of a tile's places. */
static NOINLINE void conv_back(int count, int in, int step, int outputs, const real *g, const real *weight,
                               real *x) {
    real panel[PANEL_ROWS * TILE_COLUMNS];
    for (int i = 0; i < in; i += TILE_COLUMNS) {
        const int row = i + TILE_COLUMNS > in ? in - TILE_COLUMNS : i;
        for (int o = 0; o < outputs; o += PANEL_ROWS) {
            const int rows = outputs - o < PANEL_ROWS ? outputs - o : PANEL_ROWS;
            conv_panel(row, i, outputs, o, rows, weight, panel);
            conv_panel_add(count, step, outputs, rows, panel, g + o, x + row);
        }
    }
}
