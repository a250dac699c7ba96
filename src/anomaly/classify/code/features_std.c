/* The standard deviation of each channel that is used; work: LENGTH. */
static void compute_features(FOR_WINDOW const real *x, real *f, real *work) {
    for (int i = 0; i < SELECTED; i++)
        f[i] = centre_numbers(NAME_LENGTH, REAL(1.0), x + NAME_select[i] * NAME_LENGTH, work);
}
