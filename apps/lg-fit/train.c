/* lg-fit train: fit a network to a table; lg-fit search: random search over the options of train. */
#include "lg-fit/train.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/search.h"
#include "table/files/recipe.h"

/* ---- settings ---- */

#define COLUMNS                                                                                              \
    LG_OPTION(train_values, inputs, STRING, "A,B,...",                                                       \
              "Columns to learn from (default: all that are not outputs). A name with a comma stands "       \
              "in quotes: '\"time, s\",b'"),                                                                 \
        LG_OPTION(train_values, outputs, STRING, "Y,...", "Columns to learn (default: the last one)"),       \
        LG_OPTION(train_values, without, STRING, "A,B,...", "Columns to leave out, such as texts"),          \
        LG_OPTION(train_values, class_column, STRING, "COLUMN",                                              \
                  "Classification: the column with the classes, texts or numbers", .option = "class")

static const lg_field train_options[] = {
    COLUMNS,
    LG_OPTION(train_values, test, STRING, "TABLE",
              "Judge the model on this table (default: on the validation part)"),
    LG_FIELD_END};
static const lg_field columns_options[] = {COLUMNS, LG_FIELD_END};

static const lg_field file_options[] = {
    TRAIN_SIZE_ROW, TRAIN_FILE_ROWS("Draw predicted against true values, or the table of confusion"),
    LG_FIELD_END};

static train_values values;
static lg_table_run run;
static training state = {.given = &values, .run = &run};
static const app_settings settings[] = {{lg_table_fields, &run, sizeof run},
                                        APP_GIVEN(train_options, values),
                                        APP_GIVEN(file_options, train_given_files),
                                        APP_SETTINGS_END};

/* ---- the run ---- */

/* One hidden layer with as many weights as the rows can determine, and few enough to be quick. */
static uint32_t width_of(void) {
    enum { LEAST = 6, MOST = 40, WEIGHTS = 320, CLASS_WIDTH = 32 };
    if (!is_regression(&state)) return CLASS_WIDTH;
    const double n = state.inputs.count, m = state.outputs.count, rows = (double)state.table.data.rows;
    const double weights = fmin(rows * m / 2.0, WEIGHTS), width = (weights - n * m) / (n + m + 1.0);
    return (uint32_t)fmin(fmax(width, LEAST), MOST);
}

/* What is not given on the command line. */
static lg_table_run usual_run(void) {
    const bool regression = is_regression(&state);
    lg_table_run from = {.training = {.dtype = LG_F64,
                                      .epochs = 300,
                                      .batch = 200,
                                      .lr = 3e-3,
                                      .schedule = LG_SCHEDULE_COSINE,
                                      .lr_step = 50,
                                      .lr_gamma = 0.0,
                                      .adam_eps = 1e-8,
                                      .patience = regression ? 0 : 40,
                                      .validation = regression && values.test != NULL ? 0.0 : 0.1,
                                      .weight_decay = regression ? 0.0 : 2e-3,
                                      .plan = {.phases = 1}}};
    from.training.plan.phase[0].method = regression ? LG_FIT_LM : LG_FIT_LBFGS;
    from.model.options.hidden_count = 1;
    from.model.options.hidden[0] = width_of();
    return from;
}

static lg_status check_plan(const lg_fit_plan *plan, lg_error *error) {
    for (uint32_t i = 0; i < plan->phases && !is_regression(&state); i++)
        if (lg_fit_method_squares((lg_fit_method)plan->phase[i].method))
            return app_error(
                error, LG_UNSUPPORTED,
                "--method lm: takes sums of squares; a classification is learned by lbfgs, ssbroyden "
                "or adam");
    return LG_OK;
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    (void)user;
    state.resumed = stored != NULL;
    if (stored == NULL) {
        const lg_table_run from = usual_run();
        app_adopt(self, settings, &from, true);
    }
    run.rows = state.table.data.rows;
    memcpy(run.data_sha256, state.table.data.sha256, sizeof run.data_sha256);
    lg_table_options options = run.model.options;
    options.task = is_regression(&state) ? LG_TABLE_REGRESSION : LG_TABLE_CLASSIFICATION;
    const lg_status status =
        lg_table_init(&run.model, &options, state.inputs.count, state.outputs.count, error);
    return status == LG_OK ? check_plan(&run.training.plan, error) : status;
}

static int prepare(void *user, app *self) {
    lg_error error = {LG_OK, ""};
    (void)user;
    const lg_status status = split_rows(&state, self, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "%s", app_sentence(status, &error));
}

static lg_status hold_out(void *user, app *self, double validation, lg_error *error) {
    (void)user;
    run.training.validation = validation;
    return split_rows(&state, self, error);
}

/* ---- the fit ---- */

/* Whether the evidence of the data gives the priors. */
static bool seeks_evidence(const app *self) {
    return is_regression(&state) && !state.resumed && !lg_fit_plan_batches(&run.training.plan) &&
           !app_given(self, "decay") && !app_given(self, "weight-decay") && !app_given(self, "prior") &&
           lg_table_parameters(&run.model) <= LG_TABLE_MOST_LM;
}

