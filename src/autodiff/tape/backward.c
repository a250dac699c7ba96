/* The unrecorded reverse sweep: every intermediate value comes from the pool and is returned to it once its
 * node is done.
 *
 * The sweep keeps one block of memory, the adjoint, for each node that has received a contribution. The first
 * contribution to a node may be a temporary of a vjp; then its memory is taken over as the block. Later
 * contributions are added. A block goes back to the pool when its node is done. A view (reshape, contiguous
 * slice) has no block: its adjoint lies inside its parent's adjoint, so a weight's gradient is accumulated
 * directly in the caller's flat gradient. The sweep knows which parts of the caller's memory already hold
 * numbers; the first contribution to any other part overwrites it, so that part is neither read nor cleared
 * beforehand.
 *
 * On request the sweep bounds the norm of what it leaves in the caller's memory. It uses the triangle
 * inequality over the contributions: for a product |A B| <= |A| |B| (Frobenius norms) where this is less work
 * than measuring the product. Every other contribution is measured while it is still in the cache. */
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/rows.h"
#include "autodiff/tape/sweep.h"

#include <math.h>
#include <string.h>

/* REACHED: the node depends on a wanted variable. ASKED: it is a wanted variable itself. */
enum { REACHED = 1, ASKED = 2 };

/* ---- the caller's memory ---- */

typedef struct span {
    size_t begin, end;
} span;

/* A gradient buffer of the caller. `span` lists the byte ranges that already hold numbers, sorted and
 * disjoint. */
enum { SPANS = 16 };
typedef struct target {
    unsigned char *base;
    size_t bytes;
    uint32_t spans;
    span span[SPANS];
} target;

/* Writes zeros to those bytes of begin..end that the spans first..after-1 do not cover. */
static void clear(target *t, uint32_t first, uint32_t after, size_t begin, size_t end) {
    size_t at = begin;
    for (uint32_t i = first; i < after; i++) {
        if (t->span[i].begin > at) memset(t->base + at, 0, t->span[i].begin - at);
        if (t->span[i].end > at) at = t->span[i].end;
    }
    if (at < end) memset(t->base + at, 0, end - at);
}

static void clear_rest(target *t) {
    clear(t, 0, t->spans, 0, t->bytes);
    t->spans = 1;
    t->span[0] = (span){0, t->bytes};
}

/* Called before a contribution is added to the bytes begin..end. Returns true when none of them holds numbers
 * yet: the caller must then overwrite the whole range. Otherwise the bytes that held no numbers have been set
 * to zero, and the caller must add. Either way the range counts as filled from now on. */
static bool first_touch(target *t, size_t begin, size_t end) {
    bool empty = true;
    uint32_t first = 0, after;
    while (first < t->spans && t->span[first].end < begin) first++;
    for (after = first; after < t->spans && t->span[after].begin <= end; after++)
        empty = empty && (t->span[after].begin >= end || t->span[after].end <= begin);
    if (first == after && t->spans == SPANS) {
        clear_rest(t);
        return false;
    }
    if (!empty) clear(t, first, after, begin, end);
    span joined = {begin, end};
    if (first < after) {
        if (t->span[first].begin < begin) joined.begin = t->span[first].begin;
        if (t->span[after - 1].end > end) joined.end = t->span[after - 1].end;
    }
    memmove(&t->span[first + 1], &t->span[after], (t->spans - after) * sizeof *t->span);
    t->span[first] = joined;
    t->spans += 1 + first - after;
    return empty;
}

/* ---- blocks ---- */

typedef struct lg_sweep {
    lg_node_range range;
    void **block;    /* adjoint of each node, NULL until the first contribution */
    target *targets; /* one per wanted variable */
    uint32_t *lent;  /* 1 + index of the target that contains the block; 0: pool memory */
    uint8_t *reach;
    uint8_t *owned; /* 1: the block is from the pool; 0: it belongs to the caller or a parent */
    double *bound;  /* bound on the norm of the caller's memory; NULL when not requested */
    lg_rows *rows;  /* NULL unless the gradient of each row is kept apart */
    /* Bit k is set while the current step has written input k's adjoint in place and its norm is not yet in
     * `bound`. */
    uint64_t unbounded;
} lg_sweep;

_Static_assert(LG_MAX_INPUTS <= 64, "a bit for each input");

static size_t node_bytes(const lg_tape *tape, uint32_t i) {
    return tape->nodes[i].count * tape->k->size;
}

