/* The recipe of tables: splits and scales the rows, makes the fit problem, and judges the model. */
#include "table/files/recipe.h"

#include <math.h>
#include <string.h>

enum { STREAM_SPLIT = 2 };

/* ---- the data ---- */

static lg_status read_data(lg_training *self, lg_error *error) {
    const lg_table_state *s = self->state;
    if (self->file == NULL) LG_TRY(lg_table_choose(self, error));
    LG_TRY(lg_table_read_rows(self, error));
    memcpy(self->sha256, s->table.data.sha256, sizeof self->sha256);
    return LG_OK;
}

static void close_data(lg_training *self) {
    lg_table_state *s = self->state;
    lg_table_data_destroy(&s->table.data);
    lg_table_data_destroy(&s->test.data);
    lg_table_names_destroy(&s->inputs);
    lg_table_names_destroy(&s->outputs);
    lg_table_names_destroy(&s->without);
}

/* ---- the run ---- */

/* Width of the hidden layer: about as many weights as the rows can determine, but few enough for a quick
 * fit. */
static uint32_t width_of(const lg_table_state *s) {
    enum { LEAST = 6, MOST = 40, WEIGHTS = 320, CLASS_WIDTH = 32 };
    if (!lg_table_is_regression(s)) return CLASS_WIDTH;
    const double n = s->inputs.count, m = s->outputs.count, rows = (double)s->table.data.rows;
    const double weights = fmin(rows * m / 2.0, WEIGHTS), width = (weights - n * m) / (n + m + 1.0);
    return (uint32_t)fmin(fmax(width, LEAST), MOST);
}

enum { FEWEST = 5, MANY = 60, OTHERS = 300 }; /* evaluations of the loss */

/* The settings where the command line gives none. tested: --test is given. */
static lg_table_run usual_run(bool regression, bool tested, uint32_t width) {
    lg_table_run from = {.training = {.dtype = LG_F64,
                                      .epochs = 300,
                                      .batch = 200,
                                      .lr = 3e-3,
                                      .schedule = LG_SCHEDULE_COSINE,
                                      .lr_step = 50,
                                      .lr_gamma = 0.0,
                                      .adam_eps = 1e-8,
                                      .patience = regression ? 0 : 40,
                                      .validation = regression && tested ? 0.0 : 0.1,
                                      .weight_decay = regression ? 0.0 : 2e-3,
                                      .plan = {.phases = 1}}};
    from.training.plan.phase[0].method = regression ? LG_FIT_LM : LG_FIT_LBFGS;
    from.model.options.hidden_count = 1;
    from.model.options.hidden[0] = width;
    return from;
}

/* Small regressions, large ones, classifications. */
static bool usual(lg_training *self, uint32_t at) {
    lg_table_run from = usual_run(at < 2, false, 1);
    if (at == 0) from.training.epochs = MANY;
    if (at == 1) from.training.plan.phase[0].method = LG_FIT_LBFGS;
    lg_training_adopt(self, &from, true);
    return at < 3;
}

static lg_status describe(lg_training *self, lg_error *error) {
    const lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    const lg_table_run from = usual_run(lg_table_is_regression(s), s->given.test != NULL, width_of(s));
    if (self->stored == NULL) lg_training_adopt(self, &from, true);
    run->rows = s->table.data.rows;
    memcpy(run->data_sha256, s->table.data.sha256, sizeof run->data_sha256);
    lg_table_options options = run->model.options;
    options.task = lg_table_is_regression(s) ? LG_TABLE_REGRESSION : LG_TABLE_CLASSIFICATION;
    LG_TRY(lg_table_init(&run->model, &options, s->inputs.count, s->outputs.count, error));
    const lg_fit_plan *plan = &run->training.plan;
    for (uint32_t i = 0; i < plan->phases && !lg_table_is_regression(s); i++)
        if (lg_fit_method_squares((lg_fit_method)plan->phase[i].method))
            return lg_fail(error, LG_UNSUPPORTED,
                           "--optimizer lm minimises only sums of squares; for a classification, take lbfgs, "
                           "ssbroyden or adam");
    return LG_OK;
}

