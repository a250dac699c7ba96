/* ONNX (onnx.ai, opset 13): a function of a program as a graph of standard operators. Each operation of the
 * library that has a form in ONNX is a row of the table below; what depends on parameters alone is an
 * initializer. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/graph.h"
#include "lg-export/protobuf.h"
#include "liegrad/activation.h"

enum { IR_VERSION = 8, OPSET = 13, TYPE_FLOAT = 1, TYPE_INT64 = 7, TYPE_BOOL = 9, TYPE_DOUBLE = 11 };

typedef struct job {
    const graph *g;
    const export_options *options;
    text graph; /* the nodes and initializers so far */
    size_t helpers;
    bool has_batch; /* the node "/batch" is there: the number of rows, shape (1) */
} job;

/* The name of a value. */
typedef struct name {
    char text[24];
} name;

static name name_of(const job *j, uint32_t node) {
    name n;
    const graph_node *k = &j->g->nodes[node];
    if (strcmp(k->op.name, "input") == 0)
        (void)snprintf(n.text, sizeof n.text, "%.23s", j->g->inputs[k->op.whole[0].base].name);
    else
        (void)snprintf(n.text, sizeof n.text, "/v%u", node);
    return n;
}

static name new_name(job *j) {
    name n;
    (void)snprintf(n.text, sizeof n.text, "/h%zu", j->helpers++);
    return n;
}

/* ---- tensors ---- */

static int real_type(const job *j) {
    return j->options->dtype == LG_F32 ? TYPE_FLOAT : TYPE_DOUBLE;
}

static void add_tensor(job *j, const char *called, int type, const int64_t *dims, size_t rank,
                       const void *data, size_t bytes) {
    text tensor = {.data = NULL};
    for (size_t i = 0; i < rank; i++) proto_whole(&tensor, 1, dims[i]);
    proto_whole(&tensor, 2, type);
    proto_text(&tensor, 8, called);
    proto_bytes(&tensor, 9, data, bytes);
    proto_message(&j->graph, 5, &tensor);
}

static void add_reals(job *j, const char *called, const int64_t *dims, size_t rank, const double *values,
                      size_t count) {
    if (j->options->dtype != LG_F32) {
        add_tensor(j, called, TYPE_DOUBLE, dims, rank, values, count * sizeof *values);
    } else {
        float *narrow = app_alloc(count, sizeof *narrow);
        for (size_t i = 0; i < count; i++) narrow[i] = (float)values[i];
        add_tensor(j, called, TYPE_FLOAT, dims, rank, narrow, count * sizeof *narrow);
        free(narrow);
    }
    for (size_t i = 0; i < count; i++)
        if (!isfinite(export_round(j->options, values[i]))) j->graph.unfit = true;
}

static name number(job *j, double value) {
    const name n = new_name(j);
    add_reals(j, n.text, NULL, 0, &value, 1);
    return n;
}

static name wholes(job *j, const int64_t *values, size_t count) {
    const name n = new_name(j);
    const int64_t dim = (int64_t)count;
    add_tensor(j, n.text, TYPE_INT64, &dim, 1, values, count * sizeof *values);
    return n;
}

/* ---- nodes ---- */

typedef struct attribute {
    const char *name;
    enum { INT, INTS } type;
    int64_t i[4];
    size_t count;
} attribute;

static void add_attribute(text *node, const attribute *a) {
    static const int types[] = {[INT] = 2, [INTS] = 7};
    text message = {.data = NULL};
    proto_text(&message, 1, a->name);
    if (a->type == INT) proto_whole(&message, 3, a->i[0]);
    for (size_t k = 0; a->type == INTS && k < a->count; k++) proto_whole(&message, 8, a->i[k]);
    proto_whole(&message, 20, types[a->type]);
    proto_message(node, 5, &message);
}

static void emit_to(job *j, const char *out, const char *type, const name *in, size_t inputs,
                    const attribute *with, size_t attributes) {
    text node = {.data = NULL};
    for (size_t i = 0; i < inputs; i++) proto_text(&node, 1, in[i].text);
    proto_text(&node, 2, out);
    proto_text(&node, 3, out);
    proto_text(&node, 4, type);
    for (size_t i = 0; i < attributes; i++) add_attribute(&node, &with[i]);
    proto_message(&j->graph, 1, &node);
}

