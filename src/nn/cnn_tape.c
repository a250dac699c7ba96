/* Convolutional networks on a tape. */
#include "core/core.h"
#include "nn/cnn.h"
#include "liegrad/ops.h"

/* Whether the input x fits the network. If not, sets the tape's error. */
static bool fits(lg_tape *tape, const lg_cnn *net, lg_var x) {
    if (lg_value(tape, x) == NULL) return true; /* x is a stale handle: the first operation reports it */
    const lg_shape shape = lg_var_shape(tape, x);
    if (shape.rank == 3 && shape.dims[1] == net->length && shape.dims[2] == net->channels) return true;
    (void)lg_tape_fail(tape, LG_SHAPE, "cnn", "series must be of shape (count, length, channels)");
    return false;
}

/* Convolution, activation and average pooling of block i. `apart`: as separate operations. */
static lg_var convolve(lg_tape *tape, const lg_cnn *net, uint32_t i, bool apart, lg_var w, lg_var b,
                       lg_var x) {
    const lg_cnn_block *it = &net->block[i];
    const bool average = it->pooling == LG_POOL_AVERAGE;
    const uint32_t size = average ? it->pool_size : 1, step = average ? it->pool_stride : 1;
    if (!apart) return lg_conv1d_pooled(tape, x, w, b, it->stride, it->padding, net->activation, size, step);
    const lg_var z = lg_add(tape, lg_conv1d(tape, x, w, it->stride, it->padding), b);
    const lg_var y = lg_act(tape, z, net->activation);
    return average ? lg_avg_pool1d(tape, y, size, step) : y;
}

static lg_var block(lg_tape *tape, const lg_cnn *net, uint32_t i, bool apart, lg_var w, lg_var b, lg_var x) {
    const lg_cnn_block *it = &net->block[i];
    const lg_var y = convolve(tape, net, i, apart, w, b, x);
    return it->pooling == LG_POOL_MAX ? lg_max_pool1d(tape, y, it->pool_size, it->pool_stride) : y;
}

static lg_var record(lg_tape *tape, const lg_cnn *net, bool apart, lg_var theta, size_t offset, lg_var x,
                     lg_var layers[CNN_MAX_LAYERS]) {
    const lg_layers layout = lg_cnn_layers(net);
    lg_var w[CNN_MAX_LAYERS], b[CNN_MAX_LAYERS];
    for (uint32_t i = 0; i < CNN_MAX_LAYERS; i++) layers[i] = LG_NONE;
    if (lg_layers_bind(tape, &layout, "cnn", theta, offset, w, b) != LG_OK || !fits(tape, net, x))
        return LG_NONE;
    const uint32_t count = lg_var_shape(tape, x).dims[0];
    lg_var h = x;
    for (uint32_t i = 0; i < layout.count; i++) {
        if (i < net->blocks) {
            h = block(tape, net, i, apart, w[i], b[i], h);
        } else {
            const bool last = i + 1 == layout.count;
            h = lg_reshape(tape, h, lg_shape2(count, (uint32_t)layout.layer[i].in));
            h = lg_dense(tape, h, w[i], b[i], last ? LG_IDENTITY : net->activation);
        }
        layers[i] = h;
    }
    return h;
}

lg_var lg_cnn_record_layers(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x,
                            lg_var layers[CNN_MAX_LAYERS]) {
    return record(tape, net, false, theta, offset, x, layers);
}

lg_var lg_cnn_record(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x, lg_var *plane) {
    lg_var layers[CNN_MAX_LAYERS];
    const lg_var y = record(tape, net, false, theta, offset, x, layers);
    if (plane != NULL) *plane = net->plane > 0 && !lg_is_none(y) ? layers[net->blocks] : LG_NONE;
    return y;
}

lg_var lg_cnn_record_apart(lg_tape *tape, const lg_cnn *net, lg_var theta, lg_var x) {
    lg_var layers[CNN_MAX_LAYERS];
    return record(tape, net, true, theta, 0, x, layers);
}
