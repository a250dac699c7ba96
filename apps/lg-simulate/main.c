/* lg-simulate: integrates a mechanical system and shows the result. */
#include "common/trials.h"
#include "lg-simulate/ensemble.h"

#include <string.h>

static simulate_values values = {.atol = -1, .theta = 0.5};

static const lg_field options[] = {
    APP_SCHEME(simulate_values, "NAME|FILE.yaml",
               "A scheme of the list below, or a tableau of your own in a file (default rkmk54, and dp54 on "
               "R^n)",
               .usual = true),
    LG_OPTION(simulate_values, steps, U64, "N", "N equal steps", .low = 1, .high = 1e12, .usual = true),
    APP_TOLERANCE(simulate_values, "Adaptive steps; the tolerance of component i is TOL |y_i| + A", .high = 1,
                  .value = "1e-9", .usual = true),
    LG_OPTION(simulate_values, atol, REAL, "A",
              "Absolute part of the tolerance (default: 1e-4 TOL, but at least 1e-16, times the largest size "
              "so far of the vector q, omega, p, R, ... that component i belongs to)",
              .high = 1e300),
    LG_OPTION(simulate_values, max_steps, U64, "N",
              "Stop after this many adaptive steps, rejected ones included", .low = 1, .high = 1e12,
              .value = "1000000"),
    APP_T_END(simulate_values, "Time of the last point (default: the scene's t_end)", .usual = true),
    LG_OPTION(simulate_values, theta, REAL, "TH",
              "Parameter of slgi, midpoint and implicit-euler: order 2 at 1/2, else 1", .high = 1),
    LG_OPTION(simulate_values, dexpinv, U64, "exact|K",
              "RKMK methods: closed form, or the series up to ad^K, K = 0..10", .high = LG_DEXPINV_MAX,
              LG_NAMES("exact")),
    APP_OUT(simulate_values, "FILE.h5", "Write the trajectory (HDF5)", .usual = true),
    APP_POINTS(simulate_values,
               "Number of equidistant points of the trajectory, including the start (default 501, or "
               "according to --steps)",
               .without = "times", .usual = true),
    LG_OPTION(simulate_values, times, REALS, "T,T,...",
              "Ascending times of the trajectory, instead of --points", LG_ANY_REAL,
              .longer = "use --points"),
    LG_OPTION(simulate_values, work_precision, SWITCH, NULL,
              "Compare schemes: error at the final time against CPU time and evaluations",
              .without = "gradient,out,plot-kind", .usual = true),
    LG_OPTION(simulate_values, schemes, STRING, "NAME,NAME,...",
              "Schemes of --work-precision (default: a selection of the schemes that apply)",
              .needs = "work-precision"),
    LG_OPTION(simulate_values, levels, U64, "L",
              "Number of runs of each method in --work-precision; each run has twice the steps, or a tenth "
              "of the tolerance, of the run before",
              .needs = "work-precision", .low = 1, .high = 40, .value = "9"),
    LG_OPTION(
        simulate_values, gradient, STRING, "W,W,...|@FILE",
        "Compute J = sum W_k y_k at the end and its gradient with respect to the start and the parameters",
        .usual = true),
    LG_OPTION(simulate_values, checkpoints, U64, "C",
              "Number of states stored for --gradient (default: the square root of the number of steps)",
              .needs = "gradient", .low = 1, .high = 1e12),
    LG_OPTION(simulate_values, ensemble, U64, "N",
              "N runs from different starts or with different parameters, and their statistics at the points "
              "(default 51)",
              .without = "gradient,work-precision,plot-kind", .usual = true, .low = 1, .high = MEMBERS_MAX),
    LG_OPTION(
        simulate_values, vary, STRING, "NAME=DISTRIBUTION,...",
        "What differs between members (default: the scene's key `ensemble`): uniform:LOW:HIGH, "
        "normal:MEAN:DEVIATION, within:S, within:S% or around:S of the scene's value, sphere, cone:ANGLE, "
        "rotation; e.g. q=sphere,omega=normal:0:1,masses=within:5%",
        .needs = "ensemble", .usual = true),
    LG_OPTION(simulate_values, members, STRING, "FILE.csv|.h5",
              "A table with one row per member; its columns have the names of numbers of the state or of "
              "parameters (q1.x, m2)",
              .needs = "ensemble", .file = LG_FILE_READ),
    LG_OPTION(
        simulate_values, event, STRING, "NAME=VALUE,...",
        "Times when a number of the state first passes a value; NAME>VALUE upwards, NAME<VALUE downwards",
        .needs = "ensemble"),
    LG_OPTION(simulate_values, save, U64, "all|K", "Keep the trajectories of all or of the first K members",
              .needs = "ensemble", .low = 1, .high = MEMBERS_MAX, LG_NAMES("all")),
    TRIALS_TASK(simulate_values, task,
                "Run part i of n (i from 0) of the ensemble and write a file for `lg-simulate merge OUT.h5 "
                "PARTS...`",
                .needs = "ensemble"),
    LG_FIELD_END};

