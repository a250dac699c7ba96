/* An integration with equal or adaptive steps, which Ctrl-C can end. */
#include "lg-simulate/simulate.h"

#include <math.h>
#include <time.h>

static double cpu_seconds(void) {
    struct timespec now;
    if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) != 0) return 0;
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void plan_init(const simulation *sim, const lg_scheme *scheme, plan *out) {
    const simulate_values *values = sim->values;
    *out = (plan){.scheme = scheme, .t_end = sim->t_end};
    lg_step_controller_init(&out->control);
    out->control.steps = (size_t)values->steps;
    out->control.max_steps = (size_t)values->max_steps;
    out->control.dense = true;
    plan_tolerance(sim, values->tolerance, out);
}

void plan_tolerance(const simulation *sim, double tol, plan *out) {
    out->control.rtol = tol;
    out->control.atol = sim->values->atol >= 0 ? sim->values->atol : -fmax(1e-4 * tol, 1e-16);
}

typedef struct runner {
    const plan *how;
    outcome *out;
} runner;

static lg_status observe_step(void *user, double t, double h, const double *y) {
    const runner *run = user;
    const lg_step_controller *own = &run->how->control;
    run->out->t = t + h;
    if (app_interrupted()) return LG_CANCELLED;
    return own->observe != NULL ? own->observe(own->observer, t, h, y) : LG_OK;
}

lg_status integrate(const simulation *sim, const plan *how, const double *y0, double *rows, outcome *out,
                    lg_error *error) {
    lg_stepper *stepper = NULL;
    *out = (outcome){.t = 0};
    for (size_t i = 0; i < how->count * sim->dim; i++) rows[i] = (double)NAN;
    const lg_ode *ode = &sim->ode[lg_system_coordinates_for(how->scheme)];
    lg_status status = lg_scheme_check(how->scheme, error);
    if (status == LG_OK) status = lg_stepper_create(sim->self->context, how->scheme, ode, &stepper);
    if (status != LG_OK) return status;
    runner run = {how, out};
    lg_step_controller control = how->control;
    control.observe = observe_step;
    control.observer = &run;
    const double begin = app_seconds(), begin_cpu = cpu_seconds();
    status = lg_integrate_adaptive(stepper, &control, 0, y0, how->times, how->count, rows, &out->stats);
    out->seconds = app_seconds() - begin;
    out->cpu = cpu_seconds() - begin_cpu;
    lg_stepper_destroy(stepper);
    return status;
}
