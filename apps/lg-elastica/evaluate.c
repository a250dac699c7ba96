/* lg-elastica evaluate: the errors of a model on curves. */
#include <stdlib.h>
#include <string.h>

#include "elastica/files/recipe.h"
#include "lg-elastica/beam.h"

enum { SHOWN = 10 };

typedef struct evaluate_values {
    const char *plot;
    int part;
} evaluate_values;

enum { PART_ALL, PART_TRAIN, PART_TEST };
static const char *const part_names[] = {"all", "train", "test", NULL};

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, part, NAME, NULL,
              "Curves to use: all (default), or the train or test part of the data that the model was "
              "trained on",
              .names = part_names),
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw ten curves, true and learned, with their tangents and the mean error along the beam",
              .file = LG_FILE_DRAWN),
    LG_FIELD_END};

static evaluate_values values;

typedef struct evaluation {
    lg_surrogate_file file;
    lg_elastica_data data;
    uint32_t *chosen; /* (count): indices of the curves, rising */
    size_t count;
    lg_surrogate_errors errors;
    outside beyond;
    double *node_error; /* (N + 1, 2) */
    double seconds;
} evaluation;

static void report(const app *self, const evaluation *e) {
    const lg_surrogate_errors *errors = &e->errors;
    const struct {
        const char *key, *meaning;
        double value;
    } rows[] = {{"mse", "mean squared error over nodes and components", errors->mse},
                {"mse_q", "of the nodes", errors->mse_q},
                {"mse_v", "of the tangents", errors->mse_v},
                {"max_error", "largest component", errors->max_error},
                {"boundary_error", "largest difference from the boundary conditions", errors->boundary_error},
                {"unit_tangent_error", "largest | |v| - 1 |", errors->unit_tangent_error},
                {"unit_tangent_between", "half-way between nodes", errors->unit_tangent_between}};
    app_json out;
    app_result_begin(&out, self);
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        app_result_real(&out, rows[i].key, rows[i].value, rows[i].meaning);
    app_result_size(&out, "curves", e->count, NULL);
    app_result_text(&out, "part", part_names[values.part], NULL);
    app_result_size(&out, "outside", e->beyond.count, "curves beyond the training range");
    app_json_real(&out, "reach", e->beyond.reach);
    app_json_real(&out, "largest_distance", e->beyond.largest);
    app_json_real(&out, "spread", e->beyond.spread);
    app_json_real(&out, "largest_off_family", e->beyond.off);
    app_json_text(&out, "network", lg_surrogate_kind_name(e->file.run.model.options.kind));
    app_json_real(&out, "seconds", e->seconds);
    app_json_end(&out);
}

/* ---- the plot ---- */

/* A block for each shown curve, with its true and learned nodes; then the mean errors at each node. */
static void draw(const app *self, const evaluation *e) {
    const lg_elastica_curves *curves = &e->data.curves;
    const size_t nodes = (size_t)curves->intervals + 1, shown = e->count < SHOWN ? e->count : (size_t)SHOWN;
    APP_FREE double *q = app_alloc(5 * nodes, sizeof *q);
    double *const v = q + 2 * nodes, *const s = v + 2 * nodes;
    APP_CLEAN(learned_close) learned network = learned_open(self, &e->file, nodes);
    app_plot plot;
    app_plot_begin(&plot, "elastica_comparison", values.plot);
    app_plot_text(&plot, "%s network, %zu of %zu curves, mean squared error %.3e\t%zu\t%.9g",
                  lg_surrogate_kind_name(e->file.run.model.options.kind), shown, e->count, e->errors.mse,
                  shown, curves->length);
    for (size_t k = 0; k < nodes; k++) s[k] = equidistant(curves->length, k, nodes);
    for (size_t i = 0; i < shown; i++) {
        const size_t curve = e->chosen[(2 * i + 1) * e->count / (2 * shown)];
        const double *true_q = curves->q + 2 * nodes * curve, *true_v = curves->v + 2 * nodes * curve;
        lg_surrogate_curve(network.curves, curves->boundary + 8 * curve, s, nodes, q, v, network.work);
        for (size_t k = 0; k < 2 * nodes; k += 2)
            APP_PLOT_ROW(&plot, 9, true_q[k], true_q[k + 1], q[k], q[k + 1], true_v[k], true_v[k + 1], v[k],
                         v[k + 1]);
        app_plot_block(&plot);
    }
    for (size_t k = 0; k < nodes; k++)
        APP_PLOT_ROW(&plot, 9, s[k], e->node_error[2 * k], e->node_error[2 * k + 1]);
    app_plot_end(self, &plot);
}

