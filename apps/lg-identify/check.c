/* lg-identify check: what is in the logs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"
#include "liegrad/minimise.h"

typedef struct check_values {
    const char *plot;
} check_values;

static const lg_field options[] = {
    LG_OPTION(check_values, plot, STRING, "FILE.svg|.png", "Draw all columns of the first run"),
    LG_FIELD_END};

static check_values values;

/* ---- excitation ---- */

enum { MOST_SEEN = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 1 };

/* What an input may be a linear function of: positions, velocities, other inputs, 1. */
static size_t fill_seen(const lg_machine *machine, const lg_machine_log *log, size_t row, bool velocities,
                        uint32_t input, double *x) {
    size_t n = 0;
    const size_t m = machine->input_count;
    for (size_t k = 0; k < machine->positions; k++) x[n++] = log->q[row * machine->positions + k];
    for (size_t k = 0; k < machine->velocities && velocities; k++)
        x[n++] = log->v[row * machine->velocities + k];
    for (size_t k = 0; k < m; k++)
        if (k != input) x[n++] = log->u[row * 4 * m + k];
    x[n++] = 1;
    return n;
}

/* The part of an input that state and other inputs do not give, of its standard deviation; NaN: it is
 * constant. */
static double own_part(const lg_machine *machine, const lg_machine_log *log, bool velocities,
                       uint32_t input) {
    double *matrix = app_alloc(MOST_SEEN * MOST_SEEN, sizeof *matrix), right[MOST_SEEN] = {0}, x[MOST_SEEN],
           given[MOST_SEEN];
    double mean = 0, square = 0;
    size_t n = 0, count = 0;
    for (size_t row = 0; row < log->rows; row++) {
        bool finite = true;
        const double u = log->u[row * 4 * machine->input_count + input];
        n = fill_seen(machine, log, row, velocities, input, x);
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
    free(matrix);
    return solved ? sqrt(fmax(0, (square - explained) / variance)) : (double)NAN;
}

static void warn_of_inputs(const app *self, const identify_data *data) {
    static const double least = 1e-3;
    const lg_machine *machine = &data->file.machine;
    for (uint32_t k = 0; k < machine->input_count; k++) {
        const double part =
            own_part(machine, &data->logs.log, data->file.measured == LG_MEASURED_VELOCITIES, k);
        if (part < least)
            app_warn(
                self,
                "column %s: the input is a linear function of the state and the other inputs (all but %.1g "
                "of it): feedback, or a copy; what it does cannot be told from damping and potential",
                machine->inputs[k], part);
    }
}

/* ---- positions against velocities ---- */

/* Positions that belong to velocities of other rows. */
static void warn_of_clocks(const app *self, const identify_data *data, const double *motions) {
    int lag[LG_MACHINE_COORDINATES];
    double left[LG_MACHINE_COORDINATES];
    identify_lags(data, lag, left);
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        if (lag[i] != 0)
            app_warn(
                self,
                "%s: its positions are %d rows (%.3g s) %s than its velocities: with that shift they explain "
                "its motion up to %.2g of it, as logged up to %.2g: two clocks, or a delay of one sensor; "
                "shift the columns before they are learned from",
                data->file.machine.coordinates[i].name, abs(lag[i]), fabs(lag[i] * data->logs.dt_median),
                lag[i] < 0 ? "later" : "earlier", left[i], motions[i]);
}

static void warn_of_stuck(const app *self, const identify_data *data) {
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++) {
        const identify_standstill at = identify_stuck(data, i);
        if (at.rows > 0)
            app_warn(self,
                     "column %s: stands at %.6g for %zu rows from %.6g s on while %s moves: a sensor that is "
                     "stuck; leave these rows empty",
                     data->file.columns[data->file.coordinates[i].place].name, at.value, at.rows,
                     data->logs.log.t[at.row], data->file.columns[data->file.coordinates[i].velocity].name);
    }
}

/* Many gaps are rows that jitter. */
static void warn_of_gaps(const app *self, const lg_logs *logs) {
    enum { OFTEN = 50 };
    if (OFTEN * logs->gaps > logs->rows_read)
        app_warn(
            self,
            "%zu of %zu steps are longer than %.4g s and count as gaps, which leave %zu parts: if the rows "
            "jitter, columns: {max_step: ...} says how long a step may be (the median is %.4g s)",
            logs->gaps, logs->rows_read, logs->max_step, logs->log.parts, logs->dt_median);
}

/* The common factor of masses, potential, damping and input map. */
static void warn_of_gauge(const app *self, const lg_machine *machine) {
    if (machine->normalised)
        app_warn(self,
                 "nothing that is given fixes the scale of the forces: the first mass is taken as 1, and "
                 "the others are ratios to it (give an input map or a mass as known to fix it)");
    if (machine->free_gauge)
        app_warn(self,
                 "nothing that is given fixes the scale of the forces: mass, potential, damping and input "
                 "map are known up to a common factor (give an input map or a mass as known to fix it)");
}

/* ---- report ---- */

static bool is_value(const lg_log_column *column) {
    return identify_is_state(column) || column->role == LG_LOG_INPUT;
}