static name emit(job *j, const char *type, const name *in, size_t inputs, const attribute *with) {
    const name out = new_name(j);
    emit_to(j, out.text, type, in, inputs, with, with != NULL);
    return out;
}

static name unary(job *j, const char *type, name x) {
    return emit(j, type, &x, 1, NULL);
}

static name binary(job *j, const char *type, name x, name y) {
    return emit(j, type, (name[]){x, y}, 2, NULL);
}

static name where(job *j, name condition, name yes, name no) {
    return emit(j, "Where", (name[]){condition, yes, no}, 3, NULL);
}

static name cast(job *j, name x, int to) {
    const attribute a = {.name = "to", .type = INT, .i = {to}};
    return emit(j, "Cast", &x, 1, &a);
}

/* The axes in another order. */
static name transpose(job *j, name x, const int64_t *order, size_t rank) {
    attribute a = {.name = "perm", .type = INTS, .count = rank};
    memcpy(a.i, order, rank * sizeof *order);
    return emit(j, "Transpose", &x, 1, &a);
}

/* ---- shapes ---- */

/* -1 for a dimension with rows; false: more than one has. */
static bool shape_of(const lg_affine *dims, size_t rank, int64_t *out) {
    size_t open = 0;
    for (size_t k = 0; k < rank; k++) {
        out[k] = dims[k].rows != 0 ? -1 : dims[k].base;
        open += dims[k].rows != 0;
    }
    return open <= 1;
}

static name reshape(job *j, name x, const lg_affine *dims, size_t rank) {
    int64_t shape[LG_MAX_RANK];
    (void)shape_of(dims, rank, shape);
    return binary(j, "Reshape", x, wholes(j, shape, rank));
}

/* The tensor with a first dimension of rows: a copy for each row. */
static name for_each_row(job *j, name x, const lg_operation *op) {
    int64_t rest[LG_MAX_RANK];
    const name batch = {"/batch"};
    if (!j->has_batch) {
        const name shape = unary(j, "Shape", name_of(j, 0));
        const name first = wholes(j, (int64_t[]){0}, 1);
        emit_to(j, batch.text, "Gather", (name[]){shape, first}, 2, NULL, 0);
        j->has_batch = true;
    }
    for (uint32_t k = 1; k < op->rank; k++) rest[k - 1] = op->shape[k].base;
    const attribute axis = {.name = "axis", .type = INT, .i = {0}};
    name shape = batch;
    if (op->rank > 1) shape = emit(j, "Concat", (name[]){batch, wholes(j, rest, op->rank - 1)}, 2, &axis);
    return binary(j, "Expand", x, shape);
}

/* ---- operations ---- */

typedef struct operation {
    job *j;
    const lg_operation *op;
    name x[64];
    const char *out;
} operation;

/* Gives the result its name. */
static bool give(const operation *o, name result) {
    emit_to(o->j, o->out, "Identity", &result, 1, NULL, 0);
    return true;
}

static bool give_binary(const operation *o, const char *type) {
    emit_to(o->j, o->out, type, o->x, 2, NULL, 0);
    return true;
}

static bool give_unary(const operation *o, const char *type) {
    emit_to(o->j, o->out, type, o->x, 1, NULL, 0);
    return true;
}

static bool add(const operation *o) {
    return give_binary(o, "Add");
}
static bool sub(const operation *o) {
    return give_binary(o, "Sub");
}
static bool mul(const operation *o) {
    return give_binary(o, "Mul");
}
static bool quotient(const operation *o) {
    return give_binary(o, "Div");
}
static bool larger(const operation *o) {
    return give_binary(o, "Max");
}
static bool root(const operation *o) {
    return give_unary(o, "Sqrt");
}
static bool exponential(const operation *o) {
    return give_unary(o, "Exp");
}
static bool logarithm(const operation *o) {
    return give_unary(o, "Log");
}
static bool sine(const operation *o) {
    return give_unary(o, "Sin");
}
static bool cosine(const operation *o) {
    return give_unary(o, "Cos");
}
static bool absolute(const operation *o) {
    return give_unary(o, "Abs");
}
static bool sign(const operation *o) {
    return give_unary(o, "Sign");
}
static bool identity(const operation *o) {
    return give_unary(o, "Identity");
}

