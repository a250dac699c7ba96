/* lg-anomaly watch: judges a feed window by window, in fixed memory. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "anomaly/novelty_internal.h"
#include "lg-anomaly/watch.h"

enum {
    TOLD_NOT_JUDGED = 3, /* number of windows of a gap that are printed one by one */
    NOISE_WINDOWS = 10,  /* number of windows from which the level of noise is measured */
    REASON = 256         /* bytes */
};
/* SAME_NOISE: amplitudes whose ratio is below this have the same level of noise. UNEXPLAINED: ratio of
 * standard deviations that a few filled-in samples cannot explain. */
static const double SAME_NOISE = 1.5, UNEXPLAINED = 2;

typedef struct watch_values {
    const char *input, *log;
    char healthy[LG_SERIES_NAME];
    bool quiet;
    lg_wholes votes;
    double hop, bridge, missing, rate, crack_at, unlike;
} watch_values;

static const lg_field watch_options[] = {
    LG_OPTION(watch_values, input, STRING, "FILE", "File of samples (default: standard input)",
              .file = LG_FILE_READ),
    HEALTHY(watch_values),
    VOTES(watch_values, "K[,N]", "are not of the healthy class", .most = 2, .value = "3,5"),
    LG_OPTION(watch_values, hop, REAL, "SECONDS", "Distance from one window to the next", LG_POSITIVE,
              .otherwise = "the window"),
    LG_OPTION(watch_values, bridge, REAL, "S", "Gaps of at most S seconds are filled by straight lines",
              .high = 1e9, .value = "1"),
    LG_OPTION(watch_values, missing, REAL, "P",
              "Windows with a larger fraction of missing samples are not scored", .high = 1, .value = "0.1"),
    LG_OPTION(watch_values, rate, REAL, "HZ",
              "Sampling rate of the feed, whatever its times say (default: the model's)", LG_POSITIVE),
    LG_OPTION(watch_values, unlike, REAL, "F",
              "Windows whose distance from those of training is above F are unlike anything seen and get no "
              "class (default 1; 0: every window gets one)",
              .high = 1e12),
    CRACK_AT(watch_values, "T",
             "Time at which the damage began, in seconds of the feed (`feed --crack-at` takes hours), "
             "for trials with a known truth",
             LG_ANY_REAL),
    LG_OPTION(watch_values, log, STRING, "FILE",
              "Append the results to FILE instead of printing them; SIGHUP opens it again (log rotation)",
              .file = LG_FILE_STREAMED),
    LG_OPTION(watch_values, quiet, SWITCH, NULL, "Print changes of the alarm only"),
    LG_FIELD_END};

static watch_values values = {.hop = NAN, .rate = NAN, .crack_at = NAN, .unlike = 1};

/* The number N of windows that vote. */
static uint32_t voters(void) {
    enum { USUAL = 5 };
    return values.votes.count > 1 ? values.votes.values[1] : USUAL;
}

/* Returns whether the window is unlike the training windows. A sensor that stands still or is cut off makes
 * any window unlike. So does a distance beyond `farthest`, but only for a classifier, whose class then means
 * nothing; for a novelty model the distance is the answer itself. Filling missing samples by straight lines
 * changes the spectrum. So with missing samples the standard deviation must differ as well. */
static bool is_unlike(const bench *b, uint32_t missing) {
    const lg_novelty_result *r = &b->novelty;
    if (!isfinite(b->farthest)) return false;
    if (r->cause == LG_NOVELTY_STILL || r->cause == LG_NOVELTY_EXTREME) return true;
    if (b->model->sort == WELL_NOVELTY || r->distance <= b->farthest) return false;
    return missing == 0 || !(fabs(log(r->deviation)) < log(UNEXPLAINED));
}

