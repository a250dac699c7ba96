/* lg-elastica evaluate and predict: the errors of a network on curves, and the curves that it computes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "elastica/files/recipe.h"
#include "lg-elastica/beam.h"

/* ---- networks ---- */

/* `count`: number of curves whose boundary conditions are outside the range of the trained ones, as
 * liegrad/elastica.h defines it. All distances are NaN if the model file has no boundary conditions of its
 * training part. */
typedef struct outside {
    double reach, largest; /* largest: largest distance of a curve */
    double spread, off;    /* off: largest distance of a curve from the family */
    size_t count;
} outside;

/* A curve is outside if its distance exceeds the reach or the spread times this factor. */
static const double outside_factor = 2;

/* `chosen` (count): the rows of `boundary_rows` to count; NULL: the first `count` rows. */
static outside count_outside(const lg_surrogate_file *file, const double *boundary_rows,
                             const uint32_t *chosen, size_t count) {
    const double none = (double)NAN;
    if (file->trained_count == 0) return (outside){none, none, none, none, 0};
    outside out = {.reach = lg_surrogate_reach(file->trained, file->trained_count),
                   .spread = lg_surrogate_spread(file->trained, file->trained_count)};
    for (size_t i = 0; i < count; i++) {
        const double *x = boundary_rows + 8 * (chosen != NULL ? chosen[i] : i);
        const double distance =
            lg_surrogate_distance(&file->run.model, file->trained, file->trained_count, x);
        const double off = lg_surrogate_off_family(&file->run.model, file->trained, file->trained_count, x);
        out.largest = fmax(out.largest, distance);
        out.off = fmax(out.off, off);
        out.count += distance > outside_factor * out.reach || off > outside_factor * out.spread;
    }
    return out;
}

/* The beam of the data that a model was trained on, without its end angles. *known: the file has its
 * stiffness. */
static lg_elastica beam_of_model(const lg_surrogate_file *file, bool *known) {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = file->run.model.length;
    problem.intervals = file->run.model.intervals;
    *known = file->run.stiffness > 0;
    if (*known) problem.stiffness = file->run.stiffness;
    if (file->trained_count > 0) {
        memcpy(problem.q0, file->trained, sizeof problem.q0);
        memcpy(problem.qN, file->trained + 4, sizeof problem.qN);
    }
    return problem;
}

/* A network that is ready to compute its curves at up to `points` points at a time. */
typedef struct learned {
    lg_surrogate_curves *curves;
    void *work;
} learned;

static learned learned_open(const app *self, const lg_surrogate_file *file, size_t points) {
    learned out;
    APP_MUST(self, lg_surrogate_curves_create(self->context, &file->run.model, file->theta, LG_F64, points,
                                              &out.curves, &error));
    out.work = app_alloc(lg_surrogate_curves_work_size(out.curves), 1);
    return out;
}

static void learned_close(learned *curves) {
    free(curves->work);
    lg_surrogate_curves_destroy(curves->curves);
}

/* Number k, from 0, of n equidistant arc lengths on [0, length]. */
static double equidistant(double length, size_t k, size_t n) {
    return k + 1 < n ? length * ((double)k / (double)(n - 1)) : length;
}

/* ---- evaluate ---- */

enum { SHOWN = 10 };

typedef struct evaluate_values {
    const char *plot;
    int part;
} evaluate_values;

enum { PART_ALL, PART_TRAIN, PART_TEST };
static const char *const part_names[] = {"all", "train", "test", NULL};

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, part, NAME, NULL,
              "Curves to use: all (default), or the train or test part of the data that the model was "
              "trained on",
              .names = part_names),
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw ten curves, true and learned, with their tangents and the mean error along the beam",
              .file = LG_FILE_DRAWN),
    LG_FIELD_END};

static evaluate_values evaluate_given;

typedef struct evaluation {
    lg_surrogate_file file;
    lg_elastica_data data;
    uint32_t *chosen; /* (count): indices of the curves, rising */
    size_t count;
    lg_surrogate_errors errors;
    outside beyond;
    double *node_error; /* (N + 1, 2) */
    double seconds;
} evaluation;

