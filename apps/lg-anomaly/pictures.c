/* Pictures of points, lines and recordings. */
#include "lg-anomaly/pictures.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { SHOWN_POINTS = 1200, PAIRED_POINTS = 350, SHOWN_COLUMNS = 8, BINS = 40, SHOWN_SAMPLES = 1800 };

static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2e8b57", "#8b3a8b", "#b8860b",
                                      "#17a2b8", "#6b4423", "#5d6d7e", "#7cb342", "#e377c2"};

const char *class_colour(size_t i) {
    return colours[i % LG_COUNT(colours)];
}

void put_text(FILE *script, const char *text) {
    (void)fputc('"', script);
    for (; *text != '\0'; text++) {
        if (*text == '"' || *text == '\\') (void)fputc('\\', script);
        if ((unsigned char)*text >= ' ') (void)fputc(*text, script);
    }
    (void)fputs("\" noenhanced", script);
}

/* ---- points by class: data block c has the points of class c ---- */

/* Writes about `limit` points at most, evenly chosen from each class. The block of a class without points has
 * one NaN point, which gnuplot does not draw. */
static void put_points(app_plot *plot, const labelled *points, size_t limit) {
    const size_t every = points->count / limit + 1;
    for (uint32_t c = 0; c < points->classes; c++) {
        size_t seen = 0;
        for (size_t i = 0; i < points->count; i++) {
            if (points->label[i] != c || seen++ % every != 0) continue;
            for (uint32_t k = 0; k < points->columns; k++)
                (void)fprintf(plot->data.stream, "%.6g ", points->x[i * points->columns + k]);
            (void)fputc('\n', plot->data.stream);
        }
        for (uint32_t k = 0; seen == 0 && k < points->columns; k++) (void)fputs("NaN ", plot->data.stream);
        if (seen == 0) (void)fputc('\n', plot->data.stream);
        app_plot_block(plot);
    }
}

static void put_axis(FILE *script, char axis, const char *name) {
    (void)fprintf(script, "set %clabel ", axis);
    put_text(script, name);
    (void)fputs(strlen(name) > 16 ? " font ',7'\n" : "\n", script);
}

/* Writes "datafile index c using a:b[:c] ..." for every class c. `titles` adds each class name with a larger
 * point to the key. */
static void put_classes(FILE *script, const labelled *points, const char *columns, double size, bool titles) {
    for (uint32_t c = 0; c < points->classes; c++)
        (void)fprintf(script, "%sdatafile index %u using %s with points pt 7 ps %g lc rgb '%s' notitle",
                      c == 0 ? "" : ", ", c, columns, size, class_colour(c));
    for (uint32_t c = 0; titles && c < points->classes; c++) {
        (void)fprintf(script, ", keyentry with points pt 7 ps 0.8 lc rgb '%s' title ", class_colour(c));
        put_text(script, points->class_name[c]);
    }
}

/* ---- scatter plots of pairs of columns ---- */

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
        (void)fprintf(plot->data.stream, "%.6g", s.low + ((double)bin + 0.5) / BINS * (s.high - s.low));
        for (uint32_t c = 0; c < points->classes; c++)
            (void)fprintf(plot->data.stream, " %.5g",
                          total[c] == 0 ? 0.0 : (double)count[bin * points->classes + c] / (double)total[c]);
        (void)fputc('\n', plot->data.stream);
    }
    app_plot_block(plot);
}

static void put_panel(FILE *script, const labelled *points, uint32_t row, uint32_t column,
                      const span *spans) {
    (void)fprintf(script, "set xrange [%.6g:%.6g]\n", spans[column].low, spans[column].high);
    if (row != column) {
        char columns[32];
        (void)snprintf(columns, sizeof columns, "%u:%u", column + 1, row + 1);
        (void)fprintf(script, "set yrange [%.6g:%.6g]\nplot ", spans[row].low, spans[row].high);
        put_classes(script, points, columns, 0.18, false);
        (void)fputc('\n', script);
        return;
    }
    (void)fputs("set yrange [0:*]\nplot ", script);
    for (uint32_t c = 0; c < points->classes; c++) {
        (void)fprintf(
            script,
            "%sdatafile index %u using 1:%u with filledcurves y1=0 fs transparent solid 0.45 lc rgb "
            "'%s' title ",
            c == 0 ? "" : ", ", points->classes + column, c + 2, class_colour(c));
        put_text(script, points->class_name[c]);
    }
    (void)fputc('\n', script);
}

