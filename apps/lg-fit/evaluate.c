/* lg-fit evaluate: the errors of a model on a table. */
#include "lg-fit/fit.h"

typedef struct evaluate_values {
    const char *plot;
} evaluate_values;

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw predicted against true values, or the table of confusion; its data and script stay "
              "next to it, as FILE.dat and FILE.gp",
              .file = LG_FILE_DRAWN),
    LG_FIELD_END};

static evaluate_values values;
static lg_table_run run_of;
static lg_table_state state;
static const app_settings settings[] = {{lg_table_fields, &run_of, 0}, APP_SETTINGS_END};

static void report(const app *self, const lg_training *training) {
    app_json out;
    if (!self->json) {
        judgement_print(&state);
        return;
    }
    app_json_begin(&out);
    train_put_results(&out, training, 0, training->result_count);
    app_json_real(&out, "seconds", training->seconds);
    app_json_warnings(&out, self);
    app_json_end(&out);
}

static int run(app *self) {
    const char *model = self->arguments[0];
    APP_CLEAN(lg_table_file_destroy) lg_table_file file = {0};
    train_task task = {.recipe = &lg_recipe_table, .settings = settings, .state = &state};
    APP_MUST_FILE(self, model, lg_table_load(self->context, model, NULL, &file, &error));
    const int code = train_evaluate(self, &task, &file);
    if (values.plot != NULL) draw_judgement(self, values.plot, &state);
    report(self, &task.training);
    lg_training_close(&task.training);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TABLE",
    .summary = "Judge a model on a table",
    .details =
        "Columns are found by their names, in any order. Rows with missing cells are left out. A row lies "
        "outside the training range if an input exceeds its range by more than a tenth of the range.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};