static void report_errors(const app *self, const evaluation *e) {
    const lg_surrogate_errors *errors = &e->errors;
    const struct {
        const char *key, *meaning;
        double value;
    } rows[] = {{"mse", "mean squared error over nodes and components", errors->mse},
                {"mse_q", "of the nodes", errors->mse_q},
                {"mse_v", "of the tangents", errors->mse_v},
                {"max_error", "largest component", errors->max_error},
                {"boundary_error", "largest difference from the boundary conditions", errors->boundary_error},
                {"unit_tangent_error", "largest | |v| - 1 |", errors->unit_tangent_error},
                {"unit_tangent_between", "half-way between nodes", errors->unit_tangent_between}};
    app_json out;
    app_result_begin(&out, self);
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        app_result_real(&out, rows[i].key, rows[i].value, rows[i].meaning);
    app_result_size(&out, "curves", e->count, NULL);
    app_result_text(&out, "part", part_names[evaluate_given.part], NULL);
    app_result_size(&out, "outside", e->beyond.count, "curves beyond the training range");
    app_json_real(&out, "reach", e->beyond.reach);
    app_json_real(&out, "largest_distance", e->beyond.largest);
    app_json_real(&out, "spread", e->beyond.spread);
    app_json_real(&out, "largest_off_family", e->beyond.off);
    app_json_text(&out, "network", lg_surrogate_kind_name(e->file.run.model.options.kind));
    app_json_real(&out, "seconds", e->seconds);
    app_json_end(&out);
}

/* ---- the plot ---- */

/* A block for each shown curve, with its true and learned nodes; then the mean errors at each node. */
static void draw(const app *self, const evaluation *e) {
    const lg_elastica_curves *curves = &e->data.curves;
    const size_t nodes = (size_t)curves->intervals + 1, shown = e->count < SHOWN ? e->count : (size_t)SHOWN;
    APP_FREE double *q = app_alloc(5 * nodes, sizeof *q);
    double *const v = q + 2 * nodes, *const s = v + 2 * nodes;
    APP_CLEAN(learned_close) learned network = learned_open(self, &e->file, nodes);
    app_plot plot;
    app_plot_begin(&plot, "elastica_comparison", evaluate_given.plot);
    app_plot_text(&plot, "%s network, %zu of %zu curves, mean squared error %.3e\t%zu\t%.9g",
                  lg_surrogate_kind_name(e->file.run.model.options.kind), shown, e->count, e->errors.mse,
                  shown, curves->length);
    for (size_t k = 0; k < nodes; k++) s[k] = equidistant(curves->length, k, nodes);
    for (size_t i = 0; i < shown; i++) {
        const size_t curve = e->chosen[(2 * i + 1) * e->count / (2 * shown)];
        const double *true_q = curves->q + 2 * nodes * curve, *true_v = curves->v + 2 * nodes * curve;
        lg_surrogate_curve(network.curves, curves->boundary + 8 * curve, s, nodes, q, v, network.work);
        for (size_t k = 0; k < 2 * nodes; k += 2)
            APP_PLOT_ROW(&plot, 9, true_q[k], true_q[k + 1], q[k], q[k + 1], true_v[k], true_v[k + 1], v[k],
                         v[k + 1]);
        app_plot_block(&plot);
    }
    for (size_t k = 0; k < nodes; k++)
        APP_PLOT_ROW(&plot, 9, s[k], e->node_error[2 * k], e->node_error[2 * k + 1]);
    app_plot_end(self, &plot);
}

/* ---- running ---- */

static void choose(const app *self, evaluation *e) {
    const lg_surrogate_run *run = &e->file.run;
    const char *part = part_names[evaluate_given.part];
    e->count = e->data.curves.count;
    e->chosen = app_alloc(e->count, sizeof *e->chosen);
    for (size_t i = 0; i < e->count; i++) e->chosen[i] = (uint32_t)i;
    if (evaluate_given.part == PART_ALL) return;
    if (strcmp(run->data_sha256, e->data.sha256) != 0 || run->curves != e->count)
        app_stop_usage(self, "--part %s: %s was trained on other data than %s", part, self->arguments[0],
                       self->arguments[1]);
    APP_MUST_FILE(self, self->arguments[0],
                  lg_surrogate_part(self->context, run,
                                    evaluate_given.part == PART_TRAIN ? LG_PART_TRAIN : LG_PART_TEST,
                                    e->chosen, &e->count, &error));
    if (e->count == 0) app_stop_usage(self, "--part %s: the model has no curves in it", part);
}

