/* Multilayer perceptrons without a tape: products and activations by the kernels, in the caller's memory.
 *
 * With z_l = a_l W_l + b_l the pre-activation of hidden layer l:
 *   value      a_{l+1} = sigma(z_l)
 *   tangent    da_{l+1} = sigma'(z_l) (da_l W_l)
 *   cotangent  g_l = (g_{l+1} sigma'(z_l)) W_l^T
 * and, of the cotangent along a tangent of x (forward over reverse), with dz_l = da_l W_l:
 *   dg_l = (dg_{l+1} sigma'(z_l) + g_{l+1} sigma''(z_l) dz_l) W_l^T
 */
#include <string.h>

#include "liegrad/nn.h"
#include "nn/eval.h"

/* Which of z and the helper h the derivative of an activation reads, as kernels.h says; h is the activation's
 * own value, or sigmoid(z). */
typedef enum helper { HELPER_NONE, HELPER_VALUE, HELPER_SIGMOID } helper;

static const helper helpers[LG_ACTIVATION_COUNT] = {
    [LG_IDENTITY] = HELPER_NONE, [LG_TANH] = HELPER_VALUE, [LG_SIGMOID] = HELPER_VALUE,
    [LG_SWISH] = HELPER_SIGMOID, [LG_RELU] = HELPER_NONE,  [LG_LEAKY_RELU] = HELPER_NONE,
    [LG_SINE] = HELPER_NONE,
};

/* A run over some rows: the network and where its pieces lie in `work`. */
typedef struct run {
    const lg_mlp *net;
    const lg_kernels *k;
    const char *theta;
    size_t rows;
    char *z[LG_MLP_MAX_LAYERS]; /* hidden layers: (rows, width[l + 1]) */
    char *h[LG_MLP_MAX_LAYERS];
    char *temporary[3]; /* (rows, largest width) */
    char *transposed;   /* the largest hidden W^T, for more than one row */
} run;

static size_t widest(const lg_mlp *net) {
    size_t width = 0;
    for (uint32_t l = 0; l <= net->layers; l++)
        if (net->width[l] > width) width = net->width[l];
    return width;
}

static size_t largest_weight(const lg_mlp *net) {
    size_t largest = 0;
    for (uint32_t l = 0; l < net->layers; l++) {
        const size_t count = (size_t)net->width[l] * net->width[l + 1];
        if (count > largest) largest = count;
    }
    return largest;
}

/* With `work` NULL only *bytes is of use. */
static run layout(const lg_mlp *net, lg_dtype dtype, const void *theta, size_t rows, void *work,
                  size_t *bytes) {
    run r = {.net = net, .k = lg_kernels_for(dtype), .theta = theta, .rows = rows};
    char *rest = work;
    *bytes = 0;
    for (uint32_t l = 0; l + 1 < net->layers; l++) {
        r.z[l] = eval_take(&rest, bytes, rows * net->width[l + 1] * r.k->size);
        r.h[l] = eval_take(&rest, bytes, rows * net->width[l + 1] * r.k->size);
    }
    for (size_t i = 0; i < LG_COUNT(r.temporary); i++)
        r.temporary[i] = eval_take(&rest, bytes, rows * widest(net) * r.k->size);
    r.transposed = eval_take(&rest, bytes, largest_weight(net) * r.k->size);
    return r;
}

size_t lg_mlp_work_size(const lg_mlp *net, size_t rows, lg_dtype dtype) {
    size_t bytes;
    (void)layout(net, dtype, NULL, rows, NULL, &bytes);
    return bytes;
}

static const void *weight(const run *r, uint32_t l) {
    return r->theta + lg_mlp_weight_offset(r->net, l) * r->k->size;
}

static const void *bias(const run *r, uint32_t l) {
    return lg_mlp_has_bias(r->net, l) ? r->theta + lg_mlp_bias_offset(r->net, l) * r->k->size : NULL;
}

/* y (rows, width[l + 1]) = a W_l */
static void multiply(const run *r, uint32_t l, const void *a, void *y) {
    eval_multiply(r->k, r->rows, r->net->width[l], r->net->width[l + 1], a, weight(r, l), y, false);
}