static bool at_least(const operation *o) {
    const name truth = binary(o->j, "GreaterOrEqual", o->x[0], o->x[1]);
    return give(o, cast(o->j, truth, real_type(o->j)));
}

static bool choice(const operation *o) {
    return give(o, where(o->j, cast(o->j, o->x[0], TYPE_BOOL), o->x[1], o->x[2]));
}

static bool mixture(const operation *o) {
    const name rest = binary(o->j, "Sub", number(o->j, 1), o->x[0]);
    return give(
        o, binary(o->j, "Add", binary(o->j, "Mul", rest, o->x[1]), binary(o->j, "Mul", o->x[0], o->x[2])));
}

static bool scaled(const operation *o) {
    if (o->op->reciprocal.base != 0 || o->op->reciprocal.rows != 0) return false;
    return give(o, binary(o->j, "Mul", o->x[0], number(o->j, o->op->real)));
}
static bool shifted(const operation *o) {
    return give(o, binary(o->j, "Add", o->x[0], number(o->j, o->op->real)));
}
static bool power(const operation *o) {
    return give(o, binary(o->j, "Pow", o->x[0], number(o->j, o->op->real)));
}

static bool combination(const operation *o) {
    name sum = binary(o->j, "Mul", o->x[0], number(o->j, o->op->reals[0]));
    for (uint32_t i = 1; i < o->op->input_count; i++)
        sum = binary(o->j, "Add", sum, binary(o->j, "Mul", o->x[i], number(o->j, o->op->reals[i])));
    return give(o, sum);
}

/* atan(y/x), moved by pi to the left of x = 0. */
static bool angle(const operation *o) {
    job *j = o->j;
    const name y = o->x[0], x = o->x[1], zero = number(j, 0), pi = number(j, acos(-1.0));
    const name turn = where(j, binary(j, "GreaterOrEqual", y, zero), pi, unary(j, "Neg", pi));
    const name side = where(j, binary(j, "Less", x, zero), turn, zero);
    return give(o, binary(j, "Add", unary(j, "Atan", binary(j, "Div", y, x)), side));
}

static bool activated(job *j, int64_t kind, name x, name *out) {
    static const char *const types[LG_ACTIVATION_COUNT] = {[LG_IDENTITY] = "Identity",
                                                           [LG_TANH] = "Tanh",
                                                           [LG_SIGMOID] = "Sigmoid",
                                                           [LG_RELU] = "Relu",
                                                           [LG_SINE] = "Sin"};
    if (kind < 0 || kind >= LG_ACTIVATION_COUNT) return false;
    if (kind == LG_SWISH)
        *out = binary(j, "Mul", x, unary(j, "Sigmoid", x));
    else if (kind == LG_LEAKY_RELU) /* LeakyRelu has no double in onnxruntime */
        *out = binary(j, "Max", x, binary(j, "Mul", x, number(j, 0.01)));
    else
        *out = unary(j, types[kind], x);
    return true;
}

static bool activation(const operation *o) {
    name y;
    return activated(o->j, o->op->whole[0].base, o->x[0], &y) && give(o, y);
}

/* sigma'(x) from x and sigma(x); of swish, x and the sigmoid. */
static bool slope(job *j, int64_t kind, name x, name s, name *out) {
    const name one = number(j, 1), rest = binary(j, "Sub", one, s);
    if (kind == LG_TANH)
        *out = binary(j, "Sub", one, binary(j, "Mul", s, s));
    else if (kind == LG_SIGMOID)
        *out = binary(j, "Mul", s, rest);
    else if (kind == LG_SWISH)
        *out = binary(j, "Mul", s, binary(j, "Add", one, binary(j, "Mul", x, rest)));
    else if (kind == LG_SINE)
        *out = unary(j, "Cos", x);
    else
        return false;
    return true;
}

