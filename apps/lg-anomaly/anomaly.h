/* Declarations that the commands of lg-anomaly share: labelled data, models of both kinds, judging, pictures.
 * A function that returns int returns an exit code, and has printed a message when it is not APP_EXIT_OK; one
 * that returns a status explains a failure in `error`; others end the command where they fail. */
#ifndef LG_APPS_ANOMALY_H
#define LG_APPS_ANOMALY_H

#include "anomaly/files/recipe.h"
#include "common/app.h"
#include "liegrad/classify.h"
#include "liegrad/detector.h"
#include "liegrad/io.h"
#include "liegrad/metrics.h"
#include "liegrad/novelty.h"
#include "liegrad/riser.h"
#include "liegrad/series.h"

extern const app_command generate_command, feed_command, train_command, evaluate_command, search_command,
    watch_command;

extern const char *const housing_names[]; /* generate.c; in the order of lg_housing */

/* ---- models (model.c) ---- */

typedef enum well_sort {
    WELL_NETWORK,   /* kind "detector" */
    WELL_CLASSICAL, /* kind "classifier" */
    WELL_NOVELTY    /* kind "classifier", method "novelty": class 0, and all that is unlike it */
} well_sort;

/* A model ready to judge. */
typedef struct well_model {
    well_sort sort;
    const char *method;                   /* "cnn", "logistic", ..., "baseline", "novelty"; static */
    uint32_t classes, channels, window;   /* window: samples */
    double rate;                          /* Hz; 0: unknown */
    char (*class_name)[LG_SERIES_NAME];   /* (classes); owned by detector or names */
    char (*class_label)[LG_SERIES_NAME];  /* (classes) or NULL; likewise */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels) or NULL; likewise */
    lg_detector_run cut;                  /* how its data were cut and split; the rest is a network's */
    bool probabilities;                   /* scores are probabilities; false: decisions, distances */
    lg_detector_file detector;            /* WELL_NETWORK */
    lg_detector_plan *plan;               /* of the detector, in its training type */
    lg_classifier classifier;             /* WELL_CLASSICAL */
    lg_novelty novelty; /* of the training windows; channels 0: none; of a loaded detector its own */
    lg_series names;    /* of a loaded classifier: owns its names */
} well_model;

void well_model_load(const app *app, const char *path, well_model *out);
void well_model_destroy(well_model *model); /* a zeroed one may be destroyed */
/* Bytes of work memory for well_model_score. */
size_t well_model_work(const well_model *model);
/* A window (channels, window), as recorded -> score (classes); the class is lg_class_of(score). plane: as
 * for lg_detector_eval, NULL unless it is a network. A novelty scores 1 and the distance of lg_novelty_eval.
 * work: 64-byte aligned. No allocation. */
lg_status well_model_score(const well_model *model, const float *x, double *score, double *plane, void *work);
/* A score for "not of the first class": the score of class 1 (two classes), 1 - that of class 0
 * (probabilities), or the best of the others minus that of class 0. */
double well_model_alarm(const well_model *model, const double *score);

/* Writes kind "classifier": /run from `model`, /classifier from model->classifier. */
lg_status well_model_save(const app *app, const char *path, const well_model *model, double accuracy,
                          double f1, lg_error *error);

/* ---- data (data.c) ---- */

/* Data with the classes of a model, or of a novelty with any classes; channels must be the model's. */
void read_series_of(const app *app, const char *path, const well_model *model, lg_series_data *out);
/* For a novelty: labels become 0 for the class that is named `first`, 1 for all others; classes that have no
 * window are no classes. */
void merge_classes(lg_series *series, const char *first);

/* ---- judging (judge.c) ---- */

lg_status judge_windows(const app *app, const well_model *model, const lg_cut_series *from,
                        const lg_window_list *part, lg_judgement *out, lg_error *error);
/* The same for a classical model from the features of all windows, table (windows, d); seconds are those of
 * one thread. */
lg_status judge_rows(const app *app, const well_model *model, const lg_cut_series *from,
                     const lg_window_list *part, const double *table, lg_judgement *out, lg_error *error);
/* Windows of a judgement that are unlike those of training; *farthest: the farthest of them all. The model
 * has a novelty. */