/* Whether the node is a view whose adjoint lies inside its parent's. This holds for a view that takes part in
 * the sweep and is not itself a wanted variable; its parent then takes part too. */
static bool inside_parent(const lg_sweep *sweep, const lg_node *node, uint32_t at) {
    return (node->flags & LG_NODE_VIEW) && sweep->reach[at] == REACHED;
}

/* Returns the adjoint block of node i, or NULL when the node has no block yet. The block of a view lies
 * inside its parent's block; the parent's block is created with zeros if needed. With `demand`, a missing
 * block is created with zeros for any node. Sets the tape's error on failure. */
static void *block_of(lg_tape *tape, lg_sweep *sweep, uint32_t i, bool demand) {
    uint32_t at = i - sweep->range.lo;
    if (sweep->block[at] != NULL) return sweep->block[at];
    const lg_node *node = &tape->nodes[i];
    if (inside_parent(sweep, node, at)) {
        unsigned char *base = block_of(tape, sweep, *lg_parents_of(tape, node), true);
        if (base == NULL) return NULL;
        sweep->block[at] = base + (size_t)node->attr.i[3] * tape->k->size;
        sweep->lent[at] = sweep->lent[*lg_parents_of(tape, node) - sweep->range.lo];
        return sweep->block[at];
    }
    if (!demand) return NULL;
    sweep->block[at] = lg_pool_take(tape, node_bytes(tape, i));
    if (sweep->block[at] == NULL) return NULL;
    sweep->owned[at] = 1;
    tape->k->fill(node->count, 0.0, sweep->block[at]);
    return sweep->block[at];
}

/* Whether node i's block lies in the caller's memory and holds no numbers yet. It must then be overwritten
 * completely, because first_touch counts it as filled from now on. */
static bool untouched(const lg_tape *tape, lg_sweep *sweep, uint32_t i) {
    const uint32_t at = i - sweep->range.lo;
    if (sweep->lent[at] == 0) return false;
    target *t = &sweep->targets[sweep->lent[at] - 1];
    const size_t begin = (size_t)((unsigned char *)sweep->block[at] - t->base);
    return first_touch(t, begin, begin + node_bytes(tape, i));
}

static double norm_of(const lg_tape *tape, size_t count, const void *value) {
    return sqrt(tape->k->dot(count, value, value));
}

/* Adds the norm of `value`, a contribution to node i, to the bound if node i's block lies in the caller's
 * memory. */
static void add_to_bound(const lg_tape *tape, lg_sweep *sweep, uint32_t i, const void *value) {
    if (sweep->bound == NULL || sweep->lent[i - sweep->range.lo] == 0) return;
    *sweep->bound += norm_of(tape, tape->nodes[i].count, value);
}

/* Adds contribution v to node i's adjoint. If v is the first contribution, is a temporary that owns its
 * memory, and nobody else reads this memory (only_reader), the memory becomes node i's block without a
 * copy. */
static void contribute(lg_tape *tape, lg_sweep *sweep, uint32_t i, lg_var v, bool only_reader) {
    uint32_t at = i - sweep->range.lo;
    void *block = block_of(tape, sweep, i, false);
    if (tape->status != LG_OK) return;
    lg_node *from = &tape->nodes[v.index];
    add_to_bound(tape, sweep, i, from->value);
    if (block != NULL && untouched(tape, sweep, i)) {
        memcpy(block, from->value, node_bytes(tape, i));
    } else if (block != NULL) {
        tape->k->axpy(tape->nodes[i].count, 1.0, from->value, block);
    } else if ((from->flags & LG_NODE_POOLED) && only_reader) {
        from->flags &= (uint8_t)~LG_NODE_POOLED;
        sweep->block[at] = from->value;
        sweep->owned[at] = 1;
    } else {
        block = lg_pool_take(tape, node_bytes(tape, i));
        if (block == NULL) return;
        memcpy(block, from->value, node_bytes(tape, i));
        sweep->block[at] = block;
        sweep->owned[at] = 1;
    }
}

/* Whether the values of a and b overlap in memory; their adjoints then overlap too. This happens when both
 * are views of the same numbers or the same node. */
static bool overlap(const lg_tape *tape, lg_var a, lg_var b) {
    const uintptr_t pa = (uintptr_t)lg_node_at(tape, a)->value, pb = (uintptr_t)lg_node_at(tape, b)->value;
    return pa < pb + node_bytes(tape, b.index) && pb < pa + node_bytes(tape, a.index);
}

