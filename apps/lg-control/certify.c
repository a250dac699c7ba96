/* lg-control certify: proves where a closed loop goes to its goal. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-control/certify_report.h"
#include "liegrad/interval.h"
#include "liegrad/lyapunov.h"

typedef enum kind { QUADRATIC, POLYNOMIAL, FUNCTION, ENERGY } kind;

typedef enum precision { F64, F32, EXACT } precision;

typedef struct certify_values {
    uint32_t lyapunov, dtype;
    const char *box, *level, *eps, *model_error, *certificate;
    double seconds;
    uint64_t degree;
    bool loop; /* continuous */
} certify_values;

static const lg_field options[] = {
    LG_OPTION(
        certify_values, lyapunov, NAME, "KIND",
        "V: a quadratic form or a polynomial, which are searched, the function lyapunov of a plant that is a "
        "program, or the energy of a pendulum or of a body that turns",
        LG_NAMES("quadratic", "polynomial", "function", "energy"), .value = "quadratic"),
    LG_OPTION(certify_values, box, STRING, "NAME=W,...",
              "The box of states: for each position and velocity its largest distance from the goal",
              .otherwise = "unbounded"),
    LG_OPTION(certify_values, level, STRING, "C",
              "The level c of {V <= c}, or auto: the largest that is found", .value = "auto"),
    LG_OPTION(certify_values, eps, STRING, "E",
              "Motions are proved to reach {V < eps}; auto: the smallest that is found, and the goal where "
              "it can be proved. A quadratic V that is searched has the level 1 or less",
              .value = "auto"),
    LG_FIELD(certify_values, NULL, "model_error", STRING, model_error, .unit = "D",
             .meaning = "Bound of the error of the model's state after a period (with --loop continuous: of "
                        "its accelerations, of a plant that is a program of all rates), as one number, as "
                        "NAME=D,... or auto: three standard deviations of the fit of lg-identify, at the "
                        "worst of random states and inputs",
             .otherwise = "0"),
    APP_BOUND(certify_values, "Largest time of the proof", .value = "60"),
    LG_OPTION(certify_values, degree, U64, "n", "Degree of the polynomial, even", .low = 2, .high = 12,
              .value = "8"),
    LG_OPTION(certify_values, loop, NAME, NULL,
              "Prove it for inputs that are held over the task's period, or for inputs that follow the state "
              "at all times",
              LG_NAMES("held", "continuous"), .value = "held"),
    APP_DTYPE(certify_values,
              "Numbers in which the controller computes, whose rounding the proof of held inputs covers",
              LG_NAMES("f64", "f32", "exact"), .value = "f64"),
    LG_OPTION(certify_values, certificate, STRING, "FILE.json",
              "Write the proof, if it succeeds, as a file that lg-control verify checks again",
              .file = LG_FILE_TEXT),
    LG_FIELD_END};

static certify_values values;

/* ---- the box ---- */

static void read_box(const app *self, control_naming names, double *low, double *high) {
    for (size_t i = 0; i < names.n; i++) high[i] = INFINITY;
    if (values.box != NULL) control_read_states(self, names, "--box", values.box, high);
    for (size_t i = 0; i < names.n; i++) {
        low[i] = -high[i];
        if (values.lyapunov != QUADRATIC && values.lyapunov != ENERGY && !isfinite(high[i]))
            app_stop_usage(self,
                           "--box: a V that is no quadratic form needs a bound of every state; %s has none",
                           control_name_of(names, i));
    }
}

static bool is_task(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot != NULL && (strcmp(dot, ".yaml") == 0 || strcmp(dot, ".yml") == 0);
}

static void draw_model_error(const app *self, lg_policy *policy, control_naming names, const double *high,
                             double *out) {
    if (names.plant == NULL)
        app_stop_usage(self, "--model-error auto: give the task, whose plant is a model of lg-identify");
    for (size_t i = 0; i < names.n; i++)
        if (!isfinite(high[i]))
            app_stop_usage(self, "--model-error auto: needs a bound of every state; %s has none",
                           control_name_of(names, i));
    control_draw_error(self, policy, names.plant, !values.loop, high, out);
}

/* One number is for the rates that the model states: the accelerations, or all rates of a program; of a
 * held loop for all states. */
