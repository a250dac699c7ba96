/* The pictures of lg-hamiltonian. */
#include "lg-hamiltonian/training.h"

#include <math.h>

enum { PANELS_IN_ROW = 3, TITLE_HEIGHT = 30 };

static bool on_spheres(const lg_hamiltonian *model) {
    return model->family->factor[0] == LG_SPACE_TS2;
}

/* Which data blocks are drawn: blocks of true points, followed by blocks of predicted points. */
typedef struct curves {
    size_t true_blocks, predicted_blocks;
    size_t part, parts; /* the blocks part, part + parts, part + 2 parts, ... are drawn */
} curves;

/* Writes a block per trajectory and link. A line has the position (on R^(2n) the first two coordinates and 0)
 * and then the time. Returns the number of blocks. */
static size_t put_blocks(app_plot *plot, const lg_hamiltonian *model, const double *t, const double *y,
                         size_t n, size_t points) {
    const bool chain = on_spheres(model);
    const size_t dim = lg_hamiltonian_state_dim(model), parts = chain ? model->n : 1;
    for (size_t i = 0; i < n; i++)
        for (size_t part = 0; part < parts; part++) {
            for (size_t j = 0; j < points; j++) {
                const double *q = y + (i * points + j) * dim + 6 * part * (chain ? 1 : 0);
                (void)fprintf(plot->data.stream, "%.9g %.9g %.9g %.9g\n", q[0], q[1], chain ? q[2] : 0, t[j]);
            }
            app_plot_block(plot);
        }
    return n * parts;
}

static void put_curves(FILE *script, const curves *of, const char *columns, bool more) {
    const char *separator = more ? ", " : "";
    for (size_t k = of->part; k < of->true_blocks; k += of->parts, separator = ", ")
        (void)fprintf(script, "%sdatafile index %zu using %s with lines lw 2 lc rgb '#1f5fa8' %s", separator,
                      k, columns, k == of->part ? "title 'true'" : "notitle");
    for (size_t k = of->part; k < of->predicted_blocks; k += of->parts, separator = ", ")
        (void)fprintf(script, "%sdatafile index %zu using %s with %s lc rgb '#d1641f' %s", separator,
                      of->true_blocks + k, columns,
                      of->true_blocks > 0 ? "points pt 7 ps 0.5" : "lines lw 1.5",
                      k == of->part ? "title 'predicted'" : "notitle");
    (void)fputc('\n', script);
}

/* Draws a sphere for each link; the arrow shows the direction of gravity, -e3. */
static void put_spheres(FILE *script, size_t links, curves of) {
    (void)fprintf(
        script,
        "set view equal xyz\nset view 65,35,%g\nset key top left\nset xyplane at -1\nset parametric\n"
        "set urange [0:pi]\nset vrange [0:2*pi]\nset isosamples 25,13\nset xrange [-1:1]\n"
        "set yrange [-1:1]\nset zrange [-1:1]\nset border 31\nset xtics -1,1,1 offset 0,-0.3\n"
        "set ytics -1,1,1 offset 0,-0.3\nset ztics -1,1,1\nset xlabel 'q_x' offset 0,-0.5\n"
        "set ylabel 'q_y' offset 0,-0.5\nset label 'q_z' at -1,-1,1.15 center\n"
        "set arrow from 1,1,0.4 to 1,1,-0.4 lw 2.5 lc rgb '#333333' head filled front\n"
        "set label 'gravity' at 1,1,0.55 center front\n",
        links > 1 ? 1.1 : 1.15);
    for (size_t part = 0; part < links; part++) {
        of.part = part;
        if (links > 1) (void)fprintf(script, "set title 'link %zu'\n", part + 1);
        (void)fputs("splot sin(u)*cos(v), sin(u)*sin(v), cos(u) with lines lc rgb '#dcdcdc' lw 0.5 notitle",
                    script);
        put_curves(script, &of, "1:2:3", true);
    }
}

