/* Records functions of a program on a tape. */
#include <string.h>

#include "autodiff/program/program_call.h"

typedef struct applying {
    lg_tape *tape;
    const lg_program *program;
    const lg_function *f;
    const lg_var *parameters, *inputs;
    size_t rows;
    lg_var *made; /* for each node of f: its variable on the tape */
} applying;

/* Sets rows to B, taken from the first batched input, and checks all shapes. False, with the error set: an
 * input or a parameter has the wrong shape. */
static bool find_rows(applying *a) {
    const lg_function *f = a->f;
    a->rows = 1;
    for (size_t i = 0, found = 0; i < f->inputs; i++) {
        const lg_node *node = lg_node_of(a->tape, a->inputs[i], f->name);
        if (node == NULL) return false;
        if (!f->input[i].shared && !found && node->shape.rank > 0 && node->shape.dims[0] > 0) {
            a->rows = node->shape.dims[0];
            found = 1;
        }
        const lg_shape wanted = lg_port_shape(&f->input[i], a->rows);
        if (lg_same_shape(&node->shape, &wanted)) continue;
        lg_fail_shapes(a->tape, f->name, &node, 1);
        return false;
    }
    for (size_t i = 0; a->parameters != NULL && i < a->program->parameters; i++) {
        const lg_node *node = lg_node_of(a->tape, a->parameters[i], f->name);
        if (node == NULL) return false;
        if (lg_same_shape(&node->shape, &a->program->parameter[i].shape)) continue;
        lg_fail_shapes(a->tape, f->name, &node, 1);
        return false;
    }
    return true;
}

/* A constant leaf: the stored values, repeated to fill the shape, in the tape's type. */
static lg_var constant(const applying *a, const lg_program_node *node, lg_shape shape) {
    const double *values = a->f->reals + node->payload;
    void *memory = NULL;
    if (node->payload_count == 1) return lg_full(a->tape, shape, values[0]);
    const lg_var leaf = lg_input_buffer(a->tape, shape, &memory);
    const size_t count = lg_shape_count(shape), size = a->tape->k->size;
    for (size_t at = 0; memory != NULL && at < count; at += node->payload_count) {
        const size_t rest = count - at, length = rest < node->payload_count ? rest : node->payload_count;
        a->tape->k->convert_in(length, values, (unsigned char *)memory + at * size);
    }
    return leaf;
}

static lg_var leaf(const applying *a, const lg_program_node *node, lg_shape shape) {
    if (node->leaf == LG_LEAF_INPUT) return a->inputs[node->number];
    if (node->leaf == LG_LEAF_CONSTANT) return constant(a, node, shape);
    if (a->parameters != NULL) return a->parameters[node->number];
    return lg_input_f64(a->tape, shape, a->program->parameter[node->number].values);
}

/* Copies the payload to the tape's memory, so that it lives as long as the nodes, even if the program is
 * destroyed. */
static bool keep_payload(lg_tape *tape, const lg_program_node *node, lg_attr *attr) {
    const lg_payload kind = node->op->payload;
    const size_t size = kind == LG_PAYLOAD_REALS     ? sizeof(double)
                        : kind == LG_PAYLOAD_INDICES ? sizeof(uint32_t)
                                                     : 0;
    if (size == 0) return true;
    void *kept = lg_payload_allocate(tape, node->payload_count * size);
    if (kept == NULL) return false;
    memcpy(kept, attr->pointer, node->payload_count * size);
    attr->pointer = kept;
    return true;
}

static lg_var record(const applying *a, const lg_program_node *node, const lg_var *in, lg_shape shape) {
    lg_attr attr;
    if (lg_is_call(node->op)) {
        lg_var out[LG_PROGRAM_MAX_PORTS];
        return lg_program_record(a->tape, a->program, lg_called(node), a->parameters, in, out) == LG_OK
                   ? out[lg_called_output(node)]
                   : LG_NONE;
    }
    if (!lg_node_attr_at(a->f, node, a->rows, &attr))
        return lg_tape_fail(a->tape, LG_SHAPE, node->op->name, "an attribute is out of range");
    if (node->op->record != NULL) return node->op->record(a->tape, in[0], &attr, shape);
    if (!keep_payload(a->tape, node, &attr)) return LG_NONE;
    return lg_record_shaped(a->tape, node->op, in, node->inputs, &attr, shape);
}

static lg_var operation(const applying *a, const lg_program_node *node, lg_shape shape) {
    lg_var in[LG_MAX_INPUTS];
    for (uint32_t k = 0; k < node->inputs; k++) in[k] = a->made[a->f->edges[node->first + k]];
    const lg_var made = record(a, node, in, shape);
    if (!lg_is_none(made) && !lg_same_shape(&lg_node_at(a->tape, made)->shape, &shape))
        return lg_tape_fail(
            a->tape, LG_SHAPE, node->op->name,
            "its shape with this number of rows differs from the shape that the program states");
    return made;
}

