/* The pictures of lg-elastica. */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

enum { SHOWN_CURVES = 24, SMOOTH_POINTS = 400 };

static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2e8b57", "#8b3a8b", "#b8860b", "#c0392b",
                                      "#17a2b8", "#6b4423", "#5d6d7e", "#7cb342", "#e377c2", "#3f51b5"};
static const char true_colour[] = "#1f5fa8", learned_colour[] = "#d1641f";

static const char *colour(size_t i) {
    return colours[i % LG_COUNT(colours)];
}

/* Writes a data block with a polyline of `points` points. */
static void put_pairs(app_plot *plot, const double *pairs, size_t points) {
    for (size_t k = 0; k < points; k++)
        (void)fprintf(plot->data.stream, "%.9g %.9g\n", pairs[2 * k], pairs[2 * k + 1]);
    app_plot_block(plot);
}

/* Writes a data block with a beam, interpolated by cubic Hermite polynomials. */
static void put_beam(app_plot *plot, const beam_curve *curve) {
    const double *q = curve->at.q, *v = curve->at.v;
    const size_t intervals = curve->problem.intervals;
    const double h = curve->problem.length / (double)intervals;
    const size_t parts = intervals < SMOOTH_POINTS ? (SMOOTH_POINTS + intervals - 1) / intervals : 1;
    for (size_t k = 0; k < intervals; k++)
        for (size_t i = 0; i < parts + (k + 1 == intervals); i++) {
            const double t = (double)i / (double)parts, a = t * t * (3 - 2 * t), b = t * (1 - t) * (1 - t),
                         c = t * t * (t - 1);
            for (size_t d = 0; d < 2; d++)
                (void)fprintf(plot->data.stream, "%.9g%c",
                              q[2 * k + d] * (1 - a) + q[2 * k + 2 + d] * a +
                                  h * (v[2 * k + d] * b + v[2 * k + 2 + d] * c),
                              d == 0 ? ' ' : '\n');
        }
    app_plot_block(plot);
}

/* ---- plots with equal scales on both axes ---- */

typedef struct box {
    double low[2], high[2];
} box;

static const box empty_box = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};

static void extend(box *b, const double *pairs, size_t points) {
    for (size_t i = 0; i < 2 * points; i++) {
        b->low[i % 2] = fmin(b->low[i % 2], pairs[i]);
        b->high[i % 2] = fmax(b->high[i % 2], pairs[i]);
    }
}

/* Height in pixels of a picture in which the curves are 720 pixels wide. */
static int height_of(const box *b) {
    const double dx = fmax(b->high[0] - b->low[0], 1e-6), dy = b->high[1] - b->low[1];
    const double height = 1.12 * 720 * dy / dx;
    return (height < 120 ? 120 : height > 800 ? 800 : (int)height) + 110;
}

/* Begins a plot. The tics of y have steps of 1, 2 or 5 times a power of ten: about four steps, fewer if the
 * box is low. */
static void begin_plane(app_plot *plot, const char *picture, const box *b, int width, int height) {
    const double dx = fmax(b->high[0] - b->low[0], 1e-6), dy = fmax(b->high[1] - b->low[1], 1e-6);
    const double steps = fmin(4, fmax(1, 20 * dy / dx));
    const double rough = dy / steps, power = pow(10, floor(log10(rough)));
    const double lead = rough / power, step = (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10) * power;
    app_plot_begin(plot, picture, width, height);
    (void)fprintf(plot->script.stream,
                  "set xlabel 'x'\nset ylabel 'y'\nset size ratio -1\nset ytics %.6g\n"
                  "set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05\n",
                  step);
}

static void end(const app *self, app_plot *plot, const char *picture) {
    APP_MUST_FILE(self, picture, app_plot_end(self, plot, &error));
}

typedef struct style {
    bool labelled;                /* with the energies */
    const char *title;            /* may be NULL */
    const char *minimum, *saddle; /* line widths for minima and for saddles */
} style;

