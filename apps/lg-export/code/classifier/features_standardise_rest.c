/* z = (f - mean)/scale; what the mean's rounding to float leaves out is in a second number. */
static void standardise(const real *RESTRICT f, real *RESTRICT z) {
    ROLLED
    for (int i = 0; i < NAME_FEATURES; i++)
        z[i] = ((f[i] - NAME_mean[i]) - NAME_mean_rest[i]) * NAME_inverse_deviation[i];
}
