/* Convolutional networks without a tape: products, activations and sums by the kernels, in the caller's
 * memory. What a kernel covers of a series (L, C) lies contiguous, stride C numbers from one place to the
 * next: a convolution is one product with overlapping rows. Zeros of a padding are laid around a block's
 * input when it is written. */
#include <string.h>

#include "kernels/conv.h"
#include "nn/cnn.h"
#include "nn/eval.h"

/* Where the pieces of `work` lie. What is said to be of gradients is NULL in plain evaluation. */
typedef struct run {
    const lg_cnn *net;
    const lg_kernels *k;
    const char *theta;
    cnn_layout layout;
    char *input[2];                     /* of blocks, in turn: (L + 2p, C) */
    char *activated[LG_CNN_MAX_BLOCKS]; /* (L', O), where pooling follows; gradients: kept for a maximum */
    char *plane;                        /* (plane) */
    char *slope[LG_CNN_MAX_BLOCKS + 1]; /* gradients: sigma' (L', O) of each block, (plane) behind them */
    char *cotangent[2];                 /* gradients: of what a block gives or reads, of its convolution */
    char *transposed, *scratch;         /* gradients: the largest W^T and what lg_conv_input asks for */
} run;

static size_t most(size_t a, size_t b) {
    return a > b ? a : b;
}

static lg_k_windows pool_of(const lg_cnn *net, uint32_t i) {
    const lg_cnn_block *b = &net->block[i];
    return (lg_k_windows){.length = cnn_convolved(net, i),
                          .channels = b->channels,
                          .size = b->pool_size,
                          .stride = b->pool_stride,
                          .count = net->lengths[i + 1]};
}

/* The convolution of block i, with the pooling behind it where that is an average. */
static lg_conv conv_of(const lg_cnn *net, uint32_t i) {
    const lg_cnn_block *b = &net->block[i];
    lg_conv conv = {.windows = {.length = net->lengths[i],
                                .channels = cnn_channels(net, i),
                                .size = b->kernel,
                                .stride = b->stride,
                                .padding = b->padding,
                                .count = cnn_convolved(net, i)},
                    .batch = 1,
                    .outputs = b->channels};
    if (b->pooling == LG_POOL_AVERAGE) conv.pool = pool_of(net, i);
    return conv;
}

static size_t convolved_numbers(const lg_cnn *net, uint32_t i) {
    return (size_t)cnn_convolved(net, i) * net->block[i].channels;
}

static void take_activated(run *r, bool gradient, char **rest, size_t *bytes) {
    size_t shared = 0;
    for (uint32_t i = 0; i < r->net->blocks; i++)
        if (r->net->block[i].pooling != LG_POOL_NONE) shared = most(shared, convolved_numbers(r->net, i));
    char *piece = eval_take(rest, bytes, shared * r->k->size);
    for (uint32_t i = 0; i < r->net->blocks; i++) {
        const bool keep = gradient && r->net->block[i].pooling == LG_POOL_MAX;
        r->activated[i] = keep ? eval_take(rest, bytes, convolved_numbers(r->net, i) * r->k->size) : piece;
    }
}

static void take_gradient(run *r, char **rest, size_t *bytes) {
    const lg_cnn *net = r->net;
    size_t cotangent = net->plane, transposed = 0, scratch = 0;
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_conv conv = conv_of(net, i);
        const size_t out = convolved_numbers(net, i), in = (size_t)net->lengths[i] * cnn_channels(net, i);
        r->slope[i] = eval_take(rest, bytes, out * r->k->size);
        cotangent = most(cotangent, most(out, in));
        transposed = most(transposed, r->layout.layer[i].in * r->layout.layer[i].out);
        scratch = most(scratch, lg_conv_input_scratch(&conv));
    }
    r->slope[net->blocks] = eval_take(rest, bytes, net->plane * r->k->size);
    for (size_t i = 0; i < LG_COUNT(r->cotangent); i++)
        r->cotangent[i] = eval_take(rest, bytes, cotangent * r->k->size);
    r->transposed = eval_take(rest, bytes, transposed * r->k->size);
    r->scratch = eval_take(rest, bytes, scratch * r->k->size);
}

/* With `work` NULL only *bytes is of use. */
static run run_over(const lg_cnn *net, lg_dtype dtype, const void *theta, bool gradient, void *work,
                    size_t *bytes) {
    run r = {.net = net, .k = lg_kernels_for(dtype), .theta = theta};
    char *rest = work;
    size_t input = 0;
    lg_cnn_layout(net, &r.layout);
    for (uint32_t i = 0; i <= net->blocks; i++) {
        const size_t padding = i < net->blocks ? net->block[i].padding : 0;
        if (i > 0 || padding > 0) input = most(input, (net->lengths[i] + 2 * padding) * cnn_channels(net, i));
    }
    *bytes = 0;
    r.input[0] = eval_take(&rest, bytes, input * r.k->size);
    r.input[1] = eval_take(&rest, bytes, input * r.k->size);
    take_activated(&r, gradient, &rest, bytes);
    r.plane = eval_take(&rest, bytes, net->plane * r.k->size);
    if (gradient) take_gradient(&r, &rest, bytes);
    return r;
}

size_t lg_cnn_work_size(const lg_cnn *net, lg_dtype dtype) {
    size_t bytes;
    (void)run_over(net, dtype, NULL, false, NULL, &bytes);
    return bytes;
}

