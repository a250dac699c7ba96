/* Convolution along time.
 *
 * CONV1D y = conv(x, w), CONV1D_INPUT x = conv_input(g, w) and CONV1D_WEIGHT w = conv_weight(x, g) are the
 * three bilinear maps with g.conv(x, w) = conv_input(g, w).x = conv_weight(x, g).w. The derivatives of each
 * map are the other two. CONV1D may have a bias as third input. attr.i = {stride, padding, extent}. The
 * extent is a size that the inputs' shapes do not determine: the length of x for CONV1D_INPUT, the kernel
 * length for CONV1D_WEIGHT.
 *
 * CONV1D_BLOCK(x, w[, b]) is CONV1D, an activation and AVG_POOL1D in one; attr.i = {stride, padding, size and
 * stride of the pooling}, attr.c is the activation. It keeps the slope of the activation as its only array
 * for the vjp; the convolution's result and the activation's value are not stored. Derivatives that will be
 * differentiated again are built from the three separate operations. */
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/pool.h"
#include "autodiff/ops/windows.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/conv.h"

extern const lg_op lg_op_conv1d, lg_op_conv1d_block;

/* ---- convolution: shapes ---- */

/* Whether the largest scratch size is a number that memory can be requested for. If there are no outputs or
 * samples, the sizes of the tensors do not limit it. */
static bool scratch_fits(const lg_conv *c) {
    const lg_k_windows *w = &c->windows;
    const double width = (double)w->size * (double)w->channels;
    const double rows = (double)w->count + 2.0 * (double)c->outputs;
    return width * rows + (double)(w->length + 2 * w->padding) * (double)w->channels <
           (double)(SIZE_MAX / 64);
}

/* Sets *out from the shapes of x and w and the attributes. False: they do not fit. */
static bool conv_of(const lg_shape *x, const lg_shape *w, const lg_attr *attr, lg_conv *out) {
    *out = (lg_conv){.windows = {.length = x->dims[1],
                                 .channels = x->dims[2],
                                 .size = w->dims[0],
                                 .stride = attr->i[0],
                                 .padding = attr->i[1]},
                     .batch = x->dims[0],
                     .outputs = w->dims[2]};
    return x->rank == 3 && w->rank == 3 && x->dims[2] == w->dims[1] && lg_windows_count(&out->windows) &&
           out->windows.count <= UINT32_MAX && scratch_fits(out);
}

/* The shape of y, the convolution's output. */
static lg_shape windows_shape(const lg_conv *c) {
    return lg_shape3((uint32_t)c->batch, (uint32_t)c->windows.count, (uint32_t)c->outputs);
}

static lg_status conv1d_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    lg_conv c;
    if (!conv_of(in[0], in[1], attr, &c)) return LG_SHAPE;
    if (inputs > 2 && (in[2]->rank != 1 || in[2]->dims[0] != c.outputs)) return LG_SHAPE;
    *out = windows_shape(&c);
    return LG_OK;
}

/* Checks that the convolution of shapes x and w has an output of shape g. */
static lg_status check_output(const lg_shape *g, const lg_shape *x, const lg_shape *w, const lg_attr *attr) {
    lg_conv c;
    if (!conv_of(x, w, attr, &c)) return LG_SHAPE;
    const lg_shape y = windows_shape(&c);
    return lg_same_shape(g, &y) ? LG_OK : LG_SHAPE;
}

static lg_status conv1d_input_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                    lg_shape *out) {
    if (in[0]->rank != 3 || in[1]->rank != 3) return LG_SHAPE;
    *out = lg_shape3(in[0]->dims[0], attr->i[2], in[1]->dims[1]);
    return check_output(in[0], out, in[1], attr);
}

static lg_status conv1d_weight_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                     lg_shape *out) {
    if (in[0]->rank != 3 || in[1]->rank != 3) return LG_SHAPE;
    *out = lg_shape3(attr->i[2], in[0]->dims[2], in[1]->dims[2]);
    return check_output(in[1], in[0], out, attr);
}

/* ---- convolution: values ---- */

static lg_conv conv_at(const lg_evaluation *e) {
    lg_conv c;
    (void)conv_of(e->in[0], e->in[1], e->attr, &c);
    return c;
}

static lg_conv conv_input_at(const lg_evaluation *e) {
    lg_conv c;
    (void)conv_of(e->shape, e->in[1], e->attr, &c);
    return c;
}

static lg_conv conv_weight_at(const lg_evaluation *e) {
    lg_conv c;
    (void)conv_of(e->in[0], e->shape, e->attr, &c);
    return c;
}