/* A panel for a system on R^(2n): which columns are drawn against each other. With one degree of freedom
 * there are the phase portrait, q against t and p against t; otherwise q_2 against q_1. */
typedef struct panel {
    const char *columns, *xlabel, *ylabel, *settings;
} panel;

static const panel phase_panels[] = {{"1:2", "q", "p", "set size ratio -1"},
                                     {"4:1", "t (s)", "q", "set size noratio"},
                                     {"4:2", "t (s)", "p", "set size noratio"}};
static const panel plane_panels[] = {{"1:2", "q_1", "q_2", "set size ratio -1"}};

static void put_panels(FILE *script, const panel *panels, size_t count, const curves *of) {
    (void)fputs("set key below center horizontal\nset bmargin 5\nset autoscale xfix\n"
                "set offsets graph 0.03, graph 0.03, graph 0.03, graph 0.03\n",
                script);
    for (size_t i = 0; i < count; i++) {
        (void)fprintf(script, "%s\nset xlabel '%s'\nset ylabel '%s'\nplot ", panels[i].settings,
                      panels[i].xlabel, panels[i].ylabel);
        put_curves(script, of, panels[i].columns, false);
    }
}

/* Begins a grid of panels, PANELS_IN_ROW per row, under one title. */
static void begin_panels(app_plot *plot, const char *picture, size_t count, int side, const char *title) {
    const size_t columns = count < PANELS_IN_ROW ? count : (size_t)PANELS_IN_ROW;
    const size_t rows = (count + PANELS_IN_ROW - 1) / PANELS_IN_ROW;
    app_plot_begin(plot, picture, side * (int)columns, side * (int)rows + TITLE_HEIGHT);
    (void)fprintf(plot->script.stream, "set multiplot layout %zu,%zu title \"%s\"\n", rows, columns, title);
}

lg_status draw_trajectories(const app *self, const char *picture, const char *title,
                            const lg_hamiltonian *model, const double *t, const double *truth,
                            const double *predicted, size_t n, size_t points, lg_error *error) {
    app_plot plot;
    const size_t links = model->n;
    const bool space = on_spheres(model), phase = lg_hamiltonian_state_dim(model) == 2;
    const size_t count = space ? links : phase ? LG_COUNT(phase_panels) : LG_COUNT(plane_panels);
    begin_panels(&plot, picture, count, count > 1 ? 520 : 700, title);
    curves of = {.parts = space ? links : 1};
    if (truth != NULL) of.true_blocks = put_blocks(&plot, model, t, truth, n, points);
    of.predicted_blocks = put_blocks(&plot, model, t, predicted, n, points);
    if (space)
        put_spheres(plot.script.stream, links, of);
    else
        put_panels(plot.script.stream, phase ? phase_panels : plane_panels, count, &of);
    (void)fputs("unset multiplot\n", plot.script.stream);
    return app_plot_end(self, &plot, error);
}

lg_status draw_energy(const app *self, const char *picture, const double *t, const double *true_energy,
                      const double *learned_energy, size_t count, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 800, 500);
    for (size_t i = 1; i < count; i++)
        (void)fprintf(plot.data.stream, "%.9g %.9g %.9g\n", t[i], fabs(learned_energy[i] - learned_energy[0]),
                      true_energy != NULL ? fabs(true_energy[i] - true_energy[0]) : (double)NAN);
    (void)fputs("set title 'Energy along the prediction, from its value at the start'\nset logscale y\n"
                "set format y '10^{%L}'\nset xlabel 't / (L/g)^{1/2}'\nset ylabel '|H - H(0)| / (m g L)'\n"
                "set key below center horizontal\nplot ",
                plot.script.stream);
    if (true_energy != NULL)
        (void)fputs(
            "datafile using 1:3 with lines lw 1.5 lc rgb '#1f5fa8' title 'true energy of the prediction', ",
            plot.script.stream);
    (void)fputs("datafile using 1:2 with lines lw 1.5 lc rgb '#d1641f' title 'learned energy'\n",
                plot.script.stream);
    return app_plot_end(self, &plot, error);
}
