/* Anomaly detection in sensor data: detectors (convolutional networks that classify windows), novelty
 * (whether a window is like the training data at all), monitors (which apply a classifier to a feed of
 * samples), and a simulated drilling riser that generates data. Windows, splits and scalers are in
 * liegrad/series.h, classical classifiers in liegrad/classify.h. The guide is docs/detectors.md.
 *
 * The functions are in the library liegrad, except the section "monitoring of a feed" (liegrad_classify) and
 * the section "files of detectors" (liegrad_io).
 *
 *   lg_detector_plan *plan;
 *   lg_detector_plan_create(NULL, &model, &scaler, theta, LG_F32, &plan, &error);
 *   void *work = aligned_alloc(64, lg_detector_work_size(plan));
 *   lg_detector_eval(plan, x, probability, NULL, work);
 */
#ifndef LIEGRAD_ANOMALY_H
#define LIEGRAD_ANOMALY_H

#include "liegrad/model.h"
#include "liegrad/series.h"

LG_BEGIN_DECLS

/* ---- detectors ----
 *
 * A detector is a convolutional network that gives the class of a window of sensor data.
 *
 * A window (channels, length) is scaled channel by channel, z = (x - mean)/scale, with mean and scale of the
 * training part (lg_scaler). With `centred`, the mean of each channel over the window itself is subtracted
 * first. The loss is
 *   LG_DETECTOR_MSE            for two classes and one output y: mean of (sigmoid(y) - label)^2
 *   LG_DETECTOR_CROSS_ENTROPY  with one output per class: mean of -log softmax(y)[label] */

typedef enum lg_detector_loss { LG_DETECTOR_MSE, LG_DETECTOR_CROSS_ENTROPY } lg_detector_loss;
#define LG_DETECTOR_LOSS_COUNT 2
/* "mse" or "cross-entropy"; "unknown" for any other value. */
LG_API const char *lg_detector_loss_name(lg_detector_loss loss);

/* The description of a detector; plain data. The parameters are a separate vector theta
 * (lg_cnn_parameters(&net)). */
typedef struct lg_detector {
    lg_cnn net;       /* from lg_cnn_init; net.outputs must be 1 for LG_DETECTOR_MSE, `classes` otherwise */
    uint32_t classes; /* >= 2; exactly 2 for LG_DETECTOR_MSE */
    lg_detector_loss loss;
    bool centred; /* subtract the mean of each channel over the window */
} lg_detector;
/* Checks a description. Errors: LG_INVALID_ARGUMENT with a sentence. */
LG_API lg_status lg_detector_check(const lg_detector *model, lg_error *error);

/* ---- training ---- */

/* Windows for training: scaled, and in the memory order in which the network reads them. */
typedef struct lg_detector_data {
    size_t count;
    lg_dtype dtype;
    void *x;                   /* (count, length, channels) numbers of type `dtype` */
    uint32_t *label;           /* (count) */
    const lg_context *context; /* in whose memory the arrays are */
} lg_detector_data;
/* Makes the training data from the windows with the indices chosen (count), or from all windows if `chosen`
 * is NULL. The order is kept; `chosen` must list the training part first and then the validation part.
 * Errors: LG_SHAPE (channels, length or classes differ from the model's), LG_INVALID_ARGUMENT (no windows, an
 * index out of range), LG_NOT_FINITE (a scaled number overflows in `dtype`). */
LG_API lg_status lg_detector_data_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const lg_series *series,
                                         const lg_windows *windows, const uint32_t *chosen, size_t count,
                                         lg_dtype dtype, lg_detector_data *out, lg_error *error);
LG_API void lg_detector_data_destroy(lg_detector_data *data);

/* A model and its data. All pointers are borrowed. */
typedef struct lg_detector_problem {
    const lg_detector *model;
    const lg_detector_data *data;
    /* The first `training` windows of the data are the training part, the others the validation part
     * (lg_fit_problem.validation). lg_fit_options.keep_best takes the parameters of the epoch with the best
     * validation. */
    size_t training;
    uint64_t seed; /* seed of the new weights for a network that died (see below) */
} lg_detector_problem;
/* Fills *out for lg_fit. `problem` is borrowed and must outlive the fit. With lg_fit_options.restarts, a
 * network that died (see below) starts again with the weights of lg_detector_initialise. */
