/* lg-anomaly evaluate: judges a model on labelled data, per window, per group (sea state), and with votes per
 * recording. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/csv.h"
#include "lg-anomaly/train.h"

enum { SHOWN_GROUPS = 40 };

typedef struct evaluate_values {
    const char *scores;
    char healthy[LG_SERIES_NAME];
    int part;
    lg_wholes votes;
} evaluate_values;

enum { PART_AUTO, PART_ALL, PART_TRAIN, PART_VALIDATION, PART_TEST };
static const char *const part_names[] = {"auto", "all", "train", "validation", "test", NULL};

static const lg_field evaluate_options[] = {
    APP_PART(evaluate_values,
             "Windows to score: all, or the train, validation or test part of the data that the model "
             "was trained on; auto (default): the test part of those data, all windows of other data",
             .names = part_names),
    HEALTHY(evaluate_values),
    VOTES(evaluate_values, "K,N",
          "of a recording are not of the healthy class; report time to detection and false alarms per day"),
    LG_OPTION(evaluate_values, scores, STRING, "FILE.csv",
              "Write one row for each window: run, group, truth, class, scores", .file = LG_FILE_TEXT),
    LG_FIELD_END};

static evaluate_values values;

/* Results of voting on the recordings. Times are in seconds, or in samples if the rate is unknown. */
typedef struct voting {
    size_t damaged, detected, false_alarms;
    /* Median and largest time to detection; intact_time: time observed before any damage. */
    double median, largest, intact_time;
    double a_day; /* false alarms per day; NaN if the rate is unknown */
} voting;

typedef struct evaluation {
    const app *app;
    well_model *model;
    const lg_series *names;     /* of the model */
    const lg_detector_run *run; /* its training */
    const char *path;
    lg_cut_series from;
    const char *part_name;
    lg_window_list part;
    lg_judgement judged;
    lg_novelty_result *measured; /* of each window, while they are counted */
    size_t unlike; /* number of windows unlike the training windows, if the model has a novelty model */
    voting votes;
} evaluation;

/* ---- choosing the windows to judge ---- */

static void choose_part(evaluation *e) {
    static const lg_part wanted[] = {
        [PART_TRAIN] = LG_PART_TRAIN, [PART_VALIDATION] = LG_PART_VALIDATION, [PART_TEST] = LG_PART_TEST};
    const lg_detector_run *cut = e->run;
    const size_t windows = e->from.windows.count;
    const char *model = e->app->arguments[0];
    const bool same = strcmp(cut->data_sha256, e->from.data.sha256) == 0 && cut->windows == windows;
    int part = values.part;
    if (part == PART_AUTO) part = same && cut->test_fraction > 0 ? PART_TEST : PART_ALL;
    e->part_name = part_names[part];
    if (part == PART_ALL) {
        if (same && values.part == PART_AUTO)
            app_warn(e->app, "%s was trained on %s without a test part: these are training errors", model,
                     e->path);
        APP_DO(e->app, lg_window_part, &e->from, NULL, LG_PART_NONE, &e->part);
        return;
    }
    if (!same)
        app_stop_usage(e->app, "--part %s: %s was trained on other data than %s", e->part_name, model,
                       e->path);
    APP_MUST_FILE(e->app, e->path,
                  lg_window_part(e->app->context, &e->from, cut, wanted[part], &e->part, &error));
    if (e->part.count == 0) app_stop_usage(e->app, "--part %s: the model has no windows in it", e->part_name);
}

/* ---- voting ---- */

typedef struct watching {
    uint64_t votes;
    bool alarm, damaged, detected;
    double onset; /* the recording's sample at which damage begins */
} watching;

/* Processes window i of a recording; `begin` is the window's first sample in the recording. */
static void watch_window(const evaluation *e, watching *state, size_t i, double begin, voting *out,
                         double *times) {
    const lg_judgement *judged = &e->judged;
    const double unit = e->names->rate > 0 ? 1 / e->names->rate : 1;
    if (judged->truth[i] != judged->healthy && !state->damaged) {
        state->damaged = true;
        state->onset = begin;
        out->damaged++;
    }
    const bool before = state->alarm, positive = judged->given[i] != judged->healthy;
    state->alarm = lg_cast_vote(&state->votes, values.votes.values[1], positive) >= values.votes.values[0];
    if (!state->damaged) {
        out->false_alarms += state->alarm && !before;
        out->intact_time += (double)e->run->hop * unit;
    } else if (positive && state->alarm && !state->detected) {
        state->detected = true;
        times[out->detected++] = (begin + (double)e->model->window - state->onset) * unit;
    }
}

