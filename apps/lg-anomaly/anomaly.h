/* Declarations that the commands of lg-anomaly share: labelled data, models, judging, plots. A function
 * that returns int returns an exit code and has printed a message if it is not APP_EXIT_OK. A function that
 * returns a status explains a failure in `error`. Any other function ends the command if it fails. */
#ifndef LG_APPS_ANOMALY_H
#define LG_APPS_ANOMALY_H

#include "anomaly/files/recipe.h"
#include "common/app.h"
#include "common/classifier_file.h"

extern const app_command anomaly_generate_command, anomaly_feed_command, anomaly_train_command,
    anomaly_evaluate_command, anomaly_search_command, anomaly_watch_command;

/* ---- the simulated well (generate.c) ---- */

extern const char *const housing_names[];   /* indexed by lg_housing */
extern const char *const operation_names[]; /* drilling, completion */

/* What is chosen before an operation and stays. */
typedef struct well_setup {
    int housing, operation;
    double load_relief, severity, noise;
} well_setup;
/* The options of a member `well` of type well_setup. */
#define WELL_ROWS(type)                                                                                      \
    LG_OPTION(type, well.housing, NAME, NULL, "slack (default) or tight", .option = "housing",               \
              .usual = true, .names = housing_names),                                                        \
        LG_OPTION(type, well.operation, NAME, NULL,                                                          \
                  "drilling (default), or completion: a Christmas tree below the BOP, brine in the riser",   \
                  .option = "operation", .names = operation_names),                                          \
        LG_OPTION(type, well.load_relief, REAL, "K",                                                         \
                  "Horizontal stiffness in N/m of wires that hold the BOP (default 0: no wires)",            \
                  .option = "load-relief", .high = 1e9),                                                     \
        LG_OPTION(type, well.severity, REAL, "R",                                                            \
                  "Remaining fraction of the broken casing's rotational stiffness: 1 is intact",             \
                  .option = "severity", .usual = true, .low = 1e-3, .high = 1, .value = "0.58"),             \
        LG_OPTION(type, well.noise, REAL, "F", "Noise of the sensors as a multiple of the data sheet's",     \
                  .option = "noise", .usual = true, .high = 1e6, .value = "1")
#define HOURS(type, ...)    LG_OPTION(type, hours, REAL, "H", __VA_ARGS__)
#define CRACK_AT(type, ...) LG_OPTION(type, crack_at, REAL, __VA_ARGS__)
void well_set_up(const well_setup *setup, lg_riser_parameters *parameters, lg_riser_run *run);

/* ---- models (model.c) ---- */

#define VOTES(type, unit_, ...)                                                                              \
    LG_OPTION(type, votes, WHOLES, unit_, "Raise an alarm when K of the last N windows " __VA_ARGS__,        \
              .low = 1, .high = 64)

typedef enum well_sort {
    WELL_NETWORK,   /* file of kind "detector" */
    WELL_CLASSICAL, /* file of kind "classifier" */
    /* File of kind "classifier", method "novelty": separates the healthy class, number 0, from all else. */
    WELL_NOVELTY
} well_sort;

/* A model that is ready to judge windows. */
typedef struct well_model {
    well_sort sort;
    union {
        classifier_file file;     /* of a network it has the members of LG_DETECTOR_HEAD */
        lg_detector_file network; /* of WELL_NETWORK */
    };
    const char *method;     /* by classifier_method_name */
    uint32_t window;        /* samples per window */
    uint32_t healthy;       /* class that means "all is well", or LG_NO_CLASS */
    lg_detector_plan *plan; /* evaluates the network, in the number type of its training */
} well_model;

/* The healthy class is unknown until well_model_settle. */
void well_model_load(const app *app, const char *path, well_model *out);
/* Sets the healthy class, if it is unknown, by lg_find_healthy: from `given` or the model's own. If it stays
 * unknown and `needed` is not NULL, ends the command with "NEEDED: it is unknown which class ...". */
void well_model_settle(const app *app, well_model *model, const char *given, const char *data,
                       const char *needed);
void well_model_destroy(well_model *model); /* a zeroed model is allowed */
/* How the model scores windows, without allocation; the class is lg_metrics_class(score). */
lg_scorer well_model_scorer(const well_model *model);
/* A single score for "not healthy"; the healthy class must be known. Two classes: the score of the other
 * class. More classes: 1 minus the probability of the healthy class, or without probabilities the best other
 * score minus the score of the healthy class. */
double well_model_alarm(const lg_scorer *by, const double *score);

/* Reads data whose classes and channels must be the model's. A novelty model accepts any classes and merges
 * them (lg_series_merge). */
void read_series_of(const app *app, const char *path, const well_model *model, lg_series_data *out);

/* ---- judging ---- */

/* Adds the results of lg_detector_tell. */
void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model);

#endif
