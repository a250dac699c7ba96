/* lg-simulate: integrate a mechanical system and look at the result. */
#include "lg-simulate/ensemble.h"

#include <stdlib.h>
#include <string.h>

static simulate_values values = {.atol = -1, .theta = 0.5};

static const char *const picture_kinds[] = {"overview", "components", "invariants", "manifold",
                                            "steps",    "3d",         NULL};

static const lg_field options[] = {
    LG_OPTION(simulate_values, method, STRING, "NAME",
              "A method of the list below (default rkmk54, and dp54 on R^n)"),
    LG_OPTION(simulate_values, scheme, STRING, "FILE.yaml", "A method of your own: a tableau in a file"),
    LG_OPTION(simulate_values, steps, U64, "N", "N equal steps", .low = 1, .high = 1e12),
    LG_OPTION(simulate_values, tol, REAL, "T", "Adaptive steps; the tolerance of component i is T |y_i| + A",
              .low = 1e-15, .high = 1, .value = "1e-9"),
    LG_OPTION(simulate_values, atol, REAL, "A",
              "Absolute part of the tolerance (default 1e-4 T, at least 1e-16, of the largest size that "
              "q, omega, p, R, ... of that body has had)",
              .high = 1e300),
    LG_OPTION(simulate_values, max_steps, U64, "N",
              "Stop after this many adaptive steps, rejected ones included", .low = 1, .high = 1e12,
              .value = "1000000"),
    LG_OPTION(simulate_values, t_end, REAL, "T", "Time of the last point (default: the scene's t_end)",
              LG_POSITIVE),
    LG_OPTION(simulate_values, theta, REAL, "TH",
              "Parameter of slgi, midpoint and implicit-euler: order 2 at 1/2, else 1", .high = 1),
    LG_OPTION(simulate_values, dexpinv, STRING, "exact|K",
              "RKMK methods: closed form, or the series up to ad^K, K = 0..10"),
    LG_OPTION(simulate_values, out, STRING, "FILE.h5", "Write the trajectory (HDF5)"),
    LG_OPTION(simulate_values, points, U64, "M",
              "Equidistant points of the trajectory, the start included (default 501, or steps)", .low = 2,
              .high = 1e8),
    LG_OPTION(simulate_values, times, REALS, "T,T,...",
              "Ascending times of the trajectory, instead "
              "of --points",
              LG_ANY_REAL, .longer = "use --points"),
    LG_OPTION(simulate_values, plot, STRING, "FILE.svg|.png", "Draw the run, or the diagram"),
    LG_OPTION(simulate_values, plot_kind, NAME, NULL,
              "overview, components, invariants, manifold, steps or 3d (default overview)",
              .names = picture_kinds),
    LG_OPTION(simulate_values, work_precision, SWITCH, NULL,
              "Compare methods: error at the final time against CPU time and evaluations"),
    LG_OPTION(simulate_values, methods, STRING, "NAME,NAME,...",
              "Methods of --work-precision (default: a selection of those that apply)"),
    LG_OPTION(simulate_values, levels, U64, "L",
              "Runs of each method in --work-precision; from run to run steps are doubled, tolerances "
              "divided by 10",
              .low = 1, .high = 40, .value = "9"),
    LG_OPTION(simulate_values, gradient, STRING, "W,W,...|@FILE",
              "Compute J = sum W_k y_k at the end and its gradient by the start and the parameters"),
    LG_OPTION(simulate_values, checkpoints, U64, "C",
              "Number of states stored for --gradient (default: the square root of the number of steps)",
              .low = 1, .high = 1e12),
    LG_OPTION(
        simulate_values, ensemble, U64, "N",
        "N runs side by side from other starts or with other parameters: statistics at the points (default "
        "51)",
        .low = 1, .high = MEMBERS_MAX),
    LG_OPTION(
        simulate_values, vary, STRING, "NAME=DISTRIBUTION,...",
        "What differs between members (default: the scene's key `ensemble`): uniform:LOW:HIGH, "
        "normal:MEAN:DEVIATION, within:S, within:S% or around:S of the scene's value, sphere, cone:ANGLE, "
        "rotation; e.g. q=sphere,omega=normal:0:1,masses=within:5%"),
    LG_OPTION(simulate_values, starts, STRING, "FILE.csv|.h5|.npy",
              "A member a row: columns named as numbers of the state or parameters (q1.x, m2)"),
    LG_OPTION(
        simulate_values, event, STRING, "NAME=VALUE,...",
        "Times when a number of the state first passes a value; NAME>VALUE upwards, NAME<VALUE downwards"),
    LG_OPTION(simulate_values, save, STRING, "all|K",
              "Keep the trajectories of all or of the first K members"),
    LG_OPTION(simulate_values, task, STRING, "i/n",
              "Part i of n (i from 0) of the ensemble, into a file for `lg-simulate merge OUT.h5 PARTS...`"),
    LG_OPTION(simulate_values, one_by_one, SWITCH, NULL,
              "Without lanes: one member at a time, for comparison"),
    LG_FIELD_END};

