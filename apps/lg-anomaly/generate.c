/* lg-anomaly generate: the standard runs of the riser scene, cut in windows, into a data file. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/pieces.h"
#include "lg-anomaly/anomaly.h"
#include "common/train.h"

enum { CONDITIONS = LG_RISER_RUNS / 2, MAX_RUNS = 1000 * LG_RISER_RUNS };

typedef struct generate_values {
    const char *out, *plot;
    uint64_t runs;
    int housing, picture;
    double noise, hours, severity, window;
    board_values board;
} generate_values;

static const char *const housings[] = {[LG_HOUSING_SLACK] = "slack", [LG_HOUSING_TIGHT] = "tight", NULL};

enum { PICTURE_STATES, PICTURE_HOUSINGS };
static const char *const pictures[] = {"states", "housings", NULL};

static const lg_field generate_options[] = {
    LG_OPTION(generate_values, out, STRING, "FILE", "The HDF5 file to write"),
    LG_OPTION(generate_values, noise, REAL, "F",
              "Noise of the sensors as a multiple of the data sheet's (default 1)", .high = 1e6),
    LG_OPTION(
        generate_values, runs, U64, "n",
        "Recordings (default 108: 3 top tensions x 18 sea states, each intact and broken). A smaller number "
        "is spread over the conditions, pair by pair; a larger one repeats them with other waves",
        .low = 1, .high = MAX_RUNS),
    LG_OPTION(generate_values, hours, REAL, "H", "Length of a recording (default 1)", .low = 1e-3,
              .high = 1000),
    LG_OPTION(generate_values, housing, NAME, NULL, "slack (default) or tight", .names = housings),
    LG_OPTION(generate_values, severity, REAL, "R",
              "Remaining fraction of the broken casing's rotational stiffness: 1 is intact (default 0.58)",
              .low = 1e-3, .high = 1),
    LG_OPTION(generate_values, window, REAL, "SECONDS", "Length of a window (default 60)", .low = 0.2,
              .high = 1e6),
    LG_OPTION(generate_values, plot, STRING, "FILE.svg|.png",
              "Draw recordings against time, and their moments against their accelerations"),
    LG_OPTION(generate_values, picture, NAME, NULL,
              "With --plot: states, intact and broken (default), or housings, slack and tight",
              .names = pictures),
    BOARD_ROWS(generate_values),
    LG_FIELD_END};

static generate_values values = {
    .runs = LG_RISER_RUNS, .noise = 1, .hours = 1, .severity = 0.58, .window = 60};

typedef struct generating {
    const app *app;
    lg_series *series;
    size_t windows_of_run;
} generating;

/* Recording `index` of `runs`: pairs of intact and broken, which share their waves. */
static void scene_of(const app *self, uint64_t index, lg_housing housing, lg_riser_parameters *parameters,
                     lg_riser_run *run, uint32_t *label, uint32_t *sea_state) {
    const uint64_t pairs = (values.runs + 1) / 2, pair = index / 2;
    const uint64_t condition = pairs <= CONDITIONS ? pair * CONDITIONS / pairs : pair % CONDITIONS;
    const uint64_t seed = self->seed + UINT64_C(0x9e3779b97f4a7c15) * (pair / CONDITIONS);
    lg_riser_standard_run((uint32_t)(2 * condition + index % 2), seed, values.severity, parameters, run,
                          label, sea_state);
    parameters->housing = housing;
    run->noise = values.noise;
}

static void transpose(const float *samples, size_t windows, uint32_t channels, uint32_t length, float *x) {
    for (size_t w = 0; w < windows; w++)
        for (uint32_t c = 0; c < channels; c++)
            for (uint32_t t = 0; t < length; t++)
                x[(w * channels + c) * length + t] = samples[(w * length + t) * channels + c];
}

static lg_status generate_run(void *user, size_t index, lg_error *error) {
    generating *self = user;
    lg_series *series = self->series;
    const size_t windows = self->windows_of_run, first = index * windows;
    const size_t count = windows * series->length;
    lg_riser_parameters parameters;
    lg_riser_run run;
    uint32_t label, sea_state;
    lg_error why = {LG_OK, ""};
    scene_of(self->app, index, (lg_housing)values.housing, &parameters, &run, &label, &sea_state);
    float *samples = app_try_alloc(count * LG_RISER_CHANNELS, sizeof *samples);
    if (samples == NULL) return app_error(error, LG_OUT_OF_MEMORY, "run %zu: out of memory", index);
    const lg_status status = lg_riser_simulate(self->app->context, &parameters, &run, count, samples, &why);
    if (status == LG_OK)
        transpose(samples, windows, series->channels, series->length,
                  series->x + first * series->channels * series->length);
    free(samples);
    for (size_t w = first; w < first + windows; w++) {
        series->label[w] = label;
        series->group[w] = sea_state;
        series->run[w] = (uint32_t)index;
    }
    return status == LG_OK ? LG_OK
                           : app_error(error, status, "run %zu: %s", index,
                                       why.message[0] != '\0' ? why.message : lg_status_sentence(status));
}

