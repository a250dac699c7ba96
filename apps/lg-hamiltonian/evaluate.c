/* lg-hamiltonian evaluate: E1 and E2 of a model on test trajectories. */
#include "lg-hamiltonian/learning.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct evaluate_values {
    const char *plot;
    size_t drawn;
    double tolerance;
    bool record;
    int metric;
} evaluate_values;

enum { METRIC_SQUARES, METRIC_RELATIVE };
static const char *const metric_names[] = {
    [METRIC_SQUARES] = "squares", [METRIC_RELATIVE] = "relative", NULL};

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, tolerance, REAL, "TOL",
              "Tolerance of the adaptive integration of the learned flow", .low = 1e-14, .high = 1e-2,
              .otherwise = "1e-10; 1e-13 for linear potentials"),
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw the test trajectories, true and predicted"),
    LG_OPTION(evaluate_values, drawn, U64, "n", "plot: so many of them (default 10)", .low = 1,
              .high = 10000),
    LG_OPTION(evaluate_values, metric, NAME, NULL,
              "relative: also the geometric mean of |z - z'|/|z + z'| + 1e-8 over trajectories and points, "
              "where z are the positions and velocities of a chain's masses, else the state; needs "
              "/parameters in TEST.h5",
              .names = metric_names),
    LG_OPTION(evaluate_values, record, SWITCH, NULL,
              "Write E1, E2 and the test set's description into MODEL.h5, where lg-export finds them"),
    LG_FIELD_END};

static evaluate_values values;

static void report(const app *self, const lg_trajectories *test, const verdict *result, bool recorded,
                   double seconds) {
    if (self->json) {
        app_json json;
        app_json_begin(&json);
        app_json_real(&json, "E1", result->e1);
        app_json_real(&json, "E2", result->e2);
        if (values.metric == METRIC_RELATIVE) {
            app_json_real(&json, "relative", result->relative);
            app_json_real(&json, "relative_worst", result->relative_worst);
        }
        app_json_size(&json, "trajectories", test->count);
        app_json_size(&json, "points", test->points);
        app_json_real(&json, "t_end", test->t[test->points - 1] - test->t[0]);
        app_json_bool(&json, "recorded", recorded);
        app_json_size(&json, "threads", self->threads);
        app_json_real(&json, "seconds", seconds);
        app_json_end(&json);
        return;
    }
    (void)printf("%zu trajectories of %zu points on [%g, %g] (%.2f s)\n", test->count, test->points,
                 test->t[0], test->t[test->points - 1], seconds);
    (void)printf("E1 = %.4e  mean squared error of the learned flow\n", result->e1);
    if (isfinite(result->e2))
        (void)printf("E2 = %.4e  mean deviation of the Hamiltonian from the true one, up to a constant\n",
                     result->e2);
    else if (test->hamiltonian == NULL)
        (void)printf("E2 unknown: %s has no /hamiltonian\n", self->arguments[1]);
    else
        (void)printf("E2 is not finite\n");
    if (values.metric == METRIC_RELATIVE)
        (void)printf(
            "relative = %.4e  geometric mean of |z - z'|/|z + z'| + 1e-8; %.4e for the worst trajectory\n",
            result->relative, result->relative_worst);
    if (recorded) (void)printf("Recorded in %s\n", self->arguments[0]);
}

/* A result that is no number was still reported; only an E2 that nobody can know is no failure. */
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

static int record(const app *self, lg_hamiltonian_file *file, const lg_trajectories *test,
                  const verdict *result) {
    lg_error error = {LG_OK, ""};
    const char *path = self->arguments[0];
    const lg_status status =
        record_verdict(self->context, path, &file->run, file->theta, test, result, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, path);
}

static void warn_of_systems(const app *self, const char *trained, const char *given) {
    if (trained[0] != '\0' && given[0] != '\0' && strcmp(trained, given) != 0)
        app_warn(self, "%s was trained on %s, but %s holds %s", self->arguments[0], trained,
                 self->arguments[1], given);
}

static void warn_of_training_data(const app *self, const char *trained, const char *given) {
    if (values.record && strcmp(trained, given) == 0)
        app_warn(self, "--record: %s holds the data that %s was trained on", self->arguments[1],
                 self->arguments[0]);
}