static size_t conv1d_scratch(const lg_evaluation *e) {
    const lg_conv c = conv_at(e);
    return lg_conv_scratch(&c) * e->k->size;
}

static size_t conv1d_input_scratch(const lg_evaluation *e) {
    const lg_conv c = conv_input_at(e);
    const size_t turned = e->transposed != NULL ? 0 : lg_shape_count(*e->in[1]);
    return (lg_conv_input_scratch(&c) + turned) * e->k->size;
}

static size_t conv1d_weight_scratch(const lg_evaluation *e) {
    const lg_conv c = conv_weight_at(e);
    return lg_conv_weight_scratch(&c) * e->k->size;
}

static lg_transpose_use conv1d_input_transpose(const lg_evaluation *e) {
    return lg_shape_count(*e->in[1]) > 0 ? LG_TRANSPOSE_MAKE : LG_TRANSPOSE_NONE;
}

static lg_status conv1d_forward(lg_evaluation *e) {
    const lg_conv c = conv_at(e);
    lg_conv_apply(e->k, &c, e->x[0], e->x[1], e->inputs > 2 ? e->x[2] : NULL, LG_K_IDENTITY, NULL, e->y,
                  e->scratch);
    return LG_OK;
}

static lg_status conv1d_input_forward(lg_evaluation *e) {
    const lg_conv c = conv_input_at(e);
    const void *wt = e->transposed;
    if (wt == NULL) {
        unsigned char *made = (unsigned char *)e->scratch + lg_conv_input_scratch(&c) * e->k->size;
        e->k->transpose(c.windows.size * c.windows.channels, c.outputs, e->x[1], made);
        wt = made;
    }
    lg_conv_input(e->k, &c, e->x[0], wt, e->y, false, e->scratch);
    return LG_OK;
}

static lg_status conv1d_weight_forward(lg_evaluation *e) {
    const lg_conv c = conv_weight_at(e);
    lg_conv_weight(e->k, &c, e->x[0], e->x[1], e->y, false, e->scratch);
    return LG_OK;
}

/* ---- convolution: generated C ---- */

static void write_call(lg_c *c, const char *function, lg_conv conv, const char *bias) {
    char text[LG_WINDOWS_TEXT];
    lg_c_call(c, "%s(%zu, %s, %zu, $0, $1%s, $y)", function, conv.batch, lg_windows_text(&conv.windows, text),
              conv.outputs, bias);
}

static void conv1d_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, "conv1d", conv_at(e), e->inputs > 2 ? ", $2" : ", NULL");
}

static void conv1d_input_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, "conv1d_input", conv_input_at(e), "");
}

static void conv1d_weight_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, "conv1d_weight", conv_weight_at(e), "");
}

/* ---- convolution: unrecorded mode ---- */

/* Takes scratch memory for `count` numbers from the pool; *memory is NULL when count is 0. False: error
 * set. */
static bool take_scratch(lg_tape *tape, size_t count, void **memory) {
    *memory = count == 0 ? NULL : lg_pool_take(tape, count * tape->k->size);
    return count == 0 || *memory != NULL;
}

static void give_scratch(lg_tape *tape, size_t count, void *memory) {
    if (memory != NULL) lg_pool_give(tape, memory, count * tape->k->size);
}

static lg_status input_into(lg_tape *tape, const lg_conv *c, const void *g, uint32_t w, void *x, bool add) {
    const size_t count = lg_conv_input_scratch(c);
    void *scratch;
    const void *wt = lg_node_at(tape, lg_var_at(tape, w))->count == 0 ? g : lg_transposed(tape, w);
    if (wt == NULL || !take_scratch(tape, count, &scratch)) return tape->status;
    lg_conv_input(tape->k, c, g, wt, x, add, scratch);
    give_scratch(tape, count, scratch);
    return LG_OK;
}

static lg_status weight_into(lg_tape *tape, const lg_conv *c, const void *x, const void *g, void *w,
                             bool add) {
    const size_t count = lg_conv_weight_scratch(c);
    void *scratch;
    if (!take_scratch(tape, count, &scratch)) return tape->status;
    lg_conv_weight(tape->k, c, x, g, w, add, scratch);
    give_scratch(tape, count, scratch);
    return LG_OK;
}

static lg_status bias_into(lg_tape *tape, const lg_conv *c, const void *g, void *bias, bool add) {
    const size_t count = LG_CONV_BIAS_SCRATCH * c->outputs;
    void *scratch;
    if (!take_scratch(tape, count, &scratch)) return tape->status;
    lg_conv_bias(tape->k, c, g, bias, add, scratch);
    give_scratch(tape, count, scratch);
    return LG_OK;
}

