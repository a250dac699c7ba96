/* Operations that only move numbers: views, slices, padding, concatenation and permutation of axes. */
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

#include <stdio.h>
#include <string.h>

extern const lg_op lg_op_slice;

/* The operation can be replaced by its input if it does not change the shape. */
static lg_instead same_instead(const lg_known *k) {
    return lg_same_shape(k->in[0], k->shape) ? lg_instead_input(0) : lg_instead_nothing();
}

/* ---- reshape: a view ---- */

static lg_status reshape_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    return out->rank <= LG_MAX_RANK && lg_shape_count(*out) == lg_shape_count(*in[0]) ? LG_OK : LG_SHAPE;
}

static lg_status reshape_forward(lg_evaluation *e) {
    memcpy(e->y, e->x[0], e->count * e->k->size);
    return LG_OK;
}

static void reshape_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, "copy_rows(1, %zu, $0, 0, $y, 0)", e->count);
}

static bool reshape_view(const lg_shape *const *in, const lg_attr *attr, size_t *offset) {
    *offset = 0;
    return true;
}

static void reshape_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_reshape(r->tape, r->g, lg_node_at(r->tape, r->in[0])->shape);
}

static lg_instead reshape_instead(const lg_known *k) {
    return lg_instead_input(0);
}

static lg_var reshape_again(lg_tape *tape, lg_var x, const lg_attr *attr, lg_shape shape) {
    return lg_reshape(tape, x, shape);
}

const lg_op lg_op_reshape = {
    LG_OP("reshape", 0, 1, 1, reshape_shape, reshape_forward, reshape_vjp, lg_linear_jvp),
    .given = true,
    .view = reshape_view,
    .record = reshape_again,
    .expand = lg_moved_expand,
    .write_c = reshape_c,
    .rows = lg_rows_each,
    .instead = reshape_instead,
    .terms = lg_no_terms};

lg_var lg_reshape(lg_tape *tape, lg_var x, lg_shape shape) {
    const lg_node *node = lg_node_of(tape, x, "reshape");
    if (node == NULL) return LG_NONE;
    if (shape.rank > LG_MAX_RANK || lg_shape_count(shape) != node->count)
        return lg_fail_shapes(tape, "reshape", &node, 1);
    for (uint32_t i = shape.rank; i < LG_MAX_RANK; i++) shape.dims[i] = 0;
    if (lg_same_shape(&shape, &node->shape)) return x;
    return lg_record_value(tape, &lg_op_reshape, &x, 1, NULL, shape, node->value, LG_NODE_VIEW);
}

/* ---- slice and pad, which are each other's adjoints; attr.i = {axis, start of the slice or length of
 * padding before, length of the slice or of padding after, offset of a view} ---- */

/* Copies `rows` runs of `run` bytes each; consecutive runs are from_pitch and to_pitch bytes apart. A short
 * run of known length is copied without a call. */
static void copy_runs(size_t rows, size_t run, const unsigned char *from, size_t from_pitch,
                      unsigned char *to, size_t to_pitch) {
#define COPY(length)                                                                                         \
    for (size_t i = 0; i < rows; i++) memcpy(to + i * to_pitch, from + i * from_pitch, length)
#define SHORT(length)                                                                                        \
    case length:                                                                                             \
        COPY(length);                                                                                        \
        break
    switch (run) {
        SHORT(4);
        SHORT(8);
        SHORT(12);
        SHORT(16);
        SHORT(24);
        SHORT(32);
        SHORT(36);
        SHORT(40);
        SHORT(48);
        SHORT(64);
        SHORT(72);
    default:
        COPY(run);
    }
#undef SHORT
#undef COPY
}

static lg_status slice_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const uint32_t axis = attr->i[0], start = attr->i[1], length = attr->i[2];
    if (axis >= in[0]->rank || start > in[0]->dims[axis] || length > in[0]->dims[axis] - start)
        return LG_INVALID_ARGUMENT;
    *out = *in[0];
    out->dims[axis] = length;
    return LG_OK;
}

static bool slice_view(const lg_shape *const *in, const lg_attr *attr, size_t *offset) {
    size_t outer, length, inner;
    lg_around(in[0], attr->i[0], &outer, &length, &inner);
    *offset = attr->i[1] * inner;
    return outer == 1;
}

