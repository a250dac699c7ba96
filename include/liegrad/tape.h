/* The tape: define-by-run reverse and forward differentiation to any order.
 *
 * An operation (liegrad/ops.h) evaluates at once and records a node. Handles are plain values of eight bytes;
 * LG_NONE is "no variable". Tensors are row-major with up to LG_MAX_RANK axes, the batch first; a scalar has
 * rank 0. A tape has one element type; all data of a double tape is double, of a float tape float.
 *
 * Errors stick to the tape. A failing operation returns LG_NONE and the first error keeps the operation, its
 * shapes and the caller's scope; later operations do nothing and return LG_NONE; functions that return a
 * status return the sticky one. Rewinding to before the failing operation, or lg_tape_reset, clears it. NaN
 * is not a tape error.
 *
 * A tape is used by one thread at a time. Different tapes are independent.
 */
#ifndef LIEGRAD_TAPE_H
#define LIEGRAD_TAPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* ---- activations ----
 *
 * Activations of networks. Kinks at 0 belong to the branch of x < 0. LeakyReLU's slope is 0.01. */

typedef enum lg_activation {
    LG_IDENTITY,
    LG_TANH,
    LG_SIGMOID,
    LG_SWISH, /* x sigmoid(x) */
    LG_RELU,
    LG_LEAKY_RELU,
    LG_SINE
} lg_activation;
#define LG_ACTIVATION_COUNT 7
LG_API const char *lg_activation_name(lg_activation kind);

#define LG_MAX_RANK 4

typedef struct lg_tape lg_tape;

/* A variable of a tape. `generation` makes handles of rewound nodes and of other tapes recognisable. */
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

LG_API lg_shape lg_shape_of(uint32_t rank, const uint32_t *dims);
LG_API size_t lg_shape_count(lg_shape shape); /* number of elements; 1 for rank 0; SIZE_MAX on overflow */
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

typedef struct lg_tape_options {
    size_t size;     /* sizeof(lg_tape_options) */
    lg_dtype dtype;  /* LG_F64 */
    int threads;     /* 1, 1..1024: large products are split over so many; the bits do not depend on it */
    size_t max_size; /* 0: no limit; else LG_OUT_OF_MEMORY when values, nodes and adjoints would exceed it */
} lg_tape_options;

LG_API void lg_tape_options_init(lg_tape_options *options);
/* `options` may be NULL for the defaults. The context must outlive the tape. Errors: LG_INVALID_ARGUMENT,
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_tape_create(const lg_context *context, const lg_tape_options *options, lg_tape **out);
LG_API void lg_tape_destroy(lg_tape *tape); /* NULL is fine */
LG_API lg_dtype lg_tape_dtype(const lg_tape *tape);

/* Bytes held (high-water mark: memory is kept for the next step). */
LG_API size_t lg_tape_size(const lg_tape *tape);

/* A position on the tape. Rewinding drops everything recorded after the mark in O(1), and handles made after
 * it become stale. Memory is kept, so a repeated step allocates nothing. Errors: LG_INVALID_ARGUMENT for a
 * mark that lies ahead of the tape or belongs to another tape; nothing changes then. The mark of an empty
 * tape fits any tape. */
typedef struct lg_mark {
    uint32_t nodes, parents, generation;
    uint32_t chunk;
    size_t used;
} lg_mark;
LG_API lg_mark lg_tape_mark(const lg_tape *tape);
LG_API lg_status lg_tape_rewind(lg_tape *tape, lg_mark mark);
LG_API void lg_tape_reset(lg_tape *tape); /* rewind to empty, clear the error */

/* The sticky error. lg_tape_message is a sentence with operation, shapes and scope; "" without an error. */
LG_API lg_status lg_tape_status(const lg_tape *tape);
LG_API const char *lg_tape_message(const lg_tape *tape);
/* Reports the caller's own failure, with an operation name and a reason. It is ignored when the tape already
 * has an error. Returns LG_NONE. */
