/* lg-elastica solve: finds one equilibrium, all equilibria, or all over a range of boundary conditions. */
#include <math.h>
#include <stdlib.h>

#include "files/csv.h"
#include "lg-elastica/beam.h"

typedef struct solve_values {
    double gradient_tol;
    uint64_t sweep;
    bool continuous, branches, saddles;
    const char *out;
} solve_values;

static const lg_field solve_options[] = {
    LG_OPTION(solve_values, gradient_tol, REAL, "TOL",
              "Largest gradient, relative to the largest term in its sum (default 1e-12)", LG_POSITIVE),
    CONTINUOUS(solve_values),
    LG_OPTION(solve_values, branches, SWITCH, NULL,
              "Search from many starts, and list all minima found by rising energy", .without = "sweep",
              .usual = true),
    LG_OPTION(solve_values, saddles, SWITCH, NULL, "With --branches or --sweep: list saddles too"),
    LG_OPTION(solve_values, sweep, U64, "n",
              "Follow the branches of a case over n equidistant x in [0, 2 pi]", .low = 2, .high = 10000,
              .usual = true, .without = "x,theta0,thetaN,rotation"),
    APP_OUT(solve_values, "FILE.csv", "Write the curves (columns s, x, y, vx, vy, theta), or the sweep",
            .usual = true, .file = LG_FILE_TEXT),
    LG_FIELD_END};

static solve_values values;

static void add_problem(app_json *out, const lg_elastica *problem) {
    APP_PUT(out, LG_AS_WHOLE("intervals", problem->intervals), LG_AS_REAL("length", problem->length),
            LG_AS_REAL("stiffness", problem->stiffness), LG_AS_REAL("theta0", problem->theta0),
            LG_AS_REALS("q0", problem->q0, 2), LG_AS_REALS("qN", problem->qN, 2));
}

static void add_curve(app_json *out, const beam_curve *curve) {
    const lg_elastica_solution *solution = &curve->solution;
    APP_PUT(out, LG_REAL("energy", solution->energy, NULL),
            LG_WHOLE("negative_eigenvalues", solution->negative_eigenvalues,
                     solution->negative_eigenvalues == 0 ? "minimum" : "saddle"),
            LG_REAL("gradient", solution->gradient, NULL), LG_REAL("residual", solution->residual, NULL),
            LG_REALS("multiplier", solution->force, 2, "force"),
            LG_REAL("rotation", curve->problem.rotation, NULL));
    result_nodes(out, &curve->at, false);
}

/* ---- one solution ---- */

static void report_curve(const app *self, const beam_curve *curve, double seconds) {
    const size_t inner = curve->problem.intervals - 1;
    app_json *out = self->out;
    app_json_put(out, LG_TEXT("values", values.continuous ? "continuous" : "discrete", NULL));
    add_curve(out, curve);
    if (!values.continuous) {
        APP_FREE double *lambda = app_alloc(inner, sizeof *lambda);
        (void)lg_elastica_euler_lagrange(&curve->problem, curve->at.q, curve->at.v, lambda);
        app_json_reals(out, "lambda", lambda, inner);
    }
    add_problem(out, &curve->problem);
    APP_PUT(out, LG_WHOLE("iterations", curve->solution.iterations, "Newton steps"),
            LG_AS_WHOLE("problems", curve->solution.problems), LG_REAL("seconds", seconds, NULL));
}

/* Warns if the energy differs by more than 5 % from the energy of the continuous beam. If the continuous beam
 * cannot be solved, there is no warning. */
static void warn_of_intervals(const app *self, const lg_elastica *problem, double energy) {
    static const double coarse = 0.05;
    lg_elastica_solution continuous;
    APP_FREE double *theta = app_alloc((size_t)problem->intervals + 1, sizeof *theta);
    const lg_status status =
        lg_elastica_solve_continuous(self->context, problem, NULL, theta, NULL, &continuous, NULL);
    if (status == LG_OK && fabs(energy - continuous.energy) > coarse * continuous.energy)
        app_warn(
            self,
            "%u intervals are too few for this shape: the energy is %.4g, and %.4g for the continuous beam; "
            "take more --intervals, or --continuous",
            problem->intervals, energy, continuous.energy);
}

