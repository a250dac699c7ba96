/* Integrates the field of a learned model over time. */
#ifndef LG_APPS_FLOW_H
#define LG_APPS_FLOW_H

#include "liegrad/model.h"

/* Integrates from `start` at times[0] and writes the states at all `count` times to `out`, (count, d).
 * The scheme is adaptive. Its error per step is relative to the largest value so far of the component's group
 * (lg_step_controller with rtol = tolerance, atol = -tolerance). most: largest number of steps, 0 for the
 * default. stats may be NULL. Errors as of lg_integrate_adaptive. */
lg_status app_flow(const lg_context *context, const lg_model *learned, const lg_scheme *scheme,
                   double tolerance, size_t most, const double *start, const double *times, size_t count,
                   double *out, lg_run_stats *stats);

#endif
