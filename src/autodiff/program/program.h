/* Internals of programs: functions in the form in which they were recorded ("raw").
 *
 * Files hold raw functions: operations by name with their original inputs, attributes and shapes, in the
 * order of recording. A raw function is not optimised, so it can be put on a tape, differentiated and written
 * as C; lg_plan prepares it for running. */
#ifndef LG_AUTODIFF_PROGRAM_H
#define LG_AUTODIFF_PROGRAM_H

#include "autodiff/ops/op.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/heap.h"
#include "autodiff/tape/tape_internal.h"
#include "core/clean.h"
#include "liegrad/program.h"

LG_AT(lg_program_destroy, lg_program)
LG_AT(lg_function_image_destroy, lg_function_image)

static inline int64_t lg_affine_at(lg_affine a, size_t rows) {
    return a.base + a.rows * (int64_t)rows;
}

typedef enum lg_leaf {
    LG_LEAF_NONE,      /* the node is an operation */
    LG_LEAF_INPUT,     /* input `number` of the function */
    LG_LEAF_PARAMETER, /* parameter `number` of the program */
    LG_LEAF_CONSTANT   /* a constant; element j is reals[payload + j % payload_count] */
} lg_leaf;

/* One operation or leaf of a function. */
typedef struct lg_program_node {
    const lg_op *op; /* &lg_op_leaf for leaves */
    lg_leaf leaf;
    uint32_t number;
    /* Its inputs are the nodes edges[first], edges[first + 1], ..., all with smaller numbers. */
    uint32_t first, inputs;
    uint32_t rank;
    lg_affine dims[LG_MAX_RANK]; /* the output's shape, for a number of rows */
    lg_affine i[4];              /* lg_attr.i */
    double c;                    /* lg_attr.c, unless `inverse` is set */
    /* If not 0, lg_attr.c is 1/inverse instead; this serves a mean over the batch. */
    lg_affine inverse;
    /* A range of `reals` (LG_PAYLOAD_REALS and constants) or of `indices`, depending on the operation. */
    uint32_t payload, payload_count;
} lg_program_node;

typedef struct lg_function {
    char *name;
    lg_port *input, *output; /* the function owns their names and units */
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
    /* If times > 0, the function is a loop without nodes: it calls function `callee` `times` times. carry[i]
     * is the output that becomes input i after each call, or UINT32_MAX if input i stays the same. */
    uint32_t times, callee;
    uint32_t *carry;
    /* A loop's last `paths` outputs hold the values of all its calls: output path[k] of the callee as
     * (times, shape...). */
    uint32_t *path;
    size_t paths;
    bool fitted; /* lg_program_is_fitted */
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
    /* A planted error: replaces the scalar code of one operation in plans. */
    lg_exchange exchange;
};

/* Limits of functions that are built or loaded; a file beyond them is refused. */
#define LG_PROGRAM_MAX_FUNCTIONS  256
#define LG_PROGRAM_MAX_PARAMETERS 256
#define LG_PROGRAM_MAX_PORTS      64
#define LG_PROGRAM_MAX_ALL_NODES  (1u << 22) /* of all functions together */
#define LG_PROGRAM_MAX_TIMES      (1u << 24) /* number of calls in a loop */
#define LG_PROGRAM_MAX_NAME       64         /* characters of a name, and bytes of a unit */
#define LG_PROGRAM_MAX_TEXT       4095       /* bytes of a description */
#define LG_PROGRAM_MAX_DIM        ((int64_t)1 << 31)
/* Limit for tensors without elements, such as (B, 0, 5): the product of their dimensions, with 1 in place of
 * 0, so that loops over the other dimensions stay short. */
#define LG_PROGRAM_MAX_EMPTY ((uint64_t)1 << 24)

/* Returns the reason why `name` cannot be the name of a function, port or parameter, or NULL if it can. A
 * name is a C identifier of at most LG_PROGRAM_MAX_NAME characters that is no keyword of C or C++. */
