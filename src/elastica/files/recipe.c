/* The trainer of surrogates: how a surrogate learns curves. */
#include "elastica/files/recipe.h"

#include <math.h>
#include <string.h>

#include "model/files/training.h"

enum { STREAM_WEIGHTS = 1 };

typedef lg_curves_part part;
typedef lg_surrogate_state state;

/* ---- the data ---- */

/* Whether a node is impossible: its distance from the curve's first node, or the length of its tangent, is
 * more than twice the largest possible value. */
static bool is_impossible(const lg_elastica_curves *curves, size_t curve, size_t node) {
    const size_t nodes = (size_t)curves->intervals + 1;
    const double *first = curves->q + 2 * nodes * curve, *q = first + 2 * node,
                 *v = curves->v + 2 * (nodes * curve + node);
    return !(hypot(q[0] - first[0], q[1] - first[1]) <= 2 * curves->length && hypot(v[0], v[1]) <= 2);
}

static lg_status read_data(lg_training *self, lg_error *error) {
    state *s = self->state;
    const char *path = self->paths[0];
    LG_TRY(lg_elastica_data_read(self->context, path, NULL, &s->data, error));
    memcpy(self->sha256, s->data.sha256, sizeof self->sha256);
    const lg_elastica_curves *curves = &s->data.curves;
    size_t count = 0, curve = 0, node = 0;
    for (size_t i = curves->count; i-- > 0;)
        for (size_t k = (size_t)curves->intervals + 1; k-- > 0;)
            if (is_impossible(curves, i, k)) curve = i, node = k, count++;
    if (count > 0)
        LG_WARN(self,
                "%s: %zu nodes cannot be points of a beam; the first is node %zu of curve %zu (both "
                "counted from 0): such a node is farther from the beam's start than twice the length, "
                "or its tangent is longer than 2; most of the error comes from these nodes",
                path, count, node, curve);
    return LG_OK;
}

static void close_data(lg_training *self) {
    lg_elastica_data_destroy(&((state *)self->state)->data);
}

/* ---- parts ---- */

/* Splits all curves, or those of `of` if it is not NULL, and takes one part of them. */
static lg_status draw_part(lg_training *self, const part *of, double train, double test, lg_part wanted,
                           part *out, lg_error *error) {
    const lg_surrogate_run *run = self->run;
    const size_t n = of != NULL ? of->count : (size_t)run->curves;
    uint8_t *parts;
    LG_TRAINING_ARRAY(self, parts, n, error);
    LG_TRAINING_ARRAY(self, out->list, n, error);
    const lg_status status = lg_surrogate_split(n, train, test, run->training.seed, parts);
    if (status != LG_OK)
        return lg_fail(error, status,
                       "fractions %g for training and %g for testing: they add up to more than 1, or leave "
                       "none of %zu curves for training",
                       train, test, n);
    out->count = 0;
    for (size_t i = 0; i < n; i++)
        if (parts[i] == (uint8_t)wanted) out->list[out->count++] = of != NULL ? of->list[i] : (uint32_t)i;
    return LG_OK;
}

static lg_status take_part(lg_training *self, lg_part wanted, part *out, lg_error *error) {
    const lg_surrogate_run *run = self->run;
    return draw_part(self, NULL, run->train_fraction, run->test_fraction, wanted, out, error);
}

static lg_status prepare(lg_training *self, lg_error *error) {
    state *s = self->state;
    LG_TRY(take_part(self, LG_PART_TRAIN, &s->train, error));
    return take_part(self, LG_PART_TEST, &s->test, error);
}

/* Divides the training part: some curves are held out as s->test, the others stay in s->train. */
static lg_status hold_out(lg_training *self, double validation, lg_error *error) {
    state *s = self->state;
    part whole = {NULL, 0};
    LG_TRY(take_part(self, LG_PART_TRAIN, &whole, error));
    lg_status status = draw_part(self, &whole, 1 - validation, validation, LG_PART_TRAIN, &s->train, error);
    if (status == LG_OK)
        status = draw_part(self, &whole, 1 - validation, validation, LG_PART_TEST, &s->test, error);
    if (status == LG_OUT_OF_MEMORY || (status == LG_OK && s->test.count > 0)) return status;
    return lg_fail(
        error, LG_INVALID_ARGUMENT,
        "--validation-fraction %g: the training part or the validation part has none of the %zu curves",
        validation, whole.count);
}

