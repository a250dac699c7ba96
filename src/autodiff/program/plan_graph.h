/* A function for a fixed number of rows, simplified: it holds only what the outputs need, constants are
 * folded, and equal subexpressions occur once. Values of constants are stored as doubles; parameters are
 * first rounded to the plan's type. */
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
    uint32_t number; /* number of an input */
    uint32_t inputs;
    /* The inputs, nodes before this one; LG_GRAPH_NONE for an input that the operation does not read. */
    uint32_t *in;
    lg_shape shape;
    size_t count;
    const double *value; /* values of a constant */
    bool weights;        /* the constant depends on parameters */
} lg_graph_node;

typedef struct lg_graph {
    lg_heap *heap; /* holds all memory of the graph */
    lg_graph_node *node;
    uint32_t count, capacity;
    uint32_t *table; /* hash table of 1 + node number */
    uint32_t slots;
    uint32_t *result;       /* node of each output */
    uint32_t rows;          /* rows of the batch */
    double work, most_work; /* arithmetic operations spent on folding constants, and their limit */
    bool failed;            /* out of memory */
} lg_graph;

/* Makes the graph. Of the options it uses rows, dtype, calls and most_work. `exact`: no operation is replaced
 * by another or computed, so nothing is rounded. LG_UNSUPPORTED: folding constants takes more than most_work
 * operations. */
lg_status lg_graph_make(lg_heap *heap, const lg_program *program, const lg_function *function,
                        const lg_plan_options *options, bool exact, lg_graph *out, lg_error *error);

/* Memory from the graph's heap. NULL: out of memory, and `failed` is set. */
void *lg_graph_take(lg_graph *graph, size_t count, size_t size);
/* Adds a node and returns its number, or the number of an equal node that the graph already has. node->in may
 * be on the caller's stack. Returns 0 on failure. */
uint32_t lg_graph_add(lg_graph *graph, const lg_graph_node *node);
uint32_t lg_graph_add_constant(lg_graph *graph, lg_shape shape, const double *value, bool weights);
/* Adds an operation after simplification (plan_simplify.c) and returns the node that takes its place.
 * `shapes` are the shapes of its inputs. */
uint32_t lg_graph_operation(lg_graph *graph, const lg_graph_node *node, const lg_shape *const *shapes);

/* Returns true if the node is a constant whose elements all equal `with`. Returns false for weights, because
 * the structure of a plan must not depend on the values of weights. Returns false for LG_GRAPH_NONE. */
bool lg_graph_filled(const lg_graph *graph, uint32_t node, double with);
/* plan_join.c: the concatenation that a sum of padded tensors is, or LG_GRAPH_NONE for any other operation.
 * Takes the same arguments as lg_graph_operation. */
uint32_t lg_graph_joined(lg_graph *graph, const lg_graph_node *node, const lg_shape *const *shapes);

/* Approximate number of arithmetic operations of a node: its elements times the terms of its longest sum. */
double lg_graph_work(const lg_graph *graph, const lg_graph_node *node);

/* Sets the shapes of a node's inputs. An input that the operation does not read gets a shape of rank 0; the
 * operation does not use it. */
void lg_graph_shapes(const lg_graph *graph, const lg_graph_node *node, const lg_shape **shapes);

#endif
