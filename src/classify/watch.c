/* A feed of samples cut into windows that a judge sees one by one, with votes over the last of them. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/judge.h"

/* Slot s % window of the ring holds sample s; all arrays lie behind the structure in the caller's memory. */
struct lg_watch {
    uint32_t channels, window, hop, bridge;
    uint32_t most_missing; /* in a window that is judged */
    uint32_t votes, votes_of;
    lg_watch_judge judge;
    void *user;
    uint64_t samples; /* pushed so far */
    uint64_t windows; /* complete so far */
    uint64_t gap;     /* samples lost since the last received one */
    bool received;    /* any sample */
    uint32_t slot;    /* of the next sample */
    uint32_t until;   /* samples until the next window is complete */
    uint32_t missing; /* among the last `window` samples */
    uint64_t ballots; /* of the last judged windows, bit 0 the latest */
    uint32_t cast;    /* how many of them there are */
    bool alarm;
    float *ring;   /* (window, channels) */
    float *x;      /* (channels, window) for the judge */
    float *last;   /* (channels) the last received sample; zeros before the first */
    uint8_t *lost; /* (window) */
};

void lg_watch_options_init(lg_watch_options *options) {
    *options = (lg_watch_options){.size = sizeof *options,
                                  .channels = 0,
                                  .window = 0,
                                  .hop = 0,
                                  .bridge = 5,
                                  .missing = 0.1,
                                  .votes = 3,
                                  .votes_of = 5};
}

static lg_status check(const lg_watch_options *o, lg_error *error) {
    if (o == NULL || o->size != sizeof *o)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "options of a watch that lg_watch_options_init did not make");
    if (o->channels == 0 || o->window == 0 || o->channels > (size_t)1 << 31 || o->window > (size_t)1 << 31 ||
        (uint64_t)o->channels * o->window > (uint64_t)1 << 32)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a window of %u channels and %u samples: each must be at least 1, and together at most 2^32",
            o->channels, o->window);
    if (o->hop > o->window)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "windows of %u samples every %u samples: samples between them would go unseen",
                       o->window, o->hop);
    if (!(o->missing >= 0.0 && o->missing <= 1.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the part of a window that may be missing is %g, not in [0, 1]", o->missing);
    if (o->votes_of < 1 || o->votes_of > 64 || o->votes < 1 || o->votes > o->votes_of)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "an alarm at %u of %u windows: the first must be 1 to the second, the second 1 to 64",
                       o->votes, o->votes_of);
    return LG_OK;
}

