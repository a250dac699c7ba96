/* lg-identify predict: free runs of a model with the inputs of a log. */
#include <math.h>
#include <string.h>

#include "files/csv.h"
#include "lg-identify/identify.h"

typedef struct predict_values {
    const char *out;
    uint64_t start, substeps, start_rows;
    bool bands;
} predict_values;

static const lg_field options[] = {
    APP_OUT(predict_values, "FILE.csv", "Write the predicted rows in the columns of the log",
            .file = LG_FILE_TEXT, .required = true),
    LG_OPTION(predict_values, start, U64, "n",
              "Begin at row n (counted from 0) of each part without a gap, or at the next complete row",
              .high = 1e12),
    IDENTIFY_MODEL_OPTIONS(predict_values),
    LG_OPTION(
        predict_values, bands, SWITCH, NULL,
        "Add columns NAME.sd: the standard deviation that results from the uncertainty of the parameters"),
    LG_FIELD_END};

static predict_values values;

typedef struct prediction {
    const identify_given *given;
    size_t *start, runs, rows;
    double *q, *v; /* Predicted states at the rows of the log. */
    double *bands; /* Standard deviations, (rows, columns of the machine file); NULL: not wanted. */
    double error[LG_LOG_COLUMNS];
    bool finite;
} prediction;

/* ---- standard deviations that follow from the uncertainty of the parameters ---- */

enum { SAMPLES = 40 };

/* Draws parameters theta + W x, with x of N(0, 1). */
static void draw(const double *theta, const double *W, size_t n, lg_rng *rng, double *out) {
    memcpy(out, theta, n * sizeof *out);
    for (size_t k = 0; k < n; k++) {
        const double x = lg_rng_normal(rng);
        for (size_t i = 0; i < n; i++) out[i] += W[i * n + k] * x;
    }
}

/* Adds the squared differences of two predictions to `out` (rows, columns of the file). */
static void add_squares(const lg_machine_data *data, const double *q, const double *v, const double *other_q,
                        const double *other_v, double *out) {
    const lg_machine_file *file = &data->file;
    const size_t nq = file->machine.positions, nv = file->machine.velocities;
    double error[LG_LOG_COLUMNS];
    for (size_t row = 0; row < data->logs.log.rows; row++) {
        identify_errors(file, other_q + row * nq, other_v + row * nv, q + row * nq, v + row * nv, error);
        for (uint32_t c = 0; c < file->column_count; c++)
            out[row * file->column_count + c] += error[c] * error[c];
    }
}

/* Standard deviations (rows, columns of the file) of the predictions q and v from these starts. They are
 * computed from SAMPLES runs with parameters theta + W x, x of N(0, 1), where W is the model's `spread`. */
static void find_bands(const app *self, const identify_given *given, const size_t *start, size_t count,
                       const double *q, const double *v, double *out) {
    const lg_machine *machine = given->model.machine;
    const lg_machine_log *log = &given->data.logs.log;
    const size_t n = machine->parameters, numbers = log->rows * given->data.file.column_count;
    APP_FREE double *theta = app_alloc(n + 1, sizeof *theta);
    APP_FREE double *other_q = app_alloc(log->rows * machine->positions, sizeof *other_q);
    APP_FREE double *other_v = app_alloc(log->rows * machine->velocities, sizeof *other_v);
    lg_learned_machine drawn = given->model;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    drawn.theta = theta;
    memset(out, 0, numbers * sizeof *out);
    for (int i = 0; i < SAMPLES; i++) {
        draw(given->model.theta, given->file.spread, n, &rng, theta);
        identify_run_log(self, &drawn, log, start, count, other_q, other_v);
        add_squares(&given->data, q, v, other_q, other_v, out);
    }
    for (size_t i = 0; i < numbers; i++) out[i] = sqrt(out[i] / SAMPLES);
}

/* ---- the prediction ---- */

static void find_starts(const app *self, prediction *p) {
    const lg_machine_log *log = &p->given->data.logs.log;
    p->start = app_keep(log->parts, sizeof *p->start);
    p->runs = identify_first_rows(&p->given->model, log, values.start, p->start);
    if (p->runs == 0)
        app_stop(self, LG_INVALID_ARGUMENT,
                 "%s: no part of the log has, at or after row %llu, a complete row that another row follows",
                 self->arguments[1], (unsigned long long)values.start);
    if (p->runs < log->parts)
        app_warn(
            self,
            "%zu of %zu parts have, at or after row %llu, no complete row that another row follows, and are "
            "left out",
            log->parts - p->runs, log->parts, (unsigned long long)values.start);
}

static void predict(const app *self, prediction *p) {
    const identify_given *given = p->given;
    const lg_machine *machine = given->model.machine;
    const lg_machine_log *log = &given->data.logs.log;
    p->q = app_keep(log->rows * machine->positions, sizeof *p->q);
    p->v = app_keep(log->rows * machine->velocities, sizeof *p->v);
    identify_run_log(self, &given->model, log, p->start, p->runs, p->q, p->v);
    if (values.bands) {
        p->bands = app_keep(log->rows * given->data.file.column_count, sizeof *p->bands);
        find_bands(self, given, p->start, p->runs, p->q, p->v, p->bands);
    }
    identify_column_errors(given, p->q, p->v, p->error);
    identify_warn_range(self, given, p->q, p->v);
}

