/* Labelled sets of time series. A set holds windows of several signals ("channels"), and each window has one
 * class. The functions cut sets into windows, split them into parts or folds, scale them, compute power
 * spectra and the quality of a classification, and read and write files. They are in the library liegrad,
 * those from "files of series" on in liegrad_io. The guide is docs/detectors.md.
 *
 * Functions may be called by several threads at the same time for different outputs. Structures that own
 * memory are freed by their _destroy function, which leaves them zeroed.
 */
#ifndef LIEGRAD_SERIES_H
#define LIEGRAD_SERIES_H

#include "liegrad/files.h"
#include "liegrad/fit.h"

LG_BEGIN_DECLS

#define LG_SERIES_NAME 64 /* bytes of the name of a class or channel, with the terminator */

/* n windows of `length` equidistant samples of `channels` signals. These are the stored windows; lg_windows
 * cuts other windows out of them. */
typedef struct lg_series {
    size_t count;              /* n >= 1 */
    uint32_t channels, length; /* >= 1 */
    uint32_t classes;          /* >= 1 */
    double rate;               /* sampling rate in Hz; 0 if unknown */
    float *x;                  /* (n, channels, length), finite */
    uint32_t *label;           /* (n), 0..classes-1 */
    /* (n) or NULL: number of the window's group. Windows with the same number belong together, such as the
     * windows of one sea state; a split by group keeps them in the same part. */
    uint32_t *group;
    /* (n) or NULL: number of the recording (run) that the window is from. The windows of a run are
     * consecutive and in order of time; each begins where the previous one ends. */
    uint32_t *run;
    char (*class_name)[LG_SERIES_NAME]; /* (classes) */
    /* (classes) The label of each class in the file that was read, such as "1", "2". NULL if the labels are
     * unknown or equal to the names. */
    char (*class_label)[LG_SERIES_NAME];
    char (*channel_name)[LG_SERIES_NAME]; /* (channels), "" for unknown names; or NULL */
    const lg_context *context;            /* in whose memory the arrays are */
} lg_series;

/* Allocates the arrays of a set. The caller sets count, channels, length, classes and rate of *series before.
 * The function allocates x, label and class_name ("0", "1", ...), with `with_group` also group, and with
 * `with_run` also run. Their numbers are zero, all other pointers become NULL. Free with lg_series_destroy.
 * Errors: LG_INVALID_ARGUMENT (a size of 0); *series is then unchanged. */
LG_API lg_status lg_series_allocate(const lg_context *context, lg_series *series, bool with_group,
                                    bool with_run);
LG_API void lg_series_destroy(lg_series *series);

#define LG_NO_CLASS UINT32_MAX /* no class; the class is not known */
/* Returns the number of the class that means "all is well", or LG_NO_CLASS if there is none. `name` is its
 * name in class_name or its label in class_label. With `name` NULL or "" the class is guessed from the words
 * of the names (docs/detectors.md, "The healthy class"); if several names mean it, the result is LG_NO_CLASS.
 * Only classes, class_name and class_label of the series are used. */
LG_API uint32_t lg_series_healthy(const lg_series *series, const char *name);

/* ---- windows ---- */

/* Windows that are cut out of a set, for example as a detector needs them. Window i has `length` samples. It
 * begins at sample `offset[i]` of stored window `first[i]` and goes on through the following stored windows
 * of the same run. It has the label, group and run of stored window first[i]. */
typedef struct lg_windows {
    size_t count;
    uint32_t length;           /* samples */
    uint32_t *first, *offset;  /* (count) */
    const lg_context *context; /* in whose memory the arrays are */
} lg_windows;

/* Cuts windows of `length` samples out of each run; one begins every `hop` samples. length 0 stands for the
 * stored length, hop 0 for `length`. A window in which the label or group changes is left out, and so is an
 * incomplete window at the end of a run. In a set without runs each stored window counts as a run. Errors:
 * LG_INVALID_ARGUMENT (no window fits; 2^32 windows or samples per window, or more). */
