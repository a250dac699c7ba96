/* A function of a program as one list of operations: calls and loops are written out, what nothing needs is
 * left out, and what depends on parameters alone is a constant, computed by the library. */
#ifndef LG_EXPORT_GRAPH_H
#define LG_EXPORT_GRAPH_H

#include "lg-export/export.h"
#include "liegrad/program_image.h"

typedef struct graph_node {
    lg_operation op; /* its inputs are nodes of the graph */
    bool needed;     /* a result depends on it and it is not inside of a constant */
    bool varies;     /* it depends on an input */
    double *values;  /* constants that are needed: all elements; NULL otherwise */
    size_t count;
} graph_node;

typedef struct graph {
    const lg_port *inputs, *outputs;
    size_t input_count, output_count;
    graph_node *nodes;
    size_t count, room;
    uint32_t *results; /* (output_count) */
    lg_function_image **images;
    size_t image_count;
} graph;

/* Errors, with a sentence: LG_UNSUPPORTED (more than 2^20 operations), those of lg_plan_create. */
lg_status graph_make(lg_program *program, size_t function, graph *out, lg_error *error);
void graph_free(graph *g);

#endif
