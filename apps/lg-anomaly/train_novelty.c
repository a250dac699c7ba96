/* lg-anomaly train --method novelty: learns what windows of the healthy class look like, and nothing else. */
#include <string.h>

#include "lg-anomaly/train.h"

/* Smaller than the default margin, which is for a third answer in addition to the classes of a classifier.
 * Here single windows beyond the limit are outvoted, while damage stays beyond it. */
static const double MARGIN = 1.6;

typedef struct alone {
    const app *app;
    well_model model;
    char names[2][LG_SERIES_NAME];
} alone;

static lg_detector_state *const state = &train_state;

static void describe(alone *self) {
    self->model = trained_model(WELL_NOVELTY, train_method_name(METHOD_NOVELTY));
    memcpy(self->names[0], train_run.healthy, LG_SERIES_NAME);
    memcpy(self->names[1], "unlike", sizeof "unlike");
    self->model.classes = 2;
    self->model.class_name = self->names;
    self->model.class_label = NULL;
}

/* Removes the windows of other classes from the training windows. */
static void keep_healthy(void) {
    const lg_cut_series *all = &state->all;
    lg_window_list *train = &state->train;
    size_t kept = 0;
    for (size_t i = 0; i < train->count; i++)
        if (all->data.series.label[all->windows.first[train->list[i]]] == 0)
            train->list[kept++] = train->list[i];
    train->count = kept;
}

static void judge(const alone *self) {
    const app *program = self->app;
    APP_MUST(program,
             judge_windows(program, &self->model, &state->all, &state->train, &state->train_judged, &error));
    APP_MUST(program, judge_windows(program, &self->model, lg_detector_tested(state), &state->tested,
                                    &state->judged, &error));
}

static void put_novelty(app_json *out, const void *novelty) {
    app_result_size(out, "feature_count", ((const lg_novelty *)novelty)->features, NULL);
    app_json_size(out, "bands", ((const lg_novelty *)novelty)->bands);
}

static void fit(alone *self) {
    const double begin = app_seconds();
    lg_novelty_options options;
    lg_novelty_options_init(&options);
    options.margin = MARGIN;
    APP_MUST(self->app, lg_novelty_fit(self->app->context, &options, &state->all.data.series,
                                       &state->all.windows, state->train.list, state->train.count,
                                       (int)self->app->threads, &self->model.novelty, &error));
    network_recipe.training.seconds = app_seconds() - begin;
}

void train_novelty(const app *program) {
    alone self = {.app = program};
    describe(&self);
    keep_healthy();
    check_plot(program, &self.model);
    fit(&self);
    judge(&self);
    save_trained(program, &self.model);
    draw_tested(program, view_of(&self.model, train_given.plot_kind, true), &self.model, &state->judged);
    report_trained(program, &self.model, put_novelty, &self.model.novelty);
    lg_novelty_destroy(&self.model.novelty);
}