LG_API lg_status lg_windows_create(const lg_context *context, const lg_series *series, size_t length,
                                   size_t hop, lg_windows *out, lg_error *error);
LG_API void lg_windows_destroy(lg_windows *windows);
/* Copies the samples of window `index` to out (channels, windows->length). */
LG_API void lg_windows_copy(const lg_series *series, const lg_windows *windows, size_t index, float *out);

/* ---- splits ---- */

/* What is put into a part as a whole (the unit of the split). */
typedef enum lg_split {
    LG_SPLIT_RANDOM, /* single windows */
    LG_SPLIT_RUN,    /* whole runs */
    LG_SPLIT_GROUP   /* whole groups */
} lg_split;
#define LG_SPLIT_COUNT 3
LG_API const char *lg_split_name(lg_split split); /* "random", "run", "group" */

/* Splits windows: parts (windows->count) becomes LG_PART_TEST, LG_PART_VALIDATION or LG_PART_TRAIN
 * (liegrad/fit.h) for each window. The unit of the split is a window, a run or a group. All units with the
 * same set of classes form a stratum, which is shuffled by `seed` (in a random stream of its own). With n
 * units in a stratum, the first round(test_fraction n) are the test part and the next
 * round(validation_fraction n) the validation part. At least one unit of each stratum stays for training, so
 * training sees every class. The test part does not depend on the size of the validation part. A random split
 * of windows that overlap (hop < length) puts overlapping windows into different parts; such windows should
 * be split by run or group. Errors: LG_INVALID_ARGUMENT with a sentence for
 * - fractions outside [0, 1), or with a sum of 1 or more
 * - a split by run or group of a set that does not have them
 * - a label that is not below `classes`, or a class without a window
 * - an empty test part although test_fraction > 0 */
LG_API lg_status lg_series_split(const lg_context *context, const lg_series *series,
                                 const lg_windows *windows, lg_split split, double test_fraction,
                                 double validation_fraction, uint64_t seed, uint8_t *parts, lg_error *error);
/* Makes stratified folds: fold (count) becomes the number of the fold, 0..folds-1, of each item.
 * Without units (unit NULL), item j of a class, counted from 0, goes to fold j mod folds. With unit (count),
 * items with the same unit number go to the same fold. Units with the same set of classes form a stratum. The
 * units of a stratum, sorted by number, are dealt to the folds one after the other. The dealing of a stratum
 * begins at the fold that so far holds the smallest share of the units with its classes; of equal folds at
 * the first one. With more folds than units some folds stay empty. folds = 0 counts as 1. *rarest, if it is
 * not NULL, becomes the number of units (without units: items) of the rarest class that occurs. Memory: folds
 * (largest label + 1) doubles and 60 bytes per item. */
LG_API lg_status lg_series_folds(const lg_context *context, const uint32_t *label, const uint32_t *unit,
                                 size_t count, uint32_t folds, uint32_t *fold, uint32_t *rarest);

/* ---- scaling ---- */

/* Mean and scale (standard deviation) of each channel over all samples of some windows. A constant channel
 * has scale 1. */
typedef struct lg_scaler {
    uint32_t channels;
    double *mean, *scale;      /* (channels) */
    const lg_context *context; /* in whose memory the arrays are */
} lg_scaler;
/* Computes mean and standard deviation (divisor: the number of samples) over the windows with the indices
 * chosen (count), or over the first `count` windows if `chosen` is NULL, in double and in two passes. With
 * `centred` the mean of each channel in each window is first subtracted from that window; out->mean is then
 * 0. Errors: LG_INVALID_ARGUMENT (no windows, an index out of range). */
LG_API lg_status lg_scaler_fit(const lg_context *context, const lg_series *series, const lg_windows *windows,
                               const uint32_t *chosen, size_t count, bool centred, lg_scaler *out);
