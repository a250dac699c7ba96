/* The trainer of Hamiltonians: how one is learned from trajectories. */
#include "hamiltonian/files/recipe.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hamiltonian/files/constrained.h"
#include "hamiltonian/learned.h"
#include "model/files/program_file.h"
#include "model/files/training.h"

enum { STREAM_WEIGHTS = 1 };

const lg_field lg_hamiltonian_options[] = {
    LG_OPTION(lg_hamiltonian_state, newton, SWITCH, NULL,
              "After the last epoch, minimise the loss to rounding by Newton's method on all data (for few "
              "parameters)"),
    LG_OPTION(
        lg_hamiltonian_state, constraint, STRING, "FILE.h5",
        "A file with the function constraint (q) -> g, for states q p with g(q) = 0; it replaces the one "
        "in the data",
        .file = LG_FILE_READ),
    LG_FIELD_END};

/* ---- the data ---- */

static lg_status read_data(lg_training *self, lg_error *error) {
    const lg_hamiltonian_run *run = self->run;
    lg_trajectories *data = &((lg_hamiltonian_state *)self->state)->data;
    const char *path = self->paths[0];
    lg_read_options reading;
    lg_read_options_init(&reading);
    reading.project_starts = self->given(self, "initial-states") || self->resumed;
    LG_CLEAN(lg_program_destroy_at) lg_program *constraint = NULL;
    const char *file = ((const lg_hamiltonian_state *)self->state)->constraint;
    if (file != NULL) LG_TRY(lg_program_load(self->context, file, NULL, &constraint, error));
    const lg_hamiltonian_file *model = self->file; /* evaluate: the constraint of the model */
    reading.constraint = constraint;
    if (constraint == NULL && model != NULL && model->constraint != NULL)
        reading.constraint = lg_constraint_program(model->constraint);
    LG_TRY(lg_trajectories_read(self->context, path, &reading, data, error));
    if (data->starts_off > 1e-6 && run->starts == LG_START_MEASURED)
        LG_WARN(self,
                "%s: the first points were off the manifold by up to %.2g and are projected onto it; if they "
                "are noisy, --initial-states estimated learns them",
                path, data->starts_off);
    if (data->guessed)
        LG_WARN(self,
                "%s: the attributes system and layout are both missing: the %u numbers of each point are "
                "taken as a state of family %s (%s)",
                path, data->state_dim, data->family->name, data->family->formula);
    if (data->system[0] != '\0' && lg_system_parameters(data->system, NULL) == NULL)
        LG_WARN(self,
                "%s: attribute system: '%s' is not a known system: from attribute layout, the data are taken "
                "as states of family %s (%s)",
                path, data->system, data->family->name, data->family->formula);
    lg_warn_of_inputs(self->context, path, data);
    memcpy(self->sha256, data->sha256, sizeof self->sha256);
    return LG_OK;
}

static void close_data(lg_training *self) {
    lg_trajectories_destroy(&((lg_hamiltonian_state *)self->state)->data);
}

/* ---- the run ---- */

/* Values of options in a preset. `family` (NULL: any family) and `least` (lowest n) restrict a row. Later
 * rows override earlier ones; options without a row keep their default. */
static const struct {
    const char *preset, *option, *value, *family;
    uint32_t least;
} preset_rows[] = {
    {"thesis", "optimizer", "adam", NULL, 0},    {"thesis", "hidden", "100,100,100", NULL, 0},
    {"thesis", "epochs", "100", NULL, 0},        {"thesis", "prior", "0", NULL, 0},
    {"thesis", "scaled", "no", NULL, 0},         {"thesis", "units", "given", NULL, 0},
    {"thesis", "activation", "tanh", NULL, 0},   {"best", "activation", "swish", NULL, 0},
    {"best", "optimizer", "ssbroyden", NULL, 0}, {"best", "hidden", "20,20", NULL, 0},
    {"best", "epochs", "2000", NULL, 0},         {"best", "prior", "0.2", NULL, 0},
    {"best", "units", "data", NULL, 0},          {"best", "scheme", "rk4", "separable", 0},
    {"best", "scaled", "yes", "chain", 0},       {"best", "hidden", "20", "chain", 3},
    {"best", "scheme", "rkmk5", "chain", 3},
};

