/* lg-control evaluate: judges a policy by runs. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "control/policy.h"
#include "files/frame.h"
#include "lg-control/control_app.h"

typedef struct evaluate_values {
    const char *plant, *disturb, *reference, *out;
    uint64_t starts;
} evaluate_values;

static const lg_field options[] = {
    LG_OPTION(evaluate_values, plant, STRING, "FILE", "Score on this machine instead of the policy's",
              .file = LG_FILE_READ),
    LG_OPTION(evaluate_values, disturb, STRING, "TASK.yaml",
              "Score with the disturbances (robust) of this task too", .file = LG_FILE_READ),
    LG_OPTION(evaluate_values, reference, STRING, "FILE",
              "Also run along these set points: columns t, the tracked coordinates, and their velocities if "
              "they are known",
              .file = LG_FILE_READ),
    APP_OUT(evaluate_values, "FILE.csv",
            "Write the runs: start, t, the state, inputs and cost of each period", .file = LG_FILE_TEXT),
    LG_OPTION(evaluate_values, starts, U64, "n", "Random starts", .low = 1, .high = 1e6, .value = "500"),
    LG_FIELD_END};

static evaluate_values values;

/* Warns if the lagged inputs of two plants differ under u = 1. */
static void warn_of_other_lag(const app *self, const lg_policy *policy, const lg_program *plant) {
    double a[2][LG_POLICY_COORDINATES] = {{0}}, u[LG_POLICY_INPUTS];
    const double h = policy->task.period, none[LG_POLICY_COORDINATES] = {0};
    const uint32_t n = policy->memory.lags;
    for (uint32_t l = 0; l < LG_POLICY_INPUTS; l++) u[l] = 1;
    for (int i = 0; i < 2 && n > 0; i++)
        APP_DO(self, lg_program_eval, i == 0 ? lg_policy_program(policy) : plant, "lag", 1,
               (const double *const[]){none, u, &h}, (double *const[]){a[i]});
    if (memcmp(a[0], a[1], n * sizeof **a) != 0)
        app_warn(
            self,
            "%s has another lag; the controller computes lagged inputs by the lag that it was trained with",
            values.plant);
}

/* The machine --plant; *names: what its file says. */
static lg_program *other_plant(const app *self, const lg_policy *policy, lg_policy_task *names) {
    const lg_policy_task *own = &policy->task;
    const uint32_t lagged = policy->memory.lags, remembered = policy->memory.lines + policy->memory.integrals;
    uint32_t found = 0; /* lagged inputs of the plant */
    *names = (lg_policy_task){.period = own->period};
    if (own->coordinate[0].velocity[0] == '\0') {
        *names = *own; /* the file of a program does not name its states */
        names->coordinate_count -= remembered;
    }
    APP_CLEAN(control_machine_destroy) control_machine machine;
    lg_program *plant = control_load_plant(self, values.plant, lagged > 0, names, &machine);
    for (uint32_t i = 0; i < names->coordinate_count; i++) found += names->coordinate[i].follows > 0;
    if (found != lagged)
        app_stop(self, LG_SHAPE, "%s: the plant has %u lagged inputs, but the policy knows %u", values.plant,
                 found, lagged);
    bool same = names->coordinate_count + remembered == own->coordinate_count &&
                names->input_count == own->input_count;
    for (uint32_t i = 0; same && i < names->coordinate_count; i++)
        same = strcmp(names->coordinate[i].name, own->coordinate[i].name) == 0 &&
               names->coordinate[i].motion == own->coordinate[i].motion;
    for (uint32_t l = 0; same && l < names->input_count; l++)
        same = strcmp(names->input[l].name, own->input[l].name) == 0;
    if (!same)
        app_stop(self, LG_SHAPE, "%s: its coordinates or inputs are not those of the policy", values.plant);
    warn_of_other_lag(self, policy, plant);
    return plant;
}

