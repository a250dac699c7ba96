/* Convolutional networks on a tape. */
#include "core/core.h"
#include "nn/cnn.h"
#include "liegrad/ops.h"

/* Whether the parameters and the input x fit the network. If not, sets the tape's error. */
static bool fits(lg_tape *tape, const lg_cnn *net, size_t parameters, size_t offset, lg_var x) {
    if (lg_tape_status(tape) != LG_OK) return false;
    if (parameters > UINT32_MAX || offset > UINT32_MAX - parameters) {
        (void)lg_tape_fail(tape, LG_SHAPE, "cnn", "the parameters of the network end beyond 2^32 elements");
        return false;
    }
    if (lg_value(tape, x) == NULL) return true; /* x is a stale handle: the first operation reports it */
    const lg_shape shape = lg_var_shape(tape, x);
    if (shape.rank == 3 && shape.dims[1] == net->length && shape.dims[2] == net->channels) return true;
    (void)lg_tape_fail(tape, LG_SHAPE, "cnn", "series must be of shape (count, length, channels)");
    return false;
}

static lg_var weight(lg_tape *tape, lg_var theta, size_t offset, const cnn_layer *l) {
    const uint32_t at = (uint32_t)(offset + l->weight), in = (uint32_t)l->in;
    const lg_var flat = lg_slice(tape, theta, 0, at, in * l->out);
    if (l->kernel == 0) return lg_reshape(tape, flat, lg_shape2(in, l->out));
    return lg_reshape(tape, flat, lg_shape3(l->kernel, in / l->kernel, l->out));
}

static lg_var bias(lg_tape *tape, lg_var theta, size_t offset, const cnn_layer *l) {
    return lg_slice(tape, theta, 0, (uint32_t)(offset + l->bias), l->out);
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
    cnn_layout layout;
    lg_cnn_layout(net, &layout);
    for (uint32_t i = 0; i < CNN_MAX_LAYERS; i++) layers[i] = LG_NONE;
    if (!fits(tape, net, layout.parameters, offset, x)) return LG_NONE;
    const uint32_t count = lg_var_shape(tape, x).dims[0];
    lg_var h = x;
    for (uint32_t i = 0; i < layout.count; i++) {
        const cnn_layer *l = &layout.layer[i];
        const lg_var w = weight(tape, theta, offset, l), b = bias(tape, theta, offset, l);
        if (i < net->blocks) {
            h = block(tape, net, i, apart, w, b, h);
        } else {
            const bool last = i + 1 == layout.count;
            h = lg_reshape(tape, h, lg_shape2(count, (uint32_t)l->in));
            h = lg_dense(tape, h, w, b, last ? LG_IDENTITY : net->activation);
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
