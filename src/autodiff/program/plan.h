/* A plan inside: the steps of a function for a number of rows. lg_plan_eval walks through them; the writer of
 * C prints them (of a plan of one row). */
#ifndef LG_PLAN_H
#define LG_PLAN_H

#include "autodiff/tape/heap.h"
#include "autodiff/program/program.h"
#include "autodiff/program/scalars.h"

/* Where numbers lie. Offsets are in elements. */
typedef enum lg_area {
    LG_AREA_WORK,
    LG_AREA_CONSTANTS, /* lg_plan.constants: made from parameters and constants */
    LG_AREA_INPUT,     /* + input */
    LG_AREA_OUTPUT,    /* + output */
    LG_AREA_NONE       /* not read, not there */
} lg_area;

typedef struct lg_place {
    lg_area area;
    uint32_t number; /* which input or output */
    size_t offset;
} lg_place;

/* A tensor operation. y may be the place of input `over` when the operation works elementwise in place. */
typedef struct lg_tensor_step {
    const lg_op *op;
    lg_attr attr; /* pointer into the plan's payload */
    uint32_t inputs;
    const lg_shape **shapes; /* of inputs */
    lg_place *x;
    lg_place transposed; /* of input 1, or LG_AREA_NONE */
    lg_shape shape;
    size_t count;
    lg_place y, scratch;
    size_t scratch_count; /* elements */
} lg_tensor_step;

/* y (m, n) = sigma(x (m, k) W (k, n) + b) */
typedef struct lg_dense_step {
    size_t m, k, n;
    lg_place x, w, b, y; /* b: LG_AREA_NONE for none */
    lg_activation kind;
} lg_dense_step;

/* `count` neighbouring elements that go into, or come out of, scalar code. */
typedef struct lg_scalar_range {
    lg_place place;
    uint32_t count;
    uint32_t first; /* in: the first of their registers; out: the first of their entries in `stored` */
} lg_scalar_range;

/* A run of scalar operations. Registers: constants, what is loaded, then the results of the groups, level by
 * level: an instruction needs results of groups before its own only. */
typedef struct lg_scalar_step {
    uint32_t constants, loads, instructions; /* registers of each sort, in this order */
    const void *constant;                    /* of the plan's type */
    lg_scalar_range *in;
    uint32_t ins;
    lg_scalar_group *group;
    uint32_t groups;
    uint32_t *operands; /* registers, or whole numbers: LG_SCALAR_LIST */
    lg_scalar_range *out;
    uint32_t outs;
    uint32_t *stored;   /* registers that go out */
    lg_place registers; /* in the work memory */
} lg_scalar_step;

/* A copy of `count` elements: an input that is an output, a view that has to be whole. */
typedef struct lg_copy_step {
    lg_place x, y;
    size_t count;
} lg_copy_step;

/* `times` runs of another plan. Its inputs and outputs; after each run but the last, outputs take the places
 * of inputs. */
typedef struct lg_call_step {
    struct lg_plan *callee; /* owned */
    uint32_t times;
    const uint32_t *carry; /* by input of the callee: its output, or UINT32_MAX */
    lg_place *next;        /* by input: in the work memory, for two values of what is carried */
    lg_place work;
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

/* Of an output that is copied at the end, if anybody wants it, or that another plan makes. */
#define LG_NO_SPILL SIZE_MAX

struct lg_plan {
    const lg_context *context;
    const lg_kernels *k;
    size_t rows;
    bool mark_unfit;
    const char *name; /* of the function */
    size_t inputs, outputs;
    size_t *input_count, *output_count; /* elements for all rows */
    lg_plan_step *step;
    size_t steps;
    void *constants; /* of the plan's type, 64-byte aligned pieces */
    size_t constant_count;
    size_t work_count; /* elements */
    size_t depth;      /* operations one after another at most, counting a sum of n terms as log2 n + 1 */
    double work;       /* operations on numbers of a run */
    size_t *spill;     /* by output: where in the work memory it goes when nobody wants it, or LG_NO_SPILL */
    lg_plan **callee;  /* by function of the program: plans of what steps call (program_call.h), owned */
    size_t callees;
    lg_heap memory; /* everything the plan owns but callees */
};

#endif
