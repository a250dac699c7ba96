/* Pictures of points, lines and recordings. */
#include <float.h>
#include <math.h>

#include "lg-anomaly/anomaly.h"

enum { SHOWN_POINTS = 1200, PAIRED_POINTS = 350, SHOWN_COLUMNS = 8, BINS = 40, SHOWN_SAMPLES = 1800 };

/* ---- points by class ---- */

/* Writes the first columns of every `every`-th point of a class as a block. A block without points has one
 * NaN point, which gnuplot does not draw. */
static void put_class(app_plot *plot, const labelled *points, uint32_t columns, uint32_t c, size_t every) {
    size_t seen = 0;
    for (size_t i = 0; i < points->count; i++) {
        if (points->label[i] != c || seen++ % every != 0) continue;
        for (uint32_t k = 0; k < columns; k++)
            (void)fprintf(plot->data, "%.6g ", points->x[i * points->columns + k]);
        (void)fputc('\n', plot->data);
    }
    for (uint32_t k = 0; seen == 0 && k < columns; k++) (void)fputs("NaN ", plot->data);
    (void)fputc('\n', plot->data);
    app_plot_block(plot);
}

/* Begins a picture of the first columns of points: the numbers and names of columns and classes, and about
 * `limit` points at most, evenly chosen from each class. */
static void begin_points(app_plot *plot, const char *script, const char *picture, int width, int height,
                         const labelled *points, uint32_t columns, size_t limit) {
    app_plot_begin(plot, script, picture, width, height);
    app_plot_text(plot, "%u", columns);
    app_plot_text(plot, "%u", points->classes);
    for (uint32_t k = 0; k < columns; k++) app_plot_text(plot, "%s", points->column_name[k]);
    for (uint32_t c = 0; c < points->classes; c++) {
        app_plot_text(plot, "%s", points->class_name[c]);
        put_class(plot, points, columns, c, points->count / limit + 1);
    }
}

typedef struct span {
    double low, high;
} span;

static span column_span(const labelled *points, uint32_t k) {
    span s = {DBL_MAX, -DBL_MAX};
    for (size_t i = 0; i < points->count; i++) {
        const double x = points->x[i * points->columns + k];
        s.low = fmin(s.low, x);
        s.high = fmax(s.high, x);
    }
    const double room = s.high > s.low ? 0.03 * (s.high - s.low) : 0.5 * fabs(s.low) + 0.5;
    return (span){s.low - room, s.high + room};
}

static span put_span(app_plot *plot, const labelled *points, uint32_t k) {
    const span s = column_span(points, k);
    app_plot_text(plot, "%.6g", s.low);
    app_plot_text(plot, "%.6g", s.high);
    return s;
}

/* The histogram of column k as a data block: each line has the middle of a bin, and for each class the
 * fraction of its points in this bin. */
static void put_histogram(app_plot *plot, const labelled *points, uint32_t k, span s) {
    const size_t cells = (size_t)BINS * points->classes;
    APP_FREE size_t *count = app_alloc(cells, sizeof *count);
    APP_FREE size_t *total = app_alloc(points->classes, sizeof *total);
    for (size_t i = 0; i < points->count; i++) {
        const double at = (points->x[i * points->columns + k] - s.low) / (s.high - s.low) * BINS;
        const size_t bin = at < 0 ? 0 : at >= BINS ? BINS - 1 : (size_t)at;
        count[bin * points->classes + points->label[i]]++;
        total[points->label[i]]++;
    }
    for (size_t bin = 0; bin < BINS; bin++) {
        (void)fprintf(plot->data, "%.6g", s.low + ((double)bin + 0.5) / BINS * (s.high - s.low));
        for (uint32_t c = 0; c < points->classes; c++)
            (void)fprintf(plot->data, " %.5g",
                          total[c] == 0 ? 0.0 : (double)count[bin * points->classes + c] / (double)total[c]);
        (void)fputc('\n', plot->data);
    }
    app_plot_block(plot);
}

lg_status draw_pairs(const app *self, const char *picture, const labelled *points, lg_error *error) {
    app_plot plot;
    const uint32_t shown = points->columns < SHOWN_COLUMNS ? points->columns : SHOWN_COLUMNS;
    const int size = shown > 2 ? 150 * (int)shown + 120 : 420;
    begin_points(&plot, "pairs", picture, size, size, points, shown, PAIRED_POINTS);
    for (uint32_t k = 0; k < shown; k++) put_histogram(&plot, points, k, put_span(&plot, points, k));
    return app_plot_end(self, &plot, error);
}

lg_status draw_clouds(const app *self, const char *picture, const labelled *points, lg_error *error) {
    app_plot plot;
    const uint32_t shown = points->columns < 3 ? points->columns : 3;
    begin_points(&plot, "clouds", picture, shown == 3 ? 1240 : 720, 600, points, shown, 2 * SHOWN_POINTS);
    return app_plot_end(self, &plot, error);
}

/* Chooses the vertical axis: the column in which the plane's normal is longest, measured in lengths of the
 * axes. The plane's equation is solved for this column. */
