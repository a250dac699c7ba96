/* The plot of trajectories. */
#include "lg-hamiltonian/training.h"

/* Writes a block for each trajectory, the true ones first: the state, and the time. */
void put_flow(app_plot *plot, const void *drawn) {
    const drawn_flow *of = drawn;
    const uint32_t dim = lg_hamiltonian_state_dim(of->model);
    const bool chain = of->model->family->factor[0] == LG_SPACE_TS2;
    if (chain) plot->script = "spheres";
    app_plot_text(plot, "%s\t%u\t%zu\t%zu", of->title, chain ? of->model->n : dim,
                  of->truth != NULL ? of->n : 0, of->n);
    for (size_t i = of->truth != NULL ? 0 : of->n; i < 2 * of->n; i++) {
        const double *y =
            i < of->n ? of->truth + i * of->points * dim : of->predicted + (i - of->n) * of->points * dim;
        APP_PLOT_COLUMNS(plot, 9, of->points, {y, dim, dim}, {of->t, 1, 1});
        app_plot_block(plot);
    }
}
