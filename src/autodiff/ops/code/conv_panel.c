/* Rows row .. row + 7 of weight (in, outputs) as columns, outputs o .. o + rows - 1; zeros for rows before
 * `from`. The columns of the panel are rows of the weight, so a tile of x's cotangent is one product
 * computed by conv_tile. */
enum { PANEL_ROWS = 12 };

static NOINLINE void conv_panel(int row, int from, int outputs, int o, int rows, const real *weight,
                                real *panel) {
    for (int j = 0; j < TILE_COLUMNS; j++)
        for (int k = 0; k < rows; k++)
            panel[k * TILE_COLUMNS + j] = row + j < from ? REAL(0.0) : weight[(row + j) * outputs + o + k];
}
