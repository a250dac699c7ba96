/* lg-identify predict: free runs of a model with the inputs of a log. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"

typedef struct predict_values {
    const char *out, *plot;
    uint64_t start, substeps;
    bool bands;
} predict_values;

static const lg_field options[] = {
    LG_OPTION(predict_values, out, STRING, "FILE.csv", "Write the predicted rows in the columns of the log"),
    LG_OPTION(predict_values, start, U64, "n",
              "Begin at row n of each part without a gap, from 0; the next complete one is taken",
              .high = 1e12),
    LG_OPTION(predict_values, substeps, U64, "n", "Integrator steps between two points of the data", .low = 1,
              .high = 1e6, .otherwise = "the model's"),
    LG_OPTION(predict_values, bands, SWITCH, NULL,
              "Add columns NAME.sd: the standard deviation that the uncertainty of the parameters makes"),
    LG_OPTION(predict_values, plot, STRING, "FILE.svg|.png", "Draw the first run, logged and predicted"),
    LG_FIELD_END};

static predict_values values;

typedef struct prediction {
    const lg_machine_model_file *file;
    identify_data data;
    size_t *start, runs, rows;
    double *q, *v; /* as the log's rows */
    double *bands; /* (rows, columns of the machine's file): standard deviations; NULL: not wanted */
    double error[LG_LOG_COLUMNS];
    bool finite;
} prediction;

static lg_status predict(app *self, prediction *p, lg_error *error) {
    const lg_machine_model_run *run = &p->file->run;
    const lg_machine *machine = &run->machine;
    const lg_machine_log *log = &p->data.logs.log;
    const bool positions = p->data.file.measured == LG_MEASURED_POSITIONS;
    const identify_model model = {machine, p->file->theta, run->scheme,
                                  values.substeps > 0 ? (uint32_t)values.substeps : run->substeps};
    p->start = app_alloc(log->parts, sizeof *p->start);
    p->runs = identify_first_rows(machine, log, values.start, positions, p->start);
    if (p->runs == 0)
        return app_error(
            error, LG_INVALID_ARGUMENT,
            "no part of the log has a complete row at or after row %llu that another one follows",
            (unsigned long long)values.start);
    if (p->runs < log->parts)
        app_warn(self, "%zu of %zu parts have no complete row to begin at, and are left out",
                 log->parts - p->runs, log->parts);
    p->q = app_alloc(log->rows * machine->positions, sizeof *p->q);
    p->v = app_alloc(log->rows * machine->velocities, sizeof *p->v);
    LG_TRY(identify_run_log(self, &model, log, p->start, p->runs, positions, p->q, p->v, error));
    if (values.bands) {
        p->bands = app_alloc(log->rows * p->data.file.column_count, sizeof *p->bands);
        LG_TRY(identify_bands(self, &model, p->file->spread, &p->data.file, log, p->start, p->runs, positions,
                              p->q, p->v, p->bands, error));
    }
    identify_column_errors(&p->data.file, log, p->q, p->v, p->error);
    identify_warn_range(self, run, &p->data.file, log, p->q, p->v);
    return LG_OK;
}

/* ---- the file ---- */

/* Rows from the start of a run to the end of its part. */
static size_t end_of(const prediction *p, size_t run) {
    const lg_machine_log *log = &p->data.logs.log;
    size_t part = 0;
    while (log->first[part + 1] <= p->start[run]) part++;
    return log->first[part + 1];
}

static void put_head(FILE *stream, const lg_machine_file *file) {
    bool first = true;
    for (uint32_t c = 0; c < file->column_count; c++, first = false)
        (void)fprintf(stream, "%s%s", first ? "" : ",", file->columns[c].name);
    for (uint32_t c = 0; c < file->column_count && values.bands; c++)
        if (identify_is_state(&file->columns[c])) (void)fprintf(stream, ",%s.sd", file->columns[c].name);
    (void)fputc('\n', stream);
}

static void put_number(FILE *stream, double value) {
    if (isfinite(value)) (void)fprintf(stream, "%.17g", value);
}

/* The input that acts from a row on was logged `delay` rows before. */
static double input_of(const lg_machine_log *log, const lg_machine *machine, size_t row, size_t end,
                       uint32_t delay, uint32_t input) {
    const size_t from = row + delay;
    return from < end ? log->u[from * 4 * machine->input_count + input] : (double)NAN;
}

static void put_row(FILE *stream, prediction *p, size_t row, size_t end, uint32_t run, const double *before,
                    double *columns) {
    const lg_machine_file *file = &p->data.file;
    const lg_machine *machine = &file->machine;
    const lg_machine_log *log = &p->data.logs.log;
    const double *q = p->q + row * machine->positions;
    bool first = true;
    identify_to_columns(file, q, p->v + row * machine->velocities, before, columns);
    columns[file->time] = log->t[row];
    for (uint32_t c = 0; c < file->column_count; c++, first = false) {
        const lg_log_column *column = &file->columns[c];
        if (column->role == LG_LOG_INPUT)
            columns[c] = input_of(log, machine, row, end, p->data.logs.delay, column->index);
        if (!first) (void)fputc(',', stream);
        if (column->role == LG_LOG_RUN)
            (void)fprintf(stream, "%u", run);
        else
            put_number(stream, columns[c] / column->scale);
        if (identify_is_state(column)) p->finite = p->finite && isfinite(columns[c]);
    }
    for (uint32_t c = 0; c < file->column_count && values.bands; c++) {
        if (!identify_is_state(&file->columns[c])) continue;
        (void)fputc(',', stream);
        put_number(stream, p->bands[row * file->column_count + c] / fabs(file->columns[c].scale));
    }
    (void)fputc('\n', stream);
    p->rows++;
}

