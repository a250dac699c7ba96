/* y (outputs); H <- H + sigma(H A + b) B in place. */
static void net_value(const real *x, real *y, real *work) {
    real *h = work + NET_H, *z = work + NET_Z;
    dense_activated(&net_layers[NET_FIRST], net_input(x, work), h);
    for (int l = NET_FIRST + 1; l < NET_LAST; l += 2) {
        dense_activated(&net_layers[l], h, z);
        dense_add(NET_HIDDEN, NET_HIDDEN, NAME_weights + net_layers[l + 1].weight, z, h);
    }
    dense(&net_layers[NET_LAST], h, y);
}
