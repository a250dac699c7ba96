/* lg-identify evaluate: compares free runs of a model with logs. */
#include <math.h>
#include <string.h>

#include "common/verbs.h"
#include "lg-identify/identify.h"
#include "liegrad/geometry.h"

enum { MOST_HORIZONS = 16 };

typedef struct evaluate_values {
    lg_reals horizons;
    uint64_t every, window, substeps, start_rows;
    bool relative;
} evaluate_values;

static const lg_field options[] = {
    LG_OPTION(evaluate_values, horizons, REALS, "S,S,...", "Lengths of free runs in seconds (default 1,2,5)",
              LG_POSITIVE, .most = MOST_HORIZONS),
    LG_OPTION(evaluate_values, every, U64, "n", "Rows from one start to the next", .low = 1, .high = 1e9,
              .value = "25"),
    WINDOW(evaluate_values, NULL, U64,
           .meaning = "Points of the windows of window_loss (default the model's)"),
    IDENTIFY_MODEL_OPTIONS(evaluate_values),
    RELATIVE(evaluate_values, "horizons", "|z - z'|/|z + z'| + 1e-8 over time, then over parts"),
    LG_FIELD_END};

static evaluate_values values;

typedef struct verdict {
    double window_loss;
    size_t horizon_count;
    lg_horizon horizons[MOST_HORIZONS], linear[MOST_HORIZONS];
    double free_run[LG_LOG_COLUMNS]; /* Root mean squares per column. */
    double energy[IDENTIFY_ENERGIES];
    identify_whiteness whiteness[LG_LOG_COLUMNS];
    double relative, relative_worst; /* NaN: not asked for. */
    identify_offset offsets[LG_MACHINE_COORDINATES];
    identify_runs runs; /* from the first rows */
} verdict;

/* ---- report ---- */

/* `key`: of an object with the errors; NULL: they are members of the open one. */
static void put_errors(app_json *json, const char *key, const double *errors, const char *suffix) {
    if (key != NULL) app_json_open(json, key, '{');
    for (int e = 0; e < LG_RUN_ERRORS; e++) {
        APP_FREE char *name = app_format("%s%s", lg_run_error_names[e], suffix);
        app_json_real(json, name, errors[e]);
    }
    if (key != NULL) app_json_close(json, '}');
}

static void put_horizon(app_json *json, const lg_horizon *h, const lg_horizon *linear) {
    app_json_open(json, NULL, '{');
    APP_PUT(json, LG_AS_REAL("seconds", h->seconds), LG_AS_WHOLE("starts", h->starts));
    put_errors(json, NULL, h->pooled, "");
    put_errors(json, NULL, h->median, "_median");
    put_errors(json, "unchanged", h->unchanged, "");
    put_errors(json, "linear", linear->pooled, "");
    app_json_close(json, '}');
}

/* Prints the table of horizons, with the linear model if there is one. */
static void show_horizons(app_json *out, const verdict *v) {
    bool linear = false;
    for (size_t i = 0; i < v->horizon_count; i++)
        for (int e = 0; e < LG_RUN_ERRORS; e++) linear = linear || !isnan(v->linear[i].pooled[e]);
    app_result_rows(out, NULL);
    for (size_t i = 0; i < v->horizon_count; i++)
        for (int e = 0; e < LG_RUN_ERRORS; e++) {
            const lg_horizon *h = &v->horizons[i];
            if (isnan(h->pooled[e])) continue;
            APP_PUT(out, LG_AS_REAL("horizon, s", h->seconds), LG_AS_WHOLE("starts", h->starts),
                    LG_AS_TEXT("error of", lg_run_error_names[e]), LG_AS_ROUNDED("pooled", h->pooled[e], 3),
                    LG_AS_ROUNDED("median", h->median[e], 3), LG_AS_ROUNDED("unchanged", h->unchanged[e], 3));
            if (linear) app_json_put(out, LG_AS_ROUNDED("linear", v->linear[i].pooled[e], 3));
        }
    app_result_rows_end(out);
}

/* Says for each horizon how the model compares with the linear model, and whether a machine at rest beats
 * both. */
