/* lg-anomaly train --method novelty: what the windows of the first class look like, and nothing else. */
#include <string.h>

#include "lg-anomaly/train.h"

/* Closer than the limit of a third answer: single windows beyond it are outvoted, damage stays. */
static const double MARGIN = 1.6;

typedef struct alone {
    const app *app;
    lg_learning *learning;
    lg_detector_state *base;
    well_model model;
    char names[2][LG_SERIES_NAME];
} alone;

static void describe(alone *self) {
    const lg_detector_state *base = self->base;
    const lg_series *series = &base->all.data.series;
    memcpy(self->names[0], series->class_name[0], LG_SERIES_NAME);
    memcpy(self->names[1], "unlike", sizeof "unlike");
    self->model = (well_model){.sort = WELL_NOVELTY,
                               .method = train_method_name(METHOD_NOVELTY),
                               .classes = 2,
                               .channels = series->channels,
                               .window = (uint32_t)train_run.window,
                               .rate = series->rate,
                               .class_name = self->names,
                               .channel_name = series->channel_name,
                               .cut = train_run};
}

/* Windows of other classes are no training windows. */
static void keep_first_class(lg_detector_state *base) {
    const lg_series *series = &base->all.data.series;
    size_t kept = 0;
    for (size_t i = 0; i < base->train.count; i++)
        if (series->label[base->all.windows.first[base->train.list[i]]] == 0)
            base->train.list[kept++] = base->train.list[i];
    base->train.count = kept;
}

static void judge(alone *self) {
    lg_detector_state *base = self->base;
    APP_MUST(self->app,
             judge_windows(self->app, &self->model, &base->all, &base->train, &base->train_judged, &error));
    APP_MUST(self->app, judge_windows(self->app, &self->model, lg_detector_tested(base), &base->tested,
                                      &base->judged, &error));
}

static void report(const alone *self) {
    const lg_novelty *novelty = &self->model.novelty;
    if (!self->app->json) {
        (void)printf("%s: novelty, %u features, windows of '%s' alone (%.3f s)\n", train_given_files.out,
                     novelty->features, self->names[0], self->learning->seconds);
        print_trained(&self->model);
        return;
    }
    app_json json;
    app_json_begin(&json);
    json_trained(&json, self->learning, &self->model);
    app_json_text(&json, "split", lg_split_name(train_run.split));
    app_json_real(&json, "test_fraction", train_run.test_fraction);
    app_json_size(&json, "feature_count", novelty->features);
    app_json_size(&json, "bands", novelty->bands);
    app_json_size(&json, "seed", self->app->seed);
    app_json_size(&json, "threads", self->app->threads);
    app_json_text(&json, "out", train_given_files.out);
    app_json_warnings(&json, self->app);
    app_json_end(&json);
}

static void fit(alone *self) {
    const lg_detector_state *base = self->base;
    const double begin = app_seconds();
    lg_novelty_options options;
    lg_novelty_options_init(&options);
    options.margin = MARGIN;
    APP_MUST(self->app, lg_novelty_fit(self->app->context, &options, &base->all.data.series,
                                       &base->all.windows, base->train.list, base->train.count,
                                       (int)self->app->threads, &self->model.novelty, &error));
    self->learning->seconds = app_seconds() - begin;
}

void train_novelty(const app *program, lg_learning *learning) {
    alone self = {.app = program, .learning = learning, .base = learning->state};
    describe(&self);
    keep_first_class(self.base);
    if (train_given_files.plot != NULL) check_view(program, &self.model, train_given.picture, true);
    fit(&self);
    judge(&self);
    save_trained(program, &self.model);
    if (train_given_files.plot != NULL)
        draw_tested(program, view_of(&self.model, train_given.picture, true), &self.model,
                    &self.base->judged);
    report(&self);
    lg_novelty_destroy(&self.model.novelty);
}
