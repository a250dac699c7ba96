static void gate_kept(const net_layer *layer, const real *h, real *t, real *z, real *slope) {
    dense_kept(layer, h, t, slope);
    dense(layer + 1, t, z);
}

/* From the gate's cotangent, which is overwritten, to that of H. */
static void gate_vjp(const net_layer *layer, const real *slope, real *dz, real *t, real *dh) {
    dense_transposed(layer + 1, dz, t);
    scale_by(NET_HIDDEN, slope, t);
    dense_transposed(layer, t, dh);
}
