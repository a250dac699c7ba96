/* Internals of the tape: nodes, arena, pool, and the interface that vjps and jvps of operations use.
 *
 * The vjp and jvp of an operation (op.h) run in two modes. In recorded mode the nodes they build stay on the
 * tape. In unrecorded mode (lg_backward) every value they compute comes from the pool and is returned to it
 * after the node. */
#ifndef LG_TAPE_INTERNAL_H
#define LG_TAPE_INTERNAL_H

#include "autodiff/ops/op.h"
#include "core/core.h"
#include "liegrad/ops.h"
#include "liegrad/tape.h"

enum {
    LG_NODE_POOLED = 1, /* the value is a pool block that the node owns (unrecorded mode only) */
    /* The value lies inside parent 0's value, contiguous, starting at element attr.i[3]. */
    LG_NODE_VIEW = 2,
    LG_NODE_NO_VALUE = 4, /* a fused operation has overwritten the value; the node remains only for handles */
    LG_NODE_ROWS = 8,     /* a leaf whose first axis counts the rows of a batch: lg_tape_mark_rows */
    LG_NODE_FULL = 16,    /* a leaf whose elements are all the same constant: lg_full */
    LG_NODE_GIVEN = 32    /* a leaf in the caller's memory: lg_parameter */
};

typedef struct lg_node {
    const lg_op *op;
    void *value;
    void *transposed; /* transpose of the value, NULL until needed; lg_transposed says who owns it */
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

/* Bump arena made of chunks: addresses never change, rewinding is O(1), and chunks are kept for reuse. */
typedef struct lg_arena {
    lg_chunk *chunks;
    uint32_t count, capacity, current;
    size_t used; /* bytes used of the current chunk */
} lg_arena;

/* One list of free blocks per size class. Blocks are cut from the pool's arena and are never returned to
 * it. */
#define LG_POOL_CLASSES 240
typedef struct lg_pool_memory {
    lg_arena arena;
    void *free[LG_POOL_CLASSES];
} lg_pool_memory;

/* The transpose of a constant (rows, cols) matrix that lies outside the tape (lg_tape_constant); it is stored
 * in a pool block. */
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
    size_t bytes;            /* total allocated through the context */
    lg_thread_pool *workers; /* NULL when the tape uses one thread */

    lg_node *nodes;
    uint32_t count, capacity;
    uint32_t *parents;
    uint32_t parents_count, parents_capacity;
    lg_arena arena;
    lg_pool_memory pool;
    uint32_t *transposed; /* indices of the nodes that own their transpose */
    uint32_t transposed_count, transposed_capacity;
    uint32_t transposed_end;       /* the largest of these indices, plus 1 */
    const unsigned char *constant; /* memory declared constant by lg_tape_constant */
    size_t constant_bytes;
    lg_lasting *lasting;
    uint32_t lasting_count, lasting_capacity;

    uint32_t generation;
    bool unrecorded; /* unrecorded mode: values come from the pool */
    /* Operations are recorded, but not computed: only leaves have values (lg_tape_set_dry). */
    bool dry;
    /* lg_tape_repeat: number of nodes of the recording that the caller repeats, or 0. end_chunk and end_used
     * say where the recording's memory ends in the arena. */
    uint32_t repeated, end_chunk;
    size_t end_used;

    lg_status status;
    uint32_t failed_at; /* number of nodes when the error occurred */
    char message[320];
    const char *scopes[LG_SCOPE_DEPTH];
    int scope_depth;
    /* 1 + index of a node; when this node is recorded, the scope is copied to `watched`. 0: no node is
     * watched. */
    uint32_t watch;
    char watched[160];
    /* Set while a function of a program is recorded (program_call.h), otherwise NULL. */
    struct lg_calls *calls;
    /* What users of the tape keep from one recording to the next; NULL, or released with the tape. */
    void *kept;
    void (*release)(void *kept);
    /* The planted error: replaces the derivatives of one operation (lg_exchange). */
    lg_exchange exchange;
};

/* ---- the interface of an operation ---- */

/* One reverse step: the argument of a vjp. It must set out[k] to the cotangent of input k, or to LG_NONE for
 * zero, for every k with need[k]; it may leave the others. */
typedef struct lg_reverse {
    const lg_op *op; /* the row of the table in use; see lg_row_in_use */
    lg_tape *tape;
    uint32_t node;
    lg_var y, g;
    const lg_attr *attr; /* a copy, because recording may move the nodes */
    const lg_var *in;
    uint32_t inputs;
    const bool *need;
    lg_var *out;
    struct lg_sweep *sweep; /* NULL in recorded mode */
    /* The cotangents must be returned in `out`, not written in place (lg_reverse_in_place returns false). */
    bool put_out;
} lg_reverse;

