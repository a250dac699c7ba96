/* lg-control evaluate: judges a policy by runs. */
#include <string.h>

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
    const double h = lg_policy_task_of(policy)->period, none[LG_POLICY_COORDINATES] = {0};
    const uint32_t n = control_count_lagged(lg_policy_task_of(policy), false);
    for (uint32_t l = 0; l < LG_POLICY_INPUTS; l++) u[l] = 1;
    for (int i = 0; i < 2 && n > 0; i++)
        APP_MUST(self,
                 lg_program_eval(self->context, i == 0 ? lg_policy_program(policy) : plant, "lag", 1,
                                 (const double *const[]){none, u, &h}, (double *const[]){a[i]}, &error));
    if (memcmp(a[0], a[1], n * sizeof **a) != 0)
        app_warn(
            self,
            "%s has another lag; the controller computes lagged inputs by the lag that it was trained with",
            values.plant);
}

static lg_policy *other_plant(const app *self, lg_policy *policy) {
    const lg_policy_task *own = lg_policy_task_of(policy);
    lg_policy_task names = {.period = own->period};
    lg_policy *other = NULL;
    const uint32_t lagged = control_count_lagged(own, false), remembered = control_count_lagged(own, true);
    if (own->coordinate[0].velocity[0] == '\0') {
        names = *own; /* the file of a program does not name its states */
        names.coordinate_count -= remembered;
    }
    lg_program *plant = control_load_plant(self, values.plant, lagged > 0, &names);
    if (control_count_lagged(&names, false) != lagged)
        app_stop(self, LG_SHAPE, "%s: the plant has %u lagged inputs, but the policy knows %u", values.plant,
                 control_count_lagged(&names, false), lagged);
    bool same =
        names.coordinate_count + remembered == own->coordinate_count && names.input_count == own->input_count;
    for (uint32_t i = 0; same && i < names.coordinate_count; i++)
        same = strcmp(names.coordinate[i].name, own->coordinate[i].name) == 0 &&
               names.coordinate[i].motion == own->coordinate[i].motion;
    for (uint32_t l = 0; same && l < names.input_count; l++)
        same = strcmp(names.input[l].name, own->input[l].name) == 0;
    if (!same)
        app_stop(self, LG_SHAPE, "%s: its coordinates or inputs are not those of the policy", values.plant);
    warn_of_other_lag(self, policy, plant);
    APP_MUST(self, lg_policy_transplant(policy, plant, names.dead_time, &other, &error));
    lg_policy_destroy(policy);
    return other;
}

static lg_policy *refined(const app *self, lg_policy *policy) {
    lg_policy *out = NULL;
    APP_MUST(self, lg_policy_transplant(policy, NULL, NULL, &out, &error));
    lg_policy_destroy(policy);
    return out;
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

static void tell_worst(app_json *out, const lg_policy *policy, const lg_policy_outcome *o,
                       const double *starts) {
    app_json_open(out, "worst", '{');
    app_json_real(out, "cost", o->worst);
    app_json_size(out, "start", o->worst_start);
    app_json_reals(out, "errors", starts + o->worst_start * lg_policy_regulator_of(policy)->errors,
                   lg_policy_regulator_of(policy)->errors);
    app_json_close(out, '}');
}

/* The time of a call of `control` in the library, microseconds. */
static double time_control(const app *self, const lg_policy *policy) {
    enum { CALLS = 20000 };
    const lg_program *program = lg_policy_program(policy);
    lg_plan *plan = NULL;
    size_t at;
    APP_MUST(self, lg_program_find(program, "control", &at, &error));
    APP_MUST(self, lg_plan_create(program, at, NULL, &plan, &error));
    APP_FREE double *x = app_alloc(lg_plan_input_count(plan, 0), sizeof *x);
    APP_FREE double *u = app_alloc(lg_plan_output_count(plan, 0), sizeof *u);
    APP_FREE void *work = app_alloc(lg_plan_work_size(plan), 1);
    x[0] = 1.0;
    const double begun = app_seconds();
    for (int i = 0; i < CALLS; i++) lg_plan_eval(plan, (const void *[]){x}, (void *[]){u}, work);
    lg_plan_destroy(plan);
    return (app_seconds() - begun) / CALLS * 1e6;
}

static bool told(void) {
    return values.out != NULL || app_plot_given.plot != NULL;
}

static void show_runs(const app *self, control_runs *runs) {
    if (!told()) return;
    control_find_states(self, runs);
    if (values.out != NULL) control_write_runs(self, runs, values.out);
    control_draw_runs(self, runs);
}

static void run(app *self) {
    lg_policy *policy = NULL;
    lg_policy_outcome rough;
    APP_MUST_FILE(self, self->arguments[0],
                  lg_policy_load(self->context, self->arguments[0], NULL, &policy, NULL, &error));
    policy = values.plant != NULL ? other_plant(self, policy) : refined(self, policy);
    control_runs runs;
    control_runs_begin(policy, values.starts, told(), &runs);
    const lg_policy_outcome own = control_evaluate(self, policy, LG_POLICY_NOMINAL, values.starts, self->seed,
                                                   &runs.runs),
                            regulator = control_evaluate(self, policy, LG_POLICY_REGULATED, values.starts,
                                                         self->seed, NULL);
    show_runs(self, &runs);
    if (values.disturb != NULL) {
        disturb(self, policy);
        rough = control_evaluate(self, policy, LG_POLICY_DISTURBED, values.starts, self->seed, NULL);
    }
    app_json *out = self->out;
    control_tell_outcome(out, NULL, NULL, &own);
    app_result_real(out, "microseconds", time_control(self, policy),
                    "of a call of the controller in the library");
    tell_worst(out, policy, &own, runs.runs.path);
    control_tell_outcome(out, "lqr", "the saturated regulator alone", &regulator);
    if (values.disturb != NULL) {
        APP_FREE char *heading = app_format("with the disturbances of %s", values.disturb);
        control_tell_outcome(out, "disturbed", heading, &rough);
    }
    if (values.reference != NULL) control_follow(self, policy, values.reference, out);
    lg_policy_destroy(policy);
}

const app_command control_evaluate_command = {
    .name = "evaluate",
    .arguments = "POLICY.h5",
    .summary = "Score a policy by runs from random starts",
    .details = "The saturated regulator alone (lqr) is scored too. --plant scores on another machine than "
               "the one that the policy was trained with, for example the true one of a simulation.",
    APP_DRAWS("the motion of some runs, which starts succeed, and inputs"),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
