/* The pictures of lg-elastica. */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

enum { SHOWN_CURVES = 24, SMOOTH_POINTS = 400, AROUND = 110 };

static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2e8b57", "#8b3a8b", "#b8860b", "#c0392b",
                                      "#17a2b8", "#6b4423", "#5d6d7e", "#7cb342", "#e377c2", "#3f51b5"};
static const char true_colour[] = "#1f5fa8", learned_colour[] = "#d1641f";

static const char *colour(size_t i) {
    return colours[i % LG_COUNT(colours)];
}

static lg_status begin(app_plot *plot, const char *picture, int width, int height, lg_error *error) {
    (void)error;
    app_plot_begin(plot, picture, width, height);
    return LG_OK;
}

static lg_status end(const app *self, app_plot *plot, lg_error *error) {
    return app_plot_end(self, plot, error);
}

/* One block: a polyline of `points` pairs. */
static void put_pairs(app_plot *plot, const double *pairs, size_t points) {
    for (size_t k = 0; k < points; k++)
        (void)fprintf(plot->data.stream, "%.9g %.9g\n", pairs[2 * k], pairs[2 * k + 1]);
    app_plot_block(plot);
}

/* One block: a beam of `intervals` intervals of length h by cubic Hermite interpolation. */
static void put_beam(app_plot *plot, const double *q, const double *v, size_t intervals, double h) {
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

/* ---- equal axes ---- */

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

/* Height in pixels of curves drawn `width` wide, without the margins. */
static int height_of(const box *b, int width) {
    const double dx = fmax(b->high[0] - b->low[0], 1e-6), dy = b->high[1] - b->low[1];
    const double height = 1.12 * (double)width * dy / dx;
    return height < 120 ? 120 : height > 800 ? 800 : (int)height;
}

/* Steps of 1, 2 or 5 times a power of ten over the height: about four, fewer where it is low. */
static void put_plane(FILE *script, const box *b) {
    const double dx = fmax(b->high[0] - b->low[0], 1e-6), dy = fmax(b->high[1] - b->low[1], 1e-6);
    const double steps = fmin(4, fmax(1, 20 * dy / dx));
    const double rough = dy / steps, power = pow(10, floor(log10(rough)));
    const double lead = rough / power, step = (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10) * power;
    (void)fprintf(script,
                  "set xlabel 'x'\nset ylabel 'y'\nset size ratio -1\nset ytics %.6g\n"
                  "set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05\n",
                  step);
}

lg_status draw_curves(const app *self, const char *picture, const beam_curve *curves, size_t count,
                      char *const *labels, lg_error *error) {
    app_plot plot;
    box b = empty_box;
    for (size_t i = 0; i < count; i++) extend(&b, curves[i].q, (size_t)curves[i].problem.intervals + 1);
    int height = height_of(&b, 720) + AROUND;
    if (labels != NULL && height < (int)(20 * count) + 60) height = (int)(20 * count) + 60;
    const lg_status status = begin(&plot, picture, labels != NULL ? 1000 : 800, height, error);
    if (status != LG_OK) return status;
    FILE *script = plot.script.stream;
    for (size_t i = 0; i < count; i++) {
        const lg_elastica *problem = &curves[i].problem;
        put_beam(&plot, curves[i].q, curves[i].v, problem->intervals,
                 problem->length / (double)problem->intervals);
    }
    put_plane(script, &b);
    (void)fputs(labels != NULL ? "set key outside right top\n" : "unset key\n", script);
    for (size_t i = 0; i < count; i++) {
        const bool saddle = curves[i].solution.negative_eigenvalues > 0;
        (void)fprintf(script, "%sdatafile index %zu with lines lw %s%s lc rgb '%s' ", i == 0 ? "plot " : ", ",
                      i, saddle ? "1.5" : "2.5", saddle ? " dt 2" : "", colour(i));
        if (labels != NULL)
            (void)fprintf(script, "title '%s'", labels[i]);
        else
            (void)fputs("notitle", script);
    }
    (void)fputc('\n', script);
    return end(self, &plot, error);
}

lg_status draw_set(const app *self, const char *picture, const lg_elastica_curves *curves, lg_error *error) {
    app_plot plot;
    box b = empty_box;
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t shown = curves->count < SHOWN_CURVES ? curves->count : (size_t)SHOWN_CURVES;
    for (size_t i = 0; i < shown; i++) extend(&b, curves->q + 2 * nodes * (i * curves->count / shown), nodes);
    const lg_status status = begin(&plot, picture, 800, height_of(&b, 720) + AROUND, error);
    if (status != LG_OK) return status;
    for (size_t i = 0; i < shown; i++) {
        const size_t at = 2 * nodes * (i * curves->count / shown);
        put_beam(&plot, curves->q + at, curves->v + at, curves->intervals,
                 curves->length / (double)curves->intervals);
    }
    put_plane(plot.script.stream, &b);
    (void)fprintf(plot.script.stream, "unset key\nset title '%zu of %zu curves'\n", shown, curves->count);
    for (size_t i = 0; i < shown; i++)
        (void)fprintf(plot.script.stream, "%sdatafile index %zu with lines lw 1.3 lc rgb '%s' notitle",
                      i == 0 ? "plot " : ", ", i, colour(i));
    (void)fputc('\n', plot.script.stream);
    return end(self, &plot, error);
}

/* ---- energy against x ---- */

/* A line changes its dash where the branch changes its stability: pieces of equal stability, the last point
 * of one repeated as the first of the next. */
static size_t put_branches(app_plot *plot, const sweep_point *points, size_t count, bool *saddle,
                           size_t *branch) {
    size_t blocks = 0;
    for (size_t i = 0; i < count; i++) {
        const bool unstable = points[i].negative_eigenvalues > 0;
        const bool follows = i > 0 && points[i - 1].branch == points[i].branch;
        const bool fresh = !follows || unstable != (points[i - 1].negative_eigenvalues > 0);
        if (fresh) {
            if (i > 0) app_plot_block(plot);
            if (follows)
                (void)fprintf(plot->data.stream, "%.9g %.9g\n", points[i - 1].x, points[i - 1].energy);
            saddle[blocks] = unstable;
            branch[blocks++] = points[i].branch;
        }
        (void)fprintf(plot->data.stream, "%.9g %.9g\n", points[i].x, points[i].energy);
    }
    return blocks;
}

lg_status draw_sweep(const app *self, const char *picture, const sweep_point *points, size_t count,
                     lg_error *error) {
    app_plot plot;
    const lg_status status = begin(&plot, picture, 1000, 650, error);
    if (status != LG_OK) return status;
    bool *saddle = app_alloc(count, sizeof *saddle);
    size_t *branch = app_alloc(count, sizeof *branch);
    FILE *script = plot.script.stream;
    const size_t blocks = put_branches(&plot, points, count, saddle, branch);
    bool saddles = false;
    for (size_t b = 0; b < blocks; b++) saddles = saddles || saddle[b];
    (void)fputs("set xlabel 'x / π'\nset ylabel 'energy'\nset xrange [0:2]\n"
                "set xtics 0.25\nset key outside top center horizontal\npi2 = 3.14159265358979\n",
                script);
    (void)fputs("plot 1/0 with lines lw 2 lc rgb '#444444' title 'minima'", script);
    if (saddles) (void)fputs(", 1/0 with lines lw 1.3 dt 2 lc rgb '#444444' title 'saddles'", script);
    for (size_t b = 0; b < blocks; b++)
        (void)fprintf(script,
                      ", datafile index %zu using ($1/pi2):2 with linespoints ps 0.4 %s lc rgb '%s' notitle",
                      b, saddle[b] ? "pt 6 lw 1.3 dt 2" : "pt 7 lw 2", colour(branch[b]));
    (void)fputc('\n', script);
    free(saddle);
    free(branch);
    return end(self, &plot, error);
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

lg_status draw_comparison(const app *self, const char *picture, const comparison *what, lg_error *error) {
    app_plot plot;
    const lg_status status = begin(&plot, picture, 1500, 520, error);
    if (status != LG_OK) return status;
    const size_t nodes = (size_t)what->intervals + 1, shown = what->shown;
    const double *const sets[] = {what->true_q, what->q, what->true_v, what->v};
    FILE *script = plot.script.stream;
    for (size_t set = 0; set < LG_COUNT(sets); set++)
        for (size_t i = 0; i < shown; i++) put_pairs(&plot, sets[set] + 2 * nodes * i, nodes);
    /* An error of exactly 0 (given ends) has no logarithm. */
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
    return end(self, &plot, error);
}

lg_status draw_prediction(const app *self, const char *picture, const double *q, size_t points,
                          const beam_curve *truth, lg_error *error) {
    app_plot plot;
    box b = empty_box;
    extend(&b, q, points);
    if (truth != NULL) extend(&b, truth->q, (size_t)truth->problem.intervals + 1);
    const lg_status status = begin(&plot, picture, 800, height_of(&b, 720) + AROUND + 20, error);
    if (status != LG_OK) return status;
    put_pairs(&plot, q, points);
    if (truth != NULL)
        put_beam(&plot, truth->q, truth->v, truth->problem.intervals,
                 truth->problem.length / (double)truth->problem.intervals);
    put_plane(plot.script.stream, &b);
    (void)fputs("set key top center horizontal outside\nplot ", plot.script.stream);
    if (truth != NULL)
        (void)fprintf(plot.script.stream, "datafile index 1 with lines lw 2.5 lc rgb '%s' title 'solved', ",
                      true_colour);
    (void)fprintf(plot.script.stream,
                  "datafile index 0 with linespoints pt 7 ps 0.5 lw 1 lc rgb '%s' title 'learned'\n",
                  learned_colour);
    return end(self, &plot, error);
}
