/* Finds the place of each sample in the feed: the clock, times that are wrong or jump, and the feed's own
 * rate. */
#include "lg-anomaly/watch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    TOLD = 5,              /* number of malformed lines that are reported one by one */
    MANY_MALFORMED = 20,   /* so many malformed lines in a row: the expected layout is reported */
    LONGEST_GAP = 7 * DAY, /* s */
    LEAST_TIMES = 12,      /* least number of first times that are collected to measure the feed's interval */
    LEAST_DIFFERENCES = 10, /* with fewer differences of these times nothing is measured */
    BELIEVED = 4,           /* number of waiting samples in a line that confirm a jump of the time */
    NEAR = 10               /* largest distance between samples in a line, in intervals of the feed */
};
/* Largest relative difference between the feed's rate and the expected rate. */
static const double rate_tolerance = 0.01;
/* The clock is corrected by this fraction of the difference between a sample's time and the expected time.
 * The clock thus follows a sampling rate that is slightly wrong, and averages jitter. */
static const double clock_gain = 0.05;
/* A difference below this fraction of the sampling interval is only rounding; the clock then takes the
 * sample's time. */
static const double clock_exact = 1e-3;

/* ---- the clock ---- */

static void set_clock(watching *self, double time) {
    self->now = self->origin = time;
    self->since = 0;
}

static void tick(watching *self) {
    self->since++;
    self->now = self->origin + (double)self->since / self->rate;
}

static void lose(watching *self, uint64_t count) {
    self->in_gap = true;
    for (uint64_t i = 0; i < count && !app_interrupted(); i++) {
        tick(self);
        watch_push(self, NULL);
    }
    self->in_gap = false;
    watch_end_gap(self);
}

/* Number of samples from one time to another. */
static double steps_between(const watching *self, double from, double to) {
    return floor((to - from) * self->rate + 0.5);
}

/* Sets the clock to `time`. One whole window is lost, so that no window has samples from before and after. */
static void lose_window(watching *self, double time) {
    const uint64_t window = self->bench.model->window;
    self->tally.absent += window;
    set_clock(self, time - (double)(window + 1) / self->rate);
    lose(self, window);
    set_clock(self, time);
}

/* Advances the clock to a sample with a time, and pushes the missing samples before it. False: the sample
 * repeats an earlier one. */
static bool advance(watching *self, double time) {
    const double steps = steps_between(self, self->now, time);
    if (steps > LONGEST_GAP * self->rate || steps < -(double)self->bench.model->window) {
        /* The feed's clock was set, or the gap is too long to be filled. */
        app_warn(self->app, "the time goes from %.15g s to %.15g s: the feed restarts there", self->now,
                 time);
        lose_window(self, time);
        return true;
    }
    if (steps < 1) {
        self->tally.repeated++;
        return false;
    }
    self->tally.absent += (uint64_t)steps - 1;
    if (steps > 1) lose(self, (uint64_t)steps - 1);
    tick(self);
    const double off = time - self->now;
    if (self->timing.follow)
        set_clock(self, fabs(off) * self->rate < clock_exact ? time : self->now + clock_gain * off);
    return true;
}

static void push_received(watching *self, const float *sample) {
    bool whole = true;
    for (uint32_t c = 0; c < self->channels; c++) whole = whole && isfinite(sample[c]);
    *(whole ? &self->tally.received : &self->tally.not_finite) += 1;
    watch_push(self, sample);
}

/* Pushes a sample whose time is accepted. */
static void accept(watching *self, const float *sample, double time) {
    if (!self->started || !self->rate_known)
        set_clock(self, time);
    else if (!advance(self, time))
        return;
    self->started = true;
    push_received(self, sample);
}

static void count_malformed(watching *self, uint64_t line, const char *problem, bool lost) {
    if (self->tally.malformed++ >= TOLD) return;
    app_warn(self->app, "line %llu: %s; %s%s", (unsigned long long)line, problem,
             lost ? "taken as a lost sample" : "left out",
             self->tally.malformed == TOLD ? " (more such lines are only counted)" : "");
}