static void compare(app_json *out, const verdict *v) {
    for (size_t i = 0; i < v->horizon_count; i++)
        for (int e = 0; e < LG_RUN_ERRORS; e++) {
            const double own = v->horizons[i].pooled[e], linear = v->linear[i].pooled[e],
                         rest = v->horizons[i].unchanged[e];
            if (!isfinite(own) || !isfinite(linear)) continue;
            if (rest < own && rest < linear)
                app_result_line(out,
                                "Runs of %g s, error of %s: a machine that stands still is better, %.3g "
                                "against %.3g of the model and %.3g of the linear model",
                                v->horizons[i].seconds, lg_run_error_names[e], rest, own, linear);
            else
                app_result_line(
                    out, "Runs of %g s, error of %s: the %s is better, %.3g against %.3g of the %s",
                    v->horizons[i].seconds, lg_run_error_names[e], own < linear ? "model" : "linear model",
                    fmin(own, linear), fmax(own, linear), own < linear ? "linear model" : "model");
            break;
        }
}

static void put_columns(app_json *out, const lg_machine_file *file, const verdict *v) {
    identify_put_errors(out, file, v->free_run, "free run to the end of each part, root mean square");
    app_result_named(out, "whiteness", "residual of");
    for (uint32_t c = 0; c < file->column_count; c++) {
        const identify_whiteness *w = &v->whiteness[c];
        if (!identify_is_state(&file->columns[c])) continue;
        APP_OBJECT(out, file->columns[c].name, LG_AS_REAL("rms", w->rms), LG_AS_REAL("lag1", w->lag1),
                   LG_AS_REAL("ljung_box", w->ljung_box), LG_AS_REAL("probability", w->probability));
    }
    app_result_rows_end(out);
    app_result_line(out,
                    file->measured == LG_MEASURED_POSITIONS || file->machine.accelerations
                        ? "Residuals are those of the run."
                        : "Residuals of one step; probability of such ones, if they are white. Noise of the "
                          "logged rows\nalone makes the correlation of neighbours, lag1, -0.5; 0 is the "
                          "best that a run can have.");
}

static const char *const energy_names[IDENTIFY_ENERGIES] = {"change", "inputs", "damping",   "residual",
                                                            "offset", "left",   "left_size", "change_size"};
static const char *const energy_words[IDENTIFY_ENERGIES] = {
    "change of the energy", "work of the inputs", "work of damping and friction", "work of the residual",
    "work of the offset",   "left over",          "left over, sizes added",       "changes, sizes added"};

static void report(const app *self, const identify_given *given, const verdict *v) {
    const lg_machine_file *file = &given->data.file;
    app_json *out = self->out;
    identify_put_start_rows(out, &given->model);
    app_result_known(out, "window_loss", v->window_loss, NULL);
    app_json_open(out, "horizons", '[');
    for (size_t i = 0; i < v->horizon_count; i++) put_horizon(out, &v->horizons[i], &v->linear[i]);
    app_json_close(out, ']');
    if (out->people) show_horizons(out, v);
    if (out->people) compare(out, v);
    put_columns(out, file, v);
    app_json_open(out, "integrates", '{'); /* constant forces that the free run integrates */
    for (uint32_t i = 0; i < file->machine.coordinate_count; i++) {
        const identify_offset *o = &v->offsets[i];
        if (!o->integrates) continue;
        APP_OBJECT(out, file->machine.coordinates[i].name, LG_AS_REAL("force", o->force),
                   LG_AS_REAL("without", o->without), LG_AS_REAL("with", o->with));
    }
    app_json_close(out, '}');
    app_json_open(out, "energy", '{');
    for (int k = 0; k < IDENTIFY_ENERGIES; k++)
        app_result_known(out, energy_names[k], v->energy[k], energy_words[k]);
    app_json_close(out, '}');
    if (values.relative)
        APP_PUT(out, LG_REAL("relative", v->relative, NULL),
                LG_REAL("relative_worst", v->relative_worst, NULL));
}

/* ---- a linear model to compare the machine with ---- */

/* v' = A (q, v, u, 1), fitted to all rows of the logs on which it is judged. If the logs have no velocities,
 * its runs are NaN. */
enum { FEATURES = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 1 };
typedef struct linear_model {
    const lg_learned_machine *rival; /* the model, whose runs begin from the same states */
    double *start;                   /* (rows, positions + velocities): the states where these runs began */
    size_t features;
    double A[LG_MACHINE_VELOCITIES * FEATURES]; /* (velocities, features) */
    const lg_machine_log *log;
    size_t row; /* the interval of the step begins here */
} linear_model;