static void warn_of_range(const app *self, const evaluation *e) {
    const bool trained = e->file.run.continuous, given = e->data.curves.continuous;
    if (e->beyond.count > 0)
        app_warn(
            self,
            "%zu of %zu curves lie outside the training range of %s (their boundary conditions are up "
            "to %.3g away from the training part, whose boundary conditions are at most %.3g apart, and up "
            "to %.3g off its family, which itself spreads by %.3g): expect large errors there",
            e->beyond.count, e->count, self->arguments[0], e->beyond.largest, e->beyond.reach, e->beyond.off,
            e->beyond.spread);
    if (trained != given)
        app_warn(self,
                 "%s was trained on %s values, but %s holds %s ones: the errors include their difference",
                 self->arguments[0], trained ? "continuous" : "discrete", self->arguments[1],
                 given ? "continuous" : "discrete");
}

static void evaluate(const app *self, evaluation *e) {
    lg_error error = {LG_OK, ""};
    const lg_elastica_curves *curves = &e->data.curves;
    const char *path = self->arguments[1];
    const double begin = app_seconds();
    e->node_error = app_alloc(2 * ((size_t)curves->intervals + 1), sizeof *e->node_error);
    e->beyond = count_outside(&e->file, curves->boundary, e->chosen, e->count);
    warn_of_range(self, e);
    const lg_status status = lg_surrogate_evaluate(self->context, &e->file.run.model, e->file.theta, curves,
                                                   e->chosen, e->count, e->node_error, &e->errors, &error);
    e->seconds = app_seconds() - begin;
    if (status != LG_OK && status != LG_SHAPE)
        app_stop(self, status, "%s: %s", path, app_sentence(status, &error));
    app_must_file(self, status, &error, path);
}

static void evaluation_destroy(evaluation *e) {
    free(e->chosen);
    free(e->node_error);
    lg_elastica_data_destroy(&e->data);
    lg_surrogate_file_destroy(&e->file);
}

static int run_evaluate(app *self) {
    APP_CLEAN(evaluation_destroy) evaluation e = {.count = 0};
    const char *model = self->arguments[0], *data = self->arguments[1];
    APP_MUST_FILE(self, model, lg_surrogate_load(self->context, model, NULL, &e.file, &error));
    APP_MUST_FILE(self, data, lg_elastica_data_judge(self->context, data, &e.data, &error));
    choose(self, &e);
    evaluate(self, &e);
    if (evaluate_given.plot != NULL) draw(self, &e);
    report_errors(self, &e);
    return APP_EXIT_OK;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5",
    .summary = "Judge a network on curves",
    .details =
        "The mean squared error is over curves, nodes and components: 4(N - 1) inner ones for the discrete "
        "network, all 4(N + 1) for the others. Boundary conditions lie outside the training range if they "
        "are farther from those of the training part than twice the largest gap among these, or farther off "
        "the "
        "lines through neighbours. The command counts them.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, evaluate_given)),
    .run = run_evaluate};

/* ---- predict ---- */

enum { TIMED = 9 };

typedef struct predict_values {
    boundary_values where;
    lg_reals s;
    uint64_t points;
    const char *out, *plot;
    bool solve;
} predict_values;

static const lg_field predict_options[] = {
    BOUNDARY_ROWS(predict_values, where, "the family trained on", "that of the training data",
                  "that of the training data"),
    LG_OPTION(predict_values, s, REALS, "S,S,...", "Ascending arc lengths in [0, L]", LG_ANY_REAL,
              .longer = "use --points"),
    LG_OPTION(predict_values, points, U64, "n",
              "Number of equidistant arc lengths, ends included, instead of --s (default: the nodes of "
              "the training data)",
              .low = 2, .high = 10000000),
    LG_OPTION(predict_values, solve, SWITCH, NULL,
              "Also solve the beam, and report the largest difference at the nodes"),
    LG_OPTION(predict_values, out, STRING, "FILE.csv", "Columns s, x, y, vx, vy, theta",
              .file = LG_FILE_TEXT),
    LG_OPTION(predict_values, plot, STRING, "FILE.svg|.png", "Draw the curve; with --solve, the solution too",
              .file = LG_FILE_DRAWN),
    LG_FIELD_END};

static predict_values predict_given;

