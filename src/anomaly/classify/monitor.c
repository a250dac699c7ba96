/* Cuts a feed of samples into windows, passes each window to a scorer, and counts the votes of the last
 * windows. */
#include <math.h>
#include <string.h>

#include "anomaly/judge.h"
#include "core/portions.h"
#include "kernels/kernels.h"
#include "liegrad/anomaly.h"

/* Sample number s of the feed is in slot s % window of the ring. All arrays are behind the structure in the
 * caller's memory. */
struct lg_monitor {
    uint32_t channels, window, hop, bridge;
    uint32_t most_missing; /* largest number of missing samples in a window that is scored */
    uint32_t votes, votes_of;
    lg_monitor_scorer scorer;
    void *user;
    uint64_t samples; /* number of samples pushed so far */
    uint64_t windows; /* number of complete windows so far */
    uint64_t gap;     /* number of samples lost since the last received one */
    bool received;    /* whether any sample has been received */
    uint32_t slot;    /* slot of the next sample */
    uint32_t until;   /* number of samples until the next window is complete */
    uint32_t missing; /* number of lost samples among the last `window` samples */
    /* Votes of the last scored windows that were not novel, one bit each; bit 0 is the latest. */
    uint64_t ballots;
    /* Whether the last scored windows were novel, one bit each; bit 0 is the latest. */
    uint64_t novels;
    uint32_t cast; /* number of valid bits in `ballots` */
    bool alarm, novel;
    float *ring;   /* (window, channels) */
    float *x;      /* (channels, window): the window for the scorer */
    float *last;   /* (channels): last received sample; zeros before the first one */
    uint8_t *lost; /* (window): whether the sample in the slot was lost */
};

void lg_monitor_options_init(lg_monitor_options *options) {
    *options =
        (lg_monitor_options){.size = sizeof *options, .bridge = 5, .missing = 0.1, .votes = 3, .votes_of = 5};
}

static lg_status check(const lg_monitor_options *o, lg_error *error) {
    if (o == NULL || o->size != sizeof *o)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the options of the monitor were not initialised with lg_monitor_options_init");
    if (o->channels == 0 || o->window == 0 || o->channels > (size_t)1 << 31 || o->window > (size_t)1 << 31 ||
        (uint64_t)o->channels * o->window > (uint64_t)1 << 32)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a window of %u channels and %u samples: each must be at least 1, and together at most 2^32",
            o->channels, o->window);
    if (o->hop > o->window)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "windows of %u samples, one every %u samples: samples between the windows would not be seen",
            o->window, o->hop);
    if (!(o->missing >= 0.0 && o->missing <= 1.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the part of a window that may be missing is %g, expected a number in [0, 1]",
                       o->missing);
    if (o->votes_of < 1 || o->votes_of > 64 || o->votes < 1 || o->votes > o->votes_of)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "an alarm at %u of the last %u windows is not possible: the second number must be 1 "
                       "to 64, and the first 1 to the second",
                       o->votes, o->votes_of);
    return LG_OK;
}

/* Places the monitor and then its arrays, whose addresses go to *arrays; returns the monitor. */
static lg_monitor *place(const lg_monitor_options *o, lg_portions *from, lg_monitor *arrays) {
    lg_monitor *monitor = lg_portion(from, 1, sizeof *monitor);
    arrays->ring = lg_portion(from, (size_t)o->channels * o->window, sizeof(float));
    arrays->x = lg_portion(from, (size_t)o->channels * o->window, sizeof(float));
    arrays->last = lg_portion(from, o->channels, sizeof(float));
    arrays->lost = lg_portion(from, o->window, 1);
    return monitor;
}

size_t lg_monitor_size(const lg_monitor_options *options) {
    lg_portions from = {NULL, 0};
    lg_monitor arrays;
    if (check(options, NULL) != LG_OK) return 0;
    (void)place(options, &from, &arrays);
    return from.used;
}

lg_status lg_monitor_init(const lg_monitor_options *options, lg_monitor_scorer scorer, void *user,
                          lg_monitor **out, void *memory, size_t size, lg_error *error) {
    LG_TRY(check(options, error));
    LG_NEEDS(error, scorer, out);
    const size_t needed = lg_monitor_size(options);
    LG_TRY(lg_portions_check(memory, size, needed, error));
    memset(memory, 0, needed);
    lg_portions from = {memory, 0};
    lg_monitor arrays = {.channels = options->channels}, *monitor = place(options, &from, &arrays);
    *monitor = arrays;
    monitor->window = options->window;
    monitor->hop = options->hop == 0 ? options->window : options->hop;
    monitor->bridge = options->bridge;
    /* The factor compensates the rounding of numbers such as 0.1, so that 0.1 of 300 samples is 30. */
    monitor->most_missing = (uint32_t)floor(options->missing * options->window * (1.0 + 1e-12));
    monitor->votes = options->votes;
    monitor->votes_of = options->votes_of;
    monitor->scorer = scorer;
    monitor->user = user;
    monitor->until = options->window;
    *out = monitor;
    return LG_OK;
}