/* ---- times that jump ----
 *
 * A sample whose time does not follow the clock waits. A line is a series of samples, each at most NEAR usual
 * intervals after the one before it. When BELIEVED waiting samples form a line, their times are accepted and
 * the clock jumps there. If a sample follows the clock before that, the times of the waiting samples are
 * wrong, and these samples are malformed. */

static void keep(const watching *self, held_sample *to, const float *sample, double time, uint64_t line) {
    to->time = time;
    to->line = line;
    memcpy(to->values, sample, self->channels * sizeof *sample);
}

static bool in_line(const watching *self, double from, double to) {
    const double steps = steps_between(self, from, to);
    return steps >= 1 && steps <= NEAR * self->timing.usual;
}

/* Index of the first sample of the line that ends with held sample `last` - 1. */
static uint32_t line_before(const watching *self, uint32_t last) {
    uint32_t first = last - 1;
    while (first > 0 && in_line(self, self->timing.held[first - 1].time, self->timing.held[first].time))
        first--;
    return first;
}

static void reject_held(watching *self, uint32_t i) {
    char problem[96];
    (void)snprintf(problem, sizeof problem, "the time %.15g s does not fit the lines around it",
                   self->timing.held[i].time);
    count_malformed(self, self->timing.held[i].line, problem, false);
}

/* Accepts or rejects all held samples. The samples first..last-1 form a line and are accepted. Then, from the
 * latest to the earliest, a line of two or more samples before them is accepted if it fits between the clock
 * and the accepted sample after it; a single sample must also be near that accepted sample. */
static void settle(watching *self, uint32_t first, uint32_t last) {
    timing *t = &self->timing;
    bool fits[HELD] = {false};
    double next = t->held[first].time;
    for (uint32_t i = first; i < last; i++) fits[i] = true;
    for (uint32_t end = first; end > 0;) {
        const uint32_t begin = line_before(self, end);
        const bool between = steps_between(self, t->held[end - 1].time, next) >= 1 &&
                             (!self->started || steps_between(self, self->now, t->held[begin].time) >= 1);
        if (between && (end - begin >= 2 || in_line(self, t->held[begin].time, next))) {
            for (uint32_t i = begin; i < end; i++) fits[i] = true;
            next = t->held[begin].time;
        }
        end = begin;
    }
    for (uint32_t i = 0; i < t->holds; i++)
        if (fits[i])
            accept(self, t->held[i].values, t->held[i].time);
        else
            reject_held(self, i);
    t->holds = 0;
}

/* Called when the feed has ended or no more samples can wait. Accepts the latest line of at least two
 * samples. Without such a line, it accepts at the end a first sample that follows the clock; otherwise it
 * rejects the oldest waiting sample. */
static void settle_held(watching *self, bool at_end) {
    timing *t = &self->timing;
    for (uint32_t last = t->holds; last > 1; last--) {
        const uint32_t first = line_before(self, last);
        if (last - first < 2) continue;
        settle(self, first, last);
        return;
    }
    if (at_end) {
        const bool fits = t->holds > 0 && (!self->started || in_line(self, self->now, t->held[0].time));
        settle(self, 0, fits ? 1 : 0);
        return;
    }
    reject_held(self, 0);
    const held_sample rejected = t->held[0];
    t->holds--;
    memmove(t->held, t->held + 1, t->holds * sizeof *t->held);
    t->held[t->holds] = rejected; /* its memory is free again */
}

