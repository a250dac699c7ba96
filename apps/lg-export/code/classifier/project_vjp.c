/* The cotangent of the features from that of their components. */
static void project_vjp(const real *dp, real *dz) {
    for (int i = 0; i < NAME_FEATURES; i++) dz[i] = REAL(0.0);
    add_row_products(&components, dp, dz);
    for (int i = 0; i < NAME_FEATURES; i++) dz[i] *= NAME_inverse_deviation[i];
}
