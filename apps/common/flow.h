/* The flow of a model that moves. */
#ifndef LG_APPS_FLOW_H
#define LG_APPS_FLOW_H

#include "liegrad/model.h"

/* From `start` at times[0] to all times (count), by an adaptive scheme with this tolerance, relative to each
 * number and to its group: out (count, d). most: of steps, 0: the default; stats may be NULL. Errors: those
 * of lg_integrate_adaptive. */
lg_status app_flow(const lg_context *context, const lg_model *learned, const lg_scheme *scheme,
                   double tolerance, size_t most, const double *start, const double *times, size_t count,
                   double *out, lg_run_stats *stats);

#endif
