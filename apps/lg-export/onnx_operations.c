/* The operations of the library in ONNX: those in the table at the end of this file by a function each,
 * elementwise ones by their scalar code. */
#include <math.h>
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/program/scalars.h"
#include "lg-export/onnx.h"
#include "liegrad/tape.h"

bool onnx_give(const onnx_operation *o, onnx_name result) {
    onnx_emit_to(o->j, o->out, "Identity", &result, 1, NULL, 0);
    return true;
}

static uint32_t rank_of(const onnx_operation *o, uint32_t input) {
    return o->j->g->nodes[o->op->inputs[input]].op.rank;
}

/* ---- elementwise operations: a node for each instruction of their scalar code ---- */

/* Sign of x, but 1 at zero, where ONNX's Sign is 0. NaN stays. */
static onnx_name sign(onnx_job *j, onnx_name x) {
    const onnx_name zero = onnx_number(j, 0), one = onnx_number(j, 1), minus = onnx_number(j, -1);
    const onnx_name below = onnx_where(j, onnx_binary(j, "Less", x, zero), minus, x);
    return onnx_where(j, onnx_binary(j, "GreaterOrEqual", x, zero), one, below);
}

/* True if x is negative or -0. The quotient 1/x finds -0, for which x < 0 is false. */
static onnx_name negative(onnx_job *j, onnx_name x) {
    const onnx_name zero = onnx_number(j, 0), over = onnx_binary(j, "Div", onnx_number(j, 1), x);
    return onnx_binary(j, "Or", onnx_binary(j, "Less", x, zero), onnx_binary(j, "Less", over, zero));
}

/* The quotient of the smaller and the larger absolute value gives an angle from 0 to pi/4, which is then
 * mirrored. At the origin the larger one is replaced by 1: the angle is 0 or pi, as in C. If both are
 * infinite, the quotient is 1. */
static onnx_name angle(onnx_job *j, onnx_name rise, onnx_name run) {
    const onnx_name y = onnx_unary(j, "Abs", rise), x = onnx_unary(j, "Abs", run);
    const onnx_name zero = onnx_number(j, 0), half = onnx_number(j, acos(0.0)),
                    whole = onnx_number(j, acos(-1.0));
    const onnx_name steep = onnx_binary(j, "Greater", y, x), large = onnx_where(j, steep, y, x);
    const onnx_name by = onnx_where(j, onnx_binary(j, "Equal", large, zero), onnx_number(j, 1), large);
    const onnx_name small = onnx_where(j, steep, x, y), equal = onnx_binary(j, "Equal", small, by);
    const onnx_name ratio = onnx_where(j, equal, onnx_number(j, 1), onnx_binary(j, "Div", small, by));
    onnx_name turn = onnx_unary(j, "Atan", ratio);
    turn = onnx_where(j, steep, onnx_binary(j, "Sub", half, turn), turn);
    turn = onnx_where(j, negative(j, run), onnx_binary(j, "Sub", whole, turn), turn);
    return onnx_where(j, negative(j, rise), onnx_unary(j, "Neg", turn), turn);
}

/* Adds the nodes of an instruction whose operands are `in`; a single node gives the value `out`. */
static onnx_name instruction(onnx_job *j, const lg_scalar_code *c, const onnx_name *in, onnx_name out) {
    static const char *const types[LG_SCALAR_OPS] = {
        [LG_S_ADD] = "Add",   [LG_S_SUB] = "Sub",        [LG_S_MUL] = "Mul",   [LG_S_DIV] = "Div",
        [LG_S_NEG] = "Neg",   [LG_S_MAX] = "Max",        [LG_S_SQRT] = "Sqrt", [LG_S_ABS] = "Abs",
        [LG_S_EXP] = "Exp",   [LG_S_LOG] = "Log",        [LG_S_SIN] = "Sin",   [LG_S_COS] = "Cos",
        [LG_S_TANH] = "Tanh", [LG_S_SIGMOID] = "Sigmoid"};
    switch (c->op) {
    case LG_S_CONSTANT:
        return onnx_number(j, c->p);
    case LG_S_GE:
        return onnx_cast(j, onnx_binary(j, "GreaterOrEqual", in[0], in[1]), onnx_real_type(j));
    case LG_S_SELECT:
        return onnx_where(j, onnx_cast(j, in[0], ONNX_BOOL), in[1], in[2]);
    case LG_S_SIGN:
        return sign(j, in[0]);
    case LG_S_POW:
        return onnx_binary(j, "Pow", in[0], onnx_number(j, c->p));
    case LG_S_ATAN2:
        return angle(j, in[0], in[1]);
    default:
        onnx_emit_to(j, out.text, types[c->op], in, lg_scalar_instructions(c->op), NULL, 0);
        return out;
    }
}

