/* An operation is one row of the operation table (op_table.h). Its shape rule, forward, vjp, jvp and C code
 * stand together in one file.
 *
 * The shape rule and forward use neither tape nor program: they only get shapes, values, attributes and
 * scratch memory, so tapes and programs share them. The vjp and jvp are written with operations on a tape, so
 * their results can be differentiated again. */
#ifndef LG_OP_H
#define LG_OP_H

#include "core/core.h"
#include "kernels/kernels.h"
#include "kernels/product.h"
#include "liegrad/tape.h"

#define LG_MAX_INPUTS 64 /* limit per operation */

/* The data of an operation besides its inputs. */
typedef struct lg_attr {
    double c;
    uint32_t i[4];
    const void *pointer; /* meaning and type: lg_op.payload */
} lg_attr;

typedef enum lg_payload {
    LG_PAYLOAD_NONE,
    LG_PAYLOAD_REALS,     /* one double per input */
    LG_PAYLOAD_INDICES,   /* i[0] numbers of type uint32_t */
    LG_PAYLOAD_KEPT,      /* the second output, read by vjps, never by forward */
    LG_PAYLOAD_IN_PROCESS /* pointers to the caller's functions; such an operation cannot be in a program */
} lg_payload;

typedef struct lg_op lg_op;

/* One evaluation of an operation. Values on a tape are 64-byte aligned; in a plan they may be unaligned. The
 * output overlaps no input, except as lg_op.over_first allows. The third input of a product may be the
 * output. */
typedef struct lg_evaluation {
    const lg_kernels *k;
    const lg_crew *crew; /* NULL: one thread, no BLAS, no lock */
    const lg_attr *attr;
    uint32_t inputs;
    const lg_shape *const *in; /* shapes of the inputs */
    const void *const *x;      /* their values; NULL where forward does not read the input (lg_op.unread) */
    /* The transpose of input 1 if the caller has it (lg_op.transpose), otherwise NULL. */
    const void *transposed;
    const lg_shape *shape; /* shape of the output */
    size_t count;          /* number of elements of the output */
    void *y;
    /* The second output, lg_op.kept bytes. NULL when no vjp will be called. */
    void *kept;
    void *scratch; /* lg_op.scratch bytes, 64-byte aligned */
} lg_evaluation;

struct lg_reverse;
struct lg_forward;
typedef struct lg_scalars lg_scalars; /* defined in scalars.h */
typedef uint32_t lg_scalar;           /* number of an instruction of scalar code */
struct lg_c;

/* Which rows of the inputs a row of the output depends on. Rows are the elements along the first axis. */
typedef enum lg_row_use {
    LG_ROWS_MEET, /* on several rows, or unknown */
    LG_ROWS_EACH, /* row r depends on row r of every input */
    /* Like LG_ROWS_EACH, but an input of lower rank or with a single row is used by all rows. */
    LG_ROWS_BROADCAST,
    LG_ROWS_FIRST /* row r depends on row r of input 0 and on all rows of the other inputs */
} lg_row_use;

/* A simpler replacement for an operation whose inputs are partly known: no replacement, zeros, or input
 * `input` reshaped to the output's shape. */
typedef struct lg_instead {
    enum { LG_INSTEAD_NOTHING, LG_INSTEAD_ZEROS, LG_INSTEAD_INPUT } kind;
    uint32_t input;
} lg_instead;
typedef struct lg_known {
    const lg_attr *attr;
    uint32_t inputs;
    const lg_shape *const *in, *shape;
    /* Whether input `input` is a constant whose elements all equal `with`. */
    bool (*filled)(void *user, uint32_t input, double with);
    void *user;
} lg_known;

