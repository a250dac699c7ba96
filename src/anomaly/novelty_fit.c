/* Fits the distributions and limits of the novelty detector to training windows. Each row of the table has
 * the features of one window: (rows, d). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
#include "kernels/lapack.h"
#include "anomaly/judge.h"
#include "anomaly/novelty_internal.h"

enum { LEAST_WINDOWS = 8 };
/* Lower bound for the standard deviation of a feature. Most features are logarithms, so 0.02 means 2 %. */
static const double SMALLEST = 0.02;
/* Limits for equal samples in a window. Consecutive equal samples are always allowed up to the fraction STILL
 * of a window, samples at the extreme value up to the fraction EXTREME, and both up to MORE times the largest
 * number in a training window. STILL is large because a bridged gap stands still for up to a tenth of a
 * window. */
static const double STILL = 0.25, EXTREME = 0.125, MORE = 3;

void lg_novelty_options_init(lg_novelty_options *options) {
    *options = (lg_novelty_options){
        .size = sizeof *options, .bands = 8, .folds = 5, .most = 20000, .quantile = 0.99, .margin = 3};
}

typedef struct fitting {
    const lg_context *context;
    const lg_novelty_options *options;
    const lg_series *series;
    const lg_windows *windows;
    lg_novelty *v;
    size_t rows;
    uint32_t *window, *label, *fold; /* (rows) */
    double *table;                   /* (rows, d) features of the windows */
    double *still, *extreme;         /* (rows, channels) */
    double *z, *squares, *sums;      /* z: (rows, d), rows of one class; squares, sums: (d, d) each */
    double *square, *work; /* square: (rows, groups), distances of rows that the fit left out; work: 2 d */
} fitting;

/* ---- the table ---- */

static lg_status fill_row(void *user, size_t i, const float *x, void *work) {
    const fitting *f = user;
    const lg_novelty *v = f->v;
    return lg_novelty_features(v, x, f->table + i * v->features, f->still + i * v->channels,
                               f->extreme + i * v->channels, work)
               ? LG_OK
               : LG_NOT_FINITE;
}

static lg_status fill_table(fitting *f, int threads, lg_error *error) {
    const lg_window_list all = {f->window, f->rows};
    const lg_status status = lg_windows_each(f->context, f->series, f->windows, &all, (uint64_t)threads,
                                             lg_novelty_work_size(f->v), fill_row, f);
    return status == LG_OK ? LG_OK
                           : lg_fail(error, status, "features of windows: %s", lg_status_sentence(status));
}

static void allow_equal(const fitting *f) {
    const lg_novelty *v = f->v;
    for (uint32_t c = 0; c < v->channels; c++) {
        v->still[c] = STILL * v->length;
        v->extreme[c] = EXTREME * v->length;
        for (size_t i = 0; i < f->rows; i++) {
            v->still[c] = fmax(v->still[c], MORE * f->still[i * v->channels + c]);
            v->extreme[c] = fmax(v->extreme[c], MORE * f->extreme[i * v->channels + c]);
        }
    }
}

/* ---- distributions ---- */

/* Computes the centre and number of windows of each class, and the spread within the classes, from the rows
 * of all folds but `left_out`. */
static void find_centres(const fitting *f, uint32_t left_out) {
    lg_novelty *v = f->v;
    const size_t d = v->features;
    size_t rows = 0;
    memset(v->windows, 0, v->classes * sizeof *v->windows);
    memset(v->centre, 0, v->classes * d * sizeof *v->centre);
    memset(v->spread, 0, d * sizeof *v->spread);
    for (size_t i = 0; i < f->rows; i++) {
        if (f->fold[i] == left_out) continue;
        double *centre = v->centre + f->label[i] * d;
        v->windows[f->label[i]]++;
        rows++;
        for (size_t j = 0; j < d; j++) centre[j] += f->table[i * d + j];
    }
    for (uint32_t c = 0; c < v->classes; c++)
        for (size_t j = 0; j < d && v->windows[c] > 0; j++) v->centre[c * d + j] /= v->windows[c];
    for (size_t i = 0; i < f->rows; i++) {
        const double *centre = v->centre + f->label[i] * d, *row = f->table + i * d;
        for (size_t j = 0; j < d && f->fold[i] != left_out; j++)
            v->spread[j] += (row[j] - centre[j]) * (row[j] - centre[j]);
    }
    for (size_t j = 0; j < d; j++) v->spread[j] = sqrt(v->spread[j] / (double)rows + SMALLEST * SMALLEST);
}

/* Fills f->z with (row - centre)/spread for the rows of a class, without the fold `left_out`. Returns the
 * number of rows. */
static size_t standardise(const fitting *f, uint32_t class_index, uint32_t left_out) {
    const lg_novelty *v = f->v;
    const size_t d = v->features;
    size_t count = 0;
    for (size_t i = 0; i < f->rows; i++) {
        if (f->fold[i] == left_out || f->label[i] != class_index) continue;
        double *z = f->z + count++ * d;
        for (size_t j = 0; j < d; j++)
            z[j] = (f->table[i * d + j] - v->centre[class_index * d + j]) / v->spread[j];
    }
    return count;
}

