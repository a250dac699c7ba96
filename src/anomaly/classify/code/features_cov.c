/* The centred scaled channels, (SELECTED, LENGTH). */
static void centre_channels(FOR_WINDOW const real *x, real *z) {
    for (int i = 0; i < SELECTED; i++)
        (void)centre_numbers(NAME_LENGTH, INVERSE_SCALE(NAME_select[i]), x + NAME_select[i] * NAME_LENGTH,
                             z + i * NAME_LENGTH);
}

/* g (SELECTED, SELECTED): rows s_k u_k of the singular values and left vectors of the channels; z as
 * centre_channels has made it, destroyed. */
static void singular_rows(FOR_WINDOW real *z, real *g) {
    factor_rows(SELECTED, NAME_LENGTH, z, g);
    rotate_rows(SELECTED, g);
}

/* The upper triangle, row by row, of the symmetric square root of the channels' covariance, sum over k of
 * u_k s_k u_k^T/sqrt(length). work: SELECTED (LENGTH + SELECTED). */
static void compute_features(FOR_WINDOW const real *x, real *f, real *work) {
    real *g = work + SELECTED * NAME_LENGTH;
    centre_channels(OF_WINDOW x, work);
    singular_rows(OF_WINDOW work, g);
    for (int e = 0; e < NAME_FEATURES; e++) f[e] = REAL(0.0);
    for (int k = 0; k < SELECTED; k++) {
        const real *row = g + k * SELECTED;
        const real norm = SQRT(dot_of(SELECTED, row, row)),
                   factor = norm > REAL(0.0) ? REAL(1.0) / norm / SQRT((real)NAME_LENGTH) : norm;
        for (int i = 0, e = 0; i < SELECTED; i++)
            for (int j = i; j < SELECTED; j++) f[e++] += row[i] * factor * row[j];
    }
}
