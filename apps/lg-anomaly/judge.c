/* Scores of a model on windows, and its errors. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"

enum { BUNDLE = 64 }; /* windows of a task */

/* ---- scores ---- */

typedef struct scoring {
    const well_model *model;
    const lg_series *series;
    const lg_windows *windows;
    judgement *out;
    lg_status *status; /* of each task */
} scoring;

static void score_bundle(void *user, size_t index) {
    const scoring *self = user;
    const well_model *model = self->model;
    judgement *out = self->out;
    const size_t begin = index * BUNDLE, end = begin + BUNDLE < out->count ? begin + BUNDLE : out->count;
    APP_FREE float *x = app_alloc((size_t)model->channels * model->window, sizeof *x);
    APP_FREE void *work = app_alloc(well_model_work(model), 1);
    for (size_t i = begin; i < end && self->status[index] == LG_OK && !app_interrupted(); i++) {
        lg_windows_copy(self->series, self->windows, out->window[i], x);
        self->status[index] = well_model_score(model, x, out->score + i * out->classes,
                                               out->plane != NULL ? out->plane + 2 * i : NULL, work);
    }
}

static lg_status score_all(const app *self, const well_model *model, const lg_series *series,
                           const lg_windows *windows, judgement *out) {
    const size_t tasks = (out->count + BUNDLE - 1) / BUNDLE;
    APP_FREE lg_status *each = app_alloc(tasks, sizeof *each);
    scoring what = {model, series, windows, out, each};
    app_parallel(self->threads, tasks, score_bundle, &what);
    lg_status status = app_interrupted() ? LG_CANCELLED : LG_OK;
    for (size_t i = 0; i < tasks && status == LG_OK; i++) status = each[i];
    return status;
}

/* ---- from scores to numbers ---- */

static judgement judgement_create(const well_model *model, const lg_series *series, const lg_windows *windows,
                                  const part_indices *part, bool plane) {
    const size_t n = part->count, classes = model->classes;
    judgement out = {.count = n, .classes = model->classes, .auc = NAN, .mse = NAN};
    out.metrics = (lg_metrics){NAN, NAN, NAN, NAN, NAN};
    out.window = app_alloc(n, sizeof *out.window);
    out.truth = app_alloc(n, sizeof *out.truth);
    out.given = app_alloc(n, sizeof *out.given);
    out.score = app_alloc(n * classes, sizeof *out.score);
    out.confusion = app_alloc(classes * classes, sizeof *out.confusion);
    if (plane) out.plane = app_alloc(2 * n, sizeof *out.plane);
    for (size_t i = 0; i < n; i++) {
        out.window[i] = part->list[i];
        out.truth[i] = series->label[windows->first[part->list[i]]];
    }
    return out;
}

static lg_status conclude(const app *self, const well_model *model, judgement *out, lg_error *error) {
    if (out->count == 0) return LG_OK;
    for (size_t i = 0; i < out->count; i++)
        out->given[i] = lg_class_of(out->score + i * out->classes, out->classes);
    lg_confusion(out->truth, out->given, out->count, out->classes, out->confusion);
    out->metrics = lg_metrics_of(out->confusion, out->classes);
    if (out->classes == 2 && model->probabilities) {
        double sum = 0;
        for (size_t i = 0; i < out->count; i++) {
            const double d = out->score[2 * i + 1] - (double)out->truth[i];
            sum += d * d;
        }
        out->mse = sum / (double)out->count;
    }
    const lg_status status =
        lg_auc(self->context, out->truth, out->score, out->count, out->classes, &out->auc);
    return status == LG_OK ? LG_OK : app_error(error, status, "%s", lg_status_sentence(status));
}

lg_status judge_windows(const app *self, const well_model *model, const lg_series *series,
                        const lg_windows *windows, const part_indices *part, judgement *out,
                        lg_error *error) {
    *out = judgement_create(model, series, windows, part,
                            model->sort == WELL_NETWORK && model->detector.run.model.net.plane == 2);
    const double begin = app_seconds();
    lg_status status = score_all(self, model, series, windows, out);
    out->seconds = app_seconds() - begin;
    if (status != LG_OK)
        (void)app_error(error, status, "%s", lg_status_sentence(status));
    else
        status = conclude(self, model, out, error);
    if (status != LG_OK) judgement_free(out);
    return status;
}

lg_status judge_rows(const app *self, const well_model *model, const lg_series *series,
                     const lg_windows *windows, const part_indices *part, const double *table, judgement *out,
                     lg_error *error) {
    const lg_classifier *classifier = &model->classifier;
    *out = judgement_create(model, series, windows, part, false);
    APP_FREE double *work = app_alloc(lg_classifier_work_size(classifier), 1);
    const double begin = app_seconds();
    for (size_t i = 0; i < out->count; i++)
        lg_classifier_score(classifier, table + (size_t)part->list[i] * classifier->features.count,
                            out->score + i * out->classes, work);
    out->seconds = app_seconds() - begin;
    const lg_status status = conclude(self, model, out, error);
    if (status != LG_OK) judgement_free(out);
    return status;
}