/* ---- convolution: derivatives ---- */

static lg_var conv(lg_tape *tape, lg_var x, lg_var w, const lg_attr *attr) {
    return lg_record_windows(tape, &lg_op_conv1d, x, w, attr, 0);
}

static lg_var conv_input(lg_tape *tape, lg_var g, lg_var w, const lg_attr *attr, uint32_t length) {
    return lg_record_windows(tape, &lg_op_conv1d_input, g, w, attr, length);
}

static lg_var conv_weight(lg_tape *tape, lg_var x, lg_var g, const lg_attr *attr, uint32_t kernel) {
    return lg_record_windows(tape, &lg_op_conv1d_weight, x, g, attr, kernel);
}

/* Adds all cotangents directly to the inputs' adjoints. g is the cotangent of the output of convolution c. */
static void conv1d_reversed(lg_reverse *r, const lg_conv *c, const void *g) {
    lg_tape *tape = r->tape;
    void *to;
    bool add;
    if (r->need[0] && (to = lg_reverse_into(r, 0, &add)) != NULL)
        (void)input_into(tape, c, g, r->in[1].index, to, add);
    if (r->need[1] && tape->status == LG_OK && (to = lg_reverse_into(r, 1, &add)) != NULL)
        (void)weight_into(tape, c, lg_node_at(tape, r->in[0])->value, g, to, add);
    if (r->inputs > 2 && r->need[2] && tape->status == LG_OK && (to = lg_reverse_into(r, 2, &add)) != NULL)
        (void)bias_into(tape, c, g, to, add);
}

/* The same cotangents as recorded operations. */
static void conv1d_recorded(lg_reverse *r, lg_var g) {
    const lg_shape x = lg_node_at(r->tape, r->in[0])->shape, w = lg_node_at(r->tape, r->in[1])->shape;
    if (r->need[0]) r->out[0] = conv_input(r->tape, g, r->in[1], r->attr, x.dims[1]);
    if (r->need[1]) r->out[1] = conv_weight(r->tape, r->in[0], g, r->attr, w.dims[0]);
    if (r->inputs > 2 && r->need[2]) r->out[2] = lg_sum_to(r->tape, g, lg_node_at(r->tape, r->in[2])->shape);
}

static void conv1d_vjp(lg_reverse *r) {
    lg_conv c;
    if (!lg_reverse_in_place(r)) {
        conv1d_recorded(r, r->g);
        return;
    }
    (void)conv_of(&lg_node_at(r->tape, r->in[0])->shape, &lg_node_at(r->tape, r->in[1])->shape, r->attr, &c);
    conv1d_reversed(r, &c, lg_node_at(r->tape, r->g)->value);
}

static lg_var conv1d_tangent(const lg_forward *f, lg_shape shape) {
    lg_var x = LG_NONE, w = LG_NONE, bias = LG_NONE;
    if (!lg_is_none(f->tangents[0])) x = conv(f->tape, f->tangents[0], f->in[1], f->attr);
    if (!lg_is_none(f->tangents[1])) w = conv(f->tape, f->in[0], f->tangents[1], f->attr);
    if (f->inputs > 2 && !lg_is_none(f->tangents[2])) bias = lg_broadcast_to(f->tape, f->tangents[2], shape);
    return lg_add_or(f->tape, lg_add_or(f->tape, x, w), bias);
}

static lg_var conv1d_jvp(const lg_forward *f) {
    return conv1d_tangent(f, lg_node_at(f->tape, f->y)->shape);
}

/* The cotangent r->g of conv_input(g, w) has the shape of x. */
static void conv1d_input_vjp(lg_reverse *r) {
    const uint32_t kernel = lg_node_at(r->tape, r->in[1])->shape.dims[0];
    if (r->need[0]) r->out[0] = conv(r->tape, r->g, r->in[1], r->attr);
    if (r->need[1]) r->out[1] = conv_weight(r->tape, r->g, r->in[0], r->attr, kernel);
}

static void conv1d_weight_vjp(lg_reverse *r) {
    const uint32_t length = lg_node_at(r->tape, r->in[0])->shape.dims[1];
    if (r->need[0]) r->out[0] = conv_input(r->tape, r->in[1], r->g, r->attr, length);
    if (r->need[1]) r->out[1] = conv(r->tape, r->in[0], r->g, r->attr);
}

/* lg_op.terms of conv1d, elements of a window, and of conv1d_weight, places of all windows. */
static size_t conv1d_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return (size_t)in[1]->dims[0] * in[1]->dims[1];
}

static size_t conv1d_input_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return (size_t)in[1]->dims[0] * in[1]->dims[2];
}

