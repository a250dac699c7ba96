/* lg-elastica evaluate: the errors of a model over curves. */
#include <math.h>
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
              "Draw ten curves, true and learned, with their tangents and the mean error along the beam"),
    LG_FIELD_END};

static evaluate_values values;

/* Indices of the curves of one part, rising. */
typedef struct part_indices {
    uint32_t *list;
    size_t count;
} part_indices;

typedef struct evaluation {
    const lg_surrogate_file *file;
    const lg_elastica_curves *curves;
    part_indices chosen;
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
    if (!self->json) {
        (void)printf("%zu curves (%s) of %s\n", e->chosen.count, part_names[values.part], self->arguments[1]);
        for (size_t i = 0; i < LG_COUNT(rows); i++)
            (void)printf("%-18s  %.4e  %s\n", rows[i].key, rows[i].value, rows[i].meaning);
        return;
    }
    app_json json;
    app_json_begin(&json);
    for (size_t i = 0; i < LG_COUNT(rows); i++) app_json_real(&json, rows[i].key, rows[i].value);
    app_json_size(&json, "curves", e->chosen.count);
    app_json_text(&json, "part", part_names[values.part]);
    app_json_size(&json, "outside", e->beyond.count);
    app_json_real(&json, "reach", e->beyond.reach);
    app_json_real(&json, "largest_distance", e->beyond.largest);
    app_json_text(&json, "network", lg_surrogate_kind_name(e->file->run.model.options.kind));
    app_json_real(&json, "seconds", e->seconds);
    app_json_end(&json);
}

/* ---- the picture ---- */

static lg_status draw(const app *self, const evaluation *e, lg_error *error) {
    const lg_surrogate *model = &e->file->run.model;
    const size_t nodes = (size_t)e->curves->intervals + 1,
                 shown = e->chosen.count < SHOWN ? e->chosen.count : (size_t)SHOWN;
    double *memory = app_alloc(8 * shown * nodes + nodes, sizeof *memory);
    double *const true_q = memory, *const true_v = true_q + 2 * shown * nodes,
                  *const q = true_v + 2 * shown * nodes, *const v = q + 2 * shown * nodes,
                  *const s = v + 2 * shown * nodes;
    lg_surrogate_curves *curves = NULL;
    char title[128];
    lg_status status =
        lg_surrogate_curves_create(self->context, model, e->file->theta, LG_F64, nodes, &curves, error);
    void *work = status == LG_OK ? app_alloc(lg_surrogate_curves_work_size(curves), 1) : NULL;
    for (size_t k = 0; k < nodes; k++)
        s[k] = k + 1 < nodes ? e->curves->length * ((double)k / (double)(nodes - 1)) : e->curves->length;
    for (size_t i = 0; i < shown && status == LG_OK; i++) {
        const size_t curve = e->chosen.list[(2 * i + 1) * e->chosen.count / (2 * shown)];
        memcpy(true_q + 2 * nodes * i, e->curves->q + 2 * nodes * curve, 2 * nodes * sizeof *q);
        memcpy(true_v + 2 * nodes * i, e->curves->v + 2 * nodes * curve, 2 * nodes * sizeof *v);
        lg_surrogate_curve(curves, e->curves->boundary + 8 * curve, s, nodes, q + 2 * nodes * i,
                           v + 2 * nodes * i, work);
    }
    (void)snprintf(title, sizeof title, "%s network, %zu of %zu curves, mean squared error %.3e",
                   lg_surrogate_kind_name(model->options.kind), shown, e->chosen.count, e->errors.mse);
    const comparison what = {.shown = shown,
                             .intervals = e->curves->intervals,
                             .length = e->curves->length,
                             .true_q = true_q,
                             .true_v = true_v,
                             .q = q,
                             .v = v,
                             .node_error = e->node_error,
                             .title = title};
    if (status == LG_OK) status = draw_comparison(self, values.plot, &what, error);
    lg_surrogate_curves_destroy(curves);
    free(work);
    free(memory);
    return status;
}

/* ---- running ---- */

