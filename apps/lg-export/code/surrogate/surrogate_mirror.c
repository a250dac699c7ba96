/* -1 where the network works on the mirror image (y -> -y) of the boundary conditions x, else 1: the first
 * number that is not 0 decides. */
static real mirror_sign(const real *x) {
    real number = x[3] - x[7];
    if (number == REAL(0.0)) number = x[3];
    if (number == REAL(0.0)) number = x[5] - x[1];
    return MIRROR && number < REAL(0.0) ? REAL(-1.0) : REAL(1.0);
}

/* A number of x makes the whole curve NaN when it is not finite, one of s its point. */
static void mark_curve(const real *x, const real *s, int points, real *y) {
    if (y == NULL) return;
    mark_unfit(8, x, 2 * points, y);
    for (int i = 0; i < points; i++) mark_unfit(1, s + i, 2, y + 2 * i);
}
