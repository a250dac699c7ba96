/* lg-fit train: fit a network to a table. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-fit/fit.h"

enum { STREAM_WEIGHTS = 1, STREAM_SPLIT = 2 };

/* ---- settings ---- */

typedef struct train_values {
    const char *inputs, *outputs, *class_column, *test;
} train_values;

static const app_option train_options[] = {
    APP_ROW_TEXT(train_values, inputs, "inputs", "A,B,...",
                 "Columns to learn from (default: all that are not outputs)"),
    APP_ROW_TEXT(train_values, outputs, "outputs", "Y,...", "Columns to learn (default: the last one)"),
    APP_ROW_TEXT(train_values, class_column, "class", "COLUMN",
                 "Classification: the column with the classes, texts or numbers"),
    APP_ROW_TEXT(train_values, test, "test", "TABLE",
                 "Judge the model on this table (default: on the validation part)"),
    APP_ROW_END};

static train_values values;
static lg_table_run run; /* all that determines the result */
static const app_settings settings[] = {{lg_table_hyperparameters, &run, sizeof run}, {.rows = NULL}};

typedef struct training {
    column_names inputs, outputs; /* outputs: of a classification the classes */
    fit_table table, test;
    bool resumed;
    uint32_t *order; /* (rows): the training rows, then the validation part */
    size_t trained;
    lg_scaler input_scaler, output_scaler;
    lg_table_samples samples;
    double *decay; /* (parameters), or NULL */
    lg_table_evidence_result evidence;
    lg_table_problem problem;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} training;

static bool is_regression(void) {
    return values.class_column == NULL;
}

/* ---- columns ---- */

/* All columns with a name that are none of the outputs. */
static int default_inputs(const app *self, const lg_table_names *all, const column_names *outputs,
                          column_names *out) {
    *out = (column_names){0, app_alloc((size_t)all->count + 1, sizeof *out->name)};
    for (uint32_t i = 0; i < all->count; i++) {
        const char *name = all->name[i];
        if (name[0] == '\0') {
            app_warn(self, "column %u has no name and is not used", i + 1);
            continue;
        }
        if (has_name(outputs, name) ||
            (values.class_column != NULL && strcmp(name, values.class_column) == 0))
            continue;
        memcpy(out->name[out->count++], name, sizeof *out->name);
    }
    return APP_EXIT_OK;
}

static int default_outputs(const app *self, const lg_table_names *all, column_names *out) {
    *out = (column_names){1, app_alloc(1, sizeof *out->name)};
    const char *last = all->name[all->count - 1];
    (void)snprintf(out->name[0], LG_TABLE_NAME, "%s", last);
    (void)fprintf(stderr, "%s: the output is the last column, %s; --outputs or --class names others\n",
                  self->title, last);
    return APP_EXIT_OK;
}

