/* lg-elastica evaluate and predict: the errors of a network on curves, and the curves that it computes. */
#include <math.h>
#include <string.h>

#include "common/verbs.h"
#include "elastica/files/recipe.h"
#include "lg-elastica/beam.h"

/* ---- networks ---- */

/* Computes the curves of a network at up to `points` points at a time; the caller destroys it. */
static lg_surrogate_curves *open_network(const app *self, const lg_surrogate_file *file, size_t points,
                                         void **work) {
    lg_surrogate_curves *curves;
    APP_DO(self, lg_surrogate_curves_create, &file->run.model, file->theta, LG_F64, points, &curves);
    *work = app_keep(lg_surrogate_curves_work_size(curves), 1);
    return curves;
}

/* Number k, from 0, of n equidistant arc lengths on [0, length]. */
static double equidistant(double length, size_t k, size_t n) {
    return k + 1 < n ? length * ((double)k / (double)(n - 1)) : length;
}

/* ---- evaluate ---- */

enum { SHOWN = 10 };

static const lg_field part_option[] = {
    APP_PART(lg_surrogate_state,
             "Curves to use: all (default), or the train or test part of the data that the model was "
             "trained on",
             .names = lg_curves_part_names),
    LG_FIELD_END};

/* A block for each shown curve, with its true and learned nodes; then the mean errors at each node. */
static void put_curves(app_plot *plot, const void *user) {
    const lg_training *training = user;
    const lg_surrogate_file *file = training->file;
    const lg_surrogate_state *of = training->state;
    const lg_elastica_curves *curves = &of->data.curves;
    const size_t nodes = (size_t)curves->intervals + 1, count = of->test.count;
    const size_t shown = count < SHOWN ? count : (size_t)SHOWN;
    APP_FREE double *q = app_alloc(5 * nodes, sizeof *q);
    double *const v = q + 2 * nodes, *const s = v + 2 * nodes;
    void *work;
    lg_surrogate_curves *network = open_network(app_running(), file, nodes, &work);
    app_plot_text(plot, "%s network, %zu of %zu curves, mean squared error %.3e\t%zu\t%.9g",
                  lg_surrogate_kind_name(file->run.model.options.kind), shown, count, of->errors.mse, shown,
                  curves->length);
    for (size_t k = 0; k < nodes; k++) s[k] = equidistant(curves->length, k, nodes);
    for (size_t i = 0; i < shown; i++) {
        const size_t curve = of->test.list[(2 * i + 1) * count / (2 * shown)];
        const double *true_q = curves->q + 2 * nodes * curve, *true_v = curves->v + 2 * nodes * curve;
        lg_surrogate_curve(network, curves->boundary + 8 * curve, s, nodes, q, v, work);
        APP_PLOT_COLUMNS(plot, 9, nodes, {true_q, 2, 2}, {q, 2, 2}, {true_v, 2, 2}, {v, 2, 2});
        app_plot_block(plot);
    }
    lg_surrogate_curves_destroy(network);
    APP_PLOT_COLUMNS(plot, 9, nodes, {s, 1, 1}, {of->node_error, 2, 2});
}

static lg_surrogate_state state;
static train_task task = {.recipe = &lg_recipe_surrogate, .state = &state};

const app_command elastica_evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5",
    .summary = "Evaluate a network on curves",
    .details =
        "The mean squared error is over curves, nodes and components: 4(N - 1) inner ones for the discrete "
        "network, all 4(N + 1) for the others. Boundary conditions lie outside the training range if they "
        "are farther from those of the training part than twice the largest gap among these, or farther off "
        "the lines through neighbours. The command counts them.",
    .settings = APP_SETTINGS(APP_GIVEN(part_option, state)),
    APP_DRAWS("ten curves, true and learned, with their tangents and the mean error along the beam",
              "elastica_comparison", put_curves),
    VERB(evaluate, task)};

/* ---- predict ---- */

enum { TIMED = 9 };

typedef struct predict_values {
    lg_reals s;
    uint64_t points;
    const char *out;
    bool solve;
} predict_values;

static const lg_field predict_options[] = {
    LG_OPTION(predict_values, s, REALS, "S,S,...", "Ascending arc lengths in [0, L]", LG_ANY_REAL,
              .longer = "use --points", .without = "points"),
    APP_POINTS(predict_values,
               "Number of equidistant arc lengths, ends included, instead of --s (default: the nodes of "
               "the training data)"),
    LG_OPTION(predict_values, solve, SWITCH, NULL,
              "Also solve the beam, and report the largest difference at the nodes"),
    APP_OUT(predict_values, "FILE.csv", "Columns s, x, y, vx, vy, theta", .file = LG_FILE_TEXT),
    LG_FIELD_END};

static predict_values predict_given;

typedef struct prediction {
    lg_surrogate_file file;
    boundary where;
    double x[8];
    beam_curve curve; /* the learned curve at the requested points */
    lg_elastica_outside beyond;
    double seconds;
    bool stiff;       /* the stiffness of the beam is known */
    beam_curve truth; /* the solution; only with --solve */
    double max_error, mse, solve_seconds;
} prediction;

/* ---- input ---- */

