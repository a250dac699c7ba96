/* Reads a model and the logs that a command runs it on, and predicts all parts of a log by free runs. If only
 * positions or accelerations were measured, the states at the starts of the runs are estimated first. */
#include <math.h>

#include "lg-identify/identify.h"

/* ---- models and logs ---- */

void identify_read(const app *self, const lg_machine_sources *from, lg_machine_data *out) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_machine_data_read(self->context, from, out, &error);
    app_must_file(self, status, &error, out->failed);
}

void identify_load(app *self, uint64_t substeps, uint64_t start_rows, identify_given *out) {
    const char *path = self->arguments[0];
    const lg_machine_model_run *run = &out->file.run;
    APP_FILE(self, path, lg_recipe_load, NULL, &lg_recipe_machine_model, &out->file);
    const lg_machine_sources from = {.machine = path,
                                     .text = run->text,
                                     .logs = self->arguments + 1,
                                     .count = (size_t)self->argument_count - 1,
                                     .delay = run->estimated};
    identify_read(self, &from, &out->data);
    out->log = &out->data.logs.log;
    APP_MUST(self, lg_machine_refuse_momenta(&out->data.file, path, &error));
    const bool estimated =
        out->data.file.measured == LG_MEASURED_POSITIONS || out->data.file.machine.accelerations;
    if (start_rows > 0 && !estimated)
        app_stop(self, LG_INVALID_ARGUMENT,
                 "--start-rows %llu: no start is estimated, because the logs have positions and velocities: "
                 "leave the option out",
                 (unsigned long long)start_rows);
    if (start_rows > 0) out->file.run.start_rows = (uint32_t)start_rows;
    out->model = lg_model_learned(self->context, run, out->file.theta, estimated);
    if (substeps > 0) out->model.substeps = (uint32_t)substeps;
}

void identify_put_start_rows(app_json *json, const lg_learned_machine *model) {
    app_result_known(json, "start_rows", model->start_rows > 0 ? model->start_rows : NAN,
                     "rows that estimate the state at a start");
}

void identify_given_destroy(identify_given *given) {
    lg_machine_data_destroy(&given->data);
    lg_recipe_release(&lg_recipe_machine_model, &given->file);
}

/* ---- runs ---- */

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
    APP_DO(self, lg_machine_free_run, model->machine, model->theta, model->scheme, model->substeps, log,
           start, count, steps, q, v);
}

identify_runs identify_runs_begin(const lg_learned_machine *model, const lg_machine_log *log, size_t from) {
    identify_runs out = {.start = app_keep(log->parts, sizeof *out.start),
                         .q = app_keep(log->rows * model->machine->positions, sizeof *out.q),
                         .v = app_keep(log->rows * model->machine->velocities, sizeof *out.v)};
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first + from; row + 1 < p.end; row++) {
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
            for (size_t k = 0; k < nq; k++) runs->q[row * nq + k] = NAN;
            for (size_t k = 0; k < nv; k++) runs->v[row * nv + k] = NAN;
        }
}