/* Sets the options that the user did not give, for data of a family (NULL: one without rows). "thesis": the
 * published values; "best": our values, chosen by measurement (docs/reports/training.md). */
static void adopt_rows(lg_training *self, const char *family, uint32_t n) {
    lg_hamiltonian_run *run = self->run;
    const char *preset = lg_training_preset(self);
    for (size_t i = 0; i < LG_COUNT(preset_rows); i++) {
        const char *option = preset_rows[i].option, *of = preset_rows[i].family;
        const bool fits = strcmp(preset_rows[i].preset, preset) == 0 && n >= preset_rows[i].least &&
                          (of == NULL || (family != NULL && strcmp(of, family) == 0));
        if (fits && !self->given(self, option))
            (void)lg_field_set(lg_field_find(lg_hamiltonian_fields, option), preset_rows[i].value, run, NULL);
    }
}

static bool usual(lg_training *self, uint32_t at) {
    if (at < LG_COUNT(preset_rows)) adopt_rows(self, preset_rows[at].family, preset_rows[at].least);
    return at < LG_COUNT(preset_rows);
}

static void adopt_preset(lg_training *self) {
    lg_hamiltonian_run *run = self->run;
    const lg_trajectories *data = &((lg_hamiltonian_state *)self->state)->data;
    if (!self->given(self, "scheme")) run->scheme = lg_scheme_find(data->family->scheme);
    adopt_rows(self, data->family->name, data->n);
    /* Estimated starts are too many parameters for a dense matrix. */
    const bool dense = strcmp(lg_training_preset(self), "best") == 0 && run->starts == LG_START_ESTIMATED;
    if (dense && !self->given(self, "optimizer"))
        (void)lg_fit_plan_parse("lbfgs", true, &run->training.plan, NULL);
}

static lg_hamiltonian_problem problem_of(const lg_hamiltonian_run *run, const lg_trajectories *data) {
    return (lg_hamiltonian_problem){.model = &run->model,
                                    .scheme = run->scheme,
                                    .substeps = run->substeps,
                                    .penalty = run->penalty,
                                    .penalty_form = run->penalty_form,
                                    .penalty_integral = lg_first_integral_find(run->penalty_integral),
                                    .distance = run->distance,
                                    .starts = run->starts,
                                    .trajectories = data->count,
                                    .points = data->points,
                                    .dt = data->dt,
                                    .data = data->data};
}

/* Completes the run by what the data determine, and makes the model. */
static lg_status complete_run(lg_hamiltonian_run *run, const lg_trajectories *data, lg_error *error) {
    const lg_mlp net = run->model.net;
    const lg_symmetry symmetry = run->model.symmetry;
    const lg_status status = lg_hamiltonian_init(&run->model, data->family, data->n, run->model.potential,
                                                 net.width + 1, net.layers - 1, net.activation);
    if (status != LG_OK) return lg_fail(error, status, "a network of this size cannot be made");
    if (lg_hamiltonian_set_symmetry(&run->model, symmetry) != LG_OK)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "--symmetry %s: is not for family %s with n = %u: the coordinates have no invariants of this "
            "kind, or too many for a dictionary",
            lg_field_name(lg_field_find(lg_hamiltonian_fields, "symmetry"), symmetry),
            run->model.family->name, run->model.n);
    run->model.constraint = data->constraint;
    memcpy(run->system, data->system, sizeof run->system);
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    run->trajectories = data->count;
    run->points = data->points;
    run->dt = data->dt;
    if (run->units == LG_UNITS_GIVEN) return LG_OK;
    const lg_hamiltonian_problem problem = problem_of(run, data);
    return lg_hamiltonian_find_scales(&problem, &run->model.scales, error);
}

/* Without --penalty-integral, chooses the first row in the table of first integrals that fits the model. */
static void choose_integral(lg_training *self) {
    lg_hamiltonian_run *run = self->run;
    const lg_first_integral *integral;
    if (run->penalty == 0 || self->given(self, "penalty-integral")) return;
    for (uint32_t i = 0; (integral = lg_first_integral_at(i)) != NULL; i++) {
        if (!lg_first_integral_fits(integral, &run->model)) continue;
        (void)snprintf(run->penalty_integral, sizeof run->penalty_integral, "%s", integral->name);
        return;
    }
}