/* The upper triangle (row-major) of out (d, d) becomes z^T z/count. */
static void second_moments(size_t count, size_t d, const double *z, double *out) {
    const double zero = 0, weight = 1 / (double)count;
    const int order = (int)d, rows = (int)count;
    dsyrk_("L", "N", &order, &rows, &weight, z, &order, &zero, out, &order);
}

/* Returns the share by which the covariance S shrinks to the identity: sum var(s_ij)/sum s_ij^2 over i < j,
 * limited to 0..1. S is in f->sums. The entries of f->z are squared in place. */
static double shrinkage(const fitting *f, size_t count) {
    const size_t d = f->v->features;
    double variance = 0, square = 0;
    if (count < 3) return 1;
    for (size_t i = 0; i < count * d; i++) f->z[i] *= f->z[i];
    second_moments(count, d, f->z, f->squares);
    for (size_t i = 0; i < d; i++)
        for (size_t j = i + 1; j < d; j++) {
            const double s = f->sums[i * d + j];
            variance += (f->squares[i * d + j] - s * s) / (double)(count - 1);
            square += s * s;
        }
    return variance < square ? fmax(variance / square, 0) : 1;
}

/* precision = ((1 - share) S + share I + SMALLEST^2/spread^2)^-1 */
static lg_status find_precision(const fitting *f, uint32_t class_index, uint32_t left_out, lg_error *error) {
    lg_novelty *v = f->v;
    const size_t d = v->features;
    const int order = (int)d;
    int info = 0;
    double *P = v->precision + class_index * d * d;
    const size_t count = standardise(f, class_index, left_out);
    second_moments(count, d, f->z, f->sums);
    const double share = shrinkage(f, count);
    for (size_t i = 0; i < d; i++) {
        for (size_t j = i; j < d; j++) P[i * d + j] = (1 - share) * f->sums[i * d + j];
        P[i * d + i] += share + SMALLEST * SMALLEST / (v->spread[i] * v->spread[i]);
    }
    dpotrf_("L", &order, P, &order, &info);
    if (info == 0) dpotri_("L", &order, P, &order, &info);
    if (info != 0)
        return lg_fail(error, LG_NOT_FINITE, "the covariance of the windows' features is singular");
    for (size_t i = 0; i < d; i++)
        for (size_t j = 0; j < i; j++) P[i * d + j] = P[j * d + i];
    return LG_OK;
}

static lg_status fit_classes(const fitting *f, uint32_t left_out, lg_error *error) {
    find_centres(f, left_out);
    for (uint32_t c = 0; c < f->v->classes; c++)
        if (f->v->windows[c] > 0) LG_TRY(find_precision(f, c, left_out, error));
    return lg_novelty_factor(f->v, error);
}

/* ---- limits ---- */

/* Computes the distance of each row of a fold to its own class, which was fitted on the other folds. Skips
 * rows whose class occurs in this fold only. Returns `measured` plus the number of distances computed
 * here. */
static size_t measure_fold(const fitting *f, uint32_t fold, size_t measured) {
    const lg_novelty *v = f->v;
    const uint32_t groups = lg_novelty_groups(v);
    for (size_t i = 0; i < f->rows; i++)
        if (f->fold[i] == fold && v->windows[f->label[i]] > 0)
            lg_novelty_distances(v, f->label[i], f->table + i * v->features, f->square + groups * measured++,
                                 f->work);
    return measured;
}

static void set_limits(const fitting *f, size_t measured) {
    const uint32_t groups = lg_novelty_groups(f->v);
    double *sorted = f->z;
    const size_t rank = (size_t)ceil(f->options->quantile * (double)measured);
    for (uint32_t g = 0; g < groups; g++) {
        for (size_t i = 0; i < measured; i++) sorted[i] = f->square[i * groups + g];
        qsort(sorted, measured, sizeof *sorted, lg_compare_doubles);
        f->v->limit[g] =
            f->options->margin * fmax(sorted[rank > 0 ? rank - 1 : 0], lg_novelty_group(f->v, g).count);
    }
}

/* Deals the rows to folds so that rows of one group are in the same fold. Without groups, or if all rows
 * would be in one fold, runs take the place of groups, and if that fails too, single rows. */
static lg_status deal(const fitting *f, lg_error *error) {
    const uint32_t *const units[] = {f->series->group, f->series->run, NULL};
    LG_SCRATCH(uint32_t, unit, f->context, f->rows);
    lg_status status = unit == NULL ? LG_OUT_OF_MEMORY : LG_OK;
    bool dealt = false;
    for (size_t u = 0; u < LG_COUNT(units) && status == LG_OK && !dealt; u++) {
        for (size_t i = 0; i < f->rows; i++)
            unit[i] = units[u] != NULL ? units[u][f->windows->first[f->window[i]]] : (uint32_t)i;
        status = lg_series_folds(f->context, f->label, unit, f->rows, f->options->folds, f->fold, NULL);
        for (size_t i = 1; i < f->rows && units[u] != NULL && !dealt; i++) dealt = f->fold[i] != f->fold[0];
    }
    return status == LG_OK ? LG_OK : lg_fail(error, status, "no memory for %zu windows", f->rows);
}

