/* Integrates the field of a learned model over time. */
#include "common/flow.h"

#include <stdlib.h>

#include "common/app.h"

lg_status app_flow(const lg_context *context, const lg_model *learned, const lg_scheme *scheme,
                   double tolerance, size_t most, const double *start, const double *times, size_t count,
                   double *out, lg_run_stats *stats) {
    APP_FREE void *work = app_alloc(lg_model_work_size(learned), 1);
    lg_model_user user;
    lg_ode ode;
    lg_step_controller control;
    lg_stepper *stepper = NULL;
    lg_step_controller_init(&control);
    control.rtol = tolerance;
    control.atol = -tolerance;
    if (most > 0) control.max_steps = most;
    LG_TRY(lg_model_ode(learned, &ode, &user, work));
    LG_TRY(lg_stepper_create(context, scheme, &ode, &stepper));
    const lg_status status =
        lg_integrate_adaptive(stepper, &control, times[0], start, times, count, out, stats);
    lg_stepper_destroy(stepper);
    return status;
}
