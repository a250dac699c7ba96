/* The tape: automatic differentiation in reverse and forward mode, to any order. Library liegrad.
 *
 * A function is written as a sequence of operations on variables (define-by-run). Each operation
 * (liegrad/ops.h) computes its value at once and records a node on the tape. The functions for derivatives at
 * the end of this header then differentiate what was recorded.
 *
 *   lg_var x = lg_input_f64(tape, lg_shape1(3), values), y = lg_sum(tape, lg_square(tape, x)), g;
 *   lg_status status = lg_grad(tape, y, &x, 1, &g);        (g = 2 x, shape (3))
 *
 * Variables are handles, plain values of eight bytes; LG_NONE means "no variable". A variable holds a tensor:
 * numbers in row-major order, with up to LG_MAX_RANK axes; the first axis is usually the batch. A scalar has
 * rank 0. All numbers of a tape are of one type, double or float. Pointers to void in this header point to
 * numbers of this type.
 *
 * Errors are kept by the tape. An operation that fails returns LG_NONE, and the tape stores its status and a
 * message with the operation, its shapes and the scope (lg_scope_push). From then on every operation does
 * nothing and returns LG_NONE, and every function that returns a status returns the stored one. So it is
 * enough to ask lg_tape_status after the last operation. lg_tape_rewind to a mark before the failing
 * operation, or lg_tape_reset, clears the error. NaN in a value is not an error of the tape.
 *
 * Only one thread at a time may use a tape. Different tapes are independent.
 */
#ifndef LIEGRAD_TAPE_H
#define LIEGRAD_TAPE_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* ---- activations ----
 *
 * Activation functions of networks. At x = 0 the derivative of LG_RELU is 0, and that of LG_LEAKY_RELU is
 * 0.01. */

typedef enum lg_activation {
    LG_IDENTITY,
    LG_TANH,
    LG_SIGMOID,    /* 1/(1 + exp(-x)) */
    LG_SWISH,      /* x sigmoid(x) */
    LG_RELU,       /* max(x, 0) */
    LG_LEAKY_RELU, /* x for x > 0, else 0.01 x */
    LG_SINE
} lg_activation;
#define LG_ACTIVATION_COUNT 7
/* Returns "identity", "tanh", "sigmoid", "swish", "relu", "leaky-relu" or "sine"; "unknown" for another
 * value. */
LG_API const char *lg_activation_name(lg_activation kind);

/* ---- variables and shapes ---- */

#define LG_MAX_RANK 4

typedef struct lg_tape lg_tape;

/* A variable of a tape. By `generation` the tape recognises handles of nodes that were rewound (always), and
 * handles of other tapes (almost always). */
typedef struct lg_var {
    uint32_t index, generation;
} lg_var;

#define LG_NONE (lg_make_none())
static inline lg_var lg_make_none(void) {
    lg_var none = {0, 0};
    return none;
}
static inline bool lg_is_none(lg_var v) {
    return v.generation == 0;
}

typedef struct lg_shape {
    uint32_t rank; /* 0..LG_MAX_RANK */
    uint32_t dims[LG_MAX_RANK];
} lg_shape;

/* Returns the shape dims[0..rank-1]. */
LG_API lg_shape lg_shape_of(uint32_t rank, const uint32_t *dims);
/* Returns the number of elements, the product of the dimensions: 1 for rank 0, SIZE_MAX on overflow. */
LG_API size_t lg_shape_count(lg_shape shape);
/* Shapes of rank 0 to 4. */
static inline lg_shape lg_shape0(void) {
    lg_shape s = {0, {0, 0, 0, 0}};
    return s;
}
static inline lg_shape lg_shape1(uint32_t a) {
    lg_shape s = {1, {a, 0, 0, 0}};
    return s;
}
static inline lg_shape lg_shape2(uint32_t a, uint32_t b) {
    lg_shape s = {2, {a, b, 0, 0}};
    return s;
}
static inline lg_shape lg_shape3(uint32_t a, uint32_t b, uint32_t c) {
    lg_shape s = {3, {a, b, c, 0}};
    return s;
}
static inline lg_shape lg_shape4(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    lg_shape s = {4, {a, b, c, d}};
    return s;
}

/* ---- creation ---- */

