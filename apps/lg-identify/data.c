/* Machines and logs of a command. */
#include "lg-identify/runs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_LOGS = 4096 }; /* those for validation included */

/* Cuts a list at its commas, in place. */
static size_t cut(char *text, const char **paths, size_t room) {
    size_t count = 0;
    for (char *at = strtok(text, ","); at != NULL && count < room; at = strtok(NULL, ","))
        paths[count++] = at;
    return count;
}

static void tell_warnings(const app *self, const lg_logs *logs) {
    for (uint32_t i = 0; i < logs->warning_count; i++) app_warn(self, "%s", logs->warnings[i]);
}

/* The parts of the first `files` files come first. */
static void split(identify_data *data, size_t files) {
    const lg_logs *logs = &data->logs;
    size_t parts = 0;
    while (parts < logs->log.parts && logs->part_file[parts] < files) parts++;
    data->training_parts = parts;
    data->training = logs->log;
    data->training.parts = parts;
    data->training.rows = logs->log.first[parts];
}

/* The file that the sentence names, or the first one. */
static const char *named_of(const char *const *paths, size_t count, const char *sentence) {
    size_t i = 0;
    while (i < count && strstr(sentence, paths[i]) == NULL) i++;
    return paths[i < count ? i : 0];
}

static int read_logs(app *self, const char *const *paths, size_t count, size_t training, int64_t delay,
                     identify_data *out) {
    lg_error error = {LG_OK, ""};
    lg_log_options options;
    lg_log_options_init(&options);
    options.delay = delay;
    const lg_status status =
        lg_logs_read(self->context, &out->file, paths, count, &options, &out->logs, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, named_of(paths, count, error.message));
    split(out, training);
    return APP_EXIT_OK;
}

/* ---- delay ---- */

/* Reads the logs with delays of 0 to 8 rows, and again with that of the least error. */
static int estimate_delay(app *self, const char *const *paths, size_t count, size_t training,
                          identify_data *out) {
    enum { MOST = 8 };
    double least = (double)INFINITY;
    int64_t best = 0;
    for (int64_t delay = 0; delay <= MOST; delay++) {
        lg_logs_destroy(&out->logs);
        const int code = read_logs(self, paths, count, training, delay, out);
        if (code != APP_EXIT_OK) return code;
        const double error = identify_unexplained(&out->file.machine, &out->training);
        if (!(error < least)) continue;
        least = error;
        best = delay;
    }
    lg_logs_destroy(&out->logs);
    app_warn(self, "the inputs act %lld rows after they are logged, as far as a quadratic model can tell",
             (long long)best);
    return read_logs(self, paths, count, training, best, out);
}

int identify_read(app *self, const char *machine, const char *const *paths, size_t count, const char *more,
                  identify_data *out) {
    lg_error error = {LG_OK, ""};
    const char *all[MOST_LOGS];
    *out = (identify_data){.training_parts = 0};
    const lg_status status = lg_machine_file_read(self->context, machine, &out->file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, machine);
    APP_FREE char *list = more != NULL ? app_format("%s", more) : NULL;
    memcpy(all, paths, count * sizeof *paths);
    const size_t total = count + (list != NULL ? cut(list, all + count, MOST_LOGS - count) : 0);
    const int code = out->file.estimate_delay ? estimate_delay(self, all, total, count, out)
                                              : read_logs(self, all, total, count, -1, out);
    if (code == APP_EXIT_OK) tell_warnings(self, &out->logs);
    return code;
}

void identify_load(app *self, uint64_t substeps, identify_given *out) {
    const char *path = self->arguments[0];
    const size_t logs = (size_t)self->argument_count - 1;
    const lg_machine_model_run *run = &out->file.run;
    identify_data *data = &out->data;
    APP_MUST_FILE(self, path, lg_model_load_machine_model(self->context, path, NULL, &out->file, &error));
    APP_MUST_FILE(
        self, path,
        lg_machine_file_parse(self->context, path, run->text, strlen(run->text), &data->file, &error));
    int code = read_logs(self, self->arguments + 1, logs, logs, run->delay, data);
    if (code == APP_EXIT_OK) tell_warnings(self, &data->logs);
    if (code == APP_EXIT_OK) code = identify_refuse_momenta(self, &data->file, path);
    if (code != APP_EXIT_OK) app_end(code);
    out->model = (identify_model){&run->machine, out->file.theta, run->scheme,
                                  substeps > 0 ? (uint32_t)substeps : run->substeps,
                                  data->file.measured == LG_MEASURED_POSITIONS};
}

void identify_given_destroy(identify_given *given) {
    identify_release(&given->data);
    lg_machine_model_file_destroy(&given->file);
}

void identify_release(identify_data *data) {
    lg_logs_destroy(&data->logs);
    lg_machine_file_destroy(&data->file);
}

/* ---- noise ---- */

/* The largest noise of columns first .. first + count - 1, where it is more than `least` of their range or
 * `confirmed`. */
static double noise_of(const identify_data *data, uint32_t first, uint32_t count, bool confirmed,
                       double least) {
    double range = 0.0, estimated = 0.0, given = 0.0;
    for (uint32_t c = first; c < first + count; c++) {
        const lg_log_statistics *found = &data->logs.columns[c];
        range = fmax(range, found->high - found->low);
        if (!found->noise_at_most) estimated = fmax(estimated, found->noise);
        given = fmax(given, data->file.columns[c].noise);
    }
    return given > 0.0 ? given : confirmed || estimated > least * range ? estimated : 0.0;
}

/* Whether the noise that the position's column shows is there in its motion beside the velocity, too. */
static bool is_confirmed(const identify_data *data, uint32_t coordinate) {
    const lg_log_statistics *found = &data->logs.columns[data->file.coordinates[coordinate].place];
    return !found->noise_at_most && found->noise > 0.0 &&
           identify_position_noise(data, coordinate) > 0.5 * found->noise;
}

static void find_noise(const identify_data *data, uint32_t coordinate, bool confirmed, double least,
                       double *position, double *velocity) {
    const lg_log_coordinate *at = &data->file.coordinates[coordinate];
    *position = fmax(noise_of(data, at->place, at->places, confirmed, least),
                     noise_of(data, at->attitude, at->attitudes, false, least));
    *velocity = noise_of(data, at->velocity, at->velocities, confirmed, least);
    if (at->attitudes == 4) *position *= 2.0; /* a quaternion changes by half of the angle */
}

/* What is less than 2e-4 of a range is left to the loss: starts need not be unknown for it, and uneven steps
 * and held inputs can feign it. */
void identify_noise(const identify_data *data, double *position, double *velocity) {
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        find_noise(data, i, is_confirmed(data, i), 2e-4, &position[i], &velocity[i]);
}

void identify_traces(const identify_data *data, double *position, double *velocity) {
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++) {
        find_noise(data, i, false, 0.0, &position[i], &velocity[i]);
        if (data->file.coordinates[i].attitudes == 0 && data->file.measured == LG_MEASURED_VELOCITIES)
            position[i] = fmin(position[i], identify_position_noise(data, i));
    }
}