static lg_status write_rows(prediction *p, lg_error *error) {
    app_file file;
    double columns[LG_LOG_COLUMNS], before[LG_LOG_COLUMNS];
    const lg_machine_log *log = &p->data.logs.log;
    app_file_begin(&file, values.out);
    put_head(file.stream, &p->data.file);
    for (size_t i = 0; i < p->runs; i++) {
        const size_t end = end_of(p, i);
        size_t part = 0;
        while (log->first[part + 1] < end) part++;
        for (size_t row = p->start[i]; row < end; row++) {
            put_row(file.stream, p, row, end, p->data.logs.part_run[part], row > p->start[i] ? before : NULL,
                    columns);
            memcpy(before, columns, sizeof before);
        }
    }
    return app_file_end(&file, error);
}

static lg_status draw(const app *self, const prediction *p, lg_error *error) {
    const lg_logs *logs = &p->data.logs;
    size_t parts = 1;
    while (parts < logs->log.parts && logs->part_run[parts] == logs->part_run[0]) parts++;
    return identify_draw_run(self, values.plot, "First run of the log: logged (thick) and predicted (thin)",
                             &p->data.file, &logs->log, parts, p->q, p->v, p->bands, error);
}

/* ---- report ---- */

static void report(const app *self, const prediction *p) {
    const lg_machine_file *file = &p->data.file;
    app_json json;
    if (!self->json) {
        (void)printf("%s: %zu rows in %zu runs\n", values.out, p->rows, p->runs);
        for (uint32_t c = 0; c < file->column_count; c++)
            if (identify_is_state(&file->columns[c]))
                (void)printf("%s: root mean square of the difference from the log %.4g\n",
                             file->columns[c].name, p->error[c]);
        return;
    }
    app_json_begin(&json);
    app_json_size(&json, "rows", p->rows);
    app_json_size(&json, "runs", p->runs);
    app_json_open(&json, "free_run", '{');
    for (uint32_t c = 0; c < file->column_count; c++)
        if (identify_is_state(&file->columns[c])) app_json_real(&json, file->columns[c].name, p->error[c]);
    app_json_close(&json, '}');
    app_json_text(&json, "out", values.out);
    app_json_warnings(&json, self);
    app_json_end(&json);
}

static int predict_and_write(app *self, prediction *p) {
    lg_error error = {LG_OK, ""};
    lg_status status;
    int code = identify_read_logs(self, p->file, self->arguments + 1, 1, &p->data);
    if (code == APP_EXIT_OK) code = identify_refuse_momenta(self, &p->data.file, self->arguments[0]);
    if (code != APP_EXIT_OK) return code;
    if (values.bands && p->file->spread == NULL)
        return app_fail(
            self, LG_UNSUPPORTED,
            "%s: has no covariance of its parameters for --bands: it has more than %d of them, or none "
            "that the logs determine",
            self->arguments[0], IDENTIFY_MOST_SPREAD);
    status = predict(self, p, &error);
    if (status != LG_OK)
        return app_fail(self, status, "%s: %s", self->arguments[1], app_sentence(status, &error));
    p->finite = true;
    status = write_rows(p, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    if (values.plot != NULL) status = draw(self, p, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.plot);
    report(self, p);
    if (p->finite) return APP_EXIT_OK;
    return app_fail(
        self, LG_NOT_FINITE,
        "%s: the prediction is not finite from some row on (empty cells): the model leaves what it "
        "has learned, or needs more --substeps",
        values.out);
}

static int run_predict(app *self) {
    lg_error error = {LG_OK, ""};
    const app_path paths[] = {{"out", values.out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    if (values.out == NULL) return app_usage(self, "--out FILE.csv is missing");
    int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    lg_machine_model_file *file = app_alloc(1, sizeof *file);
    prediction p = {.file = file};
    const lg_status status =
        lg_model_load_machine_model(self->context, self->arguments[0], NULL, file, &error);
    code = status == LG_OK ? predict_and_write(self, &p)
                           : app_fail_file(self, status, &error, self->arguments[0]);
    identify_release(&p.data);
    free(p.start);
    free(p.q);
    free(p.v);
    free(p.bands);
    if (status == LG_OK) lg_machine_model_file_destroy(file);
    free(file);
    return code;
}

const app_command predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5 LOG",
    .summary = "Run a model with the inputs of a log",
    .details =
        "A run goes from the first complete row of each part without a gap (or from --start) to its end; "
        "with positions alone 50 rows estimate its start. Columns that leave the range of the training "
        "data are named in warnings.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run_predict};
