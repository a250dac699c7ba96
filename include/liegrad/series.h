/* Labelled sets of time series. A set holds windows of several signals ("channels"); each window has one
 * class. The functions cut, split and scale such sets.
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

/* n windows of `length` equidistant samples of `channels` signals. */
typedef struct lg_series {
    size_t count;              /* n >= 1 */
    uint32_t channels, length; /* >= 1 */
    uint32_t classes;          /* >= 1 */
    double rate;               /* samples a second, Hz; 0: unknown */
    float *x;                  /* (n, channels, length), finite */
    uint32_t *label;           /* (n), 0..classes-1 */
    uint32_t *group;           /* (n) or NULL: windows that must not be torn apart, such as a sea state */
    uint32_t *run; /* (n) or NULL: recording. The windows of a run are consecutive and in order of time; each
                    * begins where the previous one ends */
    char (*class_name)[LG_SERIES_NAME];   /* (classes) */
    char (*class_label)[LG_SERIES_NAME];  /* (classes), the label of each class in the file that was read,
                                           * such as "1", "2"; NULL: unknown, or equal to the names */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels), "" where unknown, or NULL */
    const lg_context *context;            /* whose memory the arrays are in */
} lg_series;

/* The caller sets count, channels, length, classes and rate of *series. The function allocates x, label,
 * class_name ("0", "1", ...), and group and run where they are wanted; numbers are zero. All other pointers
 * become NULL. Errors: LG_INVALID_ARGUMENT (a size of 0), LG_OUT_OF_MEMORY. On failure *series is unchanged.
 */
LG_API lg_status lg_series_allocate(const lg_context *context, lg_series *series, bool with_group,
                                    bool with_run);
/* NULL and a zeroed struct are fine; the struct is zero afterwards. */
LG_API void lg_series_destroy(lg_series *series);

/* ---- windows: how a set is cut for a method ---- */

/* Window i has `length` samples. It begins at sample `offset[i]` of stored window `first[i]` and goes on
 * through the following stored windows of the same run. Its label, group and run are those of first[i]. */
typedef struct lg_windows {
    size_t count;
    uint32_t length;
    uint32_t *first, *offset;  /* (count) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_windows;

/* Cuts windows of `length` samples every `hop` samples out of each run. length 0 is the stored length, hop 0
 * is `length`. A window over a change of the label or group is left out, and so is an incomplete one at the
 * end of a run. In a set without runs each stored window is a run of its own. Errors: LG_INVALID_ARGUMENT
 * (with a sentence: no window fits), LG_OUT_OF_MEMORY. */
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

/* Splits windows into parts (windows->count): LG_PART_TEST, LG_PART_VALIDATION or LG_PART_TRAIN
 * (liegrad/nn.h). A unit is a window, a run or a group. Units with the same set of classes form a stratum,
 * which is shuffled by `seed` (in a stream of its own). In each stratum the first round(test_fraction size)
 * units are the test part and the next round(validation_fraction size) the validation part. At least one unit
 * stays for training, so training sees every class. The test part does not depend on the size of the
 * validation part. A random split with hop < length puts overlapping windows into different parts: split by
 * run or group then.
 * Errors: LG_OUT_OF_MEMORY; LG_INVALID_ARGUMENT with a sentence:
 * - fractions outside [0, 1), or a sum of 1 or more
 * - no runs or groups in the series, a label beyond the classes, a class without a window
 * - a test part that is wanted and would be empty
 * On failure parts are untouched. */
LG_API lg_status lg_series_split(const lg_context *context, const lg_series *series,
                                 const lg_windows *windows, lg_split split, double test_fraction,
                                 double validation_fraction, uint64_t seed, uint8_t *parts, lg_error *error);
/* Stratified folds: fold (count) becomes the number of the fold, 0..folds-1, of each item.
 * Without units (unit NULL) item j of a class, counted from 0, goes to fold j mod folds. With unit (count),
 * items with the same unit number go to the same fold. Units with the same set of classes form a stratum; in
 * each stratum the units are dealt to the folds in turn by rising number. The first fold of a stratum is the
 * first of those that hold the least part of its classes so far, fold 0 for classes that are new.
 * More folds than units leave folds empty; folds = 0 counts as 1. Memory: folds (largest label + 1) doubles
 * and 60 bytes an item. LG_OUT_OF_MEMORY: fold is untouched. */
LG_API lg_status lg_folds(const lg_context *context, const uint32_t *label, const uint32_t *unit,
                          size_t count, uint32_t folds, uint32_t *fold);

/* ---- scaling ---- */

/* Mean and scale of each channel over all samples of the windows it was fitted on. A constant channel has
 * scale 1. */
typedef struct lg_scaler {
    uint32_t channels;
    double *mean, *scale;      /* (channels) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_scaler;
/* Mean and standard deviation (divisor: the number of samples) over the windows `chosen` (count; NULL: the
 * first `count`), in double and two passes. With `centred` each window's own mean is subtracted from each
 * channel first, and mean is 0. Errors: LG_INVALID_ARGUMENT (no windows, or one that does not exist),
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_scaler_fit(const lg_context *context, const lg_series *series, const lg_windows *windows,
                               const uint32_t *chosen, size_t count, bool centred, lg_scaler *out);
LG_API void lg_scaler_destroy(lg_scaler *scaler);
/* On a tape: x (..., channels) -> (x - mean)/scale; `back`: x scale + mean. Both are constants of the
 * recording. Errors stick to the tape. */
LG_API lg_var lg_scaler_record(lg_tape *tape, const lg_scaler *scaler, lg_var x, bool back);

LG_END_DECLS

#endif
