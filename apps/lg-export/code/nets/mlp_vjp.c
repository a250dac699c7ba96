/* y (outputs; or NULL) and dx = sum over outputs of cotangent dy/dx. */
static void net_vjp(const real *x, const real *cotangent, real *y, real *dx, real *work) {
    const real *a = net_input(x, work), *g = cotangent;
    real *slope = work + NET_SLOPES;
    for (int l = NET_FIRST; l < NET_LAST; l++) {
        real *z = work + NET_SIDES + l % 2 * NET_WIDEST;
        dense_kept(&net_layers[l], a, z, slope);
        slope += net_layers[l].out;
        a = z;
    }
    if (y != NULL) dense(&net_layers[NET_LAST], a, y);
    for (int l = NET_LAST; l > NET_FIRST; l--) {
        real *h = work + NET_SIDES + l % 2 * NET_WIDEST;
        dense_transposed(&net_layers[l], g, h);
        slope -= net_layers[l].in;
        scale_by(net_layers[l].in, slope, h);
        g = h;
    }
    dense_transposed(&net_layers[NET_FIRST], g, net_input_cotangent(dx, work));
    net_input_vjp(dx, work);
}