static lg_status slice_forward(lg_evaluation *e) {
    size_t outer, length, inner;
    lg_around(e->in[0], e->attr->i[0], &outer, &length, &inner);
    size_t size = e->k->size * inner;
    copy_runs(outer, e->attr->i[2] * size, (const unsigned char *)e->x[0] + e->attr->i[1] * size,
              length * size, e->y, e->attr->i[2] * size);
    return LG_OK;
}

static void slice_c(lg_c *c, const lg_evaluation *e) {
    size_t outer, length, inner;
    lg_around(e->in[0], e->attr->i[0], &outer, &length, &inner);
    const size_t run = e->attr->i[2] * inner;
    lg_c_call(c, "copy_rows(%zu, %zu, $0 + %zu, %zu, $y, %zu)", outer, run, e->attr->i[1] * inner,
              length * inner, run);
}

static void slice_vjp(lg_reverse *r) {
    if (!r->need[0]) return;
    const lg_shape *shape = &lg_node_at(r->tape, r->in[0])->shape;
    const uint32_t *i = r->attr->i;
    r->out[0] = lg_pad(r->tape, r->g, (int)i[0], i[1], shape->dims[i[0]] - i[1] - i[2]);
}

static lg_var slice_again(lg_tape *tape, lg_var x, const lg_attr *attr, lg_shape shape) {
    return lg_slice(tape, x, (int)attr->i[0], attr->i[1], attr->i[2]);
}

const lg_op lg_op_slice = {LG_OP("slice", 0, 1, 1, slice_shape, slice_forward, slice_vjp, lg_linear_jvp),
                           .view = slice_view,
                           .record = slice_again,
                           .follows = 1u << 3,
                           .expand = lg_moved_expand,
                           .write_c = slice_c,
                           .rows = lg_rows_but_axis,
                           .instead = same_instead,
                           .terms = lg_no_terms};

lg_var lg_slice(lg_tape *tape, lg_var x, int axis, uint32_t start, uint32_t length) {
    const lg_node *node = lg_node_of(tape, x, "slice");
    if (node == NULL) return LG_NONE;
    int a = lg_axis(axis, node->shape.rank);
    if (a < 0 || start > node->shape.dims[a] || length > node->shape.dims[a] - start) {
        char reason[160];
        (void)snprintf(reason, sizeof reason,
                       a < 0 ? "there is no axis %d in a tensor of rank %u"
                             : "axis %d has %u elements, of which %u elements from number %u on are wanted",
                       axis, a < 0 ? node->shape.rank : node->shape.dims[a], length, start);
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "slice", reason);
    }
    size_t outer, whole, inner;
    lg_around(&node->shape, (uint32_t)a, &outer, &whole, &inner);
    lg_shape shape = node->shape;
    shape.dims[a] = length;
    lg_attr attr = {.i = {(uint32_t)a, start, length, 0}};
    if (outer != 1 || (size_t)start * inner > UINT32_MAX) return lg_record(tape, &lg_op_slice, &x, 1, &attr);
    attr.i[3] = start * (uint32_t)inner;
    unsigned char *value = (unsigned char *)node->value + (size_t)attr.i[3] * tape->k->size;
    return lg_record_value(tape, &lg_op_slice, &x, 1, &attr, shape, value, LG_NODE_VIEW);
}

static lg_status pad_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const uint32_t axis = attr->i[0];
    if (axis >= in[0]->rank || (uint64_t)in[0]->dims[axis] + attr->i[1] + attr->i[2] > UINT32_MAX)
        return LG_INVALID_ARGUMENT;
    *out = *in[0];
    out->dims[axis] += attr->i[1] + attr->i[2];
    return LG_OK;
}

static lg_status pad_forward(lg_evaluation *e) {
    size_t outer, length, inner;
    lg_around(e->in[0], e->attr->i[0], &outer, &length, &inner);
    size_t size = e->k->size * inner, padded = e->attr->i[1] + length + e->attr->i[2];
    e->k->fill(e->count, 0.0, e->y);
    copy_runs(outer, length * size, e->x[0], length * size, (unsigned char *)e->y + e->attr->i[1] * size,
              padded * size);
    return LG_OK;
}