static void read_model_error(const app *self, lg_policy *policy, control_naming names, const double *high,
                             double *out) {
    double x;
    const size_t positions = names.positions;
    if (values.model_error == NULL) return; /* errors begin as 0 */
    if (strcmp(values.model_error, "auto") == 0) {
        draw_model_error(self, policy, names, high, out);
        return;
    }
    if (strchr(values.model_error, '=') != NULL) {
        control_read_states(self, names, "--model-error", values.model_error, out);
    } else {
        if (lg_number_parse(values.model_error, &x) != LG_OK || !(x >= 0))
            app_stop_usage(self, "--model-error: '%s' is not a number of at least 0", values.model_error);
        /* The controller computes what it remembers: that has no error. */
        for (size_t i = !values.loop || names.n == positions ? 0 : positions; i < names.n; i++)
            out[i] = names.of[i]->ago > 0 || names.of[i]->integrates > 0 ? 0 : x;
    }
    for (size_t i = 0; values.loop && names.n > positions && i < positions; i++)
        if (out[i] > 0)
            app_stop_usage(self, "--model-error: %s is a position, whose rate is its velocity, without error",
                           control_name_of(names, i));
}

/* 0: auto */
static double read_level(const app *self, const char *option, const char *given) {
    double c = 0;
    if (strcmp(given, "auto") != 0 && (lg_number_parse(given, &c) != LG_OK || !(c > 0)))
        app_stop_usage(self, "--%s: '%s' is neither auto nor a number above 0", option, given);
    return c;
}

static void check_options(const app *self) {
    static const char *const useless[] = {"level", "eps", "model-error"};
    if (values.loop && app_given(self, "dtype"))
        app_stop_usage(self, "--dtype: the rounding of the controller is covered for held inputs, not "
                             "with --loop continuous");
    if (!values.loop && values.lyapunov != QUADRATIC)
        app_stop_usage(
            self,
            "--lyapunov %s: this proof is about inputs that follow the state at all times, but the "
            "controller holds them for a period: give --loop continuous, or take the quadratic V",
            options[0].names[values.lyapunov]);
    if (values.certificate != NULL && values.lyapunov != QUADRATIC)
        app_stop_usage(self, "--certificate: there are files for a quadratic V; not for a polynomial, a "
                             "function or an energy");
    if (values.degree % 2 != 0) app_stop_usage(self, "--degree: expected an even number");
    for (size_t i = 0; values.lyapunov == ENERGY && i < LG_COUNT(useless); i++)
        if (app_given(self, useless[i]))
            app_stop_usage(self, "--%s: the energy proves all states at once, for the model as it is",
                           useless[i]);
}

/* Continuous inputs act at once. */
static void check_delays(const app *self, const lg_policy_task *task) {
    for (uint32_t i = 0; i < task->coordinate_count; i++)
        if (values.loop && task->coordinate[i].ago > 0)
            app_stop_usage(
                self,
                "--loop continuous: the input %s acts late (key inputs.delay of the plant), and a proof "
                "about continuous inputs does not cover that",
                task->input[task->coordinate[i].follows - 1].name);
}

/* ---- the policy ---- */

/* The certificate chooses the gains of a task of kind lqr that gives none. */
static bool chooses_gains(const app *self, const lg_policy_task *task) {
    return is_task(self->arguments[0]) && values.lyapunov == QUADRATIC && task->kind == LG_POLICY_LQR &&
           task->gain_count == 0;
}

lg_policy *control_read_policy(const app *self, const char *path, const double *gains, size_t count,
                               char **source) {
    lg_policy *policy = NULL;
    *source = NULL;
    if (!is_task(path)) {
        APP_FILE(self, path, lg_policy_load, NULL, &policy, NULL);
        return policy;
    }
    lg_policy_task task;
    APP_FREE char *text = NULL;
    APP_CLEAN(control_machine_destroy) control_machine machine = {.scheme = NULL};
    lg_program *plant = control_read_task(self, path, &task, &text, source, &machine);
    /* Whether the controller has a regulator that training chooses. */
    task.search = task.kind == LG_POLICY_NETWORK ||
                  (task.kind == LG_POLICY_LQR && task.gain_count == 0 && !chooses_gains(self, &task));
    if (count > 0) {
        task.gain_count = (uint32_t)count;
        memcpy(task.gains, gains, count * sizeof *gains);
    }
    APP_DO(self, lg_policy_create, &task, plant, self->seed, &policy);
    if (lg_policy_parameters(policy) > 0)
        app_warn(self, "%s is a task: its controller of kind %s is not trained", path,
                 lg_policy_kind_name(task.kind));
    return policy;
}