/* Computes d = h dy/dt of positions and velocities y at the time t[0] + s h, with h = t[1] - t[0]. */
static lg_status slope(void *user, double s, const double *y, const double *t, double *d) {
    const linear_model *linear = user;
    const lg_machine *machine = linear->rival->machine;
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    const double *q = y, *v = y + nq, h = t[1] - t[0];
    double *dq = d, *dv = d + nq, x[FEATURES];
    memcpy(x, y, (nq + nv) * sizeof *x);
    for (size_t k = 0; k < m; k++) {
        const double *u = linear->log->u + linear->row * 4 * m + k;
        x[nq + nv + k] = u[0] + s * (u[m] + s * (u[2 * m] + s * u[3 * m]));
    }
    x[nq + nv + m] = 1;
    for (size_t k = 0; k < nv; k++) {
        double sum = 0;
        for (size_t i = 0; i < linear->features; i++) sum += linear->A[k * linear->features + i] * x[i];
        dv[k] = sum;
    }
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double *R = q + at.places, *rate = v + at.velocities - 3;
        for (uint32_t k = 0; k < at.places; k++) dq[k] = at.rotations > 0 ? lg_dot3(R + 3 * k, v) : v[k];
        if (at.directions > 0) lg_cross3(v, q, dq);
        for (int r = 0; r < 3 && at.rotations > 0; r++) lg_cross3(R + 3 * r, rate, dq + at.places + 3 * r);
        q += at.positions, dq += at.positions, v += at.velocities;
    }
    for (size_t k = 0; k < nq + nv; k++) d[k] *= h;
    return LG_OK;
}

/* Makes one step of y over an interval, and projects the positions. y is NaN where it is not finite. */
static void advance(const linear_model *linear, lg_stepper *stepper, double *y) {
    const lg_machine *machine = linear->rival->machine;
    if (lg_stepper_step(stepper, 0, 1, y, linear->log->t + linear->row, y) != LG_OK)
        for (size_t k = 0; k < machine->positions + machine->velocities; k++) y[k] = NAN;
    for (lg_machine_offsets of = {0}; lg_machine_next(machine, &of);) {
        double *own = y + of.position;
        if (of.rotations > 0) lg_so3_project(own + of.places);
        const double norm = of.directions > 0 ? sqrt(lg_dot3(own, own)) : 1;
        for (int k = 0; k < 3 && of.directions > 0; k++) own[k] /= norm;
    }
}

static lg_status run_linear(const void *user, const lg_machine_log *log, const size_t *start, size_t count,
                            size_t steps, double *q, double *v, lg_error *error) {
    linear_model linear = *(const linear_model *)user;
    const lg_machine *machine = linear.rival->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    lg_ode ode = {.field = slope, .user = &linear};
    lg_stepper *stepper;
    double y[FEATURES];
    LG_TRY(lg_space_init_rn(&ode.space, nq + nv));
    LG_TRY(lg_stepper_create(linear.rival->context, lg_scheme_find("rk4"), &ode, &stepper));
    linear.log = log;
    for (size_t i = 0; i < count; i++) {
        memcpy(y, linear.start + start[i] * (nq + nv), (nq + nv) * sizeof *y);
        for (size_t step = 0; step <= steps; step++, q += nq, v += nv) {
            linear.row = start[i] + step - 1;
            if (step > 0) advance(&linear, stepper, y);
            memcpy(q, y, nq * sizeof *q);
            memcpy(v, y + nq, nv * sizeof *v);
        }
    }
    lg_stepper_destroy(stepper);
    return LG_OK;
}

/* Runs the model, and keeps the states at the starts. */
static lg_status run_rival(const void *user, const lg_machine_log *log, const size_t *start, size_t count,
                           size_t steps, double *q, double *v, lg_error *error) {
    const linear_model *linear = user;
    const size_t nq = linear->rival->machine->positions, nv = linear->rival->machine->velocities;
    LG_TRY(lg_machine_run(linear->rival, log, start, count, steps, q, v, error));
    for (size_t i = 0; i < count; i++) {
        memcpy(linear->start + start[i] * (nq + nv), q + i * (steps + 1) * nq, nq * sizeof *q);
        memcpy(linear->start + start[i] * (nq + nv) + nq, v + i * (steps + 1) * nv, nv * sizeof *v);
    }
    return LG_OK;
}

/* ---- judging ---- */

/* Warns if the model predicts the shortest horizon no better than a simple guess: then it has not learned the
 * machine. */
