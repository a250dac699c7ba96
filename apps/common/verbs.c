/* The commands train, search and evaluate, and the flow, of any kind of model. */
#include "common/verbs.h"

#include <string.h>

/* Checks the data arguments, which begin at argument number `first`. */
static const lg_recipe *check_data(const app *self, const lg_recipe *recipe, int first) {
    if (recipe == NULL) app_stop_usage(self, "--recipe NAME is missing");
    const char *data = recipe->trainer->data;
    if (self->argument_count > first + 1 && strstr(data, "...") == NULL)
        app_stop_usage(self, "%s: there are too many arguments; the recipe %s takes only %s",
                       self->arguments[first + 1], recipe->name, data);
    return recipe;
}

static train_task *task_of(const app *self) {
    return (train_task *)(uintptr_t)self->command->row;
}

void verb_train(app *self) {
    (void)check_data(self, task_of(self)->recipe, 0);
    train_main(self, task_of(self));
}

void verb_search(app *self) {
    (void)check_data(self, task_of(self)->recipe, 1);
    search_main(self, task_of(self)->command, task_of(self));
}

static const lg_recipe *recipe_of_file(const app *self, const char *path) {
    char kind[64] = "";
    APP_CLEAN(lg_model_file_destroy) lg_model_file file = {0};
    APP_FILE(self, path, lg_model_load, NULL, &file);
    if (file.recipe != NULL) return file.recipe;
    (void)lg_model_file_kind(self->context, path, NULL, kind, sizeof kind, NULL);
    app_stop(self, LG_FORMAT,
             "%s: no recipe belongs to the kind '%s', so its data are unknown and it cannot be evaluated; "
             "lg-learn list names the recipes",
             path, kind);
}

void verb_evaluate(app *self) {
    const char *path = self->arguments[0];
    train_task task = *task_of(self);
    if (task.recipe == NULL) task.recipe = recipe_of_file(self, path);
    const lg_recipe *recipe = check_data(self, task.recipe, 1);
    const app_settings settings[] = {{recipe->fields, app_keep(1, recipe->run_size), 0}, APP_SETTINGS_END};
    task.settings = settings;
    char *file = app_keep(1, recipe->file_size);
    APP_FILE(self, path, lg_recipe_load, NULL, recipe, file);
    train_begin(self, &task, 1);
    lg_training *training = &task.training;
    training->model = path;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_training_evaluate(training, file, &error);
    train_check_usage(self, status, &error);
    if (status == LG_NOT_FINITE && training->sha256[0] != '\0')
        app_must(self, status, &error); /* it was read */
    app_must_file(self, status, &error, training->failed != NULL ? training->failed : training->paths[0]);
    train_draw(self, &task);
    app_json *out = self->out;
    train_put_results(out, training, 0, training->result_count);
    APP_PUT(out, LG_AS_TEXT("recipe", recipe->name), LG_AS_REAL("seconds", training->seconds));
    app_result_end(self);
    if (!self->json && task.print != NULL) task.print(training);
    if (training->verdict.failed) self->code = APP_EXIT_NUMERIC;
    lg_training_close(training);
    lg_recipe_release(recipe, file);
}

flow_values flow_given;

/* --tolerance must be the fourth: FLOW_TOLERANCE begins there. */
const lg_field flow_options[] = {
    LG_OPTION(flow_values, initial, REALS, "X,X,...", "The start, in the layout of the model's state",
              LG_ANY_REAL),
    APP_T_END(flow_values, "Time of the last point (default: the scene's t_end, or 1)"),
    APP_POINTS(flow_values, "Equidistant points of the trajectory, the start included", .value = "101"),
    APP_TOLERANCE(flow_values, "Tolerance of the adaptive integration of the learned flow", .high = 1e-2,
                  .otherwise = "1e-10; 1e-13 for linear potentials"),
    LG_FIELD_END};

lg_status app_flow(const lg_context *context, const lg_model *learned, const lg_scheme *scheme,
                   double tolerance, size_t most, const double *start, const double *times, size_t count,
                   double *out, lg_run_stats *stats) {
    APP_FREE void *work = app_alloc(lg_model_work_size(learned), 1);
    lg_model_user user;
    lg_ode ode;
    lg_step_controller control;
    lg_stepper *stepper = NULL;
    lg_step_controller_init(&control);
    control.rtol = tolerance;
    control.atol = -tolerance;
    if (most > 0) control.max_steps = most;
    LG_TRY(lg_model_ode(learned, &ode, &user, work));
    LG_TRY(lg_stepper_create(context, scheme, &ode, &stepper));
    const lg_status status =
        lg_integrate_adaptive(stepper, &control, times[0], start, times, count, out, stats);
    lg_stepper_destroy(stepper);
    return status;
}