/* Draws come from the model --plant, or else from the plant of the task. */
static void disturb(const app *self, lg_policy *policy) {
    lg_policy_task task;
    APP_FREE char *text = NULL, *source = NULL;
    APP_CLEAN(control_machine_destroy) control_machine machine = {.scheme = NULL};
    lg_program_destroy(control_read_task(self, values.disturb, &task, &text, &source, &machine));
    if (!lg_policy_is_disturbed(&task))
        app_stop(self, LG_FORMAT, "%s: the task has no disturbances (robust)", values.disturb);
    APP_MUST(self, lg_policy_disturb(policy, &task, &error));
    control_add_draws(self, policy, values.plant != NULL ? values.plant : source);
}

/* The time of a call of `control` in the library, microseconds. */
static double time_control(const app *self, const lg_policy *policy) {
    enum { CALLS = 20000 };
    lg_plan *plan = NULL;
    APP_MUST(self, lg_program_plan(policy->program, "control", LG_F64, 1, &plan, &error));
    APP_FREE double *x = app_alloc(lg_plan_input_count(plan, 0), sizeof *x);
    APP_FREE double *u = app_alloc(lg_plan_output_count(plan, 0), sizeof *u);
    APP_FREE void *work = app_alloc(lg_plan_work_size(plan), 1);
    x[0] = 1.0;
    const double begun = app_seconds();
    for (int i = 0; i < CALLS; i++) lg_plan_eval(plan, (const void *[]){x}, (void *[]){u}, work);
    lg_plan_destroy(plan);
    return (app_seconds() - begun) / CALLS * 1e6;
}

/* ---- a run along set points ---- */

typedef struct following {
    const app *self;
    const lg_policy *policy;
    const lg_policy_task *task;
    size_t numbers;                        /* In `reference`. */
    uint32_t place[LG_POLICY_COORDINATES]; /* of a tracked coordinate: of its position, and velocity */
    uint32_t tracked;
    lg_frame table;
    lg_frame_want want[2 * LG_POLICY_COORDINATES + 1]; /* time, set points, their rates */
} following;

static void choose_columns(following *f) {
    f->want[0] = (lg_frame_want){.name = "t", .as = LG_FRAME_TIME, .complete = true};
    for (uint32_t i = 0; i < f->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &f->task->coordinate[i];
        if (c->motion > LG_POLICY_ANGLE)
            app_stop(f->self, LG_UNSUPPORTED,
                     "--reference: %s is a %s; runs along set points are for lines and angles", c->name,
                     lg_policy_motion_row_of(c->motion)->name);
        if (!c->track) continue;
        f->place[f->tracked++] = i;
        f->want[f->tracked] = (lg_frame_want){.name = c->name, .complete = true};
    }
    if (f->tracked == 0)
        app_stop(f->self, LG_FORMAT,
                 "--reference: the policy's task tracks no coordinate; give it track: [NAME]");
    f->numbers = f->tracked * (f->policy->layout.velocities > 0 ? 2 : 1);
    for (uint32_t k = f->tracked; k < f->numbers; k++)
        f->want[1 + k] = (lg_frame_want){.name = f->task->coordinate[f->place[k - f->tracked]].velocity,
                                         .complete = true,
                                         .optional = true};
}

static void lay_out(following *f, const char *path) {
    lg_frame *table = &f->table;
    choose_columns(f);
    *table = (lg_frame){.context = f->self->context, .path = path, .what = "table", .want = f->want};
    table->wants = 1 + f->numbers;
    APP_MUST_FILE(f->self, path, lg_frame_open(table, &error));
    APP_MUST_FILE(f->self, path, lg_frame_next(table, SIZE_MAX, &error));
    if (table->rows == 0) app_stop(f->self, LG_FORMAT, "%s: has no rows: add some", path);
    if (table->cut) app_warn(f->self, "%s: the last line was cut off and left out", path);
    for (size_t i = 1; i < table->rows; i++)
        if (!(table->value[i * table->width] > table->value[(i - 1) * table->width]))
            APP_MUST_FILE(
                f->self, path,
                lg_frame_fail(
                    table, i, "t", &error,
                    "the time does not increase: sort the rows, and remove those that repeat a time"));
}