LG_API void lg_detector_fit_problem(const lg_detector_problem *problem, lg_fit_problem *out);
/* Draws the weights theta (lg_cnn_parameters) as lg_cnn_initialise does. restart = 0 gives the first draw of
 * the random generator with this seed, restart = 1 its second draw, and so on. */
LG_API void lg_detector_initialise(const lg_detector *model, uint64_t seed, uint64_t restart, double *theta);

/* ---- dead units ---- */

/* A unit is one number of the plane, or one output channel of a convolution (with its values at all times),
 * after activation and pooling. A unit is constant if its least and its largest value over all training
 * windows differ by at most 1e-6 max(1, |value|). The layers behind a constant unit learn nothing about the
 * window from it. A unit is zero if all its values are 0, as for a ReLU whose argument is never positive;
 * then the weights of the unit have no gradient either. If all units of a layer are constant, the output is
 * constant too, and the network has died: it gives every window the same class, and training cannot change
 * that. */
#define LG_DETECTOR_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 1)
typedef struct lg_detector_units {
    /* Number of layers: the convolutions, then the plane if there is one. The output layer does not count. */
    uint32_t layers;
    struct {
        uint32_t units, constant, zero; /* numbers of units, of constant units, of zero units */
    } layer[LG_DETECTOR_MAX_LAYERS];
    bool died; /* always false for a single training window */
} lg_detector_units;
/* Counts the units of the network with the parameters theta (lg_cnn_parameters), over the training part. The
 * network is evaluated in the type of the data. Errors: the errors of the tape. */
LG_API lg_status lg_detector_count_units(const lg_detector_problem *problem, const double *theta,
                                         lg_detector_units *out);

/* ---- presets ---- */

/* Settings for data of a subsea well with some level of sensor noise (lg_riser_run.noise): published ones
 * ("thesis") and our own ("best"). */
typedef struct lg_detector_preset {
    const char *name;   /* "thesis" or "best" */
    double noise;       /* noise level 1, 10 or 50, or NaN for data of unknown noise */
    const char *source; /* where the settings are from: "table 6.5" of the thesis, or "ours" */
    lg_activation activation;
    lg_detector_loss loss;
    lg_fit_settings training;
} lg_detector_preset;
/* Returns the preset with this name whose noise level is nearest to `noise`. For an unknown level (NaN) it
 * returns the preset for unknown noise, or the first preset with this name if none is for unknown noise.
 * Returns NULL for an unknown name. */
LG_API const lg_detector_preset *lg_detector_preset_find(const char *name, double noise);

/* ---- as a program ---- */

/* Makes a program with the parameters `theta`, `mean`, `mean_rest` and `inverse_scale` and the functions
 * below. x is an unscaled window (channels, length), z a scaled window (length, channels).
 *   value        x -> y: the logits (outputs)
 *   grad         x -> y, g: the logits and their Jacobian (outputs, channels length)
 *   probability  x -> probability (classes)
 *   scores       z -> probability, and `plane` if the network has a plane
 * theta is copied. `mean` and `mean_rest` sum to the mean of the scaler; `mean` is exact in single precision.
 * Errors: the errors of lg_program_build. */
LG_API lg_status lg_detector_program(const lg_context *context, const lg_detector *model,
                                     const lg_scaler *scaler, const double *theta, lg_program **out,
                                     lg_error *error);

/* ---- evaluation without a tape ---- */

/* Makes a plan that classifies single windows. It is immutable: threads may share it, each with its own work
 * memory. The model, the scaler and theta are copied; theta is rounded to `dtype`, in which the network
 * computes. Errors: the errors of lg_detector_program and lg_plan_create. */
typedef struct lg_detector_plan lg_detector_plan;
LG_API lg_status lg_detector_plan_create(const lg_context *context, const lg_detector *model,
                                         const lg_scaler *scaler, const double *theta, lg_dtype dtype,
                                         lg_detector_plan **out, lg_error *error);
LG_API void lg_detector_plan_destroy(lg_detector_plan *plan);
/* Bytes of work memory for lg_detector_eval; the memory must be aligned to 64 bytes. */
LG_API size_t lg_detector_work_size(const lg_detector_plan *plan);
/* Computes probability (classes) of one unscaled window x (channels, length). plane (net.plane), or NULL,
 * receives the output of the layer before the last one. Does not allocate or lock. */