/* Set while the series lives; not freed with it. */
static char channel_names[LG_RISER_CHANNELS][LG_SERIES_NAME];

static lg_status create_series(const app *self, uint32_t length, size_t windows, lg_series *out) {
    lg_riser_run run;
    lg_riser_run_init(&run);
    *out = (lg_series){.count = windows, .channels = LG_RISER_CHANNELS, .length = length, .classes = 2};
    const lg_status status = lg_series_allocate(self->context, out, true, true);
    if (status != LG_OK) return status;
    out->rate = run.rate;
    (void)snprintf(out->class_name[0], LG_SERIES_NAME, "intact");
    (void)snprintf(out->class_name[1], LG_SERIES_NAME, "broken");
    for (uint32_t c = 0; c < LG_RISER_CHANNELS; c++)
        (void)snprintf(channel_names[c], LG_SERIES_NAME, "%s", lg_riser_channel(c));
    out->channel_name = channel_names;
    return LG_OK;
}

static void free_data(lg_series_data *data) {
    data->series.channel_name = NULL;
    lg_series_data_destroy(data);
}

/* ---- the picture ---- */

enum { SHOWN_SECONDS = 3600 };

/* Two versions of one condition of the first runs. */
static lg_status draw(const app *self, double rate, lg_error *error) {
    const bool states = values.picture == PICTURE_STATES;
    const double seconds = fmin(values.hours * 3600, SHOWN_SECONDS);
    const size_t count = (size_t)(seconds * rate);
    static const char *const names[][2] = {{"intact", "broken"}, {"slack, broken", "tight, broken"}};
    float *samples = app_alloc(2 * count * LG_RISER_CHANNELS, sizeof *samples);
    recording runs[2];
    lg_status status = LG_OK;
    for (uint64_t i = 0; i < 2 && status == LG_OK; i++) {
        lg_riser_parameters parameters;
        lg_riser_run run;
        uint32_t label, sea_state;
        const lg_housing housing = states ? (lg_housing)values.housing : (lg_housing)i;
        scene_of(self, states ? i : 1, housing, &parameters, &run, &label, &sea_state);
        runs[i] = (recording){names[values.picture][i], samples + i * count * LG_RISER_CHANNELS, count};
        status = lg_riser_simulate(self->context, &parameters, &run, count,
                                   samples + i * count * LG_RISER_CHANNELS, error);
    }
    if (status == LG_OK)
        status = draw_recordings(self, values.plot, runs, 2, LG_RISER_CHANNELS, channel_names, rate, error);
    free(samples);
    return status;
}

/* ---- the command ---- */

