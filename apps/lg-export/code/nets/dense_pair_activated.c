/* y = sigma(x W + b) and its derivative in direction dx. */
static void dense_pair_activated(const net_layer *layer, const real *x, const real *dx, real *y, real *dy,
                                 real *work) {
    dense_pair(layer, x, dx, y, dy);
    activate_slope(layer->out, y, work + NET_SLOPE);
    scale_by(layer->out, work + NET_SLOPE, dy);
}
