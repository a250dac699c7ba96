/* lg-elastica predict: computes the learned curve for given boundary conditions. */
#include <math.h>

#include "elastica/files/recipe.h"
#include "lg-elastica/beam.h"

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

static predict_values values;

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
    if (values.solve && !p->stiff)
        app_warn(self,
                 "%s: the file does not say the stiffness of the beam, so the energy is unknown: train the "
                 "model again",
                 self->arguments[0]);
    boundary_read(self, &values.where, &problem,
                  known.right_end && !known.both_ends ? LG_ELASTICA_RIGHT_END : LG_ELASTICA_BOTH_ENDS,
                  &p->where);
    boundary_vector(&p->where.problem, p->x);
}

static void read_points(const app *self, prediction *p) {
    const double length = p->file.run.model.length;
    const bool given = values.s.count > 0;
    const size_t n = given               ? values.s.count
                     : values.points > 0 ? (size_t)values.points
                                         : (size_t)p->file.run.model.intervals + 1;
    p->curve.at = beam_nodes_create(n);
    double *s = p->curve.at.s;
    for (size_t i = 0; i < n; i++) {
        s[i] = given ? values.s.values[i] : equidistant(length, i, n);
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

static void report(const app *self, const prediction *p) {
    const beam_nodes *at = &p->curve.at;
    app_json out;
    app_result_begin(&out, self);
    app_json_reals(&out, "s", at->s, at->count);
    result_nodes(&out, at, values.s.count > 0);
    app_json_reals(&out, "boundary", p->x, 8);
    app_result_real(&out, "distance", p->beyond.largest, "from the nearest boundary conditions trained on");
    app_result_real(&out, "reach", p->beyond.reach, "largest distance among these");
    app_result_real(&out, "off_family", p->beyond.off, "from the family of boundary conditions trained on");
    app_result_real(&out, "spread", p->beyond.spread, "largest such distance among these");
    app_json_bool(&out, "inside", p->beyond.count == 0);
    app_result_real(&out, "seconds", p->seconds, NULL);
    if (values.solve) {
        app_result_real(&out, "max_error", p->max_error, "largest difference at the nodes");
        app_result_real(&out, "mse", p->mse, NULL);
        app_result_real(&out, "energy", p->stiff ? p->truth.solution.energy : (double)NAN, NULL);
        app_result_real(&out, "rotation", p->truth.problem.rotation, NULL);
        app_result_real(&out, "solve_seconds", p->solve_seconds, NULL);
    }
    app_json_text(&out, "network", lg_surrogate_kind_name(p->file.run.model.options.kind));
    app_json_text(&out, "out", values.out);
    app_json_end(&out);
}

static void prediction_destroy(prediction *p) {
    beam_curve_destroy(&p->curve);
    beam_curve_destroy(&p->truth);
    lg_surrogate_file_destroy(&p->file);
}

static int run(app *self) {
    APP_CLEAN(prediction_destroy) prediction p = {.seconds = 0};
    const char *model = self->arguments[0];
    if (values.s.count > 0 && values.points > 0)
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
    if (values.solve) compare(self, &p);
    write_curves(self, values.out, &p.curve, 1, false);
    draw_prediction(self, values.plot, &p.curve, values.solve ? &p.truth : NULL);
    report(self, &p);
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
    .settings = APP_SETTINGS(APP_GIVEN(predict_options, values)),
    .run = run};