/* Adds the nodes of the operation's scalar code, from the elements x of its inputs, one input behind the
 * other, to the elements y of its output. Where y is one element and has a name, the value gets this name if
 * it is the result of a node. */
static void add_code(onnx_job *j, const lg_op *row, const lg_evaluation *e, const onnx_name *x,
                     onnx_name *y) {
    lg_scalars s;
    const lg_scalar *in[LG_MAX_INPUTS];
    size_t all = 0;
    for (uint32_t i = 0; i < e->inputs; i++) all += lg_shape_count(*e->in[i]);
    APP_FREE lg_scalar *input = app_alloc(all, sizeof *input), *result = app_alloc(e->count, sizeof *result);
    lg_scalars_init(&s, NULL);
    for (uint32_t k = 0; k < all; k++) input[k] = lg_s_input(&s, k);
    for (size_t i = 0, at = 0; i < e->inputs; at += lg_shape_count(*e->in[i++])) in[i] = input + at;
    if (!lg_scalars_expand(&s, row, e, in, result)) app_out_of_memory();
    APP_FREE uint8_t *live = app_alloc(s.count, 1);
    APP_FREE onnx_name *value = app_alloc(s.count, sizeof *value);
    lg_scalars_mark(&s, result, e->count, live);
    for (uint32_t i = 0; i < s.count; i++) {
        const lg_scalar_code *c = &s.code[i];
        onnx_name operand[3];
        for (uint32_t k = 0; live[i] && k < lg_scalar_instructions(c->op); k++) operand[k] = value[c->in[k]];
        const bool last = i == result[0] && e->count == 1 && y->text[0] != '\0';
        if (live[i])
            value[i] =
                c->op == LG_S_INPUT ? x[c->n] : instruction(j, c, operand, last ? *y : onnx_new_name(j));
    }
    for (size_t i = 0; i < e->count; i++) {
        y[i] = value[result[i]];
        if (s.code[result[i]].op == LG_S_CONSTANT) /* in the shape of x */
            y[i] = onnx_where(j, onnx_binary(j, "Equal", x[0], x[0]), y[i], y[i]);
    }
    lg_scalars_destroy(&s);
}

/* An operation of whole tensors, element by element. `name`: of the value, see add_code. */
static onnx_name elementwise(onnx_job *j, const lg_op *row, const lg_attr *attr, const onnx_name *x,
                             uint32_t inputs, const char *name) {
    onnx_name y;
    const lg_shape one = lg_shape0(), *in[LG_MAX_INPUTS];
    for (uint32_t i = 0; i < inputs; i++) in[i] = &one;
    const lg_evaluation e = {.attr = attr, .inputs = inputs, .in = in, .shape = &one, .count = 1};
    (void)snprintf(y.text, sizeof y.text, "%s", name);
    add_code(j, row, &e, x, &y);
    return y;
}

static bool by_elements(const onnx_operation *o) {
    lg_attr attr = {.c = o->op->real, .pointer = o->op->reals};
    const lg_op *row = lg_op_named(o->op->name);
    if (row == NULL || row->element == NULL) return false;
    for (size_t k = 0; k < LG_COUNT(attr.i); k++) attr.i[k] = (uint32_t)o->op->whole[k].base;
    const onnx_name y = elementwise(o->j, row, &attr, o->x, o->op->input_count, o->out);
    return strcmp(y.text, o->out) == 0 || onnx_give(o, y);
}

static bool scaled(const onnx_operation *o) {
    if (o->op->reciprocal.base == 0 && o->op->reciprocal.rows == 0) return by_elements(o);
    return onnx_give(o, onnx_binary(o->j, "Div", o->x[0], onnx_affine(o->j, o->op->reciprocal)));
}

static onnx_name activated(onnx_job *j, uint32_t kind, onnx_name x) {
    const lg_attr attr = {.i = {kind}};
    return kind == LG_RELU ? onnx_unary(j, "Relu", x) : elementwise(j, lg_op_named("act"), &attr, &x, 1, "");
}

static bool activation(const onnx_operation *o) {
    return onnx_give(o, activated(o->j, (uint32_t)o->op->whole[0].base, o->x[0]));
}

/* The last one or two axes of an operation, without the batch. */
static lg_shape inner_shape(const lg_operation *op, uint32_t axes) {
    lg_shape out = {.rank = axes + 1, .dims = {1}};
    for (uint32_t k = 1; k <= axes; k++) out.dims[k] = (uint32_t)op->shape[op->rank - 1 - axes + k].base;
    return out;
}

