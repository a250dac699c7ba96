/* Proofs of lg-control certify: names of states, results, and the sentence of the claim. */
#include "lg-control/certify_report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

/* ---- names ---- */

const char *control_name_of(control_naming names, size_t i) {
    return i < names.positions ? names.of[i]->name : names.of[i]->velocity;
}

control_naming control_name_states(const lg_policy_task *task) {
    control_naming names = {.task = task};
    for (int velocity = 0; velocity < 2; velocity++)
        for (uint32_t i = 0; i < task->coordinate_count; i++) {
            const lg_policy_coordinate *c = &task->coordinate[i];
            if (velocity ? c->velocity[0] == '\0' : c->free) continue;
            names.of[names.n++] = c;
            names.positions += !velocity;
        }
    return names;
}

/* The state with this name; a velocity is also known as v and the name of its position. */
static size_t find_state(const app *self, control_naming names, const char *option, const char *name) {
    APP_CLEAN(lg_text_destroy) lg_text known = app_text();
    for (size_t i = 0; i < names.n; i++) {
        if (strcmp(name, control_name_of(names, i)) == 0 ||
            (i >= names.positions && name[0] == 'v' && strcmp(name + 1, names.of[i]->name) == 0))
            return i;
        lg_text_add(&known, "%s%s", i > 0 ? ", " : "", control_name_of(names, i));
    }
    app_stop_usage(self, "%s: there is no state '%s'; the states are %s", option, name, known.data);
}

/* "NAME=number,..." */
void control_read_states(const app *self, control_naming names, const char *option, const char *given,
                         double *out) {
    bool seen[CONTROL_STATES] = {false};
    APP_FREE char *text = app_format("%s", given);
    char *rest = NULL;
    for (char *entry = strtok_r(text, ",", &rest); entry != NULL; entry = strtok_r(NULL, ",", &rest)) {
        char *number = strchr(entry, '=');
        double x = 0;
        if (number == NULL) app_stop_usage(self, "%s: '%s' is not NAME=number", option, entry);
        *number++ = '\0';
        const size_t i = find_state(self, names, option, entry);
        if (lg_number_parse(number, &x) != LG_OK || !(x > 0))
            app_stop_usage(self, "%s: %s: '%s' is not a number above 0", option, entry, number);
        if (seen[i]) app_stop_usage(self, "%s: '%s' stands twice", option, entry);
        seen[i] = true;
        out[i] = x;
    }
}

bool control_has_states(const lg_policy *policy, const lg_certificate *file) {
    const control_naming names = control_name_states(lg_policy_task_of(policy));
    bool has = names.n == file->states;
    for (size_t i = 0; has && i < names.n; i++)
        has = strncmp(control_name_of(names, i), file->names[i], LG_CERTIFICATE_NAME - 1) == 0;
    return has;
}

/* ---- results ---- */

/* Why it is not proved, with the box. */
static char *tell_reason(app_json *out, control_naming names, const control_proof *v) {
    lg_text text = app_text();
    lg_text_add(&text, "%s", v->r.reason);
    app_json_open(out, "failed", '{');
    for (size_t i = 0; i < v->sides && v->r.failed_low != NULL; i++) {
        const double goal = i < names.positions ? names.of[i]->goal[0] : 0;
        const double side[2] = {goal + v->r.failed_low[i], goal + v->r.failed_high[i]};
        app_json_reals(out, control_name_of(names, i), side, 2);
        lg_text_add(&text, "%s%s from %.6g to %.6g", i == 0 ? ", at " : ", ", control_name_of(names, i),
                    side[0], side[1]);
    }
    app_json_close(out, '}');
    return text.data;
}

/* The quadratic form, and gains in the form that a task takes. */
static void tell_forms(app_json *out, control_naming names, const control_proof *v) {
    APP_CLEAN(lg_text_destroy) lg_text line = app_text();
    const size_t n = v->sides, count = names.task->input_count * n;
    if (v->P != NULL) app_json_reals(out, "P", v->P, n * n);
    if (v->gains != NULL) app_json_reals(out, "gains", v->gains, count);
    for (size_t i = 0; i < count && v->gains != NULL; i++)
        lg_text_add(&line, "%s%.6g", i > 0 ? ", " : "", v->gains[i]);
    if (v->gains != NULL)
        app_result_line(out, "chosen for a large set: controller: {kind: lqr, gains: [%s]}", line.data);
}

double control_six_digits(double x) {
    char text[32];
    (void)lg_format(text, sizeof text, "%.6g", x);
    return lg_real(text, NULL);
}

/* A number of at most 6 digits that is not above x. */
double control_rounded_down(double x) {
    double out = control_six_digits(x);
    for (int i = 1; i <= 10 && !(out <= x); i++) out = control_six_digits(x - i * 1e-6 * fabs(x));
    return out;
}

