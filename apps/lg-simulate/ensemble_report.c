/* The results of an ensemble as one JSON object, one screen, or a picture of bands. */
#include "lg-simulate/ensemble.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- JSON ---- */

static const struct {
    const char *name;
    double p;
} shown_quantiles[] = {{"q01", 0.01}, {"q05", 0.05}, {"q25", 0.25}, {"median", 0.5},
                       {"q75", 0.75}, {"q95", 0.95}, {"q99", 0.99}};

static void json_cell(app_json *json, const lg_statistics *from, size_t row, size_t column) {
    const lg_statistics_cell cell = lg_statistics_of(from, row, column);
    app_json_size(json, "count", cell.count);
    app_json_real(json, "mean", cell.mean);
    app_json_real(json, "deviation", cell.deviation);
    app_json_real(json, "least", cell.least);
    app_json_real(json, "largest", cell.largest);
    for (size_t i = 0; i < LG_COUNT(shown_quantiles); i++)
        app_json_real(json, shown_quantiles[i].name,
                      lg_statistics_quantile(from, row, column, shown_quantiles[i].p));
    app_json_real(json, "resolution", cell.resolution);
}

static void json_failures(app_json *json, const result *what) {
    app_json_size(json, "failed", result_failed(what));
    app_json_open(json, "failed_by_status", '{');
    for (size_t i = 0; i < STATUSES; i++)
        if (what->failed[i] > 0) app_json_size(json, lg_status_name((lg_status)i), what->failed[i]);
    app_json_close(json, '}');
    app_json_open(json, "failures", '[');
    for (size_t i = 0; i < what->listed; i++) {
        app_json_open(json, NULL, '{');
        app_json_size(json, "member", what->failures[i].member);
        app_json_text(json, "status", lg_status_name((lg_status)what->failures[i].status));
        app_json_real(json, "t", what->failures[i].t);
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
}

static void json_stats(app_json *json, const lg_ensemble_stats *stats) {
    app_json_size(json, "lanes", stats->lanes);
    app_json_real(json, "occupancy", stats->occupancy);
    app_json_real(json, "seconds", stats->seconds);
}

void ensemble_json(const app *self, const ensemble_run *run) {
    const result *what = run->what;
    app_json json;
    app_json_begin(&json);
    app_json_text(&json, "ensemble", what->what);
    app_json_size(&json, "total", what->total);
    app_json_size(&json, "first", what->first);
    app_json_size(&json, "members", what->members);
    app_json_size(&json, "block", what->block);
    app_json_size(&json, "steps", what->steps);
    app_json_size(&json, "rejected", what->rejected);
    if (run->stats != NULL) json_stats(&json, run->stats);
    json_failures(&json, what);
    app_json_real(&json, "t", what->t[what->points - 1]);
    app_json_open(&json, "end", '{');
    for (size_t c = 0; c < what->columns; c++) {
        app_json_open(&json, what->column[c], '{');
        json_cell(&json, what->states, what->points - 1, c);
        app_json_close(&json, '}');
    }
    app_json_close(&json, '}');
    app_json_open(&json, "events", '{');
    for (size_t e = 0; e < what->events; e++) {
        app_json_open(&json, what->event[e], '{');
        json_cell(&json, what->times, 0, e);
        app_json_size(&json, "without", what->members - lg_statistics_of(what->times, 0, e).count);
        app_json_close(&json, '}');
    }
    app_json_close(&json, '}');
    app_json_text(&json, "out", run->out);
    app_json_size(&json, "points", what->points);
    app_json_warnings(&json, self);
    app_json_end(&json);
}

/* ---- one screen ---- */

static void print_row(app_table *table, const char *name, const lg_statistics *from, size_t row,
                      size_t column) {
    const lg_statistics_cell cell = lg_statistics_of(from, row, column);
    app_table_cell(table, "%s", name);
    app_table_cell(table, "%.6g", cell.mean);
    app_table_cell(table, "%.4g", cell.deviation);
    app_table_cell(table, "%.6g", cell.least);
    app_table_cell(table, "%.6g", lg_statistics_quantile(from, row, column, 0.05));
    app_table_cell(table, "%.6g", lg_statistics_quantile(from, row, column, 0.5));
    app_table_cell(table, "%.6g", lg_statistics_quantile(from, row, column, 0.95));
    app_table_cell(table, "%.6g", cell.largest);
}

static void begin_table(app_table *table, const char *first) {
    const char *const heads[] = {first, "mean", "deviation", "least", "5 %", "median", "95 %", "largest"};
    app_table_begin(table, LG_COUNT(heads));
    for (size_t i = 0; i < LG_COUNT(heads); i++) app_table_cell(table, "%s", heads[i]);
}

static void print_failures(const result *what) {
    enum { SHOWN = 5 };
    if (what->listed == 0) return;
    (void)printf("\nfailed:");
    for (size_t i = 0; i < STATUSES; i++)
        if (what->failed[i] > 0)
            (void)printf(" %llu (%s)", (unsigned long long)what->failed[i], lg_status_sentence((lg_status)i));
    (void)printf("; members");
    for (size_t i = 0; i < what->listed && i < SHOWN; i++)
        (void)printf("%s %llu at t = %g", i > 0 ? "," : "", (unsigned long long)what->failures[i].member,
                     what->failures[i].t);
    (void)printf("%s\n", what->listed > SHOWN ? ", ..." : "");
}

void ensemble_text(const ensemble_run *run) {
    enum { SHOWN = 24 };
    const result *what = run->what;
    app_table table;
    (void)printf("%s\n", what->what);
    if (what->members == 0) {
        (void)printf("no members: blocks of %llu go to the parts, and the others have all %llu members\n",
                     (unsigned long long)what->block, (unsigned long long)what->total);
        if (run->out != NULL) (void)printf("\n%s: %zu points\n", run->out, what->points);
        return;
    }
    (void)printf("%llu members", (unsigned long long)what->members);
    if (what->members < what->total)
        (void)printf(" (%llu to %llu of %llu)", (unsigned long long)what->first,
                     (unsigned long long)(what->first + what->members) - 1, (unsigned long long)what->total);
    (void)printf(", %.4g steps each", (double)what->steps / (double)what->members);
    if (run->stats != NULL && run->stats->lanes > 1)
        (void)printf("; %zu lanes, %.1f %% in use", run->stats->lanes, 100.0 * run->stats->occupancy);
    if (run->stats != NULL && run->stats->lanes == 1) (void)printf("; one at a time");
    if (run->stats != NULL) (void)printf("; %.3g s", run->stats->seconds);
    (void)printf("\n\nt = %g\n", what->t[what->points - 1]);
    begin_table(&table, "");
    for (size_t c = 0; c < what->columns; c++)
        if (c < SHOWN || c + 2 >= what->columns)
            print_row(&table, what->column[c], what->states, what->points - 1, c);
    app_table_end(&table, stdout);
    if (what->events > 0) {
        (void)printf("\nTime of the first event\n");
        begin_table(&table, "");
        for (size_t e = 0; e < what->events; e++) print_row(&table, what->event[e], what->times, 0, e);
        app_table_end(&table, stdout);
        for (size_t e = 0; e < what->events; e++)
            (void)printf("%s: %llu members without\n", what->event[e],
                         (unsigned long long)(what->members - lg_statistics_of(what->times, 0, e).count));
    }
    print_failures(what);
    if (run->out != NULL) (void)printf("\n%s: %zu points\n", run->out, what->points);
}

/* ---- the end ---- */

int ensemble_conclude(const app *self, const ensemble_run *run) {
    const result *what = run->what;
    const uint64_t failed = result_failed(what);
    const bool all = failed > 0 && failed == what->total;
    size_t most = 0;
    if (failed > 0 && !all)
        app_warn(self, "%llu of %llu members failed; the statistics are of what they reached",
                 (unsigned long long)failed, (unsigned long long)what->members);
    if (self->json)
        ensemble_json(self, run);
    else
        ensemble_text(run);
    for (size_t i = 0; i < STATUSES; i++)
        if (what->failed[i] > what->failed[most]) most = i;
    return all ? app_fail(self, (lg_status)most, "all %llu members failed: %s", (unsigned long long)failed,
                          lg_status_sentence((lg_status)most))
               : APP_EXIT_OK;
}

/* ---- a picture: bands over time, histograms of the times of events ---- */

enum { PANELS = 6, BARS = 64 };

static void put_bands(app_plot *plot, const result *what, size_t column) {
    for (size_t row = 0; row < what->points; row++) {
        (void)fprintf(plot->data.stream, "%.9g", what->t[row]);
        for (size_t i = 0; i < LG_COUNT(shown_quantiles); i++)
            (void)fprintf(plot->data.stream, " %.9g",
                          lg_statistics_quantile(what->states, row, column, shown_quantiles[i].p));
        (void)fputc('\n', plot->data.stream);
    }
    app_plot_block(plot);
}

static void draw_bands(app_plot *plot, const result *what, size_t column, size_t index) {
    put_bands(plot, what, column);
    (void)fprintf(
        plot->script.stream,
        "set title '%s'\nset xlabel 't [s]'\nplot datafile index %zu using 1:2:8 with filledcurves lc rgb "
        "'#dbe7f4' title '1-99 %%', '' index %zu using 1:3:7 with filledcurves lc rgb '#b3cde6' title "
        "'5-95 %%', '' index %zu using 1:4:6 with filledcurves lc rgb '#7fa8d1' title '25-75 %%', '' index "
        "%zu using 1:5 with lines lw 1.6 lc rgb '#1f5fa8' title 'median'\n",
        what->column[column], index, index, index, index);
}

static void draw_times(app_plot *plot, const result *what, size_t event, size_t index) {
    const lg_statistics_range range = lg_statistics_range_at(what->times, 0, event);
    const uint64_t *bins = lg_statistics_bins(what->times, 0, event);
    const size_t each = 256 / BARS;
    const double width = (range.high - range.low) / BARS;
    for (size_t i = 0; i < BARS; i++) {
        uint64_t sum = 0;
        for (size_t k = 0; k < each; k++) sum += bins[1 + i * each + k];
        (void)fprintf(plot->data.stream, "%.9g %llu\n", range.low + ((double)i + 0.5) * width,
                      (unsigned long long)sum);
    }
    app_plot_block(plot);
    (void)fprintf(
        plot->script.stream,
        "set title 'first %s'\nset xlabel 't [s]'\nplot datafile index %zu using 1:2 with boxes fs solid 0.6 "
        "lc rgb '#d1641f' notitle\n",
        what->event[event], index);
}

lg_status ensemble_draw(const app *self, const result *what, const char *path, lg_error *error) {
    app_plot plot;
    size_t chosen[PANELS], shown = 0;
    for (size_t c = 0; c < what->columns && shown < PANELS; c++)
        if (strncmp(what->column[c], "drift of ", 9) != 0) chosen[shown++] = c;
    const size_t panels = shown + what->events, columns = panels > 1 ? 2 : 1,
                 rows = (panels + columns - 1) / columns;
    app_plot_begin(&plot, path, 560 * (int)columns, 340 * (int)rows);
    (void)fprintf(plot.script.stream,
                  "set encoding utf8\nset tics nomirror\nset key below\nset multiplot layout %zu,%zu\n", rows,
                  columns);
    for (size_t i = 0; i < shown; i++) {
        draw_bands(&plot, what, chosen[i], i);
        (void)fputs("unset key\n", plot.script.stream); /* the first panel has it */
    }
    for (size_t e = 0; e < what->events; e++) draw_times(&plot, what, e, shown + e);
    (void)fputs("unset multiplot\n", plot.script.stream);
    return app_plot_end(self, &plot, error);
}
