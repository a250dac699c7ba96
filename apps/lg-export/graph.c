#include "lg-export/graph.h"

#include <string.h>

enum { MOST_PORTS = LG_PROGRAM_MAX_PORTS };

static lg_status take_operations(graph *g, lg_error *error) {
    LG_TRY(lg_program_flat(g->program, g->function, &g->flat, error));
    LG_TRY(lg_function_image_create(g->flat, 0, &g->image));
    g->count = g->image->operation_count;
    g->results = g->image->results;
    g->nodes = app_keep(g->count, sizeof *g->nodes);
    for (size_t k = 0; k < g->count; k++) g->nodes[k].op = g->image->operations[k];
    return LG_OK;
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

/* Computes constants, as the outputs of a function in a program of its own. */
static lg_status compute(graph *g, const uint32_t *which, size_t count, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    char names[MOST_PORTS][32];
    const double *in[MOST_PORTS];
    double *out[MOST_PORTS];
    lg_port outputs[MOST_PORTS];
    lg_function_image image = *g->image;
    size_t largest = 1;
    image.results = which, image.outputs = outputs, image.output_count = count;
    for (size_t i = 0; i < g->input_count; i++)
        if (lg_shape_count(g->inputs[i].shape) > largest) largest = lg_shape_count(g->inputs[i].shape);
    APP_FREE double *zeros = app_alloc(largest, sizeof *zeros);
    for (size_t i = 0; i < g->input_count; i++) in[i] = zeros;
    for (size_t i = 0; i < count; i++) {
        graph_node *n = &g->nodes[which[i]];
        (void)snprintf(names[i], sizeof names[i], "constant_%zu", i);
        outputs[i] = (lg_port){.name = names[i], .shared = true, .shape = {.rank = n->op.rank}};
        for (uint32_t k = 0; k < n->op.rank; k++) outputs[i].shape.dims[k] = (uint32_t)n->op.shape[k].base;
        n->count = lg_shape_count(outputs[i].shape);
        out[i] = n->values = app_keep(n->count, sizeof *n->values);
    }
    LG_TRY(lg_program_bare(g->program, &program, error));
    LG_TRY(lg_program_add_image(program, &image, error));
    return lg_program_eval(NULL, program, image.name, 1, in, out, error);
}

/* Computes all constants that are needed, at most MOST_PORTS of them per function. */
static lg_status fold(graph *g, lg_error *error) {
    APP_FREE uint32_t *which = app_alloc(g->count, sizeof *which);
    size_t count = 0;
    for (size_t k = 0; k < g->count; k++)
        if (g->nodes[k].needed && !g->nodes[k].varies) which[count++] = (uint32_t)k;
    lg_status status = LG_OK;
    for (size_t at = 0; at < count && status == LG_OK; at += MOST_PORTS)
        status = compute(g, which + at, count - at < MOST_PORTS ? count - at : MOST_PORTS, error);
    return status;
}

/* ---- the graph ---- */

lg_status graph_make(const lg_program *program, size_t function, graph *out, lg_error *error) {
    *out = (graph){.program = program, .function = function};
    out->inputs = lg_program_inputs(program, function, &out->input_count);
    out->outputs = lg_program_outputs(program, function, &out->output_count);
    LG_TRY(take_operations(out, error));
    mark(out);
    return fold(out, error);
}

void graph_free(graph *g) {
    lg_function_image_destroy(g->image);
    lg_program_destroy(g->flat);
}
