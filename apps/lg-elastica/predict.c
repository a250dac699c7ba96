/* lg-elastica predict: the learned curve of one pair of boundary conditions. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "elastica/files/recipe.h"
#include "lg-elastica/beam.h"

enum { SHOWN_POINTS = 10, TIMED = 9 };

typedef struct predict_values {
    boundary_values where;
    lg_reals s;
    uint64_t points;
    const char *out, *plot;
    bool solve;
} predict_values;

static const lg_field predict_options[] = {
    BOUNDARY_ROWS(predict_values, where, "the family trained on", "that of the training data"),
    LG_OPTION(predict_values, s, REALS, "S,S,...", "Ascending arc lengths in [0, L]", LG_ANY_REAL,
              .longer = "use --points"),
    LG_OPTION(predict_values, points, U64, "n",
              "Number of equidistant arc lengths, ends included, instead of --s (default: the nodes of "
              "the training data)",
              .low = 2, .high = 10000000),
    LG_OPTION(predict_values, solve, SWITCH, NULL,
              "Also solve the beam, and report the largest difference at the nodes"),
    LG_OPTION(predict_values, out, STRING, "FILE.csv", "Columns s, x, y, vx, vy, theta"),
    LG_OPTION(predict_values, plot, STRING, "FILE.svg|.png",
              "Draw the curve; with --solve, the solution "
              "too"),
    LG_FIELD_END};

static predict_values values;

typedef struct prediction {
    const lg_surrogate_file *file;
    boundary where;
    double x[8];
    size_t points;
    double *s, *q, *v, *theta; /* (points), (points, 2), (points, 2), (points) */
    double distance, reach, seconds;
    beam_curve truth; /* with --solve */
    double max_error, mse, solve_seconds;
} prediction;

/* ---- input ---- */

static int read_where(const app *self, prediction *p) {
    const lg_surrogate_file *file = p->file;
    const lg_elastica_families known = lg_elastica_families_of(file->trained, file->trained_count);
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = file->run.model.length;
    problem.intervals = file->run.model.intervals;
    if (file->trained_count > 0) {
        memcpy(problem.q0, file->trained, sizeof problem.q0);
        memcpy(problem.qN, file->trained + 4, sizeof problem.qN);
    }
    const int code = boundary_read(
        self, &values.where, &problem,
        known.right_end && !known.both_ends ? LG_ELASTICA_RIGHT_END : LG_ELASTICA_BOTH_ENDS, &p->where);
    boundary_vector(&p->where.problem, p->x);
    return code;
}

static int read_points(const app *self, prediction *p) {
    const double length = p->file->run.model.length;
    const bool given = values.s.count > 0;
    p->points = given               ? values.s.count
                : values.points > 0 ? (size_t)values.points
                                    : (size_t)p->file->run.model.intervals + 1;
    p->s = app_alloc(p->points, sizeof *p->s);
    for (size_t i = 0; i < p->points; i++) {
        p->s[i] = given                ? values.s.values[i]
                  : i + 1 == p->points ? length
                                       : length * ((double)i / (double)(p->points - 1));
        if (!(p->s[i] >= 0 && p->s[i] <= length))
            return app_usage(self, "--s: %.12g is outside the beam [0, %.12g]", p->s[i], length);
        if (i > 0 && p->s[i] < p->s[i - 1])
            return app_usage(self, "--s: %.12g follows %.12g; arc lengths must ascend", p->s[i], p->s[i - 1]);
    }
    return APP_EXIT_OK;
}

/* ---- the curve ---- */

/* Plans for `points` points, and their work memory. */
static int open_curves(const app *self, const lg_surrogate_file *file, size_t points,
                       lg_surrogate_curves **curves, void **work) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_surrogate_curves_create(self->context, &file->run.model, file->theta, LG_F64,
                                                        points, curves, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    *work = app_alloc(lg_surrogate_curves_work_size(*curves), 1);
    return APP_EXIT_OK;
}

