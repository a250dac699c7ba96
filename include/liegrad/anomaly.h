/* Anomaly detection: detectors, novelty, monitoring of a feed, and a well that makes data.
 */
#ifndef LIEGRAD_ANOMALY_H
#define LIEGRAD_ANOMALY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/series.h"
#include "liegrad/settings.h"

LG_BEGIN_DECLS

/* ---- detectors ----
 *
 * Detectors: convolutional networks that tell the class of a window of sensor data.
 *
 * A window (channels, length) is scaled channel by channel, z = (x - mean)/scale, with the numbers of the
 * training part; with `centred` each window's own mean is subtracted first. Loss:
 *   LG_DETECTOR_MSE            two classes, one output: mean of (sigmoid(y) - label)^2
 *   LG_DETECTOR_CROSS_ENTROPY  an output a class: mean of -log softmax(y)[label] */

typedef enum lg_detector_loss { LG_DETECTOR_MSE, LG_DETECTOR_CROSS_ENTROPY } lg_detector_loss;
#define LG_DETECTOR_LOSS_COUNT 2
LG_API const char *lg_detector_loss_name(lg_detector_loss loss); /* "mse", "cross-entropy" */

/* Plain data. net.outputs is 1 for LG_DETECTOR_MSE, `classes` otherwise. */
typedef struct lg_detector {
    lg_cnn net;
    uint32_t classes; /* >= 2; 2 for LG_DETECTOR_MSE */
    lg_detector_loss loss;
    bool centred;
} lg_detector;
/* `net` must come from lg_cnn_init. Errors: LG_INVALID_ARGUMENT with a sentence. */
LG_API lg_status lg_detector_check(const lg_detector *model, lg_error *error);

/* ---- training ---- */

/* Windows scaled and ordered as the network reads them: (count, length, channels) of `dtype`. Made once. */
typedef struct lg_detector_data {
    size_t count;
    lg_dtype dtype;
    void *x;                   /* (count, length, channels) */
    uint32_t *label;           /* (count) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_detector_data;
/* Makes the data of windows `chosen` (count; NULL: all of them), in this order: the training part first, then
 * the validation part. Errors, with a sentence: LG_SHAPE (channels, length or classes other than the
 * model's), LG_INVALID_ARGUMENT (no windows, or one that does not exist), LG_OUT_OF_MEMORY, LG_NOT_FINITE
 * (overflow in dtype). */
LG_API lg_status lg_detector_data_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const lg_series *series,
                                         const lg_windows *windows, const uint32_t *chosen, size_t count,
                                         lg_dtype dtype, lg_detector_data *out, lg_error *error);
LG_API void lg_detector_data_destroy(lg_detector_data *data);

/* A model and its data. The first `training` windows are the training part, the others the validation
 * part (lg_fit_problem.validation; set lg_fit_options.keep_best for the parameters of its best epoch).
 * Borrowed. */
typedef struct lg_detector_problem {
    const lg_detector *model;
    const lg_detector_data *data;
    size_t training;
    uint64_t seed; /* of the weights with which a network that died starts again */
} lg_detector_problem;
/* With lg_fit_options.restarts, a network that died (below) starts again with the weights of
 * lg_detector_initialise. */
LG_API void lg_detector_fit_problem(const lg_detector_problem *problem, lg_fit_problem *out);
/* Weights by LG_INIT_FAN_IN: draw number `restart` (0: the first) of one generator with this seed. */
LG_API void lg_detector_initialise(const lg_detector *model, uint64_t seed, uint64_t restart, double *theta);

/* ---- dead units ---- */

/* A unit is a number of the plane, or an output channel of a convolution at all its times, after activation
 * and pooling. It is constant when its least and largest value over all training windows differ by at most
 * 1e-6 max(1, |value|): what is behind it learns nothing of the window from it. Zero: constant, and all
 * values are 0, as those of a ReLU whose argument is never positive; then its own weights have no gradient
 * either. Where all units of a layer are constant, the output is, too, and the network has died: it gives
 * every window the same class, and training cannot change that. */
