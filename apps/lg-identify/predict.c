/* lg-identify predict: free runs of a model with the inputs of a log. */
#include <math.h>
#include <string.h>

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

/* ---- standard deviations that follow from the uncertainty of the parameters ---- */

enum { SAMPLES = 40 };

/* The bands of the runs, from SAMPLES runs with parameters theta + W x, x of N(0, 1), where W is the model's
 * `spread`. */
static void find_bands(const app *self, const identify_given *given, identify_runs *runs) {
    const lg_machine_log *log = given->log;
    const lg_machine *machine = given->model.machine;
    const size_t n = machine->parameters, nq = machine->positions, nv = machine->velocities,
                 columns = given->data.file.column_count, numbers = log->rows * columns;
    double error[LG_LOG_COLUMNS];
    APP_FREE double *theta = app_alloc(n + 1, sizeof *theta);
    identify_runs other = identify_runs_begin(&given->model, log, values.start);
    lg_learned_machine drawn = given->model;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    drawn.theta = theta;
    runs->bands = app_keep(numbers, sizeof *runs->bands);
    for (int i = 0; i < SAMPLES; i++) {
        memcpy(theta, given->model.theta, n * sizeof *theta);
        for (size_t k = 0; k < n; k++) {
            const double x = lg_rng_normal(&rng);
            for (size_t j = 0; j < n; j++) theta[j] += given->file.spread[j * n + k] * x;
        }
        identify_run_log(self, &drawn, log, &other);
        for (size_t row = 0; row < log->rows; row++) {
            identify_errors(&given->data.file, other.q + row * nq, other.v + row * nv, runs->q + row * nq,
                            runs->v + row * nv, error);
            for (size_t c = 0; c < columns; c++) runs->bands[row * columns + c] += error[c] * error[c];
        }
    }
    for (size_t i = 0; i < numbers; i++) runs->bands[i] = sqrt(runs->bands[i] / SAMPLES);
}

/* ---- the prediction ---- */

static void predict(const app *self, const identify_given *given, identify_runs *runs) {
    const lg_machine_log *log = given->log;
    *runs = identify_runs_begin(&given->model, log, values.start);
    if (runs->count == 0)
        app_stop(self, LG_INVALID_ARGUMENT,
                 "%s: no part of the log has, at or after row %llu, a complete row that another row follows",
                 self->arguments[1], (unsigned long long)values.start);
    if (runs->count < log->parts)
        app_warn(
            self,
            "%zu of %zu parts have, at or after row %llu, no complete row that another row follows, and are "
            "left out",
            log->parts - runs->count, log->parts, (unsigned long long)values.start);
    identify_run_log(self, &given->model, log, runs);
    if (values.bands) find_bands(self, given, runs);
    identify_warn_range(self, given, runs);
}

/* The input that was logged at `row`: it acts its delay later. NaN if that is beyond the part. */
static double input_of(const void *user, size_t part, size_t row, uint32_t input) {
    const lg_machine_data *data = user;
    const lg_machine_log *log = &data->logs.log;
    const size_t from = row + data->logs.delay[input], each = 4 * data->file.machine.input_count;
    return from < log->first[part + 1] ? log->u[from * each + input] : NAN;
}

/* ---- the command ---- */

static void run(app *self) {
    APP_CLEAN(identify_given_destroy) identify_given given = {.model = {.machine = NULL}};
    const lg_machine_data *data = &given.data;
    app_json *out = self->out;
    identify_runs runs;
    size_t rows;
    double errors[LG_LOG_COLUMNS];
    identify_load(self, values.substeps, values.start_rows, &given);
    if (values.bands && given.file.spread == NULL)
        app_stop(self, LG_UNSUPPORTED,
                 "%s: has no covariance of its parameters, which --bands needs: the model has more than %d "
                 "parameters, its fit did not converge, it was adapted, or the logs determine none of them",
                 self->arguments[0], LG_MACHINE_MOST_SPREAD);
    predict(self, &given, &runs);
    const bool finite = identify_write(self, values.out, &data->file, &data->logs.log, &data->logs, &runs,
                                       input_of, data, &rows);
    app_plot_draw(self, 0,
                  &(identify_plot){"First run of the log: logged (thick) and predicted (thin)", &data->file,
                                   &data->logs.log, identify_first_run(&data->logs), &runs, .given = NULL});
    identify_leave_out(&given.model, &data->logs.log, &runs);
    identify_column_errors(&given, &runs, errors);
    APP_PUT(out, LG_WHOLE("rows", rows, NULL), LG_WHOLE("runs", runs.count, NULL));
    identify_put_start_rows(out, &given.model);
    identify_put_errors(out, &data->file, errors, "root mean square of the difference from the log");
    app_json_put(out, LG_TEXT("out", values.out, NULL));
    if (!finite)
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
    APP_DRAWS("the first run, logged and predicted", "machine", identify_put),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
