/* Export of a detector: declarations that its files share. */
#ifndef LG_EXPORT_DETECTOR_H
#define LG_EXPORT_DETECTOR_H

#include "lg-export/window.h"
#include "liegrad/random.h"

/* A detector with its scaler and weights. Borrowed. */
typedef struct exported_detector {
    lg_detector detector;
    lg_scaler scaler;
    const double *theta;
    const lg_model *learned;
} exported_detector;

/* A window (channels, length) of noise with mean and scale of the training data, rounded to the exported
 * type. For detectors that subtract the window's own mean it has an offset. */
void detector_draw_window(const export_source *source, const exported_detector *model, lg_rng *rng,
                          double *x);

/* Whether value or gradient have kinks, from ReLU or maxima. */
bool detector_has_kinks(const lg_cnn *net);

/* The factor by which the network multiplies rounding, >= 1; the tolerance of the self-test contains it. It
 * is measured over windows like the golden ones, in roundings and relative to the root mean square of the
 * results, as the larger of two changes: that of value and gradient when weights and windows move by one
 * rounding each, and that between single and double precision of the library. It is multiplied by 4 for
 * safety and divided by the 20 DEPTH that every tolerance contains. Needs golden vectors. Errors: those of
 * lg_detector_program and lg_plan_create. */
enum { DETECTOR_WINDOWS = 48 };
lg_status detector_condition(const export_source *source, const exported_detector *model, double *out);

#endif