bool lg_reverse_in_place(const lg_reverse *r) {
    if (r->sweep == NULL || r->put_out) return false;
    for (uint32_t i = 0; i < r->inputs; i++)
        for (uint32_t j = 0; j < i; j++)
            if (r->need[i] && r->need[j] && overlap(r->tape, r->in[i], r->in[j])) return false;
    return true;
}

void *lg_reverse_into(lg_reverse *r, uint32_t k, bool *add) {
    lg_tape *tape = r->tape;
    const uint32_t i = r->in[k].index, at = i - r->sweep->range.lo;
    void *block = block_of(tape, r->sweep, i, false);
    if (tape->status != LG_OK) return NULL;
    *add = block != NULL && !untouched(tape, r->sweep, i);
    r->sweep->unbounded |= (uint64_t)1 << k;
    if (block != NULL) return block;
    block = lg_pool_take(tape, node_bytes(tape, i));
    if (block == NULL) return NULL;
    r->sweep->block[at] = block;
    r->sweep->owned[at] = 1;
    return block;
}

void lg_reverse_three(lg_reverse *r, lg_reverse_kernel kernel, size_t n) {
    const void *in[3];
    void *out[3] = {NULL, NULL, NULL};
    bool add[3] = {false, false, false};
    for (uint32_t k = 0; k < 3; k++) {
        in[k] = lg_node_at(r->tape, r->in[k])->value;
        if (r->need[k] && r->tape->status == LG_OK) out[k] = lg_reverse_into(r, k, &add[k]);
    }
    if (r->tape->status == LG_OK) kernel(n, in, lg_node_at(r->tape, r->g)->value, out, add);
}

/* Adds |a| |b|, a bound on the norm of the product of a and b, to the sweep's bound if that is less work than
 * measuring the product. */
static void bound_product(lg_reverse *r, uint32_t k, const lg_node *a, const lg_node *b) {
    lg_sweep *sweep = r->sweep;
    const uint32_t i = r->in[k].index;
    if (sweep->bound == NULL || sweep->lent[i - sweep->range.lo] == 0) return;
    if (a->count + b->count > r->tape->nodes[i].count) return;
    *sweep->bound += norm_of(r->tape, a->count, a->value) * norm_of(r->tape, b->count, b->value);
    sweep->unbounded &= ~((uint64_t)1 << k);
}

void lg_reverse_matmul(lg_reverse *r, uint32_t k, uint32_t variant, lg_var a, lg_var b) {
    lg_tape *tape = r->tape;
    if (!r->need[k] || tape->status != LG_OK) return;
    const lg_shape *shape = &lg_node_at(tape, r->in[k])->shape;
    if (!lg_reverse_in_place(r) || shape->rank != 2) {
        lg_attr attr = {.i = {variant, 0, 0, 0}};
        lg_var in[2] = {a, b};
        r->out[k] = lg_record(tape, &lg_op_matmul, in, 2, &attr);
        return;
    }
    bool add = false;
    void *block = lg_reverse_into(r, k, &add);
    if (block == NULL) return;
    const lg_node *na = lg_node_at(tape, a), *nb = lg_node_at(tape, b);
    const size_t inner = na->shape.dims[variant == 2 ? 0 : 1];
    lg_gemm(tape, variant, shape->dims[0], shape->dims[1], inner, na->value, b.index, block, add);
    bound_product(r, k, na, nb);
}

/* Removes the temporaries of a vjp: nodes recorded after the mark, their pool blocks and their payload. */
static void drop_temporaries(lg_tape *tape, lg_mark before) {
    for (uint32_t i = before.nodes; i < tape->count; i++)
        if (tape->nodes[i].flags & LG_NODE_POOLED)
            lg_pool_give(tape, tape->nodes[i].value, node_bytes(tape, i));
    lg_forget_nodes(tape, before.nodes);
    tape->parents_count = before.parents;
    tape->arena.current = before.chunk;
    tape->arena.used = before.used;
}

/* Whether no other cotangent in `out` starts inside the memory of out[k]: none is the same variable or a view
 * of a part of it. */
static bool unshared(const lg_tape *tape, const lg_var *out, uint32_t inputs, uint32_t k) {
    const uintptr_t begin = (uintptr_t)lg_node_at(tape, out[k])->value;
    const uintptr_t end = begin + node_bytes(tape, out[k].index);
    for (uint32_t other = 0; other < inputs; other++) {
        if (other == k || lg_is_none(out[other])) continue;
        const uintptr_t value = (uintptr_t)lg_node_at(tape, out[other])->value;
        if (value >= begin && value < end) return false;
    }
    return true;
}

