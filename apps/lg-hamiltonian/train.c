/* lg-hamiltonian train: fit a Hamiltonian to trajectories. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-hamiltonian/learning.h"

/* ---- settings ---- */

static struct { bool newton; } given;

static const lg_field options[] = {
    LG_OPTION(__typeof__(given), newton, SWITCH, NULL,
              "After the last epoch, minimise the loss to rounding by Newton's method on all data (for few "
              "parameters)"),
    LG_FIELD_END};

static lg_hamiltonian_run run; /* all that determines the result */

static const app_settings settings[] = {{lg_hamiltonian_fields, &run, sizeof run},
                                        TRAIN_PRESET,
                                        APP_GIVEN(options, given),
                                        TRAIN_SHARED,
                                        APP_SETTINGS_END};

typedef struct training {
    lg_trajectories data;
    learner learner;
    lg_newton_result newton;
} training;

/* ---- the run and its fit ---- */

static int read_data(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    training *state = user;
    lg_error error = {LG_OK, ""};
    lg_read_options reading;
    lg_read_options_init(&reading);
    reading.project_starts = app_given(self, "starts") || train_given_files.resume != NULL;
    const lg_status status = lg_trajectories_read(self->context, path, &reading, &state->data, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (state->data.starts_off > 1e-6 && run.starts == LG_START_MEASURED)
        app_warn(
            self,
            "%s: first points were off the manifold by up to %.2g and are brought back; --starts estimated "
            "takes them as unknown",
            path, state->data.starts_off);
    if (state->data.guessed)
        app_warn(self,
                 "%s: gives neither attribute system nor layout: its %u numbers a point are taken for states "
                 "of %s (%s)",
                 path, state->data.state_dim, state->data.family->name, state->data.family->formula);
    if (state->data.system[0] != '\0' && lg_system_parameters(state->data.system, NULL) == NULL)
        app_warn(self, "%s: no system is called '%s': by its layout its data are taken for states of %s (%s)",
                 path, state->data.system, state->data.family->name, state->data.family->formula);
    warn_of_inputs(self, path, &state->data);
    memcpy(sha256, state->data.sha256, LG_SHA256_TEXT);
    return APP_EXIT_OK;
}

/* Without --penalty-integral the first one that fits the system. */
static void choose_integral(const app *self) {
    const lg_first_integral *integral;
    if (run.penalty == 0 || app_given(self, "penalty-integral")) return;
    for (uint32_t i = 0; (integral = lg_first_integral_at(i)) != NULL; i++) {
        if (!lg_first_integral_fits(integral, &run.model)) continue;
        run.penalty_integral = i;
        return;
    }
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    const training *state = user;
    if (stored == NULL) {
        if (!app_given(self, "integrator")) run.scheme = lg_scheme_find(state->data.family->scheme);
        (void)learner_preset(self, train_preset(self, &run.training), state->data.family, state->data.n,
                             &run);
    }
    const lg_status status = describe_run(&state->data, &run, error);
    if (status == LG_OK && stored == NULL) choose_integral(self);
    return status;
}

static bool has_network(void *user) {
    (void)user;
    return run.model.potential == LG_POTENTIAL_MLP;
}

/* Options that say nothing without another one. */
static int check_options(const app *self) {
    static const char *const of_network[] = {"hidden", "activation", "prior"};
    static const char *const of_penalty[] = {"penalty-integral", "penalty-copy", "penalty-points",
                                             "penalty-form"};
    char potential[LG_FIELD_TEXT_SIZE];
    lg_field_show(lg_field_find(lg_hamiltonian_fields, "potential"), &run, potential, sizeof potential);
    for (size_t i = 0; i < LG_COUNT(of_network); i++)
        if (app_given(self, of_network[i]) && !has_network(NULL))
            return app_usage(self, "--%s: --potential %s has no network", of_network[i], potential);
    for (size_t i = 0; i < LG_COUNT(of_penalty); i++)
        if (app_given(self, of_penalty[i]) && run.penalty == 0)
            return app_usage(self, "--%s: needs --penalty MU", of_penalty[i]);
    return APP_EXIT_OK;
}

static int prepare(void *user, app *self) {
    const training *state = user;
    const int code = check_options(self);
    if (code != APP_EXIT_OK) return code;
    if (given.newton && run.starts == LG_START_ESTIMATED)
        return app_usage(self, "--newton: is not for --starts estimated");
    if (given.newton && lg_hamiltonian_parameters(&run.model) > LG_NEWTON_MAX_PARAMETERS)
        return app_usage(self, "--newton: the model has %zu parameters, at most %d are possible",
                         lg_hamiltonian_parameters(&run.model), LG_NEWTON_MAX_PARAMETERS);
    if (state->data.points > LG_HAMILTONIAN_MAX_POINTS)
        return app_fail(self, LG_FORMAT,
                        "%s: /trajectories has %zu points a trajectory; training takes at most %d",
                        self->arguments[0], state->data.points, LG_HAMILTONIAN_MAX_POINTS);
    return APP_EXIT_OK;
}

static lg_status create(void *user, app *self, const lg_fit_options *how, lg_fit **fit, lg_error *error) {
    training *state = user;
    const lg_status status = learner_create(self->context, &run, &state->data, how, &state->learner, error);
    *fit = state->learner.fit;
    if (status == LG_OK) warn_of_data(self, &state->learner.problem, self->arguments[0]);
    return status == LG_OK ? warn_of_integral(self, &state->learner, error) : status;
}

static void release(void *user) {
    training *state = user;
    learner_destroy(&state->learner);
}

/* ---- result ---- */

static void report_json(const training *state, const train_session *session, double loss) {
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "loss", loss);
    train_json(session, &json);
    app_json_size(&json, "parameters", lg_hamiltonian_parameters(&run.model));
    if (given.newton) {
        app_json_size(&json, "newton_iterations", state->newton.iterations);
        app_json_real(&json, "newton_gradient", state->newton.gradient_norm);
    }
    app_json_end(&json);
}

