#include "lg-export/graph.h"

#include <stdlib.h>
#include <string.h>

/* MOST_NODES is a limit of this file; MOST_OUTPUTS is the limit of outputs per function of a program, and
 * MOST_JOINED of inputs per operation. */
enum { MOST_NODES = 1 << 20, MOST_OUTPUTS = 64, MOST_JOINED = 64 };

/* ---- writing out calls and loops ---- */

static uint32_t add_node(graph *g, const lg_operation *op) {
    if (g->count == g->room) {
        const size_t room = g->room > 0 ? 2 * g->room : 256;
        graph_node *grown = app_alloc(room, sizeof *grown);
        if (g->count > 0) memcpy(grown, g->nodes, g->count * sizeof *grown);
        free(g->nodes);
        g->nodes = grown;
        g->room = room;
    }
    g->nodes[g->count] = (graph_node){.op = *op};
    return (uint32_t)g->count++;
}

static lg_status image_of(graph *g, const lg_program *program, size_t function, lg_function_image **out) {
    lg_function_image **grown = app_alloc(g->image_count + 1, sizeof *grown);
    if (g->image_count > 0) memcpy(grown, g->images, g->image_count * sizeof *grown);
    free(g->images);
    g->images = grown;
    LG_TRY(lg_function_image_create(program, function, out));
    g->images[g->image_count++] = *out;
    return LG_OK;
}

static lg_status inline_function(graph *g, const lg_program *program, size_t function, const uint32_t *inputs,
                                 uint32_t *results);

/* Returns the nodes that the operation reads; kept until the graph is freed. */
static uint32_t *inputs_of(const lg_operation *op, const uint32_t *place) {
    uint32_t *inputs = app_alloc(op->input_count, sizeof *inputs);
    for (uint32_t i = 0; i < op->input_count; i++) inputs[i] = place[op->inputs[i]];
    return inputs;
}

static lg_status inline_call(graph *g, const lg_program *program, const lg_operation *op,
                             const uint32_t *place, uint32_t *out) {
    size_t outs;
    const size_t callee = (size_t)op->whole[0].base;
    (void)lg_program_outputs(program, callee, &outs);
    uint32_t *inputs = inputs_of(op, place), *results = app_alloc(outs, sizeof *results);
    const lg_status status = inline_function(g, program, callee, inputs, results);
    if (status == LG_OK) *out = results[op->whole[1].base];
    free(results);
    free(inputs);
    return status;
}

static lg_status inline_operations(graph *g, const lg_program *program, const lg_function_image *image,
                                   const uint32_t *inputs, uint32_t *results) {
    APP_FREE uint32_t *place = app_alloc(image->operation_count, sizeof *place);
    lg_status status = LG_OK;
    for (size_t k = 0; k < image->operation_count && status == LG_OK; k++) {
        lg_operation op = image->operations[k];
        if (strcmp(op.name, "input") == 0 && inputs != NULL) {
            place[k] = inputs[op.whole[0].base];
        } else if (strcmp(op.name, "call") == 0) {
            status = inline_call(g, program, &op, place, &place[k]);
        } else {
            op.inputs = inputs_of(&op, place);
            place[k] = add_node(g, &op);
        }
        if (g->count > MOST_NODES) status = LG_UNSUPPORTED;
    }
    for (size_t o = 0; o < image->output_count && status == LG_OK; o++) results[o] = place[image->results[o]];
    return status;
}

/* Adds a node of this shape. The node reads the given nodes. */
static uint32_t add_shaped(graph *g, const char *name, const uint32_t *from, size_t count,
                           const lg_affine *shape, uint32_t rank) {
    lg_operation op = {.name = name, .revision = 1, .input_count = (uint32_t)count, .rank = rank};
    uint32_t *inputs = app_alloc(count, sizeof *inputs);
    memcpy(inputs, from, count * sizeof *inputs);
    memcpy(op.shape, shape, rank * sizeof *shape);
    op.inputs = inputs;
    return add_node(g, &op);
}

/* Joins nodes of equal shapes, in which the axis has length 1. */
static uint32_t join(graph *g, const uint32_t *parts, size_t count, int64_t axis) {
    lg_affine shape[LG_MAX_RANK];
    uint32_t halves[2];
    const uint32_t rank = g->nodes[parts[0]].op.rank;
    memcpy(shape, g->nodes[parts[0]].op.shape, sizeof shape);
    shape[axis].base = (int64_t)count;
    if (count > MOST_JOINED) {
        halves[0] = join(g, parts, count / 2, axis);
        halves[1] = join(g, parts + count / 2, count - count / 2, axis);
        parts = halves;
        count = 2;
    }
    const uint32_t joined = add_shaped(g, "concat", parts, count, shape, rank);
    g->nodes[joined].op.whole[0].base = axis;
    return joined;
}

