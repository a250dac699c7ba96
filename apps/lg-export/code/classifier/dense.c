/* A dense layer: where its weights (in, out) and its bias (out; -1: none) begin in NAME_weights. */
typedef struct net_layer {
    int in, out, weight, bias;
} net_layer;

/* y = x W + b */
static void dense(const net_layer *layer, const real *x, real *y) {
    for (int j = 0; j < layer->out; j++) y[j] = layer->bias < 0 ? REAL(0.0) : NAME_weights[layer->bias + j];
    dense_add(layer->in, layer->out, NAME_weights + layer->weight, x, y);
}