/* y (rows, width[l]) = g W_l^T */
static void multiply_transposed(const run *r, uint32_t l, const void *g, void *y) {
    eval_multiply_transposed(r->k, r->rows, r->net->width[l], r->net->width[l + 1], g, weight(r, l),
                             r->transposed, y, false);
}

/* The hidden layer's z from its input; then h, where the derivative needs one. Returns h or NULL. */
static const void *pre_activate(const run *r, uint32_t l, const void *a) {
    const size_t n = r->rows * r->net->width[l + 1];
    const helper wanted = helpers[r->net->activation];
    multiply(r, l, a, r->z[l]);
    r->k->bias_act(LG_K_IDENTITY, r->rows, r->net->width[l + 1], bias(r, l), r->z[l]);
    if (wanted == HELPER_NONE) return NULL;
    const lg_k_act kind = wanted == HELPER_SIGMOID ? LG_K_SIGMOID : (lg_k_act)r->net->activation;
    r->k->act(kind, 0, n, r->z[l], NULL, NULL, r->h[l]);
    return r->h[l];
}

/* a_{l+1}: h itself, or computed into y. */
static const void *activate(const run *r, uint32_t l, const void *h, void *y) {
    if (helpers[r->net->activation] == HELPER_VALUE) return h;
    r->k->act((lg_k_act)r->net->activation, 0, r->rows * r->net->width[l + 1], r->z[l], h, NULL, y);
    return y;
}

/* y = g sigma'(z_l); g and y differ. */
static void scale_by_slope(const run *r, uint32_t l, const void *h, const void *g, void *y) {
    r->k->act((lg_k_act)r->net->activation, 1, r->rows * r->net->width[l + 1], r->z[l], h, g, y);
}

static void last_layer(const run *r, const void *a, void *y) {
    const uint32_t last = r->net->layers - 1;
    multiply(r, last, a, y);
    if (r->net->last_bias) r->k->bias_act(LG_K_IDENTITY, r->rows, r->net->width[last + 1], bias(r, last), y);
}

void lg_mlp_eval(const lg_mlp *net, lg_dtype dtype, const void *theta, const void *x, size_t rows, void *y,
                 void *work) {
    size_t bytes;
    const run r = layout(net, dtype, theta, rows, work, &bytes);
    const void *a = x;
    for (uint32_t l = 0; l + 1 < net->layers; l++) {
        multiply(&r, l, a, r.z[l]);
        r.k->bias_act((lg_k_act)net->activation, rows, net->width[l + 1], bias(&r, l), r.z[l]);
        a = r.z[l];
    }
    last_layer(&r, a, y);
}

/* The value is dead before the next layer's is written to the same temporary, since its product lies in z. */
static const void *forward(const run *r, const void *x) {
    const void *a = x;
    for (uint32_t l = 0; l + 1 < r->net->layers; l++) {
        const void *h = pre_activate(r, l, a);
        a = activate(r, l, h, r->temporary[2]);
    }
    return a;
}

void lg_mlp_input_gradient(const lg_mlp *net, lg_dtype dtype, const void *theta, const void *x, size_t rows,
                           const void *cotangent, void *y, void *gradient, void *work) {
    size_t bytes;
    const run r = layout(net, dtype, theta, rows, work, &bytes);
    const void *a = forward(&r, x);
    if (y != NULL) last_layer(&r, a, y);
    const char *g = cotangent;
    if (g == NULL) {
        r.k->fill(rows * lg_mlp_outputs(net), 1.0, r.temporary[1]);
        g = r.temporary[1];
    }
    const bool has_helper = helpers[net->activation] != HELPER_NONE;
    for (uint32_t l = net->layers - 1; l > 0; l--) {
        multiply_transposed(&r, l, g, r.temporary[0]);
        scale_by_slope(&r, l - 1, has_helper ? r.h[l - 1] : NULL, r.temporary[0], r.temporary[1]);
        g = r.temporary[1];
    }
    multiply_transposed(&r, 0, g, gradient);
}

