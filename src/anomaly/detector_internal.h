/* Shared by the files of the detector. */
#ifndef LG_DETECTOR_INTERNAL_H
#define LG_DETECTOR_INTERNAL_H

#include "liegrad/detector.h"

/* One window x (channels, length) as the network reads it: out (length, channels) of dtype. */
void lg_detector_scale(const lg_detector *model, const lg_scaler *scaler, lg_dtype dtype, const float *x,
                       void *out);

/* lg_detector_program, or its function `scores` alone: recording the others takes time and memory. */
lg_status lg_detector_build(const lg_context *context, const lg_detector *model, const lg_scaler *scaler,
                            const double *theta, bool scores_alone, lg_program **out, lg_error *error);

/* Windows `samples` (count) on a tape: (count, length, channels) of its type. */
lg_var lg_detector_put_windows(const lg_detector_problem *problem, lg_tape *tape, const uint32_t *samples,
                               uint32_t count);
/* Windows on a tape at once, for speed. */
size_t lg_detector_chunk(const lg_detector_problem *problem);
/* lg_fit_problem.revive: user is the lg_detector_problem. */
lg_status lg_detector_revive(void *user, uint64_t number, double *theta, bool *dead);

#endif