static int choose_columns(const app *self, const char *path, training *state) {
    lg_table_names all = {.count = 0};
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    if (values.outputs != NULL && values.class_column != NULL)
        return app_usage(self,
                         "--outputs and --class: a table is learned by regression or by classification");
    const lg_status status = lg_table_names_read(self->context, path, NULL, &all, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (values.outputs != NULL)
        code = parse_names(self, "outputs", values.outputs, &state->outputs);
    else if (values.class_column == NULL)
        code = default_outputs(self, &all, &state->outputs);
    if (code == APP_EXIT_OK)
        code = values.inputs != NULL ? parse_names(self, "inputs", values.inputs, &state->inputs)
                                     : default_inputs(self, &all, &state->outputs, &state->inputs);
    lg_table_names_destroy(&all);
    if (code != APP_EXIT_OK) return code;
    for (uint32_t i = 0; i < state->inputs.count; i++) {
        const char *name = state->inputs.name[i];
        if (has_name(&state->outputs, name) ||
            (values.class_column != NULL && strcmp(name, values.class_column) == 0))
            return app_usage(self, "column %s is an input and an output", name);
    }
    if (state->inputs.count == 0)
        return app_fail(self, LG_FORMAT, "%s: there is no column to learn from", path);
    return APP_EXIT_OK;
}

/* ---- the data ---- */

static int check_classes(const app *self, training *state) {
    lg_table_data *data = &state->table.data;
    uint64_t *members = app_alloc(data->classes + 1, sizeof *members);
    int code = APP_EXIT_OK;
    for (size_t i = 0; i < data->rows; i++) members[data->label[i]]++;
    uint32_t present = 0;
    for (uint32_t c = 0; c < data->classes; c++) present += members[c] > 0;
    if (present < 2)
        code = app_fail(self, LG_FORMAT, "%s: column %s has one class only: there is nothing to tell apart",
                        state->table.path, values.class_column);
    for (uint32_t c = 0; c < data->classes && code == APP_EXIT_OK; c++)
        if (members[c] < 2)
            app_warn(self, "%s: class '%s' has %llu %s", state->table.path, data->class_name[c],
                     (unsigned long long)members[c], members[c] == 1 ? "row" : "complete rows");
    free(members);
    if (code != APP_EXIT_OK) return code;
    state->outputs = (column_names){data->classes, app_alloc(data->classes, sizeof *state->outputs.name)};
    memcpy(state->outputs.name, data->class_name, data->classes * sizeof *data->class_name);
    return APP_EXIT_OK;
}

static void warn_constant(const app *self, const training *state) {
    const lg_table_data *data = &state->table.data;
    for (uint32_t c = 0; c < data->columns; c++) {
        size_t same = 1;
        while (same < data->rows && data->values[same * data->columns + c] == data->values[c]) same++;
        const bool input = c < state->inputs.count;
        if (same == data->rows)
            app_warn(self, "%s: column %s is constant%s", state->table.path,
                     input ? state->inputs.name[c] : state->outputs.name[c - state->inputs.count],
                     input ? ": it says nothing" : ": there is nothing to learn of it");
    }
}

static int read_data(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    training *state = user;
    int code = choose_columns(self, path, state);
    if (code == APP_EXIT_OK)
        code =
            read_table(self, path, &state->inputs, &state->outputs, values.class_column, true, &state->table);
    if (code != APP_EXIT_OK) return code;
    if (state->table.data.rows < 2)
        return app_fail(self, LG_FORMAT, "%s: has one complete row; two at least are needed", path);
    if (!is_regression()) code = check_classes(self, state);
    if (code != APP_EXIT_OK) return code;
    warn_constant(self, state);
    const column_names none = {0, NULL};
    if (values.test != NULL)
        code = read_table(self, values.test, &state->inputs, is_regression() ? &state->outputs : &none,
                          values.class_column, true, &state->test);
    if (code == APP_EXIT_OK && values.test != NULL && !is_regression())
        code = match_classes(self, &state->test, state->outputs.name, state->outputs.count);
    if (code == APP_EXIT_OK) memcpy(sha256, state->table.data.sha256, LG_SHA256_TEXT);
    return code;
}

/* ---- the run ---- */

/* One hidden layer with as many weights as the rows can determine, and few enough to be quick. */
static uint32_t width_of(const training *state) {
    enum { LEAST = 6, MOST = 40, WEIGHTS = 320, CLASS_WIDTH = 32 };
    if (!is_regression()) return CLASS_WIDTH;
    const double n = state->inputs.count, m = state->outputs.count, rows = (double)state->table.data.rows;
    const double weights = fmin(rows * m / 2.0, WEIGHTS), width = (weights - n * m) / (n + m + 1.0);
    return (uint32_t)fmin(fmax(width, LEAST), MOST);
}

/* Beyond this many parameters the matrix of Levenberg-Marquardt takes too long. */
enum { MOST_LM = 1500 };

/* What is not given on the command line. */
static lg_table_run usual_run(const training *state) {
    lg_table_run from = {.training = {.dtype = LG_F64,
                                      .batch = 200,
                                      .lr = 3e-3,
                                      .schedule = LG_SCHEDULE_COSINE,
                                      .lr_step = 50,
                                      .lr_gamma = 0.0,
                                      .adam_eps = 1e-8,
                                      .shards = 4}};
    lg_table_options *options = &from.model.options;
    options->hidden_count = 1;
    options->hidden[0] = width_of(state);
    const bool regression = is_regression();
    from.training.epochs = 300;
    from.training.patience = regression ? 0 : 40;
    from.training.validation = regression && values.test != NULL ? 0.0 : 0.1;
    from.training.weight_decay = regression ? 0.0 : 2e-3;
    from.training.plan.phases = 1;
    from.training.plan.phase[0].method = regression ? LG_FIT_LM : LG_FIT_LBFGS;
    return from;
}

static bool has_adam(const lg_fit_plan *plan) {
    bool adam = plan->phases == 0;
    for (uint32_t i = 0; i < plan->phases; i++) adam = adam || plan->phase[i].method == LG_FIT_ADAM;
    return adam;
}

static lg_status check_plan(const lg_fit_plan *plan, lg_error *error) {
    for (uint32_t i = 0; i < plan->phases && !is_regression(); i++)
        if (lg_fit_method_squares((lg_fit_method)plan->phase[i].method))
            return app_error(
                error, LG_UNSUPPORTED,
                "--method lm: takes sums of squares; a classification is learned by lbfgs, ssbroyden "
                "or adam");
    return LG_OK;
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    training *state = user;
    state->resumed = stored != NULL;
    if (stored == NULL) {
        const lg_table_run from = usual_run(state);
        app_adopt(self, settings, &from, true);
    }
    run.rows = state->table.data.rows;
    memcpy(run.data_sha256, state->table.data.sha256, sizeof run.data_sha256);
    lg_table_options options = run.model.options;
    options.task = is_regression() ? LG_TABLE_REGRESSION : LG_TABLE_CLASSIFICATION;
    const lg_status status =
        lg_table_init(&run.model, &options, state->inputs.count, state->outputs.count, error);
    if (status != LG_OK) return status;
    return check_plan(&run.training.plan, error);
}

/* ---- parts ---- */

static int compare_rows(const double *a, const double *b, uint32_t columns) {
    for (uint32_t c = 0; c < columns; c++)
        if (a[c] != b[c]) return a[c] < b[c] ? -1 : 1;
    return 0;
}

typedef struct sorted_row {
    const double *values;
    uint32_t columns, label;
    bool trained;
} sorted_row;

static int compare_sorted(const void *a, const void *b) {
    const sorted_row *x = a, *y = b;
    const int order = compare_rows(x->values, y->values, x->columns);
    return order != 0 ? order : (x->label > y->label) - (x->label < y->label);
}

/* Equal rows, and whether they stand on both sides of the split. */
static void warn_duplicates(const app *self, const training *state) {
    const lg_table_data *data = &state->table.data;
    sorted_row *rows = app_alloc(data->rows, sizeof *rows);
    size_t repeated = 0, shared = 0, first = 0;
    bool both = false;
    for (size_t i = 0; i < data->rows; i++) {
        const size_t row = state->order[i];
        rows[i] = (sorted_row){data->values + row * data->columns, data->columns,
                               data->label != NULL ? data->label[row] : 0, i < state->trained};
    }
    qsort(rows, data->rows, sizeof *rows, compare_sorted);
    for (size_t i = 1; i < data->rows; i++) {
        const bool same = compare_sorted(&rows[i - 1], &rows[i]) == 0;
        repeated += same;
        if (!same) first = i, both = false;
        if (same && !both && rows[i].trained != rows[first].trained) both = true, shared++;
    }
    free(rows);
    if (repeated > 0) app_warn(self, "%s: %zu rows are repetitions of others", state->table.path, repeated);
    if (shared > 0)
        app_warn(
            self,
            "%s: %zu different rows are in the training and in the validation part: the errors there are "
            "too good",
            state->table.path, shared);
}

static lg_status no_room(lg_error *error) {
    return app_error(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters",
                     lg_table_parameters(&run.model));
}

/* Rows of `columns` numbers from column `first` on, scaled, in the order of the parts. */
static double *scaled_rows(const training *state, uint32_t first, const lg_scaler *scaler) {
    const lg_table_data *data = &state->table.data;
    double *out = app_alloc(data->rows * scaler->channels, sizeof *out);
    for (size_t i = 0; i < data->rows; i++)
        for (uint32_t c = 0; c < scaler->channels; c++)
            out[i * scaler->channels + c] =
                (data->values[(size_t)state->order[i] * data->columns + first + c] - scaler->mean[c]) /
                scaler->scale[c];
    return out;
}

/* Columns first .. first + count - 1 of the training rows. */
static lg_status fit_scaler(const training *state, const app *self, uint32_t first, uint32_t count,
                            lg_scaler *out, lg_error *error) {
    const lg_table_data *data = &state->table.data;
    double *part = app_alloc(state->trained * count, sizeof *part);
    for (size_t i = 0; i < state->trained; i++)
        memcpy(part + i * count, data->values + (size_t)state->order[i] * data->columns + first,
               count * sizeof *part);
    const lg_status status = lg_table_scaler_fit(self->context, part, count, NULL, state->trained, out);
    free(part);
    return status == LG_OK ? LG_OK : app_error(error, status, "the scaling of the columns");
}

static lg_status scale_all(training *state, const app *self, lg_error *error) {
    const uint32_t n = state->inputs.count, m = state->outputs.count;
    const size_t rows = state->table.data.rows;
    lg_status status = fit_scaler(state, self, 0, n, &state->input_scaler, error);
    if (status != LG_OK) return status;
    state->samples = (lg_table_samples){.count = rows, .training = state->trained};
    state->samples.x = scaled_rows(state, 0, &state->input_scaler);
    if (is_regression()) {
        status = fit_scaler(state, self, n, m, &state->output_scaler, error);
        if (status == LG_OK) state->samples.y = scaled_rows(state, n, &state->output_scaler);
        return status;
    }
    state->samples.label = app_alloc(rows, sizeof *state->samples.label);
    for (size_t i = 0; i < rows; i++) state->samples.label[i] = state->table.data.label[state->order[i]];
    return LG_OK;
}

static lg_status split(training *state, const app *self, lg_error *error) {
    const size_t rows = state->table.data.rows;
    const double part = run.training.validation;
    size_t held = (size_t)floor(part * (double)rows + 0.5);
    if (part > 0.0 && held == 0) held = 1;
    if (held >= rows) held = rows - 1;
    lg_rng rng;
    lg_rng_seed(&rng, run.training.seed, STREAM_SPLIT);
    state->order = app_alloc(rows, sizeof *state->order);
    for (size_t i = 0; i < rows; i++) state->order[i] = (uint32_t)i;
    lg_rng_shuffle(&rng, state->order, rows);
    state->trained = rows - held;
    return scale_all(state, self, error);
}

static int prepare(void *user, app *self) {
    training *state = user;
    lg_error error = {LG_OK, ""};
    const lg_status status = split(state, self, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", app_sentence(status, &error));
    return APP_EXIT_OK;
}

static lg_status hold_out(void *user, app *self, double validation, lg_error *error) {
    training *state = user;
    run.training.validation = validation;
    return split(state, self, error);
}

/* ---- the fit ---- */

/* Parameters as they are drawn; NULL: no memory. */
static double *first_parameters(void) {
    double *theta = app_try_alloc(lg_table_parameters(&run.model), sizeof *theta);
    lg_rng rng;
    lg_rng_seed(&rng, run.training.seed, STREAM_WEIGHTS);
    if (theta != NULL) lg_table_initialise(&run.model, &rng, theta);
    return theta;
}

/* The parameters of the present model with those of a narrower one in it: its units, and new ones of little
 * weight. */
static void grow_parameters(const lg_table *narrow, const double *from, double *theta) {
    static const double LITTLE = 0.1;
    lg_slice_info a, b;
    for (uint32_t s = 0; lg_table_slice(narrow, s, &a) && lg_table_slice(&run.model, s, &b); s++) {
        const size_t columns = a.rank == 2 ? a.dims[1] : a.dims[0], rows = a.count / columns;
        const size_t wide = b.rank == 2 ? b.dims[1] : b.dims[0];
        const bool reads = b.rank == 2 && b.dims[0] == run.model.net.inputs;
        for (size_t i = 0; !reads && i < b.count; i++) theta[b.offset + i] *= LITTLE;
        for (size_t i = 0; i < rows; i++)
            memcpy(theta + b.offset + i * wide, from + a.offset + i * columns, columns * sizeof *theta);
    }
}

static uint32_t slices_of(const lg_table *model) {
    lg_slice_info info;
    uint32_t slices = 0;
    while (lg_table_slice(model, slices, &info)) slices++;
    return slices;
}

static void count_slices(void) {
    run.decay.count = slices_of(&run.model);
}

/* Whether the priors are to be found. */
static bool seeks_evidence(const training *state, const app *self) {
    return is_regression() && !state->resumed && !has_adam(&run.training.plan) && !app_given(self, "decay") &&
           !app_given(self, "weight-decay") && !app_given(self, "prior") &&
           lg_table_parameters(&run.model) <= MOST_LM;
}

/* Multiplications in an evaluation of residuals, Jacobian and matrix, with what it costs beside them. */
static double work_of(const training *state, double rows) {
    static const double BESIDE = 100.0, AT_LEAST = 3e6;
    const double n = (double)lg_table_parameters(&run.model), m = state->outputs.count;
    return rows * m * n * (0.5 * n + BESIDE) + n * n * n + AT_LEAST;
}

enum { RACE_EVALUATIONS = 60 };
static const double RACE_WORK = 8e9, EVIDENCE_WORK = 3e9, TRAINING_WORK = 8e9;

/* One width: theta and the priors of the run, and how probable they make the data. */
static lg_status try_width(training *state, const app *self, uint32_t width, size_t rows,
                           const double *narrower, double **theta, lg_table_evidence_result *found,
                           double *work, lg_error *error) {
    const lg_table narrow = run.model;
    lg_table_options options = run.model.options;
    lg_table_evidence_options effort;
    options.hidden_count = 1;
    options.hidden[0] = width;
    lg_status status = lg_table_init(&run.model, &options, state->inputs.count, state->outputs.count, error);
    if (status != LG_OK) return status;
    *theta = first_parameters();
    if (*theta == NULL) return no_room(error);
    if (narrower != NULL) grow_parameters(&narrow, narrower, *theta);
    count_slices();
    lg_table_evidence_options_init(&effort);
    effort.go_on = narrower != NULL;
    effort.rows = rows;
    effort.evaluations = RACE_EVALUATIONS;
    status =
        lg_table_evidence(self->context, &state->problem, &effort, *theta, run.decay.value, found, error);
    *work += found->evaluations * work_of(state, (double)rows);
    return status;
}

/* The race of widths: the best model so far with its parameters. */
typedef struct race {
    lg_table_run best;
    double *theta, high, work;
    bool better; /* the last width was */
} race;

/* A width from parameters as they are drawn, or grown from those of the best narrower one. */
static lg_status run_lane(training *state, const app *self, uint32_t width, size_t rows, bool grown, race *r,
                          lg_error *error) {
    static const double CLEARLY = 2.0; /* seven times as probable */
    double *theta = NULL;
    lg_table_evidence_result result = {0};
    run = r->best;
    const lg_status status =
        try_width(state, self, width, rows, grown ? r->theta : NULL, &theta, &result, &r->work, error);
    state->evidence.evaluations += result.evaluations;
    const bool better = status == LG_OK && (r->theta == NULL || result.evidence > r->high + CLEARLY);
    if (better) {
        free(r->theta);
        r->best = run, r->high = result.evidence, r->theta = theta;
        r->better = true;
    } else {
        free(theta);
    }
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* What a lane of the race takes. */
static double lane_work(const training *state, uint32_t width, double rows) {
    const lg_table kept = run.model;
    lg_table_options options = run.model.options;
    options.hidden_count = 1;
    options.hidden[0] = width;
    (void)lg_table_init(&run.model, &options, state->inputs.count, state->outputs.count, NULL);
    const double work = RACE_EVALUATIONS * work_of(state, rows);
    run.model = kept;
    return work;
}

/* The width whose evidence is highest, from small to large, until three in a row are not clearly better or
 * the work is done. The run gets its model and priors; *theta its parameters. */
static lg_status choose_width(training *state, const app *self, size_t rows, double **theta,
                              lg_error *error) {
    static const uint32_t widths[] = {1, 2, 4, 6, 8, 12, 16, 24, 32, 48};
    enum { WORSE = 3 };
    race r = {.best = run, .high = -INFINITY};
    uint32_t worse = 0;
    const double columns = (double)state->inputs.count + state->outputs.count + 1.0;
    const size_t first = 4.0 * columns > (double)rows * state->outputs.count ? 0 : 1;
    lg_status status = LG_OK;
    for (size_t i = first; i < LG_COUNT(widths) && worse < WORSE && r.work < RACE_WORK && status == LG_OK;
         i++) {
        const double lane = lane_work(state, widths[i], (double)rows);
        const bool grown = r.theta != NULL && r.work + 2.0 * lane <= RACE_WORK;
        r.better = false;
        if (r.theta != NULL && r.work + lane > RACE_WORK) break;
        if (grown) status = run_lane(state, self, widths[i], rows, true, &r, error);
        if (status == LG_OK) status = run_lane(state, self, widths[i], rows, false, &r, error);
        worse = r.better ? 0 : worse + 1;
    }
    run = r.best;
    *theta = r.theta;
    if (status != LG_OK) return status;
    return *theta != NULL ? LG_OK : app_error(error, LG_NOT_FINITE, "no width has finite residuals");
}

/* Width, priors and parameters to start from. */
static lg_status find_evidence(training *state, const app *self, double **theta, lg_error *error) {
    static const double LEAST_ROWS = 1000.0, FOR_WEIGHTS = 3.0;
    lg_table_evidence_options options;
    const uint32_t before = state->evidence.evaluations;
    const bool free_width = !app_given(self, "hidden");
    lg_table_evidence_options_init(&options);
    double rows = fmin(LEAST_ROWS, (double)state->trained);
    lg_status status = free_width ? choose_width(state, self, (size_t)rows, theta, error) : LG_OK;
    if (status != LG_OK) return status;
    if (!free_width) *theta = first_parameters();
    if (*theta == NULL) return no_room(error);
    count_slices();
    rows =
        fmin(fmax(FOR_WEIGHTS * (double)lg_table_parameters(&run.model) / state->outputs.count, LEAST_ROWS),
             (double)state->trained);
    options.rows = (size_t)rows;
    options.evaluations = (uint32_t)fmin(fmax(EVIDENCE_WORK / work_of(state, rows), 12.0), 200.0);
    options.go_on = free_width;
    const uint32_t raced = state->evidence.evaluations - before;
    status = lg_table_evidence(self->context, &state->problem, &options, *theta, run.decay.value,
                               &state->evidence, error);
    state->evidence.evaluations += raced;
    return status;
}

/* The decay of each parameter from that of its slice. */
static void spread_decay(training *state) {
    lg_slice_info info;
    if (run.decay.count == 0) return;
    state->decay = app_alloc(lg_table_parameters(&run.model), sizeof *state->decay);
    for (uint32_t s = 0; s < run.decay.count && lg_table_slice(&run.model, s, &info); s++)
        for (size_t i = 0; i < info.count; i++) state->decay[info.offset + i] = run.decay.value[s];
}

static lg_status check_decay(lg_error *error) {
    if (run.decay.count == 0 || run.decay.count == slices_of(&run.model)) return LG_OK;
    return app_error(error, LG_INVALID_ARGUMENT, "--decay: %u numbers; the model has %u arrays of parameters",
                     run.decay.count, slices_of(&run.model));
}

/* The method and its evaluations, where they are not given: Levenberg-Marquardt where its matrix is small,
 * for as many evaluations as are quick. */
static void choose_method(const training *state, const app *self, lg_fit_options *options) {
    enum { LEAST = 5, MOST = 60, OTHERS = 300 };
    const bool large = lg_table_parameters(&run.model) > MOST_LM;
    if (state->resumed || !is_regression() || app_given(self, "method")) return;
    if (large) run.training.plan.phase[0].method = LG_FIT_LBFGS;
    if (!app_given(self, "epochs") && !app_given(self, "evaluations") && !app_given(self, "seconds")) {
        const double evaluations = TRAINING_WORK / work_of(state, (double)state->trained);
        run.training.epochs = large ? OTHERS : (uint64_t)fmin(fmax(evaluations, LEAST), MOST);
        options->epochs = run.training.epochs;
    }
    options->plan = run.training.plan;
}

static lg_status create(void *user, app *self, const lg_fit_options *options, lg_fit **fit, lg_error *error) {
    training *state = user;
    lg_fit_options chosen = *options;
    double *theta = NULL;
    state->problem = (lg_table_problem){&run.model, &state->samples, NULL};
    state->evidence = (lg_table_evidence_result){0};
    lg_status status = LG_OK;
    if (seeks_evidence(state, self)) {
        status = find_evidence(state, self, &theta, error);
    } else {
        status = check_decay(error);
        theta = status == LG_OK ? first_parameters() : NULL;
        if (status == LG_OK && theta == NULL) status = no_room(error);
    }
    if (status == LG_OK) {
        choose_method(state, self, &chosen);
        spread_decay(state);
        state->problem.decay = state->decay;
        lg_table_fit_problem(&state->problem, &state->fit_problem);
        chosen.validation = 0.0;
        chosen.keep_best = state->trained < state->samples.count;
        status = lg_fit_create(self->context, &state->fit_problem, &chosen, theta, &state->fit, error);
    }
    free(theta);
    *fit = state->fit;
    return status;
}

static void release(void *user) {
    training *state = user;
    lg_fit_destroy(state->fit);
    lg_scaler_destroy(&state->input_scaler);
    lg_scaler_destroy(&state->output_scaler);
    free(state->samples.x);
    free(state->samples.y);
    free(state->samples.label);
    free(state->order);
    free(state->decay);
    state->samples = (lg_table_samples){0};
    state->order = NULL;
    state->decay = NULL;
    state->fit = NULL;
}

static size_t parameters(void *user) {
    (void)user;
    return lg_table_parameters(&run.model);
}

/* The lowest loss of the validation part so far. */
static double objective(void *user, app *self) {
    const training *state = user;
    const uint64_t best = lg_fit_best_epoch(state->fit);
    (void)self;
    return best > 0 ? lg_fit_history(state->fit, LG_FIT_VALIDATION)[best - 1] : (double)NAN;
}

/* ---- result ---- */

/* The model as a file; borrows from the state, but for theta, low and high. */
static lg_table_file file_of(const training *state, const app *self) {
    lg_table_file file = {.run = run,
                          .inputs = state->input_scaler,
                          .outputs = state->output_scaler,
                          .input_name = state->inputs.name,
                          .output_name = state->outputs.name,
                          .rmse = (double)NAN,
                          .accuracy = (double)NAN,
                          .f1 = (double)NAN};
    const uint32_t n = state->inputs.count;
    file.parameters = lg_table_parameters(&run.model);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    lg_fit_parameters(state->fit, file.theta);
    file.low = app_alloc(n, sizeof *file.low);
    file.high = app_alloc(n, sizeof *file.high);
    for (uint32_t c = 0; c < n; c++) {
        file.low[c] = INFINITY, file.high[c] = -INFINITY;
        for (size_t i = 0; i < state->trained; i++) {
            const double value = table_row(&state->table, state->order[i])[c];
            file.low[c] = fmin(file.low[c], value);
            file.high[c] = fmax(file.high[c], value);
        }
    }
    if (!is_regression())
        (void)snprintf(file.class_column, sizeof file.class_column, "%s", values.class_column);
    file.provenance = app_provenance(self, run.training.seed);
    return file;
}

typedef struct verdict {
    judgement trained, judged;
    const char *part; /* "validation", "test" or "training" */
} verdict;

static lg_status judge(const training *state, const app *self, const lg_table_file *file, verdict *v,
                       lg_error *error) {
    const size_t held = state->table.data.rows - state->trained;
    lg_status status =
        judge_rows(self, file, &state->table, state->order, state->trained, &v->trained, error);
    if (status != LG_OK) return status;
    v->part = values.test != NULL ? "test" : held > 0 ? "validation" : "training";
    if (values.test != NULL) return judge_rows(self, file, &state->test, NULL, 0, &v->judged, error);
    return judge_rows(self, file, &state->table, state->order + (held > 0 ? state->trained : 0),
                      held > 0 ? held : state->trained, &v->judged, error);
}

static void report_json(const training *state, const train_session *session, const lg_table_file *file,
                        const verdict *v) {
    app_json json;
    app_json_begin(&json);
    judgement_json(&json, file, &v->judged);
    app_json_text(&json, "part", v->part);
    app_json_real(&json, "train_scaled_rmse", v->trained.scaled_rmse);
    app_json_real(&json, "train_accuracy", v->trained.accuracy);
    app_json_text(&json, "task", lg_table_task_name(run.model.options.task));
    app_json_size(&json, "parameters", file->parameters);
    app_json_size(&json, "rows", state->table.data.rows);
    app_json_size(&json, "rows_left_out", state->table.left_out);
    app_json_size(&json, "train_rows", state->trained);
    app_json_size(&json, "inputs", state->inputs.count);
    app_json_size(&json, "outputs", state->outputs.count);
    app_json_size(&json, "evidence_evaluations", state->evidence.evaluations);
    app_json_real(&json, "effective_parameters",
                  state->evidence.evaluations > 0 ? state->evidence.effective : (double)NAN);
    app_json_real(&json, "log_evidence",
                  state->evidence.evaluations > 0 ? state->evidence.evidence : (double)NAN);
    app_json_real(&json, "noise", state->evidence.evaluations > 0 ? state->evidence.noise : (double)NAN);
    train_json(session, &json);
    app_json_end(&json);
}

static void report(const training *state, const train_session *session, const lg_table_file *file,
                   const verdict *v) {
    if (session->app->json) {
        report_json(state, session, file, v);
        return;
    }
    (void)printf("%s: %s of %zu rows, %u inputs, %s network, %zu parameters\n", train_given_files.out,
                 lg_table_task_name(run.model.options.task), state->trained, state->inputs.count,
                 lg_net_kind_name(run.model.options.network), file->parameters);
    if (state->evidence.evaluations > 0)
        (void)printf("the data determine %.1f parameters; noise about %.3g of the outputs' deviation\n",
                     state->evidence.effective, state->evidence.noise);
    (void)printf("%s rows (%zu):\n", v->part, v->judged.rows);
    judgement_print(file, &v->judged);
}

/* What a simple guess would have: the mean, or the most frequent class. */
static double guessed(const training *state, const verdict *v) {
    if (is_regression()) return 1.0;
    const uint32_t classes = state->outputs.count;
    uint64_t most = 0;
    for (uint32_t c = 0; c < classes; c++) {
        uint64_t members = 0;
        for (uint32_t k = 0; k < classes; k++) members += v->trained.confusion[c * classes + k];
        if (members > most) most = members;
    }
    return 1.0 - (double)most / (double)v->trained.rows;
}

/* A fit that starts from the evidence's parameters has nothing left to lower. */
static int judge_training(const training *state, const train_session *session, double wrong, double guess) {
    static const double LEARNED = 0.99;
    const char *what = is_regression() ? "mean squared error" : "share of wrong rows",
               *simple = is_regression() ? "the mean" : "the most frequent class";
    if (state->evidence.evaluations == 0) return train_judge(session, what, wrong, simple, guess);
    if (!(wrong < LEARNED * guess))
        app_warn(session->app,
                 "the model has learned nothing: its %s %.3g is not below %.3g, that of %s; the inputs say "
                 "nothing of "
                 "the outputs, or there are too few rows",
                 what, wrong, guess, simple);
    return APP_EXIT_OK;
}

static int finish(void *user, train_session *session) {
    const training *state = user;
    const app *self = session->app;
    lg_error error = {LG_OK, ""};
    verdict v = {.part = NULL};
    lg_table_file file = file_of(state, self);
    lg_status status = judge(state, self, &file, &v, &error);
    int code = status == LG_OK ? APP_EXIT_OK
                               : app_fail(self, status, "after training: %s", app_sentence(status, &error));
    int judged = APP_EXIT_OK;
    if (code == APP_EXIT_OK) {
        warn_duplicates(self, state);
        if (values.test != NULL) warn_outside(self, &v.judged, values.test, train_given_files.out);
        const double wrong =
            is_regression() ? v.trained.scaled_rmse * v.trained.scaled_rmse : 1.0 - v.trained.accuracy;
        judged = judge_training(state, session, wrong, guessed(state, &v));
        file.rmse = v.judged.scaled_rmse;
        file.accuracy = v.judged.accuracy;
        file.f1 = v.judged.f1;
        status = lg_model_save_table(self->context, train_given_files.out, &file, state->fit, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, train_given_files.out);
    }
    if (code == APP_EXIT_OK && train_given_files.plot != NULL) {
        status = draw_judgement(self, train_given_files.plot, &file, &v.judged, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, train_given_files.plot);
    }
    if (code == APP_EXIT_OK) report(state, session, &file, &v);
    judgement_free(&v.trained);
    judgement_free(&v.judged);
    free(file.theta);
    free(file.low);
    free(file.high);
    return code == APP_EXIT_OK ? judged : code;
}

/* ---- the command ---- */

static const char *const sizes[] = {"4", "8", "16", "32", "16,16", "32,32", NULL};

int with_task(app *self, int (*main_)(app *self, const train_task *task)) {
    training state = {.fit = NULL};
    const train_task task = {.kind = &lg_run_table,
                             .settings = settings,
                             .training = &run.training,
                             .held_out = "validation",
                             .kept = "test",
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
                             .sizes = sizes,
                             .prior = true};
    const int code = main_(self, &task);
    lg_table_data_destroy(&state.table.data);
    lg_table_data_destroy(&state.test.data);
    free_names(&state.inputs);
    free_names(&state.outputs);
    return code;
}

static int run_train(app *self) {
    return with_task(self, train_main);
}

const app_command train_command = {
    .name = "train",
    .arguments = "TABLE",
    .summary = "Fit a network to a table",
    .details =
        "TABLE is a CSV file with a header, an HDF5 file or a numpy array (.npy). Columns are scaled by mean "
        "and "
        "deviation of the training rows. Rows with missing cells are left out. A regression is trained by "
        "Levenberg-Marquardt with a weight decay for each array of parameters that the evidence of the data "
        "gives: "
        "it needs no validation part, and a network that is too wide does not learn the noise. A "
        "classification is "
        "trained by lbfgs, the parameters are those of the best epoch on the validation part.\n\nrmse, r2, "
        "accuracy "
        "and f1 are those of the validation part or of --test. --plot draws predicted against true values, "
        "or the "
        "table of confusion.\n\nCtrl-C saves a checkpoint and ends with exit code 130; --resume continues to "
        "the "
        "same bits.",
    .options = train_options,
    .values = &values,
    TRAIN_SHARED,
    .settings = settings,
    .arguments_min = 1,
    .arguments_max = 1,
    .run = run_train};
