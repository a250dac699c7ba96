/* The tape inside: nodes, arena, pool, and what vjps and jvps of operations get.
 *
 * The vjp and jvp of an operation (op.h) run in two modes: recorded, where what they build stays on the tape,
 * and unrecorded (lg_backward), where every value comes from the pool and is given back after the node.
 */
#ifndef LG_TAPE_INTERNAL_H
#define LG_TAPE_INTERNAL_H

#include "autodiff/ops/op.h"
#include "core/core.h"
#include "liegrad/ops.h"
#include "liegrad/tape.h"

enum {
    LG_NODE_POOLED = 1,   /* the value is a pool block that the node owns (unrecorded mode only) */
    LG_NODE_VIEW = 2,     /* the value lies inside parent 0's value, attr.i[3] elements in, contiguous */
    LG_NODE_NO_VALUE = 4, /* the value was overwritten by a fused operation; only handles to it remain */
    LG_NODE_ROWS = 8      /* a leaf whose first axis is the rows of a batch: lg_tape_mark_rows */
};

typedef struct lg_node {
    const lg_op *op;
    void *value;
    void *transposed; /* transpose of the value; NULL until asked for. Its owner: see lg_transposed */
    size_t count;
    lg_attr attr;
    lg_shape shape;
    uint32_t generation;
    uint32_t parents; /* offset into lg_tape.parents */
    uint8_t inputs, flags;
} lg_node;

typedef struct lg_chunk {
    unsigned char *base;
    size_t size;
} lg_chunk;

/* Chunked bump arena: addresses stay, rewinding is O(1), chunks are kept. */
typedef struct lg_arena {
    lg_chunk *chunks;
    uint32_t count, capacity, current;
    size_t used; /* in the current chunk */
} lg_arena;

/* Free lists by size class; blocks are carved from the pool's own arena and never returned. */
#define LG_POOL_CLASSES 240
typedef struct lg_pool_memory {
    lg_arena arena;
    void *free[LG_POOL_CLASSES];
} lg_pool_memory;

/* The transpose of a (rows, cols) matrix outside the tape, a pool block. */
typedef struct lg_lasting {
    const void *value;
    void *transposed;
    uint32_t rows, cols;
} lg_lasting;

#define LG_SCOPE_DEPTH 8

struct lg_tape {
    const lg_context *context;
    const lg_kernels *k;
    lg_tape_options options;
    size_t bytes;            /* allocated through the context */
    lg_thread_pool *workers; /* NULL for one thread */

    lg_node *nodes;
    uint32_t count, capacity;
    uint32_t *parents;
    uint32_t parents_count, parents_capacity;
    lg_arena arena;
    lg_pool_memory pool;
    uint32_t *transposed; /* indices of the nodes that own their transpose */
    uint32_t transposed_count, transposed_capacity;
    const unsigned char *constant; /* see lg_tape_constant */
    size_t constant_bytes;
    lg_lasting *lasting;
    uint32_t lasting_count, lasting_capacity;

    uint32_t generation;
    bool unrecorded; /* values come from the pool */

    lg_status status;
    uint32_t failed_at; /* node count when the error struck */
    char message[320];
    const char *scopes[LG_SCOPE_DEPTH];
    int scope_depth;
    uint32_t watch; /* 1 + a node at whose recording the scope is written down; 0: none */
    char watched[160];
    struct lg_calls *calls; /* while a function of a program is recorded (program_call.h), else NULL */
    lg_exchange exchange;   /* of the derivatives of one operation */
};

/* ---- the interface of an operation ---- */

/* One reverse step. out[k] is set to the cotangent of input k, LG_NONE for zero, or left when need[k] is
 * false. */
typedef struct lg_reverse {
    const lg_op *op; /* the row in use */
    lg_tape *tape;
    uint32_t node;
    lg_var y, g;
    const lg_attr *attr; /* a copy: recording may move the nodes */
    const lg_var *in;
    uint32_t inputs;
    const bool *need;
    lg_var *out;
    struct lg_sweep *sweep; /* NULL when recorded */
    bool put_out;           /* no adjoint is to be written in place: whoever calls looks at `out` */
} lg_reverse;

/* One forward step: tangents[k] is LG_NONE when input k does not vary. Returns the output's tangent. */
typedef struct lg_forward {
    const lg_op *op; /* the row in use */
    lg_tape *tape;
    lg_var y;
    const lg_attr *attr;
    const lg_var *in, *tangents;
    uint32_t inputs;
} lg_forward;

/* ---- recording ---- */

/* Validates handles, asks for the shape, allocates, evaluates, records. `attr` may be NULL. */
lg_var lg_record(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr);
/* Records a node whose value is given (a view, a fused result): shape rule and forward are not run. */
lg_var lg_record_value(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr,
                       lg_shape shape, void *value, uint32_t flags);
/* lg_record of an operation that works in place of its first input's value, which becomes its own: the
 * input's node must be the newest, and its value never be read again. Recorded mode only. */
lg_var lg_record_over(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr);
/* For operations whose output's shape is `given`. */
lg_var lg_record_shaped(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs,
                        const lg_attr *attr, lg_shape shape);