/* Picks `most` curves of a part at even distances in it, or all curves if `most` is 0. */
static lg_status thin(lg_training *self, const part *from, uint64_t most, part *out, lg_error *error) {
    out->count = most > 0 && most < from->count ? (size_t)most : from->count;
    LG_TRAINING_ARRAY(self, out->list, out->count, error);
    for (size_t i = 0; i < out->count; i++)
        out->list[i] = from->list[out->count > 1 ? i * (from->count - 1) / (out->count - 1) : 0];
    return LG_OK;
}

/* ---- the run ---- */

lg_elastica_families lg_elastica_families_of(const double *boundary, size_t n) {
    lg_elastica_families found = {false, false};
    for (size_t i = 0; i < n; i++) {
        const double *x = boundary + 8 * i, dx = x[4] - x[0], dy = x[5] - x[1];
        const double along = x[2] * dx + x[3] * dy, across = x[2] * dy - x[3] * dx;
        const bool right_end = along > 0 && fabs(across) <= 1e-9 * along;
        found.right_end = found.right_end || right_end;
        found.both_ends = found.both_ends || !right_end;
    }
    return found;
}

/* Returns half of the largest distance between the ends of a curve. A maximum has the same bits for all sets
 * of curves with the same distance. */
static double centre_of(const lg_elastica_curves *curves) {
    double largest = 0;
    for (size_t i = 0; i < curves->count; i++) {
        const double *x = curves->boundary + 8 * i;
        largest = fmax(largest, hypot(x[4] - x[0], x[5] - x[1]));
    }
    return 0.5 * largest;
}

/* Sets the number of modes. The preset's number is an upper limit; the curves that will be learned determine
 * how many are needed. */
static lg_status modes_of_curves(lg_training *self, lg_error *error) {
    const lg_elastica_curves *curves = &((state *)self->state)->data.curves;
    lg_surrogate_run *run = self->run;
    lg_surrogate_options options = run->model.options;
    lg_surrogate model;
    part train = {NULL, 0}, learned;
    options.modes = (uint32_t)fmin(options.modes, 4.0 * (curves->intervals - 1));
    LG_TRY(lg_surrogate_init(&model, &options, curves->intervals, curves->length, centre_of(curves), error));
    LG_TRY(take_part(self, LG_PART_TRAIN, &train, error));
    LG_TRY(thin(self, &train, run->most_curves, &learned, error));
    return lg_surrogate_count_modes(self->context, &model, curves, learned.list, learned.count,
                                    &run->model.options.modes, error);
}

static void adopt_row(lg_training *self, const lg_surrogate_preset *preset) {
    const lg_surrogate_run from = {
        .model.options = preset->model, .training = preset->training, .most_curves = preset->most_curves};
    lg_training_adopt(self, &from, true);
}

/* The cases are all presets of this name. */
static bool usual(lg_training *self, uint32_t at) {
    for (uint32_t i = 0; i < 240; i++) {
        const lg_surrogate_preset *preset =
            lg_surrogate_preset_find(self->preset, (lg_surrogate_kind)(i % 3), i / 3 % 2 == 1,
                                     (lg_surrogate_loss)(i / 6 % 2), i / 12 % 2 == 1, i / 24 / 10.0);
        if (preset == NULL || at-- > 0) continue;
        adopt_row(self, preset);
        return true;
    }
    return false;
}

