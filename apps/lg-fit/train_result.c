/* lg-fit train: what is told of the result, and written. */
#include <math.h>
#include <stdlib.h>

#include "lg-fit/train.h"

/* Least and largest value of each input in the training rows, without cells far from all others. */
static void find_ranges(const training *state, double *low, double *high) {
    for (uint32_t c = 0; c < state->inputs.count; c++) {
        low[c] = INFINITY, high[c] = -INFINITY;
        for (size_t i = 0; i < state->trained; i++) {
            const double value = table_row(&state->table, state->order[i])[c];
            if (lg_table_is_far(&state->far[c], value)) continue;
            low[c] = fmin(low[c], value);
            high[c] = fmax(high[c], value);
        }
    }
}

/* The model as a file; borrows from the state, but for theta, low and high. Its rows are those that were
 * learned. */
static lg_table_file file_of(const training *state, const app *self) {
    lg_table_file file = {.run = *state->run,
                          .inputs = state->input_scaler,
                          .outputs = state->output_scaler,
                          .input_name = state->inputs.name,
                          .output_name = state->outputs.name,
                          .rmse = (double)NAN,
                          .accuracy = (double)NAN,
                          .f1 = (double)NAN};
    file.run.rows = state->trained;
    file.parameters = lg_table_parameters(&state->run->model);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    lg_fit_parameters(state->fit, file.theta);
    file.low = app_alloc(state->inputs.count, sizeof *file.low);
    file.high = app_alloc(state->inputs.count, sizeof *file.high);
    find_ranges(state, file.low, file.high);
    if (!is_regression(state))
        (void)snprintf(file.class_column, sizeof file.class_column, "%s", state->class_name);
    file.provenance = app_provenance(self, state->run->training.seed);
    return file;
}

typedef struct verdict {
    judgement trained, judged;
    const char *part; /* "validation", "test" or "training" */
} verdict;

static lg_status judge(const training *state, const app *self, const lg_table_file *file, verdict *v,
                       lg_error *error) {
    const size_t held = state->table.data.rows - state->trained;
    lg_status status =
        judge_rows(self, file, &state->table, state->order, state->trained, &v->trained, error);
    if (status != LG_OK) return status;
    v->part = state->given->test != NULL ? "test" : held > 0 ? "validation" : "training";
    if (state->given->test != NULL) return judge_rows(self, file, &state->test, NULL, 0, &v->judged, error);
    return judge_rows(self, file, &state->table, state->order + (held > 0 ? state->trained : 0),
                      held > 0 ? held : state->trained, &v->judged, error);
}

/* Standard deviation of the noise in units of the outputs' deviation, from what the last fit leaves. */
static double noise_of(const training *state, const verdict *v) {
    const double numbers = (double)state->trained * state->outputs.count;
    return v->trained.scaled_rmse * sqrt(numbers / fmax(numbers - state->evidence.effective, 0.02 * numbers));
}

/* null where no evidence was sought. */
static void put_evidence(app_json *json, const training *state, const verdict *v) {
    const lg_table_evidence_result *found = &state->evidence;
    const bool sought = found->evaluations > 0;
    app_json_size(json, "evidence_evaluations", found->evaluations);
    app_json_real(json, "effective_parameters", sought ? found->effective : (double)NAN);
    app_json_real(json, "log_evidence", sought ? found->evidence : (double)NAN);
    app_json_real(json, "noise", sought ? noise_of(state, v) : (double)NAN);
}

static void report_json(const training *state, const train_session *session, const lg_table_file *file,
                        const verdict *v) {
    app_json json;
    app_json_begin(&json);
    judgement_json(&json, file, &v->judged);
    app_json_text(&json, "part", v->part);
    app_json_real(&json, "train_scaled_rmse", v->trained.scaled_rmse);
    app_json_real(&json, "train_accuracy", v->trained.accuracy);
    app_json_text(&json, "task", lg_table_task_name(state->run->model.options.task));
    app_json_size(&json, "parameters", file->parameters);
    app_json_size(&json, "rows", state->table.data.rows);
    app_json_size(&json, "rows_left_out", state->table.left_out);
    app_json_size(&json, "train_rows", state->trained);
    app_json_size(&json, "inputs", state->inputs.count);
    app_json_size(&json, "outputs", state->outputs.count);
    put_evidence(&json, state, v);
    train_json(session, &json);
    app_json_end(&json);
}

