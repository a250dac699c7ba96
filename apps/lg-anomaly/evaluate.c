/* lg-anomaly evaluate: judges a model on labelled data, by window, by sea state, and by recording with
 * votes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

enum { MAX_FILES = 7, MAX_VOTES = 64, SHOWN_GROUPS = 40 };

typedef struct evaluate_values {
    const char *plot, *scores;
    int part, picture;
    lg_wholes votes;
} evaluate_values;

enum { PART_AUTO, PART_ALL, PART_TRAIN, PART_VALIDATION, PART_TEST };
static const char *const part_names[] = {"auto", "all", "train", "validation", "test", NULL};

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, part, NAME, NULL,
              "Windows to judge: all, or the train, validation or test part of the data that the model "
              "was trained on; auto (default): the test part of those data, all windows of other data",
              .names = part_names),
    LG_OPTION(evaluate_values, votes, WHOLES, "K,N",
              "Raise an alarm when K of the last N windows of a recording are not of the first class; "
              "report time to detection and false alarms a day",
              .low = 1, .high = MAX_VOTES),
    LG_OPTION(evaluate_values, scores, STRING, "FILE.csv",
              "Write one row for each window: run, group, truth, class, scores"),
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png", "Draw a picture"),
    LG_OPTION(evaluate_values, picture, NAME, NULL, EVALUATE_VIEW_HELP, .names = evaluate_view_names),
    LG_FIELD_END};

static evaluate_values values;

/* Results of voting on the recordings. Times in seconds, or samples if the rate is unknown. */
typedef struct voting {
    size_t damaged, detected, false_alarms;
    double median, largest, intact_time; /* time to detection; time observed before any damage */
    double a_day;                        /* false alarms; NaN where the rate is unknown */
} voting;

typedef struct evaluation {
    const app *app;
    const well_model *model;
    const char *path;
    cut_series from;
    const char *part_name;
    part_indices part;
    judgement judged;
    size_t unlike; /* windows unlike those of training; for models that know them */
    voting votes;
} evaluation;

/* ---- which windows ---- */

static int choose_part(evaluation *e) {
    const well_cut *cut = &e->model->cut;
    const bool same =
        strcmp(cut->data_sha256, e->from.data.sha256) == 0 && cut->windows == e->from.windows.count;
    static const lg_part wanted[] = {
        [PART_TRAIN] = LG_PART_TRAIN, [PART_VALIDATION] = LG_PART_VALIDATION, [PART_TEST] = LG_PART_TEST};
    int part = values.part;
    if (part == PART_AUTO) part = same && cut->test_fraction > 0 ? PART_TEST : PART_ALL;
    e->part_name = part_names[part];
    if (part == PART_ALL) {
        if (same && values.part == PART_AUTO)
            app_warn(e->app, "%s was trained on %s without a test part: these are training errors",
                     e->app->arguments[0], e->path);
        e->part = part_all(e->from.windows.count);
        return APP_EXIT_OK;
    }
    if (!same)
        return app_usage(e->app, "--part %s: %s was trained on other data than %s", part_names[part],
                         e->app->arguments[0], e->path);
    lg_error error = {LG_OK, ""};
    uint8_t *parts = app_alloc(e->from.windows.count, 1);
    const lg_status status =
        lg_series_split(e->app->context, &e->from.data.series, &e->from.windows, cut->split,
                        cut->test_fraction, cut->validation_fraction, cut->seed, parts, &error);
    if (status == LG_OK) e->part = part_of(parts, e->from.windows.count, wanted[part]);
    free(parts);
    if (status != LG_OK) return app_fail_file(e->app, status, &error, e->path);
    if (e->part.count > 0) return APP_EXIT_OK;
    return app_usage(e->app, "--part %s: the model has no windows in it", part_names[part]);
}

/* ---- voting ---- */

/* For each stored window, the first stored window of its recording. */
static uint32_t *run_begins(const lg_series *series) {
    uint32_t *begin = app_alloc(series->count, sizeof *begin);
    for (size_t i = 1; i < series->count; i++)
        begin[i] = series->run[i] == series->run[i - 1] ? begin[i - 1] : (uint32_t)i;
    return begin;
}

typedef struct ballot {
    bool last[MAX_VOTES];
    size_t cast, positive;
    bool alarm;
} ballot;

/* True when the alarm begins. */
static bool cast_vote(ballot *b, bool positive) {
    const size_t n = values.votes.values[1], at = b->cast % n;
    if (b->cast >= n && b->last[at]) b->positive--;
    b->last[at] = positive;
    b->positive += positive;
    b->cast++;
    const bool before = b->alarm;
    b->alarm = b->positive >= values.votes.values[0];
    return b->alarm && !before;
}