/* An operation on vectors or small matrices, the last `axes` axes, whose elements are written out. */
static bool written_out(const onnx_operation *o, uint32_t axes) {
    enum { MOST_ORDER = 6 };
    onnx_job *j = o->j;
    const lg_shape shape = inner_shape(o->op, axes);
    const lg_attr none = {.c = 0};
    lg_shape own[3];
    lg_evaluation e = {.attr = &none,
                       .inputs = o->op->input_count,
                       .in = (const lg_shape *const[]){&own[0], &own[1], &own[2]},
                       .shape = &shape,
                       .count = lg_shape_count(shape)};
    size_t all = 0;
    for (uint32_t i = 0; i < e.inputs; i++) {
        own[i] = inner_shape(&j->g->nodes[o->op->inputs[i]].op, axes);
        all += lg_shape_count(own[i]);
        if (own[0].dims[1] > MOST_ORDER || rank_of(o, i) != o->op->rank) return false;
    }
    APP_FREE onnx_name *x = app_alloc(all, sizeof *x), *y = app_alloc(e.count, sizeof *y);
    for (size_t i = 0, at = 0; i < e.inputs; i++) {
        const int64_t count = (int64_t)lg_shape_count(own[i]);
        const onnx_name flat = onnx_reshape(j, o->x[i], (const lg_affine[]){{0, 1}, {count, 0}}, 2);
        for (int64_t k = 0; k < count; k++) x[at++] = onnx_take(j, flat, &k, 1, 1);
    }
    add_code(j, lg_op_named(o->op->name), &e, x, y);
    return onnx_give(o, onnx_reshape(j, onnx_join(j, y, e.count, 1), o->op->shape, o->op->rank));
}
static bool of_vectors(const onnx_operation *o) {
    return written_out(o, 1);
}
static bool of_matrices(const onnx_operation *o) {
    return written_out(o, 2);
}

/* ---- products ---- */

static onnx_name transposed(onnx_job *j, onnx_name x, uint32_t rank) {
    const int64_t order[2][3] = {{1, 0}, {0, 2, 1}};
    return onnx_transpose(j, x, order[rank - 2], rank);
}

static bool product(const onnx_operation *o) {
    const int64_t kind = o->op->whole[0].base;
    const bool flat = rank_of(o, 0) == 2 && rank_of(o, 1) == 2;
    onnx_name in[3] = {o->x[0], o->x[1], o->x[2]};
    if (kind == 1) in[1] = transposed(o->j, in[1], rank_of(o, 1));
    if (kind == 2) in[0] = transposed(o->j, in[0], rank_of(o, 0));
    if (o->op->input_count == 3 && flat && rank_of(o, 2) == 1) {
        onnx_emit_to(o->j, o->out, "Gemm", in, 3, NULL, 0);
        return true;
    }
    const onnx_name y = onnx_emit(o->j, "MatMul", in, 2, NULL);
    return onnx_give(o, o->op->input_count == 3 ? onnx_binary(o->j, "Add", y, in[2]) : y);
}

static onnx_name dot(onnx_job *j, onnx_name x, onnx_name y) {
    return onnx_binary(j, "ReduceSum", onnx_binary(j, "Mul", x, y), onnx_wholes(j, (int64_t[]){-1}, 1));
}
static bool row_products(const onnx_operation *o) {
    return onnx_give(o, dot(o->j, o->x[0], o->x[1]));
}

/* ---- shapes ---- */

/* 1 where x is NaN, else 0; and y, but NaN where the largest such number `any` is 1. A
 * maximum of onnxruntime ignores NaN; a maximum of the library is NaN if a number is. */
static onnx_name not_a_number(onnx_job *j, onnx_name x) {
    return onnx_cast(j, onnx_unary(j, "IsNaN", x), onnx_real_type(j));
}
static onnx_name keep(onnx_job *j, onnx_name any, onnx_name y) {
    const onnx_name nan = onnx_unary(j, "Sqrt", onnx_unary(j, "Neg", any));
    return onnx_where(j, onnx_cast(j, any, ONNX_BOOL), nan, y);
}

/* Reductions over the middle axis of x seen as (i0, i1, i2). In opset 13 the axes of a sum are an input, the
 * axes of a maximum are an attribute. */
