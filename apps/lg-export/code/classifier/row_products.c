/* dx += W dy, W (in, out): a product along each row. */
static void add_row_products(const net_layer *layer, const real *dy, real *dx) {
    const real *w = NAME_weights + layer->weight;
    ROW_BY_ROW
    for (int i = 0; i < layer->in; i++) dx[i] += dot(layer->out, w + i * layer->out, dy);
}
