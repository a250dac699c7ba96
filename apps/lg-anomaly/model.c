/* Networks and classical models: reading them, and the scores of windows. */
#include <math.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"
#include "common/train.h"

/* ---- reading ---- */

void well_model_load(const app *self, const char *path, well_model *out) {
    char kind[64];
    *out = (well_model){.healthy = LG_NO_CLASS};
    lg_detector_file *network = &out->network;
    classifier_file *file = &out->file;
    APP_FILE(self, path, lg_model_file_kind, NULL, kind, sizeof kind);
    if (strcmp(kind, "detector") == 0) {
        APP_FILE(self, path, lg_recipe_load, NULL, &lg_recipe_detector, network);
        out->method = "cnn";
        out->window = network->run.model.net.length;
        APP_MUST_FILE(self, path,
                      lg_detector_plan_create(self->context, &network->run.model, &network->scaler,
                                              network->theta, network->run.training.dtype, &out->plan,
                                              &error));
    } else if (strcmp(kind, "classifier") == 0) {
        APP_FILE(self, path, classifier_file_load, file);
        out->sort = classifier_file_is_novelty(file) ? WELL_NOVELTY : WELL_CLASSICAL;
        out->method = file->method;
        out->window = (uint32_t)file->run.window;
    } else {
        app_stop(
            self, LG_FORMAT,
            "%s: attribute kind is '%s', expected 'detector' or 'classifier', which lg-anomaly train writes",
            path, kind);
    }
}

void well_model_settle(const app *self, well_model *model, const char *given, const char *data,
                       const char *needed) {
    lg_series names = model->file.names;
    char text[320];
    if (model->healthy != LG_NO_CLASS) return;
    /* A novelty model has learned its first class as healthy; its other class cannot be. */
    if (model->sort == WELL_NOVELTY) names.classes = 1;
    if (given[0] != '\0')
        (void)snprintf(model->file.run.healthy, sizeof model->file.run.healthy, "%s", given);
    APP_DO(self, lg_find_healthy, &names, data, model->file.run.healthy, &model->healthy);
    if (needed == NULL || model->healthy != LG_NO_CLASS) return;
    lg_ask_healthy(&names, text, sizeof text);
    app_stop_usage(self, "%s: %s", needed, text);
}

void well_model_destroy(well_model *model) {
    lg_detector_plan_destroy(model->plan);
    lg_recipe_release(model->sort == WELL_NETWORK ? &lg_recipe_detector : &classifier_recipe, &model->file);
}

/* ---- labelled series for a model ---- */

void read_series_of(const app *self, const char *path, const well_model *model, lg_series_data *out) {
    const bool any = model->sort == WELL_NOVELTY;
    lg_series like = model->file.names;
    if (any) like.classes = 0;
    APP_FILE(self, path, lg_series_read_like, &like, out);
    if (any) lg_series_merge(self->context, path, model->file.names.class_name[0], out);
}

/* ---- judging ---- */

static lg_status score_classical(const void *model, const float *x, double *score, double *plane,
                                 void *work) {
    return lg_classifier_window(model, x, score, work);
}

/* The scores are 1 and the distance of lg_novelty_eval. */
static lg_status score_novelty(const void *model, const float *x, double *score, double *plane, void *work) {
    lg_novelty_result result;
    lg_novelty_eval(model, x, &result, NULL, work);
    score[0] = 1;
    score[1] = result.distance;
    return LG_OK;
}

lg_scorer well_model_scorer(const well_model *model) {
    const lg_classifier *classifier = &model->file.classifier;
    lg_scorer by = {.classes = model->file.names.classes, .healthy = model->healthy};
    if (model->sort == WELL_NETWORK)
        return lg_detector_scorer(model->plan, &model->network.run.model, model->healthy);
    if (model->sort == WELL_NOVELTY) {
        by.score = score_novelty;
        by.model = &model->file.novelty;
        by.work = lg_novelty_work_size(by.model);
    } else {
        by.score = score_classical;
        by.model = classifier;
        by.work = lg_classifier_work_size(classifier);
        by.probabilities = classifier->method <= LG_METHOD_TREE;
    }
    return by;
}

double well_model_alarm(const lg_scorer *by, const double *score) {
    if (by->classes == 2) return score[1 - by->healthy];
    if (by->probabilities) return 1 - score[by->healthy];
    double best = -INFINITY;
    for (uint32_t c = 0; c < by->classes; c++)
        if (c != by->healthy) best = fmax(best, score[c]);
    return best - score[by->healthy];
}

/* ---- printing ---- */

void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model) {
    lg_training list = {.results = NULL};
    lg_detector_tell(&list, judged, model->file.run.hop, model->file.names.rate,
                     model->file.names.class_name);
    train_put_results(out, &list, 0, list.result_count);
    lg_training_clear(&list);
}