typedef struct prediction {
    lg_surrogate_file file;
    boundary where;
    double x[8];
    beam_curve curve; /* the learned curve at the requested points */
    outside beyond;
    double seconds;
    bool stiff;       /* the stiffness of the beam is known */
    beam_curve truth; /* the solution; only with --solve */
    double max_error, mse, solve_seconds;
} prediction;

/* ---- input ---- */

static void read_where(const app *self, prediction *p) {
    const lg_surrogate_file *file = &p->file;
    const lg_elastica_families known = lg_elastica_families_of(file->trained, file->trained_count);
    const lg_elastica problem = beam_of_model(file, &p->stiff);
    if (predict_given.solve && !p->stiff)
        app_warn(self,
                 "%s: the file does not say the stiffness of the beam, so the energy is unknown: train the "
                 "model again",
                 self->arguments[0]);
    boundary_read(self, &predict_given.where, &problem,
                  known.right_end && !known.both_ends ? LG_ELASTICA_RIGHT_END : LG_ELASTICA_BOTH_ENDS,
                  &p->where);
    boundary_vector(&p->where.problem, p->x);
}

static void read_points(const app *self, prediction *p) {
    const double length = p->file.run.model.length;
    const bool given = predict_given.s.count > 0;
    const size_t n = given                      ? predict_given.s.count
                     : predict_given.points > 0 ? (size_t)predict_given.points
                                                : (size_t)p->file.run.model.intervals + 1;
    p->curve.at = beam_nodes_create(n);
    double *s = p->curve.at.s;
    for (size_t i = 0; i < n; i++) {
        s[i] = given ? predict_given.s.values[i] : equidistant(length, i, n);
        if (!(s[i] >= 0 && s[i] <= length))
            app_stop_usage(self, "--s: %.12g is outside the beam [0, %.12g]", s[i], length);
        if (i > 0 && s[i] < s[i - 1])
            app_stop_usage(self, "--s: %.12g follows %.12g; arc lengths must ascend", s[i], s[i - 1]);
    }
}

/* ---- computing the curve ---- */

/* Computes the curve. The time is the median over TIMED calls after a first call that is not timed. */
static void compute(const app *self, prediction *p) {
    double seconds[TIMED];
    const beam_nodes *at = &p->curve.at;
    APP_CLEAN(learned_close) learned network = learned_open(self, &p->file, at->count);
    for (size_t i = 0; i <= TIMED; i++) {
        const double begin = app_seconds();
        lg_surrogate_curve(network.curves, p->x, at->s, at->count, at->q, at->v, network.work);
        if (i > 0) seconds[i - 1] = app_seconds() - begin;
    }
    p->seconds = lg_median(seconds, TIMED);
    for (size_t i = 0; i < at->count; i++) {
        const double angle = atan2(at->v[2 * i + 1], at->v[2 * i]);
        at->theta[i] = i > 0 ? at->theta[i - 1] + wrap_angle(angle - at->theta[i - 1]) : angle;
    }
    for (size_t i = 0; i < 2 * at->count; i++)
        if (!isfinite(at->q[i]) || !isfinite(at->v[i]))
            app_stop(self, LG_NOT_FINITE, "the curve is not finite at s = %.9g", at->s[i / 2]);
}

/* Compares at the nodes, whatever points the user requested. */
static void compare(const app *self, prediction *p) {
    const lg_surrogate *model = &p->file.run.model;
    const size_t nodes = (size_t)model->intervals + 1;
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    const double begin = app_seconds();
    beam_solve(self, &p->where, &options, p->file.run.continuous, &p->truth);
    p->solve_seconds = app_seconds() - begin;
    APP_CLEAN(learned_close) learned network = learned_open(self, &p->file, nodes);
    APP_CLEAN(beam_nodes_destroy) beam_nodes at = beam_nodes_create(nodes);
    for (size_t k = 0; k < nodes; k++) at.s[k] = equidistant(model->length, k, nodes);
    lg_surrogate_curve(network.curves, p->x, at.s, nodes, at.q, at.v, network.work);
    for (size_t i = 0; i < 2 * nodes; i++) {
        const double dq = at.q[i] - p->truth.at.q[i], dv = at.v[i] - p->truth.at.v[i];
        p->max_error = fmax(p->max_error, fmax(fabs(dq), fabs(dv)));
        p->mse += (dq * dq + dv * dv) / (double)(4 * nodes);
    }
}

