/* A plan inside: the steps of a function for a number of rows. lg_plan_run walks through them; the writer of
 * C prints them (of a plan of one row). */
#ifndef LG_PLAN_H
#define LG_PLAN_H

#include "autodiff/program.h"
#include "autodiff/scalars.h"

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
    lg_op_code op;
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

/* Elements that go into, or come out of, scalar code: row r of a tensor with `stride` elements a row (0: the
 * same for all rows) begins at place.offset + r stride; `count` elements of it from `from` on. */
typedef struct lg_scalar_range {
    lg_place place;
    size_t stride, from;
    uint32_t count;
    uint32_t first; /* in: the first of `count` registers; out: the first of `count` entries of `stored` */
} lg_scalar_range;

/* A run of scalar operations, for each of `rows` rows. Registers: constants, what is loaded, then a result
 * for each instruction in the order of `code`. */
typedef struct lg_scalar_instruction {
    uint16_t op; /* lg_scalar_op */
    uint16_t unused;
    uint32_t in[3]; /* registers */
    uint32_t n;
    double p;
} lg_scalar_instruction;

typedef struct lg_scalar_group {
    uint16_t op;
    uint32_t first, count; /* instructions, one behind the other, none of which needs another one */
} lg_scalar_group;

typedef struct lg_scalar_step {
    size_t rows;
    uint32_t constants, loads, instructions; /* registers of each sort, in this order */
    const double *constant;
    lg_scalar_range *in;
    uint32_t ins;
    lg_scalar_instruction *code; /* grouped: level by level, in a level by operation */
    lg_scalar_group *group;
    uint32_t groups;
    lg_scalar_range *out;
    uint32_t outs;
    uint32_t *stored;   /* registers */
    lg_place registers; /* of the work memory */
} lg_scalar_step;

/* A copy of `count` elements: an input that is an output, a view that has to be whole. */
typedef struct lg_copy_step {
    lg_place x, y;
    size_t count;
} lg_copy_step;

/* `times` runs of another plan. Its inputs and outputs; after each run but the last, outputs take the places
 * of inputs. */
typedef struct lg_call_step {
    const struct lg_plan *callee;
    uint32_t times;
    const uint32_t *carry; /* by input of the callee: its output, or UINT32_MAX */
    lg_place *next;        /* by input: memory of what is carried, in the work memory; two halves */
    lg_place work;
} lg_call_step;

typedef enum lg_step_kind {
    LG_STEP_TENSOR,
    LG_STEP_DENSE,
    LG_STEP_SCALARS,
    LG_STEP_COPY,
    LG_STEP_CALL
} lg_step_kind;

typedef struct lg_step {
    lg_step_kind kind;
    union {
        lg_tensor_step tensor;
        lg_dense_step dense;
        lg_scalar_step scalars;
        lg_copy_step copy;
        lg_call_step call;
    };
} lg_step;

struct lg_plan {
    const lg_context *context;
    const lg_kernels *k;
    size_t rows;
    bool mark_unfit;
    size_t inputs, outputs;
    size_t *input_count, *output_count; /* elements for all rows */
    lg_step *step;
    size_t steps;
    void *constants; /* of the plan's type, 64-byte aligned pieces */
    size_t constant_count;
    size_t work_count; /* elements */
    size_t depth;      /* operations one after another at most, counting a sum of n terms as log2 n + 1 */
    struct lg_arena_plain *memory; /* everything the plan owns */
};

#endif