/* ---- proofs ---- */

static control_proof prove_slope(const app *self, lg_policy *policy, lg_certify_energy_result *r) {
    lg_certify_energy_spec spec;
    lg_policy_slope loop;
    APP_MUST(self, lg_policy_add_slope(policy, &loop, &error));
    lg_certify_energy_spec_init(&spec);
    spec.program = lg_policy_program(policy), spec.slope = "slope";
    spec.damping = loop.damping, spec.gain = loop.gain, spec.saturated = loop.saturated;
    APP_DO(self, lg_certify_energy, &spec, r);
    return (control_proof){.r = {.verified = r->verified,
                                 .boxes = r->boxes,
                                 .claim = r->claim,
                                 .reason = r->reason,
                                 .failed_low = &r->failed_low,
                                 .failed_high = &r->failed_high},
                           .global = true,
                           .margin = r->margin,
                           .sides = 1};
}

static control_proof prove_turn(const app *self, const lg_policy *policy, lg_certify_rotation_result *r) {
    lg_certify_rotation_spec spec;
    lg_policy_turn loop;
    APP_MUST(self, lg_policy_find_turn(policy, &loop, &error));
    lg_certify_rotation_spec_init(&spec);
    spec.stiffness = loop.stiffness, spec.damping = loop.damping, spec.inputs = loop.inputs;
    memcpy(spec.J, loop.J, sizeof spec.J);
    memcpy(spec.map, loop.map, sizeof spec.map);
    memcpy(spec.gains, loop.gains, sizeof spec.gains);
    memcpy(spec.limit, loop.limit, sizeof spec.limit);
    APP_MUST(self, lg_certify_rotation(&spec, r, &error));
    return (control_proof){
        .r = {.verified = r->verified, .level = r->level, .claim = r->claim, .reason = r->reason},
        .turns = true,
        .margin = r->angle};
}

/* Proves convergence by the energy, for a plant with one coordinate. */
static void prove_energy(app *self, lg_policy *policy, control_naming names) {
    static const char *const compared[] = {
        "mass, the damping and the map of the input are constant was compared at several states",
        "inertia, the damping and the map of the inputs are constant was compared at several rotations"};
    const bool turns = names.task->coordinate[0].motion == LG_POLICY_ROTATION;
    lg_certify_energy_result slope;
    lg_certify_rotation_result turn;
    double low[CONTROL_STATES], high[CONTROL_STATES];
    const double start = app_seconds();
    if (turns && values.box != NULL)
        app_stop_usage(self, "--box: the energy on rotations has its own set: {V < level}");
    read_box(self, names, low, high); /* only its names are checked: the proof is for every state */
    control_proof v = turns ? prove_turn(self, policy, &turn) : prove_slope(self, policy, &slope);
    APP_FREE char *more = app_format(" That the %s, it was not proved.", compared[turns]);
    APP_FREE char *claim = control_claim(self, names, values.loop, false, false, v.r.claim, more);
    v.r.claim = claim;
    v.r.converges = v.r.verified;
    v.r.seconds = app_seconds() - start;
    control_tell_proof(self, names, &v);
}

/* Whether a plant that is a program has this function of its state x; the goal must be 0, so that z = x. */
static bool has_function(const app *self, const lg_program *program, control_naming names, const char *name) {
    size_t number;
    if (names.n != names.task->coordinate_count || names.n != names.positions ||
        lg_program_find(program, name, &number, NULL) != LG_OK)
        return false;
    for (size_t i = 0; i < names.n; i++)
        if (names.of[i]->goal[0] != 0)
            app_stop(self, LG_UNSUPPORTED, "the plant's function %s is of the state x: its goal must be 0",
                     name);
    return true;
}

