/* B_j/j!, the Bernoulli numbers' */
static const real dexpinv_series[11] = {
    REAL(1.0),
    REAL(-0.5),
    REAL(0.083333333333333333),
    REAL(0.0),
    REAL(-0.0013888888888888889),
    REAL(0.0),
    REAL(3.3068783068783069e-5),
    REAL(0.0),
    REAL(-8.2671957671957672e-7),
    REAL(0.0),
    REAL(2.0876756987868099e-8),
};

/* b <- sum_{j <= DEXPINV_TERMS} B_j/j! ad_a^j b on each link: dexp_a^-1 b, truncated */
static void space_dexpinv(const real *a, real *b) {
    for (int i = 0; i < LINKS; i++) {
        real term[6];
        for (int c = 0; c < 6; c++) term[c] = b[6 * i + c];
        for (int j = 1; j <= DEXPINV_TERMS; j++) {
            se3_bracket(a + 6 * i, term, term);
            for (int c = 0; c < 6; c++) b[6 * i + c] += dexpinv_series[j] * term[c];
        }
    }
}