static void solve_curve(const app *self, const boundary *where, const lg_elastica_options *options) {
    beam_curve curve;
    const double begin = app_seconds();
    beam_solve(self, where, options, values.continuous, &curve);
    const double seconds = app_seconds() - begin;
    if (!values.continuous) warn_of_intervals(self, &curve.problem, curve.solution.energy);
    write_curves(self, values.out, &curve, 1, false);
    app_plot_draw(self, 0, &(beam_curves){.count = 1, .list = &curve});
    report_curve(self, &curve, seconds);
}

/* ---- branches ---- */

static void report_branches(const app *self, const beam_curves *found, const lg_elastica *problem,
                            double seconds) {
    app_json *out = self->out;
    app_result_rows(out, "branches");
    for (size_t i = 0; i < found->count; i++) {
        const bool saddle = found->list[i].solution.negative_eigenvalues > 0;
        app_json_open(out, NULL, '{');
        if (out->people)
            APP_PUT(out, LG_AS_WHOLE("branch", i + 1), LG_AS_TEXT("", saddle ? "saddle" : "minimum"));
        add_curve(out, &found->list[i]);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    app_json_put(out, LG_WHOLE("count", found->count, NULL));
    add_problem(out, problem);
    app_result_real(out, "seconds", seconds, NULL);
}

static void solve_branches(const app *self, const boundary *where, const lg_elastica_options *options) {
    beam_curves found;
    const double begin = app_seconds();
    APP_DO(self, beam_branches, where, options, values.saddles, &found);
    const double seconds = app_seconds() - begin;
    if (found.count == 0) app_stop(self, LG_NO_CONVERGENCE, "no equilibrium was found");
    if (found.full) app_warn(self, "there may be more branches than those listed");
    write_curves(self, values.out, found.list, found.count, true);
    app_plot_draw(self, 0, &found);
    report_branches(self, &found, &where->problem, seconds);
}

/* ---- all branches over a range of x ---- */

/* Largest distance (beam_distance) between curves of one branch at neighbouring x: `moved` times the step in
 * x, but at most far_curve. Different branches are farther apart than this. */
static const double moved = 6, far_curve = 0.5;

/* The numbers of a row of the sweep; branches are counted from 1. */
enum { NUMBERS = 5 };
#define SWEEP_HEAD "branch,x,energy,negative_eigenvalues,rotation"
typedef struct sweep_point {
    double branch, x, energy, negative_eigenvalues, rotation;
} sweep_point;

typedef struct sweep {
    const app *self;
    const lg_elastica *problem; /* but the end angles, which depend on x */
    const lg_elastica_options *options;
    size_t points;
    beam_curves *found; /* (points): the curves found at each x */
    size_t **branch;    /* (points): for each x, the branch number of each curve */
    double *x;
    size_t branches, count;
    sweep_point *rows; /* (count): by branch, then by x */
} sweep;

static lg_status find(void *user, size_t i, lg_error *error) {
    const sweep *s = user;
    boundary where = {.problem = *s->problem};
    lg_error why = {LG_OK, ""};
    if (app_interrupted()) return LG_CANCELLED;
    lg_elastica_set_case(&where.problem, (lg_elastica_case)beam_given.kind, s->x[i]);
    boundary_rotations(where.problem.theta0, where.problem.theta0 + where.problem.rotation, &where);
    const lg_status status =
        beam_branches(s->self->context, &where, s->options, values.saddles, &s->found[i], &why);
    s->branch[i] = app_keep(s->found[i].count, sizeof *s->branch[i]);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "x = %.9g: %s", s->x[i], app_sentence(status, &why));
}

/* ---- following the branches ---- */

typedef struct pair {
    double distance; /* first: it sorts the pairs */
    size_t before, after;
} pair;

/* Assigns the curves at x[i] to branches, pair by pair in order of distance: a curve gets the branch of the
 * nearest curve at x[i - 1] that no nearer curve has taken. The curves that are left begin new branches. */
