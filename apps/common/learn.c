/* Trains what a recipe says: the hooks of a task from a learner's. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/learn.h"

static train_recipe *of(void *user) {
    return user;
}

static bool given(const lg_learning *learning, const char *option) {
    return app_given(learning->user, option);
}

/* A sentence that begins with an option is about the command line. */
static bool is_usage(lg_status status, const lg_error *error) {
    return status == LG_INVALID_ARGUMENT && strncmp(error->message, "--", 2) == 0;
}

static int fail(const app *self, lg_status status, const lg_error *error) {
    return is_usage(status, error) ? app_usage(self, "%s", error->message)
                                   : app_fail(self, status, "%s", app_sentence(status, error));
}

void learn_begin(train_recipe *task, const app *self, int argument) {
    const lg_recipe *recipe = task->recipe;
    if (task->state == NULL && recipe->learner->state_size > 0)
        task->state = app_alloc(1, recipe->learner->state_size);
    task->learning = lg_learning_of(self->context, recipe, task->settings[0].values, task->state);
    task->learning.paths = self->arguments + argument;
    task->learning.path_count = (size_t)(self->argument_count - argument);
    task->learning.model = train_given_files.out;
    task->learning.threads = self->threads;
    task->learning.given = given;
    task->learning.user = self;
}

/* ---- the hooks of a task ---- */

static int read_data(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]) {
    lg_learning *learning = &of(user)->learning;
    lg_error error = {LG_OK, ""};
    learning->resumed = train_given_files.resume != NULL;
    const lg_status status = learning->recipe->learner->read(learning, &error);
    if (is_usage(status, &error)) return fail(self, status, &error);
    if (status != LG_OK)
        return app_fail_file(self, status, &error, learning->failed != NULL ? learning->failed : path);
    memcpy(sha256, learning->sha256, LG_SHA256_TEXT);
    return APP_EXIT_OK;
}

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    lg_learning *learning = &of(user)->learning;
    learning->user = self;
    learning->stored = stored;
    learning->preset = app_given(self, "preset") ? lg_preset_name(train_preset_given) : NULL;
    return learning->recipe->learner->describe(learning, error);
}

static int prepare(void *user, app *self) {
    lg_learning *learning = &of(user)->learning;
    const lg_learner *learner = learning->recipe->learner;
    lg_error error = {LG_OK, ""};
    const lg_status status = learner->prepare != NULL ? learner->prepare(learning, &error) : LG_OK;
    if (status != LG_OK) return fail(self, status, &error);
    return of(user)->check != NULL ? of(user)->check(self, learning) : APP_EXIT_OK;
}

static lg_status hold_out(void *user, app *self, double validation, lg_error *error) {
    (void)self;
    return lg_learning_hold_out(&of(user)->learning, validation, error);
}

static lg_status create(void *user, app *self, const lg_fit_options *options, lg_fit **fit, lg_error *error) {
    lg_learning *learning = &of(user)->learning;
    (void)self;
    learning->options = *options;
    const lg_status status = lg_learning_create_fit(learning, error);
    *fit = learning->fit;
    return status;
}

static void release(void *user) {
    lg_learning_release(&of(user)->learning);
}

static double objective(void *user, app *self) {
    (void)self;
    return lg_learning_objective(&of(user)->learning);
}

static size_t parameters(void *user) {
    const lg_learning *learning = &of(user)->learning;
    return learning->recipe->parameters(learning->run);
}

static bool has_width(void *user) {
    const lg_learning *learning = &of(user)->learning;
    const lg_learner *learner = learning->recipe->learner;
    return learner->has_width == NULL || learner->has_width(learning);
}

/* ---- the result ---- */

static void put_value(app_json *out, const lg_result *result) {
    if (result->type == LG_FIELD_REAL) app_result_real(out, result->name, result->real, result->label);
    if (result->type == LG_FIELD_U64) app_result_size(out, result->name, result->whole, result->label);
    if (result->type == LG_FIELD_STRING) app_result_text(out, result->name, result->text, result->label);
}

void learn_put_results(app_json *out, const lg_learning *learning, size_t first, size_t end) {
    size_t depth = 0;
    if (learning->results_lost) app_out_of_memory();
    for (size_t i = first; i < end; i++) {
        const lg_result *result = &learning->results[i];
        if (result->bracket == '[' || result->bracket == '{') {
            app_json_open(out, result->name, result->bracket);
            depth++;
        } else if (result->bracket != 0) {
            app_json_close(out, result->bracket);
            depth--;
        } else if (depth == 0 || !out->people) {
            put_value(out, result);
        }
    }
}

