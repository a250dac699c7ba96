/* Reverse and forward sweeps over the tape.
 *
 * All sweeps look at the nodes lo..hi only, lo the oldest variable asked for, hi the newest output. A node
 * takes part when it depends, through inputs that are not frozen, on one of the variables.
 *
 * The unrecorded sweep keeps an adjoint block for each live node. A block is adopted from a temporary of the
 * vjp when it is the first contribution, accumulated into otherwise, and returned to the pool when its node
 * is done. A view (reshape, contiguous slice) has no block of its own: its adjoint lies inside its parent's,
 * so a weight's gradient is accumulated straight into the caller's flat gradient.
 */
#include "autodiff/tape_internal.h"

#include <string.h>

/* ---- reachability ---- */

typedef struct lg_range {
    uint32_t lo, hi; /* inclusive */
} lg_range;

static bool frozen(const lg_node *node, uint32_t input) {
    return input < 32 && ((lg_ops[node->op]->frozen >> input) & 1u) != 0;
}

static bool planted(const lg_tape *tape, uint32_t node, lg_plant_direction direction) {
    return tape->plant != NULL && lg_plant_hits(tape, node, direction);
}

static const uint32_t *parents_of(const lg_tape *tape, const lg_node *node) {
    return &tape->parents[node->parents];
}

/* reach[i - lo] = 1 when node i depends on one of the variables. `reach` is zeroed. */
static void mark_reach(const lg_tape *tape, lg_range range, const lg_var *wrt, size_t n, uint8_t *reach) {
    for (size_t i = 0; i < n; i++) reach[wrt[i].index - range.lo] = 1;
    for (uint32_t i = range.lo; i <= range.hi; i++) {
        const lg_node *node = &tape->nodes[i];
        const uint32_t *parents = parents_of(tape, node);
        for (uint32_t k = 0; k < node->inputs && !reach[i - range.lo]; k++)
            if (parents[k] >= range.lo && reach[parents[k] - range.lo] && !frozen(node, k))
                reach[i - range.lo] = 1;
    }
}

/* Clears reach for nodes on which no output depends. */
static void keep_needed(lg_tape *tape, lg_range range, const lg_var *y, size_t ny, uint8_t *reach,
                        uint8_t *needed) {
    for (size_t i = 0; i < ny; i++)
        if (y[i].index >= range.lo) needed[y[i].index - range.lo] = 1;
    for (uint32_t i = range.hi + 1; i-- > range.lo;) {
        if (!needed[i - range.lo]) {
            reach[i - range.lo] = 0;
            continue;
        }
        const lg_node *node = &tape->nodes[i];
        const uint32_t *parents = parents_of(tape, node);
        for (uint32_t k = 0; k < node->inputs; k++)
            if (parents[k] >= range.lo && !frozen(node, k)) needed[parents[k] - range.lo] = 1;
    }
}

/* Resolves a list of handles; false with the error set when one is bad. */
static bool valid_list(lg_tape *tape, const lg_var *list, size_t n, const char *name) {
    if (tape->status != LG_OK) return false;
    for (size_t i = 0; i < n; i++)
        if (lg_node_of(tape, list[i], name) == NULL) return false;
    return true;
}

static lg_range range_of(const lg_var *newest, size_t n_newest, const lg_var *oldest, size_t n_oldest) {
    lg_range range = {UINT32_MAX, 0};
    for (size_t i = 0; i < n_oldest; i++) {
        if (oldest[i].index < range.lo) range.lo = oldest[i].index;
        if (oldest[i].index > range.hi) range.hi = oldest[i].index;
    }
    for (size_t i = 0; i < n_newest; i++)
        if (newest[i].index > range.hi) range.hi = newest[i].index;
    return range;
}

/* ---- one reverse step ---- */

enum { REACHED = 1, ASKED = 2 }; /* ASKED: one of the variables of lg_backward */

