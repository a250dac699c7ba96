/* Splits and folds of a set of windows. A unit is a set of windows that stay together. Units with the same
 * set of classes form a stratum, and the units of each stratum are distributed over the parts or folds. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clean.h"
#include "core/median.h"
#include "liegrad/core.h"
#include "liegrad/series.h"

static const char *const split_names[LG_SPLIT_COUNT] = {"random", "run", "group"};

const char *lg_split_name(lg_split split) {
    return (unsigned)split < LG_SPLIT_COUNT ? split_names[split] : "unknown";
}

/* random stream of the split, so that its draws are independent of others with the same seed */
#define SPLIT_STREAM 0x73657269u

/* A unit: a window, a run or a group. `classes` (count) are the classes that occur in it, each once, in
 * rising order. */
typedef struct unit {
    uint32_t id; /* first: it sorts units */
    size_t count;
    const uint32_t *classes;
    uint32_t part; /* LG_PART_... in a split, the number of the fold in lg_series_folds */
} unit;

/* The units of a list of items, each of which has a unit number (id) and a class. */
typedef struct unit_set {
    size_t items, units;
    uint64_t *keys;    /* (items): id << 32 | class */
    uint32_t *classes; /* (items): classes of the units, unit after unit */
    unit *unit;        /* (items), of which the first `units` are used */
} unit_set;

static lg_status allocate_units(const lg_context *context, size_t items, unit_set *out) {
    *out = (unit_set){.items = items};
    return LG_ALLOC_ALL(context, LG_ARRAY(out->keys, items), LG_ARRAY(out->classes, items),
                        LG_ARRAY(out->unit, items));
}

typedef struct split_task {
    const lg_series *series;
    const lg_windows *windows;
    lg_split split;
    double test, validation;
    unit_set set; /* the items are the windows */
    bool *seen;   /* (classes): whether the class occurs in the training part */
} split_task;

static uint32_t unit_id(const split_task *t, size_t window) {
    const uint32_t first = t->windows->first[window];
    if (t->split == LG_SPLIT_RUN) return t->series->run[first];
    return t->split == LG_SPLIT_GROUP ? t->series->group[first] : (uint32_t)window;
}

static int by_key(const void *a, const void *b) {
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* Order of the strata: compares the lists of classes. */
static int by_classes(const unit *a, const unit *b) {
    for (size_t i = 0; i < a->count && i < b->count; i++)
        if (a->classes[i] != b->classes[i]) return a->classes[i] < b->classes[i] ? -1 : 1;
    return (a->count > b->count) - (a->count < b->count);
}

static int by_stratum(const void *a, const void *b) {
    const int order = by_classes(a, b);
    return order != 0 ? order : lg_compare_u32(a, b);
}

/* Makes the units from set->keys. They are sorted by stratum, and by id within a stratum. */
static void collect_units(unit_set *set) {
    uint32_t *classes = set->classes;
    qsort(set->keys, set->items, sizeof *set->keys, by_key);
    set->units = 0;
    for (size_t i = 0; i < set->items; i++) {
        const uint32_t id = (uint32_t)(set->keys[i] >> 32);
        if (i > 0 && set->keys[i] == set->keys[i - 1]) continue;
        if (set->units == 0 || set->unit[set->units - 1].id != id)
            set->unit[set->units++] = (unit){.id = id, .classes = classes};
        *classes++ = (uint32_t)set->keys[i];
        set->unit[set->units - 1].count++;
    }
    qsort(set->unit, set->units, sizeof *set->unit, by_stratum);
}

static size_t end_of_stratum(const unit_set *set, size_t first) {
    size_t end = first + 1;
    while (end < set->units && by_classes(&set->unit[first], &set->unit[end]) == 0) end++;
    return end;
}

/* The units must be sorted by id. */
static const unit *find_unit(const unit_set *set, uint32_t id) {
    const unit key = {.id = id};
    return bsearch(&key, set->unit, set->units, sizeof key, lg_compare_u32);
}

/* Distributes the units of one stratum over the parts. At least one unit stays in the training part; if too
 * few are left, the test part gets its units before the validation part. Returns the number of test units. */
static size_t deal(const split_task *t, unit *units, size_t n, lg_rng *rng) {
    size_t test = (size_t)floor(t->test * (double)n + 0.5);
    size_t validation = (size_t)floor(t->validation * (double)n + 0.5);
    if (test > n - 1) test = n - 1;
    if (validation > n - 1 - test) validation = n - 1 - test;
    for (size_t i = n; i > 1; i--) {
        const size_t j = (size_t)lg_rng_below(rng, i);
        const unit other = units[j];
        units[j] = units[i - 1];
        units[i - 1] = other;
    }
    for (size_t i = 0; i < n; i++)
        units[i].part = i < test ? LG_PART_TEST : i < test + validation ? LG_PART_VALIDATION : LG_PART_TRAIN;
    return test;
}

static const char *const unit_names[LG_SPLIT_COUNT] = {"windows", "runs", "groups"};

static lg_status run_split(split_task *t, uint64_t seed, uint8_t *parts, lg_error *error) {
    for (size_t i = 0; i < t->windows->count; i++)
        t->set.keys[i] = (uint64_t)unit_id(t, i) << 32 | t->series->label[t->windows->first[i]];
    size_t tested = 0;
    lg_rng rng;
    lg_rng_seed(&rng, seed, SPLIT_STREAM);
    collect_units(&t->set);
    for (size_t first = 0, end; first < t->set.units; first = end) {
        end = end_of_stratum(&t->set, first);
        tested += deal(t, t->set.unit + first, end - first, &rng);
    }
    for (const unit *u = t->set.unit; u < t->set.unit + t->set.units; u++)
        for (size_t c = 0; u->part == LG_PART_TRAIN && c < u->count; c++) t->seen[u->classes[c]] = true;
    uint32_t unseen = 0; /* the first class that no unit of the training part has */
    while (unseen < t->series->classes && t->seen[unseen]) unseen++;
    if (unseen < t->series->classes)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there is no window of class \"%s\" to train on",
                       t->series->class_name != NULL ? t->series->class_name[unseen] : "?");
    if (t->test > 0.0 && tested == 0)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the test part, %g of %zu %s, is empty: of each class at least one must be left to train on",
            t->test, t->set.units, unit_names[t->split]);
    qsort(t->set.unit, t->set.units, sizeof *t->set.unit, lg_compare_u32);
    for (size_t i = 0; i < t->windows->count; i++)
        parts[i] = (uint8_t)find_unit(&t->set, unit_id(t, i))->part;
    return LG_OK;
}

