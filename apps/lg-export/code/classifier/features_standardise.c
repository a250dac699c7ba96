/* z = (f - mean)/scale */
static void standardise(const real *RESTRICT f, real *RESTRICT z) {
    ROLLED
    for (int i = 0; i < NAME_FEATURES; i++) z[i] = (f[i] - NAME_mean[i]) * NAME_inverse_deviation[i];
}
