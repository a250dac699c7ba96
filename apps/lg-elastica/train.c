/* lg-elastica train: fit a surrogate to curves; lg-elastica search: random search over its options. */
#include "lg-elastica/train.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/search.h"

enum { STREAM_WEIGHTS = 1 };

/* ---- settings: the run, and where what is not given comes from ---- */

static lg_surrogate_run run; /* all that determines the result */

static const app_settings settings[] = {
    {lg_surrogate_fields, &run, sizeof run}, TRAIN_PRESET, TRAIN_SHARED, APP_SETTINGS_END};

typedef struct training {
    lg_elastica_data data;
    const lg_surrogate_preset *preset;        /* NULL when resumed */
    part_indices train, test;                 /* in a search `test` is held out of the training part */
    part_indices learned;                     /* of the training part, at most run.most_curves */
    double *modes, *coefficients, truncation; /* of a network with modes; NULL, NULL, NaN */
    lg_surrogate_problem problem;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} training;

/* ---- the run ---- */

static int read_data(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    training *state = user;
    const int code = read_curves(self, path, &state->data);
    if (code == APP_EXIT_OK) memcpy(sha256, state->data.sha256, LG_SHA256_TEXT);
    return code;
}

/* Half of the largest distance of the ends: the same bits wherever all curves have one distance. */
static double centre_of(const lg_elastica_curves *curves) {
    double largest = 0;
    for (size_t i = 0; i < curves->count; i++) {
        const double *x = curves->boundary + 8 * i;
        largest = fmax(largest, hypot(x[4] - x[0], x[5] - x[1]));
    }
    return 0.5 * largest;
}

/* `most` curves of a part at even distances in it, or all for 0. */
static part_indices thin(const part_indices *part, uint64_t most) {
    const size_t count = most > 0 && most < part->count ? (size_t)most : part->count;
    part_indices out = {app_alloc(count, sizeof *out.list), count};
    for (size_t i = 0; i < count; i++)
        out.list[i] = part->list[count > 1 ? i * (part->count - 1) / (count - 1) : 0];
    return out;
}

/* A preset's modes are a limit; the curves that are learned say how many it takes. */
static lg_status modes_of_curves(const training *state, const app *self, uint32_t *modes, lg_error *error) {
    const lg_elastica_curves *curves = &state->data.curves;
    lg_surrogate_options options = run.model.options;
    lg_surrogate model;
    part_indices train, test;
    options.modes = (uint32_t)fmin(options.modes, 4.0 * (curves->intervals - 1));
    lg_status status =
        lg_surrogate_init(&model, &options, curves->intervals, curves->length, centre_of(curves), error);
    if (status == LG_OK) status = split_curves(&run, &train, &test, error);
    if (status != LG_OK) return status;
    const part_indices learned = thin(&train, run.most_curves);
    status =
        lg_surrogate_count_modes(self->context, &model, curves, learned.list, learned.count, modes, error);
    free(train.list);
    free(test.list);
    free(learned.list);
    return status;
}

static lg_status adopt_preset(training *state, app *self, lg_error *error) {
    const lg_elastica_curves *curves = &state->data.curves;
    const lg_surrogate_options *options = &run.model.options;
    const families found = families_of(curves->boundary, curves->count);
    const bool merged = found.both_ends && found.right_end;
    const char *name = train_preset(self, &run.training);
    state->preset = lg_surrogate_preset_find(name, options->kind, options->boundary, options->loss, merged,
                                             run.train_fraction);
    if (state->preset == NULL)
        return app_error(error, LG_UNSUPPORTED, "--preset: %s has no settings for the %s network%s%s%s", name,
                         lg_surrogate_kind_name(options->kind),
                         options->loss == LG_SURROGATE_ENERGY ? " with --loss energy" : "",
                         options->boundary ? " with --boundary true" : "",
                         merged ? " on data of both families" : "");
    lg_surrogate_run from = {.model.options = state->preset->model, .training = state->preset->training};
    from.most_curves = state->preset->most_curves;
    app_adopt(self, settings, &from, true);
    if (options->angles && !app_given(self, "modes")) run.model.options.modes = 0;
    if (options->modes == 0 || app_given(self, "modes")) return LG_OK;
    return modes_of_curves(state, self, &run.model.options.modes, error);
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    training *state = user;
    const lg_elastica_curves *curves = &state->data.curves;
    state->preset = NULL;
    run.curves = curves->count;
    const lg_status status = stored != NULL ? LG_OK : adopt_preset(state, self, error);
    if (status != LG_OK) return status;
    run.continuous = curves->continuous;
    memcpy(run.data_sha256, state->data.sha256, sizeof run.data_sha256);
    const lg_surrogate_options options = run.model.options;
    return lg_surrogate_init(&run.model, &options, curves->intervals, curves->length, centre_of(curves),
                             error);
}