/* The values and first derivatives. */
static bool activation_derivative(const operation *o) {
    const int64_t kind = o->op->whole[0].base, order = o->op->whole[1].base;
    job *j = o->j;
    name s, y;
    if (order > 1) return false;
    if (o->op->whole[2].base == 1)
        s = o->x[1];
    else if (!activated(j, kind == LG_SWISH ? LG_SIGMOID : kind, o->x[0], &s))
        return false;
    if (order == 0)
        y = kind == LG_SWISH ? binary(j, "Mul", o->x[0], s) : s;
    else if (!slope(j, kind, o->x[0], s, &y))
        return false;
    if (o->op->whole[3].base == 1) y = binary(j, "Mul", y, o->x[2]);
    return give(o, y);
}

static uint32_t rank_of(const operation *o, uint32_t input) {
    return o->j->g->nodes[o->op->inputs[input]].op.rank;
}

static name transposed(job *j, name x, uint32_t rank) {
    const int64_t order[2][3] = {{1, 0}, {0, 2, 1}};
    return transpose(j, x, order[rank - 2], rank);
}

static bool product(const operation *o) {
    const int64_t kind = o->op->whole[0].base;
    const bool flat = rank_of(o, 0) == 2 && rank_of(o, 1) == 2;
    name in[3] = {o->x[0], o->x[1], o->x[2]};
    if (kind == 1) in[1] = transposed(o->j, in[1], rank_of(o, 1));
    if (kind == 2) in[0] = transposed(o->j, in[0], rank_of(o, 0));
    if (o->op->input_count == 3 && flat && rank_of(o, 2) == 1) {
        emit_to(o->j, o->out, "Gemm", in, 3, NULL, 0);
        return true;
    }
    const name y = emit(o->j, "MatMul", in, 2, NULL);
    return give(o, o->op->input_count == 3 ? binary(o->j, "Add", y, in[2]) : y);
}

/* Over the middle of (i0, i1, i2). */
static bool reduced(const operation *o, const char *type) {
    const name x = reshape(o->j, o->x[0], o->op->whole, 3);
    name y;
    if (strcmp(type, "ReduceSum") == 0) {
        y = binary(o->j, type, x, wholes(o->j, (int64_t[]){1}, 1));
    } else {
        const attribute axes = {.name = "axes", .type = INTS, .i = {1}, .count = 1};
        y = emit(o->j, type, &x, 1, &axes);
    }
    return give(o, reshape(o->j, y, o->op->shape, o->op->rank));
}
static bool summed(const operation *o) {
    return reduced(o, "ReduceSum");
}
static bool maximum(const operation *o) {
    return reduced(o, "ReduceMax");
}

static bool repeated(const operation *o) {
    if (o->op->whole[1].rows != 0) return false;
    const lg_affine one[3] = {o->op->whole[0], {1, 0}, o->op->whole[2]};
    const name x = reshape(o->j, o->x[0], one, 3);
    const name y = binary(o->j, "Tile", x, wholes(o->j, (int64_t[]){1, o->op->whole[1].base, 1}, 3));
    return give(o, reshape(o->j, y, o->op->shape, o->op->rank));
}

static bool reshaped(const operation *o) {
    int64_t shape[LG_MAX_RANK];
    return shape_of(o->op->shape, o->op->rank, shape) &&
           give(o, reshape(o->j, o->x[0], o->op->shape, o->op->rank));
}

static bool sliced(const operation *o) {
    const lg_affine *w = o->op->whole;
    if (w[1].rows != 0 || w[2].rows != 0) return false;
    const name in[4] = {o->x[0], wholes(o->j, (int64_t[]){w[1].base}, 1),
                        wholes(o->j, (int64_t[]){w[1].base + w[2].base}, 1),
                        wholes(o->j, (int64_t[]){w[0].base}, 1)};
    emit_to(o->j, o->out, "Slice", in, 4, NULL, 0);
    return true;
}