void judgement_free(judgement *judged) {
    free(judged->window);
    free(judged->truth);
    free(judged->given);
    free(judged->score);
    free(judged->plane);
    free(judged->confusion);
    *judged = (judgement){.count = 0};
}

/* ---- novelty ---- */

typedef struct novelty_task {
    const well_model *model;
    const lg_series *series;
    const lg_windows *windows;
    const judgement *judged;
    lg_novelty_result *result; /* of each window */
} novelty_task;

static void measure_bundle(void *user, size_t index) {
    const novelty_task *self = user;
    const lg_novelty *novelty = &self->model->novelty;
    const size_t begin = index * BUNDLE, count = self->judged->count;
    APP_FREE float *x = app_alloc((size_t)novelty->channels * novelty->length, sizeof *x);
    APP_FREE void *work = app_alloc(lg_novelty_work_size(novelty), 1);
    for (size_t i = begin; i < begin + BUNDLE && i < count && !app_interrupted(); i++) {
        lg_windows_copy(self->series, self->windows, self->judged->window[i], x);
        lg_novelty_eval(novelty, x, &self->result[i], NULL, work);
    }
}

size_t count_novel(const app *self, const well_model *model, const lg_series *series,
                   const lg_windows *windows, const judgement *judged, lg_novelty_result *farthest) {
    APP_FREE lg_novelty_result *result = app_alloc(judged->count, sizeof *result);
    novelty_task task = {model, series, windows, judged, result};
    size_t novel = 0;
    app_parallel(self->threads, (judged->count + BUNDLE - 1) / BUNDLE, measure_bundle, &task);
    *farthest = (lg_novelty_result){.distance = 0};
    for (size_t i = 0; i < judged->count; i++) {
        novel += result[i].novel;
        if (result[i].distance > farthest->distance) *farthest = result[i];
    }
    return novel;
}

/* ---- telling ---- */

double false_alarms_per_day(const judgement *judged, uint64_t hop, double rate) {
    return rate > 0 ? judged->metrics.false_positive_rate * 86400.0 * rate / (double)hop : (double)NAN;
}

void json_metrics(app_json *json, const judgement *judged, uint64_t hop, double rate) {
    const lg_metrics *metrics = &judged->metrics;
    const char *mean = judged->classes == 2 ? NULL : "mean over the classes";
    app_result_real(json, "accuracy", metrics->accuracy, NULL);
    app_result_real(json, "precision", metrics->precision, mean);
    app_result_real(json, "recall", metrics->recall, mean);
    app_result_real(json, "f1", metrics->f1, mean);
    app_result_real(json, "auc", judged->auc, NULL);
    app_result_real(json, "false_positive_rate", metrics->false_positive_rate, NULL);
    app_result_real(json, "false_alarms_per_day", false_alarms_per_day(judged, hop, rate),
                    "window by window");
    if (judged->count == 0) {
        app_json_text(json, "confusion", NULL);
        return;
    }
    app_json_open(json, "confusion", '[');
    for (uint32_t i = 0; i < judged->classes; i++) {
        app_json_open(json, NULL, '[');
        for (uint32_t j = 0; j < judged->classes; j++)
            app_json_size(json, NULL, judged->confusion[(size_t)i * judged->classes + j]);
        app_json_close(json, ']');
    }
    app_json_close(json, ']');
}

enum { SHOWN_CLASSES = 12 };

void print_confusion(FILE *stream, const judgement *judged, const well_model *model) {
    app_table table;
    if (judged->classes > SHOWN_CLASSES) return;
    app_table_begin(&table, judged->classes + 1);
    app_table_cell(&table, "true class / given");
    for (uint32_t j = 0; j < judged->classes; j++) app_table_cell(&table, "%s", model->class_name[j]);
    for (uint32_t i = 0; i < judged->classes; i++) {
        app_table_cell(&table, "%s", model->class_name[i]);
        for (uint32_t j = 0; j < judged->classes; j++)
            app_table_cell(&table, "%llu",
                           (unsigned long long)judged->confusion[(size_t)i * judged->classes + j]);
    }
    app_table_end(&table, stream);
}

void print_metrics(const judgement *judged, const well_model *model) {
    const lg_metrics *metrics = &judged->metrics;
    if (judged->count == 0) {
        (void)printf("no windows to test on\n");
        return;
    }
    (void)printf("accuracy %.4f, precision %.4f, recall %.4f, F1 %.4f", metrics->accuracy, metrics->precision,
                 metrics->recall, metrics->f1);
    if (isfinite(judged->auc)) (void)printf(", AUC %.4f", judged->auc);
    (void)printf(" on %zu windows%s\n", judged->count,
                 model->classes == 2 ? "" : " (precision, recall and F1: mean over the classes)");
    const double alarms = false_alarms_per_day(judged, model->cut.hop, model->rate);
    if (isfinite(alarms)) (void)printf("false alarms a day: %.3g\n", alarms);
    print_confusion(stdout, judged, model);
}
