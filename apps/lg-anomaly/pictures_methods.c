/* Pictures of methods: explained variance, pruning, trees, confusion matrices and ROC curves. */
#include "lg-anomaly/pictures.h"

#include <math.h>
#include <stdlib.h>

enum { SHOWN_DEPTH = 6, SHOWN_VARIANCES = 30 };

lg_status draw_variance(const app *self, const char *picture, const double *variance, size_t count,
                        uint32_t chosen, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 760, 500);
    FILE *script = plot.script.stream;
    double total = 0, sum = 0;
    for (size_t i = 0; i < count; i++) total += variance[i];
    const size_t shown = count < SHOWN_VARIANCES ? count : SHOWN_VARIANCES;
    for (size_t i = 0; i < shown; i++) {
        sum += variance[i];
        (void)fprintf(plot.data.stream, "%zu %.6g %.6g\n", i + 1, total > 0 ? variance[i] / total : 0,
                      total > 0 ? sum / total : 0);
    }
    (void)fprintf(script,
                  "set xlabel 'component'\nset ylabel 'part of the variance'\nset yrange [0:1.05]\n"
                  "set xrange [0.3:%zu.7]\nset boxwidth 0.7\nset key center right\n",
                  shown);
    if (chosen > 0 && chosen <= shown)
        (void)fprintf(script, "set arrow from %u.5,0 to %u.5,1.05 nohead dt 2 lc rgb '#777777'\n", chosen,
                      chosen);
    (void)fprintf(
        script,
        "plot datafile using 1:2 with boxes fs solid 0.6 lc rgb '%s' title 'each', datafile using 1:3 "
        "with linespoints pt 7 ps 0.6 lw 1.5 lc rgb '%s' title 'running sum'\n",
        class_colour(0), class_colour(1));
    return app_plot_end(self, &plot, error);
}

lg_status draw_pruning(const app *self, const char *picture, const pruned_tree *trees, size_t count,
                       double chosen, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 1240, 480);
    FILE *script = plot.script.stream;
    for (size_t i = 0; i < count; i++)
        (void)fprintf(plot.data.stream, "%.9g %.9g %.9g %u %u\n", trees[i].alpha, trees[i].train_accuracy,
                      trees[i].test_accuracy, trees[i].nodes, trees[i].depth);
    (void)fputs("set multiplot layout 1,2\nset xlabel 'alpha'\nset ylabel 'accuracy'\nset key bottom left\n",
                script);
    /* The last trees have a far larger alpha and would squeeze the others. */
    if (chosen > 0 && trees[count - 1].alpha > 12 * chosen)
        (void)fprintf(script, "set xrange [0:%.9g]\n", 12 * chosen);
    (void)fprintf(script, "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead dt 2 lc rgb '#777777'\n",
                  chosen, chosen);
    (void)fprintf(
        script,
        "plot datafile using 1:2 with steps lw 2 lc rgb '%s' title 'training', datafile using 1:3 with "
        "steps lw 2 lc rgb '%s' title 'test'\n",
        class_colour(0), class_colour(1));
    (void)fprintf(
        script,
        "set ylabel 'nodes'\nset logscale y\nset y2label 'depth'\nset y2tics\nset ytics nomirror\n"
        "set key top right\nplot datafile using 1:4 with steps lw 2 lc rgb '%s' title 'nodes', datafile "
        "using 1:5 axes x1y2 with steps lw 1.5 dt 2 lc rgb '%s' title 'depth'\nunset multiplot\n",
        class_colour(0), class_colour(2));
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

/* Mixes `part` of the colour with white; writes #rrggbb. */
static void pale(const char *colour, double part, char out[8]) {
    const unsigned long rgb = strtoul(colour + 1, NULL, 16);
    (void)snprintf(out, 8, "#");
    for (int shift = 16, at = 1; shift >= 0; shift -= 8, at += 2)
        (void)snprintf(out + at, 3, "%02x",
                       (unsigned)(255.5 - part * (255.0 - (double)((rgb >> shift) & 255))) & 255);
}

static void put_node(FILE *script, const tree_layout *at, uint32_t node, char *const *column_name,
                     char (*class_name)[LG_SERIES_NAME], int object) {
    const lg_tree *tree = at->tree;
    const lg_tree_node *n = &tree->node[node];
    const uint32_t class = majority(tree, node);
    const double pure =
        n->samples == 0 ? 0 : (double)tree->counts[(size_t)node * tree->classes + class] / (double)n->samples;
    char text[256];
    if (n->left != 0)
        (void)snprintf(text, sizeof text, "%.40s <= %.4g\n%.3f  n = %u", column_name[n->feature],
                       n->threshold, n->impurity, n->samples);
    else
        (void)snprintf(text, sizeof text, "%.40s\n%.3f  n = %u", class_name[class], n->impurity, n->samples);
    char fill[8];
    pale(class_colour(class), 0.1 + 0.6 * pure, fill);
    (void)fprintf(script,
                  "set object %d rect center %.4f,%u size 0.94,0.5 fc rgb '%s' fs solid 1 border lc rgb "
                  "'#444444' front\nset label %d ",
                  object, at->x[node], at->depth[node], fill, object);
    (void)fputc('"', script);
    for (const char *p = text; *p != '\0'; p++) {
        if (*p == '\n')
            (void)fputs("\\n", script);
        else if (*p == '"' || *p == '\\')
            (void)fprintf(script, "\\%c", *p);
        else
            (void)fputc(*p, script);
    }
    (void)fprintf(script, "\" at %.4f,%u center noenhanced font ',8' front offset 0,0.4\n", at->x[node],
                  at->depth[node]);
}

