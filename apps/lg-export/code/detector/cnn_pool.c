/* Windows over time of y (convolved, filters) -> out (pooled, filters): their mean. */
static NOINLINE void cnn_pool_mean(const cnn_block *b, const real *RESTRICT y, real *RESTRICT out) {
    const int n = b->layer.out;
    const real part = REAL(1.0) / (real)b->pool;
    for (int t = 0; t < b->pooled; t++, out += n) {
        const real *RESTRICT row = y + t * b->pool_stride * n;
        for (int c = 0; c < n; c++) out[c] = row[c];
        for (int i = 1; i < b->pool; i++)
            for (int c = 0; c < n; c++) out[c] += row[i * n + c];
        for (int c = 0; c < n; c++) out[c] *= part;
    }
}

/* Their largest number; NaN before all. */
static NOINLINE void cnn_pool_largest(const cnn_block *b, const real *RESTRICT y, real *RESTRICT out) {
    const int n = b->layer.out;
    for (int t = 0; t < b->pooled; t++, out += n) {
        const real *RESTRICT row = y + t * b->pool_stride * n;
        for (int c = 0; c < n; c++) out[c] = row[c];
        for (int i = 1; i < b->pool; i++)
            for (int c = 0; c < n; c++) {
                const real next = row[i * n + c], best = out[c];
                out[c] = best >= next || best != best ? best : next;
            }
    }
}
