/* Minimal cost-complexity pruning: Breiman et al. (1984), chapter 3.
 *
 * R(t) = (n_t/n) impurity_t is the cost of node t as a leaf. R(T_t) is the sum of R over the leaves below t,
 * and |T_t| is the number of these leaves. The branch at t is worth keeping as long as alpha is below
 *   g(t) = (R(t) - R(T_t))/(|T_t| - 1).
 * The algorithm cuts the branch with the smallest g, updates R(T), |T| and g of its ancestors, and repeats
 * this until only the root is left. A tournament tree over the nodes finds the smallest g, so that a cut
 * costs O(depth log nodes). */
#include <math.h>
#include <string.h>

#include "anomaly/classify/tree.h"
#include "core/core.h"

#define NO_NODE UINT32_MAX

/* ---- copies and depth of trees ---- */

typedef struct visit {
    uint32_t from, parent, depth; /* node in the original, parent in the copy, depth there */
    bool right;
} visit;

/* Copies the nodes, and sets their number and the depth. */
static void copy_kept(const lg_tree *tree, const bool *cut, visit *stack, lg_tree *out) {
    const size_t row = tree->classes * sizeof *out->counts;
    size_t used = 0;
    uint32_t count = 0;
    stack[used++] = (visit){0, 0, 0, false};
    out->depth = 0;
    while (used > 0) {
        const visit v = stack[--used];
        lg_tree_node *node = &out->node[count];
        *node = tree->node[v.from];
        if (v.depth > out->depth) out->depth = v.depth;
        memcpy(&out->counts[(size_t)count * tree->classes], &tree->counts[(size_t)v.from * tree->classes],
               row);
        if (count > 0 && v.right) out->node[v.parent].right = count;
        if (count > 0 && !v.right) out->node[v.parent].left = count;
        if (node->left == 0 || (cut != NULL && cut[v.from])) {
            node->left = node->right = node->feature = 0;
            node->threshold = 0.0;
        } else {
            stack[used++] = (visit){node->right, count, v.depth + 1, true};
            stack[used++] = (visit){node->left, count, v.depth + 1, false};
        }
        count++;
    }
    out->count = count;
}

lg_status lg_tree_compact(const lg_context *context, const lg_tree *tree, const bool *cut, lg_tree *out) {
    lg_tree copy = *tree;
    copy.context = context;
    visit *stack = lg_alloc(context, (size_t)tree->count + 1, sizeof *stack);
    if (stack == NULL) return LG_OUT_OF_MEMORY;
    copy.node = lg_alloc(context, copy.count, sizeof *copy.node);
    copy.counts = lg_alloc(context, (size_t)copy.count * copy.classes, sizeof *copy.counts);
    const bool all = copy.node != NULL && copy.counts != NULL;
    if (all) {
        copy_kept(tree, cut, stack, &copy);
        *out = copy;
    } else {
        lg_tree_destroy(&copy);
    }
    lg_free(context, stack);
    return all ? LG_OK : LG_OUT_OF_MEMORY;
}

/* ---- the weakest links ---- */

typedef struct pruner {
    const lg_context *context;
    const lg_tree *tree; /* points to `ordered` */
    lg_tree ordered;
    uint32_t nodes;            /* number of nodes of the current (pruned) tree */
    uint32_t base;             /* number of leaves of the tournament tree, a power of two */
    uint32_t *parent, *leaves; /* (count) */
    uint32_t *end;             /* (count): the nodes below t are t + 1 .. end[t] - 1 */
    double *own, *branch;      /* R(t) and R(T_t) */
    /* (2 base): the tournament tree. Entry base + t is g(t); entry i < base is the smaller of entries 2 i and
     * 2 i + 1. */
    double *link;
    bool *cut;
    double alpha; /* alpha of the last cut */
} pruner;

static void pruner_free(pruner *p) {
    void *const owned[] = {p->parent, p->leaves, p->end, p->own, p->branch, p->link, p->cut};
    for (size_t i = 0; i < LG_COUNT(owned); i++) lg_free(p->context, owned[i]);
    lg_tree_destroy(&p->ordered);
}

static double link_of(const pruner *p, uint32_t t) {
    if (p->leaves[t] < 2) return (double)INFINITY;
    return (p->own[t] - p->branch[t]) / (double)(p->leaves[t] - 1);
}

static void play(pruner *p, uint32_t t) {
    uint32_t i = p->base + t;
    p->link[i] = link_of(p, t);
    for (i /= 2; i > 0; i /= 2) p->link[i] = fmin(p->link[2 * i], p->link[2 * i + 1]);
}

/* Returns the node with the smallest g, the first one if several are equal, or NO_NODE if only the root is
 * left. */
static uint32_t weakest(const pruner *p) {
    if (p->leaves[0] < 2) return NO_NODE;
    uint32_t i = 1;
    while (i < p->base) i = p->link[2 * i] <= p->link[2 * i + 1] ? 2 * i : 2 * i + 1;
    return i - p->base;
}

