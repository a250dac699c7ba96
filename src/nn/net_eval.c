/* Networks of several architectures without a tape: products and activations by the kernels, in the caller's
 * memory. A derivative in a direction is computed in pairs: the rows of values, then as many of derivatives,
 * pass through a layer in one product, and its weights are read once.
 *
 * Cotangents, G of H after a layer:
 *   gated      dZ = G o (V - U), dU += G o (1 - Z), dV += G o Z, G <- cotangent of H through Z
 *   residual   G <- G + (sigma' o (G B^T)) A^T
 */
#include <string.h>

#include "nn/eval.h"
#include "nn/net.h"

/* A run over some rows (pairs: twice as many) and where its pieces lie in `work`. */
typedef struct run {
    const lg_net *net;
    const lg_kernels *k;
    const char *theta;
    size_t rows;
    net_layout layout;
    char *input, *embedded;    /* (2 rows, in), (2 rows, e) */
    char *cotangent, *ones;    /* (rows, e) of the embedding, (rows, out) */
    char *head[NET_MAX_HEADS]; /* (2 rows, h): sigma(x W + b); or values and cotangents */
    char *h, *z, *g;           /* (2 rows, h) */
    char *kept;                /* (steps l, rows, h): what cotangents read of each layer */
    char *kept_head;           /* (heads, rows, h) */
    char *transposed;          /* the largest W^T */
    char *rest;                /* of `work`, for a perceptron behind an embedding */
} run;

static size_t largest_weight(const net_layout *layout) {
    size_t largest = 0;
    for (uint32_t i = 0; i < layout->count; i++) {
        const size_t count = (size_t)layout->dense[i].in * layout->dense[i].out;
        if (count > largest) largest = count;
    }
    return largest;
}

/* The perceptron behind an embedding. */
static lg_mlp behind_embedding(const lg_net *net) {
    lg_mlp mlp = lg_net_mlp(net);
    if (net->embedding > 0) mlp.width[0] = net->embedding;
    return mlp;
}

/* With `work` NULL only *bytes is of use. */
static run run_over(const lg_net *net, lg_dtype dtype, const void *theta, size_t rows, void *work,
                    size_t *bytes) {
    run r = {.net = net, .k = lg_kernels_for(dtype), .theta = theta, .rows = rows};
    char *rest = work;
    const size_t row = rows * r.k->size, pair = 2 * row;
    lg_net_layout(net, &r.layout);
    *bytes = 0;
    if (net->embedding > 0) {
        r.input = eval_take(&rest, bytes, pair * net->inputs);
        r.embedded = eval_take(&rest, bytes, pair * net->embedding);
        r.cotangent = eval_take(&rest, bytes, row * net->embedding);
        r.transposed = eval_take(&rest, bytes, largest_weight(&r.layout) * r.k->size);
    }
    if (net->kind == LG_NET_MLP) {
        const lg_mlp mlp = behind_embedding(net);
        r.rest = rest;
        *bytes += lg_mlp_work_size(&mlp, rows, dtype);
        return r;
    }
    if (net->embedding == 0) {
        r.input = eval_take(&rest, bytes, pair * net->inputs);
        r.transposed = eval_take(&rest, bytes, largest_weight(&r.layout) * r.k->size);
    }
    r.ones = eval_take(&rest, bytes, row * net->outputs);
    for (uint32_t i = 0; i < r.layout.heads; i++) r.head[i] = eval_take(&rest, bytes, pair * net->hidden);
    r.h = eval_take(&rest, bytes, pair * net->hidden);
    r.z = eval_take(&rest, bytes, pair * net->hidden);
    r.g = eval_take(&rest, bytes, pair * net->hidden);
    r.kept = eval_take(&rest, bytes, row * net->hidden * r.layout.steps * net->layers);
    r.kept_head = eval_take(&rest, bytes, row * net->hidden * r.layout.heads);
    return r;
}

size_t lg_net_work_size(const lg_net *net, size_t rows, lg_dtype dtype) {
    size_t bytes;
    if (lg_net_is_mlp(net)) {
        const lg_mlp mlp = lg_net_mlp(net);
        return lg_mlp_work_size(&mlp, rows, dtype);
    }
    (void)run_over(net, dtype, NULL, rows, NULL, &bytes);
    return bytes;
}

/* ---- layers ---- */

static const void *weight(const run *r, uint32_t i) {
    return r->theta + r->layout.dense[i].weight * r->k->size;
}

