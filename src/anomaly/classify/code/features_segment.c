/* s (SEGMENT): segment `number` of z (LENGTH) under its window. */
static void taper_segment(FOR_WINDOW int number, const real *z, real *s) {
    for (int t = 0; t < SEGMENT; t++) s[t] = NAME_taper[t] * z[number * HOP + t];
}

/* The sums of s_t cos(2 pi bin t/SEGMENT) and of s_t sin. */
static void transform_segment(FOR_WINDOW int bin, const real *s, real *re, real *im) {
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
static real band_squares(FOR_WINDOW int band) {
    return (real)(SEGMENTS * (NAME_edge[band + 1] - NAME_edge[band]));
}
