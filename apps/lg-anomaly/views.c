/* Computes the points, curves and planes of pictures from a model and windows. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

enum { SHOWN_LINES = 150, SHOWN_POINTS = 4000 };

const char *const view_names[] = {"default",   "loss", "pairs",  "clouds",      "variance",
                                  "pruning",   "tree", "margin", "regressions", "plane",
                                  "confusion", "roc",  NULL};

const char *const evaluate_view_names[] = {"default",     "pairs", "clouds",    "variance", "tree", "margin",
                                           "regressions", "plane", "confusion", "roc",      NULL};
const int evaluate_views[] = {VIEW_DEFAULT, VIEW_PAIRS,       VIEW_CLOUDS, VIEW_VARIANCE,  VIEW_TREE,
                              VIEW_MARGIN,  VIEW_REGRESSIONS, VIEW_PLANE,  VIEW_CONFUSION, VIEW_ROC};

/* ---- which pictures a model has ---- */

static bool is_baseline(const well_model *model) {
    return model->sort == WELL_CLASSICAL && model->classifier.features.kind == LG_FEATURES_BASELINE;
}

static bool has_margin(const well_model *model) {
    return model->sort == WELL_CLASSICAL && model->classes == 2 &&
           model->classifier.method == LG_METHOD_SVM_LINEAR && lg_pca_outputs(&model->classifier.pca) == 3;
}

int view_of(const well_model *model, int wanted, bool training) {
    if (wanted != VIEW_DEFAULT) return wanted;
    if (model->sort == WELL_NETWORK)
        return training ? VIEW_LOSS : model->detector.run.model.net.plane == 2 ? VIEW_PLANE : VIEW_CONFUSION;
    if (model->sort == WELL_NOVELTY) return VIEW_ROC;
    if (is_baseline(model)) return VIEW_REGRESSIONS;
    if (model->classifier.method == LG_METHOD_TREE) return VIEW_TREE;
    return has_margin(model) ? VIEW_MARGIN : VIEW_CLOUDS;
}

static const char *view_missing(const well_model *model, int view, bool training) {
    const bool classical = model->sort == WELL_CLASSICAL;
    switch (view) {
    case VIEW_LOSS:
        return model->sort == WELL_NETWORK && training ? NULL : "is drawn while a cnn is trained";
    case VIEW_PRUNING:
        return classical && training && model->classifier.method == LG_METHOD_TREE
                   ? NULL
                   : "is drawn while a tree is trained";
    case VIEW_PAIRS:
    case VIEW_CLOUDS:
        return classical ? NULL : "the model has no features; use confusion or roc";
    case VIEW_VARIANCE:
        return classical && model->classifier.pca.variances > 0 ? NULL
                                                                : "needs principal components (--components)";
    case VIEW_TREE:
        return classical && model->classifier.method == LG_METHOD_TREE ? NULL : "the model is not a tree";
    case VIEW_MARGIN:
        return has_margin(model) ? NULL : "needs svm-linear with two classes and three components";
    case VIEW_REGRESSIONS:
        return is_baseline(model) ? NULL : "needs --method baseline";
    case VIEW_PLANE:
        return model->sort == WELL_NETWORK && model->detector.run.model.net.plane == 2
                   ? NULL
                   : "needs a cnn with two numbers before its output (--plane 2)";
    default:
        return NULL;
    }
}

void check_view(const app *self, const well_model *model, int view, bool training) {
    const char *missing = view_missing(model, view_of(model, view, training), training);
    if (missing != NULL) app_stop_usage(self, "--picture %s: %s", view_names[view], missing);
}

/* ---- points with class labels ---- */

typedef struct points {
    labelled as;
    double *x;
    uint32_t *label;
    char **name;
} points;

static points points_create(const well_model *model, size_t count, uint32_t columns) {
    points out = {.x = app_alloc(count * columns, sizeof *out.x),
                  .label = app_alloc(count, sizeof *out.label),
                  .name = app_alloc(columns, sizeof *out.name)};
    out.as = (labelled){count, columns, model->classes, out.x, out.label, model->class_name, out.name};
    return out;
}

static void points_destroy(points *p) {
    for (uint32_t c = 0; c < p->as.columns; c++) free(p->name[c]);
    free(p->name);
    free(p->x);
    free(p->label);
}

/* Chooses at most SHOWN_POINTS windows, evenly spaced. */
static size_t shown(const lg_judgement *judged) {
    return judged->count < SHOWN_POINTS ? judged->count : (size_t)SHOWN_POINTS;
}
static size_t chosen(const lg_judgement *judged, size_t i) {
    return i * judged->count / shown(judged);
}

