/* The action of SE(3) on T*S^2. With w = |u|^2, c_1 = sin x/x, c_2 = (1 - cos x)/x^2, c_3 = (x - sin x)/x^3
 * at x = |u|, functions of w that are analytic at 0:
 *   exp(hat u) b = b + c_1 u x b + c_2 u x (u x b), dexp_u v = v + c_2 u x v + c_3 u x (u x v),
 *   exp(u, v) . (q, p) = (R q, R p + r x R q), R = exp(hat u), r = dexp_u v. */

/* Coefficients of c_2 and c_3 in powers of -w, 1/(2 + 2j)! and 1/(3 + 2j)!, for w <= 4. */
static const real stumpff_2[12] = {
    REAL(0.5),
    REAL(0.041666666666666667),
    REAL(0.0013888888888888889),
    REAL(2.4801587301587302e-5),
    REAL(2.7557319223985891e-7),
    REAL(2.0876756987868099e-9),
    REAL(1.1470745597729725e-11),
    REAL(4.7794773323873853e-14),
    REAL(1.5619206968586226e-16),
    REAL(4.1103176233121649e-19),
    REAL(8.8967913924505733e-22),
    REAL(1.6117375710961183e-24),
};
static const real stumpff_3[12] = {
    REAL(0.16666666666666667),    REAL(0.0083333333333333333),  REAL(0.00019841269841269841),
    REAL(2.7557319223985891e-6),  REAL(2.5052108385441719e-8),  REAL(1.6059043836821615e-10),
    REAL(7.6471637318198165e-13), REAL(2.8114572543455208e-15), REAL(8.2206352466243297e-18),
    REAL(1.9572941063391261e-20), REAL(3.868170170630684e-23),  REAL(6.4469502844843734e-26),
};

/* c_1, c_2, c_3 */
static void stumpff(real w, real *c) {
    if (w <= REAL(4.0)) {
        real even = REAL(0.0), odd = REAL(0.0);
        for (int j = STUMPFF_TERMS - 1; j >= 0; j--) {
            even = stumpff_2[j] - even * w;
            odd = stumpff_3[j] - odd * w;
        }
        c[0] = REAL(1.0) - w * odd;
        c[1] = even;
        c[2] = odd;
    } else {
        const real x = SQRT(w), half = SIN(REAL(0.5) * x);
        c[0] = SIN(x) / x;
        c[1] = REAL(2.0) * half * half / w;
        c[2] = (REAL(1.0) - c[0]) / w;
    }
}

/* out = b + g1 u x b + g2 u x (u x b); may be b */
static void so3_function(real g1, real g2, const real *u, const real *b, real *out) {
    real ub[3], uub[3];
    cross3(u, b, ub);
    cross3(u, ub, uub);
    for (int i = 0; i < 3; i++) out[i] = b[i] + (g1 * ub[i] + g2 * uub[i]);
}

/* One Newton correction of |q| = 1 and q.p = 0 where rounding is what violates them: without it rounding
 * adds up over a run. Farther points keep their distance. */
static void se3_settle(const real *r, real *y) {
    const real off = dot3(y, y) - REAL(1.0);
    real along;
    if (!(FABS(off) <= manifold_rounding)) return;
    for (int i = 0; i < 3; i++) y[i] -= REAL(0.5) * off * y[i];
    along = dot3(y, y + 3);
    if (along * along <=
        (dot3(y + 3, y + 3) + REAL(1.0) + dot3(r, r)) * (manifold_rounding * manifold_rounding))
        for (int i = 0; i < 3; i++) y[3 + i] -= along * y[i];
}

/* out = exp(a) . y, a = (u, v), y = (q, p); out may be y */
static void se3_act(const real *a, const real *y, real *out) {
    real c[3], r[3], turned[3];
    stumpff(dot3(a, a), c);
    so3_function(c[1], c[2], a, a + 3, r);
    so3_function(c[0], c[1], a, y, out);
    so3_function(c[0], c[1], a, y + 3, out + 3);
    cross3(r, out, turned);
    for (int i = 0; i < 3; i++) out[3 + i] += turned[i];
    se3_settle(r, out);
}

/* out = exp(a) . y on all links */
static void space_act(const real *a, const real *y, real *out) {
    for (int i = 0; i < LINKS; i++) se3_act(a + 6 * i, y + 6 * i, out + 6 * i);
}
