/* A function of a program as one list of operations. Calls and loops are written out, operations that no
 * result needs are marked as not needed, and operations that depend on parameters alone become constants,
 * which the library computes. */
#ifndef LG_EXPORT_GRAPH_H
#define LG_EXPORT_GRAPH_H

#include "lg-export/export.h"

typedef struct graph_node {
    lg_operation op; /* Its inputs are indices of nodes of this graph. */
    bool needed;     /* A result depends on it, and it is not merely an operand of a constant. */
    bool varies;     /* It depends on an input or on the number of rows. */
    double *values;  /* Elements of a needed constant; NULL for all other nodes. */
    size_t count;
} graph_node;

typedef struct graph {
    const lg_program *program;
    size_t function;
    const lg_port *inputs, *outputs;
    size_t input_count, output_count;
    graph_node *nodes;
    size_t count;
    const uint32_t *results; /* (output_count) */
    lg_program *flat;        /* has the function without calls and loops */
    lg_function_image *image;
} graph;

/* Errors: those of lg_program_add_function and lg_plan_create. */
lg_status graph_make(const lg_program *program, size_t function, graph *out, lg_error *error);
void graph_free(graph *g);

#endif