/* ---- parts ---- */

static part_indices indices_of(const uint8_t *parts, size_t n, lg_part wanted) {
    part_indices out = {app_alloc(n, sizeof *out.list), 0};
    for (size_t i = 0; i < n; i++)
        if (parts[i] == (uint8_t)wanted) out.list[out.count++] = (uint32_t)i;
    return out;
}

lg_status split_curves(const lg_surrogate_run *from, part_indices *train, part_indices *test,
                       lg_error *error) {
    const size_t n = (size_t)from->curves;
    uint8_t *parts = app_alloc(n, 1);
    const lg_status status =
        lg_surrogate_split(n, from->train_fraction, from->test_fraction, from->training.seed, parts);
    if (status == LG_OK) {
        *train = indices_of(parts, n, LG_PART_TRAIN);
        *test = indices_of(parts, n, LG_PART_TEST);
    } else {
        (void)app_error(error, status,
                        "fractions %g for training and %g for testing: they add up to more than 1, or leave "
                        "none of %zu curves for training",
                        from->train_fraction, from->test_fraction, n);
    }
    free(parts);
    return status;
}

static int prepare(void *user, app *self) {
    training *state = user;
    lg_error error = {LG_OK, ""};
    const lg_status status = split_curves(&run, &state->train, &state->test, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "%s", app_sentence(status, &error));
}

/* The training part without the held-out curves. */
static lg_status hold_out(void *user, app *self, double validation, lg_error *error) {
    training *state = user;
    part_indices whole, test;
    (void)self;
    lg_status status = split_curves(&run, &whole, &test, error);
    if (status != LG_OK) return status;
    free(test.list);
    uint8_t *parts = app_alloc(whole.count, 1);
    status = lg_surrogate_split(whole.count, 1 - validation, validation, run.training.seed, parts);
    state->train = indices_of(parts, whole.count, LG_PART_TRAIN);
    state->test = indices_of(parts, whole.count, LG_PART_TEST);
    for (size_t i = 0; i < state->train.count; i++) state->train.list[i] = whole.list[state->train.list[i]];
    for (size_t i = 0; i < state->test.count; i++) state->test.list[i] = whole.list[state->test.list[i]];
    free(parts);
    free(whole.list);
    if (status == LG_OK && state->train.count > 0 && state->test.count > 0) return LG_OK;
    return app_error(error, LG_INVALID_ARGUMENT,
                     "--validation %g: of %zu curves, the training or "
                     "validation part has none",
                     validation, whole.count);
}

/* ---- the fit ---- */

/* The fixed last layer, from the curves that are learned. */
static lg_status find_modes(training *state, const app *self, lg_error *error) {
    const lg_elastica_curves *curves = &state->data.curves;
    state->truncation = (double)NAN;
    if (run.model.options.modes == 0) return LG_OK;
    state->modes = app_try_alloc(lg_surrogate_modes_size(&run.model), sizeof *state->modes);
    state->coefficients = app_try_alloc(state->learned.count * run.model.options.modes, sizeof(double));
    if (state->modes == NULL || state->coefficients == NULL)
        return train_no_room(lg_surrogate_parameters(&run.model), error);
    const lg_status status = lg_surrogate_find_modes(self->context, &run.model, curves, state->learned.list,
                                                     state->learned.count, state->modes, error);
    run.model.modes = state->modes;
    if (status != LG_OK) return status;
    return lg_surrogate_coefficients(self->context, &run.model, curves, state->learned.list,
                                     state->learned.count, state->coefficients, &state->truncation, error);
}

