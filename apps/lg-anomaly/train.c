/* lg-anomaly train: from labelled series to a model file. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

const cut_series *tested_series(const trained *self) {
    return train_given.test != NULL ? &self->foreign : &self->all;
}

/* ---- what every method tells ---- */

void json_trained(app_json *json, const trained *self, const well_model *model) {
    const lg_series *series = &self->all.data.series;
    json_metrics(json, &self->judged, self->cut.hop, series->rate);
    app_json_real(json, "train_accuracy", self->train_judged.metrics.accuracy);
    app_json_real(json, "train_f1", self->train_judged.metrics.f1);
    app_json_real(json, "train_seconds", self->train_seconds);
    app_json_real(json, "test_seconds", self->judged.seconds);
    app_json_text(json, "method", model->method);
    app_json_open(json, "classes", '[');
    for (uint32_t c = 0; c < model->classes; c++) app_json_text(json, NULL, model->class_name[c]);
    app_json_close(json, ']');
    app_json_size(json, "channels", series->channels);
    app_json_size(json, "window", self->cut.window);
    app_json_size(json, "hop", self->cut.hop);
    app_json_real(json, "rate", series->rate > 0 ? series->rate : (double)NAN);
    app_json_size(json, "windows", self->all.windows.count);
    app_json_size(json, "train_windows", self->train.count);
    app_json_size(json, "validation_windows", self->validation.count);
    app_json_size(json, "test_windows", self->test.count);
    app_json_text(json, "test", train_given.test);
    app_json_text(json, "data_sha256", self->cut.data_sha256);
}

void print_trained(const trained *self, const well_model *model) {
    (void)printf("%zu windows for training, accuracy %.4f on them; the test part (%s):\n", self->train.count,
                 self->train_judged.metrics.accuracy,
                 train_given.test != NULL ? train_given.test : lg_split_name(self->cut.split));
    print_metrics(&self->judged, model);
}

/* ---- reading and cutting ---- */

static int read_test(trained *state) {
    const char *path = train_given.test;
    const app *self = state->app;
    const lg_series *series = &state->all.data.series;
    if (path == NULL) return APP_EXIT_OK;
    const bool any = train_given.method == METHOD_NOVELTY; /* all classes but the first are one */
    const int code = read_series(self, path, any ? NULL : series, &state->foreign.data);
    if (code != APP_EXIT_OK) return code;
    const lg_series_data *test = &state->foreign.data;
    if (test->series.channels != series->channels)
        return app_fail(self, LG_SHAPE, "%s: %u channels, %s has %u", path, test->series.channels,
                        self->arguments[0], series->channels);
    if (strcmp(test->sha256, state->all.data.sha256) == 0)
        app_warn(self, "%s holds the same windows as %s: there is no test on unseen data", path,
                 self->arguments[0]);
    return APP_EXIT_OK;
}

int read_all(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    trained *state = user;
    const int code = read_series(self, path, NULL, &state->all.data);
    if (code != APP_EXIT_OK) return code;
    memcpy(sha256, state->all.data.sha256, LG_SHA256_TEXT);
    return read_test(state);
}

static int fail(const app *self, lg_status status, const lg_error *error) {
    return app_fail(self, status, "%s", app_sentence(status, error));
}

static void warn_of_cut(const trained *self) {
    const well_cut *cut = &self->cut;
    if (cut->validation_fraction > 0 && self->validation.count == 0)
        app_warn(self->app,
                 "--validation %g: this fraction of the %ss has no window: the parameters of the last epoch "
                 "are kept",
                 cut->validation_fraction,
                 cut->split == LG_SPLIT_RANDOM ? "window" : lg_split_name(cut->split));
    if (self->cut.hop < self->cut.window && cut->split == LG_SPLIT_RANDOM &&
        (cut->test_fraction > 0 || cut->validation_fraction > 0))
        app_warn(self->app, "windows overlap and are split at random, so training samples are also test "
                            "samples; use --split run or --split group");
}

