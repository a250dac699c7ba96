/* The plots of lg-hamiltonian. */
#include "lg-hamiltonian/training.h"

/* Writes a block per trajectory and link: its position (on R^(2n) the first two coordinates), the time.
 * Returns the number of blocks. */
static size_t put_blocks(app_plot *plot, const lg_hamiltonian *model, const double *t, const double *y,
                         size_t n, size_t points) {
    const bool chain = model->family->factor[0] == LG_SPACE_TS2;
    const size_t dim = lg_hamiltonian_state_dim(model), parts = chain ? model->n : 1;
    for (size_t i = 0; i < n * parts; i++) {
        const double *q = y + i / parts * points * dim + 6 * (i % parts);
        APP_PLOT_COLUMNS(plot, 9, points, {q, dim, chain ? 3 : 2}, {t, 1, 1});
        app_plot_block(plot);
    }
    return n * parts;
}

void draw_trajectories(const app *self, const char *title, const lg_hamiltonian *model, const double *t,
                       const double *truth, const double *predicted, size_t n, size_t points) {
    const bool chain = model->family->factor[0] == LG_SPACE_TS2;
    app_plot plot;
    if (!app_plot_begin(&plot, chain ? "spheres" : "learned_flow")) return;
    app_plot_text(&plot, "%s\t%u", title, chain ? model->n : lg_hamiltonian_state_dim(model) == 2 ? 3 : 1);
    app_plot_text(&plot, "%zu", truth != NULL ? put_blocks(&plot, model, t, truth, n, points) : 0);
    app_plot_text(&plot, "%zu", put_blocks(&plot, model, t, predicted, n, points));
    app_plot_end(self, &plot);
}
