/* Grid search by cross-validation. */
#include "anomaly/classify/classify_internal.h"

#include <math.h>

#include "liegrad/series.h"

typedef struct search {
    const lg_context *context;
    const lg_classifier_options *options;
    size_t count;   /* number of options */
    uint32_t folds; /* 1: the models are trained and tested on all rows */
    const double *x;
    const uint32_t *label, *unit; /* labels and units of the table's rows; unit may be NULL */
    const uint32_t *chosen;
    size_t rows;
    uint32_t d, classes;
    uint32_t *fold; /* (rows) fold of each chosen row */
    double *part;   /* (count, folds) accuracy of each option in each fold; NaN: it did not converge */
} search;

/* Collects the table rows that fold `fold` is tested on (`test`), or the rows that it is trained on. Returns
 * their number. */
static size_t gather(const search *s, uint32_t fold, bool test, uint32_t *out) {
    size_t n = 0;
    for (size_t i = 0; i < s->rows; i++)
        if (s->folds == 1 || (s->fold[i] == fold) == test) out[n++] = (uint32_t)lg_chosen_row(s->chosen, i);
    return n;
}

static lg_status try_fold(const search *s, size_t option, uint32_t fold, double *accuracy, lg_error *error) {
    LG_TRY_SCRATCH(uint32_t, rows, s->context, s->rows, LG_OUT_OF_MEMORY);
    size_t n = gather(s, fold, false, rows), right = 0;
    lg_classifier_options o = s->options[option];
    /* Training on a part of the rows may allow fewer components than training on all rows. */
    const size_t most = n < s->d ? n : s->d;
    if (o.components > most && most < s->rows) o.components = (uint32_t)most;
    LG_CLEAN(lg_classifier_destroy) lg_classifier c = {0};
    LG_TRY(lg_classifier_fit(s->context, &o, s->x, s->label, rows, n, s->d, s->classes, &c, error));
    LG_TRY_SCRATCH(double, score, s->context, lg_classifier_work_size(&c) / sizeof(double) + s->classes,
                   LG_OUT_OF_MEMORY);
    n = gather(s, fold, true, rows);
    for (size_t i = 0; i < n; i++) {
        lg_classifier_score(&c, s->x + (size_t)rows[i] * s->d, score, score + s->classes);
        right += lg_metrics_class(score, s->classes) == s->label[rows[i]];
    }
    *accuracy = n > 0 ? (double)right / (double)n : NAN;
    return LG_OK;
}

static lg_status search_task(void *user, size_t index, lg_error *error) {
    const search *s = user;
    const size_t option = index / s->folds;
    lg_error why = {LG_OK, ""};
    const lg_status status = lg_cancelled(s->context)
                                 ? LG_CANCELLED
                                 : try_fold(s, option, (uint32_t)(index % s->folds), &s->part[index], &why);
    if (status == LG_NO_CONVERGENCE) s->part[index] = NAN;
    if (status == LG_OK || status == LG_NO_CONVERGENCE) return LG_OK;
    return lg_fail(error, status, "setting %zu: %s", option,
                   why.message[0] != '\0' ? why.message : lg_status_sentence(status));
}

/* Deals the rows to the folds, of which there are at most as many as rows, or units, of the rarest class. */
static lg_status deal(search *s, uint32_t folds, lg_error *error) {
    uint32_t rarest;
    LG_TRY_SCRATCH(size_t, counts, s->context, s->classes, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(uint32_t, label, s->context, s->rows, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(uint32_t, own, s->context, s->rows, LG_OUT_OF_MEMORY);
    const uint32_t *unit = s->unit != NULL ? own : NULL;
    for (size_t i = 0; i < s->rows; i++) {
        const size_t row = lg_chosen_row(s->chosen, i);
        label[i] = s->label[row];
        if (unit != NULL) own[i] = s->unit[row];
    }
    LG_TRY(lg_check_labels(label, s->rows, s->classes, 2, counts, error));
    LG_TRY(lg_series_folds(s->context, label, unit, s->rows, folds, s->fold, &rarest));
    s->folds = folds < 2 ? 1 : folds < rarest ? folds : rarest;
    return s->folds == folds ? LG_OK
                             : lg_series_folds(s->context, label, unit, s->rows, s->folds, s->fold, NULL);
}

/* Averages the accuracy of each option over its folds and finds the best option. An option that did not
 * converge in some fold gets NaN and is not chosen. */
static lg_status collect(const search *s, double *accuracy, size_t *best, lg_error *error) {
    size_t chosen = s->count;
    for (size_t o = 0; o < s->count; o++) {
        accuracy[o] = 0.0;
        for (uint32_t f = 0; f < s->folds; f++) accuracy[o] += s->part[o * s->folds + f];
        accuracy[o] /= s->folds;
        if (!isnan(accuracy[o]) && (chosen == s->count || accuracy[o] > accuracy[chosen])) chosen = o;
    }
    if (chosen == s->count)
        return lg_fail(error, LG_NO_CONVERGENCE, "none of %zu settings converged", s->count);
    *best = chosen;
    return LG_OK;
}

lg_status lg_classifier_search(const lg_context *context, const lg_classifier_options *options, size_t count,
                               uint32_t folds, const double *x, const uint32_t *label, const uint32_t *unit,
                               const uint32_t *chosen, size_t rows, uint32_t d, uint32_t classes, int threads,
                               double *accuracy, size_t *best, lg_error *error) {
    if (options == NULL || count == 0 || x == NULL || label == NULL || accuracy == NULL || best == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL");
    if (rows == 0 || rows > UINT32_MAX || d == 0 || classes < 2 || classes > LG_CLASSES_MAX || threads < 1)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "%zu rows, %u features, %u classes, %d threads: cross-validation needs rows, features, "
            "two classes and a thread",
            rows, d, classes, threads);
    search s = {.context = context,
                .options = options,
                .count = count,
                .x = x,
                .label = label,
                .unit = unit,
                .chosen = chosen,
                .rows = rows,
                .d = d,
                .classes = classes};
    LG_TRY_SCRATCH(uint32_t, fold, context, rows, lg_no_memory(error));
    s.fold = fold;
    const lg_status dealt = deal(&s, folds, error);
    if (dealt != LG_OK) return dealt == LG_OUT_OF_MEMORY ? lg_no_memory(error) : dealt;
    const size_t jobs = count * s.folds;
    LG_TRY_SCRATCH(double, part, context, jobs, lg_no_memory(error));
    s.part = part;
    LG_TRY(lg_jobs_run(context, (uint64_t)threads, jobs, search_task, &s, error));
    return collect(&s, accuracy, best, error);
}
