/* lg-anomaly train: from labelled series to a model file. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

const cut_series *tested_series(const trained *self) {
    return self->foreign != NULL ? self->foreign : self->all;
}

/* ---- what every method tells ---- */

void json_trained(app_json *json, const trained *self, const well_model *model) {
    const lg_series *series = &self->all->data.series;
    json_metrics(json, &self->judged, self->cut.hop, series->rate);
    app_json_real(json, "train_accuracy", self->train_judged.metrics.accuracy);
    app_json_real(json, "train_f1", self->train_judged.metrics.f1);
    app_json_real(json, "train_seconds", self->train_seconds);
    app_json_real(json, "test_seconds", self->judged.seconds);
    app_json_text(json, "method", model->method);
    app_json_open(json, "classes", '[');
    for (uint32_t c = 0; c < series->classes; c++) app_json_text(json, NULL, series->class_name[c]);
    app_json_close(json, ']');
    app_json_size(json, "channels", series->channels);
    app_json_size(json, "window", self->cut.window);
    app_json_size(json, "hop", self->cut.hop);
    app_json_real(json, "rate", series->rate > 0 ? series->rate : (double)NAN);
    app_json_size(json, "windows", self->all->windows.count);
    app_json_size(json, "train_windows", self->train.count);
    app_json_size(json, "validation_windows", self->validation.count);
    app_json_size(json, "test_windows", self->test.count);
    app_json_text(json, "split", train_splits[self->cut.split]);
    app_json_real(json, "test_fraction", self->cut.test_fraction);
    app_json_text(json, "test", self->values->test);
    app_json_text(json, "data_sha256", self->cut.data_sha256);
}

void print_trained(const trained *self, const well_model *model) {
    (void)printf("%zu windows to train on, accuracy %.4f on them; the test part (%s):\n", self->train.count,
                 self->train_judged.metrics.accuracy,
                 self->foreign != NULL ? self->values->test : train_splits[self->cut.split]);
    print_metrics(&self->judged, model);
}

/* ---- reading and cutting ---- */

static int read_test(const app *self, const train_values *values, const cut_series *all, cut_series *out) {
    if (values->test == NULL) return APP_EXIT_OK;
    const lg_series *series = &all->data.series;
    const int code = read_series(self, values->test, series, &out->data);
    if (code != APP_EXIT_OK) return code;
    if (out->data.series.channels != series->channels)
        return app_fail(self, LG_SHAPE, "%s: %u channels, %s has %u", values->test, out->data.series.channels,
                        self->arguments[0], series->channels);
    if (strcmp(out->data.sha256, all->data.sha256) == 0)
        app_warn(self, "%s holds the windows of %s: nothing is tested on unseen data", values->test,
                 self->arguments[0]);
    return APP_EXIT_OK;
}

static int fail_cut(const app *self, lg_status status, const lg_error *error) {
    return app_fail(self, status, "%s",
                    error->message[0] != '\0' ? error->message : lg_status_sentence(status));
}

/* Windows and parts by self->cut; windows->count is entered there. */
static int cut_parts(trained *self, cut_series *all, cut_series *foreign) {
    const lg_context *context = self->app->context;
    lg_error error = {LG_OK, ""};
    uint8_t *parts;
    lg_status status = cut_and_split(context, &all->data.series, &self->cut, &all->windows, &parts, &error);
    if (status != LG_OK) return fail_cut(self->app, status, &error);
    self->cut.windows = all->windows.count;
    self->train = part_of(parts, all->windows.count, LG_PART_TRAIN);
    self->validation = part_of(parts, all->windows.count, LG_PART_VALIDATION);
    if (self->values->test == NULL) {
        self->test = part_of(parts, all->windows.count, LG_PART_TEST);
    } else {
        status = lg_windows_create(context, &foreign->data.series, (size_t)self->cut.window,
                                   (size_t)self->cut.hop, &foreign->windows, &error);
        if (status == LG_OK) self->test = part_all(foreign->windows.count);
        self->foreign = foreign;
        if (status != LG_OK && status != LG_OUT_OF_MEMORY) {
            free(parts);
            return app_fail_file(self->app, status, &error, self->values->test);
        }
    }
    free(parts);
    if (status != LG_OK) return fail_cut(self->app, status, &error);
    if (self->cut.validation_fraction > 0 && self->validation.count == 0)
        app_warn(self->app,
                 "--validation %g: too small a part of these %ss to have a window: the last epoch's "
                 "parameters are taken",
                 self->cut.validation_fraction,
                 self->cut.split == LG_SPLIT_RANDOM ? "window" : train_splits[self->cut.split]);
    if (self->cut.hop < self->cut.window && self->cut.split == LG_SPLIT_RANDOM &&
        (self->cut.test_fraction > 0 || self->cut.validation_fraction > 0))
        app_warn(self->app, "windows overlap and are split at random: samples that were trained on are "
                            "tested on too; take --split run or --split group");
    return APP_EXIT_OK;
}

static void free_parts(trained *self) {
    free(self->train.list);
    free(self->validation.list);
    free(self->test.list);
    judgement_free(&self->train_judged);
    judgement_free(&self->judged);
}

/* ---- networks ---- */