static lg_status adopt_preset(lg_training *self, lg_error *error) {
    state *s = self->state;
    lg_surrogate_run *run = self->run;
    const lg_surrogate_options *options = &run->model.options;
    const lg_elastica_families found = lg_elastica_families_of(s->data.curves.boundary, s->data.curves.count);
    const bool merged = found.both_ends && found.right_end;
    const char *name = lg_training_preset(self);
    s->preset = lg_surrogate_preset_find(name, options->kind, options->boundary, options->loss, merged,
                                         run->train_fraction);
    if (s->preset == NULL)
        return lg_fail(error, LG_UNSUPPORTED, "--preset: %s has no settings for the %s network%s%s%s", name,
                       lg_surrogate_kind_name(options->kind),
                       options->loss == LG_SURROGATE_ENERGY ? " with --loss energy" : "",
                       options->boundary ? " with --boundary true" : "",
                       merged ? " on data of both families" : "");
    adopt_row(self, s->preset);
    if (options->angles && !self->given(self, "modes")) run->model.options.modes = 0;
    if (options->modes == 0 || self->given(self, "modes")) return LG_OK;
    return modes_of_curves(self, error);
}

static lg_status describe(lg_training *self, lg_error *error) {
    state *s = self->state;
    lg_surrogate_run *run = self->run;
    const lg_elastica_curves *curves = &s->data.curves;
    s->preset = NULL;
    run->curves = curves->count;
    if (self->stored == NULL) LG_TRY(adopt_preset(self, error));
    run->continuous = curves->continuous;
    run->stiffness = curves->stiffness;
    memcpy(run->data_sha256, s->data.sha256, sizeof run->data_sha256);
    const lg_surrogate_options options = run->model.options;
    return lg_surrogate_init(&run->model, &options, curves->intervals, curves->length, centre_of(curves),
                             error);
}

/* ---- the problem ---- */

/* Computes the modes and the targets of the coefficients from the curves that are learned. */
static lg_status find_modes(lg_training *self, lg_error *error) {
    state *s = self->state;
    lg_surrogate_run *run = self->run;
    s->truncation = NAN;
    if (run->model.options.modes == 0) return LG_OK;
    LG_TRAINING_ARRAY(self, s->modes, lg_surrogate_modes_size(&run->model), error);
    LG_TRAINING_ARRAY(self, s->coefficients, s->learned.count * run->model.options.modes, error);
    run->model.modes = s->modes;
    LG_TRY(lg_surrogate_find_modes(self->context, &run->model, &s->data.curves, s->learned.list,
                                   s->learned.count, s->modes, error));
    return lg_surrogate_coefficients(self->context, &run->model, &s->data.curves, s->learned.list,
                                     s->learned.count, s->coefficients, &s->truncation, error);
}

static lg_status make_problem(lg_training *self, lg_error *error) {
    state *s = self->state;
    lg_surrogate_run *run = self->run;
    lg_rng rng;
    LG_TRY(thin(self, &s->train, run->most_curves, &s->learned, error));
    LG_TRY(find_modes(self, error));
    s->problem = (lg_surrogate_problem){&run->model, &s->data.curves, s->learned.list, s->learned.count,
                                        s->coefficients};
    LG_TRY(lg_surrogate_problem_check(&s->problem, error));
    lg_surrogate_fit_problem(&s->problem, &self->problem);
    LG_TRAINING_ARRAY(self, self->theta, self->problem.parameters, error);
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_net_initialise(&run->model.net, &rng, self->theta);
    return LG_OK;
}

static void release(lg_training *self) {
    state *s = self->state;
    ((lg_surrogate_run *)self->run)->model.modes = s->modes = s->coefficients = NULL;
    s->train = s->test = s->learned = (part){NULL, 0};
}

/* ---- result ---- */

/* Computes the errors over a part. All are NaN if the part has no curves. */
static lg_status errors_of(const lg_training *self, const part *of, const double *theta,
                           lg_surrogate_errors *out, lg_error *error) {
    const state *s = self->state;
    const double none = NAN;
    *out = (lg_surrogate_errors){none, none, none, none, none, none, none};
    if (of->count == 0) return LG_OK;
    return lg_surrogate_evaluate(self->context, &((lg_surrogate_run *)self->run)->model, theta,
                                 &s->data.curves, of->list, of->count, NULL, out, error);
}

