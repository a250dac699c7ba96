/* Training: declarations that `train` and `search` share. */
#ifndef LG_APPS_ANOMALY_TRAIN_H
#define LG_APPS_ANOMALY_TRAIN_H

#include "common/search.h"
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

/* Values of the command line besides files, train_run and train_state. */
typedef struct train_values {
    int picture;
    lg_reals grid;
    /* Hyperparameters of the classical methods. */
    uint32_t method;
    uint32_t features, directions, criterion, prune;
    uint64_t components, max_depth, min_leaf, folds;
    double ccp_alpha, c, gamma;
} train_values;

extern train_values train_given;
/* Networks: all that determines the result; of the classical methods: the split. */
extern lg_detector_run train_run;
extern lg_detector_state train_state;
extern const app_settings train_settings[];
/* Names by number; NULL beyond the last. */
const char *train_method_name(uint32_t method);

/* Refuses options that the method does not have, or that do not go together. */
int train_check_options(const app *app);

/* ---- the training ---- */

/* Of `train --method cnn` and `search` (train_network.c). */
extern train_task network_recipe;
/* Any other method, with the state's data read, cut and split. */
void train_classical(const app *app);
void train_novelty(const app *app);
/* A model of the state's data; what it learned is missing. */
well_model trained_model(well_sort sort, const char *method);
/* Writes a model of these methods. */
void save_trained(const app *app, const well_model *model);
/* --plot, if given: --picture is one of the model's; draws the part that was tested (lg_detector_tested). */
void check_picture(const app *app, const well_model *model);
void draw_tested(const app *app, int view, const well_model *model, const lg_judgement *judged);
/* Keys that every method has; the sentence of the metrics. */
void json_trained(app_json *json, const well_model *model);
void print_trained(const well_model *model);

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
/* Ends the command where the model has no such picture. */
void check_view(const app *app, const well_model *model, int view, bool training);
/* Draws windows `judged->window` of the series. LG_UNSUPPORTED for VIEW_LOSS and VIEW_PRUNING. */
lg_status draw_view(const app *app, const char *picture, int view, const well_model *model,
                    const lg_cut_series *from, const lg_judgement *judged, lg_error *error);

#endif
