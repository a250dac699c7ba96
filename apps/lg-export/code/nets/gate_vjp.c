static void gate_kept(const net_layer *layer, const real *h, real *t, real *z, real *slope) {
    (void)t;
    dense_kept(layer, h, z, slope);
}

/* From the gate's cotangent, which is overwritten, to that of H. */
static void gate_vjp(const net_layer *layer, const real *slope, real *dz, real *t, real *dh) {
    (void)t;
    scale_by(NET_HIDDEN, slope, dz);
    dense_transposed(layer, dz, dh);
}