static void report(const app *self, const lg_series_data *data, double seconds) {
    const lg_series *series = &data->series;
    size_t broken = 0;
    for (size_t i = 0; i < series->count; i++) broken += series->label[i] == 1;
    if (!self->json) {
        (void)printf("%s: %zu windows of %g s (%u channels, %g samples a second) from %llu runs of %g h; "
                     "%zu intact, %zu broken; noise %g, %s housing (%.1f s)\n",
                     values.out, series->count, series->length / series->rate, series->channels, series->rate,
                     (unsigned long long)values.runs, values.hours, series->count - broken, broken,
                     values.noise, data->housing, seconds);
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_size(&json, "runs", values.runs);
    app_json_real(&json, "hours", values.hours);
    app_json_size(&json, "windows", series->count);
    app_json_size(&json, "intact", series->count - broken);
    app_json_size(&json, "broken", broken);
    app_json_size(&json, "channels", series->channels);
    app_json_size(&json, "length", series->length);
    app_json_real(&json, "rate", series->rate);
    app_json_real(&json, "noise", values.noise);
    app_json_text(&json, "housing", data->housing);
    app_json_real(&json, "severity", values.severity);
    app_json_size(&json, "seed", self->seed);
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "sha256", data->sha256);
    app_json_text(&json, "out", values.out);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

/* All runs, of all processes. *complete: they are there. An exit code. */
static int simulate(const app *self, size_t windows, lg_series *series, pieces *made, bool *complete) {
    const size_t runs = (size_t)values.runs, window = (size_t)series->channels * series->length;
    generating what = {.app = self, .series = series, .windows_of_run = windows};
    char label[LG_SHA256_TEXT],
        *text = app_format("%llu %.17g %.17g %.17g %d %.17g %llu", (unsigned long long)values.runs,
                           values.hours, values.window, values.noise, values.housing, values.severity,
                           (unsigned long long)self->seed);
    board_label(text, NULL, label);
    free(text);
    *made = (pieces){.app = self,
                     .board = &values.board,
                     .out = values.out,
                     .sweep = label,
                     .count = runs,
                     .array_count = 4,
                     .make = generate_run,
                     .user = &what};
    const pieces_array arrays[] = {{series->x, windows * window * sizeof *series->x, 0},
                                   {series->label, windows * sizeof *series->label, 0},
                                   {series->group, windows * sizeof *series->group, 0},
                                   {series->run, windows * sizeof *series->run, 0}};
    for (size_t k = 0; k < made->array_count; k++) {
        made->arrays[k] = arrays[k];
        made->arrays[k].total = runs * arrays[k].each;
    }
    *complete = pieces_make(made);
    return APP_EXIT_OK;
}

/* A recording must have whole windows, a window whole samples. */
static int cut(const app *self, double rate, uint32_t *length, size_t *windows) {
    const double samples = values.window * rate, whole = floor(samples + 0.5);
    if (fabs(samples - whole) > 1e-6 * samples)
        return app_usage(self, "--window %g: is %g samples at %g a second, not a whole number", values.window,
                         samples, rate);
    const double count = floor(values.hours * 3600 * rate / whole + 1e-9);
    if (!(count >= 1))
        return app_usage(self, "--window %g: a recording of %g h is shorter than one window", values.window,
                         values.hours);
    if (count * (double)values.runs > 4e9)
        return app_usage(self, "%g windows are more than a file may hold: reduce --runs or --hours",
                         count * (double)values.runs);
    *length = (uint32_t)whole;
    *windows = (size_t)count;
    return APP_EXIT_OK;
}

static int run(app *self) {
    const app_path paths[] = {{"out", values.out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    lg_error error = {LG_OK, ""};
    lg_series_data data = {.noise = values.noise, .severity = values.severity};
    lg_riser_run defaults;
    uint32_t length = 0;
    size_t windows = 0;
    bool complete = false;
    pieces made;
    lg_riser_run_init(&defaults);
    if (values.out == NULL) return app_usage(self, "--out FILE is missing");
    if (app_given(self, "picture") && values.plot == NULL)
        return app_usage(self, "--picture: needs --plot FILE");
    (void)board_wanted(self, &values.board, values.out);
    int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code == APP_EXIT_OK) code = cut(self, defaults.rate, &length, &windows);
    if (code != APP_EXIT_OK) return code;
    const double begin = app_seconds();
    lg_status status = create_series(self, length, windows * (size_t)values.runs, &data.series);
    if (status == LG_OUT_OF_MEMORY)
        return app_fail(self, status, "out of memory: %llu windows of %u samples",
                        (unsigned long long)(windows * values.runs), length);
    if (status != LG_OK) return app_fail(self, status, "%s", lg_status_sentence(status));
    code = simulate(self, windows, &data.series, &made, &complete);
    const double seconds = app_seconds() - begin;
    (void)snprintf(data.housing, sizeof data.housing, "%s", housings[values.housing]);
    data.provenance = app_provenance(self, self->seed);
    if (complete) {
        status = lg_series_write(self->context, values.out, &data, &error);
        app_must_file(self, status, &error, values.out);
        pieces_end(&made);
    }
    if (code == APP_EXIT_OK && complete && values.plot != NULL) {
        status = draw(self, data.series.rate, &error);
        if (status != LG_OK) code = app_fail_file(self, status, &error, values.plot);
    }
    if (code == APP_EXIT_OK && complete) report(self, &data, seconds);
    free_data(&data);
    return code;
}

const app_command generate_command = {
    .name = "generate",
    .summary = "Simulate labelled windows of a subsea well, intact and broken",
    .details =
        "The file holds /X (n, 6, samples) as 32-bit floats, /y (0 intact, 1 broken), /group (the sea "
        "state, 0 to 17; --split group keeps the windows of a group together) and /run (the recording). "
        "Channels: accelerations of the lower and the upper sensor in m/s^2 and the bending moment in N m, "
        "each in x and y. For the probability of detection against severity, make one file for each "
        "--severity.",
    .settings = APP_SETTINGS(APP_GIVEN(generate_options, values)),
    .run = run,
    .together = APP_WORKERS};
