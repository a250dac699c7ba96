/* y = W g */
static void dense_transposed(const net_layer *layer, const real *RESTRICT g, real *RESTRICT y) {
    const int in = layer->in, out = layer->out;
    const real *RESTRICT w = NAME_weights + layer->weight;
    if (out == 1)
        for (int i = 0; i < in; i++) y[i] = w[i] * g[0];
    else
        for (int i = 0; i < in; i++, w += out) y[i] = dot(out, w, g);
}