static void report(const training *state, const train_session *session, double loss) {
    if (session->app->json) {
        report_json(state, session, loss);
        return;
    }
    (void)printf("%s: %zu parameters, %llu epochs or evaluations with %s, mean squared error %.3e, floor "
                 "%.1e (%.4f s an epoch, "
                 "%.1f s in all)\n",
                 train_given_files.out, lg_hamiltonian_parameters(&run.model),
                 (unsigned long long)lg_fit_epochs_done(session->fit), run.scheme->name, loss, session->floor,
                 lg_fit_seconds_per_epoch(session->fit), session->seconds);
}

static lg_status find_floor(const training *state, train_session *session, const double *theta, double loss,
                            lg_error *error) {
    const lg_hamiltonian_problem *problem = &state->learner.problem;
    const lg_status status =
        lg_hamiltonian_floor(session->app->context, problem, theta, &session->floor, error);
    if (status == LG_OK) warn_of_floor(session->app, problem, loss, session->floor);
    return status;
}

static int finish(void *user, train_session *session) {
    training *state = user;
    const app *self = session->app;
    const learner *learned = &state->learner;
    lg_error error = {LG_OK, ""};
    double loss = 0, *theta = learner_theta(learned);
    lg_status status = LG_OK;
    if (given.newton && lg_fit_finished(learned->fit))
        status = lg_newton_fit(self->context, &learned->fit_problem, NULL, theta, &state->newton);
    if (status == LG_OK)
        status = lg_hamiltonian_mean_squared_error(self->context, &learned->problem, theta, &loss, &error);
    if (status == LG_OK && !isfinite(loss)) status = LG_NOT_FINITE;
    if (status == LG_OK) status = find_floor(state, session, theta, loss, &error);
    if (status == LG_OK) status = warn_of_drift(self, learned, theta, loss, session->floor, &error);
    const int judged = status == LG_OK
                           ? train_judge(session, "mean squared error", loss, "a state that does not change",
                                         unchanged_error(&learned->problem))
                           : APP_EXIT_OK;
    int code = status == LG_OK
                   ? APP_EXIT_OK
                   : app_fail(self, status, "after the last epoch: %s", app_sentence(status, &error));
    if (code == APP_EXIT_OK) {
        status = save_model(self, train_given_files.out, learned, theta, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, train_given_files.out);
    }
    free(theta);
    if (code == APP_EXIT_OK) code = train_draw(session);
    if (code == APP_EXIT_OK) report(state, session, loss);
    return code == APP_EXIT_OK ? judged : code;
}

/* ---- the command ---- */

static const char *const sizes[] = {"8,8", "12,12", "16,16", "20,20", "32,32", "48,48", NULL};

static size_t parameters(void *user) {
    (void)user;
    return lg_hamiltonian_parameters(&run.model);
}

static training state;
static const train_task task = {.kind = &lg_recipe_hamiltonian,
                                .settings = settings,
                                .training = &run.training,
                                .user = &state,
                                .read = read_data,
                                .describe = describe,
                                .prepare = prepare,
                                .create = create,
                                .release = release,
                                .finish = finish,
                                .parameters = parameters,
                                .sizes = sizes,
                                .has_width = has_network,
                                .prior = true};

static int run_train(app *self) {
    const int code = train_main(self, &task);
    lg_trajectories_destroy(&state.data);
    return code;
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a Hamiltonian to trajectories",
    .details =
        "Loss: the mean squared difference over trajectories, coordinates and points (the first "
        "excluded; with --starts estimated it counts too) between the data and the integrator's prediction "
        "with the learned Hamiltonian; "
        "with --penalty, plus the penalty. The `loss` reported is this mean squared error (no "
        "penalty) over all trajectories of the file, in double precision, at the parameters that are "
        "written; `running_loss` is the last epoch's mean over its batches. `floor` is the part of this "
        "error that the integrator's steps make, estimated by steps of half the size.\n\nThe defaults above "
        "are "
        "those of --preset thesis. Without options of Adam the preset is best, which changes method, widths, "
        "epochs, prior and scheme by the system: docs/reports/hamiltonian.md has its table, --json the "
        "values "
        "of a run.\n\nCtrl-C "
        "saves a "
        "checkpoint and ends with exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};