LG_API void lg_detector_eval(const lg_detector_plan *plan, const float *x, double *probability, double *plane,
                             void *work);

/* ---- novelty ----
 *
 * A window of sensor data is novel if it is unlike the windows that a model was trained on. A classifier
 * gives every window one of its classes, even a window of a dead sensor; novelty says when the answer of the
 * classifier is meaningless.
 *
 * Features of a window z = (x - mean)/scale (channels, length):
 *   per channel           the mean m; ln s, where s is the standard deviation; ln(max |z - m|/s);
 *                         and ln of the power in each of `bands` frequency bands (lg_spectrum)
 *   per pair of channels  artanh of their correlation (only for up to LG_NOVELTY_PAIRED channels)
 * A thousandth of the channel's scale is added to s and to the amplitudes, so motions that are smaller are
 * not distinguished from no motion. For each class, the features f of the training windows are described by a
 * normal distribution with centre c and covariance Sigma. Sigma is shrunk towards its diagonal by a share
 * that is estimated from the data (Schaefer & Strimmer, Stat. Appl. Genet. Mol. Biol. 4 (2005) 32). With P =
 * Sigma^-1 and d = f - c the squared distances of a window from the class are
 *   of all features         d' P d                        (Mahalanobis distance)
 *   of a group g of them    (P d)_g' (P_gg)^-1 (P d)_g    the part of d_g that the rest of d does not explain
 * The features of each channel are a group, and the features of all pairs together are one group. Each
 * squared distance has a limit: `margin` times a quantile of the same distance of training windows (measured
 * from distributions that were fitted without these windows), or `margin` times the number of features in the
 * group if that is larger. A window is novel if for every class at least one of its distances exceeds its
 * limit, if a channel stands still, or if too many samples of a channel are at its least or largest value. */

#define LG_NOVELTY_PAIRED   24u   /* with more channels than this there are no features of pairs */
#define LG_NOVELTY_FEATURES 1024u /* largest number of features; with many channels there are fewer bands */

typedef struct lg_novelty {
    uint32_t channels, length, classes;
    uint32_t bands, pairs, features; /* numbers of bands, of pairs of channels, of features */
    double *mean, *scale;            /* (channels) */
    double *still;                   /* (channels) allowed number of consecutive samples that are equal */
    double *extreme;   /* (channels) allowed number of samples at the least (or largest) value of a window */
    double *windows;   /* (classes) number of training windows; a class with 0 has no distribution */
    double *centre;    /* (classes, features) */
    double *spread;    /* (features) standard deviation within the classes */
    double *precision; /* (classes, features, features) inverse covariance of (f - centre)/spread */
    double *limit;     /* (1 + channels + 1) limits: for all features, for each channel, for the pairs */
    double *block;     /* Cholesky factors of the blocks P_gg of `precision` */
    lg_spectrum spectrum; /* all zero if bands is 0 */
    const lg_context *context;
} lg_novelty;

/* The comments give the values of lg_novelty_options_init. */
typedef struct lg_novelty_options {
    size_t size;     /* sizeof(lg_novelty_options) */
    uint32_t bands;  /* wanted number of frequency bands; default 8 */
    uint32_t folds;  /* default 5, >= 2: folds of the training windows, for measuring the quantiles */
    uint32_t most;   /* default 20000, >= 8: largest number of windows used, evenly chosen */
    double quantile; /* quantile of the squared distances; default 0.99, in (0, 1] */
    double margin;   /* default 3, > 0: factor from the quantile of a squared distance to its limit */
} lg_novelty_options;
LG_API void lg_novelty_options_init(lg_novelty_options *options);

/* Fits the distributions and limits to the windows with the indices chosen (count), or to the first `count`
 * windows if `chosen` is NULL. `options` must not be NULL. Windows of the same group are put into the same
 * fold; without groups, windows of the same run are. The bits of the result do not depend on `threads` >= 1.
 * Errors: LG_INVALID_ARGUMENT (fewer than 8 windows, windows of one sample, more than LG_NOVELTY_FEATURES/3
 * channels, an option out of range), LG_NOT_FINITE, LG_CANCELLED. */
LG_API lg_status lg_novelty_fit(const lg_context *context, const lg_novelty_options *options,
                                const lg_series *series, const lg_windows *windows, const uint32_t *chosen,
                                size_t count, int threads, lg_novelty *out, lg_error *error);