static lg_status objective(lg_training *self, double *out, lg_error *error) {
    const state *s = self->state;
    lg_surrogate_errors errors = {.mse = NAN};
    double *theta;
    LG_TRAINING_ARRAY(self, theta, self->problem.parameters, error);
    lg_fit_parameters(self->fit, theta);
    const lg_status status = errors_of(self, &s->test, theta, &errors, error);
    *out = errors.mse;
    return status == LG_NOT_FINITE ? LG_OK : status;
}

/* Mean squared error of always guessing the mean curve, on the training part, over the nodes that the network
 * outputs. */
static double mean_curve_error(const state *s, lg_surrogate_kind kind) {
    const lg_elastica_curves *curves = &s->data.curves;
    const part *of = &s->train;
    const size_t row = 2 * ((size_t)curves->intervals + 1);
    const size_t edge = kind == LG_SURROGATE_DISCRETE ? 2 : 0;
    const double *const values[2] = {curves->q, curves->v}, n = (double)of->count;
    double sum = 0;
    for (size_t k = 0; k < 2; k++)
        for (size_t j = edge; j < row - edge; j++) {
            double mean = 0;
            for (size_t i = 0; i < of->count; i++) mean += values[k][of->list[i] * row + j] / n;
            for (size_t i = 0; i < of->count; i++) sum += pow(values[k][of->list[i] * row + j] - mean, 2);
        }
    return sum / (n * 2.0 * (double)(row - 2 * edge));
}

static void tell(lg_training *self, const lg_surrogate_errors *train, const lg_surrogate_errors *test) {
    const state *s = self->state;
    const lg_surrogate_run *run = self->run;
    const lg_surrogate_preset *preset = s->preset;
    LG_TELL(self, LG_REAL("train_mse", train->mse, "mean squared error of the training part"),
            LG_REAL("test_mse", test->mse, "of the test part"),
            LG_REAL("training_loss", lg_fit_loss(self->fit), "the last epoch's mean over its batches"),
            LG_REAL("truncation", s->truncation, "what the modes leave out"),
            LG_WHOLE("parameters", self->problem.parameters, NULL));
    self->first_count = self->result_count;
    LG_TELL(self, LG_TEXT("preset", preset != NULL ? preset->name : NULL, NULL),
            LG_TEXT("source", preset != NULL ? preset->source : NULL, NULL),
            LG_WHOLE("train_curves", s->train.count, NULL),
            LG_WHOLE("learned_curves", s->learned.count, NULL), LG_WHOLE("test_curves", s->test.count, NULL),
            LG_REAL("test_max_error", test->max_error, "largest component"),
            LG_TEXT("values", run->continuous ? "continuous" : "discrete", NULL),
            LG_TEXT("data_sha256", run->data_sha256, NULL));
}

static lg_status judge(lg_training *self, double *theta, lg_error *error) {
    const state *s = self->state;
    const lg_surrogate *model = &((lg_surrogate_run *)self->run)->model;
    lg_surrogate_errors train, test;
    LG_TRY(errors_of(self, &s->train, theta, &train, error));
    LG_TRY(errors_of(self, &s->test, theta, &test, error));
    if (model->options.loss == LG_SURROGATE_ENERGY && s->data.curves.continuous)
        LG_WARN(self,
                "--loss energy learns solutions of the discrete problem with %u intervals, but the data are "
                "continuous solutions: the errors include the difference between the two",
                model->intervals);
    self->verdict = (lg_training_verdict){.what = "mean squared error",
                                          .guess = "the mean curve",
                                          .error = train.mse,
                                          .guessed = mean_curve_error(s, model->options.kind)};
    tell(self, &train, &test);
    return LG_OK;
}

