/* The feed of lg-anomaly watch: its lines, and where samples belong in time. */
#include <math.h>
#include <stdlib.h>

#include "fuzz.h"
#include "lg-anomaly/watch.h"

/* ---- windows ---- */

enum { CHANNELS = 2, WINDOW = 4 };

/* A window has no number that is not finite, and no more missing samples than were lost. */
static lg_status judge(void *user, const float *x, uint32_t missing, lg_answer *answer, double *score) {
    (void)user;
    if (missing > WINDOW) abort();
    for (int i = 0; i < CHANNELS * WINDOW; i++)
        if (!isfinite(x[i])) abort();
    *answer = missing > 1 ? LG_ANSWER_NOVEL : x[0] > 0 ? LG_ANSWER_POSITIVE : LG_ANSWER_NEGATIVE;
    *score = (double)x[0];
    return x[0] == 13 ? LG_NOT_FINITE : LG_OK;
}

static void open_monitor(watching *self, uint8_t options) {
    static _Alignas(64) unsigned char memory[4096];
    lg_monitor_options about;
    lg_error error = {LG_OK, ""};
    lg_monitor_options_init(&about);
    about.channels = CHANNELS;
    about.window = WINDOW;
    about.hop = (options & 16) != 0 ? 1 + ((options >> 5) & 1) : 0;
    about.bridge = (options & 64) != 0 ? 2 : 5;
    about.missing = (options & 128) != 0 ? 1 : 0.3;
    if (lg_monitor_size(&about) > sizeof memory ||
        lg_monitor_init(&about, judge, NULL, &self->watch, memory, sizeof memory, &error) != LG_OK)
        abort();
}

/* Replaces the function that prints verdicts. Windows follow each other without a gap. */
void watch_push(watching *self, const float *sample) {
    lg_verdict v;
    bool ready = false;
    const bool lost = sample == NULL || !isfinite(sample[0]) || !isfinite(sample[1]);
    if (sample != NULL && isinf(sample[0])) abort(); /* a number must be finite, or be missing */
    self->tally.samples++;
    if (!lost) self->tally.received++;
    if (lg_monitor_push(self->watch, sample, &ready, &v) != LG_OK || !ready) return;
    if (v.first_sample + WINDOW != self->tally.samples || v.positive_votes > v.votes || v.votes > 5) abort();
    if (v.scored && self->tally.received == 0) abort();
}
void watch_end_gap(watching *self) {
    self->gap_windows = 0;
}

/* ---- feeds ---- */

static void take_feed(const app *by, const well_model *model, uint8_t options) {
    static lg_frame_text names[] = {"a", "b"};
    watching self = {.app = by,
                     .bench = {.model = model},
                     .channels = CHANNELS,
                     .rate = 1.0,
                     .rate_known = (options & 1) != 0};
    /* Hz; low rates, so that the longest gap that watch fills, a week, has few samples */
    if (self.rate_known) self.rate = (options & 2) != 0 ? 1e-3 : 0.05;
    self.timing.follow = (options & 4) != 0;
    sample_reader reader;
    self.reader = &reader;
    sample_reader_open(fuzz_file_descriptor(), "feed", CHANNELS, (options & 8) != 0 ? names : NULL, &reader);
    float sample[CHANNELS];
    double time;
    open_monitor(&self, options);
    watch_time_open(&self);
    for (sample_kind kind; (kind = sample_next(&reader, sample, &time)) < SAMPLE_END && !self.refused;) {
        if (reader.renamed) watch_restart(&self);
        reader.renamed = false;
        if (kind == SAMPLE_READ)
            watch_take(&self, sample, time, reader.line);
        else
            watch_take_malformed(&self, sample, time);
    }
    watch_settle(&self);
    app_free_kept();
    sample_reader_close(&reader);
}

void fuzz_feed(const uint8_t *data, size_t size) {
    static const well_model model = {.file = {.names = {.channels = CHANNELS, .classes = 2}},
                                     .window = WINDOW};
    if (size == 0) return;
    app by = {.title = "fuzz"};
    (void)fuzz_file(data + 1, size - 1);
    take_feed(&by, &model, data[0]);
}