lg_status draw_pairs(const app *self, const char *picture, const labelled *points, lg_error *error) {
    app_plot plot;
    const uint32_t shown = points->columns < SHOWN_COLUMNS ? points->columns : SHOWN_COLUMNS;
    const int size = 150 * (int)shown + 120;
    app_plot_begin(&plot, picture, size < 420 ? 420 : size, size < 420 ? 420 : size);
    FILE *script = plot.script.stream;
    span spans[SHOWN_COLUMNS];
    put_points(&plot, points, PAIRED_POINTS);
    for (uint32_t k = 0; k < shown; k++) spans[k] = column_span(points, k);
    for (uint32_t k = 0; k < shown; k++) put_histogram(&plot, points, k, spans[k]);
    if (shown == 1) { /* only the distribution */
        put_axis(script, 'x', points->column_name[0]);
        put_axis(script, 'y', "part of the windows");
        put_panel(script, points, 0, 0, spans);
        return app_plot_end(self, &plot, error);
    }
    (void)fprintf(script,
                  "set multiplot layout %u,%u margins 0.07,0.99,0.07,0.97 spacing 0.012\n"
                  "set key samplen 1 font ',9'\nunset xtics\nunset ytics\n",
                  shown, shown);
    for (uint32_t row = 0; row < shown; row++)
        for (uint32_t column = 0; column < shown; column++) {
            (void)fputs(row == 0 && column == 0 ? "set key\n" : "unset key\n", script);
            put_axis(script, 'y', column == 0 ? points->column_name[row] : "");
            put_axis(script, 'x', row + 1 == shown ? points->column_name[column] : "");
            put_panel(script, points, row, column, spans);
        }
    (void)fputs("unset multiplot\n", script);
    return app_plot_end(self, &plot, error);
}

/* ---- clouds and planes ---- */

/* Labels the axes x, y and z with columns at[0], at[1] and at[2]. */
static void put_space(FILE *script, const labelled *points, const uint32_t at[3]) {
    for (uint32_t k = 0; k < 3; k++) put_axis(script, "xyz"[k], points -> column_name[at[k]]);
    (void)fputs("set zlabel rotate by 90\nset xyplane relative 0\nset view 62,38\nset ticslevel 0\n", script);
}

lg_status draw_clouds(const app *self, const char *picture, const labelled *points, lg_error *error) {
    app_plot plot;
    const bool space = points->columns >= 3;
    app_plot_begin(&plot, picture, space ? 1240 : 720, 600);
    FILE *script = plot.script.stream;
    put_points(&plot, points, 2 * SHOWN_POINTS);
    if (space) (void)fputs("set multiplot layout 1,2\n", script);
    put_axis(script, 'x', points->column_name[0]);
    put_axis(script, 'y', points->columns > 1 ? points->column_name[1] : "");
    (void)fputs("plot ", script);
    put_classes(script, points, points->columns > 1 ? "1:2" : "1:(0)", 0.35, true);
    if (space) {
        (void)fputs("\n", script);
        put_space(script, points, (const uint32_t[3]){0, 1, 2});
        (void)fputs("splot ", script);
        put_classes(script, points, "1:2:3", 0.3, true);
        (void)fputs("\nunset multiplot", script);
    }
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, error);
}

/* Chooses the vertical axis: the column in which the plane's normal is longest, measured in lengths of the
 * axes. The plane's equation is solved for this column. */
static void upright(const span s[3], const double *w, uint32_t column[3]) {
    uint32_t best = 2;
    for (uint32_t k = 0; k < 3; k++)
        if (fabs(w[k]) * (s[k].high - s[k].low) > fabs(w[best]) * (s[best].high - s[best].low)) best = k;
    column[0] = best == 0 ? 1 : 0;
    column[1] = best == 2 ? 1 : 2;
    column[2] = best;
}

