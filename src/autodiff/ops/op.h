/* An operation: one row of the table (op_table.h). Its shape rule, forward, vjp, jvp and C stand together.
 *
 * Shape rule and forward know neither tape nor program: they get shapes, values, attributes and scratch
 * memory, and serve both. The vjp and jvp are written with operations on a tape, so they can be
 * differentiated again.
 */
#ifndef LG_OP_H
#define LG_OP_H

#include "core/core.h"
#include "kernels/kernels.h"
#include "kernels/product.h"
#include "liegrad/tape.h"

#define LG_MAX_INPUTS 64 /* of one operation */

/* What an operation remembers besides its inputs. */
typedef struct lg_attr {
    double c;
    uint32_t i[4];
    const void *pointer; /* what lg_op.payload says */
} lg_attr;

typedef enum lg_payload {
    LG_PAYLOAD_NONE,
    LG_PAYLOAD_REALS,     /* a double for each input */
    LG_PAYLOAD_INDICES,   /* i[0] numbers of type uint32_t */
    LG_PAYLOAD_KEPT,      /* the second output, for vjps; never read by forward */
    LG_PAYLOAD_IN_PROCESS /* functions of the caller's: cannot be in a program */
} lg_payload;

typedef struct lg_op lg_op;

/* One evaluation. Values are 64-byte aligned on a tape and in a program's work memory, elsewhere they need
 * not be; the output overlaps no input, but see lg_op.over_first. */
typedef struct lg_evaluation {
    const lg_kernels *k;
    const lg_crew *crew; /* NULL: one thread, no BLAS, no lock */
    const lg_attr *attr;
    uint32_t inputs;
    const lg_shape *const *in; /* shapes of the inputs */
    const void *const *x;      /* their values; NULL where forward does not read them (lg_op.unread) */
    const void *transposed;    /* of input 1, where whoever evaluates has it (lg_op.transpose); else NULL */
    const lg_shape *shape;     /* of the output */
    size_t count;              /* its elements */
    void *y;
    void *kept;    /* second output, `kept` bytes; NULL: nobody will ask for a vjp */
    void *scratch; /* `scratch` bytes, 64-byte aligned */
} lg_evaluation;

struct lg_reverse;
struct lg_forward;
typedef struct lg_scalars lg_scalars; /* scalars.h */
typedef uint32_t lg_scalar;           /* an instruction of scalar code */
struct lg_c;

/* How the rows of the output, elements along its first axis, come about. */
typedef enum lg_row_use {
    LG_ROWS_MEET,      /* rows meet, or it is not known */
    LG_ROWS_EACH,      /* row r of row r of every input */
    LG_ROWS_BROADCAST, /* likewise; an input of lower rank, or with one row, serves all rows */
    LG_ROWS_FIRST      /* row r of row r of input 0 and of all of the others */
} lg_row_use;

/* What an operation is instead, where inputs are known: nothing else, zeros, or input `input` in the output's
 * shape. */
typedef struct lg_instead {
    enum { LG_INSTEAD_NOTHING, LG_INSTEAD_ZEROS, LG_INSTEAD_INPUT } kind;
    uint32_t input;
} lg_instead;
typedef struct lg_known {
    const lg_attr *attr;
    uint32_t inputs;
    const lg_shape *const *in, *shape;
    bool (*filled)(void *user, uint32_t input, double with); /* a constant, all of it this number */
    void *user;
} lg_known;