static void pad_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const size_t before = e->attr->i[1];
    size_t outer, length, inner;
    lg_around(e->in[0], e->attr->i[0], &outer, &length, &inner);
    const size_t whole = before + length + e->attr->i[2];
    for (size_t i = 0; i < e->count; i++) {
        const size_t o = i / (whole * inner), l = i / inner % whole;
        const bool inside = l >= before && l < before + length;
        y[i] = inside ? x[0][(o * length + l - before) * inner + i % inner] : lg_s_constant(s, 0.0);
    }
}

static void pad_c(lg_c *c, const lg_evaluation *e) {
    size_t outer, length, inner;
    lg_around(e->in[0], e->attr->i[0], &outer, &length, &inner);
    const size_t run = length * inner, whole = run + (e->attr->i[1] + (size_t)e->attr->i[2]) * inner;
    lg_c_call(c, "clear(%zu, $y)", e->count);
    lg_c_call(c, "copy_rows(%zu, %zu, $0, %zu, $y + %zu, %zu)", outer, run, run, e->attr->i[1] * inner,
              whole);
}

static void pad_vjp(lg_reverse *r) {
    uint32_t axis = r->attr->i[0];
    if (r->need[0])
        r->out[0] = lg_slice(r->tape, r->g, (int)axis, r->attr->i[1],
                             lg_node_at(r->tape, r->in[0])->shape.dims[axis]);
}

const lg_op lg_op_pad = {LG_OP("pad", 0, 1, 1, pad_shape, pad_forward, pad_vjp, lg_linear_jvp),
                         .expand = pad_expand,
                         .write_c = pad_c,
                         .rows = lg_rows_but_axis,
                         .instead = same_instead,
                         .terms = lg_no_terms};

lg_var lg_pad(lg_tape *tape, lg_var x, int axis, uint32_t before, uint32_t after) {
    const lg_node *node = lg_node_of(tape, x, "pad");
    if (node == NULL) return LG_NONE;
    int a = lg_axis(axis, node->shape.rank);
    if (a < 0 || (uint64_t)node->shape.dims[a] + before + after > UINT32_MAX)
        return lg_tape_fail(
            tape, LG_INVALID_ARGUMENT, "pad",
            "the tensor has no such axis, or the padded axis has more than 2^32 - 1 elements");
    return lg_record(tape, &lg_op_pad, &x, 1, &(lg_attr){.i = {(uint32_t)a, before, after, 0}});
}

/* ---- concatenation; attr.i = {axis} ---- */

static lg_status concat_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const uint32_t axis = attr->i[0];
    uint64_t length = 0;
    if (axis >= in[0]->rank) return LG_INVALID_ARGUMENT;
    for (uint32_t p = 0; p < inputs; p++) {
        lg_shape other = *in[p];
        if (other.rank != in[0]->rank) return LG_SHAPE;
        length += other.dims[axis];
        other.dims[axis] = in[0]->dims[axis];
        if (!lg_same_shape(&other, in[0]) || length > UINT32_MAX) return LG_SHAPE;
    }
    *out = *in[0];
    out->dims[axis] = (uint32_t)length;
    return LG_OK;
}

static lg_status concat_forward(lg_evaluation *e) {
    size_t outer, whole, inner, at = 0;
    lg_around(e->shape, e->attr->i[0], &outer, &whole, &inner);
    size_t size = e->k->size * inner;
    for (uint32_t p = 0; p < e->inputs; p++) {
        size_t length = e->in[p]->dims[e->attr->i[0]];
        copy_runs(outer, length * size, e->x[p], length * size, (unsigned char *)e->y + at * size,
                  whole * size);
        at += length;
    }
    return LG_OK;
}

static void concat_c(lg_c *c, const lg_evaluation *e) {
    size_t outer, whole, inner, at = 0;
    lg_around(e->shape, e->attr->i[0], &outer, &whole, &inner);
    for (uint32_t p = 0; p < e->inputs; p++) {
        const size_t run = e->in[p]->dims[e->attr->i[0]] * inner;
        lg_c_call(c, "copy_rows(%zu, %zu, $%u, %zu, $y + %zu, %zu)", outer, run, p, run, at, whole * inner);
        at += run;
    }
}