typedef struct watching {
    ballot ballot;
    bool damaged, detected;
    double onset; /* sample of the recording where damage begins */
} watching;

/* One window of a recording: `begin` its first sample. */
static void watch_window(const evaluation *e, watching *state, size_t i, double begin, voting *out,
                         double *times) {
    const judgement *judged = &e->judged;
    const double unit = e->model->rate > 0 ? 1 / e->model->rate : 1;
    if (judged->truth[i] != 0 && !state->damaged) {
        state->damaged = true;
        state->onset = begin;
        out->damaged++;
    }
    const bool began = cast_vote(&state->ballot, judged->given[i] != 0);
    if (!state->damaged) {
        out->false_alarms += began;
        out->intact_time += (double)e->model->cut.hop * unit;
    } else if (state->ballot.alarm && !state->detected) {
        state->detected = true;
        times[out->detected++] = (begin + (double)e->model->window - state->onset) * unit;
    }
}

static void vote(evaluation *e) {
    const lg_series *series = &e->from.data.series;
    const lg_windows *windows = &e->from.windows;
    voting *out = &e->votes;
    uint32_t *begins = run_begins(series);
    double *times = app_alloc(e->judged.count, sizeof *times);
    watching state = {.damaged = false};
    *out = (voting){.largest = NAN};
    for (size_t i = 0; i < e->judged.count; i++) {
        const uint32_t window = e->judged.window[i], first = windows->first[window];
        if (i == 0 || begins[first] != begins[windows->first[e->judged.window[i - 1]]])
            state = (watching){.damaged = false};
        const double begin =
            (double)(first - begins[first]) * (double)series->length + (double)windows->offset[window];
        watch_window(e, &state, i, begin, out, times);
    }
    for (size_t i = 0; i < out->detected; i++) out->largest = fmax(out->largest, times[i]);
    out->median = app_median(times, out->detected);
    out->a_day = e->model->rate > 0 && out->intact_time > 0
                     ? (double)out->false_alarms * 86400 / out->intact_time
                     : (double)NAN;
    free(times);
    free(begins);
}

/* ---- groups ---- */

typedef struct group_row {
    uint32_t group;
    size_t windows, right, first_class, false_positive;
} group_row;

static int by_group(const void *a, const void *b) {
    const uint32_t p = ((const group_row *)a)->group, q = ((const group_row *)b)->group;
    return (p > q) - (p < q);
}

static group_row *group_rows(const evaluation *e, size_t *count) {
    const judgement *judged = &e->judged;
    group_row *rows = app_alloc(judged->count, sizeof *rows);
    for (size_t i = 0; i < judged->count; i++)
        rows[i] = (group_row){e->from.data.series.group[e->from.windows.first[judged->window[i]]], 1,
                              judged->given[i] == judged->truth[i], judged->truth[i] == 0,
                              judged->truth[i] == 0 && judged->given[i] != 0};
    qsort(rows, judged->count, sizeof *rows, by_group);
    *count = 0;
    for (size_t i = 0; i < judged->count; i++) {
        if (*count == 0 || rows[*count - 1].group != rows[i].group) {
            rows[(*count)++] = rows[i];
            continue;
        }
        group_row *sum = &rows[*count - 1];
        sum->windows++;
        sum->right += rows[i].right;
        sum->first_class += rows[i].first_class;
        sum->false_positive += rows[i].false_positive;
    }
    return rows;
}

static double part_or_nan(size_t a, size_t b) {
    return b > 0 ? (double)a / (double)b : (double)NAN;
}

