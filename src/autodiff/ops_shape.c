/* Operations that move numbers: views, slices, pads, concatenation, permutation, gather and scatter. */
#include "autodiff/tape_internal.h"

#include <string.h>

/* ---- reshape: a view ---- */

static lg_status never_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    (void)tape, (void)in, (void)out;
    return LG_INVALID_ARGUMENT;
}

static void reshape_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_reshape(r->tape, r->g, lg_node_at(r->tape, r->in[0])->shape);
}

static lg_var reshape_jvp(const lg_forward *f) {
    return lg_reshape(f->tape, f->tangents[0], lg_node_at(f->tape, f->y)->shape);
}

const lg_op lg_op_reshape = {"reshape", 0, lg_given_shape, never_forward, reshape_vjp, reshape_jvp};

lg_var lg_reshape(lg_tape *tape, lg_var x, lg_shape shape) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "reshape");
    if (node == NULL) return LG_NONE;
    if (shape.rank > LG_MAX_RANK || lg_shape_count(shape) != node->count)
        return lg_fail_shapes(tape, "reshape", &node, 1);
    for (uint32_t i = shape.rank; i < LG_MAX_RANK; i++) shape.dims[i] = 0;
    if (lg_same_shape(&shape, &node->shape)) return x;
    return lg_record_value(tape, LG_OP_RESHAPE, &x, 1, NULL, shape, node->value, LG_NODE_VIEW);
}

/* ---- slice and pad: each other's adjoints; attr.i = {axis, start or before, length or after, view offset}
 * ---- */

/* Copies `rows` runs of `run` bytes between buffers with their own pitches. */
static void copy_runs(size_t rows, size_t run, const unsigned char *from, size_t from_pitch,
                      unsigned char *to, size_t to_pitch) {
    for (size_t i = 0; i < rows; i++) memcpy(to + i * to_pitch, from + i * from_pitch, run);
}

static lg_status slice_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    size_t outer, length, inner;
    lg_around(&in[0]->shape, out->attr.i[0], &outer, &length, &inner);
    size_t size = tape->k->size * inner;
    copy_runs(outer, out->attr.i[2] * size, (const unsigned char *)in[0]->value + out->attr.i[1] * size,
              length * size, out->value, out->attr.i[2] * size);
    return LG_OK;
}

static void slice_vjp(lg_reverse *r) {
    if (!r->need[0]) return;
    const lg_shape *shape = &lg_node_at(r->tape, r->in[0])->shape;
    const uint32_t *i = r->attr->i;
    r->out[0] = lg_pad(r->tape, r->g, (int)i[0], i[1], shape->dims[i[0]] - i[1] - i[2]);
}

static lg_var slice_jvp(const lg_forward *f) {
    return lg_slice(f->tape, f->tangents[0], (int)f->attr->i[0], f->attr->i[1], f->attr->i[2]);
}

const lg_op lg_op_slice = {"slice", 0, lg_given_shape, slice_forward, slice_vjp, slice_jvp};

lg_var lg_slice(lg_tape *tape, lg_var x, int axis, uint32_t start, uint32_t length) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "slice");
    if (node == NULL) return LG_NONE;
    int a = lg_axis(axis, node->shape.rank);
    if (a < 0 || start > node->shape.dims[a] || length > node->shape.dims[a] - start)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "slice", "no such axis, or the range leaves it");
    size_t outer, whole, inner;
    lg_around(&node->shape, (uint32_t)a, &outer, &whole, &inner);
    lg_shape shape = node->shape;
    shape.dims[a] = length;
    lg_attr attr = {.i = {(uint32_t)a, start, length, 0}};
    if (outer != 1 || (size_t)start * inner > UINT32_MAX)
        return lg_record_shaped(tape, LG_OP_SLICE, &x, 1, attr, shape);
    attr.i[3] = start * (uint32_t)inner;
    unsigned char *value = (unsigned char *)node->value + (size_t)attr.i[3] * tape->k->size;
    return lg_record_value(tape, LG_OP_SLICE, &x, 1, &attr, shape, value, LG_NODE_VIEW);
}

