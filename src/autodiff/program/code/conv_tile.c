/* A convolution is taken for a few places and columns of its weights at once: compilers keep their sums in
 * vector registers. */
enum { TILE_PLACES = 4, TILE_COLUMNS = 8 };

static const real tile_zero[TILE_COLUMNS] = {REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0),
                                             REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0)};

/* y = start (TILE_COLUMNS) + x w over n rows of w, which begin `width` after one another; places of x begin
 * `step`, those of y `pace` after one another. Four rows at a time gcc keeps the sums in registers; one at a
 * time it would take rows for elements of vectors and shuffle them. With clang it is the other way round. */
static NOINLINE void conv_tile(int n, int step, int width, int pace, const real *RESTRICT x,
                               const real *RESTRICT w, const real *RESTRICT start, real *RESTRICT y) {
    real sum[TILE_PLACES][TILE_COLUMNS];
    int i = 0;
    for (int t = 0; t < TILE_PLACES; t++)
        for (int j = 0; j < TILE_COLUMNS; j++) sum[t][j] = start[j];
#if !defined(__clang__)
    for (; i + 4 <= n; i += 4, w += 4 * width)
        for (int t = 0; t < TILE_PLACES; t++)
            for (int j = 0; j < TILE_COLUMNS; j++) {
                real s = sum[t][j];
                s += x[t * step + i] * w[j];
                s += x[t * step + i + 1] * w[width + j];
                s += x[t * step + i + 2] * w[2 * width + j];
                s += x[t * step + i + 3] * w[3 * width + j];
                sum[t][j] = s;
            }
#endif
    for (; i < n; i++, w += width)
        for (int t = 0; t < TILE_PLACES; t++)
            for (int j = 0; j < TILE_COLUMNS; j++) sum[t][j] += x[t * step + i] * w[j];
    for (int t = 0; t < TILE_PLACES; t++)
        for (int j = 0; j < TILE_COLUMNS; j++) y[t * pace + j] = sum[t][j];
}
