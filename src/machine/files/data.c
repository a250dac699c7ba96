/* Reads a machine and its logs, and finds the noise of the logs. */
#include <math.h>
#include <string.h>

#include "machine/files/recipe.h"

/* ---- logs ---- */

/* Lists the training logs, then the comma-separated paths of the validation logs. */
static lg_status list_paths(const lg_context *context, const lg_machine_sources *from, lg_machine_data *out,
                            lg_error *error) {
    const char *more = from->validation != NULL ? from->validation : "";
    size_t commas = 0;
    for (const char *at = more; *at != '\0'; at++) commas += *at == ',';
    out->paths = lg_alloc(context, from->count + commas + 1, sizeof *out->paths);
    out->list = lg_strdup(context, more);
    if (out->paths == NULL || out->list == NULL) return lg_no_memory(error);
    memcpy(out->paths, from->logs, from->count * sizeof *out->paths);
    out->path_count = from->count;
    for (char *rest = out->list, *at; (at = strtok_r(rest, ",", &rest)) != NULL;)
        out->paths[out->path_count++] = at;
    return LG_OK;
}

/* `training` becomes the parts that lie in the first files, which are for training; they come first. */
static lg_status read_logs(const lg_context *context, uint32_t delay, size_t training, lg_machine_data *out,
                           lg_error *error) {
    lg_log_options options;
    lg_log_options_init(&options);
    options.delay = delay;
    options.clocks = out->clocks;
    lg_logs_destroy(&out->logs);
    LG_TRY(lg_logs_read(context, &out->file, out->paths, out->path_count, &options, &out->logs, error));
    const lg_logs *logs = &out->logs;
    size_t parts = 0;
    while (parts < logs->log.parts && logs->part_file[parts] < training) parts++;
    out->training = logs->log;
    out->training.parts = parts;
    out->training.rows = logs->log.first[parts];
    return LG_OK;
}

/* Reads the logs with delays of 0 to LG_DELAY_ESTIMATED rows of all inputs with `delay: estimate`, and once
 * more with the delay whose unexplained accelerations are smallest. */
static lg_status estimate_delay(const lg_context *context, size_t training, lg_machine_data *out,
                                lg_error *error) {
    double least = INFINITY, left = 0;
    uint32_t best = 0;
    for (uint32_t delay = 0; delay <= LG_DELAY_ESTIMATED; delay++) {
        LG_TRY(read_logs(context, delay, training, out, error));
        LG_TRY(lg_machine_unexplained(context, &out->file.machine, &out->training, NULL, &left, error));
        if (!(left < least)) continue;
        least = left;
        best = delay;
    }
    if (isinf(least))
        return lg_fail(error, LG_UNSUPPORTED,
                       "%s: `delay: estimate` needs velocities: log them, or give `delay: auto` or a number",
                       out->failed);
    lg_log_message(
        context, LG_LOG_WARNING,
        "inputs with `delay: estimate` act %u row%s after they are logged (estimated with a "
        "quadratic model)%s",
        best, best == 1 ? "" : "s",
        best < LG_DELAY_ESTIMATED ? "" : "; more are not tried: if they act later, set a number of rows");
    return read_logs(context, best, training, out, error);
}

static lg_status read_all(const lg_context *context, const lg_machine_sources *from, lg_machine_data *out,
                          lg_error *error) {
    out->failed = from->machine;
    out->clocks = from->clocks;
    LG_TRY(from->text == NULL ? lg_machine_file_read(context, from->machine, &out->file, error)
                              : lg_machine_file_parse(context, from->machine, from->text, strlen(from->text),
                                                      &out->file, error));
    LG_TRY(list_paths(context, from, out, error));
    out->failed = out->paths[0];
    bool estimate = false;
    for (uint32_t i = 0; i < out->file.machine.input_count; i++)
        estimate = estimate || out->file.inputs[i].estimate_delay;
    return estimate && from->delay < 0
               ? estimate_delay(context, from->count, out, error)
               : read_logs(context, estimate ? (uint32_t)from->delay : 0, from->count, out, error);
}

lg_status lg_machine_data_read(const lg_context *context, const lg_machine_sources *from,
                               lg_machine_data *out, lg_error *error) {
    lg_error own = {LG_OK, ""};
    const lg_status status = read_all(context, from, out, &own);
    for (size_t i = out->path_count; i-- > 0;)
        if (strstr(own.message, out->paths[i]) != NULL) out->failed = out->paths[i];
    for (uint32_t i = 0; i < out->logs.warning_count && status == LG_OK && !from->quiet; i++)
        lg_log_message(context, LG_LOG_WARNING, "%s", out->logs.warnings[i]);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s", own.message);
}

void lg_machine_data_destroy(lg_machine_data *data) {
    const lg_context *context = data->file.context;
    LG_FREE_ALL(context, data->paths, data->list);
    lg_logs_destroy(&data->logs);
    lg_machine_file_destroy(&data->file);
    *data = (lg_machine_data){.failed = NULL};
}

lg_status lg_machine_refuse_momenta(const lg_machine_file *file, const char *path, lg_error *error) {
    if (file->measured != LG_MEASURED_MOMENTA) return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED,
                   "%s: `measured: momenta` is not possible here: log velocities, or positions alone", path);
}

/* ---- noise ---- */

/* Root mean square of the noise of columns first .. first + count - 1. Noise given in the machine's file
 * comes first; estimated noise counts if it is `confirmed` or more than `least` of the columns' range. */