LG_API void lg_novelty_destroy(lg_novelty *novelty);

/* ---- evaluation of novelty ---- */

typedef enum lg_novelty_cause {
    LG_NOVELTY_NONE,    /* no cause can be given, because a value of the window is not finite */
    LG_NOVELTY_STILL,   /* `samples` consecutive samples of `channel` are equal */
    LG_NOVELTY_EXTREME, /* `samples` samples of `channel` are at its least or largest value */
    LG_NOVELTY_CHANNEL, /* a feature of `channel` deviates most from training */
    LG_NOVELTY_PAIR     /* the correlation of `channel` and `other` deviates most from training */
} lg_novelty_cause;

typedef struct lg_novelty_result {
    bool novel;
    /* For each class, the ratios of the squared distances to their limits are computed, and the largest ratio
     * is taken. `distance` is the smallest of these numbers over the classes; above 1 the window is novel. */
    double distance;
    uint32_t nearest;                 /* the class that has this smallest number */
    lg_novelty_cause cause;           /* what is most unusual; also set if the window is not novel */
    uint32_t channel, other, samples; /* see lg_novelty_cause */
    /* Index of the feature that deviates most from the centre of `nearest`, in units of its spread. If a
     * feature of a single channel deviates by more than 5 spreads, pairs are not considered. */
    uint32_t feature;
    double value, usual; /* value of this feature in the window, and in the centre of `nearest` */
    double deviation;    /* standard deviation of `channel` in the window, relative to the usual one */
} lg_novelty_result;

/* Bytes of work memory for lg_novelty_eval; the memory must be aligned to 64 bytes. */
LG_API size_t lg_novelty_work_size(const lg_novelty *novelty);
/* Judges an unscaled window x (channels, length). features (novelty->features), or NULL, becomes the features
 * of the window. A window with a value that is not finite is novel, with an infinite distance. Does not
 * allocate or lock. */
LG_API void lg_novelty_eval(const lg_novelty *novelty, const float *x, lg_novelty_result *result,
                            double *features, void *work);
/* Computes ratio (channels) from the features of a window (lg_novelty_eval): the amplitude in the highest
 * frequency band, divided by the usual amplitude there of class `class_index`. This is the relative noise of
 * the sensors if they measure only noise in this band. All ratios are 1 if there are no bands. */
LG_API void lg_novelty_noise(const lg_novelty *novelty, uint32_t class_index, const double *features,
                             double *ratio);
/* The lower end of the highest frequency band, in cycles per sample. */
LG_API double lg_novelty_noise_from(const lg_novelty *novelty);
/* Writes the cause as a text such as "moment_x: standard deviation 0.01 times the usual", and returns its
 * length as snprintf does. names (channels), or NULL: channels are then numbered from 1. `rate` in Hz; 0 if
 * it is unknown. */
LG_API int lg_novelty_explain(const lg_novelty *novelty, const lg_novelty_result *result,
                              char (*names)[LG_SERIES_NAME], double rate, char *text, size_t size);

/* ---- archives of novelty ---- */

/* Save and load the arrays below "novelty/" of an archive (liegrad/core.h). lg_novelty_load checks sizes and
 * values; on failure *out is zeroed. Errors of lg_novelty_load: LG_NOT_FOUND (the archive has no novelty),
 * LG_FORMAT, LG_NOT_FINITE. Errors of lg_novelty_save: the errors of the writer. */
LG_API lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *writer, lg_error *error);
LG_API lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *reader, lg_novelty *out,
                                 lg_error *error);

/* ---- monitoring of a feed (library liegrad_classify) ----
 *
 * A monitor receives the samples of a feed one by one, cuts them into windows, passes each window to a scorer
 * (a callback around any classifier), and raises an alarm when enough of the last windows are positive. It
 * lives in memory of fixed size that the caller provides. */

/* The comments give the values of lg_monitor_options_init; channels and window must be set. */
typedef struct lg_monitor_options {
    size_t size;       /* sizeof(lg_monitor_options) */
    uint32_t channels; /* >= 1 */
    uint32_t window;   /* samples per window, >= 1 */
    /* Samples from the beginning of one window to the beginning of the next, <= `window`. 0, the default,
     * stands for `window`. */
    uint32_t hop;
    uint32_t bridge; /* default 5: gaps of at most so many samples are filled by straight lines */
    double missing;  /* default 0.1: a window is scored if at most this part of it was lost, bridged or not */
    /* k, default 3: there is an alarm if at least k of the last n scored windows are positive. */
    uint32_t votes;
    uint32_t votes_of; /* n, default 5, 1..64 */
} lg_monitor_options;
LG_API void lg_monitor_options_init(lg_monitor_options *options);

