/* lg-elastica solve: one equilibrium, all of them, or all of them over a range of boundary conditions. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

enum { SHOWN_NODES = 10 };

typedef struct solve_values {
    boundary_values where;
    double length, stiffness, gradient_tol;
    uint64_t intervals, sweep;
    bool continuous, branches, saddles;
    const char *out, *plot;
} solve_values;

static const lg_field solve_options[] = {
    BOUNDARY_ROWS(solve_values, where, "both-ends", "0,0 and 3,0"),
    LG_OPTION(solve_values, length, REAL, "L", "Length of the beam", LG_POSITIVE, .value = "3.3"),
    LG_OPTION(solve_values, stiffness, REAL, "EI", "Bending stiffness", LG_POSITIVE, .value = "10"),
    LG_OPTION(solve_values, intervals, U64, "N", "Number of equal intervals between the nodes",
              .low = LG_ELASTICA_MIN_INTERVALS, .high = LG_ELASTICA_MAX_INTERVALS, .value = "50"),
    LG_OPTION(solve_values, gradient_tol, REAL, "TOL",
              "Largest gradient, relative to the largest term in its sum (default 1e-12)", LG_POSITIVE),
    LG_OPTION(solve_values, continuous, SWITCH, NULL,
              "Solve the differential equation instead of the discrete problem"),
    LG_OPTION(solve_values, branches, SWITCH, NULL,
              "Search from many starts, and list all minima found by rising energy"),
    LG_OPTION(solve_values, saddles, SWITCH, NULL, "With --branches or --sweep: list saddles too"),
    LG_OPTION(solve_values, sweep, U64, "n",
              "Follow the branches of a case over n equidistant x in [0, 2 pi]", .low = 2, .high = 10000),
    LG_OPTION(solve_values, out, STRING, "FILE.csv",
              "Write the curves (columns s, x, y, vx, vy, theta), or the sweep"),
    LG_OPTION(solve_values, plot, STRING, "FILE.svg|.png", "Draw the curves; with --sweep energy against x"),
    LG_FIELD_END};

static solve_values values;

static void json_problem(app_json *json, const lg_elastica *problem) {
    app_json_size(json, "intervals", problem->intervals);
    app_json_real(json, "length", problem->length);
    app_json_real(json, "stiffness", problem->stiffness);
    app_json_real(json, "theta0", problem->theta0);
    app_json_reals(json, "q0", problem->q0, 2);
    app_json_reals(json, "qN", problem->qN, 2);
}

static void json_curve(app_json *json, const beam_curve *curve) {
    const lg_elastica *problem = &curve->problem;
    const lg_elastica_solution *solution = &curve->solution;
    const size_t nodes = (size_t)problem->intervals + 1;
    app_json_real(json, "energy", solution->energy);
    app_json_size(json, "negative_eigenvalues", solution->negative_eigenvalues);
    app_json_real(json, "gradient", solution->gradient);
    app_json_real(json, "residual", solution->residual);
    app_json_reals(json, "multiplier", solution->force, 2);
    app_json_real(json, "rotation", problem->rotation);
    json_pairs(json, "q", curve->q, nodes);
    json_pairs(json, "v", curve->v, nodes);
    app_json_reals(json, "theta", curve->theta, nodes);
}

/* ---- one solution ---- */

static void print_curve(const beam_curve *curve, double seconds) {
    const lg_elastica *problem = &curve->problem;
    const lg_elastica_solution *solution = &curve->solution;
    const size_t n = problem->intervals, every = n > SHOWN_NODES ? (n + SHOWN_NODES - 1) / SHOWN_NODES : 1;
    app_table table;
    (void)printf("energy %.12g, rotation %.9g, force (%.9g, %.9g)\n", solution->energy, problem->rotation,
                 solution->force[0], solution->force[1]);
    (void)printf("%s: %u negative eigenvalues, gradient %.1e, residual %.1e; %u Newton steps, %.2g s\n",
                 solution->negative_eigenvalues == 0 ? "minimum" : "saddle", solution->negative_eigenvalues,
                 solution->gradient, solution->residual, solution->iterations, seconds);
    app_table_begin(&table, 6);
    static const char *const heads[] = {"s", "x", "y", "vx", "vy", "theta"};
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t k = 0; k <= n; k = k < n && k + every > n ? n : k + every) {
        app_table_cell(&table, "%.6g", problem->length * (double)k / (double)n);
        for (size_t c = 0; c < 2; c++) app_table_cell(&table, "%.9f", curve->q[2 * k + c]);
        for (size_t c = 0; c < 2; c++) app_table_cell(&table, "%.9f", curve->v[2 * k + c]);
        app_table_cell(&table, "%.9f", curve->theta[k]);
    }
    app_table_end(&table, stdout);
}