static bool padded(const operation *o) {
    int64_t pads[2 * LG_MAX_RANK] = {0};
    const lg_affine *w = o->op->whole;
    if (w[1].rows != 0 || w[2].rows != 0) return false;
    pads[w[0].base] = w[1].base;
    pads[o->op->rank + (size_t)w[0].base] = w[2].base;
    return give(o, binary(o->j, "Pad", o->x[0], wholes(o->j, pads, 2 * o->op->rank)));
}

static bool joined(const operation *o) {
    const attribute axis = {.name = "axis", .type = INT, .i = {o->op->whole[0].base}};
    emit_to(o->j, o->out, "Concat", o->x, o->op->input_count, &axis, 1);
    return true;
}

static bool permuted(const operation *o) {
    int64_t order[4];
    for (uint32_t k = 0; k < o->op->rank; k++) order[k] = o->op->whole[k].base;
    return give(o, transpose(o->j, o->x[0], order, o->op->rank));
}

static name rows_at(job *j, name x, const int64_t *places, size_t count, int64_t along) {
    const attribute axis = {.name = "axis", .type = INT, .i = {along}};
    return emit(j, "Gather", (name[]){x, wholes(j, places, count)}, 2, &axis);
}

static bool gathered(const operation *o) {
    int64_t *places = app_alloc(o->op->index_count, sizeof *places);
    for (uint32_t i = 0; i < o->op->index_count; i++) places[i] = o->op->indices[i];
    const name y = rows_at(o->j, o->x[0], places, o->op->index_count, 0);
    free(places);
    return give(o, y);
}

static name dot(job *j, name x, name y) {
    return binary(j, "ReduceSum", binary(j, "Mul", x, y), wholes(j, (int64_t[]){-1}, 1));
}
static bool row_products(const operation *o) {
    return give(o, dot(o->j, o->x[0], o->x[1]));
}

static bool crossed(const operation *o) {
    const int64_t next[3] = {1, 2, 0}, last[3] = {2, 0, 1};
    job *j = o->j;
    const name a = binary(j, "Mul", rows_at(j, o->x[0], next, 3, -1), rows_at(j, o->x[1], last, 3, -1));
    const name b = binary(j, "Mul", rows_at(j, o->x[0], last, 3, -1), rows_at(j, o->x[1], next, 3, -1));
    return give(o, binary(j, "Sub", a, b));
}

/* ---- small matrices (..., n, n), written out ---- */

enum { MOST_SPD = 6 };

/* Element (r, c), as (..., 1). */
static name element(job *j, name x, int64_t r, int64_t c) {
    const name row = rows_at(j, x, (int64_t[]){r}, 1, -2), one = rows_at(j, row, (int64_t[]){c}, 1, -1);
    return binary(j, "Squeeze", one, wholes(j, (int64_t[]){-2}, 1));
}

static name along(job *j, const name *x, size_t count, int64_t axis) {
    const attribute a = {.name = "axis", .type = INT, .i = {axis}};
    return emit(j, "Concat", x, count, &a);
}

/* x - sum of a[k] b[k] */
static name less_products(job *j, name x, const name *a, const name *b, size_t count) {
    for (size_t k = 0; k < count; k++) x = binary(j, "Sub", x, binary(j, "Mul", a[k], b[k]));
    return x;
}

static uint32_t order_of(const operation *o) {
    const lg_operation *matrix = &o->j->g->nodes[o->op->inputs[0]].op;
    return (uint32_t)matrix->shape[matrix->rank - 1].base;
}

/* Cholesky's factor of (x + x^T)/2, row by row. */
static bool factor(const operation *o) {
    job *j = o->j;
    const uint32_t n = order_of(o);
    name L[MOST_SPD][MOST_SPD], rows_of[MOST_SPD];
    if (n > MOST_SPD) return false;
    const name zero = number(j, 0), half = number(j, 0.5);
    for (uint32_t r = 0; r < n; r++) {
        name row[MOST_SPD];
        for (uint32_t c = 0; c <= r; c++) {
            const name a = binary(j, "Mul", half,
                                  binary(j, "Add", element(j, o->x[0], r, c), element(j, o->x[0], c, r)));
            const name rest = less_products(j, a, L[r], L[c], c);
            L[r][c] = c == r ? unary(j, "Sqrt", rest) : binary(j, "Div", rest, L[c][c]);
        }
        for (uint32_t c = 0; c < n; c++) row[c] = c <= r ? L[r][c] : binary(j, "Mul", zero, L[r][0]);
        rows_of[r] = binary(j, "Unsqueeze", along(j, row, n, -1), wholes(j, (int64_t[]){-2}, 1));
    }
    return give(o, along(j, rows_of, n, -2));
}