static lg_status save(lg_training *self, void *into, lg_error *error) {
    const state *s = self->state;
    lg_surrogate_file *file = into;
    file->trained_count = s->learned.count;
    LG_TRAINING_ARRAY(self, file->trained, 8 * file->trained_count, error);
    for (size_t i = 0; i < file->trained_count; i++)
        memcpy(file->trained + 8 * i, s->data.curves.boundary + 8 * (size_t)s->learned.list[i],
               8 * sizeof *file->trained);
    file->has_errors = true;
    file->train_mse = lg_result_find(self, "train_mse")->real;
    file->test_mse = lg_result_find(self, "test_mse")->real;
    return LG_OK;
}

/* ---- evaluation ---- */

const char *const lg_curves_part_names[] = {"all", "train", "test", NULL};

/* Sets s->test to the curves that are used. */
static lg_status choose(lg_training *self, lg_error *error) {
    state *s = self->state;
    const lg_surrogate_run *run = self->run;
    const size_t count = s->data.curves.count;
    const char *name = lg_curves_part_names[s->part];
    if (s->part == LG_CURVES_ALL) {
        s->test.count = count;
        LG_TRAINING_ARRAY(self, s->test.list, count, error);
        for (size_t i = 0; i < count; i++) s->test.list[i] = (uint32_t)i;
        return LG_OK;
    }
    if (strcmp(run->data_sha256, s->data.sha256) != 0 || run->curves != count)
        return lg_fail(error, LG_INVALID_ARGUMENT, "--part %s: %s was trained on other data than %s", name,
                       self->model, self->paths[0]);
    LG_TRY(take_part(self, s->part == LG_CURVES_TRAIN ? LG_PART_TRAIN : LG_PART_TEST, &s->test, error));
    if (s->test.count > 0) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT, "--part %s: the model has no curves in it", name);
}

/* A curve is outside if its distance exceeds the reach or the spread times this factor. */
static const double outside_factor = 2;

lg_elastica_outside lg_elastica_count_outside(const lg_surrogate_file *file, const double *boundary,
                                              const uint32_t *chosen, size_t count) {
    const double none = NAN;
    if (file->trained_count == 0) return (lg_elastica_outside){none, none, none, none, 0};
    lg_elastica_outside out = {.reach = lg_surrogate_reach(file->trained, file->trained_count),
                               .spread = lg_surrogate_spread(file->trained, file->trained_count)};
    for (size_t i = 0; i < count; i++) {
        const double *x = boundary + 8 * (chosen != NULL ? chosen[i] : i);
        const double distance =
            lg_surrogate_distance(&file->run.model, file->trained, file->trained_count, x);
        const double off = lg_surrogate_off_family(&file->run.model, file->trained, file->trained_count, x);
        out.largest = fmax(out.largest, distance);
        out.off = fmax(out.off, off);
        out.count += distance > outside_factor * out.reach || off > outside_factor * out.spread;
    }
    return out;
}

lg_elastica_outside lg_elastica_warn_outside(const lg_context *context, const lg_surrogate_file *file,
                                             const double *boundary) {
    const lg_elastica_outside beyond = lg_elastica_count_outside(file, boundary, NULL, 1);
    if (beyond.count > 0)
        lg_log_message(
            context, LG_LOG_WARNING,
            "outside the training range: the nearest boundary conditions of the training part are %.3g away, "
            "where neighbours in the training part are at most %.3g apart, and the query lies %.3g off their "
            "family, where they themselves lie at most %.3g off; the curve may be meaningless",
            beyond.largest, beyond.reach, beyond.off, beyond.spread);
    return beyond;
}

/* x is the arc length, if the network is not discrete, and then the boundary conditions. */
static lg_status inspect(const lg_context *context, const void *from, const double *x, lg_error *error) {
    const lg_surrogate_file *file = from;
    const lg_surrogate *model = &file->run.model;
    const bool along = model->options.kind != LG_SURROGATE_DISCRETE;
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = model->length;
    if (along && !(x[0] >= 0 && x[0] <= model->length))
        return lg_fail(error, LG_INVALID_ARGUMENT, "s = %.12g is outside the beam [0, %.12g]", x[0],
                       model->length);
    x += along;
    memcpy(problem.q0, x, sizeof problem.q0);
    memcpy(problem.qN, x + 4, sizeof problem.qN);
    LG_TRY(lg_elastica_check(&problem, error));
    (void)lg_elastica_warn_outside(context, file, x);
    return LG_OK;
}

