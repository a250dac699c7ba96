/* lg-anomaly generate: simulates the standard runs of the riser scene, cuts them into windows and writes a
 * data file. */
#include <math.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"
#include "common/train.h"
#include "common/trials.h"

enum { CONDITIONS = LG_RISER_RUNS / 2, MAX_RUNS = 1000 * LG_RISER_RUNS };

typedef struct generate_values {
    const char *out;
    uint64_t runs;
    double hours, window;
    well_setup well;
    trials_values shared;
} generate_values;

const char *const housing_names[] = {[LG_HOUSING_SLACK] = "slack", [LG_HOUSING_TIGHT] = "tight", NULL};
enum { DRILLING, COMPLETION };
const char *const operation_names[] = {[DRILLING] = "drilling", [COMPLETION] = "completion", NULL};

void well_set_up(const well_setup *setup, lg_riser_parameters *parameters, lg_riser_run *run) {
    run->noise = setup->noise;
    parameters->housing = (lg_housing)setup->housing;
    parameters->relief_stiffness = setup->load_relief;
    if (setup->operation == COMPLETION) lg_riser_complete(parameters);
}

static const lg_field generate_options[] = {
    APP_OUT(generate_values, "FILE", "The HDF5 file to write", .required = true, .usual = true),
    APP_RUNS(
        generate_values,
        "Recordings (default 108: 3 top tensions x 18 sea states, each intact and broken). A smaller number "
        "is spread over the conditions, pair by pair; a larger one repeats them with other waves",
        .usual = true, .high = MAX_RUNS),
    HOURS(generate_values, "Length of a recording (default 1)", .usual = true, .low = 1e-3, .high = 1000),
    WELL_ROWS(generate_values),
    LG_OPTION(generate_values, window, REAL, "SECONDS", "Length of a window (default 60)", .usual = true,
              .low = 0.2, .high = 1e6),
    TRIALS_ROWS(generate_values),
    LG_FIELD_END};

static generate_values values = {.runs = LG_RISER_RUNS, .hours = 1, .window = 60};

typedef struct generating {
    const app *app;
    lg_series *series;
    size_t windows_of_run;
} generating;

/* Sets the parameters of recording `index`. Recordings 2k and 2k + 1 are a pair, intact and broken, with the
 * same waves. */
static void scene_of(const app *self, uint64_t index, const well_setup *well, lg_riser_parameters *parameters,
                     lg_riser_run *run, uint32_t *label, uint32_t *sea_state) {
    const uint64_t pairs = (values.runs + 1) / 2, pair = index / 2;
    const uint64_t condition = pairs <= CONDITIONS ? pair * CONDITIONS / pairs : pair % CONDITIONS;
    const uint64_t seed = self->seed + UINT64_C(0x9e3779b97f4a7c15) * (pair / CONDITIONS);
    lg_riser_standard_run((uint32_t)(2 * condition + index % 2), seed, values.well.severity, parameters, run,
                          label, sea_state);
    well_set_up(well, parameters, run);
}

static lg_status generate_run(void *user, size_t index, void *record, lg_error *error) {
    generating *self = user;
    lg_series *series = self->series;
    const size_t windows = self->windows_of_run, first = index * windows;
    const size_t count = windows * series->length;
    lg_riser_parameters parameters;
    lg_riser_run run;
    uint32_t label, sea_state;
    lg_error why = {LG_OK, ""};
    scene_of(self->app, index, &values.well, &parameters, &run, &label, &sea_state);
    APP_FREE float *samples = app_try_alloc(count * LG_RISER_CHANNELS, sizeof *samples);
    if (samples == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "run %zu: out of memory", index);
    const lg_status status = lg_riser_simulate(self->app->context, &parameters, &run, count, samples, &why);
    const size_t channels = series->channels, length = series->length;
    for (size_t w = 0; status == LG_OK && w < windows; w++)
        for (size_t c = 0; c < channels; c++)
            for (size_t t = 0; t < length; t++)
                series->x[((first + w) * channels + c) * length + t] =
                    samples[(w * length + t) * channels + c];
    for (size_t w = first; w < first + windows; w++) {
        series->label[w] = label;
        series->group[w] = sea_state;
        series->run[w] = (uint32_t)index;
    }
    return status == LG_OK ? LG_OK : lg_fail(error, status, "run %zu: %s", index, app_sentence(status, &why));
}