static int evaluate(app *self, lg_hamiltonian_file *file, const lg_trajectories *test) {
    lg_error error = {LG_OK, ""};
    verdict result;
    const lg_hamiltonian *model = &file->run.model;
    if (model->family != test->family || model->n != test->n)
        return app_fail(self, LG_SHAPE, "%s: states of %u numbers, but the model %s has %u%s",
                        self->arguments[1], test->state_dim, self->arguments[0],
                        lg_hamiltonian_state_dim(model),
                        model->family != test->family ? " of another layout" : "");
    const double tolerance = values.tolerance > 0 ? values.tolerance : default_tolerance(model);
    double *predicted = NULL;
    if (values.metric == METRIC_RELATIVE && test->truth == NULL)
        return app_fail(self, LG_FORMAT,
                        "%s: --metric relative needs the parameters of the system, /parameters",
                        self->arguments[1]);
    const size_t drawn = values.drawn > 0 ? values.drawn : SHOWN_TRAJECTORIES;
    if (values.plot != NULL || values.metric == METRIC_RELATIVE)
        predicted = app_alloc(test->count * test->points * test->state_dim, sizeof *predicted);
    const double begin = app_seconds();
    lg_status status =
        judge(self->context, self->threads, model, file->theta, test, tolerance, predicted, &result, &error);
    int code = status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "%s", error.message);
    if (code == APP_EXIT_OK && values.metric == METRIC_RELATIVE) {
        status = judge_relative(test, predicted, &result, &error);
        if (status != LG_OK) code = app_fail(self, status, "%s", error.message);
    }
    if (code == APP_EXIT_OK && values.plot != NULL) {
        status = draw_trajectories(self, values.plot, "Trajectories of the test set, true and predicted",
                                   model, test->t, test->data, predicted,
                                   test->count < drawn ? test->count : drawn, test->points, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, values.plot);
    }
    if (code == APP_EXIT_OK) {
        const double seconds = app_seconds() - begin;
        code = check_finite(self, test, &result);
        if (code == APP_EXIT_OK && values.record) code = record(self, file, test, &result);
        report(self, test, &result, code == APP_EXIT_OK && values.record, seconds);
    }
    free(predicted);
    return code;
}

/* The model is replaced: a new file in the folder of what a link leads to. */
static int check_record(const app *self) {
    lg_error error = {LG_OK, ""};
    const char *path = self->arguments[0];
    if (!values.record) return APP_EXIT_OK;
    if (app_same_file(path, self->arguments[1]))
        return app_usage(self, "--record: %s is the model and the test data too", path);
    char *real = realpath(path, NULL);
    lg_status status = app_check_writable(real != NULL ? real : path, &error);
    free(real);
    if (status == LG_OK && access(path, W_OK) != 0)
        status = app_error(&error, LG_FILE, "%s: %s", path, strerror(errno));
    if (status == LG_OK) status = app_claim(self, path, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    return APP_EXIT_OK;
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_hamiltonian_file file;
    lg_trajectories test;
    const app_path plot = {"plot", values.plot, APP_DRAWN};
    int code = app_check_outputs(self, &plot, 1);
    if (code == APP_EXIT_OK) code = check_record(self);
    if (code != APP_EXIT_OK) return code;
    lg_status status = lg_model_load_hamiltonian(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    status = lg_trajectories_read(self->context, self->arguments[1], NULL, &test, &error);
    if (status == LG_OK) {
        warn_of_inputs(self, self->arguments[1], &test);
        warn_of_systems(self, file.run.system, test.system);
        warn_of_training_data(self, file.run.data_sha256, test.sha256);
        code = evaluate(self, &file, &test);
        lg_trajectories_destroy(&test);
    } else {
        code = app_fail_file(self, status, &error, self->arguments[1]);
    }
    lg_hamiltonian_file_destroy(&file);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TEST.h5",
    .summary = "Measure a model's errors E1 and E2 on test trajectories",
    .details = "E1: mean of the squared differences over trajectories, coordinates and points, t = 0 "
               "included; the learned "
               "flow is integrated by an adaptive method of order 5 from the file's first points. E2: mean "
               "|d - mean d|, d "
               "= H - H_learned at the starts; unknown (null) without /hamiltonian in the file.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .arguments_min = 2,
    .arguments_max = 2,
    .run = run};
