/* Sums and broadcasts, which are each other's adjoints, and the maximum along an axis.
 *
 * The primitive operations see a tensor as (outer, length, inner): REDUCE sums over the middle axis, REPEAT
 * repeats along it. Every other sum or broadcast is a chain of these. attr.i = {outer, length, inner}. */
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

#include <string.h>

extern const lg_op lg_op_reduce, lg_op_reduce_max, lg_op_argmax_mask;

static lg_var record_sized(lg_tape *tape, const lg_op *op, lg_var x, size_t outer, size_t length,
                           size_t inner, lg_shape shape) {
    if (outer > UINT32_MAX || length > UINT32_MAX || inner > UINT32_MAX)
        return lg_tape_fail(tape, LG_SHAPE, "reduce", "more than 2^32 - 1 elements along an axis");
    const lg_attr attr = {.i = {(uint32_t)outer, (uint32_t)length, (uint32_t)inner, 0}};
    return lg_record_shaped(tape, op, &x, 1, &attr, shape);
}

/* Whether `whole` has outer * length * inner elements and `part` has outer * inner. */
static bool sizes_fit(const lg_shape *whole, const lg_shape *part, const lg_attr *attr) {
    const size_t outer = attr->i[0], inner = attr->i[2];
    const size_t more = lg_shape_count(lg_shape3(attr->i[0], attr->i[1], attr->i[2]));
    return part->rank <= LG_MAX_RANK && more != SIZE_MAX && lg_shape_count(*whole) == more &&
           lg_shape_count(*part) == outer * inner;
}

static lg_status reduce_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    return sizes_fit(in[0], out, attr) ? LG_OK : LG_SHAPE;
}

static lg_status repeat_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    return out->rank <= LG_MAX_RANK && sizes_fit(out, in[0], attr) ? LG_OK : LG_SHAPE;
}

static lg_status mask_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const lg_shape part = lg_shape2(attr->i[0], attr->i[2]);
    return attr->i[1] > 0 && lg_same_shape(in[0], out) && sizes_fit(in[0], &part, attr) ? LG_OK : LG_SHAPE;
}

static lg_status reduce_forward(lg_evaluation *e) {
    const lg_kernels *k = e->k;
    size_t outer = e->attr->i[0], length = e->attr->i[1], inner = e->attr->i[2];
    const unsigned char *x = e->x[0];
    unsigned char *y = e->y;
    /* Without elements, outer may be arbitrarily large, so the loops must be skipped; the same holds
     * below. */
    if (e->count == 0) return LG_OK;
    if (outer == 1 && inner == 1) {
        const double total = k->sum(length, x);
        k->fill(1, total, y);
    } else if (inner == 1) {
        k->sum_cols(outer, length, x, y);
    } else {
        for (size_t o = 0; o < outer; o++)
            k->sum_rows(length, inner, x + o * length * inner * k->size, y + o * inner * k->size, false);
    }
    return LG_OK;
}

static void reduce_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const size_t length = e->attr->i[1], inner = e->attr->i[2];
    for (size_t i = 0; i < e->count; i++)
        y[i] = lg_s_sum(s, x[0] + i / inner * length * inner + i % inner, length, inner);
}

static void reduce_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *size = e->attr->i;
    if (e->k->dtype == LG_F32 && size[1] > 64) {
        lg_c_call(c, "sum_long(%u, %u, %u, $0, $y)", size[0], size[1], size[2]);
        return;
    }
    lg_c_call(c, "sum_axis(%u, %u, %u, $0, $y)", size[0], size[1], size[2]);
}

/* The cotangent of the input, by the adjoint operation. */
static void record_adjoint(lg_reverse *r, const lg_op *adjoint) {
    const lg_shape shape = lg_node_at(r->tape, r->in[0])->shape;
    if (r->need[0]) r->out[0] = lg_record_shaped(r->tape, adjoint, &r->g, 1, r->attr, shape);
}

