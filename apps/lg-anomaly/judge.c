/* Scores windows by a model. */

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
    LG_TRY(lg_judgement_begin(self->context, &from->data.series, &from->windows, part,
                              model->file.names.classes, model->healthy, plane, out, error));
    const lg_status status = lg_windows_each(self->context, &from->data.series, &from->windows, part,
                                             self->threads, well_model_work(model), score, &user);
    return lg_judgement_end(out, model->probabilities, status, error);
}

/* ---- printing ---- */

void put_metrics(app_json *out, const lg_judgement *judged, const well_model *model) {
    lg_training list = {.results = NULL};
    lg_detector_tell(&list, judged, model->file.run.hop, model->file.names.rate);
    train_put_results(out, &list, 0, list.result_count);
    lg_training_clear(&list);
    if (out->people && judged->count > 0)
        app_print_confusion(out->stream, judged->confusion, judged->classes, model->file.names.class_name);
}