static void draw_beams(const app *self, const char *picture, const beam_curve *curves, size_t count,
                       const style *as) {
    app_plot plot;
    box b = empty_box;
    for (size_t i = 0; i < count; i++) extend(&b, curves[i].at.q, curves[i].at.count);
    const int height = height_of(&b), least = as->labelled ? (int)(20 * count) + 60 : 0;
    begin_plane(&plot, picture, &b, as->labelled ? 1000 : 800, height < least ? least : height);
    FILE *script = plot.script.stream;
    (void)fputs(as->labelled ? "set key outside right top\n" : "unset key\n", script);
    if (as->title != NULL) (void)fprintf(script, "set title '%s'\n", as->title);
    for (size_t i = 0; i < count; i++) {
        const bool saddle = curves[i].solution.negative_eigenvalues > 0;
        put_beam(&plot, &curves[i]);
        (void)fprintf(script, "%sdatafile index %zu with lines lw %s lc rgb '%s' ", i == 0 ? "plot " : ", ",
                      i, saddle ? as->saddle : as->minimum, colour(i));
        if (as->labelled)
            (void)fprintf(script, "title 'E = %.6g%s'", curves[i].solution.energy, saddle ? " (saddle)" : "");
        else
            (void)fputs("notitle", script);
    }
    (void)fputc('\n', script);
    end(self, &plot, picture);
}

void draw_curves(const app *self, const char *picture, const beam_curve *curves, size_t count,
                 bool labelled) {
    const style as = {.labelled = labelled, .minimum = "2.5", .saddle = "1.5 dt 2"};
    if (picture != NULL) draw_beams(self, picture, curves, count, &as);
}

void draw_set(const app *self, const char *picture, const lg_elastica_curves *curves) {
    char title[64];
    beam_curve beams[SHOWN_CURVES];
    const style as = {.title = title, .minimum = "1.3"};
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t shown = curves->count < SHOWN_CURVES ? curves->count : (size_t)SHOWN_CURVES;
    if (picture == NULL) return;
    for (size_t i = 0; i < shown; i++) {
        const size_t at = 2 * nodes * (i * curves->count / shown);
        beams[i] = (beam_curve){.problem = {.length = curves->length, .intervals = curves->intervals},
                                .at = {.count = nodes, .q = curves->q + at, .v = curves->v + at}};
    }
    (void)snprintf(title, sizeof title, "%zu of %zu curves", shown, curves->count);
    draw_beams(self, picture, beams, shown, &as);
}

/* ---- energy against x ---- */

/* Writes each branch as pieces of equal stability, since stable and unstable pieces have different dashes. A
 * piece begins with the last point of the piece before it. */
static void put_branches(app_plot *plot, const sweep_point *points, size_t count) {
    for (size_t i = 0, block = 0; i < count; i++) {
        const bool saddle = points[i].negative_eigenvalues > 0;
        const bool follows = i > 0 && points[i - 1].branch == points[i].branch;
        if (!follows || saddle != (points[i - 1].negative_eigenvalues > 0)) {
            if (i > 0) app_plot_block(plot);
            if (follows)
                (void)fprintf(plot->data.stream, "%.9g %.9g\n", points[i - 1].x, points[i - 1].energy);
            (void)fprintf(
                plot->script.stream,
                ", datafile index %zu using ($1/pi2):2 with linespoints ps 0.4 %s lc rgb '%s' notitle",
                block++, saddle ? "pt 6 lw 1.3 dt 2" : "pt 7 lw 2", colour(points[i].branch));
        }
        (void)fprintf(plot->data.stream, "%.9g %.9g\n", points[i].x, points[i].energy);
    }
}

void draw_sweep(const app *self, const char *picture, const sweep_point *points, size_t count) {
    if (picture == NULL) return;
    app_plot plot;
    app_plot_begin(&plot, picture, 1000, 650);
    FILE *script = plot.script.stream;
    bool saddles = false;
    for (size_t i = 0; i < count; i++) saddles = saddles || points[i].negative_eigenvalues > 0;
    (void)fputs("set xlabel 'x / π'\nset ylabel 'energy'\nset xrange [0:2]\n"
                "set xtics 0.25\nset key outside top center horizontal\npi2 = 3.14159265358979\n",
                script);
    (void)fputs("plot 1/0 with lines lw 2 lc rgb '#444444' title 'minima'", script);
    if (saddles) (void)fputs(", 1/0 with lines lw 1.3 dt 2 lc rgb '#444444' title 'saddles'", script);
    put_branches(&plot, points, count);
    (void)fputc('\n', script);
    end(self, &plot, picture);
}

