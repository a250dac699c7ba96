static void features_vjp(FOR_WINDOW const real *x, const real *df, real *dx, real *work) {
    for (int i = 0; i < SELECTED; i++) {
        const int first = NAME_select[i] * NAME_LENGTH;
        deviation_vjp(NAME_LENGTH, REAL(1.0), x + first, df[i], dx + first, work);
    }
}