#define LG_DETECTOR_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 1)
typedef struct lg_detector_units {
    uint32_t layers; /* the convolutions, then the plane where there is one; the output is none of them */
    struct {
        uint32_t units, constant, zero;
    } layer[LG_DETECTOR_MAX_LAYERS];
    bool died; /* false for a single training window */
} lg_detector_units;
/* Counts the units for theta (lg_cnn_parameters), in the type of the data. Errors: LG_OUT_OF_MEMORY, the
 * tape's. */
LG_API lg_status lg_detector_count_units(const lg_detector_problem *problem, const double *theta,
                                         lg_detector_units *out);

/* Settings for levels of the sensors' noise: those published for the subsea well ("thesis"), and our own
 * ("best"). Our own include one for data of unknown noise. */
typedef struct lg_detector_preset {
    const char *name;   /* "thesis", "best" */
    double noise;       /* 1, 10, 50, or NaN: unknown. The nearest preset is taken, else the first */
    const char *source; /* "table 6.5", ... */
    lg_activation activation;
    lg_detector_loss loss;
    lg_training training;
} lg_detector_preset;
/* NULL for an unknown name. Static storage. */
LG_API const lg_detector_preset *lg_detector_preset_find(const char *name, double noise);

/* ---- as a program ---- */

/* A bundle on the parameters `theta`, `mean`, `mean_rest` and `inverse_scale`; x is a window as recorded
 * (channels, length), z a scaled window (length, channels):
 *   value        x -> y, the logits
 *   grad         x -> y, g: (outputs, channels length)
 *   probability  x -> probability (classes)
 *   scores       z -> probability, plane (where the network has one)
 * Errors: those of lg_program_build. */
LG_API lg_status lg_detector_program(const lg_context *context, const lg_detector *model,
                                     const lg_scaler *scaler, const double *theta, lg_program **out,
                                     lg_error *error);

/* ---- use, without a tape ---- */

/* A plan of `scores` above for one window. Immutable: threads may share it, each with its own work memory.
 * Everything is copied. The network computes in `dtype`, to which theta is rounded. Errors: those of
 * lg_detector_program and lg_plan_create. */
typedef struct lg_detector_plan lg_detector_plan;
LG_API lg_status lg_detector_plan_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const double *theta, lg_dtype dtype,
                                         lg_detector_plan **out, lg_error *error);
LG_API void lg_detector_plan_destroy(lg_detector_plan *plan); /* NULL is fine */
/* Bytes, to be aligned to 64. */
LG_API size_t lg_detector_work_size(const lg_detector_plan *plan);
/* One window x (channels, length), as recorded. probability (classes), plane (net.plane) or NULL. No
 * allocation, no lock. */
LG_API void lg_detector_eval(const lg_detector_plan *plan, const float *x, double *probability, double *plane,
                             void *work);

/* ---- novelty ----
 *
 * Novelty: whether a window of sensor data is like the windows that a model was trained on. A classifier
 * gives any window one of its classes, also one from a dead sensor; this says when its answer means nothing.
 *
 * Features of a window z = (x - mean)/scale (channels, length):
 *   a channel   mean m; ln s, s the standard deviation; ln(max |z - m|/s); ln of the power in each of `bands`
 *               frequency bands (liegrad/spectrum.h)
 *   a pair      of channels: artanh of their correlation (up to LG_NOVELTY_PAIRED channels)
 * A thousandth of the channel's scale is added to s and to the amplitudes: less than that is not told from
 * nothing. Each class of the training windows has a normal distribution of the features f: centre c and
 * covariance Sigma, shrunk towards the diagonal by the share that the data ask for (Schaefer & Strimmer,
 * Stat. Appl. Genet. Mol. Biol. 4 (2005) 32). With P = Sigma^-1 and d = f - c the squared distances are
 *   of the window           d' P d                          (Mahalanobis)
 *   of a group of features  (P d)_g' (P_gg)^-1 (P d)_g      the part that the rest of d does not explain
 * where the features of a channel are a group, and all pairs are one. Their limits are `margin` times a
 * quantile of the same distances of training windows that the distributions were not fitted on, or times the
 * number of features, if that is larger. A window is novel when one of its distances is beyond its limit for
 * every class, when a channel stands still, or when too many samples are at the channel's least or largest
 * value. */