LG_API void lg_scaler_destroy(lg_scaler *scaler);
/* Records x (..., channels) -> (x - mean)/scale on a tape; with `back` the inverse, x scale + mean. mean and
 * scale are copied as constants of the recording. Errors stick to the tape. */
LG_API lg_var lg_scaler_record(lg_tape *tape, const lg_scaler *scaler, lg_var x, bool back);

/* ---- spectra ----
 *
 * Power of a series in frequency bands, by Welch's method (IEEE Trans. Audio Electroacoust. 15 (1967) 70).
 *
 * The series is cut into segments of n samples that overlap by half or a little more. Each segment is
 * multiplied by Hann's window h_t = sin^2(pi (t + 1/2)/n) and Fourier transformed. Bin k has the frequency
 * k/n, in cycles per sample. The power of bin k is
 *   P_k = mean over the segments of |sum_t h_t z_t exp(-2 pi i k t/n)|^2 / sum h_t^2.
 * The power of a band is the mean over its bins, so white noise of variance s^2 has power s^2 in every band.
 * Bin 0 is in no band. The bins 1..n/2 are distributed evenly over the bands, in rising order. */

#define LG_SPECTRUM_SEGMENT 128u /* largest number of samples per segment */
#define LG_SPECTRUM_BANDS   64u  /* largest number of bands */

/* The plan of a spectrum; immutable, and threads may share it. */
typedef struct lg_spectrum {
    /* Samples of the series; samples of a segment (n); number of segments; samples from one segment to the
     * next. */
    uint32_t length, segment, segments, hop;
    uint32_t bins, bands;                 /* bins: segment/2, without bin 0 */
    uint32_t edge[LG_SPECTRUM_BANDS + 1]; /* band b has the bins edge[b] .. edge[b + 1] - 1 */
    /* (segment, 2 bins): row t has h_t cos(2 pi k t/n) for all bins k, then h_t sin(2 pi k t/n), where h is
     * Hann's window over its norm, sum h_t^2 = 1. */
    double *wave;
    const lg_context *context; /* in whose memory `wave` is */
} lg_spectrum;

/* Returns how many bands are possible for a series of `length` samples: `wanted`, or less if the series has
 * fewer bins or LG_SPECTRUM_BANDS is less. 0 for less than 4 samples. */
LG_API uint32_t lg_spectrum_bands(uint32_t length, uint32_t wanted);
/* Makes the plan for series of `length` samples. `bands` must be at least 1, and possible according to
 * lg_spectrum_bands. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_spectrum_create(const lg_context *context, uint32_t length, uint32_t bands,
                                    lg_spectrum *out, lg_error *error);
LG_API void lg_spectrum_destroy(lg_spectrum *spectrum);
/* Number of doubles of work memory for lg_spectrum_powers. */
LG_API size_t lg_spectrum_work(const lg_spectrum *spectrum);
/* Computes power (bands) of the series z (length). */
LG_API void lg_spectrum_powers(const lg_spectrum *spectrum, const double *z, double *power, double *work);

/* ---- quality of a classification ---- */

/* Returns the class with the largest score (classes); of equal scores the first. With two classes equal
 * scores give class 1. */
LG_API uint32_t lg_metrics_class(const double *score, uint32_t classes);
/* Computes the confusion matrix (classes, classes): entry (i, j) is the number of windows with true class i
 * that were given class j. truth and given (n). Windows with a class out of range are not counted. */
LG_API void lg_metrics_confusion(const uint32_t *truth, const uint32_t *given, size_t n, uint32_t classes,
                                 uint64_t *confusion);

/* With two classes, precision, recall and f1 are computed for the class that is not healthy, or for class 1
 * if the healthy class is not known. With more classes they are means ("macro") over the classes that occur
 * or were given. They are NaN if no such class is left. A class that was never given has precision 0, one
 * that does not occur has recall 0. With precision p and recall r, f1 = 2 p r/(p + r), and 0 if p = r = 0. */