static double noise_of(const lg_machine_data *data, uint32_t first, uint32_t count, bool confirmed,
                       double least) {
    double range = 0.0;
    lg_squares estimated = {0, 0}, given = {0, 0};
    for (uint32_t c = first; c < first + count; c++) {
        const lg_log_statistics *found = &data->logs.columns[c];
        const double known = data->file.columns[c].noise;
        range = fmax(range, found->high - found->low);
        lg_squares_add(&estimated, found->noise_at_most ? 0.0 : found->noise);
        lg_squares_add(&given, known > 0.0 ? known : NAN);
    }
    const double noise = fmax(lg_squares_root(&estimated), 0.0);
    return given.count > 0 ? lg_squares_root(&given) : confirmed || noise > least * range ? noise : 0.0;
}

/* Whether the noise of the position's column also shows in its differences from the integrated velocity: more
 * than half of it. */
static bool is_confirmed(const lg_machine_data *data, uint32_t coordinate) {
    const lg_log_statistics *found = &data->logs.columns[data->file.coordinates[coordinate].place];
    if (data->file.coordinates[coordinate].places == 0) return false;
    return !found->noise_at_most && found->noise > 0.0 &&
           data->logs.position_noise[coordinate] > 0.5 * found->noise;
}

static void find_noise(const lg_machine_data *data, uint32_t coordinate, bool confirmed, double least,
                       lg_machine_noise *out) {
    const lg_log_coordinate *at = &data->file.coordinates[coordinate];
    const uint32_t linear = at->velocities == 6 ? 3 : at->velocities; /* a pose has rates behind them */
    /* The angle is twice the change of a quaternion. */
    out->turn[coordinate] =
        (at->attitudes == 4 ? 2.0 : 1.0) * noise_of(data, at->attitude, at->attitudes, false, least);
    out->position[coordinate] =
        fmax(noise_of(data, at->place, at->places, confirmed, least), out->turn[coordinate]);
    out->rate[coordinate] = noise_of(data, at->velocity + linear, at->velocities - linear, false, least);
    out->velocity[coordinate] =
        fmax(noise_of(data, at->velocity, linear, confirmed, least), out->rate[coordinate]);
}

/* Unconfirmed noise below 2e-4 of a range is ignored: it does not justify estimated starts, and uneven time
 * steps or held inputs can look like it. But if positions alone are measured and one of them has noise,
 * traces of noise count in the others: without them such a position would have almost no weight beside the
 * first. */
static bool find_noises(const lg_machine_data *data, lg_machine_noise *out) {
    bool any = false;
    lg_machine_noise traces;
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++) {
        find_noise(data, i, is_confirmed(data, i), 2e-4, out);
        any = any || out->position[i] > 0.0 || out->velocity[i] > 0.0;
    }
    lg_machine_data_traces(data, &traces);
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++)
        if (any && data->file.measured == LG_MEASURED_POSITIONS && !(out->position[i] > 0.0))
            out->position[i] = traces.position[i];
    return any;
}

void lg_machine_data_traces(const lg_machine_data *data, lg_machine_noise *out) {
    for (uint32_t i = 0; i < data->file.machine.coordinate_count; i++) {
        find_noise(data, i, false, 0.0, out);
        if (data->file.coordinates[i].attitudes == 0 && data->file.measured == LG_MEASURED_VELOCITIES)
            out->position[i] = fmin(out->position[i], data->logs.position_noise[i]);
    }
}

void lg_machine_look(lg_machine_state *s) {
    s->positions = s->data.file.measured == LG_MEASURED_POSITIONS;
    s->estimated = s->positions || s->data.file.machine.accelerations;
    s->noisy = find_noises(&s->data, &s->noise);
}

/* ---- numbers of rows ---- */

double lg_log_number(const lg_machine *machine, const lg_machine_log *log, size_t row, size_t i) {
    const size_t nq = machine->positions, nv = machine->velocities;
    if (i >= nq + nv) return log->u[4 * row * machine->input_count + i - nq - nv];
    if (i >= nq) return lg_log_shown(log)[row * nv + i - nq];
    return machine->accelerations ? NAN : log->q[row * nq + i];
}

double lg_log_change(const lg_machine *machine, const lg_machine_log *log, size_t i, size_t lag) {
    enum { MOST = 20000 };
    const size_t every = log->rows / MOST + 1;
    lg_squares s = {0, 0};
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first; row + lag < p.end; row += every)
            lg_squares_add(&s,
                           lg_log_number(machine, log, row + lag, i) - lg_log_number(machine, log, row, i));
    return s.sum / (double)s.count;
}

double lg_log_variance(const lg_machine *machine, const lg_machine_log *log, size_t i) {
    double sum = 0, count = 0;
    lg_squares s = {0, 0};
    for (size_t row = 0; row < log->rows; row++) {
        const double x = lg_log_number(machine, log, row, i);
        if (!isnan(x)) sum += x, count++;
    }
    for (size_t row = 0; row < log->rows; row++)
        lg_squares_add(&s, lg_log_number(machine, log, row, i) - sum / count);
    return s.sum / (double)s.count;
}

void lg_machine_find_range(const lg_machine *machine, const lg_machine_log *log, lg_machine_range *out) {
    const size_t states = machine->positions + machine->velocities;
    for (size_t i = 0; i < LG_MACHINE_RANGE; i++) {
        const bool used = i < states + machine->input_count;
        out->low[i] = used ? 1e300 : 0.0;
        out->high[i] = used ? -1e300 : 0.0;
        for (size_t row = 0; row < log->rows && used && (i >= states || !machine->accelerations); row++) {
            const double x = lg_log_number(machine, log, row, i);
            out->low[i] = fmin(out->low[i], x);
            out->high[i] = fmax(out->high[i], x);
        }
    }
}