static void reduce_vjp(lg_reverse *r) {
    record_adjoint(r, &lg_op_repeat);
}

/* Row rule of sums and broadcasts: rows stay apart if they lie within the outer axis. */
static lg_row_use outer_rows(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                             uint32_t copies, lg_attr *attr) {
    if (attr->i[0] % shape->dims[0] != 0) return LG_ROWS_MEET;
    attr->i[0] /= copies;
    return LG_ROWS_EACH;
}

static lg_instead single_instead(const lg_known *k) {
    return k->attr->i[1] == 1 ? lg_instead_input(0) : lg_instead_nothing();
}

static size_t length_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return attr->i[1];
}

const lg_op lg_op_reduce = {LG_OP("sum", 0, 1, 1, reduce_shape, reduce_forward, reduce_vjp, lg_linear_jvp),
                            .given = true,
                            .expand = reduce_expand,
                            .write_c = reduce_c,
                            .rows = outer_rows,
                            .instead = single_instead,
                            .terms = length_terms};

/* y[o, l] = x[o]: the case inner = 1, where single elements are repeated. */
static void repeat_elements(size_t size, size_t outer, size_t length, const void *x, void *y) {
    if (size == sizeof(double)) {
        const double *from = x;
        double *to = y;
        for (size_t o = 0; o < outer; o++)
            for (size_t l = 0; l < length; l++) *to++ = from[o];
    } else {
        const float *from = x;
        float *to = y;
        for (size_t o = 0; o < outer; o++)
            for (size_t l = 0; l < length; l++) *to++ = from[o];
    }
}

static lg_status repeat_forward(lg_evaluation *e) {
    size_t outer = e->attr->i[0], length = e->attr->i[1], inner = e->attr->i[2];
    if (e->count == 0) return LG_OK;
    if (inner == 1) {
        repeat_elements(e->k->size, outer, length, e->x[0], e->y);
        return LG_OK;
    }
    const unsigned char *x = e->x[0];
    unsigned char *y = e->y;
    size_t bytes = inner * e->k->size;
    for (size_t o = 0; o < outer; o++)
        for (size_t l = 0; l < length; l++, y += bytes) memcpy(y, x + o * bytes, bytes);
    return LG_OK;
}

static void repeat_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *size = e->attr->i;
    lg_c_call(c, "repeat(%u, %u, %u, $0, $y)", size[0], size[1], size[2]);
}

static void repeat_vjp(lg_reverse *r) {
    record_adjoint(r, &lg_op_reduce);
}

const lg_op lg_op_repeat = {
    LG_OP("broadcast", 0, 1, 1, repeat_shape, repeat_forward, repeat_vjp, lg_linear_jvp),
    .given = true,
    .expand = lg_moved_expand,
    .write_c = repeat_c,
    .rows = outer_rows,
    .instead = single_instead,
    .terms = lg_no_terms};

/* ---- chains: one primitive operation for each run of adjacent axes to be summed or repeated ---- */

/* The dimension of `small` at axis i of `big`, with last axes aligned; 1 where `small` has no such axis. */
static uint32_t aligned_dim(const lg_shape *small, const lg_shape *big, uint32_t i) {
    uint32_t missing = big->rank - small->rank;
    return i < missing ? 1 : small->dims[i - missing];
}

static bool broadcasts_to(const lg_shape *small, const lg_shape *big) {
    if (small->rank > big->rank) return false;
    for (uint32_t i = 0; i < big->rank; i++) {
        uint32_t d = aligned_dim(small, big, i);
        if (d != big->dims[i] && d != 1) return false;
    }
    return true;
}

/* Applies `op` to every run of adjacent axes in which `small` and `big` differ: from the last run to the
 * first when reducing, from the first to the last when repeating. The result has the shape of `small`
 * (REDUCE) or `big` (REPEAT). */
