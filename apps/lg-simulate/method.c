/* Chooses the method, by name or from a file, with its variants, and checks whether it applies to the
 * system. */
#include "lg-simulate/simulate.h"

#include <string.h>
#include <unistd.h>

/* ---- which methods apply ---- */

const char *method_obstacle(const simulation *sim, const lg_scheme *scheme) {
    /* Why a scheme of this kind does not apply; NULL: it applies to all systems. */
    static const char *const reasons[LG_SCHEME_KINDS] = {
        [LG_SCHEME_SPLITTING] = "it splits H = K(p) + V(q), and the system is not separable",
        [LG_SCHEME_SLGI] = "it needs a system on the cotangent bundle of SO(3): heavy-top, form cotangent or "
                           "quadratic",
        [LG_SCHEME_VARIATIONAL] = "the system defines no discrete Lagrangian"};
    const bool fits = lg_stepper_size(scheme, &sim->ode[lg_system_coordinates_for(scheme)]) > 0;
    return fits ? NULL : reasons[scheme->kind];
}

/* Names of the methods: all, or only those that apply to the system (`applicable`), or that have adaptive
 * steps (`adaptive`). The caller frees the text. */
static char *method_names(const simulation *sim, bool applicable, bool adaptive) {
    lg_text names = app_text();
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if ((applicable && method_obstacle(sim, scheme) != NULL) || (adaptive && scheme->embedded_order == 0))
            continue;
        lg_text_add(&names, "%s%s", names.length > 0 ? ", " : "", scheme->name);
    }
    return names.data;
}

void check_control(const simulation *sim, const lg_scheme *scheme) {
    const app *self = sim->self;
    if (sim->values->steps > 0 || scheme->embedded_order > 0) return;
    app_stop_usage(self,
                   app_given(self, "tolerance") || app_given(self, "atol")
                       ? "--tolerance: '%s' does not estimate its error: give --steps N; adaptive methods: %s"
                       : "'%s' needs --steps N, because it does not estimate its error; adaptive methods: %s",
                   scheme->name, method_names(sim, true, true));
}

/* ---- choosing a method ---- */

method method_named(const simulation *sim, const char *option, const char *name) {
    const lg_scheme *scheme = lg_scheme_find(name);
    lg_scheme *file = NULL;
    if (scheme == NULL && (strpbrk(name, "./") != NULL || access(name, F_OK) == 0)) {
        APP_FILE(sim->self, name, lg_scheme_read, &file);
        scheme = file;
    }
    if (scheme == NULL)
        app_stop_usage(sim->self, "--%s: '%s' is not one of %s", option, name,
                       method_names(sim, false, false));
    const char *obstacle = method_obstacle(sim, scheme);
    if (obstacle != NULL)
        app_stop_usage(sim->self, "--%s: '%s' does not apply to %s: %s; methods that apply: %s", option,
                       scheme->name, sim->title, obstacle, method_names(sim, true, false));
    return (method){*scheme, file};
}

void method_free(method *what) {
    lg_scheme_destroy(what->file);
    *what = (method){.file = NULL};
}

void method_adjust(const simulation *sim, method *what) {
    lg_scheme *scheme = &what->scheme;
    const uint64_t terms = sim->values->dexpinv;
    const bool theta = app_given(sim->self, "theta"), dexpinv = app_given(sim->self, "dexpinv");
    if (theta && scheme->kind != LG_SCHEME_IMPLICIT && scheme->kind != LG_SCHEME_SLGI)
        app_stop_usage(sim->self,
                       "--theta: '%s' has no parameter theta; slgi, midpoint and implicit-euler have one",
                       scheme->name);
    if (dexpinv && (scheme->kind != LG_SCHEME_RKMK || scheme->ambient))
        app_stop_usage(sim->self, "--dexpinv: '%s' has no dexpinv; RKMK methods have one", scheme->name);
    if (theta) {
        scheme->theta = sim->values->theta;
        scheme->order = scheme->theta == 0.5 ? 2 : 1;
    }
    if (dexpinv) scheme->dexpinv = terms > LG_DEXPINV_MAX ? LG_DEXPINV_EXACT : (int)terms;
}

method method_choose(const simulation *sim) {
    const char *name = lg_space_is_abelian(lg_system_space(sim->system)) ? "dp54" : "rkmk54";
    method out = method_named(sim, "scheme", sim->values->scheme != NULL ? sim->values->scheme : name);
    method_adjust(sim, &out);
    return out;
}
