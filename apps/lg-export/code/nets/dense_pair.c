/* y += x W and dy += dx W: the weights are read once. */
static NOINLINE void dense_add_pair(int in, int out, const real *RESTRICT w, const real *RESTRICT x,
                                    const real *RESTRICT dx, real *RESTRICT y, real *RESTRICT dy) {
    int i = 0;
    if (out == 1) {
        y[0] += dot(in, w, x);
        dy[0] += dot(in, w, dx);
        return;
    }
    for (; i + 4 <= in; i += 4, w += 4 * out) {
        const real *RESTRICT w1 = w + out, *RESTRICT w2 = w1 + out, *RESTRICT w3 = w2 + out;
        const real x0 = x[i], x1 = x[i + 1], x2 = x[i + 2], x3 = x[i + 3];
        const real d0 = dx[i], d1 = dx[i + 1], d2 = dx[i + 2], d3 = dx[i + 3];
        for (int j = 0; j < out; j++) {
            y[j] += (x0 * w[j] + x1 * w1[j]) + (x2 * w2[j] + x3 * w3[j]);
            dy[j] += (d0 * w[j] + d1 * w1[j]) + (d2 * w2[j] + d3 * w3[j]);
        }
    }
    for (; i < in; i++, w += out)
        for (int j = 0; j < out; j++) {
            y[j] += x[i] * w[j];
            dy[j] += dx[i] * w[j];
        }
}

/* y = x W + b, dy = dx W */
static void dense_pair(const net_layer *layer, const real *x, const real *dx, real *y, real *dy) {
    for (int j = 0; j < layer->out; j++) {
        y[j] = layer->bias < 0 ? REAL(0.0) : NAME_weights[layer->bias + j];
        dy[j] = REAL(0.0);
    }
    dense_add_pair(layer->in, layer->out, NAME_weights + layer->weight, x, dx, y, dy);
}