#define LG_NOVELTY_PAIRED   24u   /* channels; with more, pairs are left out */
#define LG_NOVELTY_FEATURES 1024u /* at most; with many channels there are fewer bands */

typedef struct lg_novelty {
    uint32_t channels, length, classes;
    uint32_t bands, pairs, features;
    double *mean, *scale; /* (channels) */
    double *still;        /* (channels): equal consecutive samples that are allowed */
    double *extreme;      /* (channels): samples at the window's least, or largest, value that are allowed */
    double *windows;      /* (classes): training windows; a class without any has no distribution */
    double *centre;       /* (classes, features) */
    double *spread;       /* (features): standard deviation within the classes */
    double *precision;    /* (classes, features, features): of (f - centre)/spread */
    double *limit;        /* (1 + channels + 1): of the window, each channel, the pairs */
    double *block;        /* Cholesky factors of the groups' blocks of `precision` */
    lg_spectrum spectrum; /* zero for bands 0 */
    const lg_context *context;
} lg_novelty;

typedef struct lg_novelty_options {
    size_t size;     /* sizeof(lg_novelty_options) */
    uint32_t bands;  /* 8 */
    uint32_t folds;  /* 5: of the training windows, for the limits */
    uint32_t most;   /* 20000: windows that are looked at, evenly chosen */
    double quantile; /* 0.99 */
    double margin;   /* 3: limit of a squared distance over its quantile */
} lg_novelty_options;
LG_API void lg_novelty_options_init(lg_novelty_options *options);

/* Fits it on the windows `chosen` (count; NULL: the first `count`). Windows of a group, or without groups of
 * a run, are in the same fold. The bits do not depend on `threads` >= 1. Errors, with a sentence:
 * LG_INVALID_ARGUMENT (fewer than 8 windows or 2 samples, more than LG_NOVELTY_FEATURES/3 channels),
 * LG_NOT_FINITE, LG_OUT_OF_MEMORY, LG_CANCELLED. */
LG_API lg_status lg_novelty_fit(const lg_context *context, const lg_novelty_options *options,
                                const lg_series *series, const lg_windows *windows, const uint32_t *chosen,
                                size_t count, int threads, lg_novelty *out, lg_error *error);
LG_API void lg_novelty_destroy(lg_novelty *novelty); /* a zeroed one is fine */

/* ---- use ---- */

typedef enum lg_novelty_cause {
    LG_NOVELTY_NONE,
    LG_NOVELTY_STILL,   /* `samples` consecutive samples of `channel` are equal */
    LG_NOVELTY_EXTREME, /* `samples` samples of `channel` are at its least or largest value */
    LG_NOVELTY_CHANNEL, /* `channel` is unlike the others' and its own features in training */
    LG_NOVELTY_PAIR     /* so is the correlation of `channel` and `other` */
} lg_novelty_cause;

typedef struct lg_novelty_result {
    bool novel;
    double distance; /* the largest squared distance over its limit, of the nearest class; above 1 is novel */
    uint32_t nearest;       /* that class */
    lg_novelty_cause cause; /* told below the limits, too; NONE: a value is not finite */
    uint32_t channel, other, samples;
    uint32_t feature;    /* that deviates most, in units of its spread; a channel's if one deviates by 5 */
    double value, usual; /* of that feature */
    double deviation;    /* of the channel: standard deviation over the usual */
} lg_novelty_result;

/* Bytes, to be aligned to 64, for lg_novelty_eval. */
LG_API size_t lg_novelty_work_size(const lg_novelty *novelty);
/* x (channels, length), as recorded. features: NULL, or (features) for the result. No allocation, no lock. A
 * window with a value that is not finite is novel, its distance infinite. */
LG_API void lg_novelty_eval(const lg_novelty *novelty, const float *x, lg_novelty_result *result,
                            double *features, void *work);
/* ratio (channels) = amplitude in the highest band over the usual one of a class, from `features`: the noise
 * of the sensors, where they measure nothing else there. bands 0: 1. */
LG_API void lg_novelty_noise(const lg_novelty *novelty, uint32_t class_index, const double *features,
                             double *ratio);
