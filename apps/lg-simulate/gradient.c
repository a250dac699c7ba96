/* J = sum w_k y_k at the final time, and its gradient with respect to the start and the parameters. */
#include "lg-simulate/simulate.h"

#include "files/read_file.h"

#include <string.h>

enum { MAX_TEXT = 1 << 26 };

/* ---- weights ---- */

void gradient_read(const simulation *sim, gradient *out) {
    static const char between[] = ", \t\r\n";
    const char *given = sim->values->gradient;
    const bool from_file = given[0] == '@';
    size_t count = 0, used = 0;
    APP_FREE char *text = from_file ? app_alloc(MAX_TEXT, 1) : app_format("%s", given);
    if (from_file)
        APP_MUST_FILE(sim->self, given + 1, lg_read_first(given + 1, text, MAX_TEXT - 1, &used, &error));
    if (from_file && (used == MAX_TEXT - 1 || strlen(text) != used))
        app_stop(sim->self, LG_FILE, "%s: is not a list of numbers", given + 1);
    *out = (gradient){.count = sim->reported, .weights = app_keep(sim->dim, sizeof *out->weights)};
    for (char *rest = text, *word; (word = strtok_r(rest, between, &rest)) != NULL; count++) {
        double value;
        if (lg_number_parse(word, &value) != LG_OK)
            app_stop_usage(sim->self, "--gradient: '%.40s' is not a number", word);
        if (count < sim->reported) out->weights[count] = value;
    }
    if (count != sim->reported)
        app_stop_usage(sim->self, "--gradient: %zu weights, but the state has %zu numbers: %s", count,
                       sim->reported, lg_system_layout(sim->system));
}

/* ---- the gradient ---- */

typedef struct functional {
    const simulation *sim;
    lg_coordinates coordinates;
    const double *weights;
    size_t steps;
    lg_system_taped_user user;
} functional;

static lg_status bind(void *user, lg_tape *tape, lg_var parameters, lg_taped_ode *ode) {
    functional *self = user;
    return lg_system_taped_ode(self->sim->system, self->coordinates, parameters, ode, &self->user);
}

static lg_status source(void *user, size_t n, double t, const double *y, double *slope) {
    const functional *self = user;
    if (app_interrupted()) return LG_CANCELLED;
    for (size_t i = 0; n == self->steps && i < self->sim->dim; i++) slope[i] += self->weights[i];
    return LG_OK;
}

void gradient_compute(const simulation *sim, const lg_scheme *scheme, const watch *seen, gradient *out) {
    const app *self = sim->self;
    lg_error error = {LG_OK, ""};
    lg_adjoint_problem problem;
    const lg_coordinates coordinates = lg_system_coordinates_for(scheme);
    functional user = {.sim = sim, .coordinates = coordinates, .weights = out->weights, .steps = seen->steps};
    APP_FREE double *end = app_alloc(sim->dim, sizeof *end);
    out->dy0 = app_keep(sim->dim, sizeof *out->dy0);
    out->dparameters = app_keep(lg_system_parameter_count(sim->system), sizeof *out->dparameters);
    lg_adjoint_problem_init(&problem);
    problem.scheme = scheme;
    problem.ode = &sim->ode[coordinates];
    problem.bind = bind;
    problem.parameters = lg_system_parameter_values(sim->system);
    problem.parameter_count = lg_system_parameter_count(sim->system);
    problem.source = source;
    problem.user = &user;
    problem.t = seen->t;
    problem.h = seen->h;
    problem.steps = seen->steps;
    problem.checkpoints =
        sim->values->checkpoints < seen->steps ? (size_t)sim->values->checkpoints : seen->steps;
    const lg_status status = lg_adjoint_gradient(self->context, &problem, sim->scene.state, end, out->dy0,
                                                 out->dparameters, &out->stats, &error);
    if (status == LG_CANCELLED) app_stop(self, status, "stopped by %s", app_stopper());
    if (status == LG_UNSUPPORTED)
        app_stop_usage(self, "--gradient: '%s' cannot be differentiated on %s; rkmk4 can", scheme->name,
                       sim->title);
    if (status != LG_OK)
        app_stop(self, status, "--gradient with %s: %s", scheme->name, app_sentence(status, &error));
    lg_space_project_gradient(lg_system_space(sim->system), sim->scene.state, out->dy0);
    for (size_t i = 0; i < sim->reported; i++) out->j += out->weights[i] * end[i];
}
