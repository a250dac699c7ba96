/* z = f - mean; the scale is in the weights. */
static void standardise(const real *RESTRICT f, real *RESTRICT z) {
    ROLLED
    for (int i = 0; i < NAME_FEATURES; i++) z[i] = f[i] - NAME_mean[i];
}