const lg_op lg_op_conv1d = {LG_OP("conv1d", 0, 2, 3, conv1d_shape, conv1d_forward, conv1d_vjp, conv1d_jvp),
                            .scratch = conv1d_scratch, .write_c = conv1d_c, .rows = lg_rows_first,
                            .terms = conv1d_terms};
const lg_op lg_op_conv1d_input = {LG_OP("conv1d_input", 0, 2, 2, conv1d_input_shape, conv1d_input_forward,
                                        conv1d_input_vjp, lg_multilinear_jvp),
                                  .scratch = conv1d_input_scratch,
                                  .transpose = conv1d_input_transpose,
                                  .write_c = conv1d_input_c,
                                  .rows = lg_rows_first,
                                  .terms = conv1d_input_terms};
const lg_op lg_op_conv1d_weight = {LG_OP("conv1d_weight", 0, 2, 2, conv1d_weight_shape, conv1d_weight_forward,
                                         conv1d_weight_vjp, lg_multilinear_jvp),
                                   .scratch = conv1d_weight_scratch, .write_c = conv1d_weight_c,
                                   .terms = conv1d_terms};

/* ---- convolution, activation and average pooling in one operation ---- */

static bool block_of(const lg_shape *x, const lg_shape *w, const lg_attr *attr, lg_conv *out) {
    if (!conv_of(x, w, attr, out)) return false;
    const lg_shape convolved = windows_shape(out);
    const lg_attr pool = {.i = {attr->i[2], attr->i[3], 0, 0}};
    return (attr->i[2] == 1 && attr->i[3] == 1) || lg_pool_of(&convolved, &pool, &out->pool);
}

static lg_status block_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    lg_conv c;
    if (!(attr->c >= 0.0 && attr->c < LG_ACTIVATION_COUNT) || attr->c != (double)(int)attr->c)
        return LG_INVALID_ARGUMENT;
    if (conv1d_shape(in, inputs, attr, out) != LG_OK) return LG_SHAPE;
    if (!block_of(in[0], in[1], attr, &c)) return LG_SHAPE;
    if (c.pool.count > 0) out->dims[1] = (uint32_t)c.pool.count;
    return LG_OK;
}

static lg_conv block_at(const lg_evaluation *e) {
    lg_conv c;
    (void)block_of(e->in[0], e->in[1], e->attr, &c);
    return c;
}

static size_t block_scratch(const lg_evaluation *e) {
    const lg_conv c = block_at(e);
    return lg_conv_scratch(&c) * e->k->size;
}

static size_t block_kept(const lg_evaluation *e) {
    const lg_conv c = block_at(e);
    return c.batch * c.windows.count * c.outputs * e->k->size;
}

static lg_status block_forward(lg_evaluation *e) {
    const lg_conv c = block_at(e);
    lg_conv_apply(e->k, &c, e->x[0], e->x[1], e->inputs > 2 ? e->x[2] : NULL, (lg_k_act)e->attr->c, e->kept,
                  e->y, e->scratch);
    return LG_OK;
}

/* With pooling, samples are processed one after the other, and scratch holds one sample's activations before
 * they are averaged. */
static void block_c(lg_c *c, const lg_evaluation *e) {
    const lg_conv conv = block_at(e);
    const lg_attr kind = {.i = {(uint32_t)e->attr->c}};
    const size_t series = conv.windows.length * conv.windows.channels;
    const size_t count = conv.windows.count * conv.outputs, pooled = conv.pool.count * conv.outputs;
    const bool pool = conv.pool.count > 0;
    const size_t samples = pool ? conv.batch : 1, together = pool ? 1 : conv.batch;
    char text[LG_WINDOWS_TEXT];
    if (pool) lg_c_scratch(c, count);
    for (size_t i = 0; i < samples; i++) {
        lg_c_call(c, "conv1d(%zu, %s, %zu, $0 + %zu, $1, %s, %s)", together,
                  lg_windows_text(&conv.windows, text), conv.outputs, i * series,
                  e->inputs > 2 ? "$2" : "NULL", pool ? "$s" : "$y");
        if (kind.i[0] != LG_IDENTITY)
            lg_c_call(c, pool ? "%s(%zu, $s)" : "%s(%zu, $y)", lg_c_map(c, &lg_op_act, &kind, 1, 1),
                      together * count);
        if (pool)
            lg_c_call(c, "pool_mean(1, %s, $s, $y + %zu)", lg_windows_text(&conv.pool, text), i * pooled);
    }
}

