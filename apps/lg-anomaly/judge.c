/* Scores windows by a model, and finds windows that are unlike the training data. */

#include "common/train.h"
#include "lg-anomaly/anomaly.h"

uint32_t cast_vote(uint64_t *votes, uint32_t n, bool is_for) {
    *votes = (*votes << 1 | is_for) & (UINT64_MAX >> (64 - n));
    return (uint32_t)__builtin_popcountll(*votes);
}

/* ---- scores ---- */

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
    LG_TRY(lg_judgement_begin(self->context, &from->data.series, &from->windows, part, model->names.classes,
                              model->healthy, plane, out, error));
    const lg_status status = lg_windows_each(self->context, &from->data.series, &from->windows, part,
                                             self->threads, well_model_work(model), score, &user);
    return lg_judgement_end(out, model->probabilities, status, error);
}

/* ---- novelty ---- */

typedef struct measuring {
    const lg_novelty *novelty;
    lg_novelty_result *result; /* the result of each window */
} measuring;

static lg_status measure(void *user, size_t i, const float *x, void *work) {
    const measuring *self = user;
    lg_novelty_eval(self->novelty, x, &self->result[i], NULL, work);
    return LG_OK;
}

size_t count_novel(const app *self, const well_model *model, const lg_cut_series *from,
                   const lg_judgement *judged, lg_novelty_result *farthest) {
    const lg_window_list all = {judged->window, judged->count};
    APP_FREE lg_novelty_result *result = app_alloc(judged->count, sizeof *result);
    measuring user = {&model->novelty, result};
    size_t novel = 0;
    app_must(self,
             lg_windows_each(self->context, &from->data.series, &from->windows, &all, self->threads,
                             lg_novelty_work_size(user.novelty), measure, &user),
             NULL);
    *farthest = (lg_novelty_result){.distance = 0};
    for (size_t i = 0; i < judged->count; i++) {
        novel += result[i].novel;
        if (result[i].distance > farthest->distance) *farthest = result[i];
    }
    return novel;
}

/* ---- printing ---- */

void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model) {
    lg_training list = {.results = NULL};
    lg_detector_tell(&list, judged, model->cut.hop, model->names.rate, model->names.class_name);
    train_put_results(out, &list, 0, list.result_count);
    lg_training_clear(&list);
}