static lg_status judge(void *user, const float *x, uint32_t missing, lg_answer *answer, double *score) {
    bench *b = user;
    LG_TRY(b->by.score(b->by.model, x, b->score, NULL, b->work));
    b->given = lg_metrics_class(b->score, b->by.classes);
    *score = well_model_alarm(&b->by, b->score);
    *answer = b->given != b->by.healthy ? LG_ANSWER_POSITIVE : LG_ANSWER_NEGATIVE;
    if (b->novelty_work != NULL) lg_novelty_eval(b->usual, x, &b->novelty, b->features, b->novelty_work);
    if (b->novelty_work != NULL && is_unlike(b, missing)) *answer = LG_ANSWER_NOVEL;
    return isnan(*score) && *answer != LG_ANSWER_NOVEL ? LG_NOT_FINITE : LG_OK;
}

/* ---- sensors that send no numbers ---- */

static uint32_t most_silent(const watching *self) {
    uint32_t most = 0;
    for (uint32_t c = 1; c < self->channels; c++)
        if (self->silence.without[c] > self->silence.without[most]) most = c;
    return most;
}

/* A window that was not judged because a channel sends no numbers also counts as unlike the training
 * windows. */
static void blame_silence(watching *self, lg_verdict *v) {
    silence *s = &self->silence;
    const bool silent =
        !v->scored && isfinite(self->bench.farthest) && 2 * s->without[most_silent(self)] > s->samples;
    const uint32_t votes = lg_cast_vote(&s->windows, voters(), silent);
    if (silent) v->answer = LG_ANSWER_NOVEL;
    if (votes > v->novel_votes) v->novel_votes = votes;
    v->novel = v->novel || votes >= values.votes.values[0];
}

static void tell_silence(const watching *self, char text[REASON]) {
    const uint32_t c = most_silent(self);
    char channel[NOVELTY_NAME];
    lg_novelty_channel(self->bench.names->channel_name, c, channel);
    (void)snprintf(text, REASON, "%s: no number in %llu of %llu samples", channel,
                   (unsigned long long)self->silence.without[c], (unsigned long long)self->silence.samples);
}

/* Says why the window is unlike the training windows, or why a novelty model votes for an alarm. Otherwise
 * "". */
static const char *reason_of(const watching *self, const lg_verdict *v, char text[REASON]) {
    const bench *b = &self->bench;
    const bool alone = b->model->sort == WELL_NOVELTY && v->answer == LG_ANSWER_POSITIVE;
    text[0] = '\0';
    if (!v->scored && v->answer == LG_ANSWER_NOVEL)
        tell_silence(self, text);
    else if (v->scored && (v->answer == LG_ANSWER_NOVEL || alone))
        (void)lg_novelty_explain(b->usual, &b->novelty, b->names->channel_name, b->names->rate, text, REASON);
    return text;
}

static const char *class_name(const watching *self, const lg_verdict *v) {
    if (v->answer == LG_ANSWER_NOVEL) return "unlike";
    return v->scored ? self->bench.names->class_name[self->bench.given] : NULL;
}

/* ---- the level of noise ---- */

static void warn_of_noise(const watching *self) {
    const lg_series *names = self->bench.names;
    const noise_level *noise = &self->noise;
    const double rate = names->rate > 0 ? names->rate : 1;
    uint32_t more = 0, less = 0, most = 0;
    for (uint32_t c = 0; c < names->channels; c++) {
        const double change = noise->sum[c] / noise->windows;
        more += change > log(SAME_NOISE);
        less += change < -log(SAME_NOISE);
        if (fabs(noise->sum[c]) > fabs(noise->sum[most])) most = c;
    }
    if (2 * more <= names->channels && 2 * less <= names->channels) return;
    app_warn(self->app,
             "the noise of the feed differs from the noise in training: %u of %u channels have %s amplitude "
             "above %.3g %s, channel %u %.3g times the usual one; a model that was trained at another level "
             "of noise misses damage",
             more > less ? more : less, names->channels, more > less ? "more" : "less",
             lg_novelty_noise_from(self->bench.usual) * rate, names->rate > 0 ? "Hz" : "cycles a sample",
             most + 1, exp(noise->sum[most] / noise->windows));
}