/* L L^T y = b, each row of b by what is known: b (..., n, m) as rows (..., m). */
static bool solve(const operation *o) {
    job *j = o->j;
    const uint32_t n = order_of(o);
    name L[MOST_SPD][MOST_SPD], y[MOST_SPD];
    if (n > MOST_SPD || rank_of(o, 1) != rank_of(o, 0)) return false;
    for (uint32_t r = 0; r < n; r++)
        for (uint32_t c = 0; c <= r; c++) L[r][c] = element(j, o->x[2], r, c);
    for (uint32_t r = 0; r < n; r++) {
        const name b =
            binary(j, "Squeeze", rows_at(j, o->x[1], (int64_t[]){r}, 1, -2), wholes(j, (int64_t[]){-2}, 1));
        y[r] = binary(j, "Div", less_products(j, b, L[r], y, r), L[r][r]);
    }
    for (uint32_t r = n; r-- > 0;) {
        name column[MOST_SPD];
        for (uint32_t k = r + 1; k < n; k++) column[k - r - 1] = L[k][r];
        y[r] = binary(j, "Div", less_products(j, y[r], column, y + r + 1, n - 1 - r), L[r][r]);
    }
    for (uint32_t r = 0; r < n; r++) y[r] = binary(j, "Unsqueeze", y[r], wholes(j, (int64_t[]){-2}, 1));
    return give(o, along(j, y, n, -2));
}

/* ---- convolutions: (batch, length, channels) here, channels before the length there ---- */

static name channels_first(job *j, name x) {
    return transpose(j, x, (const int64_t[]){0, 2, 1}, 3);
}

static name convolved(const operation *o) {
    const lg_affine *w = o->op->whole;
    name in[3] = {channels_first(o->j, o->x[0]), transpose(o->j, o->x[1], (const int64_t[]){2, 1, 0}, 3),
                  o->x[2]};
    const attribute how[2] = {{.name = "strides", .type = INTS, .i = {w[0].base}, .count = 1},
                              {.name = "pads", .type = INTS, .i = {w[1].base, w[1].base}, .count = 2}};
    const name out = new_name(o->j);
    emit_to(o->j, out.text, "Conv", in, o->op->input_count, how, 2);
    return out;
}

static name pooled(job *j, const char *type, name x, int64_t size, int64_t stride) {
    const attribute how[2] = {{.name = "kernel_shape", .type = INTS, .i = {size}, .count = 1},
                              {.name = "strides", .type = INTS, .i = {stride}, .count = 1}};
    const name out = new_name(j);
    emit_to(j, out.text, type, &x, 1, how, 2);
    return out;
}

static bool convolution(const operation *o) {
    return give(o, channels_first(o->j, convolved(o)));
}

static bool block(const operation *o) {
    name y;
    if (!activated(o->j, (int64_t)o->op->real, convolved(o), &y)) return false;
    y = pooled(o->j, "AveragePool", y, o->op->whole[2].base, o->op->whole[3].base);
    return give(o, channels_first(o->j, y));
}

static bool average_pool(const operation *o) {
    const name y = pooled(o->j, "AveragePool", channels_first(o->j, o->x[0]), o->op->whole[0].base,
                          o->op->whole[1].base);
    return give(o, channels_first(o->j, y));
}

static bool max_pool(const operation *o) {
    if (o->op->inputs[0] != o->op->inputs[1]) return false;
    const name y =
        pooled(o->j, "MaxPool", channels_first(o->j, o->x[0]), o->op->whole[0].base, o->op->whole[1].base);
    return give(o, channels_first(o->j, y));
}