static void concat_vjp(lg_reverse *r) {
    uint32_t axis = r->attr->i[0], at = 0;
    for (uint32_t k = 0; k < r->inputs; k++) {
        uint32_t length = lg_node_at(r->tape, r->in[k])->shape.dims[axis];
        if (r->need[k]) r->out[k] = lg_slice(r->tape, r->g, (int)axis, at, length);
        at += length;
    }
}

static lg_var concat_jvp(const lg_forward *f) {
    lg_var parts[LG_MAX_INPUTS];
    for (uint32_t k = 0; k < f->inputs; k++)
        parts[k] = lg_is_none(f->tangents[k]) ? lg_zeros_like(f->tape, f->in[k]) : f->tangents[k];
    return lg_concat(f->tape, parts, f->inputs, (int)f->attr->i[0]);
}

static lg_instead concat_instead(const lg_known *k) {
    return k->inputs == 1 ? lg_instead_input(0) : lg_instead_nothing();
}
const lg_op lg_op_concat = {
    LG_OP("concat", 0, 1, LG_MAX_INPUTS, concat_shape, concat_forward, concat_vjp, concat_jvp),
    .expand = lg_moved_expand,
    .write_c = concat_c,
    .rows = lg_rows_but_axis,
    .instead = concat_instead,
    .terms = lg_no_terms};

/* Concatenates at most LG_MAX_INPUTS parts. */
static lg_var concat_some(lg_tape *tape, const lg_var *parts, size_t n, int axis) {
    const lg_node *first = lg_node_of(tape, parts[0], "concat");
    if (first == NULL) return LG_NONE;
    int a = lg_axis(axis, first->shape.rank);
    if (a < 0) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "concat", "the tensors have no such axis");
    return lg_record(tape, &lg_op_concat, parts, (uint32_t)n, &(lg_attr){.i = {(uint32_t)a, 0, 0, 0}});
}

lg_var lg_concat(lg_tape *tape, const lg_var *parts, size_t n, int axis) {
    if (n == 0)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "concat", "there are no tensors to concatenate");
    if (n <= LG_MAX_INPUTS) return concat_some(tape, parts, n, axis);
    size_t half = n / 2;
    lg_var both[2] = {lg_concat(tape, parts, half, axis), lg_concat(tape, parts + half, n - half, axis)};
    return lg_concat(tape, both, 2, axis);
}

/* ---- permutation of axes; attr.i[d] = the input axis that becomes axis d; i[d] = d for unused d ---- */

static lg_status permute_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    uint32_t seen = 0;
    *out = *in[0];
    for (uint32_t i = 0; i < in[0]->rank; i++) {
        const uint32_t a = attr->i[i];
        if (a >= in[0]->rank || (seen >> a & 1u)) return LG_INVALID_ARGUMENT;
        seen |= 1u << a;
        out->dims[i] = in[0]->dims[a];
    }
    return LG_OK;
}

/* Whether the permutation only swaps the last two axes. */
static bool is_transpose(uint32_t rank, const uint32_t *axes) {
    if (rank < 2 || axes[rank - 1] != rank - 2 || axes[rank - 2] != rank - 1) return false;
    for (uint32_t i = 0; i + 2 < rank; i++)
        if (axes[i] != i) return false;
    return true;
}

/* The loops over the output in its order, the innermost one last, and their steps in the input. */
typedef struct walk {
    size_t dims[LG_MAX_RANK], step[LG_MAX_RANK];
} walk;

static walk walk_of(const lg_evaluation *e) {
    const uint32_t rank = e->shape->rank, before = LG_MAX_RANK - rank;
    size_t stride[LG_MAX_RANK], run = 1;
    walk w = {.dims = {1, 1, 1, 1}};
    for (uint32_t i = rank; i-- > 0; run *= e->in[0]->dims[i]) stride[i] = run;
    for (uint32_t i = 0; i < rank; i++) {
        w.dims[before + i] = e->shape->dims[i];
        w.step[before + i] = stride[e->attr->i[i]];
    }
    return w;
}

