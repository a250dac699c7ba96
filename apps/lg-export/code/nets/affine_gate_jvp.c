static void gate_jvp(const net_layer *layer, const real *h, const real *dh, real *z, real *dz, real *work) {
    dense_pair_activated(layer, h, dh, work + NET_T, work + NET_T_D, work);
    dense_pair(layer + 1, work + NET_T, work + NET_T_D, z, dz);
}