static void warn_of_range(const lg_training *self, const lg_surrogate_file *file,
                          const lg_elastica_outside *beyond) {
    const state *s = self->state;
    const bool trained = file->run.continuous, given = s->data.curves.continuous;
    if (beyond->count > 0)
        LG_WARN(self,
                "%zu of %zu curves lie outside the training range of %s (their boundary conditions are up "
                "to %.3g away from the training part, whose boundary conditions are at most %.3g apart, and "
                "up to %.3g off its family, which itself spreads by %.3g): expect large errors there",
                beyond->count, s->test.count, self->model, beyond->largest, beyond->reach, beyond->off,
                beyond->spread);
    if (trained != given)
        LG_WARN(self,
                "%s was trained on %s values, but %s holds %s ones: the errors include their difference",
                self->model, trained ? "continuous" : "discrete", self->paths[0],
                given ? "continuous" : "discrete");
}

static lg_status evaluate(lg_training *self, const void *from, lg_error *error) {
    const lg_surrogate_file *file = from;
    state *s = self->state;
    const lg_elastica_curves *curves = &s->data.curves;
    lg_surrogate_errors *of = &s->errors;
    LG_TRY(choose(self, error));
    LG_TRAINING_ARRAY(self, s->node_error, 2 * ((size_t)curves->intervals + 1), error);
    const lg_elastica_outside beyond =
        lg_elastica_count_outside(file, curves->boundary, s->test.list, s->test.count);
    warn_of_range(self, file, &beyond);
    LG_TRY(lg_surrogate_evaluate(self->context, &file->run.model, file->theta, curves, s->test.list,
                                 s->test.count, s->node_error, of, error));
    LG_TELL(self, LG_REAL("mse", of->mse, "mean squared error over nodes and components"),
            LG_REAL("mse_q", of->mse_q, "of the nodes"), LG_REAL("mse_v", of->mse_v, "of the tangents"),
            LG_REAL("max_error", of->max_error, "largest component"),
            LG_REAL("boundary_error", of->boundary_error, "largest difference from the boundary conditions"),
            LG_REAL("unit_tangent_error", of->unit_tangent_error, "largest | |v| - 1 |"),
            LG_REAL("unit_tangent_between", of->unit_tangent_between, "half-way between nodes"),
            LG_WHOLE("curves", s->test.count, NULL), LG_TEXT("part", lg_curves_part_names[s->part], NULL),
            LG_WHOLE("outside", beyond.count, "curves beyond the training range"),
            LG_REAL("reach", beyond.reach, "largest distance between trained boundary conditions"),
            LG_REAL("largest_distance", beyond.largest, "from them"),
            LG_REAL("spread", beyond.spread, "largest distance of them from their family"),
            LG_REAL("largest_off_family", beyond.off, "from the family"),
            LG_TEXT("network", lg_surrogate_kind_name(file->run.model.options.kind), NULL));
    return LG_OK;
}

static const char *const sizes[] = {"8", "12", "16", "24", "32", "64", NULL};

const lg_trainer lg_surrogate_learner = {.data = "DATA.h5",
                                         .state_size = sizeof(state),
                                         .method = "network",
                                         .sizes = sizes,
                                         .presets = true,
                                         .read = read_data,
                                         .describe = describe,
                                         .usual = usual,
                                         .prepare = prepare,
                                         .hold_out = hold_out,
                                         .problem = make_problem,
                                         .judge = judge,
                                         .objective = objective,
                                         .save = save,
                                         .evaluate = evaluate,
                                         .inspect = inspect,
                                         .release = release,
                                         .close = close_data};
