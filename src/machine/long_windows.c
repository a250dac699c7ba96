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

typedef struct run {
    lg_chain *of;   /* one window */
    double *z;      /* (M, numbers) */
    double *F;      /* (M - 1, numbers) */
    double *A, *B;  /* (M - 1, d, d), (M - 1, d, shared) */
    double *memory; /* of the batches of rows */
    size_t *start;  /* (LG_FIT_CHUNK) */
} run;

static size_t run_numbers(const lg_chain *c, size_t batch) {
    const size_t M = c->problem->window, d = c->axes.count, n = c->axes.numbers;
    return M * (2 * n + d * d + d * c->shared) + batch;
}

/* F, A and B of all intervals at z. */
static lg_status evaluate_run(lg_tape *tape, run *x) {
    const lg_chain *c = x->of;
    const size_t n = c->axes.numbers, d = c->axes.count, all = c->problem->window - 1,
                 first = lg_chain_row(c, 0, 0);
    lg_machine_problem rows = *c->problem;
    uint32_t samples[LG_FIT_CHUNK];
    size_t at[LG_FIT_CHUNK];
    rows.start = x->start;
    for (size_t j = 0; j < all; j += LG_FIT_CHUNK) {
        const size_t count = all - j < LG_FIT_CHUNK ? all - j : LG_FIT_CHUNK;
        lg_chain batch = *c;
        for (size_t s = 0; s < count; s++) samples[s] = (uint32_t)s, x->start[s] = first + j + s;
        batch.problem = &rows;
        batch.samples = samples;
        batch.count = count;
        batch.own = 0;
        batch.columns = c->shared;
        lg_chain_place(&batch, x->memory);
        memcpy(batch.z, x->z + j * n, count * n * sizeof *batch.z);
        LG_TRY(lg_chain_pass_interval(tape, &batch, 0, at));
        memcpy(x->F + j * n, batch.next, count * n * sizeof *x->F);
        memcpy(x->A + j * d * d, batch.A, count * d * d * sizeof *x->A);
        memcpy(x->B + j * d * c->shared, batch.S, count * d * c->shared * sizeof *x->B);
    }
    return LG_OK;
}

