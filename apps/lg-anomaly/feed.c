/* lg-anomaly feed: simulates the stream of samples that a logger on a rig would send, for `watch`. */
#include <errno.h>
#include <float.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/csv.h"
#include "lg-anomaly/anomaly.h"

enum { HOUR = 3600 };
/* Streams of the random number generator; they differ from the streams of the scene. */
enum { STREAM_SEA = 0x66656564, STREAM_FAULTS = 0x6661756c };

typedef struct feed_values {
    const char *out;
    well_setup well;
    double hours, crack_at, nan;
    lg_reals gaps;
} feed_values;

static const lg_field feed_options[] = {
    HOURS(feed_values, "Length of the feed", .low = 1e-4, .high = 1e6, .value = "24"),
    CRACK_AT(feed_values, "HOURS",
             "Time at which the casing breaks, in hours (`watch --crack-at` takes seconds; default: never)",
             .high = 1e6),
    LG_OPTION(
        feed_values, gaps, REALS, "N[,S]",
        "Average number of gaps per day (default 0), and their mean length in seconds (default 30); a gap "
        "is a series of missing lines",
        .high = 86400, .most = 2),
    LG_OPTION(feed_values, nan, REAL, "N", "Average number of samples per day with one value nan (default 0)",
              .high = 432000),
    WELL_ROWS(feed_values),
    APP_OUT(feed_values, "FILE.csv", "File for the feed (default: standard output)",
            .file = LG_FILE_STREAMED),
    LG_FIELD_END};

static feed_values values = {.crack_at = NAN};

/* Writes a line. The rate divides 10, so the times have one decimal. Nine significant digits let every float
 * read back exactly; digits that end half way between two numbers are rounded away from 0. */
static void put_line(lg_columns *to, double time, const float *sample) {
    lg_text_add(lg_columns_cell(to), "%.1f", time);
    for (uint32_t c = 0; c < LG_RISER_CHANNELS; c++)
        if (sample[c] == 0)
            lg_columns_whole(to, 0);
        else
            lg_text_add(lg_columns_cell(to), "%.8e", (double)sample[c] * (1 + DBL_EPSILON));
    lg_columns_end(to);
}

/* ---- simulating an hour ---- */

typedef struct hour {
    float *samples; /* (HOUR * rate, LG_RISER_CHANNELS) */
    lg_columns rows;
    size_t lines, gaps, nans;
    lg_status status;
    lg_error error;
} hour;

typedef struct feeding {
    const app *app;
    hour *hours; /* (crew): the hours that are simulated at the same time */
    size_t crew;
    uint64_t first, samples, rate;     /* first: index of the hour in hours[0]; samples: of the whole feed */
    uint64_t lines, gaps, nans, bytes; /* totals written so far */
    app_progress progress;
} feeding;

/* Sets the parameters of hour `index`. All hours have the same well, one of the standard wells; sea state,
 * waves and noise are drawn for each hour. */
static void scene_of(const app *self, uint64_t index, lg_riser_parameters *parameters, lg_riser_run *run) {
    uint32_t label, sea_state;
    lg_rng rng;
    const double start = (double)index * HOUR, crack = values.crack_at * HOUR;
    const uint32_t well = (uint32_t)(self->seed % (LG_RISER_RUNS / 2));
    lg_riser_standard_run(2 * well + 1, self->seed, values.well.severity, parameters, run, &label,
                          &sea_state);
    lg_rng_seed(&rng, self->seed ^ (index * UINT64_C(0x9e3779b97f4a7c15)), STREAM_SEA);
    run->sea = lg_sea_state_draw((uint32_t)lg_rng_below(&rng, LG_SEA_STATES), &rng);
    run->seed = lg_rng_next(&rng);
    run->noise_seed = lg_rng_next(&rng);
    well_set_up(&values.well, parameters, run);
    if (!(crack < start + HOUR)) parameters->severity = 1; /* the casing breaks in a later hour or never */
    run->crack_time = crack > start && crack < start + HOUR ? crack - start : 0;
}

/* Writes the lines of hour `index`, without the lines that fall into gaps. A gap ends at the end of the hour
 * at the latest. */