/* ---- the scaling ---- */

/* Inputs are scaled without far cells, which would make the differences between all other cells vanish.
 * Outputs are scaled with all cells, because the loss contains all of them. */
static lg_status fit_scaler(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_data *data = &s->table.data;
    double *column;
    uint32_t *chosen;
    LG_TRAINING_ARRAY(self, column, s->trained, error);
    LG_TRAINING_ARRAY(self, chosen, s->trained, error);
    LG_TRAINING_ARRAY(self, s->scaler.mean, data->columns, error);
    LG_TRAINING_ARRAY(self, s->scaler.scale, data->columns, error);
    for (uint32_t c = 0; c < data->columns; c++) {
        lg_table_far far = {.limit = INFINITY};
        lg_scaler one = {0};
        uint32_t kept = 0;
        for (size_t i = 0; i < s->trained; i++) column[i] = lg_table_sheet_row(&s->table, s->order[i])[c];
        lg_status status =
            c < s->inputs.count ? lg_table_find_far(self->context, column, 1, s->trained, &far) : LG_OK;
        for (uint32_t i = 0; i < s->trained; i++)
            if (!lg_table_is_far(&far, column[i])) chosen[kept++] = i;
        if (status == LG_OK) status = lg_table_scaler_fit(self->context, column, 1, chosen, kept, &one);
        if (status != LG_OK) return lg_fail(error, status, "the columns cannot be scaled");
        s->scaler.mean[c] = one.mean[0];
        s->scaler.scale[c] = one.scale[0];
        lg_scaler_destroy(&one);
    }
    return LG_OK;
}

/* `count` columns of the scaler from `first` on; borrows its arrays. */
static lg_scaler part_of(const lg_scaler *scaler, uint32_t first, uint32_t count) {
    return (lg_scaler){.channels = count, .mean = scaler->mean + first, .scale = scaler->scale + first};
}

/* Writes `count` columns from `first` on, scaled, training rows first. Far cells are cut to MOST deviations,
 * whose squares can still be summed. */
static lg_status scaled_rows(lg_training *self, uint32_t first, uint32_t count, double **out,
                             lg_error *error) {
    static const double MOST = 1e100;
    const lg_table_state *s = self->state;
    const lg_scaler scaler = part_of(&s->scaler, first, count);
    LG_TRAINING_ARRAY(self, *out, s->samples.count * count, error);
    for (size_t i = 0; i < s->samples.count; i++) {
        const double *row = lg_table_sheet_row(&s->table, s->order[i]) + first;
        for (uint32_t c = 0; c < count; c++)
            (*out)[i * count + c] = fmax(-MOST, fmin((row[c] - scaler.mean[c]) / scaler.scale[c], MOST));
    }
    return LG_OK;
}

static lg_status make_samples(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const size_t rows = s->table.data.rows;
    LG_TRY(fit_scaler(self, error));
    s->samples = (lg_table_samples){.count = rows, .training = s->trained};
    LG_TRY(scaled_rows(self, 0, s->inputs.count, &s->samples.x, error));
    if (lg_table_is_regression(s))
        return scaled_rows(self, s->inputs.count, s->outputs.count, &s->samples.y, error);
    LG_TRAINING_ARRAY(self, s->samples.label, rows, error);
    for (size_t i = 0; i < rows; i++) s->samples.label[i] = s->table.data.label[s->order[i]];
    return LG_OK;
}

/* ---- training and validation part ---- */