static int choose(const app *self, const lg_surrogate_run *run, const lg_elastica_data *data,
                  part_indices *chosen) {
    lg_error error = {LG_OK, ""};
    *chosen = (part_indices){app_alloc(data->curves.count, sizeof *chosen->list), data->curves.count};
    if (values.part == PART_ALL) {
        for (size_t i = 0; i < chosen->count; i++) chosen->list[i] = (uint32_t)i;
        return APP_EXIT_OK;
    }
    if (strcmp(run->data_sha256, data->sha256) != 0 || run->curves != data->curves.count)
        return app_usage(self, "--part %s: %s was trained on other data than %s", part_names[values.part],
                         self->arguments[0], self->arguments[1]);
    const lg_status status =
        lg_surrogate_part(self->context, run, values.part == PART_TRAIN ? LG_PART_TRAIN : LG_PART_TEST,
                          chosen->list, &chosen->count, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    if (chosen->count > 0) return APP_EXIT_OK;
    return app_usage(self, "--part %s: the model has no curves in it", part_names[values.part]);
}

static void warn_of_range(const app *self, const evaluation *e) {
    if (e->beyond.count > 0)
        app_warn(self,
                 "%zu of %zu curves lie outside the training range of %s (boundary conditions up to %.3g "
                 "away; those of the training part are at most %.3g apart): expect large errors there",
                 e->beyond.count, e->chosen.count, self->arguments[0], e->beyond.largest, e->beyond.reach);
    if (e->file->run.continuous != e->curves->continuous)
        app_warn(self,
                 "%s was trained on %s values, but %s holds %s ones: the errors include their "
                 "difference",
                 self->arguments[0], e->file->run.continuous ? "continuous" : "discrete", self->arguments[1],
                 e->curves->continuous ? "continuous" : "discrete");
}

static int evaluate(const app *self, evaluation *e) {
    lg_error error = {LG_OK, ""};
    const lg_surrogate_file *file = e->file;
    const double begin = app_seconds();
    e->node_error = app_alloc(2 * ((size_t)e->curves->intervals + 1), sizeof *e->node_error);
    e->beyond = count_outside(&file->run.model, file->trained, file->trained_count, e->curves->boundary,
                              e->chosen.list, e->chosen.count);
    warn_of_range(self, e);
    lg_status status =
        lg_surrogate_evaluate(self->context, &file->run.model, file->theta, e->curves, e->chosen.list,
                              e->chosen.count, e->node_error, &e->errors, &error);
    e->seconds = app_seconds() - begin;
    if (status == LG_SHAPE) return app_fail_file(self, status, &error, self->arguments[1]);
    if (status != LG_OK)
        return app_fail(self, status, "%s: %s", self->arguments[1],
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    if (values.plot != NULL) status = draw(self, e, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.plot);
    report(self, e);
    return APP_EXIT_OK;
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_surrogate_file file;
    lg_elastica_data data;
    const app_path plot = {"plot", values.plot, LG_FILE_DRAWN};
    int code = app_check_outputs(self, &plot, 1);
    if (code != APP_EXIT_OK) return code;
    lg_status status = lg_model_load_surrogate(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    status = lg_elastica_data_judge(self->context, self->arguments[1], &data, &error);
    if (status != LG_OK) code = app_fail_file(self, status, &error, self->arguments[1]);
    if (code == APP_EXIT_OK) {
        evaluation e = {.file = &file, .curves = &data.curves};
        code = choose(self, &file.run, &data, &e.chosen);
        if (code == APP_EXIT_OK) code = evaluate(self, &e);
        free(e.chosen.list);
        free(e.node_error);
        lg_elastica_data_destroy(&data);
    }
    lg_surrogate_file_destroy(&file);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5",
    .summary = "Judge a network on curves",
    .details =
        "The mean squared error is over curves, nodes and components: 4(N - 1) inner ones for the discrete "
        "network, all 4(N + 1) for the others. Boundary conditions lie outside the training range if they "
        "are farther from those of the training part than twice the largest gap among these. The command "
        "counts them.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};
