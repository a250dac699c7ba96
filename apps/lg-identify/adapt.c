/* lg-identify adapt: fits a few numbers of a model to the beginning of a new log, and judges the rest. */
#include <math.h>
#include <string.h>

#include "common/train.h"
#include "lg-identify/identify.h"

typedef struct adapt_values {
    double beginning;
    uint64_t window, substeps, start_rows;
    const char *numbers, *out;
} adapt_values;

static const lg_field options[] = {
    LG_OPTION(adapt_values, beginning, REAL, "S", "Length of the beginning that the numbers are fitted to",
              LG_POSITIVE, .required = true),
    LG_OPTION(adapt_values, numbers, STRING, "NAME,NAME",
              "What may change: offset (a constant force for each velocity), friction (one factor)",
              .value = "offset,friction"),
    WINDOW(adapt_values, NULL, U64,
           .meaning = "Rows of the windows that are fitted (default an eighth of the beginning, or those of "
                      "the training)"),
    IDENTIFY_MODEL_OPTIONS(adapt_values),
    APP_OUT(adapt_values, "MODEL.h5", "Write the adapted model", .file = LG_FILE_WRITTEN,
            .kind = "machine_model"),
    LG_FIELD_END};

static adapt_values values;

typedef struct adapting {
    identify_given given;
    lg_adaptation to;
    lg_learned_machine model;    /* the adapted machine */
    size_t cut;                  /* first row of the rest */
    size_t *first, cut_parts;    /* parts of the log, of which the one with the cut is divided */
    lg_machine_log begin, whole; /* the rows before the cut; all rows, with these parts */
    identify_runs rest;          /* of `whole`, from the cut */
    double x[LG_ADAPT_MOST], error[LG_ADAPT_MOST], alone[LG_ADAPT_MOST];
    uint32_t window;
    bool kept; /* the model as it is: the beginning shows no change */
    lg_machine_adapted found;
    /* root mean squares per column of the free run of the rest */
    double before[LG_LOG_COLUMNS], after[LG_LOG_COLUMNS], unchanged[LG_LOG_COLUMNS];
} adapting;

static void adapting_destroy(adapting *a) {
    lg_adaptation_destroy(&a->to);
    identify_given_destroy(&a->given);
}

/* ---- the two pieces of the log ---- */

/* The first row that is `seconds` of running time after the beginning. */
static size_t find_cut(const lg_machine_log *log, double seconds) {
    double passed = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);) {
        for (size_t row = p.first; row < p.end; row++)
            if (passed + log->t[row] - log->t[p.first] >= seconds * (1 - 1e-9)) return row;
        passed += log->t[p.end - 1] - log->t[p.first];
    }
    return log->rows;
}

static void divide(const app *self, adapting *a) {
    enum { LEAST = 5 }; /* rows of positions alone: more than the starts and numbers of a fit */
    const lg_machine_log *log = a->given.log;
    size_t parts = 0;
    a->cut = find_cut(log, values.beginning);
    if (a->cut < LEAST || a->cut + LEAST > log->rows)
        app_stop(self, LG_INVALID_ARGUMENT,
                 "--beginning %g: leaves %zu rows for the fit and %zu for the judgement; %d each are needed",
                 values.beginning, a->cut, log->rows - a->cut, LEAST);
    a->first = app_keep(log->parts + 2, sizeof *a->first);
    for (size_t p = 0; p <= log->parts; p++) {
        if (log->first[p] >= a->cut && (parts == 0 || a->first[parts - 1] < a->cut)) {
            a->cut_parts = parts;
            a->first[parts++] = a->cut;
        }
        if (log->first[p] != a->cut) a->first[parts++] = log->first[p];
    }
    a->whole = a->begin = *log;
    a->whole.first = a->begin.first = a->first;
    a->whole.parts = parts - 1;
    a->begin.parts = a->cut_parts;
    a->begin.rows = a->cut;
    a->rest = identify_runs_begin(&a->given.model, &a->whole, 0);
    const size_t count = a->rest.count;
    a->rest.count = 0;
    for (size_t i = 0; i < count; i++)
        if (a->rest.start[i] >= a->cut) a->rest.start[a->rest.count++] = a->rest.start[i];
}