/* Warns of too few training rows, once, however many fits are made. */
static void warn_few(const lg_training *self) {
    enum { LEAST = 10 };
    lg_table_state *s = self->state;
    const size_t inputs = s->inputs.count, least = inputs + 2 > LEAST ? inputs + 2 : LEAST;
    if (s->few_told || s->trained >= least) return;
    s->few_told = true;
    LG_WARN(self,
            "%s: there are too few rows: %zu to learn from, with %zu inputs; at least %zu are needed for "
            "reliable figures of errors and noise",
            s->table.path, s->trained, inputs, least);
}

static lg_status prepare(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_fit_settings *training = lg_training_settings(self);
    const size_t rows = s->table.data.rows;
    size_t held = (size_t)floor(training->validation * (double)rows + 0.5);
    if (training->validation > 0.0 && held == 0) held = 1;
    if (held >= rows) held = rows - 1;
    lg_rng rng;
    lg_rng_seed(&rng, training->seed, STREAM_SPLIT);
    LG_TRAINING_ARRAY(self, s->order, rows, error);
    for (size_t i = 0; i < rows; i++) s->order[i] = (uint32_t)i;
    lg_rng_shuffle(&rng, s->order, rows);
    s->trained = rows - held;
    warn_few(self);
    return make_samples(self, error);
}

/* ---- the problem ---- */

/* Whether the priors come from the evidence of the data. */
static bool seeks_evidence(const lg_training *self) {
    const lg_table_run *run = self->run;
    return lg_table_is_regression(self->state) && self->stored == NULL &&
           !lg_fit_plan_batches(&run->training.plan) && !self->given(self, "decay") &&
           !self->given(self, "weight-decay") && !self->given(self, "prior") &&
           lg_table_parameters(&run->model) <= LG_TABLE_MOST_LM;
}

/* Finds the priors and initial parameters. */
static lg_status find_start(lg_training *self, lg_error *error) {
    const lg_table_run *run = self->run;
    const uint32_t given = run->decay.count, slices = lg_table_slices(&run->model);
    if (seeks_evidence(self)) return lg_table_find_start(self, !self->given(self, "hidden"), error);
    if (given != 0 && given != slices)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--decay: has %u numbers, but the model has %u arrays of parameters", given, slices);
    return lg_table_first_parameters(self, &run->model, &self->theta, error);
}

/* Sets the decay of each parameter to the decay of its slice. The list of decays is empty, or it has a number
 * for each slice. */
static lg_status spread_decay(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_run *run = self->run;
    lg_slice_info info;
    double *decay;
    if (run->decay.count == 0) return LG_OK;
    LG_TRAINING_ARRAY(self, decay, lg_table_parameters(&run->model), error);
    for (uint32_t k = 0; lg_table_slice(&run->model, k, &info); k++)
        for (size_t i = 0; i < info.count; i++) decay[info.offset + i] = run->decay.value[k];
    s->problem.decay = decay;
    return LG_OK;
}

/* Chooses the method, and the evaluations unless they are limited: Levenberg-Marquardt if its matrix is
 * small, with as many evaluations as are quick. */
static void choose_method(lg_training *self) {
    static const double WORK = 8e9;
    const lg_table_state *s = self->state;
    lg_table_run *run = self->run;
    const bool large = lg_table_parameters(&run->model) > LG_TABLE_MOST_LM;
    if (self->stored != NULL || !lg_table_is_regression(s) || self->given(self, "optimizer")) return;
    if (large) run->training.plan.phase[0].method = LG_FIT_LBFGS;
    if (!self->given(self, "epochs") && !self->given(self, "seconds")) {
        const double evaluations = WORK / lg_table_work(&run->model, (double)s->trained);
        run->training.epochs = large ? OTHERS : (uint64_t)fmin(fmax(evaluations, FEWEST), MANY);
        self->options.epochs = run->training.epochs;
    }
    self->options.plan = run->training.plan;
}