static lg_status hash_program(const lg_context *context, const lg_program *program, char *text) {
    lg_sha256 sum;
    lg_sha256_init(&sum);
    for (size_t i = 0; i < lg_program_functions(program); i++) {
        const char *name = lg_program_function_name(program, i);
        lg_sha256_add(&sum, name, strlen(name) + 1);
        LG_TRY(lg_hash_function(context, program, i, &sum));
    }
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec parameter = lg_program_parameter(program, i);
        lg_sha256_add_doubles(&sum, parameter.values, lg_shape_count(parameter.shape));
    }
    lg_sha256_finish(&sum, text);
    return LG_OK;
}

lg_status lg_penalty_load(const lg_context *context, lg_hamiltonian_run *run, lg_program **out,
                          lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    LG_TRY(lg_program_load(context, run->penalty_integral, NULL, &made, error));
    const lg_status status = hash_program(context, made, run->penalty_sha256);
    if (status != LG_OK)
        return lg_fail(error, status, "%s: %s", run->penalty_integral, lg_status_sentence(status));
    return LG_MOVE(out, made);
}

static void release_integral(lg_training *self) {
    lg_hamiltonian_state *s = self->state;
    lg_program_destroy(s->program);
    s->program = NULL;
}

/* Loads the first integral from its file. A resumed run keeps the stored path if the file has been moved. */
static lg_status load_integral(lg_training *self, lg_error *error) {
    lg_hamiltonian_run *run = self->run;
    lg_hamiltonian_state *s = self->state;
    const lg_hamiltonian_run *stored = self->stored;
    lg_error why = {LG_OK, ""};
    release_integral(self);
    run->penalty_sha256[0] = '\0';
    if (run->penalty == 0 || lg_first_integral_find(run->penalty_integral) != NULL) return LG_OK;
    LG_TRY(lg_penalty_load(self->context, run, &s->program, error));
    if (lg_first_integral_from(s->program, &run->model, run->penalty_integral, &s->integral, &why) != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: %.300s", run->penalty_integral, why.message);
    if (stored != NULL && stored != run && strcmp(stored->penalty_sha256, run->penalty_sha256) == 0)
        memcpy(run->penalty_integral, stored->penalty_integral, sizeof run->penalty_integral);
    return LG_OK;
}

static lg_status describe(lg_training *self, lg_error *error) {
    if (self->stored == NULL) adopt_preset(self);
    LG_TRY(complete_run(self->run, &((lg_hamiltonian_state *)self->state)->data, error));
    if (self->stored == NULL) choose_integral(self);
    return load_integral(self, error);
}

static bool has_network(const lg_training *self) {
    return ((const lg_hamiltonian_run *)self->run)->model.potential == LG_POTENTIAL_MLP;
}

/* Refuses options that have no effect without another option. */
static lg_status check_options(const lg_training *self, lg_error *error) {
    static const char *const of_network[] = {"hidden", "activation", "prior"};
    static const char *const of_penalty[] = {"penalty-integral", "penalty-form"};
    const lg_hamiltonian_run *run = self->run;
    char potential[LG_FIELD_TEXT_SIZE];
    lg_field_show(lg_field_find(lg_hamiltonian_fields, "potential"), run, potential, sizeof potential);
    for (size_t i = 0; i < LG_COUNT(of_network); i++)
        if (self->given(self, of_network[i]) && !has_network(self))
            return lg_fail(error, LG_INVALID_ARGUMENT, "--%s: --potential %s has no network", of_network[i],
                           potential);
    for (size_t i = 0; i < LG_COUNT(of_penalty); i++)
        if (self->given(self, of_penalty[i]) && run->penalty == 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "--%s: needs --penalty MU", of_penalty[i]);
    return LG_OK;
}

static lg_status prepare(lg_training *self, lg_error *error) {
    const lg_hamiltonian_state *s = self->state;
    const lg_hamiltonian_run *run = self->run;
    const size_t parameters = lg_hamiltonian_parameters(&run->model);
    LG_TRY(check_options(self, error));
    if (s->newton && run->starts == LG_START_ESTIMATED)
        return lg_fail(error, LG_INVALID_ARGUMENT, "--newton cannot be used with --initial-states estimated");
    if (s->newton && parameters > LG_NEWTON_MAX_PARAMETERS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--newton: the model has %zu parameters, at most %d are possible", parameters,
                       LG_NEWTON_MAX_PARAMETERS);
    if (s->data.points > LG_HAMILTONIAN_MAX_POINTS)
        return lg_fail(error, LG_FORMAT,
                       "%s: /trajectories has %zu points per trajectory; training takes at most %d",
                       self->paths[0], s->data.points, LG_HAMILTONIAN_MAX_POINTS);
    return LG_OK;
}

/* ---- the problem ---- */

/* Sets the weights of the loss from the data. The penalty is scaled so that its ratio to the most heavily
 * weighted squares, usually of the momenta, stays the same. */
static lg_status weigh(lg_hamiltonian_problem *problem, double unit, lg_error *error) {
    const lg_status status = lg_hamiltonian_weigh(problem, error);
    if (status != LG_OK || problem->penalty == 0) return status;
    if (problem->penalty_form == LG_PENALTY_MEAN_SQUARE) unit *= unit;
    double most = 0;
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++) most = fmax(most, problem->weight[i]);
    problem->penalty *= most / unit;
    return LG_OK;
}

