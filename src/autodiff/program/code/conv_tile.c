/* A convolution is computed for TILE_PLACES windows and TILE_COLUMNS columns of the weight at once, so that
 * compilers keep the sums in vector registers. */
enum { TILE_PLACES = 4, TILE_COLUMNS = 8 };

static const real tile_zero[TILE_COLUMNS] = {REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0),
                                             REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0)};

/* y = start (TILE_COLUMNS) + x w for TILE_PLACES windows. w has n rows, `width` numbers apart; consecutive
 * windows of x are `step` numbers apart, consecutive rows of y `pace`. gcc keeps the sums in registers if it
 * gets four rows at a time; with one row at a time it would build vectors across rows and shuffle them. clang
 * does better with one row at a time. */
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