/* ---- the file ---- */

static void put_head(lg_columns *to, const lg_machine_file *file) {
    identify_put_names(to, file);
    for (uint32_t c = 0; c < file->column_count && values.bands; c++) {
        APP_FREE char *name = app_format("%s.sd", file->columns[c].name);
        if (identify_is_state(&file->columns[c])) lg_columns_name(to, name);
    }
    lg_columns_end(to);
}

/* Returns the input that was logged at `row`: it acts its delay later. NaN if that is beyond the part. */
static double input_of(const lg_logs *logs, const lg_machine *machine, size_t row, size_t end,
                       uint32_t input) {
    const size_t from = row + logs->delay[input];
    return from < end ? logs->log.u[from * 4 * machine->input_count + input] : (double)NAN;
}

/* Writes a row of a part that ends before row `end`. `before`: columns of the previous row, or NULL. */
static void put_row(lg_columns *to, prediction *p, size_t row, size_t end, uint32_t run, const double *before,
                    double *columns) {
    const lg_machine_file *file = &p->given->data.file;
    const lg_machine *machine = &file->machine;
    const lg_logs *logs = &p->given->data.logs;
    identify_to_columns(file, p->q + row * machine->positions, p->v + row * machine->velocities, before,
                        columns);
    columns[file->time] = logs->log.t[row];
    if (file->run < file->column_count) columns[file->run] = run;
    for (uint32_t c = 0; c < file->column_count; c++) {
        const lg_log_column *column = &file->columns[c];
        if (column->role == LG_LOG_INPUT) columns[c] = input_of(logs, machine, row, end, column->index);
        if (identify_is_state(column)) p->finite = p->finite && isfinite(columns[c]);
    }
    identify_put_columns(to, file, columns);
    for (uint32_t c = 0; c < file->column_count && values.bands; c++)
        if (identify_is_state(&file->columns[c]))
            lg_columns_number(to, p->bands[row * file->column_count + c] / fabs(file->columns[c].scale));
    lg_columns_end(to);
    p->rows++;
}

static void write_rows(const app *self, prediction *p) {
    lg_columns to = {.text = app_text()};
    double columns[LG_LOG_COLUMNS], before[LG_LOG_COLUMNS];
    const lg_logs *logs = &p->given->data.logs;
    p->finite = true;
    put_head(&to, &p->given->data.file);
    for (size_t i = 0; i < p->runs; i++) {
        const size_t part = lg_machine_log_part(&logs->log, p->start[i]), end = logs->log.first[part + 1];
        for (size_t row = p->start[i]; row < end; row++) {
            put_row(&to, p, row, end, logs->part_run[part], row > p->start[i] ? before : NULL, columns);
            memcpy(before, columns, sizeof before);
        }
    }
    APP_MUST_FILE(self, values.out, lg_columns_write(&to, self->context, values.out, &error));
}

/* ---- the command ---- */

static void report(const app *self, const prediction *p) {
    const lg_machine_file *file = &p->given->data.file;
    app_json *out = self->out;
    app_result_size(out, "rows", p->rows, NULL);
    app_result_size(out, "runs", p->runs, NULL);
    identify_put_start_rows(out, &p->given->model);
    app_json_open(out, "free_run", '{');
    for (uint32_t c = 0; c < file->column_count; c++)
        if (identify_is_state(&file->columns[c]))
            app_result_real(out, file->columns[c].name, p->error[c],
                            "root mean square of the difference from the log");
    app_json_close(out, '}');
    app_result_text(out, "out", values.out, NULL);
}

static void run(app *self) {
    APP_CLEAN(identify_given_destroy) identify_given given = {.model = {.machine = NULL}};
    prediction p = {.given = &given};
    const lg_machine_data *data = &given.data;
    identify_load(self, values.substeps, values.start_rows, &given);
    if (values.bands && given.file.spread == NULL)
        app_stop(self, LG_UNSUPPORTED,
                 "%s: has no covariance of its parameters, which --bands needs: the model has more than %d "
                 "parameters, its fit did not converge, it was adapted, or the logs determine none of them",
                 self->arguments[0], LG_MACHINE_MOST_SPREAD);
    find_starts(self, &p);
    predict(self, &p);
    write_rows(self, &p);
    identify_draw_run(self, "First run of the log: logged (thick) and predicted (thin)", &data->file,
                      &data->logs.log, identify_first_run(&data->logs), p.q, p.v, p.bands);
    report(self, &p);
    if (!p.finite)
        self->code =
            app_fail(self, LG_NOT_FINITE,
                     "%s: the prediction is not finite from some row on (empty cells): the model leaves the "
                     "range of its training data, or needs more --substeps",
                     values.out);
}

const app_command identify_predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5 LOG",
    .summary = "Run a model with the inputs of a log",
    .details =
        "A run goes from the first complete row of each part without a gap (or from --start) to its end; "
        "with positions or accelerations alone some rows (--start-rows) estimate its start. Columns that "
        "leave the range of the training data are named in warnings.",
    APP_DRAWS("the first run, logged and predicted"),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