/* Where no polynomial falls in all of the box, the box is made smaller. */
static void add_polynomial(const app *self, lg_program *program, control_naming names, double *low,
                           double *high) {
    static const double smaller = 0.9, least = 0.2;
    lg_lyapunov_spec spec;
    lg_error error = {LG_OK, ""};
    lg_status status = LG_NO_CONVERGENCE;
    lg_lyapunov_spec_init(&spec);
    spec.rate = "rate";
    spec.name = "polynomial";
    spec.map = has_function(self, program, names, "coordinates") ? "coordinates" : NULL;
    spec.low = low;
    spec.high = high;
    spec.degree = (int)values.degree;
    spec.decay = 1e-2;
    spec.seed = self->seed;
    for (double part = 1; status == LG_NO_CONVERGENCE && part > least; part *= smaller) {
        for (size_t i = 0; i < names.n && part < 1; i++) low[i] *= smaller, high[i] *= smaller;
        status = lg_lyapunov_polynomial(program, &spec, &error);
    }
    app_must(self, status, &error);
}

/* What is to be proved. */
typedef struct wanted {
    double low[CONTROL_STATES], high[CONTROL_STATES], error[CONTROL_STATES],
        P[CONTROL_STATES * CONTROL_STATES], gains[LG_POLICY_GAINS];
    bool chosen;       /* the gains */
    double level, eps; /* 0: found */
} wanted;

/* Sizes of states: sides of the box; where it has none, the farthest start, or half the range of an input. */
static void find_scale(const app *self, control_naming names, const wanted *what, double *scale) {
    for (size_t i = 0; i < names.n; i++) {
        const lg_policy_coordinate *c = names.of[i];
        const double *start = i < names.positions ? c->start : c->start_velocity;
        scale[i] = isfinite(what->high[i]) ? what->high[i] : fmax(fabs(start[0]), fabs(start[1]));
        if (c->follows > 0 && !isfinite(what->high[i])) {
            const lg_policy_input *input = &names.task->input[c->follows - 1];
            scale[i] = 0.5 * (input->high - input->low);
        }
        if (!(scale[i] > 0))
            app_stop_usage(self, "--box: %s has no bound, and all starts have it at the goal: give a bound",
                           control_name_of(names, i));
    }
}

/* V of a proof that cannot succeed: it finds a state where V does not fall. */
static void take_squares(control_naming names, const double *scale, wanted *what) {
    for (size_t i = 0; i < names.n * names.n; i++) what->P[i] = 0;
    for (size_t i = 0; i < names.n; i++) what->P[i * (names.n + 1)] = 1 / (scale[i] * scale[i]);
    if (what->level == 0) what->level = 0.99;
    if (what->eps == 0) what->eps = 1e-3 * what->level;
}

static void search_form(app *self, const lg_policy *policy, control_naming names, wanted *what) {
    double scale[CONTROL_STATES];
    lg_lyapunov_search search;
    lg_error error = {LG_OK, ""};
    find_scale(self, names, what, scale);
    what->chosen = chooses_gains(self, names.task);
    lg_lyapunov_search_init(&search);
    search.rate = values.loop ? (what->chosen ? "rate_by_gains" : "rate")
                              : (what->chosen ? "advance_by_gains" : "advance");
    search.step = !values.loop;
    search.low = what->low, search.high = what->high, search.scale = scale;
    search.model_error = what->error;
    search.seed = self->seed, search.threads = (int)self->threads;
    const lg_status status = lg_lyapunov_quadratic(self->context, lg_policy_program(policy), &search, what->P,
                                                   what->gains, NULL, &error);
    for (size_t i = 0; i < names.task->input_count * names.n && what->chosen; i++)
        what->gains[i] = control_six_digits(what->gains[i]); /* what is printed is what is proved */
    if (status != LG_CHECK_FAILED || what->chosen) {
        app_must(self, status, &error);
        return;
    }
    app_warn(self, "%s", error.message);
    take_squares(names, scale, what);
}

/* Stops where the plant's motion jumps at the goal, as with dry friction that sticks. The inputs stay in
 * their limits there, and what the controller remembers rests. */