/* One forward step: the argument of a jvp, which returns the output's tangent. tangents[k] is LG_NONE when
 * input k does not vary. */
typedef struct lg_forward {
    const lg_op *op; /* the row of the table in use; see lg_row_in_use */
    lg_tape *tape;
    lg_var y;
    const lg_attr *attr;
    const lg_var *in, *tangents;
    uint32_t inputs;
} lg_forward;

/* ---- recording ---- */

/* Checks the handles, computes the shape, allocates and evaluates the output, and records the node. `attr`
 * may be NULL. */
lg_var lg_record(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr);
/* Records a node whose value already exists (a view, a fused result), without running the shape rule or
 * forward. */
lg_var lg_record_value(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr,
                       lg_shape shape, void *value, uint32_t flags);
/* Like lg_record, for operations whose output shape is chosen by the caller (lg_op.given). */
lg_var lg_record_shaped(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs,
                        const lg_attr *attr, lg_shape shape);
/* Makes an empty tape dry for the rest of its life: it records operations, but does not compute them. lg_read
 * then returns LG_UNSUPPORTED, and lg_value returns NULL. */
void lg_tape_set_dry(lg_tape *tape);
/* Goes back to the first node of a dry tape and keeps the recording. The caller then records the same
 * operations again, with the same attributes, indices and constants (lg_full). The new values of leaves go to
 * the memory of the old values; a leaf of lg_parameter that lg_plan_of_tape has not moved may name other
 * memory. Any other call fails with LG_UNSUPPORTED; the caller may then call lg_tape_repeat again.
 * lg_tape_reset ends the repetition. */
void lg_tape_repeat(lg_tape *tape);
/* Returns the memory of the next leaf of the repeated recording, or NULL with the tape's error set. */
void *lg_repeated_leaf(lg_tape *tape, const lg_shape *shape);
/* The vjp and jvp of operations that differentiation treats as constants. */
void lg_no_vjp(lg_reverse *r);
lg_var lg_zero_jvp(const lg_forward *f);
/* Of an operation that is linear in each input that is not frozen: the sum over these inputs of the operation
 * with the input replaced by its tangent. */
lg_var lg_multilinear_jvp(const lg_forward *f);
/* NULL if the handle is stale or belongs to another tape, or the tape has failed; the tape's error is set. */
lg_node *lg_node_of(lg_tape *tape, lg_var v, const char *operation);
/* The node of a handle that is known to be valid; nothing is checked. */
static inline const lg_node *lg_node_at(const lg_tape *tape, lg_var v) {
    return &tape->nodes[v.index];
}
static inline lg_var lg_var_at(const lg_tape *tape, uint32_t index) {
    lg_var v = {index, tape->nodes[index].generation};
    return v;
}
/* Appends `more` to the string `text` in a buffer of `size` bytes. Text that does not fit is cut off. */
void lg_tape_append(char *text, size_t size, const char *more);
/* Appends a shape in the form "(2, 3)". */
void lg_append_shape(char *text, size_t size, const lg_shape *shape);
lg_var lg_fail_shapes(lg_tape *tape, const char *operation, const lg_node *const *in, uint32_t inputs);
/* Memory for a value of `count` elements: from the arena in recorded mode, from the pool in unrecorded mode.
 * NULL: error set. */
void *lg_value_allocate(lg_tape *tape, size_t count);
/* Memory for extra data of a node, such as indices. It lives as long as the nodes that are recorded now.
 * NULL: error set. */
void *lg_payload_allocate(lg_tape *tape, size_t bytes);
/* The transpose of a node's value of rank 2, or of rank 3 seen as (d0 d1, d2). It is computed once. It lives
 * as long as the node, or, if the value lies in memory declared constant (lg_tape_constant), until that
 * declaration is replaced. NULL: error set. */
const void *lg_transposed(lg_tape *tape, uint32_t node);
/* Returns the transposes owned by nodes `node` and later to the pool. */
void lg_forget_transposes(lg_tape *tape, uint32_t node);
/* The transpose of a node's value if `use` says that it pays off, otherwise NULL. */
const void *lg_kept_transpose(lg_tape *tape, lg_transpose_use use, uint32_t node);
static inline lg_crew lg_tape_crew(const lg_tape *tape) {
    return (lg_crew){tape->workers, tape->options.threads};
}
/* Promises that these bytes, which lg_parameter points to, keep their present values during everything done
 * on the tape until the next call of this function. Data derived from them, such as transposes, then survives
 * lg_tape_reset. NULL, 0: no promise. */
void lg_tape_constant(lg_tape *tape, const void *memory, size_t bytes);

