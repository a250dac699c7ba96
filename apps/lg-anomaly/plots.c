/* Plots of a model and its windows, by name. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "lg-anomaly/train.h"

enum { SHOWN_COLUMNS = 8, SHOWN_DEPTH = 6, SHOWN_LINES = 150, SHOWN_POINTS = 4000 };

static void no_plot(const char *why) {
    app_stop(app_running(), LG_FILE, "%s: %s", app_plot_given.plot, why);
}

/* Chooses at most SHOWN_POINTS windows, evenly spaced. */
static size_t shown(const lg_judgement *judged) {
    if (judged->count == 0) no_plot("there are no windows to draw");
    return judged->count < SHOWN_POINTS ? judged->count : (size_t)SHOWN_POINTS;
}
static size_t chosen(const lg_judgement *judged, size_t i) {
    return i * judged->count / shown(judged);
}

/* Computes the features of evaluated window `at`. x and work are memory for the window and its features. */
static void features_of(const viewing *v, size_t at, float *x, double *f, void *work) {
    lg_windows_copy(&v->from->data.series, &v->from->windows, v->judged->window[at], x);
    app_must_file(app_running(), lg_features_compute(&v->model->file.classifier.features, x, f, work), NULL,
                  app_plot_given.plot);
}

/* ---- points by class ---- */

/* The model's channel names are used if the file has none. */
static char *column_name(const viewing *v, bool reduced, uint32_t c) {
    char name[160];
    lg_series series = v->from->data.series;
    if (series.channel_name == NULL) series.channel_name = v->model->file.names.channel_name;
    if (reduced) return app_format("component %u", c + 1);
    (void)lg_features_name(&v->model->file.classifier.features, &series, c, name, sizeof name);
    return app_format("%s", name);
}

static void put_class_names(app_plot *plot, const viewing *v) {
    const lg_series *names = &v->model->file.names;
    for (uint32_t c = 0; c < names->classes; c++) app_plot_text(plot, "%s", names->class_name[c]);
}

/* The line w.x + b = 0 on which a network with two numbers before its output finds both classes equally
 * likely: its two logits are equal, or its only logit is 0. False: there is no such line. */
static bool output_line(const well_model *model, double w[2], double *b) {
    const lg_cnn *net = &model->network.run.model.net;
    const double *theta = model->network.theta, *weight = NULL, *bias = NULL;
    lg_slice_info slice;
    for (uint32_t i = 0; lg_cnn_slice(net, i, &slice); i++) {
        if (strcmp(slice.name, "output/weight") == 0) weight = theta + slice.offset;
        if (strcmp(slice.name, "output/bias") == 0) bias = theta + slice.offset;
    }
    if (weight == NULL || bias == NULL || model->file.names.classes != 2) return false;
    const uint32_t n = net->outputs; /* weight is (2, n) */
    for (int d = 0; d < 2; d++) w[d] = n == 1 ? weight[d] : weight[2 * d + 1] - weight[2 * d];
    *b = n == 1 ? bias[0] : bias[1] - bias[0];
    return w[0] != 0 || w[1] != 0;
}

/* Draws the features of the windows (pairs), their principal components (clouds, margin), or the two numbers
 * before the output of a network (plane); with the plane or line w.x + b = 0 of margin and plane. */