static const void *bias(const run *r, uint32_t i) {
    const net_dense *d = &r->layout.dense[i];
    return d->has_bias ? r->theta + d->bias * r->k->size : NULL;
}

/* y = [y +] x W of dense layer i */
static void multiply(const run *r, size_t rows, uint32_t i, const void *x, void *y, bool accumulate) {
    const net_dense *d = &r->layout.dense[i];
    eval_multiply(r->k, rows, d->in, d->out, x, weight(r, i), y, accumulate);
}

static void multiply_transposed(const run *r, uint32_t i, const void *g, void *y, bool accumulate) {
    const net_dense *d = &r->layout.dense[i];
    eval_multiply_transposed(r->k, r->rows, d->in, d->out, g, weight(r, i), r->transposed, y, accumulate);
}

/* y = sigma(x W + b) of values, or of pairs. */
static void dense(const run *r, bool dual, uint32_t i, lg_activation kind, const void *x, void *y) {
    multiply(r, dual ? 2 * r->rows : r->rows, i, x, y, false);
    if (dual)
        r->k->dual_act((lg_k_act)kind, r->rows, r->layout.dense[i].out, bias(r, i), NULL, y);
    else
        r->k->bias_act((lg_k_act)kind, r->rows, r->layout.dense[i].out, bias(r, i), y);
}

/* sin(2 pi (x A + b)) */
static const void *embed(const run *r, bool dual, const void *x) {
    if (r->net->embedding == 0) return x;
    const size_t n = r->rows * r->net->embedding;
    dense(r, dual, 0, LG_IDENTITY, x, r->embedded);
    r->k->unary[LG_K_SCALE](dual ? 2 * n : n, LG_TWO_PI, r->embedded, r->embedded);
    if (dual)
        r->k->dual_act(LG_K_SINE, r->rows, r->net->embedding, NULL, NULL, r->embedded);
    else
        r->k->bias_act(LG_K_SINE, r->rows, r->net->embedding, NULL, r->embedded);
    return r->embedded;
}

/* x and tangent as pairs. */
static const void *pair(const run *r, const void *x, const void *tangent) {
    const size_t bytes = r->rows * r->net->inputs * r->k->size;
    memcpy(r->input, x, bytes);
    memcpy(r->input + bytes, tangent, bytes);
    return r->input;
}

/* H <- H after layer l. r->z and, in a residual network, nothing else is overwritten. */
static void gated_layer(const run *r, bool dual, uint32_t l) {
    const uint32_t i = r->layout.first_step + l * r->layout.steps;
    const size_t n = r->rows * r->net->hidden;
    const char *gate = r->z;
    dense(r, dual, i, r->net->activation, r->h, r->z);
    if (r->layout.steps > 1) {
        dense(r, dual, i + 1, LG_IDENTITY, r->z, r->g);
        gate = r->g;
    }
    (dual ? r->k->dual_mix : r->k->mix)(n, gate, r->head[0], r->head[1], r->h);
}

static void residual_layer(const run *r, bool dual, uint32_t l) {
    const uint32_t i = r->layout.first_step + l * r->layout.steps;
    dense(r, dual, i, r->net->activation, r->h, r->z);
    multiply(r, dual ? 2 * r->rows : r->rows, i + 1, r->z, r->h, true);
}

/* From the body's input to its last hidden values, in r->h. */
static void body(const run *r, bool dual, const void *x) {
    const uint32_t last = r->layout.heads - 1;
    for (uint32_t i = 0; i < last; i++)
        dense(r, dual, r->layout.first_head + i, r->net->activation, x, r->head[i]);
    dense(r, dual, r->layout.first_head + last, r->net->activation, x, r->h);
    for (uint32_t l = 0; l < r->net->layers; l++) {
        if (lg_net_gated(r->net))
            gated_layer(r, dual, l);
        else
            residual_layer(r, dual, l);
    }
}

void lg_net_eval(const lg_net *net, lg_dtype dtype, const void *theta, const void *x, size_t rows, void *y,
                 void *work) {
    if (lg_net_is_mlp(net)) {
        const lg_mlp mlp = lg_net_mlp(net);
        lg_mlp_eval(&mlp, dtype, theta, x, rows, y, work);
        return;
    }
    size_t bytes;
    const run r = run_over(net, dtype, theta, rows, work, &bytes);
    const void *inner = embed(&r, false, x);
    if (net->kind == LG_NET_MLP) {
        const lg_mlp mlp = behind_embedding(net);
        lg_mlp_eval(&mlp, dtype, weight(&r, 1), inner, rows, y, r.rest);
        return;
    }
    body(&r, false, inner);
    dense(&r, false, r.layout.count - 1, LG_IDENTITY, r.h, y);
}