static void record_nodes(applying *a) {
    for (uint32_t i = 0; i < a->f->nodes && a->tape->status == LG_OK; i++) {
        const lg_program_node *node = &a->f->node[i];
        lg_shape shape;
        if (!lg_node_shape_at(node, a->rows, &shape))
            a->made[i] = lg_tape_fail(a->tape, LG_SHAPE, a->f->name, "a dimension is out of range");
        else
            a->made[i] = node->op == &lg_op_leaf ? leaf(a, node, shape) : operation(a, node, shape);
    }
}

static lg_status apply_nodes(applying *a, lg_var *outputs) {
    const size_t bytes = a->f->nodes * sizeof *a->made;
    a->made = lg_pool_take(a->tape, bytes);
    if (a->made == NULL) return a->tape->status;
    record_nodes(a);
    for (size_t j = 0; j < a->f->outputs && a->tape->status == LG_OK; j++)
        outputs[j] = a->made[a->f->result[j]];
    lg_pool_give(a->tape, a->made, bytes);
    return a->tape->status;
}

/* The value of one call as an entry of its path: (rows, 1, shape...); (1, shape...) if all rows share it. */
static lg_var path_entry(const applying *a, const lg_port *port, lg_var value) {
    const uint32_t axis = port->shared ? 0 : 1;
    lg_shape shape = lg_port_shape(port, a->rows);
    shape.dims[axis] = 1;
    return lg_reshape(a->tape, value, shape);
}

/* Calls the function again and again; path[k * times + n] becomes entry n of path k. */
static lg_status apply_calls(const applying *a, lg_var *outputs, lg_var *path) {
    lg_var now[LG_PROGRAM_MAX_PORTS], next[LG_PROGRAM_MAX_PORTS];
    const lg_function *loop = a->f;
    const size_t called = loop->outputs - loop->paths;
    applying inner = *a;
    inner.f = &a->program->function[loop->callee];
    inner.inputs = now;
    for (size_t i = 0; i < loop->inputs; i++) now[i] = a->inputs[i];
    for (uint32_t n = 0; n < loop->times; n++) {
        LG_TRY(apply_nodes(&inner, next));
        for (size_t i = 0; i < loop->inputs; i++)
            if (loop->carry[i] != UINT32_MAX) now[i] = next[loop->carry[i]];
        for (size_t k = 0; k < loop->paths; k++)
            path[k * loop->times + n] = path_entry(a, &loop->output[called + k], next[loop->path[k]]);
    }
    for (size_t j = 0; j < called; j++) outputs[j] = next[j];
    return LG_OK;
}

static lg_status apply_loop(const applying *a, lg_var *outputs) {
    const lg_function *loop = a->f;
    const size_t called = loop->outputs - loop->paths, bytes = loop->paths * loop->times * sizeof(lg_var);
    lg_var *path = NULL;
    if (bytes > 0 && (path = lg_pool_take(a->tape, bytes)) == NULL) return a->tape->status;
    lg_status status = apply_calls(a, outputs, path);
    for (size_t k = 0; k < loop->paths && status == LG_OK; k++) {
        outputs[called + k] =
            lg_concat(a->tape, path + k * loop->times, loop->times, loop->output[called + k].shared ? 0 : 1);
        status = a->tape->status;
    }
    if (path != NULL) lg_pool_give(a->tape, path, bytes);
    return status;
}

lg_status lg_program_record(lg_tape *tape, const lg_program *program, size_t function,
                            const lg_var *parameters, const lg_var *inputs, lg_var *outputs) {
    if (tape == NULL) return LG_INVALID_ARGUMENT;
    if (program == NULL || inputs == NULL || outputs == NULL)
        (void)lg_tape_fail(tape, LG_INVALID_ARGUMENT, "program",
                           "the program, `inputs` or `outputs` is NULL");
    if (tape->status != LG_OK) return tape->status;
    if (function >= program->functions) {
        lg_tape_fail(tape, LG_NOT_FOUND, "program", "the program has no function with this number");
        return tape->status;
    }
    applying a = {.tape = tape,
                  .program = program,
                  .f = &program->function[function],
                  .parameters = parameters,
                  .inputs = inputs};
    if (!find_rows(&a)) return tape->status;
    lg_scope_push(tape, a.f->name);
    const lg_status status = a.f->times > 0 ? apply_loop(&a, outputs) : apply_nodes(&a, outputs);
    lg_scope_pop(tape);
    return status;
}