typedef enum lg_answer {
    LG_ANSWER_NEGATIVE, /* the window is normal */
    LG_ANSWER_POSITIVE, /* what the monitor looks for */
    LG_ANSWER_NOVEL     /* the window is unlike the training data (lg_novelty), so there is no answer */
} lg_answer;
/* Scores a window x (channels, window): sets *answer and *score (higher means more positive). `missing`
 * samples of x were lost and are filled in. x is in the memory of the monitor, aligned to 64 bytes, and valid
 * until the scorer returns. */
typedef lg_status (*lg_monitor_scorer)(void *user, const float *x, uint32_t missing, lg_answer *answer,
                                       double *score);

/* The result for one window. */
typedef struct lg_verdict {
    uint64_t window;       /* number of the window: 0, 1, ... */
    uint64_t first_sample; /* number of its first sample in the feed */
    bool scored;           /* false: too many samples were lost; `answer` and `score` are not set */
    lg_answer answer;
    double score;
    uint32_t missing; /* number of samples of the window that were not received or not finite */
    /* Number of positive windows among the last windows that were scored and not novel; number of these
     * windows, at most n. */
    uint32_t positive_votes, votes;
    uint32_t novel_votes; /* number of novel windows among the last n scored windows */
    bool alarm;           /* positive_votes >= k; does not change while windows are not scored or are novel */
    bool novel;           /* novel_votes >= k; does not change while windows are not scored */
} lg_verdict;

typedef struct lg_monitor lg_monitor;
/* Bytes of memory for a monitor (two windows of floats and a little more); the memory must be aligned to 64
 * bytes. 0 for options that lg_monitor_init rejects. */
LG_API size_t lg_monitor_size(const lg_monitor_options *options);
/* Makes a monitor in `memory` (`size` bytes), which must live as long as the monitor is used. The monitor
 * owns nothing else, so there is no function that destroys it. `user` is passed to the scorer. Errors:
 * LG_INVALID_ARGUMENT with a sentence (channels or window is 0, hop > window, missing outside [0, 1], votes
 * outside 1..votes_of, votes_of outside 1..64, memory that is not aligned or has less than lg_monitor_size
 * bytes). */
LG_API lg_status lg_monitor_init(const lg_monitor_options *options, lg_monitor_scorer scorer, void *user,
                                 lg_monitor **out, void *memory, size_t size, lg_error *error);
/* Takes one sample (channels), or NULL for a sample that was lost. A sample with a value that is not finite
 * counts as lost. *ready becomes true if the sample completes a window; then *verdict is set. Window i has
 * the samples i hop .. i hop + window - 1 of the feed, counting lost ones. Lost samples are filled in:
 *   - A gap of at most `bridge` samples is filled by straight lines as soon as the next sample is received.
 *   - A longer gap, and a gap that is still open when a window is complete, gets the last value received.
 *   - Samples lost at the beginning of the feed get the value of the first sample received.
 * Before the first sample is received no window is scored, whatever `missing` allows. Only the scorer may
 * allocate memory or lock. The function returns the status of the scorer. If it is not LG_OK, *ready and
 * *verdict do not change, and the window has no vote; the next sample may be pushed. */
LG_API lg_status lg_monitor_push(lg_monitor *monitor, const float *sample, bool *ready, lg_verdict *verdict);

/* ---- a drilling riser ----
 *
 * A simulated drilling riser with blowout preventer (BOP) and wellhead, in waves and current. It generates
 * sensor data of an intact and of a damaged well. docs/detectors.md has the equations, and the parameters
 * with their units and sources.
 *
 * Each of the two horizontal directions x and y has 14 degrees of freedom: the offset u of the wellhead, the
 * rotation th of the BOP, and the displacements of 12 riser nodes; the top is fixed. Drag, soil and wellhead
 * act along the resultant of both directions and so couple them. */