/* Joins the values of all rounds to an array (times, shape...). First each value gets the shape (1,
 * shape...). */
static uint32_t join_path(graph *g, const lg_port *port, const uint32_t *rounds, uint32_t times) {
    const int64_t axis = !port->shared;
    const uint32_t rank = port->shape.rank + !port->shared;
    lg_affine shape[LG_MAX_RANK] = {{0, 1}};
    APP_FREE uint32_t *parts = app_alloc(times, sizeof *parts);
    for (uint32_t k = 0; k < port->shape.rank; k++)
        shape[k + !port->shared] = (lg_affine){k == 0 ? 1 : port->shape.dims[k], 0};
    for (uint32_t n = 0; n < times; n++) parts[n] = add_shaped(g, "reshape", &rounds[n], 1, shape, rank);
    const uint32_t joined = join(g, parts, times, axis);
    return joined;
}

static lg_status inline_loop(graph *g, const lg_program *program, const lg_function_image *image,
                             const uint32_t *inputs, uint32_t *results) {
    const size_t called = image->output_count - image->path_count;
    APP_FREE uint32_t *now = app_alloc(image->input_count, sizeof *now),
                      *rounds = app_alloc(image->path_count * image->times, sizeof *rounds);
    lg_status status = LG_OK;
    for (size_t i = 0; i < image->input_count; i++) now[i] = inputs[i];
    for (uint32_t n = 0; n < image->times && status == LG_OK; n++) {
        status = inline_function(g, program, image->callee, now, results);
        for (size_t k = 0; k < image->path_count; k++) rounds[k * image->times + n] = results[image->path[k]];
        for (size_t i = 0; i < image->input_count && status == LG_OK; i++)
            if (image->carry[i] != LG_CARRY_NONE) now[i] = results[image->carry[i]];
    }
    for (size_t k = 0; k < image->path_count && status == LG_OK; k++)
        results[called + k] =
            join_path(g, &image->outputs[called + k], rounds + k * image->times, image->times);
    return status;
}

static lg_status inline_function(graph *g, const lg_program *program, size_t function, const uint32_t *inputs,
                                 uint32_t *results) {
    lg_function_image *image;
    LG_TRY(image_of(g, program, function, &image));
    return image->times > 0 ? inline_loop(g, program, image, inputs, results)
                            : inline_operations(g, program, image, inputs, results);
}

/* ---- inputs ---- */

/* Adds one node per input, before all other nodes. */
static uint32_t *add_inputs(graph *g) {
    uint32_t *nodes = app_alloc(g->input_count, sizeof *nodes);
    for (size_t i = 0; i < g->input_count; i++) {
        const lg_port *port = &g->inputs[i];
        lg_operation op = {.name = "input", .revision = 1, .whole = {{(int64_t)i, 0}}};
        op.rank = port->shape.rank + !port->shared;
        if (!port->shared) op.shape[0] = (lg_affine){0, 1};
        for (uint32_t k = 0; k < port->shape.rank; k++)
            op.shape[k + !port->shared] = (lg_affine){port->shape.dims[k], 0};
        op.inputs = app_alloc(1, sizeof *op.inputs);
        nodes[i] = add_node(g, &op);
    }
    return nodes;
}

/* ---- constants ---- */

static bool has_rows(const lg_operation *op) {
    bool any = op->reciprocal.rows != 0;
    for (uint32_t k = 0; k < op->rank; k++) any = any || op->shape[k].rows != 0;
    return any;
}

static void mark(graph *g) {
    for (size_t k = 0; k < g->count; k++) {
        graph_node *n = &g->nodes[k];
        n->varies = strcmp(n->op.name, "input") == 0 || has_rows(&n->op);
        for (uint32_t i = 0; i < n->op.input_count; i++)
            n->varies = n->varies || g->nodes[n->op.inputs[i]].varies;
    }
    for (size_t o = 0; o < g->output_count; o++) g->nodes[g->results[o]].needed = true;
    for (size_t k = g->count; k-- > 0;) {
        const graph_node *n = &g->nodes[k];
        for (uint32_t i = 0; n->needed && n->varies && i < n->op.input_count; i++)
            g->nodes[n->op.inputs[i]].needed = true;
    }
}