static lg_status pad_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    size_t outer, length, inner;
    lg_around(&in[0]->shape, out->attr.i[0], &outer, &length, &inner);
    size_t size = tape->k->size * inner, padded = out->attr.i[1] + length + out->attr.i[2];
    tape->k->fill(out->count, 0.0, out->value);
    copy_runs(outer, length * size, in[0]->value, length * size,
              (unsigned char *)out->value + out->attr.i[1] * size, padded * size);
    return LG_OK;
}

static void pad_vjp(lg_reverse *r) {
    uint32_t axis = r->attr->i[0];
    if (r->need[0])
        r->out[0] = lg_slice(r->tape, r->g, (int)axis, r->attr->i[1],
                             lg_node_at(r->tape, r->in[0])->shape.dims[axis]);
}

static lg_var pad_jvp(const lg_forward *f) {
    return lg_pad(f->tape, f->tangents[0], (int)f->attr->i[0], f->attr->i[1], f->attr->i[2]);
}

const lg_op lg_op_pad = {"pad", 0, lg_given_shape, pad_forward, pad_vjp, pad_jvp};

lg_var lg_pad(lg_tape *tape, lg_var x, int axis, uint32_t before, uint32_t after) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "pad");
    if (node == NULL) return LG_NONE;
    int a = lg_axis(axis, node->shape.rank);
    if (a < 0 || (uint64_t)node->shape.dims[a] + before + after > UINT32_MAX)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "pad", "no such axis, or it becomes too long");
    lg_shape shape = node->shape;
    shape.dims[a] += before + after;
    return lg_record_shaped(tape, LG_OP_PAD, &x, 1, (lg_attr){.i = {(uint32_t)a, before, after, 0}}, shape);
}

/* ---- concatenation; attr.i = {axis} ---- */

static lg_status concat_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    size_t outer, whole, inner, at = 0;
    lg_around(&out->shape, out->attr.i[0], &outer, &whole, &inner);
    size_t size = tape->k->size * inner;
    for (uint32_t p = 0; p < out->inputs; p++) {
        size_t length = in[p]->shape.dims[out->attr.i[0]];
        copy_runs(outer, length * size, in[p]->value, length * size, (unsigned char *)out->value + at * size,
                  whole * size);
        at += length;
    }
    return LG_OK;
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

const lg_op lg_op_concat = {"concat", 0, lg_given_shape, concat_forward, concat_vjp, concat_jvp};

/* At most LG_MAX_INPUTS parts. */
static lg_var concat_some(lg_tape *tape, const lg_var *parts, size_t n, int axis) {
    const lg_node *first = lg_node_of(tape, parts[0], "concat");
    if (first == NULL) return LG_NONE;
    int a = lg_axis(axis, first->shape.rank);
    if (a < 0) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "concat", "no such axis");
    lg_shape shape = first->shape;
    uint64_t length = shape.dims[a];
    for (size_t p = 1; p < n; p++) {
        const lg_node *node = lg_node_of(tape, parts[p], "concat");
        if (node == NULL) return LG_NONE;
        lg_shape other = node->shape;
        if (other.rank == shape.rank) {
            length += other.dims[a];
            other.dims[a] = shape.dims[a];
        }
        const lg_node *both[2] = {first, node};
        if (!lg_same_shape(&other, &shape)) return lg_fail_shapes(tape, "concat", both, 2);
    }
    if (length > UINT32_MAX) return lg_tape_fail(tape, LG_SHAPE, "concat", "the result is too long");
    shape.dims[a] = (uint32_t)length;
    return lg_record_shaped(tape, LG_OP_CONCAT, parts, (uint32_t)n, (lg_attr){.i = {(uint32_t)a, 0, 0, 0}},
                            shape);
}

