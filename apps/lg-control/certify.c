/* lg-control certify: proves where a closed loop goes to its goal. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-control/control_app.h"
#include "liegrad/certify.h"
#include "liegrad/lyapunov.h"

typedef enum kind { QUADRATIC, POLYNOMIAL, ENERGY } kind;

typedef struct certify_values {
    uint32_t lyapunov;
    const char *box, *level, *model_error;
    double seconds;
    uint64_t degree;
    bool held;
} certify_values;

static const lg_field options[] = {
    LG_OPTION(certify_values, lyapunov, NAME, "KIND",
              "V: the regulator's P, a polynomial by linear programming, or the energy of a pendulum",
              LG_NAMES("quadratic", "polynomial", "energy"), .value = "quadratic"),
    LG_OPTION(certify_values, box, STRING, "NAME=W,...",
              "The box of states: for each position and velocity its largest distance from the goal",
              .otherwise = "unbounded"),
    LG_OPTION(certify_values, level, STRING, "C",
              "The level c of {V <= c}, or auto: the largest that is found", .value = "auto"),
    LG_FIELD(
        certify_values, NULL, "model_error", STRING, model_error, .unit = "D",
        .meaning =
            "Bound of the error of the model's accelerations (with --held: of the next state; of a plant "
            "that is a program: of all rates), as one number or as NAME=D,...",
        .otherwise = "0"),
    LG_OPTION(certify_values, seconds, REAL, "s", "Largest time of the proof", .high = 1e9, .above = true,
              .value = "60"),
    LG_OPTION(certify_values, degree, U64, "n", "Degree of the polynomial, even", .low = 2, .high = 12,
              .value = "8"),
    LG_OPTION(certify_values, held, SWITCH, NULL, "Prove it for inputs that are held over a period"),
    LG_FIELD_END};

static certify_values values;

/* ---- names ---- */

typedef struct naming {
    const lg_policy_task *task;
    size_t n; /* numbers of z: positions, then velocities */
} naming;

static const char *name_of(naming names, size_t i) {
    const uint32_t count = names.task->coordinate_count;
    return i < count ? names.task->coordinate[i].name : names.task->coordinate[i - count].velocity;
}

static naming name_states(const lg_policy_task *task) {
    return (naming){task, (size_t)task->coordinate_count * (task->coordinate[0].velocity[0] != '\0' ? 2 : 1)};
}

/* The state with this name; a velocity is also known as v and the name of its position. */
static size_t find_state(const app *self, naming names, const char *option, const char *name) {
    lg_text known = app_text();
    for (size_t i = 0; i < names.n; i++) {
        const uint32_t count = names.task->coordinate_count;
        if (strcmp(name, name_of(names, i)) == 0 ||
            (i >= count && name[0] == 'v' && strcmp(name + 1, name_of(names, i - count)) == 0))
            return i;
        lg_text_add(&known, "%s%s", i > 0 ? ", " : "", name_of(names, i));
    }
    app_stop_usage(self, "%s: there is no state '%s'; the states are %s", option, name, known.data);
}

/* "NAME=number,..." */
static void read_states(const app *self, naming names, const char *option, const char *given, double *out) {
    bool seen[2 * LG_POLICY_COORDINATES] = {false};
    APP_FREE char *text = app_format("%s", given);
    char *rest = NULL;
    for (char *entry = strtok_r(text, ",", &rest); entry != NULL; entry = strtok_r(NULL, ",", &rest)) {
        char *number = strchr(entry, '=');
        double x = 0;
        if (number == NULL) app_stop_usage(self, "%s: '%s' is not NAME=number", option, entry);
        *number++ = '\0';
        const size_t i = find_state(self, names, option, entry);
        if (!app_parse_real(number, &x) || !(x > 0))
            app_stop_usage(self, "%s: %s: '%s' is not a number above 0", option, entry, number);
        if (seen[i]) app_stop_usage(self, "%s: '%s' stands twice", option, entry);
        seen[i] = true;
        out[i] = x;
    }
}

static void read_box(const app *self, naming names, double *low, double *high) {
    for (size_t i = 0; i < names.n; i++) high[i] = INFINITY;
    if (values.box != NULL) read_states(self, names, "--box", values.box, high);
    for (size_t i = 0; i < names.n; i++) {
        low[i] = -high[i];
        if (values.lyapunov == POLYNOMIAL && !isfinite(high[i]))
            app_stop_usage(self, "--box: a polynomial needs a bound of every state; %s has none",
                           name_of(names, i));
    }
}

/* One number is for the rates that the model states: the accelerations, or all rates of a program; of a
 * held loop for all states. */