static void put_hour(const feeding *self, uint64_t index, uint64_t count, hour *out) {
    lg_rng rng;
    lg_rng_seed(&rng, self->app->seed ^ (index * UINT64_C(0x9e3779b97f4a7c15)), STREAM_FAULTS);
    const double per_sample = 1.0 / (86400.0 * (double)self->rate);
    const double mean = (values.gaps.count > 1 ? values.gaps.values[1] : 30) * (double)self->rate;
    uint64_t missing = 0;
    out->rows.row = out->lines = out->gaps = out->nans = 0;
    for (uint64_t i = 0; i < count; i++) {
        if (missing == 0 && lg_rng_uniform(&rng) < values.gaps.values[0] * per_sample) {
            missing = 1 + (uint64_t)(-mean * log(1 - lg_rng_uniform(&rng)));
            out->gaps++;
        }
        const bool hole = lg_rng_uniform(&rng) < values.nan * per_sample;
        float *sample = out->samples + i * LG_RISER_CHANNELS;
        if (hole) sample[lg_rng_below(&rng, LG_RISER_CHANNELS)] = NAN;
        if (missing > 0) {
            missing--;
            continue;
        }
        out->nans += hole;
        out->lines++;
        put_line(&out->rows, (double)(index * HOUR * self->rate + i) / (double)self->rate, sample);
    }
}

static void make_hour(void *user, size_t slot) {
    feeding *self = user;
    hour *out = &self->hours[slot];
    const uint64_t index = self->first + slot, begin = index * HOUR * self->rate;
    const uint64_t left = self->samples - begin, whole = HOUR * self->rate;
    const uint64_t count = left < whole ? left : whole;
    lg_riser_parameters parameters;
    lg_riser_run run;
    out->error = (lg_error){LG_OK, ""};
    out->status = app_interrupted() ? LG_CANCELLED : LG_OK;
    if (out->status != LG_OK) return;
    scene_of(self->app, index, &parameters, &run);
    out->status =
        lg_riser_simulate(self->app->context, &parameters, &run, (size_t)count, out->samples, &out->error);
    if (out->status == LG_OK) put_hour(self, index, count, out);
}

/* ---- writing the feed ---- */

/* A regular file appears under its name only when it is complete, whatever its length. An existing target of
 * another type (a pipe, a device) is written to directly. */
typedef struct sink {
    FILE *stream;
    lg_temporary temporary; /* of a regular file */
} sink;

/* The status and message of errno, or LG_CANCELLED if a signal interrupted the write. */
static lg_status file_failed(lg_error *error) {
    if (app_interrupted()) return LG_CANCELLED;
    return lg_fail(error, lg_status_of(errno), "%s: %s", values.out != NULL ? values.out : "standard output",
                   strerror(errno));
}

/* Opens the sink and writes the line of names. */
static lg_status sink_open(const app *self, const char *path, sink *out, lg_error *error) {
    static const float ones[LG_RISER_CHANNELS] = {1, 1, 1, 1, 1, 1};
    struct stat information;
    lg_columns like = {.text = app_text()};
    lg_columns_name(&like, "time");
    for (uint32_t c = 0; c < LG_RISER_CHANNELS; c++) lg_columns_name(&like, lg_riser_channel(c));
    lg_columns_end(&like);
    const size_t head = like.row;
    put_line(&like, 0.1, ones);
    APP_FREE char *text = like.text.data;
    *out = (sink){.stream = stdout, .temporary = {.fd = -1}};
    if (path != NULL && stat(path, &information) == 0 && !S_ISREG(information.st_mode)) {
        out->stream = fopen(path, "we");
    } else if (path != NULL) {
        LG_TRY(lg_may_replace(self->context, path, text, like.row, error));
        LG_TRY(lg_temporary_create(self->context, path, false, &out->temporary, error));
        out->stream = fdopen(dup(out->temporary.fd), "w");
    }
    /* without a buffer, so that nothing is left to write to a pipe that nobody reads */
    const bool ready = out->stream != NULL && setvbuf(out->stream, NULL, _IONBF, 0) == 0;
    return ready && fwrite(text, 1, head, out->stream) == head ? LG_OK : file_failed(error);
}

/* Closes the sink. The file appears under its name only if `status`, the status of the writes, is LG_OK. */
static lg_status sink_close(sink *to, lg_status status, lg_error *error) {
    if (to->stream != NULL && to->stream != stdout && fclose(to->stream) != 0 && status == LG_OK)
        status = file_failed(error);
    if (to->temporary.fd < 0) return status;
    if (status == LG_OK) status = lg_temporary_publish(&to->temporary, values.out, error);
    if (status != LG_OK) (void)unlink(to->temporary.name);
    lg_temporary_end(&to->temporary);
    return status;
}