static lg_var chain(lg_tape *tape, const lg_op *op, lg_var x, const lg_shape *small, const lg_shape *big) {
    bool reducing = op == &lg_op_reduce;
    /* The current shape, with all axes of `big`: an axis to be summed or repeated has length 1 once it is
     * summed or until it is repeated. */
    lg_shape now = *big;
    if (!reducing)
        for (uint32_t i = 0; i < big->rank; i++) now.dims[i] = aligned_dim(small, big, i);
    for (uint32_t step = 0; step < big->rank;) {
        uint32_t i = reducing ? big->rank - 1 - step : step, run = 0;
        while (step + run < big->rank) {
            uint32_t axis = reducing ? i - run : i + run;
            if (aligned_dim(small, big, axis) == big->dims[axis]) break;
            run++;
        }
        if (run == 0) {
            step++;
            continue;
        }
        uint32_t first = reducing ? i - run + 1 : i;
        size_t outer = 1, length = 1, inner = 1;
        for (uint32_t a = 0; a < big->rank; a++) {
            if (a < first) outer *= now.dims[a];
            if (a >= first + run) inner *= now.dims[a];
            if (a >= first && a < first + run) {
                length *= big->dims[a];
                now.dims[a] = reducing ? 1 : big->dims[a];
            }
        }
        x = record_sized(tape, op, x, outer, length, inner, now);
        step += run;
    }
    return lg_reshape(tape, x, reducing ? *small : *big);
}

static lg_var fit(lg_tape *tape, const lg_op *op, lg_var x, lg_shape shape) {
    const lg_node *node = lg_node_of(tape, x, op->name);
    if (node == NULL) return LG_NONE;
    if (shape.rank > LG_MAX_RANK) return lg_tape_fail(tape, LG_SHAPE, op->name, "the rank is above 4");
    if (lg_same_shape(&node->shape, &shape)) return x;
    lg_shape from = node->shape;
    const lg_shape *small = op == &lg_op_reduce ? &shape : &from, *big = op == &lg_op_reduce ? &from : &shape;
    if (!broadcasts_to(small, big)) return lg_fail_shapes(tape, op->name, &node, 1);
    return chain(tape, op, x, small, big);
}

lg_var lg_sum_to(lg_tape *tape, lg_var x, lg_shape shape) {
    return fit(tape, &lg_op_reduce, x, shape);
}

lg_var lg_broadcast_to(lg_tape *tape, lg_var x, lg_shape shape) {
    return fit(tape, &lg_op_repeat, x, shape);
}

lg_var lg_sum(lg_tape *tape, lg_var x) {
    const lg_node *node = lg_node_of(tape, x, "sum");
    if (node == NULL) return LG_NONE;
    return record_sized(tape, &lg_op_reduce, x, 1, node->count, 1, lg_shape0());
}

lg_var lg_mean(lg_tape *tape, lg_var x) {
    const lg_node *node = lg_node_of(tape, x, "mean");
    if (node == NULL) return LG_NONE;
    double count = (double)node->count;
    return lg_scale(tape, lg_sum(tape, x), 1.0 / count);
}

/* ---- along one axis ---- */

static lg_shape without_axis(lg_shape shape, uint32_t axis, bool keep) {
    if (keep) {
        shape.dims[axis] = 1;
        return shape;
    }
    for (uint32_t i = axis; i + 1 < shape.rank; i++) shape.dims[i] = shape.dims[i + 1];
    shape.dims[--shape.rank] = 0;
    return shape;
}

static lg_var along_axis(lg_tape *tape, const lg_op *op, lg_var x, int axis, bool keep, size_t *length) {
    const lg_node *node = lg_node_of(tape, x, op->name);
    if (node == NULL) return LG_NONE;
    int a = lg_axis(axis, node->shape.rank);
    if (a < 0) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, op->name, "the tensor has no such axis");
    size_t outer, inner;
    lg_around(&node->shape, (uint32_t)a, &outer, length, &inner);
    return record_sized(tape, op, x, outer, *length, inner, without_axis(node->shape, (uint32_t)a, keep));
}

