/* lg-identify evaluate: free runs of a model against logs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"

typedef struct evaluate_values {
    lg_reals horizons;
    uint64_t every, window, substeps;
    int metric;
    const char *plot;
} evaluate_values;

enum { METRIC_HORIZONS, METRIC_RELATIVE };
static const char *const metrics[] = {"horizons", "relative", NULL};

static const lg_field options[] = {
    LG_OPTION(evaluate_values, horizons, REALS, "S,S,...", "Lengths of free runs in seconds (default 1,2,5)",
              LG_ANY_REAL),
    LG_OPTION(evaluate_values, every, U64, "n", "Rows from one start to the next", .low = 1, .high = 1e9,
              .value = "25"),
    LG_OPTION(evaluate_values, window, U64, "M", "Points of the windows of window_loss (default the model's)",
              .low = 2, .high = LG_MACHINE_WINDOW),
    LG_OPTION(evaluate_values, substeps, U64, "n", "Integrator steps between two points of the data",
              .low = 1, .high = 1e6, .otherwise = "the model's"),
    LG_OPTION(evaluate_values, metric, NAME, NULL,
              "relative: also the geometric mean over time, then over parts, of |z - z'|/|z + z'| + 1e-8",
              .names = metrics),
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw the first run, errors against horizons, learned potential and friction"),
    LG_FIELD_END};

static evaluate_values values;

enum { MOST_HORIZONS = 16 };

typedef struct verdict {
    const lg_machine_file *file;
    double window_loss;
    size_t horizon_count;
    identify_horizon horizons[MOST_HORIZONS], linear[MOST_HORIZONS];
    double free_run[LG_LOG_COLUMNS]; /* root mean squares */
    identify_energy energy;
    identify_whiteness whiteness[LG_LOG_COLUMNS];
    double relative, relative_worst; /* NaN: not asked for */
    double *q, *v;                   /* of the free run, as the log's rows; owned */
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

static void put_horizon(app_json *json, const identify_horizon *h, const identify_horizon *linear) {
    app_json_open(json, NULL, '{');
    app_json_real(json, "seconds", h->seconds);
    app_json_size(json, "starts", h->starts);
    put_errors(json, h->pooled, "");
    put_errors(json, h->median, "_median");
    app_json_open(json, "unchanged", '{');
    put_errors(json, h->unchanged, "");
    app_json_close(json, '}');
    app_json_open(json, "linear", '{');
    put_errors(json, linear->pooled, "");
    app_json_close(json, '}');
    app_json_close(json, '}');
}

static void put_columns(app_json *json, const verdict *v) {
    app_json_open(json, "free_run", '{');
    for (uint32_t c = 0; c < v->file->column_count; c++)
        if (identify_is_state(&v->file->columns[c]))
            app_json_real(json, v->file->columns[c].name, v->free_run[c]);
    app_json_close(json, '}');
    app_json_open(json, "whiteness", '{');
    for (uint32_t c = 0; c < v->file->column_count; c++) {
        const identify_whiteness *w = &v->whiteness[c];
        if (!identify_is_state(&v->file->columns[c])) continue;
        app_json_open(json, v->file->columns[c].name, '{');
        app_json_real(json, "rms", w->rms);
        app_json_real(json, "lag1", w->lag1);
        app_json_real(json, "ljung_box", w->ljung_box);
        app_json_real(json, "probability", w->probability);
        app_json_close(json, '}');
    }
    app_json_close(json, '}');
}

/* Names and places of the parts of a balance. */
static const struct {
    const char *name, *words;
    size_t offset;
} balance_rows[] = {{"change", "change of the energy", offsetof(identify_energy, change)},
                    {"inputs", "work of the inputs", offsetof(identify_energy, inputs)},
                    {"damping", "work of damping and friction", offsetof(identify_energy, damping)},
                    {"residual", "work of the residual", offsetof(identify_energy, residual)},
                    {"left", "left over", offsetof(identify_energy, left)},
                    {"left_size", "left over, sizes added", offsetof(identify_energy, left_size)},
                    {"change_size", "changes, sizes added", offsetof(identify_energy, moved)}};