static lg_status permute_forward(lg_evaluation *e) {
    const lg_kernels *k = e->k;
    const uint32_t rank = e->shape->rank, *axes = e->attr->i;
    if (is_transpose(rank, axes)) {
        const size_t rows = e->in[0]->dims[rank - 2], columns = e->in[0]->dims[rank - 1];
        for (size_t at = 0; at < e->count; at += rows * columns)
            k->transpose(rows, columns, (const unsigned char *)e->x[0] + at * k->size,
                         (unsigned char *)e->y + at * k->size);
        return LG_OK;
    }
    const walk w = walk_of(e);
    const unsigned char *x = e->x[0];
    unsigned char *y = e->y;
    for (size_t a = 0; a < w.dims[0]; a++)
        for (size_t b = 0; b < w.dims[1]; b++)
            for (size_t c = 0; c < w.dims[2]; c++)
                for (size_t d = 0; d < w.dims[3]; d++, y += k->size) {
                    const size_t at = a * w.step[0] + b * w.step[1] + c * w.step[2] + d * w.step[3];
                    memcpy(y, x + at * k->size, k->size);
                }
    return LG_OK;
}

static void permute_c(lg_c *c, const lg_evaluation *e) {
    const walk w = walk_of(e);
    lg_c_call(c, "permute(%zu, %zu, %zu, %zu, %zu, %zu, %zu, %zu, $0, $y)", w.dims[0], w.dims[1], w.dims[2],
              w.dims[3], w.step[0], w.step[1], w.step[2], w.step[3]);
}

static void inverse_axes(const lg_attr *attr, uint32_t rank, int *axes) {
    for (uint32_t i = 0; i < rank; i++) axes[attr->i[i]] = (int)i;
}

static void permute_vjp(lg_reverse *r) {
    int axes[LG_MAX_RANK];
    inverse_axes(r->attr, lg_node_at(r->tape, r->y)->shape.rank, axes);
    if (r->need[0]) r->out[0] = lg_permute(r->tape, r->g, axes);
}

static lg_row_use permute_rows(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                               uint32_t copies, lg_attr *attr) {
    return attr->i[0] == 0 ? LG_ROWS_EACH : LG_ROWS_MEET;
}

/* No number moves if the axes longer than 1 keep their order. */
static lg_instead permute_instead(const lg_known *k) {
    uint32_t last = 0;
    for (uint32_t d = 0; d < k->shape->rank; d++) {
        if (k->shape->dims[d] == 1) continue;
        if (k->attr->i[d] < last) return lg_instead_nothing();
        last = k->attr->i[d];
    }
    return lg_instead_input(0);
}

const lg_op lg_op_permute = {
    LG_OP("permute", 0, 1, 1, permute_shape, permute_forward, permute_vjp, lg_linear_jvp),
    .expand = lg_moved_expand,
    .write_c = permute_c,
    .rows = permute_rows,
    .instead = permute_instead,
    .terms = lg_no_terms};

lg_var lg_permute(lg_tape *tape, lg_var x, const int *axes) {
    const lg_node *node = lg_node_of(tape, x, "permute");
    if (node == NULL) return LG_NONE;
    const uint32_t rank = node->shape.rank;
    lg_attr attr = {.i = {0, 1, 2, 3}};
    uint32_t seen = 0;
    for (uint32_t i = 0; i < rank; i++) {
        int a = lg_axis(axes[i], rank);
        if (a < 0 || (seen >> a & 1u))
            return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "permute", "the axes are not a permutation");
        seen |= 1u << a;
        attr.i[i] = (uint32_t)a;
    }
    return lg_record(tape, &lg_op_permute, &x, 1, &attr);
}

lg_var lg_transpose(lg_tape *tape, lg_var x) {
    const lg_node *node = lg_node_of(tape, x, "transpose");
    if (node == NULL) return LG_NONE;
    int rank = (int)node->shape.rank, axes[LG_MAX_RANK] = {0, 1, 2, 3};
    if (rank < 2) return lg_tape_fail(tape, LG_SHAPE, "transpose", "the rank is below 2");
    axes[rank - 2] = rank - 1;
    axes[rank - 1] = rank - 2;
    return lg_permute(tape, x, axes);
}