lg_status draw_margin(const app *self, const char *picture, const labelled *points, const double *w, double b,
                      lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 900, 720);
    FILE *script = plot.script.stream;
    span s[3];
    uint32_t at[3];
    char columns[32];
    put_points(&plot, points, SHOWN_POINTS);
    for (uint32_t k = 0; k < 3; k++) s[k] = column_span(points, k);
    upright(s, w, at);
    (void)snprintf(columns, sizeof columns, "%u:%u:%u", at[0] + 1, at[1] + 1, at[2] + 1);
    put_space(script, points, at);
    for (uint32_t k = 0; k < 3; k++)
        (void)fprintf(script, "set %crange [%.6g:%.6g]\n", "xyz"[k], s[at[k]].low, s[at[k]].high);
    (void)fprintf(script,
                  "set isosamples 14\nplane(x, y, m) = (m - (%.9g) - (%.9g)*x - (%.9g)*y)/(%.9g)\n"
                  "cut(z) = z < %.6g || z > %.6g ? NaN : z\nset key top right\nset lmargin at screen "
                  "0.1\nsplot ",
                  b, w[at[0]], w[at[1]], w[at[2]] == 0 ? 1e-300 : w[at[2]], s[at[2]].low, s[at[2]].high);
    put_classes(script, points, columns, 0.3, true);
    (void)fputs(", cut(plane(x, y, 0)) with lines lc rgb '#333333' title 'plane'"
                ", cut(plane(x, y, 1)) with lines dt 3 lc rgb '#999999' title 'margin'"
                ", cut(plane(x, y, -1)) with lines dt 3 lc rgb '#999999' notitle\n",
                script);
    return app_plot_end(self, &plot, error);
}

lg_status draw_plane(const app *self, const char *picture, const labelled *points, const double *w, double b,
                     lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 760, 600);
    FILE *script = plot.script.stream;
    put_points(&plot, points, 2 * SHOWN_POINTS);
    const span x = column_span(points, 0), y = column_span(points, 1);
    put_axis(script, 'x', points->column_name[0]);
    put_axis(script, 'y', points->column_name[1]);
    (void)fprintf(script,
                  "set xrange [%.6g:%.6g]\nset yrange [%.6g:%.6g]\nset parametric\nset trange [-1:1]\n",
                  x.low, x.high, y.low, y.high);
    (void)fputs("plot ", script);
    put_classes(script, points, "1:2", 0.4, true);
    const double norm = w == NULL ? 0 : hypot(w[0], w[1]);
    if (norm > 0) { /* the point of the line nearest to the origin, and the direction of the line */
        const double far = 2 * (x.high - x.low + y.high - y.low + fabs(b) / norm);
        (void)fprintf(
            script, ", %.9g + t*%.9g, %.9g + t*%.9g with lines lw 1.5 lc rgb '#333333' title 'decision'",
            -b * w[0] / (norm * norm), -far * w[1] / norm, -b * w[1] / (norm * norm), far * w[0] / norm);
    }
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, error);
}

/* ---- regression lines of the baseline ---- */

lg_status draw_regressions(const app *self, const char *picture, const regression *lines, size_t count,
                           char (*class_name)[LG_SERIES_NAME], lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 1240, 560);
    FILE *script = plot.script.stream;
    uint32_t classes = 0;
    for (size_t i = 0; i < count; i++)
        if (lines[i].label >= classes) classes = lines[i].label + 1;
    /* One block of lines per class; then one block of (intercept, slope) points per class. */
    for (uint32_t c = 0; c < classes; c++) {
        for (size_t i = 0; i < count; i++) {
            const regression *line = &lines[i];
            if (line->label != c || line->count == 0) continue;
            double low = DBL_MAX, high = -DBL_MAX;
            for (size_t k = 0; k < line->count; k++) {
                low = fmin(low, line->acceleration[k]);
                high = fmax(high, line->acceleration[k]);
            }
            for (int end = 0; end < 2; end++)
                (void)fprintf(plot.data.stream, "%.6g %.6g\n", end == 0 ? low : high,
                              line->intercept + line->slope * (end == 0 ? low : high));
            (void)fputc('\n', plot.data.stream);
        }
        (void)fputs("NaN NaN\n", plot.data.stream);
        app_plot_block(&plot);
    }
    for (uint32_t c = 0; c < classes; c++) {
        for (size_t i = 0; i < count; i++)
            if (lines[i].label == c)
                (void)fprintf(plot.data.stream, "%.6g %.6g\n", lines[i].intercept, lines[i].slope);
        (void)fputs("NaN NaN\n", plot.data.stream);
        app_plot_block(&plot);
    }
    (void)fputs("set multiplot layout 1,2\nset xlabel 'standard deviation of the acceleration'\n"
                "set ylabel 'standard deviation of the moment'\nset key left top\nplot ",
                script);
    for (uint32_t part = 0; part < 2; part++) {
        for (uint32_t c = 0; c < classes; c++) {
            (void)fprintf(script, "%sdatafile index %u using 1:2 with %s lc rgb '%s' title ",
                          c == 0 ? "" : ", ", part * classes + c,
                          part == 0 ? "lines lw 0.6" : "points pt 7 ps 0.3", class_colour(c));
            put_text(script, class_name[c]);
        }
        (void)fputs(part == 0 ? "\nset xlabel 'intercept'\nset ylabel 'slope'\nplot " : "\nunset multiplot\n",
                    script);
    }
    return app_plot_end(self, &plot, error);
}