static double balance_of(const identify_energy *energy, size_t row) {
    double value;
    memcpy(&value, (const char *)energy + balance_rows[row].offset, sizeof value);
    return value;
}

static void report_json(const app *self, const verdict *v) {
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "window_loss", v->window_loss);
    app_json_open(&json, "horizons", '[');
    for (size_t i = 0; i < v->horizon_count; i++) put_horizon(&json, &v->horizons[i], &v->linear[i]);
    app_json_close(&json, ']');
    put_columns(&json, v);
    app_json_open(&json, "energy", '{');
    for (size_t i = 0; i < LG_COUNT(balance_rows); i++)
        app_json_real(&json, balance_rows[i].name, balance_of(&v->energy, i));
    app_json_close(&json, '}');
    if (values.metric == METRIC_RELATIVE) {
        app_json_real(&json, "relative", v->relative);
        app_json_real(&json, "relative_worst", v->relative_worst);
    }
    app_json_warnings(&json, self);
    app_json_end(&json);
}

/* Without velocities there is no linear model. */
static bool has_linear(const verdict *v) {
    bool there = false;
    for (size_t i = 0; i < v->horizon_count; i++)
        for (int e = 0; e < IDENTIFY_ERRORS; e++) there = there || !isnan(v->linear[i].pooled[e]);
    return there;
}

static void show_horizons(const verdict *v) {
    static const char *const head[] = {"horizon", "starts",    "error of", "pooled",
                                       "median",  "unchanged", "linear"};
    app_table table;
    const bool linear = has_linear(v);
    const size_t columns = linear ? LG_COUNT(head) : LG_COUNT(head) - 1;
    app_table_begin(&table, columns);
    for (size_t c = 0; c < columns; c++) app_table_cell(&table, "%s", head[c]);
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
            if (linear) app_table_cell(&table, "%.3g", v->linear[i].pooled[e]);
        }
    app_table_end(&table, stdout);
}

static void show_columns(const verdict *v) {
    static const char *const head[] = {"column", "free run", "residual", "lag 1", "Ljung-Box", "white?"};
    app_table table;
    app_table_begin(&table, LG_COUNT(head));
    for (size_t c = 0; c < LG_COUNT(head); c++) app_table_cell(&table, "%s", head[c]);
    for (uint32_t c = 0; c < v->file->column_count; c++) {
        const identify_whiteness *w = &v->whiteness[c];
        if (!identify_is_state(&v->file->columns[c])) continue;
        app_table_cell(&table, "%s", v->file->columns[c].name);
        app_table_cell(&table, "%.3g", v->free_run[c]);
        app_table_cell(&table, "%.3g", w->rms);
        app_table_cell(&table, "%.3f", w->lag1);
        app_table_cell(&table, "%.4g", w->ljung_box);
        app_table_cell(&table, "%s", isnan(w->probability) ? "-" : w->probability > 0.01 ? "yes" : "no");
    }
    app_table_end(&table, stdout);
    if (v->file->measured == LG_MEASURED_POSITIONS) {
        (void)printf(
            "Root mean squares of one run to the end of each part, whose residuals are the others.\n");
        return;
    }
    (void)printf("Root mean squares of one run to the end of each part, and of residuals of one step with "
                 "the correlation of "
                 "neighbours.\nNoise of the logged rows alone makes it -0.5; 0 is the best that a run can "
                 "have.\n");
}

static void show_energy(const identify_energy *energy) {
    app_table table;
    if (isnan(energy->change)) return;
    app_table_begin(&table, 2);
    app_table_cell(&table, "energy along the logs");
    app_table_cell(&table, "in all");
    for (size_t i = 0; i < LG_COUNT(balance_rows); i++) {
        app_table_cell(&table, "%s", balance_rows[i].words);
        app_table_cell(&table, "%.4g", balance_of(energy, i));
    }
    app_table_end(&table, stdout);
}