typedef struct lg_tape_options {
    size_t size;    /* sizeof(lg_tape_options) */
    lg_dtype dtype; /* type of all numbers; default LG_F64 */
    /* Threads for large matrix products, 1 to 1024; default 1. The results do not depend on it, not even in
     * the last bit. */
    int threads;
    /* Limit on the memory of the tape in bytes (values, nodes and adjoints); beyond it, operations fail with
     * LG_OUT_OF_MEMORY. Default 0: no limit. */
    size_t max_size;
} lg_tape_options;

LG_API void lg_tape_options_init(lg_tape_options *options);
/* Creates an empty tape. `options` is copied, NULL means the defaults. The context must outlive the tape.
 * Errors: LG_INVALID_ARGUMENT (an option is out of range). */
LG_API lg_status lg_tape_create(const lg_context *context, const lg_tape_options *options, lg_tape **out);
LG_API void lg_tape_destroy(lg_tape *tape);
LG_API lg_dtype lg_tape_dtype(const lg_tape *tape); /* the type of its numbers */

/* Returns the bytes that the tape has allocated. Rewinding keeps memory for the next recording, so this is
 * the most that the tape has needed so far. */
LG_API size_t lg_tape_size(const lg_tape *tape);

/* ---- marks and rewinding ---- */

/* A position on the tape. Members are internal. The mark of an empty tape is valid for every tape. */
typedef struct lg_mark {
    uint32_t nodes, parents, generation;
    uint32_t chunk;
    size_t used;
} lg_mark;
/* Returns the current end of the tape. */
LG_API lg_mark lg_tape_mark(const lg_tape *tape);
/* Removes everything that was recorded after the mark, in constant time. Handles that were made after it
 * become stale: operations refuse them with LG_STALE_HANDLE. Memory is kept, so recording the same operations
 * again allocates nothing. An error that occurred after the mark is cleared. Errors: LG_INVALID_ARGUMENT (the
 * mark lies beyond the end of the tape or belongs to another tape); then nothing changes. */
LG_API lg_status lg_tape_rewind(lg_tape *tape, lg_mark mark);
/* Removes everything from the tape, clears the error, and leaves all scopes. */
LG_API void lg_tape_reset(lg_tape *tape);

/* ---- errors and scopes ---- */

/* Returns the status of the first failure since the last reset or rewind before it; LG_OK without a
 * failure. */
LG_API lg_status lg_tape_status(const lg_tape *tape);
/* Returns the message of this failure, with operation, shapes and scope; "" without a failure. Borrowed from
 * the tape. */
LG_API const char *lg_tape_message(const lg_tape *tape);
/* Makes the tape fail with this status, as if an operation had failed. `operation` is its name and `reason` a
 * sentence, both for the message. Does nothing when the tape has already failed. Returns LG_NONE. */
LG_API lg_var lg_tape_fail(lg_tape *tape, lg_status status, const char *operation, const char *reason);
/* Enters a scope: a name for the part of the function that is recorded next, which messages of failures
 * contain. The tape keeps the pointer `name`, so the text must live until lg_scope_pop. Scopes may be nested;
 * a message joins their names with '/', but shows only the 8 outermost ones. */
LG_API void lg_scope_push(lg_tape *tape, const char *name);
/* Leaves the scope that was entered last. */
LG_API void lg_scope_pop(lg_tape *tape);

/* ---- leaves: variables that no operation computes ----
 *
 * Each function returns LG_NONE when the tape fails: LG_INVALID_ARGUMENT (rank above LG_MAX_RANK, NULL). */

/* Records a tensor and copies its lg_shape_count(shape) numbers from `data`. */
LG_API lg_var lg_input(lg_tape *tape, lg_shape shape, const void *data);
/* The same, but `data` holds doubles, whatever the type of the tape. */
LG_API lg_var lg_input_f64(lg_tape *tape, lg_shape shape, const double *data);
/* Records a tensor whose numbers the caller still has to write: to *values, which points to memory of the
 * tape for lg_shape_count(shape) numbers. They must be written before the variable is used. */
LG_API lg_var lg_input_buffer(lg_tape *tape, lg_shape shape, void **values);
/* Records a tensor whose numbers stay in the caller's memory `data`; nothing is copied. This memory must
 * live, and must not change, until the variable is rewound. Several tapes may use the same memory. Meant for
 * large parameter vectors. */