/* ---- options against each other ---- */

typedef struct dependency {
    const char *option, *other;
    bool needs; /* the option needs the other; else they exclude each other */
} dependency;

static const dependency dependencies[] = {{"checkpoints", "gradient", true},
                                          {"plot-kind", "plot", true},
                                          {"methods", "work-precision", true},
                                          {"levels", "work-precision", true},
                                          {"method", "scheme", false},
                                          {"points", "times", false},
                                          {"work-precision", "gradient", false},
                                          {"work-precision", "out", false},
                                          {"work-precision", "method", false},
                                          {"work-precision", "plot-kind", false},
                                          {"vary", "ensemble", true},
                                          {"starts", "ensemble", true},
                                          {"event", "ensemble", true},
                                          {"save", "ensemble", true},
                                          {"task", "ensemble", true},
                                          {"one-by-one", "ensemble", true},
                                          {"ensemble", "gradient", false},
                                          {"ensemble", "work-precision", false},
                                          {"ensemble", "plot-kind", false}};

static int check_options(const app *self) {
    for (size_t i = 0; i < LG_COUNT(dependencies); i++) {
        const dependency *d = &dependencies[i];
        if (!app_given(self, d->option) || app_given(self, d->other) == d->needs) continue;
        if (d->needs) return app_usage(self, "--%s: needs --%s", d->option, d->other);
        return app_usage(self, "--%s and --%s cannot be given together", d->option, d->other);
    }
    if (!values.work_precision && app_given(self, "steps") &&
        (app_given(self, "tol") || app_given(self, "atol")))
        return app_usage(self, "--steps (equal steps) and --tol (adaptive steps) cannot be given together");
    return APP_EXIT_OK;
}

/* A task works on its part of --out alone. */
static int check_outputs(const app *self) {
    const bool weights = values.gradient != NULL && values.gradient[0] == '@';
    ensemble_output out[OUTPUTS] = {{"out", NULL}};
    const bool parts = values.ensemble > 0;
    int code = parts ? ensemble_outputs(self, &values, out) : APP_EXIT_OK;
    const app_path paths[] = {{"scheme", values.scheme, LG_FILE_READ},
                              {"gradient", weights ? values.gradient + 1 : NULL, LG_FILE_READ},
                              {"starts", values.starts, LG_FILE_READ},
                              {"out", parts ? NULL : values.out, LG_FILE_WRITTEN},
                              {out[0].option, out[0].path, LG_FILE_WRITTEN},
                              {out[1].option, out[1].path, LG_FILE_WRITTEN},
                              {out[2].option, out[2].path, LG_FILE_WRITTEN},
                              {"plot", values.plot, LG_FILE_DRAWN}};
    if (code == APP_EXIT_OK) code = app_check_outputs(self, paths, LG_COUNT(paths));
    for (size_t i = 0; i < OUTPUTS; i++) free(out[i].path);
    return code;
}

/* Equal or adaptive steps must fit the method. */
int check_control(const simulation *sim, const lg_scheme *scheme) {
    const app *self = sim->self;
    if (values.steps > 0 || scheme->embedded_order > 0) return APP_EXIT_OK;
    char *names = method_names(sim, true, true);
    const int code =
        app_given(self, "tol") || app_given(self, "atol")
            ? app_usage(self, "--tol: '%s' does not estimate its error: give --steps N; adaptive methods: %s",
                        scheme->name, names)
            : app_usage(self,
                        "'%s' needs --steps N, because it does not estimate its error; adaptive "
                        "methods: %s",
                        scheme->name, names);
    free(names);
    return code;
}