static lg_status create(void *user, app *self, const lg_fit_options *options, lg_fit **fit, lg_error *error) {
    training *state = user;
    state->learned = thin(&state->train, run.most_curves);
    lg_status status = find_modes(state, self, error);
    if (status != LG_OK) return status;
    state->problem = (lg_surrogate_problem){&run.model, &state->data.curves, state->learned.list,
                                            state->learned.count, state->coefficients};
    status = lg_surrogate_problem_check(&state->problem, error);
    if (status != LG_OK) return status;
    lg_surrogate_fit_problem(&state->problem, &state->fit_problem);
    double *theta = app_try_alloc(lg_surrogate_parameters(&run.model), sizeof *theta);
    if (theta == NULL) return train_no_room(lg_surrogate_parameters(&run.model), error);
    lg_rng rng;
    lg_rng_seed(&rng, run.training.seed, STREAM_WEIGHTS);
    lg_net_initialise(&run.model.net, LG_INIT_FAN_IN, &rng, theta);
    status = lg_fit_create(self->context, &state->fit_problem, options, theta, &state->fit, error);
    free(theta);
    *fit = state->fit;
    return status;
}

static void release(void *user) {
    training *state = user;
    lg_fit_destroy(state->fit);
    free(state->train.list);
    free(state->test.list);
    free(state->learned.list);
    free(state->modes);
    free(state->coefficients);
    run.model.modes = state->modes = state->coefficients = NULL;
    state->fit = NULL;
    state->train = state->test = state->learned = (part_indices){NULL, 0};
}

/* Errors of the fit's parameters over a part; all NaN for a part without curves. */
static lg_status errors_of(const training *state, const app *self, const part_indices *part,
                           lg_surrogate_errors *out, lg_error *error) {
    const double none = (double)NAN;
    *out = (lg_surrogate_errors){none, none, none, none, none, none, none};
    if (part->count == 0) return LG_OK;
    double *theta = app_try_alloc(lg_surrogate_parameters(&run.model), sizeof *theta);
    if (theta == NULL) return train_no_room(lg_surrogate_parameters(&run.model), error);
    lg_fit_parameters(state->fit, theta);
    const lg_status status = lg_surrogate_evaluate(self->context, &run.model, theta, &state->data.curves,
                                                   part->list, part->count, NULL, out, error);
    free(theta);
    return status;
}

static double objective(void *user, app *self) {
    const training *state = user;
    lg_surrogate_errors errors;
    return errors_of(state, self, &state->test, &errors, NULL) == LG_OK ? errors.mse : (double)NAN;
}

static size_t parameters(void *user) {
    (void)user;
    return lg_surrogate_parameters(&run.model);
}

/* ---- result ---- */

static void report_json(const training *state, const train_session *session, const lg_surrogate_errors *train,
                        const lg_surrogate_errors *test) {
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "train_mse", train->mse);
    app_json_real(&json, "test_mse", test->mse);
    app_json_real(&json, "loss", lg_fit_loss(state->fit));
    app_json_real(&json, "truncation", state->truncation);
    app_json_size(&json, "parameters", lg_surrogate_parameters(&run.model));
    train_json(session, &json);
    app_json_text(&json, "preset", state->preset != NULL ? state->preset->name : NULL);
    app_json_text(&json, "source", state->preset != NULL ? state->preset->source : NULL);
    app_json_size(&json, "train_curves", state->train.count);
    app_json_size(&json, "learned_curves", state->learned.count);
    app_json_size(&json, "test_curves", state->test.count);
    app_json_real(&json, "test_max_error", test->max_error);
    app_json_text(&json, "values", run.continuous ? "continuous" : "discrete");
    app_json_text(&json, "data_sha256", run.data_sha256);
    app_json_end(&json);
}

static void report(const training *state, const train_session *session, const lg_surrogate_errors *train,
                   const lg_surrogate_errors *test) {
    const lg_surrogate_options *options = &run.model.options;
    if (session->app->json) {
        report_json(state, session, train, test);
        return;
    }
    (void)printf("%s: %s network, %s %u x %u, %zu parameters", train_given_files.out,
                 lg_surrogate_kind_name(options->kind), lg_net_kind_name(options->architecture),
                 options->hidden, options->layers, lg_surrogate_parameters(&run.model));
    if (state->preset != NULL) (void)printf(" (preset %s: %s)", state->preset->name, state->preset->source);
    (void)printf("\n%llu epochs (%.4f s each, %.1f s in all); mean squared error %.4e on %zu curves trained "
                 "on",
                 (unsigned long long)lg_fit_epochs_done(state->fit), lg_fit_seconds_per_epoch(state->fit),
                 session->seconds, train->mse, state->train.count);
    if (state->test.count > 0) (void)printf(", %.4e on %zu test curves", test->mse, state->test.count);
    (void)printf("\n");
}

