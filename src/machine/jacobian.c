/* Machines: losses, residuals and Jacobians of windows for fits. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

/* Writes the rows of the priors behind the points of each window, and adds them to the loss. */
static void put_priors(lg_chain *c, size_t batch) {
    lg_prior priors[LG_MACHINE_PRIORS];
    const lg_machine *machine = c->problem->machine;
    const uint32_t count =
        lg_machine_problem_priors(c->problem) > 0 ? lg_machine_list_priors(machine, priors) : 0;
    const double weight = lg_machine_prior_weight(c->problem, batch);
    for (uint32_t i = 0; i < count; i++) {
        const lg_prior *p = &priors[i];
        const size_t column = machine->terms[p->term].offset + p->index;
        double slope;
        const double x = lg_number_at(&p->map, c->theta[column], &slope);
        const double r = weight * (x - p->centre) / p->sigma;
        for (size_t s = 0; s < c->count; s++) {
            const size_t row = s * c->rows + c->done + i;
            c->loss += r * r;
            if (c->r == NULL) continue; /* only the loss is wanted */
            memset(c->jacobian + row * c->columns, 0, c->columns * sizeof *c->jacobian);
            c->jacobian[row * c->columns + column] = weight * slope / p->sigma;
            c->r[row] = r;
        }
    }
}

size_t lg_machine_linearised_rows(const lg_machine_problem *problem) {
    return (size_t)(problem->window - lg_chain_first(problem)) * lg_row_axes_of(problem->machine).seen +
           lg_machine_problem_priors(problem);
}

void lg_machine_row_variances(const lg_machine_problem *problem, const lg_machine_noise *noise, size_t row,
                              double factor, double *out, double *part) {
    const lg_machine *machine = problem->machine;
    const lg_row_axes all = lg_row_axes_of(machine);
    const double *q = problem->log.q + row * machine->positions;
    double weight[LG_CHAIN_NUMBERS], along[LG_MACHINE_VELOCITIES];
    lg_machine_weigh_row(problem, row, factor, weight, weight + machine->positions);
    lg_machine_along_row(problem, row, along);
    for (uint32_t i = 0; i < all.seen; i++) {
        const lg_row_axis *a = &all.each[i];
        const bool moves = a->first >= machine->positions;
        const double turn = (moves ? noise->rate : noise->turn)[a->coordinate],
                     sigma = a->turns && turn != 0.0
                                 ? turn
                                 : (moves ? noise->velocity : noise->position)[a->coordinate],
                     scale = (moves ? problem->velocity_scale : problem->position_scale)[a->coordinate],
                     variance = weight[a->first] != 0.0 ? pow(factor / scale * sigma, 2.0) : 0.0,
                     by = a->kind == LG_TURN_DIRECTION ? q[a->first + a->turn]
                          : moves                      ? along[a->first - machine->positions]
                                                       : 0.0;
        out[i] = isnan(variance) ? 0.0 : variance;
        part[i] = isnan(by) ? 0.0 : 1.0 - by * by;
    }
}

static lg_status run_chain(const lg_machine_problem *problem, lg_tape *tape, const double *theta,
                           const uint32_t *samples, size_t count, size_t batch, double *loss, double *floor,
                           double *r, double *jacobian) {
    const uint32_t first = lg_chain_first(problem);
    lg_chain c = {.problem = problem,
                  .theta = theta,
                  .samples = samples,
                  .count = count,
                  .shared = lg_machine_shared(problem),
                  .own = first == 0 ? lg_machine_start_numbers(problem->machine) : 0,
                  .rows = lg_machine_linearised_rows(problem),
                  .factor = 1.0 / sqrt((double)batch * (double)(problem->window - first)),
                  .axes = lg_row_axes_of(problem->machine),
                  .r = r,
                  .jacobian = jacobian};
    c.columns = c.shared + c.own;
    const size_t bytes = lg_chain_place_all(&c, NULL) * sizeof(double);
    double *memory = lg_pool_take(tape, bytes);
    if (memory == NULL) return lg_tape_status(tape);
    (void)lg_chain_place_all(&c, memory);
    const lg_status status =
        lg_machine_is_long(problem) ? lg_chain_pass_long(tape, &c, floor) : lg_chain_pass_windows(tape, &c);
    if (status == LG_OK) put_priors(&c, batch);
    lg_pool_give(tape, memory, bytes);
    *loss = c.loss;
    return status;
}

lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    return run_chain(user, tape, theta, samples, count, batch, loss, NULL, r, jacobian);
}

lg_status lg_machine_long_loss(const lg_machine_problem *problem, lg_tape *tape, const double *theta,
                               const uint32_t *samples, size_t count, size_t batch, double *loss,
                               double *floor) {
    return run_chain(problem, tape, theta, samples, count, batch, loss, floor, NULL, NULL);
}
