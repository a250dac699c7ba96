/* Minimal cost-complexity pruning: Breiman et al. (1984), chapter 3.
 *
 * R(t) = (n_t/n) impurity_t is the cost of node t as a leaf. R(T_t) is the sum of R over the leaves below t,
 * and |T_t| is the number of these leaves. The branch at t is worth keeping as long as alpha is below
 *   g(t) = (R(t) - R(T_t))/(|T_t| - 1).
 * The algorithm cuts the branch with the smallest g, updates R(T) and |T| of its ancestors, and repeats this
 * until only the root is left. */
#include <math.h>
#include <string.h>

#include "anomaly/classify/classify_internal.h"

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
    LG_CLEAN(lg_tree_destroy) lg_tree copy = *tree;
    copy.context = context;
    copy.node = NULL, copy.counts = NULL;
    LG_TRY_SCRATCH(visit, stack, context, (size_t)tree->count + 1, LG_OUT_OF_MEMORY);
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(copy.node, copy.count),
                        LG_ARRAY(copy.counts, (size_t)copy.count * copy.classes)));
    copy_kept(tree, cut, stack, &copy);
    return LG_GIVE(out, copy);
}

/* ---- the weakest links ---- */

/* A node of the current (pruned) tree; nodes that were removed have no leaves. */
typedef struct branch {
    uint32_t parent, leaves, end; /* the nodes below t are t + 1 .. end - 1 */
    double own, below;            /* R(t) and R(T_t) */
} branch;

typedef struct pruner {
    lg_tree tree;
    uint32_t nodes; /* number of nodes of the current tree */
    branch *at;     /* (count) */
    bool *cut;      /* (count): whether the branch was cut */
    double alpha;   /* alpha of the last cut */
} pruner;

static void pruner_free(pruner *p) {
    LG_FREE_ALL(p->tree.context, p->at, p->cut);
    lg_tree_destroy(&p->tree);
}

static lg_status pruner_create(const lg_context *context, const lg_tree *tree, pruner *p) {
    LG_TRY(lg_tree_compact(context, tree, NULL, &p->tree));
    const lg_tree_node *node = p->tree.node;
    p->nodes = p->tree.count;
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(p->at, p->nodes), LG_ARRAY(p->cut, p->nodes)));
    p->at[0].parent = NO_NODE;
    for (uint32_t t = 0; t < p->nodes; t++) {
        p->at[t].own = (double)node[t].samples * node[t].impurity / (double)node[0].samples;
        if (node[t].left != 0) p->at[node[t].left].parent = p->at[node[t].right].parent = t;
    }
    for (uint32_t t = p->nodes; t-- > 0;) {
        branch *b = &p->at[t];
        if (node[t].left == 0) *b = (branch){b->parent, 1, t + 1, b->own, b->own};
        if (t == 0) break;
        branch *parent = &p->at[b->parent];
        if (parent->end == 0) parent->end = b->end; /* the right child comes first */
        parent->leaves += b->leaves;
        parent->below += b->below;
    }
    return LG_OK;
}

/* Cuts the weakest link, the first one if several are equal, if its alpha is at most `limit`, and returns
 * whether it did. The alphas of successive cuts never fall. */
static bool cut_weakest(pruner *p, double limit) {
    double least = (double)INFINITY;
    uint32_t weakest = NO_NODE;
    for (uint32_t t = 0; t < p->tree.count; t++) {
        const branch *b = &p->at[t];
        const double link = b->leaves < 2 ? least : (b->own - b->below) / (double)(b->leaves - 1);
        if (link < least) weakest = t, least = link;
    }
    const double alpha = fmax(p->alpha, least);
    if (weakest == NO_NODE || !(alpha <= limit)) return false;
    const branch top = p->at[weakest];
    for (uint32_t i = weakest + 1; i < top.end; i++) {
        p->nodes -= p->at[i].leaves > 0;
        p->at[i].leaves = 0;
    }
    p->cut[weakest] = true;
    for (uint32_t i = weakest; i != NO_NODE; i = p->at[i].parent) {
        p->at[i].leaves -= top.leaves - 1;
        p->at[i].below += top.own - top.below;
    }
    p->at[weakest].below = top.own;
    p->alpha = alpha;
    return true;
}

lg_status lg_tree_pruning_path(const lg_context *context, const lg_tree *tree, size_t room,
                               lg_pruning_step *steps, size_t *count) {
    if (tree == NULL || tree->count == 0 || count == NULL || (steps == NULL && room > 0))
        return LG_INVALID_ARGUMENT;
    LG_CLEAN(pruner_free) pruner p = {.nodes = 0};
    LG_TRY(pruner_create(context, tree, &p));
    *count = 0;
    do {
        if (*count < room) steps[*count] = (lg_pruning_step){p.alpha, p.at[0].below, p.nodes};
        ++*count;
    } while (cut_weakest(&p, (double)INFINITY));
    return LG_OK;
}

lg_status lg_tree_prune(const lg_context *context, const lg_tree *tree, double alpha, lg_tree *out) {
    if (tree == NULL || tree->count == 0 || out == NULL || !(alpha >= 0.0)) return LG_INVALID_ARGUMENT;
    LG_CLEAN(pruner_free) pruner p = {.nodes = 0};
    LG_TRY(pruner_create(context, tree, &p));
    while (cut_weakest(&p, alpha)) {
    }
    return lg_tree_compact(context, &p.tree, p.cut, out);
}
