/* lg-identify evaluate: free runs of a model against logs. */
#include <math.h>
#include <stdlib.h>

#include "core/core.h"
#include "lg-identify/identify.h"

typedef struct evaluate_values {
    app_reals horizons;
    uint64_t every, window, substeps;
} evaluate_values;

static const app_option options[] = {
    APP_ROW_REALS(evaluate_values, horizons, "horizons", "S,S,...",
                  "Lengths of free runs in seconds (default 1,2,5)", NULL),
    APP_ROW_SIZE(evaluate_values, every, "every", "n", 1, 1e9,
                 "Rows from one start to the next (default 25)"),
    APP_ROW_SIZE(evaluate_values, window, "window", "M", 2, LG_MACHINE_WINDOW,
                 "Points of the windows of window_loss (default the model's)"),
    APP_ROW_SIZE(evaluate_values, substeps, "substeps", "n", 1, 1e6,
                 "Steps between two rows (default the model's)"),
    APP_ROW_END};

static evaluate_values values = {.every = 25};

enum { MOST_HORIZONS = 16 };

typedef struct verdict {
    double window_loss;
    size_t horizon_count;
    identify_horizon horizons[MOST_HORIZONS];
} verdict;

/* ---- window loss ---- */

/* The mean over windows, points 2..M of: for each position group the mean square of its numbers, the mean
 * square of all velocities, the squared angles. */
static double loss_of(const lg_machine *machine, const lg_machine_log *log, const size_t *start, size_t count,
                      uint32_t window, const double *q, const double *v) {
    const size_t nq = machine->positions, nv = machine->velocities;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        for (uint32_t j = 1; j < window; j++) {
            const double *a = q + (i * window + j) * nq, *b = log->q + (start[i] + j) * nq;
            const double *va = v + (i * window + j) * nv, *vb = log->v + (start[i] + j) * nv;
            double speeds = 0.0;
            size_t measured = 0;
            for (size_t k = 0; k < nv; k++)
                if (!isnan(vb[k])) speeds += (va[k] - vb[k]) * (va[k] - vb[k]), measured++;
            if (measured > 0) sum += speeds / (double)measured;
            sum += identify_position_loss(machine, a, b);
        }
    return sum / ((double)count * (window - 1));
}

static lg_status window_loss(const app *self, const identify_model *model, const lg_machine_log *log,
                             uint32_t window, double *out, lg_error *error) {
    const lg_machine *machine = model->machine;
    size_t *start = app_alloc(log->rows, sizeof *start);
    const size_t count = lg_machine_windows(machine, log, window, 1, false, start);
    lg_status status = LG_OK;
    *out = (double)NAN;
    if (count > 0) {
        double *q = app_alloc(count * window * machine->positions, sizeof *q),
               *v = app_alloc(count * window * machine->velocities, sizeof *v);
        status = lg_machine_free_run(self->context, machine, model->theta, model->scheme, model->substeps,
                                     log, start, count, window - 1, q, v, error);
        if (status == LG_OK) *out = loss_of(machine, log, start, count, window, q, v);
        free(q);
        free(v);
    }
    free(start);
    return status;
}

/* ---- report ---- */

static void put_errors(app_json *json, const double *errors, const char *suffix) {
    char key[40];
    for (int e = 0; e < IDENTIFY_ERRORS; e++) {
        (void)snprintf(key, sizeof key, "%s%s", identify_error_names[e], suffix);
        app_json_real(json, key, errors[e]);
    }
}

static void report_json(const app *self, const verdict *v) {
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "window_loss", v->window_loss);
    app_json_open(&json, "horizons", '[');
    for (size_t i = 0; i < v->horizon_count; i++) {
        const identify_horizon *h = &v->horizons[i];
        app_json_open(&json, NULL, '{');
        app_json_real(&json, "seconds", h->seconds);
        app_json_size(&json, "starts", h->starts);
        put_errors(&json, h->pooled, "");
        put_errors(&json, h->median, "_median");
        app_json_open(&json, "unchanged", '{');
        put_errors(&json, h->unchanged, "");
        app_json_close(&json, '}');
        app_json_close(&json, '}');
    }
    app_json_close(&json, ']');
    app_json_warnings(&json, self);
    app_json_end(&json);
}

