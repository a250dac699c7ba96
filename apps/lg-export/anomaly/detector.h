/* Export of a detector: declarations that the files of this folder share. */
#ifndef LG_EXPORT_DETECTOR_H
#define LG_EXPORT_DETECTOR_H

#include "lg-export/faces.h"

/* Sets the condition: the factor >= 1 by which the network multiplies rounding errors; the tolerance of the
 * self-test contains it. It is measured over DETECTOR_WINDOWS windows like the golden ones. Two changes of
 * value and gradient are measured, in units of one rounding error and relative to the root mean square of the
 * results: the change when all weights and samples move by one rounding error each, and the change between
 * single and double precision of the library. The condition is the larger change, times 4 for safety, divided
 * by the 20 DEPTH that every tolerance contains. */
enum { DETECTOR_WINDOWS = 48 };
lg_status detector_condition(export_model *m, lg_error *error);

/* Draws a window (channels, length) of noise with the mean and scale of the training data, rounded to the
 * exported type. For detectors that subtract the window's own mean, each channel also gets a random
 * offset. */
void detector_draw_window(const export_model *m, lg_rng *rng, double *x);
/* Returns whether the value or the gradient has kinks, caused by ReLU or maxima. */
bool detector_has_kinks(const lg_cnn *net);

#endif
