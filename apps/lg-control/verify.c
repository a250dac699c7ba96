/* lg-control verify: proves a certificate again. */
#include <string.h>

#include "core/core.h"
#include "lg-control/control_app.h"

static const lg_field options[] = {APP_BOUND(app_common, "Largest time of the proof", .value = "60"),
                                   LG_FIELD_END};

/* ---- the loop of a task or policy now ---- */

typedef struct comparison {
    bool compared, plant, controller, period, states;
    double held; /* of a certificate of continuous inputs: for how long they are held; otherwise 0 */
} comparison;

static comparison compare(const app *self, const lg_certificate *file, const char *path) {
    comparison c = {.compared = true};
    lg_program *program = NULL;
    APP_FREE char *source = NULL;
    lg_policy *policy = control_read_policy(self, path, NULL, 0, &source);
    APP_MUST(self, lg_policy_add_rate(policy, &program, &error));
    APP_MUST(self, lg_certificate_compare(file, program, "rate_by_input", "input_by_state", &c.plant,
                                          &c.controller, &error));
    const double period = lg_policy_task_of(policy)->period;
    c.held = file->period == 0 ? period : 0;
    c.period = c.held > 0 || file->period == period;
    c.states = control_has_states(policy, file);
    lg_policy_destroy(policy);
    return c;
}

/* Freed with free; "": the loop is the same */
static char *tell_difference(const comparison *c, const char *path) {
    APP_CLEAN(lg_text_destroy) lg_text text = app_text();
    const struct {
        bool same;
        const char *what;
    } parts[] = {{c->plant, "plant"},
                 {c->controller, "controller"},
                 {c->period, "period"},
                 {c->states, "list of states"}};
    for (size_t i = 0; c->compared && i < LG_COUNT(parts); i++)
        if (!parts[i].same)
            lg_text_add(&text, "%s%s", text.length > 0 ? " and another " : "another ", parts[i].what);
    return text.length == 0 ? app_format("%s", "")
                            : app_format("the certificate is about another loop: %s has %s", path, text.data);
}

/* ---- results ---- */

static void tell_box(app_json *out, const lg_certificate *file, const lg_certify_result *r) {
    app_json_open(out, "failed", '{');
    for (size_t i = 0; i < file->states && r->failed_low != NULL; i++) {
        const double side[2] = {r->failed_low[i], r->failed_high[i]};
        app_json_reals(out, file->names[i], side, 2);
        app_result_line(out, "fails at %s from %.6g to %.6g", file->names[i], side[0], side[1]);
    }
    app_json_close(out, '}');
}

static void tell(app *self, const lg_certificate *file, const lg_certify_result *r, const comparison *c,
                 const char *reason) {
    const bool verified = reason[0] == '\0';
    app_json *out = self->out;
    APP_PUT(out, LG_AS_FLAG("verified", verified), LG_AS_FLAG("converges", verified && r->converges),
            LG_TEXT("claim", r->claim, NULL));
    if (!verified) app_json_put(out, LG_TEXT("reason", reason, NULL));
    APP_PUT(out, LG_TEXT("plant", file->plant, file->plant_sha256),
            LG_TEXT("controller", file->controller, file->controller_sha256),
            LG_AS_TEXT("plant_sha256", file->plant_sha256),
            LG_AS_TEXT("controller_sha256", file->controller_sha256));
    if (c->compared)
        APP_PUT(out, LG_AS_FLAG("same_plant", c->plant), LG_AS_FLAG("same_controller", c->controller),
                LG_AS_FLAG("same_period", c->period && c->held == 0));
    APP_PUT(out, LG_REAL("level", r->level, NULL), LG_WHOLE("boxes", r->boxes, "examined"),
            LG_REAL("seconds", r->seconds, NULL));
    if (!r->verified) tell_box(out, file, r);
    app_result_end(self);
    if (!verified) app_stop(self, LG_CHECK_FAILED, "not proved: %s", reason);
}

static void run(app *self) {
    lg_certificate file;
    lg_certify *certify = NULL;
    lg_certify_result r;
    const char *path = self->arguments[0];
    APP_FILE(self, path, lg_certificate_load, &file);
    APP_MUST_FILE(self, path, lg_certify_open(self->context, &file, (int)self->threads, &certify, &error));
    const comparison c =
        self->argument_count > 1 ? compare(self, &file, self->arguments[1]) : (comparison){.compared = false};
    APP_MUST(self, lg_certify_run(certify, SIZE_MAX, app_common_given.seconds, &r, &error));
    APP_FREE char *other = tell_difference(&c, self->arguments[1]);
    APP_FREE char *late =
        app_format("not finished in %.3g s; --seconds allows more", app_common_given.seconds);
    const char *reason = !r.finished                        ? late
                         : !r.verified                      ? r.reason
                         : strcmp(r.claim, file.claim) != 0 ? "the file claims something else than its "
                                                              "numbers, which are proved"
                                                            : other;
    APP_CLEAN(lg_text_destroy) lg_text claim = app_text();
    lg_text_add(&claim, "%s", r.claim);
    if (c.held > 0) control_add_continuous(&claim, c.held);
    r.claim = claim.data;
    tell(self, &file, &r, &c, reason);
    lg_certify_destroy(certify);
    lg_certificate_destroy(&file);
}

const app_command control_verify_command = {
    .name = "verify",
    .arguments = "CERTIFICATE.json [POLICY.h5|TASK.yaml]",
    .summary = "Prove a certificate of certify again, from its file alone",
    .details =
        "Every box of the certificate is examined again with outward rounding, for the loop that the file "
        "holds. With a second file the loop is compared, operation by operation: the proof is about the "
        "plant and the controller in the certificate. If it is not proved, or the loop is another one, the "
        "exit code is 1. docs/certificates.md has the format.",
    .settings = APP_SETTINGS(APP_GIVEN(options, app_common_given)),
    .run = run};