static void check_motion(const app *self, const lg_policy *policy, const lg_program *program) {
    const lg_policy_task *task = lg_policy_task_of(policy);
    const double *u0 = lg_policy_regulator_of(policy)->u0;
    lg_interval *rate;
    size_t function;
    bool jumps = false;
    APP_MUST(self, lg_program_find(program, "rate_by_input", &function, &error));
    APP_MUST(self, lg_interval_create(program, &function, 1, NULL, &rate, &error));
    const size_t inputs = lg_interval_inputs(rate), n = lg_interval_outputs(rate);
    APP_FREE double *low = app_alloc(2 * (inputs + n), sizeof *low);
    double *high = low + inputs, *out = high + inputs;
    APP_FREE uint8_t *flag = app_alloc(n, sizeof *flag);
    void *work = lg_alloc(self->context, lg_interval_work_size(rate), 1);
    for (size_t i = 0; i < inputs; i++) {
        const size_t l = i - n;
        low[i] = i < n ? -1e-9 : l < task->input_count ? u0[l] : 0;
        high[i] = i < n ? 1e-9 : low[i];
    }
    APP_MUST(self, lg_interval_eval(rate, 1, low, high, out, out + n, flag, work, &error));
    for (size_t i = 0; i < n; i++) jumps = jumps || flag[i] < LG_INTERVAL_CONTINUOUS;
    lg_free(self->context, work);
    lg_interval_destroy(rate);
    if (jumps)
        app_stop(self, LG_UNSUPPORTED,
                 "the plant's motion jumps at the goal, as where dry friction sticks: motions stop in a band "
                 "about the goal, and a proof that they reach a set that holds this band is not built. "
                 "Nothing is proved; test the policy by runs (evaluate)");
}

static lg_program *add_rate(const app *self, lg_policy *policy) {
    lg_program *program = NULL;
    APP_MUST(self, lg_policy_add_rate(policy, &program, &error));
    check_motion(self, policy, program);
    return program;
}

/* What the gate of a network says about the set; "": nothing. */
static char *tell_gate(const lg_policy *policy, const double *P, double level) {
    double ratio;
    if (P == NULL || lg_policy_bound_gate(policy, P, level, &ratio, NULL) != LG_OK)
        return app_format("%s", "");
    return app_format(" In the set the network's gate leaves at least %g %% of the input to the regulator "
                      "(its own V is at most %g of the level where the gate is half open).",
                      control_rounded_down(100 / (1 + exp(4.5 * (ratio - 1)))),
                      -control_rounded_down(-ratio));
}

/* Fills what is to be proved. Returns a policy with the gains that were chosen, which the caller owns, or
 * NULL. */
static lg_policy *prepare(app *self, lg_policy *given, control_naming names, wanted *what,
                          lg_program **program) {
    what->level = read_level(self, "level", values.level);
    what->eps = read_level(self, "eps", values.eps);
    read_box(self, names, what->low, what->high);
    read_model_error(self, given, names, what->high, what->error);
    *program = add_rate(self, given);
    if (values.lyapunov == POLYNOMIAL) add_polynomial(self, *program, names, what->low, what->high);
    if (values.lyapunov == FUNCTION && !has_function(self, *program, names, "lyapunov"))
        app_stop(self, LG_UNSUPPORTED, "the plant is no program with a function lyapunov (x)");
    if (values.lyapunov == QUADRATIC) search_form(self, given, names, what);
    if (!what->chosen) return NULL;
    APP_FREE char *source = NULL;
    lg_policy *own = control_read_policy(self, self->arguments[0], what->gains,
                                         names.task->input_count * names.n, &source);
    *program = add_rate(self, own);
    return own;
}

static lg_certify *begin_proof(const app *self, const lg_program *program, double period, const wanted *what,
                               lg_certify_spec *spec) {
    static const char *const functions[] = {[POLYNOMIAL] = "polynomial", [FUNCTION] = "lyapunov"};
    static const double unit[] = {[F64] = 0x1p-53, [F32] = 0x1p-24, [EXACT] = 0};
    const bool quadratic = values.lyapunov == QUADRATIC;
    lg_certify *certify = NULL;
    lg_certify_spec_init(spec);
    spec->program = program;
    spec->rate = values.loop ? "rate" : "rate_by_input";
    spec->control = values.loop ? NULL : "input_by_state";
    spec->period = period;
    spec->unit = values.loop ? 0 : unit[values.dtype];
    spec->P = quadratic ? what->P : NULL;
    spec->lyapunov = quadratic ? NULL : functions[values.lyapunov];
    spec->level = what->level, spec->eps = what->eps;
    spec->most = quadratic ? 0.98 : 0; /* the proposal has the level 1: more boxes would gain little */
    spec->low = what->low, spec->high = what->high, spec->model_error = what->error;
    spec->threads = (int)self->threads;
    APP_DO(self, lg_certify_create, spec, &certify);
    return certify;
}

