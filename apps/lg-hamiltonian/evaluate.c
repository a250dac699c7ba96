/* lg-hamiltonian evaluate: the errors E1 and E2 of a model on test trajectories. The plot of trajectories. */
#include "common/verbs.h"
#include "hamiltonian/learned.h"
#include "lg-hamiltonian/training.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

typedef struct evaluate_values {
    size_t drawn;
    bool record, relative;
} evaluate_values;

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, drawn, U64, "n", "plot: number of trajectories", .low = 1, .high = 10000,
              .value = "10"),
    RELATIVE(evaluate_values, "squares",
             "|z - z'|/|z + z'| + 1e-8 over trajectories and points, where z are the positions and "
             "velocities of a chain's masses, else the state; needs /parameters in TEST.h5"),
    LG_OPTION(evaluate_values, record, SWITCH, NULL,
              "Write E1, E2 and the test set's description into MODEL.h5, where lg-export finds them"),
    LG_FIELD_END};

static evaluate_values values;

static void report(const app *self, const lg_trajectories *test, const verdict *result, bool recorded,
                   double seconds) {
    app_json *out = self->out;
    APP_PUT(out, LG_REAL("E1", result->e1, "mean squared error of the learned flow, starts included"),
            LG_REAL("E2", result->e2,
                    test->hamiltonian == NULL
                        ? "the file of the test trajectories has no /hamiltonian"
                        : "mean deviation of the Hamiltonian from the true one, up to a constant"));
    if (values.relative)
        APP_PUT(out, LG_REAL("relative", result->relative, "geometric mean of |z - z'|/|z + z'| + 1e-8"),
                LG_REAL("relative_worst", result->relative_worst, "the same of the worst trajectory"));
    APP_PUT(out, LG_WHOLE("trajectories", test->count, NULL),
            LG_WHOLE("points", test->points, "of each trajectory"),
            LG_REAL("t_end", test->t[test->points - 1] - test->t[0], NULL), LG_AS_FLAG("recorded", recorded),
            LG_AS_WHOLE("threads", self->threads), LG_REAL("seconds", seconds, NULL));
    if (recorded) app_result_line(out, "Recorded in %s", self->arguments[0]);
}

/* An E1 or E2 that is not finite is a failure (the report is still printed), except that E2 may be
 * unknown. */
static int check_finite(const app *self, const lg_trajectories *test, const verdict *result) {
    if (!isfinite(result->e1))
        return app_fail(self, LG_NOT_FINITE, "%s: E1 is not finite (%g): the squared differences overflow",
                        self->arguments[1], result->e1);
    if (test->hamiltonian != NULL && !isfinite(result->e2))
        return app_fail(
            self, LG_NOT_FINITE,
            "%s: E2 is not finite (%g): a learned energy is not finite or the differences overflow",
            self->arguments[1], result->e2);
    return APP_EXIT_OK;
}

/* Writes a finite verdict and a description of the test set into the model file. */
static lg_status record(const app *self, lg_hamiltonian_file *file, const lg_trajectories *test,
                        const verdict *result, lg_error *error) {
    file->has_e1 = true, file->e1 = result->e1;
    file->has_e2 = test->hamiltonian != NULL, file->e2 = result->e2;
    file->test = (lg_test_set){
        .trajectories = test->count, .points = test->points, .t_end = test->t[test->points - 1] - test->t[0]};
    memcpy(file->test.sha256, test->sha256, sizeof test->sha256);
    return lg_hamiltonian_save_errors(self->context, self->arguments[0], file, error);
}

