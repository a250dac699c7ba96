/* Declarations that `train` and `search` share. */
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
    METHOD_ROCKET,
    METHOD_NOVELTY
};
enum { PRUNE_NONE, PRUNE_PRE, PRUNE_POST };

/* A value that is one of the names of a field, or a number. */
typedef struct name_or_number {
    uint32_t name;   /* index of the name, if number is 0 */
    uint64_t number; /* 0: a name was given */
} name_or_number;

/* Values from the command line, except for files, train_run and train_state. */
typedef struct train_values {
    int plot_kind;
    lg_reals grid;
    /* Hyperparameters of the classical methods. */
    uint32_t method;
    name_or_number features, prune; /* numbers: random convolution features, and how many of them are kept */
    uint32_t directions, criterion;
    uint64_t components, max_depth, min_leaf, folds;
    double ccp_alpha, c, gamma;
} train_values;

extern train_values train_given;
/* For networks: everything that determines the result. Classical methods use only how the data are cut and
 * split. */
extern lg_detector_run train_run;
extern lg_detector_state train_state;
extern const app_settings train_settings[];
/* The name of a method; NULL if there is no such method. */
const char *train_method_name(uint32_t method);

/* Rejects options that the method does not have, and options that cannot be combined. */
void train_check_options(const app *app);

/* ---- training ---- */

/* The task of `train --method cnn` and of `search` (train_network.c). Other methods use its `training` for
 * data and results. */
extern train_task network_recipe;
/* Trains another method. The data in train_state have been read, cut and split. */
void train_classical(const app *app);
/* train_task.trial: rocket; a cnn is trained by the recipe. */
lg_status train_trial(const app *app, lg_trial *trial, lg_error *error);
void train_novelty(const app *app);
/* Returns a model that describes the data in train_state; what training learns is not set yet. */
well_model trained_model(well_sort sort, const char *method);
/* Writes the file of a model that is not a network. */
void save_trained(const app *app, const well_model *model);
/* If --plot is given: check_plot checks that the model has the plot of --plot-kind, draw_tested draws it
 * for the windows of the test part (lg_detector_tested). */
void check_plot(const app *app, const well_model *model);
void draw_tested(const app *app, int view, const well_model *model, const lg_judgement *judged);
/* Prints the results of a training that is not a network's; `put` adds those of the method. */
void report_trained(const app *app, const well_model *model, void (*put)(app_json *, const void *),
                    const void *user);

/* ---- plots of a model (plots.c) ---- */

/* Indices into view_names. */
enum {
    VIEW_DEFAULT,
    VIEW_PAIRS,
    VIEW_CLOUDS,
    VIEW_VARIANCE,
    VIEW_TREE,
    VIEW_MARGIN,
    VIEW_REGRESSIONS,
    VIEW_PLANE,
    VIEW_CONFUSION,
    VIEW_ROC,
    VIEW_LOSS,
    VIEW_PRUNING
};
extern const char *const view_names[];
/* view_names without the plots that can only be drawn during training. */
extern const char *const evaluate_view_names[];
#define EVALUATE_VIEW_HELP                                                                                   \
    "With --plot: pairs (features), clouds (components), variance (explained), tree, margin (linear svm), "  \
    "regressions (baseline), plane (cnn), confusion or roc; the default suits the method"
#define VIEW_HELP                                                                                            \
    "With --plot: pairs (features), clouds (components), variance (explained), pruning, tree, margin "       \
    "(linear "                                                                                               \
    "svm), regressions (baseline), plane (cnn), loss (cnn), confusion or roc; the default suits the method"

/* Replaces VIEW_DEFAULT by the model's default plot; `training`: the model is being trained. */
int view_of(const well_model *model, int wanted, bool training);
/* Ends the command if the model has no such plot. */
void check_view(const app *app, const well_model *model, int view, bool training);
/* Draws the windows of `judged`; not VIEW_LOSS and VIEW_PRUNING. */
void draw_view(const app *app, const char *path, int view, const well_model *model, const lg_cut_series *from,
               const lg_judgement *judged);

#endif