#define LG_RISER_NODES      12
#define LG_RISER_DOF        (LG_RISER_NODES + 2) /* degrees of freedom of one direction */
#define LG_RISER_CHANNELS   6
#define LG_RISER_COMPONENTS 200 /* number of Airy waves in a sea state */

/* Returns the name of channel 0..5: "acc_lower_x", "acc_lower_y", "acc_upper_x", "acc_upper_y" (accelerations
 * in m/s^2), "moment_x", "moment_y" (moments in N m). NULL for other indices. */
LG_API const char *lg_riser_channel(uint32_t index);

typedef enum lg_housing { LG_HOUSING_SLACK, LG_HOUSING_TIGHT } lg_housing; /* fit of the wellhead housing */
#define LG_HOUSING_COUNT 2

/* SI units. docs/detectors.md explains each parameter; lg_riser_standard_run sets the standard values. */
typedef struct lg_riser_parameters {
    size_t size;                /* sizeof(lg_riser_parameters) */
    double depth, rho, gravity; /* water depth, m; density of water, kg/m^3; m/s^2 */
    /* Units in this order: kg, kg, m, m, N (submerged weight), m, 1 (drag coefficient), m^3. */
    double bop_mass, bop_added_mass, bop_height, bop_centre, bop_weight, bop_diameter, bop_drag, bop_volume;
    /* Units in this order: kg/m, m, 1 (drag coefficient), 1 (added-mass coefficient), N m^2, N/m. */
    double riser_mass, hydro_diameter, drag, added_mass, bending_stiffness, submerged_weight;
    double flex_joint;  /* N m/rad */
    double top_tension; /* N */
    /* K_r, N m/rad; K_sf, housing relative to casing; M_gap, the moment that closes the gap, N m; th_s,
     * rad */
    double housing_stiffness, housing_factor, housing_gap, softening;
    double soil_stiffness, soil_strength; /* K_y, N/m; P_u, N */
    double damping_rotation, damping_offset,
        damping_riser;                                /* zeta_r, zeta_u (of critical damping); beta, s */
    double sensor_moment, sensor_lower, sensor_upper; /* lever h_s and heights z_L, z_U, m */
    double noise_acceleration, noise_moment; /* standard deviations for lg_riser_run.noise = 1: m/s^2, N m */
    double current;                          /* at the surface, along x, m/s */
    lg_housing housing;
    double severity; /* r of the casing, in (0, 1]: 1 means intact, 0.58 the standard crack */
    /* Load relief: wires hold the BOP at the height relief_height above the sea floor with the horizontal
     * stiffness relief_stiffness in every direction. Units: N/m (0 means no wires), m. */
    double relief_stiffness, relief_height;
} lg_riser_parameters;
/* Checks the parameters. Errors: LG_INVALID_ARGUMENT with a sentence, for a parameter out of range (which it
 * names) or a structure that cannot stand: its mass matrix or stiffness matrix (with the initial spring of
 * the soil, and the housing beyond its gap) is not positive definite or overflows. A structure that is stable
 * only beyond the gap is accepted; it leans. */
LG_API lg_status lg_riser_parameters_check(const lg_riser_parameters *parameters, lg_error *error);

/* Changes the parameters of a drilling riser to those of a completion, with a Christmas tree below the BOP
 * and brine in the riser (docs/detectors.md, "Setups"). BOP and tree become one block: masses, volumes,
 * weights and heights add; bop_centre is the centre of all masses with added mass. Call it once. */
LG_API void lg_riser_complete(lg_riser_parameters *parameters);

/* ---- sea ---- */

/* A JONSWAP spectrum (gamma = 3.3) with cos^12 spreading about `direction`. */
typedef struct lg_sea_state {
    double height;    /* significant wave height Hs, m; 0 means a calm sea */
    double period;    /* peak period Tp, s */
    double direction; /* angle from x towards y, rad */
} lg_sea_state;

#define LG_SEA_STATES 18 /* Hs {1.5, 2, 2.5, 3, 3.5, 4.5} m times directions {20, 45, 70} degrees */
/* Returns standard sea state `index` (modulo 18); sea states with consecutive indices differ in direction
 * first. The period Tp = 4.2 sqrt(Hs) U(0.95, 1.25) + 1 s is drawn from `rng`, and so is an angle within +-10
 * degrees that is added to the direction. */
LG_API lg_sea_state lg_sea_state_draw(uint32_t index, lg_rng *rng);

