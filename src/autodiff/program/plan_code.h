/* Scalar code of a plan under construction: turns a run of operations into one step. */
#ifndef LG_PLAN_CODE_H
#define LG_PLAN_CODE_H

#include "autodiff/program/plan.h"
#include "autodiff/program/plan_graph.h"

/* Returns the number of elements in one row of the node, or in the whole node if it has no rows. */
size_t lg_code_count(const lg_graph *graph, uint32_t node);
/* Returns true if scalar code can compute the node, or one row of it, and this is small enough. */
bool lg_code_fits(const lg_graph *graph, uint32_t node);

typedef struct lg_code {
    lg_scalars s;
    lg_heap *temporary;
    const lg_graph *graph;
    size_t rows;       /* rows of the batch if an added node has rows; else 1 */
    lg_scalar **value; /* for each node: one instruction per element (of a row), or NULL */
    uint32_t *load;    /* for each INPUT instruction, by number: node and element */
    uint32_t loads, capacity;
    lg_exchange exchange; /* the program's planted error */
} lg_code;

/* `value` must have one entry per node of the graph, all NULL. */
void lg_code_begin(lg_code *code, lg_heap *temporary, const lg_graph *graph, lg_scalar **value);
/* Adds the scalar code of a node. Its inputs are constants, nodes added before, or nodes that are loaded. */
lg_status lg_code_add(lg_code *code, uint32_t node);
/* Makes the step. place_of(user, node) returns the place of a node that is loaded or stored. `stored` lists
 * the added nodes whose values must be stored. `memory` is the plan's heap. The caller must still assign
 * lg_scalar_step.registers. */
typedef lg_place (*lg_code_place)(void *user, uint32_t node);
lg_status lg_code_finish(lg_code *code, lg_heap *memory, const lg_kernels *k, const uint32_t *stored,
                         size_t count, lg_code_place place_of, void *user, lg_scalar_step *out);
/* Frees the scalar code and sets all entries of `value` to NULL again. `nodes` lists all nodes for which
 * lg_code_add was called or would have been. */
void lg_code_end(lg_code *code, const uint32_t *nodes, uint32_t count);

#endif