struct lg_op {
    const char *name;    /* unique; model files identify operations by it */
    uint32_t frozen;     /* bit k: differentiation treats input k as a constant */
    uint8_t least, most; /* smallest and largest number of inputs */
    /* Computes the output's shape. The number of inputs has been checked. This function must validate
     * everything else, because forward is never called with bad shapes or attributes. If `given`, *out holds
     * the shape that the caller asks for, and is checked. */
    lg_status (*shape)(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out);
    lg_status (*forward)(lg_evaluation *e); /* NULL for leaves */
    void (*vjp)(struct lg_reverse *r);
    lg_var (*jvp)(const struct lg_forward *f);
    lg_payload payload;
    bool given;
    /* How often the operation's meaning in files has changed. Files store 1 + revision. */
    uint8_t revision;
    /* Bit k of the result: forward does not read input k. NULL: it reads all inputs. */
    uint32_t (*unread)(const lg_attr *attr, uint32_t inputs);
    /* Sizes in bytes. They may depend on shapes, on attributes and on whether `transposed` is there, not on
     * values. NULL: 0 bytes. */
    size_t (*scratch)(const lg_evaluation *e);
    size_t (*kept)(const lg_evaluation *e);
    /* How useful a transpose of input 1 is (of rank 2, or of rank 3 seen as (d0 d1, d2)). NULL: of no use. */
    lg_transpose_use (*transpose)(const lg_evaluation *e);
    /* Whether the output is a contiguous part of input 0, starting at element *offset. NULL: never. */
    bool (*view)(const lg_shape *const *in, const lg_attr *attr, size_t *offset);
    /* Records the operation when the tape may make it a view. NULL: it is recorded with lg_record_shaped. */
    lg_var (*record)(lg_tape *tape, lg_var x, const lg_attr *attr, lg_shape shape);
    /* Bit k: attr->i[k] can be computed from the other data; programs store 0 for it. */
    uint8_t follows;
    /* For elementwise operations (with broadcasting): scalar code of one output element. x[k] is undefined
     * for an input that is not read. A plan may let y overwrite an input of such an operation (see
     * over_first). */
    lg_scalar (*element)(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs);
    /* For other operations whose small tensors are worth writing out: scalar code of all elements y of the
     * output, from all elements x[k] of each input. */
    void (*expand)(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y);
    /* Scalar code is used only up to this number of arithmetic operations; 0 means that there is no such
     * limit. */
    uint32_t most_code;
    /* How an elementwise operation may overwrite an input. False: forward reads element i of every input
     * before it writes element i of y, so y may overwrite any input. True: forward first writes all of y from
     * input 0, so y may overwrite input 0 only, and only if no other input reads the same numbers. */
    bool over_first;
    /* Elementwise, with derivatives computed from the value: their errors are relative to 1, not to their
     * size. */
    bool saturates;
    /* Whether the operation is a product f(other inputs) times its last input. If so, *rest becomes the
     * attributes of f. NULL: never. */
    bool (*factor)(const lg_attr *attr, uint32_t inputs, lg_attr *rest);
    /* How the rows of an output of shape `shape` depend on the inputs' rows. *attr becomes the attributes of
     * the same operation on 1/copies of the rows. NULL: LG_ROWS_BROADCAST if the operation has `element`,
     * else LG_ROWS_MEET. */
    lg_row_use (*rows)(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                       lg_attr *attr);
    /* The simpler replacement that a plan uses. NULL: there never is one. These rules take 0 x as 0 for every
     * x, even if x is infinite or NaN. */
    lg_instead (*instead)(const lg_known *known);
    /* Number of terms in the longest sum of the operation, for error bounds; 0 if it only moves numbers.
     * NULL: 1. */
    size_t (*terms)(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape);
    /* A plan fuses a layer y = sigma(x W + b) into one step if nothing else uses the product. A row whose
     * begins_layer is true for these inputs is the product x W + b. A row with ends_layer that follows it is
     * sigma, with the lg_activation in attr->i[0]. */
    bool (*begins_layer)(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr);
    bool ends_layer;
    bool calls; /* true for lg_op_call only (program/program_call.h), which occurs only in programs */
    /* Writes the evaluation as C (op_c.h), from shapes and attributes, without values. NULL: the C is made
     * from `element`. */
    void (*write_c)(struct lg_c *c, const lg_evaluation *e);
};

/* A planted error, for tests: `by` replaces `row` when derivatives are taken or scalar code is made. */
typedef struct lg_exchange {
    const lg_op *row, *by; /* NULL: no row is replaced */
} lg_exchange;
static inline const lg_op *lg_row_in_use(const lg_exchange *exchange, const lg_op *row) {
    return exchange->row == row ? exchange->by : row;
}

/* The members that every row sets, in this order. A row sets further members by name after the macro. */
#define LG_OP(title, constants, from, to, shape_rule, value, reverse, tangent)                               \
    .name = title, .frozen = constants, .least = from, .most = to, .shape = shape_rule, .forward = value,    \
    .vjp = reverse, .jvp = tangent

lg_row_use lg_rows_each(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                        lg_attr *attr);
lg_row_use lg_rows_first(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                         lg_attr *attr);
/* Row rule of operations along axis attr->i[0]: rows stay apart unless this is axis 0. */
lg_row_use lg_rows_but_axis(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                            uint32_t copies, lg_attr *attr);
size_t lg_no_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape);
static inline lg_instead lg_instead_input(uint32_t input) {
    return (lg_instead){LG_INSTEAD_INPUT, input};
}
static inline lg_instead lg_instead_zeros(void) {
    return (lg_instead){LG_INSTEAD_ZEROS, 0};
}
static inline lg_instead lg_instead_nothing(void) {
    return (lg_instead){LG_INSTEAD_NOTHING, 0};
}

static inline bool lg_same_shape(const lg_shape *a, const lg_shape *b) {
    if (a->rank != b->rank) return false;
    for (uint32_t i = 0; i < a->rank; i++)
        if (a->dims[i] != b->dims[i]) return false;
    return true;
}
/* Splits a shape at an axis: elements before, along and after the axis. */
static inline void lg_around(const lg_shape *shape, uint32_t axis, size_t *outer, size_t *length,
                             size_t *inner) {
    *outer = *inner = 1;
    for (uint32_t i = 0; i < axis; i++) *outer *= shape->dims[i];
    *length = shape->dims[axis];
    for (uint32_t i = axis + 1; i < shape->rank; i++) *inner *= shape->dims[i];
}

#endif
