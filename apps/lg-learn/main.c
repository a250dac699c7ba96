/* lg-learn: models of any recipe. Only the table of recipes knows which recipes exist. */
#include <math.h>
#include <string.h>

#include "common/verbs.h"
#include "files/csv.h"
#include "nn/search.h"

/* ---- the recipe and its options ---- */

/* Name of recipe number `value`; NULL beyond the last one. */
static const char *recipe_name(uint32_t value) {
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++)
        if (value-- == 0) return (*recipe)->name;
    return NULL;
}

static uint32_t recipe_given;
static const lg_field recipe_rows[] = {{.name = "recipe",
                                        .type = LG_FIELD_NAME,
                                        .size = sizeof recipe_given,
                                        .value_name = recipe_name,
                                        .usual = true,
                                        .meaning = "The kind of model; the options of this kind follow"},
                                       LG_FIELD_END};

enum { SETTINGS = 8 };
static app_settings train_settings[SETTINGS], search_settings[SETTINGS];
static const app_command train_command;
static train_task task, any_kind;

static void add(app_settings *settings, const lg_field *rows, void *values, size_t size) {
    while (settings->rows != NULL) settings++;
    if (rows != NULL) *settings = (app_settings){rows, values, size};
}

/* Finds the recipe that the last --recipe names, which may be abbreviated. It must be known before the other
 * options are parsed, because it determines which options exist. */
static const lg_recipe *find_recipe(int argc, char **argv) {
    const lg_recipe *found = NULL;
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++) {
        const size_t length = strcspn(argv[i], "=");
        if (length <= strlen("--") || strncmp(argv[i], "--recipe", length) != 0) continue;
        found = lg_recipe_find(argv[i][length] == '=' ? argv[i] + length + 1
                               : i + 1 < argc         ? argv[i + 1]
                                                      : "");
    }
    return found;
}

static void choose_recipe(const lg_recipe *chosen) {
    task = (train_task){.recipe = chosen, .settings = train_settings, .command = &train_command};
    if (chosen != NULL) {
        const lg_trainer *trainer = chosen->trainer;
        task.state = app_alloc(1, trainer->state_size + 1);
        add(train_settings, chosen->fields, app_alloc(1, chosen->run_size), chosen->run_size);
        if (trainer->presets)
            add(train_settings, train_preset_rows, &train_preset_given, sizeof train_preset_given);
        add(train_settings, trainer->options, task.state, 0);
        add(search_settings, trainer->options, task.state, 0);
    }
    const bool sizes = chosen != NULL && chosen->trainer->sizes != NULL;
    add(train_settings, recipe_rows, &recipe_given, 0);
    add(train_settings, sizes ? train_file_options : train_file_options + 1, &train_given_files, 0);
    add(search_settings, recipe_rows, &recipe_given, 0);
    add(search_settings, search_options, &search_given, 0);
}

static const app_command train_command = {
    TRAIN_COMMAND("DATA...", task, train_plots), .summary = "Learn a model from data",
    .details = "With --recipe NAME the options of this kind of model are listed above. The command search "
               "draws values of the same options.\n\n" TRAIN_STOPS,
    .settings = train_settings};

/* ---- predict ---- */

static const lg_field predict_options[] = {
    APP_OUT(app_common, "FILE.csv", "Write the trajectory: the time, then the state", .file = LG_FILE_TEXT),
    LG_FIELD_END};

/* Projects the start onto the manifold. Numbers typed by hand are off by rounding; a start that is off by
 * more than 1e-6 is refused. */
static void project(const app *self, const lg_space *space, double *state, size_t dim) {
    double distance = 0;
    APP_FREE double *given = app_alloc(dim, sizeof *given);
    memcpy(given, state, dim * sizeof *given);
    lg_space_project(space, state);
    for (size_t i = 0; i < dim; i++) distance = fmax(distance, fabs(state[i] - given[i]));
    if (!(distance <= 1e-6))
        app_stop_usage(self, "--initial: the start is off the manifold by %g, more than the allowed 1e-6",
                       distance);
    if (distance > 1e-14) app_warn(self, "the start was off the manifold by %g and is projected", distance);
}

static void write_trajectory(const app *self, const double *t, const double *y, size_t points, size_t dim) {
    lg_columns to = {.text = app_text()};
    if (app_common_given.out == NULL) return;
    lg_columns_name(&to, "t");
    for (size_t i = 0; i < dim; i++) {
        APP_FREE char *name = app_format("y%zu", i + 1);
        lg_columns_name(&to, name);
    }
    lg_columns_end(&to);
    for (size_t k = 0; k < points; k++) {
        lg_columns_number(&to, t[k]);
        lg_columns_numbers(&to, y + k * dim, dim);
        lg_columns_end(&to);
    }
    APP_MUST_FILE(self, app_common_given.out,
                  lg_columns_write(&to, self->context, app_common_given.out, &error));
}

