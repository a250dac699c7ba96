/* Labelled sets of time series: windows of several signals ("channels"), each of one class, and how they are
 * cut, split and scaled.
 */
#ifndef LIEGRAD_SERIES_H
#define LIEGRAD_SERIES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/nn.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

#define LG_SERIES_NAME 64 /* of a class or channel, terminator included */

/* n windows of `length` equidistant samples of `channels` signals. Owned by whoever made it; freed by
 * lg_series_destroy. */
typedef struct lg_series {
    size_t count;              /* n >= 1 */
    uint32_t channels, length; /* >= 1 */
    uint32_t classes;          /* >= 1 */
    double rate;               /* samples a second, Hz; 0: unknown */
    float *x;                  /* (n, channels, length), finite */
    uint32_t *label;           /* (n), 0..classes-1 */
    uint32_t *group;           /* (n) or NULL: windows that must not be torn apart, such as a sea state */
    uint32_t *run; /* (n) or NULL: recording; the windows of a run stand together, in order of time, and each
                    * one begins where the one before ends */
    char (*class_name)[LG_SERIES_NAME];   /* (classes) */
    char (*class_label)[LG_SERIES_NAME];  /* (classes), what stood for each class in the file that was read,
                                           * such as "1", "2"; NULL: unknown, or the names themselves */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels), "" where unknown, or NULL */
    const lg_context *context;            /* whose memory the arrays are in */
} lg_series;

/* Sizes count, channels, length, classes (and rate) of *series are set by the caller; allocates x, label,
 * class_name ("0", "1", ...), and where asked group and run, zeroed; other pointers become NULL, channel_name
 * among them. LG_INVALID_ARGUMENT: a size of 0;
 * LG_OUT_OF_MEMORY. On failure *series is as before. */
LG_API lg_status lg_series_allocate(const lg_context *context, lg_series *series, bool with_group,
                                    bool with_run);
/* Leaves it zeroed; a zeroed one may be freed. */
LG_API void lg_series_destroy(lg_series *series);

/* ---- windows: how a set is cut for a method ---- */

/* Window i has `length` samples from sample `offset[i]` of stored window `first[i]` on, through as many
 * stored windows of the same run as it takes. Its label, group and run are those of first[i]. */
typedef struct lg_windows {
    size_t count;
    uint32_t length;
    uint32_t *first, *offset;  /* (count) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_windows;

/* Windows of `length` samples every `hop` samples of each run (0: the stored length; hop 0: hop = length).
 * Windows over a change of the label or group are left out, and what is left at the end of a run. Without
 * runs each stored window is a run. LG_INVALID_ARGUMENT with a sentence when not one window fits;
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_windows_create(const lg_context *context, const lg_series *series, size_t length,
                                   size_t hop, lg_windows *out, lg_error *error);
LG_API void lg_windows_destroy(lg_windows *windows);
/* out (channels, length) */
LG_API void lg_windows_copy(const lg_series *series, const lg_windows *windows, size_t index, float *out);

/* ---- splits ---- */

typedef enum lg_split {
    LG_SPLIT_RANDOM, /* windows one by one */
    LG_SPLIT_RUN,    /* whole runs */
    LG_SPLIT_GROUP   /* whole groups */
} lg_split;
#define LG_SPLIT_COUNT 3
LG_API const char *lg_split_name(lg_split split);                 /* "random", "run", "group" */
LG_API lg_status lg_split_parse(const char *name, lg_split *out); /* LG_NOT_FOUND */

/* parts (windows->count): LG_PART_TEST, LG_PART_VALIDATION or LG_PART_TRAIN (liegrad/nn.h). Units (windows,
 * runs, groups) are sorted into strata by the classes that they hold, shuffled by `seed` (a stream of its
 * own), and of each stratum the first round(test size) are tested, the next round(validation size) validate;
 * each stratum keeps at least one unit for training, so that training sees every class. The test part does
 * not depend on the validation part's size. Windows that overlap with windows of another part (hop < length,
 * random split) are the caller's business: split by run or group.
 * LG_INVALID_ARGUMENT with a sentence, parts untouched: fractions outside [0, 1) or together 1 or more, no
 * runs or groups in the series, a label beyond the classes, a class without a window, a test part asked for
 * and empty. LG_OUT_OF_MEMORY. */
LG_API lg_status lg_series_split(const lg_context *context, const lg_series *series,
                                 const lg_windows *windows, lg_split split, double test_fraction,
                                 double validation_fraction, uint64_t seed, uint8_t *parts, lg_error *error);
/* Number of the fold, 0..folds-1, of each of `count` items by label, stratified. unit (count), or NULL where
 * each item stands by itself: items of the same number are a unit, which falls into one fold whole. Units are
 * sorted into strata by the classes that they hold and dealt out in turn, in each stratum by rising number
 * (items in the order in which they stand), from the first of the folds that hold the least part of its
 * classes so far: fold 0 for a class that no stratum before holds. Without units item j of a class, counted
 * from 0, goes to fold j mod folds. More folds than units leave folds empty; folds = 0 counts as 1.
 * LG_OUT_OF_MEMORY; then fold is untouched. Memory: folds (largest label + 1) doubles and 60 bytes an item.
 */
LG_API lg_status lg_folds(const lg_context *context, const uint32_t *label, const uint32_t *unit,
                          size_t count, uint32_t folds, uint32_t *fold);

/* ---- scaling ---- */

/* Of each channel, over all samples of the windows it was fitted on; a constant channel has scale 1. */
typedef struct lg_scaler {
    uint32_t channels;
    double *mean, *scale;      /* (channels) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_scaler;
/* Mean and standard deviation (divided by the number of samples) over the windows `chosen` (count; NULL: the
 * first `count`), accumulated in double, two passes. `centred`: each window's own mean is taken off each
 * channel first; then mean is 0. LG_INVALID_ARGUMENT: no windows, or one that does not exist;
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_scaler_fit(const lg_context *context, const lg_series *series, const lg_windows *windows,
                               const uint32_t *chosen, size_t count, bool centred, lg_scaler *out);
LG_API void lg_scaler_destroy(lg_scaler *scaler);

LG_END_DECLS

#endif