static const struct {
    const char *name;
    bool (*translate)(const operation *o); /* false: this form of it has none in ONNX */
} rows[] = {{"add", add},
            {"sub", sub},
            {"mul", mul},
            {"div", quotient},
            {"max", larger},
            {"ge", at_least},
            {"atan2", angle},
            {"select", choice},
            {"mix", mixture},
            {"combine", combination},
            {"scale", scaled},
            {"shift", shifted},
            {"pow", power},
            {"sqrt", root},
            {"exp", exponential},
            {"log", logarithm},
            {"sin", sine},
            {"cos", cosine},
            {"abs", absolute},
            {"sign", sign},
            {"stop_gradient", identity},
            {"act", activation},
            {"act_derivative", activation_derivative},
            {"matmul", product},
            {"sum", summed},
            {"max_axis", maximum},
            {"broadcast", repeated},
            {"reshape", reshaped},
            {"slice", sliced},
            {"pad", padded},
            {"concat", joined},
            {"permute", permuted},
            {"gather", gathered},
            {"rowdot", row_products},
            {"cross", crossed},
            {"spd_factor", factor},
            {"spd_solve", solve},
            {"conv1d", convolution},
            {"conv1d_block", block},
            {"avg_pool1d", average_pool},
            {"pool_pick", max_pool}};

static bool translate(job *j, uint32_t node) {
    const lg_operation *op = &j->g->nodes[node].op;
    operation o = {.j = j, .op = op};
    const name out = name_of(j, node);
    o.out = out.text;
    for (uint32_t i = 0; i < op->input_count; i++) o.x[i] = name_of(j, op->inputs[i]);
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        if (strcmp(rows[i].name, op->name) == 0) return rows[i].translate(&o);
    return false;
}

/* A constant with a row for each row of the batch. */
static bool add_row_constant(job *j, uint32_t node) {
    const lg_operation *op = &j->g->nodes[node].op;
    int64_t dims[LG_MAX_RANK];
    size_t count = 1;
    if (op->shape[0].rows != 1 || op->shape[0].base != 0) return false;
    dims[0] = 1;
    for (uint32_t k = 1; k < op->rank; k++) count *= (size_t)(dims[k] = op->shape[k].base);
    if (op->real_count > count || count % op->real_count != 0) return false;
    double *values = app_alloc(count, sizeof *values);
    for (size_t i = 0; i < count; i++) values[i] = op->reals[i % op->real_count];
    const name one = new_name(j), out = name_of(j, node);
    add_reals(j, one.text, dims, op->rank, values, count);
    free(values);
    const operation o = {.j = j, .op = op, .out = out.text};
    return give(&o, for_each_row(j, one, op));
}

static void add_constant(job *j, uint32_t node) {
    const graph_node *n = &j->g->nodes[node];
    int64_t dims[LG_MAX_RANK];
    for (uint32_t k = 0; k < n->op.rank; k++) dims[k] = n->op.shape[k].base;
    add_reals(j, name_of(j, node).text, dims, n->op.rank, n->values, n->count);
}

static lg_status add_nodes(job *j, const char *file, lg_error *error) {
    for (uint32_t k = 0; k < j->g->count; k++) {
        const graph_node *n = &j->g->nodes[k];
        bool done = true;
        if (!n->needed || strcmp(n->op.name, "input") == 0) continue;
        if (!n->varies)
            add_constant(j, k);
        else if (strcmp(n->op.name, "constant") == 0)
            done = add_row_constant(j, k);
        else
            done = translate(j, k);
        if (!done)
            return app_error(error, LG_UNSUPPORTED,
                             "%s: its operation '%s' has no form in ONNX here; choose another function with "
                             "--functions, or --target c",
                             file, n->op.name);
    }
    return LG_OK;
}

/* ---- the file ---- */

