/* y (outputs; or NULL) and dy = (dy/dx) dx. */
static void net_jvp(const real *x, const real *dx, real *y, real *dy, real *work) {
    real *h = work + NET_H, *z = work + NET_Z, *dh = work + NET_H_D, *dz = work + NET_Z_D;
    const real *a = x, *da = dx;
    net_input_jvp(&a, &da, work);
    dense_pair_activated(&net_layers[NET_FIRST], a, da, h, dh, work);
    for (int l = NET_FIRST + 1; l < NET_LAST; l += 2) {
        dense_pair_activated(&net_layers[l], h, dh, z, dz, work);
        dense_add_pair(NET_HIDDEN, NET_HIDDEN, NAME_weights + net_layers[l + 1].weight, z, dz, h, dh);
    }
    dense_pair(&net_layers[NET_LAST], h, dh, y != NULL ? y : work + NET_SLOPE, dy);
}
