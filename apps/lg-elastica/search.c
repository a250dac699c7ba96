/* lg-elastica search: random search over the options of train. */
#include "common/search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/train.h"

static const app_option search_options[] = {
    SEARCH_ROWS("Part of the training curves that is held out: their mean squared error is the objective "
                "(default 0.1)"),
    APP_ROW_END};

static search_values values = SEARCH_DEFAULTS;

/* One trial while it is trained. */
typedef struct trial_state {
    const lg_context *context;
    learner learner;
    part_indices train, validation;
} trial_state;

/* The training part without what is held out; both lists are the caller's. */
static lg_status hold_out(const lg_surrogate_run *run, double validation, part_indices *train,
                          part_indices *held, lg_error *error) {
    part_indices whole, test;
    lg_status status = split_curves(run, &whole, &test, error);
    if (status != LG_OK) return status;
    free(test.list);
    uint8_t *parts = app_alloc(whole.count, 1);
    status = lg_surrogate_split(whole.count, 1 - validation, validation, run->training.seed, parts);
    *train = (part_indices){app_alloc(whole.count, sizeof *train->list), 0};
    *held = (part_indices){app_alloc(whole.count, sizeof *held->list), 0};
    for (size_t i = 0; i < whole.count && status == LG_OK; i++) {
        part_indices *to = parts[i] == LG_PART_TEST ? held : train;
        to->list[to->count++] = whole.list[i];
    }
    free(parts);
    if (status == LG_OK && held->count > 0 && train->count > 0) {
        free(whole.list);
        return LG_OK;
    }
    (void)app_error(error, LG_INVALID_ARGUMENT, "--validation %g of %zu curves leaves a part without any",
                    validation, whole.count);
    free(whole.list);
    free(train->list);
    free(held->list);
    return LG_INVALID_ARGUMENT;
}

static double objective_of(void *user) {
    const trial_state *state = user;
    lg_surrogate_errors errors;
    const lg_status status =
        learner_errors(state->context, &state->learner, &state->validation, &errors, NULL);
    return status == LG_OK ? errors.mse : (double)NAN;
}

static int read_data(void *user, const app *self, char sha256[LG_SHA256_TEXT]) {
    lg_elastica_data *data = user;
    const int code = read_curves(self, self->arguments[1], data);
    if (code == APP_EXIT_OK) memcpy(sha256, data->sha256, LG_SHA256_TEXT);
    return code;
}

static lg_status run_trial(void *user, app *train, void *given, double validation, search_trial *trial,
                           lg_error *error) {
    const lg_elastica_data *data = user;
    trial_state state = {.context = train->context};
    lg_surrogate_run run;
    const lg_surrogate_preset *preset;
    lg_status status = train_run(train, given, data, false, &run, &preset, error);
    if (status == LG_OK) status = hold_out(&run, validation, &state.train, &state.validation, error);
    if (status != LG_OK) return status;
    const lg_fit_options options = search_fit_options(trial, &run.training);
    status =
        learner_create(train->context, &run, &data->curves, &state.train, &options, &state.learner, error);
    if (status == LG_OK)
        status = search_fit(trial, state.learner.fit, lg_surrogate_parameters(&run.model), objective_of,
                            &state, error);
    learner_destroy(&state.learner);
    free(state.train.list);
    free(state.validation.list);
    return status;
}

static int run(app *self) {
    lg_elastica_data data = {.sha256 = ""};
    const search_task task = {.train = &train_command,
                              .values_size = sizeof train_given,
                              .is_hyperparameter = train_is_hyperparameter,
                              .read = read_data,
                              .run = run_trial,
                              .user = &data};
    const int code = search_main(self, &values, &task);
    lg_elastica_data_destroy(self->context, &data);
    return code;
}

const app_command search_command = {.name = "search",
                                    .arguments = "RANGES.yaml DATA.h5",
                                    .summary = "Random search over the options of train",
                                    .details = SEARCH_DETAILS,
                                    .options = search_options,
                                    .values = &values,
                                    .arguments_min = 2,
                                    .arguments_max = 2,
                                    .run = run};