/* Adds a function to the program that returns the given constants as its outputs. */
static lg_status add_constants_function(const graph *g, lg_program *program, const uint32_t *which,
                                        size_t count, lg_error *error) {
    char name[48];
    (void)snprintf(name, sizeof name, "export_constants_%zu", lg_program_functions(program));
    lg_function_image image = {.name = name,
                               .inputs = g->inputs,
                               .input_count = g->input_count,
                               .output_count = count,
                               .operation_count = g->count,
                               .results = which};
    APP_FREE lg_port *outputs = app_alloc(count, sizeof *outputs);
    char(*names)[32] = app_alloc(count, sizeof *names);
    image.operations = app_alloc(g->count, sizeof *image.operations);
    for (size_t k = 0; k < g->count; k++) image.operations[k] = g->nodes[k].op;
    for (size_t i = 0; i < count; i++) {
        const lg_operation *op = &g->nodes[which[i]].op;
        (void)snprintf(names[i], sizeof names[i], "constant_%zu", i);
        outputs[i] = (lg_port){.name = names[i], .shared = true, .shape = {.rank = op->rank}};
        for (uint32_t k = 0; k < op->rank; k++) outputs[i].shape.dims[k] = (uint32_t)op->shape[k].base;
    }
    image.outputs = outputs;
    const lg_status status = lg_program_add_image(program, &image, error);
    free(image.operations);
    free(names);
    return status;
}

static lg_status evaluate_constants(graph *g, lg_program *program, const uint32_t *which, size_t count,
                                    lg_error *error) {
    lg_plan *plan;
    const size_t function = lg_program_functions(program) - 1;
    LG_TRY(lg_plan_create(program, function, NULL, &plan, error));
    APP_FREE double **in = app_alloc(g->input_count, sizeof *in), **out = app_alloc(count, sizeof *out);
    APP_FREE void *work = app_alloc(lg_plan_work_size(plan), 1);
    for (size_t i = 0; i < g->input_count; i++)
        in[i] = app_alloc(lg_plan_input_count(plan, i), sizeof(double));
    for (size_t i = 0; i < count; i++) {
        graph_node *n = &g->nodes[which[i]];
        n->count = lg_plan_output_count(plan, i);
        out[i] = n->values = app_alloc(n->count, sizeof *n->values);
    }
    lg_plan_eval(plan, (const void *const *)in, (void *const *)out, work);
    for (size_t i = 0; i < g->input_count; i++) free(in[i]);
    lg_plan_destroy(plan);
    return LG_OK;
}

/* Computes all constants that are needed, at most MOST_OUTPUTS of them per added function. */
static lg_status fold(graph *g, lg_program *program, lg_error *error) {
    APP_FREE uint32_t *which = app_alloc(g->count, sizeof *which);
    size_t count = 0;
    for (size_t k = 0; k < g->count; k++)
        if (g->nodes[k].needed && !g->nodes[k].varies) which[count++] = (uint32_t)k;
    lg_status status = LG_OK;
    for (size_t at = 0; at < count && status == LG_OK; at += MOST_OUTPUTS) {
        const size_t some = count - at < MOST_OUTPUTS ? count - at : MOST_OUTPUTS;
        status = add_constants_function(g, program, which + at, some, error);
        if (status == LG_OK) status = evaluate_constants(g, program, which + at, some, error);
    }
    return status;
}

/* ---- the graph ---- */

lg_status graph_make(lg_program *program, size_t function, graph *out, lg_error *error) {
    *out = (graph){.count = 0};
    out->inputs = lg_program_inputs(program, function, &out->input_count);
    out->outputs = lg_program_outputs(program, function, &out->output_count);
    out->results = app_alloc(out->output_count, sizeof *out->results);
    uint32_t *inputs = add_inputs(out);
    lg_status status = inline_function(out, program, function, inputs, out->results);
    free(inputs);
    if (status != LG_OK) return lg_fail(error, status, "the function has too many operations to be exported");
    mark(out);
    return fold(out, program, error);
}

void graph_free(graph *g) {
    for (size_t k = 0; k < g->count; k++) {
        free((void *)g->nodes[k].op.inputs);
        free(g->nodes[k].values);
    }
    for (size_t i = 0; i < g->image_count; i++) lg_function_image_destroy(g->images[i]);
    free(g->images);
    free(g->nodes);
    free(g->results);
}