lg_var lg_sum_axis(lg_tape *tape, lg_var x, int axis, bool keep) {
    size_t length;
    return along_axis(tape, &lg_op_reduce, x, axis, keep, &length);
}

lg_var lg_mean_axis(lg_tape *tape, lg_var x, int axis, bool keep) {
    size_t length = 1;
    lg_var total = along_axis(tape, &lg_op_reduce, x, axis, keep, &length);
    return lg_is_none(total) ? total : lg_scale(tape, total, 1.0 / (double)length);
}

/* ---- maximum ---- */

/* The middle axis is the only window of each of `outer` series with `inner` channels. */
static lg_k_windows window_of(const lg_attr *attr) {
    const uint32_t *size = attr->i;
    return (lg_k_windows){
        .length = size[1], .channels = size[2], .size = size[1], .stride = size[1], .count = 1};
}

static lg_status reduce_max_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                  lg_shape *out) {
    return attr->i[1] > 0 ? reduce_shape(in, inputs, attr, out) : LG_SHAPE;
}

static lg_status reduce_max_forward(lg_evaluation *e) {
    const lg_k_windows w = window_of(e->attr);
    if (e->count > 0) e->k->window_pick(&w, e->attr->i[0], e->x[0], e->x[0], e->y);
    return LG_OK;
}

static size_t mask_scratch(const lg_evaluation *e) {
    return (size_t)e->attr->i[0] * e->attr->i[2] * e->k->size;
}

static lg_status argmax_mask_forward(lg_evaluation *e) {
    const lg_k_windows w = window_of(e->attr);
    if (e->count == 0) return LG_OK;
    e->k->fill((size_t)e->attr->i[0] * w.channels, 1.0, e->scratch);
    e->k->window_place(&w, e->attr->i[0], e->scratch, e->x[0], e->y, false);
    return LG_OK;
}

static void reduce_max_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *size = e->attr->i;
    lg_c_call(c, "max_axis(%u, %u, %u, $0, $y)", size[0], size[1], size[2]);
}

static void argmax_mask_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *size = e->attr->i;
    lg_c_call(c, "argmax_mask(%u, %u, %u, $0, $y)", size[0], size[1], size[2]);
}

const lg_op lg_op_argmax_mask = {
    LG_OP("argmax_mask", ~0u, 1, 1, mask_shape, argmax_mask_forward, lg_no_vjp, lg_zero_jvp), .given = true,
    .scratch = mask_scratch, .write_c = argmax_mask_c};

static lg_var mask_of(lg_tape *tape, const lg_attr *attr, lg_var x) {
    return lg_record_shaped(tape, &lg_op_argmax_mask, &x, 1, attr, lg_node_at(tape, x)->shape);
}

static void reduce_max_vjp(lg_reverse *r) {
    if (!r->need[0]) return;
    const lg_shape shape = lg_node_at(r->tape, r->in[0])->shape;
    const lg_var spread = lg_record_shaped(r->tape, &lg_op_repeat, &r->g, 1, r->attr, shape);
    r->out[0] = lg_mul(r->tape, spread, mask_of(r->tape, r->attr, r->in[0]));
}

static lg_var reduce_max_jvp(const lg_forward *f) {
    const lg_var chosen = lg_mul(f->tape, f->tangents[0], mask_of(f->tape, f->attr, f->in[0]));
    return lg_record_shaped(f->tape, &lg_op_reduce, &chosen, 1, f->attr, lg_node_at(f->tape, f->y)->shape);
}

const lg_op lg_op_reduce_max = {
    LG_OP("max_axis", 0, 1, 1, reduce_max_shape, reduce_max_forward, reduce_max_vjp, reduce_max_jvp),
    .given = true, .write_c = reduce_max_c};

lg_var lg_max_axis(lg_tape *tape, lg_var x, int axis, bool keep) {
    size_t length;
    return along_axis(tape, &lg_op_reduce_max, x, axis, keep, &length);
}
