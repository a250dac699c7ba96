/* lg-anomaly train: trains a model on labelled series and writes its file. */
#include <math.h>
#include <string.h>

#include "lg-anomaly/train.h"

/* Default window and hop of the baseline, in seconds. */
static const double baseline_window = 600, baseline_hop = 60;
/* If the rate is unknown, the baseline's window has so many stored windows, and its hop is one. */
enum { BASELINE_STORED = 10 };

/* ---- results of all methods ---- */

void save_trained(const app *self, const well_model *model) {
    const char *path = train_given_files.out;
    const lg_metrics *metrics = &train_state.judged.metrics;
    APP_MUST_FILE(self, path, well_model_save(self, path, model, metrics->accuracy, metrics->f1, &error));
}

void check_plot(const app *self, const well_model *model) {
    if (train_given_files.plot != NULL) check_view(self, model, train_given.plot_kind, true);
}

void draw_tested(const app *self, int view, const well_model *model, const lg_judgement *judged) {
    if (train_given_files.plot != NULL)
        draw_view(self, train_given_files.plot, view, model, lg_detector_tested(&train_state), judged);
}

well_model trained_model(well_sort sort, const char *method) {
    const lg_series *series = &train_state.all.data.series;
    return (well_model){.sort = sort,
                        .method = method,
                        .classes = series->classes,
                        .channels = series->channels,
                        .window = (uint32_t)train_run.window,
                        .rate = series->rate,
                        .healthy = train_state.healthy,
                        .class_name = series->class_name,
                        .class_label = series->class_label,
                        .channel_name = series->channel_name,
                        .cut = train_run};
}

void report_trained(const app *self, const well_model *model, void (*put)(app_json *, const void *),
                    const void *user) {
    lg_training *training = &network_recipe.training;
    app_json out;
    app_result_begin(&out, self);
    put_metrics(&out, &train_state.judged, model);
    lg_detector_tell_training(training, model->method, model->classes, model->class_name);
    train_put_results(&out, training, 0, training->result_count);
    app_result_text(&out, "healthy", train_run.healthy[0] != '\0' ? train_run.healthy : NULL, NULL);
    app_result_text(&out, "split", lg_split_name(train_run.split), NULL);
    app_json_real(&out, "test_fraction", train_run.test_fraction);
    put(&out, user);
    app_json_size(&out, "seed", self->seed);
    app_json_size(&out, "threads", self->threads);
    app_result_text(&out, "out", train_given_files.out, NULL);
    if (model->sort == WELL_CLASSICAL) app_json_real(&out, "floor", (double)NAN);
    app_json_warnings(&out, self);
    app_json_end(&out);
}

/* ---- the classical methods ---- */

/* Sets the baseline's window and hop if the data are recordings; otherwise a window is a stored window. */
static void baseline_defaults(const lg_series *series, uint64_t *window, uint64_t *hop) {
    if (series->run == NULL) return;
    if (series->rate > 0) {
        *window = (uint64_t)fmax(floor(baseline_window * series->rate + 0.5), 1);
        *hop = (uint64_t)fmax(floor(baseline_hop * series->rate + 0.5), 1);
    } else {
        *window = (uint64_t)BASELINE_STORED * series->length;
        *hop = series->length;
    }
}

static void merge_into_two(const app *self) {
    const well_model model = trained_model(WELL_CLASSICAL, "novelty");
    well_model_need_healthy(self, &model, "--method novelty");
    merge_classes(&train_state.all.data.series, train_run.healthy);
    if (train_state.test != NULL) merge_classes(&train_state.foreign.data.series, train_run.healthy);
    train_state.healthy = 0;
}

static void run_classical(const app *self) {
    lg_training *training = &network_recipe.training;
    const lg_series_data *data = &train_state.all.data;
    const bool alone = train_given.method == METHOD_NOVELTY;
    if (train_state.test != NULL) train_run.test_fraction = 0;
    train_run.validation_fraction = 0;
    train_run.training.seed = self->seed;
    train_run.window = data->series.length;
    memcpy(train_run.data_sha256, data->sha256, sizeof data->sha256);
    APP_MUST(self, lg_detector_settle(training, &error));
    if (alone) merge_into_two(self);
    if (data->series.classes < 2 && !alone)
        app_stop(self, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'", data->series.class_name[0]);
    if (train_given.method == METHOD_BASELINE)
        baseline_defaults(&data->series, &train_run.window, &train_run.hop);
    APP_MUST(self, lg_detector_window(training, &train_run.window, &train_run.hop, &error));
    APP_MUST(self, lg_detector_split(training, &error));
    (alone ? train_novelty : train_classical)(self);
}

/* ---- the command ---- */

static int run_train(app *self) {
    train_check_options(self);
    if (train_given.method == METHOD_CNN) return train_main(self, &network_recipe);
    if (self->rank_count > 1) app_stop_usage(self, "only --method cnn can be trained by several ranks");
    train_state.any_class = train_given.method == METHOD_NOVELTY; /* all other classes count as one */
    train_open(self, &network_recipe);
    run_classical(self);
    lg_training_close(&network_recipe.training);
    return APP_EXIT_OK;
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Train a detector on labelled windows",
    .details =
        "DATA.h5 holds /X (n, channels, samples) and /y (n), any number of classes; /group, /run and the "
        "attributes rate, classes and channels if they are known (docs/detectors.md).\n\nScaling, components "
        "and grids are fitted on the training part only. Metrics are those of the test part: precision, "
        "recall and F1 for two classes those of the class that is not healthy, otherwise their mean over the "
        "classes. false_alarms_per_day is the number of windows per day that would be given another class if "
        "all were of the healthy one (--healthy).\n\nCtrl-C saves a checkpoint (cnn) and ends with exit code "
        "130; --resume continues to "
        "the same bits.",
    .settings = train_settings,
    .run = run_train,
    .together = APP_RANKS};
