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

enum { BEFORE = IDENTIFY_START_ROWS - 1 }; /* rows before a start */

/* Of runs over `before` and `steps` intervals the last steps + 1 points. */
static void keep_ends(const double *runs, size_t count, size_t before, size_t steps, size_t n, double *out) {
    for (size_t i = 0; i < count; i++)
        memcpy(out + i * (steps + 1) * n, runs + (i * (before + steps + 1) + before) * n,
               (steps + 1) * n * sizeof *out);
}

static lg_status run_from_positions(void *user, const lg_machine_log *log, const size_t *start, size_t count,
                                    size_t steps, double *q, double *v, lg_error *error) {
    const positions_runner *r = user;
    const identify_model *model = r->model;
    const size_t nq = model->machine->positions, nv = model->machine->velocities,
                 points = count * (BEFORE + steps + 1);
    identify_started begun;
    size_t *from = app_alloc(count, sizeof *from);
    double *all_q = app_alloc(points * nq, sizeof *all_q), *all_v = app_alloc(points * nv, sizeof *all_v);
    (void)log;
    for (size_t i = 0; i < count; i++) from[i] = start[i] - BEFORE;
    lg_status status = identify_with_starts(r->app, model, r->log, from, count, &begun, error);
    if (status == LG_OK)
        status =
            lg_machine_free_run(r->app->context, model->machine, model->theta, model->scheme, model->substeps,
                                &begun.log, from, count, BEFORE + steps, all_q, all_v, error);
    keep_ends(all_q, count, BEFORE, steps, nq, q);
    keep_ends(all_v, count, BEFORE, steps, nv, v);
    identify_started_release(&begun);
    free(from);
    free(all_q);
    free(all_v);
    return status;
}

/* Velocities are there, as 0, where a run can start. */
static double *mark_starts(const lg_machine *machine, const lg_machine_log *log, size_t every) {
    const size_t nv = machine->velocities;
    double *v = app_alloc(log->rows * nv, sizeof *v);
    for (size_t i = 0; i < log->rows * nv; i++) v[i] = (double)NAN;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row < log->first[p + 1]; row += every) {
            const bool starts =
                row >= log->first[p] + BEFORE && lg_machine_log_complete(machine, log, row - BEFORE, true);
            for (size_t k = 0; starts && k < nv; k++) v[row * nv + k] = 0;
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
