/* dexp_a^-1 b on se(3), a = (u, v): with x = [a, b], xx = [a, x] and w = |u|^2
 *   b - x/2 + g xx, and (u.v) 2 g' times the rotational part of xx on the translational part,
 * g = (1 - q)/w, q = (x/2) cot(x/2) at x = |u|; 2 w q' = q - q^2 - w/4. The pole |u| = 2 pi is the map's. */

/* g less its first pole, 2/(4 pi^2 - w), in powers of w for w <= 4. */
static const real pole_rest[11] = {
    REAL(0.032672741512164448),   REAL(0.00010564110705334699), REAL(5.6373702828768453e-7),
    REAL(3.3571419266574514e-9),  REAL(2.0742872904166046e-11), REAL(1.3000482138698974e-13),
    REAL(8.1960520556910086e-16), REAL(5.1801181961697243e-18), REAL(3.2775391747017918e-20),
    REAL(2.0747401878593605e-22), REAL(1.3136241807166534e-24),
};

/* g and 2 g' */
static void dexpinv_coefficients(real w, real *g) {
    if (w <= REAL(4.0)) {
        const real pole = REAL(1.0) / (REAL(39.478417604357434) - w);
        real rest = REAL(0.0), slope = REAL(0.0);
        for (int j = DEXPINV_TERMS - 1; j >= 0; j--) {
            slope = slope * w + rest;
            rest = rest * w + pole_rest[j];
        }
        g[0] = REAL(2.0) * pole + rest;
        g[1] = REAL(4.0) * pole * pole + REAL(2.0) * slope;
    } else {
        const real half = REAL(0.5) * SQRT(w), q = half * COS(half) / SIN(half);
        g[0] = (REAL(1.0) - q) / w;
        g[1] = -((q - q * q - REAL(0.25) * w) / w + REAL(2.0) * g[0]) / w;
    }
}

/* b <- dexp_a^-1 b */
static void se3_dexpinv(const real *a, real *b) {
    const real rho = dot3(a, a + 3);
    real g[2], x[6], xx[6];
    dexpinv_coefficients(dot3(a, a), g);
    se3_bracket(a, b, x);
    se3_bracket(a, x, xx);
    for (int i = 0; i < 6; i++) b[i] += g[0] * xx[i] - REAL(0.5) * x[i];
    for (int i = 0; i < 3; i++) b[3 + i] += rho * g[1] * xx[i];
}

static void space_dexpinv(const real *a, real *b) {
    for (int i = 0; i < LINKS; i++) se3_dexpinv(a + 6 * i, b + 6 * i);
}
