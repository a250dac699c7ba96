/* y = sigma(x W + b), and sigma' there. */
static void dense_kept(const net_layer *layer, const real *x, real *y, real *slope) {
    dense(layer, x, y);
    activate_slope(layer->out, y, slope);
}