/* One node of the unrecorded sweep: runs its vjp, adds the contributions to its inputs' adjoints, and removes
 * the temporaries. */
static void unrecorded_step(lg_tape *tape, lg_sweep *sweep, uint32_t i, void *block) {
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS];
    const lg_mark before = lg_tape_mark(tape);
    uint32_t inputs = tape->nodes[i].inputs;
    lg_var g = lg_record_value(tape, &lg_op_leaf, NULL, 0, NULL, tape->nodes[i].shape, block, 0);
    if (tape->status != LG_OK) return;
    sweep->unbounded = 0;
    lg_reverse_step(tape, sweep->range, sweep->reach, sweep, i, g, in, need, out);
    for (uint32_t k = 0; k < inputs && tape->status == LG_OK; k++) {
        if (sweep->unbounded >> k & 1)
            add_to_bound(tape, sweep, in[k].index, sweep->block[in[k].index - sweep->range.lo]);
        if (need[k] && !lg_is_none(out[k]))
            contribute(tape, sweep, in[k].index, out[k], unshared(tape, out, inputs, k));
    }
    if (sweep->rows != NULL && tape->status == LG_OK) lg_rows_add(tape, sweep->rows, i, g);
    drop_temporaries(tape, before);
}

/* Copies or adds the complete adjoint of node i to the caller's buffer t. Only wanted variables that are not
 * leaves need this; the block of a wanted leaf is the caller's buffer itself. */
static void hand_out(const lg_tape *tape, lg_sweep *sweep, uint32_t i, const void *block, target *t) {
    if (sweep->bound != NULL) *sweep->bound += norm_of(tape, tape->nodes[i].count, block);
    if (first_touch(t, 0, t->bytes))
        memcpy(t->base, block, t->bytes);
    else
        tape->k->axpy(tape->nodes[i].count, 1.0, block, t->base);
}

static void unrecorded_sweep(lg_tape *tape, lg_sweep *sweep, const lg_var *wrt, size_t n) {
    for (uint32_t i = sweep->range.hi + 1; i-- > sweep->range.lo && tape->status == LG_OK;) {
        uint32_t at = i - sweep->range.lo;
        void *block = sweep->block[at];
        if (block == NULL || !sweep->reach[at] || inside_parent(sweep, &tape->nodes[i], at)) continue;
        if (tape->nodes[i].inputs > 0) {
            unrecorded_step(tape, sweep, i, block);
            for (size_t w = 0; sweep->reach[at] == ASKED && w < n; w++)
                if (wrt[w].index == i) hand_out(tape, sweep, i, block, &sweep->targets[w]);
        }
        if (sweep->owned[at]) {
            lg_pool_give(tape, block, node_bytes(tape, i));
            sweep->owned[at] = 0;
            sweep->block[at] = NULL;
        }
    }
}

/* Marks the wanted variables, and makes the caller's buffer the adjoint block of each wanted variable that is
 * a leaf. With `added`, the buffers hold numbers already and the gradients are added to them. */
static void open_targets(lg_tape *tape, lg_sweep *sweep, const lg_var *wrt, size_t n, void *const *grad,
                         bool added) {
    for (size_t i = 0; i < n; i++) {
        uint32_t at = wrt[i].index - sweep->range.lo;
        const bool twice = sweep->reach[at] == ASKED;
        if (twice || grad[i] == NULL) {
            lg_tape_fail(tape, LG_INVALID_ARGUMENT, "backward",
                         twice ? "a variable is in the list twice" : "the memory for a gradient is NULL");
            return;
        }
        sweep->reach[at] = ASKED;
        target *t = &sweep->targets[i];
        *t = (target){.base = grad[i], .bytes = node_bytes(tape, wrt[i].index)};
        if (added) t->span[t->spans++] = (span){0, t->bytes};
        if (tape->nodes[wrt[i].index].inputs > 0) continue;
        sweep->block[at] = grad[i];
        sweep->lent[at] = (uint32_t)i + 1;
    }
}

static void seed(lg_tape *tape, lg_sweep *sweep, lg_var y) {
    if (y.index < sweep->range.lo || !sweep->reach[y.index - sweep->range.lo]) return;
    const lg_mark before = lg_tape_mark(tape);
    lg_var one = lg_full(tape, tape->nodes[y.index].shape, 1.0);
    if (tape->status == LG_OK) contribute(tape, sweep, y.index, one, true);
    drop_temporaries(tape, before);
}

