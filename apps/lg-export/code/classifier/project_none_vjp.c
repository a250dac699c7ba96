/* The cotangent of the features from that of the standardised ones. */
static void project_vjp(const real *dp, real *dz) {
    ROLLED
    for (int i = 0; i < NAME_FEATURES; i++) dz[i] = dp[i] * NAME_inverse_deviation[i];
}