lg_var lg_concat(lg_tape *tape, const lg_var *parts, size_t n, int axis) {
    if (tape->status != LG_OK) return LG_NONE;
    if (n == 0) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "concat", "nothing to concatenate");
    if (n <= LG_MAX_INPUTS) return concat_some(tape, parts, n, axis);
    size_t half = n / 2;
    lg_var both[2] = {lg_concat(tape, parts, half, axis), lg_concat(tape, parts + half, n - half, axis)};
    return lg_concat(tape, both, 2, axis);
}

/* ---- permutation of axes; attr.i = axes, unused places hold themselves ---- */

static lg_status permute_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    const lg_kernels *k = tape->k;
    const uint32_t rank = out->shape.rank, *axes = out->attr.i;
    if (rank == 2 && axes[0] == 1) {
        k->transpose(in[0]->shape.dims[0], in[0]->shape.dims[1], in[0]->value, out->value);
        return LG_OK;
    }
    size_t stride[LG_MAX_RANK], dims[LG_MAX_RANK] = {1, 1, 1, 1}, step[LG_MAX_RANK] = {0, 0, 0, 0}, run = 1;
    for (uint32_t i = rank; i-- > 0;) {
        stride[i] = run;
        run *= in[0]->shape.dims[i];
    }
    for (uint32_t i = 0; i < rank; i++) {
        dims[LG_MAX_RANK - rank + i] = out->shape.dims[i];
        step[LG_MAX_RANK - rank + i] = stride[axes[i]];
    }
    const unsigned char *x = in[0]->value;
    unsigned char *y = out->value;
    for (size_t a = 0; a < dims[0]; a++)
        for (size_t b = 0; b < dims[1]; b++)
            for (size_t c = 0; c < dims[2]; c++)
                for (size_t d = 0; d < dims[3]; d++, y += k->size)
                    memcpy(y, x + (a * step[0] + b * step[1] + c * step[2] + d * step[3]) * k->size, k->size);
    return LG_OK;
}

static void inverse_axes(const lg_attr *attr, uint32_t rank, int *axes) {
    for (uint32_t i = 0; i < rank; i++) axes[attr->i[i]] = (int)i;
}

static void permute_vjp(lg_reverse *r) {
    int axes[LG_MAX_RANK];
    inverse_axes(r->attr, lg_node_at(r->tape, r->y)->shape.rank, axes);
    if (r->need[0]) r->out[0] = lg_permute(r->tape, r->g, axes);
}

static lg_var permute_jvp(const lg_forward *f) {
    int axes[LG_MAX_RANK];
    for (uint32_t i = 0; i < LG_MAX_RANK; i++) axes[i] = (int)f->attr->i[i];
    return lg_permute(f->tape, f->tangents[0], axes);
}

const lg_op lg_op_permute = {"permute", 0, lg_given_shape, permute_forward, permute_vjp, permute_jvp};

lg_var lg_permute(lg_tape *tape, lg_var x, const int *axes) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "permute");
    if (node == NULL) return LG_NONE;
    lg_shape shape = node->shape;
    lg_attr attr = {.i = {0, 1, 2, 3}};
    uint32_t seen = 0;
    for (uint32_t i = 0; i < shape.rank; i++) {
        int a = lg_axis(axes[i], shape.rank);
        if (a < 0 || (seen >> a & 1u))
            return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "permute", "not a permutation");
        seen |= 1u << a;
        attr.i[i] = (uint32_t)a;
        shape.dims[i] = node->shape.dims[a];
    }
    return lg_record_shaped(tape, LG_OP_PERMUTE, &x, 1, attr, shape);
}

lg_var lg_transpose(lg_tape *tape, lg_var x) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "transpose");
    if (node == NULL) return LG_NONE;
    int rank = (int)node->shape.rank, axes[LG_MAX_RANK] = {0, 1, 2, 3};
    if (rank < 2) return lg_tape_fail(tape, LG_SHAPE, "transpose", "rank below 2");
    axes[rank - 2] = rank - 1;
    axes[rank - 1] = rank - 2;
    return lg_permute(tape, x, axes);
}

