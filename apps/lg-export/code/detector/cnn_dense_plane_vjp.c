/* Derivative of output o by the numbers that enter the plane, dx. */
static NOINLINE void cnn_dense_vjp(int o, real *dx, real *work) {
    const real *slope = work + cnn_places_grad[BLOCKS].slope, *column = NAME_weights + cnn_output.weight + o;
    real *dz = work + cnn_places_grad[BLOCKS].activated;
    for (int p = 0; p < cnn_plane.out; p++) dz[p] = column[p * NAME_OUTPUTS] * slope[p];
    for (int i = 0; i < cnn_plane.in; i++) dx[i] = REAL(0.0);
    add_row_products(&cnn_plane, dz, dx);
}
