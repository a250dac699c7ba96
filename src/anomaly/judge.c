/* Scores of a model on windows, and its errors. */
#include "anomaly/judge.h"

#include <math.h>

#include "core/core.h"

enum { BUNDLE = 64 }; /* windows of a task */

/* ---- scores ---- */

typedef struct scoring {
    const lg_context *context;
    const lg_scorer *scorer;
    lg_judgement *out;
    lg_status *status; /* of each task */
} scoring;

static void score_bundle(void *user, size_t index) {
    const scoring *self = user;
    lg_judgement *out = self->out;
    const size_t begin = index * BUNDLE, end = begin + BUNDLE < out->count ? begin + BUNDLE : out->count;
    void *work = lg_alloc(self->context, 1, self->scorer->work);
    lg_status status = work != NULL ? LG_OK : LG_OUT_OF_MEMORY;
    for (size_t i = begin; i < end && status == LG_OK && !lg_cancelled(self->context); i++)
        status = self->scorer->score(self->scorer->user, out->window[i], out->score + i * out->classes,
                                     out->plane != NULL ? out->plane + 2 * i : NULL, work);
    lg_free(self->context, work);
    self->status[index] = status;
}

static lg_status score_all(const scoring *self, size_t tasks, uint64_t threads) {
    lg_thread_pool *pool;
    LG_TRY(lg_thread_pool_create(self->context, (int)(threads < tasks ? threads : tasks), &pool));
    lg_thread_pool_run(pool, tasks, score_bundle, (void *)self);
    lg_thread_pool_destroy(pool);
    lg_status status = lg_cancelled(self->context) ? LG_CANCELLED : LG_OK;
    for (size_t i = 0; i < tasks && status == LG_OK; i++) status = self->status[i];
    return status;
}

/* ---- from scores to numbers ---- */

/* One block, which begins at `score`. */
static lg_status allocate(const lg_scorer *scorer, lg_judgement *out) {
    const size_t n = out->count, classes = out->classes, plane = scorer->plane ? 2 * n : 0;
    const size_t words = n * classes + plane + classes * classes,
                 bytes = 8 * words + 3 * n * sizeof(uint32_t);
    out->score = lg_alloc(out->context, 1, bytes);
    if (out->score == NULL) return LG_OUT_OF_MEMORY;
    out->plane = scorer->plane ? out->score + n * classes : NULL;
    out->confusion = (uint64_t *)(void *)(out->score + n * classes + plane);
    out->window = (uint32_t *)(void *)(out->score + words);
    out->truth = out->window + n;
    out->given = out->truth + n;
    return LG_OK;
}

static lg_status conclude(const lg_scorer *scorer, lg_judgement *out) {
    for (size_t i = 0; i < out->count; i++)
        out->given[i] = lg_class_of(out->score + i * out->classes, out->classes);
    lg_confusion(out->truth, out->given, out->count, out->classes, out->confusion);
    out->metrics = lg_metrics_of(out->confusion, out->classes);
    if (out->classes == 2 && scorer->probabilities) {
        double sum = 0;
        for (size_t i = 0; i < out->count; i++) {
            const double d = out->score[2 * i + 1] - (double)out->truth[i];
            sum += d * d;
        }
        out->mse = sum / (double)out->count;
    }
    return lg_auc(out->context, out->truth, out->score, out->count, out->classes, &out->auc);
}

static lg_status judge(const lg_scorer *scorer, uint64_t threads, lg_judgement *out) {
    const size_t tasks = (out->count + BUNDLE - 1) / BUNDLE;
    scoring what = {out->context, scorer, out, lg_alloc(out->context, tasks, sizeof *what.status)};
    if (what.status == NULL) return LG_OUT_OF_MEMORY;
    const double begin = lg_seconds();
    const lg_status status = score_all(&what, tasks, threads);
    out->seconds = lg_seconds() - begin;
    lg_free(out->context, what.status);
    return status == LG_OK ? conclude(scorer, out) : status;
}

lg_status lg_judge_windows(const lg_context *context, const lg_scorer *scorer, const lg_series *series,
                           const lg_windows *windows, const lg_window_list *part, uint64_t threads,
                           lg_judgement *out, lg_error *error) {
    *out = (lg_judgement){.count = part->count,
                          .classes = scorer->classes,
                          .metrics = {NAN, NAN, NAN, NAN, NAN},
                          .auc = NAN,
                          .mse = NAN,
                          .context = context};
    lg_status status = allocate(scorer, out);
    for (size_t i = 0; i < out->count && status == LG_OK; i++) {
        out->window[i] = part->list[i];
        out->truth[i] = series->label[windows->first[part->list[i]]];
    }
    if (status == LG_OK && out->count > 0) status = judge(scorer, threads, out);
    if (status == LG_OK) return LG_OK;
    lg_judgement_destroy(out);
    return lg_fail(error, status, "%s", lg_status_sentence(status));
}

void lg_judgement_destroy(lg_judgement *judged) {
    lg_free(judged->context, judged->score);
    *judged = (lg_judgement){.count = 0};
}

/* ---- what they say ---- */

lg_status lg_judgement_check(const lg_judgement *judged, lg_error *error) {
    size_t infinite = 0, first = 0;
    for (size_t i = judged->count * judged->classes; i-- > 0;)
        if (!isfinite(judged->score[i])) infinite++, first = i / judged->classes;
    if (infinite > 0)
        return lg_fail(error, LG_NOT_FINITE,
                       "%zu scores of %zu windows are not finite, the first of window %u (from 0): its "
                       "numbers are too large for the model",
                       infinite, judged->count, judged->window[first]);
    return LG_OK;
}

double lg_judgement_alarms(const lg_judgement *judged, uint64_t hop, double rate) {
    return rate > 0 ? judged->metrics.false_positive_rate * 86400.0 * rate / (double)hop : (double)NAN;
}