/* ---- standard deviations of offsets ---- */

/* A tenth of the friction along the run of the beginning, of each velocity; where there is no friction, a
 * tenth of the largest of these, or else of the force that the machine's scales make. */
static void find_forces(const app *self, const adapting *a, double *force) {
    const lg_learned_machine *model = &a->given.model;
    const lg_machine *machine = model->machine;
    const size_t nv = machine->velocities, rows = a->cut;
    APP_FREE double *friction = app_alloc(rows * nv, sizeof *friction);
    identify_runs runs = identify_runs_begin(model, &a->begin, 0);
    double largest = 0;
    identify_run_log(self, model, &a->begin, &runs);
    identify_values(self, model, rows, runs.q, runs.v, NULL, friction);
    for (size_t k = 0; k < nv; k++) {
        lg_squares s = {0, 0};
        for (size_t row = 0; row < rows; row++) {
            const double f = friction[row * nv + k];
            lg_squares_add(&s, isfinite(f) ? f : NAN);
        }
        force[k] = s.count > 0 ? LG_ADAPT_SIGMA * lg_squares_root(&s) : 0;
        largest = fmax(largest, force[k]);
    }
    for (size_t k = 0; k < nv; k++) {
        const double scale = LG_ADAPT_SIGMA * machine->scales.energy / machine->scales.velocity[k];
        if (!(force[k] > 0)) force[k] = largest > 0 ? largest : scale;
    }
}

/* ---- the fit ---- */

/* Fits the numbers on windows of a->window rows. False: the runs of the windows are not finite. */
static bool fit(const app *self, adapting *a) {
    const lg_machine_model_run *run = &a->to.run;
    APP_FREE size_t *start = app_alloc(a->cut, sizeof *start);
    lg_machine_problem problem = {.machine = &run->machine,
                                  .scheme = run->scheme,
                                  .substeps = a->given.model.substeps,
                                  .window = a->window,
                                  .starts = LG_MACHINE_STARTS_ESTIMATED,
                                  .log = a->begin,
                                  .start = start};
    memcpy(problem.position_scale, run->position_scale, sizeof run->position_scale);
    memcpy(problem.velocity_scale, run->velocity_scale, sizeof run->velocity_scale);
    problem.windows = lg_machine_windows(&run->machine, &a->begin, a->window, a->window - 1,
                                         a->given.model.start_rows > 0, start);
    const lg_machine_restriction restriction = {&problem, a->to.theta, a->to.count, a->to.directions};
    lg_error error = {LG_OK, ""};
    a->found = (lg_machine_adapted){.x = a->x, .error = a->error, .alone = a->alone};
    if (problem.windows == 0) return false;
    const lg_status status = lg_machine_adapt(self->context, &restriction, &a->found, &error);
    if (status == LG_NOT_FINITE) return false;
    app_must(self, status, &error);
    return true;
}

/* Mean square, in units of the loss, of the positions and velocities about their means: the loss of a machine
 * that stands still. */
static double loss_at_rest(const adapting *a) {
    const lg_machine_model_run *run = &a->to.run;
    double sum = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(&run->machine, &at);)
        for (uint32_t k = 0; k < at.positions + at.velocities; k++) {
            const bool moves = k >= at.positions;
            const uint32_t i =
                moves ? run->machine.positions + at.velocity + k - at.positions : at.position + k;
            const double scale = moves ? run->velocity_scale[at.index] : run->position_scale[at.index],
                         square = lg_log_variance(&run->machine, &a->begin, i);
            if (!isnan(square)) sum += square / (scale * scale);
        }
    return sum;
}

/* Eight windows, whose residuals tell the errors of the numbers; if the model leaves them, halves and so on,
 * down to the windows of the training. */