static bool summed(const onnx_operation *o) {
    const onnx_name x = onnx_reshape(o->j, o->x[0], o->op->whole, 3);
    const onnx_name y = onnx_binary(o->j, "ReduceSum", x, onnx_wholes(o->j, (int64_t[]){1}, 1));
    return onnx_give(o, onnx_reshape(o->j, y, o->op->shape, o->op->rank));
}
static bool maximum(const onnx_operation *o) {
    const onnx_attribute axes = {.name = "axes", .type = ONNX_INTS, .i = {1}, .count = 1};
    const onnx_name x = onnx_reshape(o->j, o->x[0], o->op->whole, 3);
    const onnx_name not = not_a_number(o->j, x), y = onnx_emit(o->j, "ReduceMax", &x, 1, &axes);
    const onnx_name kept = keep(o->j, onnx_emit(o->j, "ReduceMax", &not, 1, &axes), y);
    return onnx_give(o, onnx_reshape(o->j, kept, o->op->shape, o->op->rank));
}

/* Adds a first axis to x, and copies x to each row of the batch. */
static bool repeated_for_rows(const onnx_operation *o) {
    lg_affine shape[LG_MAX_RANK] = {{1, 0}};
    if (o->op->whole[0].base != 1 || o->op->shape[0].base != 0 || o->op->shape[0].rows != 1) return false;
    for (uint32_t k = 1; k < o->op->rank; k++) shape[k] = o->op->shape[k];
    return onnx_give(o, onnx_for_each_row(o->j, onnx_reshape(o->j, o->x[0], shape, o->op->rank), o->op));
}

static bool repeated(const onnx_operation *o) {
    if (o->op->whole[1].rows != 0) return repeated_for_rows(o);
    const lg_affine one[3] = {o->op->whole[0], {1, 0}, o->op->whole[2]};
    const onnx_name x = onnx_reshape(o->j, o->x[0], one, 3);
    const onnx_name y =
        onnx_binary(o->j, "Tile", x, onnx_wholes(o->j, (int64_t[]){1, o->op->whole[1].base, 1}, 3));
    return onnx_give(o, onnx_reshape(o->j, y, o->op->shape, o->op->rank));
}

static bool reshaped(const onnx_operation *o) {
    int64_t shape[LG_MAX_RANK];
    return onnx_shape_of(o->op->shape, o->op->rank, shape) &&
           onnx_give(o, onnx_reshape(o->j, o->x[0], o->op->shape, o->op->rank));
}

static bool sliced(const onnx_operation *o) {
    const lg_affine *w = o->op->whole;
    if (w[1].rows != 0 || w[2].rows != 0) return false;
    const onnx_name in[4] = {o->x[0], onnx_wholes(o->j, (int64_t[]){w[1].base}, 1),
                             onnx_wholes(o->j, (int64_t[]){w[1].base + w[2].base}, 1),
                             onnx_wholes(o->j, (int64_t[]){w[0].base}, 1)};
    onnx_emit_to(o->j, o->out, "Slice", in, 4, NULL, 0);
    return true;
}

static bool padded(const onnx_operation *o) {
    int64_t pads[2 * LG_MAX_RANK] = {0};
    const lg_affine *w = o->op->whole;
    if (w[1].rows != 0 || w[2].rows != 0) return false;
    pads[w[0].base] = w[1].base;
    pads[o->op->rank + (size_t)w[0].base] = w[2].base;
    return onnx_give(o, onnx_binary(o->j, "Pad", o->x[0], onnx_wholes(o->j, pads, 2 * o->op->rank)));
}

static bool joined(const onnx_operation *o) {
    const onnx_attribute axis = onnx_axis(o->op->whole[0].base);
    onnx_emit_to(o->j, o->out, "Concat", o->x, o->op->input_count, &axis, 1);
    return true;
}

static bool permuted(const onnx_operation *o) {
    int64_t order[4];
    for (uint32_t k = 0; k < o->op->rank; k++) order[k] = o->op->whole[k].base;
    return onnx_give(o, onnx_transpose(o->j, o->x[0], order, o->op->rank));
}

static bool gathered(const onnx_operation *o) {
    APP_FREE int64_t *places = app_alloc(o->op->index_count, sizeof *places);
    for (uint32_t i = 0; i < o->op->index_count; i++) places[i] = o->op->indices[i];
    const onnx_name y = onnx_take(o->j, o->x[0], places, o->op->index_count, 0);
    return onnx_give(o, y);
}

/* ---- convolutions: of (batch, length, channels); ONNX takes (batch, channels, length) ---- */

static onnx_name channels_first(onnx_job *j, onnx_name x) {
    return onnx_transpose(j, x, (const int64_t[]){0, 2, 1}, 3);
}