/* ---- recordings ---- */

static void put_recordings(app_plot *plot, const recording *runs, size_t count, uint32_t channels,
                           double rate) {
    for (size_t r = 0; r < count; r++) {
        const size_t every = runs[r].count / SHOWN_SAMPLES + 1;
        for (size_t i = 0; i < runs[r].count; i += every) {
            (void)fprintf(plot->data.stream, "%.6g", rate > 0 ? (double)i / rate / 60 : (double)i);
            for (uint32_t c = 0; c < channels; c++)
                (void)fprintf(plot->data.stream, " %.5g", (double)runs[r].samples[i * channels + c]);
            (void)fputc('\n', plot->data.stream);
        }
        app_plot_block(plot);
    }
}

static void put_channel(FILE *script, const recording *runs, size_t count, const char *columns,
                        const char *style) {
    (void)fputs("plot ", script);
    for (size_t r = count; r-- > 0;) { /* the first recording is drawn last, on top */
        (void)fprintf(script, "%sdatafile index %zu using %s with %s lc rgb '%s' title ",
                      r + 1 == count ? "" : ", ", r, columns, style, class_colour(r));
        put_text(script, runs[r].name);
    }
    (void)fputc('\n', script);
}

lg_status draw_recordings(const app *self, const char *picture, const recording *runs, size_t count,
                          uint32_t channels, char (*channel_name)[LG_SERIES_NAME], double rate,
                          lg_error *error) {
    app_plot plot;
    const uint32_t pairs = channels >= 6 ? 2 : 0; /* moment against lower acceleration, for x and y */
    const uint32_t rows = (channels + 1) / 2 + (pairs > 0 ? 1 : 0);
    app_plot_begin(&plot, picture, 1240, 210 * (int)rows + 60);
    FILE *script = plot.script.stream;
    char columns[32], name[LG_SERIES_NAME + 16];
    put_recordings(&plot, runs, count, channels, rate);
    (void)fprintf(script, "set multiplot layout %u,2\nset key samplen 1\n", rows);
    for (uint32_t c = 0; c < channels; c++) {
        (void)snprintf(name, sizeof name, "channel %u", c);
        put_axis(script, 'y', channel_name != NULL && channel_name[c][0] != '\0' ? channel_name[c] : name);
        put_axis(script, 'x', rate > 0 ? "minutes" : "samples");
        (void)snprintf(columns, sizeof columns, "1:%u", c + 2);
        put_channel(script, runs, count, columns, "lines lw 0.4");
    }
    for (uint32_t p = 0; p < pairs; p++) {
        put_axis(script, 'x', channel_name != NULL ? channel_name[p] : "acceleration");
        put_axis(script, 'y', channel_name != NULL ? channel_name[p + 4] : "moment");
        (void)snprintf(columns, sizeof columns, "%u:%u", p + 2, p + 6);
        put_channel(script, runs, count, columns, "dots");
    }
    (void)fputs("unset multiplot\n", script);
    return app_plot_end(self, &plot, error);
}