static void vote(evaluation *e) {
    const lg_series *series = &e->from.data.series;
    const lg_windows *windows = &e->from.windows;
    voting *out = &e->votes;
    APP_FREE double *times = app_alloc(e->judged.count, sizeof *times);
    watching state = {.damaged = false};
    uint32_t begins = 0; /* the first stored window of the recording */
    *out = (voting){.largest = NAN};
    for (size_t i = 0; i < e->judged.count; i++) {
        const uint32_t window = e->judged.window[i], first = windows->first[window];
        if (i == 0 || series->run[first] != series->run[begins]) {
            for (begins = first; begins > 0 && series->run[begins - 1] == series->run[first];) begins--;
            state = (watching){.damaged = false};
        }
        const double begin =
            (double)(first - begins) * (double)series->length + (double)windows->offset[window];
        watch_window(e, &state, i, begin, out, times);
    }
    for (size_t i = 0; i < out->detected; i++) out->largest = fmax(out->largest, times[i]);
    out->median = lg_median(times, out->detected);
    out->a_day = e->names->rate > 0 && out->intact_time > 0
                     ? (double)out->false_alarms * 86400 / out->intact_time
                     : (double)NAN;
}

/* ---- groups ---- */

static double part_or_nan(size_t a, size_t b) {
    return b > 0 ? (double)a / (double)b : (double)NAN;
}

typedef struct group_row {
    uint32_t group;  /* first: it sorts the rows */
    uint32_t window; /* index among the judged windows */
} group_row;

static void add_groups(app_json *out, const evaluation *e) {
    const lg_judgement *judged = &e->judged;
    const lg_cut_series *from = &e->from;
    size_t groups = 0;
    if (from->data.series.group == NULL) return;
    APP_FREE group_row *rows = app_alloc(judged->count, sizeof *rows);
    for (size_t i = 0; i < judged->count; i++)
        rows[i] = (group_row){from->data.series.group[from->windows.first[judged->window[i]]], (uint32_t)i};
    qsort(rows, judged->count, sizeof *rows, lg_compare_u32);
    app_result_rows(out, "groups");
    for (size_t first = 0, end; first < judged->count; first = end) {
        size_t right = 0, healthy = 0, false_positive = 0;
        for (end = first; end < judged->count && rows[end].group == rows[first].group; end++) {
            const uint32_t given = judged->given[rows[end].window], truth = judged->truth[rows[end].window];
            right += given == truth;
            healthy += truth == judged->healthy;
            false_positive += truth == judged->healthy && given != truth;
        }
        if (++groups > SHOWN_GROUPS && out->people) continue;
        APP_OBJECT(out, NULL, LG_AS_WHOLE("group", rows[first].group), LG_AS_WHOLE("windows", end - first),
                   LG_AS_REAL("accuracy", part_or_nan(right, end - first)),
                   LG_AS_REAL("false_positive_rate", part_or_nan(false_positive, healthy)));
    }
    app_result_rows_end(out);
    if (groups > SHOWN_GROUPS) app_result_line(out, "and %zu groups more", groups - SHOWN_GROUPS);
}

/* ---- results ---- */

static void add_votes(app_json *out, const evaluation *e) {
    const voting *votes = &e->votes;
    const char *unit = e->names->rate > 0 ? "s" : "samples";
    if (values.votes.count == 0) return;
    APP_OBJECT(out, "votes", LG_AS_WHOLE("k", values.votes.values[0]),
               LG_AS_WHOLE("n", values.votes.values[1]), LG_WHOLE("damaged_runs", votes->damaged, NULL),
               LG_WHOLE("detected_runs", votes->detected, "by votes"),
               LG_AS_REAL("probability_of_detection", part_or_nan(votes->detected, votes->damaged)),
               LG_AS_TEXT("unit", unit), LG_REAL("median_time_to_detection", votes->median, unit),
               LG_REAL("largest_time_to_detection", votes->largest, unit),
               LG_AS_REAL("intact_time", votes->intact_time),
               LG_WHOLE("false_alarms", votes->false_alarms, "by votes"),
               LG_REAL("false_alarms_per_day", votes->a_day, "by votes"));
}