/* The model with the state of its fit. */
static lg_status save_model(const training *state, const app *self, double train_mse, double test_mse,
                            lg_error *error) {
    lg_surrogate_file file;
    memset(&file, 0, sizeof file);
    file.run = run;
    file.parameters = lg_surrogate_parameters(&run.model);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    lg_fit_parameters(state->fit, file.theta);
    file.trained_count = state->learned.count;
    file.trained = app_alloc(8 * file.trained_count, sizeof *file.trained);
    for (size_t i = 0; i < file.trained_count; i++)
        memcpy(file.trained + 8 * i, state->data.curves.boundary + 8 * (size_t)state->learned.list[i],
               8 * sizeof *file.trained);
    file.has_errors = true;
    file.train_mse = train_mse;
    file.test_mse = test_mse;
    file.provenance = app_provenance(self, run.training.seed);
    const lg_status status =
        lg_model_save_surrogate(self->context, train_given_files.out, &file, state->fit, error);
    free(file.theta);
    free(file.trained);
    return status;
}

/* The mean squared error of the mean curve on the part that was trained on, over the nodes that the network
 * gives. */
static double mean_curve_error(const training *state) {
    const lg_elastica_curves *curves = &state->data.curves;
    const part_indices *part = &state->train;
    const size_t row = 2 * ((size_t)curves->intervals + 1);
    const size_t edge = run.model.options.kind == LG_SURROGATE_DISCRETE ? 2 : 0;
    const double *const values[2] = {curves->q, curves->v}, n = (double)part->count;
    double sum = 0;
    for (size_t k = 0; k < 2; k++)
        for (size_t j = edge; j < row - edge; j++) {
            double mean = 0;
            for (size_t i = 0; i < part->count; i++) mean += values[k][part->list[i] * row + j] / n;
            for (size_t i = 0; i < part->count; i++) sum += pow(values[k][part->list[i] * row + j] - mean, 2);
        }
    return sum / (n * 2.0 * (double)(row - 2 * edge));
}

static int finish(void *user, train_session *session) {
    const training *state = user;
    const app *self = session->app;
    lg_error error = {LG_OK, ""};
    lg_surrogate_errors train, test;
    lg_status status = errors_of(state, self, &state->train, &train, &error);
    if (status == LG_OK) status = errors_of(state, self, &state->test, &test, &error);
    if (status != LG_OK)
        return app_fail(self, status, "after the last epoch: %s", app_sentence(status, &error));
    if (run.model.options.loss == LG_SURROGATE_ENERGY && run.continuous)
        app_warn(self,
                 "--loss energy learns the beams of the discrete energy on %u intervals; errors against "
                 "continuous values contain their difference from these",
                 run.model.intervals);
    const int judged =
        train_judge(session, "mean squared error", train.mse, "the mean curve", mean_curve_error(state));
    status = save_model(state, self, train.mse, test.mse, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, train_given_files.out);
    const int code = train_draw(session);
    if (code == APP_EXIT_OK) report(state, session, &train, &test);
    return code == APP_EXIT_OK ? judged : code;
}

/* ---- the commands ---- */

static const char *const sizes[] = {"8", "12", "16", "24", "32", "64", NULL};

static training state;

static const train_task task = {.kind = &lg_recipe_surrogate,
                                .settings = settings,
                                .training = &run.training,
                                .method = "network",
                                .user = &state,
                                .read = read_data,
                                .describe = describe,
                                .prepare = prepare,
                                .hold_out = hold_out,
                                .create = create,
                                .release = release,
                                .finish = finish,
                                .objective = objective,
                                .parameters = parameters,
                                .sizes = sizes};

static int end(int code) {
    lg_elastica_data_destroy(&state.data);
    return code;
}

static int run_train(app *self) {
    return end(train_main(self, &task));
}

static int run_search(app *self) {
    return end(search_main(self, &train_command, &task));
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a network to curves",
    .details =
        "train_mse and test_mse are mean squared errors over the curves of each part, nodes and "
        "components, in double precision (discrete: the 4(N - 1) inner ones); `loss` is the last "
        "epoch's mean over its batches, with its penalty. `truncation` is what --modes leaves out: the "
        "mean squared error of the trained curves' best approximation by so many modes.\n\nCtrl-C saves a "
        "checkpoint and ends with "
        "exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};

const app_command search_command = {SEARCH_COMMAND("DATA.h5"), .settings = APP_SETTINGS(SEARCH_SHARED),
                                    .run = run_search};