/* Measures the level of noise in the first windows without missing samples and with all sensors alive. */
static void listen(watching *self, uint32_t missing) {
    const bench *b = &self->bench;
    noise_level *noise = &self->noise;
    const lg_novelty_cause cause = b->novelty.cause;
    if (b->novelty_work == NULL || b->usual->bands == 0 || noise->windows >= NOISE_WINDOWS) return;
    if (missing > 0 || cause == LG_NOVELTY_STILL || cause == LG_NOVELTY_NONE) return;
    double *ratio = b->novelty_work; /* this memory is free until the next window is judged */
    lg_novelty_noise(b->usual, b->novelty.nearest, b->features, ratio);
    for (uint32_t c = 0; c < b->names->channels; c++) noise->sum[c] += log(ratio[c]);
    if (++noise->windows == NOISE_WINDOWS) warn_of_noise(self);
}

/* ---- verdicts ---- */

/* Prints a JSON object on its own line of the log. */
static void print_object(const watching *self, const lg_result *members) {
    app_json json = {.stream = self->log.stream};
    app_json_object(&json, NULL, members);
    (void)fputc('\n', json.stream);
}

static void print_json_verdict(const watching *self, const lg_verdict *v) {
    char text[REASON];
    const char *reason = reason_of(self, v, text);
    const bool unlike = v->answer == LG_ANSWER_NOVEL, measured = self->bench.novelty_work != NULL;
    print_object(
        self, LG_RESULTS(LG_AS_REAL("time", self->now), LG_AS_WHOLE("window", v->window),
                         LG_AS_WHOLE("first_sample", v->first_sample), LG_AS_FLAG("judged", v->scored),
                         LG_AS_TEXT("class", class_name(self, v)),
                         LG_AS_REAL("score", v->scored ? v->score : NAN), LG_AS_WHOLE("missing", v->missing),
                         LG_AS_WHOLE("positive_votes", v->positive_votes), LG_AS_WHOLE("votes", v->votes),
                         LG_AS_FLAG("alarm", v->alarm), LG_AS_FLAG("unlike", unlike),
                         LG_AS_REAL("distance", v->scored && measured ? self->bench.novelty.distance : NAN),
                         LG_AS_TEXT("reason", reason[0] != '\0' ? reason : NULL),
                         LG_AS_WHOLE("unlike_votes", v->novel_votes), LG_AS_FLAG("unlike_alarm", v->novel)));
}

/* A log begins with the line of column names, or with --json with an object that begins with json_begin. */
static const char text_begin[] = "# time\tclass\tscore\tvotes\tmissing\talarm\treason\n",
                  json_begin[] = "{\"time\": ";

static void print_verdict(const watching *self, const lg_verdict *v) {
    FILE *out = self->log.stream;
    char text[REASON], time[LG_SHORTEST];
    const char *reason = reason_of(self, v, text), *class = class_name(self, v);
    lg_format_shortest(time, self->now, false);
    if (values.log == NULL && self->tally.windows == 1) (void)fputs(text_begin, out);
    app_put(out, "%s\t%s", time, class != NULL ? class : "-");
    if (v->scored)
        app_put(out, "\t%.6g", v->score);
    else
        app_put(out, "\t-");
    app_put(out, "\t%u/%u\t%u\t%s\t%s\n", v->positive_votes, v->votes, v->missing,
            v->alarm   ? v->novel ? "ALARM,UNLIKE" : "ALARM"
            : v->novel ? "UNLIKE"
                       : "-",
            reason[0] != '\0' ? reason : "-");
}

static void count_verdict(watching *self, const lg_verdict *v) {
    tally *t = &self->tally;
    const bool before = !(self->now > values.crack_at), rises = v->alarm && !self->alarm;
    const bool positive = v->scored && v->answer == LG_ANSWER_POSITIVE;
    t->unlike += v->answer == LG_ANSWER_NOVEL;
    t->unlike_alarms += v->novel && !self->unlike;
    if (v->novel && isnan(t->first_unlike)) t->first_unlike = self->now;
    t->windows++;
    t->judged += v->scored;
    t->positive += positive;
    t->alarms += rises;
    t->judged_before += before && v->scored;
    t->positive_before += before && positive;
    t->alarms_before += before && rises;
    if (rises && isnan(t->first_alarm)) t->first_alarm = self->now;
    /* If an alarm is already on at the crack, the crack is detected by the first window after it that votes
     * for the alarm. A sample stands for the interval after it, so the window ends one interval after
     * `now`. */
    if (!before && positive && v->alarm && isnan(t->detection)) t->detection = self->now + 1 / self->rate;
}

