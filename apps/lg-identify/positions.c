/* Errors over horizons of logs with positions alone: the state at a start comes from the rows before it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-identify/runs.h"

typedef struct positions_runner {
    const app *app;
    const identify_model *model;
    const lg_machine_log *log;
} positions_runner;

static lg_status run_from_positions(void *user, const lg_machine_log *log, const size_t *start, size_t count,
                                    size_t steps, double *q, double *v, lg_error *error) {
    const positions_runner *r = user;
    const identify_model *model = r->model;
    const size_t nq = model->machine->positions, nv = model->machine->velocities;
    lg_machine_log copy = *log;
    size_t *from = app_alloc(count, sizeof *from);
    double *own_q = app_alloc(log->rows * nq, sizeof *own_q),
           *own_v = app_alloc(log->rows * nv, sizeof *own_v),
           *first = app_alloc(2 * count * (nq + nv), sizeof *first);
    double *first_v = first + count * nq, *last_q = first_v + count * nv, *last_v = last_q + count * nq;
    for (size_t i = 0; i < count; i++) from[i] = start[i] - (IDENTIFY_START_ROWS - 1);
    lg_status status =
        identify_estimate_starts(r->app, model, r->log, from, count, first, first_v, last_q, last_v, error);
    for (size_t i = 0; i < count; i++) {
        memcpy(own_q + start[i] * nq, last_q + i * nq, nq * sizeof *own_q);
        memcpy(own_v + start[i] * nv, last_v + i * nv, nv * sizeof *own_v);
    }
    copy.q = own_q, copy.v = own_v;
    if (status == LG_OK)
        status = lg_machine_free_run(r->app->context, model->machine, model->theta, model->scheme,
                                     model->substeps, &copy, start, count, steps, q, v, error);
    free(from);
    free(own_q);
    free(own_v);
    free(first);
    return status;
}

/* Velocities are there, as 0, where a run can start. */
static double *mark_starts(const lg_machine *machine, const lg_machine_log *log, size_t every) {
    const size_t nq = machine->positions, nv = machine->velocities;
    double *v = app_alloc(log->rows * nv, sizeof *v);
    for (size_t i = 0; i < log->rows * nv; i++) v[i] = (double)NAN;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row < log->first[p + 1]; row += every) {
            bool complete = row >= log->first[p] + IDENTIFY_START_ROWS - 1;
            for (size_t k = 0; complete && k < nq; k++)
                complete = !isnan(log->q[(row - IDENTIFY_START_ROWS + 1) * nq + k]);
            for (size_t k = 0; complete && k < nv; k++) v[row * nv + k] = 0;
        }
    return v;
}

static void forget_velocity(identify_horizon *h) {
    h->pooled[ERROR_VELOCITY] = h->median[ERROR_VELOCITY] = h->unchanged[ERROR_VELOCITY] = (double)NAN;
}

lg_status identify_position_horizon_errors(const app *self, const identify_model *model,
                                           const lg_machine_log *log, double seconds, size_t every,
                                           identify_horizon *out, lg_error *error) {
    positions_runner runner = {self, model, log};
    lg_machine_log marked = *log;
    double *v = mark_starts(model->machine, log, every);
    marked.v = v;
    const lg_status status = identify_horizon_errors_of(model->machine, run_from_positions, &runner, &marked,
                                                        seconds, every, out, error);
    forget_velocity(out);
    free(v);
    return status;
}
