/* Shared by the files of the detector. */
#ifndef LG_DETECTOR_INTERNAL_H
#define LG_DETECTOR_INTERNAL_H

#include "liegrad/detector.h"

/* One window x (channels, length) as the network reads it: out (length, channels) of dtype. */
void lg_detector_scale(const lg_detector *model, const lg_scaler *scaler, lg_dtype dtype, const float *x,
                       void *out);

#endif