static bool changes(const watching *self, const lg_verdict *v) {
    return v->alarm != self->alarm || v->novel != self->unlike;
}

void watch_end_gap(watching *self) {
    const unsigned long long count =
        self->gap_windows > TOLD_NOT_JUDGED ? self->gap_windows - TOLD_NOT_JUDGED : 0;
    self->gap_windows = 0;
    if (count == 0 || values.quiet) return;
    watch_log_turn(&self->log);
    if (self->app->json) {
        print_object(self,
                     LG_RESULTS(LG_AS_REAL("time", self->now), LG_AS_REAL("first_time", self->gap_first),
                                LG_AS_WHOLE("not_judged", count)));
    } else
        (void)fprintf(self->log.stream, "# not judged: %llu window%s more, the last ends before %.15g s\n",
                      count, count == 1 ? "" : "s", self->now + 1 / self->rate);
    watch_log_put(&self->log);
}

void watch_push(watching *self, const float *sample) {
    lg_verdict v;
    bool ready = false;
    self->silence.samples++;
    for (uint32_t c = 0; sample != NULL && c < self->channels; c++)
        self->silence.without[c] += !isfinite(sample[c]);
    const lg_status status = lg_monitor_push(self->watch, sample, &ready, &v);
    self->tally.samples++;
    if (status != LG_OK) {
        self->tally.windows++;
        if (self->tally.failed++ == 0)
            app_warn(self->app, "the window that ends at %.15g s could not be judged: %s", self->now,
                     lg_status_sentence(status));
        return;
    }
    if (!ready) return;
    blame_silence(self, &v);
    count_verdict(self, &v);
    if (v.scored) listen(self, v.missing);
    /* After the first windows of a gap the others are counted and not printed. */
    const bool left_out =
        self->in_gap && !v.scored && !changes(self, &v) && ++self->gap_windows > TOLD_NOT_JUDGED;
    if (left_out && self->gap_windows == TOLD_NOT_JUDGED + 1) self->gap_first = self->now;
    if (!left_out && (!values.quiet || changes(self, &v))) {
        watch_log_turn(&self->log);
        (self->app->json ? print_json_verdict : print_verdict)(self, &v);
        watch_log_put(&self->log);
    }
    self->alarm = v.alarm;
    self->unlike = v.novel;
    self->silence.samples = 0;
    memset(self->silence.without, 0, self->channels * sizeof *self->silence.without);
}

/* ---- the summary ---- */

static uint64_t max_rss_kb(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) == 0 ? (uint64_t)usage.ru_maxrss : 0;
}

static double a_day(uint64_t count, double days) {
    return days > 0 ? (double)count / days : NAN;
}

/* Adds a number that has a meaning only with --crack-at. */
static void put_known(app_json *out, const char *key, double value, const char *label) {
    if (!isnan(values.crack_at))
        app_result_real(out, key, value, label);
    else
        app_json_real(out, key, NAN);
}