static void report_table(const verdict *v) {
    if (!isnan(v->window_loss)) (void)printf("window loss %.4e\n", v->window_loss);
    if (values.metric == METRIC_RELATIVE)
        (void)printf("relative error %.3e, at most %.3e\n", v->relative, v->relative_worst);
    show_horizons(v);
    show_columns(v);
    show_energy(&v->energy);
}

/* ---- judging ---- */

static lg_status judge_horizon(const app *self, const identify_model *model, const identify_data *data,
                               double seconds, size_t every, identify_horizon *out, lg_error *error) {
    const lg_machine_log *log = &data->logs.log;
    if (data->file.measured == LG_MEASURED_POSITIONS)
        return identify_position_horizon_errors(self, model, log, seconds, every, out, error);
    return identify_horizon_errors(self, model, log, seconds, every, out, error);
}

/* A model that predicts no better than a simple guess has not learned the machine. */
static void warn_of_horizon(const app *self, const identify_horizon *h, const identify_horizon *linear) {
    const struct {
        const char *name;
        const double *errors;
    } guesses[] = {{"a machine that stands still", h->unchanged}, {"a linear model", linear->pooled}};
    for (size_t g = 0; g < LG_COUNT(guesses); g++)
        for (int e = 0; e < IDENTIFY_ERRORS; e++)
            if (h->pooled[e] >= guesses[g].errors[e])
                app_warn(self, "at %g s the model's error of %s, %.3g, is no better than the %.3g of %s",
                         h->seconds, identify_error_names[e], h->pooled[e], guesses[g].errors[e],
                         guesses[g].name);
}

/* Told once, of the shortest one that is judged. */
static void warn_of_horizons(const app *self, const verdict *v) {
    size_t best = v->horizon_count;
    for (size_t i = 0; i < v->horizon_count; i++)
        if (v->horizons[i].starts > 0 &&
            (best == v->horizon_count || v->horizons[i].seconds < v->horizons[best].seconds))
            best = i;
    if (best < v->horizon_count) warn_of_horizon(self, &v->horizons[best], &v->linear[best]);
}

static lg_status judge_horizons(const app *self, const identify_model *model, const identify_data *data,
                                verdict *out, lg_error *error) {
    static const double usual[] = {1, 2, 5};
    const lg_machine_log *log = &data->logs.log;
    const bool positions = data->file.measured == LG_MEASURED_POSITIONS;
    identify_linear *linear = identify_linear_create(model->machine, log);
    lg_status status = LG_OK;
    out->horizon_count = values.horizons.count > 0 ? values.horizons.count : LG_COUNT(usual);
    for (size_t i = 0; i < out->horizon_count && status == LG_OK; i++) {
        const double seconds = values.horizons.count > 0 ? values.horizons.values[i] : usual[i];
        status = judge_horizon(self, model, data, seconds, values.every, &out->horizons[i], error);
        out->linear[i] = (identify_horizon){.seconds = seconds};
        for (int e = 0; e < IDENTIFY_ERRORS; e++) out->linear[i].pooled[e] = (double)NAN;
        if (status == LG_OK && !positions)
            status = identify_horizon_errors_of(model->machine, identify_linear_run, linear, log, seconds,
                                                values.every, &out->linear[i], error);
        if (status == LG_OK && out->horizons[i].starts == 0)
            app_warn(self, "no run of %g s fits into a part of the logs: that horizon is not judged",
                     seconds);
    }
    identify_linear_destroy(linear);
    if (status == LG_OK) warn_of_horizons(self, out);
    return status;
}

/* |z - z'|/|z + z'| + 1e-8 of a row: the logarithm. */
static double relative_of(const double *a, const double *b, size_t n, double *square, double *sum) {
    for (size_t k = 0; k < n; k++) {
        if (isnan(a[k])) continue;
        *square += (a[k] - b[k]) * (a[k] - b[k]);
        *sum += (a[k] + b[k]) * (a[k] + b[k]);
    }
    return log((*square > 0 ? sqrt(*square / *sum) : 0) + 1e-8);
}

