static void features_vjp(FOR_WINDOW const real *x, const real *df, real *dx, real *work) {
    (void)x, (void)work;
    ROLLED
    for (int i = 0; i < SELECTED; i++) {
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) dx[NAME_select[i] * NAME_LENGTH + t] = df[i * NAME_LENGTH + t];
    }
}