static void write_certificate(const app *self, control_naming names, lg_certify_spec *spec,
                              const lg_certify_result *proved) {
    const char *own = self->arguments[0];
    lg_certificate file;
    if (spec->control == NULL) {
        spec->rate = "rate_by_input";
        spec->control = "input_by_state";
        spec->period = 0;
    }
    APP_DO(self, lg_certificate_make, spec, proved, INFINITY, &file);
    for (size_t i = 0; i < file.states; i++)
        (void)lg_format(file.names[i], sizeof file.names[i], "%s", control_name_of(names, i));
    (void)lg_format(file.plant, sizeof file.plant, "%s",
                    app_name_of(names.plant != NULL ? names.plant : own));
    (void)lg_format(file.controller, sizeof file.controller, "%s", app_name_of(own));
    APP_FILE(self, values.certificate, lg_certificate_save, &file);
    lg_certificate_destroy(&file);
}

static void prove(app *self, lg_policy *given, control_naming names) {
    wanted what = {.chosen = false};
    lg_program *program = NULL;
    lg_certify_result r;
    const double start = app_seconds();
    lg_policy *own = prepare(self, given, names, &what, &program);
    lg_certify_spec spec;
    lg_certify *certify = begin_proof(self, program, names.task->period, &what, &spec);
    const double left = values.seconds - (app_seconds() - start);
    APP_MUST(self, lg_certify_run(certify, SIZE_MAX, fmax(left, 0), &r, &error));
    control_proof v = {.r = r,
                       .sides = names.n,
                       .P = values.lyapunov == QUADRATIC ? what.P : NULL,
                       .gains = what.chosen ? what.gains : NULL};
    const bool rounded = spec.unit > 0 && isfinite(r.input_error);
    if (spec.unit > 0 && !rounded)
        app_warn(self, "the rounding of the controller has no bound, because it may decide a jump, or leave "
                       "the domain of an operation: the proof is about exact arithmetic");
    APP_FREE char *all = control_box_of(names);
    APP_FREE char *gate = tell_gate(given, v.P, r.level);
    APP_FREE char *more = app_format("%s%s", all, gate);
    APP_FREE char *claim = control_claim(self, names, values.loop, what.chosen, rounded, r.claim, more);
    APP_FREE char *late =
        app_format("neither proved nor refuted in %.3g s; --seconds allows more", values.seconds);
    v.r.claim = claim;
    v.r.reason = r.finished ? r.reason : late;
    v.r.input_error = rounded ? r.input_error : 0;
    v.r.seconds = app_seconds() - start;
    if (values.certificate != NULL && r.verified) write_certificate(self, names, &spec, &r);
    control_tell_proof(self, names, &v);
    lg_certify_destroy(certify);
    lg_policy_destroy(own);
}

static void run(app *self) {
    check_options(self);
    APP_FREE char *source = NULL;
    lg_policy *policy = control_read_policy(self, self->arguments[0], NULL, 0, &source);
    control_naming names = control_name_states(lg_policy_task_of(policy));
    names.plant = source;
    check_delays(self, names.task);
    (values.lyapunov == ENERGY ? prove_energy : prove)(self, policy, names);
    lg_policy_destroy(policy);
}

const app_command control_certify_command = {
    .name = "certify",
    .arguments = "POLICY.h5|TASK.yaml",
    .summary = "Prove from which states the closed loop goes to its goal",
    .details =
        "Interval arithmetic and branch and bound prove that V falls on {V <= c} inside of the box; nothing "
        "is sampled. A task is certified with its controller as it is before training. If the proof fails, "
        "the exit code is 1, and the result has the box of states where it fails. docs/certificates.md is "
        "the guide.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