/* For what is constant to differentiation. */
void lg_no_vjp(lg_reverse *r);
lg_var lg_zero_jvp(const lg_forward *f);
/* NULL when stale or foreign: the error is then on the tape. */
lg_node *lg_node_of(lg_tape *tape, lg_var v, const char *operation);
/* A valid handle's node without ceremony. */
static inline const lg_node *lg_node_at(const lg_tape *tape, lg_var v) {
    return &tape->nodes[v.index];
}
static inline lg_var lg_var_at(const lg_tape *tape, uint32_t index) {
    lg_var v = {index, tape->nodes[index].generation};
    return v;
}
/* Appends more to a sentence of so many bytes; what has no room is cut. */
void lg_tape_append(char *text, size_t size, const char *more);
/* Appends "(2, 3)". */
void lg_append_shape(char *text, size_t size, const lg_shape *shape);
lg_var lg_fail_shapes(lg_tape *tape, const char *operation, const lg_node *const *in, uint32_t inputs);
/* Memory for a value: from the arena, or from the pool in unrecorded mode. NULL: error set. */
void *lg_value_allocate(lg_tape *tape, size_t count);
/* Payload that lives as long as the nodes recorded now (indices and the like). NULL: error set. */
void *lg_payload_allocate(lg_tape *tape, size_t bytes);
/* Transpose of a node's value of rank 2, or of rank 3 seen as (d0 d1, d2), made once: it lasts as long as the
 * node, or as the memory that has been declared constant. NULL: error set. */
const void *lg_transposed(lg_tape *tape, uint32_t node);
/* Gives back the transposes that nodes from `node` on own. */
void lg_forget_transposes(lg_tape *tape, uint32_t node);
/* The transpose where `use` says that it is of use, else NULL. */
const void *lg_kept_transpose(lg_tape *tape, lg_transpose_use use, uint32_t node);
static inline lg_crew lg_tape_crew(const lg_tape *tape) {
    return (lg_crew){tape->workers, tape->options.threads};
}
/* Promises that all that is done on the tape until the next such call finds these bytes, which lg_parameter
 * points to, as they are now: what is derived from them survives lg_tape_reset. NULL, 0: no promise. */
void lg_tape_constant(lg_tape *tape, const void *memory, size_t bytes);

/* ---- memory ---- */
void *lg_arena_allocate(lg_tape *tape, lg_arena *arena, size_t bytes);
void lg_arena_destroy(lg_tape *tape, lg_arena *arena);
void *lg_pool_take(lg_tape *tape, size_t bytes);
void lg_pool_give(lg_tape *tape, void *block, size_t bytes);
/* Grows a plain array to hold `needed` elements; false: out of memory (error set). */
bool lg_grow(lg_tape *tape, void **array, uint32_t *capacity, uint32_t needed, size_t element);
/* Forgets nodes from `node` on: returns their pool blocks and cached transposes. */
void lg_forget_nodes(lg_tape *tape, uint32_t node);

/* ---- help for vjps ---- */

/* Whether this step may write its inputs' adjoints by itself: nobody records it or looks at
 * `out`, and no two wanted inputs share memory. */
bool lg_reverse_in_place(const lg_reverse *r);
/* Then: memory of input k's adjoint. *add: it holds numbers already and is added to; else it is to be
 * written, all of it. NULL: error set. */
void *lg_reverse_into(lg_reverse *r, uint32_t k, bool *add);
/* Whether something has been added to input k's adjoint already. */
bool lg_reverse_started(const lg_reverse *r, uint32_t k);
/* Where lg_reverse_in_place: cotangents of three inputs at once, by a kernel of the form of mix_reverse; n is
 * handed to it. */
typedef void (*lg_reverse_kernel)(size_t n, const void *const *in, const void *g, void *const *out,
                                  const bool *add);
void lg_reverse_three(lg_reverse *r, lg_reverse_kernel kernel, size_t n);
/* out[k] = product of the variant (0 nn, 1 nt, 2 tn); unrecorded it goes into the adjoint in place. */
void lg_reverse_matmul(lg_reverse *r, uint32_t k, uint32_t variant, lg_var a, lg_var b);
/* [c +] op(a) op(b) into memory, b the value of a node; variant as above. a (m, k) after op, b (k, n) after
 * op.
 */
void lg_gemm(lg_tape *tape, uint32_t variant, size_t m, size_t n, size_t k, const void *a, uint32_t b_node,
             void *c, bool accumulate);

/* lg_backward_set that also tells how large the result is at most: *bound is the norm of all of grad or above
 * it, up to rounding; where it is within the type's range, all numbers on the way to grad and in it are
 * finite. It costs less than to measure the gradient where that is mostly made of products of small factors.
 */
lg_status lg_backward_set_bounded(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad,
                                  double *bound);

/* Says that the first axis of a leaf is the rows of a batch. */
void lg_tape_mark_rows(lg_tape *tape, lg_var leaf);
/* The gradients of each row: y is a sum over `count` rows that do not meet, x a variable and theta a leaf,
 * rank 1, that all rows share. What does not depend on a marked leaf is the same for all rows. grad (elements
 * of x) and gradients (count, elements of theta) are set. Double tapes. Errors also: LG_UNSUPPORTED (rows
 * meet). */
lg_status lg_backward_rows(lg_tape *tape, lg_var y, lg_var x, double *grad, lg_var theta, size_t count,
                           double *gradients);

lg_var lg_zeros_like(lg_tape *tape, lg_var v);
/* Whether a derivative of y by x is anything but zero whatever the numbers; false on failure. */
bool lg_depends_on(lg_tape *tape, lg_var y, lg_var x);
/* a + b where LG_NONE is zero */
static inline lg_var lg_add_or(lg_tape *tape, lg_var a, lg_var b) {
    if (lg_is_none(a)) return b;
    if (lg_is_none(b)) return a;
    return lg_add(tape, a, b);
}
/* Resolves a possibly negative axis; -1 on failure. */
static inline int lg_axis(int axis, uint32_t rank) {
    if (axis < 0) axis += (int)rank;
    return axis >= 0 && axis < (int)rank ? axis : -1;
}
/* The sticky status. `all` says whether the pointers that the operation needs are there: if not,
 * LG_INVALID_ARGUMENT, which sticks. The same for a tape that is NULL. */
lg_status lg_tape_needs(lg_tape *tape, const char *operation, bool all);

#endif