static void report(const train_recipe *task, const train_session *session) {
    const lg_learning *learning = &task->learning;
    app_json out;
    if (!session->app->json && task->print != NULL) {
        task->print(session, learning);
        return;
    }
    app_result_begin(&out, session->app);
    learn_put_results(&out, learning, 0, learning->first_count);
    train_json(session, &out);
    learn_put_results(&out, learning, learning->first_count, learning->result_count);
    app_json_end(&out);
}

/* The parameters of the fit are judged and written. */
static int conclude(train_recipe *task, train_session *session, double *theta) {
    lg_learning *learning = &task->learning;
    const app *self = session->app;
    const char *out = train_given_files.out;
    lg_error error = {LG_OK, ""};
    learning->seconds = session->seconds;
    lg_fit_parameters(learning->fit, theta);
    lg_status status = learning->recipe->learner->judge(learning, theta, &error);
    if (status != LG_OK)
        return app_fail(self, status, "after the last epoch: %s", app_sentence(status, &error));
    session->floor = learning->floor;
    const lg_verdict *verdict = &learning->verdict;
    const int judged = verdict->what != NULL ? train_judge(session, verdict->what, verdict->error,
                                                           verdict->guess, verdict->guessed)
                                             : APP_EXIT_OK;
    const lg_provenance provenance = app_provenance(self, lg_learning_training(learning)->seed);
    status = lg_learning_save(learning, out, theta, &provenance, &error);
    if (status == LG_CANCELLED) return app_fail(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK) return app_fail_file(self, status, &error, out);
    const int code = task->draw != NULL ? task->draw(session, learning) : train_draw(session);
    if (code != APP_EXIT_OK) return code;
    report(task, session);
    return judged == APP_EXIT_OK && verdict->failed ? APP_EXIT_NUMERIC : judged;
}

static int finish(void *user, train_session *session) {
    lg_learning *learning = &of(user)->learning;
    lg_error error = {LG_OK, ""};
    double *theta = lg_learning_alloc(learning, learning->problem.parameters, sizeof *theta, &error);
    if (theta == NULL)
        return app_fail(session->app, LG_OUT_OF_MEMORY, "after the last epoch: %s", error.message);
    return conclude(user, session, theta);
}

/* ---- commands ---- */

int learn_evaluate(train_recipe *task, const app *self, const void *file) {
    lg_learning *learning = &task->learning;
    lg_error error = {LG_OK, ""};
    learn_begin(task, self, 1);
    learning->model = self->arguments[0];
    const lg_status status = lg_learning_evaluate(learning, file, &error);
    app_must_file(self, status, &error, learning->failed != NULL ? learning->failed : learning->paths[0]);
    return learning->verdict.failed ? APP_EXIT_NUMERIC : APP_EXIT_OK;
}

static train_task task_of(train_recipe *task) {
    const lg_learner *learner = task->recipe->learner;
    return (train_task){.kind = task->recipe,
                        .settings = task->settings,
                        .training = lg_learning_training(&task->learning),
                        .method = learner->method,
                        .only = task->only,
                        .held_out = learner->held_out,
                        .kept = learner->kept,
                        .user = task,
                        .read = read_data,
                        .describe = describe,
                        .prepare = prepare,
                        .hold_out = hold_out,
                        .create = create,
                        .release = release,
                        .finish = finish,
                        .objective = objective,
                        .parameters = parameters,
                        .sizes = learner->sizes,
                        .has_width = has_width,
                        .prior = learner->prior};
}

int train_recipe_main(app *self, train_recipe *task) {
    learn_begin(task, self, 0);
    const train_task hooks = task_of(task);
    const int code = train_main(self, &hooks);
    lg_learning_close(&task->learning);
    return code;
}

int train_recipe_read(app *self, train_recipe *task) {
    char sha256[LG_SHA256_TEXT];
    learn_begin(task, self, 0);
    const train_task hooks = task_of(task);
    const int code = train_check(self, &hooks);
    return code == APP_EXIT_OK ? read_data(task, self, self->arguments[0], sha256) : code;
}

int search_recipe_main(app *self, const app_command *train, train_recipe *task) {
    learn_begin(task, self, 1);
    const train_task hooks = task_of(task);
    const int code = search_main(self, train, &hooks);
    lg_learning_close(&task->learning);
    return code;
}