/* ---- gather and scatter rows: each other's adjoints; attr.pointer = indices (payload), attr.i = {n, rows}
 * ---- */

static lg_status gather_shape(const lg_node *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    (void)inputs;
    if (in[0]->shape.rank == 0) return LG_SHAPE;
    *out = in[0]->shape;
    out->dims[0] = attr->i[0];
    return LG_OK;
}

static lg_status scatter_shape(const lg_node *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    (void)inputs;
    if (in[0]->shape.rank == 0 || in[0]->shape.dims[0] != attr->i[0]) return LG_SHAPE;
    *out = in[0]->shape;
    out->dims[0] = attr->i[1];
    return LG_OK;
}

static size_t row_length(const lg_node *x) {
    return x->shape.dims[0] == 0 ? 0 : x->count / x->shape.dims[0];
}

static lg_status gather_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    const uint32_t *indices = out->attr.pointer;
    size_t bytes = row_length(in[0]) * tape->k->size;
    for (size_t i = 0; i < out->attr.i[0]; i++)
        memcpy((unsigned char *)out->value + i * bytes,
               (const unsigned char *)in[0]->value + indices[i] * bytes, bytes);
    return LG_OK;
}

static lg_status scatter_forward(lg_tape *tape, const lg_node *const *in, lg_node *out) {
    const uint32_t *indices = out->attr.pointer;
    size_t length = row_length(in[0]), bytes = length * tape->k->size;
    tape->k->fill(out->count, 0.0, out->value);
    for (size_t i = 0; i < out->attr.i[0]; i++)
        tape->k->axpy(length, 1.0, (const unsigned char *)in[0]->value + i * bytes,
                      (unsigned char *)out->value + indices[i] * bytes);
    return LG_OK;
}

/* The payload is already the tape's: derivatives share it. */
static lg_var record_indexed(lg_tape *tape, lg_op_code op, lg_var x, const lg_attr *attr) {
    return lg_record(tape, op, &x, 1, attr);
}

static void gather_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = record_indexed(r->tape, LG_OP_SCATTER, r->g, r->attr);
}
static lg_var gather_jvp(const lg_forward *f) {
    return record_indexed(f->tape, LG_OP_GATHER, f->tangents[0], f->attr);
}
const lg_op lg_op_gather = {"gather", 0, gather_shape, gather_forward, gather_vjp, gather_jvp};

static void scatter_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = record_indexed(r->tape, LG_OP_GATHER, r->g, r->attr);
}
static lg_var scatter_jvp(const lg_forward *f) {
    return record_indexed(f->tape, LG_OP_SCATTER, f->tangents[0], f->attr);
}
const lg_op lg_op_scatter = {"scatter", 0, scatter_shape, scatter_forward, scatter_vjp, scatter_jvp};

static lg_var index_rows(lg_tape *tape, lg_op_code op, lg_var x, const uint32_t *indices, uint32_t n,
                         uint32_t rows) {
    for (uint32_t i = 0; i < n; i++)
        if (indices[i] >= rows)
            return lg_tape_fail(tape, LG_INVALID_ARGUMENT, lg_ops[op]->name, "an index is out of range");
    uint32_t *kept = lg_payload_allocate(tape, (size_t)n * sizeof *kept);
    if (kept == NULL) return LG_NONE;
    memcpy(kept, indices, (size_t)n * sizeof *kept);
    lg_attr attr = {.i = {n, rows, 0, 0}, .pointer = kept};
    return record_indexed(tape, op, x, &attr);
}

lg_var lg_gather(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *node = lg_node_of(tape, x, "gather");
    if (node == NULL) return LG_NONE;
    return index_rows(tape, LG_OP_GATHER, x, indices, n, node->shape.rank == 0 ? 0 : node->shape.dims[0]);
}

lg_var lg_scatter(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n, uint32_t rows) {
    if (tape->status != LG_OK) return LG_NONE;
    return index_rows(tape, LG_OP_SCATTER, x, indices, n, rows);
}