static void follow(const app *self, const lg_model *model, double *start, app_json *out) {
    const size_t points = (size_t)flow_given.points, dim = lg_model_inputs(model);
    const double t_end = flow_given.t_end > 0 ? flow_given.t_end : 1,
                 tolerance = flow_given.tolerance > 0 ? flow_given.tolerance : 1e-10;
    lg_run_stats stats = {0};
    APP_FREE double *t = app_alloc(points, sizeof *t), *y = app_alloc(points * dim, sizeof *y);
    for (size_t k = 0; k < points; k++) t[k] = t_end * (double)k / (double)(points - 1);
    project(self, lg_model_space(model), start, dim);
    app_must(
        self,
        app_flow(self->context, model, lg_scheme_find("rkmk54"), tolerance, 0, start, t, points, y, &stats),
        NULL);
    write_trajectory(self, t, y, points, dim);
    APP_PUT(out, LG_REAL("t", t_end, NULL), LG_REALS("y", y + (points - 1) * dim, dim, "the state"),
            LG_WHOLE("steps", stats.steps, NULL));
}

/* Prints the first output of a function of --initial alone, if the program has it. `label`: NULL for the
 * output's name. */
static void calculate(const app *self, const lg_program *program, const char *name, const char *label) {
    const double *x = flow_given.initial.values;
    size_t function, count;
    if (lg_program_find(program, name, &function, NULL) != LG_OK) return;
    const lg_port *port = lg_program_inputs(program, function, &count);
    if (count != 1 || lg_shape_count(port->shape) != flow_given.initial.count) return;
    port = lg_program_outputs(program, function, &count);
    const size_t numbers = lg_shape_count(port->shape);
    APP_FREE double **y = app_alloc(count, sizeof *y);
    APP_FREE double *first = y[0] = app_alloc(numbers, sizeof *first);
    APP_DO(self, lg_program_eval, program, name, 1, &x, y);
    app_json_put(self->out, LG_REALS(name, first, numbers, label != NULL ? label : port->name));
}

/* Refuses options of a flow, which a model that does not move would ignore. */
static void refuse_flow(const app *self) {
    static const char *const of_flow[] = {"t-end", "points", "tolerance", "out"};
    for (size_t i = 0; i < LG_COUNT(of_flow); i++)
        if (app_given(self, of_flow[i]))
            app_stop_usage(self, "--%s: is for models with a flow (a space and a field), and %s has none",
                           of_flow[i], self->arguments[0]);
}

static void run_predict(app *self) {
    const char *path = self->arguments[0];
    APP_CLEAN(lg_model_file_destroy) lg_model_file file = {0};
    APP_FILE(self, path, lg_model_load, NULL, &file);
    if (flow_given.initial.count != lg_model_inputs(file.model))
        app_stop_usage(self, "--initial: %zu numbers are given, but the model takes %zu",
                       flow_given.initial.count, lg_model_inputs(file.model));
    if (lg_model_space(file.model) == NULL) refuse_flow(self);
    double *x = flow_given.initial.values;
    if (file.recipe != NULL && file.recipe->trainer->inspect != NULL)
        APP_DO(self, file.recipe->trainer->inspect, file.contents, x);
    const lg_program *program = lg_model_program(file.model);
    size_t chances;
    const bool logits = lg_program_find(program, "probability", &chances, NULL) == LG_OK;
    const bool energy = file.recipe != NULL && lg_model_space(file.model) != NULL;
    calculate(self, program, "value", logits ? "logits" : energy ? "energy" : NULL);
    calculate(self, program, "probability", "of the classes");
    calculate(self, program, "velocities", "of the start, which has momenta; no input acts");
    if (lg_model_space(file.model) != NULL) follow(self, file.model, x, self->out);
}

/* ---- list ---- */

static void run_list(app *self) {
    app_json *out = self->out;
    app_result_rows(out, "recipes");
    for (uint32_t i = 0; recipe_name(i) != NULL; i++) {
        const lg_recipe *found = lg_recipe_find(recipe_name(i));
        const lg_field *fields = found->fields;
        uint64_t count = 0;
        while (fields[count].name != NULL) count++;
        APP_OBJECT(out, NULL, LG_AS_TEXT("name", found->name), LG_AS_TEXT("data", found->trainer->data),
                   LG_AS_WHOLE("options", count));
    }
    app_result_rows_end(out);
}

APP_PROGRAM(lg_learn) {
    choose_recipe(find_recipe(argc, argv));
    const app_command commands[] = {
        train_command,
        {SEARCH_COMMAND("DATA..."), VERB(search, task), .settings = search_settings},
        {.name = "evaluate",
         .arguments = "MODEL.h5 DATA...",
         .summary = "Evaluate a model on data",
         VERB(evaluate, any_kind)},
        {.name = "predict",
         .arguments = "MODEL.h5",
         .summary = "Value of a model, and its trajectory if it has a flow",
         .details = "A model without a flow takes its inputs as --initial. The state of a machine has "
                    "momenta, and no input acts on it; `lg-identify predict` takes positions, velocities and "
                    "inputs of a log.",
         .settings = APP_SETTINGS(FLOW, APP_GIVEN(predict_options, app_common_given)),
         .run = run_predict},
        {.name = "list", .summary = "List the recipes", .run = run_list},
        {.run = NULL}};
    return app_main(
        argc, argv, "lg-learn",
        "Trains, searches, evaluates and predicts models of any recipe. A new recipe needs no new program.",
        commands);
}