/* A file whose function has no finite derivatives cannot be used. */
static lg_status unit_of_integral(const lg_training *self, double *unit, lg_error *error) {
    const lg_hamiltonian_state *s = self->state;
    const lg_status status = lg_hamiltonian_integral_unit(self->context, &s->problem, unit, error);
    if (status != LG_NOT_FINITE) return status;
    if (error != NULL) error->status = LG_FORMAT;
    return LG_FORMAT;
}

/* Draws the parameters to start from. They are drawn again if a prediction is not finite: a long chain with a
 * nearly singular mass matrix moves too fast for the step size. */
static lg_status draw_weights(lg_training *self, lg_error *error) {
    enum { DRAWS = 20 };
    const lg_hamiltonian_run *run = self->run;
    const lg_hamiltonian_problem *problem = &((lg_hamiltonian_state *)self->state)->problem;
    double loss = NAN;
    lg_rng rng;
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    for (int draw = 0; draw < DRAWS && !isfinite(loss); draw++) {
        lg_hamiltonian_initialise(&run->model, &rng, self->theta);
        const lg_status scaled =
            run->scaled ? lg_hamiltonian_scale(self->context, problem, self->theta, NULL) : LG_OK;
        if (scaled != LG_OK && scaled != LG_NOT_FINITE)
            return lg_fail(error, scaled, "%s", lg_status_sentence(scaled));
        const lg_status status =
            lg_hamiltonian_mean_squared_error(self->context, problem, self->theta, &loss, error);
        if (status != LG_OK && status != LG_NOT_FINITE) return status;
    }
    if (!isnan(loss)) return LG_OK; /* infinite: the data are too large */
    return lg_fail(
        error, LG_NOT_FINITE,
        "no prediction of random initial models is finite with --substeps %u and --scheme %s: give "
        "more --substeps",
        run->substeps, run->scheme->name);
}

static lg_status warn_of_data(lg_training *self, const lg_hamiltonian_problem *problem, lg_error *error) {
    LG_TRY(lg_hamiltonian_warn_of_data(self->context, problem, self->paths[0]));
    lg_status status = lg_hamiltonian_warn_of_symmetry(self->context, problem);
    if (status != LG_OK) return lg_fail(error, status, "symmetry: %s", lg_status_sentence(status));
    status = lg_hamiltonian_warn_of_integral(self->context, problem);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s", lg_status_sentence(status));
}

