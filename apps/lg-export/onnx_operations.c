/* The operations of the library in ONNX: one row per operation in the table at the end of this file. */
#include <math.h>
#include <string.h>

#include "lg-export/onnx.h"
#include "liegrad/tape.h"

bool onnx_give(const onnx_operation *o, onnx_name result) {
    onnx_emit_to(o->j, o->out, "Identity", &result, 1, NULL, 0);
    return true;
}

static uint32_t rank_of(const onnx_operation *o, uint32_t input) {
    return o->j->g->nodes[o->op->inputs[input]].op.rank;
}

/* ---- elementwise operations ---- */

static bool at_least(const onnx_operation *o) {
    const onnx_name truth = onnx_binary(o->j, "GreaterOrEqual", o->x[0], o->x[1]);
    return onnx_give(o, onnx_cast(o->j, truth, onnx_real_type(o->j)));
}

/* Sign of x, but 1 at zero, where ONNX's Sign is 0. NaN stays. */
static bool sign(const onnx_operation *o) {
    onnx_job *j = o->j;
    const onnx_name zero = onnx_number(j, 0), one = onnx_number(j, 1), minus = onnx_number(j, -1);
    const onnx_name below = onnx_where(j, onnx_binary(j, "Less", o->x[0], zero), minus, o->x[0]);
    return onnx_give(o, onnx_where(j, onnx_binary(j, "GreaterOrEqual", o->x[0], zero), one, below));
}

static bool choice(const onnx_operation *o) {
    return onnx_give(o, onnx_where(o->j, onnx_cast(o->j, o->x[0], ONNX_BOOL), o->x[1], o->x[2]));
}

static bool mixture(const onnx_operation *o) {
    const onnx_name rest = onnx_binary(o->j, "Sub", onnx_number(o->j, 1), o->x[0]);
    return onnx_give(o, onnx_binary(o->j, "Add", onnx_binary(o->j, "Mul", rest, o->x[1]),
                                    onnx_binary(o->j, "Mul", o->x[0], o->x[2])));
}

static bool scaled(const onnx_operation *o) {
    if (o->op->reciprocal.base != 0 || o->op->reciprocal.rows != 0)
        return onnx_give(o, onnx_binary(o->j, "Div", o->x[0], onnx_affine(o->j, o->op->reciprocal)));
    return onnx_give(o, onnx_binary(o->j, "Mul", o->x[0], onnx_number(o->j, o->op->real)));
}
static bool shifted(const onnx_operation *o) {
    return onnx_give(o, onnx_binary(o->j, "Add", o->x[0], onnx_number(o->j, o->op->real)));
}
static bool power(const onnx_operation *o) {
    return onnx_give(o, onnx_binary(o->j, "Pow", o->x[0], onnx_number(o->j, o->op->real)));
}

static bool combination(const onnx_operation *o) {
    onnx_name sum = onnx_binary(o->j, "Mul", o->x[0], onnx_number(o->j, o->op->reals[0]));
    for (uint32_t i = 1; i < o->op->input_count; i++)
        sum = onnx_binary(o->j, "Add", sum,
                          onnx_binary(o->j, "Mul", o->x[i], onnx_number(o->j, o->op->reals[i])));
    return onnx_give(o, sum);
}

/* True if x is negative or -0. The quotient 1/x finds -0, for which x < 0 is false. */
static onnx_name negative(onnx_job *j, onnx_name x) {
    const onnx_name zero = onnx_number(j, 0), over = onnx_binary(j, "Div", onnx_number(j, 1), x);
    return onnx_binary(j, "Or", onnx_binary(j, "Less", x, zero), onnx_binary(j, "Less", over, zero));
}

/* The quotient of the smaller and the larger absolute value gives an angle from 0 to pi/4, which is then
 * mirrored. At the origin the larger one is replaced by 1: the angle is 0 or pi, as in C. If both are
 * infinite, the quotient is 1. */
