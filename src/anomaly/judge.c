/* Evaluation of a model on windows: scores by several threads, then metrics from the scores. */
#include "anomaly/judge.h"

#include <math.h>

#include "core/clean.h"

enum { BUNDLE = 64 }; /* number of windows per task of the thread pool */

/* ---- visiting windows in threads ---- */

typedef struct visit {
    const lg_context *context;
    const lg_series *series;
    const lg_windows *windows;
    const lg_window_list *part;
    size_t work;
    lg_status (*each)(void *user, size_t i, const float *x, void *work);
    void *user;
} visit;

static lg_status visit_bundle(void *user, size_t index, lg_error *error) {
    const visit *self = user;
    const size_t begin = index * BUNDLE, count = self->part->count,
                 end = begin + BUNDLE < count ? begin + BUNDLE : count;
    LG_TRY_SCRATCH(float, x, self->context, (size_t)self->series->channels * self->windows->length,
                   LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(char, work, self->context, self->work, LG_OUT_OF_MEMORY);
    for (size_t i = begin; i < end; i++) {
        lg_windows_copy(self->series, self->windows, self->part->list != NULL ? self->part->list[i] : i, x);
        LG_TRY(lg_cancelled(self->context) ? LG_CANCELLED : self->each(self->user, i, x, work));
    }
    return LG_OK;
}

lg_status lg_windows_each(const lg_context *context, const lg_series *series, const lg_windows *windows,
                          const lg_window_list *part, uint64_t threads, size_t work,
                          lg_status (*each)(void *user, size_t i, const float *x, void *work), void *user) {
    visit all = {context, series, windows, part, work, each, user};
    return lg_jobs_run(context, threads, (part->count + BUNDLE - 1) / BUNDLE, visit_bundle, &all, NULL);
}

/* ---- metrics from scores ---- */

/* Allocates all arrays as one block, which begins at out->score. */
static lg_status allocate(lg_judgement *out, bool plane) {
    const size_t n = out->count, classes = out->classes, scores = n * classes + (plane ? 2 * n : 0);
    const size_t words = scores + classes * classes;
    out->score = lg_alloc(out->context, 1, 8 * words + 3 * n * sizeof *out->window);
    if (out->score == NULL) return LG_OUT_OF_MEMORY;
    out->plane = plane ? out->score + n * classes : NULL;
    out->confusion = (uint64_t *)(void *)(out->score + scores);
    out->window = (uint32_t *)(void *)(out->score + words);
    out->truth = out->window + n;
    out->given = out->truth + n;
    return LG_OK;
}

lg_status lg_judgement_begin(const lg_context *context, const lg_scorer *by, const lg_cut_series *from,
                             const lg_window_list *part, lg_judgement *out, lg_error *error) {
    *out = (lg_judgement){.count = part->count,
                          .classes = by->classes,
                          .healthy = by->healthy,
                          .metrics = {NAN, NAN, NAN, NAN, NAN},
                          .auc = NAN,
                          .mse = NAN,
                          .by = by,
                          .context = context};
    if (allocate(out, by->plane) != LG_OK) return lg_no_memory(error);
    for (size_t i = 0; i < out->count; i++) {
        out->window[i] = part->list[i];
        out->truth[i] = from->data.series.label[from->windows.first[part->list[i]]];
    }
    out->seconds = -lg_seconds();
    return LG_OK;
}

static lg_status conclude(lg_judgement *out) {
    for (size_t i = 0; i < out->count; i++)
        out->given[i] = lg_metrics_class(out->score + i * out->classes, out->classes);
    lg_metrics_confusion(out->truth, out->given, out->count, out->classes, out->confusion);
    out->metrics = lg_metrics_of(out->confusion, out->classes, out->healthy);
    if (out->classes == 2 && out->by->probabilities) {
        double sum = 0;
        for (size_t i = 0; i < out->count; i++) {
            const double d = out->score[2 * i + 1] - (double)out->truth[i];
            sum += d * d;
        }
        out->mse = sum / (double)out->count;
    }
    return lg_metrics_auc(out->context, out->truth, out->score, out->count, out->classes, &out->auc);
}

lg_status lg_judgement_end(lg_judgement *judged, lg_status status, lg_error *error) {
    judged->seconds += lg_seconds();
    if (status == LG_OK && judged->count > 0) status = conclude(judged);
    judged->by = NULL;
    if (status == LG_OK) return LG_OK;
    lg_judgement_destroy(judged);
    return lg_fail(error, status, "%s", lg_status_sentence(status));
}

static lg_status judge_window(void *user, size_t i, const float *x, void *work) {
    const lg_judgement *out = user;
    double *plane = out->plane != NULL ? out->plane + 2 * i : NULL;
    return out->by->score(out->by->model, x, out->score + i * out->classes, plane, work);
}

lg_status lg_judge(const lg_context *context, const lg_scorer *by, const lg_cut_series *from,
                   const lg_window_list *part, uint64_t threads, lg_judgement *out, lg_error *error) {
    LG_TRY(lg_judgement_begin(context, by, from, part, out, error));
    const lg_status status = lg_windows_each(context, &from->data.series, &from->windows, part, threads,
                                             by->work, judge_window, out);
    return lg_judgement_end(out, status, error);
}

void lg_judgement_destroy(lg_judgement *judged) {
    lg_free(judged->context, judged->score);
    *judged = (lg_judgement){.count = 0};
}

/* ---- checks and derived numbers ---- */

lg_status lg_judgement_check(const lg_judgement *judged, lg_error *error) {
    size_t infinite = 0, first = 0;
    for (size_t i = judged->count * judged->classes; i-- > 0;)
        if (!isfinite(judged->score[i])) infinite++, first = i / judged->classes;
    if (infinite > 0)
        return lg_fail(error, LG_NOT_FINITE,
                       "%zu scores of %zu windows are not finite, the first of window %u (counted from 0): "
                       "its numbers are too large for the model",
                       infinite, judged->count, judged->window[first]);
    return LG_OK;
}

double lg_judgement_alarms(const lg_judgement *judged, uint64_t hop, double rate) {
    return rate > 0 ? judged->metrics.false_positive_rate * 86400.0 * rate / (double)hop : (double)NAN;
}