static lg_status make_problem(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    s->problem = (lg_table_problem){&((lg_table_run *)self->run)->model, &s->samples, NULL};
    s->evidence = (lg_table_evidence_result){0};
    LG_TRY(find_start(self, error));
    choose_method(self);
    LG_TRY(spread_decay(self, error));
    lg_table_fit_problem(&s->problem, &self->problem);
    self->options.validation = 0.0;
    self->options.keep_best = s->trained < s->samples.count;
    return LG_OK;
}

/* ---- the model ---- */

/* The file's number of rows is the number of training rows. Ranges have far cells, too. */
static lg_status make_file(lg_training *self, double *theta, lg_error *error) {
    lg_table_state *s = self->state;
    const uint32_t inputs = s->inputs.count, outputs = s->outputs.count;
    lg_table_file file = {.run = *(const lg_table_run *)self->run,
                          .parameters = self->problem.parameters,
                          .theta = theta,
                          .inputs = part_of(&s->scaler, 0, inputs),
                          .input_name = s->inputs.name,
                          .output_name = s->outputs.name};
    if (lg_table_is_regression(s)) file.outputs = part_of(&s->scaler, inputs, outputs);
    file.run.rows = s->trained;
    memcpy(file.class_column, s->class_name, sizeof file.class_column);
    LG_TRAINING_ARRAY(self, file.low, inputs, error);
    LG_TRAINING_ARRAY(self, file.high, inputs, error);
    for (uint32_t c = 0; c < inputs; c++) {
        file.low[c] = INFINITY, file.high[c] = -INFINITY;
        for (size_t i = 0; i < s->trained; i++) {
            const double value = lg_table_sheet_row(&s->table, s->order[i])[c];
            file.low[c] = fmin(file.low[c], value), file.high[c] = fmax(file.high[c], value);
        }
    }
    s->file = file;
    return LG_OK;
}

static lg_status save(lg_training *self, void *into, lg_error *error) {
    const lg_table_state *s = self->state;
    lg_table_file *file = into;
    const lg_provenance provenance = file->provenance;
    *file = s->file;
    file->provenance = provenance;
    file->rmse = isfinite(s->judged.scaled_rmse) ? s->judged.scaled_rmse : (double)NAN;
    file->accuracy = s->judged.accuracy;
    file->f1 = s->judged.f1;
    return LG_OK;
}

/* ---- results ---- */

/* A training error from here on, in units of the error of a simple guess, means that nothing was learned. */
static const double LEARNED = 0.99;

/* Judges a regression of large training error again, without the rows whose errors are above a deviation of
 * the outputs and far from all others. If they make up the error, s->usual is this judgement, with a warning.
 */
static lg_status judge_usual(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_judgement *j = &s->learned;
    const uint32_t m = s->outputs.count;
    lg_table_far far;
    lg_table_judgement rest;
    uint32_t *chosen, kept = 0;
    double *size, wrong = 0.0;
    s->usual = *j;
    if (!(j->scaled_rmse >= LEARNED) || isinf(j->scaled_rmse)) return LG_OK;
    LG_TRAINING_ARRAY(self, size, j->rows, error);
    LG_TRAINING_ARRAY(self, chosen, j->rows, error);
    for (size_t i = 0; i < j->rows * m; i++)
        size[i / m] = hypot(size[i / m], (j->prediction[i] - j->truth[i]) / s->file.outputs.scale[i % m]);
    LG_TRY(lg_table_find_far(self->context, size, 1, j->rows, &far));
    for (size_t i = 0; i < j->rows; i++)
        if (size[i] <= 1.0 || !lg_table_is_far(&far, size[i])) chosen[kept++] = s->order[i];
    LG_TRY(lg_table_judge(self, &s->file, &s->table, chosen, kept, &rest, error));
    for (uint32_t o = 0; o < m; o++) wrong += isnan(rest.r2[o]) ? 0.0 : (1.0 - rest.r2[o]) / m;
    if (kept == j->rows || !(wrong < LEARNED)) return LG_OK;
    s->usual = rest;
    LG_WARN(self,
            "%s: the model does not follow %zu of %zu training rows, the worst in %s %zu: mean squared error "
            "%.3g of the variance; %.3g without them",
            s->table.path, j->rows - kept, j->rows, s->table.data.place,
            s->table.data.line[s->order[far.farthest]], j->scaled_rmse * j->scaled_rmse, wrong);
    return LG_OK;
}

