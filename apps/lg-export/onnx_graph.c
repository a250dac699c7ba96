/* Adds tensors and nodes to an ONNX graph. */
#include <string.h>

#include "lg-export/onnx.h"

onnx_name onnx_name_of(const onnx_job *j, uint32_t node) {
    onnx_name n;
    const graph_node *k = &j->g->nodes[node];
    if (strcmp(k->op.name, "input") == 0)
        (void)snprintf(n.text, sizeof n.text, "%s", j->g->inputs[k->op.whole[0].base].name);
    else
        (void)snprintf(n.text, sizeof n.text, "/v%u", node);
    return n;
}

onnx_name onnx_new_name(onnx_job *j) {
    onnx_name n;
    (void)snprintf(n.text, sizeof n.text, "/h%zu", j->helpers++);
    return n;
}

/* ---- tensors ---- */

int onnx_real_type(const onnx_job *j) {
    return j->options->dtype == LG_F32 ? ONNX_FLOAT : ONNX_DOUBLE;
}

static void add_tensor(onnx_job *j, const char *called, int type, const int64_t *dims, size_t rank,
                       text *raw) {
    text tensor = app_text();
    for (size_t i = 0; i < rank; i++) proto_whole(&tensor, 1, dims[i]);
    proto_whole(&tensor, 2, type);
    proto_text(&tensor, 8, called);
    proto_message(&tensor, 9, raw);
    proto_message(&j->graph, 5, &tensor);
}

void onnx_add_reals(onnx_job *j, const char *called, const int64_t *dims, size_t rank, const double *values,
                    size_t count) {
    text raw = app_text();
    export_raw(j->options, &raw, &j->graph, values, count);
    add_tensor(j, called, onnx_real_type(j), dims, rank, &raw);
}

onnx_name onnx_number(onnx_job *j, double value) {
    const onnx_name n = onnx_new_name(j);
    onnx_add_reals(j, n.text, NULL, 0, &value, 1);
    return n;
}

onnx_name onnx_wholes(onnx_job *j, const int64_t *values, size_t count) {
    const onnx_name n = onnx_new_name(j);
    const int64_t dim = (int64_t)count;
    text raw = app_text();
    for (size_t i = 0; i < count; i++) lg_text_add_bytes(&raw, 8, (uint64_t)values[i]);
    add_tensor(j, n.text, ONNX_INT64, &dim, 1, &raw);
    return n;
}

/* ---- nodes ---- */

static void add_attribute(text *node, const onnx_attribute *a) {
    static const int types[] = {[ONNX_INT] = 2, [ONNX_INTS] = 7};
    text message = app_text();
    proto_text(&message, 1, a->name);
    if (a->type == ONNX_INT) proto_whole(&message, 3, a->i[0]);
    for (size_t k = 0; a->type == ONNX_INTS && k < a->count; k++) proto_whole(&message, 8, a->i[k]);
    proto_whole(&message, 20, types[a->type]);
    proto_message(node, 5, &message);
}

void onnx_emit_to(onnx_job *j, const char *out, const char *type, const onnx_name *in, size_t inputs,
                  const onnx_attribute *with, size_t attributes) {
    text node = app_text();
    for (size_t i = 0; i < inputs; i++) proto_text(&node, 1, in[i].text);
    proto_text(&node, 2, out);
    proto_text(&node, 3, out);
    proto_text(&node, 4, type);
    for (size_t i = 0; i < attributes; i++) add_attribute(&node, &with[i]);
    proto_message(&j->graph, 1, &node);
}

onnx_name onnx_emit(onnx_job *j, const char *type, const onnx_name *in, size_t inputs,
                    const onnx_attribute *with) {
    const onnx_name out = onnx_new_name(j);
    onnx_emit_to(j, out.text, type, in, inputs, with, with != NULL);
    return out;
}

onnx_name onnx_unary(onnx_job *j, const char *type, onnx_name x) {
    return onnx_emit(j, type, &x, 1, NULL);
}