static void hold(watching *self, const float *sample, double time, uint64_t line) {
    timing *t = &self->timing;
    if (t->holds > 0) {
        const double last = t->held[t->holds - 1].time;
        if (steps_between(self, last, time) == 0) { /* it repeats the last waiting sample */
            self->tally.repeated++;
            return;
        }
        const double steps = self->started ? steps_between(self, self->now, time) : 0;
        if (!in_line(self, last, time) && steps >= 1 && steps <= (t->holds + 1) * t->usual) {
            settle(self, 0, 0);
            accept(self, sample, time);
            return;
        }
    }
    if (t->holds == HELD) settle_held(self, false);
    keep(self, &t->held[t->holds++], sample, time, line);
    const uint32_t first = line_before(self, t->holds);
    if (t->holds - first >= BELIEVED) settle(self, first, t->holds);
}

static void take_timed(watching *self, const float *sample, double time, uint64_t line) {
    timing *t = &self->timing;
    const double steps = self->started ? steps_between(self, self->now, time) : -1;
    if (!self->rate_known || (t->holds == 0 && steps >= 0 && steps <= t->usual))
        accept(self, sample, time);
    else
        hold(self, sample, time, line);
}

/* ---- the feed's own rate ---- */

/* The name of the column of times, or its number. */
static const char *time_name(const sample_reader *reader) {
    return reader->time > 0 ? reader->frame.name[reader->time - 1] : "1";
}

/* The mean of the differences that are near the median, so that gaps, wrong times and rounded times do not
 * disturb it. *blur: bound on its relative error. False: there are too few differences. */
static bool measure_interval(const timing *t, double *interval, double *blur) {
    double difference[FIRST_TIMES], sum = 0, lowest = INFINITY, highest = 0;
    uint32_t count = 0, near = 0;
    for (uint32_t i = 1; i < t->firsts; i++) {
        const double d = t->first[i].time - t->first[i - 1].time;
        if (d > 0 && isfinite(d)) difference[count++] = d;
    }
    if (count < LEAST_DIFFERENCES) return false;
    qsort(difference, count, sizeof *difference, lg_compare_doubles);
    const double median = difference[count / 2];
    for (uint32_t i = 0; i < count; i++) {
        if (difference[i] < 0.5 * median || difference[i] > 1.5 * median) continue;
        lowest = fmin(lowest, difference[i]);
        highest = fmax(highest, difference[i]);
        sum += difference[i];
        near++;
    }
    *interval = sum / near;
    /* Differences that follow each other add up to last time - first time; each of the two is wrong by at
     * most half of (highest - lowest). */
    *blur = (highest - lowest) / sum;
    return true;
}

/* Measures the feed's rate. False: it differs from the expected rate, and --rate is not given. */
static bool check_rate(watching *self) {
    timing *t = &self->timing;
    double interval, blur;
    char guess[200] = "";
    if (!self->rate_known || !measure_interval(t, &interval, &blur)) return true;
    const double steps = interval * self->rate;
    if (fabs(steps - 1) <= rate_tolerance + blur) return true;
    if (!app_given(self->app, "rate")) {
        self->refused = true;
        if (self->reader->guessed)
            (void)snprintf(guess, sizeof guess,
                           "column %s comes first and increases, so it is taken as the time; if it is no "
                           "time, move it behind the channels: ",
                           time_name(self->reader));
        (void)app_fail(
            self->app, LG_FILE,
            "%sthe times of the feed give %.4g samples per second, the model was trained at %.4g: resample "
            "the feed, or force it with --rate %.4g (windows of the same number of samples, so shorter or "
            "longer)",
            guess, 1 / interval, self->rate, 1 / interval);
        return false;
    }
    app_warn(self->app, "the times of the feed give %.4g samples per second; the grid of --rate %.4g is used",
             1 / interval, self->rate);
    t->follow = false;
    t->usual = fmax(1, ceil(steps - rate_tolerance));
    return true;
}

/* Checks the column of times. It holds times if at least half of the first values increase and at most a
 * quarter decrease. Returns false if it holds no times, or times of another rate. */