static void create_series(const app *self, uint32_t length, size_t windows, lg_series *out) {
    lg_riser_run run;
    lg_riser_run_init(&run);
    *out = (lg_series){.count = windows, .channels = LG_RISER_CHANNELS, .length = length, .classes = 2};
    const lg_status status = lg_series_allocate(self->context, out, true, true);
    if (status == LG_OK) out->channel_name = lg_alloc(self->context, LG_RISER_CHANNELS, LG_SERIES_NAME);
    if (status == LG_OUT_OF_MEMORY || out->channel_name == NULL)
        app_stop(self, LG_OUT_OF_MEMORY, "out of memory: %zu windows of %u samples", windows, length);
    out->rate = run.rate;
    (void)snprintf(out->class_name[0], LG_SERIES_NAME, "intact");
    (void)snprintf(out->class_name[1], LG_SERIES_NAME, "broken");
    for (uint32_t c = 0; c < LG_RISER_CHANNELS; c++)
        (void)snprintf(out->channel_name[c], LG_SERIES_NAME, "%s", lg_riser_channel(c));
}

/* ---- the plot ---- */

enum { SHOWN_SECONDS = 3600, SHOWN_SAMPLES = 1800 };

/* Two recordings of the first condition against time: intact and broken, or, both broken, slack and tight. */
static void put_recordings(app_plot *plot, const void *sampled) {
    const app *self = app_running();
    const bool states = strcmp(plot->kind, "states") == 0;
    const double rate = *(const double *)sampled;
    const size_t count = (size_t)(fmin(values.hours * 3600, SHOWN_SECONDS) * rate);
    APP_FREE float *samples = app_alloc(count * LG_RISER_CHANNELS, sizeof *samples);
    app_plot_text(plot, states ? "2\t%d\tintact\tbroken" : "2\t%d\tslack, broken\ttight, broken",
                  LG_RISER_CHANNELS);
    for (uint32_t c = 0; c < LG_RISER_CHANNELS; c++) app_plot_text(plot, "%s", lg_riser_channel(c));
    for (int i = 0; i < 2; i++) {
        lg_riser_parameters parameters;
        lg_riser_run run;
        uint32_t label, sea_state;
        well_setup well = values.well;
        if (!states) well.housing = i;
        scene_of(self, states ? (uint64_t)i : 1, &well, &parameters, &run, &label, &sea_state);
        APP_MUST_FILE(self, app_plot_given.plot,
                      lg_riser_simulate(self->context, &parameters, &run, count, samples, &error));
        for (size_t k = 0; k < count; k += count / SHOWN_SAMPLES + 1) {
            double row[1 + LG_RISER_CHANNELS] = {(double)k / rate / 60};
            for (size_t c = 0; c < LG_RISER_CHANNELS; c++)
                row[1 + c] = (double)samples[k * LG_RISER_CHANNELS + c];
            APP_PLOT_COLUMNS(plot, 6, 1, {row, 0, LG_COUNT(row)});
        }
        app_plot_block(plot);
    }
}

/* ---- the command ---- */

/* Simulates all runs, together with other processes if there are any. False: another process writes the
 * file. */
static bool simulate(const app *self, size_t windows, lg_series *series, trials_work *made) {
    const size_t window = (size_t)series->channels * series->length;
    generating what = {.app = self, .series = series, .windows_of_run = windows};
    APP_FREE char *text =
        app_format("%llu %.17g %.17g %.17g %d %d %.17g %.17g %llu", (unsigned long long)values.runs,
                   values.hours, values.window, values.well.noise, values.well.housing, values.well.operation,
                   values.well.load_relief, values.well.severity, (unsigned long long)self->seed);
    made->count = (size_t)values.runs;
    made->array_count = 4;
    made->run = generate_run;
    made->user = &what;
    /* All pieces have the same size. */
    made->arrays[0] = (trials_array){series->x, windows * window * sizeof *series->x, SIZE_MAX};
    made->arrays[1] = (trials_array){series->label, windows * sizeof *series->label, SIZE_MAX};
    made->arrays[2] = (trials_array){series->group, windows * sizeof *series->group, SIZE_MAX};
    made->arrays[3] = (trials_array){series->run, windows * sizeof *series->run, SIZE_MAX};
    trials_begin(made, text, NULL);
    return trials_run(made);
}