static size_t padded(size_t bytes) {
    return (bytes + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
}

static size_t floats_of(const lg_watch_options *o) {
    return padded((size_t)o->channels * o->window * sizeof(float));
}

size_t lg_watch_size(const lg_watch_options *options) {
    if (check(options, NULL) != LG_OK) return 0;
    return padded(sizeof(lg_watch)) + 2 * floats_of(options) + padded(options->channels * sizeof(float)) +
           padded(options->window);
}

lg_status lg_watch_init(const lg_watch_options *options, lg_watch_judge judge, void *user, void *memory,
                        lg_watch **out, lg_error *error) {
    LG_TRY(check(options, error));
    if (judge == NULL || memory == NULL || out == NULL || (uintptr_t)memory % LG_ALIGNMENT != 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a watch needs a judge and memory aligned to %d bytes",
                       LG_ALIGNMENT);
    memset(memory, 0, lg_watch_size(options));
    lg_watch *watch = memory;
    char *at = (char *)memory + padded(sizeof *watch);
    watch->channels = options->channels;
    watch->window = options->window;
    watch->hop = options->hop == 0 ? options->window : options->hop;
    watch->bridge = options->bridge;
    /* 0.1 of 300 is 30, whatever the rounding of 0.1 */
    watch->most_missing = (uint32_t)floor(options->missing * options->window * (1.0 + 1e-12));
    watch->votes = options->votes;
    watch->votes_of = options->votes_of;
    watch->judge = judge;
    watch->user = user;
    watch->until = options->window;
    watch->ring = (float *)(void *)at;
    watch->x = (float *)(void *)(at + floats_of(options));
    watch->last = (float *)(void *)(at + 2 * floats_of(options));
    watch->lost = (uint8_t *)(at + 2 * floats_of(options) + padded(options->channels * sizeof(float)));
    *out = watch;
    return LG_OK;
}

/* Sample `back` before the one that goes to `slot`, back <= window. */
static float *before(const lg_watch *watch, uint64_t back) {
    const uint64_t slot = (uint64_t)watch->slot + watch->window - back;
    return &watch->ring[(size_t)(slot % watch->window) * watch->channels];
}

/* The gap that ends with `sample`: a straight line from the last received sample, where that is near enough.
 * A feed that begins with lost samples has them filled with the first received one. What has left the ring
 * was judged before. */
static void fill_gap(lg_watch *watch, const float *sample) {
    const uint64_t gap = watch->gap, inside = gap < watch->window ? gap : watch->window;
    const float *last = watch->received ? watch->last : sample;
    if (watch->received && gap > watch->bridge) return;
    for (uint64_t back = inside; back > 0; back--) {
        const double part = (double)(gap + 1 - back) / (double)(gap + 1);
        float *filled = before(watch, back);
        for (uint32_t c = 0; c < watch->channels; c++)
            filled[c] = (float)((double)last[c] + part * ((double)sample[c] - (double)last[c]));
    }
}

static bool is_finite(const float *sample, uint32_t channels) {
    for (uint32_t c = 0; c < channels; c++)
        if (!isfinite(sample[c])) return false;
    return true;
}

static void store(lg_watch *watch, const float *sample) {
    const bool lost = sample == NULL || !is_finite(sample, watch->channels);
    const size_t row = watch->channels * sizeof *sample;
    if (lost) {
        watch->gap++;
    } else {
        if (watch->gap > 0) fill_gap(watch, sample);
        memcpy(watch->last, sample, row);
        watch->gap = 0;
        watch->received = true;
    }
    memcpy(&watch->ring[(size_t)watch->slot * watch->channels], watch->last, row);
    watch->missing += lost;
    watch->missing -= watch->lost[watch->slot];
    watch->lost[watch->slot] = lost;
    watch->slot = watch->slot + 1 == watch->window ? 0 : watch->slot + 1;
    watch->samples++;
}

/* x (channels, window), oldest first. `slot` is the oldest: the ring is full. */
static void copy_window(lg_watch *watch) {
    const uint32_t channels = watch->channels, window = watch->window;
    for (uint32_t i = 0; i < window; i++) {
        const uint32_t slot = i < window - watch->slot ? watch->slot + i : watch->slot + i - window;
        const float *sample = &watch->ring[(size_t)slot * channels];
        for (uint32_t c = 0; c < channels; c++) watch->x[(size_t)c * window + i] = sample[c];
    }
}

static uint32_t bits_of(uint64_t bits) {
    uint32_t count = 0;
    for (; bits != 0; bits &= bits - 1) count++;
    return count;
}

static void vote(lg_watch *watch, bool positive) {
    const uint64_t kept = watch->votes_of == 64 ? UINT64_MAX : ((uint64_t)1 << watch->votes_of) - 1;
    watch->ballots = (watch->ballots << 1 | positive) & kept;
    if (watch->cast < watch->votes_of) watch->cast++;
    watch->alarm = bits_of(watch->ballots) >= watch->votes;
}

lg_status lg_watch_push(lg_watch *watch, const float *sample, bool *ready, lg_verdict *verdict) {
    store(watch, sample);
    if (--watch->until > 0) {
        *ready = false;
        return LG_OK;
    }
    watch->until = watch->hop;
    lg_verdict v = {.window = watch->windows++,
                    .first_sample = watch->samples - watch->window,
                    .judged = watch->received && watch->missing <= watch->most_missing,
                    .missing = watch->missing};
    if (v.judged) {
        copy_window(watch);
        LG_TRY(watch->judge(watch->user, watch->x, &v.positive, &v.score));
        vote(watch, v.positive);
    }
    v.positive_votes = bits_of(watch->ballots);
    v.votes = watch->cast;
    v.alarm = watch->alarm;
    *verdict = v;
    *ready = true;
    return LG_OK;
}