/* Straight lines between the rows. Rates without a column are 0. *row: where to begin. */
static void reference_at(const following *f, double t, size_t *row, double *out) {
    const double *all = f->table.value;
    const size_t n = f->table.width, last = f->table.rows - 1;
    while (*row < last && all[(*row + 1) * n] <= t) ++*row;
    const double *a = all + *row * n, *b = *row < last ? a + n : a;
    const double part = b > a ? (t - a[0]) / (b[0] - a[0]) : 0;
    for (size_t k = 0; k < f->numbers; k++) {
        const lg_frame_want *want = &f->want[1 + k];
        out[k] = want->there ? a[want->first] + part * (b[want->first] - a[want->first]) : 0;
    }
}

enum { TRACK, PERIOD, SENSED, FUNCTIONS };

typedef struct sums {
    double square, largest;
} sums;

static void run_along(const following *f, lg_plan *const *plan, double *x, void *work, sums *sum,
                      double *saturated) {
    const double begin = f->table.value[0], end = f->table.value[(f->table.rows - 1) * f->table.width];
    const double periods = floor((end - begin) / f->task->period);
    if (!(periods <= 1e9))
        app_stop(f->self, LG_FORMAT,
                 "%s: from the first to the last time are %g periods of %g s, expected at most 1e+09",
                 f->table.path, periods, f->task->period);
    const size_t steps = (size_t)periods + 1, state = f->policy->state, nq = f->policy->layout.positions;
    double seen[2 * LG_POLICY_COORDINATES] = {0}, reference[2 * LG_POLICY_COORDINATES], u[LG_POLICY_INPUTS];
    double *next = x + state;
    size_t row = 0;
    for (size_t i = 0; i < nq; i++) seen[i] = f->task->coordinate[i].goal[0];
    reference_at(f, begin, &row, reference);
    for (uint32_t k = 0; k < f->tracked; k++) seen[f->place[k]] = reference[k];
    APP_MUST(f->self, lg_policy_states_at(f->policy, seen, seen + nq, 1, x, &error));
    for (size_t s = 0; s < steps; s++) {
        if (app_interrupted()) app_stop(f->self, LG_CANCELLED, "stopped by %s", app_stopper());
        reference_at(f, begin + (double)s * f->task->period, &row, reference);
        for (uint32_t k = 0; k < f->tracked; k++) {
            const double off = fabs(seen[f->place[k]] - reference[k]);
            sum[k].square += off * off / (double)steps;
            sum[k].largest = off <= sum[k].largest ? sum[k].largest : off;
        }
        lg_plan_eval(plan[TRACK], (const void *[]){seen, reference}, (void *[]){u}, work);
        if (lg_policy_at_limit(f->policy, u)) *saturated += 1 / (double)steps;
        lg_plan_eval(plan[PERIOD], (const void *[]){x, u}, (void *[]){next}, work);
        memcpy(x, next, state * sizeof *x);
        lg_plan_eval(plan[SENSED], (const void *[]){x}, (void *[]){seen}, work);
    }
}

static void tell_errors(const following *f, app_json *out, const sums *sum, double saturated) {
    app_result_line(out, "along the set points:");
    app_json_open(out, "reference", '{');
    for (uint32_t k = 0; k < f->tracked; k++) {
        const char *name = f->task->coordinate[f->place[k]].name;
        APP_FREE char *rms = app_format("%s_rms", name), *largest = app_format("%s_largest", name);
        APP_PUT(out, LG_REAL(rms, sqrt(sum[k].square), "of the distance from the set point"),
                LG_REAL(largest, sum[k].largest, NULL));
    }
    app_result_real(out, "saturated", saturated, "share of the periods with an input at a limit");
    app_json_close(out, '}');
}