static lg_status judge_parts(lg_training *self, lg_error *error) {
    lg_table_state *s = self->state;
    const size_t held = s->table.data.rows - s->trained;
    LG_TRY(lg_table_judge(self, &s->file, &s->table, s->order, s->trained, &s->learned, error));
    LG_TRY(judge_usual(self, error));
    s->part = s->given.test != NULL ? "test" : held > 0 ? "validation" : "training";
    if (s->given.test != NULL) return lg_table_judge(self, &s->file, &s->test, NULL, 0, &s->judged, error);
    return lg_table_judge(self, &s->file, &s->table, s->order + (held > 0 ? s->trained : 0),
                          held > 0 ? held : s->trained, &s->judged, error);
}

/* Warns of far cells (lg_table_find_far) in the output columns of the table on which a regression is
 * judged. */
static lg_status warn_far_outputs(const lg_training *self, const lg_table_sheet *sheet, lg_error *error) {
    const lg_table_file *file = &((lg_table_state *)self->state)->file;
    return lg_table_warn_far(self->context, sheet, sheet->inputs, file->output_name, sheet->outputs,
                             "most of the error comes from these cells", error);
}

static void warn_of_learned(const lg_training *self, const lg_table_sheet *sheet, const char *sha256) {
    if (strcmp(sheet->data.sha256, sha256) == 0)
        LG_WARN(self,
                "%s is the table of the training: most of these errors are of rows that the model was fitted "
                "to, and other rows may have larger ones",
                sheet->path);
}

static lg_status warn_of_parts(lg_training *self, lg_error *error) {
    const lg_table_state *s = self->state;
    const lg_table_judgement *j = &s->judged;
    LG_TRY(lg_table_warn_repeated(self, error));
    if (j->rows < 2)
        LG_WARN(self,
                "the %s part has one row, which is too few to judge the model; --test TABLE judges it on "
                "other rows",
                s->part);
    if (s->given.test == NULL) return LG_OK;
    lg_table_warn_outside(self->context, j->outside, j->rows, s->given.test, self->model);
    warn_of_learned(self, &s->test, s->table.data.sha256);
    return warn_far_outputs(self, &s->test, error);
}

/* Compares the training error with the error of a simple guess. After a search for the evidence the fit
 * starts near its minimum and its loss hardly falls; the caller's check of self->verdict would fault that, so
 * this function warns instead. */
static void judge_training(lg_training *self) {
    const lg_table_state *s = self->state;
    const lg_table_judgement *j = &s->usual;
    const bool regression = lg_table_is_regression(s);
    const char *what = regression ? "mean squared error" : "share of wrong rows",
               *simple = regression ? "the mean" : "the most frequent class";
    const double wrong = regression ? j->scaled_rmse * j->scaled_rmse : 1.0 - j->accuracy,
                 guess = regression ? 1.0 : lg_guess_class(s->learned.confusion, s->outputs.count);
    if (s->evidence.evaluations == 0)
        self->verdict =
            (lg_training_verdict){.what = what, .guess = simple, .error = wrong, .guessed = guess};
    else if (!(wrong < LEARNED * guess))
        LG_WARN(self,
                "the model has learned nothing: its %s %.3g is not below %.3g, which always predicting %s "
                "gives; the inputs do not determine the outputs, or there are too few rows",
                what, wrong, guess, simple);
    self->verdict.failed = lg_table_warn_errors(self->context, &s->file, &s->judged,
                                                s->given.test != NULL ? s->given.test : s->table.path);
}

