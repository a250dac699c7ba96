/* Classification trees: Breiman, Friedman, Olshen, Stone, "Classification and Regression Trees" (1984).
 *
 * Each column of the table is sorted once. A node owns the same range of positions in every column. When a
 * node is split, its range in each column is partitioned, and both parts keep their order; so a level of the
 * tree costs O(d n). A column whose values are all equal within a node is neither searched nor partitioned
 * from that node on. Its range may then hold rows of the sibling node, which is harmless because all values
 * in the range are equal. */
#include "anomaly/classify/classify_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/widen.h"

/* ---- names, options ---- */

static const char *const criterion_names[LG_CRITERION_COUNT] = {"gini", "entropy"};

const char *lg_tree_criterion_name(lg_tree_criterion criterion) {
    return (unsigned)criterion < LG_CRITERION_COUNT ? criterion_names[criterion] : "unknown";
}

void lg_tree_options_init(lg_tree_options *options) {
    *options = (lg_tree_options){
        .size = sizeof *options, .criterion = LG_GINI, .min_samples_split = 2, .min_samples_leaf = 1};
}

/* ---- growing ---- */

typedef struct item {
    double value;
    uint32_t row, label;
} item;

/* A node that waits to be split. It owns the positions first .. last - 1 of every column. */
typedef struct task {
    uint32_t node, first, last, depth;
} task;

typedef struct split {
    bool found;
    uint32_t feature, position; /* first position of the right part */
    double threshold, score;    /* a higher score is better */
} split;

typedef struct grower {
    const lg_context *context;
    lg_tree_options options;
    size_t n;
    item *items;            /* (d, n): sorted columns */
    item *spare;            /* (n): work memory */
    uint8_t *side;          /* (n), indexed by row: 1 if the row goes right */
    double *i_log_i;        /* (n + 1): i log2(i), for the entropy criterion only */
    uint32_t *left, *right; /* (classes): rows of each class on either side of a split */
    task *stack;            /* (n): enough, as tasks are disjoint non-empty ranges of rows */
    size_t tasks;
    lg_tree tree;
    uint32_t room; /* number of nodes for which there is memory */
} grower;

static double impurity_of(lg_tree_criterion criterion, const uint32_t *counts, uint32_t classes,
                          uint32_t samples) {
    const double n = samples;
    double sum = 0.0;
    for (uint32_t k = 0; k < classes; k++) {
        const double c = counts[k];
        if (criterion == LG_GINI)
            sum += c * c;
        else if (counts[k] > 0)
            sum -= c / n * log2(c / n);
    }
    return criterion == LG_GINI ? 1.0 - sum / (n * n) : sum;
}

/* Makes room for two more nodes. */
static lg_status reserve(grower *g) {
    lg_tree *tree = &g->tree;
    if (tree->count + 2 <= g->room) return LG_OK;
    const uint32_t room = g->room < 32 ? 64 : 2 * g->room;
    lg_tree_node *node = lg_widen(g->context, tree->node, tree->count, room, sizeof *node);
    if (node == NULL) return LG_OUT_OF_MEMORY;
    tree->node = node;
    uint32_t *counts = lg_widen(g->context, tree->counts, (size_t)tree->count * tree->classes,
                                (size_t)room * tree->classes, sizeof *counts);
    if (counts == NULL) return LG_OUT_OF_MEMORY;
    tree->counts = counts;
    g->room = room;
    return LG_OK;
}

static bool may_split(const grower *g, const lg_tree_node *node, const uint32_t *counts, uint32_t depth) {
    const lg_tree_options *o = &g->options;
    if (o->max_depth != 0 && depth >= o->max_depth) return false;
    if (node->samples < o->min_samples_split || node->samples / 2 < o->min_samples_leaf) return false;
    for (uint32_t k = 0; k < g->tree.classes; k++)
        if (counts[k] == node->samples) return false;
    return true;
}

/* Appends a leaf to the tree. If the leaf may be split, also pushes a task for it and returns true. */
static bool add_node(grower *g, const uint32_t *counts, uint32_t first, uint32_t last, uint32_t depth) {
    lg_tree *tree = &g->tree;
    const uint32_t index = tree->count++;
    uint32_t *own = &tree->counts[(size_t)index * tree->classes];
    memcpy(own, counts, tree->classes * sizeof *own);
    tree->node[index] = (lg_tree_node){
        .impurity = impurity_of(tree->criterion, own, tree->classes, last - first), .samples = last - first};
    if (!may_split(g, &tree->node[index], own, depth)) return false;
    g->stack[g->tasks++] = (task){index, first, last, depth};
    return true;
}

/* Returns the middle between both values, or the lower value if the middle rounds to the upper one. */
static double between(double lower, double upper) {
    const double middle = 0.5 * lower + 0.5 * upper;
    return middle >= lower && middle < upper ? middle : lower;
}