static void print_summary(const watching *self, double seconds, size_t watch_bytes, uint64_t start_rss) {
    const tally *t = &self->tally;
    const double days = (double)t->samples / self->rate / DAY,
                 before = (double)t->judged_before * self->hop / self->rate / DAY;
    app_json *out = self->app->out;
    out->prefix = "# ";
    APP_PUT(out, LG_AS_FLAG("summary", true),
            LG_TEXT("healthy", self->bench.model->file.run.healthy,
                    "windows of other classes vote for the alarm"),
            LG_AS_FLAG("interrupted", app_interrupted()), LG_WHOLE("samples", t->samples, NULL),
            LG_WHOLE("received", t->received, NULL), LG_WHOLE("absent", t->absent, NULL),
            LG_WHOLE("not_finite", t->not_finite, NULL), LG_WHOLE("malformed", t->malformed, NULL),
            LG_WHOLE("repeated", t->repeated, NULL), LG_REAL("days", days, NULL),
            LG_WHOLE("windows", t->windows, NULL), LG_WHOLE("judged", t->judged, NULL),
            LG_WHOLE("positive", t->positive, NULL), LG_AS_WHOLE("failed", t->failed));
    if (isfinite(self->bench.farthest) || !out->people)
        APP_PUT(out, LG_WHOLE("unlike", t->unlike, NULL),
                LG_WHOLE("unlike_alarms", t->unlike_alarms, self->unlike ? "standing" : NULL));
    APP_PUT(out, LG_AS_REAL("first_unlike", t->first_unlike), LG_AS_FLAG("alarm", self->alarm),
            LG_WHOLE("alarms", t->alarms, self->alarm ? "standing" : NULL),
            LG_AS_REAL("first_alarm", t->first_alarm));
    put_known(out, "crack_at", values.crack_at, "s");
    put_known(out, "time_to_detection", t->detection - values.crack_at, "s");
    put_known(out, "false_alarms", (double)t->alarms_before, NULL);
    put_known(out, "false_alarms_per_day", a_day(t->alarms_before, before), NULL);
    put_known(out, "false_positive_windows_per_day", a_day(t->positive_before, before), NULL);
    APP_PUT(out, LG_REAL("seconds", seconds, NULL),
            LG_REAL("samples_per_second", (double)t->samples / seconds, NULL),
            LG_WHOLE("watch_bytes", watch_bytes, NULL), LG_AS_WHOLE("start_rss_kb", start_rss),
            LG_WHOLE("max_rss_kb", max_rss_kb(), NULL));
}

/* ---- the command ---- */

/* Converts seconds into a whole number of samples. False: below `least` or above `most`. */
static bool samples_of(double seconds, double rate, double least, double most, uint32_t *out) {
    const double samples = floor(seconds * rate + 0.5);
    if (!(samples >= least && samples <= most)) return false;
    *out = (uint32_t)samples;
    return true;
}

static void set_options(const app *self, const well_model *model, watching *w, lg_monitor_options *o) {
    const double trained = model->file.names.rate;
    const bool forced = app_given(self, "rate");
    w->rate_known = forced || trained > 0;
    w->rate = forced ? values.rate : trained > 0 ? trained : 1.0;
    if (!w->rate_known)
        app_warn(self, "the model has no sampling rate: options in seconds count samples instead (see "
                       "--rate)");
    if (forced && trained > 0 && fabs(values.rate / trained - 1) > 1e-3)
        app_warn(self, "the model was trained at %.6g Hz, not %.6g Hz", trained, values.rate);
    lg_monitor_options_init(o);
    o->channels = w->channels;
    o->window = model->window;
    o->missing = values.missing;
    o->votes = values.votes.values[0];
    o->votes_of = voters();
    if (o->votes > o->votes_of)
        app_stop_usage(self, "--votes: %u of %u windows: the first number must not be larger than the second",
                       o->votes, o->votes_of);
    if (app_given(self, "hop") && !samples_of(values.hop, w->rate, 1, model->window, &o->hop))
        app_stop_usage(self, "--hop %.6g: expected a time from one sample (%.6g s) to one window (%.6g s)",
                       values.hop, 1 / w->rate, model->window / w->rate);
    if (!samples_of(values.bridge, w->rate, 0, 4e9, &o->bridge))
        app_stop_usage(self, "--bridge %.6g: at most 4e9 samples", values.bridge);
    w->hop = o->hop == 0 ? o->window : o->hop;
}

static const char *feed_name(void) {
    return values.input != NULL ? values.input : "standard input";
}

