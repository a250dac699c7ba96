/* Programs inside: functions as they were recorded ("raw").
 *
 * A raw function is what files hold: operations by name with their original inputs, attributes and shapes, in
 * the order of recording. Nothing is optimised in it, so it can be put on a tape, differentiated and
 * translated; lg_plan makes it ready to run.
 */
#ifndef LG_AUTODIFF_PROGRAM_H
#define LG_AUTODIFF_PROGRAM_H

#include "autodiff/ops/op.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/heap.h"
#include "autodiff/tape/tape_internal.h"
#include "liegrad/program.h"
#include "liegrad/program_image.h"

static inline int64_t lg_affine_at(lg_affine a, size_t rows) {
    return a.base + a.rows * (int64_t)rows;
}

typedef enum lg_leaf {
    LG_LEAF_NONE,      /* an operation */
    LG_LEAF_INPUT,     /* input `number` of the function */
    LG_LEAF_PARAMETER, /* parameter `number` of the program */
    LG_LEAF_CONSTANT   /* element j is reals[payload + j % payload_count] */
} lg_leaf;

/* One operation or leaf. */
typedef struct lg_program_node {
    const lg_op *op; /* &lg_op_leaf for leaves */
    lg_leaf leaf;
    uint32_t number;
    uint32_t first, inputs; /* edges[first ...]: the nodes it takes, all before it */
    uint32_t rank;
    lg_affine dims[LG_MAX_RANK]; /* the output's shape */
    lg_affine i[4];              /* lg_attr.i */
    double c;                    /* lg_attr.c */
    lg_affine inverse;           /* not 0: lg_attr.c is 1/inverse instead, as a mean over the batch has it */
    uint32_t payload, payload_count; /* reals (LG_PAYLOAD_REALS, constants) or indices, by the operation */
} lg_program_node;

typedef struct lg_function {
    char *name;
    lg_port *input, *output; /* own their names and units */
    size_t inputs, outputs;
    lg_program_node *node;
    uint32_t nodes;
    uint32_t *edges;
    size_t edge_count;
    double *reals;
    size_t real_count;
    uint32_t *indices;
    size_t index_count;
    uint32_t *result; /* node of each output */
    /* A loop instead: calls function `callee` `times` times. carry[i]: the output that takes the place of
     * input i after a call, or UINT32_MAX. No nodes then. */
    uint32_t times, callee;
    uint32_t *carry;
} lg_function;

typedef struct lg_program_parameter_own {
    char *name;
    lg_shape shape;
    size_t count;
    double *values;
} lg_program_parameter_own;

struct lg_program {
    const lg_context *context;
    char *description;
    lg_program_parameter_own *parameter;
    size_t parameters;
    lg_function *function;
    size_t functions, capacity;
    lg_exchange exchange; /* of the scalar code of one operation in plans */
};

/* Limits of what is built or loaded; a file beyond them is refused. */
#define LG_PROGRAM_MAX_FUNCTIONS  256
#define LG_PROGRAM_MAX_PARAMETERS 256
#define LG_PROGRAM_MAX_PORTS      64
#define LG_PROGRAM_MAX_NODES      (1u << 20)
#define LG_PROGRAM_MAX_ALL_NODES  (1u << 22) /* of all functions */
#define LG_PROGRAM_MAX_TIMES      (1u << 24) /* calls of a loop */
#define LG_PROGRAM_MAX_NAME       64         /* characters of a name, bytes of a unit */
#define LG_PROGRAM_MAX_TEXT       4095       /* bytes of a description */
#define LG_PROGRAM_MAX_DIM        ((int64_t)1 << 31)
/* A tensor without elements, such as (B, 0, 5), is no larger than this with 1 for 0: loops over its other
 * dimensions stay short. */
#define LG_PROGRAM_MAX_EMPTY ((uint64_t)1 << 24)

/* Why `name` cannot be the name of a function, port or parameter (a C identifier of at most
 * LG_PROGRAM_MAX_NAME characters, none of C's or C++'s words), or NULL. */
const char *lg_program_name_problem(const char *name);
/* The name as it may stand in a sentence: cut, other characters than printable ASCII as '?'. */
#define LG_SHOWN_NAME (LG_PROGRAM_MAX_NAME + 1)
const char *lg_shown_name(const char *name, char shown[LG_SHOWN_NAME]);

/* An empty program; parts are added, each checked. `name`s and arrays are copied. */
lg_status lg_program_create(const lg_context *context, lg_program **out);
lg_status lg_program_add_parameter(lg_program *program, const lg_parameter_spec *parameter, lg_error *error);
/* Takes over what `function` owns when it succeeds. Everything is checked: names, edges that point forward,
 * operations' numbers of inputs, attributes and shapes (by the shape rules, at several numbers of rows),
 * payload, numbers that are not finite, what outputs are. */
lg_status lg_program_add_function(lg_program *program, lg_function *function, lg_error *error);
/* Records a function into it. */
lg_status lg_program_record_function(lg_program *program, const lg_function_spec *spec, bool derivative,
                                     lg_error *error);
void lg_function_destroy(const lg_context *context, lg_function *function);

/* Node `node`'s shape and attributes at so many rows; false: a dimension or an attribute is negative or too
 * large then. attr->pointer points into the function. */
bool lg_node_shape_at(const lg_program_node *node, size_t rows, lg_shape *shape);
bool lg_node_attr_at(const lg_function *function, const lg_program_node *node, size_t rows, lg_attr *attr);

/* An image and its memory. lg_function_image_destroy is given the address of `image`, the first member. NULL:
 * out of memory. */
typedef struct lg_owned_image {
    lg_function_image image;
    lg_heap heap;
} lg_owned_image;
lg_owned_image *lg_owned_image_create(const lg_context *context, size_t most);

/* Copies of ports, in memory of the function; on failure nothing is kept. */
lg_status lg_ports_copy(const lg_context *context, const lg_port *ports, size_t count, lg_port **out);

#endif