/* ---- learned curves ---- */

static void put_panel(FILE *script, const char *axes, size_t first_true, size_t first_learned, size_t shown) {
    (void)fputs(axes, script);
    for (size_t i = 0; i < shown; i++)
        (void)fprintf(script, "%sdatafile index %zu with lines lw 2 lc rgb '%s' %s", i == 0 ? "plot " : ", ",
                      first_true + i, true_colour, i == 0 ? "title 'true'" : "notitle");
    for (size_t i = 0; i < shown; i++)
        (void)fprintf(script, ", datafile index %zu with linespoints pt 7 ps 0.35 lw 0.7 lc rgb '%s' %s",
                      first_learned + i, learned_colour, i == 0 ? "title 'learned'" : "notitle");
    (void)fputc('\n', script);
}

void draw_comparison(const app *self, const char *picture, const comparison *what) {
    app_plot plot;
    app_plot_begin(&plot, picture, 1500, 520);
    const size_t nodes = (size_t)what->intervals + 1, shown = what->shown;
    const double *const sets[] = {what->true_q, what->q, what->true_v, what->v};
    FILE *script = plot.script.stream;
    for (size_t set = 0; set < LG_COUNT(sets); set++)
        for (size_t i = 0; i < shown; i++) put_pairs(&plot, sets[set] + 2 * nodes * i, nodes);
    /* An error of exactly 0, as at the given ends, has no logarithm; it is left out as NaN. */
    for (size_t k = 0; k < nodes; k++) {
        const double eq = what->node_error[2 * k], ev = what->node_error[2 * k + 1];
        (void)fprintf(plot.data.stream, "%.9g %.9g %.9g\n",
                      what->length * (double)k / (double)what->intervals, eq > 0 ? eq : (double)NAN,
                      ev > 0 ? ev : (double)NAN);
    }
    (void)fprintf(script, "set multiplot layout 1,3 title '%s'\n", what->title);
    (void)fputs("set key top center horizontal outside\n", script);
    put_panel(script,
              "set xlabel 'x'\nset ylabel 'y'\nset size ratio -1\n"
              "set offsets graph 0.04, graph 0.04, graph 0.04, graph 0.04\n",
              0, shown, shown);
    put_panel(script,
              "set xlabel \"x'\"\nset ylabel \"y'\"\nset xrange [-1.1:1.1]\nset yrange [-1.1:1.1]\n"
              "set offsets 0,0,0,0\n",
              2 * shown, 3 * shown, shown);
    (void)fprintf(
        script,
        "set size noratio\nset autoscale\nset xrange [0:%.9g]\nset xlabel 's'\nset ylabel 'mean error'\n"
        "set logscale y\nset format y '10^{%%L}'\n"
        "plot datafile index %zu using 1:2 with lines lw 2 lc rgb '#2e8b57' title 'q', "
        "datafile index %zu using 1:3 with lines lw 2 lc rgb '#8b3a8b' title \"q'\"\n"
        "unset multiplot\n",
        what->length, 4 * shown, 4 * shown);
    end(self, &plot, picture);
}

void draw_prediction(const app *self, const char *picture, const beam_curve *curve, const beam_curve *truth) {
    if (picture == NULL) return;
    app_plot plot;
    box b = empty_box;
    extend(&b, curve->at.q, curve->at.count);
    if (truth != NULL) extend(&b, truth->at.q, truth->at.count);
    begin_plane(&plot, picture, &b, 800, height_of(&b) + 20);
    put_pairs(&plot, curve->at.q, curve->at.count);
    if (truth != NULL) put_beam(&plot, truth);
    (void)fputs("set key top center horizontal outside\nplot ", plot.script.stream);
    if (truth != NULL)
        (void)fprintf(plot.script.stream, "datafile index 1 with lines lw 2.5 lc rgb '%s' title 'solved', ",
                      true_colour);
    (void)fprintf(plot.script.stream,
                  "datafile index 0 with linespoints pt 7 ps 0.5 lw 1 lc rgb '%s' title 'learned'\n",
                  learned_colour);
    end(self, &plot, picture);
}