void lg_net_jvp(const lg_net *net, lg_dtype dtype, const void *theta, const void *x, const void *tangent,
                size_t rows, void *y, void *dy, void *work) {
    if (lg_net_is_mlp(net)) {
        const lg_mlp mlp = lg_net_mlp(net);
        lg_mlp_jvp(&mlp, dtype, theta, x, tangent, rows, y, dy, work);
        return;
    }
    size_t bytes;
    const run r = run_over(net, dtype, theta, rows, work, &bytes);
    const char *inner = embed(&r, true, pair(&r, x, tangent));
    if (net->kind == LG_NET_MLP) {
        const lg_mlp mlp = behind_embedding(net);
        const char *direction = inner + rows * net->embedding * r.k->size;
        lg_mlp_jvp(&mlp, dtype, weight(&r, 1), inner, direction, rows, y, dy, r.rest);
        return;
    }
    body(&r, true, inner);
    const uint32_t last = r.layout.count - 1;
    if (y != NULL) dense(&r, false, last, LG_IDENTITY, r.h, y);
    multiply(&r, rows, last, r.h + rows * net->hidden * r.k->size, dy, false);
}

/* ---- input gradient ---- */

/* Of an activation sigma(z) the cotangents read its value, where the derivative follows from that, else z. */
static bool value_serves(lg_activation kind) {
    return kind != LG_SWISH && kind != LG_SINE;
}

static char *kept_step(const run *r, uint32_t step) {
    return r->kept + (size_t)step * r->rows * r->net->hidden * r->k->size;
}

static char *kept_head(const run *r, uint32_t i) {
    return r->kept_head + (size_t)i * r->rows * r->net->hidden * r->k->size;
}

/* dense() of values with what cotangents read in `kept`; returns sigma(x W + b), in `kept` or in y. */
static const void *dense_kept(const run *r, uint32_t i, const void *x, char *kept, void *y) {
    const lg_activation kind = r->net->activation;
    const size_t n = r->rows * r->net->hidden;
    dense(r, false, i, value_serves(kind) ? kind : LG_IDENTITY, x, kept);
    if (value_serves(kind)) return kept;
    r->k->act((lg_k_act)kind, 0, n, kept, NULL, NULL, y);
    return y;
}

/* g <- g sigma'(z), by what was kept. */
static void through_activation(const run *r, const char *kept, void *g) {
    const lg_activation kind = r->net->activation;
    const bool value = value_serves(kind);
    r->k->act((lg_k_act)kind, 1, r->rows * r->net->hidden, value ? NULL : kept, value ? kept : NULL, g, g);
}

/* The forward pass of values that keeps what backward() reads; r->h is the last hidden value. */
static void forward(const run *r, const void *x) {
    const net_layout *layout = &r->layout;
    const size_t n = r->rows * r->net->hidden, bytes = n * r->k->size;
    const void *head[NET_MAX_HEADS];
    for (uint32_t i = 0; i < layout->heads; i++)
        head[i] = dense_kept(r, layout->first_head + i, x, kept_head(r, i), r->head[i]);
    memcpy(r->h, head[layout->heads - 1], bytes);
    for (uint32_t l = 0; l < r->net->layers; l++) {
        const uint32_t step = l * layout->steps, i = layout->first_step + step;
        const void *z = dense_kept(r, i, r->h, kept_step(r, step), r->z);
        if (!lg_net_gated(r->net)) {
            multiply(r, r->rows, i + 1, z, r->h, true);
            continue;
        }
        if (layout->steps > 1) {
            dense(r, false, i + 1, LG_IDENTITY, z, kept_step(r, step + 1));
            z = kept_step(r, step + 1);
        }
        r->k->mix(n, z, head[0], head[1], r->h);
    }
}

/* The gate of layer l into r->z, unless it was kept. */
static const void *gate_of(const run *r, uint32_t l) {
    const uint32_t step = l * r->layout.steps;
    if (r->layout.steps > 1) return kept_step(r, step + 1);
    if (value_serves(r->net->activation)) return kept_step(r, step);
    r->k->act((lg_k_act)r->net->activation, 0, r->rows * r->net->hidden, kept_step(r, step), NULL, NULL,
              r->z);
    return r->z;
}

/* Values of U and V, which their cotangents must not overwrite. */
static const void *head_value(const run *r, uint32_t i) {
    return value_serves(r->net->activation) ? kept_head(r, i) : r->head[i];
}

