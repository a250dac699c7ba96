/* The gate of a layer, Z = sigma(H W_z + b_z); `t` is not used. */
enum { NET_STEPS = 1 };
static void gate(const net_layer *layer, const real *h, real *t, real *z) {
    (void)t;
    dense_activated(layer, h, z);
}
