/* y (outputs). Hidden values alternate between two places. */
static void net_value(const real *x, real *y, real *work) {
    const real *a = net_input(x, work);
    for (int l = NET_FIRST; l < NET_LAST; l++) {
        real *z = work + NET_SIDES + l % 2 * NET_WIDEST;
        dense_activated(&net_layers[l], a, z);
        a = z;
    }
    dense(&net_layers[NET_LAST], a, y);
}
