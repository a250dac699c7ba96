/* Least squares y = intercept + slope x through the parts' standard deviations of one pair of channels. */
typedef struct fitted_line {
    real mean_x, mean_y, xx, slope;
    int level; /* x does not vary: slope 0 */
} fitted_line;

static fitted_line fit_line(FOR_WINDOW const real *x, const real *y) {
    fitted_line l = {0, 0, 0, 0, 0};
    real largest = REAL(0.0), xy = REAL(0.0);
    for (int s = 0; s < SEGMENTS; s++) {
        l.mean_x += x[s];
        l.mean_y += y[s];
        if (x[s] > largest) largest = x[s];
    }
    l.mean_x /= (real)SEGMENTS;
    l.mean_y /= (real)SEGMENTS;
    for (int s = 0; s < SEGMENTS; s++) {
        l.xx += (x[s] - l.mean_x) * (x[s] - l.mean_x);
        xy += (x[s] - l.mean_x) * (y[s] - l.mean_y);
    }
    const real rounding = REAL(16.0) * REAL_EPSILON * largest;
    l.level = !(l.xx > (real)SEGMENTS * rounding * rounding);
    l.slope = l.level ? REAL(0.0) : xy / l.xx;
    return l;
}

/* The first sample of a part. */
static int part_begin(FOR_WINDOW int part) {
    return (int)((long long)part * NAME_LENGTH / SEGMENTS);
}

/* Standard deviations (SEGMENTS) of the parts of a channel. work: LENGTH. */
static void part_deviations(FOR_WINDOW int channel, const real *x, real *deviation, real *work) {
    for (int s = 0; s < SEGMENTS; s++) {
        const int begin = part_begin(OF_WINDOW s);
        deviation[s] = centre_numbers(part_begin(OF_WINDOW s + 1) - begin, INVERSE_SCALE(channel),
                                      x + channel * NAME_LENGTH + begin, work);
    }
}

/* Intercept and slope of the parts' deviations of each pair of channels, moment against acceleration. work:
 * LENGTH + 2 SEGMENTS PAIRS. */
static void compute_features(FOR_WINDOW const real *x, real *f, real *work) {
    real *deviation = work + NAME_LENGTH;
    for (int p = 0; p < PAIRS; p++, deviation += 2 * SEGMENTS) {
        part_deviations(OF_WINDOW NAME_pair[2 * p], x, deviation, work);
        part_deviations(OF_WINDOW NAME_pair[2 * p + 1], x, deviation + SEGMENTS, work);
        const fitted_line l = fit_line(OF_WINDOW deviation, deviation + SEGMENTS);
        f[2 * p] = l.mean_y - l.slope * l.mean_x;
        f[2 * p + 1] = l.slope;
    }
}
