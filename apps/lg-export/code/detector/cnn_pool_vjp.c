/* dy (convolved, filters) from dout (pooled, filters): each sample of a window gets its part. */
static NOINLINE void cnn_pool_mean_vjp(const cnn_block *b, const real *RESTRICT dout, real *RESTRICT dy) {
    const int n = b->layer.out;
    const real part = REAL(1.0) / (real)b->pool;
    for (int i = 0; i < b->convolved * n; i++) dy[i] = REAL(0.0);
    for (int t = 0; t < b->pooled; t++, dout += n) {
        real *RESTRICT row = dy + t * b->pool_stride * n;
        for (int i = 0; i < b->pool; i++)
            for (int c = 0; c < n; c++) row[i * n + c] += part * dout[c];
    }
}

/* The first of a window's largest samples gets all. */
static NOINLINE void cnn_pool_largest_vjp(const cnn_block *b, const real *RESTRICT y,
                                          const real *RESTRICT dout, real *RESTRICT dy) {
    const int n = b->layer.out;
    for (int i = 0; i < b->convolved * n; i++) dy[i] = REAL(0.0);
    for (int t = 0; t < b->pooled; t++, dout += n) {
        const int first = t * b->pool_stride * n;
        for (int c = 0; c < n; c++) {
            int best = first + c;
            for (int i = best; i < first + b->pool * n; i += n)
                if (!(y[best] >= y[i] || y[best] != y[best])) best = i;
            dy[best] += dout[c];
        }
    }
}
