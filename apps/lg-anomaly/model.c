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
    APP_DO(self, lg_find_healthy, &names, data, model->file.run.healthy, &model->healthy);
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
    lg_recipe_release(model->sort == WELL_NETWORK ? &lg_recipe_detector : &classifier_recipe, &model->file);
}

lg_status well_model_score(const void *user, const float *x, double *score, double *plane, void *work) {
    const well_model *model = user;
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

static bool gives_probabilities(const well_model *model) {
    return model->sort == WELL_NETWORK ||
           (model->sort == WELL_CLASSICAL && model->file.classifier.method <= LG_METHOD_TREE);
}

double well_model_alarm(const well_model *model, const double *score) {
    if (model->file.names.classes == 2) return score[1 - model->healthy];
    if (gives_probabilities(model)) return 1 - score[model->healthy];
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
    APP_FILE(self, path, lg_series_read_like, &like, out);
    if (any) lg_series_merge(self->context, path, model->file.names.class_name[0], out);
}

/* ---- judging ---- */

lg_scorer well_model_scorer(const well_model *model) {
    return (lg_scorer){.score = well_model_score,
                       .model = model,
                       .work = model->sort == WELL_NETWORK ? lg_detector_work_size(model->plan)
                               : model->sort == WELL_NOVELTY
                                   ? lg_novelty_work_size(&model->file.novelty)
                                   : lg_classifier_work_size(&model->file.classifier),
                       .classes = model->file.names.classes,
                       .healthy = model->healthy,
                       .plane = model->sort == WELL_NETWORK && model->network.run.model.net.plane == 2,
                       .probabilities = gives_probabilities(model)};
}

/* ---- printing ---- */

void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model) {
    lg_training list = {.results = NULL};
    lg_detector_tell(&list, judged, model->file.run.hop, model->file.names.rate,
                     model->file.names.class_name);
    train_put_results(out, &list, 0, list.result_count);
    lg_training_clear(&list);
}