static void put_points(app_plot *plot, const void *view) {
    const viewing *v = view;
    const bool plane = strcmp(plot->kind, "plane") == 0, margin = strcmp(plot->kind, "margin") == 0;
    const bool pairs = strcmp(plot->kind, "pairs") == 0;
    const lg_classifier *classifier = &v->model->file.classifier;
    const lg_features *features = &classifier->features;
    const lg_pca *pca = &classifier->pca;
    const bool reduced = !pairs && !plane && pca->components > 0;
    const uint32_t all = plane     ? 2
                         : reduced ? pca->components
                                   : features->count,
                   most = pairs ? (uint32_t)SHOWN_COLUMNS : 3, columns = all < most ? all : most;
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE double *f = app_alloc(3 * (size_t)features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    APP_FREE double *seen = app_alloc(v->judged->classes, sizeof *seen);
    double w[3], b = 0, *reduction = f + features->count;
    bool known = plane && output_line(v->model, w, &b);
    if (margin) {
        app_must_file(app_running(), lg_svm_plane(&classifier->svm, w, &b), NULL, app_plot_given.plot);
        known = true;
    }
    app_plot_text(plot, "%u\t%u", columns, v->judged->classes);
    for (uint32_t c = 0; c < columns; c++) {
        APP_FREE char *name =
            plane ? app_format("output %u of the last hidden layer", c + 1) : column_name(v, reduced, c);
        app_plot_text(plot, "%s", name);
    }
    put_class_names(plot, v);
    app_plot_text(plot, "%s\t%.9g", plot->kind, b);
    for (uint32_t k = 0; known && k < columns; k++) app_plot_text(plot, "%.9g", w[k]);
    for (size_t i = 0; i < shown(v->judged); i++) {
        const size_t at = chosen(v->judged, i), class = v->judged->truth[at];
        const double head[2] = {(double)class + 1, seen[class]++};
        if (!plane) features_of(v, at, x, f, work);
        if (reduced) lg_pca_eval(pca, f, 1, reduction, reduction + features->count);
        const double *row = plane ? v->judged->plane + 2 * at : reduced ? reduction : f;
        APP_PLOT_COLUMNS(plot, 9, 1, {head, 0, 2}, {row, 0, columns});
    }
}

/* ---- what methods have learned ---- */

static void put_variance(app_plot *plot, const void *view) {
    const viewing *v = view;
    const lg_pca *pca = &v->model->file.classifier.pca;
    app_plot_text(plot, "%u", pca->components);
    APP_PLOT_COLUMNS(plot, 9, pca->variances, {pca->variance, 1, 1});
}

/* Writes a node after its children, down to SHOWN_DEPTH: the line of its box and of the lines to its
 * children, and its two texts. Leaves are at x = 0, 1, 2, ..., a parent is in the middle between its
 * children. Returns x. */
static double put_node(app_plot *plot, const viewing *v, uint32_t node, uint32_t depth, double *leaves) {
    const lg_classifier *classifier = &v->model->file.classifier;
    const lg_tree *tree = &classifier->tree;
    const lg_tree_node *n = &tree->node[node];
    const uint32_t *counts = tree->counts + (size_t)node * tree->classes;
    const bool leaf = n->left == 0 || depth == SHOWN_DEPTH;
    const double left = leaf ? (double)NAN : put_node(plot, v, n->left, depth + 1, leaves),
                 right = leaf ? (double)NAN : put_node(plot, v, n->right, depth + 1, leaves),
                 x = leaf ? (*leaves)++ : 0.5 * (left + right);
    uint32_t class = 0;
    for (uint32_t c = 1; c < tree->classes; c++)
        if (counts[c] > counts[class]) class = c;
    if (n->left != 0) {
        APP_FREE char *name = column_name(v, classifier->pca.components > 0, n->feature);
        app_plot_text(plot, "%s\t <= %.4g\n%.3f  n = %u", name, n->threshold, n->impurity, n->samples);
    } else {
        app_plot_text(plot, "%s\t\n%.3f  n = %u", v->model->file.names.class_name[class], n->impurity,
                      n->samples);
    }
    APP_PLOT_ROW(plot, 6, x, depth, class + 1, n->samples == 0 ? 0 : counts[class] / (double)n->samples, left,
                 right);
    return x;
}

static void put_tree(app_plot *plot, const void *view) {
    const viewing *v = view;
    const lg_tree *tree = &v->model->file.classifier.tree;
    double leaves = 0;
    app_plot_text(plot, "%u\t%u", tree->depth, tree->count);
    (void)put_node(plot, v, 0, 0, &leaves);
}

static double deviation_of(const float *x, size_t n) {
    double mean = 0, square = 0;
    for (size_t t = 0; t < n; t++) mean += (double)x[t] / (double)n;
    for (size_t t = 0; t < n; t++) square += ((double)x[t] - mean) * ((double)x[t] - mean);
    return sqrt(square / (double)n);
}

/* Writes the regression line of each window and the range of the accelerations of its segments. */
static void put_regressions(app_plot *plot, const void *view) {
    const viewing *v = view;
    const lg_features *features = &v->model->file.classifier.features;
    APP_FREE double *f = app_alloc(features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE size_t *of_class = app_alloc(v->judged->classes, sizeof *of_class);
    const size_t n = features->length, parts = features->segments, first = features->pair[0];
    const size_t every = shown(v->judged) / ((size_t)SHOWN_LINES * v->judged->classes) + 1;
    app_plot_text(plot, "%u", v->judged->classes);
    put_class_names(plot, v);
    for (size_t i = 0; i < shown(v->judged); i += every) {
        const size_t at = chosen(v->judged, i), class = v->judged->truth[at];
        double least = DBL_MAX, most = -DBL_MAX;
        if (of_class[class]++ >= SHOWN_LINES) continue;
        features_of(v, at, x, f, work);
        for (size_t s = 0, begin = 0, end; s < parts; s++, begin = end) {
            end = (s + 1) * n / parts;
            const double own = deviation_of(x + first * n + begin, end - begin) / features->scale[first];
            least = fmin(least, own);
            most = fmax(most, own);
        }
        APP_PLOT_ROW(plot, 9, (double)class + 1, f[0], f[1], least, most);
    }
}

/* ---- outcomes ---- */

static void put_confusion(app_plot *plot, const void *view) {
    const viewing *v = view;
    if (shown(v->judged) > 0)
        app_plot_confusion(plot, "", v->judged->confusion, v->judged->classes,
                           v->model->file.names.class_name);
}

static void put_roc(app_plot *plot, const void *view) {
    const viewing *v = view;
    const lg_judgement *judged = v->judged;
    const size_t n = judged->count, room = n + 1;
    /* Of two classes one curve says all: that of the class that is not healthy. */
    const uint32_t classes = judged->classes, left_out = classes != 2           ? classes
                                                         : judged->healthy == 1 ? 1
                                                                                : 0;
    APP_FREE double *fpr = app_alloc(3 * room + n, sizeof *fpr);
    APP_FREE uint32_t *order = app_alloc(n, sizeof *order);
    double *tpr = fpr + room, *threshold = tpr + room, *score = threshold + room;
    size_t curves = 0;
    for (uint32_t c = 0; c < classes; c++) {
        if (c == left_out) continue;
        for (size_t i = 0; i < n; i++) score[i] = judged->score[i * classes + c];
        const size_t points = lg_metrics_roc(judged->truth, score, n, c, fpr, tpr, threshold, order);
        if (points == 0) continue;
        double area = 0;
        for (size_t i = 1; i < points; i++) area += 0.5 * (fpr[i] - fpr[i - 1]) * (tpr[i] + tpr[i - 1]);
        APP_PLOT_COLUMNS(plot, 9, points, {fpr, 1, 1}, {tpr, 1, 1});
        app_plot_text(plot, "%s, area %.4f", v->model->file.names.class_name[c], area);
        app_plot_block(plot);
        curves++;
    }
    if (curves == 0) no_plot("all windows are of one class: there is no ROC curve");
}

static void put_loss(app_plot *plot, const void *view) {
    train_put_loss(plot, ((const viewing *)view)->training);
}

/* ---- which plots a model has ---- */

enum { FEATURES = 2, VARIANCES = 4, TREE = 8, MARGIN = 16, BASELINE = 32 };
enum { PLANE = 64, NOVELTY = 128, LOSS = 256, PRUNING = 512, NETWORK = 1024 };

#define NO_FEATURES "the model has no features; use confusion or roc"
const app_plot_kind anomaly_plots[] = {
    APP_PLOT("loss", "cnn", "training", put_loss, LOSS, "is drawn while a cnn is trained", LOSS),
    APP_PLOT("pruning", "tree", "pruning", put_pruning, PRUNING, "is drawn while a tree is trained", 0),
    APP_PLOT("pairs", "features", "points", put_points, FEATURES, NO_FEATURES, 0),
    APP_PLOT("plane", "cnn", "points", put_points, PLANE,
             "needs a cnn with two numbers before its output (--plane 2)", PLANE),
    APP_PLOT("regressions", "baseline", "regressions", put_regressions, BASELINE,
             "needs --classifier baseline", BASELINE),
    APP_PLOT("tree", "tree", "tree", put_tree, TREE, "the model is not a tree", TREE),
    APP_PLOT("margin", "linear svm", "points", put_points, MARGIN,
             "needs svm-linear with two classes and three components", MARGIN),
    APP_PLOT("clouds", "components", "points", put_points, FEATURES, NO_FEATURES, FEATURES),
    APP_PLOT("variance", "explained by components", "variance", put_variance, VARIANCES,
             "needs principal components (--components)", 0),
    APP_PLOT("roc", "true against false alarms", "roc", put_roc, .usual = NOVELTY),
    APP_PLOT("confusion", "given against true class", "confusion", put_confusion, .usual = NETWORK),
    {.name = NULL}};

unsigned plots_of(const well_model *model, bool training) {
    if (model->sort == WELL_NOVELTY) return NOVELTY;
    if (model->sort == WELL_NETWORK)
        return NETWORK | (training ? LOSS : 0) | (model->network.run.model.net.plane == 2 ? PLANE : 0);
    const lg_classifier *by = &model->file.classifier;
    const bool tree = by->method == LG_METHOD_TREE, margin = model->file.names.classes == 2 &&
                                                             by->method == LG_METHOD_SVM_LINEAR &&
                                                             lg_pca_outputs(&by->pca) == 3;
    return FEATURES | (by->pca.variances > 0 ? VARIANCES : 0) | (tree ? TREE : 0) | (margin ? MARGIN : 0) |
           (by->features.kind == LG_FEATURES_BASELINE ? BASELINE : 0) | (tree && training ? PRUNING : 0);
}