onnx_name onnx_binary(onnx_job *j, const char *type, onnx_name x, onnx_name y) {
    return onnx_emit(j, type, (onnx_name[]){x, y}, 2, NULL);
}

onnx_name onnx_where(onnx_job *j, onnx_name condition, onnx_name yes, onnx_name no) {
    return onnx_emit(j, "Where", (onnx_name[]){condition, yes, no}, 3, NULL);
}

onnx_name onnx_cast(onnx_job *j, onnx_name x, int to) {
    const onnx_attribute a = {.name = "to", .type = ONNX_INT, .i = {to}};
    return onnx_emit(j, "Cast", &x, 1, &a);
}

onnx_name onnx_transpose(onnx_job *j, onnx_name x, const int64_t *order, size_t rank) {
    onnx_attribute a = {.name = "perm", .type = ONNX_INTS, .count = rank};
    memcpy(a.i, order, rank * sizeof *order);
    return onnx_emit(j, "Transpose", &x, 1, &a);
}

/* ---- shapes ---- */

bool onnx_shape_of(const lg_affine *dims, size_t rank, int64_t *out) {
    size_t open = 0;
    for (size_t k = 0; k < rank; k++) {
        out[k] = dims[k].rows != 0 ? -1 : dims[k].base;
        open += dims[k].rows != 0;
    }
    return open <= 1;
}

onnx_name onnx_reshape(onnx_job *j, onnx_name x, const lg_affine *dims, size_t rank) {
    int64_t shape[LG_MAX_RANK];
    (void)onnx_shape_of(dims, rank, shape);
    return onnx_binary(j, "Reshape", x, onnx_wholes(j, shape, rank));
}

onnx_name onnx_take(onnx_job *j, onnx_name x, const int64_t *places, size_t count, int64_t axis) {
    const onnx_attribute along = onnx_axis(axis);
    return onnx_emit(j, "Gather", (onnx_name[]){x, onnx_wholes(j, places, count)}, 2, &along);
}

onnx_name onnx_join(onnx_job *j, const onnx_name *x, size_t count, int64_t axis) {
    const onnx_attribute along = onnx_axis(axis);
    return onnx_emit(j, "Concat", x, count, &along);
}

/* Returns the value that holds the number of rows, shape (1); adds it when it is first needed. It is the
 * first dimension of an input that has rows. */
static onnx_name batch_of(onnx_job *j) {
    const onnx_name batch = {"/batch"};
    const lg_port *port = j->g->inputs;
    onnx_name input;
    if (j->has_batch) return batch;
    while (port->shared && port + 1 < j->g->inputs + j->g->input_count) port++;
    (void)snprintf(input.text, sizeof input.text, "%s", port->name);
    const onnx_name shape = onnx_unary(j, "Shape", input);
    const onnx_name first = onnx_wholes(j, (int64_t[]){0}, 1);
    onnx_emit_to(j, batch.text, "Gather", (onnx_name[]){shape, first}, 2, NULL, 0);
    j->has_batch = true;
    return batch;
}

onnx_name onnx_affine(onnx_job *j, lg_affine a) {
    const onnx_name batch = onnx_binary(j, "Squeeze", batch_of(j), onnx_wholes(j, (int64_t[]){0}, 1));
    const onnx_name rows = onnx_cast(j, batch, onnx_real_type(j));
    return onnx_binary(j, "Add", onnx_binary(j, "Mul", rows, onnx_number(j, (double)a.rows)),
                       onnx_number(j, (double)a.base));
}

onnx_name onnx_for_each_row(onnx_job *j, onnx_name x, const lg_operation *op) {
    int64_t rest[LG_MAX_RANK];
    onnx_name shape = batch_of(j);
    for (uint32_t k = 1; k < op->rank; k++) rest[k - 1] = op->shape[k].base;
    if (op->rank > 1) shape = onnx_join(j, (onnx_name[]){shape, onnx_wholes(j, rest, op->rank - 1)}, 2, 0);
    return onnx_binary(j, "Expand", x, shape);
}
