/* lg-anomaly search: random search over the options of train --method cnn. */
#include "common/search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

static const app_option search_options[] = {
    SEARCH_ROWS("Part of the windows that is held out beside the test part: the network's loss on it, at its "
                "best epoch, is the objective (default 0.1)"),
    APP_ROW_END};

static search_values values = SEARCH_DEFAULTS;

/* The loss of the validation part at the best epoch so far. */
static double objective_of(void *user) {
    const network *net = user;
    const uint64_t best = lg_fit_best_epoch(net->fit);
    return best > 0 ? lg_fit_history(net->fit, LG_FIT_VALIDATION)[best - 1] : (double)NAN;
}

static int read_data(void *user, const app *self, char sha256[LG_SHA256_TEXT]) {
    lg_series_data *data = user;
    const int code = read_series(self, self->arguments[1], NULL, data);
    if (code == APP_EXIT_OK) memcpy(sha256, data->sha256, LG_SHA256_TEXT);
    return code;
}

static lg_status train_trial(app *train, const lg_detector_run *run, const lg_series *series,
                             const lg_windows *windows, const uint8_t *parts, search_trial *trial,
                             lg_error *error) {
    part_indices chosen = part_of(parts, windows->count, LG_PART_TRAIN),
                 held = part_of(parts, windows->count, LG_PART_VALIDATION);
    network net;
    const lg_fit_options options = search_fit_options(trial, &run->training);
    lg_status status = held.count > 0
                           ? LG_OK
                           : app_error(error, LG_INVALID_ARGUMENT,
                                       "the validation part has no windows: a larger --validation");
    if (status == LG_OK) {
        status = network_create(train->context, run, series, windows, &chosen, &held, &options, &net, error);
        if (status == LG_OK) {
            status = search_fit(trial, net.fit, net.fit_problem.parameters, objective_of, &net, error);
            network_destroy(train->context, &net);
        }
    }
    free(chosen.list);
    free(held.list);
    return status;
}

static lg_status run_trial(void *user, app *train, void *given, double validation, search_trial *trial,
                           lg_error *error) {
    const lg_series_data *data = user;
    train_values *wanted = given;
    lg_detector_run run;
    const lg_detector_preset *preset;
    lg_windows windows;
    uint8_t *parts;
    wanted->fit.validation = validation;
    lg_status status = network_run(train, wanted, data, NULL, &run, &preset, error);
    if (status != LG_OK) return status;
    const well_cut cut = cut_of_run(&run);
    status = cut_and_split(train->context, &data->series, &cut, &windows, &parts, error);
    if (status != LG_OK) return status;
    run.windows = windows.count;
    status = train_trial(train, &run, &data->series, &windows, parts, trial, error);
    free(parts);
    lg_windows_destroy(train->context, &windows);
    return status;
}

static const char *refused(const char *option, const char *text) {
    if (strcmp(option, "method") == 0)
        return strcmp(text, train_methods[METHOD_CNN]) == 0 ? NULL : "can only be cnn in a search";
    return train_has_option(METHOD_CNN, option) ? NULL : "is no option of --method cnn";
}

static int run(app *self) {
    lg_series_data data;
    memset(&data, 0, sizeof data);
    const search_task task = {.train = &train_command,
                              .values_size = sizeof train_given,
                              .is_hyperparameter = train_is_hyperparameter,
                              .refused = refused,
                              .read = read_data,
                              .run = run_trial,
                              .user = &data};
    const int code = search_main(self, &values, &task);
    lg_series_data_destroy(self->context, &data);
    return code;
}

const app_command search_command = {
    .name = "search",
    .arguments = "RANGES.yaml DATA.h5",
    .summary = "Random search over the options of train --method cnn",
    .details =
        SEARCH_DETAILS " The test part (fixed: test-fraction, split) is never looked at: train the best "
                       "trial to see it.",
    .options = search_options,
    .values = &values,
    .arguments_min = 2,
    .arguments_max = 2,
    .run = run};