size_t count_novel(const app *app, const well_model *model, const lg_cut_series *from,
                   const lg_judgement *judged, lg_novelty_result *farthest);
/* The results of lg_detector_tell. */
void json_metrics(app_json *json, const lg_judgement *judged, uint64_t hop, double rate);
/* The counts for people; nothing where there are many classes. */
void print_confusion(FILE *stream, const lg_judgement *judged, const well_model *model);
void print_metrics(const lg_judgement *judged, const well_model *model);

/* ---- pictures (pictures.c): FILE.svg or FILE.png ---- */

/* Points by class. */
typedef struct labelled {
    size_t count;
    uint32_t columns, classes;
    const double *x;                    /* (count, columns) */
    const uint32_t *label;              /* (count), < classes */
    char (*class_name)[LG_SERIES_NAME]; /* (classes) */
    char *const *column_name;           /* (columns) */
} labelled;

/* Every pair of the first eight columns at most, the distribution of each on the diagonal. */
lg_status draw_pairs(const app *app, const char *picture, const labelled *points, lg_error *error);
/* The first two columns in the plane, and with three or more the first three in space beside it. */
lg_status draw_clouds(const app *app, const char *picture, const labelled *points, lg_error *error);
/* Explained variance of each component and their running sum: variance (count), falling; `chosen`: components
 * that the model keeps, 0: all. */
lg_status draw_variance(const app *app, const char *picture, const double *variance, size_t count,
                        uint32_t chosen, lg_error *error);

typedef struct pruned_tree {
    double alpha, train_accuracy, test_accuracy; /* test_accuracy NaN without a test part */
    uint32_t nodes, depth;
} pruned_tree;
/* Accuracy and node count against alpha; rising alpha; `chosen`: the alpha of the model, a line. */
lg_status draw_pruning(const app *app, const char *picture, const pruned_tree *trees, size_t count,
                       double chosen, lg_error *error);
/* Boxes with the split, impurity, samples and class, for as many levels as are readable. */
lg_status draw_tree(const app *app, const char *picture, const lg_tree *tree,
                    char (*class_name)[LG_SERIES_NAME], char *const *column_name, lg_error *error);
/* The first three columns in space, the plane w.x + b = 0 and its margins w.x + b = -+1; w (3). */
lg_status draw_margin(const app *app, const char *picture, const labelled *points, const double *w, double b,
                      lg_error *error);
/* Two columns and the line w.x + b = 0; w (2), or NULL: no line. */
lg_status draw_plane(const app *app, const char *picture, const labelled *points, const double *w, double b,
                     lg_error *error);
/* Counts and parts of each row; confusion (classes, classes), rows are the truth. */
lg_status draw_confusion(const app *app, const char *picture, const uint64_t *confusion, uint32_t classes,
                         char (*class_name)[LG_SERIES_NAME], lg_error *error);

typedef struct roc_curve {
    const char *name; /* of the class against the others */
    const double *fpr, *tpr;
    size_t points;
    double auc;
} roc_curve;
lg_status draw_roc(const app *app, const char *picture, const roc_curve *curves, size_t count,
                   lg_error *error);

/* One regression line of BASELINE: the parts' standard deviations, acceleration and moment, (count) points.
 */
typedef struct regression {
    const double *acceleration, *moment; /* (count) */
    size_t count;
    double intercept, slope;
    uint32_t label;
} regression;
lg_status draw_regressions(const app *app, const char *picture, const regression *lines, size_t count,
                           char (*class_name)[LG_SERIES_NAME], lg_error *error);

/* Recordings of the same channels, such as intact and broken, or slack and tight: each channel against time,
 * and the moments against the lower accelerations (phase plots). */
typedef struct recording {
    const char *name;
    const float *samples; /* (count, channels) */
    size_t count;
} recording;
lg_status draw_recordings(const app *app, const char *picture, const recording *runs, size_t count,
                          uint32_t channels, char (*channel_name)[LG_SERIES_NAME], double rate,
                          lg_error *error);

/* The loss of a training: train_draw_loss of common/train.h. Objective against trial: draw_search of
 * common/search.h. */

#endif
