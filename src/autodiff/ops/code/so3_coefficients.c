/* c[k] = c_k(w), k = 1, 2, 3: sin(x)/x, (1 - cos(x))/x^2, (x - sin(x))/x^3, x = sqrt(w). The Stumpff
 * functions c_2 and c_3 for 0 <= w <= 4 by the series sum_i (-w)^i/(k + 2i)!, with as many terms as the
 * type can resolve. */
static const real stumpff_2[12] = {REAL(0.5),
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
                                   REAL(1.6117375710961183e-24)};
static const real stumpff_3[12] = {
    REAL(0.16666666666666667),    REAL(0.0083333333333333333),  REAL(0.00019841269841269841),
    REAL(2.7557319223985891e-6),  REAL(2.5052108385441719e-8),  REAL(1.6059043836821615e-10),
    REAL(7.6471637318198165e-13), REAL(2.8114572543455208e-15), REAL(8.2206352466243297e-18),
    REAL(1.9572941063391261e-20), REAL(3.868170170630684e-23),  REAL(6.4469502844843734e-26)};
static void so3_coefficients(real w, real *c) {
    if (w <= REAL(4.0)) {
        real even = REAL(0.0);
        real odd = REAL(0.0);
        for (int i = sizeof w == sizeof(float) ? 6 : 11; i >= 0; i--) {
            even = stumpff_2[i] - w * even;
            odd = stumpff_3[i] - w * odd;
        }
        c[1] = REAL(1.0) - w * odd;
        c[2] = even;
        c[3] = odd;
    } else {
        const real x = SQRT(w);
        const real half = SIN(REAL(0.5) * x);
        c[1] = SIN(x) / x;
        c[2] = REAL(2.0) * half * half / w;
        c[3] = (REAL(1.0) - c[1]) / w;
    }
}