static void report_table(const verdict *v) {
    app_table table;
    (void)printf("window loss %.4e\n", v->window_loss);
    app_table_begin(&table, 6);
    const char *const head[] = {"horizon", "starts", "error of", "pooled", "median", "unchanged"};
    for (size_t c = 0; c < LG_COUNT(head); c++) app_table_cell(&table, "%s", head[c]);
    for (size_t i = 0; i < v->horizon_count; i++)
        for (int e = 0; e < IDENTIFY_ERRORS; e++) {
            const identify_horizon *h = &v->horizons[i];
            if (isnan(h->pooled[e])) continue;
            app_table_cell(&table, "%g s", h->seconds);
            app_table_cell(&table, "%zu", h->starts);
            app_table_cell(&table, "%s", identify_error_names[e]);
            app_table_cell(&table, "%.3g", h->pooled[e]);
            app_table_cell(&table, "%.3g", h->median[e]);
            app_table_cell(&table, "%.3g", h->unchanged[e]);
        }
    app_table_end(&table, stdout);
}

/* ---- the command ---- */

static lg_status judge(const app *self, const lg_machine_model_file *file, const identify_data *data,
                       verdict *out, lg_error *error) {
    static const double usual[] = {1, 2, 5};
    const lg_machine_model_run *run = &file->run;
    const identify_model model = {&run->machine, file->theta, run->scheme,
                                  values.substeps > 0 ? (uint32_t)values.substeps : run->substeps};
    const uint32_t window = values.window > 0 ? (uint32_t)values.window : run->window;
    LG_TRY(window_loss(self, &model, &data->logs.log, window, &out->window_loss, error));
    out->horizon_count = values.horizons.count > 0 ? values.horizons.count : LG_COUNT(usual);
    for (size_t i = 0; i < out->horizon_count; i++) {
        const double seconds = values.horizons.count > 0 ? values.horizons.values[i] : usual[i];
        LG_TRY(identify_horizon_errors(self, &model, &data->logs.log, seconds, values.every,
                                       &out->horizons[i], error));
    }
    return LG_OK;
}

static int evaluate(app *self, lg_machine_model_file *file) {
    lg_error error = {LG_OK, ""};
    identify_data data;
    verdict v;
    if (values.horizons.count > MOST_HORIZONS)
        return app_usage(self, "--horizons: at most %d", MOST_HORIZONS);
    int code = identify_read_logs(self, file, self->arguments + 1, (size_t)self->argument_count - 1, &data);
    if (code == APP_EXIT_OK) {
        const lg_status status = judge(self, file, &data, &v, &error);
        if (status != LG_OK)
            code = app_fail(self, status, "%s", app_sentence(status, &error));
        else if (self->json)
            report_json(self, &v);
        else
            report_table(&v);
    }
    identify_release(&data);
    return code;
}

static int run_evaluate(app *self) {
    lg_error error = {LG_OK, ""};
    lg_machine_model_file *file = app_alloc(1, sizeof *file);
    const lg_status status =
        lg_model_load_machine_model(self->context, self->arguments[0], NULL, file, &error);
    const int code =
        status == LG_OK ? evaluate(self, file) : app_fail_file(self, status, &error, self->arguments[0]);
    if (status == LG_OK) lg_machine_model_file_destroy(file);
    free(file);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 LOG...",
    .summary = "Free runs of a model against logs",
    .details = "Runs start every so many rows and go on without the log but for its inputs. Errors are root "
               "mean squares over all rows up to the horizon, beside those of a machine that stands still.",
    .options = options,
    .values = &values,
    .arguments_min = 2,
    .arguments_max = APP_ARGUMENTS,
    .run = run_evaluate};
