/* Internals of a plan: the steps of a function for a fixed number of rows. lg_plan_eval executes the steps;
 * the writer of C prints them (for a plan of one row). */
#ifndef LG_PLAN_H
#define LG_PLAN_H

#include "autodiff/tape/heap.h"
#include "autodiff/program/program.h"
#include "autodiff/program/scalars.h"

/* Which memory a number lies in. Offsets are in elements. */
typedef enum lg_area {
    LG_AREA_WORK,
    LG_AREA_CONSTANTS, /* lg_plan.constants: values of parameters and constants */
    LG_AREA_INPUT,     /* input `number` */
    LG_AREA_OUTPUT,    /* output `number` */
    LG_AREA_NONE       /* the operation does not read it, or it does not exist */
} lg_area;

typedef struct lg_place {
    lg_area area;
    uint32_t number; /* number of the input or output */
    size_t offset;
} lg_place;

static inline bool lg_same_place(const lg_place *a, const lg_place *b) {
    return a->area == b->area && a->number == b->number && a->offset == b->offset;
}

/* A tensor operation. If the operation works elementwise, y may be the place of an input; if
 * lg_op.over_first is set, only of input 0. y of a product may be the place of input 2. */
typedef struct lg_tensor_step {
    const lg_op *op;
    lg_attr attr; /* its pointer points into the plan's memory */
    uint32_t inputs;
    const lg_shape **shapes; /* shapes of the inputs */
    lg_place *x;
    lg_place transposed; /* transpose of input 1, or LG_AREA_NONE */
    lg_shape shape;
    size_t count;
    lg_place y, scratch;
    size_t scratch_count; /* elements */
} lg_tensor_step;

/* A dense layer y (m, n) = sigma(x (m, k) W (k, n) + b). */
typedef struct lg_dense_step {
    size_t m, k, n;
    lg_place x, w, b, y; /* the area of b is LG_AREA_NONE if there is no bias */
    lg_activation kind;
} lg_dense_step;

/* `count` adjacent elements that scalar code loads or stores. If the tensor has rows, `place` is in row 0,
 * and row b begins b * apart elements after row 0. If it has no rows, `apart` is 0. */
typedef struct lg_scalar_range {
    lg_place place;
    uint32_t count, apart;
    /* Loads: register of the first element. Stores: index of the first element in lg_scalar_step.stored. */
    uint32_t first;
} lg_scalar_range;

/* A run of scalar operations. The registers hold first the constants, then the loaded values, then the
 * results of the groups of instructions. An instruction uses only constants, loaded values and results of
 * earlier groups. The plan runs the code for each of `rows` rows. rows = 1 means whole tensors. */
typedef struct lg_scalar_step {
    size_t rows;
    /* Numbers of registers: constants, loaded values and results of instructions, in this order. */
    uint32_t constants, loads, instructions;
    const void *constant; /* values of the constants, in the plan's type */
    lg_scalar_range *in;
    uint32_t ins;
    lg_scalar_group *group;
    uint32_t groups;
    /* Register numbers of the operands; some are whole numbers instead (LG_SCALAR_LIST). */
    uint32_t *operands;
    lg_scalar_range *out;
    uint32_t outs;
    uint32_t *stored;   /* the registers that are stored */
    lg_place registers; /* memory of the registers, in the work memory */
} lg_scalar_step;

/* A copy of `count` elements: to an output at the end of a plan, when the output is an input, a constant, a
 * view, or the same node as another output; or of a part of a concatenation to its place. */
typedef struct lg_copy_step {
    lg_place x, y;
    size_t count;
} lg_copy_step;

/* A loop: `times` runs of another plan, with the inputs and outputs of this plan. After each run but the
 * last, outputs become inputs as `carry` says. */
typedef struct lg_call_step {
    struct lg_plan *callee; /* owned by the step */
    uint32_t times;
    /* For each input of the callee: the output that becomes this input after a run, or UINT32_MAX. */
    const uint32_t *carry;
    /* For each carried input: work memory for two values, used alternately. */
    lg_place *next;
    lg_place work;
    /* Output path[k] of the callee goes to entry n of output callee->outputs + k after call n. For each row
     * (path_rows[k] of them) the entries follow each other. `kept` is memory for the output of one call. */
    const uint32_t *path;
    const size_t *path_rows;
    const lg_place *kept;
    size_t paths;
} lg_call_step;

typedef enum lg_plan_step_kind {
    LG_STEP_TENSOR,
    LG_STEP_DENSE,
    LG_STEP_SCALARS,
    LG_STEP_COPY,
    LG_STEP_CALL
} lg_plan_step_kind;

typedef struct lg_plan_step {
    lg_plan_step_kind kind;
    union {
        lg_tensor_step tensor;
        lg_dense_step dense;
        lg_scalar_step scalars;
        lg_copy_step copy;
        lg_call_step call;
    };
} lg_plan_step;

/* Value of lg_plan.spill for an output that needs no place in the work memory: the steps that write it, among
 * them copies, are left out if the caller does not want it, or a called plan computes it. */
#define LG_NO_SPILL SIZE_MAX

struct lg_plan {
    const lg_context *context;
    const lg_kernels *k;
    size_t rows;
    bool mark_unfit;
    const char *name; /* name of the function */
    size_t inputs, outputs;
    size_t *input_count, *output_count; /* elements of each port for all rows */
    lg_plan_step *step;
    size_t steps;
    void *constants; /* in the plan's type; each piece is 64-byte aligned unless packed */
    size_t constant_count;
    size_t work_count; /* elements of work memory */
    /* Longest chain of dependent operations, where a sum of n terms counts as log2 n + 1. */
    size_t depth;
    double work; /* arithmetic operations per run */
    /* For each output: its place in the work memory, used when the caller does not want the output, or
     * LG_NO_SPILL. */
    size_t *spill;
    /* For each function of the program: its plan if steps call it (program_call.h), owned; otherwise NULL. */
    lg_plan **callee;
    size_t callees;
    lg_heap memory; /* everything the plan owns, except the called plans */
};

#endif