static void report_json(const app *self, const identify_data *data, const double *motions) {
    app_json json;
    const lg_logs *logs = &data->logs;
    app_json_begin(&json);
    app_json_size(&json, "files", logs->files);
    app_json_size(&json, "runs", logs->runs);
    app_json_size(&json, "rows", logs->rows_read);
    app_json_size(&json, "rows_kept", logs->log.rows);
    app_json_size(&json, "parts", logs->log.parts);
    app_json_real(&json, "dt_median", logs->dt_median);
    app_json_real(&json, "dt_max", logs->dt_max);
    app_json_real(&json, "max_step", logs->max_step);
    app_json_size(&json, "gaps", logs->gaps);
    app_json_size(&json, "delay", logs->delay);
    app_json_open(&json, "columns", '{');
    for (uint32_t c = 0; c < data->file.column_count; c++) {
        const lg_log_statistics *s = &logs->columns[c];
        if (!is_value(&data->file.columns[c])) continue;
        app_json_open(&json, data->file.columns[c].name, '{');
        app_json_real(&json, "min", s->low);
        app_json_real(&json, "max", s->high);
        app_json_real(&json, "noise", s->noise);
        app_json_bool(&json, "noise_at_most", s->noise_at_most);
        app_json_size(&json, "missing", s->missing);
        app_json_close(&json, '}');
    }
    app_json_close(&json, '}');
    app_json_open(&json, "kinematics", '{');
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        app_json_real(&json, data->file.machine.coordinates[i].name, motions[i]);
    app_json_close(&json, '}');
    app_json_warnings(&json, self);
    app_json_end(&json);
}

static void show_columns(const identify_data *data) {
    static const char *const head[] = {"column", "smallest", "largest", "noise", "missing"};
    app_table table;
    app_table_begin(&table, LG_COUNT(head));
    for (size_t c = 0; c < LG_COUNT(head); c++) app_table_cell(&table, "%s", head[c]);
    for (uint32_t c = 0; c < data->file.column_count; c++) {
        const lg_log_statistics *s = &data->logs.columns[c];
        if (!is_value(&data->file.columns[c])) continue;
        app_table_cell(&table, "%s", data->file.columns[c].name);
        app_table_cell(&table, "%.6g", s->low);
        app_table_cell(&table, "%.6g", s->high);
        app_table_cell(&table, "%s%.2g", s->noise_at_most ? "< " : "", s->noise);
        app_table_cell(&table, "%zu", s->missing);
    }
    app_table_end(&table, stdout);
}

static void report(const identify_data *data, const double *motions) {
    const lg_logs *logs = &data->logs;
    (void)printf("%u %s, %u %s, %zu rows, of which %zu in %zu parts without a gap\n", logs->files,
                 logs->files == 1 ? "file" : "files", logs->runs, logs->runs == 1 ? "run" : "runs",
                 logs->rows_read, logs->log.rows, logs->log.parts);
    (void)printf("a row every %.4g s (median), at most %.4g s; %zu gaps, longer than %.4g s\n",
                 logs->dt_median, logs->dt_max, logs->gaps, logs->max_step);
    show_columns(data);
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        if (!isnan(motions[i]))
            (void)printf("%s: its velocity explains its motion from row to row up to %.2g of it\n",
                         data->file.machine.coordinates[i].name, motions[i]);
}

/* ---- the command ---- */

static int draw(const app *self, const identify_data *data) {
    lg_error error = {LG_OK, ""};
    const lg_logs *logs = &data->logs;
    size_t parts = 1;
    while (parts < logs->log.parts && logs->part_run[parts] == logs->part_run[0]) parts++;
    const lg_status status = identify_draw_run(self, values.plot, "First run of the log", &data->file,
                                               &logs->log, parts, NULL, NULL, NULL, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.plot);
}

static int run_check(app *self) {
    identify_data data = {.training_parts = 0};
    double motions[LG_MACHINE_COORDINATES];
    const app_path paths[] = {{"plot", values.plot, LG_FILE_DRAWN}};
    int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    code = identify_read(self, self->arguments[0], self->arguments + 1, (size_t)self->argument_count - 1,
                         NULL, &data);
    if (code == APP_EXIT_OK) {
        identify_motions(&data, 0, motions);
        warn_of_clocks(self, &data, motions);
        warn_of_stuck(self, &data);
        warn_of_gaps(self, &data.logs);
        warn_of_inputs(self, &data);
        warn_of_gauge(self, &data.file.machine);
        if (values.plot != NULL) code = draw(self, &data);
    }
    if (code == APP_EXIT_OK && self->json) report_json(self, &data, motions);
    if (code == APP_EXIT_OK && !self->json) report(&data, motions);
    identify_release(&data);
    return code;
}

const app_command check_command = {
    .name = "check",
    .arguments = "MACHINE.yaml LOG...",
    .summary = "Say what is in the logs, and whether the columns are what the machine says",
    .details =
        "Logs that cannot be what MACHINE.yaml says (swapped columns, wrong units, two clocks) end with "
        "exit code 3 and a sentence that names file, column and remedy. What is merely not determined "
        "by them is a warning.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run_check};