static int compare_stored(const app *self, const char *path, const lg_detector_run *stored,
                          const lg_detector_run *run) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_detector_run_compare(path, stored, run, &error);
    return status == LG_OK ? APP_EXIT_OK : fail_cut(self, status, &error);
}

static int run_network(trained *state, cut_series *all, cut_series *foreign) {
    app *self = state->app;
    lg_error error = {LG_OK, ""};
    lg_detector_run run, stored_run;
    lg_file_reader *stored = NULL;
    const lg_detector_preset *preset;
    const char *resume = train_given.fit.resume;
    if (resume != NULL) {
        const lg_status status =
            lg_detector_checkpoint_open(self->context, resume, NULL, &stored_run, &stored, &error);
        if (status != LG_OK) return app_fail_file(self, status, &error, resume);
    }
    const lg_status status = network_run(self, &train_given, &all->data, stored != NULL ? &stored_run : NULL,
                                         &run, &preset, &error);
    int code = status == LG_OK ? APP_EXIT_OK : fail_cut(self, status, &error);
    if (code == APP_EXIT_OK) {
        state->cut = cut_of_run(&run);
        /* The data are compared before they are cut: another set need not be cut in the same way. */
        run.windows = stored != NULL ? stored_run.windows : 0;
        if (stored != NULL) code = compare_stored(self, resume, &stored_run, &run);
    }
    if (code == APP_EXIT_OK) code = cut_parts(state, all, foreign);
    if (code == APP_EXIT_OK) {
        run.windows = state->cut.windows;
        if (stored != NULL) code = compare_stored(self, resume, &stored_run, &run);
    }
    if (code == APP_EXIT_OK) code = train_network(state, &run, preset, stored);
    lg_file_reader_close(stored);
    return code;
}

static int run_classical(trained *state, cut_series *all, cut_series *foreign) {
    app *self = state->app;
    lg_error error = {LG_OK, ""};
    state->cut = (well_cut){.split = (lg_split)train_given.split,
                            .test_fraction = train_given.test != NULL ? 0 : train_given.test_fraction,
                            .seed = self->seed};
    memcpy(state->cut.data_sha256, all->data.sha256, sizeof state->cut.data_sha256);
    if (all->data.series.classes < 2)
        return app_fail(self, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'",
                        all->data.series.class_name[0]);
    const lg_status status =
        window_of(self, &train_given, &all->data.series, &state->cut.window, &state->cut.hop, &error);
    if (status != LG_OK) return fail_cut(self, status, &error);
    const int code = cut_parts(state, all, foreign);
    return code == APP_EXIT_OK ? train_classical(state) : code;
}

/* ---- the command ---- */

static int check_files(const app *self) {
    const fit_values *fit = &train_given.fit;
    const app_path paths[] = {{"test", train_given.test, APP_READ},
                              {"out", fit->out, APP_WRITTEN},
                              {"checkpoint", fit->checkpoint, APP_WRITTEN},
                              {"history", fit->history, APP_WRITTEN},
                              {"plot", fit->plot, APP_DRAWN}};
    const int code = fit_check_outputs(self, fit);
    if (code != APP_EXIT_OK || train_given.test == NULL) return code;
    return app_check_outputs(self, paths, APP_COUNT(paths));
}

static int run_train(app *self) {
    cut_series all, foreign;
    memset(&all, 0, sizeof all);
    memset(&foreign, 0, sizeof foreign);
    trained state = {.app = self, .values = &train_given, .all = &all};
    int code = train_check_options(self, &train_given);
    if (code == APP_EXIT_OK && train_given.fit.resume != NULL && app_given(self, "preset"))
        code = app_usage(self, "--preset: a resumed run has its settings already");
    if (code == APP_EXIT_OK) code = check_files(self);
    if (code == APP_EXIT_OK) code = read_series(self, self->arguments[0], NULL, &all.data);
    if (code != APP_EXIT_OK) return code;
    code = read_test(self, &train_given, &all, &foreign);
    if (code == APP_EXIT_OK)
        code = train_given.method == METHOD_CNN ? run_network(&state, &all, &foreign)
                                                : run_classical(&state, &all, &foreign);
    free_parts(&state);
    lg_windows_destroy(self->context, &all.windows);
    lg_windows_destroy(self->context, &foreign.windows);
    lg_series_data_destroy(self->context, &all.data);
    lg_series_data_destroy(self->context, &foreign.data);
    return code;
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Train a detector on labelled windows",
    .details =
        "DATA.h5 holds /X (n, channels, samples) and /y (n), any number of classes; /group, /run and the "
        "attributes rate, classes and channels where they are known (docs/anomaly.md).\n\nAll that is fitted "
        "-- scaling, components, grids -- is fitted on the training part. Metrics are those of the test "
        "part: precision, recall and F1 of class 1 where there are two, otherwise their mean over the "
        "classes; false_alarms_per_day: windows of class 0 that were given another class, were all of them "
        "of class 0.\n\nCtrl-C saves a checkpoint (cnn) and ends with exit code 130; --resume continues to "
        "the same bits.",
    .options = train_options,
    .values = &train_given,
    .arguments_min = 1,
    .arguments_max = 1,
    .run = run_train};
