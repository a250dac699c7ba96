/* Training: declarations that `train` and `search` share. */
#ifndef LG_APPS_ANOMALY_TRAIN_H
#define LG_APPS_ANOMALY_TRAIN_H

#include "common/learn.h"
#include "lg-anomaly/anomaly.h"

enum {
    METHOD_CNN,
    METHOD_LOGISTIC,
    METHOD_TREE,
    METHOD_SVM_LINEAR,
    METHOD_SVM_RBF,
    METHOD_BASELINE,
    METHOD_NOVELTY
};
enum { PRUNE_NONE, PRUNE_PRE, PRUNE_POST };

/* Values of the command line besides files and train_run. */
typedef struct train_values {
    const char *test;
    int picture;
    lg_reals grid;
    /* Hyperparameters. */
    uint32_t method;
    double window, hop;
    /* classical */
    uint32_t features, directions, criterion, prune;
    uint64_t components, max_depth, min_split, min_leaf, folds;
    double ccp_alpha, c, gamma;
    /* network: where the rest comes from, and its blocks */
    uint32_t preset, pooling;
    uint64_t kernel, stride, padding, pool_size;
    lg_wholes filters;
} train_values;

extern train_values train_given;
/* Networks: all that determines the result; of the classical methods: the split. */
extern lg_detector_run train_run;
extern const app_settings train_settings[];
/* Names by number; NULL beyond the last. */
const char *train_method_name(uint32_t method);

/* Refuses options that the method does not have, or that do not go together. */
int train_check_options(const app *app);

/* ---- the data of a training (cut.c) ---- */

/* One file, cut in windows. */
typedef struct cut_series {
    lg_series_data data;
    lg_windows windows;
} cut_series;

/* Samples of a window, and from one to the next, by the options for this data. */
lg_status window_of(const app *app, const lg_series *series, uint64_t *window, uint64_t *hop,
                    lg_error *error);
/* Windows and their parts. parts: (windows->count), freed with free. */
lg_status cut_and_split(const lg_context *context, const lg_series *series, const well_cut *how,
                        lg_windows *windows, uint8_t **parts, lg_error *error);

/* ---- networks (network.c) ---- */

/* Completes train_run from options and data. Values that were not given come from the preset, *preset, or
 * from `stored`; then *preset is NULL. */
lg_status network_run(app *app, const lg_series_data *data, const lg_detector_run *stored,
                      const lg_detector_preset **preset, lg_error *error);
well_cut cut_of_run(const lg_detector_run *run);

typedef struct network {
    lg_scaler scaler;
    lg_detector_data data;
    lg_detector_problem problem;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} network;

/* A fit of train_run. The network must not move while it lives. */
lg_status network_create(const lg_context *context, const lg_series *series, const lg_windows *windows,
                         const part_indices *train, const part_indices *validation,
                         const lg_fit_options *options, network *out, lg_error *error);
void network_destroy(network *net);
/* The fit's result as a file in memory, names borrowed from the series; free its theta with free. */
lg_detector_file network_file(const network *net, const lg_series *series);

/* ---- the training ---- */

typedef struct trained {
    app *app;
    cut_series all;     /* DATA.h5 */
    cut_series foreign; /* --test */
    well_cut cut;
    part_indices train, validation, test; /* of all; test of foreign when that is given */
    judgement train_judged, judged;
    double train_seconds;
    /* Networks. */
    const lg_detector_preset *preset; /* NULL when resumed */
    lg_detector_units units;          /* of the result */
    network net;
} trained;

/* Runs `main_`, train_main or another, with the task of this program. */
int with_task(app *self, int (*main_)(app *self, const train_task *task));
/* The series with the test part. */
const cut_series *tested_series(const trained *self);
int read_all(void *user, app *app, const char *path, char sha256[LG_SHA256_TEXT]);
/* Windows and parts by self->cut, which gets their number. */
int cut_parts(trained *self);
/* The task of `train --method cnn` and `search` (train_network.c), without reading. */
train_task network_task(trained *self);
/* Any other method, with everything read and cut. Exit codes. */
int train_classical(trained *self);
int train_novelty(trained *self);
/* The novelty of a part of the windows; a warning where it cannot be had, and *out is untouched. */
int fit_novelty(const trained *self, const part_indices *part, lg_novelty *out);
/* Keys that every method has; the sentence of the beginning and the metrics. */
void json_trained(app_json *json, const trained *self, const well_model *model);
void print_trained(const trained *self, const well_model *model);

/* ---- pictures of a model (views.c) ---- */

/* Positions in view_names. */
enum {
    VIEW_DEFAULT,
    VIEW_LOSS,
    VIEW_PAIRS,
    VIEW_CLOUDS,
    VIEW_VARIANCE,
    VIEW_PRUNING,
    VIEW_TREE,
    VIEW_MARGIN,
    VIEW_REGRESSIONS,
    VIEW_PLANE,
    VIEW_CONFUSION,
    VIEW_ROC
};
extern const char *const view_names[];
/* The same without the pictures that are drawn during training only. */
extern const char *const evaluate_view_names[];
extern const int evaluate_views[]; /* VIEW_... of each */
#define EVALUATE_VIEW_HELP                                                                                   \
    "With --plot: pairs (features), clouds (components), variance (explained), tree, margin (linear svm), "  \
    "regressions (baseline), plane (cnn), confusion or roc; the default suits the method"
#define VIEW_HELP                                                                                            \
    "With --plot: pairs (features), clouds (components), variance (explained), pruning, tree, margin "       \
    "(linear "                                                                                               \
    "svm), regressions (baseline), plane (cnn), loss (cnn), confusion or roc; the default suits the method"

/* The view that a model has by default; `training`: while it is trained. */
int view_of(const well_model *model, int wanted, bool training);
/* Checks that the model has such a picture; otherwise prints the reason and returns the exit code of
 * usage. */
int check_view(const app *app, const well_model *model, int view, bool training);
/* Draws windows `judged->window` of the series. LG_UNSUPPORTED for VIEW_LOSS and VIEW_PRUNING. */
lg_status draw_view(const app *app, const char *picture, int view, const well_model *model,
                    const lg_series *series, const lg_windows *windows, const judgement *judged,
                    lg_error *error);

#endif
