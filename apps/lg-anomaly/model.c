/* Networks and classical models: reading them, and the scores of windows. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"
#include "common/train.h"

/* ---- networks ---- */

static void load_detector(const app *self, const char *path, well_model *out) {
    lg_detector_file file;
    const lg_detector_run *run = &file.run;
    APP_MUST_FILE(self, path, lg_recipe_load(self->context, path, NULL, &lg_recipe_detector, &file, &error));
    *out = (well_model){.sort = WELL_NETWORK,
                        .healthy = LG_NO_CLASS,
                        .window = run->model.net.length,
                        .file = {.names = file.names, .run = *run, .method = "cnn", .novelty = file.novelty},
                        .probabilities = true,
                        .detector = file};
    APP_MUST_FILE(self, path,
                  lg_detector_plan_create(self->context, &run->model, &file.scaler, file.theta,
                                          run->training.dtype, &out->plan, &error));
}

/* ---- classical classifiers ---- */

static void load_classifier(const app *self, const char *path, well_model *out) {
    *out = (well_model){.healthy = LG_NO_CLASS};
    classifier_file *file = &out->file;
    APP_MUST_FILE(self, path, classifier_file_load(self->context, path, file, &error));
    const bool alone = classifier_file_is_novelty(file);
    out->sort = alone ? WELL_NOVELTY : WELL_CLASSICAL;
    out->window = (uint32_t)file->run.window;
    out->probabilities = !alone && file->classifier.method <= LG_METHOD_TREE;
    file->names.channels = alone ? file->novelty.channels : file->classifier.features.channels;
}

/* ---- all models ---- */

void well_model_load(const app *self, const char *path, well_model *out) {
    char kind[64];
    APP_MUST_FILE(self, path, lg_model_file_kind(self->context, path, NULL, kind, sizeof kind, &error));
    if (strcmp(kind, "detector") == 0)
        load_detector(self, path, out);
    else if (strcmp(kind, "classifier") == 0)
        load_classifier(self, path, out);
    else
        app_stop(
            self, LG_FORMAT,
            "%s: attribute kind is '%s', expected 'detector' or 'classifier', which lg-anomaly train writes",
            path, kind);
}

/* A novelty model has learned its first class as healthy; its other class cannot be. */
static lg_series names_of(const well_model *model) {
    lg_series names = model->file.names;
    if (model->sort == WELL_NOVELTY) names.classes = 1;
    return names;
}

void well_model_settle(const app *self, well_model *model, const char *given, const char *data) {
    const lg_series names = names_of(model);
    if (model->healthy != LG_NO_CLASS) return;
    if (given[0] != '\0')
        (void)snprintf(model->file.run.healthy, sizeof model->file.run.healthy, "%s", given);
    APP_MUST(self,
             lg_find_healthy(self->context, &names, data, model->file.run.healthy, &model->healthy, &error));
}

void well_model_need_healthy(const app *self, const well_model *model, const char *what) {
    const lg_series names = names_of(model);
    char text[320];
    if (model->healthy != LG_NO_CLASS) return;
    lg_ask_healthy(&names, text, sizeof text);
    app_stop_usage(self, "%s: %s", what, text);
}

void well_model_destroy(well_model *model) {
    lg_detector_plan_destroy(model->plan);
    if (model->sort == WELL_NETWORK)
        lg_recipe_release(&lg_recipe_detector, &model->detector);
    else
        classifier_file_free(&model->file);
}

size_t well_model_work(const well_model *model) {
    if (model->sort == WELL_NETWORK) return lg_detector_work_size(model->plan);
    return model->sort == WELL_NOVELTY ? lg_novelty_work_size(&model->file.novelty)
                                       : lg_classifier_work_size(&model->file.classifier);
}

lg_status well_model_score(const well_model *model, const float *x, double *score, double *plane,
                           void *work) {
    lg_novelty_result result;
    switch (model->sort) {
    case WELL_NETWORK:
        lg_detector_eval(model->plan, x, score, plane, work);
        return LG_OK;
    case WELL_CLASSICAL:
        return lg_classifier_window(&model->file.classifier, x, score, work);
    case WELL_NOVELTY:
        break;
    }
    lg_novelty_eval(&model->file.novelty, x, &result, NULL, work);
    score[0] = 1;
    score[1] = result.distance;
    return LG_OK;
}

double well_model_alarm(const well_model *model, const double *score) {
    if (model->file.names.classes == 2) return score[1 - model->healthy];
    if (model->probabilities) return 1 - score[model->healthy];
    double best = -INFINITY;
    for (uint32_t c = 0; c < model->file.names.classes; c++)
        if (c != model->healthy) best = fmax(best, score[c]);
    return best - score[model->healthy];
}

/* ---- labelled series for a model ---- */

void read_series_of(const app *self, const char *path, const well_model *model, lg_series_data *out) {
    const bool any = model->sort == WELL_NOVELTY;
    lg_series like = model->file.names;
    if (any) like.classes = 0;
    APP_MUST_FILE(self, path, lg_series_read_like(self->context, path, &like, out, &error));
    if (any) merge_classes(&out->series, model->file.names.class_name[0]);
}

void merge_classes(lg_series *series, const char *healthy) {
    uint32_t others = 0;
    for (size_t i = 0; i < series->count; i++) {
        series->label[i] = strcmp(series->class_name[series->label[i]], healthy) != 0;
        others |= series->label[i];
    }
    series->classes = 1 + others;
}

/* ---- judging ---- */

uint32_t cast_vote(uint64_t *votes, uint32_t n, bool is_for) {
    *votes = (*votes << 1 | is_for) & (UINT64_MAX >> (64 - n));
    return (uint32_t)__builtin_popcountll(*votes);
}

typedef struct scoring {
    const well_model *model;
    const lg_judgement *out;
} scoring;

static lg_status score(void *user, size_t i, const float *x, void *work) {
    const scoring *self = user;
    const lg_judgement *out = self->out;
    double *plane = out->plane != NULL ? out->plane + 2 * i : NULL;
    return well_model_score(self->model, x, out->score + i * out->classes, plane, work);
}

lg_status judge_windows(const app *self, const well_model *model, const lg_cut_series *from,
                        const lg_window_list *part, lg_judgement *out, lg_error *error) {
    const bool plane = model->sort == WELL_NETWORK && model->detector.run.model.net.plane == 2;
    scoring user = {model, out};
    LG_TRY(lg_judgement_begin(self->context, &from->data.series, &from->windows, part,
                              model->file.names.classes, model->healthy, plane, out, error));
    const lg_status status = lg_windows_each(self->context, &from->data.series, &from->windows, part,
                                             self->threads, well_model_work(model), score, &user);
    return lg_judgement_end(out, model->probabilities, status, error);
}

/* ---- printing ---- */

void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model) {
    lg_training list = {.results = NULL};
    lg_detector_tell(&list, judged, model->file.run.hop, model->file.names.rate,
                     model->file.names.class_name);
    train_put_results(out, &list, 0, list.result_count);
    lg_training_clear(&list);
}
