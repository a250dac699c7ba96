/* Predicts all parts of a log by free runs of the model. If only positions or accelerations were measured,
 * the states at the starts of the runs are estimated first. */
#include <math.h>

#include "lg-identify/identify.h"

void identify_log_begin(identify_log *made, const lg_machine *machine, size_t parts, size_t rows) {
    *made = (identify_log){.first = app_keep(parts + 1, sizeof *made->first),
                           .t = app_keep(rows, sizeof *made->t),
                           .q = app_keep(rows * machine->positions, sizeof *made->q),
                           .v = app_keep(rows * machine->velocities, sizeof *made->v),
                           .u = app_keep(rows * 4 * machine->input_count + 1, sizeof *made->u)};
    made->log = (lg_machine_log){.rows = rows,
                                 .parts = parts,
                                 .first = made->first,
                                 .t = made->t,
                                 .q = made->q,
                                 .v = made->v,
                                 .u = made->u};
}

size_t identify_first_run(const lg_logs *logs) {
    size_t parts = 1;
    while (parts < logs->log.parts && logs->part_run[parts] == logs->part_run[0]) parts++;
    return parts;
}

void identify_run(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                  const size_t *start, size_t count, size_t steps, double *q, double *v) {
    APP_MUST(self, lg_machine_free_run(self->context, model->machine, model->theta, model->scheme,
                                       model->substeps, log, start, count, steps, q, v, &error));
}

identify_runs identify_runs_begin(const lg_learned_machine *model, const lg_machine_log *log, size_t from) {
    identify_runs out = {.start = app_keep(log->parts, sizeof *out.start),
                         .q = app_keep(log->rows * model->machine->positions, sizeof *out.q),
                         .v = app_keep(log->rows * model->machine->velocities, sizeof *out.v)};
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p] + from; row + 1 < log->first[p + 1]; row++) {
            if (!lg_machine_log_complete(model->machine, log, row, model->start_rows > 0)) continue;
            out.start[out.count++] = row;
            break;
        }
    return out;
}

void identify_run_log(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                      identify_runs *runs) {
    APP_CLEAN(lg_started_log_destroy) lg_started_log from = {.log = *log};
    if (model->start_rows > 0)
        APP_MUST(self, lg_started_log_create(model, log, runs->start, runs->count, &from, &error));
    identify_run(self, model, &from.log, runs->start, runs->count, LG_MACHINE_TO_END, runs->q, runs->v);
}

void identify_leave_out(const lg_learned_machine *model, const lg_machine_log *log, identify_runs *runs) {
    const size_t nq = model->machine->positions, nv = model->machine->velocities;
    for (size_t i = 0; i < runs->count; i++)
        for (size_t row = runs->start[i]; row < runs->start[i] + model->start_rows && row < log->rows;
             row++) {
            for (size_t k = 0; k < nq; k++) runs->q[row * nq + k] = (double)NAN;
            for (size_t k = 0; k < nv; k++) runs->v[row * nv + k] = (double)NAN;
        }
}