static char *second_half(const run *r, char *pairs) {
    return pairs + r->rows * r->net->hidden * r->k->size;
}

/* G from after layer l to before it, in r->g; adds to the heads' cotangents. */
static void gated_back(const run *r, uint32_t l) {
    const uint32_t step = l * r->layout.steps, i = r->layout.first_step + step;
    const void *in[3] = {gate_of(r, l), head_value(r, 0), head_value(r, 1)};
    char *dz = second_half(r, r->z);
    const bool more = l + 1 < r->net->layers, add[3] = {false, more, more};
    void *out[3] = {dz, second_half(r, r->head[0]), second_half(r, r->head[1])};
    r->k->mix_reverse(r->rows * r->net->hidden, in, r->g, out, add);
    if (r->layout.steps > 1) {
        multiply_transposed(r, i + 1, dz, r->h, false);
        dz = r->h;
    }
    through_activation(r, kept_step(r, step), dz);
    multiply_transposed(r, i, dz, r->g, false);
}

static void residual_back(const run *r, uint32_t l) {
    const uint32_t step = l * r->layout.steps, i = r->layout.first_step + step;
    multiply_transposed(r, i + 1, r->g, r->z, false);
    through_activation(r, kept_step(r, step), r->z);
    multiply_transposed(r, i, r->z, r->g, true);
}

/* gradient (rows, in of the body) */
static void backward(const run *r, const void *cotangent, void *gradient) {
    const net_layout *layout = &r->layout;
    const uint32_t last = layout->heads - 1;
    multiply_transposed(r, layout->count - 1, cotangent, r->g, false);
    for (uint32_t l = r->net->layers; l-- > 0;) {
        if (lg_net_gated(r->net))
            gated_back(r, l);
        else
            residual_back(r, l);
    }
    through_activation(r, kept_head(r, last), r->g);
    multiply_transposed(r, layout->first_head + last, r->g, gradient, false);
    for (uint32_t i = 0; i < last && r->net->layers > 0; i++) {
        char *g = second_half(r, r->head[i]);
        through_activation(r, kept_head(r, i), g);
        multiply_transposed(r, layout->first_head + i, g, gradient, true);
    }
}

/* Through sin(2 pi (x A + b)), whose argument is the second half of r->embedded. */
static void embedding_back(const run *r, void *gradient) {
    const size_t n = r->rows * r->net->embedding;
    r->k->act(LG_K_SINE, 1, n, r->embedded + n * r->k->size, NULL, r->cotangent, r->cotangent);
    r->k->unary[LG_K_SCALE](n, LG_TWO_PI, r->cotangent, r->cotangent);
    multiply_transposed(r, 0, r->cotangent, gradient, false);
}

static const void *embed_kept(const run *r, const void *x) {
    if (r->net->embedding == 0) return x;
    const size_t n = r->rows * r->net->embedding;
    char *argument = r->embedded + n * r->k->size;
    dense(r, false, 0, LG_IDENTITY, x, argument);
    r->k->unary[LG_K_SCALE](n, LG_TWO_PI, argument, argument);
    r->k->act(LG_K_SINE, 0, n, argument, NULL, NULL, r->embedded);
    return r->embedded;
}

void lg_net_input_gradient(const lg_net *net, lg_dtype dtype, const void *theta, const void *x, size_t rows,
                           const void *cotangent, void *y, void *gradient, void *work) {
    if (lg_net_is_mlp(net)) {
        const lg_mlp mlp = lg_net_mlp(net);
        lg_mlp_input_gradient(&mlp, dtype, theta, x, rows, cotangent, y, gradient, work);
        return;
    }
    size_t bytes;
    const run r = run_over(net, dtype, theta, rows, work, &bytes);
    const void *inner = embed_kept(&r, x);
    void *to_inner = net->embedding > 0 ? r.cotangent : gradient;
    if (net->kind == LG_NET_MLP) {
        const lg_mlp mlp = behind_embedding(net);
        lg_mlp_input_gradient(&mlp, dtype, weight(&r, 1), inner, rows, cotangent, y, to_inner, r.rest);
    } else {
        forward(&r, inner);
        if (y != NULL) dense(&r, false, r.layout.count - 1, LG_IDENTITY, r.h, y);
        if (cotangent == NULL) r.k->fill(rows * net->outputs, 1.0, r.ones);
        backward(&r, cotangent != NULL ? cotangent : r.ones, to_inner);
    }
    if (net->embedding > 0) embedding_back(&r, gradient);
}
