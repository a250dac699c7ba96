/* A function at a number of rows, simplified: only what the outputs need, constants folded, equal
 * subexpressions once. Values of constants are doubles (of parameters rounded to the plan's type). */
#ifndef LG_PLAN_GRAPH_H
#define LG_PLAN_GRAPH_H

#include "autodiff/tape/heap.h"
#include "autodiff/program/program.h"

typedef enum lg_graph_sort { LG_GRAPH_OPERATION, LG_GRAPH_INPUT, LG_GRAPH_CONSTANT } lg_graph_sort;

#define LG_GRAPH_NONE UINT32_MAX

typedef struct lg_graph_node {
    lg_graph_sort sort;
    const lg_op *op;
    lg_attr attr;
    uint32_t number; /* of an input */
    uint32_t inputs;
    uint32_t *in; /* nodes before it; LG_GRAPH_NONE where the operation does not read */
    lg_shape shape;
    size_t count;
    const double *value; /* of a constant */
    bool weights;        /* of a constant: it comes from parameters */
} lg_graph_node;

typedef struct lg_graph {
    lg_heap *heap; /* all of it lives there */
    lg_graph_node *node;
    uint32_t count, capacity;
    uint32_t *table; /* hashes: 1 + node */
    uint32_t slots;
    uint32_t *result;       /* by output */
    double work, most_work; /* of folding */
    bool failed;            /* out of memory */
} lg_graph;

/* rows, dtype, calls and most_work as in the options. LG_UNSUPPORTED: folding takes more than most_work
 * operations. */
lg_status lg_graph_make(lg_heap *heap, const lg_program *program, const lg_function *function,
                        const lg_plan_options *options, lg_graph *out, lg_error *error);

/* Memory of the graph's heap. NULL: `failed` is set. */
void *lg_graph_take(lg_graph *graph, size_t count, size_t size);
/* The node's number; an equal node that was there before is taken. node->in may live on the caller's stack.
 * 0 after a failure. */
uint32_t lg_graph_add(lg_graph *graph, const lg_graph_node *node);
uint32_t lg_graph_add_constant(lg_graph *graph, lg_shape shape, const double *value, bool weights);
/* What stands for an operation after simplification (plan_simplify.c); shapes: of its inputs. */
uint32_t lg_graph_operation(lg_graph *graph, const lg_graph_node *node, const lg_shape *const *shapes);

/* Operations on numbers that a node takes, about: its elements times the terms of its longest sum. */
double lg_graph_work(const lg_graph *graph, const lg_graph_node *node);

/* The shapes of a node's inputs; of one that is not read, the shape of another place (operations do not
 * look). */
void lg_graph_shapes(const lg_graph *graph, const lg_graph_node *node, const lg_shape **shapes);

#endif