static void add_value_info(job *j, int field, const char *called, const lg_port *port) {
    text dims = {.data = NULL}, tensor = {.data = NULL}, type = {.data = NULL}, info = {.data = NULL};
    for (uint32_t k = 0; k < port->shape.rank + !port->shared; k++) {
        text dim = {.data = NULL};
        if (k == 0 && !port->shared)
            proto_text(&dim, 2, "rows");
        else
            proto_whole(&dim, 1, port->shape.dims[k - !port->shared]);
        proto_message(&dims, 1, &dim);
    }
    proto_whole(&tensor, 1, real_type(j));
    proto_message(&tensor, 2, &dims);
    proto_message(&type, 1, &tensor);
    proto_text(&info, 1, called);
    proto_message(&info, 2, &type);
    proto_message(&j->graph, field, &info);
}

static void write_file(job *j, const export_source *source, const char *description, text *to) {
    char *producer = app_format("lg-export: %s", source->options->name);
    text opset = {.data = NULL};
    proto_whole(to, 1, IR_VERSION);
    proto_text(to, 2, producer);
    proto_text(to, 3, lg_version());
    proto_text(to, 6, description);
    proto_text(&j->graph, 2, source->options->name);
    for (size_t i = 0; i < j->g->input_count; i++)
        add_value_info(j, 11, j->g->inputs[i].name, &j->g->inputs[i]);
    for (size_t o = 0; o < j->g->output_count; o++)
        add_value_info(j, 12, j->g->outputs[o].name, &j->g->outputs[o]);
    to->unfit = j->graph.unfit;
    proto_message(to, 7, &j->graph);
    proto_text(&opset, 1, "");
    proto_whole(&opset, 2, OPSET);
    proto_message(to, 8, &opset);
    free(producer);
}

/* Results get the names of the outputs. */
static void name_outputs(job *j) {
    for (size_t o = 0; o < j->g->output_count; o++) {
        const name result = name_of(j, j->g->results[o]);
        emit_to(j, j->g->outputs[o].name, "Identity", &result, 1, NULL, 0);
    }
}

/* What onnxruntime has in single precision only: an operation of the function, or NULL. */
static const char *single_only(const graph *g) {
    static const char *const names[] = {"conv1d", "conv1d_block", "atan2"};
    for (size_t k = 0; k < g->count; k++)
        for (size_t i = 0; i < LG_COUNT(names) && g->nodes[k].needed && g->nodes[k].varies; i++)
            if (strcmp(g->nodes[k].op.name, names[i]) == 0) return names[i];
    return NULL;
}

/* Single precision where nothing else is asked for and onnxruntime needs it. */
static void choose_type(const app *self, const graph *g, export_source *source, export_options *options) {
    const char *single = options->dtype == LG_F64 ? single_only(g) : NULL;
    if (single == NULL) return;
    if (app_given(self, "dtype")) {
        app_warn(self, "onnxruntime has no %s in double precision: --dtype f32 is for it", single);
        return;
    }
    app_warn(self, "written in single precision: onnxruntime has no %s in double; --dtype f64 writes double",
             single);
    options->dtype = LG_F32;
    source->single = true;
}

int export_onnx(const app *self, const char *path, lg_program *program, export_source *source) {
    static const char *const usual[] = {"value", NULL};
    char *chosen = export_choose(self, source->options, program, usual);
    size_t function;
    graph g;
    lg_error error = {LG_OK, ""};
    if (chosen == NULL) return APP_EXIT_USAGE;
    char *comma = strchr(chosen, ',');
    if (comma != NULL) {
        *comma = '\0';
        app_warn(self, "an ONNX file has one function: this one has %s; --functions chooses another", chosen);
    }
    (void)lg_program_find(program, chosen, &function);
    free(chosen);
    lg_status status = graph_make(program, function, &g, &error);
    export_options options = *source->options;
    job j = {.g = &g, .options = &options};
    if (status == LG_OK) choose_type(self, &g, source, &options);
    if (status == LG_OK) status = add_nodes(&j, source->options->file, &error);
    if (status == LG_OK) {
        name_outputs(&j);
        write_file(&j, source, lg_program_description(program), export_add_file(source, "%s.onnx"));
    }
    lg_text_destroy(&j.graph);
    graph_free(&g);
    (void)path;
    return status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "%s", error.message);
}
