/* y (outputs); H <- (1 - Z) o U + Z o V. */
static void net_value(const real *x, real *y, real *work) {
    real *u = work + NET_U, *v = work + NET_V, *h = work + NET_H, *z = work + NET_Z;
    const real *a = net_input(x, work);
    dense_activated(&net_layers[NET_FIRST], a, u);
    dense_activated(&net_layers[NET_FIRST + 1], a, v);
    dense_activated(&net_layers[NET_FIRST + 2], a, h);
    for (int l = NET_FIRST + 3; l < NET_LAST; l += NET_STEPS) {
        gate(&net_layers[l], h, work + NET_T, z);
        for (int j = 0; j < NET_HIDDEN; j++) h[j] = (REAL(1.0) - z[j]) * u[j] + z[j] * v[j];
    }
    dense(&net_layers[NET_LAST], h, y);
}