static void follow(sweep *s, size_t i) {
    const size_t n = s->found[i].count, m = i > 0 ? s->found[i - 1].count : 0;
    const double reach = i > 0 ? fmin(far_curve, moved * (s->x[i] - s->x[i - 1])) : 0;
    APP_FREE pair *pairs = app_alloc(n * m, sizeof *pairs);
    APP_FREE bool *taken = app_alloc(m, sizeof *taken);
    APP_FREE bool *named = app_alloc(n, sizeof *named);
    for (size_t a = 0; a < n; a++)
        for (size_t b = 0; b < m; b++)
            pairs[a * m + b] = (pair){beam_distance(&s->found[i - 1].list[b], &s->found[i].list[a]), b, a};
    qsort(pairs, n * m, sizeof *pairs, lg_compare_doubles);
    for (size_t k = 0; k < n * m && pairs[k].distance < reach; k++) {
        if (taken[pairs[k].before] || named[pairs[k].after]) continue;
        taken[pairs[k].before] = named[pairs[k].after] = true;
        s->branch[i][pairs[k].after] = s->branch[i - 1][pairs[k].before];
    }
    for (size_t a = 0; a < n; a++)
        if (!named[a]) s->branch[i][a] = s->branches++;
}

/* ---- output ---- */

static int by_branch(const void *a, const void *b) {
    const sweep_point *p = a, *q = b;
    return p->branch != q->branch ? lg_compare_doubles(&p->branch, &q->branch)
                                  : lg_compare_doubles(&p->x, &q->x);
}

static void collect(sweep *s) {
    for (size_t i = 0; i < s->points; i++) s->count += s->found[i].count;
    sweep_point *row = s->rows = app_keep(s->count, sizeof *s->rows);
    for (size_t i = 0; i < s->points; i++)
        for (size_t k = 0; k < s->found[i].count; k++) {
            const beam_curve *curve = &s->found[i].list[k];
            *row++ = (sweep_point){(double)s->branch[i][k] + 1, s->x[i], curve->solution.energy,
                                   curve->solution.negative_eigenvalues, curve->problem.rotation};
        }
    qsort(s->rows, s->count, sizeof *s->rows, by_branch);
}

/* Branches are drawn as pieces of equal stability, since stable and unstable ones have different dashes. */
static void put_sweep(app_plot *plot, const void *swept) {
    const sweep *s = swept;
    double before = NAN;
    for (const sweep_point *at = s->rows; at < s->rows + s->count; at++) {
        const bool follows = at > s->rows && at[-1].branch == at->branch;
        const double saddle = at->negative_eigenvalues > 0, branch = at->branch - 1;
        if (!follows || saddle != before) app_plot_gap(plot);
        if (follows && saddle != before) /* a piece begins with the last point of the piece before it */
            APP_PLOT_ROW(plot, 9, at[-1].x, at[-1].energy, saddle, branch);
        APP_PLOT_ROW(plot, 9, at->x, at->energy, saddle, branch);
        before = saddle;
    }
    app_plot_block(plot);
}

static const app_plot_kind sweep_plot = APP_PLOT("sweep", NULL, "elastica_sweep", put_sweep);

/* For people: prints a table row per branch. */
static void add_branches(app_json *out, const sweep *s) {
    const sweep_point *points = s->rows;
    app_result_rows(out, NULL);
    for (size_t i = 0, last; i < s->count; i = last) {
        size_t saddles = 0;
        double low = INFINITY, high = -INFINITY;
        for (last = i; last < s->count && points[last].branch == points[i].branch; last++) {
            saddles += points[last].negative_eigenvalues > 0;
            low = fmin(low, points[last].energy);
            high = fmax(high, points[last].energy);
        }
        APP_PUT(out, LG_AS_REAL("branch", points[i].branch), LG_AS_WHOLE("points", last - i),
                LG_AS_REAL("x from", points[i].x), LG_AS_REAL("to", points[last - 1].x),
                LG_AS_REAL("energy from", low), LG_AS_REAL("to", high), LG_AS_WHOLE("saddles", saddles));
    }
    app_result_rows_end(out);
}