static bool angle(const onnx_operation *o) {
    onnx_job *j = o->j;
    const onnx_name y = onnx_unary(j, "Abs", o->x[0]), x = onnx_unary(j, "Abs", o->x[1]);
    const onnx_name zero = onnx_number(j, 0), half = onnx_number(j, acos(0.0)),
                    whole = onnx_number(j, acos(-1.0));
    const onnx_name steep = onnx_binary(j, "Greater", y, x), large = onnx_where(j, steep, y, x);
    const onnx_name by = onnx_where(j, onnx_binary(j, "Equal", large, zero), onnx_number(j, 1), large);
    const onnx_name small = onnx_where(j, steep, x, y), equal = onnx_binary(j, "Equal", small, by);
    const onnx_name ratio = onnx_where(j, equal, onnx_number(j, 1), onnx_binary(j, "Div", small, by));
    onnx_name turn = onnx_unary(j, "Atan", ratio);
    turn = onnx_where(j, steep, onnx_binary(j, "Sub", half, turn), turn);
    turn = onnx_where(j, negative(j, o->x[1]), onnx_binary(j, "Sub", whole, turn), turn);
    return onnx_give(o, onnx_where(j, negative(j, o->x[0]), onnx_unary(j, "Neg", turn), turn));
}

/* ---- activations ---- */

static onnx_name swish(onnx_job *j, onnx_name x) {
    return onnx_binary(j, "Mul", x, onnx_unary(j, "Sigmoid", x));
}
/* Not LeakyRelu, which onnxruntime does not have in double precision. */
static onnx_name leaky_relu(onnx_job *j, onnx_name x) {
    return onnx_binary(j, "Max", x, onnx_binary(j, "Mul", x, onnx_number(j, 0.01)));
}

/* Terms of sigma'(x): x, s = sigma(x) (for swish, s is the sigmoid of x), 1, and rest = 1 - s. */
typedef struct slope_terms {
    onnx_name x, s, one, rest;
} slope_terms;

static onnx_name tanh_slope(onnx_job *j, const slope_terms *t) {
    return onnx_binary(j, "Sub", t->one, onnx_binary(j, "Mul", t->s, t->s));
}
static onnx_name sigmoid_slope(onnx_job *j, const slope_terms *t) {
    return onnx_binary(j, "Mul", t->s, t->rest);
}
static onnx_name swish_slope(onnx_job *j, const slope_terms *t) {
    return onnx_binary(j, "Mul", t->s, onnx_binary(j, "Add", t->one, onnx_binary(j, "Mul", t->x, t->rest)));
}
static onnx_name sine_slope(onnx_job *j, const slope_terms *t) {
    return onnx_unary(j, "Cos", t->x);
}

static const struct {
    const char *type; /* NULL: `make` is used. */
    onnx_name (*make)(onnx_job *j, onnx_name x);
    onnx_name (*slope)(onnx_job *j, const slope_terms *t); /* NULL: not written in ONNX. */
} activations[LG_ACTIVATION_COUNT] = {[LG_IDENTITY] = {.type = "Identity"},
                                      [LG_TANH] = {.type = "Tanh", .slope = tanh_slope},
                                      [LG_SIGMOID] = {.type = "Sigmoid", .slope = sigmoid_slope},
                                      [LG_SWISH] = {.make = swish, .slope = swish_slope},
                                      [LG_RELU] = {.type = "Relu"},
                                      [LG_LEAKY_RELU] = {.make = leaky_relu},
                                      [LG_SINE] = {.type = "Sin", .slope = sine_slope}};

static bool activated(onnx_job *j, int64_t kind, onnx_name x, onnx_name *out) {
    if (kind < 0 || kind >= LG_ACTIVATION_COUNT) return false;
    *out = activations[kind].make != NULL ? activations[kind].make(j, x)
                                          : onnx_unary(j, activations[kind].type, x);
    return true;
}

static bool activation(const onnx_operation *o) {
    onnx_name y;
    return activated(o->j, o->op->whole[0].base, o->x[0], &y) && onnx_give(o, y);
}

static bool slope(onnx_job *j, int64_t kind, onnx_name x, onnx_name s, onnx_name *out) {
    slope_terms t = {.x = x, .s = s};
    if (kind < 0 || kind >= LG_ACTIVATION_COUNT || activations[kind].slope == NULL) return false;
    t.one = onnx_number(j, 1);
    t.rest = onnx_binary(j, "Sub", t.one, s);
    *out = activations[kind].slope(j, &t);
    return true;
}