/* Reads the feed until it ends, a signal comes, or standard output fails, which app_main reports. */
static void read_feed(watching *self, sample_reader *reader, float *sample) {
    while (!app_interrupted() && !self->refused && !ferror(stdout)) {
        double time;
        const sample_kind kind = sample_next(reader, sample, &time);
        if (reader->error.status != LG_OK) app_stop(self->app, LG_FILE, "%s", reader->error.message);
        if (reader->extra.used > 0)
            app_warn(self->app, "%s: columns that are not channels of the model are left out: %s",
                     feed_name(), reader->extra.text);
        reader->extra.used = 0;
        if (reader->renamed && kind != SAMPLE_END) {
            app_warn(self->app,
                     "line %zu: a line of names replaces the columns from here on; the window begins anew",
                     reader->frame.header);
            watch_restart(self);
            reader->renamed = false;
            if (self->refused) break;
        }
        if (kind == SAMPLE_MALFORMED) {
            watch_take_malformed(self, sample, time);
        } else if (kind == SAMPLE_READ) {
            watch_take(self, sample, time, reader->line);
            self->malformed_in_row = 0;
            self->last_read = reader->line;
        } else {
            break;
        }
    }
    watch_settle(self);
    if (self->refused) app_end(APP_EXIT_FILE);
    if (app_interrupted()) return;
    const tally *t = &self->tally;
    const uint64_t read = t->received + t->not_finite + t->repeated, rows = read + t->malformed;
    if (self->last_read > 0 && self->malformed_in_row > 1)
        app_warn(self->app, "after line %llu no line could be read: %llu lines are malformed; the last: %s",
                 (unsigned long long)self->last_read, (unsigned long long)self->malformed_in_row,
                 reader->problem);
    if (reader->line == 0) app_warn(self->app, "%s is empty: there was nothing to watch", feed_name());
    if ((t->malformed > 0 && read == 0) || (reader->layout == LAYOUT_UNKNOWN && reader->line > 0))
        app_stop(self->app, LG_FILE, "%s: no line holds %u numbers, or %u with a time in seconds%s%s",
                 feed_name(), reader->channels, reader->channels + 1,
                 reader->problem[0] != '\0' ? "; the last line that could not be read: " : "",
                 reader->problem);
    if (self->timing.follow && 2 * t->repeated > rows)
        app_stop(self->app, LG_FILE,
                 "%s: %llu of %llu lines are left out, because their times do not go beyond earlier ones",
                 feed_name(), (unsigned long long)t->repeated, (unsigned long long)rows);
}

static void on_idle(void *user) {
    watching *self = user;
    watch_log_turn(&self->log);
}

static void watch_feed(watching *self, int file, size_t watch_bytes) {
    const lg_series *names = self->bench.names;
    APP_FREE float *sample = app_alloc(names->channels, sizeof *sample);
    APP_CLEAN(sample_reader_close) sample_reader reader = {.channels = 0};
    self->reader = &reader;
    watch_time_open(self);
    sample_reader_open(file, feed_name(), names->channels, names->channel_name, &reader);
    reader.idle = on_idle;
    reader.user = self;
    const uint64_t start_rss = max_rss_kb();
    const double start = app_seconds();
    read_feed(self, &reader, sample);
    const double seconds = app_seconds() - start;
    if (!app_interrupted() && self->started && values.crack_at > self->now)
        app_warn(self->app,
                 "--crack-at %.15g s is after the last sample, at %.15g s (seconds here, hours for `feed`)",
                 values.crack_at, self->now);
    if (!app_interrupted() && self->tally.judged > 0 && self->tally.judged_before == 0)
        app_warn(self->app,
                 "--crack-at %.15g s is before the end of the first scored window, so false alarms are not "
                 "known (seconds here, hours for `feed`)",
                 values.crack_at);
    print_summary(self, seconds, watch_bytes, start_rss);
    app_result_end(self->app); /* the file of --log may fail later */
}