typedef struct lg_sweep {
    lg_range range;
    uint8_t *reach;
    void **block;   /* unrecorded: adjoint memory of a node, NULL until the first contribution */
    uint8_t *owned; /* the block is the pool's, not the caller's or a parent's */
} lg_sweep;

/* Calls node i's vjp with cotangent g; out holds the inputs' cotangents. */
static void reverse_step(lg_tape *tape, lg_sweep *sweep, uint32_t i, lg_var g, bool unrecorded, lg_var *in,
                         bool *need, lg_var *out) {
    const lg_node *node = &tape->nodes[i];
    const uint32_t *parents = parents_of(tape, node);
    lg_attr attr = node->attr;
    uint32_t inputs = node->inputs;
    for (uint32_t k = 0; k < inputs; k++) {
        in[k] = lg_var_at(tape, parents[k]);
        need[k] =
            parents[k] >= sweep->range.lo && sweep->reach[parents[k] - sweep->range.lo] && !frozen(node, k);
        out[k] = LG_NONE;
    }
    lg_reverse r = {tape, i, lg_var_at(tape, i), g, &attr, in, inputs, need, out, unrecorded ? sweep : NULL};
    lg_ops[node->op]->vjp(&r);
    if (planted(tape, i, LG_PLANT_VJP)) lg_plant_vjp(&r);
}

/* ---- recorded reverse mode ---- */

static void recorded_sweep(lg_tape *tape, lg_sweep *sweep, lg_var *adjoint) {
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS];
    for (uint32_t i = sweep->range.hi + 1; i-- > sweep->range.lo && tape->status == LG_OK;) {
        lg_var g = adjoint[i - sweep->range.lo];
        uint32_t inputs = tape->nodes[i].inputs;
        if (inputs == 0 || lg_is_none(g) || !sweep->reach[i - sweep->range.lo]) continue;
        reverse_step(tape, sweep, i, g, false, in, need, out);
        for (uint32_t k = 0; k < inputs && tape->status == LG_OK; k++) {
            if (!need[k] || lg_is_none(out[k])) continue;
            lg_var *slot = &adjoint[in[k].index - sweep->range.lo];
            *slot = lg_add_or(tape, *slot, out[k]);
        }
    }
}

/* out[i] = what was found for list[i], zeros for nothing. `out` is untouched unless all is well. */
static void collect(lg_tape *tape, lg_range range, lg_var *found, const lg_var *list, size_t n, lg_var *out) {
    for (size_t i = 0; i < n && tape->status == LG_OK; i++) {
        lg_var *slot = &found[list[i].index - range.lo];
        if (lg_is_none(*slot)) *slot = lg_zeros_like(tape, list[i]);
    }
    for (size_t i = 0; i < n && tape->status == LG_OK; i++) out[i] = found[list[i].index - range.lo];
}

lg_status lg_vjp(lg_tape *tape, const lg_var *y, const lg_var *cotangent, size_t ny, const lg_var *wrt,
                 size_t n, lg_var *out) {
    if (!valid_list(tape, y, ny, "vjp") || !valid_list(tape, cotangent, ny, "vjp") ||
        !valid_list(tape, wrt, n, "vjp"))
        return tape->status;
    if (n == 0) return LG_OK;
    for (size_t j = 0; j < ny; j++)
        if (!lg_same_shape(&lg_node_at(tape, y[j])->shape, &lg_node_at(tape, cotangent[j])->shape)) {
            lg_tape_fail(tape, LG_SHAPE, "vjp", "a cotangent has another shape than its output");
            return tape->status;
        }
    lg_sweep sweep = {.range = range_of(y, ny, wrt, n)};
    size_t length = (size_t)sweep.range.hi - sweep.range.lo + 1;
    size_t bytes = length * (sizeof(lg_var) + 1);
    lg_var *adjoint = lg_pool_take(tape, bytes);
    if (adjoint == NULL) return tape->status;
    memset(adjoint, 0, bytes);
    sweep.reach = (uint8_t *)(adjoint + length);
    mark_reach(tape, sweep.range, wrt, n, sweep.reach);
    for (size_t j = 0; j < ny; j++) {
        if (y[j].index < sweep.range.lo || !sweep.reach[y[j].index - sweep.range.lo]) continue;
        lg_var *slot = &adjoint[y[j].index - sweep.range.lo];
        *slot = lg_add_or(tape, *slot, cotangent[j]);
    }
    recorded_sweep(tape, &sweep, adjoint);
    collect(tape, sweep.range, adjoint, wrt, n, out);
    lg_pool_give(tape, adjoint, bytes);
    return tape->status;
}

