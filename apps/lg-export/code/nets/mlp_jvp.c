/* y (outputs; or NULL) and dy = (dy/dx) dx. */
static void net_jvp(const real *x, const real *dx, real *y, real *dy, real *work) {
    const real *a = x, *da = dx;
    net_input_jvp(&a, &da, work);
    for (int l = NET_FIRST; l < NET_LAST; l++) {
        real *z = work + NET_SIDES + l % 2 * NET_WIDEST, *dz = work + NET_SIDES_D + l % 2 * NET_WIDEST;
        dense_pair_activated(&net_layers[l], a, da, z, dz, work);
        a = z;
        da = dz;
    }
    dense_pair(&net_layers[NET_LAST], a, da, y != NULL ? y : work + NET_SLOPE, dy);
}
