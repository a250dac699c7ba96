/* Pooling along time.
 *
 * AVG_POOL1D and AVG_POOL1D_ADJOINT are linear; attr.i = {size, stride, length}. POOL_PICK(h, x) returns for
 * each window the element of h at the place where x is largest. POOL_PLACE(g, x) is its adjoint and adds g at
 * that place. Both are linear in the first input; differentiation treats the second input as a constant.
 * Maximum pooling is POOL_PICK(x, x). */
#include "autodiff/ops/pool.h"

#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/windows.h"

extern const lg_op lg_op_pool_pick;

/* ---- shapes ---- */

bool lg_pool_of(const lg_shape *x, const lg_attr *attr, lg_k_windows *out) {
    *out = (lg_k_windows){
        .length = x->dims[1], .channels = x->dims[2], .size = attr->i[0], .stride = attr->i[1]};
    return x->rank == 3 && lg_windows_count(out);
}

/* The same for windows that fit. */
static lg_k_windows windows_of(const lg_shape *x, const lg_attr *attr) {
    lg_k_windows w;
    (void)lg_pool_of(x, attr, &w);
    return w;
}

static lg_status pooled_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const lg_shape *x = in[0];
    lg_k_windows w;
    if (!lg_pool_of(x, attr, &w)) return LG_SHAPE;
    if (inputs > 1 && !lg_same_shape(x, in[1])) return LG_SHAPE;
    *out = lg_shape3(x->dims[0], (uint32_t)w.count, x->dims[2]);
    return LG_OK;
}

/* Whether g (batch, count, channels) has the shape of the pooled series x. */
static bool pooled_from(const lg_shape *g, const lg_shape *x, const lg_attr *attr) {
    lg_k_windows w;
    return lg_pool_of(x, attr, &w) && g->rank == 3 && g->dims[0] == x->dims[0] && g->dims[1] == w.count &&
           g->dims[2] == x->dims[2];
}

static lg_status spread_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const lg_shape *g = in[0];
    if (g->rank != 3) return LG_SHAPE;
    *out = lg_shape3(g->dims[0], attr->i[2], g->dims[2]);
    return pooled_from(g, out, attr) ? LG_OK : LG_SHAPE;
}

static lg_status place_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    *out = *in[1];
    return pooled_from(in[0], out, attr) ? LG_OK : LG_SHAPE;
}

lg_var lg_record_windows(lg_tape *tape, const lg_op *op, lg_var a, lg_var b, const lg_attr *attr,
                         uint32_t extent) {
    const lg_attr own = {.i = {attr->i[0], attr->i[1], extent, 0}};
    const lg_var in[2] = {a, b};
    return lg_record(tape, op, in, lg_is_none(b) ? 1 : 2, &own);
}

/* ---- average pooling ---- */

static void spread(const lg_kernels *k, const lg_shape *shape, const lg_attr *attr, const void *g, void *x,
                   bool add) {
    const lg_k_windows w = windows_of(shape, attr);
    k->window_fold(&w, shape->dims[0], 1.0 / (double)w.size, g, w.channels, 0, NULL, x, add);
}

static lg_status avg_pool1d_forward(lg_evaluation *e) {
    const lg_k_windows w = windows_of(e->in[0], e->attr);
    e->k->window_mean(&w, e->shape->dims[0], e->x[0], e->y);
    return LG_OK;
}

static lg_status avg_pool1d_adjoint_forward(lg_evaluation *e) {
    spread(e->k, e->shape, e->attr, e->x[0], e->y, false);
    return LG_OK;
}

/* Writes a call with the windows of a series of shape x. */
static void write_call(lg_c *c, const lg_evaluation *e, const lg_shape *x, const char *function,
                       const char *inputs) {
    char text[LG_WINDOWS_TEXT];
    const lg_k_windows w = windows_of(x, e->attr);
    lg_c_call(c, "%s(%u, %s, %s, $y)", function, e->shape->dims[0], lg_windows_text(&w, text), inputs);
}

static void avg_pool1d_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, e, e->in[0], "pool_mean", "$0");
}

static void avg_pool1d_adjoint_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, e, e->shape, "pool_mean_adjoint", "$0");
}

