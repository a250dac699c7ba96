/* Random convolution features: the parts of a convolution's samples above thresholds. All sums are of floats
 * and in the order of the library, so that the counts are the same. work: the scaled channels with zeros on
 * both sides (SELECTED, LENGTH + 2 MARGIN), sums of nine taps (SELECTED, LENGTH), a convolution (LENGTH). */
enum { ROW = NAME_LENGTH + 2 * MARGIN, SUMS = SELECTED * ROW, SAMPLES = SUMS + SELECTED * NAME_LENGTH };

/* Returns the root mean square of the scaled window. Squares of floats are exact in double. */
static float scale_window(const real *x, real *work) {
    double sum = 0;
    ROLLED
    for (int i = 0; i < SELECTED; i++) {
        const int channel = NAME_select[i];
        const float mean = (float)NAME_channel_mean[channel], inverse = (float)NAME_inverse_scale[channel];
        real *z = work + i * ROW;
        ROLLED
        for (int t = 0; t < ROW; t++) z[t] = REAL(0.0);
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) {
            const float number = ((float)x[channel * NAME_LENGTH + t] - mean) * inverse;
            z[MARGIN + t] = (real)number;
            sum += (double)number * (double)number;
        }
    }
    return (float)sqrt(sum / ((double)SELECTED * NAME_LENGTH));
}

static void sum_taps(int dilation, real *work) {
    ROLLED
    for (int i = 0; i < SELECTED; i++) {
        const real *z = work + i * ROW + MARGIN - 4 * dilation;
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) {
            float total = (float)z[t];
            for (int j = 1; j < 9; j++) total += (float)z[t + j * dilation];
            work[SUMS + i * NAME_LENGTH + t] = (real)total;
        }
    }
}

/* The three taps of weight 2 of kernel number `kernel`, in lexicographic order. */
static void weighted_taps(int kernel, int *tap) {
    for (tap[0] = 0; tap[0] < 9; tap[0]++)
        for (tap[1] = tap[0] + 1; tap[1] < 9; tap[1]++)
            for (tap[2] = tap[1] + 1; tap[2] < 9; tap[2]++)
                if (kernel-- == 0) return;
}

/* Adds channel number `entry`/2, or subtracts it if `entry` is odd. */
static void add_channel(int kernel, int dilation, int entry, real *work) {
    const real *z = work + entry / 2 * ROW + MARGIN - 4 * dilation,
               *sum = work + SUMS + entry / 2 * NAME_LENGTH;
    int tap[3] = {0, 0, 0};
    if (kernel < 84) weighted_taps(kernel, tap);
    ROLLED
    for (int t = 0; t < NAME_LENGTH; t++) {
        float value = (float)sum[t];
        if (kernel < 84) {
            const float u = ((float)z[t + tap[0] * dilation] + (float)z[t + tap[1] * dilation]) +
                            (float)z[t + tap[2] * dilation];
            value = ((u + u) + u) - value;
        }
        if (entry % 2 == 1) value = -value;
        work[SAMPLES + t] = (real)((float)work[SAMPLES + t] + value);
    }
}

static void compute_features(const real *x, real *f, real *work) {
    const float rms = scale_window(x, work);
    int before = 0, entry = 0, bias = 0;
    ROLLED
    for (int c = 0; c < CONVOLUTIONS; c++) {
        const int kernel = NAME_kernel[c], dilation = NAME_dilation[c];
        const int first = NAME_padded[c] ? 0 : 4 * dilation, last = NAME_LENGTH - first;
        const float unit = kernel < 84 ? rms : 1.0f;
        if (dilation != before) sum_taps(dilation, work);
        before = dilation;
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) work[SAMPLES + t] = REAL(0.0);
        for (int i = 0; i < NAME_added[c]; i++) add_channel(kernel, dilation, NAME_channel[entry++], work);
        for (int i = 0; i < NAME_compared[c]; i++, bias++) {
            const float level = (float)NAME_bias[bias] * unit;
            int count = 0;
            ROLLED
            for (int t = first; t < last; t++) count += (float)work[SAMPLES + t] > level;
            f[bias] = (real)count / (real)(last - first);
        }
    }
}