/* Priors and parameters to start from (freed with lg_free). */
static lg_status find_start(const app *self, double **theta, lg_error *error) {
    const uint32_t given = run.decay.count, slices = lg_table_slices(&run.model);
    lg_table_start start = {.context = self->context, .run = &run, .problem = &state.problem};
    if (seeks_evidence(self)) {
        const lg_status status = lg_table_find_start(&start, !app_given(self, "hidden"), theta, error);
        state.evidence = start.evidence;
        return status;
    }
    if (given != 0 && given != slices)
        return app_error(error, LG_INVALID_ARGUMENT,
                         "--decay: %u numbers; the model has %u arrays of parameters", given, slices);
    return lg_table_first_parameters(self->context, &run, theta, error);
}

/* The decay of each parameter from that of its slice. */
static void spread_decay(void) {
    lg_slice_info info;
    if (run.decay.count == 0) return;
    state.decay = app_alloc(lg_table_parameters(&run.model), sizeof *state.decay);
    for (uint32_t s = 0; s < run.decay.count && lg_table_slice(&run.model, s, &info); s++)
        for (size_t i = 0; i < info.count; i++) state.decay[info.offset + i] = run.decay.value[s];
}

/* The method and its evaluations, where they are not given: Levenberg-Marquardt where its matrix is small,
 * for as many evaluations as are quick. */
static void choose_method(const app *self, lg_fit_options *options) {
    enum { LEAST = 5, MOST = 60, OTHERS = 300 };
    static const double WORK = 8e9;
    const bool large = lg_table_parameters(&run.model) > LG_TABLE_MOST_LM;
    if (state.resumed || !is_regression(&state) || app_given(self, "method")) return;
    if (large) run.training.plan.phase[0].method = LG_FIT_LBFGS;
    if (!app_given(self, "epochs") && !app_given(self, "seconds")) {
        const double evaluations = WORK / lg_table_work(&run.model, (double)state.trained);
        run.training.epochs = large ? OTHERS : (uint64_t)fmin(fmax(evaluations, LEAST), MOST);
        options->epochs = run.training.epochs;
    }
    options->plan = run.training.plan;
}

static lg_status create(void *user, app *self, const lg_fit_options *options, lg_fit **fit, lg_error *error) {
    lg_fit_options chosen = *options;
    double *theta = NULL;
    (void)user;
    state.problem = (lg_table_problem){&run.model, &state.samples, NULL};
    state.evidence = (lg_table_evidence_result){0};
    lg_status status = find_start(self, &theta, error);
    if (status == LG_OK) {
        choose_method(self, &chosen);
        spread_decay();
        state.problem.decay = state.decay;
        lg_table_fit_problem(&state.problem, &state.fit_problem);
        chosen.validation = 0.0;
        chosen.keep_best = state.trained < state.samples.count;
        status = lg_fit_create(self->context, &state.fit_problem, &chosen, theta, &state.fit, error);
    }
    lg_free(self->context, theta);
    *fit = state.fit;
    return status;
}

static void release(void *user) {
    (void)user;
    lg_fit_destroy(state.fit);
    lg_scaler_destroy(&state.input_scaler);
    lg_scaler_destroy(&state.output_scaler);
    free(state.samples.x);
    free(state.samples.y);
    free(state.samples.label);
    free(state.order);
    free(state.far);
    free(state.decay);
    state.samples = (lg_table_samples){0};
    state.order = NULL;
    state.far = NULL;
    state.decay = NULL;
    state.fit = NULL;
}

static size_t parameters(void *user) {
    (void)user;
    return lg_table_parameters(&run.model);
}

/* The lowest loss of the validation part so far. */
static double objective(void *user, app *self) {
    const uint64_t best = lg_fit_best_epoch(state.fit);
    (void)user;
    (void)self;
    return best > 0 ? lg_fit_history(state.fit, LG_FIT_VALIDATION)[best - 1] : (double)NAN;
}

/* ---- the commands ---- */

static const char *const sizes[] = {"4", "8", "16", "32", "16,16", "32,32", NULL};

static const train_task task = {.kind = &lg_recipe_table,
                                .settings = settings,
                                .training = &run.training,
                                .held_out = "validation",
                                .kept = "test",
                                .user = &state,
                                .read = read_training,
                                .describe = describe,
                                .prepare = prepare,
                                .hold_out = hold_out,
                                .create = create,
                                .release = release,
                                .finish = finish_training,
                                .objective = objective,
                                .parameters = parameters,
                                .sizes = sizes,
                                .prior = true};

static int end(int code) {
    lg_table_data_destroy(&state.table.data);
    lg_table_data_destroy(&state.test.data);
    free_names(&state.inputs);
    free_names(&state.outputs);
    free_names(&state.without);
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
    .arguments = "TABLE",
    .summary = "Fit a network to a table",
    .details =
        "TABLE is a CSV file with a header, an HDF5 file or a numpy array (.npy). Columns are scaled by mean "
        "and deviation of the training rows. Rows with missing cells are left out. A regression is trained "
        "by "
        "Levenberg-Marquardt with a weight decay for each array of parameters that the evidence of the data "
        "gives: it needs no validation part, and a network that is too wide does not learn the noise. A "
        "classification is trained by lbfgs, the parameters are those of the best epoch on the validation "
        "part.\n\nWithout --test a tenth of the rows is held out for judging and not learned; with it a "
        "regression learns all rows.\n\nrmse, r2, accuracy and f1 are those of the validation part or of "
        "--test. --plot draws "
        "predicted against true values, or the table of confusion.\n\nCtrl-C saves a checkpoint and ends "
        "with "
        "exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};

const app_command search_command = {
    SEARCH_COMMAND("TABLE"), .settings = APP_SETTINGS(APP_GIVEN(columns_options, values), SEARCH_SHARED),
    .run = run_search};
