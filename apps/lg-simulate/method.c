/* Which method: by name or from a file, its variants, and whether it applies to the system. */
#include "lg-simulate/simulate.h"

#include <stdlib.h>
#include <string.h>

/* ---- what applies ---- */

static bool on_cotangent_group(const simulation *sim) {
    const lg_space *space = lg_system_space(sim->system);
    if (space->factor[0].kind != LG_SPACE_SE3 || space->factor[0].count != 1) return false;
    return space->factors == 1 ||
           (space->factors == 2 && space->factor[1].kind == LG_SPACE_RN && space->factor[1].count % 2 == 0);
}

static bool has_variational_step(const simulation *sim) {
    return sim->ode[LG_COORDINATES_LIE].step != NULL || sim->ode[LG_COORDINATES_AMBIENT].step != NULL;
}

static bool is_separable(const simulation *sim) {
    return lg_system_separable(sim->system);
}

/* What a kind of scheme asks of the system; those without a row ask for nothing. */
static const struct {
    bool (*fits)(const simulation *sim);
    const char *reason;
} demands[LG_SCHEME_KINDS] = {
    [LG_SCHEME_SPLITTING] = {is_separable, "it splits H = K(p) + V(q), and the system is not separable"},
    [LG_SCHEME_SLGI] = {on_cotangent_group,
                        "it needs a system on the cotangent bundle of SO(3): heavy-top, form cotangent or "
                        "quadratic"},
    [LG_SCHEME_VARIATIONAL] = {has_variational_step, "the system has no discrete Lagrangian of its own"}};

const char *method_obstacle(const simulation *sim, const lg_scheme *scheme) {
    if (demands[scheme->kind].fits == NULL || demands[scheme->kind].fits(sim)) return NULL;
    return demands[scheme->kind].reason;
}

char *method_names(const simulation *sim, bool applicable, bool adaptive) {
    char *names = app_format("%s", "");
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if ((applicable && method_obstacle(sim, scheme) != NULL) || (adaptive && scheme->embedded_order == 0))
            continue;
        char *longer = app_format("%s%s%s", names, names[0] != '\0' ? ", " : "", scheme->name);
        free(names);
        names = longer;
    }
    return names;
}

static int refuse_if_impossible(const simulation *sim, const char *option, const lg_scheme *scheme) {
    const char *obstacle = method_obstacle(sim, scheme);
    if (obstacle == NULL) return APP_EXIT_OK;
    char *names = method_names(sim, true, false);
    const char *form = lg_system_form(sim->system);
    const int code = app_usage(sim->self, "--%s: '%s' does not apply to %s%s%s: %s; methods that apply: %s",
                               option, scheme->name, lg_system_name(sim->system), form != NULL ? ", " : "",
                               form != NULL ? form : "", obstacle, names);
    free(names);
    return code;
}

/* ---- choosing ---- */

int method_named(const simulation *sim, const char *option, const char *name, method *out) {
    const lg_scheme *scheme = lg_scheme_find(name);
    if (scheme == NULL) {
        char *names = method_names(sim, false, false);
        const int code = app_usage(sim->self, "--%s: '%s' is not one of %s", option, name, names);
        free(names);
        return code;
    }
    *out = (method){.scheme = *scheme};
    return refuse_if_impossible(sim, option, scheme);
}

int method_read(const simulation *sim, const char *path, method *out) {
    lg_error error = {LG_OK, ""};
    lg_scheme *file = NULL;
    const lg_status status = lg_scheme_read(sim->self->context, path, &file, &error);
    if (status != LG_OK) return app_fail_file(sim->self, status, &error, path);
    *out = (method){*file, file};
    return refuse_if_impossible(sim, "scheme", file);
}

void method_free(method *what) {
    lg_scheme_destroy(what->file);
    *what = (method){.file = NULL};
}

static int set_theta(const simulation *sim, lg_scheme *scheme) {
    if (scheme->kind != LG_SCHEME_IMPLICIT && scheme->kind != LG_SCHEME_SLGI)
        return app_usage(sim->self,
                         "--theta: '%s' has no such parameter; slgi, midpoint and implicit-euler have",
                         scheme->name);
    scheme->theta = sim->values->theta;
    scheme->order = scheme->theta == 0.5 ? 2 : 1;
    return APP_EXIT_OK;
}

static int set_dexpinv(const simulation *sim, lg_scheme *scheme) {
    const char *text = sim->values->dexpinv;
    uint64_t terms = 0;
    const bool exact = strcmp(text, "exact") == 0;
    if (!exact && (!app_parse_size(text, &terms) || terms > LG_DEXPINV_MAX))
        return app_usage(sim->self, "--dexpinv: '%s' is neither `exact` nor a whole number up to %d", text,
                         LG_DEXPINV_MAX);
    if (scheme->kind != LG_SCHEME_RKMK || scheme->ambient)
        return app_usage(sim->self, "--dexpinv: '%s' has no dexpinv; RKMK methods have one", scheme->name);
    scheme->dexpinv = exact ? LG_DEXPINV_EXACT : (int)terms;
    return APP_EXIT_OK;
}

int method_choose(const simulation *sim, method *out) {
    const simulate_values *values = sim->values;
    const char *name = values->method != NULL                              ? values->method
                       : lg_space_is_abelian(lg_system_space(sim->system)) ? "dp54"
                                                                           : "rkmk54";
    int code = values->scheme != NULL ? method_read(sim, values->scheme, out)
                                      : method_named(sim, "method", name, out);
    if (code == APP_EXIT_OK && app_given(sim->self, "theta")) code = set_theta(sim, &out->scheme);
    if (code == APP_EXIT_OK && values->dexpinv != NULL) code = set_dexpinv(sim, &out->scheme);
    return code;
}