struct lg_op {
    const char *name;    /* unique: files know an operation by it */
    uint32_t frozen;     /* bit k: input k is a constant to differentiation */
    uint8_t least, most; /* inputs */
    /* The output's shape from inputs of the right number. Must validate everything: forward cannot see bad
     * shapes or attributes. Where `given`, *out holds the shape that is asked for and is checked. */
    lg_status (*shape)(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out);
    lg_status (*forward)(lg_evaluation *e); /* NULL: leaves */
    void (*vjp)(struct lg_reverse *r);
    lg_var (*jvp)(const struct lg_forward *f);
    lg_payload payload;
    bool given;
    uint8_t revision; /* how often its meaning in files has changed: they say 1 + revision */
    /* Bit k: forward does not read input k. NULL: it reads all. */
    uint32_t (*unread)(const lg_attr *attr, uint32_t inputs);
    /* Bytes; they see shapes, attributes and whether `transposed` is there, no values. NULL: none. */
    size_t (*scratch)(const lg_evaluation *e);
    size_t (*kept)(const lg_evaluation *e);
    /* What a transpose of input 1 (rank 2; rank 3 as (d0 d1, d2)) is worth. NULL: nothing. */
    lg_transpose_use (*transpose)(const lg_evaluation *e);
    /* Whether the output is a contiguous part of input 0, from element *offset on. NULL: never. */
    bool (*view)(const lg_shape *const *in, const lg_attr *attr, size_t *offset);
    /* Records it where the tape may make a view. NULL: lg_record_shaped does. */
    lg_var (*record)(lg_tape *tape, lg_var x, const lg_attr *attr, lg_shape shape);
    uint8_t follows; /* bit k: attr->i[k] follows from the rest, and is 0 in programs */
    /* Scalar code of one element, for elementwise operations (broadcasting); x[k] of an input that is not
     * read is no instruction. Plans may then put y over an input (over_first). */
    lg_scalar (*element)(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs);
    /* Scalar code of all elements y of the output from all elements x[k] of the inputs; for others whose
     * small tensors are worth writing out. */
    void (*expand)(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y);
    uint32_t most_code; /* scalar code serves up to so many operations on numbers; 0: for any */
    /* Elementwise: forward reads element i of the inputs before it writes element i of y, so that y may
     * lie over an input; over_first: it writes all of y from input 0 first, so that y may lie over input 0
     * alone, and only if no other input reads the same numbers. */
    bool over_first;
    bool saturates; /* elementwise; derivatives are made of the value: their errors are relative to 1 */
    /* The input that multiplies what the others give, the last one; *rest becomes the attributes of the
     * operation without it. False: there is none. NULL: never. */
    bool (*factor)(const lg_attr *attr, uint32_t inputs, lg_attr *rest);
    /* For the rows of `shape`; attr becomes that of 1/copies of them. NULL: BROADCAST where there is
     * `element`, else MEET. */
    lg_row_use (*rows)(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                       lg_attr *attr);
    /* NULL: nothing ever. 0 x is 0 for every x. */
    lg_instead (*instead)(const lg_known *known);
    /* Terms of its longest sum, for error bounds; 0: numbers are moved only. NULL: 1. */
    size_t (*terms)(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape);
    /* A plan fuses y = sigma(x W + b), a layer, into one step if nothing else uses the product. The first
     * row, for whose inputs begins_layer is true, is the product; the row after it, with ends_layer, is
     * sigma, an lg_activation in attr->i[0]. */
    bool (*begins_layer)(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr);
    bool ends_layer;
    bool calls; /* lg_op_call (program/program_call.h), which only programs have */
    /* The evaluation as C (op_c.h); it sees shapes and attributes, no values. NULL: as `element` says. */
    void (*write_c)(struct lg_c *c, const lg_evaluation *e);
};

/* For planted errors: `by` replaces `row` when derivatives are taken or scalar code is made. */
typedef struct lg_exchange {
    const lg_op *row, *by; /* NULL: no row is exchanged */
} lg_exchange;
static inline const lg_op *lg_row_in_use(const lg_exchange *exchange, const lg_op *row) {
    return exchange->row == row ? exchange->by : row;
}

/* What every row has, in this order; the rest by name. */
#define LG_OP(title, constants, from, to, shape_rule, value, reverse, tangent)                               \
    .name = title, .frozen = constants, .least = from, .most = to, .shape = shape_rule, .forward = value,    \
    .vjp = reverse, .jvp = tangent

lg_row_use lg_rows_each(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                        lg_attr *attr);
lg_row_use lg_rows_first(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                         lg_attr *attr);
/* For operations along axis attr->i[0]. */
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
/* Shape (outer, length, inner) around an axis. */
static inline void lg_around(const lg_shape *shape, uint32_t axis, size_t *outer, size_t *length,
                             size_t *inner) {
    *outer = *inner = 1;
    for (uint32_t i = 0; i < axis; i++) *outer *= shape->dims[i];
    *length = shape->dims[axis];
    for (uint32_t i = axis + 1; i < shape->rank; i++) *inner *= shape->dims[i];
}

#endif