/* ---- one run ---- */

static int fail_run(const simulation *sim, const plan *how, const outcome *run, lg_status status,
                    const lg_error *error) {
    const app *self = sim->self;
    const char *name = how->scheme->name;
    switch (status) {
    case LG_CANCELLED:
        return app_fail(self, status, "stopped by %s at t = %g", app_stopper(), run->t);
    case LG_STEP_TOO_SMALL:
        return app_fail(
            self, status,
            "%s: the step size fell below the rounding of time at t = %.17g, after %zu steps; try a larger "
            "--tol or --atol",
            name, run->t, run->stats.steps);
    case LG_TOO_MANY_STEPS:
        return app_fail(self, status, "%s: reached only t = %g in %zu steps (--max-steps); t_end is %g", name,
                        run->t, how->max_steps, how->t_end);
    case LG_NOT_FINITE:
        return app_fail(self, status, "%s: the state is not finite in the step from t = %g, after %zu steps",
                        name, run->t, run->stats.steps);
    case LG_NO_CONVERGENCE:
        return app_fail(self, status,
                        "%s: Newton's method does not converge in the step from t = %g; give more steps",
                        name, run->t);
    default:
        return app_fail(self, status, "%s: %s", name,
                        error->message[0] != '\0' ? error->message : lg_status_sentence(status));
    }
}