/* The activation or its first derivative (order 0 or 1), times a third input if whole[3] is 1. */
static bool activation_derivative(const onnx_operation *o) {
    const int64_t kind = o->op->whole[0].base, order = o->op->whole[1].base;
    onnx_job *j = o->j;
    onnx_name s, y;
    if (order > 1) return false;
    if (o->op->whole[2].base == 1)
        s = o->x[1];
    else if (!activated(j, kind == LG_SWISH ? LG_SIGMOID : kind, o->x[0], &s))
        return false;
    if (order == 0)
        y = kind == LG_SWISH ? onnx_binary(j, "Mul", o->x[0], s) : s;
    else if (!slope(j, kind, o->x[0], s, &y))
        return false;
    if (o->op->whole[3].base == 1) y = onnx_binary(j, "Mul", y, o->x[2]);
    return onnx_give(o, y);
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

static bool crossed(const onnx_operation *o) {
    const int64_t next[3] = {1, 2, 0}, last[3] = {2, 0, 1};
    onnx_job *j = o->j;
    const onnx_name a =
        onnx_binary(j, "Mul", onnx_take(j, o->x[0], next, 3, -1), onnx_take(j, o->x[1], last, 3, -1));
    const onnx_name b =
        onnx_binary(j, "Mul", onnx_take(j, o->x[0], last, 3, -1), onnx_take(j, o->x[1], next, 3, -1));
    return onnx_give(o, onnx_binary(j, "Sub", a, b));
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

/* ---- small symmetric matrices (..., n, n): factors, and systems of equations, element by element ---- */

enum { MOST_SPD = 6 };

/* Element (r, c) of each matrix, as (..., 1). */
static onnx_name element(onnx_job *j, onnx_name x, int64_t r, int64_t c) {
    const onnx_name row = onnx_take(j, x, (int64_t[]){r}, 1, -2),
                    one = onnx_take(j, row, (int64_t[]){c}, 1, -1);
    return onnx_binary(j, "Squeeze", one, onnx_wholes(j, (int64_t[]){-2}, 1));
}

/* Returns x minus the sum of all a[k] b[k]. */
static onnx_name less_products(onnx_job *j, onnx_name x, const onnx_name *a, const onnx_name *b,
                               size_t count) {
    for (size_t k = 0; k < count; k++) x = onnx_binary(j, "Sub", x, onnx_binary(j, "Mul", a[k], b[k]));
    return x;
}

static uint32_t order_of(const onnx_operation *o) {
    const lg_operation *matrix = &o->j->g->nodes[o->op->inputs[0]].op;
    return (uint32_t)matrix->shape[matrix->rank - 1].base;
}

/* Cholesky factor of (x + x^T)/2, row by row. */
static bool factor(const onnx_operation *o) {
    onnx_job *j = o->j;
    const uint32_t n = order_of(o);
    onnx_name L[MOST_SPD][MOST_SPD], rows_of[MOST_SPD];
    if (n > MOST_SPD) return false;
    const onnx_name zero = onnx_number(j, 0), half = onnx_number(j, 0.5);
    for (uint32_t r = 0; r < n; r++) {
        onnx_name row[MOST_SPD];
        for (uint32_t c = 0; c <= r; c++) {
            const onnx_name a = onnx_binary(
                j, "Mul", half, onnx_binary(j, "Add", element(j, o->x[0], r, c), element(j, o->x[0], c, r)));
            const onnx_name rest = less_products(j, a, L[r], L[c], c);
            L[r][c] = c == r ? onnx_unary(j, "Sqrt", rest) : onnx_binary(j, "Div", rest, L[c][c]);
        }
        for (uint32_t c = 0; c < n; c++) row[c] = c <= r ? L[r][c] : onnx_binary(j, "Mul", zero, L[r][0]);
        rows_of[r] =
            onnx_binary(j, "Unsqueeze", onnx_join(j, row, n, -1), onnx_wholes(j, (int64_t[]){-2}, 1));
    }
    return onnx_give(o, onnx_join(j, rows_of, n, -2));
}

/* Solves L L^T y = b, where b is (..., n, m): forward substitution, then back substitution, on rows (..., m)
 * of b. */
static bool solve(const onnx_operation *o) {
    onnx_job *j = o->j;
    const uint32_t n = order_of(o);
    onnx_name L[MOST_SPD][MOST_SPD], y[MOST_SPD];
    if (n > MOST_SPD || rank_of(o, 1) != rank_of(o, 0)) return false;
    for (uint32_t r = 0; r < n; r++)
        for (uint32_t c = 0; c <= r; c++) L[r][c] = element(j, o->x[2], r, c);
    for (uint32_t r = 0; r < n; r++) {
        const onnx_name b = onnx_binary(j, "Squeeze", onnx_take(j, o->x[1], (int64_t[]){r}, 1, -2),
                                        onnx_wholes(j, (int64_t[]){-2}, 1));
        y[r] = onnx_binary(j, "Div", less_products(j, b, L[r], y, r), L[r][r]);
    }
    for (uint32_t r = n; r-- > 0;) {
        onnx_name column[MOST_SPD];
        for (uint32_t k = r + 1; k < n; k++) column[k - r - 1] = L[k][r];
        y[r] = onnx_binary(j, "Div", less_products(j, y[r], column, y + r + 1, n - 1 - r), L[r][r]);
    }
    for (uint32_t r = 0; r < n; r++)
        y[r] = onnx_binary(j, "Unsqueeze", y[r], onnx_wholes(j, (int64_t[]){-2}, 1));
    return onnx_give(o, onnx_join(j, y, n, -2));
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
    onnx_name y;
    if (!activated(o->j, (int64_t)o->op->real, convolved(o), &y)) return false;
    y = pooled(o->j, "AveragePool", y, o->op->whole[2].base, o->op->whole[3].base);
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

static const struct {
    const char *name, *type; /* type: the ONNX operator that takes the same inputs, or NULL. */
    /* Returns false if this form of the operation does not exist in ONNX. */
    bool (*translate)(const onnx_operation *o);
    bool single; /* onnxruntime has it in single precision only. */
} rows[] = {{"add", "Add", NULL, false},
            {"sub", "Sub", NULL, false},
            {"mul", "Mul", NULL, false},
            {"div", "Div", NULL, false},
            {"max", "Max", NULL, false},
            {"sqrt", "Sqrt", NULL, false},
            {"exp", "Exp", NULL, false},
            {"log", "Log", NULL, false},
            {"sin", "Sin", NULL, false},
            {"cos", "Cos", NULL, false},
            {"abs", "Abs", NULL, false},
            {"stop_gradient", "Identity", NULL, false},
            {"ge", NULL, at_least, false},
            {"sign", NULL, sign, false},
            {"atan2", NULL, angle, true},
            {"select", NULL, choice, false},
            {"mix", NULL, mixture, false},
            {"combine", NULL, combination, false},
            {"scale", NULL, scaled, false},
            {"shift", NULL, shifted, false},
            {"pow", NULL, power, false},
            {"act", NULL, activation, false},
            {"act_derivative", NULL, activation_derivative, false},
            {"matmul", NULL, product, false},
            {"rowdot", NULL, row_products, false},
            {"cross", NULL, crossed, false},
            {"sum", NULL, summed, false},
            {"max_axis", NULL, maximum, false},
            {"broadcast", NULL, repeated, false},
            {"reshape", NULL, reshaped, false},
            {"slice", NULL, sliced, false},
            {"pad", NULL, padded, false},
            {"concat", NULL, joined, false},
            {"permute", NULL, permuted, false},
            {"gather", NULL, gathered, false},
            {"spd_factor", NULL, factor, false},
            {"spd_solve", NULL, solve, false},
            {"conv1d", NULL, convolution, true},
            {"conv1d_block", NULL, block, true},
            {"avg_pool1d", NULL, average_pool, true},
            {"pool_pick", NULL, max_pool, false}};

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
    if (row == LG_COUNT(rows)) return false;
    for (uint32_t i = 0; i < op->input_count; i++) o.x[i] = onnx_name_of(j, op->inputs[i]);
    if (rows[row].type == NULL) return rows[row].translate(&o);
    onnx_emit_to(j, o.out, rows[row].type, o.x, op->input_count, NULL, 0);
    return true;
}

const char *onnx_single_only(const graph *g) {
    for (size_t k = 0; k < g->count; k++) {
        const graph_node *n = &g->nodes[k];
        const size_t row = n->needed && n->varies ? row_of(&n->op) : LG_COUNT(rows);
        if (row < LG_COUNT(rows) && rows[row].single) return rows[row].name;
    }
    return NULL;
}