const char *lg_program_name_problem(const char *name);
/* The name in a form that may be printed in a message: cut off if too long, with '?' for everything except
 * printable ASCII. */
#define LG_SHOWN_NAME (LG_PROGRAM_MAX_NAME + 1)
const char *lg_shown_name(const char *name, char shown[LG_SHOWN_NAME]);

/* Creates an empty program. Parts are added afterwards, and each part is checked. Names and arrays are
 * copied. */
lg_status lg_program_create(const lg_context *context, lg_program **out);
/* Builds a program of functions alone; derives the Jacobian by all inputs of a function. */
lg_status lg_program_of(const lg_context *context, const lg_function_spec *functions, size_t count,
                        lg_program **out, lg_error *error);
/* `record` of a function that is a copy of `user`, a function of another program (lg_program_part), whose
 * parameters become constants. */
typedef struct lg_program_part {
    const lg_program *program;
    size_t function;
} lg_program_part;
lg_status lg_program_record_part(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                 lg_var *out);
/* Copies a function into a new program with the same parameters and description. The copy records the
 * operations of calls and loops in their place. The caller destroys *out. */
lg_status lg_program_flat(const lg_program *program, size_t function, lg_program **out, lg_error *error);
/* The names of derivatives of each kind begin with these texts. Returns whether a name begins with one. */
extern const char *const lg_derivative_begins[LG_DERIVATIVE_KIND_COUNT];
bool lg_program_is_derivative(const char *name);
lg_status lg_program_jacobian(lg_program *program, const char *function, lg_error *error);
/* Makes a program without functions that has the parameters and the description of another. */
lg_status lg_program_bare(const lg_program *from, lg_program **out, lg_error *error);
lg_status lg_program_add_parameter(lg_program *program, const lg_parameter_spec *parameter, lg_error *error);
/* Adds a function. On success the program takes over what `function` owns. Everything is checked: names, that
 * inputs of a node come before it, the operations' numbers of inputs, attributes and shapes (by the shape
 * rules, at several numbers of rows), payload, that numbers are finite, and the nodes and shapes of
 * outputs. */
lg_status lg_program_take_function(lg_program *program, lg_function *function, lg_error *error);
/* Records a function with `spec` and adds it to the program. `known`: it consists of known operations, such
 * as a derivative, so fewer recordings are compared, which compute nothing: inputs take no memory. */
lg_status lg_program_record_function(lg_program *program, const lg_function_spec *spec, bool known,
                                     lg_error *error);
void lg_function_destroy(const lg_context *context, lg_function *function);
/* The port `name` with the values of an output from all calls of a loop: (times, shape...). The output's rank
 * is below LG_MAX_RANK. */
lg_port lg_path_port(const lg_port *output, uint32_t times, const char *name);

/* Plans the function with this name: lg_plan_create with this dtype, these rows and default options. */
LG_API lg_status lg_program_plan(const lg_program *program, const char *function, lg_dtype dtype, size_t rows,
                                 lg_plan **out, lg_error *error);

/* Shape and attributes of a node for this number of rows. False: a dimension or an attribute is negative or
 * too large for this number. attr->pointer points into the function. */
bool lg_node_shape_at(const lg_program_node *node, size_t rows, lg_shape *shape);
bool lg_node_attr_at(const lg_function *function, const lg_program_node *node, size_t rows, lg_attr *attr);

/* A function image together with its memory. `image` must be the first member, because
 * lg_function_image_destroy gets its address. lg_owned_image_create returns NULL when out of memory; `most`
 * limits the bytes of the heap. */
typedef struct lg_owned_image {
    lg_function_image image;
    lg_heap heap;
} lg_owned_image;
lg_owned_image *lg_owned_image_create(const lg_context *context, size_t most);

/* Copies ports into new memory, which the caller owns. On failure nothing stays allocated. */
lg_status lg_ports_copy(const lg_context *context, const lg_port *ports, size_t count, lg_port **out);

#endif
