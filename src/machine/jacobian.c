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

typedef struct chunk {
    const lg_machine_problem *problem;
    const double *theta;
    const uint32_t *samples; /* (count), or NULL: windows from `first` on */
    size_t first, count, batch;
    bool steps;                    /* residuals are the steps' own error, and have no priors */
    double *losses, *r, *jacobian; /* of each window; NULL: not wanted */
} chunk;

/* Adds the loss of a chunk. The steps' own error is the difference between predictions with the substeps and
 * with twice as many, times 1/(1 - 2^-p) for a scheme of order p. */
static lg_status add(lg_tape *tape, const chunk *of, double *sum) {
    const double factor = of->steps ? 1.0 / (1.0 - ldexp(1.0, -of->problem->scheme->order)) : 1.0;
    lg_machine_problem finer = *of->problem;
    LG_CLEAN(lg_chain_close) lg_chain c;
    LG_CLEAN(lg_chain_close) lg_chain twice = {.memory = NULL};
    finer.substeps *= 2;
    LG_TRY(lg_chain_open(tape, of->problem, of->theta, of->samples, of->first, of->count,
                         of->jacobian != NULL, &c));
    if (of->steps)
        LG_TRY(lg_chain_open(tape, &finer, of->theta, of->samples, of->first, of->count, false, &twice));
    c.against = of->steps ? &twice : NULL;
    c.factor = 1.0 / sqrt((double)of->batch * (double)(finer.window - lg_chain_first(&finer)));
    c.rows = lg_machine_linearised_rows(&finer);
    c.losses = of->losses, c.r = of->r, c.jacobian = of->jacobian;
    LG_TRY(lg_chain_pass_windows(&c));
    if (!of->steps || c.r != NULL) put_priors(&c, of->batch);
    for (size_t i = 0; of->steps && c.r != NULL && i < c.count * c.rows; i++) c.r[i] *= factor;
    *sum += factor * factor * c.loss;
    return LG_OK;
}

lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    *loss = 0.0;
    return add(tape, &(chunk){user, theta, samples, 0, count, batch, false, NULL, r, jacobian}, loss);
}

lg_status lg_machine_linearise_steps(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                                     size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    *loss = 0.0;
    return add(tape, &(chunk){user, theta, samples, 0, count, batch, true, NULL, r, jacobian}, loss);
}

/* ---- losses of all windows ---- */

/* Adds the loss of `count` windows, or of the steps' own error. losses (windows): of each one, or NULL. */
static lg_status add_all(lg_tape *tape, const lg_machine_problem *problem, const double *theta, size_t count,
                         size_t batch, bool steps, double *losses, double *sum) {
    for (size_t first = 0; first < count; first += LG_FIT_CHUNK) {
        const size_t some = count - first < LG_FIT_CHUNK ? count - first : LG_FIT_CHUNK;
        LG_TRY(add(tape,
                   &(chunk){problem, theta, NULL, first, some, batch, steps,
                            losses != NULL ? losses + first : NULL, NULL, NULL},
                   sum));
    }
    return LG_OK;
}

lg_status lg_machine_losses(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                            double *losses, lg_error *error) {
    double all = 0.0;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    memset(losses, 0, problem->windows * sizeof *losses);
    return lg_tape_conclude(tape, add_all(tape, problem, theta, problem->windows, 1, false, losses, &all),
                            error);
}

lg_status lg_machine_loss(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                          double *loss, double *floor, lg_error *error) {
    LG_NEEDS(error, problem, loss);
    LG_TRY(lg_machine_problem_check(problem, error));
    LG_NEEDS(error, theta);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    const size_t all = problem->windows - problem->validation;
    double sum = 0.0, of_steps = 0.0;
    lg_status status = add_all(tape, problem, theta, all, all, false, NULL, &sum);
    if (status == LG_OK && floor != NULL)
        status = add_all(tape, problem, theta, all, all, true, NULL, &of_steps);
    LG_TRY(lg_tape_conclude(tape, status, error));
    *loss = sum;
    if (floor != NULL) *floor = of_steps;
    return LG_OK;
}
