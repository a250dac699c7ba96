/* lg-elastica solve: finds one equilibrium, all equilibria, or all over a range of boundary conditions. */
#include <math.h>

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
              .usual = true),
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
    app_result_real(out, "energy", solution->energy, NULL);
    app_result_size(out, "negative_eigenvalues", solution->negative_eigenvalues,
                    solution->negative_eigenvalues == 0 ? "minimum" : "saddle");
    app_result_real(out, "gradient", solution->gradient, NULL);
    app_result_real(out, "residual", solution->residual, NULL);
    app_result_reals(out, "multiplier", solution->force, 2, "force");
    app_result_real(out, "rotation", curve->problem.rotation, NULL);
    result_nodes(out, &curve->at, false);
}

/* ---- one solution ---- */

static void report_curve(const app *self, const beam_curve *curve, double seconds) {
    const size_t inner = curve->problem.intervals - 1;
    app_json *out = self->out;
    app_result_text(out, "values", values.continuous ? "continuous" : "discrete", NULL);
    add_curve(out, curve);
    if (!values.continuous) {
        APP_FREE double *lambda = app_alloc(inner, sizeof *lambda);
        (void)lg_elastica_euler_lagrange(&curve->problem, curve->at.q, curve->at.v, lambda);
        app_json_reals(out, "lambda", lambda, inner);
    }
    add_problem(out, &curve->problem);
    app_result_size(out, "iterations", curve->solution.iterations, "Newton steps");
    app_json_size(out, "problems", curve->solution.problems);
    app_result_real(out, "seconds", seconds, NULL);
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
    draw_beams(self, "", false, 2.5, &curve, 1);
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
        if (out->people) app_json_size(out, "branch", i + 1);
        if (out->people) app_json_text(out, "", saddle ? "saddle" : "minimum");
        add_curve(out, &found->list[i]);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    app_result_size(out, "count", found->count, NULL);
    add_problem(out, problem);
    app_result_real(out, "seconds", seconds, NULL);
}

static void solve_branches(const app *self, const boundary *where, const lg_elastica_options *options) {
    beam_curves found;
    const double begin = app_seconds();
    APP_MUST(self, beam_branches(self->context, where, options, values.saddles, &found, &error));
    const double seconds = app_seconds() - begin;
    if (found.count == 0) app_stop(self, LG_NO_CONVERGENCE, "no equilibrium was found");
    if (found.full) app_warn(self, "there may be more branches than those listed");
    write_curves(self, values.out, found.list, found.count, true);
    draw_beams(self, "", true, 2.5, found.list, found.count);
    report_branches(self, &found, &where->problem, seconds);
}

/* ---- the command ---- */

/* Checks options that exclude each other or need another option. */
static void check_options(const app *self) {
    static const char *const alone[] = {"x", "theta0", "thetaN", "rotation"};
    const bool many = values.branches || values.sweep > 0;
    if (values.continuous && many)
        app_stop_usage(self, "--continuous: %s is for the discrete problem only",
                       values.branches ? "--branches" : "--sweep");
    if (values.saddles && !many) app_stop_usage(self, "--saddles: needs --branches or --sweep");
    for (size_t i = 0; values.sweep > 0 && i < LG_COUNT(alone); i++)
        if (app_given(self, alone[i]))
            app_stop_usage(self, "--%s: --sweep already varies the x of a case", alone[i]);
}

static void run(app *self) {
    check_options(self);
    APP_FREE char *head = app_format("%s\n", values.sweep > 0 ? SWEEP_HEAD : curves_head(values.branches));
    app_check_text(self, values.out, head);
    const lg_elastica problem = beam_problem(self);
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    if (values.gradient_tol > 0) options.gradient_tolerance = values.gradient_tol;
    if (values.sweep > 0) {
        const sweep_values sweep = {(size_t)values.sweep, problem, (lg_elastica_case)beam_given.kind,
                                    values.saddles, values.out};
        sweep_run(self, &sweep, &options);
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
    APP_DRAWS("the curves; with --sweep energy against x"),
    .settings = APP_SETTINGS(BOUNDARY, ENDS, BEAM, APP_GIVEN(solve_options, values)),
    .run = run};
