/* z (m, n + 2 margin) = (x - mean) inverse, with zeros on both sides; returns the root mean square. Squares
 * of floats are exact in double. */
static float scale_window(int m, int n, int margin, const real *x, const real *mean, const real *inverse,
                          real *z) {
    double sum = 0;
    for (int i = 0; i < m * (n + 2 * margin); i++) z[i] = REAL(0.0);
    for (int i = 0; i < m; i++)
        for (int t = 0; t < n; t++) {
            const float number = ((float)x[i * n + t] - (float)mean[i]) * (float)inverse[i];
            z[i * (n + 2 * margin) + margin + t] = (real)number;
            sum += (double)number * (double)number;
        }
    return (float)sqrt(sum / ((double)m * n));
}

/* The three taps of weight 2 of kernel number `kernel`, in lexicographic order. */
static void weighted_taps(int kernel, int *tap) {
    for (tap[0] = 0; tap[0] < 9; tap[0]++)
        for (tap[1] = tap[0] + 1; tap[1] < 9; tap[1]++)
            for (tap[2] = tap[1] + 1; tap[2] < 9; tap[2]++)
                if (kernel-- == 0) return;
}

/* sum (n) becomes the sums of nine samples, `dilation` apart, from z on. */
static NOINLINE void sum_taps(int n, int dilation, const real *z, real *sum) {
    for (int t = 0; t < n; t++) {
        float total = (float)z[t];
        for (int j = 1; j < 9; j++) total += (float)z[t + j * dilation];
        sum[t] = (real)total;
    }
}

/* Adds a channel to y (n), or subtracts it if `sign` is -1. */
static NOINLINE void add_channel(int n, int kernel, int dilation, float sign, const real *z, const real *sum,
                                 real *y) {
    int tap[3] = {0, 0, 0};
    if (kernel < 84) weighted_taps(kernel, tap);
    for (int t = 0; t < n; t++) {
        float value = (float)sum[t];
        if (kernel < 84) {
            const float u = ((float)z[t + tap[0] * dilation] + (float)z[t + tap[1] * dilation]) +
                            (float)z[t + tap[2] * dilation];
            value = ((u + u) + u) - value;
        }
        y[t] = (real)((float)y[t] + sign * value);
    }
}

static NOINLINE real part_above(int n, const real *y, float level) {
    int count = 0;
    for (int t = 0; t < n; t++) count += (float)y[t] > level;
    return (real)count / (real)n;
}

/* Features f of random convolutions: the parts of a convolution's samples above the thresholds `bias`; NaN if
 * a scaled sample is not finite. All sums are of floats and in the order of the library, so that the counts
 * are the same. A row of the table has kernel, dilation, padding, numbers of channels and of thresholds;
 * behind the rows are the channels. work: the scaled channels with zeros on both sides, sums of nine taps
 * (m, n), a convolution (n). */
static void rocket(int m, int n, int rows, const int *table, const real *x, const real *mean,
                   const real *inverse, const real *bias, real *f, real *work) {
    const int *channel = table + 5 * rows;
    int margin = 0, before = 0;
    for (int c = 0; c < rows; c++)
        if (4 * table[5 * c + 1] > margin) margin = 4 * table[5 * c + 1];
    real *sum = work + m * (n + 2 * margin), *y = sum + m * n;
    const float rms = scale_window(m, n, margin, x, mean, inverse, work);
    for (int c = 0; c < rows; c++, table += 5) {
        const int kernel = table[0], dilation = table[1], first = table[2] ? 0 : 4 * dilation;
        const real *z = work + margin - 4 * dilation;
        for (int i = 0; i < m && dilation != before; i++)
            sum_taps(n, dilation, z + i * (n + 2 * margin), sum + i * n);
        before = dilation;
        for (int t = 0; t < n; t++) y[t] = REAL(0.0);
        for (int i = 0; i < table[3]; i++, channel++)
            add_channel(n, kernel, dilation, *channel % 2 == 1 ? -1.0f : 1.0f,
                        z + *channel / 2 * (n + 2 * margin), sum + *channel / 2 * n, y);
        for (int i = 0; i < table[4]; i++)
            *f++ = REAL(0.0) * (real)rms +
                   part_above(n - 2 * first, y + first, (float)*bias++ * (kernel < 84 ? rms : 1.0f));
    }
}