static bool check_times(watching *self) {
    sample_reader *reader = self->reader;
    timing *t = &self->timing;
    uint32_t rises = 1, falls = 0;
    t->measured = true;
    for (uint32_t i = 1; i < t->firsts; i++) {
        rises += t->first[i].time > t->first[i - 1].time;
        falls += t->first[i].time < t->first[i - 1].time;
    }
    if (t->firsts < LEAST_TIMES || (2 * rises >= t->firsts && 4 * falls <= t->firsts))
        return check_rate(self);
    self->refused = !reader->guessed;
    if (self->refused) {
        (void)app_fail(self->app, LG_FILE, "column %s should be the time, but it does not increase",
                       time_name(reader));
        return false;
    }
    app_warn(self->app,
             "column %s is left out: it is not a channel of the model, and not the time, as it does not "
             "increase",
             time_name(reader));
    sample_leave_times(reader);
    for (uint32_t i = 0; i < t->firsts; i++) t->first[i].time = NAN;
    return true;
}

static void take_untimed(watching *self, const float *sample) {
    if (self->started) tick(self);
    self->started = true;
    push_received(self, sample);
}

static void release_first(watching *self) {
    timing *t = &self->timing;
    const bool right = t->measured || check_times(self);
    for (uint32_t i = 0; right && i < t->firsts; i++)
        if (isnan(t->first[i].time))
            take_untimed(self, t->first[i].values);
        else
            take_timed(self, t->first[i].values, t->first[i].time, t->first[i].line);
    t->firsts = 0;
}

void watch_take(watching *self, const float *sample, double time, uint64_t line) {
    timing *t = &self->timing;
    if (!isfinite(time)) {
        take_untimed(self, sample);
    } else if (t->measured) {
        take_timed(self, sample, time, line);
    } else {
        keep(self, &t->first[t->firsts], sample, time, line);
        if (++t->firsts == t->wanted) release_first(self);
    }
}

/* A line that could not be read counts as a lost sample in a feed without times, unless it comes before the
 * first sample. In a feed with times, the other times show which samples are missing. */
void watch_take_malformed(watching *self, const float *sample, double time) {
    const sample_reader *reader = self->reader;
    if (!self->rate_known && self->timing.firsts > 0) release_first(self);
    const bool timed = reader->layout == LAYOUT_TIMED && self->rate_known;
    const bool lost = timed ? isfinite(time) : self->started;
    count_malformed(self, reader->line, reader->problem, lost);
    if (++self->malformed_in_row == MANY_MALFORMED)
        app_warn(self->app,
                 "line %llu: %d lines in a row could not be read; expected are %s%u number%s a line%s",
                 (unsigned long long)reader->line, MANY_MALFORMED,
                 reader->layout == LAYOUT_TIMED ? "a time and " : "", reader->channels,
                 reader->channels == 1 ? "" : "s",
                 reader->layout == LAYOUT_UNKNOWN ? ", after a time or without" : "");
    if (timed && isfinite(time))
        watch_take(self, sample, time, reader->line);
    else if (!timed && self->started)
        lose(self, 1);
}

/* ---- beginning and end ---- */

void watch_time_open(watching *self) {
    timing *t = &self->timing;
    const uint32_t window = self->bench.model->window;
    *t = (timing){.usual = 1, .follow = true};
    t->wanted = window > FIRST_TIMES ? FIRST_TIMES : window < LEAST_TIMES ? LEAST_TIMES : window;
    float *values = app_keep((size_t)(FIRST_TIMES + HELD) * self->channels, sizeof *values);
    for (uint32_t i = 0; i < FIRST_TIMES + HELD; i++, values += self->channels)
        (i < HELD ? &t->held[i] : &t->first[i - HELD])->values = values;
}

void watch_settle(watching *self) {
    release_first(self);
    if (!self->refused) settle_held(self, true);
}

void watch_restart(watching *self) {
    watch_settle(self);
    self->timing.measured = false;
    if (self->started) lose_window(self, self->now + 1 / self->rate);
    self->started = false; /* the next time, if there are times, sets the clock */
}
