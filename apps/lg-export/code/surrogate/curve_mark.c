/* A number of x makes the whole curve NaN when it is not finite, one of s its point. */
static void mark_curve(const real *x, const real *s, int points, real *y) {
    if (y == NULL) return;
    mark_unfit(8, x, 2 * points, y);
    for (int i = 0; i < points; i++) mark_unfit(1, s + i, 2, y + 2 * i);
}