int cut_parts(trained *self) {
    const lg_context *context = self->app->context;
    lg_error error = {LG_OK, ""};
    uint8_t *parts;
    cut_series *all = &self->all, *foreign = &self->foreign;
    lg_status status = cut_and_split(context, &all->data.series, &self->cut, &all->windows, &parts, &error);
    if (status != LG_OK) return fail(self->app, status, &error);
    self->cut.windows = all->windows.count;
    self->train = part_of(parts, all->windows.count, LG_PART_TRAIN);
    self->validation = part_of(parts, all->windows.count, LG_PART_VALIDATION);
    if (train_given.test == NULL) {
        self->test = part_of(parts, all->windows.count, LG_PART_TEST);
    } else {
        status = lg_windows_create(context, &foreign->data.series, (size_t)self->cut.window,
                                   (size_t)self->cut.hop, &foreign->windows, &error);
        if (status == LG_OK) self->test = part_all(foreign->windows.count);
    }
    free(parts);
    if (status != LG_OK && status != LG_OUT_OF_MEMORY)
        return app_fail_file(self->app, status, &error, train_given.test);
    if (status != LG_OK) return fail(self->app, status, &error);
    warn_of_cut(self);
    return APP_EXIT_OK;
}

/* ---- the command ---- */

static void merge_into_two(trained *state) {
    char first[LG_SERIES_NAME];
    memcpy(first, state->all.data.series.class_name[0], sizeof first);
    merge_classes(&state->all.data.series, first);
    if (train_given.test != NULL) merge_classes(&state->foreign.data.series, first);
}

static int run_classical(trained *state) {
    app *self = state->app;
    const lg_series_data *data = &state->all.data;
    lg_error error = {LG_OK, ""};
    state->cut = (well_cut){.split = train_run.split,
                            .test_fraction = train_given.test != NULL ? 0 : train_run.test_fraction,
                            .seed = self->seed};
    memcpy(state->cut.data_sha256, data->sha256, sizeof state->cut.data_sha256);
    const bool alone = train_given.method == METHOD_NOVELTY;
    if (alone) merge_into_two(state);
    if (data->series.classes < 2 && !alone)
        return app_fail(self, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'",
                        data->series.class_name[0]);
    const lg_status status = window_of(self, &data->series, &state->cut.window, &state->cut.hop, &error);
    if (status != LG_OK) return fail(self, status, &error);
    const int code = cut_parts(state);
    if (code != APP_EXIT_OK) return code;
    return alone ? train_novelty(state) : train_classical(state);
}

static int train(app *self, const train_task *task) {
    char sha256[LG_SHA256_TEXT];
    int code = train_check_options(self);
    if (code != APP_EXIT_OK) return code;
    if (train_given.method == METHOD_CNN) return train_main(self, task);
    if (self->rank_count > 1) return app_usage(self, "--method cnn alone trains by ranks");
    code = train_check(self, task);
    if (code == APP_EXIT_OK) code = task->read(task->user, self, self->arguments[0], sha256);
    return code == APP_EXIT_OK ? run_classical(task->user) : code;
}

int with_task(app *self, int (*main_)(app *self, const train_task *task)) {
    trained *state = app_alloc(1, sizeof *state);
    state->app = self;
    const train_task task = network_task(state);
    const int code = main_(self, &task);
    task.release(state);
    lg_series_data_destroy(&state->all.data);
    lg_series_data_destroy(&state->foreign.data);
    free(state);
    return code;
}

static int run_train(app *self) {
    return with_task(self, train);
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Train a detector on labelled windows",
    .details =
        "DATA.h5 holds /X (n, channels, samples) and /y (n), any number of classes; /group, /run and the "
        "attributes rate, classes and channels if they are known (docs/anomaly.md).\n\nScaling, components "
        "and grids are fitted on the training part only. Metrics are those of the test part: precision, "
        "recall and F1 of class 1 for two classes, otherwise their mean over the classes. "
        "false_alarms_per_day is the number of windows a day that would be given another class if all were "
        "of class 0.\n\nCtrl-C saves a checkpoint (cnn) and ends with exit code 130; --resume continues to "
        "the same bits.",
    .settings = train_settings,
    .run = run_train,
    .together = APP_RANKS};
