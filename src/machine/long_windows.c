/* Machines: long windows, whose intervals are computed together. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

/* A window of M rows is a system of M - 1 equations z_{j+1} = F_j(z_j). Newton's method solves all of them at
 * the same time, from the logged rows: F_j and dF_j/dz are computed for many rows at once, and
 *   d_{j+1} = F_j(z_j) - z_{j+1} + dF_j/dz d_j
 * is the change of z_{j+1}. A machine whose runs do not spread fast needs few rounds. */
enum { LONG = 512, ROUNDS = 12 };

static size_t place_run(const lg_chain *c, lg_chain_run *x, double *memory) {
    const size_t M = c->problem->window, d = c->axes.count, n = c->axes.numbers;
    const lg_chain_array arrays[] = {{&x->z, M * n},
                                     {&x->F, M * n},
                                     {&x->A, M * d * d},
                                     {&x->B, M * d * c->shared},
                                     {&x->dz, LG_FIT_CHUNK * n},
                                     {&x->apart, LG_FIT_CHUNK * c->shared}};
    return lg_chain_place(arrays, LG_COUNT(arrays), memory);
}

/* F, A and B of all intervals at z. */
static lg_status evaluate_run(lg_tape *tape, const lg_chain *c) {
    const lg_chain_run *x = c->run;
    const size_t n = c->axes.numbers, d = c->axes.count, all = c->problem->window - 1;
    lg_chain batch = *c;
    batch.columns = c->shared;
    batch.own = 0;
    batch.dz = x->dz;
    batch.apart = x->apart;
    for (size_t j = 0; j < all; j += batch.count) {
        batch.count = all - j < LG_FIT_CHUNK ? all - j : LG_FIT_CHUNK;
        batch.z = x->z + j * n;
        batch.next = x->F + j * n;
        batch.A = x->A + j * d * d;
        batch.moved = x->B + j * d * c->shared;
        for (size_t s = 0; s < batch.count; s++) batch.at[s] = c->at[0] + j + s;
        LG_TRY(lg_chain_interval(tape, &batch));
    }
    return LG_OK;
}

/* One round of Newton's method; returns the largest change, in scaled units. */
static double correct_run(const lg_chain *c) {
    const lg_chain_run *x = c->run;
    const size_t n = c->axes.numbers, all = c->problem->window - 1;
    double change[LG_CHAIN_NUMBERS] = {0}, next[LG_CHAIN_NUMBERS], most = 0;
    for (size_t j = 0; j < all; j++) {
        double *z = x->z + (j + 1) * n;
        for (size_t i = 0; i < n; i++) {
            next[i] = x->F[j * n + i] - z[i];
            for (size_t k = 0; k < n; k++) next[i] += x->A[(j * n + i) * n + k] * change[k];
            most = fabs(next[i]) <= most ? most : fabs(next[i]);
        }
        for (size_t i = 0; i < n; i++) z[i] += change[i] = next[i];
    }
    return most;
}

/* Logged rows as first guesses; where a number is missing, the one before. */
static void guess_run(const lg_chain *c) {
    const lg_chain_run *x = c->run;
    const lg_machine *machine = c->problem->machine;
    const size_t n = c->axes.numbers;
    double there[LG_CHAIN_NUMBERS];
    memcpy(x->z, c->z, n * sizeof *x->z);
    for (uint32_t j = 1; j < c->problem->window; j++) {
        const size_t row = c->at[0] + j;
        double *z = x->z + j * n;
        lg_machine_scaled_rows(machine, &c->problem->log, &row, 1, z, z + machine->positions);
        lg_machine_weigh_row(c->problem, row, 1.0, there, there + machine->positions);
        for (size_t i = 0; i < machine->positions; i++)
            if (there[i] == 0.0) z[i] = (z - n)[i];
    }
}

/* Solves for all rows of the only window. *found false: the rounds do not converge. */
static lg_status solve_run(lg_tape *tape, const lg_chain *c, bool *found) {
    static const double enough = 1e-10, beyond = 1e6;
    guess_run(c);
    *found = false;
    for (int round = 0; round < ROUNDS && !*found; round++) {
        LG_TRY(evaluate_run(tape, c));
        const double most = correct_run(c);
        if (!(most < beyond)) return LG_OK;
        *found = most < enough;
    }
    return LG_OK;
}

static bool along_only(const lg_row_axes *all) {
    for (uint32_t i = 0; i < all->count; i++)
        if (all->each[i].kind != LG_ALONG) return false;
    return true;
}

/* A window that cannot be solved for is passed from row to row. */
static lg_status pass_long(lg_tape *tape, lg_chain *c) {
    bool found;
    LG_TRY(lg_chain_first_points(tape, c));
    LG_TRY(solve_run(tape, c, &found));
    if (!found) c->run = NULL;
    return lg_chain_pass_windows(tape, c);
}

/* The part of the loss of one window that comes from the steps: see shard_floor. */
static lg_status add_floor(lg_tape *tape, lg_chain *c, double *floor) {
    const size_t n = c->axes.numbers, bytes = c->problem->window * n * sizeof(double);
    const double power = ldexp(1.0, c->problem->scheme->order), factor = c->factor * power / (power - 1.0);
    lg_machine_problem twice = *c->problem;
    const lg_machine_problem *once = c->problem;
    double weight[LG_CHAIN_NUMBERS], *before = lg_pool_take(tape, bytes);
    bool found[2] = {false, false};
    if (before == NULL) return lg_tape_status(tape);
    lg_status status = lg_chain_first_points(tape, c);
    if (status == LG_OK) status = solve_run(tape, c, &found[0]);
    memcpy(before, c->run->z, bytes);
    twice.substeps *= 2;
    c->problem = &twice;
    if (status == LG_OK) status = solve_run(tape, c, &found[1]);
    c->problem = once;
    if (!found[0] || !found[1]) *floor = NAN;
    for (uint32_t j = lg_chain_first(once); status == LG_OK && j < once->window; j++) {
        lg_machine_weigh_row(once, c->at[0] + j, factor, weight, weight + once->machine->positions);
        for (size_t i = 0; i < n; i++) {
            const double r = weight[i] * (c->run->z[j * n + i] - before[j * n + i]);
            *floor += r * r;
        }
    }
    lg_pool_give(tape, before, bytes);
    return status;
}

lg_status lg_chain_pass_long(lg_tape *tape, lg_chain *all, double *floor) {
    lg_chain_run x;
    const size_t bytes = place_run(all, &x, NULL) * sizeof(double);
    double *memory = lg_pool_take(tape, bytes), loss = 0.0;
    if (memory == NULL) return lg_tape_status(tape);
    (void)place_run(all, &x, memory);
    lg_status status = LG_OK;
    for (size_t s = 0; s < all->count && status == LG_OK; s++) {
        lg_chain one = *all;
        one.count = 1;
        one.done = 0;
        one.samples = all->samples + s;
        one.run = &x;
        if (all->r != NULL) {
            one.r = all->r + s * all->rows;
            one.jacobian = all->jacobian + s * all->rows * all->columns;
        }
        status = floor != NULL ? add_floor(tape, &one, floor) : pass_long(tape, &one);
        loss += one.loss;
        all->done = one.done;
    }
    all->loss = loss;
    lg_pool_give(tape, memory, bytes);
    return status;
}

bool lg_machine_is_long(const lg_machine_problem *problem) {
    const lg_row_axes all = lg_row_axes_of(problem->machine);
    return problem->window >= LONG && problem->machine->bristles == 0 && along_only(&all) &&
           !problem->machine->accelerations;
}