/* One round of Newton's method; returns the largest change, in scaled units. */
static double correct_run(run *x) {
    const size_t n = x->of->axes.numbers, all = x->of->problem->window - 1;
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
static void guess_run(run *x) {
    const lg_chain *c = x->of;
    const lg_machine *machine = c->problem->machine;
    const size_t n = c->axes.numbers;
    double there[LG_CHAIN_NUMBERS];
    memcpy(x->z, c->z, n * sizeof *x->z);
    for (uint32_t j = 1; j < c->problem->window; j++) {
        const size_t row = lg_chain_row(c, 0, j);
        double *z = x->z + j * n;
        lg_machine_scaled_rows(machine, &c->problem->log, &row, 1, z, z + machine->positions);
        lg_machine_weigh_row(c->problem, row, 1.0, there, there + machine->positions);
        for (size_t i = 0; i < machine->positions; i++)
            if (there[i] == 0.0) z[i] = (z - n)[i];
    }
}

/* Solves for a whole window. *found false: the rounds do not converge. */
static lg_status solve_run(lg_tape *tape, run *x, bool *found) {
    static const double enough = 1e-10, beyond = 1e6;
    guess_run(x);
    *found = false;
    for (int round = 0; round < ROUNDS && !*found; round++) {
        LG_TRY(evaluate_run(tape, x));
        const double most = correct_run(x);
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

/* S of point j + 1 from S of point j. */
static void pass_S(const lg_kernels *k, run *x, uint32_t j) {
    lg_chain *c = x->of;
    const size_t d = c->axes.count;
    memset(c->moved, 0, d * c->columns * sizeof *c->moved);
    for (size_t i = 0; i < d; i++)
        memcpy(c->moved + i * c->columns, x->B + (j * d + i) * c->shared, c->shared * sizeof *c->moved);
    lg_chain_move(k, c, j, x->A + j * d * d);
}

/* As pass_window, for a chain of one window. */
static lg_status pass_long(lg_tape *tape, lg_chain *c, run *x) {
    bool found;
    LG_TRY(lg_chain_first_points(tape, c));
    LG_TRY(solve_run(tape, x, &found));
    if (!found) return lg_chain_pass_window(tape, c);
    if (lg_chain_first(c->problem) == 0) lg_chain_put_rows(tape->k, c, 0);
    for (uint32_t j = 0; j + 1 < c->problem->window; j++) {
        pass_S(tape->k, x, j);
        memcpy(c->z, x->z + (j + 1) * c->axes.numbers, c->axes.numbers * sizeof *c->z);
        lg_chain_put_rows(tape->k, c, j + 1);
    }
    return LG_OK;
}

/* The part of the loss of one window that comes from the steps: see shard_floor. */
static lg_status add_floor(lg_tape *tape, lg_chain *c, run *x, double *floor) {
    const size_t numbers = c->problem->window * c->axes.numbers;
    const double power = ldexp(1.0, c->problem->scheme->order), factor = c->factor * power / (power - 1.0);
    lg_machine_problem twice = *c->problem;
    const lg_machine_problem *once = c->problem;
    double weight[LG_CHAIN_NUMBERS], *before = lg_pool_take(tape, numbers * sizeof *before);
    bool found[2] = {false, false};
    if (before == NULL) return lg_tape_status(tape);
    lg_status status = lg_chain_first_points(tape, c);
    if (status == LG_OK) status = solve_run(tape, x, &found[0]);
    memcpy(before, x->z, numbers * sizeof *before);
    twice.substeps *= 2;
    c->problem = &twice;
    if (status == LG_OK) status = solve_run(tape, x, &found[1]);
    c->problem = once;
    if (!found[0] || !found[1]) *floor = NAN;
    for (uint32_t j = lg_chain_first(once); status == LG_OK && j < once->window; j++) {
        lg_machine_weigh_row(once, lg_chain_row(c, 0, j), factor, weight, weight + once->machine->positions);
        for (size_t i = 0, k = j * c->axes.numbers; i < c->axes.numbers; i++, k++) {
            const double r = weight[i] * (x->z[k] - before[k]);
            *floor += r * r;
        }
    }
    lg_pool_give(tape, before, numbers * sizeof *before);
    return status;
}

lg_status lg_chain_pass_long(lg_tape *tape, lg_chain *all, double *floor) {
    lg_chain batch = *all;
    size_t start[LG_FIT_CHUNK];
    batch.count = LG_FIT_CHUNK;
    batch.own = 0;
    batch.columns = all->shared;
    const size_t room = lg_chain_numbers(&batch), M = all->problem->window, n = all->axes.numbers,
                 d = all->axes.count, bytes = run_numbers(all, room) * sizeof(double);
    run x = {.z = lg_pool_take(tape, bytes), .start = start};
    if (x.z == NULL) return lg_tape_status(tape);
    double loss = 0.0;
    x.F = x.z + M * n;
    x.A = x.F + M * n;
    x.B = x.A + M * d * d;
    x.memory = x.B + M * d * all->shared;
    lg_status status = LG_OK;
    for (size_t s = 0; s < all->count && status == LG_OK; s++) {
        lg_chain one = *all;
        one.count = 1;
        one.samples = all->samples + s;
        if (all->r != NULL) {
            one.r = all->r + s * all->rows;
            one.jacobian = all->jacobian + s * all->rows * all->columns;
        }
        x.of = &one;
        status = floor != NULL ? add_floor(tape, &one, &x, floor) : pass_long(tape, &one, &x);
        loss += one.loss;
    }
    all->loss = loss;
    lg_pool_give(tape, x.z, bytes);
    return status;
}

bool lg_machine_is_long(const lg_machine_problem *problem) {
    const lg_row_axes all = lg_row_axes_of(problem->machine);
    return problem->window >= LONG && problem->machine->bristles == 0 && along_only(&all) &&
           !problem->machine->accelerations;
}