/* Reports the evidence; values are NaN if none was sought. */
static void tell_evidence(lg_training *self) {
    const lg_table_state *s = self->state;
    const lg_table_evidence_result *found = &s->evidence;
    const bool sought = found->evaluations > 0;
    const double numbers = (double)s->trained * s->outputs.count;
    /* The noise follows from the residuals of the last fit. */
    const double noise =
        s->usual.scaled_rmse * sqrt(numbers / fmax(numbers - found->effective, 0.02 * numbers));
    LG_TELL(self, LG_WHOLE("evidence_evaluations", found->evaluations, NULL),
            LG_REAL("effective_parameters", sought ? found->effective : (double)NAN,
                    "parameters that the data determine"),
            LG_REAL("log_evidence", sought ? found->evidence : (double)NAN, NULL),
            LG_REAL("noise", sought ? noise : (double)NAN, "in units of the outputs' deviation"));
}

static void tell(lg_training *self) {
    const lg_table_state *s = self->state;
    lg_table_tell(self, &s->file, &s->judged);
    LG_TELL(self, LG_TEXT("part", s->part, "the rows that were judged"),
            LG_REAL("train_scaled_rmse", s->learned.scaled_rmse, NULL),
            LG_REAL("train_accuracy", s->learned.accuracy, NULL),
            LG_TEXT("task", lg_table_task_name(s->file.run.model.options.task), NULL),
            LG_WHOLE("parameters", s->file.parameters, NULL), LG_WHOLE("rows", s->table.data.rows, NULL),
            LG_WHOLE("rows_left_out", s->table.left_out, NULL), LG_WHOLE("train_rows", s->trained, NULL),
            LG_WHOLE("inputs", s->inputs.count, NULL), LG_WHOLE("outputs", s->outputs.count, NULL));
    tell_evidence(self);
    self->first_count = self->result_count;
}

static lg_status judge(lg_training *self, double *theta, lg_error *error) {
    LG_TRY(make_file(self, theta, error));
    LG_TRY(judge_parts(self, error));
    LG_TRY(warn_of_parts(self, error));
    judge_training(self);
    tell(self);
    return LG_OK;
}

static lg_status evaluate(lg_training *self, const void *file, lg_error *error) {
    lg_table_state *s = self->state;
    const lg_table_judgement *j = &s->judged;
    s->file = *(const lg_table_file *)file;
    LG_TRY(lg_table_judge(self, &s->file, &s->table, NULL, 0, &s->judged, error));
    lg_table_warn_outside(self->context, j->outside, j->rows, s->table.path, self->model);
    warn_of_learned(self, &s->table, s->file.run.data_sha256);
    self->verdict.failed = lg_table_warn_errors(self->context, &s->file, j, s->table.path);
    LG_TRY(warn_far_outputs(self, &s->table, error));
    lg_table_tell(self, &s->file, j);
    LG_TELL(self, LG_TEXT("task", lg_table_task_name(s->file.run.model.options.task), NULL),
            LG_WHOLE("rows_left_out", s->table.left_out, NULL));
    return LG_OK;
}

static const char *const sizes[] = {"4", "8", "16", "32", "16,16", "32,32", NULL};

static lg_status inspect(const lg_context *context, const void *file, const double *x, lg_error *error) {
    lg_table_warn_outside(context, lg_table_is_outside(file, x), 1, "--initial", "the model");
    return LG_OK;
}

const lg_trainer lg_table_learner = {.data = "TABLE",
                                     .state_size = sizeof(lg_table_state),
                                     .options = lg_table_given_rows,
                                     .held_out = "validation-fraction",
                                     .sizes = sizes,
                                     .read = read_data,
                                     .describe = describe,
                                     .usual = usual,
                                     .prepare = prepare,
                                     .problem = make_problem,
                                     .judge = judge,
                                     .save = save,
                                     .evaluate = evaluate,
                                     .inspect = inspect,
                                     .close = close_data};
