/* Scores of a model on windows, windows that are unlike those of training, and what is told of both. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/learn.h"
#include "lg-anomaly/anomaly.h"

enum { BUNDLE = 64 }; /* windows of a task */

/* ---- scores ---- */

typedef struct scored {
    const well_model *model;
    const lg_cut_series *from;
    const double *table; /* features of all windows, or NULL */
} scored;

static lg_scorer scorer_of(const scored *what) {
    return (lg_scorer){
        .user = what, .classes = what->model->classes, .probabilities = what->model->probabilities};
}

/* After the work memory of the model there is room for a window. */
static lg_status score_window(const void *user, uint32_t window, double *score, double *plane, void *work) {
    const scored *self = user;
    float *x = (float *)(void *)((char *)work + well_model_work(self->model));
    lg_windows_copy(&self->from->data.series, &self->from->windows, window, x);
    return well_model_score(self->model, x, score, plane, work);
}

lg_status judge_windows(const app *self, const well_model *model, const lg_cut_series *from,
                        const lg_window_list *part, lg_judgement *out, lg_error *error) {
    const scored what = {model, from, NULL};
    lg_scorer scorer = scorer_of(&what);
    scorer.score = score_window;
    scorer.work = well_model_work(model) + (size_t)model->channels * model->window * sizeof(float);
    scorer.plane = model->sort == WELL_NETWORK && model->detector.run.model.net.plane == 2;
    return lg_judge_windows(self->context, &scorer, &from->data.series, &from->windows, part, self->threads,
                            out, error);
}

static lg_status score_row(const void *user, uint32_t window, double *score, double *plane, void *work) {
    const scored *self = user;
    const lg_classifier *classifier = &self->model->classifier;
    (void)plane;
    lg_classifier_score(classifier, self->table + (size_t)window * classifier->features.count, score, work);
    return LG_OK;
}

lg_status judge_rows(const app *self, const well_model *model, const lg_cut_series *from,
                     const lg_window_list *part, const double *table, lg_judgement *out, lg_error *error) {
    const scored what = {model, from, table};
    lg_scorer scorer = scorer_of(&what);
    scorer.score = score_row;
    scorer.work = lg_classifier_work_size(&model->classifier);
    return lg_judge_windows(self->context, &scorer, &from->data.series, &from->windows, part, 1, out, error);
}

/* ---- novelty ---- */

typedef struct novelty_task {
    const well_model *model;
    const lg_cut_series *from;
    const lg_judgement *judged;
    lg_novelty_result *result; /* of each window */
} novelty_task;

static void measure_bundle(void *user, size_t index) {
    const novelty_task *self = user;
    const lg_novelty *novelty = &self->model->novelty;
    const size_t begin = index * BUNDLE, count = self->judged->count;
    APP_FREE float *x = app_alloc((size_t)novelty->channels * novelty->length, sizeof *x);
    APP_FREE void *work = app_alloc(lg_novelty_work_size(novelty), 1);
    for (size_t i = begin; i < begin + BUNDLE && i < count && !app_interrupted(); i++) {
        lg_windows_copy(&self->from->data.series, &self->from->windows, self->judged->window[i], x);
        lg_novelty_eval(novelty, x, &self->result[i], NULL, work);
    }
}

size_t count_novel(const app *self, const well_model *model, const lg_cut_series *from,
                   const lg_judgement *judged, lg_novelty_result *farthest) {
    APP_FREE lg_novelty_result *result = app_alloc(judged->count, sizeof *result);
    novelty_task task = {model, from, judged, result};
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

void json_metrics(app_json *json, const lg_judgement *judged, uint64_t hop, double rate) {
    lg_learning list = {.results = NULL};
    lg_detector_tell(&list, judged, hop, rate);
    learn_put_results(json, &list, 0, list.result_count);
    lg_learning_clear(&list);
}

enum { SHOWN_CLASSES = 12 };

void print_confusion(FILE *stream, const lg_judgement *judged, const well_model *model) {
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

void print_metrics(const lg_judgement *judged, const well_model *model) {
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
    const double alarms = lg_judgement_alarms(judged, model->cut.hop, model->rate);
    if (isfinite(alarms)) (void)printf("false alarms a day: %.3g\n", alarms);
    print_confusion(stdout, judged, model);
}
