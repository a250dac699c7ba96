/* Pictures of methods: explained variance, pruning, trees and ROC curves. */
#include "lg-anomaly/anomaly.h"

enum { SHOWN_DEPTH = 6, SHOWN_VARIANCES = 30 };

lg_status draw_variance(const app *self, const char *picture, const double *variance, size_t count,
                        uint32_t chosen, lg_error *error) {
    app_plot plot;
    double total = 0, sum = 0;
    const size_t shown = count < SHOWN_VARIANCES ? count : SHOWN_VARIANCES;
    app_plot_begin(&plot, "variance", picture, 760, 500);
    app_plot_text(&plot, "%zu", shown);
    app_plot_text(&plot, "%u", chosen);
    for (size_t i = 0; i < count; i++) total += variance[i];
    for (size_t i = 0; i < shown; i++) {
        sum += variance[i];
        (void)fprintf(plot.data, "%zu %.6g %.6g\n", i + 1, total > 0 ? variance[i] / total : 0,
                      total > 0 ? sum / total : 0);
    }
    return app_plot_end(self, &plot, error);
}

lg_status draw_pruning(const app *self, const char *picture, const pruned_tree *trees, size_t count,
                       double chosen, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, "pruning", picture, 1240, 480);
    app_plot_text(&plot, "%.9g", chosen);
    app_plot_text(&plot, "%.9g", trees[count - 1].alpha);
    for (size_t i = 0; i < count; i++)
        (void)fprintf(plot.data, "%.9g %.9g %.9g %u %u\n", trees[i].alpha, trees[i].train_accuracy,
                      trees[i].test_accuracy, trees[i].nodes, trees[i].depth);
    return app_plot_end(self, &plot, error);
}

/* ---- trees: leaves at x = 0, 1, 2, ..., a parent in the middle between its children ---- */

typedef struct tree_layout {
    const lg_tree *tree;
    double *x;
    uint32_t *depth;
    double leaves;
    uint32_t deepest;
} tree_layout;

static bool drawn_leaf(const tree_layout *at, uint32_t node) {
    return at->tree->node[node].left == 0 || at->depth[node] == SHOWN_DEPTH;
}

/* Recursive, but only down to SHOWN_DEPTH. */
static void place(tree_layout *at, uint32_t node, uint32_t depth) {
    at->depth[node] = depth;
    if (depth > at->deepest) at->deepest = depth;
    if (drawn_leaf(at, node)) {
        at->x[node] = at->leaves++;
        return;
    }
    const lg_tree_node *n = &at->tree->node[node];
    place(at, n->left, depth + 1);
    place(at, n->right, depth + 1);
    at->x[node] = 0.5 * (at->x[n->left] + at->x[n->right]);
}

static uint32_t majority(const lg_tree *tree, uint32_t node) {
    const uint32_t *counts = tree->counts + (size_t)node * tree->classes;
    uint32_t best = 0;
    for (uint32_t c = 1; c < tree->classes; c++)
        if (counts[c] > counts[best]) best = c;
    return best;
}

static void put_edges(app_plot *plot, const tree_layout *at) {
    for (uint32_t node = 0; node < at->tree->count; node++) {
        if (at->x[node] < 0 || drawn_leaf(at, node)) continue;
        const uint32_t ends[] = {at->tree->node[node].left, at->tree->node[node].right};
        for (size_t e = 0; e < 2; e++)
            (void)fprintf(plot->data, "%.4f %u\n%.4f %u\n\n", at->x[node], at->depth[node], at->x[ends[e]],
                          at->depth[ends[e]]);
    }
    (void)fputs("NaN NaN\n", plot->data);
    app_plot_block(plot);
}

/* Writes the box of a node: its colour's numbers, its text and its place. */
static void put_box(app_plot *plot, const tree_layout *at, uint32_t node, char *const *column_name,
                    char (*class_name)[LG_SERIES_NAME]) {
    const lg_tree *tree = at->tree;
    const lg_tree_node *n = &tree->node[node];
    const uint32_t class = majority(tree, node),
                   of_class = tree->counts[(size_t)node * tree->classes + class];
    if (n->left != 0) {
        app_plot_text(plot, "%s", column_name[n->feature]);
        app_plot_text(plot, " <= %.4g\n%.3f  n = %u", n->threshold, n->impurity, n->samples);
    } else {
        app_plot_text(plot, "%s", class_name[class]);
        app_plot_text(plot, "\n%.3f  n = %u", n->impurity, n->samples);
    }
    app_plot_text(plot, "%.4f", at->x[node]);
    app_plot_text(plot, "%u", at->depth[node]);
    (void)fprintf(plot->data, "%.4f %u %u %.4g\n", at->x[node], at->depth[node], class + 1,
                  n->samples == 0 ? 0 : of_class / (double)n->samples);
}

lg_status draw_tree(const app *self, const char *picture, const lg_tree *tree,
                    char (*class_name)[LG_SERIES_NAME], char *const *column_name, lg_error *error) {
    app_plot plot;
    APP_FREE double *x = app_alloc(tree->count, sizeof *x);
    APP_FREE uint32_t *depth = app_alloc(tree->count, sizeof *depth);
    tree_layout at = {.tree = tree, .x = x, .depth = depth};
    for (uint32_t i = 0; i < tree->count; i++) x[i] = -1;
    place(&at, 0, 0);
    const uint32_t leaves = (uint32_t)at.leaves;
    app_plot_begin(&plot, "tree", picture, 160 + 150 * (int)leaves, 120 + 96 * (int)at.deepest);
    const uint32_t numbers[] = {leaves, at.deepest, lg_tree_depth(tree), tree->count, 2 * leaves - 1};
    for (size_t k = 0; k < LG_COUNT(numbers); k++) app_plot_text(&plot, "%u", numbers[k]);
    put_edges(&plot, &at);
    for (uint32_t i = 0; i < tree->count; i++)
        if (x[i] >= 0) put_box(&plot, &at, i, column_name, class_name);
    return app_plot_end(self, &plot, error);
}

lg_status draw_roc(const app *self, const char *picture, const roc_curve *curves, size_t count,
                   lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, "roc", picture, 640, 600);
    app_plot_text(&plot, "%zu", count);
    for (size_t i = 0; i < count; i++) {
        app_plot_text(&plot, "%s, area %.4f", curves[i].name, curves[i].auc);
        for (size_t k = 0; k < curves[i].points; k++)
            (void)fprintf(plot.data, "%.9g %.9g\n", curves[i].fpr[k], curves[i].tpr[k]);
        app_plot_block(&plot);
    }
    return app_plot_end(self, &plot, error);
}