/* The lower end of that band, in cycles a sample. */
LG_API double lg_novelty_noise_from(const lg_novelty *novelty);
/* Writes the cause as snprintf does: "moment_x: standard deviation 0.01 times the usual". names (channels) or
 * NULL: numbers from 1 on; rate Hz, 0: unknown. */
LG_API int lg_novelty_explain(const lg_novelty *novelty, const lg_novelty_result *result,
                              char (*names)[LG_SERIES_NAME], double rate, char *text, size_t size);

/* ---- files ---- */

/* Arrays below "novelty/". The reader checks sizes and values: LG_FORMAT, LG_NOT_FINITE; LG_NOT_FOUND: there
 * is none. On failure *out is zeroed. */
LG_API lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *writer, lg_error *error);
LG_API lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *reader, lg_novelty *out,
                                 lg_error *error);

/* ---- monitoring of a feed ----
 *
 * Monitoring of a feed by a classifier, in the caller's memory of fixed size. Library `liegrad_classify`. */

typedef struct lg_monitor_options {
    size_t size;       /* sizeof(lg_monitor_options) */
    uint32_t channels; /* >= 1 */
    uint32_t window;   /* samples of a window */
    uint32_t hop;      /* 0: window; samples from one window to the next, <= window */
    uint32_t bridge;   /* 5: gaps of at most this many samples are filled by straight lines */
    double missing;    /* 0.1: largest part of a window that may be missing, bridged samples included */
    uint32_t votes;    /* k = 3: alarm when k of the last n judged windows are positive */
    uint32_t votes_of; /* n = 5, 1..64 */
} lg_monitor_options;
LG_API void lg_monitor_options_init(lg_monitor_options *options);

typedef enum lg_answer {
    LG_ANSWER_NEGATIVE, /* all is well */
    LG_ANSWER_POSITIVE,
    LG_ANSWER_NOVEL /* unlike what the judge knows (liegrad/novelty.h): neither of the two */
} lg_answer;
/* Judges a window (channels, window), `missing` samples of which are filled in: sets *answer and *score
 * (higher means more positive). x lies in the monitor's memory, 64-byte aligned; the judge may use it until
 * it returns. */
typedef lg_status (*lg_monitor_judge)(void *user, const float *x, uint32_t missing, lg_answer *answer,
                                      double *score);

typedef struct lg_verdict {
    uint64_t window;       /* 0, 1, ... */
    uint64_t first_sample; /* of the feed */
    bool judged;           /* false: too much was missing; nothing below but `alarm` means anything */
    lg_answer answer;
    double score;
    uint32_t missing;               /* samples not received, or not finite */
    uint32_t positive_votes, votes; /* among the last n windows that were judged and not novel */
    uint32_t novel_votes;           /* among the last n judged windows */
    bool alarm; /* k of n are positive; the last state while windows are not judged, or novel */
    bool novel; /* k of n are novel; the last state while windows are not judged */
} lg_verdict;

typedef struct lg_monitor lg_monitor;
/* Bytes, to be 64-byte aligned: two windows of floats and a small rest. 0 for options that init refuses. */
LG_API size_t lg_monitor_size(const lg_monitor_options *options);
/* LG_INVALID_ARGUMENT with a sentence: a size of 0, hop > window, missing outside [0, 1], votes outside
 * 1..votes_of, votes_of outside 1..64, memory that is not aligned or smaller than lg_monitor_size. The
 * monitor lives in `memory` (`size` bytes) and owns nothing else. */
LG_API lg_status lg_monitor_init(const lg_monitor_options *options, lg_monitor_judge judge, void *user,
                                 lg_monitor **out, void *memory, size_t size, lg_error *error);
/* One sample (channels), or NULL: lost. A sample with a value that is not finite is lost as a whole. *ready:
 * a window is complete, *verdict is set. Window i holds samples i hop .. i hop + window - 1 of the feed, lost
 * ones counted. Lost samples:
 *   - a gap of at most `bridge` samples is filled by straight lines as soon as the next sample is received;
 *   - a longer gap, and one still open when a window is complete, holds the last value received;
 *   - lost samples at the beginning of a feed get the value of the first one received.
 * A window of a feed that has not sent a sample yet is not judged, whatever `missing` allows. No allocation,
 * no lock of its own. Returns the judge's status: unless it is LG_OK, *ready and *verdict are untouched, that
 * window has no vote, and the feed may go on. */
