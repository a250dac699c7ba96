/* The plots of lg-elastica. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

enum { SHOWN_CURVES = 24, SMOOTH_POINTS = 400 };

/* Writes a data block with a beam, interpolated by cubic Hermite polynomials. */
static void put_beam(app_plot *plot, const beam_curve *curve) {
    const double *q = curve->at.q, *v = curve->at.v;
    const size_t intervals = curve->problem.intervals;
    const double h = curve->problem.length / (double)intervals;
    const size_t parts = intervals < SMOOTH_POINTS ? (SMOOTH_POINTS + intervals - 1) / intervals : 1;
    for (size_t k = 0; k < 2 * intervals; k += 2)
        for (size_t i = 0; i < parts + (k + 2 == 2 * intervals); i++) {
            const double t = (double)i / (double)parts, a = t * t * (3 - 2 * t), b = t * (1 - t) * (1 - t),
                         c = t * t * (t - 1);
            double x[2];
            for (size_t d = k; d < k + 2; d++)
                x[d - k] = q[d] * (1 - a) + q[d + 2] * a + h * (v[d] * b + v[d + 2] * c);
            app_plot_numbers(plot, 9, x, 2);
        }
    app_plot_block(plot);
}

/* Draws beams, with their energies if `labelled`. `width` is that of the lines of minima. */
static void draw_beams(const app *self, const char *path, const char *title, bool labelled, double width,
                       const beam_curve *curves, size_t count) {
    app_plot plot;
    app_plot_begin(&plot, "elastica_beams", path);
    app_plot_text(&plot, "%s\t%d\t%g", title, labelled, width);
    for (const beam_curve *at = curves; at < curves + count; at++) {
        const bool saddle = at->solution.negative_eigenvalues > 0;
        app_plot_text(&plot, "E = %.6g%s\t%d", at->solution.energy, saddle ? " (saddle)" : "", saddle);
        put_beam(&plot, at);
    }
    app_plot_end(self, &plot);
}

void draw_curves(const app *self, const char *path, const beam_curve *curves, size_t count, bool labelled) {
    if (path != NULL) draw_beams(self, path, "", labelled, 2.5, curves, count);
}

void draw_set(const app *self, const char *path, const lg_elastica_curves *curves) {
    beam_curve beams[SHOWN_CURVES];
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t shown = curves->count < SHOWN_CURVES ? curves->count : (size_t)SHOWN_CURVES;
    APP_FREE char *title = app_format("%zu of %zu curves", shown, curves->count);
    if (path == NULL) return;
    for (size_t i = 0; i < shown; i++) {
        const size_t at = 2 * nodes * (i * curves->count / shown);
        beams[i] = (beam_curve){.problem = {.length = curves->length, .intervals = curves->intervals},
                                .at = {.count = nodes, .q = curves->q + at, .v = curves->v + at}};
    }
    draw_beams(self, path, title, false, 1.3, beams, shown);
}

/* Branches are drawn as pieces of equal stability, since stable and unstable ones have different dashes. */
void draw_sweep(const app *self, const char *path, const sweep_point *points, size_t count) {
    if (path == NULL) return;
    app_plot plot;
    double before = NAN;
    app_plot_begin(&plot, "elastica_sweep", path);
    for (const sweep_point *at = points; at < points + count; at++) {
        const bool follows = at > points && at[-1].branch == at->branch;
        const double saddle = at->negative_eigenvalues > 0, branch = (double)at->branch;
        if (!follows || saddle != before) app_plot_gap(&plot);
        if (follows && saddle != before) /* a piece begins with the last point of the piece before it */
            APP_PLOT_ROW(&plot, 9, at[-1].x, at[-1].energy, saddle, branch);
        APP_PLOT_ROW(&plot, 9, at->x, at->energy, saddle, branch);
        before = saddle;
    }
    app_plot_block(&plot);
    app_plot_end(self, &plot);
}

void draw_prediction(const app *self, const char *path, const beam_curve *curve, const beam_curve *truth) {
    if (path == NULL) return;
    app_plot plot;
    app_plot_begin(&plot, "elastica_beams", path);
    app_plot_text(&plot, "\t2\t2.5\t%d", truth != NULL);
    for (size_t k = 0; k < curve->at.count; k++) app_plot_numbers(&plot, 9, curve->at.q + 2 * k, 2);
    app_plot_block(&plot);
    if (truth != NULL)
        put_beam(&plot, truth);
    else
        app_plot_block(&plot);
    app_plot_end(self, &plot);
}
