/* The pictures of lg-hamiltonian. */
#include "lg-hamiltonian/training.h"

enum { PANELS_IN_ROW = 3, TITLE_HEIGHT = 30 };

static bool on_spheres(const lg_hamiltonian *model) {
    return model->family->factor[0] == LG_SPACE_TS2;
}

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
                (void)fprintf(plot->data, "%.9g %.9g %.9g %.9g\n", q[0], q[1], chain ? q[2] : 0, t[j]);
            }
            app_plot_block(plot);
        }
    return n * parts;
}

lg_status draw_trajectories(const app *self, const char *picture, const char *title,
                            const lg_hamiltonian *model, const double *t, const double *truth,
                            const double *predicted, size_t n, size_t points, lg_error *error) {
    app_plot plot;
    const bool phase = lg_hamiltonian_state_dim(model) == 2;
    const size_t panels = on_spheres(model) ? model->n : phase ? 3 : 1;
    const size_t columns = panels < PANELS_IN_ROW ? panels : PANELS_IN_ROW;
    const size_t rows = (panels + PANELS_IN_ROW - 1) / PANELS_IN_ROW;
    const int side = panels > 1 ? 520 : 700;
    app_plot_begin(&plot, on_spheres(model) ? "spheres" : "learned_flow", picture, side * (int)columns,
                   side * (int)rows + TITLE_HEIGHT);
    app_plot_text(&plot, "%s", title);
    app_plot_text(&plot, "%zu", panels);
    app_plot_text(&plot, "%zu", truth != NULL ? put_blocks(&plot, model, t, truth, n, points) : 0);
    app_plot_text(&plot, "%zu", put_blocks(&plot, model, t, predicted, n, points));
    return app_plot_end(self, &plot, error);
}