static double entropy_score(const grower *g, const uint32_t *counts, uint32_t samples) {
    double sum = 0.0;
    for (uint32_t k = 0; k < g->tree.classes; k++) sum += g->i_log_i[counts[k]];
    return sum - g->i_log_i[samples];
}

/* Finds the best split of a column. The score by entropy is minus the sum of samples times impurity over both
 * sides. The Gini score is the sum of |counts|^2/samples over both sides. (The Gini impurity of the split
 * times the number of samples is the number of samples minus the score.) */
static void search(grower *g, const task *t, uint32_t feature, split *best) {
    const item *column = &g->items[(size_t)feature * g->n];
    const uint32_t samples = t->last - t->first, leaf = g->options.min_samples_leaf;
    const bool gini = g->tree.criterion == LG_GINI;
    uint32_t *left = g->left, *right = g->right;
    uint64_t left_squares = 0, right_squares = 0;
    for (uint32_t k = 0; k < g->tree.classes; k++) right_squares += (uint64_t)right[k] * right[k];
    for (uint32_t p = t->first; p + 1 < t->last; p++) {
        const uint32_t k = column[p].label, done = p + 1 - t->first;
        left_squares += 2 * (uint64_t)left[k]++ + 1;
        right_squares -= 2 * (uint64_t)right[k]-- - 1;
        if (column[p].value == column[p + 1].value || done < leaf || samples - done < leaf) continue;
        const double score = gini ? (double)left_squares / done + (double)right_squares / (samples - done)
                                  : entropy_score(g, left, done) + entropy_score(g, right, samples - done);
        if (!best->found || score > best->score)
            *best = (split){true, feature, p + 1, between(column[p].value, column[p + 1].value), score};
    }
}

static bool is_constant(const grower *g, const task *t, uint32_t feature) {
    const item *column = &g->items[(size_t)feature * g->n];
    return column[t->first].value == column[t->last - 1].value;
}

static split find_split(grower *g, const task *t) {
    const uint32_t classes = g->tree.classes;
    split best = {.found = false};
    for (uint32_t j = 0; j < g->tree.inputs; j++) {
        if (is_constant(g, t, j)) continue;
        memset(g->left, 0, classes * sizeof *g->left);
        memcpy(g->right, &g->tree.counts[(size_t)t->node * classes], classes * sizeof *g->right);
        search(g, t, j, &best);
    }
    return best;
}

/* In every column that is not constant, moves the rows of the left child to the front. Both parts keep their
 * order. */
static void partition(grower *g, const task *t) {
    for (uint32_t j = 0; j < g->tree.inputs; j++) {
        if (is_constant(g, t, j)) continue;
        item *column = &g->items[(size_t)j * g->n];
        uint32_t kept = t->first, moved = 0;
        for (uint32_t p = t->first; p < t->last; p++) {
            const item one = column[p];
            const uint32_t right = g->side[one.row];
            column[kept] = one;
            g->spare[moved] = one;
            kept += 1 - right;
            moved += right;
        }
        memcpy(&column[kept], g->spare, moved * sizeof *column);
    }
}

/* Splits a node. Its children become leaves, or tasks if they may be split; the left child's task is on top
 * of the stack. */
static lg_status split_node(grower *g, const task *t, const split *s) {
    const uint32_t classes = g->tree.classes;
    const item *column = &g->items[(size_t)s->feature * g->n];
    LG_TRY(reserve(g));
    memset(g->left, 0, classes * sizeof *g->left);
    memcpy(g->right, &g->tree.counts[(size_t)t->node * classes], classes * sizeof *g->right);
    for (uint32_t p = t->first; p < t->last; p++) {
        g->side[column[p].row] = p >= s->position;
        if (p >= s->position) continue;
        g->left[column[p].label]++;
        g->right[column[p].label]--;
    }
    lg_tree_node *node = &g->tree.node[t->node];
    node->feature = s->feature;
    node->threshold = s->threshold;
    node->left = g->tree.count;
    node->right = g->tree.count + 1;
    bool more = add_node(g, g->left, t->first, s->position, t->depth + 1);
    more = add_node(g, g->right, s->position, t->last, t->depth + 1) || more;
    if (more) partition(g, t);
    return LG_OK;
}

static lg_status grow(grower *g, const uint32_t *label) {
    LG_TRY(reserve(g));
    memset(g->left, 0, g->tree.classes * sizeof *g->left);
    for (size_t i = 0; i < g->n; i++) g->left[label[i]]++;
    (void)add_node(g, g->left, 0, (uint32_t)g->n, 0);
    while (g->tasks > 0) {
        const task t = g->stack[--g->tasks];
        if (lg_cancelled(g->context)) return LG_CANCELLED;
        const split s = find_split(g, &t);
        if (s.found) LG_TRY(split_node(g, &t, &s));
    }
    return LG_OK;
}