/* ---- the command ---- */

static void report_curve(const app *self, const prediction *p) {
    const beam_nodes *at = &p->curve.at;
    app_json out;
    app_result_begin(&out, self);
    app_json_reals(&out, "s", at->s, at->count);
    result_nodes(&out, at, predict_given.s.count > 0);
    app_json_reals(&out, "boundary", p->x, 8);
    app_result_real(&out, "distance", p->beyond.largest, "from the nearest boundary conditions trained on");
    app_result_real(&out, "reach", p->beyond.reach, "largest distance among these");
    app_result_real(&out, "off_family", p->beyond.off, "from the family of boundary conditions trained on");
    app_result_real(&out, "spread", p->beyond.spread, "largest such distance among these");
    app_json_bool(&out, "inside", p->beyond.count == 0);
    app_result_real(&out, "seconds", p->seconds, NULL);
    if (predict_given.solve) {
        app_result_real(&out, "max_error", p->max_error, "largest difference at the nodes");
        app_result_real(&out, "mse", p->mse, NULL);
        app_result_real(&out, "energy", p->stiff ? p->truth.solution.energy : (double)NAN, NULL);
        app_result_real(&out, "rotation", p->truth.problem.rotation, NULL);
        app_result_real(&out, "solve_seconds", p->solve_seconds, NULL);
    }
    app_json_text(&out, "network", lg_surrogate_kind_name(p->file.run.model.options.kind));
    app_json_text(&out, "out", predict_given.out);
    app_json_end(&out);
}

/* Draws the learned curve and, if `truth` is not NULL, the solution. */
static void draw_prediction(const app *self, const char *path, const beam_curve *curve,
                            const beam_curve *truth) {
    app_plot plot;
    app_plot_begin(&plot, "elastica_beams", path);
    app_plot_text(&plot, "\t2\t2.5\t%d", truth != NULL);
    for (size_t k = 0; k < curve->at.count; k++) app_plot_numbers(&plot, 9, curve->at.q + 2 * k, 2);
    app_plot_block(&plot);
    if (truth != NULL)
        put_beam(&plot, truth);
    else
        app_plot_block(&plot);
    app_plot_end(self, &plot);
}

static void prediction_destroy(prediction *p) {
    beam_curve_destroy(&p->curve);
    beam_curve_destroy(&p->truth);
    lg_surrogate_file_destroy(&p->file);
}

static int run_predict(app *self) {
    APP_CLEAN(prediction_destroy) prediction p = {.seconds = 0};
    const char *model = self->arguments[0];
    if (predict_given.s.count > 0 && predict_given.points > 0)
        app_stop_usage(self, "--s and --points cannot be given together");
    APP_MUST_FILE(self, model, lg_surrogate_load(self->context, model, NULL, &p.file, &error));
    read_where(self, &p);
    read_points(self, &p);
    p.beyond = count_outside(&p.file, p.x, NULL, 1);
    if (p.beyond.count > 0)
        app_warn(
            self,
            "outside the training range: the nearest boundary conditions of the training part are %.3g away, "
            "where neighbours in the training part are at most %.3g apart, and the query lies %.3g off their "
            "family, where they themselves lie at most %.3g off; the curve may be meaningless",
            p.beyond.largest, p.beyond.reach, p.beyond.off, p.beyond.spread);
    compute(self, &p);
    if (predict_given.solve) compare(self, &p);
    write_curves(self, predict_given.out, &p.curve, 1, false);
    if (predict_given.plot != NULL)
        draw_prediction(self, predict_given.plot, &p.curve, predict_given.solve ? &p.truth : NULL);
    report_curve(self, &p);
    return APP_EXIT_OK;
}

const app_command predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5",
    .summary = "Compute the learned curve for given boundary conditions",
    .details =
        "`distance` is the distance of the boundary conditions from the nearest ones of the training part. "
        "`reach` is the largest such distance among the training part itself. `off_family` and `spread` are "
        "the "
        "same for the distance from the lines through neighbours. A query farther than twice the reach or "
        "twice "
        "the spread is not `inside`, and there is a warning. `seconds`: the median of a few evaluations in "
        "double precision.",
    .settings = APP_SETTINGS(APP_GIVEN(predict_options, predict_given)),
    .run = run_predict};