static void report_curve(const app *self, const beam_curve *curve, double seconds) {
    if (!self->json) {
        print_curve(curve, seconds);
        return;
    }
    const size_t inner = curve->problem.intervals - 1;
    app_json json;
    app_json_begin(&json);
    app_json_text(&json, "values", values.continuous ? "continuous" : "discrete");
    json_curve(&json, curve);
    if (!values.continuous) {
        double *lambda = app_alloc(inner, sizeof *lambda);
        (void)lg_elastica_euler_lagrange(&curve->problem, curve->q, curve->v, lambda);
        app_json_reals(&json, "lambda", lambda, inner);
        free(lambda);
    }
    json_problem(&json, &curve->problem);
    app_json_size(&json, "iterations", curve->solution.iterations);
    app_json_size(&json, "problems", curve->solution.problems);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

static int write_outputs(const app *self, const beam_curve *curves, size_t count, bool numbered,
                         char *const *labels) {
    lg_error error = {LG_OK, ""};
    lg_status status = LG_OK;
    if (values.out != NULL) status = write_curves(values.out, curves, count, numbered, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    if (values.plot != NULL) status = draw_curves(self, values.plot, curves, count, labels, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.plot);
}

/* Compares with the continuous beam. Where that has no answer there is nothing to say. */
static void warn_of_intervals(const app *self, const lg_elastica *problem, double energy) {
    static const double coarse = 0.05;
    lg_elastica_solution continuous;
    double *theta = app_alloc((size_t)problem->intervals + 1, sizeof *theta);
    const lg_status status =
        lg_elastica_solve_continuous(self->context, problem, NULL, theta, NULL, &continuous, NULL);
    free(theta);
    if (status == LG_OK && fabs(energy - continuous.energy) > coarse * continuous.energy)
        app_warn(
            self,
            "%u intervals are too few for this shape: the energy is %.4g, and %.4g for the continuous beam; "
            "take more --intervals, or --continuous",
            problem->intervals, energy, continuous.energy);
}

static int solve_curve(const app *self, const boundary *where, const lg_elastica_options *options) {
    beam_curve curve;
    const double begin = app_seconds();
    int code = beam_solve(self, where, options, values.continuous, &curve);
    const double seconds = app_seconds() - begin;
    if (code != APP_EXIT_OK) return code;
    if (!values.continuous) warn_of_intervals(self, &curve.problem, curve.solution.energy);
    code = write_outputs(self, &curve, 1, false, NULL);
    if (code == APP_EXIT_OK) report_curve(self, &curve, seconds);
    beam_curve_free(&curve);
    return code;
}

/* ---- branches ---- */

static void print_branches(const beam_curves *found) {
    static const char *const heads[] = {"branch", "energy",   "rotation", "negative eigenvalues",
                                        "",       "gradient", "force x",  "force y"};
    app_table table;
    app_table_begin(&table, LG_COUNT(heads));
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t i = 0; i < found->count; i++) {
        const beam_curve *curve = &found->list[i];
        app_table_cell(&table, "%zu", i + 1);
        app_table_cell(&table, "%.12g", curve->solution.energy);
        app_table_cell(&table, "%.6g", curve->problem.rotation);
        app_table_cell(&table, "%u", curve->solution.negative_eigenvalues);
        app_table_cell(&table, "%s", curve->solution.negative_eigenvalues == 0 ? "minimum" : "saddle");
        app_table_cell(&table, "%.1e", curve->solution.gradient);
        for (size_t c = 0; c < 2; c++) app_table_cell(&table, "%.6g", curve->solution.force[c]);
    }
    app_table_end(&table, stdout);
}

static void report_branches(const app *self, const beam_curves *found, const lg_elastica *problem,
                            double seconds) {
    if (!self->json) {
        print_branches(found);
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_open(&json, "branches", '[');
    for (size_t i = 0; i < found->count; i++) {
        app_json_open(&json, NULL, '{');
        json_curve(&json, &found->list[i]);
        app_json_close(&json, '}');
    }
    app_json_close(&json, ']');
    app_json_size(&json, "count", found->count);
    json_problem(&json, problem);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

static char **branch_labels(const beam_curves *found) {
    char **labels = app_alloc(found->count, sizeof *labels);
    for (size_t i = 0; i < found->count; i++)
        labels[i] = app_format("E = %.6g%s", found->list[i].solution.energy,
                               found->list[i].solution.negative_eigenvalues > 0 ? " (saddle)" : "");
    return labels;
}

static int solve_branches(const app *self, const boundary *where, const lg_elastica_options *options) {
    lg_error error = {LG_OK, ""};
    beam_curves found;
    const double begin = app_seconds();
    const lg_status status = beam_branches(self->context, where, options, values.saddles, &found, &error);
    const double seconds = app_seconds() - begin;
    if (status != LG_OK)
        return app_fail(self, status, "%s",
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    int code = APP_EXIT_OK;
    if (found.count == 0) code = app_fail(self, LG_NO_CONVERGENCE, "no equilibrium was found");
    if (found.full) app_warn(self, "there may be more branches than those listed");
    if (code == APP_EXIT_OK) {
        char **labels = branch_labels(&found);
        code = write_outputs(self, found.list, found.count, true, labels);
        for (size_t i = 0; i < found.count; i++) free(labels[i]);
        free(labels);
    }
    if (code == APP_EXIT_OK) report_branches(self, &found, &where->problem, seconds);
    beam_curves_free(&found);
    return code;
}

/* ---- the command ---- */

/* Options that exclude each other, or need another one. */
static int check_options(const app *self) {
    static const char *const alone[] = {"x", "theta0", "thetaN", "rotation"};
    const bool many = values.branches || values.sweep > 0;
    if (values.branches && values.sweep > 0)
        return app_usage(self, "--branches and --sweep cannot be given "
                               "together");
    if (values.continuous && many)
        return app_usage(self, "--continuous: %s is for the discrete problem only",
                         values.branches ? "--branches" : "--sweep");
    if (values.saddles && !many) return app_usage(self, "--saddles: needs --branches or --sweep");
    for (size_t i = 0; values.sweep > 0 && i < LG_COUNT(alone); i++)
        if (app_given(self, alone[i]))
            return app_usage(self, "--%s: --sweep already varies the x of a case", alone[i]);
    return APP_EXIT_OK;
}

static int run(app *self) {
    const app_path paths[] = {{"out", values.out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    lg_error error = {LG_OK, ""};
    lg_elastica problem;
    lg_elastica_init(&problem);
    lg_elastica_options options;
    boundary where;
    problem.length = values.length;
    problem.stiffness = values.stiffness;
    problem.intervals = (uint32_t)values.intervals;
    lg_elastica_options_init(&options);
    if (values.gradient_tol > 0) options.gradient_tolerance = values.gradient_tol;
    int code = check_options(self);
    if (code == APP_EXIT_OK && values.sweep > 0) {
        code = boundary_ends(self, &values.where, &problem);
        where.problem = problem;
    } else if (code == APP_EXIT_OK) {
        code = boundary_read(self, &values.where, &problem, LG_ELASTICA_BOTH_ENDS, &where);
    }
    if (code == APP_EXIT_OK) code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_elastica_check(&where.problem, &error);
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    const sweep_values sweep = {(size_t)values.sweep, problem,    (lg_elastica_case)values.where.kind,
                                values.saddles,       values.out, values.plot};
    if (values.sweep > 0) return sweep_run(self, &sweep, &options);
    return values.branches ? solve_branches(self, &where, &options) : solve_curve(self, &where, &options);
}

const app_command solve_command = {
    .name = "solve",
    .summary = "Solve for equilibria of a clamped beam",
    .details = "The solution is a minimum of the bending energy for the given ends, end angles and "
               "rotation; for a case it is the global minimum. The exit code is 4 when no acceptable "
               "minimum is found. --branches lists all minima found for the three rotations nearest to "
               "zero, or for the one of --rotation.",
    .settings = APP_SETTINGS(APP_GIVEN(solve_options, values)),
    .run = run};
