/* A plan under construction: what its files share. plan.c makes a plan. It asks plan_fates.c what becomes of
 * each node, and plan_steps.c for the steps. Steps stand in the order of plan_order.c and find their places
 * in plan_memory.c. */
#ifndef LG_PLAN_MAKE_H
#define LG_PLAN_MAKE_H

#include "autodiff/program/plan.h"
#include "autodiff/program/plan_graph.h"

typedef enum lg_fate {
    LG_FATE_GIVEN,  /* an input or a constant */
    LG_FATE_VIEW,   /* a part of another node's numbers */
    LG_FATE_FUSED,  /* a product inside of the dense layer that takes it */
    LG_FATE_CODE,   /* scalar code */
    LG_FATE_TENSOR, /* a step of its own */
} lg_fate;

/* What is planned for a node of the graph. */
typedef struct lg_plan_item {
    lg_fate fate;
    uint32_t base; /* LG_FATE_VIEW: the node whose numbers it is a part of, none itself; others: itself */
    size_t offset; /* LG_FATE_VIEW: in the base's numbers */
    uint32_t uses;
    uint32_t made, last; /* steps: that computes it, that reads it last */
    uint32_t phase;      /* in the order of work: even for tensors, odd for scalar code */
    bool lasting;        /* no place is given away, as outputs are */
    lg_place place;
} lg_plan_item;

/* Constants, each once. A piece's values go to place `at` when the plan is finished. */
typedef struct lg_plan_constants {
    const double **values;
    size_t *at, *count;
    size_t pieces, capacity;
    size_t room; /* elements of all */
} lg_plan_constants;

typedef struct lg_planning {
    lg_plan *plan;
    lg_heap temporary;
    lg_graph g;
    lg_plan_item *item;        /* by node */
    struct lg_plan_hole *free; /* holes in the work memory, in order */
    size_t step_capacity;
    lg_plan_constants constants;
    lg_exchange exchange;
    lg_error *error;
    bool compact, packed, failed; /* failed: no memory */
} lg_planning;

/* A step is one tensor, or a run of scalar code: node[first .. first + count - 1] of the order. */
typedef struct lg_plan_run {
    uint32_t first, count;
    bool code;
} lg_plan_run;

typedef struct lg_plan_order {
    uint32_t *node;
    lg_plan_run *run; /* by step */
    size_t steps;
    /* Nodes by the step that reads them last: those of step s are ending[end[s + 1] .. end[s + 2] - 1]. */
    uint32_t *ending, *end;
} lg_plan_order;

/* Zeroed memory, until the plan is made and as long as the plan; NULL: none, and `failed` is set. */
static inline void *lg_planning_take(lg_planning *p, size_t count, size_t size) {
    void *memory = lg_heap_take(&p->temporary, count, size);
    if (memory == NULL) p->failed = true;
    return memory;
}

static inline void *lg_planning_keep(lg_planning *p, size_t count, size_t size) {
    void *memory = lg_heap_take(&p->plan->memory, count, size);
    if (memory == NULL) p->failed = true;
    return memory;
}

/* plan_fates.c: fate, base, offset and uses of every node. */
void lg_planning_find_fates(lg_planning *p);

/* plan_order.c: the order of what has steps; when each node is made and read last. */
lg_status lg_planning_find_order(lg_planning *p, lg_plan_order *out);

static inline bool lg_planning_is_step(const lg_planning *p, uint32_t node) {
    return p->item[node].fate == LG_FATE_CODE || p->item[node].fate == LG_FATE_TENSOR;
}

/* plan_memory.c: pieces of the work memory. */
size_t lg_planning_give_room(lg_planning *p, size_t count);
void lg_planning_take_back(lg_planning *p, size_t offset, size_t count);
/* The place of a node: its own, its base's, or that of a constant. */
lg_place lg_planning_place(lg_planning *p, uint32_t node);
/* Where step `now` writes the node; UINT32_MAX: not over an input. */
void lg_planning_give_place(lg_planning *p, uint32_t node, uint32_t now);
/* Places of outputs, before any other. */
void lg_planning_place_outputs(lg_planning *p);
/* Work memory of nodes that nobody reads any more. */
void lg_planning_end_lives(lg_planning *p, const uint32_t *ending, size_t count);
/* The values have to stay until lg_planning_fill_constants copies them into the plan. */
lg_place lg_planning_add_constant(lg_planning *p, const double *values, size_t count);
lg_status lg_planning_fill_constants(lg_planning *p);

/* plan_steps.c: an empty step at the end of the plan, NULL: no memory; all steps of the graph. */
lg_plan_step *lg_planning_new_step(lg_planning *p, lg_plan_step_kind kind);
lg_status lg_planning_add_steps(lg_planning *p);

#endif
