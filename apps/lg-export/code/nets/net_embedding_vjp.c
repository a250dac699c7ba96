/* Where the cotangent of what the layers read is to lie, and from there to that of the input. */
static real *net_input_cotangent(real *dx, real *work) {
    (void)dx;
    return work + NET_EMBEDDED_D;
}
static void net_input_vjp(real *dx, real *work) {
    real *de = work + NET_EMBEDDED_D;
    for (int j = 0; j < NET_EMBEDDING; j++) de[j] *= TWO_PI * COS(work[NET_ANGLE + j]);
    dense_transposed(&net_layers[0], de, dx);
}