typedef struct lg_metrics {
    double accuracy, precision, recall, f1;
    double false_positive_rate; /* part of the healthy class that was given another class; NaN without it */
} lg_metrics;
/* Computes the metrics from a confusion matrix of lg_metrics_confusion. `healthy` is the class that means
 * "all is well", or LG_NO_CLASS. */
LG_API lg_metrics lg_metrics_of(const uint64_t *confusion, uint32_t classes, uint32_t healthy);

/* Computes the receiver operating characteristic for class `positive` against all other classes; truth and
 * score (n). The points (fpr, tpr) go from (0, 0) to (1, 1) and are sorted by falling threshold; windows with
 * equal scores form one point. fpr, tpr and threshold must have room for n + 1 numbers; threshold[0] =
 * infinity. `order` (n < 2^32) is work memory. A NaN score counts as -infinity. Returns the number of points;
 * 0 if no window is positive or all windows are: no curve exists, and the rate of the absent class is 0. */
LG_API size_t lg_metrics_roc(const uint32_t *truth, const double *score, size_t n, uint32_t positive,
                             double *fpr, double *tpr, double *threshold, uint32_t *order);
/* Computes the area under the receiver operating characteristic. truth (n), score (n, classes). With two
 * classes it is the area for class 1. With more classes it is the mean of the areas of each class against all
 * others, over the classes for which the area exists. Equal scores count half. *auc is NaN if no area exists,
 * because all windows have the same class. Errors: LG_INVALID_ARGUMENT (no classes, 2^32 windows or more). */
LG_API lg_status lg_metrics_auc(const lg_context *context, const uint32_t *truth, const double *score,
                                size_t n, uint32_t classes, double *auc);

/* ---- files of series (library liegrad_io) ---- */

typedef struct lg_series_data {
    lg_series series;
    double noise;                 /* factor on the noise of the sensors (lg_riser_run); NaN if unknown */
    double severity;              /* r of the broken runs (lg_riser_parameters); NaN if unknown */
    char housing[16];             /* name of the lg_housing; "" if unknown */
    char healthy[LG_SERIES_NAME]; /* name of the class that means "all is well"; "" if unknown */
    /* Hash of x as little-endian floats and label as little-endian u32; set by reader and writer. */
    char sha256[LG_SHA256_TEXT];
    lg_provenance provenance;
} lg_series_data;

/* Reads a set of series from an HDF5 file: the datasets /X and /y and what else docs/files.md lists, with the
 * rules that say which label belongs to which class. /X is converted to floats without a second copy. The
 * label of each class is stored in series.class_label.
 *
 * `like` (may be NULL) is a series that was read before, or the names of a model (lg_detector_load). If
 * it is given, the file is a test file in these rules: the result has the classes and class_label of `like`.
 *
 * Errors: LG_FORMAT also for labels that are empty or not whole, a label or class that `like` does not have,
 * an attribute `healthy` that names no class, and a file without windows. LG_NOT_FINITE also for numbers that
 * a float cannot hold; the sentence has window, channel and sample. */
LG_API lg_status lg_series_read(const lg_context *context, const char *path, const lg_read_options *options,
                                const lg_series *like, lg_series_data *out, lg_error *error);
/* Writes a file of kind "series": /X as f32, /y as u32 with the class numbers 0, 1, ... (so class_label is
 * not written), and /group and /run if they are known. Names are joined by |; if the joined text would be
 * longer than about 4000 bytes, or a name contains |, they become datasets /classes and /channels of texts.
 * Fills data->sha256. Errors: LG_NOT_FINITE, LG_INVALID_ARGUMENT (no windows, a label that is not below
 * `classes`, empty or repeated class names, a run whose windows are not consecutive), LG_FILE. */
LG_API lg_status lg_series_write(const lg_context *context, const char *path, lg_series_data *data,
                                 lg_error *error);
LG_API void lg_series_data_destroy(lg_series_data *data);

LG_END_DECLS

#endif