static void fit_windows(const app *self, adapting *a) {
    enum { WINDOWS = 8 };
    static const double leaves = 0.5;
    const size_t longest = lg_log_longest_part(&a->begin);
    const double rest = loss_at_rest(a);
    const uint32_t least = a->to.run.window < longest ? a->to.run.window : (uint32_t)longest;
    const size_t eighth = longest / WINDOWS > least ? longest / WINDOWS : least;
    a->window = (uint32_t)(values.window == 0 ? eighth : values.window < longest ? values.window : longest);
    for (;;) {
        const bool done = fit(self, a);
        if (done && (values.window > 0 || a->window <= least || a->found.after < leaves * rest)) return;
        if (!done && (values.window > 0 || a->window <= least))
            app_stop(self, LG_NOT_FINITE,
                     "the model's runs over the first %g s are not finite: give a shorter --window",
                     values.beginning);
        a->window = a->window / 2 > least ? a->window / 2 : least;
    }
}

/* ---- the judgement ---- */

/* Root mean square errors of the free run of the rest; with `still` of a machine that stands still. */
static void judge(const app *self, adapting *a, const lg_learned_machine *model, bool still, double *out) {
    const lg_machine *machine = model->machine;
    const lg_machine_log *log = &a->whole;
    const size_t nq = machine->positions, nv = machine->velocities;
    identify_runs *runs = &a->rest;
    identify_run_log(self, model, log, runs);
    for (size_t i = 0; i < runs->count && still; i++) {
        const size_t first = runs->start[i], end = log->first[lg_machine_log_part(log, first) + 1];
        for (size_t row = first; row < end; row++) {
            memmove(runs->q + row * nq, runs->q + first * nq, nq * sizeof *runs->q);
            memset(runs->v + row * nv, 0, nv * sizeof *runs->v);
        }
    }
    identify_leave_out(model, log, runs);
    identify_column_errors(&a->given, runs, out);
}

/* ---- results ---- */

static void warn(const app *self, const adapting *a) {
    for (size_t k = 0; k < a->to.count; k++)
        if (!(a->alone[k] <= 1))
            app_warn(
                self,
                "%g s are too short to tell %s: the beginning of the log tells it no better than the prior, "
                "%.2g of its standard deviation; give more --beginning, or fewer --numbers",
                values.beginning, a->to.names[k], a->alone[k]);
    if (a->kept)
        app_warn(self,
                 "the first %g s do not show by more than chance that %s changed: the model is kept as it is",
                 values.beginning, values.numbers);
    for (uint32_t c = 0; c < a->given.data.file.column_count && !a->kept; c++)
        if (a->after[c] > a->before[c]) {
            app_warn(self,
                     "the adapted model predicts the rest worse than before: what changes is not a number "
                     "of --numbers, or it changes within the log");
            return;
        }
}

/* The value of number k, moved by `by` standard deviations of its prior, in the units of the log: a force, or
 * the factor of the first number of the friction. A network has no number: its last layer is scaled. */
static double value_of(const adapting *a, size_t k, double by) {
    lg_identified before[LG_MACHINE_VALUES], after[LG_MACHINE_VALUES];
    const lg_machine *machine = &a->to.run.machine;
    const size_t n = machine->parameters;
    const bool factor = strcmp(a->to.names[k], "friction") == 0;
    APP_FREE double *from = app_alloc(2 * n, sizeof *from);
    for (size_t i = 0; i < n; i++) {
        from[i] = a->to.theta[i] - a->x[k] * a->to.directions[k * n + i];
        from[n + i] = a->to.theta[i] + by * a->to.directions[k * n + i];
    }
    (void)lg_machine_numbers(machine, from, LG_MACHINE_VALUES, before);
    size_t count = lg_machine_numbers(machine, from + n, LG_MACHINE_VALUES, after);
    if (count > LG_MACHINE_VALUES) count = LG_MACHINE_VALUES;
    for (size_t i = 0; i < count; i++) {
        if (factor && after[i].value != before[i].value) return after[i].value / before[i].value;
        if (!factor && strcmp(after[i].name, a->to.names[k]) == 0) return after[i].value;
    }
    return factor ? pow(1 + LG_ADAPT_SIGMA / 2 * (a->x[k] + by), 2) : NAN;
}