static void put_tree(app_plot *plot, const tree_layout *at, char (*class_name)[LG_SERIES_NAME],
                     char *const *column_name) {
    int object = 1;
    for (uint32_t node = 0; node < at->tree->count; node++) {
        if (at->x[node] < 0) continue;
        put_node(plot->script.stream, at, node, column_name, class_name, object++);
        if (drawn_leaf(at, node)) continue;
        const uint32_t ends[] = {at->tree->node[node].left, at->tree->node[node].right};
        for (size_t e = 0; e < 2; e++)
            (void)fprintf(plot->data.stream, "%.4f %u\n%.4f %u\n\n", at->x[node], at->depth[node],
                          at->x[ends[e]], at->depth[ends[e]]);
    }
    (void)fputs("NaN NaN\n", plot->data.stream);
}

lg_status draw_tree(const app *self, const char *picture, const lg_tree *tree,
                    char (*class_name)[LG_SERIES_NAME], char *const *column_name, lg_error *error) {
    app_plot plot;
    APP_FREE double *x = app_alloc(tree->count, sizeof *x);
    APP_FREE uint32_t *depth = app_alloc(tree->count, sizeof *depth);
    tree_layout at = {.tree = tree, .x = x, .depth = depth};
    for (uint32_t i = 0; i < tree->count; i++) x[i] = -1;
    place(&at, 0, 0);
    app_plot_begin(&plot, picture, 160 + 150 * (int)at.leaves, 120 + 96 * (int)at.deepest);
    put_tree(&plot, &at, class_name, column_name);
    FILE *script = plot.script.stream;
    const uint32_t levels = lg_tree_depth(tree);
    (void)fputs("unset key\nunset border\nunset tics\nunset grid\n", script);
    if (levels > SHOWN_DEPTH)
        (void)fprintf(script, "set title 'the first %d of %u levels, %u nodes'\n", SHOWN_DEPTH, levels,
                      tree->count);
    (void)fprintf(
        script, "set xrange [-0.7:%.4f]\nset yrange [%u.5:-0.5]\nplot datafile with lines lc rgb '#666666'\n",
        at.leaves - 0.3, at.deepest);
    return app_plot_end(self, &plot, error);
}

/* ---- confusion matrices and ROC curves ---- */

lg_status draw_confusion(const app *self, const char *picture, const uint64_t *confusion, uint32_t classes,
                         char (*class_name)[LG_SERIES_NAME], lg_error *error) {
    app_plot plot;
    const int size = 220 + 110 * (int)(classes < 12 ? classes : 12);
    app_plot_begin(&plot, picture, size + 60, size);
    FILE *script = plot.script.stream;
    for (uint32_t row = 0; row < classes; row++) {
        uint64_t total = 0;
        for (uint32_t j = 0; j < classes; j++) total += confusion[(size_t)row * classes + j];
        for (uint32_t j = 0; j < classes; j++) {
            const uint64_t n = confusion[(size_t)row * classes + j];
            const double part = total == 0 ? 0 : (double)n / (double)total;
            (void)fprintf(plot.data.stream, "%u %u %.6g %llu\n", j, row, part, (unsigned long long)n);
            (void)fprintf(script, "set label \"%llu\\n%.1f %%\" at %u,%u center front tc rgb '%s'\n",
                          (unsigned long long)n, 100 * part, j, row, part > 0.55 ? "#ffffff" : "#222222");
        }
    }
    for (int axis = 0; axis < 2; axis++) {
        (void)fprintf(script, "set %ctics (", axis == 0 ? 'x' : 'y');
        for (uint32_t c = 0; c < classes; c++) {
            (void)fputs(c == 0 ? "\"" : ", \"", script);
            for (const char *p = class_name[c]; *p != '\0'; p++)
                if (*p != '"' && *p != '\\') (void)fputc(*p, script);
            (void)fprintf(script, "\" %u", c);
        }
        (void)fputs(") noenhanced\n", script);
    }
    (void)fprintf(script,
                  "unset key\nunset colorbox\nunset grid\nset xlabel 'given'\nset ylabel 'true'\n"
                  "set xrange [-0.5:%u.5]\nset yrange [%u.5:-0.5]\nset cbrange [0:1]\n"
                  "set palette defined (0 '#f4f7fb', 1 '#1f5fa8')\nset size square\n"
                  "plot datafile using 1:2:3 with image pixels\n",
                  classes - 1, classes - 1);
    return app_plot_end(self, &plot, error);
}

lg_status draw_roc(const app *self, const char *picture, const roc_curve *curves, size_t count,
                   lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 640, 600);
    FILE *script = plot.script.stream;
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < curves[i].points; k++)
            (void)fprintf(plot.data.stream, "%.9g %.9g\n", curves[i].fpr[k], curves[i].tpr[k]);
        if (curves[i].points == 0) (void)fputs("NaN NaN\n", plot.data.stream);
        app_plot_block(&plot);
    }
    (void)fputs("set xlabel 'false positive rate'\nset ylabel 'true positive rate'\nset xrange [0:1]\n"
                "set yrange [0:1.01]\nset size square\nset key bottom right\nplot x with lines dt 3 lc rgb "
                "'#999999' notitle",
                script);
    for (size_t i = 0; i < count; i++) {
        char title[LG_SERIES_NAME + 40];
        (void)snprintf(title, sizeof title, "%.60s, area %.4f", curves[i].name, curves[i].auc);
        (void)fprintf(script, ", datafile index %zu with lines lw 2 lc rgb '%s' title ", i, class_colour(i));
        put_text(script, title);
    }
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, error);
}