/* ---- running ---- */

static void choose(const app *self, evaluation *e) {
    const lg_surrogate_run *run = &e->file.run;
    const char *part = part_names[values.part];
    e->count = e->data.curves.count;
    e->chosen = app_alloc(e->count, sizeof *e->chosen);
    for (size_t i = 0; i < e->count; i++) e->chosen[i] = (uint32_t)i;
    if (values.part == PART_ALL) return;
    if (strcmp(run->data_sha256, e->data.sha256) != 0 || run->curves != e->count)
        app_stop_usage(self, "--part %s: %s was trained on other data than %s", part, self->arguments[0],
                       self->arguments[1]);
    APP_MUST_FILE(self, self->arguments[0],
                  lg_surrogate_part(self->context, run,
                                    values.part == PART_TRAIN ? LG_PART_TRAIN : LG_PART_TEST, e->chosen,
                                    &e->count, &error));
    if (e->count == 0) app_stop_usage(self, "--part %s: the model has no curves in it", part);
}

static void warn_of_range(const app *self, const evaluation *e) {
    const bool trained = e->file.run.continuous, given = e->data.curves.continuous;
    if (e->beyond.count > 0)
        app_warn(
            self,
            "%zu of %zu curves lie outside the training range of %s (their boundary conditions are up "
            "to %.3g away from the training part, whose boundary conditions are at most %.3g apart, and up "
            "to %.3g off its family, which itself spreads by %.3g): expect large errors there",
            e->beyond.count, e->count, self->arguments[0], e->beyond.largest, e->beyond.reach, e->beyond.off,
            e->beyond.spread);
    if (trained != given)
        app_warn(self,
                 "%s was trained on %s values, but %s holds %s ones: the errors include their difference",
                 self->arguments[0], trained ? "continuous" : "discrete", self->arguments[1],
                 given ? "continuous" : "discrete");
}

static void evaluate(const app *self, evaluation *e) {
    lg_error error = {LG_OK, ""};
    const lg_elastica_curves *curves = &e->data.curves;
    const char *path = self->arguments[1];
    const double begin = app_seconds();
    e->node_error = app_alloc(2 * ((size_t)curves->intervals + 1), sizeof *e->node_error);
    e->beyond = count_outside(&e->file, curves->boundary, e->chosen, e->count);
    warn_of_range(self, e);
    const lg_status status = lg_surrogate_evaluate(self->context, &e->file.run.model, e->file.theta, curves,
                                                   e->chosen, e->count, e->node_error, &e->errors, &error);
    e->seconds = app_seconds() - begin;
    if (status != LG_OK && status != LG_SHAPE)
        app_stop(self, status, "%s: %s", path, app_sentence(status, &error));
    app_must_file(self, status, &error, path);
}

static void evaluation_destroy(evaluation *e) {
    free(e->chosen);
    free(e->node_error);
    lg_elastica_data_destroy(&e->data);
    lg_surrogate_file_destroy(&e->file);
}

static int run(app *self) {
    APP_CLEAN(evaluation_destroy) evaluation e = {.count = 0};
    const char *model = self->arguments[0], *data = self->arguments[1];
    APP_MUST_FILE(self, model, lg_surrogate_load(self->context, model, NULL, &e.file, &error));
    APP_MUST_FILE(self, data, lg_elastica_data_judge(self->context, data, &e.data, &error));
    choose(self, &e);
    evaluate(self, &e);
    if (values.plot != NULL) draw(self, &e);
    report(self, &e);
    return APP_EXIT_OK;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5",
    .summary = "Judge a network on curves",
    .details =
        "The mean squared error is over curves, nodes and components: 4(N - 1) inner ones for the discrete "
        "network, all 4(N + 1) for the others. Boundary conditions lie outside the training range if they "
        "are farther from those of the training part than twice the largest gap among these, or farther off "
        "the "
        "lines through neighbours. The command counts them.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};