static void report(const training *state, const train_session *session, const lg_table_file *file,
                   const verdict *v) {
    if (session->app->json) {
        report_json(state, session, file, v);
        return;
    }
    (void)printf("%s: %s of %zu of %zu rows, %u inputs, %s network, %zu parameters\n", train_given_files.out,
                 lg_table_task_name(state->run->model.options.task), state->trained, state->table.data.rows,
                 state->inputs.count, lg_net_kind_name(state->run->model.options.network), file->parameters);
    if (state->evidence.evaluations > 0)
        (void)printf("the data determine %.1f parameters; noise about %.3g of the outputs' deviation\n",
                     state->evidence.effective, noise_of(state, v));
    (void)printf("%s rows (%zu%s):\n", v->part, v->judged.rows,
                 state->given->test == NULL && state->trained < state->table.data.rows ? ", not learned"
                                                                                       : "");
    judgement_print(file, &v->judged);
}

/* What a simple guess would have: the mean, or the most frequent class. */
static double guessed(const training *state, const verdict *v) {
    if (is_regression(state)) return 1.0;
    const uint32_t classes = state->outputs.count;
    uint64_t most = 0;
    for (uint32_t c = 0; c < classes; c++) {
        uint64_t members = 0;
        for (uint32_t k = 0; k < classes; k++) members += v->trained.confusion[c * classes + k];
        if (members > most) most = members;
    }
    return 1.0 - (double)most / (double)v->trained.rows;
}

/* A fit that starts from the evidence's parameters has nothing left to lower. */
static int judge_training(const training *state, const train_session *session, const verdict *v) {
    static const double LEARNED = 0.99;
    const bool regression = is_regression(state);
    const char *what = regression ? "mean squared error" : "share of wrong rows",
               *simple = regression ? "the mean" : "the most frequent class";
    const double wrong =
        regression ? v->trained.scaled_rmse * v->trained.scaled_rmse : 1.0 - v->trained.accuracy;
    const double guess = guessed(state, v);
    if (state->evidence.evaluations == 0) return train_judge(session, what, wrong, simple, guess);
    if (!(wrong < LEARNED * guess))
        app_warn(session->app,
                 "the model has learned nothing: its %s %.3g is not below %.3g, that of %s; the inputs say "
                 "nothing of the outputs, or there are too few rows",
                 what, wrong, guess, simple);
    return APP_EXIT_OK;
}

/* The model is judged, which goes into the file. */
static int judge_model(const training *state, const train_session *session, lg_table_file *file, verdict *v) {
    const app *self = session->app;
    const char *test = state->given->test;
    lg_error error = {LG_OK, ""};
    const lg_status status = judge(state, self, file, v, &error);
    if (status != LG_OK) return app_fail(self, status, "after training: %s", app_sentence(status, &error));
    warn_duplicates(self, state);
    if (v->judged.rows < 2)
        app_warn(self,
                 "the %s part has one row, which cannot say how good the model is; --test TABLE judges "
                 "it on others",
                 v->part);
    if (test != NULL) {
        warn_outside(self, v->judged.outside, v->judged.rows, test, train_given_files.out);
        warn_far_outputs(self, file, &state->test);
    }
    file->rmse = isfinite(v->judged.scaled_rmse) ? v->judged.scaled_rmse : (double)NAN;
    file->accuracy = v->judged.accuracy;
    file->f1 = v->judged.f1;
    return APP_EXIT_OK;
}

static int write_model(const training *state, const app *self, const lg_table_file *file, const verdict *v) {
    const train_files *files = &train_given_files;
    lg_error error = {LG_OK, ""};
    lg_status status = lg_model_save_table(self->context, files->out, file, state->fit, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, files->out);
    if (files->plot == NULL) return APP_EXIT_OK;
    status = draw_judgement(self, files->plot, file, &v->judged, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, files->plot);
}

int finish_training(void *user, train_session *session) {
    const training *state = user;
    verdict v = {.part = NULL};
    lg_table_file file = file_of(state, session->app);
    int learned = APP_EXIT_OK, code = judge_model(state, session, &file, &v);
    if (code == APP_EXIT_OK) {
        const char *path = state->given->test != NULL ? state->given->test : state->table.path;
        learned = judge_training(state, session, &v);
        const int finite = warn_judgement(session->app, &file, &v.judged, path);
        if (learned == APP_EXIT_OK) learned = finite;
        code = write_model(state, session->app, &file, &v);
    }
    if (code == APP_EXIT_OK) report(state, session, &file, &v);
    judgement_free(&v.trained);
    judgement_free(&v.judged);
    free(file.theta);
    free(file.low);
    free(file.high);
    return code == APP_EXIT_OK ? learned : code;
}
