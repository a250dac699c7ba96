/* Scalar code of a plan under construction: a run of operations becomes a step. */
#ifndef LG_PLAN_CODE_H
#define LG_PLAN_CODE_H

#include "autodiff/program/plan.h"
#include "autodiff/program/plan_graph.h"

/* Whether the node is small enough to be written out. */
bool lg_code_fits(const lg_graph *graph, const lg_graph_node *node);

typedef struct lg_code {
    lg_scalars s;
    lg_heap *temporary;
    const lg_graph *graph;
    lg_scalar **value; /* by node: an instruction for each element, or NULL */
    uint32_t *load;    /* by number of an INPUT: node, element */
    uint32_t loads, capacity;
    lg_exchange exchange; /* of the program */
} lg_code;

/* `value`: room for as many entries as the graph has nodes, all NULL. */
void lg_code_begin(lg_code *code, lg_heap *temporary, const lg_graph *graph, lg_scalar **value);
/* Adds a node: its inputs are constants, nodes added before, or are loaded. */
lg_status lg_code_add(lg_code *code, uint32_t node);
/* The step: places of what is loaded by `place_of`, of what is stored likewise; `stored` are nodes that were
 * added. `memory` is the plan's. Registers are left to be placed. */
typedef lg_place (*lg_code_place)(void *user, uint32_t node);
lg_status lg_code_finish(lg_code *code, lg_heap *memory, const lg_kernels *k, const uint32_t *stored,
                         size_t count, lg_code_place place_of, void *user, lg_scalar_step *out);
/* `nodes`: those that were added, or should have been; `value` is all NULL again. */
void lg_code_end(lg_code *code, const uint32_t *nodes, uint32_t count);

#endif