lg_status lg_grad(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, lg_var *out) {
    if (!valid_list(tape, &y, 1, "grad") || !valid_list(tape, wrt, n, "grad")) return tape->status;
    lg_var one = lg_full(tape, lg_node_at(tape, y)->shape, 1.0);
    if (tape->status != LG_OK) return tape->status;
    return lg_vjp(tape, &y, &one, 1, wrt, n, out);
}

/* ---- unrecorded reverse mode ---- */

static size_t node_bytes(const lg_tape *tape, uint32_t i) {
    return tape->nodes[i].count * tape->k->size;
}

/* A view that takes part and is not itself asked for: its parent takes part too. */
static bool inside_parent(const lg_sweep *sweep, const lg_node *node, uint32_t at) {
    return (node->flags & LG_NODE_VIEW) && sweep->reach[at] == REACHED;
}

/* Where node i's adjoint lives, or NULL when nothing has been added to it and it has no place by itself. A
 * view whose parent takes part lives inside its parent's block, made with zeros on demand. Sets the tape's
 * error on failure. */
static void *block_of(lg_tape *tape, lg_sweep *sweep, uint32_t i, bool demand) {
    uint32_t at = i - sweep->range.lo;
    if (sweep->block[at] != NULL) return sweep->block[at];
    const lg_node *node = &tape->nodes[i];
    if (inside_parent(sweep, node, at)) {
        unsigned char *base = block_of(tape, sweep, *parents_of(tape, node), true);
        if (base == NULL) return NULL;
        sweep->block[at] = base + (size_t)node->attr.i[3] * tape->k->size;
        return sweep->block[at];
    }
    if (!demand) return NULL;
    sweep->block[at] = lg_pool_take(tape, node_bytes(tape, i));
    if (sweep->block[at] == NULL) return NULL;
    sweep->owned[at] = 1;
    tape->k->fill(node->count, 0.0, sweep->block[at]);
    return sweep->block[at];
}

/* Adds contribution v to node i's adjoint. A temporary that owns its value, and is its only reader, gives it
 * away when it is the first contribution. */
