/* out = b + g1 u x b + g2 u x (u x b); out may be b. */
static void so3_function(real g1, real g2, const real *u, const real *b, real *out) {
    real ub[3];
    real uub[3];
    cross3(u, b, ub);
    cross3(u, ub, uub);
    for (int i = 0; i < 3; i++) out[i] = b[i] + (g1 * ub[i] + g2 * uub[i]);
}
