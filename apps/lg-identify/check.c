/* lg-identify check: reports what is in the logs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-identify/identify.h"
#include "liegrad/minimise.h"

/* ---- excitation ---- */

enum { MOST_SEEN = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 1 };

/* Returns the standard deviation of the part of an input that no linear function of positions, velocities (if
 * `velocities`) and other inputs explains, relative to the input's standard deviation. NaN: the input is
 * constant, or the rows do not determine the part. */
static double own_part(const lg_machine *machine, const lg_machine_log *log, bool velocities,
                       uint32_t input) {
    APP_FREE double *matrix = app_alloc(MOST_SEEN * MOST_SEEN, sizeof *matrix);
    double right[MOST_SEEN] = {0}, x[MOST_SEEN], given[MOST_SEEN];
    double mean = 0, square = 0;
    const size_t nq = machine->positions, nv = velocities ? machine->velocities : 0, m = machine->input_count;
    const size_t n = nq + nv + m; /* the other inputs, and 1 */
    size_t count = 0;
    for (size_t row = 0; row < log->rows; row++) {
        bool finite = true;
        const double u = log->u[row * 4 * m + input];
        memcpy(x, log->q + row * nq, nq * sizeof *x);
        if (nv > 0) memcpy(x + nq, log->v + row * nv, nv * sizeof *x);
        for (size_t k = 0, to = nq + nv; k < m; k++)
            if (k != input) x[to++] = log->u[row * 4 * m + k];
        x[n - 1] = 1;
        for (size_t i = 0; i < n; i++) finite = finite && isfinite(x[i]);
        if (!finite) continue;
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < n; j++) matrix[i * n + j] += x[i] * x[j];
            right[i] += x[i] * u;
        }
        mean += u, square += u * u, count++;
    }
    const double variance = square - mean * mean / (double)count;
    memcpy(given, right, sizeof given);
    double explained = 0;
    const bool solved = count > 2 * n && variance > 1e-12 * square &&
                        lg_normal_equations(n, 1, 1e-12, matrix, right) == LG_OK;
    for (size_t i = 0; i < n; i++) explained += given[i] * right[i];
    return solved ? sqrt(fmax(0, (square - explained) / variance)) : NAN;
}

/* Warns of positions that belong to velocities of other rows, of columns that stand still, of many gaps,
 * which suggest that the times of the rows jitter, and of inputs that are functions of the rest. */
static void warn(const app *self, const lg_machine_data *data) {
    enum { OFTEN = 50 };
    static const double least = 1e-3;
    const lg_machine_file *file = &data->file;
    const lg_machine *machine = &file->machine;
    const lg_logs *logs = &data->logs;
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (logs->lag[i] != 0)
            app_warn(self,
                     "%s: its positions are %d rows (%.3g s) %s than its velocities: with that shift the "
                     "velocities explain all but %.2g of the motion, as logged all but %.2g; if the sensors "
                     "have two clocks, or one has a delay, shift the columns before you learn from them",
                     machine->coordinates[i].name, abs(logs->lag[i]), fabs(logs->lag[i] * logs->dt_median),
                     logs->lag[i] < 0 ? "later" : "earlier", logs->left[i], logs->motion[i]);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_standstill at = logs->stuck[i];
        if (at.rows > 0)
            app_warn(self,
                     "column %s: stands at %.6g for %zu rows from %.6g s on while %s moves: if the sensor is "
                     "stuck, leave these rows empty",
                     file->columns[file->coordinates[i].place].name, at.value, at.rows, logs->log.t[at.row],
                     file->columns[file->coordinates[i].velocity].name);
    }
    if (OFTEN * logs->gaps > logs->rows_read)
        app_warn(self,
                 "%zu of %zu steps are longer than %.4g s and count as gaps, which leave %zu parts: if the "
                 "times of the rows jitter, set columns: {max_step: ...} to the longest step that is not a "
                 "gap (the median is %.4g s)",
                 logs->gaps, logs->rows_read, logs->max_step, logs->log.parts, logs->dt_median);
    for (uint32_t k = 0; k < machine->input_count; k++) {
        const double part = own_part(machine, &logs->log, file->measured == LG_MEASURED_VELOCITIES, k);
        if (part < least)
            app_warn(
                self,
                "column %s: the input is a linear function of the state and the other inputs (all but %.1g "
                "of it): feedback, or a copy; its effect cannot be told apart from damping and potential",
                machine->inputs[k], part);
    }
}