static void report_sweep(const sweep *s, double seconds) {
    app_json *out = s->self->out;
    if (out->people) add_branches(out, s);
    APP_PUT(out, LG_AS_TEXT("case", lg_elastica_case_name((lg_elastica_case)beam_given.kind)),
            LG_AS_REALS("x", s->x, s->points), LG_AS_WHOLE("branches", s->branches));
    app_json_open(out, "points", '[');
    for (const sweep_point *at = s->rows; at < s->rows + s->count; at++)
        APP_OBJECT(out, NULL, LG_AS_REAL("branch", at->branch), LG_AS_REAL("x", at->x),
                   LG_AS_REAL("energy", at->energy),
                   LG_AS_REAL("negative_eigenvalues", at->negative_eigenvalues),
                   LG_AS_REAL("rotation", at->rotation));
    app_json_close(out, ']');
    APP_PUT(out, LG_AS_WHOLE("intervals", s->problem->intervals), LG_AS_TEXT("out", values.out),
            LG_AS_REAL("seconds", seconds));
}

static void solve_sweep(const app *self, const lg_elastica *problem, const lg_elastica_options *options) {
    const size_t n = (size_t)values.sweep;
    sweep s = {.self = self,
               .problem = problem,
               .options = options,
               .points = n,
               .found = app_keep(n, sizeof *s.found),
               .branch = app_keep(n, sizeof *s.branch),
               .x = app_keep(n, sizeof *s.x)};
    const double begin = app_seconds();
    APP_MUST(self, lg_elastica_check(problem, &error));
    for (size_t i = 0; i < n; i++) s.x[i] = 2 * LG_PI * (double)i / (double)(n - 1);
    APP_MUST(self, lg_jobs_run(self->context, self->threads, n, find, &s, &error));
    for (size_t i = 0; i < n; i++) follow(&s, i);
    collect(&s);
    const double seconds = app_seconds() - begin;
    if (values.out != NULL) {
        lg_columns to = {.text = app_text()};
        lg_columns_names(&to, SWEEP_HEAD);
        lg_columns_end(&to);
        for (const sweep_point *at = s.rows; at < s.rows + s.count; at++) {
            lg_columns_numbers(&to, (const double *)(const void *)at, NUMBERS);
            lg_columns_end(&to);
        }
        APP_MUST_FILE(self, values.out, lg_columns_write(&to, self->context, values.out, &error));
    }
    app_plot_row(self, &sweep_plot, &s);
    report_sweep(&s, seconds);
}

/* ---- the command ---- */

static void put_beams(app_plot *plot, const void *list) {
    const beam_curves *of = list;
    app_plot_text(plot, "\t%d", values.branches);
    for (const beam_curve *at = of->list; at < of->list + of->count; at++) {
        const bool saddle = at->solution.negative_eigenvalues > 0;
        app_plot_text(plot, "E = %.6g%s\t%d", at->solution.energy, saddle ? " (saddle)" : "", saddle);
        put_beam(plot, at);
    }
}

static void run(app *self) {
    if (values.saddles && !values.branches && values.sweep == 0)
        app_stop_usage(self, "--saddles: needs --branches or --sweep");
    APP_FREE char *head = app_format("%s\n", values.sweep > 0 ? SWEEP_HEAD : curves_head(values.branches));
    app_check_text(self, values.out, head);
    const lg_elastica problem = beam_problem(self);
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    if (values.gradient_tol > 0) options.gradient_tolerance = values.gradient_tol;
    if (values.sweep > 0) {
        solve_sweep(self, &problem, &options);
        return;
    }
    boundary where;
    boundary_read(self, &problem, LG_ELASTICA_BOTH_ENDS, &where);
    (values.branches ? solve_branches : solve_curve)(self, &where, &options);
}

const app_command elastica_solve_command = {
    .name = "solve",
    .summary = "Solve for equilibria of a clamped beam",
    .details = "The solution is a minimum of the bending energy for the given ends, end angles and "
               "rotation; for a case it is the global minimum. The exit code is 4 when no acceptable "
               "minimum is found. --branches lists all minima found for the three rotations nearest to "
               "zero, or for the one of --rotation.",
    APP_DRAWS("the curves; with --sweep energy against x", "elastica_beams", put_beams),
    .settings = APP_SETTINGS(BOUNDARY, ENDS, BEAM, APP_GIVEN(solve_options, values)),
    .run = run};