static void add_evaluation(app_json *out, const evaluation *e) {
    APP_PUT(out, LG_TEXT("data", e->path, NULL), LG_TEXT("part", e->part_name, NULL),
            LG_WHOLE("windows", e->judged.count, NULL));
    put_metrics(out, &e->judged, e->model);
    APP_PUT(out, LG_AS_REAL("mse", e->judged.mse), LG_AS_REAL("test_seconds", e->judged.seconds),
            LG_AS_REAL("noise", e->from.data.noise), LG_AS_REAL("severity", e->from.data.severity),
            LG_AS_WHOLE("unlike", e->unlike));
    add_votes(out, e);
    add_groups(out, e);
    APP_PUT(out, LG_TEXT("method", e->model->method, NULL),
            LG_AS_TEXTS("classes", e->names->class_name, e->names->classes),
            LG_TEXT("healthy", e->run->healthy[0] != '\0' ? e->run->healthy : NULL, NULL),
            LG_AS_WHOLE("threads", e->app->threads));
}

/* One table row per data file, used for the probability of detection against severity or noise. */
static void add_row(app_json *out, const evaluation *e) {
    APP_PUT(out, LG_AS_TEXT("data", e->path), LG_AS_TEXT("part", e->part_name),
            LG_AS_REAL("noise", e->from.data.noise), LG_AS_REAL("severity", e->from.data.severity),
            LG_AS_WHOLE("windows", e->judged.count), LG_AS_REAL("accuracy", e->judged.metrics.accuracy),
            LG_AS_REAL("recall", e->judged.metrics.recall), LG_AS_REAL("F1", e->judged.metrics.f1),
            LG_AS_TEXT("healthy", e->run->healthy),
            LG_AS_REAL("false alarms/day", lg_judgement_alarms(&e->judged, e->run->hop, e->names->rate)));
    if (values.votes.count == 0) return;
    APP_PUT(out, LG_AS_WHOLE("damaged", e->votes.damaged), LG_AS_WHOLE("detected", e->votes.detected));
}

static void write_scores(const evaluation *e) {
    const lg_series *series = &e->from.data.series;
    const lg_judgement *judged = &e->judged;
    lg_columns to = {.text = app_text()};
    lg_columns_names(&to, "window,run,group,truth,class");
    for (uint32_t c = 0; c < judged->classes; c++) {
        APP_FREE char *name = app_format("score %s", e->names->class_name[c]);
        lg_columns_name(&to, name);
    }
    lg_columns_end(&to);
    for (size_t i = 0; i < judged->count; i++) {
        const uint32_t first = e->from.windows.first[judged->window[i]];
        lg_columns_whole(&to, judged->window[i]);
        lg_columns_number(&to, series->run != NULL ? series->run[first] : (double)NAN);
        lg_columns_number(&to, series->group != NULL ? series->group[first] : (double)NAN);
        lg_columns_text(&to, e->names->class_name[judged->truth[i]]);
        lg_columns_text(&to, e->names->class_name[judged->given[i]]);
        lg_columns_numbers(&to, judged->score + i * judged->classes, judged->classes);
        lg_columns_end(&to);
    }
    APP_MUST_FILE(e->app, values.scores, lg_columns_write(&to, e->app->context, values.scores, &error));
}

/* ---- windows that are unlike those of training ---- */

static lg_status measure(void *user, size_t i, const float *x, void *work) {
    const evaluation *e = user;
    lg_novelty_eval(&e->model->file.novelty, x, &e->measured[i], NULL, work);
    return LG_OK;
}

/* Counts them, and warns if they are many, because the model's results mean little for them. */
static void tell_unlike(evaluation *e) {
    static const double MANY = 0.05;
    const lg_series *names = e->names;
    const lg_novelty *novelty = &e->model->file.novelty;
    const size_t count = e->judged.count;
    const lg_window_list all = {e->judged.window, count};
    APP_FREE lg_novelty_result *result = app_alloc(count, sizeof *result);
    size_t farthest = 0;
    char reason[256];
    e->measured = result;
    app_must(e->app,
             lg_windows_each(e->app->context, &e->from.data.series, &e->from.windows, &all, e->app->threads,
                             lg_novelty_work_size(novelty), measure, e),
             NULL);
    for (size_t i = 0; i < count; i++) {
        e->unlike += result[i].novel;
        if (result[i].distance > result[farthest].distance) farthest = i;
    }
    if ((double)e->unlike <= MANY * (double)count) return;
    (void)lg_novelty_explain(novelty, &result[farthest], names->channel_name, names->rate, reason,
                             sizeof reason);
    app_warn(e->app, "%s: %zu of %zu windows are unlike those of training, the farthest by %s", e->path,
             e->unlike, count, reason);
}