static void report(const app *self, const adapting *a) {
    const lg_machine_file *file = &a->given.data.file;
    app_json *out = self->out;
    app_result_named(out, "adapted", "adapted");
    for (size_t k = 0; k < a->to.count; k++)
        APP_OBJECT(out, a->to.names[k], LG_AS_REAL("value", value_of(a, k, 0)),
                   LG_AS_REAL("error", fabs(value_of(a, k, a->error[k]) - value_of(a, k, -a->error[k])) / 2),
                   LG_AS_REAL("prior", a->to.units[k]));
    app_result_rows_end(out);
    APP_PUT(out, LG_TEXT("errors", a->found.block > 0 ? "corrected for correlation" : "white", NULL),
            LG_WHOLE("window", a->window, "rows of a window of the fit"));
    identify_put_start_rows(out, &a->given.model);
    app_json_put(out, LG_TEXT("numbers", a->kept ? "kept" : "changed", NULL));
    app_result_named(out, "rest", "root mean square of the rest, free run");
    for (uint32_t c = 0; c < file->column_count; c++) {
        if (!identify_is_state(&file->columns[c])) continue;
        APP_OBJECT(out, file->columns[c].name, LG_AS_REAL("before", a->before[c]),
                   LG_AS_REAL("after", a->after[c]), LG_AS_REAL("unchanged", a->unchanged[c]));
    }
    app_result_rows_end(out);
    if (values.out != NULL) app_json_put(out, LG_TEXT("out", values.out, NULL));
}

static void run(app *self) {
    APP_CLEAN(adapting_destroy) adapting a = {.cut = 0};
    double force[LG_MACHINE_VELOCITIES] = {0};
    APP_MUST(self, lg_adapt_check(values.numbers, &error));
    identify_load(self, values.substeps, values.start_rows, &a.given);
    if (a.given.model.machine->accelerations)
        app_stop(
            self, LG_UNSUPPORTED,
            "%s: adapt needs logs with positions or velocities, but this model's logs have accelerations "
            "alone: run `fit` on the new log too",
            self->arguments[0]);
    divide(self, &a);
    find_forces(self, &a, force);
    APP_DO(self, lg_adaptation_create, self->arguments[0], &a.given.file, values.numbers, force, &a.to);
    fit_windows(self, &a);
    /* The 99.5 % quantile of chi-squared, by Wilson and Hilferty from the normal one. */
    const double n = (double)a.to.count, part = 2 / (9 * n), normal = 2.576,
                 chance = n * pow(1 - part + normal * sqrt(part), 3);
    a.kept = !(a.found.change > chance);
    for (size_t k = 0; k < a.to.count && a.kept; k++) a.x[k] = 0;
    judge(self, &a, &a.given.model, false, a.before);
    judge(self, &a, &a.given.model, true, a.unchanged);
    lg_adaptation_move(&a.to, a.x);
    a.model = a.given.model;
    a.model.machine = &a.to.run.machine;
    a.model.theta = a.to.theta;
    judge(self, &a, &a.model, false, a.after);
    warn(self, &a);
    lg_machine_model_file file = a.given.file;
    file.run = a.to.run;
    file.parameters = file.run.machine.parameters;
    file.theta = a.to.theta;
    file.spread = NULL;
    file.provenance = app_provenance(self, a.to.run.training.seed);
    if (values.out != NULL) APP_FILE(self, values.out, lg_recipe_save, &lg_recipe_machine_model, &file, NULL);
    report(self, &a);
}

const app_command identify_adapt_command = {
    .name = "adapt",
    .arguments = "MODEL.h5 LOG",
    .summary = "Fit a few numbers to the beginning of a new log, and score the rest",
    .details = "The numbers are fitted to free runs in the first --beginning of the log, whose starts are "
               "estimated. Before any data, the factor of all friction is 1 with a standard deviation of .1, "
               "and an offset 0 with a tenth of the friction's root mean square. The rest of the log is "
               "predicted by one free run, with the model as it was and with the adapted model.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
