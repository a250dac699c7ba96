/* The feed of lg-anomaly watch: its lines, and where samples belong in time. */
#include <math.h>
#include <stdlib.h>

#include "fuzz.h"
#include "lg-anomaly/watch.h"

/* Replaces the function that judges windows. */
void watch_push(watching *self, const float *sample) {
    self->tally.samples++;
    if (sample != NULL && isinf(sample[0])) abort(); /* a number must be finite, or be missing */
}
void watch_end_gap(watching *self) {
    self->gap_windows = 0;
}

static void take_feed(const app *by, const well_model *model, uint8_t options) {
    static const char *const names[] = {"a", "b"};
    watching self = {.app = by, .bench = {.model = model}, .rate = 1.0, .rate_known = (options & 1) != 0};
    /* Hz; low rates, so that the longest gap that watch fills, a week, has few samples */
    if (self.rate_known) self.rate = (options & 2) != 0 ? 1e-3 : 0.05;
    self.timing.follow = (options & 4) != 0;
    static sample_reader fresh; /* its large buffer is allocated only once */
    if (fresh.buffer == NULL) sample_reader_open(fuzz_file_descriptor(), 2, NULL, &fresh);
    sample_reader reader = fresh;
    reader.names = (options & 8) != 0 ? names : NULL;
    reader.place[0] = 0;
    reader.place[1] = 1;
    float sample[2];
    double time;
    watch_time_open(&self);
    for (sample_kind kind; (kind = sample_next(&reader, sample, &time)) < SAMPLE_END && !self.refused;)
        if (kind == SAMPLE_READ)
            watch_take(&self, sample, time, reader.line);
        else
            watch_take_malformed(&self, &reader, sample, time);
    watch_settle(&self);
    watch_time_close(&self);
}

void fuzz_feed(const uint8_t *data, size_t size) {
    static const well_model model = {.channels = 2, .window = 4, .classes = 2};
    if (size == 0) return;
    app by = {.title = "fuzz", .warnings = app_warnings_create()};
    (void)fuzz_file(data + 1, size - 1);
    take_feed(&by, &model, data[0]);
    app_warnings_destroy(by.warnings);
}
