/* A plan under construction: what the files that make a plan share. plan.c makes a plan. plan_fates.c decides
 * how each node is computed. plan_order.c puts the steps in order, plan_memory.c assigns memory, and
 * plan_steps.c makes the steps. */
#ifndef LG_PLAN_MAKE_H
#define LG_PLAN_MAKE_H

#include "autodiff/program/plan.h"
#include "autodiff/program/plan_graph.h"

typedef enum lg_fate {
    LG_FATE_GIVEN,  /* an input or a constant */
    LG_FATE_VIEW,   /* a part of another node's elements */
    LG_FATE_FUSED,  /* a product that the step of its only user computes: a dense layer or a sum */
    LG_FATE_CODE,   /* computed by scalar code */
    LG_FATE_TENSOR, /* computed by a tensor step */
} lg_fate;

/* What is planned for a node of the graph. */
typedef struct lg_plan_item {
    lg_fate fate;
    /* LG_FATE_VIEW: the node, itself no view, whose elements this node is a part of. Otherwise the node
     * itself. */
    uint32_t base;
    size_t offset; /* LG_FATE_VIEW: offset in the elements of `base` */
    /* LG_FATE_TENSOR, a sum: the product that its step adds to the other term, or LG_GRAPH_NONE. */
    uint32_t product;
    /* The concatenation or sum in whose memory the node's elements lie from the start, or LG_GRAPH_NONE; and
     * where they begin. */
    uint32_t into;
    size_t into_offset;
    uint32_t uses;
    uint32_t made, last; /* the step that computes it; the last step that reads it */
    /* Position in the order of steps: even for tensor steps, odd for scalar code. See phase_of. */
    uint32_t phase;
    /* Its memory must not be given back: it is an output, or another node has taken the memory over. */
    bool lasting;
    bool skipped; /* It is an output, and its steps are left out if the caller does not want it. */
    lg_place place;
} lg_plan_item;

/* The plan's constants. A piece that is added again (same pointer and count) is stored once. The values of
 * piece i are copied to offset at[i] when the plan is finished. */
typedef struct lg_plan_constants {
    const double **values;
    size_t *at, *count;
    size_t pieces, capacity;
    size_t room; /* elements of all pieces together */
} lg_plan_constants;

typedef struct lg_planning {
    lg_plan *plan;
    lg_heap temporary;
    lg_graph g;
    lg_plan_item *item;        /* one per node */
    struct lg_plan_hole *free; /* holes in the work memory, sorted by offset */
    size_t step_capacity;
    lg_plan_constants constants;
    lg_exchange exchange;
    lg_error *error;
    bool compact, packed; /* as in lg_plan_options */
    bool failed;          /* out of memory */
} lg_planning;

/* The nodes of one step, node[first .. first + count - 1] of the order: one tensor, or a run of scalar
 * code. */
typedef struct lg_plan_run {
    uint32_t first, count;
    bool code;
} lg_plan_run;

typedef struct lg_plan_order {
    uint32_t *node;
    lg_plan_run *run; /* one per step */
    size_t steps;
    /* The nodes sorted by the step that reads them last. The nodes that step s reads last are ending[end[s +
     * 1] .. end[s + 2] - 1]. */
    uint32_t *ending, *end;
} lg_plan_order;

/* Zeroed memory. lg_planning_take: until the plan is made; lg_planning_keep: as long as the plan lives. NULL:
 * out of memory, and `failed` is set. */
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

/* plan_fates.c: sets fate, base, offset, into and uses of every node. */
void lg_planning_find_fates(lg_planning *p);
/* Whether a tensor step's node is the concatenation of tensors whose elements follow each other. Its step
 * only copies the parts that do not lie in its memory from the start. */
bool lg_planning_joins(const lg_planning *p, uint32_t node);

/* plan_order.c: finds the order of the steps, and the steps at which each node is made and read last. */
lg_status lg_planning_find_order(lg_planning *p, lg_plan_order *out);

static inline bool lg_planning_is_step(const lg_planning *p, uint32_t node) {
    return p->item[node].fate == LG_FATE_CODE || p->item[node].fate == LG_FATE_TENSOR;
}

/* plan_memory.c: lg_planning_give_room allocates a piece of the work memory and returns its offset,
 * lg_planning_take_back frees a piece. */
size_t lg_planning_give_room(lg_planning *p, size_t count);
void lg_planning_take_back(lg_planning *p, size_t offset, size_t count);
/* The place of a node: its memory, a part of its base's memory, or its place among the constants. */
lg_place lg_planning_place(lg_planning *p, uint32_t node);
/* Assigns the memory that the step computing the node writes to. `now` is this step; the node may then
 * overwrite an input that is not needed after it. UINT32_MAX: the node must not overwrite an input. */
void lg_planning_give_place(lg_planning *p, uint32_t node, uint32_t now);
/* Assigns outputs to nodes. Must be called before any other place is assigned. */
void lg_planning_place_outputs(lg_planning *p);
/* Returns the work memory of nodes that no later step reads. */
void lg_planning_end_lives(lg_planning *p, const uint32_t *ending, size_t count);
/* The values must stay valid until lg_planning_fill_constants copies them into the plan. */
lg_place lg_planning_add_constant(lg_planning *p, const double *values, size_t count);
lg_status lg_planning_fill_constants(lg_planning *p);

/* plan_steps.c: lg_planning_new_step appends an empty step to the plan (NULL: out of memory);
 * lg_planning_add_steps adds all steps of the graph. */
lg_plan_step *lg_planning_new_step(lg_planning *p, lg_plan_step_kind kind);
lg_status lg_planning_add_steps(lg_planning *p);

#endif
