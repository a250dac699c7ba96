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
            lg_chain_add(c, s, r);
            if (c->r == NULL) continue;
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

/* ---- windows of a chunk ---- */

/* Passes the windows of an open chain, in a batch of `batch`, and closes it. A chain that is compared with
 * another one has no priors. */
static lg_status run_chain(lg_tape *tape, lg_chain *c, size_t batch) {
    const uint32_t points = c->problem->window - lg_chain_first(c->problem);
    c->rows = lg_machine_linearised_rows(c->problem);
    c->factor = 1.0 / sqrt((double)batch * (double)points);
    const lg_status status = lg_chain_pass_windows(tape, c);
    if (status == LG_OK && c->against == NULL) put_priors(c, batch);
    lg_chain_close(tape, c);
    return status;
}

lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    lg_chain c;
    LG_TRY(lg_chain_open(tape, user, theta, samples, 0, count, true, &c));
    c.r = r;
    c.jacobian = jacobian;
    LG_TRY(run_chain(tape, &c, batch));
    *loss = c.loss;
    return LG_OK;
}

/* ---- losses of all windows ---- */

/* Adds the loss of `count` windows. losses (count): of each window, or NULL. */
static lg_status add_loss(lg_tape *tape, const lg_machine_problem *problem, const double *theta, size_t first,
                          size_t count, size_t batch, double *losses, double *sum) {
    lg_chain c;
    LG_TRY(lg_chain_open(tape, problem, theta, NULL, first, count, false, &c));
    c.losses = losses;
    LG_TRY(run_chain(tape, &c, batch));
    *sum += c.loss;
    return LG_OK;
}

/* The same, but of the steps' own error: the difference between predictions with the substeps and with twice
 * as many, times 2^p/(2^p - 1) for a scheme of order p. */
static lg_status add_floor(lg_tape *tape, const lg_machine_problem *problem, const double *theta,
                           size_t first, size_t count, size_t batch, double *sum) {
    const double power = ldexp(1.0, problem->scheme->order), factor = power / (power - 1.0);
    lg_machine_problem finer = *problem;
    lg_chain once, twice;
    finer.substeps *= 2;
    LG_TRY(lg_chain_open(tape, problem, theta, NULL, first, count, false, &once));
    lg_status status = lg_chain_open(tape, &finer, theta, NULL, first, count, false, &twice);
    once.against = &twice;
    if (status == LG_OK) status = run_chain(tape, &once, batch);
    if (status == LG_OK) *sum += factor * factor * once.loss;
    lg_chain_close(tape, &twice);
    lg_chain_close(tape, &once);
    return status;
}

lg_status lg_machine_window_losses(lg_tape *tape, const lg_machine_problem *problem, const double *theta,
                                   double *losses) {
    double all = 0.0;
    memset(losses, 0, problem->windows * sizeof *losses);
    for (size_t first = 0; first < problem->windows; first += LG_FIT_CHUNK) {
        const size_t left = problem->windows - first, count = left < LG_FIT_CHUNK ? left : LG_FIT_CHUNK;
        LG_TRY(add_loss(tape, problem, theta, first, count, 1, losses + first, &all));
    }
    return LG_OK;
}

lg_status lg_machine_losses(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                            double *losses, lg_error *error) {
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    return lg_tape_conclude(tape, lg_machine_window_losses(tape, problem, theta, losses), error);
}

static lg_status add_windows(lg_tape *tape, const lg_machine_problem *problem, const double *theta,
                             double *loss, double *floor) {
    double sum = 0.0, of_steps = 0.0;
    for (size_t first = 0, all = problem->windows - problem->validation; first < all; first += LG_FIT_CHUNK) {
        const size_t count = all - first < LG_FIT_CHUNK ? all - first : LG_FIT_CHUNK;
        LG_TRY(add_loss(tape, problem, theta, first, count, all, NULL, &sum));
        if (floor != NULL) LG_TRY(add_floor(tape, problem, theta, first, count, all, &of_steps));
    }
    *loss = sum;
    if (floor != NULL) *floor = of_steps;
    return LG_OK;
}

lg_status lg_machine_loss(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                          double *loss, double *floor, lg_error *error) {
    LG_NEEDS(error, problem, loss);
    LG_TRY(lg_machine_problem_check(problem, error));
    LG_NEEDS(error, theta);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    return lg_tape_conclude(tape, add_windows(tape, problem, theta, loss, floor), error);
}