/* ---- report ---- */

/* One number if all inputs have the same delay, else one for each. */
static void put_delays(app_json *out, const lg_machine *machine, const lg_logs *logs) {
    static const char label[] = "rows from an input to what it does";
    double each[LG_MACHINE_INPUTS];
    bool same = true;
    for (uint32_t i = 0; i < machine->input_count; i++) {
        each[i] = logs->delay[i];
        same = same && logs->delay[i] == logs->delay[0];
    }
    if (same)
        app_json_put(out, LG_WHOLE("delay", logs->delay[0], label));
    else
        app_json_put(out, LG_REALS("delay", each, machine->input_count, label));
}

static void report(const app *self, const lg_machine_data *data) {
    const lg_logs *logs = &data->logs;
    app_json *out = self->out;
    APP_PUT(out, LG_WHOLE("files", logs->files, NULL), LG_WHOLE("runs", logs->runs, NULL),
            LG_WHOLE("rows", logs->rows_read, NULL), LG_WHOLE("rows_kept", logs->log.rows, NULL),
            LG_WHOLE("parts", logs->log.parts, "without a gap"),
            LG_REAL("dt_median", logs->dt_median, "s from a row to the next"),
            LG_REAL("dt_max", logs->dt_max, "s at most"),
            LG_REAL("max_step", logs->max_step, "s; longer steps are gaps"),
            LG_WHOLE("gaps", logs->gaps, NULL));
    put_delays(out, &data->file.machine, logs);
    app_result_named(out, "columns", "column");
    for (uint32_t c = 0; c < data->file.column_count; c++) {
        const lg_log_statistics *s = &logs->columns[c];
        const lg_log_column *column = &data->file.columns[c];
        if (!identify_is_state(column) && column->role != LG_LOG_INPUT) continue;
        APP_OBJECT(out, column->name, LG_AS_REAL("min", s->low), LG_AS_REAL("max", s->high),
                   LG_AS_REAL("noise", s->noise), LG_AS_FLAG("noise_at_most", s->noise_at_most),
                   LG_AS_WHOLE("missing", s->missing), LG_AS_WHOLE("outliers", s->outliers));
    }
    app_result_rows_end(out);
    app_json_open(out, "kinematics", '{');
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        app_result_real(out, data->file.machine.coordinates[i].name, logs->motion[i],
                        "of its motion, which its velocity does not explain");
    app_json_close(out, '}');
}

/* ---- the command ---- */

static void run(app *self) {
    APP_CLEAN(lg_machine_data_destroy) lg_machine_data data = {.failed = NULL};
    const lg_machine_sources from = {.machine = self->arguments[0],
                                     .logs = self->arguments + 1,
                                     .count = (size_t)self->argument_count - 1,
                                     .delay = -1,
                                     .clocks = true};
    identify_read(self, &from, &data);
    warn(self, &data);
    lg_machine_warn_of_gauge(self->context, &data.file.machine);
    app_plot_draw(self, 0,
                  &(identify_plot){"First run of the log", &data.file, &data.logs.log,
                                   identify_first_run(&data.logs), .runs = NULL});
    report(self, &data);
}

const app_command identify_check_command = {
    .name = "check",
    .arguments = "MACHINE.yaml LOG...",
    .summary = "Show what is in the logs, and check that the columns are what MACHINE.yaml says",
    .details = "If the logs contradict MACHINE.yaml (swapped columns, wrong units, two clocks), the exit "
               "code is 3, and a sentence names file, column and remedy. There is a warning for each "
               "quantity that the logs do not determine.",
    APP_DRAWS("all columns of the first run", "machine", identify_put),
    .run = run};