static void run(app *self) {
    simulation sim;
    ensemble_files files = {.out = NULL};
    if (self->rank_count > 1 && values.ensemble == 0)
        app_stop_usage(
            self, "without --ensemble this program runs in one process only, but mpirun started %u processes",
            self->rank_count);
    if (!values.work_precision && app_given(self, "steps") &&
        (app_given(self, "tolerance") || app_given(self, "atol")))
        app_stop_usage(self,
                       "--steps (equal steps) and --tolerance (adaptive steps) cannot be given together");
    ensemble_files_choose(self, &values, &files);
    const char *kind = values.ensemble > 0 ? "ensemble" : "trajectory";
    const bool weights = values.gradient != NULL && values.gradient[0] == '@';
    const app_path paths[] = {{"scheme", values.scheme, LG_FILE_READ, NULL},
                              {"gradient", weights ? values.gradient + 1 : NULL, LG_FILE_READ, NULL},
                              {"out", files.out, LG_FILE_WRITTEN, kind},
                              {"save", files.trajectories, LG_FILE_WRITTEN, "ensemble-trajectories"},
                              /* Rank 0 merges the parts of all ranks into the file of --out. */
                              {"out", self->rank_count > 1 ? values.out : NULL, LG_FILE_WRITTEN, kind}};
    app_check_outputs(self, paths, LG_COUNT(paths));
    simulation_open(self, &values, self->arguments[0], &sim);
    if (values.ensemble > 0)
        ensemble(&sim, &files);
    else if (values.work_precision)
        work_precision(&sim);
    else
        run_once(&sim);
    lg_scene_destroy(&sim.scene);
}

/* ---- the list of methods for --help ---- */

enum { AMBIENT, SPLITTING, VARIATIONAL, LIE, COTANGENT, ADAPTIVE, GROUPS };

static bool belongs(const lg_scheme *scheme, int group) {
    static const int of_kind[LG_SCHEME_KINDS] = {LIE, LIE, SPLITTING, AMBIENT, COTANGENT, VARIATIONAL};
    if (group == ADAPTIVE) return scheme->embedded_order > 0;
    return group == (scheme->ambient ? AMBIENT : of_kind[scheme->kind]);
}

static char *describe_methods(void) {
    static const char *const what[GROUPS] = {
        [AMBIENT] = " in the ambient space; ",
        [SPLITTING] = " for separable systems; ",
        [VARIATIONAL] = " for the oscillator and chains; ",
        [LIE] = " on the manifold itself; ",
        [COTANGENT] = " for the heavy top as cotangent or quadratic. Adaptive: ",
        [ADAPTIVE] = ("; they take --steps too.\nThe default tolerance fits states in any units; "
                      "--atol is in the units of the state.")};
    lg_text text = app_text();
    lg_text_add(&text, "Methods: ");
    for (int group = 0; group < GROUPS; group++) {
        const char *between = "";
        for (size_t i = 0; i < lg_scheme_count(); i++) {
            if (!belongs(lg_scheme_at(i), group)) continue;
            lg_text_add(&text, "%s%s", between, lg_scheme_at(i)->name);
            between = ", ";
        }
        lg_text_add(&text, "%s", what[group]);
    }
    return text.data;
}

APP_PROGRAM(lg_simulate) {
    if (argc > 1 && strcmp(argv[1], "merge") == 0) return merge_main(argc, argv);
    APP_FREE char *details = describe_methods();
    const app_command command[] = {
        {.arguments = "SCENE.yaml",
         .summary = "Integrates a mechanical system with a classical or a Lie group method. Gives the final "
                    "state, invariants, the distance from the manifold, plots, work-precision diagrams "
                    "and gradients.",
         .details = details,
         .settings = APP_SETTINGS(APP_GIVEN(options, values)),
         .plots = simulate_plots,
         .run = run,
         .together = APP_RANKS}};
    return app_main(argc, argv, "lg-simulate", command[0].summary, command);
}