size_t lg_cnn_gradient_work_size(const lg_cnn *net, lg_dtype dtype) {
    size_t bytes;
    (void)run_over(net, dtype, NULL, true, NULL, &bytes);
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

/* y = sigma(z + b); z stands in y, or in `slope`, where sigma'(z + b) takes its place. */
static void activate(const run *r, lg_activation kind, size_t rows, size_t n, const void *b, char *slope,
                     void *y) {
    if (slope != NULL)
        r->k->act_slope((lg_k_act)kind, rows, n, b, slope, y);
    else
        r->k->bias_act((lg_k_act)kind, rows, n, b, y);
}

/* x with its padding -> y (L'', O) */
static void run_block(const run *r, uint32_t i, const void *x, char *y) {
    const lg_cnn_block *b = &r->net->block[i];
    const size_t length = cnn_convolved(r->net, i), o = b->channels, in = r->layout.layer[i].in;
    const lg_k_windows windows = pool_of(r->net, i);
    char *activated = b->pooling == LG_POOL_NONE ? y : r->activated[i];
    char *z = r->slope[i] != NULL ? r->slope[i] : activated;
    r->k->gemm(length, o, in, x, (size_t)b->stride * cnn_channels(r->net, i), 1, weight(r, i), o, z, o,
               false);
    activate(r, r->net->activation, length, o, bias(r, i), r->slope[i], activated);
    if (b->pooling == LG_POOL_AVERAGE) r->k->window_mean(&windows, 1, activated, y);
    if (b->pooling == LG_POOL_MAX) r->k->window_pick(&windows, 1, activated, activated, y);
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

/* Of layer i; slope as for activate(). */
static void dense(const run *r, uint32_t i, lg_activation kind, const void *x, char *slope, void *y) {
    const cnn_layer *l = &r->layout.layer[i];
    void *z = slope != NULL ? (void *)slope : y;
    if (l->out == 1)
        r->k->matvec(1, l->in, x, weight(r, i), z, false);
    else
        eval_multiply(r->k, 1, l->in, l->out, x, weight(r, i), z, false);
    activate(r, kind, 1, l->out, bias(r, i), slope, y);
}

static void eval_one(const run *r, const void *x, void *y, void *plane) {
    const lg_cnn *net = r->net;
    const void *input = run_blocks(r, x);
    if (net->plane > 0) {
        void *out = plane != NULL ? plane : r->plane;
        dense(r, net->blocks, net->activation, input, r->slope[net->blocks], out);
        input = out;
    }
    if (y != NULL) dense(r, r->layout.count - 1, LG_IDENTITY, input, NULL, y);
}

void lg_cnn_eval(const lg_cnn *net, lg_dtype dtype, const void *theta, const void *x, size_t rows, void *y,
                 void *plane, void *work) {
    size_t bytes;
    const run r = run_over(net, dtype, theta, false, work, &bytes);
    const size_t in = (size_t)net->length * net->channels * r.k->size;
    const size_t out = net->outputs * r.k->size, wide = net->plane * r.k->size;
    for (size_t i = 0; i < rows; i++)
        eval_one(&r, (const char *)x + i * in, (char *)y + i * out,
                 plane != NULL ? (char *)plane + i * wide : NULL);
}

/* ---- input gradient ---- */

/* y (in) = W g (out) of a dense layer */
static void dense_back(const run *r, uint32_t i, const void *g, void *y) {
    const cnn_layer *l = &r->layout.layer[i];
    eval_multiply_transposed(r->k, 1, l->in, l->out, g, weight(r, i), NULL, y, false);
}

/* From g, the cotangent of what block i gives, to that of what it reads. */
static void block_back(const run *r, uint32_t i, const void *g, void *to) {
    const cnn_layer *l = &r->layout.layer[i];
    const lg_conv conv = conv_of(r->net, i);
    char *inner = r->cotangent[1];
    if (r->net->block[i].pooling == LG_POOL_MAX) {
        const lg_k_windows windows = pool_of(r->net, i);
        r->k->window_place(&windows, 1, g, r->activated[i], inner, false);
        g = inner;
    }
    lg_conv_slope(r->k, &conv, g, r->slope[i], inner);
    r->k->transpose(l->in, l->out, weight(r, i), r->transposed);
    lg_conv_input(r->k, &conv, inner, r->transposed, to, false, r->scratch);
}

void lg_cnn_forward(const lg_cnn *net, lg_dtype dtype, const void *theta, const void *x, void *y,
                    void *work) {
    size_t bytes;
    const run r = run_over(net, dtype, theta, true, work, &bytes);
    eval_one(&r, x, y, NULL);
}

void lg_cnn_backward(const lg_cnn *net, lg_dtype dtype, const void *theta, const void *cotangent,
                     void *gradient, void *work) {
    size_t bytes;
    const run r = run_over(net, dtype, theta, true, work, &bytes);
    void *end = net->blocks > 0 ? (void *)r.cotangent[0] : gradient;
    if (net->plane > 0) {
        dense_back(&r, net->blocks + 1, cotangent, r.cotangent[1]);
        r.k->binary[LG_K_MUL](net->plane, r.cotangent[1], r.slope[net->blocks], r.cotangent[1]);
        cotangent = r.cotangent[1];
    }
    dense_back(&r, net->blocks, cotangent, end);
    for (uint32_t i = net->blocks; i-- > 0;)
        block_back(&r, i, r.cotangent[0], i > 0 ? (void *)r.cotangent[0] : gradient);
}

void lg_cnn_input_gradient(const lg_cnn *net, lg_dtype dtype, const void *theta, const void *x,
                           const void *cotangent, void *y, void *gradient, void *work) {
    lg_cnn_forward(net, dtype, theta, x, y, work);
    lg_cnn_backward(net, dtype, theta, cotangent, gradient, work);
}
