/* Plots of a model and its windows, by name. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "lg-anomaly/train.h"

enum { SHOWN_COLUMNS = 8, SHOWN_DEPTH = 6, SHOWN_LINES = 150, SHOWN_POINTS = 4000 };

typedef struct viewing {
    const app *app;
    const char *path;
    const well_model *model;
    const lg_series *series;
    const lg_windows *windows;
    const lg_judgement *judged;
    app_plot plot;
} viewing;

/* Chooses at most SHOWN_POINTS windows, evenly spaced. */
static size_t shown(const lg_judgement *judged) {
    return judged->count < SHOWN_POINTS ? judged->count : (size_t)SHOWN_POINTS;
}
static size_t chosen(const lg_judgement *judged, size_t i) {
    return i * judged->count / shown(judged);
}

static void no_plot(const viewing *v, const char *why) {
    app_end(app_fail(v->app, LG_FILE, "%s: %s", v->path, why));
}

/* ---- points by class ---- */

static char *column_name(const lg_features *features, const lg_series *series, bool reduced, uint32_t c) {
    char name[160];
    if (reduced) return app_format("component %u", c + 1);
    (void)lg_features_name(features, series, c, name, sizeof name);
    return app_format("%s", name);
}

/* The texts of points.gp after the names of the columns. w.x + b = 0 is a plane or a line; w (columns), or
 * NULL for none. */
static void put_classes(viewing *v, const char *view, uint32_t columns, const double *w, double b) {
    for (uint32_t c = 0; c < v->model->classes; c++) app_plot_text(&v->plot, "%s", v->model->class_name[c]);
    app_plot_text(&v->plot, "%s\t%.9g", view, b);
    for (uint32_t k = 0; w != NULL && k < columns; k++) app_plot_text(&v->plot, "%.9g", w[k]);
}

/* Writes window number `at`: its class, the number of earlier windows of this class, its first columns. */
static void put_point(viewing *v, size_t at, const double *x, uint32_t columns, double *seen) {
    double row[2 + SHOWN_COLUMNS] = {v->judged->truth[at] + 1, seen[v->judged->truth[at]]++};
    memcpy(row + 2, x, columns * sizeof *row);
    app_plot_numbers(&v->plot, 9, row, 2 + columns);
}

