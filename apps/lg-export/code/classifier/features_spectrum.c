/* s (SEGMENT): segment `number` of z (LENGTH) under its window. */
static void taper_segment(int number, const real *z, real *s) {
    for (int t = 0; t < SEGMENT; t++) s[t] = NAME_taper[t] * z[number * HOP + t];
}

/* The sums of s_t cos(2 pi bin t/SEGMENT) and of s_t sin. */
static void transform_segment(int bin, const real *s, real *re, real *im) {
    int at = 0; /* bin t modulo SEGMENT */
    *re = *im = REAL(0.0);
    for (int t = 0; t < SEGMENT; t++) {
        *re += s[t] * NAME_cosine[at];
        *im += s[t] * NAME_sine[at];
        at += bin;
        if (at >= SEGMENT) at -= SEGMENT;
    }
}

/* Squares that are added up for the power of a band. */
static real band_squares(int band) {
    return (real)(SEGMENTS * (NAME_edge[band + 1] - NAME_edge[band]));
}

/* Logarithms of the power of each channel in each band, by Welch's method. work: 2 LENGTH + SEGMENT +
 * SELECTED BANDS. */
static void compute_features(const real *x, real *f, real *work) {
    real *s = work + 2 * NAME_LENGTH, *inverse = s + SEGMENT;
    for (int i = 0; i < SELECTED; i++, f += BANDS, inverse += BANDS) {
        const int channel = NAME_select[i];
        (void)centre_numbers(NAME_LENGTH, NAME_inverse_scale[channel], x + channel * NAME_LENGTH, work);
        for (int b = 0; b < BANDS; b++) f[b] = REAL(0.0);
        for (int n = 0; n < SEGMENTS; n++) {
            taper_segment(n, work, s);
            for (int b = 0; b < BANDS; b++)
                for (int k = NAME_edge[b]; k < NAME_edge[b + 1]; k++) {
                    real re, im;
                    transform_segment(k, s, &re, &im);
                    f[b] += re * re + im * im;
                }
        }
        for (int b = 0; b < BANDS; b++) {
            const real power = f[b] / band_squares(b) + POWER_FLOOR;
            f[b] = LOG(power);
            inverse[b] = REAL(1.0) / power;
        }
    }
}