static onnx_name convolved(const onnx_operation *o) {
    const lg_affine *w = o->op->whole;
    onnx_name in[3] = {channels_first(o->j, o->x[0]),
                       onnx_transpose(o->j, o->x[1], (const int64_t[]){2, 1, 0}, 3), o->x[2]};
    const onnx_attribute how[2] = {
        {.name = "strides", .type = ONNX_INTS, .i = {w[0].base}, .count = 1},
        {.name = "pads", .type = ONNX_INTS, .i = {w[1].base, w[1].base}, .count = 2}};
    const onnx_name out = onnx_new_name(o->j);
    onnx_emit_to(o->j, out.text, "Conv", in, o->op->input_count, how, 2);
    return out;
}

static onnx_name pooled(onnx_job *j, const char *type, onnx_name x, int64_t size, int64_t stride) {
    const onnx_attribute how[2] = {{.name = "kernel_shape", .type = ONNX_INTS, .i = {size}, .count = 1},
                                   {.name = "strides", .type = ONNX_INTS, .i = {stride}, .count = 1}};
    const onnx_name out = onnx_new_name(j);
    onnx_emit_to(j, out.text, type, &x, 1, how, 2);
    return out;
}

static bool convolution(const onnx_operation *o) {
    return onnx_give(o, channels_first(o->j, convolved(o)));
}

static bool block(const onnx_operation *o) {
    const onnx_name x = activated(o->j, (uint32_t)o->op->real, convolved(o)),
                    y = pooled(o->j, "AveragePool", x, o->op->whole[2].base, o->op->whole[3].base);
    return onnx_give(o, channels_first(o->j, y));
}

static bool average_pool(const onnx_operation *o) {
    const onnx_name y = pooled(o->j, "AveragePool", channels_first(o->j, o->x[0]), o->op->whole[0].base,
                               o->op->whole[1].base);
    return onnx_give(o, channels_first(o->j, y));
}

static bool max_pool(const onnx_operation *o) {
    if (o->op->inputs[0] != o->op->inputs[1]) return false;
    const int64_t size = o->op->whole[0].base, stride = o->op->whole[1].base;
    const onnx_name x = channels_first(o->j, o->x[0]), not = not_a_number(o->j, x);
    const onnx_name any = pooled(o->j, "MaxPool", not, size, stride);
    return onnx_give(o, channels_first(o->j, keep(o->j, any, pooled(o->j, "MaxPool", x, size, stride))));
}

/* ---- the table ---- */

static bool without_form(const onnx_operation *o) {
    return false;
}

/* Operations that are not elementwise, have a form of their own, or exist in single precision only. */
static const struct {
    const char *name;
    /* Returns false if this form of the operation does not exist in ONNX. */
    bool (*translate)(const onnx_operation *o);
    bool single; /* onnxruntime has it in single precision only. */
} rows[] = {{"atan2", by_elements, true},
            {"scale", scaled, false},
            {"act", activation, false},
            {"matmul", product, false},
            {"rowdot", row_products, false},
            {"cross", of_vectors, false},
            {"sum", summed, false},
            {"max_axis", maximum, false},
            {"broadcast", repeated, false},
            {"reshape", reshaped, false},
            {"slice", sliced, false},
            {"pad", padded, false},
            {"concat", joined, false},
            {"permute", permuted, false},
            {"gather", gathered, false},
            {"spd_factor", of_matrices, false},
            {"spd_solve", of_matrices, false},
            {"conv1d", convolution, true},
            {"conv1d_block", block, true},
            {"avg_pool1d", average_pool, true},
            {"pool_pick", max_pool, false},
            {"dexpinv_coef", without_form, false}};

/* Returns the row of an operation, or LG_COUNT(rows) if there is none. */
static size_t row_of(const lg_operation *op) {
    size_t i = 0;
    while (i < LG_COUNT(rows) && strcmp(rows[i].name, op->name) != 0) i++;
    return i;
}

bool onnx_translate(onnx_job *j, uint32_t node) {
    const lg_operation *op = &j->g->nodes[node].op;
    const size_t row = row_of(op);
    const onnx_name out = onnx_name_of(j, node);
    onnx_operation o = {.j = j, .op = op, .out = out.text};
    for (uint32_t i = 0; i < op->input_count; i++) o.x[i] = onnx_name_of(j, op->inputs[i]);
    return row < LG_COUNT(rows) ? rows[row].translate(&o) : by_elements(&o);
}

const char *onnx_single_only(const graph *g) {
    for (size_t k = 0; k < g->count; k++) {
        const graph_node *n = &g->nodes[k];
        const size_t row = n->needed && n->varies ? row_of(&n->op) : LG_COUNT(rows);
        if (row < LG_COUNT(rows) && rows[row].single) return rows[row].name;
    }
    return NULL;
}