/* A request for the gradient of each row with respect to `theta`; `gradient` is (count, elements of
 * theta). */
typedef struct apart {
    lg_var theta;
    size_t count;
    double *gradient;
} apart;

static void sweep_back(lg_tape *tape, lg_sweep *sweep, lg_var y, const lg_var *wrt, size_t n,
                       void *const *grad, bool added, const apart *rows) {
    const size_t length = (size_t)sweep->range.hi - sweep->range.lo + 1;
    if (rows != NULL) {
        lg_mark_reach(tape, sweep->range, &rows->theta, 1, sweep->reach);
        sweep->rows =
            lg_rows_open(tape, sweep->range, rows->theta, rows->count, rows->gradient, sweep->reach);
    }
    if (tape->status != LG_OK) return;
    lg_mark_reach(tape, sweep->range, wrt, n, sweep->reach);
    open_targets(tape, sweep, wrt, n, grad, added);
    if (tape->status == LG_OK) {
        tape->unrecorded = true;
        seed(tape, sweep, y);
        unrecorded_sweep(tape, sweep, wrt, n);
        for (size_t at = 0; at < length; at++)
            if (sweep->owned[at])
                lg_pool_give(tape, sweep->block[at], node_bytes(tape, sweep->range.lo + (uint32_t)at));
        for (size_t i = 0; i < n; i++) clear_rest(&sweep->targets[i]);
        tape->unrecorded = false;
    }
    if (sweep->rows != NULL) lg_rows_close(tape, sweep->rows);
}

static lg_status backward(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad, bool added,
                          double *bound, const apart *rows) {
    LG_TRY(lg_tape_needs(tape, "backward", n == 0 || (wrt != NULL && grad != NULL)));
    if (!lg_valid_list(tape, &y, 1, "backward") || !lg_valid_list(tape, wrt, n, "backward"))
        return tape->status;
    if (tape->unrecorded) {
        lg_tape_fail(tape, LG_UNSUPPORTED, "backward", "a vjp that lg_backward runs cannot call lg_backward");
        return tape->status;
    }
    if (n == 0) return LG_OK;
    lg_sweep sweep = {.range = lg_range_of(&y, 1, wrt, n), .bound = bound};
    if (rows != NULL && rows->theta.index < sweep.range.lo) sweep.range.lo = rows->theta.index;
    const size_t length = (size_t)sweep.range.hi - sweep.range.lo + 1;
    const size_t each = sizeof *sweep.block + sizeof *sweep.lent + sizeof *sweep.reach + sizeof *sweep.owned;
    const size_t bytes = length * each + n * sizeof *sweep.targets;
    sweep.block = lg_pool_take(tape, bytes);
    if (sweep.block == NULL) return tape->status;
    memset(sweep.block, 0, bytes);
    sweep.targets = (target *)(sweep.block + length);
    sweep.lent = (uint32_t *)(sweep.targets + n);
    sweep.reach = (uint8_t *)(sweep.lent + length);
    sweep.owned = sweep.reach + length;
    sweep_back(tape, &sweep, y, wrt, n, grad, added, rows);
    lg_pool_give(tape, sweep.block, bytes);
    return tape->status;
}

lg_status lg_backward(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad) {
    return backward(tape, y, wrt, n, grad, true, NULL, NULL);
}

lg_status lg_backward_set(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad) {
    return backward(tape, y, wrt, n, grad, false, NULL, NULL);
}

lg_status lg_backward_set_bounded(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad,
                                  double *bound) {
    *bound = 0.0;
    return backward(tape, y, wrt, n, grad, false, bound, NULL);
}

lg_status lg_backward_rows(lg_tape *tape, lg_var y, lg_var x, double *grad, lg_var theta, size_t count,
                           double *gradients) {
    const apart rows = {theta, count, gradients};
    void *const into[] = {grad};
    if (!lg_valid_list(tape, &theta, 1, "backward")) return tape->status;
    if (tape->k->dtype != LG_F64 || tape->nodes[theta.index].inputs > 0) {
        lg_tape_fail(tape, LG_UNSUPPORTED, "backward",
                     "gradients per row need a tape of type LG_F64 and a leaf as theta");
        return tape->status;
    }
    return backward(tape, y, &x, 1, into, false, NULL, &rows);
}