/* Computes the samples per window and the windows per recording. Ends the command if a window is not a whole
 * number of samples. */
static void cut(const app *self, uint32_t *length, size_t *windows) {
    lg_riser_run defaults;
    lg_riser_run_init(&defaults);
    const double samples = values.window * defaults.rate, whole = floor(samples + 0.5);
    if (fabs(samples - whole) > 1e-6 * samples)
        app_stop_usage(self, "--window %g: is %g samples at %g per second, not a whole number", values.window,
                       samples, defaults.rate);
    const double count = floor(values.hours * 3600 * defaults.rate / whole + 1e-9);
    if (!(count >= 1))
        app_stop_usage(self, "--window %g: a recording of %g h is shorter than one window", values.window,
                       values.hours);
    if (count * (double)values.runs > 4e9)
        app_stop_usage(self, "%g windows are more than a file may hold: reduce --runs or --hours",
                       count * (double)values.runs);
    *length = (uint32_t)whole;
    *windows = (size_t)count;
}

static void run(app *self) {
    APP_CLEAN(trials_close)
    trials_work made = {.app = self,
                        .values = &values.shared,
                        .out = values.out,
                        .noun = "recordings",
                        .threads = self->threads};
    APP_CLEAN(lg_series_data_destroy)
    lg_series_data data = {.noise = values.well.noise, .severity = values.well.severity};
    uint32_t length;
    size_t windows;
    const app_path out = trials_choose(&made, "series");
    app_check_outputs(self, &out, 1);
    cut(self, &length, &windows);
    const double begin = app_seconds();
    create_series(self, length, windows * (size_t)values.runs, &data.series);
    if (!simulate(self, windows, &data.series, &made)) return;
    const double seconds = app_seconds() - begin;
    (void)snprintf(data.housing, sizeof data.housing, "%s", housing_names[values.well.housing]);
    (void)snprintf(data.healthy, sizeof data.healthy, "%s", data.series.class_name[0]);
    data.provenance = app_provenance(self, self->seed);
    APP_FILE(self, values.out, lg_series_write, &data);
    trials_end(&made);
    app_plot_draw(self, 0, &data.series.rate);
    const lg_series *series = &data.series;
    size_t broken = 0;
    for (size_t i = 0; i < series->count; i++) broken += series->label[i] == 1;
    APP_PUT(self->out, LG_WHOLE("runs", values.runs, NULL), LG_REAL("hours", values.hours, "of a run"),
            LG_WHOLE("windows", series->count, NULL), LG_WHOLE("intact", series->count - broken, NULL),
            LG_WHOLE("broken", broken, NULL), LG_WHOLE("channels", series->channels, NULL),
            LG_WHOLE("length", series->length, "samples of a window"),
            LG_REAL("rate", series->rate, "samples per second"), LG_REAL("noise", values.well.noise, NULL),
            LG_TEXT("housing", data.housing, NULL),
            LG_TEXT("operation", operation_names[values.well.operation], NULL),
            LG_REAL("load_relief", values.well.load_relief, "N/m"),
            LG_REAL("severity", values.well.severity, NULL), LG_AS_WHOLE("seed", self->seed),
            LG_AS_WHOLE("threads", self->threads), LG_AS_TEXT("sha256", data.sha256),
            LG_TEXT("out", values.out, NULL), LG_REAL("seconds", seconds, NULL));
}

const app_command anomaly_generate_command = {
    .name = "generate",
    .summary = "Simulate labelled windows of a subsea well, intact and broken",
    .details =
        "The file holds /X (n, 6, samples) as 32-bit floats, /y (0 intact, 1 broken), /group (the sea state, "
        "0 to 17; --split group keeps the windows of a group together) and /run (the recording). Channels: "
        "accelerations of the lower and the upper sensor in m/s^2 and the bending moment in N m, each in x "
        "and y. For the probability of detection against severity, make one file for each --severity.",
    .settings = APP_SETTINGS(APP_GIVEN(generate_options, values)),
    .plots = APP_PLOTS(APP_PLOT("states", "recordings, intact and broken", "recordings", put_recordings),
                       APP_PLOT("housings", "recordings, slack and tight", "recordings", put_recordings)),
    .run = run,
    .together = APP_RANKS};
