/* Labelled sets of time series. A set holds windows of several signals ("channels"); each window has one
 * class. The functions cut, split and scale such sets.
 */
#ifndef LIEGRAD_SERIES_H
#define LIEGRAD_SERIES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/tape.h"

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

/* ---- spectra ----
 *
 * Power of a series in frequency bands, by Welch's method (IEEE Trans. Audio Electroacoust. 15 (1967) 70).
 *
 * The series is cut into segments of n samples that overlap by half or a little more. Each is multiplied by
 * Hann's window h_t = sin^2(pi (t + 1/2)/n) and transformed; bin k has the frequency k/n, in cycles a sample.
 * The power of a bin is
 *   P_k = mean over the segments of |sum_t h_t z_t exp(-2 pi i k t/n)|^2 / sum h_t^2,
 * and that of a band the mean over its bins: white noise of variance s^2 has power s^2 in every band. Bin 0
 * is in no band; the others, 1..n/2, are shared out evenly in rising order. */

#define LG_SPECTRUM_SEGMENT 128u /* samples of a segment at most */
#define LG_SPECTRUM_BANDS   64u  /* bands at most */

typedef struct lg_spectrum {
    uint32_t length, segment, segments, hop; /* samples; samples; number; samples from one to the next */
    uint32_t bins, bands;                    /* bins: segment/2 */
    uint32_t edge[LG_SPECTRUM_BANDS + 1];    /* band b has the bins edge[b] .. edge[b + 1] - 1 */
    double *wave;              /* (segment, 2 bins): h_t cos(2 pi k t/n), then h_t sin, over sqrt(sum h^2) */
    const lg_context *context; /* whose memory it is in */
} lg_spectrum;

/* Bands of a series of `length` samples: `wanted`, or as many as it has bins for; 0 for less than 4 samples.
 */
LG_API uint32_t lg_spectrum_bands(uint32_t length, uint32_t wanted);
/* bands: 1..lg_spectrum_bands(length, bands). Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_spectrum_create(const lg_context *context, uint32_t length, uint32_t bands,
                                    lg_spectrum *out, lg_error *error);
LG_API void lg_spectrum_destroy(lg_spectrum *spectrum); /* a zeroed one is fine */
/* Doubles of work for the two functions below. */
LG_API size_t lg_spectrum_work(const lg_spectrum *spectrum);
/* z (length) -> power (bands). */
LG_API void lg_spectrum_powers(const lg_spectrum *spectrum, const double *z, double *power, double *work);
/* Adds to gradient (length) the derivative of sum_b cotangent_b power_b, at the series of the last call of
 * lg_spectrum_powers with this `work`. */
LG_API void lg_spectrum_reverse(const lg_spectrum *spectrum, const double *cotangent, double *gradient,
                                const double *work);

/* ---- measures of quality ----
 *
 * Measures of the quality of a classifier. */

/* Class of the largest score, the first of equals; two classes: 1 when score[1] >= score[0]. */
LG_API uint32_t lg_class_of(const double *score, uint32_t classes);
/* confusion (classes, classes): windows of true class i given class j; overwritten. Classes out of range are
 * left out. */
LG_API void lg_confusion(const uint32_t *truth, const uint32_t *given, size_t n, uint32_t classes,
                         uint64_t *confusion);

/* For two classes the numbers are those of class 1; for more, the mean over all classes ("macro"). A class
 * that was never predicted has precision 0, a class that does not occur has recall 0; f1 = 2 p r/(p + r), 0
 * for 0/0. */
typedef struct lg_metrics {
    double accuracy, precision, recall, f1;
    double false_positive_rate; /* part of class 0 that was given another class; NaN without class 0 */
} lg_metrics;
LG_API lg_metrics lg_metrics_of(const uint64_t *confusion, uint32_t classes);

/* Receiver operating characteristic of `score` for class `positive` against all others. The points are sorted
 * by falling threshold, (fpr, tpr) from (0, 0) to (1, 1); equal scores form one point. fpr, tpr and threshold
 * have room for n + 1 numbers; threshold[0] = infinity. `order` (n < 2^32) is work memory. A NaN score counts
 * as -infinity. Returns the number of points, 0 when one side is empty. */
LG_API size_t lg_roc(const uint32_t *truth, const double *score, size_t n, uint32_t positive, double *fpr,
                     double *tpr, double *threshold, uint32_t *order);
/* Area under this curve; ties count half; NaN when one side is empty. With more than two classes it is the
 * mean of the areas of one class against the rest, over the classes for which it exists. score (n, classes).
 * Errors: LG_OUT_OF_MEMORY, LG_INVALID_ARGUMENT (no classes, 2^32 windows). */