static void warn_of_horizons(const app *self, const verdict *v) {
    const lg_horizon *h = NULL;
    for (const lg_horizon *at = v->horizons; at < v->horizons + v->horizon_count; at++)
        if (at->starts > 0 && (h == NULL || at->seconds < h->seconds)) h = at;
    if (h == NULL) return;
    const double *const guesses[] = {h->unchanged, v->linear[h - v->horizons].pooled};
    for (size_t g = 0; g < LG_COUNT(guesses); g++)
        for (int e = 0; e < LG_RUN_ERRORS; e++)
            if (h->pooled[e] >= guesses[g][e])
                app_warn(self, "at %g s the model's error of %s, %.3g, is no better than the %.3g of %s",
                         h->seconds, lg_run_error_names[e], h->pooled[e], guesses[g][e],
                         g == 0 ? "a machine that stands still" : "a linear model");
}

/* The errors of the linear model, NaN where accelerations alone are measured: it would have no states. */
static void judge_linear(const app *self, const linear_model *linear, const lg_machine_log *log,
                         double seconds, lg_horizon *out) {
    for (int e = 0; e < LG_RUN_ERRORS; e++) out->pooled[e] = NAN;
    if (linear->rival->machine->accelerations) return;
    APP_MUST(self, lg_horizon_of(linear->rival, run_linear, linear, log, seconds, values.every, out, &error));
    for (int e = 0; e < LG_RUN_ERRORS; e++)
        if (out->pooled[e] >= 1e300) out->pooled[e] = NAN;
}

static void judge_horizons(const app *self, const identify_given *given, verdict *out) {
    static const double usual[] = {1, 2, 5};
    const lg_learned_machine *model = &given->model;
    const lg_machine *m = model->machine;
    const lg_machine_log *log = given->log;
    APP_CLEAN(lg_started_log_destroy) lg_started_log simple = identify_slopes(self, model, log);
    APP_FREE double *start = app_alloc(log->rows * (m->positions + m->velocities), sizeof *start);
    linear_model linear = {model, start, .features = m->positions + m->velocities + m->input_count + 1};
    double left;
    for (size_t i = 0; i < LG_COUNT(linear.A); i++) linear.A[i] = NAN;
    APP_DO(self, lg_machine_unexplained, m, &simple.log, linear.A, &left);
    out->horizon_count = values.horizons.count ? values.horizons.count : LG_COUNT(usual);
    for (size_t i = 0; i < out->horizon_count; i++) {
        const double seconds = values.horizons.count ? values.horizons.values[i] : usual[i];
        APP_MUST(self, lg_horizon_of(model, run_rival, &linear, log, seconds, values.every, &out->horizons[i],
                                     &error));
        judge_linear(self, &linear, log, seconds, &out->linear[i]);
        if (out->horizons[i].starts == 0)
            app_warn(self, "no run of %g s fits into a part of the logs: that horizon is not judged",
                     seconds);
    }
    warn_of_horizons(self, out);
}

/* The geometric mean over rows of |z - z'|/|z + z'| + 1e-8. */
static void judge_relative(const lg_machine *machine, const lg_machine_log *data, verdict *out) {
    const size_t nq = machine->positions, nv = machine->velocities, count = out->runs.count;
    const size_t *start = out->runs.start;
    double sum = 0, worst = -INFINITY;
    size_t part = 0;
    for (size_t i = 0; i < count; i++) {
        while (data->first[part + 1] <= start[i]) part++;
        double mean = 0;
        for (size_t row = start[i]; row < data->first[part + 1]; row++) {
            double square = 0, total = 0;
            for (size_t k = machine->accelerations ? nq : 0; k < nq + nv; k++) {
                const double a = lg_log_number(machine, data, row, k),
                             b = k < nq ? out->runs.q[row * nq + k] : out->runs.v[row * nv + k - nq];
                if (isnan(a)) continue;
                square += (a - b) * (a - b), total += (a + b) * (a + b);
            }
            mean += log((square > 0 ? sqrt(square / total) : 0) + 1e-8);
        }
        mean /= (double)(data->first[part + 1] - start[i]);
        sum += mean;
        worst = fmax(worst, mean);
    }
    out->relative = count > 0 ? exp(sum / (double)count) : NAN;
    out->relative_worst = count > 0 ? exp(worst) : NAN;
}