static char *column_name(const lg_features *features, const lg_series *series, bool reduced, uint32_t c) {
    char name[160];
    if (reduced) return app_format("component %u", c + 1);
    (void)lg_features_name(features, series, c, name, sizeof name);
    return app_format("%s", name);
}

/* Computes the features of the windows, or their principal components. */
static lg_status feature_points(const well_model *model, const lg_series *series, const lg_windows *windows,
                                const lg_judgement *judged, bool components, points *out) {
    const lg_classifier *classifier = &model->classifier;
    const lg_features *features = &classifier->features;
    const lg_pca *pca = &classifier->pca;
    const bool reduced = components && pca->components > 0;
    const uint32_t columns = reduced ? pca->components : features->count;
    *out = points_create(model, shown(judged), columns);
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE double *f = app_alloc(2 * (size_t)features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    for (uint32_t c = 0; c < columns; c++) out->name[c] = column_name(features, series, reduced, c);
    for (size_t i = 0; i < out->as.count; i++) {
        const size_t at = chosen(judged, i);
        double *row = out->x + i * columns;
        out->label[i] = judged->truth[at];
        lg_windows_copy(series, windows, judged->window[at], x);
        const lg_status status = lg_features_compute(features, x, f, work);
        if (status != LG_OK) return status;
        if (reduced)
            lg_pca_eval(pca, f, 1, row, f + features->count);
        else
            memcpy(row, f, columns * sizeof *row);
    }
    return LG_OK;
}

/* ---- the pictures ---- */

typedef struct viewing {
    const app *app;
    const char *picture;
    const well_model *model;
    const lg_series *series;
    const lg_windows *windows;
    const lg_judgement *judged;
} viewing;

static lg_status view_points(const viewing *v, int view, lg_error *error) {
    APP_CLEAN(points_destroy) points p = {.x = NULL};
    double w[3], b;
    lg_status status = feature_points(v->model, v->series, v->windows, v->judged, view != VIEW_PAIRS, &p);
    if (status != LG_OK) return app_error(error, status, "%s", lg_status_sentence(status));
    if (view == VIEW_PAIRS) return draw_pairs(v->app, v->picture, &p.as, error);
    if (view == VIEW_CLOUDS) return draw_clouds(v->app, v->picture, &p.as, error);
    status = lg_svm_plane(&v->model->classifier.svm, w, &b);
    return status == LG_OK ? draw_margin(v->app, v->picture, &p.as, w, b, error) : status;
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
    return true;
}

static lg_status view_plane(const viewing *v, lg_error *error) {
    double w[2], b = 0;
    APP_CLEAN(points_destroy) points p = points_create(v->model, shown(v->judged), 2);
    for (size_t i = 0; i < p.as.count; i++) {
        const size_t at = chosen(v->judged, i);
        memcpy(p.x + 2 * i, v->judged->plane + 2 * at, 2 * sizeof *p.x);
        p.label[i] = v->judged->truth[at];
    }
    for (int c = 0; c < 2; c++) p.name[c] = app_format("output %d of the last hidden layer", c + 1);
    const bool line = output_line(v->model, w, &b);
    return draw_plane(v->app, v->picture, &p.as, line ? w : NULL, b, error);
}

static lg_status view_tree(const viewing *v, lg_error *error) {
    const lg_classifier *classifier = &v->model->classifier;
    const uint32_t columns = lg_pca_outputs(&classifier->pca);
    /* Only the column names are used. */
    APP_CLEAN(points_destroy) points p = points_create(v->model, 0, columns);
    for (uint32_t c = 0; c < columns; c++)
        p.name[c] = column_name(&classifier->features, v->series, classifier->pca.components > 0, c);
    return draw_tree(v->app, v->picture, &classifier->tree, v->model->class_name, p.name, error);
}

static lg_status view_roc(const viewing *v, lg_error *error) {
    const lg_judgement *judged = v->judged;
    const size_t n = judged->count, room = n + 1;
    /* Of two classes one curve says all: that of the class that is not healthy. */
    const uint32_t classes = judged->classes, left_out = classes != 2           ? classes
                                                         : judged->healthy == 1 ? 1
                                                                                : 0;
    APP_FREE double *memory = app_alloc(3 * room * classes + n, sizeof *memory);
    APP_FREE uint32_t *order = app_alloc(n, sizeof *order);
    double *score = memory + 3 * room * classes;
    APP_FREE roc_curve *curves = app_alloc(classes, sizeof *curves);
    size_t count = 0;
    for (uint32_t c = 0; c < classes; c++) {
        if (c == left_out) continue;
        double *fpr = memory + 3 * room * c, *tpr = fpr + room;
        for (size_t i = 0; i < n; i++) score[i] = judged->score[i * classes + c];
        const size_t points_here = lg_metrics_roc(judged->truth, score, n, c, fpr, tpr, tpr + room, order);
        double area = 0;
        for (size_t i = 1; i < points_here; i++) area += 0.5 * (fpr[i] - fpr[i - 1]) * (tpr[i] + tpr[i - 1]);
        if (points_here > 0)
            curves[count++] = (roc_curve){v->model->class_name[c], fpr, tpr, points_here, area};
    }
    return count > 0
               ? draw_roc(v->app, v->picture, curves, count, error)
               : app_error(error, LG_INVALID_ARGUMENT, "all windows are of one class: there is no ROC curve");
}

/* Computes the standard deviations of the window's segments for the first pair of channels, scaled as in the
 * features. */
static void put_regression(const viewing *v, size_t at, const float *x, const double *f, double *memory,
                           regression *out) {
    const lg_features *features = &v->model->classifier.features;
    const uint32_t segments = features->segments, length = features->length;
    for (uint32_t k = 0; k < 2; k++) {
        const uint32_t channel = features->pair[k];
        for (uint32_t s = 0; s < segments; s++) {
            const uint32_t begin = (uint32_t)((uint64_t)s * length / segments),
                           end = (uint32_t)((uint64_t)(s + 1) * length / segments);
            double sum = 0, squares = 0;
            for (uint32_t t = begin; t < end; t++) sum += (double)x[(size_t)channel * length + t];
            const double mean = sum / (end - begin);
            for (uint32_t t = begin; t < end; t++) {
                const double d = (double)x[(size_t)channel * length + t] - mean;
                squares += d * d;
            }
            memory[k * segments + s] = sqrt(squares / (end - begin)) / features->scale[channel];
        }
    }
    *out = (regression){memory, memory + segments, segments, f[0], f[1], v->judged->truth[at]};
}

static lg_status view_regressions(const viewing *v, lg_error *error) {
    const lg_features *features = &v->model->classifier.features;
    const size_t each = 2 * (size_t)features->segments, room = (size_t)SHOWN_LINES * v->model->classes;
    APP_FREE regression *lines = app_alloc(room, sizeof *lines);
    APP_FREE double *memory = app_alloc(room * each, sizeof *memory);
    APP_FREE double *f = app_alloc(features->count, sizeof *f);
    APP_FREE double *work = app_alloc(lg_features_work_size(features), 1);
    APP_FREE float *x = app_alloc((size_t)features->channels * features->length, sizeof *x);
    APP_FREE size_t *of_class = app_alloc(v->model->classes, sizeof *of_class);
    const size_t every = shown(v->judged) / room + 1;
    size_t count = 0;
    for (size_t i = 0; i < shown(v->judged); i += every) {
        const size_t at = chosen(v->judged, i);
        if (of_class[v->judged->truth[at]] == SHOWN_LINES) continue;
        of_class[v->judged->truth[at]]++;
        lg_windows_copy(v->series, v->windows, v->judged->window[at], x);
        const lg_status status = lg_features_compute(features, x, f, work);
        if (status != LG_OK) return app_error(error, status, "%s", lg_status_sentence(status));
        put_regression(v, at, x, f, memory + count * each, &lines[count]);
        count++;
    }
    return draw_regressions(v->app, v->picture, lines, count, v->model->classes, v->model->class_name, error);
}

lg_status draw_view(const app *self, const char *picture, int view, const well_model *model,
                    const lg_cut_series *from, const lg_judgement *judged, lg_error *error) {
    lg_series named = from->data.series; /* the model's channel names are used if the file has none */
    if (named.channel_name == NULL) named.channel_name = model->channel_name;
    const viewing v = {self, picture, model, &named, &from->windows, judged};
    if (judged->count == 0)
        return app_error(error, LG_INVALID_ARGUMENT, "%s: there are no windows to draw", picture);
    switch (view) {
    case VIEW_PAIRS:
    case VIEW_CLOUDS:
    case VIEW_MARGIN:
        return view_points(&v, view, error);
    case VIEW_VARIANCE:
        return draw_variance(self, picture, model->classifier.pca.variance, model->classifier.pca.variances,
                             model->classifier.pca.components, error);
    case VIEW_TREE:
        return view_tree(&v, error);
    case VIEW_REGRESSIONS:
        return view_regressions(&v, error);
    case VIEW_PLANE:
        return view_plane(&v, error);
    case VIEW_CONFUSION:
        return app_draw_confusion(self, picture, "", judged->confusion, judged->classes, model->class_name,
                                  error);
    case VIEW_ROC:
        return view_roc(&v, error);
    default:
        return app_error(error, LG_UNSUPPORTED, "%s: this picture is not drawn here", picture);
    }
}
