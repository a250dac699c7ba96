/* What the files on detectors share. */
#ifndef LG_EXPORT_DETECTOR_H
#define LG_EXPORT_DETECTOR_H

#include "lg-export/window.h"
#include "liegrad/random.h"

/* A detector with what is known of it. Borrowed. */
typedef struct exported_detector {
    lg_detector detector;
    lg_scaler scaler;
    const double *theta;
    const lg_model *learned;
} exported_detector;

/* A window (channels, length) of noise with the training data's mean and scale, in numbers of the exported
 * type; of detectors that take off the window's own mean with an offset. */
void detector_draw_window(const export_source *source, const exported_detector *model, lg_rng *rng,
                          double *x);

/* Whether value or gradient have kinks: of ReLU or of maxima. */
bool detector_has_kinks(const lg_cnn *net);

/* By how much the network multiplies rounding, >= 1: the tolerance of the self-test contains it. The larger
 * of two changes of results, measured over windows like the golden ones, in roundings and relative to the
 * root mean square of the results: that of value and gradient when weights and windows move by a rounding
 * each, and that between single and double precision of the library; times 4 for safety, divided by
 * the 20 DEPTH that every tolerance contains. Needs golden vectors. Errors: those of lg_detector_program
 * and lg_plan_create. */
enum { DETECTOR_WINDOWS = 48 };
lg_status detector_condition(const export_source *source, const exported_detector *model, double *out);

#endif