/* Median over a few calls after a first one. */
static int compute(const app *self, prediction *p) {
    double seconds[TIMED];
    lg_surrogate_curves *curves = NULL;
    void *work = NULL;
    const int code = open_curves(self, p->file, p->points, &curves, &work);
    if (code != APP_EXIT_OK) return code;
    p->q = app_alloc(2 * p->points, sizeof *p->q);
    p->v = app_alloc(2 * p->points, sizeof *p->v);
    p->theta = app_alloc(p->points, sizeof *p->theta);
    for (size_t i = 0; i <= TIMED; i++) {
        const double begin = app_seconds();
        lg_surrogate_curve(curves, p->x, p->s, p->points, p->q, p->v, work);
        if (i > 0) seconds[i - 1] = app_seconds() - begin;
    }
    p->seconds = app_median(seconds, TIMED);
    for (size_t i = 0; i < p->points; i++) {
        const double angle = atan2(p->v[2 * i + 1], p->v[2 * i]);
        p->theta[i] = i > 0 ? p->theta[i - 1] + wrap_angle(angle - p->theta[i - 1]) : angle;
    }
    free(work);
    lg_surrogate_curves_destroy(curves);
    return APP_EXIT_OK;
}

static int check_finite(const app *self, const prediction *p) {
    for (size_t i = 0; i < 2 * p->points; i++)
        if (!isfinite(p->q[i]) || !isfinite(p->v[i]))
            return app_fail(self, LG_NOT_FINITE, "the curve is not finite at s = %.9g", p->s[i / 2]);
    return APP_EXIT_OK;
}

/* The comparison is at the nodes, whatever points the user chose. */
static int compare(const app *self, prediction *p) {
    const lg_surrogate *model = &p->file->run.model;
    const size_t nodes = (size_t)model->intervals + 1;
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    const double begin = app_seconds();
    lg_surrogate_curves *curves = NULL;
    void *work = NULL;
    int code = beam_solve(self, &p->where, &options, p->file->run.continuous, &p->truth);
    p->solve_seconds = app_seconds() - begin;
    if (code == APP_EXIT_OK) code = open_curves(self, p->file, nodes, &curves, &work);
    if (code != APP_EXIT_OK) return code;
    double *memory = app_alloc(5 * nodes, sizeof *memory), *q = memory + nodes, *v = q + 2 * nodes;
    for (size_t k = 0; k < nodes; k++)
        memory[k] = k + 1 < nodes ? model->length * ((double)k / (double)(nodes - 1)) : model->length;
    lg_surrogate_curve(curves, p->x, memory, nodes, q, v, work);
    p->max_error = p->mse = 0;
    for (size_t i = 0; i < 2 * nodes; i++) {
        const double dq = q[i] - p->truth.q[i], dv = v[i] - p->truth.v[i];
        p->max_error = fmax(p->max_error, fmax(fabs(dq), fabs(dv)));
        p->mse += (dq * dq + dv * dv) / (double)(4 * nodes);
    }
    free(work);
    free(memory);
    lg_surrogate_curves_destroy(curves);
    return APP_EXIT_OK;
}

/* ---- output ---- */

/* A model without the boundary conditions of its training part has no range. */
static bool is_inside(const prediction *p) {
    return p->file->trained_count == 0 || p->distance <= 2 * p->reach;
}

static void print_table(const prediction *p) {
    static const char *const heads[] = {"s", "x", "y", "vx", "vy", "theta"};
    const size_t last = p->points - 1, every = last > SHOWN_POINTS && values.s.count == 0
                                                   ? (last + SHOWN_POINTS - 1) / SHOWN_POINTS
                                                   : 1;
    app_table table;
    app_table_begin(&table, LG_COUNT(heads));
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t k = 0; k <= last; k = k < last && k + every > last ? last : k + every) {
        app_table_cell(&table, "%.6g", p->s[k]);
        for (size_t c = 0; c < 2; c++) app_table_cell(&table, "%.6f", p->q[2 * k + c]);
        for (size_t c = 0; c < 2; c++) app_table_cell(&table, "%.6f", p->v[2 * k + c]);
        app_table_cell(&table, "%.6f", p->theta[k]);
    }
    app_table_end(&table, stdout);
}

