/* The gate of a layer, Z = T W_o + b_o, T = sigma(H W_z + b_z). */
enum { NET_STEPS = 2 };
static void gate(const net_layer *layer, const real *h, real *t, real *z) {
    dense_activated(layer, h, t);
    dense(layer + 1, t, z);
}