/* The beam of the training data, without its end angles. */
static void read_where(const app *self, prediction *p) {
    const lg_surrogate_file *file = &p->file;
    const lg_elastica_families known = lg_elastica_families_of(file->trained, file->trained_count);
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = file->run.model.length;
    problem.intervals = file->run.model.intervals;
    p->stiff = file->run.stiffness > 0;
    if (p->stiff) problem.stiffness = file->run.stiffness;
    if (file->trained_count > 0) {
        memcpy(problem.q0, file->trained, sizeof problem.q0);
        memcpy(problem.qN, file->trained + 4, sizeof problem.qN);
    }
    if (predict_given.solve && !p->stiff)
        app_warn(self,
                 "%s: the file does not say the stiffness of the beam, so the energy is unknown: train the "
                 "model again",
                 self->arguments[0]);
    boundary_read(self, &problem,
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
    void *work;
    lg_surrogate_curves *network = open_network(self, &p->file, at->count, &work);
    for (size_t i = 0; i <= TIMED; i++) {
        const double begin = app_seconds();
        lg_surrogate_curve(network, p->x, at->s, at->count, at->q, at->v, work);
        if (i > 0) seconds[i - 1] = app_seconds() - begin;
    }
    lg_surrogate_curves_destroy(network);
    p->seconds = lg_median(seconds, TIMED);
    for (size_t i = 0; i < at->count; i++) {
        const double angle = atan2(at->v[2 * i + 1], at->v[2 * i]);
        at->theta[i] = i > 0 ? at->theta[i - 1] + lg_elastica_wrap(angle - at->theta[i - 1]) : angle;
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
    void *work;
    lg_surrogate_curves *network = open_network(self, &p->file, nodes, &work);
    const beam_nodes at = beam_nodes_create(nodes);
    for (size_t k = 0; k < nodes; k++) at.s[k] = equidistant(model->length, k, nodes);
    lg_surrogate_curve(network, p->x, at.s, nodes, at.q, at.v, work);
    lg_surrogate_curves_destroy(network);
    for (size_t i = 0; i < 2 * nodes; i++) {
        const double dq = at.q[i] - p->truth.at.q[i], dv = at.v[i] - p->truth.at.v[i];
        p->max_error = fmax(p->max_error, fmax(fabs(dq), fabs(dv)));
        p->mse += (dq * dq + dv * dv) / (double)(4 * nodes);
    }
}

/* ---- the command ---- */

static void report_curve(const app *self, const prediction *p) {
    const beam_nodes *at = &p->curve.at;
    app_json *out = self->out;
    app_json_reals(out, "s", at->s, at->count);
    result_nodes(out, at, predict_given.s.count > 0);
    APP_PUT(out, LG_AS_REALS("boundary", p->x, 8),
            LG_REAL("distance", p->beyond.largest, "from the nearest boundary conditions trained on"),
            LG_REAL("reach", p->beyond.reach, "largest distance among these"),
            LG_REAL("off_family", p->beyond.off, "from the family of boundary conditions trained on"),
            LG_REAL("spread", p->beyond.spread, "largest such distance among these"),
            LG_AS_FLAG("inside", p->beyond.count == 0), LG_REAL("seconds", p->seconds, NULL));
    if (predict_given.solve)
        APP_PUT(out, LG_REAL("max_error", p->max_error, "largest difference at the nodes"),
                LG_REAL("mse", p->mse, NULL),
                LG_REAL("energy", p->stiff ? p->truth.solution.energy : NAN, NULL),
                LG_REAL("rotation", p->truth.problem.rotation, NULL),
                LG_REAL("solve_seconds", p->solve_seconds, NULL));
    APP_PUT(out, LG_AS_TEXT("network", lg_surrogate_kind_name(p->file.run.model.options.kind)),
            LG_AS_TEXT("out", predict_given.out));
}

/* The learned curve and, with --solve, the solution. */
static void put_prediction(app_plot *plot, const void *predicted) {
    const prediction *p = predicted;
    app_plot_text(plot, "\t2\t%d", predict_given.solve);
    APP_PLOT_COLUMNS(plot, 9, p->curve.at.count, {p->curve.at.q, 2, 2});
    app_plot_block(plot);
    if (predict_given.solve) put_beam(plot, &p->truth);
}

static void run_predict(app *self) {
    prediction p = {.seconds = 0};
    const char *model = self->arguments[0];
    APP_FILE(self, model, lg_recipe_load, NULL, &lg_recipe_surrogate, &p.file);
    read_where(self, &p);
    read_points(self, &p);
    p.beyond = lg_elastica_warn_outside(self->context, &p.file, p.x);
    compute(self, &p);
    if (predict_given.solve) compare(self, &p);
    write_curves(self, predict_given.out, &p.curve, 1, false);
    app_plot_draw(self, 0, &p);
    report_curve(self, &p);
    lg_recipe_release(&lg_recipe_surrogate, &p.file);
}

const app_command elastica_predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5",
    .summary = "Compute the learned curve for given boundary conditions",
    .details =
        "`distance` is the distance of the boundary conditions from the nearest ones of the training part. "
        "`reach` is the largest such distance among the training part itself. `off_family` and `spread` are "
        "the same for the distance from the lines through neighbours. A query farther than twice the reach "
        "or twice the spread is not `inside`, and there is a warning. `seconds`: the median of a few "
        "evaluations in double precision.",
    APP_DRAWS("the curve; with --solve, the solution too", "elastica_beams", put_prediction),
    .settings = APP_SETTINGS(BOUNDARY, ENDS, APP_GIVEN(predict_options, predict_given)),
    .run = run_predict};
