/* Logarithms of the power of each channel in each band, by Welch's method. work: 2 LENGTH + SEGMENT +
 * SELECTED BANDS. */
static void compute_features(FOR_WINDOW const real *x, real *f, real *work) {
    real *s = work + 2 * NAME_LENGTH, *inverse = s + SEGMENT;
    for (int i = 0; i < SELECTED; i++, f += BANDS, inverse += BANDS) {
        const int channel = NAME_select[i];
        (void)centre_numbers(NAME_LENGTH, INVERSE_SCALE(channel), x + channel * NAME_LENGTH, work);
        for (int b = 0; b < BANDS; b++) f[b] = REAL(0.0);
        for (int n = 0; n < SEGMENTS; n++) {
            taper_segment(OF_WINDOW n, work, s);
            for (int b = 0; b < BANDS; b++)
                for (int k = NAME_edge[b]; k < NAME_edge[b + 1]; k++) {
                    real re, im;
                    transform_segment(OF_WINDOW k, s, &re, &im);
                    f[b] += re * re + im * im;
                }
        }
        for (int b = 0; b < BANDS; b++) {
            const real power = f[b] / band_squares(OF_WINDOW b) + POWER_FLOOR;
            f[b] = LOG(power);
            inverse[b] = REAL(1.0) / power;
        }
    }
}
