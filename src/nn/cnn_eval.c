/* Convolutional networks without a tape: products, activations and sums by the kernels, in the caller's
 * memory. What a kernel covers of a series (L, C) lies contiguous, stride C numbers from one place to the
 * next: a convolution is one product with overlapping rows. Zeros of a padding are laid around a block's
 * input when it is written. */
#include <string.h>

#include "nn/cnn.h"
#include "nn/eval.h"

/* Where the pieces of `work` lie. */
typedef struct run {
    const lg_cnn *net;
    const lg_kernels *k;
    const char *theta;
    cnn_layout layout;
    char *input[2];  /* of blocks, in turn: (L + 2p, C) */
    char *convolved; /* (L', O), where pooling follows */
    char *plane;     /* (plane) */
} run;

static size_t most(size_t a, size_t b) {
    return a > b ? a : b;
}

/* With `work` NULL only *bytes is of use. */
static run run_over(const lg_cnn *net, lg_dtype dtype, const void *theta, void *work, size_t *bytes) {
    run r = {.net = net, .k = lg_kernels_for(dtype), .theta = theta};
    char *rest = work;
    size_t input = 0, convolved = 0;
    lg_cnn_layout(net, &r.layout);
    for (uint32_t i = 0; i <= net->blocks; i++) {
        const size_t padding = i < net->blocks ? net->block[i].padding : 0;
        if (i > 0 || padding > 0) input = most(input, (net->lengths[i] + 2 * padding) * cnn_channels(net, i));
        if (i < net->blocks && net->block[i].pooling != LG_POOL_NONE)
            convolved = most(convolved, (size_t)cnn_convolved(net, i) * net->block[i].channels);
    }
    *bytes = 0;
    r.input[0] = eval_take(&rest, bytes, input * r.k->size);
    r.input[1] = eval_take(&rest, bytes, input * r.k->size);
    r.convolved = eval_take(&rest, bytes, convolved * r.k->size);
    r.plane = eval_take(&rest, bytes, net->plane * r.k->size);
    return r;
}

size_t lg_cnn_work_size(const lg_cnn *net, lg_dtype dtype) {
    size_t bytes;
    (void)run_over(net, dtype, NULL, NULL, &bytes);
    return bytes;
}

static const void *weight(const run *r, uint32_t i) {
    return r->theta + r->layout.layer[i].weight * r->k->size;
}

static const void *bias(const run *r, uint32_t i) {
    return r->theta + r->layout.layer[i].bias * r->k->size;
}

/* Where the samples of block i's input begin behind the zeros of its padding, which are written. */
static char *open_input(const run *r, uint32_t i, char *buffer) {
    const size_t padding = i < r->net->blocks ? r->net->block[i].padding : 0;
    const size_t row = cnn_channels(r->net, i) * r->k->size;
    if (padding > 0) {
        memset(buffer, 0, padding * row);
        memset(buffer + (padding + r->net->lengths[i]) * row, 0, padding * row);
    }
    return buffer + padding * row;
}

/* x with its padding -> y (L'', O) */
static void run_block(const run *r, uint32_t i, const void *x, char *y) {
    const lg_cnn_block *b = &r->net->block[i];
    const size_t length = cnn_convolved(r->net, i), o = b->channels, in = r->layout.layer[i].in;
    char *convolved = b->pooling == LG_POOL_NONE ? y : r->convolved;
    r->k->gemm(length, o, in, x, (size_t)b->stride * cnn_channels(r->net, i), 1, weight(r, i), o, convolved,
               o, false);
    r->k->bias_act((lg_k_act)r->net->activation, length, o, bias(r, i), convolved);
    const lg_k_windows windows = {.length = length,
                                  .channels = o,
                                  .size = b->pool_size,
                                  .stride = b->pool_stride,
                                  .count = r->net->lengths[i + 1]};
    if (b->pooling == LG_POOL_AVERAGE) r->k->window_mean(&windows, 1, convolved, y);
    if (b->pooling == LG_POOL_MAX) r->k->window_pick(&windows, 1, convolved, convolved, y);
}

/* All blocks; returns what the layers behind them read. */
static const void *run_blocks(const run *r, const void *x) {
    const lg_cnn *net = r->net;
    const void *input = x;
    if (net->blocks > 0 && net->block[0].padding > 0) {
        memcpy(open_input(r, 0, r->input[0]), x, (size_t)net->length * net->channels * r->k->size);
        input = r->input[0];
    }
    for (uint32_t i = 0; i < net->blocks; i++) {
        char *next = r->input[(i + 1) % 2];
        run_block(r, i, input, open_input(r, i + 1, next));
        input = next;
    }
    return input;
}

static void dense(const run *r, uint32_t i, lg_activation kind, const void *x, void *y) {
    const cnn_layer *l = &r->layout.layer[i];
    if (l->out == 1)
        r->k->matvec(1, l->in, x, weight(r, i), y, false);
    else
        eval_multiply(r->k, 1, l->in, l->out, x, weight(r, i), y, false);
    r->k->bias_act((lg_k_act)kind, 1, l->out, bias(r, i), y);
}

static void eval_one(const run *r, const void *x, void *y, void *plane) {
    const lg_cnn *net = r->net;
    const void *input = run_blocks(r, x);
    if (net->plane > 0) {
        void *out = plane != NULL ? plane : r->plane;
        dense(r, net->blocks, net->activation, input, out);
        input = out;
    }
    dense(r, r->layout.count - 1, LG_IDENTITY, input, y);
}

void lg_cnn_eval(const lg_cnn *net, lg_dtype dtype, const void *theta, const void *x, size_t rows, void *y,
                 void *plane, void *work) {
    size_t bytes;
    const run r = run_over(net, dtype, theta, work, &bytes);
    const size_t in = (size_t)net->length * net->channels * r.k->size;
    const size_t out = net->outputs * r.k->size, wide = net->plane * r.k->size;
    for (size_t i = 0; i < rows; i++)
        eval_one(&r, (const char *)x + i * in, (char *)y + i * out,
                 plane != NULL ? (char *)plane + i * wide : NULL);
}