static void report(const app *self, const prediction *p) {
    if (!self->json) {
        print_table(p);
        (void)printf("%.2e s", p->seconds);
        if (values.solve)
            (void)printf("; the solver took %.2e s; largest difference at the nodes %.3e", p->solve_seconds,
                         p->max_error);
        (void)printf("\n");
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_reals(&json, "s", p->s, p->points);
    json_pairs(&json, "q", p->q, p->points);
    json_pairs(&json, "v", p->v, p->points);
    app_json_reals(&json, "theta", p->theta, p->points);
    app_json_reals(&json, "boundary", p->x, 8);
    app_json_real(&json, "distance", p->distance);
    app_json_real(&json, "reach", p->reach);
    app_json_bool(&json, "inside", is_inside(p));
    app_json_real(&json, "seconds", p->seconds);
    if (values.solve) {
        app_json_real(&json, "max_error", p->max_error);
        app_json_real(&json, "mse", p->mse);
        app_json_real(&json, "energy", p->truth.solution.energy);
        app_json_real(&json, "rotation", p->truth.problem.rotation);
        app_json_real(&json, "solve_seconds", p->solve_seconds);
    }
    app_json_text(&json, "network", lg_surrogate_kind_name(p->file->run.model.options.kind));
    app_json_text(&json, "out", values.out);
    app_json_end(&json);
}

static lg_status write_table(const prediction *p, lg_error *error) {
    app_file file;
    app_file_begin(&file, values.out);
    (void)fputs("s,x,y,vx,vy,theta\n", file.stream);
    for (size_t i = 0; i < p->points; i++)
        (void)fprintf(file.stream, "%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", p->s[i], p->q[2 * i],
                      p->q[2 * i + 1], p->v[2 * i], p->v[2 * i + 1], p->theta[i]);
    return app_file_end(&file, error);
}

static int write_outputs(const app *self, const prediction *p) {
    lg_error error = {LG_OK, ""};
    lg_status status = values.out != NULL ? write_table(p, &error) : LG_OK;
    if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    if (values.plot != NULL)
        status = draw_prediction(self, values.plot, p->q, p->points, values.solve ? &p->truth : NULL, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.plot);
}

/* ---- running ---- */

static int predict(const app *self, prediction *p) {
    const lg_surrogate_file *file = p->file;
    lg_error error = {LG_OK, ""};
    int code = read_where(self, p);
    if (code == APP_EXIT_OK) code = read_points(self, p);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_elastica_check(&p->where.problem, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    const bool known = file->trained_count > 0;
    p->reach = known ? lg_surrogate_reach(file->trained, file->trained_count) : (double)NAN;
    p->distance = known ? lg_surrogate_distance(&file->run.model, file->trained, file->trained_count, p->x)
                        : (double)NAN;
    if (!is_inside(p))
        app_warn(self,
                 "outside the training range: the nearest boundary conditions of the training part are %.3g "
                 "away, and these are at most %.3g apart; the curve may be meaningless",
                 p->distance, p->reach);
    code = compute(self, p);
    if (code == APP_EXIT_OK) code = check_finite(self, p);
    if (code == APP_EXIT_OK && values.solve) code = compare(self, p);
    if (code == APP_EXIT_OK) code = write_outputs(self, p);
    if (code == APP_EXIT_OK) report(self, p);
    return code;
}

static int run(app *self) {
    const app_path paths[] = {{"out", values.out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    lg_error error = {LG_OK, ""};
    lg_surrogate_file file;
    if (values.s.count > 0 && values.points > 0)
        return app_usage(self, "--s and --points cannot be given "
                               "together");
    int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_model_load_surrogate(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    prediction p = {.file = &file};
    code = predict(self, &p);
    free(p.s);
    free(p.q);
    free(p.v);
    free(p.theta);
    beam_curve_free(&p.truth);
    lg_surrogate_file_destroy(&file);
    return code;
}

const app_command predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5",
    .summary = "Compute the learned curve for given boundary conditions",
    .details =
        "`distance` is the distance of the boundary conditions from the nearest ones of the training part. "
        "`reach` is the largest such distance among the training part itself. A query farther than twice "
        "the reach is not `inside`, and there is a warning. `seconds`: the median of a few evaluations in "
        "double precision.",
    .settings = APP_SETTINGS(APP_GIVEN(predict_options, values)),
    .run = run};
