/* An integration with equal or adaptive steps, which Ctrl-C can end. */
#include "lg-simulate/simulate.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <time.h>

/* A time counts as the end of a step if it is closer to it than SAME_TIME steps, plus rounding. */
#define SAME_TIME 1e-9

static double cpu_seconds(void) {
    struct timespec now;
    if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) != 0) return 0;
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void plan_init(const simulation *sim, const lg_scheme *scheme, plan *out) {
    const simulate_values *values = sim->values;
    *out = (plan){.scheme = scheme, .steps = (size_t)values->steps, .max_steps = (size_t)values->max_steps};
    out->t_end = sim->t_end;
    plan_tolerance(sim, values->tol, out);
}

void plan_tolerance(const simulation *sim, double tol, plan *out) {
    out->rtol = tol;
    out->atol = sim->values->atol >= 0 ? sim->values->atol : -fmax(1e-4 * tol, 1e-16);
}

typedef struct runner {
    const plan *how;
    lg_stepper *stepper;
    size_t dim;
    outcome *out;
} runner;

/* ---- equal steps ---- */

/* Stores the wanted states in the step just made from t to t + h: y at the end of the step, dense output
 * inside it. */
static lg_status keep_rows(const runner *run, double t, double h, const double *y, size_t *row,
                           double *rows) {
    const plan *how = run->how;
    const double near = SAME_TIME * h + 4 * DBL_EPSILON * (t + h);
    for (; *row < how->count && how->times[*row] <= t + h + near; (*row)++) {
        double *to = rows + *row * run->dim;
        if (how->times[*row] >= t + h - near) {
            memcpy(to, y, run->dim * sizeof *to);
            continue;
        }
        const lg_status status = lg_stepper_dense(run->stepper, (how->times[*row] - t) / h, to);
        if (status != LG_OK) return status;
    }
    return LG_OK;
}

static lg_status run_fixed(runner *run, const double *y0, double *rows) {
    const plan *how = run->how;
    const double h = how->t_end / (double)how->steps;
    APP_FREE double *y = app_alloc(run->dim, sizeof *y);
    size_t row = 0;
    lg_status status = LG_OK;
    memcpy(y, y0, run->dim * sizeof *y);
    for (size_t n = 0; n < how->steps && status == LG_OK; n++) {
        const double t = (double)n * h;
        status = app_interrupted() ? LG_CANCELLED : lg_stepper_step(run->stepper, t, h, y, NULL, y);
        if (status == LG_OK) status = keep_rows(run, t, h, y, &row, rows);
        if (status != LG_OK) break;
        run->out->stats.steps++;
        run->out->t = n + 1 < how->steps ? (double)(n + 1) * h : how->t_end;
        run->out->stats.max_angle = fmax(run->out->stats.max_angle, lg_stepper_angle(run->stepper));
        if (how->observe != NULL) status = how->observe(how->observer, t, h, y);
    }
    /* The last row is the end of the last step, even if its time differs by rounding. */
    if (status == LG_OK) memcpy(rows + (how->count - 1) * run->dim, y, run->dim * sizeof *y);
    run->out->stats.evaluations = lg_stepper_evaluations(run->stepper);
    return status;
}

/* ---- adaptive steps ---- */

static lg_status observe_step(void *user, double t, double h, const double *y) {
    runner *run = user;
    run->out->t = t + h;
    if (app_interrupted()) return LG_CANCELLED;
    return run->how->observe != NULL ? run->how->observe(run->how->observer, t, h, y) : LG_OK;
}

static lg_status run_adaptive(runner *run, const double *y0, double *rows) {
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = run->how->rtol;
    control.atol = run->how->atol;
    control.max_steps = run->how->max_steps;
    control.dense = true;
    control.observe = observe_step;
    control.observer = run;
    return lg_integrate_adaptive(run->stepper, &control, 0, y0, run->how->times, run->how->count, rows,
                                 &run->out->stats);
}

/* ---- all runs ---- */

lg_status integrate(const simulation *sim, const plan *how, const double *y0, double *rows, outcome *out,
                    lg_error *error) {
    lg_stepper *stepper = NULL;
    *out = (outcome){.t = 0};
    for (size_t i = 0; i < how->count * sim->dim; i++) rows[i] = (double)NAN;
    const lg_ode *ode = &sim->ode[lg_system_coordinates_for(how->scheme)];
    lg_status status = lg_scheme_check(how->scheme, error);
    if (status == LG_OK) status = lg_stepper_create(sim->self->context, how->scheme, ode, &stepper);
    if (status != LG_OK) return status;
    runner run = {how, stepper, sim->dim, out};
    const double begin = app_seconds(), begin_cpu = cpu_seconds();
    status = how->steps > 0 ? run_fixed(&run, y0, rows) : run_adaptive(&run, y0, rows);
    out->seconds = app_seconds() - begin;
    out->cpu = cpu_seconds() - begin_cpu;
    lg_stepper_destroy(stepper);
    return status;
}