static int evaluate(const app *self, lg_hamiltonian_file *file, const lg_trajectories *test) {
    verdict result;
    const lg_hamiltonian *model = &file->run.model;
    const bool other = model->family != test->family;
    if (other || model->n != test->n)
        app_stop(self, LG_SHAPE, "%s: a state has %u numbers, but a state of the model %s has %u%s",
                 self->arguments[1], test->state_dim, self->arguments[0], lg_hamiltonian_state_dim(model),
                 other ? " in another layout" : "");
    if (values.relative && test->truth == NULL)
        app_stop(self, LG_FORMAT, "%s: --metric relative needs the parameters of the system, /parameters",
                 self->arguments[1]);
    const double tolerance = flow_given.tolerance > 0 ? flow_given.tolerance : default_tolerance(model);
    const double begin = app_seconds();
    APP_FREE double *predicted = app_alloc(test->count * test->points * test->state_dim, sizeof *predicted);
    APP_DO(self, judge, self->threads, model, file->theta, test, tolerance, predicted, &result);
    if (values.relative) APP_MUST(self, judge_relative(test, predicted, &result, &error));
    app_plot_draw(self, 0,
                  &(drawn_flow){"Trajectories of the test set, true and predicted", model, test->t,
                                test->data, predicted,
                                test->count < values.drawn ? test->count : values.drawn, test->points});
    const double seconds = app_seconds() - begin;
    const int code = check_finite(self, test, &result);
    lg_error why = {LG_OK, ""};
    const bool records = code == APP_EXIT_OK && values.record;
    const lg_status recorded = records ? record(self, file, test, &result, &why) : LG_OK;
    report(self, test, &result, records && recorded == LG_OK, seconds);
    app_result_end(self);
    app_must_file(self, recorded, &why, self->arguments[0]);
    return code;
}

/* Checks that --record can replace the model file. */
static void check_record(const app *self) {
    const char *path = self->arguments[0];
    if (!values.record) return;
    if (app_same_file(path, self->arguments[1]))
        app_stop_usage(self, "--record: %s is both the model and the test data", path);
    APP_MUST_FILE(self, path, app_check_writable(path, &error));
    if (access(path, W_OK) != 0) app_stop(self, LG_FILE, "%s: %s", path, strerror(errno));
    APP_MUST_FILE(self, path, app_claim(self, path, &error));
    app_continue(path);
}

static void run(app *self) {
    const char *model = self->arguments[0], *data = self->arguments[1];
    lg_hamiltonian_file file;
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories test = {0};
    check_record(self);
    APP_FILE(self, model, lg_recipe_load, NULL, &lg_recipe_hamiltonian, &file);
    lg_read_options reading;
    lg_read_options_init(&reading);
    if (file.constraint != NULL) reading.constraint = lg_constraint_program(file.constraint);
    APP_FILE(self, data, lg_trajectories_read, &reading, &test);
    lg_warn_of_inputs(self->context, data, &test);
    if (file.run.system[0] != '\0' && test.system[0] != '\0' && strcmp(file.run.system, test.system) != 0)
        app_warn(self, "%s was trained on %s, but %s holds %s", model, file.run.system, data, test.system);
    if (values.record && strcmp(file.run.data_sha256, test.sha256) == 0)
        app_warn(self, "--record: %s holds the data that %s was trained on", data, model);
    self->code = evaluate(self, &file, &test);
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
}

/* ---- the plot ---- */

/* Writes a block for each trajectory, the true ones first: the state, and the time. */
void put_flow(app_plot *plot, const void *drawn) {
    const drawn_flow *of = drawn;
    const uint32_t dim = lg_hamiltonian_state_dim(of->model);
    const bool chain = of->model->family->factor[0] == LG_SPACE_TS2;
    if (chain) plot->script = "spheres";
    app_plot_text(plot, "%s\t%u\t%zu\t%zu", of->title, chain ? of->model->n : dim,
                  of->truth != NULL ? of->n : 0, of->n);
    for (size_t i = of->truth != NULL ? 0 : of->n; i < 2 * of->n; i++) {
        const double *y =
            i < of->n ? of->truth + i * of->points * dim : of->predicted + (i - of->n) * of->points * dim;
        APP_PLOT_COLUMNS(plot, 9, of->points, {y, dim, dim}, {of->t, 1, 1});
        app_plot_block(plot);
    }
}

const app_command hamiltonian_evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TEST.h5",
    .summary = "Measure a model's errors E1 and E2 on test trajectories",
    .details = "E1: mean of the squared differences over trajectories, coordinates and points, t = 0 "
               "included; the learned flow is integrated by an adaptive method of order 5 from the file's "
               "first points. E2: mean |d - mean d|, d = H - H_learned at the starts; unknown (null) without "
               "/hamiltonian in the file.",
    APP_DRAWS("the test trajectories, true and predicted", "learned_flow", put_flow),
    .settings = APP_SETTINGS(FLOW_TOLERANCE, APP_GIVEN(evaluate_options, values)),
    .run = run};