/* Draws the features of the windows, or with `components` their principal components. */
static void put_points(viewing *v, const char *view, bool components, const double *w, double b) {
    const lg_classifier *classifier = &v->model->classifier;
    const lg_features *features = &classifier->features;
    const lg_pca *pca = &classifier->pca;
    const bool reduced = components && pca->components > 0;
    const uint32_t all = reduced ? pca->components : features->count,
                   most = components ? 3 : (uint32_t)SHOWN_COLUMNS, columns = all < most ? all : most;
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE double *f = app_alloc(3 * (size_t)features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    APP_FREE double *seen = app_alloc(v->model->classes, sizeof *seen);
    double *reduction = f + features->count;
    app_plot_begin(&v->plot, "points", v->path);
    app_plot_text(&v->plot, "%u\t%u", columns, v->model->classes);
    for (uint32_t c = 0; c < columns; c++) {
        APP_FREE char *name = column_name(features, v->series, reduced, c);
        app_plot_text(&v->plot, "%s", name);
    }
    put_classes(v, view, columns, w, b);
    for (size_t i = 0; i < shown(v->judged); i++) {
        const size_t at = chosen(v->judged, i);
        lg_windows_copy(v->series, v->windows, v->judged->window[at], x);
        app_must_file(v->app, lg_features_compute(features, x, f, work), NULL, v->path);
        if (reduced) lg_pca_eval(pca, f, 1, reduction, reduction + features->count);
        put_point(v, at, reduced ? reduction : f, columns, seen);
    }
}

static void put_pairs(viewing *v) {
    put_points(v, "pairs", false, NULL, 0);
}

static void put_clouds(viewing *v) {
    put_points(v, "clouds", true, NULL, 0);
}

static void put_margin(viewing *v) {
    double w[3], b;
    app_must_file(v->app, lg_svm_plane(&v->model->classifier.svm, w, &b), NULL, v->path);
    put_points(v, "margin", true, w, b);
}

/* The line w.x + b = 0 on which a network with two numbers before its output finds both classes equally
 * likely: its two logits are equal, or its only logit is 0. False: there is no such line. */
static bool output_line(const well_model *model, double w[2], double *b) {
    const lg_cnn *net = &model->detector.run.model.net;
    const double *theta = model->detector.theta, *weight = NULL, *bias = NULL;
    lg_slice_info slice;
    for (uint32_t i = 0; lg_cnn_slice(net, i, &slice); i++) {
        if (strcmp(slice.name, "output/weight") == 0) weight = theta + slice.offset;
        if (strcmp(slice.name, "output/bias") == 0) bias = theta + slice.offset;
    }
    if (weight == NULL || bias == NULL || model->classes != 2) return false;
    const uint32_t n = net->outputs; /* weight is (2, n) */
    for (int d = 0; d < 2; d++) w[d] = n == 1 ? weight[d] : weight[2 * d + 1] - weight[2 * d];
    *b = n == 1 ? bias[0] : bias[1] - bias[0];
    return w[0] != 0 || w[1] != 0;
}

static void put_plane(viewing *v) {
    double w[2], b = 0;
    APP_FREE double *seen = app_alloc(v->model->classes, sizeof *seen);
    app_plot_begin(&v->plot, "points", v->path);
    app_plot_text(&v->plot, "2\t%u", v->model->classes);
    for (int c = 0; c < 2; c++) app_plot_text(&v->plot, "output %d of the last hidden layer", c + 1);
    put_classes(v, "plane", 2, output_line(v->model, w, &b) ? w : NULL, b);
    for (size_t i = 0; i < shown(v->judged); i++) {
        const size_t at = chosen(v->judged, i);
        put_point(v, at, v->judged->plane + 2 * at, 2, seen);
    }
}

/* ---- what methods have learned ---- */

static void put_variance(viewing *v) {
    const lg_pca *pca = &v->model->classifier.pca;
    app_plot_begin(&v->plot, "variance", v->path);
    app_plot_text(&v->plot, "%u", pca->components);
    for (uint32_t i = 0; i < pca->variances; i++) APP_PLOT_ROW(&v->plot, 9, pca->variance[i]);
}

/* Writes a node after its children, down to SHOWN_DEPTH: the line of its box and of the lines to its
 * children, and its two texts. Leaves are at x = 0, 1, 2, ..., a parent is in the middle between its
 * children. Returns x. */
static double put_node(viewing *v, uint32_t node, uint32_t depth, double *leaves) {
    const lg_classifier *classifier = &v->model->classifier;
    const lg_tree *tree = &classifier->tree;
    const lg_tree_node *n = &tree->node[node];
    const uint32_t *counts = tree->counts + (size_t)node * tree->classes;
    const bool leaf = n->left == 0 || depth == SHOWN_DEPTH;
    const double left = leaf ? (double)NAN : put_node(v, n->left, depth + 1, leaves),
                 right = leaf ? (double)NAN : put_node(v, n->right, depth + 1, leaves),
                 x = leaf ? (*leaves)++ : 0.5 * (left + right);
    uint32_t class = 0;
    for (uint32_t c = 1; c < tree->classes; c++)
        if (counts[c] > counts[class]) class = c;
    if (n->left != 0) {
        APP_FREE char *name =
            column_name(&classifier->features, v->series, classifier->pca.components > 0, n->feature);
        app_plot_text(&v->plot, "%s\t <= %.4g\n%.3f  n = %u", name, n->threshold, n->impurity, n->samples);
    } else {
        app_plot_text(&v->plot, "%s\t\n%.3f  n = %u", v->model->class_name[class], n->impurity, n->samples);
    }
    APP_PLOT_ROW(&v->plot, 6, x, depth, class + 1, n->samples == 0 ? 0 : counts[class] / (double)n->samples,
                 left, right);
    return x;
}

static void put_tree(viewing *v) {
    const lg_tree *tree = &v->model->classifier.tree;
    double leaves = 0;
    app_plot_begin(&v->plot, "tree", v->path);
    app_plot_text(&v->plot, "%u\t%u", lg_tree_depth(tree), tree->count);
    (void)put_node(v, 0, 0, &leaves);
}

/* Returns the standard deviation of segment s of a window in the first channel of the pair, scaled as in the
 * features. */
static double segment_deviation(const lg_features *features, const float *x, uint32_t s) {
    const uint32_t channel = features->pair[0], segments = features->segments, length = features->length;
    const uint32_t begin = (uint32_t)((uint64_t)s * length / segments),
                   end = (uint32_t)((uint64_t)(s + 1) * length / segments);
    double sum = 0, squares = 0;
    for (uint32_t t = begin; t < end; t++) sum += (double)x[(size_t)channel * length + t];
    const double mean = sum / (end - begin);
    for (uint32_t t = begin; t < end; t++) {
        const double d = (double)x[(size_t)channel * length + t] - mean;
        squares += d * d;
    }
    return sqrt(squares / (end - begin)) / features->scale[channel];
}

/* Writes the regression line of each window and the range of the accelerations of its segments. */
static void put_regressions(viewing *v) {
    const lg_features *features = &v->model->classifier.features;
    APP_FREE double *f = app_alloc(features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE size_t *of_class = app_alloc(v->model->classes, sizeof *of_class);
    const size_t every = shown(v->judged) / ((size_t)SHOWN_LINES * v->model->classes) + 1;
    app_plot_begin(&v->plot, "regressions", v->path);
    app_plot_text(&v->plot, "%u", v->model->classes);
    for (uint32_t c = 0; c < v->model->classes; c++) app_plot_text(&v->plot, "%s", v->model->class_name[c]);
    for (size_t i = 0; i < shown(v->judged); i += every) {
        const size_t at = chosen(v->judged, i), class = v->judged->truth[at];
        double least = DBL_MAX, most = -DBL_MAX;
        if (of_class[class]++ >= SHOWN_LINES) continue;
        lg_windows_copy(v->series, v->windows, v->judged->window[at], x);
        app_must_file(v->app, lg_features_compute(features, x, f, work), NULL, v->path);
        for (uint32_t s = 0; s < features->segments; s++) {
            least = fmin(least, segment_deviation(features, x, s));
            most = fmax(most, segment_deviation(features, x, s));
        }
        APP_PLOT_ROW(&v->plot, 9, (double)class + 1, f[0], f[1], least, most);
    }
}

/* ---- outcomes ---- */

static void put_confusion(viewing *v) {
    app_plot_confusion(&v->plot, v->path, "", v->judged->confusion, v->model->classes, v->model->class_name);
}

static void put_roc(viewing *v) {
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
    app_plot_begin(&v->plot, "roc", v->path);
    for (uint32_t c = 0; c < classes; c++) {
        if (c == left_out) continue;
        for (size_t i = 0; i < n; i++) score[i] = judged->score[i * classes + c];
        const size_t points = lg_metrics_roc(judged->truth, score, n, c, fpr, tpr, threshold, order);
        if (points == 0) continue;
        double area = 0;
        for (size_t i = 0; i < points; i++) {
            if (i > 0) area += 0.5 * (fpr[i] - fpr[i - 1]) * (tpr[i] + tpr[i - 1]);
            APP_PLOT_ROW(&v->plot, 9, fpr[i], tpr[i]);
        }
        app_plot_text(&v->plot, "%s, area %.4f", v->model->class_name[c], area);
        app_plot_block(&v->plot);
        curves++;
    }
    if (curves == 0) no_plot(v, "all windows are of one class: there is no ROC curve");
}

/* ---- which plots a model has ---- */

static const struct {
    void (*put)(viewing *v); /* NULL: the training draws it */
    const char *missing;     /* why a model may lack it */
} views[] = {[VIEW_PAIRS] = {put_pairs, "the model has no features; use confusion or roc"},
             [VIEW_CLOUDS] = {put_clouds, "the model has no features; use confusion or roc"},
             [VIEW_VARIANCE] = {put_variance, "needs principal components (--components)"},
             [VIEW_TREE] = {put_tree, "the model is not a tree"},
             [VIEW_MARGIN] = {put_margin, "needs svm-linear with two classes and three components"},
             [VIEW_REGRESSIONS] = {put_regressions, "needs --method baseline"},
             [VIEW_PLANE] = {put_plane, "needs a cnn with two numbers before its output (--plane 2)"},
             [VIEW_CONFUSION] = {put_confusion, NULL},
             [VIEW_ROC] = {put_roc, NULL},
             [VIEW_LOSS] = {NULL, "is drawn while a cnn is trained"},
             [VIEW_PRUNING] = {NULL, "is drawn while a tree is trained"}};

#define EVALUATE_VIEWS                                                                                       \
    "default", "pairs", "clouds", "variance", "tree", "margin", "regressions", "plane", "confusion", "roc"
const char *const view_names[] = {EVALUATE_VIEWS, "loss", "pruning", NULL};
const char *const evaluate_view_names[] = {EVALUATE_VIEWS, NULL};

static bool has_view(const well_model *model, int view, bool training) {
    const lg_classifier *by = &model->classifier;
    const bool classical = model->sort == WELL_CLASSICAL, network = model->sort == WELL_NETWORK,
               tree = classical && by->method == LG_METHOD_TREE,
               linear = classical && model->classes == 2 && by->method == LG_METHOD_SVM_LINEAR;
    const bool has[LG_COUNT(views)] = {[VIEW_PAIRS] = classical,
                                       [VIEW_CLOUDS] = classical,
                                       [VIEW_VARIANCE] = classical && by->pca.variances > 0,
                                       [VIEW_TREE] = tree,
                                       [VIEW_MARGIN] = linear && lg_pca_outputs(&by->pca) == 3,
                                       [VIEW_REGRESSIONS] =
                                           classical && by->features.kind == LG_FEATURES_BASELINE,
                                       [VIEW_PLANE] = network && model->detector.run.model.net.plane == 2,
                                       [VIEW_CONFUSION] = true,
                                       [VIEW_ROC] = true,
                                       [VIEW_LOSS] = network && training,
                                       [VIEW_PRUNING] = tree && training};
    return has[view];
}

int view_of(const well_model *model, int wanted, bool training) {
    static const int defaults[] = {VIEW_LOSS, VIEW_PLANE,  VIEW_REGRESSIONS,
                                   VIEW_TREE, VIEW_MARGIN, VIEW_CLOUDS};
    if (wanted != VIEW_DEFAULT) return wanted;
    for (size_t i = 0; i < LG_COUNT(defaults); i++)
        if (has_view(model, defaults[i], training)) return defaults[i];
    return model->sort == WELL_NOVELTY ? VIEW_ROC : VIEW_CONFUSION;
}

void check_view(const app *self, const well_model *model, int wanted, bool training) {
    const int view = view_of(model, wanted, training);
    if (!has_view(model, view, training))
        app_stop_usage(self, "--plot-kind %s: %s", view_names[view], views[view].missing);
}

void draw_view(const app *self, const char *path, int view, const well_model *model,
               const lg_cut_series *from, const lg_judgement *judged) {
    lg_series named = from->data.series; /* the model's channel names are used if the file has none */
    if (named.channel_name == NULL) named.channel_name = model->channel_name;
    viewing v = {.app = self,
                 .path = path,
                 .model = model,
                 .series = &named,
                 .windows = &from->windows,
                 .judged = judged};
    if (judged->count == 0) no_plot(&v, "there are no windows to draw");
    views[view].put(&v);
    app_plot_end(self, &v.plot);
}
