/* The pictures of lg-elastica. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

enum { SHOWN_CURVES = 24, SMOOTH_POINTS = 400 };

/* Writes a data block with a polyline of `points` points. */
static void put_pairs(app_plot *plot, const double *pairs, size_t points) {
    for (size_t k = 0; k < points; k++)
        (void)fprintf(plot->data, "%.9g %.9g\n", pairs[2 * k], pairs[2 * k + 1]);
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
                (void)fprintf(plot->data, "%.9g%c",
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

/* Begins a plot. Its first text is the step of the tics of y, 1, 2 or 5 times a power of ten: about four
 * steps, fewer if the box is low. */
static void begin_plane(app_plot *plot, const char *script, const char *picture, const box *b, int width,
                        int height) {
    const double dx = fmax(b->high[0] - b->low[0], 1e-6), dy = fmax(b->high[1] - b->low[1], 1e-6);
    const double steps = fmin(4, fmax(1, 20 * dy / dx));
    const double rough = dy / steps, power = pow(10, floor(log10(rough)));
    const double lead = rough / power, step = (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10) * power;
    app_plot_begin(plot, script, picture, width, height);
    app_plot_text(plot, "%.6g", step);
}

static void end(const app *self, app_plot *plot, const char *picture) {
    APP_MUST_FILE(self, picture, app_plot_end(self, plot, &error));
}

/* Draws beams. `title` may be empty; `width` is that of the lines of minima. With `labelled` there is a
 * legend with the energies. */
static void draw_beams(const app *self, const char *picture, const beam_curve *curves, size_t count,
                       bool labelled, const char *title, const char *width) {
    app_plot plot;
    box b = empty_box;
    for (size_t i = 0; i < count; i++) extend(&b, curves[i].at.q, curves[i].at.count);
    const int height = height_of(&b), least = labelled ? (int)(20 * count) + 60 : 0;
    begin_plane(&plot, "elastica_beams", picture, &b, labelled ? 1000 : 800, height < least ? least : height);
    app_plot_text(&plot, "%s", title);
    app_plot_text(&plot, "%d", labelled);
    app_plot_text(&plot, "%zu", count);
    app_plot_text(&plot, "%s", width);
    for (size_t i = 0; i < count; i++) {
        const bool saddle = curves[i].solution.negative_eigenvalues > 0;
        put_beam(&plot, &curves[i]);
        app_plot_text(&plot, "E = %.6g%s", curves[i].solution.energy, saddle ? " (saddle)" : "");
        app_plot_text(&plot, "%d", saddle);
    }
    end(self, &plot, picture);
}

void draw_curves(const app *self, const char *picture, const beam_curve *curves, size_t count,
                 bool labelled) {
    if (picture != NULL) draw_beams(self, picture, curves, count, labelled, "", "2.5");
}

void draw_set(const app *self, const char *picture, const lg_elastica_curves *curves) {
    char title[64];
    beam_curve beams[SHOWN_CURVES];
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t shown = curves->count < SHOWN_CURVES ? curves->count : (size_t)SHOWN_CURVES;
    if (picture == NULL) return;
    for (size_t i = 0; i < shown; i++) {
        const size_t at = 2 * nodes * (i * curves->count / shown);
        beams[i] = (beam_curve){.problem = {.length = curves->length, .intervals = curves->intervals},
                                .at = {.count = nodes, .q = curves->q + at, .v = curves->v + at}};
    }
    (void)snprintf(title, sizeof title, "%zu of %zu curves", shown, curves->count);
    draw_beams(self, picture, beams, shown, false, title, "1.3");
}

/* ---- energy against x ---- */

static bool is_saddle(const sweep_point *at) {
    return at->negative_eigenvalues > 0;
}

static bool follows(const sweep_point *points, size_t i) {
    return i > 0 && points[i - 1].branch == points[i].branch;
}

/* Whether a piece begins at point i. Branches are drawn as pieces of equal stability, since stable and
 * unstable ones have different dashes. */
static bool begins_piece(const sweep_point *points, size_t i) {
    return !follows(points, i) || is_saddle(&points[i]) != is_saddle(&points[i - 1]);
}

void draw_sweep(const app *self, const char *picture, const sweep_point *points, size_t count) {
    if (picture == NULL) return;
    app_plot plot;
    size_t pieces = 0;
    for (size_t i = 0; i < count; i++) pieces += begins_piece(points, i);
    app_plot_begin(&plot, "elastica_sweep", picture, 1000, 650);
    app_plot_text(&plot, "%zu", pieces);
    for (size_t i = 0; i < count; i++) {
        if (begins_piece(points, i)) {
            if (i > 0) app_plot_block(&plot);
            /* A piece begins with the last point of the piece before it. */
            if (follows(points, i))
                (void)fprintf(plot.data, "%.9g %.9g\n", points[i - 1].x, points[i - 1].energy);
            app_plot_text(&plot, "%zu", points[i].branch);
            app_plot_text(&plot, "%d", is_saddle(&points[i]));
        }
        (void)fprintf(plot.data, "%.9g %.9g\n", points[i].x, points[i].energy);
    }
    end(self, &plot, picture);
}

/* ---- learned curves ---- */

void draw_comparison(const app *self, const char *picture, const comparison *what) {
    app_plot plot;
    app_plot_begin(&plot, "elastica_comparison", picture, 1500, 520);
    const size_t nodes = (size_t)what->intervals + 1;
    const double *const sets[] = {what->true_q, what->q, what->true_v, what->v};
    app_plot_text(&plot, "%s", what->title);
    app_plot_text(&plot, "%zu", what->shown);
    app_plot_text(&plot, "%.9g", what->length);
    for (size_t set = 0; set < LG_COUNT(sets); set++)
        for (size_t i = 0; i < what->shown; i++) put_pairs(&plot, sets[set] + 2 * nodes * i, nodes);
    /* An error of exactly 0, as at the given ends, has no logarithm; it is left out as NaN. */
    for (size_t k = 0; k < nodes; k++) {
        const double eq = what->node_error[2 * k], ev = what->node_error[2 * k + 1];
        (void)fprintf(plot.data, "%.9g %.9g %.9g\n", what->length * (double)k / (double)what->intervals,
                      eq > 0 ? eq : (double)NAN, ev > 0 ? ev : (double)NAN);
    }
    end(self, &plot, picture);
}

void draw_prediction(const app *self, const char *picture, const beam_curve *curve, const beam_curve *truth) {
    if (picture == NULL) return;
    app_plot plot;
    box b = empty_box;
    extend(&b, curve->at.q, curve->at.count);
    if (truth != NULL) extend(&b, truth->at.q, truth->at.count);
    begin_plane(&plot, "elastica_prediction", picture, &b, 800, height_of(&b) + 20);
    app_plot_text(&plot, "%d", truth != NULL);
    put_pairs(&plot, curve->at.q, curve->at.count);
    if (truth != NULL)
        put_beam(&plot, truth);
    else
        (void)fputs("nan nan\n", plot.data);
    end(self, &plot, picture);
}
