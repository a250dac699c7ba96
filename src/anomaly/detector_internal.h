/* Functions shared by the source files of the detector. */
#ifndef LG_DETECTOR_INTERNAL_H
#define LG_DETECTOR_INTERNAL_H

#include "liegrad/anomaly.h"

/* Scales one window x (channels, length) and orders it as the network reads it: out (length, channels),
 * numbers of type dtype. */
void lg_detector_scale(const lg_detector *model, const lg_scaler *scaler, lg_dtype dtype, const float *x,
                       void *out);

/* Builds the program of lg_detector_program. With scores_alone the program has only the function `scores`,
 * because recording the other functions takes time and memory. */
lg_status lg_detector_build(const lg_context *context, const lg_detector *model, const lg_scaler *scaler,
                            const double *theta, bool scores_alone, lg_program **out, lg_error *error);

/* Puts the windows with the indices `samples` (count) on the tape: (count, length, channels) in the tape's
 * type. */
lg_var lg_detector_put_windows(const lg_detector_problem *problem, lg_tape *tape, const uint32_t *samples,
                               uint32_t count);
/* Number of windows to record on a tape at once, chosen for speed. */
size_t lg_detector_chunk(const lg_detector_problem *problem);
/* Implements lg_fit_problem.revive; `user` is the lg_detector_problem. */
lg_status lg_detector_revive(void *user, uint64_t number, double *theta, bool *dead);

#endif