static int write_outputs(const report *what) {
    const app *self = what->sim->self;
    lg_error error = {LG_OK, ""};
    lg_status status = LG_OK;
    if (values.out != NULL) status = write_trajectory(what, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    if (values.plot != NULL) status = draw_run(what, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.plot);
}

/* What was reached before Ctrl-C is kept. */
static void keep_begun(const report *what) {
    lg_error error = {LG_OK, ""};
    if (values.out == NULL || what->path->kept == 0) return;
    if (write_trajectory(what, &error) == LG_OK)
        app_warn(what->sim->self, "%s holds the %zu points reached", values.out, what->path->kept);
}

static int run_and_report(const simulation *sim, const plan *how, watch *seen, samples *path,
                          gradient *slope) {
    lg_error error = {LG_OK, ""};
    outcome run = {.t = 0};
    report what = {sim, how, &run, seen, path, slope};
    for (size_t i = 0; i < sim->dim; i++) path->y[i] = sim->scene.state[i];
    const lg_status status = integrate(sim, how, path->y, path->y + sim->dim, &run, &error);
    run.seconds -= seen->spent;
    if (run.seconds < 0) run.seconds = 0;
    if (status == LG_CANCELLED) {
        for (size_t i = 0; i < path->kept; i++)
            if (path->t[path->first + i] > run.t) path->kept = i;
        keep_begun(&what);
    }
    if (status != LG_OK) return fail_run(sim, how, &run, status, &error);
    watch_warn(seen, how, &run);
    if (slope == NULL) horizon_warn(sim, how, path->y + (path->count - 1) * sim->dim);
    int code = slope != NULL ? gradient_compute(sim, how->scheme, seen, slope) : APP_EXIT_OK;
    if (code == APP_EXIT_OK) code = write_outputs(&what);
    if (code != APP_EXIT_OK) return code;
    if (sim->self->json)
        report_json(&what);
    else
        report_text(&what);
    return APP_EXIT_OK;
}

static int run_with(const simulation *sim, const lg_scheme *scheme) {
    plan how;
    samples path = {0};
    gradient slope = {0};
    watch seen = {.sim = NULL};
    plan_init(sim, scheme, &how);
    int code = check_control(sim, scheme);
    if (code == APP_EXIT_OK)
        code = samples_choose(sim, &how, values.out != NULL || values.plot != NULL, &path);
    if (code == APP_EXIT_OK && values.gradient != NULL) code = gradient_read(sim, &slope);
    if (code == APP_EXIT_OK) {
        how.times = path.t + 1;
        how.count = path.count - 1;
        watch_begin(&seen, sim, values.plot != NULL, values.gradient != NULL, sim->scene.state);
        how.observe = watch_step;
        how.observer = &seen;
        code = run_and_report(sim, &how, &seen, &path, values.gradient != NULL ? &slope : NULL);
    }
    watch_end(&seen);
    gradient_free(&slope);
    samples_free(&path);
    return code;
}

static int run_once(const simulation *sim) {
    method what = {.file = NULL};
    if (values.plot != NULL && values.plot_kind == PICTURE_SPACE && !has_space_picture(sim))
        return app_usage(sim->self, "--plot-kind 3d: there is no spatial picture of %s",
                         lg_system_name(sim->system));
    int code = method_choose(sim, &what);
    if (code == APP_EXIT_OK) code = run_with(sim, &what.scheme);
    method_free(&what);
    return code;
}

static int run(app *self) {
    simulation sim = {.self = NULL};
    if (self->rank_count > 1 && values.ensemble == 0)
        return app_usage(self, "runs alone without --ensemble, and mpirun started %u of it",
                         self->rank_count);
    int code = check_options(self);
    if (code == APP_EXIT_OK) code = check_outputs(self);
    if (code != APP_EXIT_OK) return code;
    code = simulation_open(self, &values, self->arguments[0], &sim);
    if (code == APP_EXIT_OK)
        code = values.ensemble > 0     ? ensemble(&sim)
               : values.work_precision ? work_precision(&sim)
                                       : run_once(&sim);
    simulation_close(&sim);
    return code;
}

/* ---- the methods, for --help ---- */

static bool is_ambient(const lg_scheme *scheme) {
    return scheme->ambient;
}

static bool is_splitting(const lg_scheme *scheme) {
    return scheme->kind == LG_SCHEME_SPLITTING;
}

static bool is_variational(const lg_scheme *scheme) {
    return scheme->kind == LG_SCHEME_VARIATIONAL;
}

static bool is_cotangent(const lg_scheme *scheme) {
    return scheme->kind == LG_SCHEME_SLGI;
}

static bool is_lie(const lg_scheme *scheme) {
    return !is_ambient(scheme) && !is_splitting(scheme) && !is_variational(scheme) && !is_cotangent(scheme);
}

static bool is_adaptive(const lg_scheme *scheme) {
    return scheme->embedded_order > 0;
}

/* The text so far with the names of the schemes that belong, and what they are for. */
static char *list_methods(char *text, bool (*belongs)(const lg_scheme *scheme), const char *what) {
    const char *between = "";
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        if (!belongs(lg_scheme_at(i))) continue;
        char *longer = app_format("%s%s%s", text, between, lg_scheme_at(i)->name);
        free(text);
        text = longer;
        between = ", ";
    }
    char *whole = app_format("%s%s", text, what);
    free(text);
    return whole;
}

static char *describe_methods(void) {
    char *text = app_format("Methods: ");
    text = list_methods(text, is_ambient, " in the ambient space; ");
    text = list_methods(text, is_splitting, " for separable systems; ");
    text = list_methods(text, is_variational, " for the oscillator and chains; ");
    text = list_methods(text, is_lie, " on the manifold itself; ");
    text = list_methods(text, is_cotangent, " for the heavy top as cotangent or quadratic. Adaptive: ");
    return list_methods(
        text, is_adaptive,
        "; they take --steps too.\nThe default tolerance fits states in any units; --atol is in the units of "
        "the state.");
}

int main(int argc, char **argv) {
    if (argc > 1 && strcmp(argv[1], "merge") == 0) return merge_main(argc, argv);
    char *details = describe_methods();
    const app_command command[] = {
        {.arguments = "SCENE.yaml",
         .summary = "Integrates a mechanical system with a classical or a Lie group method. Gives the final "
                    "state, invariants, the distance from the manifold, pictures, work-precision diagrams "
                    "and gradients.",
         .details = details,
         .settings = APP_SETTINGS(APP_GIVEN(options, values)),
         .run = run,
         .together = APP_RANKS}};
    const int code = app_main(argc, argv, "lg-simulate", command[0].summary, command);
    free(details);
    return code;
}
