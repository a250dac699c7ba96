/* Declarations for training a detector from labelled series that are shared by the recipe, the classical
 * methods and the program `evaluate`. */
#ifndef LG_ANOMALY_RECIPE_H
#define LG_ANOMALY_RECIPE_H

#include "anomaly/judge.h"
#include "liegrad/anomaly.h"
#include "liegrad/series.h"
#include "liegrad/settings.h"
#include "model/files/training.h"

/* Write and read a part of a model by the functions that do so in an archive. LG_NOT_FOUND of `load` means
 * that the file lacks the part, which is no failure. */
typedef lg_status lg_part_saver(const void *part, const lg_archive_writer *to, lg_error *error);
typedef lg_status lg_part_loader(const lg_context *context, const lg_archive_reader *from, void *part,
                                 lg_error *error);
lg_status lg_detector_put_part(lg_h5 *h5, lg_part_saver *save, const void *part, lg_error *error);
lg_status lg_detector_get_part(lg_h5 *h5, lg_part_loader *load, void *part, lg_error *error);
/* Write and read names, rate and novelty. names->classes, channels and length are the model's; the novelty
 * must be for windows of this shape. Where channels is 0, the novelty is the model, and its shape is taken.
 * The length must be `window`. Without names in the file the classes are "0", "1", ... */
lg_status lg_detector_put_names(lg_h5 *h5, const lg_series *names, const lg_novelty *novelty,
                                lg_error *error);
lg_status lg_detector_get_names(lg_h5 *h5, uint64_t window, lg_series *names, lg_novelty *novelty,
                                lg_error *error);

/* State of the trainer of detectors. The values of its options come first. */
typedef struct lg_detector_state {
    const char *test;
    double window, hop;
    uint32_t preset, pooling;
    uint64_t kernel, stride;
    lg_wholes filters;
    /* The caller sets these for methods other than the network. */
    bool classical;    /* `describe` leaves out the network and its validation part */
    bool alone;        /* only the healthy class is learned: all other classes, of any name, become one */
    bool long_windows; /* windows have ten minutes and begin every minute, if the options say nothing else */
    /* Set by the hook `read`. */
    uint32_t healthy;      /* class that means "all is well", or LG_NO_CLASS; set by lg_detector_settle */
    lg_cut_series all;     /* the data file */
    lg_cut_series foreign; /* the --test file, if given */
    /* Set by lg_detector_split. */
    /* Windows of `all`; `tested` are windows of `foreign` if --test is given. */
    lg_window_list train, validation, tested;
    /* Set by the hook `judge`. */
    lg_judgement train_judged, judged;
    /* Used by the network (cnn) only. */
    const lg_detector_preset *from; /* preset that was adopted; NULL when training is resumed */
    lg_scaler scaler;
    lg_detector_data data;
    lg_detector_problem problem;
    lg_detector_units units;
    lg_novelty novelty;
} lg_detector_state;
extern const lg_field lg_detector_options[];

/* Returns the series that the test windows belong to: `foreign` with --test, otherwise `all`. */
const lg_cut_series *lg_detector_tested(const lg_detector_state *state);
/* Reads data for a model. `like` has the model's channel names, classes, number of channels and rate.
 * Channels are put into the order of like->channel_name. Classes are numbered as in `like`; if like->classes
 * is 0, any classes are allowed. Warns if channel names or the rate differ from the model's. */
lg_status lg_series_read_like(const lg_context *context, const char *path, const lg_series *like,
                              lg_series_data *out, lg_error *error);
/* Sets the labels to 0 for the class named `healthy` and to 1 for all others. If no class has this name,
 * warns and takes the class that attribute healthy of the file names, or whose name means that all is well.
 * The series then has two classes, or one if all windows are of the healthy class. */
void lg_series_merge(const lg_context *context, const char *path, const char *healthy, lg_series_data *data);
/* Finds the class that means "all is well", or LG_NO_CLASS, from the first of these that is known: `healthy`,
 * a name or label that the user gave or a model has stored; `data`, the attribute of a data file, or ""; the
 * words of the names, with a warning. `names` needs classes, class_name and class_label. `healthy` becomes
 * the name of the class, or "". Fails with LG_INVALID_ARGUMENT if `healthy` is the name of no class. */
lg_status lg_find_healthy(const lg_context *context, const lg_series *names, const char *data,
                          char healthy[LG_SERIES_NAME], uint32_t *out, lg_error *error);
/* Writes the sentence that says how the healthy class can be given. */
void lg_ask_healthy(const lg_series *names, char *text, size_t size);
/* Sets state->healthy and run->healthy for the data that were read. Warns if the class is unknown. With
 * state->alone it must be known, and the classes are merged. */
lg_status lg_detector_settle(const lg_training *self, lg_error *error);
/* Determines the length of a window and the distance between windows, in samples, from the options --window
 * and --hop and the rate of the data. On entry *window and *hop are the defaults; a hop of 0 becomes the
 * window. */
lg_status lg_detector_window(const lg_training *self, uint64_t *window, uint64_t *hop, lg_error *error);
/* Lists the windows that are in the part `wanted` if the windows are split as `run` says. run = NULL lists
 * all windows. */
lg_status lg_window_part(const lg_context *context, const lg_cut_series *from, const lg_detector_run *run,
                         lg_part wanted, lg_window_list *out, lg_error *error);
/* Cuts the data into windows, splits them into parts, and writes their number to run->windows. Warns if the
 * split makes the results misleading. */
lg_status lg_detector_split(lg_training *self, lg_error *error);
lg_status lg_detector_split_training(lg_training *self, lg_error *error); /* the same without the test part */
/* Fits the novelty detector to the training windows. Returns LG_CANCELLED and LG_OUT_OF_MEMORY. Any other
 * failure causes a warning, and *out stays unchanged. */
lg_status lg_detector_fit_novelty(const lg_training *self, lg_novelty *out, lg_error *error);
lg_scorer lg_detector_scorer(const lg_detector_plan *plan, const lg_detector *model, uint32_t healthy);
/* Writes the results accuracy, precision, recall, f1, auc, false_positive_rate, false_alarms_per_day and
 * confusion. */
void lg_detector_tell(lg_training *self, const lg_judgement *judged, uint64_t hop, double rate,
                      char (*class_name)[LG_SERIES_NAME]);
/* Writes the numbers that all methods report about their training. */
void lg_detector_tell_training(lg_training *self, const char *method, uint32_t classes,
                               char (*class_name)[LG_SERIES_NAME]);

#endif