static void judge_relative(const lg_machine *machine, const lg_machine_log *log, const size_t *start,
                           size_t count, verdict *out) {
    const size_t nq = machine->positions, nv = machine->velocities;
    double sum = 0, worst = -INFINITY;
    size_t part = 0;
    for (size_t i = 0; i < count; i++) {
        while (log->first[part + 1] <= start[i]) part++;
        double mean = 0;
        for (size_t row = start[i]; row < log->first[part + 1]; row++) {
            double square = 0, total = 0;
            (void)relative_of(log->q + row * nq, out->q + row * nq, nq, &square, &total);
            mean += relative_of(log->v + row * nv, out->v + row * nv, nv, &square, &total);
        }
        mean /= (double)(log->first[part + 1] - start[i]);
        sum += mean;
        worst = fmax(worst, mean);
    }
    out->relative = count > 0 ? exp(sum / (double)count) : (double)NAN;
    out->relative_worst = count > 0 ? exp(worst) : (double)NAN;
}

/* Rows that only served to find the start of a run are not scored. */
static void leave_out(const lg_machine *machine, const lg_machine_log *log, const size_t *start, size_t count,
                      const verdict *v) {
    const size_t nq = machine->positions, nv = machine->velocities;
    for (size_t i = 0; i < count; i++)
        for (size_t row = start[i]; row < start[i] + IDENTIFY_START_ROWS && row < log->rows; row++) {
            for (size_t k = 0; k < nq; k++) v->q[row * nq + k] = (double)NAN;
            for (size_t k = 0; k < nv; k++) v->v[row * nv + k] = (double)NAN;
        }
}

static void warn_of_runs(const app *self, const verdict *v) {
    for (uint32_t c = 0; c < v->file->column_count; c++) {
        if (!identify_is_state(&v->file->columns[c]) || !isinf(v->free_run[c])) continue;
        app_warn(self, "the free run is not finite: the model leaves what it has learned, or needs more "
                       "--substeps");
        return;
    }
}

/* What one step leaves of a column may be white; where the free run is not finite the model is not. */
static void deny_whiteness(verdict *v) {
    for (uint32_t c = 0; c < v->file->column_count; c++)
        if (isinf(v->free_run[c])) v->whiteness[c].probability = 0;
}

static lg_status judge_run(const app *self, const identify_model *model, const identify_data *data,
                           verdict *out, lg_error *error) {
    const lg_machine *machine = model->machine;
    const lg_machine_log *log = &data->logs.log;
    const bool positions = data->file.measured == LG_MEASURED_POSITIONS;
    size_t *start = app_alloc(log->parts, sizeof *start);
    const size_t count = identify_first_rows(machine, log, 0, positions, start);
    out->q = app_alloc(log->rows * machine->positions, sizeof *out->q);
    out->v = app_alloc(log->rows * machine->velocities, sizeof *out->v);
    lg_status status = identify_run_log(self, model, log, start, count, positions, out->q, out->v, error);
    if (status == LG_OK) {
        if (values.metric == METRIC_RELATIVE) judge_relative(machine, log, start, count, out);
        if (positions) leave_out(machine, log, start, count, out);
        identify_column_errors(&data->file, log, out->q, out->v, out->free_run);
        warn_of_runs(self, out);
        status = identify_balance(self, model, &data->file, log, &out->energy, out->whiteness, error);
        if (positions) identify_run_whiteness(&data->file, log, out->q, out->v, out->whiteness);
        deny_whiteness(out);
    }
    free(start);
    return status;
}

/* ---- the picture ---- */

