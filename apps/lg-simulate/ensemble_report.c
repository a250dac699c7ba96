/* The results of an ensemble, and a plot with bands of quantiles. */
#include "lg-simulate/ensemble.h"

#include <string.h>

enum { SHOWN = 24, SHOWN_FAILURES = 5 };

/* Only those with `shown` are printed for people. */
static const struct {
    const char *name;
    double p;
    bool shown;
} quantiles[] = {{"q01", 0.01, false}, {"q05", 0.05, true}, {"q25", 0.25, false}, {"median", 0.5, true},
                 {"q75", 0.75, false}, {"q95", 0.95, true}, {"q99", 0.99, false}};

static void put_cell(app_json *out, const lg_statistics *from, size_t row, size_t column) {
    const lg_statistics_cell cell = lg_statistics_of(from, row, column);
    if (!out->people) app_json_size(out, "count", cell.count);
    APP_PUT(out, LG_AS_REAL("mean", cell.mean), LG_AS_REAL("deviation", cell.deviation),
            LG_AS_REAL("least", cell.least), LG_AS_REAL("largest", cell.largest));
    for (size_t i = 0; i < LG_COUNT(quantiles); i++)
        if (!out->people || quantiles[i].shown)
            app_json_real(out, quantiles[i].name, lg_statistics_quantile(from, row, column, quantiles[i].p));
    if (!out->people) app_json_real(out, "resolution", cell.resolution);
}

static void put_failures(app_json *out, const result *what) {
    const size_t listed = out->people && what->listed > SHOWN_FAILURES ? SHOWN_FAILURES : what->listed;
    app_json_put(out, LG_WHOLE("failed", result_failed(what), "members failed"));
    app_json_open(out, "failed_by_status", '{');
    for (size_t i = 0; i < STATUSES; i++)
        if (what->failed[i] > 0)
            app_json_put(out, LG_WHOLE(lg_status_name((lg_status)i), what->failed[i],
                                       lg_status_sentence((lg_status)i)));
    app_json_close(out, '}');
    app_result_rows(out, "failures");
    for (size_t i = 0; i < listed; i++)
        APP_OBJECT(out, NULL, LG_AS_WHOLE("member", what->who[i][0]),
                   LG_AS_TEXT("status", lg_status_name((lg_status)what->who[i][1])),
                   LG_AS_REAL("t", what->when[i]));
    app_result_rows_end(out);
}

static void report_ensemble(app_json *out, const result *what, const lg_ensemble_stats *stats,
                            const char *path) {
    APP_PUT(out, LG_TEXT("ensemble", what->what, NULL),
            LG_WHOLE("total", what->total, "members of the ensemble"), LG_WHOLE("first", what->first, NULL),
            LG_WHOLE("members", what->members, "of this run, from the first on"),
            LG_AS_WHOLE("block", what->block), LG_WHOLE("steps", what->steps, "of all members"),
            LG_WHOLE("rejected", what->rejected, NULL));
    if (stats != NULL)
        APP_PUT(out, LG_WHOLE("lanes", stats->lanes, "1: one member at a time"),
                LG_REAL("occupancy", stats->occupancy, "part of the lanes in use"),
                LG_REAL("seconds", stats->seconds, NULL));
    put_failures(out, what);
    if (what->members == 0)
        app_result_line(out,
                        "this part has no members: parts get blocks of %llu members, and other parts have "
                        "all %llu members",
                        (unsigned long long)what->block, (unsigned long long)what->total);
    app_result_real(out, "t", what->t[what->points - 1], "of the states below");
    app_result_named(out, "end", "at the end");
    for (size_t c = 0; c < what->columns; c++) {
        if (out->people && c >= SHOWN && c + 2 < what->columns) continue;
        app_json_open(out, what->column[c], '{');
        put_cell(out, what->states, what->points - 1, c);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    if (what->events > 0) app_result_line(out, "\nTime of the first event");
    app_result_named(out, "events", "event");
    for (size_t e = 0; e < what->events; e++) {
        app_json_open(out, what->event[e], '{');
        put_cell(out, what->times, 0, e);
        app_json_size(out, "without", what->members - lg_statistics_of(what->times, 0, e).count);
        app_json_close(out, '}');
    }
    app_result_rows_end(out);
    APP_PUT(out, LG_TEXT("out", path, NULL), LG_WHOLE("points", what->points, NULL));
}

void ensemble_conclude(const app *self, const result *what, const lg_ensemble_stats *stats, const char *out) {
    const uint64_t failed = result_failed(what);
    const bool all = failed > 0 && failed == what->total;
    size_t most = 0;
    if (failed > 0 && !all)
        app_warn(self, "%llu of %llu members failed; the statistics include them up to their failure",
                 (unsigned long long)failed, (unsigned long long)what->members);
    report_ensemble(self->out, what, stats, out);
    app_result_end(self);
    for (size_t i = 0; i < STATUSES; i++)
        if (what->failed[i] > what->failed[most]) most = i;
    if (all)
        app_stop(self, (lg_status)most, "all %llu members failed: %s", (unsigned long long)failed,
                 lg_status_sentence((lg_status)most));
}

/* ---- the plot: bands of quantiles over time, histograms of the times of events ---- */

enum { PANELS = 6, BARS = 64 };

static void put_times(app_plot *plot, const result *what, size_t event) {
    const lg_statistics_range range = lg_statistics_range_at(what->times, 0, event);
    const uint64_t *bins = lg_statistics_bins(what->times, 0, event);
    const size_t each = 256 / BARS;
    const double width = (range.high - range.low) / BARS;
    for (size_t i = 0; i < BARS; i++) {
        uint64_t sum = 0;
        for (size_t k = 0; k < each; k++) sum += bins[1 + i * each + k];
        APP_PLOT_ROW(plot, 9, range.low + ((double)i + 0.5) * width, (double)sum);
    }
    app_plot_block(plot);
}

static void put_ensemble(app_plot *plot, const void *total) {
    const result *what = total;
    size_t chosen[PANELS], shown = 0;
    for (size_t c = 0; c < what->columns && shown < PANELS; c++)
        if (strncmp(what->column[c], "drift of ", 9) != 0) chosen[shown++] = c;
    app_plot_text(plot, "%zu\t%zu", shown, shown + (size_t)what->events);
    for (size_t i = 0; i < shown; i++) {
        app_plot_text(plot, "%s", what->column[chosen[i]]);
        for (size_t row = 0; row < what->points; row++) {
            double line[1 + LG_COUNT(quantiles)] = {what->t[row]};
            for (size_t q = 0; q < LG_COUNT(quantiles); q++)
                line[1 + q] = lg_statistics_quantile(what->states, row, chosen[i], quantiles[q].p);
            APP_PLOT_COLUMNS(plot, 9, 1, {line, 0, LG_COUNT(line)});
        }
        app_plot_block(plot);
    }
    for (size_t e = 0; e < what->events; e++) {
        app_plot_text(plot, "first %s", what->event[e]);
        put_times(plot, what, e);
    }
}

const app_plot_kind ensemble_plots[] = {
    APP_PLOT("ensemble", "the bands of quantiles over time", "ensemble", put_ensemble), {.name = NULL}};