LG_API lg_status lg_auc(const lg_context *context, const uint32_t *truth, const double *score, size_t n,
                        uint32_t classes, double *auc);

/* ---- files of series (library liegrad_io) ---- */

typedef struct lg_series_data {
    lg_series series;
    double noise;    /* factor on the sensors' noise, where known; NaN */
    double severity; /* r of the broken runs, where known; NaN */
    char housing[16];
    char sha256[LG_SHA256_TEXT]; /* of x as little-endian floats and label as u32; set by reader and writer */
    lg_provenance provenance;
} lg_series_data;

/* Datasets /X (n, channels, length), or (n, length) for one channel, any float or integer type, byte order
 * and chunking; read as floats without a second copy. /y (n) or (n, 1): whole numbers (integers, booleans,
 * floats with whole values, negative too) or texts (fixed or variable length, 1 to 63 bytes), at most 65536
 * different ones. All else is optional:
 *   - attribute `classes`: K names, joined by | or as a list of texts. Without it the labels are the names,
 *     in rising order. The first rule that holds says which label has which name:
 *       1. attribute `class_labels` (K texts, likewise): what /y holds for each class;
 *       2. if `like` (see below) has the same names in the same order and class_label: as in `like`. A number
 *          that is not among them is an error;
 *       3. /y of whole numbers within 1..K, K among them: counted from 1 (not in files written here);
 *       4. whole numbers within 0..K-1: counted from 0; with a warning where 0 does not occur, because the
 *          base is then a guess (no warning for files written here);
 *       5. texts that are all among the names: by name;
 *       6. there are K different labels: in rising order (texts bytewise).
 *     The result is series.class_label; with `like` it is that of `like`.
 *   - attribute `channels`: names, in the same form; `rate`: samples a second. In files of other programs a
 *     `rate` that is not such a number counts as unknown, with a warning.
 *   - /group, /run (n) or (n, 1): whole numbers 0 to 2^32 - 1, or texts, which become 0, 1, ... in rising
 *     order. If the windows of a run are not consecutive, the runs count as unknown, with a warning.
 *   - attributes `noise`, `severity`, `housing`, of files written here.
 *
 * Attributes `classes` and `channels` that are numbers are not names and are ignored. `like` (may be NULL) is
 * a series read before, or the names of a model (lg_file_reader_names). With it the classes are those of
 * `like`: the file's classes are matched by name, or by value if both names are whole numbers. In a file
 * without `classes` the labels must be among the class_label of `like`, or else among its names. If neither
 * are numbers, labels that start at 0 and are all numbers of classes of `like` count as such numbers, with a
 * warning.
 *
 * For X of more than single precision there is a warning if the rounding to floats (root mean square) is
 * above 1 % of a channel's standard deviation. Above 50 % the file is refused, unless the channel is constant
 * up to 1e-13 of its largest value. Errors also: LG_FORMAT for labels that are empty or not whole, a label or
 * class that `like` does not have, no window; LG_NOT_FINITE with window, channel and sample, also for numbers
 * that a float cannot hold. */
LG_API lg_status lg_series_read(const lg_context *context, const char *path, const lg_read_options *options,
                                const lg_series *like, lg_series_data *out, lg_error *error);
/* Kind "series": /X as f32, /y as u32 (class_label is not written), /group and /run if they are known. Names
 * that cannot be joined by | in 4095 bytes become data sets /classes, /channels of texts. Fills sha256.
 * Errors also: LG_NOT_FINITE; LG_INVALID_ARGUMENT for a label beyond the classes, empty or repeated class
 * names, a run whose windows are not consecutive. */
LG_API lg_status lg_series_write(const lg_context *context, const char *path, lg_series_data *data,
                                 lg_error *error);
LG_API void lg_series_data_destroy(lg_series_data *data);

/* Attributes `classes`, `class_labels`, `channels` and `rate` of a file of any kind, from series->classes,
 * class_name, class_label, channels, channel_name and rate; the rest of the series is not read. Names that
 * cannot be joined become data sets /classes, /channels. LG_INVALID_ARGUMENT: classes without names, empty or
 * repeated names. */
LG_API lg_status lg_file_writer_names(lg_file_writer *writer, const lg_series *series, lg_error *error);
/* Reads these attributes back. Without names of channels, channel_name is NULL and channels 0; without labels
 * class_label is NULL. Freed by lg_series_destroy with the reader's context. The series has no windows but
 * can serve as `like` above. LG_FORMAT: no `classes`. */
LG_API lg_status lg_file_reader_names(lg_file_reader *reader, lg_series *out, lg_error *error);

LG_END_DECLS

#endif
