/* Reads a model and the logs that a command runs it on. */
#include <math.h>

#include "lg-identify/identify.h"

void identify_read(const app *self, const lg_machine_sources *from, lg_machine_data *out) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_machine_data_read(self->context, from, out, &error);
    app_must_file(self, status, &error, out->failed);
}

void identify_load(app *self, uint64_t substeps, uint64_t start_rows, identify_given *out) {
    const char *path = self->arguments[0];
    const lg_machine_model_run *run = &out->file.run;
    APP_MUST_FILE(self, path,
                  lg_recipe_load(self->context, path, NULL, &lg_recipe_machine_model, &out->file, &error));
    const lg_machine_sources from = {.machine = path,
                                     .text = run->text,
                                     .logs = self->arguments + 1,
                                     .count = (size_t)self->argument_count - 1,
                                     .delay = run->estimated};
    identify_read(self, &from, &out->data);
    APP_MUST(self, lg_machine_refuse_momenta(&out->data.file, path, &error));
    const bool estimated =
        out->data.file.measured == LG_MEASURED_POSITIONS || out->data.file.machine.accelerations;
    if (start_rows > 0 && !estimated)
        app_stop(self, LG_INVALID_ARGUMENT,
                 "--start-rows %llu: no start is estimated, because the logs have positions and velocities: "
                 "leave the option out",
                 (unsigned long long)start_rows);
    if (start_rows > 0) out->file.run.start_rows = (uint32_t)start_rows;
    out->model = lg_model_learned(self->context, run, out->file.theta, estimated);
    if (substeps > 0) out->model.substeps = (uint32_t)substeps;
}

void identify_put_start_rows(app_json *json, const lg_learned_machine *model) {
    app_result_known(json, "start_rows", model->start_rows > 0 ? model->start_rows : (double)NAN,
                     "rows that estimate the state at a start");
}

void identify_given_destroy(identify_given *given) {
    lg_machine_data_destroy(&given->data);
    lg_recipe_release(&lg_recipe_machine_model, &given->file);
}
