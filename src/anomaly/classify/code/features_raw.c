/* The window as it is: the channels that are used, one after the other. */
static void compute_features(FOR_WINDOW const real *x, real *f, real *work) {
    (void)work;
    ROLLED
    for (int i = 0; i < SELECTED; i++) {
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) f[i * NAME_LENGTH + t] = x[NAME_select[i] * NAME_LENGTH + t];
    }
}
