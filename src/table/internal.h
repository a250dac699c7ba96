/* Declarations that the files of src/table share. */
#ifndef LG_MODELS_TABLE_INTERNAL_H
#define LG_MODELS_TABLE_INTERNAL_H

#include "liegrad/table.h"
#include "nn/net.h"

/* f (B, outputs) of scaled inputs z (B, inputs). taps: NULL, or gets the inputs and outputs of the dense
 * layers. */
lg_var lg_table_record(lg_tape *tape, const lg_table *model, lg_var theta, lg_var z, lg_net_tap *taps);

/* Residuals r (count, outputs) = factor (f - t) of the samples at theta, and their Jacobian (count outputs,
 * parameters) in reverse mode: a dense layer y = x W + b gives dr/dW = x (outer) dr/dy. */
lg_status lg_table_linearise(const lg_table_problem *problem, lg_tape *tape, const double *theta,
                             const uint32_t *samples, size_t count, double factor, double *r,
                             double *jacobian);

#endif