static bool fraction(double x) {
    return x >= 0.0 && x < 1.0;
}

static lg_status check_split(const split_task *t, const uint8_t *parts, lg_error *error) {
    const lg_series *series = t->series;
    if (series == NULL || t->windows == NULL || parts == NULL || t->windows->count == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are no windows to split");
    if ((unsigned)t->split >= LG_SPLIT_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kind of split");
    if (!fraction(t->test) || !fraction(t->validation) || !(t->test + t->validation < 1.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "parts of %g for testing and %g for validation: each must be in [0, 1), together "
                       "below 1",
                       t->test, t->validation);
    if ((t->split == LG_SPLIT_RUN && series->run == NULL) ||
        (t->split == LG_SPLIT_GROUP && series->group == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the series have no %s to split by", unit_names[t->split]);
    for (size_t i = 0; i < series->count; i++)
        if (series->label[i] >= series->classes)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "window %zu is of class %u (counted from 0), but there are %u classes", i,
                           (unsigned)series->label[i], (unsigned)series->classes);
    return LG_OK;
}

lg_status lg_series_split(const lg_context *context, const lg_series *series, const lg_windows *windows,
                          lg_split split, double test_fraction, double validation_fraction, uint64_t seed,
                          uint8_t *parts, lg_error *error) {
    split_task t = {.series = series,
                    .windows = windows,
                    .split = split,
                    .test = test_fraction,
                    .validation = validation_fraction};
    LG_TRY(check_split(&t, parts, error));
    LG_TRY_SCRATCH(bool, seen, context, series->classes, lg_no_memory(error));
    t.seen = seen;
    lg_status status = allocate_units(context, windows->count, &t.set);
    status = status == LG_OK ? run_split(&t, seed, parts, error) : lg_no_memory(error);
    LG_FREE_ALL(context, t.set.keys, t.set.classes, t.set.unit);
    return status;
}

/* ---- folds ---- */

typedef struct fold_task {
    size_t folds, classes; /* classes: the largest label + 1 */
    unit_set set;
    double *total; /* (classes): number of units that hold the class */
    double *held;  /* (folds, classes): number of units of the fold that hold the class */
} fold_task;

/* Returns the fold that holds the smallest share of the units with the classes of u; the first such fold if
 * several are equal. */
static size_t emptiest_fold(const fold_task *t, const unit *u) {
    size_t best = 0;
    double least = INFINITY;
    for (size_t f = 0; f < t->folds; f++) {
        double share = 0.0;
        for (size_t c = 0; c < u->count; c++)
            share += t->held[f * t->classes + u->classes[c]] / t->total[u->classes[c]];
        if (!(share < least)) continue;
        best = f;
        least = share;
    }
    return best;
}

static void deal_folds(fold_task *t) {
    unit *units = t->set.unit;
    for (size_t i = 0; i < t->set.units; i++)
        for (size_t c = 0; c < units[i].count; c++) t->total[units[i].classes[c]]++;
    for (size_t first = 0, end; first < t->set.units; first = end) {
        const size_t start = emptiest_fold(t, &units[first]);
        end = end_of_stratum(&t->set, first);
        for (size_t i = first; i < end; i++) {
            units[i].part = (uint32_t)((start + i - first) % t->folds);
            for (size_t c = 0; c < units[i].count; c++)
                t->held[units[i].part * t->classes + units[i].classes[c]]++;
        }
    }
    qsort(units, t->set.units, sizeof *units, lg_compare_u32);
}

lg_status lg_series_folds(const lg_context *context, const uint32_t *label, const uint32_t *number,
                          size_t count, uint32_t folds, uint32_t *fold, uint32_t *rarest) {
    LG_NEEDS(NULL, label, fold);
    fold_task t = {.folds = folds > 0 ? folds : 1, .classes = 1};
    for (size_t i = 0; i < count; i++)
        if (label[i] >= t.classes) t.classes = (size_t)label[i] + 1;
    lg_status status =
        LG_ALLOC_ALL(context, LG_ARRAY(t.total, t.classes), LG_ARRAY(t.held, t.classes * t.folds));
    if (status == LG_OK) status = allocate_units(context, count, &t.set);
    if (status == LG_OK) {
        for (size_t i = 0; i < count; i++)
            t.set.keys[i] = (uint64_t)(number != NULL ? number[i] : (uint32_t)i) << 32 | label[i];
        collect_units(&t.set);
        deal_folds(&t);
        for (size_t i = 0; i < count; i++)
            fold[i] = find_unit(&t.set, number != NULL ? number[i] : (uint32_t)i)->part;
        double fewest = UINT32_MAX;
        for (size_t c = 0; c < t.classes; c++)
            if (t.total[c] > 0) fewest = fmin(fewest, t.total[c]);
        if (rarest != NULL) *rarest = (uint32_t)fewest;
    }
    LG_FREE_ALL(context, t.set.keys, t.set.classes, t.set.unit, t.total, t.held);
    return status;
}