static void block_reversed(lg_reverse *r) {
    lg_tape *tape = r->tape;
    lg_conv c;
    (void)block_of(&lg_node_at(tape, r->in[0])->shape, &lg_node_at(tape, r->in[1])->shape, r->attr, &c);
    const size_t count = c.batch * c.windows.count * c.outputs;
    void *g;
    if (!take_scratch(tape, count, &g)) return;
    lg_conv_slope(tape->k, &c, lg_node_at(tape, r->g)->value, r->attr->pointer, g);
    conv1d_reversed(r, &c, g);
    give_scratch(tape, count, g);
}

/* sigma'(z), where z is the convolution's result. z and the slope are recorded as nodes. */
static lg_var block_slope(lg_tape *tape, const lg_var *in, uint32_t inputs, const lg_attr *attr) {
    const lg_attr own = {.i = {attr->i[0], attr->i[1], 0, 0}};
    return lg_act_derivative(tape, lg_record(tape, &lg_op_conv1d, in, inputs, &own), (lg_activation)attr->c,
                             1);
}

static void block_vjp(lg_reverse *r) {
    if (r->attr->pointer != NULL && lg_reverse_in_place(r)) {
        block_reversed(r);
        return;
    }
    const lg_var slope = block_slope(r->tape, r->in, r->inputs, r->attr);
    if (lg_is_none(slope)) return;
    const lg_attr pool = {.i = {r->attr->i[2], r->attr->i[3], 0, 0}};
    const uint32_t length = lg_node_at(r->tape, slope)->shape.dims[1];
    const lg_var g = lg_record_windows(r->tape, &lg_op_avg_pool1d_adjoint, r->g, LG_NONE, &pool, length);
    conv1d_recorded(r, lg_mul(r->tape, g, slope));
}

static lg_var block_jvp(const lg_forward *f) {
    const lg_var slope = block_slope(f->tape, f->in, f->inputs, f->attr);
    if (lg_is_none(slope)) return LG_NONE;
    const lg_attr pool = {.i = {f->attr->i[2], f->attr->i[3], 0, 0}};
    const lg_var z = conv1d_tangent(f, lg_node_at(f->tape, slope)->shape);
    return lg_record_windows(f->tape, &lg_op_avg_pool1d, lg_mul(f->tape, z, slope), LG_NONE, &pool, 0);
}

const lg_op lg_op_conv1d_block = {
    LG_OP("conv1d_block", 0, 2, 3, block_shape, block_forward, block_vjp, block_jvp),
    .payload = LG_PAYLOAD_KEPT,
    .scratch = block_scratch,
    .kept = block_kept,
    .write_c = block_c,
    .rows = lg_rows_first,
    .terms = conv1d_terms};

/* ---- public functions ---- */

static bool good_steps(lg_tape *tape, uint32_t stride, const lg_node *w, uint32_t padding,
                       const char *operation) {
    if (stride == 0) {
        lg_tape_fail(tape, LG_INVALID_ARGUMENT, operation, "the stride is 0, but it must be at least 1");
        return false;
    }
    if (w->shape.rank == 3 && padding > 0 && padding >= w->shape.dims[0]) {
        lg_tape_fail(tape, LG_INVALID_ARGUMENT, operation,
                     "the padding must be less than the kernel's length");
        return false;
    }
    return true;
}

lg_var lg_conv1d(lg_tape *tape, lg_var x, lg_var w, uint32_t stride, uint32_t padding) {
    return lg_conv1d_dense(tape, x, w, LG_NONE, stride, padding, LG_IDENTITY);
}

lg_var lg_conv1d_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                       lg_activation kind) {
    return lg_conv1d_pooled(tape, x, w, b, stride, padding, kind, 1, 1);
}

lg_var lg_conv1d_pooled(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                        lg_activation kind, uint32_t size, uint32_t step) {
    const char *name = lg_op_conv1d.name;
    if ((unsigned)kind >= LG_ACTIVATION_COUNT)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, name, "unknown activation");
    if (size == 0 || step == 0)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, name,
                            "the size or the stride of pooling is 0, but both must be at least 1");
    const uint32_t inputs = lg_is_none(b) ? 2 : 3;
    const lg_var in[3] = {x, w, b};
    const lg_attr attr = {.i = {stride, padding, size, step}, .c = (double)kind};
    const lg_node *weight = lg_node_of(tape, w, name);
    if (weight == NULL || !good_steps(tape, stride, weight, padding, name)) return LG_NONE;
    const bool plain = kind == LG_IDENTITY && size == 1 && step == 1;
    return lg_record(tape, plain ? &lg_op_conv1d : &lg_op_conv1d_block, in, inputs, &attr);
}
