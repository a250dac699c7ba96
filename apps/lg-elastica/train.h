/* Training a surrogate: what `train` and `search` have in common. */
#ifndef LG_APPS_ELASTICA_TRAIN_H
#define LG_APPS_ELASTICA_TRAIN_H

#include "common/fit.h"
#include "lg-elastica/beam.h"

typedef struct train_values {
    fit_values fit;
    int preset, network, architecture, activation;
    int normalise, mirror, boundary, between; /* positions in "false", "true" */
    uint64_t embedding, hidden, layers;
    double gamma, train_fraction, test_fraction;
} train_values;

/* What the command line gave, over the defaults. */
extern train_values train_given;
extern const app_option train_options[];
extern const app_command train_command;

/* Whether a search may vary or fix the option: it belongs to the model or its training, not to files. */
bool train_is_hyperparameter(const char *option);

/* What was not given becomes the stored run's. */
void train_adopt(app *app, train_values *values, const lg_surrogate_run *stored);
/* The run that options and data describe. What was not given is the preset's, *preset, unless `resumed`:
 * then train_adopt has been called and *preset is NULL. */
lg_status train_run(app *app, train_values *values, const lg_elastica_data *data, bool resumed,
                    lg_surrogate_run *run, const lg_surrogate_preset **preset, lg_error *error);

/* ---- learn.c ---- */

/* Indices of the curves of one part, rising. */
typedef struct part_indices {
    uint32_t *list;
    size_t count;
} part_indices;
/* The split of a run's data. */
lg_status split_curves(const lg_surrogate_run *run, part_indices *train, part_indices *test, lg_error *error);

typedef struct learner {
    lg_surrogate_run run; /* all that determines the result */
    lg_surrogate_problem problem;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} learner;

/* `run` is copied, `curves` and `training` are borrowed. `options` holds what is free to differ between runs;
 * its hyperparameters are the run's. The learner must not move while it lives. */
lg_status learner_create(const lg_context *context, const lg_surrogate_run *run,
                         const lg_elastica_curves *curves, const part_indices *training,
                         const lg_fit_options *options, learner *out, lg_error *error);
void learner_destroy(learner *learned);
/* Errors of the fit's parameters over a part; all NaN for a part without curves. */
lg_status learner_errors(const lg_context *context, const learner *learned, const part_indices *part,
                         lg_surrogate_errors *out, lg_error *error);
/* The model with the state of its fit. */
lg_status save_model(const app *app, const char *path, const learner *learned, double train_mse,
                     double test_mse, lg_error *error);

#endif