/* ---- memory ---- */
void *lg_arena_allocate(lg_tape *tape, lg_arena *arena, size_t bytes);
void lg_arena_destroy(lg_tape *tape, lg_arena *arena);
void *lg_pool_take(lg_tape *tape, size_t bytes);
void lg_pool_give(lg_tape *tape, void *block, size_t bytes);
/* Makes an array hold at least `needed` elements of `element` bytes. False: out of memory, error set. */
bool lg_grow(lg_tape *tape, void **array, uint32_t *capacity, uint32_t needed, size_t element);
/* Drops the nodes from `node` on and returns their cached transposes to the pool. */
void lg_forget_nodes(lg_tape *tape, uint32_t node);

/* ---- helpers for vjps ---- */

/* Whether this step may write into its inputs' adjoints directly. That requires unrecorded mode, a caller
 * that does not need `out`, and wanted inputs that do not share memory. */
bool lg_reverse_in_place(const lg_reverse *r);
/* Only if lg_reverse_in_place: the memory of input k's adjoint. If *add is true it already holds numbers, and
 * the vjp must add to them; otherwise the vjp must write every element. NULL: error set. */
void *lg_reverse_into(lg_reverse *r, uint32_t k, bool *add);
/* Only if lg_reverse_in_place: computes the cotangents of three inputs at once with a kernel that has the
 * signature of mix_reverse; `n` is passed on to the kernel. */
typedef void (*lg_reverse_kernel)(size_t n, const void *const *in, const void *g, void *const *out,
                                  const bool *add);
void lg_reverse_three(lg_reverse *r, lg_reverse_kernel kernel, size_t n);
/* out[k] = op(a) op(b), with variant 0 for a b, 1 for a b^T and 2 for a^T b. In unrecorded mode the product
 * is added directly to the adjoint. */
void lg_reverse_matmul(lg_reverse *r, uint32_t k, uint32_t variant, lg_var a, lg_var b);
/* c = [c +] op(a) op(b), where b is the value of node b_node, and `variant` is as above. op(a) is (m, k),
 * op(b) is (k, n). The term in brackets applies if `accumulate`. */
void lg_gemm(lg_tape *tape, uint32_t variant, size_t m, size_t n, size_t k, const void *a, uint32_t b_node,
             void *c, bool accumulate);

/* Like lg_backward_set, and also sets *bound to an upper bound, up to rounding, on the norm of all of grad
 * together. If *bound is within the type's range, then every number in grad and every intermediate number of
 * the sums that form it is finite. The bound costs less than the norm itself where the gradient consists
 * mostly of products of small factors. */
lg_status lg_backward_set_bounded(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad,
                                  double *bound);

/* Declares that the first axis of a leaf counts the rows of a batch. */
void lg_tape_mark_rows(lg_tape *tape, lg_var leaf);
/* Computes the gradient of each row separately. y must be a sum over `count` rows that do not interact; x is
 * a variable; theta is a leaf of rank 1 that all rows share. Nodes that do not depend on a marked leaf
 * (lg_tape_mark_rows) are the same for all rows. Sets grad, the gradient of y with respect to x, and
 * gradients (count, elements of theta). For tapes of type double only. Errors also: LG_UNSUPPORTED when rows
 * interact. */
lg_status lg_backward_rows(lg_tape *tape, lg_var y, lg_var x, double *grad, lg_var theta, size_t count,
                           double *gradients);

lg_var lg_zeros_like(lg_tape *tape, lg_var v);
/* Whether y depends on x through inputs that pass on derivatives (lg_op.frozen marks the others). If not, the
 * derivative is zero for all values. Also returns false on failure. */
bool lg_depends_on(lg_tape *tape, lg_var y, lg_var x);
/* a + b, where LG_NONE stands for zero. */
static inline lg_var lg_add_or(lg_tape *tape, lg_var a, lg_var b) {
    if (lg_is_none(a)) return b;
    if (lg_is_none(b)) return a;
    return lg_add(tape, a, b);
}
/* Converts a negative axis, which counts from the end, to 0..rank-1. Returns -1 for an invalid axis. */
static inline int lg_axis(int axis, uint32_t rank) {
    if (axis < 0) axis += (int)rank;
    return axis >= 0 && axis < (int)rank ? axis : -1;
}
/* Returns the tape's sticky status. `all` says whether all pointers that the operation needs are non-NULL; if
 * it is false, the tape fails with LG_INVALID_ARGUMENT. A NULL tape also gives LG_INVALID_ARGUMENT. */
lg_status lg_tape_needs(lg_tape *tape, const char *operation, bool all);
/* Returns `status`. Unless it is LG_OK, writes a sentence: the sentence of the tape if the tape (may be NULL)
 * has failed, otherwise the sentence of the status. */
lg_status lg_tape_conclude(const lg_tape *tape, lg_status status, lg_error *error);

#endif
