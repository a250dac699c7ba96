/* The pictures of lg-hamiltonian. */
#include "lg-hamiltonian/learning.h"

#include <math.h>

enum { SHOWN_TRAJECTORIES = 10, SPHERES_IN_ROW = 3 };

static lg_status begin(app_plot *plot, const char *picture, int width, int height, lg_error *error) {
    const lg_status status = app_plot_begin(plot, picture, width, height);
    if (status != LG_OK && error != NULL) {
        error->status = status;
        (void)snprintf(error->message, sizeof error->message, "%s: the name must end in .svg or .png",
                       picture);
    }
    return status;
}

static lg_status end(const app *self, app_plot *plot, lg_error *error) {
    bool drawn;
    return app_plot_end(self, plot, &drawn, error);
}

static bool on_spheres(const lg_hamiltonian *model) {
    return model->family->factor[0] == LG_SPACE_TS2;
}

/* One block a trajectory and link (three columns), or a trajectory: the first two coordinates. Returns the
 * blocks written. */
static size_t put_blocks(app_plot *plot, const lg_hamiltonian *model, const double *y, size_t n,
                         size_t points) {
    const bool chain = on_spheres(model);
    const size_t dim = lg_hamiltonian_state_size(model), parts = chain ? model->n : 1;
    for (size_t i = 0; i < n; i++)
        for (size_t part = 0; part < parts; part++) {
            for (size_t j = 0; j < points; j++) {
                const double *q = y + (i * points + j) * dim + 6 * part * (chain ? 1 : 0);
                (void)fprintf(plot->data.stream, "%.9g %.9g %.9g\n", q[0], q[1], chain ? q[2] : 0);
            }
            app_plot_block(plot);
        }
    return n * parts;
}

static void put_sphere(FILE *script) {
    (void)fputs("splot sin(u)*cos(v), sin(u)*sin(v), cos(u) with lines lc rgb '#dcdcdc' lw 0.5 notitle",
                script);
}

/* The curves of one link: blocks part, part + parts, ...; the predicted ones after the true ones. */
static void put_curves(FILE *script, size_t true_blocks, size_t predicted_blocks, size_t part, size_t parts,
                       bool space) {
    const char *columns = space ? "1:2:3" : "1:2";
    const char *separator = space ? ", " : "";
    for (size_t k = part; k < true_blocks; k += parts, separator = ", ")
        (void)fprintf(script, "%sdatafile index %zu using %s with lines lw 2 lc rgb '#1f5fa8' %s", separator,
                      k, columns, k == 0 ? "title 'true'" : "notitle");
    for (size_t k = part; k < predicted_blocks; k += parts, separator = ", ")
        (void)fprintf(script, "%sdatafile index %zu using %s with %s lc rgb '#d1641f' %s", separator,
                      true_blocks + k, columns, true_blocks > 0 ? "points pt 7 ps 0.5" : "lines lw 1.5",
                      k == 0 ? "title 'predicted'" : "notitle");
    (void)fputc('\n', script);
}

/* A sphere for each link. */
static void put_spheres(FILE *script, size_t links, size_t true_blocks, size_t predicted_blocks) {
    (void)fprintf(script,
                  "set view equal xyz\nset view 65,35,%g\nset key bottom right\nset xyplane at -1\nset "
                  "parametric\nset urange [0:pi]\nset vrange [0:2*pi]\nset isosamples 25,13\nset xrange "
                  "[-1:1]\nset yrange [-1:1]\nset zrange [-1:1]\nset border 0\nunset tics\nunset grid\n",
                  links > 1 ? 1.4 : 1.5);
    if (links > 1)
        (void)fprintf(script, "set multiplot layout %zu,%zu\n", (links + SPHERES_IN_ROW - 1) / SPHERES_IN_ROW,
                      links < SPHERES_IN_ROW ? links : (size_t)SPHERES_IN_ROW);
    for (size_t part = 0; part < links; part++) {
        if (links > 1) (void)fprintf(script, "set title 'q_{%zu}'\n", part + 1);
        put_sphere(script);
        put_curves(script, true_blocks, predicted_blocks, part, links, true);
    }
    if (links > 1) (void)fputs("unset multiplot\n", script);
}

static lg_status begin_trajectories(app_plot *plot, const char *picture, size_t spheres, lg_error *error) {
    const size_t columns = spheres < SPHERES_IN_ROW ? spheres : (size_t)SPHERES_IN_ROW;
    const size_t rows = (spheres + SPHERES_IN_ROW - 1) / SPHERES_IN_ROW;
    if (spheres < 2) return begin(plot, picture, 800, 700, error);
    return begin(plot, picture, 520 * (int)columns, 520 * (int)rows, error);
}

lg_status draw_trajectories(const app *self, const char *picture, const lg_hamiltonian *model,
                            const double *truth, const double *predicted, size_t n, size_t points,
                            lg_error *error) {
    app_plot plot;
    const bool space = on_spheres(model);
    const size_t links = model->n;
    const lg_status status = begin_trajectories(&plot, picture, space ? links : 0, error);
    if (status != LG_OK) return status;
    if (n > SHOWN_TRAJECTORIES) n = SHOWN_TRAJECTORIES;
    const size_t true_blocks = truth != NULL ? put_blocks(&plot, model, truth, n, points) : 0;
    const size_t predicted_blocks = put_blocks(&plot, model, predicted, n, points);
    if (space) {
        put_spheres(plot.script.stream, links, true_blocks, predicted_blocks);
    } else {
        (void)fprintf(plot.script.stream,
                      "set xlabel 'q_1'\nset ylabel '%s'\nset size ratio -1\nset offsets graph 0.03, graph "
                      "0.03, graph 0.03, graph 0.03\nplot ",
                      links > 1 ? "q_2" : "p_1");
        put_curves(plot.script.stream, true_blocks, predicted_blocks, 0, 1, false);
    }
    return end(self, &plot, error);
}

lg_status draw_energy(const app *self, const char *picture, const double *t, const double *true_energy,
                      const double *learned_energy, size_t count, lg_error *error) {
    app_plot plot;
    const lg_status status = begin(&plot, picture, 800, 500, error);
    if (status != LG_OK) return status;
    for (size_t i = 1; i < count; i++)
        (void)fprintf(plot.data.stream, "%.9g %.9g %.9g\n", t[i], fabs(learned_energy[i] - learned_energy[0]),
                      true_energy != NULL ? fabs(true_energy[i] - true_energy[0]) : (double)NAN);
    (void)fputs("set logscale y\nset format y '10^{%L}'\nset xlabel 't'\nset ylabel '|H - H(0)|'\nset key "
                "outside top center horizontal\nplot ",
                plot.script.stream);
    if (true_energy != NULL)
        (void)fputs(
            "datafile using 1:3 with lines lw 1.5 lc rgb '#1f5fa8' title 'true energy of the prediction', ",
            plot.script.stream);
    (void)fputs("datafile using 1:2 with lines lw 1.5 lc rgb '#d1641f' title 'learned energy'\n",
                plot.script.stream);
    return end(self, &plot, error);
}