static lg_status make_problem(lg_training *self, lg_error *error) {
    lg_hamiltonian_state *s = self->state;
    const lg_hamiltonian_run *run = self->run;
    lg_hamiltonian_problem *problem = &s->problem;
    double unit = 1;
    *problem = problem_of(run, &s->data);
    if (s->program != NULL) problem->penalty_integral = &s->integral;
    LG_TRY(lg_hamiltonian_problem_check(problem, error));
    if (run->penalty != 0) LG_TRY(unit_of_integral(self, &unit, error));
    if (run->units == LG_UNITS_DATA) LG_TRY(weigh(problem, unit, error));
    lg_hamiltonian_fit_problem(problem, &self->problem);
    LG_TRAINING_ARRAY(self, self->theta, self->problem.parameters, error);
    LG_TRY(draw_weights(self, error));
    return self->path_count > 0 ? warn_of_data(self, problem, error) : LG_OK; /* the data are the user's */
}

/* ---- the result ---- */

static lg_status judge(lg_training *self, double *theta, lg_error *error) {
    const lg_hamiltonian_state *s = self->state;
    const lg_hamiltonian_problem *problem = &s->problem;
    const bool newton = s->newton && lg_fit_finished(self->fit);
    lg_fit_newton_result found = {0};
    double loss = 0;
    if (newton) LG_TRY(lg_fit_newton(self->context, &self->problem, theta, &found));
    LG_TRY(lg_hamiltonian_mean_squared_error(self->context, problem, theta, &loss, error));
    if (!isfinite(loss)) return LG_NOT_FINITE;
    LG_TRY(lg_hamiltonian_floor(self->context, problem, theta, &self->floor, error));
    lg_hamiltonian_warn_of_floor(self->context, problem, loss, self->floor);
    LG_TRY(lg_hamiltonian_warn_of_drift(self->context, problem, self->fit, theta, loss, self->floor, error));
    self->verdict = (lg_training_verdict){.what = "mean squared error",
                                          .guess = "a state that does not change",
                                          .error = loss,
                                          .guessed = lg_hamiltonian_unchanged(problem)};
    LG_TELL(self,
            LG_REAL("loss", loss, "mean squared error of the predicted points, without measured starts"));
    self->first_count = self->result_count;
    LG_TELL(self, LG_WHOLE("parameters", lg_hamiltonian_parameters(problem->model), NULL));
    if (!s->newton) return LG_OK;
    LG_TELL(self, LG_WHOLE("newton_iterations", found.iterations, NULL),
            LG_REAL("newton_gradient", found.gradient_norm, NULL));
    return LG_OK;
}

/* Evaluates the predictions of the model by its training scheme, from measured starts. */
static lg_status evaluate(lg_training *self, const void *from, lg_error *error) {
    const lg_hamiltonian_file *file = from;
    lg_hamiltonian_run *run = self->run;
    const lg_trajectories *data = &((lg_hamiltonian_state *)self->state)->data;
    double loss = 0;
    if (data->family != run->model.family || data->n != run->model.n)
        return lg_fail(error, LG_SHAPE, "%s: a state has %u numbers, but a state of the model has %u",
                       self->paths[0], data->state_dim, lg_hamiltonian_state_dim(&run->model));
    run->starts = LG_START_MEASURED;
    const lg_hamiltonian_problem problem = problem_of(run, data);
    LG_TRY(lg_hamiltonian_mean_squared_error(self->context, &problem, file->theta, &loss, error));
    LG_TELL(self,
            LG_REAL("loss", loss, "mean squared error of the predicted points, without measured starts"),
            LG_REAL("unchanged", lg_hamiltonian_unchanged(&problem), "of a state that does not change"));
    return LG_OK;
}

static const char *const sizes[] = {"8,8", "12,12", "16,16", "20,20", "32,32", "48,48", NULL};

const lg_trainer lg_hamiltonian_learner = {.data = "DATA.h5",
                                           .state_size = sizeof(lg_hamiltonian_state),
                                           .options = lg_hamiltonian_options,
                                           .held_out = "validation-fraction",
                                           .sizes = sizes,
                                           .presets = true,
                                           .has_width = has_network,
                                           .read = read_data,
                                           .describe = describe,
                                           .usual = usual,
                                           .prepare = prepare,
                                           .problem = make_problem,
                                           .judge = judge,
                                           .evaluate = evaluate,
                                           .release = release_integral,
                                           .close = close_data};
