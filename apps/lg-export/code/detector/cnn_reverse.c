/* Rows of W (in, out), TILE_COLUMNS from `row` on, as columns: `rows` of its outputs from `output` on. Of
 * rows before `from` zeros. */
enum { PANEL_ROWS = 12 };

static NOINLINE void cnn_panel(const net_layer *layer, int row, int from, int output, int rows,
                               real panel[PANEL_ROWS][TILE_COLUMNS]) {
    for (int j = 0; j < TILE_COLUMNS; j++) {
        const real *w = NAME_weights + layer->weight + (row + j) * layer->out + output;
        for (int k = 0; k < rows; k++) panel[k][j] = row + j < from ? REAL(0.0) : w[k];
    }
}

/* dx += dz times a panel at `places` places; what they cover may overlap. */
static NOINLINE void cnn_panel_add(const cnn_block *b, int places, int rows,
                                   real panel[PANEL_ROWS][TILE_COLUMNS], const real *dz, real *dx) {
    const int step = b->stride * b->channels, out = b->layer.out;
    real zero[TILE_COLUMNS], sum[TILE_PLACES][TILE_COLUMNS];
    for (int j = 0; j < TILE_COLUMNS; j++) zero[j] = REAL(0.0);
    for (int i = 0; i < places; i += TILE_PLACES) {
        cnn_tile(rows, out, TILE_COLUMNS, TILE_COLUMNS, dz + i * out, panel[0], zero, sum[0]);
        for (int t = 0; t < TILE_PLACES; t++, dx += step)
            for (int j = 0; j < TILE_COLUMNS; j++) dx[j] += sum[t][j];
    }
}

/* dx += dz W^T at all places; dz (convolved, filters). */
static NOINLINE void cnn_convolve_vjp(const cnn_block *b, const real *dz, real *dx) {
    const int step = b->stride * b->channels, in = b->layer.in, out = b->layer.out;
    const int tiled = in < TILE_COLUMNS ? 0 : b->convolved / TILE_PLACES * TILE_PLACES;
    real panel[PANEL_ROWS][TILE_COLUMNS];
    for (int i = 0; i < in && tiled > 0; i += TILE_COLUMNS) {
        const int row = cnn_least(i, in - TILE_COLUMNS);
        for (int o = 0; o < out; o += PANEL_ROWS) {
            const int rows = cnn_least(PANEL_ROWS, out - o);
            cnn_panel(&b->layer, row, i, o, rows, panel);
            cnn_panel_add(b, tiled, rows, panel, dz + o, dx + row);
        }
    }
    for (int t = tiled; t < b->convolved; t++) add_row_products(&b->layer, dz + t * out, dx + t * step);
}

/* From the cotangent of what block i gives, (pooled, filters), to that of its input with the zeros around
 * it, dx; dz (convolved, filters). */
static NOINLINE void cnn_block_vjp(int i, const real *dout, real *dz, real *dx, const real *work) {
    const cnn_block *b = &cnn_blocks[i];
    const int numbers = b->convolved * b->layer.out;
    const real *slope = work + cnn_places_grad[i].slope;
    if (b->pooling == 0)
        for (int k = 0; k < numbers; k++) dz[k] = dout[k];
    if (b->pooling == 1) cnn_pool_mean_vjp(b, dout, dz);
    if (b->pooling == 2) cnn_pool_largest_vjp(b, work + cnn_places_grad[i].activated, dout, dz);
    for (int k = 0; k < numbers; k++) dz[k] *= slope[k];
    for (int k = 0; k < (b->length + 2 * b->padding) * b->channels; k++) dx[k] = REAL(0.0);
    cnn_convolve_vjp(b, dz, dx);
}

/* Derivative of output o by the scaled window, (length, channels); where in `work` it lies. */
static const real *cnn_reverse(int o, real *work) {
    real *dout = work + REVERSE, *dx = work + REVERSE + REVERSE_SIDE;
    cnn_dense_vjp(o, dout, work);
    for (int i = BLOCKS - 1; i >= 0; i--) {
        real *const free_side = (BLOCKS - 1 - i) % 2 == 0 ? work + REVERSE : work + REVERSE + REVERSE_SIDE;
        cnn_block_vjp(i, dout, work + REVERSE_CONVOLVED, dx, work);
        dout = dx + cnn_blocks[i].padding * cnn_blocks[i].channels;
        dx = free_side; /* where the cotangent was that is used up now */
    }
    return dout;
}