/* Errors of horizons from a few steps up to the longest one. */
static lg_status draw(const app *self, const identify_model *model, const identify_data *data,
                      const verdict *v, lg_error *error) {
    enum { POINTS = 10, ENOUGH = 10000 }; /* a curve does not need more rows to start at */
    identify_horizon curve[POINTS];
    const lg_logs *logs = &data->logs;
    const size_t every = values.every * (1 + logs->log.rows / ENOUGH);
    size_t parts = 1;
    double longest = 0;
    for (size_t i = 0; i < v->horizon_count; i++)
        if (v->horizons[i].starts > 0) longest = fmax(longest, v->horizons[i].seconds);
    const double shortest = 2 * logs->dt_median;
    if (!(longest > shortest)) longest = 10 * shortest;
    for (int i = 0; i < POINTS; i++)
        LG_TRY(judge_horizon(self, model, data, shortest * pow(longest / shortest, (double)i / (POINTS - 1)),
                             every, &curve[i], error));
    while (parts < logs->log.parts && logs->part_run[parts] == logs->part_run[0]) parts++;
    const identify_drawing drawing = {model, &data->file, &logs->log, parts, v->q, v->v, curve, POINTS};
    return identify_draw_evaluation(self, values.plot, &drawing, error);
}

/* ---- the command ---- */

static lg_status judge(const app *self, const lg_machine_model_file *file, const identify_model *model,
                       const identify_data *data, verdict *out, lg_error *error) {
    const uint32_t window = values.window > 0 ? (uint32_t)values.window : file->run.window;
    out->file = &data->file;
    out->relative = out->relative_worst = (double)NAN;
    LG_TRY(window_loss(self, model, &data->logs.log, window, &out->window_loss, error));
    LG_TRY(judge_run(self, model, data, out, error));
    identify_warn_range(self, &file->run, &data->file, &data->logs.log, NULL, NULL);
    return judge_horizons(self, model, data, out, error);
}

static int judge_and_report(app *self, const lg_machine_model_file *file, const identify_data *data,
                            verdict *v) {
    lg_error error = {LG_OK, ""};
    const lg_machine_model_run *run = &file->run;
    const identify_model model = {&run->machine, file->theta, run->scheme,
                                  values.substeps > 0 ? (uint32_t)values.substeps : run->substeps};
    lg_status status = judge(self, file, &model, data, v, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", app_sentence(status, &error));
    if (values.plot != NULL) status = draw(self, &model, data, v, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.plot);
    if (self->json)
        report_json(self, v);
    else
        report_table(v);
    return APP_EXIT_OK;
}

static int evaluate(app *self, lg_machine_model_file *file) {
    identify_data data;
    verdict *v = app_alloc(1, sizeof *v);
    int code = identify_read_logs(self, file, self->arguments + 1, (size_t)self->argument_count - 1, &data);
    if (code == APP_EXIT_OK) code = identify_refuse_momenta(self, &data.file, self->arguments[0]);
    if (code == APP_EXIT_OK) code = judge_and_report(self, file, &data, v);
    identify_release(&data);
    free(v->q);
    free(v->v);
    free(v);
    return code;
}

static int run_evaluate(app *self) {
    lg_error error = {LG_OK, ""};
    const app_path paths[] = {{"plot", values.plot, LG_FILE_DRAWN}};
    if (values.horizons.count > MOST_HORIZONS)
        return app_usage(self, "--horizons: at most %d", MOST_HORIZONS);
    for (size_t i = 0; i < values.horizons.count; i++)
        if (!(values.horizons.values[i] > 0)) return app_usage(self, "--horizons: seconds are above 0");
    const int checked = app_check_outputs(self, paths, LG_COUNT(paths));
    if (checked != APP_EXIT_OK) return checked;
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
    .details =
        "Runs start every so many rows and go on without the log but for its inputs. Errors are root "
        "mean squares over all rows up to the horizon, beside those of a machine that stands still and "
        "of v' = A (q, v, u, 1), fitted to the same logs. With positions alone 50 rows estimate the "
        "state at each start and are not scored.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run_evaluate};