static void read_model_error(const app *self, naming names, double *out) {
    double x;
    const uint32_t positions = names.task->coordinate_count;
    for (size_t i = 0; i < names.n; i++) out[i] = 0;
    if (values.model_error == NULL) return;
    if (strchr(values.model_error, '=') != NULL) {
        read_states(self, names, "--model-error", values.model_error, out);
    } else {
        if (!app_parse_real(values.model_error, &x) || !(x >= 0))
            app_stop_usage(self, "--model-error: '%s' is not a number of at least 0", values.model_error);
        for (size_t i = values.held || names.n == positions ? 0 : positions; i < names.n; i++) out[i] = x;
    }
    for (size_t i = 0; !values.held && names.n > positions && i < positions; i++)
        if (out[i] > 0)
            app_stop_usage(self, "--model-error: %s is a position, whose rate is its velocity, without error",
                           name_of(names, i));
}

static double read_level(const app *self) {
    double c = 0;
    if (strcmp(values.level, "auto") != 0 && (!app_parse_real(values.level, &c) || !(c > 0)))
        app_stop_usage(self, "--level: '%s' is neither auto nor a number above 0", values.level);
    return c;
}

static void check_options(const app *self) {
    static const char *const useless[] = {"level", "model-error"};
    if (values.held && values.lyapunov != QUADRATIC) app_stop_usage(self, "--held: steps need a quadratic V");
    if (values.degree % 2 != 0) app_stop_usage(self, "--degree: expected an even number");
    for (size_t i = 0; values.lyapunov == ENERGY && i < LG_COUNT(useless); i++)
        if (app_given(self, useless[i]))
            app_stop_usage(self, "--%s: the energy proves all states at once, for the model as it is",
                           useless[i]);
}

/* ---- the policy ---- */

static lg_policy *read_policy(const app *self) {
    const char *path = self->arguments[0], *dot = strrchr(path, '.');
    lg_policy *policy = NULL;
    if (dot == NULL || (strcmp(dot, ".yaml") != 0 && strcmp(dot, ".yml") != 0)) {
        APP_MUST_FILE(self, path, lg_policy_load(self->context, path, NULL, &policy, NULL, &error));
        return policy;
    }
    lg_policy_task task;
    APP_FREE char *text = NULL;
    lg_program *plant = control_read_task(self, path, &task, &text);
    APP_MUST(self, lg_policy_create(self->context, &task, plant, self->seed, &policy, &error));
    if (lg_policy_parameters(policy) > 0)
        app_warn(self, "%s is a task: its controller of kind %s is not trained", path,
                 lg_policy_kind_name(task.kind));
    return policy;
}

/* ---- results ---- */

/* What both kinds of proofs say. */
typedef struct verdict {
    bool verified, global, converges;
    double level, volume, fraction, margin; /* margin: of the energy; NaN: none */
    size_t boxes;
    double seconds;
    const char *claim, *reason;
    const double *low, *high; /* the box that failed, from the goal; NULL: none */
    size_t sides;
} verdict;

static void tell_box(app_json *out, naming names, const verdict *v) {
    app_json_open(out, "failed", '{');
    for (size_t i = 0; i < v->sides && v->low != NULL; i++) {
        const double goal = i < names.task->coordinate_count ? names.task->coordinate[i].goal[0] : 0;
        const double side[2] = {goal + v->low[i], goal + v->high[i]};
        app_json_reals(out, name_of(names, i), side, 2);
        app_result_line(out, "fails at %s from %.6g to %.6g", name_of(names, i), side[0], side[1]);
    }
    app_json_close(out, '}');
}

static int tell(app *self, naming names, const verdict *v) {
    app_json out;
    app_result_begin(&out, self);
    app_json_bool(&out, "verified", v->verified);
    app_json_bool(&out, "global", v->verified && v->global);
    app_json_bool(&out, "converges", v->converges);
    app_result_text(&out, "claim", v->claim, NULL);
    if (!v->verified) app_result_text(&out, "reason", v->reason, NULL);
    if (values.lyapunov == ENERGY) {
        app_result_real(&out, "margin", v->margin, "of the input's force over the potential's");
    } else {
        app_result_real(&out, "level", v->level, NULL);
        app_result_real(&out, "volume", v->volume, "of {V <= level}, a lower bound");
        app_result_real(&out, "fraction", v->fraction, "of the box");
    }
    app_result_size(&out, "boxes", v->boxes, "examined");
    app_result_real(&out, "seconds", v->seconds, NULL);
    if (!v->verified) tell_box(&out, names, v);
    app_json_warnings(&out, self);
    app_json_end(&out);
    if (v->verified) return APP_EXIT_OK;
    return app_fail(self, LG_CHECK_FAILED, "not proved: %s", v->reason);
}