void control_tell_proof(app *self, control_naming names, const control_proof *v) {
    const lg_certify_result *r = &v->r;
    app_json *out = self->out;
    APP_PUT(out, LG_AS_FLAG("verified", r->verified), LG_AS_FLAG("global", r->verified && v->global),
            LG_AS_FLAG("converges", r->converges), LG_TEXT("claim", r->claim, NULL));
    APP_FREE char *reason = r->verified ? NULL : tell_reason(out, names, v);
    if (!r->verified) app_json_put(out, LG_TEXT("reason", reason, NULL));
    if (!v->global) app_result_real(out, "level", control_rounded_down(r->level), NULL);
    if (v->global)
        app_result_real(out, "margin", control_rounded_down(v->margin),
                        "of the input's force over the potential's");
    else if (v->turns)
        app_result_real(out, "angle", control_rounded_down(v->margin),
                        "radians: all rotations at rest up to it are in the set");
    else
        APP_PUT(out, LG_REAL("volume", control_rounded_down(r->volume), "of {V <= level}, a lower bound"),
                LG_REAL("fraction", control_rounded_down(r->fraction), "of the box"));
    if (r->width != NULL)
        app_json_put(out, LG_REALS("width", r->width, v->sides,
                                   "the set's largest distance from the goal in each state"));
    if (r->input_error > 0) app_json_real(out, "input_error", r->input_error);
    if (r->input_error > 0 && r->verified) app_json_real(out, "eps_rounded", r->eps_rounded);
    tell_forms(out, names, v);
    APP_PUT(out, LG_WHOLE("boxes", r->boxes, "examined"), LG_REAL("seconds", r->seconds, NULL));
    app_result_end(self);
    if (!r->verified) app_stop(self, LG_CHECK_FAILED, "not proved: %s", reason);
}

/* ---- the claim ---- */

/* The name of a file with the first digits of the hash of its bytes. */
static char *name_file(const app *self, const char *path) {
    char text[LG_SHA256_TEXT];
    lg_sha256 state;
    lg_sha256_init(&state);
    APP_MUST_FILE(self, path, app_hash_file(path, &state, &error));
    lg_sha256_finish(&state, text);
    return app_format("%s (SHA-256 %.12s)", app_name_of(path), text);
}

void control_add_continuous(lg_text *claim, double period) {
    lg_text_add(claim,
                " It is about inputs that follow the state at all times; the controller holds them for %g.",
                period);
}

/* The sentence of a proof, with what it is about before it, and what it covers after it. */
char *control_claim(const app *self, control_naming names, bool continuous, bool chosen, bool rounded,
                    const char *proof, const char *more) {
    const char *path = self->arguments[0], *rest = strchr(proof, ':');
    const char *of_kind = lg_policy_kind_name(names.task->kind);
    APP_FREE char *own = name_file(self, path);
    lg_text text = app_text();
    lg_text_add(&text, "%.*s, for the ", (int)(rest - proof), proof);
    if (names.plant != NULL) {
        APP_FREE char *of = name_file(self, names.plant);
        lg_text_add(&text, "plant %s and the controller of kind %s of %s%s", of, of_kind, own,
                    chosen ? " with gains that were chosen" : "");
    } else {
        lg_text_add(&text, "plant and the controller of kind %s in %s", of_kind, own);
    }
    lg_text_add(&text, ":%s%s Inputs stay in their limits.", proof[0] == 'N' ? " that" : "", rest + 1);
    if (continuous) control_add_continuous(&text, names.task->period);
    for (uint32_t i = 0; i < names.task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &names.task->coordinate[i];
        const bool oldest =
            i + 1 == names.task->coordinate_count || names.task->coordinate[i + 1].ago <= c->ago;
        if (c->ago > 0 && oldest)
            lg_text_add(
                &text,
                " The input %s acts %u period%s late; the set also holds past inputs beyond the limits.",
                names.task->input[c->follows - 1].name, c->ago, c->ago > 1 ? "s" : "");
    }
    lg_text_add(
        &text,
        "%s Not covered: disturbances, noise of sensors, what the key robust adds, and the rounding of %s.",
        more, rounded ? "their numbers" : "the controller (2^-53 of its numbers, of an export in f32 2^-24)");
    return text.data;
}

char *control_box_of(control_naming names) {
    lg_text text = app_text();
    lg_text_add(&text, " The box is of ");
    for (size_t i = 0; i < names.n; i++)
        lg_text_add(&text, "%s%s", i > 0 ? ", " : "", control_name_of(names, i));
    lg_text_add(&text, ", counted from the goal.");
    return text.data;
}