/* ---- the command ---- */

static lg_status write_hour(feeding *feed, uint64_t index, hour *h, const sink *to, lg_error *error) {
    if (app_interrupted()) return LG_CANCELLED;
    if (h->status != LG_OK)
        return lg_fail(error, h->status, "hour %llu: %s", (unsigned long long)index,
                       app_sentence(h->status, &h->error));
    if (fwrite(h->rows.text.data, 1, h->rows.row, to->stream) != h->rows.row) return file_failed(error);
    feed->lines += h->lines;
    feed->gaps += h->gaps;
    feed->nans += h->nans;
    feed->bytes += h->rows.row;
    lg_text_destroy(&h->rows.text);
    return LG_OK;
}

/* Works in rounds of `crew` hours: the hours of a round are simulated in parallel and then written in
 * order. */
static lg_status write_hours(feeding *feed, const sink *to, lg_error *error) {
    const uint64_t whole = HOUR * feed->rate, hours = (feed->samples + whole - 1) / whole;
    lg_status status = LG_OK;
    if (values.out != NULL) app_progress_begin(&feed->progress, 0, hours);
    for (feed->first = 0; feed->first < hours && status == LG_OK; feed->first += feed->crew) {
        const uint64_t left = hours - feed->first;
        const size_t count = left < feed->crew ? (size_t)left : feed->crew;
        app_parallel(feed->app->threads, count, make_hour, feed);
        if (values.out != NULL) app_progress_show(&feed->progress, feed->first, "hours of the feed");
        for (size_t i = 0; i < count && status == LG_OK; i++)
            status = write_hour(feed, feed->first + i, &feed->hours[i], to, error);
    }
    app_progress_end(&feed->progress);
    return status;
}

static void run(app *self) {
    lg_riser_run defaults;
    lg_riser_run_init(&defaults);
    feeding feed = {.app = self, .crew = (size_t)self->threads, .rate = (uint64_t)defaults.rate};
    lg_error error = {LG_OK, ""};
    sink to;
    if (values.out == NULL && self->json)
        app_stop_usage(self, "--json: the feed would also go to standard output; give --out FILE.csv");
    feed.samples = (uint64_t)floor(values.hours * HOUR * defaults.rate + 0.5);
    if (feed.samples == 0) app_stop_usage(self, "--hours %g: is shorter than a sample", values.hours);
    feed.hours = app_keep(feed.crew, sizeof *feed.hours);
    for (size_t i = 0; i < feed.crew; i++) {
        feed.hours[i].samples = app_keep(HOUR * feed.rate * LG_RISER_CHANNELS, sizeof(float));
        feed.hours[i].rows.text = app_text();
    }
    const double begin = app_seconds();
    lg_status status = sink_open(self, values.out, &to, &error);
    if (status == LG_OK) status = write_hours(&feed, &to, &error);
    app_must(self, sink_close(&to, status, &error), &error);
    if (values.out == NULL) return;
    APP_PUT(self->out, LG_REAL("hours", values.hours, NULL), LG_WHOLE("samples", feed.samples, NULL),
            LG_WHOLE("lines", feed.lines, "samples that are there"), LG_WHOLE("gaps", feed.gaps, NULL),
            LG_WHOLE("nan", feed.nans, "samples with a value nan"), LG_AS_WHOLE("bytes", feed.bytes),
            LG_AS_REAL("rate", (double)feed.rate), LG_AS_REAL("crack_at", values.crack_at),
            LG_AS_REAL("severity", values.well.severity), LG_AS_REAL("noise", values.well.noise),
            LG_AS_WHOLE("seed", self->seed), LG_TEXT("out", values.out, NULL),
            LG_REAL("seconds", app_seconds() - begin, NULL));
}

const app_command anomaly_feed_command = {
    .name = "feed",
    .summary = "Simulate a feed of the well as CSV, with optional gaps and a crack",
    .details =
        "The first line has the names (time and the six channels). Each further line is a sample: seconds "
        "since the start, accelerations in m/s^2, moments in N m. There is one well. Every hour starts "
        "again with its own sea state, drawn from the 18 of `generate`. Memory does not depend on the "
        "length. Example, a watch over 30 days with a late crack:\n\n  lg-anomaly feed --hours 720 "
        "--crack-at 700 --gaps 20 --nan 50 | lg-anomaly watch model.h5",
    .settings = APP_SETTINGS(APP_GIVEN(feed_options, values)),
    .run = run};