static void json_groups(app_json *json, const evaluation *e) {
    size_t count;
    if (e->from.data.series.group == NULL) return;
    group_row *rows = group_rows(e, &count);
    app_json_open(json, "groups", '[');
    for (size_t i = 0; i < count; i++) {
        app_json_open(json, NULL, '{');
        app_json_size(json, "group", rows[i].group);
        app_json_size(json, "windows", rows[i].windows);
        app_json_real(json, "accuracy", part_or_nan(rows[i].right, rows[i].windows));
        app_json_real(json, "false_positive_rate", part_or_nan(rows[i].false_positive, rows[i].first_class));
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
    free(rows);
}

static void print_groups(const evaluation *e) {
    size_t count;
    app_table table;
    if (e->from.data.series.group == NULL) return;
    group_row *rows = group_rows(e, &count);
    app_table_begin(&table, 4);
    static const char *const heads[] = {"group", "windows", "accuracy", "false positives"};
    for (size_t c = 0; c < LG_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t i = 0; i < count && i < SHOWN_GROUPS; i++) {
        app_table_cell(&table, "%u", rows[i].group);
        app_table_cell(&table, "%zu", rows[i].windows);
        app_table_cell(&table, "%.4f", part_or_nan(rows[i].right, rows[i].windows));
        if (rows[i].first_class > 0)
            app_table_cell(&table, "%.4f", part_or_nan(rows[i].false_positive, rows[i].first_class));
        else
            app_table_cell(&table, "-");
    }
    app_table_end(&table, stdout);
    if (count > SHOWN_GROUPS) (void)printf("and %zu groups more\n", count - SHOWN_GROUPS);
    free(rows);
}

/* ---- results ---- */

static void json_votes(app_json *json, const evaluation *e) {
    const voting *votes = &e->votes;
    if (values.votes.count == 0) return;
    app_json_open(json, "votes", '{');
    app_json_size(json, "k", values.votes.values[0]);
    app_json_size(json, "n", values.votes.values[1]);
    app_json_size(json, "damaged_runs", votes->damaged);
    app_json_size(json, "detected_runs", votes->detected);
    app_json_real(json, "probability_of_detection", part_or_nan(votes->detected, votes->damaged));
    app_json_text(json, "unit", e->model->rate > 0 ? "s" : "samples");
    app_json_real(json, "median_time_to_detection", votes->median);
    app_json_real(json, "largest_time_to_detection", votes->largest);
    app_json_real(json, "intact_time", votes->intact_time);
    app_json_size(json, "false_alarms", votes->false_alarms);
    app_json_real(json, "false_alarms_per_day", votes->a_day);
    app_json_close(json, '}');
}

static void json_evaluation(app_json *json, const evaluation *e) {
    app_json_text(json, "data", e->path);
    app_json_text(json, "part", e->part_name);
    app_json_size(json, "windows", e->judged.count);
    json_metrics(json, &e->judged, e->model->cut.hop, e->model->rate);
    app_json_real(json, "mse", e->judged.mse);
    app_json_real(json, "test_seconds", e->judged.seconds);
    app_json_real(json, "noise", e->from.data.noise);
    app_json_real(json, "severity", e->from.data.severity);
    app_json_size(json, "unlike", e->unlike);
    json_votes(json, e);
    json_groups(json, e);
    app_json_text(json, "method", e->model->method);
    app_json_open(json, "classes", '[');
    for (uint32_t c = 0; c < e->model->classes; c++) app_json_text(json, NULL, e->model->class_name[c]);
    app_json_close(json, ']');
    app_json_size(json, "threads", e->app->threads);
}

static void print_votes(const evaluation *e) {
    const voting *votes = &e->votes;
    const char *unit = e->model->rate > 0 ? "s" : "samples";
    if (values.votes.count == 0) return;
    (void)printf("%u of %u windows: %zu of %zu damaged recordings detected", values.votes.values[0],
                 values.votes.values[1], votes->detected, votes->damaged);
    if (votes->detected > 0)
        (void)printf(", after %.6g %s in the median, %.6g %s at most", votes->median, unit, votes->largest,
                     unit);
    (void)printf("; %zu false alarms", votes->false_alarms);
    if (isfinite(votes->a_day)) (void)printf(", %.3g a day", votes->a_day);
    (void)printf("\n");
}

static void print_evaluation(const evaluation *e) {
    (void)printf("%s (%s), %s\n", e->path, e->part_name, e->model->method);
    print_metrics(&e->judged, e->model);
    print_votes(e);
    print_groups(e);
}

/* One row for each of several files, for the probability of detection against severity or noise. */
static void print_files(const evaluation *list, size_t count) {
    app_table table;
    const bool votes = values.votes.count > 0;
    static const char *const heads[] = {"data",     "part",   "noise", "severity",         "windows",
                                        "accuracy", "recall", "F1",    "false alarms/day", "detected"};
    app_table_begin(&table, votes ? LG_COUNT(heads) : LG_COUNT(heads) - 1);
    for (size_t c = 0; c < LG_COUNT(heads) - !votes; c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t i = 0; i < count; i++) {
        const evaluation *e = &list[i];
        app_table_cell(&table, "%s", e->path);
        app_table_cell(&table, "%s", e->part_name);
        app_table_cell(&table, "%g", e->from.data.noise);
        app_table_cell(&table, "%g", e->from.data.severity);
        app_table_cell(&table, "%zu", e->judged.count);
        app_table_cell(&table, "%.4f", e->judged.metrics.accuracy);
        app_table_cell(&table, "%.4f", e->judged.metrics.recall);
        app_table_cell(&table, "%.4f", e->judged.metrics.f1);
        app_table_cell(&table, "%.3g", false_alarms_per_day(&e->judged, e->model->cut.hop, e->model->rate));
        if (votes) app_table_cell(&table, "%zu/%zu", e->votes.detected, e->votes.damaged);
    }
    app_table_end(&table, stdout);
}

static void report(const app *self, const evaluation *list, size_t count) {
    if (!self->json) {
        if (count == 1)
            print_evaluation(&list[0]);
        else
            print_files(list, count);
        return;
    }
    app_json json;
    app_json_begin(&json);
    if (count == 1) {
        json_evaluation(&json, &list[0]);
    } else {
        app_json_open(&json, "files", '[');
        for (size_t i = 0; i < count; i++) {
            app_json_open(&json, NULL, '{');
            json_evaluation(&json, &list[i]);
            app_json_close(&json, '}');
        }
        app_json_close(&json, ']');
    }
    app_json_end(&json);
}

/* A name as a field of CSV. */
static void csv_text(FILE *stream, const char *text) {
    if (strpbrk(text, ",\"\n\r") == NULL) {
        (void)fputs(text, stream);
        return;
    }
    (void)fputc('"', stream);
    for (; *text != '\0'; text++) {
        if (*text == '"') (void)fputc('"', stream);
        (void)fputc(*text, stream);
    }
    (void)fputc('"', stream);
}

static lg_status write_scores(const evaluation *e, lg_error *error) {
    const lg_series *series = &e->from.data.series;
    const judgement *judged = &e->judged;
    app_file file;
    app_file_begin(&file, values.scores);
    (void)fputs("window,run,group,truth,class", file.stream);
    for (uint32_t c = 0; c < judged->classes; c++) {
        (void)fputs(",score ", file.stream);
        csv_text(file.stream, e->model->class_name[c]);
    }
    (void)fputc('\n', file.stream);
    for (size_t i = 0; i < judged->count; i++) {
        const uint32_t first = e->from.windows.first[judged->window[i]];
        (void)fprintf(file.stream, "%u,", judged->window[i]);
        if (series->run != NULL) (void)fprintf(file.stream, "%u", series->run[first]);
        (void)fputc(',', file.stream);
        if (series->group != NULL) (void)fprintf(file.stream, "%u", series->group[first]);
        (void)fputc(',', file.stream);
        csv_text(file.stream, e->model->class_name[judged->truth[i]]);
        (void)fputc(',', file.stream);
        csv_text(file.stream, e->model->class_name[judged->given[i]]);
        for (uint32_t c = 0; c < judged->classes; c++)
            (void)fprintf(file.stream, ",%.17g", judged->score[i * judged->classes + c]);
        (void)fputc('\n', file.stream);
    }
    return app_file_end(&file, error);
}

/* ---- the command ---- */

/* The figures of a model say nothing where the data are not what it knows. */
static void tell_unlike(evaluation *e) {
    static const double MANY = 0.05;
    const well_model *model = e->model;
    lg_novelty_result farthest;
    char reason[256];
    e->unlike = count_novel(e->app, model, &e->from.data.series, &e->from.windows, &e->judged, &farthest);
    if ((double)e->unlike <= MANY * (double)e->judged.count) return;
    (void)lg_novelty_explain(&model->novelty, &farthest, model->channel_name, model->rate, reason,
                             sizeof reason);
    app_warn(e->app, "%s: %zu of %zu windows are unlike those of training, the farthest by %s", e->path,
             e->unlike, e->judged.count, reason);
}

/* A window whose numbers overflow in the model has no class. */
static int refuse_infinite(const evaluation *e) {
    const judgement *judged = &e->judged;
    size_t infinite = 0, first = 0;
    for (size_t i = judged->count * judged->classes; i-- > 0;)
        if (!isfinite(judged->score[i])) infinite++, first = i / judged->classes;
    if (infinite == 0) return APP_EXIT_OK;
    return app_fail(e->app, LG_NOT_FINITE,
                    "%s: %zu scores of %zu windows are not finite, the first of window %u (from 0): its "
                    "numbers are too large for the model",
                    e->path, infinite, judged->count, judged->window[first]);
}

static int evaluate(evaluation *e) {
    const app *self = e->app;
    const lg_series *series = &e->from.data.series;
    lg_error error = {LG_OK, ""};
    int code = read_series_of(self, e->path, e->model, &e->from.data);
    if (code != APP_EXIT_OK) return code;
    lg_status status = lg_windows_create(self->context, series, e->model->window, (size_t)e->model->cut.hop,
                                         &e->from.windows, &error);
    if (status == LG_OUT_OF_MEMORY) return app_fail(self, status, "out of memory");
    if (status != LG_OK) return app_fail_file(self, status, &error, e->path);
    code = choose_part(e);
    if (code != APP_EXIT_OK) return code;
    if (values.votes.count > 0 && series->run == NULL)
        return app_usage(self, "--votes: %s has no recordings (/run)", e->path);
    if (values.votes.count > 0 && e->part.count < e->from.windows.count &&
        e->model->cut.split == LG_SPLIT_RANDOM)
        app_warn(self,
                 "--votes: the %s part of a random split holds single windows of the recordings, not the "
                 "recordings: times to detection are too long",
                 e->part_name);
    status = judge_windows(self, e->model, series, &e->from.windows, &e->part, &e->judged, &error);
    if (status == LG_CANCELLED) return app_fail(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK) return app_fail(self, status, "%s: %s", e->path, error.message);
    code = refuse_infinite(e);
    if (code != APP_EXIT_OK) return code;
    if (values.votes.count > 0) vote(e);
    if (e->model->sort != WELL_NOVELTY && e->model->novelty.channels > 0) tell_unlike(e);
    return APP_EXIT_OK;
}

static int write_outputs(const evaluation *e) {
    lg_error error = {LG_OK, ""};
    lg_status status = LG_OK;
    const char *path = values.scores;
    if (path != NULL) status = write_scores(e, &error);
    if (status == LG_OK && values.plot != NULL) {
        path = values.plot;
        status = draw_view(e->app, path, view_of(e->model, evaluate_views[values.picture], false), e->model,
                           &e->from.data.series, &e->from.windows, &e->judged, &error);
    }
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(e->app, status, &error, path);
}

static int evaluate_all(const app *self, const well_model *model) {
    const size_t count = (size_t)self->argument_count - 1;
    evaluation *list = app_alloc(count, sizeof *list);
    int code = APP_EXIT_OK;
    for (size_t i = 0; i < count && code == APP_EXIT_OK; i++) {
        list[i].app = self;
        list[i].model = model;
        list[i].path = self->arguments[i + 1];
        code = evaluate(&list[i]);
    }
    if (code == APP_EXIT_OK) code = write_outputs(&list[0]);
    if (code == APP_EXIT_OK) report(self, list, count);
    for (size_t i = 0; i < count; i++) {
        judgement_free(&list[i].judged);
        free(list[i].part.list);
        lg_windows_destroy(&list[i].from.windows);
        lg_series_data_destroy(&list[i].from.data);
    }
    free(list);
    return code;
}

static int check_options(const app *self) {
    const app_path paths[] = {{"scores", values.scores, LG_FILE_WRITTEN},
                              {"plot", values.plot, LG_FILE_DRAWN}};
    const lg_wholes *votes = &values.votes;
    if (votes->count != 0 && (votes->count != 2 || votes->values[0] > votes->values[1]))
        return app_usage(self, "--votes: expected two numbers K,N with K at most N, such as 3,5");
    if (app_given(self, "picture") && values.plot == NULL)
        return app_usage(self, "--picture: needs --plot FILE");
    if ((values.plot != NULL || values.scores != NULL) && self->argument_count > 2)
        return app_usage(self, "--plot and --scores take one data file only");
    return app_check_outputs(self, paths, LG_COUNT(paths));
}

static int run(app *self) {
    well_model model;
    if (self->argument_count > MAX_FILES + 1)
        app_stop_usage(self, "too many arguments: '%s'; expected: %s", self->arguments[MAX_FILES + 1],
                       self->command->arguments);
    int code = check_options(self);
    if (code == APP_EXIT_OK) code = well_model_load(self, self->arguments[0], &model);
    if (code != APP_EXIT_OK) return code;
    if (values.plot != NULL) code = check_view(self, &model, evaluate_views[values.picture], false);
    if (code == APP_EXIT_OK) code = evaluate_all(self, &model);
    well_model_free(&model);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 DATA.h5 ...",
    .summary = "Judge a detector on labelled windows",
    .details =
        "If DATA.h5 is the data that the model was trained on, the windows of its test part are judged, cut "
        "and split as in training. With --votes each recording is judged in order of time. The time to "
        "detection runs from the first damaged sample to the end of the window that raises the alarm. "
        "Alarms before any damage are false alarms. Each of several data files gives one row, for the "
        "probability of detection against severity.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};
