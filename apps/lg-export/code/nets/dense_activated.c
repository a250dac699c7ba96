/* y = sigma(x W + b) */
static void dense_activated(const net_layer *layer, const real *x, real *y) {
    dense(layer, x, y);
    activate(layer->out, y);
}
