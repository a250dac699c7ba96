/* What the training windows look like: for every method, and lg-anomaly train --method novelty, which is
 * that alone. */
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

int fit_novelty(const trained *self, const part_indices *part, lg_novelty *out) {
    const app *program = self->app;
    lg_novelty_options options;
    lg_error error = {LG_OK, ""};
    lg_novelty_options_init(&options);
    const lg_status status =
        lg_novelty_fit(program->context, &options, &self->all.data.series, &self->all.windows, part->list,
                       part->count, (int)program->threads, out, &error);
    if (status == LG_CANCELLED) return app_fail(program, status, "stopped by %s", app_stopper());
    if (status != LG_OK)
        app_warn(program,
                 "the model does not know what its windows look like (%s): `watch` will not tell windows "
                 "that are unlike them",
                 error.message);
    return APP_EXIT_OK;
}

/* ---- alone ---- */

/* Closer than the limit of a third answer: single windows beyond it are outvoted, damage stays. */
static const double MARGIN = 1.6;

typedef struct alone {
    trained *base;
    well_model model;
    char names[2][LG_SERIES_NAME];
} alone;

static void describe(alone *self) {
    const trained *base = self->base;
    const lg_series *series = &base->all.data.series;
    memcpy(self->names[0], series->class_name[0], LG_SERIES_NAME);
    memcpy(self->names[1], "unlike", sizeof "unlike");
    self->model = (well_model){.sort = WELL_NOVELTY,
                               .method = train_method_name(METHOD_NOVELTY),
                               .classes = 2,
                               .channels = series->channels,
                               .window = (uint32_t)base->cut.window,
                               .rate = series->rate,
                               .class_name = self->names,
                               .channel_name = series->channel_name,
                               .cut = base->cut};
}

/* Windows of other classes are no training windows. */
static void keep_first_class(trained *base) {
    const lg_series *series = &base->all.data.series;
    size_t kept = 0;
    for (size_t i = 0; i < base->train.count; i++)
        if (series->label[base->all.windows.first[base->train.list[i]]] == 0)
            base->train.list[kept++] = base->train.list[i];
    base->train.count = kept;
}

static lg_status judge(alone *self, lg_error *error) {
    trained *base = self->base;
    const cut_series *tested = tested_series(base);
    const lg_status status = judge_windows(base->app, &self->model, &base->all.data.series,
                                           &base->all.windows, &base->train, &base->train_judged, error);
    if (status != LG_OK) return status;
    return judge_windows(base->app, &self->model, &tested->data.series, &tested->windows, &base->test,
                         &base->judged, error);
}

static void report(const alone *self) {
    const trained *base = self->base;
    const lg_novelty *novelty = &self->model.novelty;
    if (!base->app->json) {
        (void)printf("%s: novelty, %u features, windows of '%s' alone (%.3f s)\n", train_given_files.out,
                     novelty->features, self->names[0], base->train_seconds);
        print_trained(base, &self->model);
        return;
    }
    app_json json;
    app_json_begin(&json);
    json_trained(&json, base, &self->model);
    app_json_text(&json, "split", lg_split_name(base->cut.split));
    app_json_real(&json, "test_fraction", base->cut.test_fraction);
    app_json_size(&json, "feature_count", novelty->features);
    app_json_size(&json, "bands", novelty->bands);
    app_json_size(&json, "seed", base->app->seed);
    app_json_size(&json, "threads", base->app->threads);
    app_json_text(&json, "out", train_given_files.out);
    app_json_warnings(&json, base->app);
    app_json_end(&json);
}

static int draw(const alone *self) {
    const trained *base = self->base;
    const cut_series *tested = tested_series(base);
    lg_error error = {LG_OK, ""};
    if (train_given_files.plot == NULL) return APP_EXIT_OK;
    const lg_status status =
        draw_view(base->app, train_given_files.plot, view_of(&self->model, train_given.picture, true),
                  &self->model, &tested->data.series, &tested->windows, &base->judged, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(base->app, status, &error, train_given_files.plot);
}

static int train(alone *self) {
    trained *base = self->base;
    const char *path = train_given_files.out;
    lg_novelty_options options;
    lg_error error = {LG_OK, ""};
    if (train_given_files.plot != NULL) {
        const int refused = check_view(base->app, &self->model, train_given.picture, true);
        if (refused != APP_EXIT_OK) return refused;
    }
    const double begin = app_seconds();
    lg_novelty_options_init(&options);
    options.margin = MARGIN;
    lg_status status = lg_novelty_fit(base->app->context, &options, &base->all.data.series,
                                      &base->all.windows, base->train.list, base->train.count,
                                      (int)base->app->threads, &self->model.novelty, &error);
    base->train_seconds = app_seconds() - begin;
    if (status == LG_OK) status = judge(self, &error);
    if (status == LG_CANCELLED) return app_fail(base->app, status, "stopped by %s", app_stopper());
    if (status != LG_OK) return app_fail(base->app, status, "%s", app_sentence(status, &error));
    status = well_model_save(base->app, path, &self->model, base->judged.metrics.accuracy,
                             base->judged.metrics.f1, &error);
    if (status != LG_OK) return app_fail_file(base->app, status, &error, path);
    const int code = draw(self);
    if (code == APP_EXIT_OK) report(self);
    return code;
}

int train_novelty(trained *base) {
    alone self = {.base = base};
    describe(&self);
    keep_first_class(base);
    const int code = train(&self);
    lg_novelty_destroy(&self.model.novelty);
    return code;
}