static lg_status pruner_allocate(pruner *p) {
    const size_t count = p->tree->count;
    p->parent = lg_alloc(p->context, count, sizeof *p->parent);
    p->leaves = lg_alloc(p->context, count, sizeof *p->leaves);
    p->end = lg_alloc(p->context, count, sizeof *p->end);
    p->own = lg_alloc(p->context, count, sizeof *p->own);
    p->branch = lg_alloc(p->context, count, sizeof *p->branch);
    p->cut = lg_alloc(p->context, count, sizeof *p->cut);
    p->link = lg_alloc(p->context, 2 * (size_t)p->base, sizeof *p->link);
    const bool all = p->parent != NULL && p->leaves != NULL && p->end != NULL && p->own != NULL &&
                     p->branch != NULL && p->cut != NULL && p->link != NULL;
    return all ? LG_OK : LG_OUT_OF_MEMORY;
}

static lg_status pruner_create(pruner *p, const lg_tree *tree) {
    /* Twice the number of nodes must fit into 32 bits. */
    if (tree->count > (uint32_t)1 << 30) return LG_OUT_OF_MEMORY;
    LG_TRY(lg_tree_compact(p->context, tree, NULL, &p->ordered));
    p->tree = &p->ordered;
    p->nodes = p->tree->count;
    for (p->base = 1; p->base < p->nodes; p->base *= 2) {
    }
    LG_TRY(pruner_allocate(p));
    const lg_tree_node *node = p->tree->node;
    p->parent[0] = NO_NODE;
    for (uint32_t t = 0; t < p->nodes; t++) {
        p->own[t] = (double)node[t].samples * node[t].impurity / (double)node[0].samples;
        if (node[t].left == 0) continue;
        p->parent[node[t].left] = p->parent[node[t].right] = t;
    }
    for (uint32_t t = p->nodes; t-- > 0;) {
        if (node[t].left == 0) {
            p->leaves[t] = 1;
            p->branch[t] = p->own[t];
            p->end[t] = t + 1;
        }
        if (t == 0) break;
        if (p->end[p->parent[t]] == 0) p->end[p->parent[t]] = p->end[t]; /* the right child comes first */
        p->leaves[p->parent[t]] += p->leaves[t];
        p->branch[p->parent[t]] += p->branch[t];
    }
    for (uint32_t i = 0; i < 2 * p->base; i++) p->link[i] = (double)INFINITY;
    for (uint32_t t = 0; t < p->nodes; t++) p->link[p->base + t] = link_of(p, t);
    for (uint32_t i = p->base; i-- > 1;) p->link[i] = fmin(p->link[2 * i], p->link[2 * i + 1]);
    return LG_OK;
}

/* Removes all nodes below t from the current tree. */
static void remove_below(pruner *p, uint32_t t) {
    for (uint32_t i = t + 1; i < p->end[t]; i = p->cut[i] ? p->end[i] : i + 1) {
        p->nodes--;
        p->leaves[i] = 0;
        play(p, i);
    }
}

/* Cuts the weakest link if its alpha is at most `limit`, and returns whether it did. The alphas of successive
 * cuts never fall. */
static bool cut_weakest(pruner *p, double limit) {
    const uint32_t t = weakest(p);
    if (t == NO_NODE) return false;
    const double alpha = fmax(p->alpha, link_of(p, t));
    if (!(alpha <= limit)) return false;
    const uint32_t fewer = p->leaves[t] - 1;
    const double more = p->own[t] - p->branch[t];
    remove_below(p, t);
    p->cut[t] = true;
    for (uint32_t i = t; i != NO_NODE; i = p->parent[i]) {
        p->leaves[i] -= fewer;
        p->branch[i] += more;
        play(p, i);
    }
    p->branch[t] = p->own[t];
    p->alpha = alpha;
    return true;
}

lg_status lg_tree_pruning_path(const lg_context *context, const lg_tree *tree, size_t room,
                               lg_pruning_step *steps, size_t *count) {
    if (tree == NULL || tree->count == 0 || count == NULL || (steps == NULL && room > 0))
        return LG_INVALID_ARGUMENT;
    pruner p = {.context = context};
    const lg_status status = pruner_create(&p, tree);
    if (status == LG_OK) {
        size_t done = 0;
        do {
            if (done < room) steps[done] = (lg_pruning_step){p.alpha, p.branch[0], p.nodes};
            done++;
        } while (cut_weakest(&p, (double)INFINITY));
        *count = done;
    }
    pruner_free(&p);
    return status;
}

lg_status lg_tree_prune(const lg_context *context, const lg_tree *tree, double alpha, lg_tree *out) {
    if (tree == NULL || tree->count == 0 || out == NULL || !(alpha >= 0.0)) return LG_INVALID_ARGUMENT;
    pruner p = {.context = context};
    lg_status status = pruner_create(&p, tree);
    if (status == LG_OK) {
        while (cut_weakest(&p, alpha)) {
        }
        status = lg_tree_compact(context, p.tree, p.cut, out);
    }
    pruner_free(&p);
    return status;
}
