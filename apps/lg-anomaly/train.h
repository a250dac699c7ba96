/* Declarations that `train` and `search` share. */
#ifndef LG_APPS_ANOMALY_TRAIN_H
#define LG_APPS_ANOMALY_TRAIN_H

#include "common/search.h"
#include "lg-anomaly/anomaly.h"

/* In the order of classifier_method_name. */
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

/* A value is a number up to TRAIN_NUMBERS, or one of the names of its row. The index of a number is 0. */
#define TRAIN_NUMBERS UINT32_MAX
static inline bool train_is_number(uint64_t value) {
    return value <= TRAIN_NUMBERS;
}
static inline uint32_t train_name(uint64_t value) {
    return train_is_number(value) ? 0 : (uint32_t)(value - TRAIN_NUMBERS - 1);
}

/* Values from the command line, except for files, train_run and train_state. */
typedef struct train_values {
    lg_reals grid;
    /* Hyperparameters of the classical methods. */
    uint32_t method;
    uint64_t features, prune; /* numbers: random convolution features, and how many of them are kept */
    uint32_t directions, criterion;
    uint64_t components, max_depth, folds;
    double ccp_alpha, c, gamma;
} train_values;

extern train_values train_given;
/* For networks: everything that determines the result. Classical methods use only how the data are cut and
 * split. */
extern lg_detector_run train_run;
extern lg_detector_state train_state;
extern const app_settings train_settings[];
/* Rejects options that the method does not have, and options that cannot be combined (train_task.check). */
lg_status train_check_options(const app *app, lg_error *error);

/* ---- training ---- */

/* The task of `train` and `search`. Its recipe trains the network; classical methods use its `training` for
 * data and results. */
extern train_task network_recipe;
/* train_task.learn: trains a classical method. */
lg_status train_classical(const app *app, lg_trial *trial, lg_error *error);
/* Returns a model that describes the data in train_state; what training learns is not set yet. */
well_model trained_model(well_sort sort, const char *method);

/* ---- plots of a model (plots.c) ---- */

/* The plots show the evaluated windows and, while a model is trained, its training. */
typedef struct viewing {
    const well_model *model;
    const lg_cut_series *from;
    const lg_judgement *judged;
    const lg_training *training; /* of a network; NULL: its training is over */
    const void *classical;       /* the training of a tree; NULL: it is over */
} viewing;
/* The plots of train. From row EVALUATE_PLOTS on they are also the plots of evaluate. */
enum { EVALUATE_PLOTS = 2 };
extern const app_plot_kind anomaly_plots[];
/* The bits of the plots that a model has. */
unsigned plots_of(const well_model *model, bool training);
void put_pruning(app_plot *plot, const void *view); /* train_classical.c */

#endif