LG_API lg_var lg_parameter(lg_tape *tape, lg_shape shape, const void *data);
/* Records a tensor whose elements are all `value`. */
LG_API lg_var lg_full(lg_tape *tape, lg_shape shape, double value);

/* ---- values of variables ---- */

/* Returns the shape of a variable; rank 0 for an invalid handle or when the tape has failed. */
LG_API lg_shape lg_var_shape(const lg_tape *tape, lg_var v);
/* Returns the numbers of a variable, borrowed until the variable is rewound; NULL for an invalid handle or
 * when the tape has failed. */
LG_API const void *lg_value(const lg_tape *tape, lg_var v);
/* Copies the `count` numbers of a variable to `out` as doubles. Errors: the status of a tape that has failed,
 * LG_STALE_HANDLE (invalid handle), LG_SHAPE (the variable does not have `count` elements). These errors do
 * not make the tape fail. */
LG_API lg_status lg_read(const lg_tape *tape, lg_var v, size_t count, double *out);

/* ---- derivatives ----
 *
 * "Recorded" derivatives are new variables on the tape, computed by operations. They may be used in further
 * operations and differentiated again. Every failure makes the tape fail and returns its status (or LG_NONE):
 * LG_STALE_HANDLE, LG_SHAPE (a cotangent or tangent has another shape than its variable),
 * LG_NOT_DIFFERENTIABLE (an operation has no derivative of this order). */

/* Recorded reverse mode: out[i] = d sum(y) / d wrt[i], with the shape of wrt[i], for i = 0..n-1. sum(y) is
 * the sum of all elements of y. If y does not depend on wrt[i], out[i] is zero. */
LG_API lg_status lg_grad(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, lg_var *out);
/* Recorded vector-Jacobian products: out[i] = sum_j (d y[j] / d wrt[i])^T cotangent[j], with the shape of
 * wrt[i], for i = 0..n-1. j = 0..ny-1; cotangent[j] has the shape of y[j]. */
LG_API lg_status lg_vjp(lg_tape *tape, const lg_var *y, const lg_var *cotangent, size_t ny, const lg_var *wrt,
                        size_t n, lg_var *out);
/* Recorded forward mode: out[j] = sum_i (d y[j] / d x[i]) tangent[i], with the shape of y[j], for j =
 * 0..ny-1. i = 0..nx-1; tangent[i] has the shape of x[i]. If y[j] depends on no x[i], out[j] is zero. */
LG_API lg_status lg_jvp(lg_tape *tape, const lg_var *y, size_t ny, const lg_var *x, const lg_var *tangent,
                        size_t nx, lg_var *out);
/* Reverse mode without recording, for the last derivative of a training step: adds d sum(y) / d wrt[i] to the
 * caller's array grad[i], which has as many numbers of the tape's type as wrt[i]. Temporary values are
 * released during the pass; afterwards the tape is as it was before. On failure grad[i] may hold anything,
 * and the tape has failed. Further errors: LG_INVALID_ARGUMENT (a variable stands twice in `wrt`, or a
 * grad[i] is NULL), LG_UNSUPPORTED (it is called by the vjp of a custom operation while lg_backward runs). */
LG_API lg_status lg_backward(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad);
/* The same, but it overwrites the arrays: grad[i] = d sum(y) / d wrt[i]. Use it for the first pass of a step,
 * or the only one: then a large gradient need not be set to zero beforehand. */
LG_API lg_status lg_backward_set(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad);

/* Recorded Jacobian, of shape (count(y), count(x)): J[a, b] = d y_a / d x_b, where y and x are taken as flat
 * vectors. It takes one reverse pass per element of y if y has at most as many elements as x, otherwise one
 * forward pass per element of x. */
LG_API lg_var lg_jacobian(lg_tape *tape, lg_var y, lg_var x);
/* Recorded product of the Hessian of sum(y) by x with a vector v of the shape of x. It is computed forward
 * over reverse: the gradient by lg_grad, then its derivative in the direction v by lg_jvp. */
LG_API lg_var lg_hvp(lg_tape *tape, lg_var y, lg_var x, lg_var v);

LG_END_DECLS

#endif
