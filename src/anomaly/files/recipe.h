/* Learning a detector from labelled series: what the classical methods and `evaluate` need besides the hooks.
 */
#ifndef LG_ANOMALY_RECIPE_H
#define LG_ANOMALY_RECIPE_H

#include "anomaly/judge.h"
#include "liegrad/io.h"
#include "liegrad/novelty.h"
#include "model/files/learning.h"

/* One file, cut in windows. */
typedef struct lg_cut_series {
    lg_series_data data;
    lg_windows windows;
} lg_cut_series;

/* Of the learner; first its options. */
typedef struct lg_detector_state {
    const char *test;
    double window, hop;
    uint32_t preset, pooling;
    uint64_t kernel, stride, pool_size;
    lg_wholes filters;
    /* Filled by `read`. */
    bool any_class;        /* --test may have classes that the data do not have */
    lg_cut_series all;     /* the data */
    lg_cut_series foreign; /* --test */
    /* Filled by lg_detector_split. */
    lg_window_list train, validation, tested; /* of all; tested: of foreign when that is given */
    /* Filled by judge. */
    lg_judgement train_judged, judged;
    /* The network's. */
    const lg_detector_preset *from; /* NULL when resumed */
    lg_scaler scaler;
    lg_detector_data data;
    lg_detector_problem problem;
    lg_detector_units units;
    lg_novelty novelty;
} lg_detector_state;
extern const lg_field lg_detector_options[];

/* The series with the test part. */
const lg_cut_series *lg_detector_tested(const lg_detector_state *state);
/* Reads data for a model whose names, classes, channels and rate `like` has: channels come in its order;
 * classes are its own, or any where like->classes is 0. Warns of other names and another rate. */
lg_status lg_series_read_like(const lg_context *context, const char *path, const lg_series *like,
                              lg_series_data *out, lg_error *error);
/* Samples of a window, and from one to the next, by the options for these data; *window and *hop are the
 * defaults, hop 0: the window. */
lg_status lg_detector_window(const lg_learning *self, uint64_t *window, uint64_t *hop, lg_error *error);
/* The windows that belong to the part `wanted` of a training by `run`; run NULL: all of them. */
lg_status lg_window_part(const lg_context *context, const lg_cut_series *from, const lg_detector_run *run,
                         lg_part wanted, lg_window_list *out, lg_error *error);
/* Windows and parts by the run, which gets their number; warns of parts that say little. */
lg_status lg_detector_split(lg_learning *self, lg_error *error);
lg_status lg_detector_split_training(lg_learning *self, lg_error *error); /* without the part for testing */
/* What the windows of training look like; a warning where that cannot be found out, and *out is untouched.
 * LG_CANCELLED alone is a failure. */
lg_status lg_detector_fit_novelty(const lg_learning *self, lg_novelty *out);
/* Results: accuracy, precision, recall, f1, auc, false_positive_rate, false_alarms_per_day, confusion. */
void lg_detector_tell(lg_learning *self, const lg_judgement *judged, uint64_t hop, double rate);
/* The results of the test part, and the numbers that every method has. */
void lg_detector_tell_training(lg_learning *self, const char *method, uint32_t classes,
                               char (*class_name)[LG_SERIES_NAME]);

#endif
