/* Adds the segment's wave of frequency bin/SEGMENT with amplitudes re, im, under its window, to g. */
static void add_wave(FOR_WINDOW int bin, real re, real im, real *g) {
    int at = 0;
    for (int t = 0; t < SEGMENT; t++) {
        g[t] += NAME_taper[t] * (re * NAME_cosine[at] + im * NAME_sine[at]);
        at += bin;
        if (at >= SEGMENT) at -= SEGMENT;
    }
}

/* Adds the cotangent of z (LENGTH), from df and 1/power (BANDS), to g (LENGTH). s: SEGMENT. */
static void powers_vjp(FOR_WINDOW const real *df, const real *inverse, const real *z, real *g, real *s) {
    for (int n = 0; n < SEGMENTS; n++) {
        taper_segment(OF_WINDOW n, z, s);
        for (int b = 0; b < BANDS; b++) {
            const real factor = REAL(2.0) * df[b] * inverse[b] / band_squares(OF_WINDOW b);
            for (int k = NAME_edge[b]; k < NAME_edge[b + 1]; k++) {
                real re, im;
                transform_segment(OF_WINDOW k, s, &re, &im);
                add_wave(OF_WINDOW k, factor * re, factor * im, g + n * HOP);
            }
        }
    }
}

/* After compute_features, with the same work. */
static void features_vjp(FOR_WINDOW const real *x, const real *df, real *dx, real *work) {
    real *g = work + NAME_LENGTH, *s = g + NAME_LENGTH;
    for (int i = 0; i < SELECTED; i++) {
        const int first = NAME_select[i] * NAME_LENGTH;
        const real factor = INVERSE_SCALE(NAME_select[i]);
        real mean = REAL(0.0);
        (void)centre_numbers(NAME_LENGTH, factor, x + first, work);
        for (int t = 0; t < NAME_LENGTH; t++) g[t] = REAL(0.0);
        powers_vjp(OF_WINDOW df + i * BANDS, s + SEGMENT + i * BANDS, work, g, s);
        for (int t = 0; t < NAME_LENGTH; t++) mean += g[t] / (real)NAME_LENGTH;
        for (int t = 0; t < NAME_LENGTH; t++) dx[first + t] += factor * (g[t] - mean);
    }
}
