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

static void report(const app *self, const fitted_table *given, const judgement *j, double seconds) {
    app_json out;
    app_result_begin(&out, self);
    judgement_json(&out, &given->file, j);
    app_json_text(&out, "task", lg_table_task_name(given->file.run.model.options.task));
    app_json_size(&out, "rows_left_out", given->table.left_out);
    app_json_real(&out, "seconds", seconds);
    app_json_warnings(&out, self);
    app_json_end(&out);
    if (!self->json) judgement_print(&given->file, j);
}

static int run(app *self) {
    const char *model = self->arguments[0], *path = self->arguments[1];
    APP_CLEAN(fitted_table_destroy) fitted_table given = {0};
    APP_CLEAN(judgement_free) judgement j = {0};
    read_fitted_table(self, true, &given);
    const double begin = app_seconds();
    APP_MUST_FILE(self, model, judge_rows(self, &given.file, &given.table, NULL, 0, &j, &error));
    const double seconds = app_seconds() - begin;
    warn_outside(self, j.outside, j.rows, path, model);
    const int code = warn_judgement(self, &given.file, &j, path);
    warn_far_outputs(self, &given.file, &given.table);
    if (values.plot != NULL)
        APP_MUST_FILE(self, values.plot, draw_judgement(self, values.plot, &given.file, &j, &error));
    report(self, &given, &j, seconds);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TABLE",
    .summary = "Judge a model on a table",
    .details =
        "Columns are found by their names, in any order. Rows with missing cells are left out. A row is "
        "outside of the training range where an input is beyond it by more than a tenth of it.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};