/* What needs logged states: constant forces that runs integrate, and the balance of energy. */
static void judge_states(const app *self, const identify_given *given, verdict *out) {
    const lg_machine *machine = given->model.machine;
    for (int k = 0; k < IDENTIFY_ENERGIES; k++) out->energy[k] = NAN;
    if (machine->accelerations) return;
    identify_find_offsets(self, given, &out->runs, out->offsets);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const identify_offset *o = &out->offsets[i];
        if (!o->integrates) continue;
        app_warn(
            self,
            "the free run integrates an offset: a constant force of %.3g on %s takes its error from %.3g to "
            "%.3g, and the effect of such a force grows to the end of the run. Judge the model by short "
            "horizons, or fit the force to the beginning of this log: lg-identify adapt",
            o->force, machine->coordinates[i].name, o->without, o->with);
    }
    identify_balance(self, given, out->energy, out->whiteness);
}

static void judge_run(const app *self, const identify_given *given, verdict *out) {
    const lg_learned_machine *model = &given->model;
    const lg_machine_log *log = given->log;
    out->runs = identify_runs_begin(model, log, 0);
    identify_run_log(self, model, log, &out->runs);
    if (values.relative) judge_relative(model->machine, log, out);
    identify_leave_out(model, log, &out->runs);
    identify_column_errors(given, &out->runs, out->free_run);
    bool finite = true;
    for (uint32_t c = 0; c < given->data.file.column_count; c++) finite = finite && !isinf(out->free_run[c]);
    if (!finite)
        app_warn(self, "the free run is not finite: the model leaves the range of its training data, or "
                       "needs more --substeps");
    judge_states(self, given, out);
    if (model->start_rows > 0) identify_run_whiteness(given, &out->runs, out->whiteness);
    /* Residuals of single steps may look white even if the free run is not finite. */
    for (uint32_t c = 0; c < given->data.file.column_count; c++)
        if (isinf(out->free_run[c])) out->whiteness[c].probability = 0;
}

/* ---- the plot ---- */

/* Draws errors of horizons from two steps up to the longest horizon. */
static void draw(const app *self, const identify_given *given, const verdict *v) {
    /* Long logs: the starts are farther apart, since a curve needs no more rows to start at. */
    enum { POINTS = 10, ENOUGH = 10000 };
    lg_horizon curve[POINTS];
    const lg_logs *logs = &given->data.logs;
    const size_t every = values.every * (1 + logs->log.rows / ENOUGH);
    double longest = 0;
    for (size_t i = 0; i < v->horizon_count; i++)
        if (v->horizons[i].starts > 0) longest = fmax(longest, v->horizons[i].seconds);
    const double shortest = 2 * logs->dt_median;
    if (longest <= shortest) longest = 10 * shortest;
    for (int i = 0; i < POINTS; i++)
        APP_MUST(self, lg_horizon_of(&given->model, lg_machine_run, &given->model, &logs->log,
                                     shortest * pow(longest / shortest, (double)i / (POINTS - 1)), every,
                                     &curve[i], &error));
    app_plot_draw(
        self, 0,
        &(identify_plot){"First run of the log: logged (thick) and predicted from its start (thin); "
                         "what was learned",
                         &given->data.file, &logs->log, identify_first_run(logs), &v->runs, given, curve,
                         POINTS});
}

/* ---- the command ---- */

static void run(app *self) {
    APP_CLEAN(identify_given_destroy) identify_given given = {.model = {.machine = NULL}};
    verdict v = {.relative = NAN, .relative_worst = NAN};
    identify_load(self, values.substeps, values.start_rows, &given);
    const uint32_t window = values.window > 0 ? (uint32_t)values.window : given.file.run.window;
    APP_MUST(self, lg_machine_window_loss(&given.model, given.log, window, &v.window_loss, &error));
    judge_run(self, &given, &v);
    identify_warn_range(self, &given, NULL);
    judge_horizons(self, &given, &v);
    if (app_plot_given.plot != NULL) draw(self, &given, &v);
    report(self, &given, &v);
}

const app_command identify_evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 LOG...",
    .summary = "Free runs of a model against logs",
    .details =
        "A run starts every n rows (--every) and takes only the inputs from the log. Errors are root "
        "mean squares over all rows up to the horizon. Beside them are the errors of a machine that "
        "stands still and of a linear model v' = A (q, v, u, 1), fitted to the same logs. With positions or "
        "accelerations alone, some rows (--start-rows) estimate the state at each start, for these two "
        "machines too; these rows do not count.",
    APP_DRAWS("the first run, errors against horizons, learned potential and friction", "machine",
              identify_put),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