/* ---- the command ---- */

static void evaluate(evaluation *e) {
    const app *self = e->app;
    const lg_series *series = &e->from.data.series;
    lg_error why = {LG_OK, ""};
    read_series_of(self, e->path, e->model, &e->from.data);
    APP_MUST_FILE(self, e->path,
                  lg_windows_create(self->context, series, e->model->window, (size_t)e->run->hop,
                                    &e->from.windows, &error));
    choose_part(e);
    const bool votes = values.votes.count > 0;
    well_model_settle(self, e->model, values.healthy, e->from.data.healthy, votes ? "--votes" : NULL);
    if (votes && series->run == NULL) app_stop_usage(self, "--votes: %s has no recordings (/run)", e->path);
    if (votes && e->part.count < e->from.windows.count && e->run->split == LG_SPLIT_RANDOM)
        app_warn(self,
                 "--votes: the %s part of a random split holds single windows of the recordings, not the "
                 "recordings: times to detection are too long",
                 e->part_name);
    const lg_scorer by = well_model_scorer(e->model);
    lg_status status = lg_judge(self->context, &by, &e->from, &e->part, self->threads, &e->judged, &why);
    if (status == LG_OK) status = lg_judgement_check(&e->judged, &why);
    if (status != LG_OK && status != LG_CANCELLED) app_stop(self, status, "%s: %s", e->path, why.message);
    app_must(self, status, &why);
    if (votes) vote(e);
    if (e->model->sort != WELL_NOVELTY && e->model->file.novelty.channels > 0) tell_unlike(e);
}

static void run(app *self) {
    APP_CLEAN(well_model_destroy) well_model model = {.plan = NULL};
    const size_t count = (size_t)self->argument_count - 1;
    const lg_wholes *votes = &values.votes;
    app_json *out = self->out;
    evaluation *list = app_keep(count, sizeof *list);
    if (votes->count != 0 && (votes->count != 2 || votes->values[0] > votes->values[1]))
        app_stop_usage(self, "--votes: expected two numbers K,N with K at most N, such as 3,5");
    if ((app_plot_given.plot != NULL || values.scores != NULL) && count > 1)
        app_stop_usage(self, "--plot and --scores take one data file only");
    well_model_load(self, self->arguments[0], &model);
    app_plot_check(self, plots_of(&model, false));
    for (size_t i = 0; i < count; i++) {
        list[i] = (evaluation){.app = self,
                               .model = &model,
                               .names = &model.file.names,
                               .run = &model.file.run,
                               .path = self->arguments[i + 1]};
        evaluate(&list[i]);
    }
    if (values.scores != NULL) write_scores(&list[0]);
    app_plot_draw(self, plots_of(&model, false),
                  &(viewing){&model, &list[0].from, &list[0].judged, .training = NULL});
    if (count > 1) app_result_rows(out, "files");
    for (evaluation *e = list; e < list + count; e++) {
        if (count > 1) app_json_open(out, NULL, '{');
        (count > 1 && out->people ? add_row : add_evaluation)(out, e);
        if (count > 1) app_json_close(out, '}');
        lg_judgement_destroy(&e->judged);
        lg_free(self->context, e->part.list);
        lg_windows_destroy(&e->from.windows);
        lg_series_data_destroy(&e->from.data);
    }
    if (count > 1) app_result_rows_end(out);
}

const app_command anomaly_evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5 ...",
    .summary = "Score a detector on labelled windows",
    .details =
        "If DATA.h5 is the data that the model was trained on, the windows of its test part are scored, cut "
        "and split as in training. With --votes each recording is scored in order of time. The time to "
        "detection runs from the first damaged sample to the end of the window that raises the alarm. "
        "Alarms before any damage are false alarms. Each of several data files gives one row, for the "
        "probability of detection against severity.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .plots = anomaly_plots + EVALUATE_PLOTS,
    .run = run};