static void upright(const labelled *points, const double *w, uint32_t column[3]) {
    double length[3];
    uint32_t best = 2;
    for (uint32_t k = 0; k < 3; k++) {
        const span s = column_span(points, k);
        length[k] = fabs(w[k]) * (s.high - s.low);
    }
    for (uint32_t k = 0; k < 3; k++)
        if (length[k] > length[best]) best = k;
    column[0] = best == 0 ? 1 : 0;
    column[1] = best == 2 ? 1 : 2;
    column[2] = best;
}

lg_status draw_margin(const app *self, const char *picture, const labelled *points, const double *w, double b,
                      lg_error *error) {
    app_plot plot;
    uint32_t at[3];
    begin_points(&plot, "margin", picture, 900, 720, points, 3, SHOWN_POINTS);
    upright(points, w, at);
    for (uint32_t k = 0; k < 3; k++) {
        app_plot_text(&plot, "%u", at[k] + 1);
        (void)put_span(&plot, points, at[k]);
        app_plot_text(&plot, "%.9g", k == 2 && w[at[k]] == 0 ? 1e-300 : w[at[k]]);
    }
    app_plot_text(&plot, "%.9g", b);
    return app_plot_end(self, &plot, error);
}

lg_status draw_plane(const app *self, const char *picture, const labelled *points, const double *w, double b,
                     lg_error *error) {
    app_plot plot;
    begin_points(&plot, "plane", picture, 760, 600, points, 2, 2 * SHOWN_POINTS);
    const span x = put_span(&plot, points, 0), y = put_span(&plot, points, 1);
    const double norm = w == NULL ? 0 : hypot(w[0], w[1]);
    app_plot_text(&plot, "%d", norm > 0);
    if (norm > 0) { /* from the line's point nearest to the origin, far in both directions */
        const double far = 2 * (x.high - x.low + y.high - y.low + fabs(b) / norm);
        for (int side = -1; side <= 1; side += 2)
            (void)fprintf(plot.data, "%.9g %.9g\n", (-b * w[0] / norm - side * far * w[1]) / norm,
                          (-b * w[1] / norm + side * far * w[0]) / norm);
    } else {
        (void)fputs("NaN NaN\n", plot.data);
    }
    return app_plot_end(self, &plot, error);
}

/* ---- regression lines of the baseline ---- */

/* Writes the two ends of a line, over the segments of its window. */
static void put_line(app_plot *plot, const regression *line) {
    double ends[2] = {DBL_MAX, -DBL_MAX};
    for (size_t k = 0; k < line->count; k++) {
        ends[0] = fmin(ends[0], line->acceleration[k]);
        ends[1] = fmax(ends[1], line->acceleration[k]);
    }
    for (int end = 0; line->count > 0 && end < 2; end++)
        (void)fprintf(plot->data, "%.6g %.6g\n", ends[end], line->intercept + line->slope * ends[end]);
    (void)fputc('\n', plot->data);
}

lg_status draw_regressions(const app *self, const char *picture, const regression *lines, size_t count,
                           uint32_t classes, char (*class_name)[LG_SERIES_NAME], lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, "regressions", picture, 1240, 560);
    app_plot_text(&plot, "%u", classes);
    for (uint32_t c = 0; c < classes; c++) app_plot_text(&plot, "%s", class_name[c]);
    for (uint32_t block = 0; block < 2 * classes; block++) {
        for (size_t i = 0; i < count; i++) {
            if (lines[i].label != block % classes) continue;
            if (block < classes)
                put_line(&plot, &lines[i]);
            else
                (void)fprintf(plot.data, "%.6g %.6g\n", lines[i].intercept, lines[i].slope);
        }
        (void)fputs("NaN NaN\n", plot.data);
        app_plot_block(&plot);
    }
    return app_plot_end(self, &plot, error);
}

/* ---- recordings ---- */

lg_status draw_recordings(const app *self, const char *picture, const recording *runs, size_t count,
                          uint32_t channels, char (*channel_name)[LG_SERIES_NAME], double rate,
                          lg_error *error) {
    app_plot plot;
    const int rows = (int)(channels + 1) / 2 + (channels >= 6);
    app_plot_begin(&plot, "recordings", picture, 1240, 210 * rows + 60);
    app_plot_text(&plot, "%zu", count);
    app_plot_text(&plot, "%u", channels);
    for (size_t r = 0; r < count; r++) app_plot_text(&plot, "%s", runs[r].name);
    for (uint32_t c = 0; c < channels; c++) app_plot_text(&plot, "%s", channel_name[c]);
    for (size_t r = 0; r < count; r++) {
        const size_t every = runs[r].count / SHOWN_SAMPLES + 1;
        for (size_t i = 0; i < runs[r].count; i += every) {
            (void)fprintf(plot.data, "%.6g", (double)i / rate / 60);
            for (uint32_t c = 0; c < channels; c++)
                (void)fprintf(plot.data, " %.5g", (double)runs[r].samples[i * channels + c]);
            (void)fputc('\n', plot.data);
        }
        app_plot_block(&plot);
    }
    return app_plot_end(self, &plot, error);
}