static void avg_pool1d_vjp(lg_reverse *r) {
    if (!r->need[0]) return;
    const lg_shape x = lg_node_at(r->tape, r->in[0])->shape;
    if (!lg_reverse_in_place(r)) {
        r->out[0] = lg_record_windows(r->tape, &lg_op_avg_pool1d_adjoint, r->g, LG_NONE, r->attr, x.dims[1]);
        return;
    }
    bool add = false;
    void *to = lg_reverse_into(r, 0, &add);
    if (to != NULL) spread(r->tape->k, &x, r->attr, lg_node_at(r->tape, r->g)->value, to, add);
}

static void avg_pool1d_adjoint_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_record_windows(r->tape, &lg_op_avg_pool1d, r->g, LG_NONE, r->attr, 0);
}

static size_t pool_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return attr->i[0];
}

const lg_op lg_op_avg_pool1d = {
    LG_OP("avg_pool1d", 0, 1, 1, pooled_shape, avg_pool1d_forward, avg_pool1d_vjp, lg_linear_jvp),
    .write_c = avg_pool1d_c, .rows = lg_rows_each, .terms = pool_terms};
const lg_op lg_op_avg_pool1d_adjoint = {
    LG_OP("avg_pool1d_adjoint", 0, 1, 1, spread_shape, avg_pool1d_adjoint_forward, avg_pool1d_adjoint_vjp,
          lg_linear_jvp),
    .write_c = avg_pool1d_adjoint_c, .rows = lg_rows_each, .terms = pool_terms};

/* ---- maximum pooling ---- */

static lg_status pool_pick_forward(lg_evaluation *e) {
    const lg_k_windows w = windows_of(e->in[0], e->attr);
    e->k->window_pick(&w, e->shape->dims[0], e->x[0], e->x[1], e->y);
    return LG_OK;
}

static lg_status pool_place_forward(lg_evaluation *e) {
    const lg_k_windows w = windows_of(e->shape, e->attr);
    e->k->window_place(&w, e->shape->dims[0], e->x[0], e->x[1], e->y, false);
    return LG_OK;
}

static void pool_pick_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, e, e->in[0], "pool_pick", "$0, $1");
}

static void pool_place_c(lg_c *c, const lg_evaluation *e) {
    write_call(c, e, e->shape, "pool_place", "$0, $1");
}

static void pool_pick_vjp(lg_reverse *r) {
    if (!r->need[0]) return;
    if (!lg_reverse_in_place(r)) {
        r->out[0] = lg_record_windows(r->tape, &lg_op_pool_place, r->g, r->in[1], r->attr, 0);
        return;
    }
    bool add = false;
    void *to = lg_reverse_into(r, 0, &add);
    if (to == NULL) return;
    const lg_node *x = lg_node_at(r->tape, r->in[1]);
    const lg_k_windows w = windows_of(&x->shape, r->attr);
    r->tape->k->window_place(&w, x->shape.dims[0], lg_node_at(r->tape, r->g)->value, x->value, to, add);
}

static void pool_place_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_record_windows(r->tape, &lg_op_pool_pick, r->g, r->in[1], r->attr, 0);
}

const lg_op lg_op_pool_pick = {
    LG_OP("pool_pick", 2u, 2, 2, pooled_shape, pool_pick_forward, pool_pick_vjp, lg_linear_jvp),
    .write_c = pool_pick_c, .rows = lg_rows_each};
const lg_op lg_op_pool_place = {
    LG_OP("pool_place", 2u, 2, 2, place_shape, pool_place_forward, pool_place_vjp, lg_linear_jvp),
    .write_c = pool_place_c, .rows = lg_rows_each};

/* ---- public functions ---- */

static lg_var pool(lg_tape *tape, const lg_op *op, const char *name, lg_var x, bool twice, uint32_t size,
                   uint32_t stride) {
    const lg_attr attr = {.i = {size, stride, 0, 0}};
    if (size == 0 || stride == 0)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, name,
                            "the size or the stride is 0, but both must be at least 1");
    return lg_record_windows(tape, op, x, twice ? x : LG_NONE, &attr, 0);
}

lg_var lg_avg_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride) {
    return pool(tape, &lg_op_avg_pool1d, "avg_pool1d", x, false, size, stride);
}

lg_var lg_max_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride) {
    return pool(tape, &lg_op_pool_pick, "max_pool1d", x, true, size, stride);
}
