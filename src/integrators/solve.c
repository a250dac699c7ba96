/* A differential equation solved in one call. */
#include <math.h>

#include "core/core.h"
#include "liegrad/integrators.h"

/* Keeps the time that the solution has reached, for the message of an error. */
static lg_status keep_time(void *reached, double t, double h, const double *y) {
    *(double *)reached = t + h;
    return LG_OK;
}

static lg_status integrate(lg_stepper *stepper, double tolerance, const double *times, size_t count,
                           const double *y0, double *out, lg_error *error) {
    double reached = times[0];
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = tolerance;
    control.atol = -tolerance;
    control.observe = keep_time;
    control.observer = &reached;
    const lg_status status = lg_integrate_adaptive(stepper, &control, times[0], y0, times, count, out, NULL);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status,
                   status == LG_INVALID_ARGUMENT
                       ? "%s (t = %g): expected a finite start, and times that only rise or only fall"
                       : "%s, at t = %g",
                   lg_status_sentence(status), reached);
}

lg_status lg_ode_solve(const lg_context *context, const char *space, lg_vector_field field, void *user,
                       double tolerance, const double *times, size_t count, const double *y0, double *out,
                       lg_error *error) {
    lg_ode ode = {.field = field, .user = user};
    lg_stepper *stepper;
    LG_NEEDS(error, space, field, times, y0, out);
    if (!(tolerance > 0.0) || !isfinite(tolerance) || count < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "tolerance %g, %zu times: expected a tolerance > 0 and times", tolerance, count);
    LG_TRY(lg_space_read(space, &ode.space, error));
    const lg_status status = lg_stepper_create(context, lg_scheme_find("rkmk54"), &ode, &stepper);
    if (status != LG_OK) return lg_fail(error, status, "no memory for a solution on %s", space);
    const lg_status solved = integrate(stepper, tolerance, times, count, y0, out, error);
    lg_stepper_destroy(stepper);
    return solved;
}