LG_API lg_status lg_monitor_push(lg_monitor *monitor, const float *sample, bool *ready, lg_verdict *verdict);

/* ---- a drilling riser ----
 *
 * A drilling riser, blowout preventer (BOP) and wellhead in waves and current. The scene generates sensor
 * data of an intact and of a damaged well. docs/riser.md has the equations, and the parameters with their
 * units and sources.
 *
 * Each of the two horizontal directions x and y has 14 degrees of freedom: wellhead offset u, BOP rotation th
 * and 12 riser nodes; the top is fixed. Drag, soil and wellhead act along the resultant and so couple the
 * directions. */

#define LG_RISER_NODES      12
#define LG_RISER_DOF        (LG_RISER_NODES + 2) /* of one direction */
#define LG_RISER_CHANNELS   6
#define LG_RISER_COMPONENTS 200 /* Airy waves of a sea state */

/* "acc_lower_x", "acc_lower_y", "acc_upper_x", "acc_upper_y", "moment_x", "moment_y": accelerations in m/s^2,
 * moments in N m. NULL beyond. */
LG_API const char *lg_riser_channel(uint32_t index);

typedef enum lg_housing { LG_HOUSING_SLACK, LG_HOUSING_TIGHT } lg_housing;
#define LG_HOUSING_COUNT 2

/* SI units. See docs/riser.md for each. */
typedef struct lg_riser_parameters {
    size_t size;                /* sizeof(lg_riser_parameters) */
    double depth, rho, gravity; /* m, kg/m^3, m/s^2 */
    double bop_mass, bop_added_mass, bop_height, bop_centre, bop_weight, bop_diameter, bop_drag, bop_volume;
    double riser_mass, hydro_diameter, drag, added_mass, bending_stiffness, submerged_weight;
    double flex_joint;                                                /* N m/rad */
    double top_tension;                                               /* N */
    double housing_stiffness, housing_factor, housing_gap, softening; /* K_r N m/rad, K_sf, M_gap N m, th_s */
    double soil_stiffness, soil_strength;                             /* K_y N/m, P_u N */
    double damping_rotation, damping_offset, damping_riser;           /* zeta_r, zeta_u, beta s */
    double sensor_moment, sensor_lower, sensor_upper;                 /* h_s, z_L, z_U, m */
    double noise_acceleration, noise_moment; /* standard deviations at noise 1: m/s^2, N m */
    double current;                          /* at the surface, m/s */
    lg_housing housing;
    double severity; /* r of the broken casing: 1 is intact, 0.58 the standard crack */
} lg_riser_parameters;
/* LG_INVALID_ARGUMENT with a sentence that names the parameter, or for a structure that cannot stand: the
 * mass or stiffness matrix (with the soil's initial spring, and the housing beyond its gap) is not positive
 * definite or overflows. A structure that is stable only beyond the gap passes; it leans. */
LG_API lg_status lg_riser_parameters_check(const lg_riser_parameters *parameters, lg_error *error);

/* ---- sea ---- */

/* JONSWAP (gamma 3.3), cos^12 spreading about `direction`. */
typedef struct lg_sea_state {
    double height;    /* Hs, m; 0: calm */
    double period;    /* Tp, s */
    double direction; /* rad, from x to y */
} lg_sea_state;

#define LG_SEA_STATES 18 /* Hs {1.5, 2, 2.5, 3, 3.5, 4.5} x directions {20, 45, 70} degrees */
/* Standard sea state `index` (modulo 18); the direction changes fastest. The rng draws the period
 * Tp = 4.2 sqrt(Hs) U(0.95, 1.25) + 1 and adds up to 10 degrees either way to the direction. */
LG_API lg_sea_state lg_sea_state_draw(uint32_t index, lg_rng *rng);

/* ---- simulation ---- */