LG_API lg_var lg_tape_fail(lg_tape *tape, lg_status status, const char *operation, const char *reason);
/* Names what is being built, for messages; `name` is kept by pointer and must live until popped. Nested
 * scopes are joined with '/'; deeper than 8 are counted but not printed. */
LG_API void lg_scope_push(lg_tape *tape, const char *name);
LG_API void lg_scope_pop(lg_tape *tape);

/* ---- leaves ---- */

/* A tensor whose `count(shape)` values are copied from `data` (elements of the tape's type). */
LG_API lg_var lg_input(lg_tape *tape, lg_shape shape, const void *data);
/* The same from doubles, on a tape of either type. */
LG_API lg_var lg_input_f64(lg_tape *tape, lg_shape shape, const double *data);
/* A tensor whose values the caller writes to *values (count(shape) elements of the tape's type) before using
 * it. */
LG_API lg_var lg_input_buffer(lg_tape *tape, lg_shape shape, void **values);
/* A tensor that refers to the caller's memory without copying; it must stay unchanged and alive until
 * rewound. Many tapes may share it. This is how a flat parameter vector comes on a tape. */
LG_API lg_var lg_parameter(lg_tape *tape, lg_shape shape, const void *data);
/* A tensor filled with a value. */
LG_API lg_var lg_full(lg_tape *tape, lg_shape shape, double value);

/* ---- readers ---- */

LG_API lg_shape lg_var_shape(const lg_tape *tape, lg_var v); /* rank 0 for an invalid handle */
/* Borrowed, valid until rewound; NULL for an invalid handle or an erroneous tape. */
LG_API const void *lg_value(const lg_tape *tape, lg_var v);
/* Copies to doubles. Errors: the sticky status, LG_STALE_HANDLE, LG_SHAPE when count differs. */
LG_API lg_status lg_read(const lg_tape *tape, lg_var v, size_t count, double *out);

/* ---- derivatives ---- */

/* Recorded reverse mode: out[i] = d sum(y) / d wrt[i], of wrt[i]'s shape, as new variables that may be
 * differentiated again. A wrt on which y does not depend gets zeros. */
LG_API lg_status lg_grad(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, lg_var *out);
/* Recorded vector-Jacobian products: out[i] = sum_j (d y[j] / d wrt[i])^T cotangent[j]. */
LG_API lg_status lg_vjp(lg_tape *tape, const lg_var *y, const lg_var *cotangent, size_t ny, const lg_var *wrt,
                        size_t n, lg_var *out);
/* Recorded forward mode: out[j] = sum_i (d y[j] / d x[i]) tangent[i]. A y that depends on no x gets zeros. */
LG_API lg_status lg_jvp(lg_tape *tape, const lg_var *y, size_t ny, const lg_var *x, const lg_var *tangent,
                        size_t nx, lg_var *out);
/* Unrecorded reverse mode, the last pass of a training step: adds d sum(y) / d wrt[i] to the caller's grad[i]
 * (elements of the tape's type, count of wrt[i]). Temporaries are freed during the pass, and the tape is left
 * as before. On failure the contents of grad are unspecified and the error sticks. Errors:
 * LG_INVALID_ARGUMENT (a variable twice in wrt, a grad[i] that is NULL), LG_UNSUPPORTED (called by a custom
 * operation's vjp while it runs). */
LG_API lg_status lg_backward(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad);
/* The same, but it overwrites: grad[i] = d sum(y) / d wrt[i]. Use it for the first or only pass of a step: a
 * large gradient is then neither cleared beforehand nor read while it is formed. */
LG_API lg_status lg_backward_set(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad);

/* Recorded Jacobian of the flattened y by the flattened x: J[a, b] = d y_a / d x_b, shape (count(y),
 * count(x)). It takes one reverse pass for each element of y when y has fewer elements than x, otherwise one
 * forward pass for each element of x. */
LG_API lg_var lg_jacobian(lg_tape *tape, lg_var y, lg_var x);
/* Recorded Hessian-vector product of sum(y): d/dx <grad y, v>, forward over reverse. */
LG_API lg_var lg_hvp(lg_tape *tape, lg_var y, lg_var x, lg_var v);

LG_END_DECLS

#endif