/* Returns the sample that is `back` samples older than the one that will go to `slot`; back <= window. */
static float *before(const lg_monitor *monitor, uint64_t back) {
    const uint64_t slot = (uint64_t)monitor->slot + monitor->window - back;
    return &monitor->ring[(size_t)(slot % monitor->window) * monitor->channels];
}

/* Fills the gap before the received `sample`. A gap of at most `bridge` samples is filled by a straight line
 * from the last received sample. A gap at the beginning of the feed, of any length, is filled with `sample`.
 * Only the part of the gap that is still in the ring is filled. */
static void fill_gap(lg_monitor *monitor, const float *sample) {
    const uint64_t gap = monitor->gap, inside = gap < monitor->window ? gap : monitor->window;
    const float *last = monitor->received ? monitor->last : sample;
    if (monitor->received && gap > monitor->bridge) return;
    for (uint64_t back = inside; back > 0; back--) {
        const double part = (double)(gap + 1 - back) / (double)(gap + 1);
        float *filled = before(monitor, back);
        for (uint32_t c = 0; c < monitor->channels; c++)
            filled[c] = (float)((double)last[c] + part * ((double)sample[c] - (double)last[c]));
    }
}

static void store(lg_monitor *monitor, const float *sample) {
    const bool lost = sample == NULL || !lg_kernels_for(LG_F32)->all_finite(monitor->channels, sample);
    const size_t row = monitor->channels * sizeof *sample;
    if (lost) {
        monitor->gap++;
    } else {
        if (monitor->gap > 0) fill_gap(monitor, sample);
        memcpy(monitor->last, sample, row);
        monitor->gap = 0;
        monitor->received = true;
    }
    memcpy(&monitor->ring[(size_t)monitor->slot * monitor->channels], monitor->last, row);
    monitor->missing += lost;
    monitor->missing -= monitor->lost[monitor->slot];
    monitor->lost[monitor->slot] = lost;
    monitor->slot = monitor->slot + 1 == monitor->window ? 0 : monitor->slot + 1;
    monitor->samples++;
}

/* Copies the ring to x (channels, window), oldest sample first. The ring is full, so `slot` holds the oldest
 * sample. */
static void copy_window(lg_monitor *monitor) {
    const uint32_t channels = monitor->channels, window = monitor->window;
    for (uint32_t i = 0; i < window; i++) {
        const uint32_t slot = i < window - monitor->slot ? monitor->slot + i : monitor->slot + i - window;
        const float *sample = &monitor->ring[(size_t)slot * channels];
        for (uint32_t c = 0; c < channels; c++) monitor->x[(size_t)c * window + i] = sample[c];
    }
}

static void vote(lg_monitor *monitor, lg_answer answer) {
    const uint32_t of = monitor->votes_of;
    const bool novel = answer == LG_ANSWER_NOVEL, positive = answer == LG_ANSWER_POSITIVE;
    monitor->novel = lg_cast_vote(&monitor->novels, of, novel) >= monitor->votes;
    if (novel) return;
    monitor->alarm = lg_cast_vote(&monitor->ballots, of, positive) >= monitor->votes;
    if (monitor->cast < of) monitor->cast++;
}

lg_status lg_monitor_push(lg_monitor *monitor, const float *sample, bool *ready, lg_verdict *verdict) {
    LG_NEEDS(NULL, monitor, ready, verdict);
    store(monitor, sample);
    if (--monitor->until > 0) {
        *ready = false;
        return LG_OK;
    }
    monitor->until = monitor->hop;
    lg_verdict v = {.window = monitor->windows++,
                    .first_sample = monitor->samples - monitor->window,
                    .scored = monitor->received && monitor->missing <= monitor->most_missing,
                    .missing = monitor->missing};
    if (v.scored) {
        copy_window(monitor);
        LG_TRY(monitor->scorer(monitor->user, monitor->x, monitor->missing, &v.answer, &v.score));
        vote(monitor, v.answer);
    }
    v.positive_votes = (uint32_t)__builtin_popcountll(monitor->ballots);
    v.votes = monitor->cast;
    v.novel_votes = (uint32_t)__builtin_popcountll(monitor->novels);
    v.alarm = monitor->alarm;
    v.novel = monitor->novel;
    *verdict = v;
    *ready = true;
    return LG_OK;
}