void lg_mlp_jvp(const lg_mlp *net, lg_dtype dtype, const void *theta, const void *x, const void *tangent,
                size_t rows, void *y, void *dy, void *work) {
    size_t bytes;
    const run r = layout(net, dtype, theta, rows, work, &bytes);
    const void *a = x, *da = tangent;
    for (uint32_t l = 0; l + 1 < net->layers; l++) {
        const void *h = pre_activate(&r, l, a);
        multiply(&r, l, da, r.temporary[0]);
        scale_by_slope(&r, l, h, r.temporary[0], r.temporary[1]);
        da = r.temporary[1];
        a = activate(&r, l, h, r.temporary[2]);
    }
    if (y != NULL) last_layer(&r, a, y);
    multiply(&r, net->layers - 1, da, dy);
}

/* What the Hessian's product keeps beside a run. */
typedef struct second_run {
    run first;
    char *dz[LG_MLP_MAX_LAYERS]; /* hidden layers: (rows, width[l + 1]) */
    char *temporary[2];          /* (rows, largest width) */
} second_run;

static second_run second_layout(const lg_mlp *net, lg_dtype dtype, const void *theta, size_t rows, void *work,
                                size_t *bytes) {
    second_run s = {.first = layout(net, dtype, theta, rows, work, bytes)};
    const size_t size = s.first.k->size;
    char *rest = work == NULL ? NULL : (char *)work + *bytes;
    for (uint32_t l = 0; l + 1 < net->layers; l++)
        s.dz[l] = eval_take(&rest, bytes, rows * net->width[l + 1] * size);
    for (size_t i = 0; i < LG_COUNT(s.temporary); i++)
        s.temporary[i] = eval_take(&rest, bytes, rows * widest(net) * size);
    return s;
}

size_t lg_mlp_hessian_work_size(const lg_mlp *net, size_t rows, lg_dtype dtype) {
    size_t bytes;
    (void)second_layout(net, dtype, NULL, rows, NULL, &bytes);
    return bytes;
}

/* z, h and dz of the hidden layers; returns the last one's value. */
static const void *second_forward(const second_run *s, const void *x, const void *tangent) {
    const run *r = &s->first;
    const void *a = x, *da = tangent;
    for (uint32_t l = 0; l + 1 < r->net->layers; l++) {
        const void *h = pre_activate(r, l, a);
        multiply(r, l, da, s->dz[l]);
        scale_by_slope(r, l, h, s->dz[l], s->temporary[0]);
        da = s->temporary[0];
        a = activate(r, l, h, r->temporary[2]);
    }
    return a;
}

/* Through the activation of hidden layer l: u and du (NULL: zero) are the cotangent of its value and that
 * one's derivative; g = u sigma', dg = du sigma' + u sigma'' dz. */
static void second_reverse(const second_run *s, uint32_t l, const void *u, const void *du, void *g,
                           void *dg) {
    const run *r = &s->first;
    const void *h = helpers[r->net->activation] != HELPER_NONE ? r->h[l] : NULL;
    if (du != NULL) scale_by_slope(r, l, h, du, dg);
    r->k->act_reverse((lg_k_act)r->net->activation, 1, r->rows * r->net->width[l + 1], r->z[l], h, u,
                      s->dz[l], g, false, dg, du != NULL);
}

void lg_mlp_hessian_vector(const lg_mlp *net, lg_dtype dtype, const void *theta, const void *x,
                           const void *tangent, size_t rows, void *y, void *gradient, void *dgradient,
                           void *work) {
    size_t bytes;
    const second_run s = second_layout(net, dtype, theta, rows, work, &bytes);
    const run *r = &s.first;
    const void *a = second_forward(&s, x, tangent);
    if (y != NULL) last_layer(r, a, y);
    char *u = r->temporary[0], *g = r->temporary[1], *du = s.temporary[0], *dg = s.temporary[1];
    bool curved = false; /* dg is not zero */
    r->k->fill(rows * lg_mlp_outputs(net), 1.0, g);
    for (uint32_t l = net->layers - 1; l > 0; l--) {
        multiply_transposed(r, l, g, u);
        if (curved) multiply_transposed(r, l, dg, du);
        second_reverse(&s, l - 1, u, curved ? du : NULL, g, dg);
        curved = true;
    }
    if (gradient != NULL) multiply_transposed(r, 0, g, gradient);
    if (curved)
        multiply_transposed(r, 0, dg, dgradient);
    else
        r->k->fill(rows * lg_mlp_inputs(net), 0.0, dgradient);
}
