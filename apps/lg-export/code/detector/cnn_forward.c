/* Writes the zeros around the input of block i; where its samples begin. */
static real *cnn_open(const cnn_place *place, int i, real *work) {
    real *input = work + place[i].input;
    if (i < BLOCKS) {
        const cnn_block *b = &cnn_blocks[i];
        const int edge = b->padding * b->channels, inner = b->length * b->channels;
        for (int k = 0; k < edge; k++) input[k] = input[edge + inner + k] = REAL(0.0);
        input += edge;
    }
    return input;
}

/* y (convolved, filters) from x, the input with its zeros. Where places or filters are not whole tiles, the
 * last tile takes some of them again. */
static void cnn_convolve(const cnn_block *b, const real *x, real *y) {
    const int step = b->stride * b->channels, filters = b->layer.out;
    if (b->convolved < TILE_PLACES || filters < TILE_COLUMNS) {
        for (int t = 0; t < b->convolved; t++) dense(&b->layer, x + t * step, y + t * filters);
        return;
    }
    for (int j = 0; j < filters; j += TILE_COLUMNS) {
        const int column = cnn_least(j, filters - TILE_COLUMNS);
        const real *w = NAME_weights + b->layer.weight + column,
                   *bias = NAME_weights + b->layer.bias + column;
        for (int t = 0; t < b->convolved; t += TILE_PLACES) {
            const int first = cnn_least(t, b->convolved - TILE_PLACES);
            cnn_tile(b->layer.in, step, filters, filters, x + first * step, w, bias,
                     y + first * filters + column);
        }
    }
}

/* The blocks, from the input that lies in its place on; with `slopes` the activation's derivative is kept. */
static NOINLINE void cnn_run_blocks(const cnn_place *place, int slopes, real *work) {
    for (int i = 0; i < BLOCKS; i++) {
        const cnn_block *b = &cnn_blocks[i];
        real *y = work + place[i].activated, *next = cnn_open(place, i + 1, work);
        cnn_convolve(b, work + place[i].input, y);
        cnn_activate(slopes, b->convolved * b->layer.out, y, work + place[i].slope);
        if (b->pooling == 1) cnn_pool_mean(b, y, next);
        if (b->pooling == 2) cnn_pool_largest(b, y, next);
    }
}