static lg_status fit_all(fitting *f, int threads, lg_error *error) {
    size_t measured = 0;
    LG_TRY(fill_table(f, threads, error));
    allow_equal(f);
    LG_TRY(deal(f, error));
    for (uint32_t fold = 0; fold < f->options->folds; fold++) {
        if (lg_cancelled(f->context)) return lg_fail(error, LG_CANCELLED, "cancelled");
        LG_TRY(fit_classes(f, fold, error));
        measured = measure_fold(f, fold, measured);
    }
    if (measured == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "every class has a single window; one class needs at least two");
    set_limits(f, measured);
    return fit_classes(f, UINT32_MAX, error);
}

/* ---- check, allocation, fit ---- */

static uint32_t bands_of(uint32_t wanted, uint32_t channels, uint32_t length) {
    const uint32_t room = LG_NOVELTY_FEATURES / channels - NOVELTY_BAND;
    const uint32_t bands = wanted < room ? wanted : room;
    return lg_spectrum_bands(length, bands);
}

static lg_status check(const lg_novelty_options *o, const lg_series *series, const lg_windows *windows,
                       size_t count, int threads, lg_error *error) {
    if (o == NULL || o->size != sizeof *o || o->folds < 2 || !(o->quantile > 0 && o->quantile <= 1) ||
        !(o->margin > 0) || o->most < LEAST_WINDOWS || threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "options of novelty are out of range");
    if (count < LEAST_WINDOWS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu windows are too few; at least %d are needed", count,
                       LEAST_WINDOWS);
    if (windows->length < 2)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the windows have fewer than two samples");
    if (series->channels > LG_NOVELTY_FEATURES / NOVELTY_BAND)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are %u channels; at most %u are possible",
                       series->channels, LG_NOVELTY_FEATURES / NOVELTY_BAND);
    return LG_OK;
}

static lg_status allocate(fitting *f, const uint32_t *chosen, size_t count, lg_error *error) {
    const size_t d = f->v->features, channels = f->v->channels, rows = f->rows;
    if (LG_ALLOC_ALL(f->context, LG_ARRAY(f->window, rows), LG_ARRAY(f->label, rows), LG_ARRAY(f->fold, rows),
                     LG_ARRAY(f->table, rows * d), LG_ARRAY(f->still, rows * channels),
                     LG_ARRAY(f->extreme, rows * channels), LG_ARRAY(f->z, rows * d),
                     LG_ARRAY(f->sums, d * d), LG_ARRAY(f->squares, d * d),
                     LG_ARRAY(f->square, rows * lg_novelty_groups(f->v)), LG_ARRAY(f->work, 2 * d)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u features of %zu windows", f->v->features,
                       rows);
    for (size_t i = 0; i < rows; i++) {
        const size_t at = lg_spread(i, count, rows);
        f->window[i] = chosen != NULL ? chosen[at] : (uint32_t)at;
        f->label[i] = f->series->label[f->windows->first[f->window[i]]];
    }
    return LG_OK;
}

static void release(fitting *f) {
    LG_FREE_ALL(f->context, f->window, f->label, f->fold, f->table, f->still, f->extreme, f->z, f->sums,
                f->squares, f->square, f->work);
}

lg_status lg_novelty_fit(const lg_context *context, const lg_novelty_options *options,
                         const lg_series *series, const lg_windows *windows, const uint32_t *chosen,
                         size_t count, int threads, lg_novelty *out, lg_error *error) {
    LG_NEEDS(error, options, series, windows, out);
    LG_TRY(check(options, series, windows, count, threads, error));
    LG_CLEAN(lg_scaler_destroy) lg_scaler scaler = {.channels = 0};
    LG_CLEAN(lg_novelty_destroy)
    lg_novelty made = {.context = context,
                       .channels = series->channels,
                       .length = windows->length,
                       .classes = series->classes,
                       .bands = bands_of(options->bands, series->channels, windows->length)};
    lg_stored arrays[NOVELTY_ARRAYS];
    lg_novelty_list(&made, arrays);
    for (size_t i = 0; i < NOVELTY_ARRAYS; i++) LG_TRY(lg_stored_allocate(context, &arrays[i], error));
    LG_TRY(lg_novelty_prepare(&made, error));
    LG_CLEAN(release)
    fitting f = {.context = context, .options = options, .series = series, .windows = windows, .v = &made};
    f.rows = count < options->most ? count : options->most;
    const lg_status status = lg_scaler_fit(context, series, windows, chosen, count, false, &scaler);
    if (status != LG_OK) return lg_fail(error, status, "scaling: %s", lg_status_sentence(status));
    memcpy(made.mean, scaler.mean, made.channels * sizeof *made.mean);
    memcpy(made.scale, scaler.scale, made.channels * sizeof *made.scale);
    LG_TRY(allocate(&f, chosen, count, error));
    LG_TRY(fit_all(&f, threads, error));
    return LG_GIVE(out, made);
}