/* By rising value, equal values by rising row. */
static int by_value(const void *a, const void *b) {
    const item *x = a, *y = b;
    if (x->value != y->value) return x->value < y->value ? -1 : 1;
    return (x->row > y->row) - (x->row < y->row);
}

static void fill_columns(grower *g, const double *x, const uint32_t *label) {
    const uint32_t d = g->tree.inputs;
    for (uint32_t j = 0; j < d; j++) {
        item *column = &g->items[(size_t)j * g->n];
        for (size_t i = 0; i < g->n; i++) column[i] = (item){x[i * d + j], (uint32_t)i, label[i]};
        qsort(column, g->n, sizeof *column, by_value);
    }
}

/* ---- public functions ---- */

static lg_status check_options(const lg_tree_options *o, lg_error *error) {
    if (o->size != sizeof *o || (unsigned)o->criterion >= LG_CRITERION_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the options of the tree were not initialised with lg_tree_options_init");
    if (o->min_samples_split < 2)
        return lg_fail(error, LG_INVALID_ARGUMENT, "min_samples_split is %u, expected 2 or more",
                       o->min_samples_split);
    if (o->min_samples_leaf < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "min_samples_leaf is 0, expected 1 or more");
    if (!(o->ccp_alpha >= 0.0) || !isfinite(o->ccp_alpha))
        return lg_fail(error, LG_INVALID_ARGUMENT, "ccp_alpha is %g: it must be 0 or a positive number",
                       o->ccp_alpha);
    return LG_OK;
}

static lg_status grower_create(grower *g) {
    const size_t n = g->n;
    const uint32_t classes = g->tree.classes;
    const bool entropy = g->tree.criterion == LG_ENTROPY;
    LG_TRY(LG_ALLOC_ALL(g->context, LG_ARRAY(g->items, n * g->tree.inputs), LG_ARRAY(g->spare, n),
                        LG_ARRAY(g->side, n), LG_ARRAY(g->left, classes), LG_ARRAY(g->right, classes),
                        LG_ARRAY(g->stack, n), LG_ARRAY(g->i_log_i, entropy ? n + 1 : 0)));
    for (size_t i = 2; i <= n && entropy; i++) g->i_log_i[i] = (double)i * log2((double)i);
    return LG_OK;
}

static void grower_free(grower *g) {
    LG_FREE_ALL(g->context, g->items, g->spare, g->side, g->i_log_i, g->left, g->right, g->stack);
    lg_tree_destroy(&g->tree);
}

lg_status lg_tree_fit(const lg_context *context, const lg_tree_options *options, const double *x,
                      const uint32_t *label, size_t n, uint32_t d, uint32_t classes, lg_tree *out,
                      lg_error *error) {
    grower g = {.context = context, .n = n};
    LG_NEEDS(error, options, label, out);
    LG_TRY(check_options(options, error));
    LG_TRY(lg_check_table(x, n, d, error));
    LG_TRY(lg_check_labels(label, n, classes, 1, NULL, error));
    g.options = *options;
    g.tree = (lg_tree){.inputs = d, .classes = classes, .criterion = options->criterion, .context = context};
    lg_status status = grower_create(&g);
    if (status == LG_OK) {
        fill_columns(&g, x, label);
        status = grow(&g, label);
    }
    if (status == LG_OK)
        status = options->ccp_alpha > 0.0 ? lg_tree_prune(context, &g.tree, options->ccp_alpha, out)
                                          : lg_tree_compact(context, &g.tree, NULL, out);
    grower_free(&g);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "growing a tree on %zu rows of %u features: %s", n, d,
                   lg_status_sentence(status));
}

void lg_tree_destroy(lg_tree *tree) {
    if (tree == NULL) return;
    LG_FREE_ALL(tree->context, tree->node, tree->counts);
    *tree = (lg_tree){.inputs = 0};
}

/* Index of the leaf to which x (d) goes. */
static uint32_t leaf_of(const lg_tree *tree, const double *x) {
    uint32_t i = 0;
    while (tree->node[i].left != 0)
        i = x[tree->node[i].feature] <= tree->node[i].threshold ? tree->node[i].left : tree->node[i].right;
    return i;
}

void lg_tree_predict(const lg_tree *tree, const double *x, size_t n, double *probability) {
    const uint32_t classes = tree->classes;
    for (size_t i = 0; i < n; i++) {
        const uint32_t leaf = leaf_of(tree, &x[i * tree->inputs]);
        const uint32_t *counts = &tree->counts[(size_t)leaf * classes];
        const double samples = tree->node[leaf].samples;
        for (uint32_t k = 0; k < classes; k++) probability[i * classes + k] = counts[k] / samples;
    }
}