static char *name_all(naming names) {
    lg_text text = app_text();
    for (size_t i = 0; i < names.n; i++) lg_text_add(&text, "%s%s", i > 0 ? ", " : "", name_of(names, i));
    return text.data;
}

/* ---- proofs ---- */

static int prove_energy(app *self, lg_policy *policy, naming names) {
    lg_certify_energy_spec spec;
    lg_certify_energy_result r;
    double low[2 * LG_POLICY_COORDINATES], high[2 * LG_POLICY_COORDINATES];
    const double start = app_seconds();
    read_box(self, names, low, high); /* only its names are checked: the proof is for every state */
    APP_MUST(self, lg_policy_add_slope(policy, &spec, &error));
    APP_MUST(self, lg_certify_energy(self->context, &spec, &r, &error));
    APP_FREE char *claim =
        app_format("%s That the mass, the damping and the map of the input are constant was "
                   "compared at several states, it was not proved.",
                   r.claim);
    const verdict v = {.verified = r.verified,
                       .global = true,
                       .converges = r.verified,
                       .margin = r.margin,
                       .boxes = r.boxes,
                       .seconds = app_seconds() - start,
                       .claim = claim,
                       .reason = r.reason,
                       .low = &r.failed_low,
                       .high = &r.failed_high,
                       .sides = 1};
    return tell(self, names, &v);
}

static void add_polynomial(const app *self, lg_program *program, const double *low, const double *high) {
    lg_lyapunov_spec spec;
    lg_lyapunov_spec_init(&spec);
    spec.rate = "rate";
    spec.name = "lyapunov";
    spec.low = low;
    spec.high = high;
    spec.degree = (int)values.degree;
    spec.decay = 1e-2;
    spec.seed = self->seed;
    APP_MUST(self, lg_lyapunov_polynomial(program, &spec, &error));
}

static int prove(app *self, lg_policy *policy, naming names) {
    double low[2 * LG_POLICY_COORDINATES], high[2 * LG_POLICY_COORDINATES], off[2 * LG_POLICY_COORDINATES];
    lg_program *program = NULL;
    lg_certify *certify = NULL;
    lg_certify_spec spec;
    lg_certify_result r;
    const double start = app_seconds();
    lg_certify_spec_init(&spec);
    spec.level = read_level(self);
    read_box(self, names, low, high);
    read_model_error(self, names, off);
    APP_MUST(self, lg_policy_add_rate(policy, &program, &error));
    if (values.lyapunov == POLYNOMIAL) add_polynomial(self, program, low, high);
    spec.program = program;
    spec.rate = values.held ? "advance" : "rate";
    spec.step = values.held;
    spec.P = values.lyapunov == QUADRATIC ? lg_policy_regulator_of(policy)->P : NULL;
    spec.lyapunov = values.lyapunov == QUADRATIC ? NULL : "lyapunov";
    spec.low = low, spec.high = high, spec.model_error = off;
    spec.threads = (int)self->threads;
    APP_MUST(self, lg_certify_create(self->context, &spec, &certify, &error));
    const double left = values.seconds - (app_seconds() - start);
    APP_MUST(self, lg_certify_run(certify, SIZE_MAX, fmax(left, 0), &r, &error));
    APP_FREE char *all = name_all(names);
    APP_FREE char *claim = app_format("%s The box is of %s, counted from the goal.", r.claim, all);
    const verdict v = {.verified = r.verified,
                       .converges = r.converges,
                       .level = r.level,
                       .volume = r.volume,
                       .fraction = r.fraction,
                       .boxes = r.boxes,
                       .seconds = app_seconds() - start,
                       .claim = claim,
                       .reason = r.reason,
                       .low = r.failed_low,
                       .high = r.failed_high,
                       .sides = names.n};
    const int code = tell(self, names, &v);
    lg_certify_destroy(certify);
    return code;
}

static int run(app *self) {
    check_options(self);
    lg_policy *policy = read_policy(self);
    const naming names = name_states(lg_policy_task_of(policy));
    const int code = (values.lyapunov == ENERGY ? prove_energy : prove)(self, policy, names);
    lg_policy_destroy(policy);
    return code;
}

const app_command certify_command = {
    .name = "certify",
    .arguments = "POLICY.h5|TASK.yaml",
    .summary = "Prove from which states the closed loop goes to its goal",
    .details =
        "Interval arithmetic and branch and bound prove that V falls on {V <= c} inside of the box; nothing "
        "is sampled. A task is certified with its controller as it is before training. If the proof fails, "
        "the "
        "exit code "
        "is 1, and the result has the box of states where it fails. docs/certificates.md is the guide.",
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
