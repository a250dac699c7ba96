/* Export of a detector: declarations that its files share. */
#ifndef LG_EXPORT_DETECTOR_H
#define LG_EXPORT_DETECTOR_H

#include "lg-export/faces.h"

/* The condition: the factor by which the network multiplies rounding, >= 1; the
 * tolerance of the self-test contains it. It is measured over windows like the golden ones, in roundings and
 * relative to the root mean square of the results, as the larger of two changes: that of value and gradient
 * when weights and windows move by one rounding each, and that between single and double precision of the
 * library. It is multiplied by 4 for safety and divided by the 20 DEPTH that every tolerance contains. */
enum { DETECTOR_WINDOWS = 48 };
lg_status detector_condition(export_model *m, lg_error *error);

/* A window (channels, length) of noise with mean and scale of the training data, rounded to the exported
 * type. For detectors that subtract the window's own mean it has an offset. */
void detector_draw_window(const export_model *m, lg_rng *rng, double *x);
/* Whether value or gradient have kinks, from ReLU or maxima. */
bool detector_has_kinks(const lg_cnn *net);

#endif