/* Runs the policy along the set points of a file, with the columns t, the tracked coordinates and, if they
 * are there, these coordinates' velocities. Adds the errors to the results as `reference`. */
static void follow(const app *self, lg_policy *policy, const char *path, app_json *out) {
    static const char *const names[FUNCTIONS] = {"track", "period", "sensed_by_control"};
    following f = {.self = self, .policy = policy, .task = &policy->task};
    APP_CLEAN(lg_policy_plans_destroy) lg_policy_plans plans;
    sums sum[LG_POLICY_COORDINATES] = {{0, 0}};
    double saturated = 0;
    lay_out(&f, path);
    APP_MUST(self, lg_policy_add(policy, "sensed_by_control", &error));
    APP_MUST(self, lg_policy_plans_create(policy, false, names, FUNCTIONS, LG_F64, 1, &plans, &error));
    APP_FREE double *x = app_alloc(2 * policy->state, sizeof *x);
    APP_FREE void *work = app_alloc(plans.work, 1);
    run_along(&f, plans.plan, x, work, sum, &saturated);
    tell_errors(&f, out, sum, saturated);
    lg_frame_close(&f.table);
}

/* ---- the command ---- */

static void run(app *self) {
    lg_policy *trained = NULL, *policy = NULL;
    lg_policy_outcome rough;
    lg_policy_task names;
    APP_FILE(self, self->arguments[0], lg_policy_load, NULL, &trained, NULL);
    lg_program *plant = values.plant != NULL ? other_plant(self, trained, &names) : NULL;
    APP_MUST(self,
             lg_policy_transplant(trained, plant, plant != NULL ? names.dead_time : NULL, &policy, &error));
    const size_t errors = lg_policy_regulator_of(policy)->errors;
    control_runs runs;
    const bool whole = values.out != NULL || app_plot_given.plot != NULL;
    control_runs_begin(policy, values.starts, whole, &runs);
    const lg_policy_outcome own = control_evaluate(self, policy, LG_POLICY_NOMINAL, values.starts, self->seed,
                                                   &runs.runs),
                            regulator = control_evaluate(self, policy, LG_POLICY_REGULATED, values.starts,
                                                         self->seed, NULL);
    if (whole) control_show_runs(self, &runs, values.out);
    if (values.disturb != NULL) {
        disturb(self, policy);
        rough = control_evaluate(self, policy, LG_POLICY_DISTURBED, values.starts, self->seed, NULL);
    }
    app_json *out = self->out;
    control_tell_outcome(out, NULL, NULL, &own);
    app_result_real(out, "microseconds", time_control(self, policy),
                    "of a call of the controller in the library");
    APP_OBJECT(out, "worst", LG_AS_REAL("cost", own.worst), LG_AS_WHOLE("start", own.worst_start),
               LG_AS_REALS("errors", runs.runs.path + own.worst_start * errors, errors));
    control_tell_outcome(out, "lqr", "the saturated regulator alone", &regulator);
    if (values.disturb != NULL) {
        APP_FREE char *heading = app_format("with the disturbances of %s", values.disturb);
        control_tell_outcome(out, "disturbed", heading, &rough);
    }
    if (values.reference != NULL) follow(self, policy, values.reference, out);
    lg_policy_destroy(policy);
    lg_policy_destroy(trained);
}

const app_command control_evaluate_command = {
    .name = "evaluate",
    .arguments = "POLICY.h5",
    .summary = "Score a policy by runs from random starts",
    .details = "The saturated regulator alone (lqr) is scored too. --plant scores on another machine than "
               "the one that the policy was trained with, for example the true one of a simulation.",
    APP_DRAWS("the motion of some runs, which starts succeed, and inputs", "policy_runs", control_put_runs),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