static void contribute(lg_tape *tape, lg_sweep *sweep, uint32_t i, lg_var v, bool only_reader) {
    uint32_t at = i - sweep->range.lo;
    void *block = block_of(tape, sweep, i, false);
    if (tape->status != LG_OK) return;
    lg_node *from = &tape->nodes[v.index];
    size_t count = tape->nodes[i].count;
    if (block != NULL) {
        tape->k->axpy(count, 1.0, from->value, block);
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

void lg_reverse_matmul(lg_reverse *r, uint32_t k, uint32_t variant, lg_var a, lg_var b) {
    lg_tape *tape = r->tape;
    if (!r->need[k] || tape->status != LG_OK) return;
    lg_attr attr = {.i = {variant, 0, 0, 0}};
    const lg_node *target = lg_node_at(tape, r->in[k]);
    if (r->sweep == NULL || target->shape.rank != 2 || planted(tape, r->node, LG_PLANT_VJP)) {
        lg_var in[2] = {a, b};
        r->out[k] = lg_record(tape, LG_OP_MATMUL, in, 2, &attr);
        return;
    }
    const lg_node *na = lg_node_at(tape, a), *nb = lg_node_at(tape, b);
    bool accumulate = true;
    void *block = block_of(tape, r->sweep, r->in[k].index, false);
    if (tape->status != LG_OK) return;
    if (block == NULL) {
        uint32_t at = r->in[k].index - r->sweep->range.lo;
        block = lg_pool_take(tape, node_bytes(tape, r->in[k].index));
        if (block == NULL) return;
        r->sweep->block[at] = block;
        r->sweep->owned[at] = 1;
        accumulate = false;
    }
    size_t inner = na->shape.dims[variant == 2 ? 0 : 1];
    lg_gemm(tape, variant, target->shape.dims[0], target->shape.dims[1], inner, na->value, nb->value, b.index,
            block, accumulate);
}

/* Frees what a vjp left behind: nodes after the mark, their pool blocks, payload. */
static void drop_temporaries(lg_tape *tape, lg_mark before) {
    for (uint32_t i = before.nodes; i < tape->count; i++)
        if (tape->nodes[i].flags & LG_NODE_POOLED)
            lg_pool_give(tape, tape->nodes[i].value, node_bytes(tape, i));
    lg_forget_nodes(tape, before.nodes);
    tape->parents_count = before.parents;
    tape->arena.current = before.chunk;
    tape->arena.used = before.used;
}

/* No other cotangent of this step reads the memory of out[k], as itself or as a view of a part. */
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

/* One node of the unrecorded sweep: its vjp, its contributions, its temporaries' end. */
static void unrecorded_step(lg_tape *tape, lg_sweep *sweep, uint32_t i, void *block) {
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS];
    const lg_mark before = lg_tape_mark(tape);
    uint32_t inputs = tape->nodes[i].inputs;
    lg_var g = lg_record_value(tape, LG_OP_LEAF, NULL, 0, NULL, tape->nodes[i].shape, block, 0);
    if (tape->status != LG_OK) return;
    reverse_step(tape, sweep, i, g, true, in, need, out);
    for (uint32_t k = 0; k < inputs && tape->status == LG_OK; k++)
        if (need[k] && !lg_is_none(out[k]))
            contribute(tape, sweep, in[k].index, out[k], unshared(tape, out, inputs, k));
    drop_temporaries(tape, before);
}

/* A variable that is a leaf has the caller's buffer as its block; any other has a block of its own that is
 * added to the caller's when complete, because the caller's may hold something already. */
static void unrecorded_sweep(lg_tape *tape, lg_sweep *sweep, const lg_var *wrt, size_t n, void *const *grad) {
    for (uint32_t i = sweep->range.hi + 1; i-- > sweep->range.lo && tape->status == LG_OK;) {
        uint32_t at = i - sweep->range.lo;
        void *block = sweep->block[at];
        if (block == NULL || !sweep->reach[at] || inside_parent(sweep, &tape->nodes[i], at)) continue;
        if (tape->nodes[i].inputs > 0) {
            unrecorded_step(tape, sweep, i, block);
            for (size_t w = 0; sweep->reach[at] == ASKED && w < n; w++)
                if (wrt[w].index == i) tape->k->axpy(tape->nodes[i].count, 1.0, block, grad[w]);
        }
        if (sweep->owned[at]) {
            lg_pool_give(tape, block, node_bytes(tape, i));
            sweep->owned[at] = 0;
            sweep->block[at] = NULL;
        }
    }
}

/* Marks the variables asked for, lends the leaves among them the caller's buffers, and adds the seed, ones.
 */
static void seed_sweep(lg_tape *tape, lg_sweep *sweep, lg_var y, const lg_var *wrt, size_t n,
                       void *const *grad) {
    for (size_t i = 0; i < n; i++) {
        uint32_t at = wrt[i].index - sweep->range.lo;
        const bool twice = sweep->reach[at] == ASKED;
        if (twice || grad[i] == NULL) {
            lg_tape_fail(tape, LG_INVALID_ARGUMENT, "backward",
                         twice ? "a variable is asked for twice" : "a gradient has no memory");
            return;
        }
        sweep->reach[at] = ASKED;
        if (tape->nodes[wrt[i].index].inputs == 0) sweep->block[at] = grad[i];
    }
    if (y.index < sweep->range.lo || !sweep->reach[y.index - sweep->range.lo]) return;
    const lg_mark before = lg_tape_mark(tape);
    lg_var one = lg_full(tape, tape->nodes[y.index].shape, 1.0);
    if (tape->status == LG_OK) contribute(tape, sweep, y.index, one, true);
    drop_temporaries(tape, before);
}

lg_status lg_backward(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, void *const *grad) {
    if (!valid_list(tape, &y, 1, "backward") || !valid_list(tape, wrt, n, "backward")) return tape->status;
    if (tape->unrecorded) {
        lg_tape_fail(tape, LG_UNSUPPORTED, "backward", "it cannot be called by a vjp that it runs");
        return tape->status;
    }
    if (n == 0) return LG_OK;
    lg_sweep sweep = {.range = range_of(&y, 1, wrt, n)};
    size_t length = (size_t)sweep.range.hi - sweep.range.lo + 1;
    size_t bytes = length * (sizeof(void *) + 2);
    sweep.block = lg_pool_take(tape, bytes);
    if (sweep.block == NULL) return tape->status;
    memset(sweep.block, 0, bytes);
    sweep.reach = (uint8_t *)(sweep.block + length);
    sweep.owned = sweep.reach + length;
    mark_reach(tape, sweep.range, wrt, n, sweep.reach);
    tape->unrecorded = true;
    seed_sweep(tape, &sweep, y, wrt, n, grad);
    unrecorded_sweep(tape, &sweep, wrt, n, grad);
    for (size_t at = 0; at < length; at++)
        if (sweep.owned[at])
            lg_pool_give(tape, sweep.block[at], node_bytes(tape, sweep.range.lo + (uint32_t)at));
    tape->unrecorded = false;
    lg_pool_give(tape, sweep.block, bytes);
    return tape->status;
}

/* ---- recorded forward mode ---- */

/* A variable that depends on another one gets its own direction and what comes to it through the other, as
 * the reverse mode's total derivatives ask. */
static void forward_sweep(lg_tape *tape, lg_range range, const uint8_t *reach, lg_var *tangent) {
    lg_var in[LG_MAX_INPUTS], tangents[LG_MAX_INPUTS];
    for (uint32_t i = range.lo; i <= range.hi && tape->status == LG_OK; i++) {
        const lg_node *node = &tape->nodes[i];
        if (!reach[i - range.lo]) continue;
        const uint32_t *parents = parents_of(tape, node);
        lg_attr attr = node->attr;
        bool any = false;
        for (uint32_t k = 0; k < node->inputs; k++) {
            in[k] = lg_var_at(tape, parents[k]);
            tangents[k] =
                parents[k] >= range.lo && !frozen(node, k) ? tangent[parents[k] - range.lo] : LG_NONE;
            any = any || !lg_is_none(tangents[k]);
        }
        if (!any) continue;
        lg_forward f = {tape, lg_var_at(tape, i), &attr, in, tangents, node->inputs};
        lg_var moved = planted(tape, i, LG_PLANT_JVP) ? lg_plant_jvp(&f) : lg_ops[node->op]->jvp(&f);
        tangent[i - range.lo] = lg_add_or(tape, tangent[i - range.lo], moved);
    }
}

lg_status lg_jvp(lg_tape *tape, const lg_var *y, size_t ny, const lg_var *x, const lg_var *direction,
                 size_t nx, lg_var *out) {
    if (!valid_list(tape, y, ny, "jvp") || !valid_list(tape, x, nx, "jvp") ||
        !valid_list(tape, direction, nx, "jvp"))
        return tape->status;
    if (ny == 0) return LG_OK;
    for (size_t i = 0; i < nx; i++)
        if (!lg_same_shape(&lg_node_at(tape, x[i])->shape, &lg_node_at(tape, direction[i])->shape)) {
            lg_tape_fail(tape, LG_SHAPE, "jvp", "a tangent has another shape than its variable");
            return tape->status;
        }
    lg_range range = range_of(y, ny, x, nx);
    for (size_t j = 0; j < ny; j++)
        if (y[j].index < range.lo) range.lo = y[j].index;
    size_t length = (size_t)range.hi - range.lo + 1;
    size_t bytes = length * (sizeof(lg_var) + 2);
    lg_var *tangent = lg_pool_take(tape, bytes);
    if (tangent == NULL) return tape->status;
    memset(tangent, 0, bytes);
    uint8_t *reach = (uint8_t *)(tangent + length), *needed = reach + length;
    mark_reach(tape, range, x, nx, reach);
    keep_needed(tape, range, y, ny, reach, needed);
    for (size_t i = 0; i < nx; i++) {
        lg_var *slot = &tangent[x[i].index - range.lo];
        *slot = lg_add_or(tape, *slot, direction[i]);
    }
    forward_sweep(tape, range, reach, tangent);
    collect(tape, range, tangent, y, ny, out);
    lg_pool_give(tape, tangent, bytes);
    return tape->status;
}

/* ---- built on them ---- */

/* A tensor of v's shape that is 1 at element `one` and 0 elsewhere. */
static lg_var unit_like(lg_tape *tape, lg_var v, size_t one) {
    lg_shape shape = lg_node_at(tape, v)->shape;
    lg_var unit = lg_full(tape, shape, 0.0);
    if (lg_is_none(unit)) return unit;
    const double value = 1.0;
    tape->k->convert_in(1, &value, (unsigned char *)tape->nodes[unit.index].value + one * tape->k->size);
    return unit;
}

static lg_var jacobian_row(lg_tape *tape, lg_var y, lg_var x, size_t row) {
    lg_var seed = unit_like(tape, y, row), out = LG_NONE;
    if (lg_vjp(tape, &y, &seed, 1, &x, 1, &out) != LG_OK) return LG_NONE;
    return lg_reshape(tape, out, lg_shape2(1, (uint32_t)lg_node_at(tape, x)->count));
}

static lg_var jacobian_column(lg_tape *tape, lg_var y, lg_var x, size_t column) {
    lg_var seed = unit_like(tape, x, column), out = LG_NONE;
    if (lg_jvp(tape, &y, 1, &x, &seed, 1, &out) != LG_OK) return LG_NONE;
    return lg_reshape(tape, out, lg_shape2((uint32_t)lg_node_at(tape, y)->count, 1));
}

lg_var lg_jacobian(lg_tape *tape, lg_var y, lg_var x) {
    if (!valid_list(tape, &y, 1, "jacobian") || !valid_list(tape, &x, 1, "jacobian")) return LG_NONE;
    size_t rows = lg_node_at(tape, y)->count, columns = lg_node_at(tape, x)->count;
    bool reverse = rows <= columns;
    size_t passes = reverse ? rows : columns;
    if (passes == 0) return lg_full(tape, lg_shape2((uint32_t)rows, (uint32_t)columns), 0.0);
    lg_var whole = LG_NONE;
    for (size_t at = 0; at < passes && tape->status == LG_OK;) {
        lg_var parts[LG_MAX_INPUTS];
        size_t n = 0;
        if (!lg_is_none(whole)) parts[n++] = whole;
        for (; n < LG_MAX_INPUTS && at < passes; at++)
            parts[n++] = reverse ? jacobian_row(tape, y, x, at) : jacobian_column(tape, y, x, at);
        whole = lg_concat(tape, parts, n, reverse ? 0 : 1);
    }
    return tape->status == LG_OK ? whole : LG_NONE;
}

lg_var lg_hvp(lg_tape *tape, lg_var y, lg_var x, lg_var v) {
    lg_var gradient, product, all[3] = {y, x, v};
    if (!valid_list(tape, all, 3, "hvp")) return LG_NONE;
    if (lg_grad(tape, y, &x, 1, &gradient) != LG_OK) return LG_NONE;
    if (lg_jvp(tape, &gradient, 1, &x, &v, 1, &product) != LG_OK) return LG_NONE;
    return product;
}
