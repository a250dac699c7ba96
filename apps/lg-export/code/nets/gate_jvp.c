static void gate_jvp(const net_layer *layer, const real *h, const real *dh, real *z, real *dz, real *work) {
    dense_pair_activated(layer, h, dh, z, dz, work);
}
