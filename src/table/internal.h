/* What the files of table networks share. */
#ifndef LG_MODELS_TABLE_INTERNAL_H
#define LG_MODELS_TABLE_INTERNAL_H

#include "liegrad/ops.h"
#include "liegrad/table.h"
#include "nn/net.h"

/* f of scaled inputs z (B, inputs): (B, outputs). taps: NULL, or what the dense layers read and give. */
lg_var lg_table_record(lg_tape *tape, const lg_table *model, lg_var theta, lg_var z, lg_net_tap *taps);

/* Residuals r (count, outputs) = factor (f - t) of the samples at theta and their Jacobian J (count outputs,
 * parameters), in reverse mode: a dense layer z = x W + b gives dr/dW = x (outer) dr/dz. */
lg_status lg_table_linearise(const lg_table_problem *problem, lg_tape *tape, const double *theta,
                             const uint32_t *samples, size_t count, double factor, double *r,
                             double *jacobian);

#endif