/* ---- simulation ---- */

/* The comments give the values of lg_riser_run_init. */
typedef struct lg_riser_run {
    size_t size;      /* sizeof(lg_riser_run) */
    lg_sea_state sea; /* default Hs 2.5 m, Tp 8 s, along x */
    uint64_t seed;    /* seed of the waves; default 1 */
    /* Seed of the sensor noise; default 1. Runs with the same waves may have different noise. */
    uint64_t noise_seed;
    double noise;   /* factor on the sensor noise; 0 means no noise; default 1 */
    double dt;      /* time step, s; default 0.05. 1/(rate dt) must be a whole number */
    double rate;    /* sampling rate, Hz; default 5 */
    double discard; /* simulated time before the first sample, s; default 200 */
    double ramp;    /* time during which the forcing grows from 0 to its full size, s; default 100 */
    /* Time of the damage, s after the first sample. Before it the well is intact, afterwards it has
     * `severity`. 0, the default: damaged from the start. INFINITY: never damaged. */
    double crack_time;
    double drag_scale; /* factor on the drag; default 1; 0 for checks of the energy */
} lg_riser_run;
LG_API void lg_riser_run_init(lg_riser_run *out);

/* Simulates a run and writes samples (count, LG_RISER_CHANNELS) at the times 0, 1/rate, 2/rate, ... Equal
 * seeds give equal bits on machines with the same instruction set. Threads may call it at the same time.
 * Errors: LG_INVALID_ARGUMENT (a number out of range, a structure that cannot stand, waves that overflow),
 * LG_CANCELLED, LG_NOT_FINITE (the time step is too large). */
LG_API lg_status lg_riser_simulate(const lg_context *context, const lg_riser_parameters *parameters,
                                   const lg_riser_run *run, size_t count, float *samples, lg_error *error);

/* ---- the standard set of runs ---- */

/* Sets the parameters and the run of standard run `index` (modulo 108). There are 54 conditions: 3 pairs of
 * top tension and flex joint times 18 sea states. Run `index` has condition index/2; an even run is intact
 * (*label 0), an odd run has the damage `severity` (*label 1). The two runs of a condition have the same
 * waves. The three tensions of a sea state have the same period and direction, but different waves. Every run
 * has its own noise. *sea_state becomes 0..17, the index of the sea state. `seed` determines all draws. */
#define LG_RISER_RUNS 108
LG_API void lg_riser_standard_run(uint32_t index, uint64_t seed, double severity,
                                  lg_riser_parameters *parameters, lg_riser_run *run, uint32_t *label,
                                  uint32_t *sea_state);

/* ---- files of detectors (library liegrad_io) ---- */

/* Model, training and data of a run. Models and checkpoints store it. */
typedef struct lg_detector_run {
    lg_detector model;
    lg_fit_settings training; /* training.validation is 0; validation_fraction below takes its place */
    lg_split split;
    double test_fraction, validation_fraction; /* fractions of the number of windows */
    uint32_t restarts;                         /* largest number of restarts, lg_fit_options.restarts */
    uint64_t windows, window, hop; /* number of windows cut from the data; their length and hop, samples */
    char data_sha256[LG_SHA256_TEXT];
    char healthy[LG_SERIES_NAME]; /* name of the class that means "all is well"; "" if unknown */
} lg_detector_run;
/* The fields of lg_detector_run, ended by a row whose name is NULL (liegrad/settings.h). Fields with
 * lg_field.methods = 1 belong to the network. Fields with methods = 0 belong to the split of the data, which
 * the classical classifiers use too. */
LG_API extern const lg_field lg_detector_fields[];

/* Members that the structures of files of detectors begin with:
 *   names         names of classes and channels, and the rate; no windows
 *   novelty       fitted to the training windows; zero without such a fit
 *   accuracy, f1  on the test part; NaN if unknown */
#define LG_DETECTOR_HEAD                                                                                     \
    LG_MODEL_FILE(lg_detector_run);                                                                          \
    lg_series names;                                                                                         \
    lg_novelty novelty;                                                                                      \
    double accuracy, f1;

typedef struct lg_detector_file {
    LG_DETECTOR_HEAD
    lg_scaler scaler;
    double test_mse; /* on the test part; NaN if unknown */
} lg_detector_file;

LG_END_DECLS

#endif