static void open_novelty(watching *self) {
    bench *b = &self->bench;
    const lg_novelty *novelty = b->usual;
    b->farthest = values.unlike > 0 ? values.unlike : INFINITY;
    self->silence.without = app_keep(self->channels, sizeof *self->silence.without);
    if (novelty->channels == 0) {
        app_warn(self->app,
                 "the model has no record of what its training windows look like: a dead sensor gets a "
                 "class, too; train it again");
        return;
    }
    b->features = app_keep(novelty->features, sizeof *b->features);
    b->novelty_work = app_keep(lg_novelty_work_size(novelty), 1);
    self->noise.sum = app_keep(novelty->channels, sizeof *self->noise.sum);
}

static void watch_with(const app *self, const well_model *model, int file) {
    watching w = {.app = self,
                  .bench = {.model = model,
                            .by = well_model_scorer(model),
                            .names = &model->file.names,
                            .usual = &model->file.novelty},
                  .channels = model->file.names.channels,
                  .tally = {.first_alarm = NAN, .first_unlike = NAN, .detection = NAN}};
    lg_monitor_options options;
    set_options(self, model, &w, &options);
    watch_log_open(&w.log, self, values.log, self->json ? json_begin : text_begin);
    const size_t bytes = lg_monitor_size(&options);
    APP_FREE void *memory = app_alloc(bytes, 1);
    w.bench.score = app_keep(w.bench.by.classes, sizeof *w.bench.score);
    w.bench.work = app_keep(w.bench.by.work, 1);
    open_novelty(&w);
    APP_MUST(self, lg_monitor_init(&options, judge, &w.bench, &w.watch, memory, bytes, &error));
    watch_feed(&w, file, bytes);
    watch_log_close(&w.log);
}

static void run(app *self) {
    APP_CLEAN(well_model_destroy) well_model model = {.plan = NULL};
    int file = STDIN_FILENO;
    well_model_load(self, self->arguments[0], &model);
    well_model_settle(self, &model, values.healthy, "", self->arguments[0]);
    if (values.input != NULL) file = open(values.input, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0) app_stop(self, LG_FILE, "%s: %s", values.input, strerror(errno));
    watch_with(self, &model, file);
    if (values.input != NULL) (void)close(file);
    if (app_interrupted()) self->code = APP_EXIT_INTERRUPTED;
}

const app_command anomaly_watch_command = {
    .name = "watch",
    .arguments = "MODEL.h5",
    .summary = "Score a feed of samples window by window, in fixed memory",
    .details =
        "A line of the feed is a sample: one number for each channel of the model, separated by commas, "
        "semicolons or blanks. A first column of seconds is optional; the first lines show whether there is "
        "one. Later lines with another number of columns are malformed. Blank lines, lines of names and "
        "comments (#) are skipped. Names of the model's channels say which column is which, also in a later "
        "line; a feed that lacks one of them is rejected, and columns with other names are left out. Empty "
        "fields and nan are "
        "lost samples. Without times an unreadable line is a lost sample too. With times it is skipped, and "
        "the times show which samples are missing. A last line without a line end may be cut; its sample is "
        "lost.\nA time that jumps is accepted when three more samples continue from it; otherwise its line "
        "is malformed. A feed whose times do not have the model's sampling rate fails. --rate HZ "
        "accepts it unchanged: windows have the same number of samples, on a grid of HZ.\nA result is "
        "printed as soon as its window is complete: time of its last sample, class, score, votes for an "
        "alarm among the last windows, samples missing, alarm, reason. The class is \"unlike\" where the "
        "window is unlike those of training, or a sensor sends no numbers: such a window has no vote for the "
        "alarm; the state is UNLIKE when K of the last N are so. For a long gap only the first windows are "
        "printed; the others are counted. The summary follows at the end, also after Ctrl-C (exit code 130). "
        "With --json each result and the summary is one object on its own line.\nWith --log results are "
        "appended to a file, one write a line; the summary stays on standard output. logrotate: rename and "
        "SIGHUP loses no line; copytruncate loses those written between its copy and its cut.\nWith "
        "--crack-at the time to detection runs from T to the end of the first window that is not of the "
        "healthy class while the alarm is on (the time of its last sample plus one interval). Alarms that "
        "begin before T are false; days before T count scored windows only.",
    .settings = APP_SETTINGS(APP_GIVEN(watch_options, values)),
    .run = run};