typedef struct lg_riser_run {
    size_t size; /* sizeof(lg_riser_run) */
    lg_sea_state sea;
    uint64_t seed;       /* of the waves */
    uint64_t noise_seed; /* of the sensors' noise; runs with the same waves may differ in noise */
    double noise;        /* factor on the noise of the sensors; 0: none; 1 */
    double dt;           /* 0.05 s; 1/(rate dt) must be whole */
    double rate;         /* 5 Hz */
    double discard;      /* 200 s before the first sample */
    double ramp;         /* 100 s over which the forcing grows */
    double crack_time;   /* s after the first sample: the well is intact before and has the severity from then
                        * on. 0: damaged from the start; INFINITY: never */
    double drag_scale;   /* factor on drag; 1. Energy checks take 0, and no damping */
} lg_riser_run;
LG_API void lg_riser_run_init(lg_riser_run *out);

/* samples (count, LG_RISER_CHANNELS) at times 0, 1/rate, ... Equal seeds give equal bits on one instruction
 * set. Threads may call it at the same time. Errors, with a sentence: LG_INVALID_ARGUMENT (also a structure
 * that cannot stand, waves that overflow), LG_OUT_OF_MEMORY, LG_CANCELLED, LG_NOT_FINITE (the step is too
 * large). */
LG_API lg_status lg_riser_simulate(const lg_context *context, const lg_riser_parameters *parameters,
                                   const lg_riser_run *run, size_t count, float *samples, lg_error *error);

/* ---- the standard set of runs ---- */

/* There are 54 conditions: 3 top tensions with their flex joints times 18 sea states. Run `index` (modulo
 * 108) has condition index/2; it is intact when even and broken when odd. The two runs of a condition share
 * the waves. The three tensions share the period and direction of a sea state but have different waves. Every
 * run has its own noise. *label: 0 intact, 1 broken; *sea_state: 0..17. */
#define LG_RISER_RUNS 108
LG_API void lg_riser_standard_run(uint32_t index, uint64_t seed, double severity,
                                  lg_riser_parameters *parameters, lg_riser_run *run, uint32_t *label,
                                  uint32_t *sea_state);

/* ---- files of detectors (library liegrad_io) ---- */

typedef struct lg_detector_run {
    lg_detector model;
    lg_training training;
    lg_split split;
    double test_fraction, validation_fraction; /* of the windows; training.validation is 0 */
    uint32_t restarts;                         /* at most: lg_fit_options.restarts */
    uint64_t windows, window, hop;             /* windows cut from the data; samples */
    char data_sha256[LG_SHA256_TEXT];
} lg_detector_run;
/* The rows of lg_detector_run. There is one method, bit 0; rows with methods = 0 belong to the split of the
 * data, which the classical methods share. */
LG_API extern const lg_field lg_detector_fields[];

typedef struct lg_detector_file {
    lg_detector_run run;
    size_t parameters;
    double *theta; /* (parameters); stored as training.dtype */
    lg_scaler scaler;
    char (*class_name)[LG_SERIES_NAME];   /* (classes) */
    char (*class_label)[LG_SERIES_NAME];  /* (classes) or NULL; as in lg_series */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels) or NULL */
    double rate;                          /* Hz, 0 unknown */
    lg_novelty novelty;                   /* of the training windows; channels 0: none */
    double accuracy, f1, test_mse;        /* on the test part; NaN without one */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT];
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_detector_file;

/* Kind "detector": /model/conv1/weight ... as lg_cnn_slice names them, /scaler/{mean, scale} (channels),
 * root attributes `classes`, `class_labels`, `channels`, `rate`, `accuracy`, `f1`, `test_mse`, and optional
 * /novelty (lg_novelty_save); laws as for the other kinds. The blocks are an attribute of /model, "12 kernel
 * 5 stride 1 padding 0 average 2/2, 24 kernel ...": channels, pooling `none` or `average`, `max` with
 * size/stride. A model written by hand needs `kind`, /scaler, the weights and the attributes of /model:
 * `channels`, `length`, `blocks` (from `stride` on optional: 1, 0, none), `plane`, `activation`, `classes`,
 * `loss`, `centred`; without root attribute `classes` they are "0", "1", ... */
LG_API lg_status lg_model_save_detector(const lg_context *context, const char *path,
                                        const lg_detector_file *file, const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_detector(const lg_context *context, const char *path,
                                        const lg_read_options *options, lg_detector_file *out,
                                        lg_error *error);
LG_API void lg_detector_file_destroy(lg_detector_file *file);

LG_END_DECLS

#endif
