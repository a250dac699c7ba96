/* Machines: estimates the start of a window from the neighbouring window, and the states at all rows of a
 * log. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

typedef struct walk {
    const lg_context *context;
    const lg_machine_problem *problem;
    lg_fit_problem fit;
    lg_tape *tape;
    size_t parameters, numbers; /* of the fit; of a start */
    double *theta, *trial;      /* (parameters): the best so far, and a trial */
    double *before;             /* (parameters): work of settle */
    double *losses, *found;     /* (windows) of theta and of trial; losses belong to the caller */
    double *z;                  /* (windows, numbers): positions, then velocities, in scaled units */
    double *t, *u;              /* of the reversed log */
    lg_machine_log back;        /* the log with its rows in reverse order: time falls */
} walk;

/* ---- the log backwards ---- */

/* Coefficients of u(1 - s) from those of u(s), `stride` numbers apart. */
static void turn_round(const double *u, size_t stride, double *out) {
    const double a = u[0], b = u[stride], c = u[2 * stride], d = u[3 * stride];
    out[0] = a + b + c + d;
    out[stride] = -b - 2.0 * c - 3.0 * d;
    out[2 * stride] = c + 3.0 * d;
    out[3 * stride] = -d;
}

static void reverse(walk *x) {
    const lg_machine_log *log = &x->problem->log;
    const size_t rows = log->rows, m = x->problem->machine->input_count;
    for (size_t row = 0; row < rows; row++) x->t[row] = log->t[rows - 1 - row];
    for (size_t row = 0; row + 1 < rows && m > 0; row++)
        for (size_t k = 0; k < m; k++)
            turn_round(log->u + (rows - 2 - row) * 4 * m + k, m, x->u + row * 4 * m + k);
    x->back = *log;
    x->back.t = x->t;
    x->back.u = m > 0 ? x->u : NULL;
}

/* ---- states ---- */

/* Moves the states z (count, numbers) from rows at[0..count-1] over one interval of `log`. */
static lg_status pass(const walk *x, const lg_machine_log *log, const size_t *at, uint32_t count, double *z) {
    lg_tape *tape = x->tape;
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var parts[LG_TAPED_MAX_PARTS];
    lg_tape_reset(tape);
    LG_TRY(lg_machine_begin_flow(tape, x->problem, lg_machine_problem_parameter(tape, x->problem, x->theta),
                                 &vars, &flow));
    const lg_var from = lg_input_f64(tape, lg_shape2(count, (uint32_t)x->numbers), z);
    LG_TRY(lg_machine_split_row(tape, &vars, from, parts));
    LG_TRY(lg_machine_record_interval(tape, &flow, log, at, count, parts));
    const lg_var to =
        lg_machine_columns(tape, lg_machine_join_row(tape, &vars, parts), 0, (uint32_t)x->numbers);
    return lg_read(tape, to, count * x->numbers, z);
}

/* z of window w: its start in theta (out), or theta from it. */
static void exchange(const walk *x, size_t w, bool out, double *z, double *theta) {
    const lg_machine *machine = x->problem->machine;
    double unit[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES],
        guess[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES];
    double *own = theta + lg_machine_shared(x->problem) + w * x->numbers;
    lg_machine_start_units(x->problem, unit);
    lg_machine_scaled_rows(machine, &x->problem->log, &x->problem->start[w], 1, guess,
                           guess + machine->positions);
    for (size_t k = 0; k < x->numbers; k++)
        if (out)
            z[k] = guess[k] + own[k] * unit[k];
        else
            own[k] = (z[k] - guess[k]) / unit[k];
}

/* Sets the starts in `trial` of up to LG_FIT_CHUNK windows that follow windows first, first + 1, ..., or of
 * these windows from those that follow. */
static lg_status follow(walk *x, size_t first, bool backwards) {
    const lg_machine_problem *problem = x->problem;
    size_t at[LG_FIT_CHUNK], of[LG_FIT_CHUNK];
    uint32_t count = 0;
    for (size_t w = first; w < first + LG_FIT_CHUNK && w < problem->windows; w++) {
        const size_t last = problem->start[w] + problem->window - 1; /* row of window w */
        if (w + 1 >= problem->windows || problem->start[w + 1] != last) continue;
        const size_t from = backwards ? w + 1 : w, row = problem->start[from];
        exchange(x, from, true, x->z + count * x->numbers, x->theta);
        at[count] = backwards ? problem->log.rows - 1 - row : row;
        of[count++] = backwards ? w : w + 1;
    }
    for (uint32_t j = 0; j + 1 < problem->window && count > 0; j++) {
        LG_TRY(pass(x, backwards ? &x->back : &problem->log, at, count, x->z));
        for (uint32_t i = 0; i < count; i++) at[i]++;
    }
    for (uint32_t i = 0; i < count; i++) exchange(x, of[i], false, x->z + i * x->numbers, x->trial);
    return LG_OK;
}

/* ---- losses ---- */

static lg_status find_losses(walk *x, const double *theta, double *losses) {
    uint32_t samples[LG_FIT_CHUNK];
    for (size_t first = 0; first < x->fit.samples; first += x->fit.chunk) {
        const size_t left = x->fit.samples - first, count = left < x->fit.chunk ? left : x->fit.chunk;
        lg_var r;
        lg_tape_reset(x->tape);
        const lg_var parameters = lg_parameter(x->tape, lg_shape1((uint32_t)x->parameters), theta);
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)(first + i);
        LG_TRY(x->fit.residuals(x->fit.user, x->tape, parameters, samples, count, 1, &r));
        LG_TRY(
            lg_read(x->tape, lg_sum_axis(x->tape, lg_square(x->tape, r), 1, false), count, losses + first));
    }
    return LG_OK;
}

/* Keeps the starts of `trial` that lower the loss of their window well; returns how many. */
static size_t keep_better(walk *x) {
    static const double well = 0.5;
    size_t kept = 0;
    for (size_t w = 0; w < x->problem->windows; w++) {
        const size_t at = lg_machine_shared(x->problem) + w * x->numbers;
        if (!isfinite(x->found[w]) || x->found[w] >= well * x->losses[w]) continue;
        memcpy(x->theta + at, x->trial + at, x->numbers * sizeof *x->theta);
        x->losses[w] = x->found[w];
        kept++;
    }
    return kept;
}

static lg_status go(walk *x, bool backwards, size_t *kept) {
    memcpy(x->trial, x->theta, x->parameters * sizeof *x->trial);
    for (size_t first = 0; first < x->problem->windows; first += LG_FIT_CHUNK)
        LG_TRY(follow(x, first, backwards));
    LG_TRY(find_losses(x, x->trial, x->found));
    *kept = keep_better(x);
    return LG_OK;
}

static lg_status go_along(walk *x) {
    enum { ROUNDS = 20 };
    const bool both = x->problem->machine->lags == 0 && x->problem->machine->bristles == 0;
    LG_TRY(find_losses(x, x->theta, x->losses));
    for (int round = 0, still = 0; round < ROUNDS && still < 2; round++) {
        size_t kept = 0;
        if (round % 2 == 0 || both) LG_TRY(go(x, round % 2 == 1, &kept));
        still = kept > 0 ? 0 : still + 1;
    }
    return LG_OK;
}

/* ---- calls ---- */

static void close_walk(walk *x) {
    lg_tape_destroy(x->tape);
    LG_FREE_ALL(x->context, x->trial, x->before, x->found, x->z, x->t, x->u);
}

static lg_status open_walk(const lg_context *context, const lg_machine_problem *problem, double *theta,
                           double *losses, walk *x) {
    const size_t rows = problem->log.rows;
    *x = (walk){.context = context,
                .problem = problem,
                .theta = theta,
                .losses = losses,
                .parameters = lg_machine_problem_parameters(problem),
                .numbers = lg_machine_start_numbers(problem->machine)};
    lg_machine_fit_problem(problem, &x->fit);
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(x->trial, x->parameters), LG_ARRAY(x->before, x->parameters),
                        LG_ARRAY(x->found, problem->windows), LG_ARRAY(x->z, LG_FIT_CHUNK * x->numbers),
                        LG_ARRAY(x->t, rows), LG_ARRAY(x->u, rows * 4 * problem->machine->input_count)));
    reverse(x);
    return lg_tape_create(context, NULL, &x->tape);
}

lg_status lg_machine_continue_starts(const lg_context *context, const lg_machine_problem *problem,
                                     double *theta, double *losses, lg_error *error) {
    LG_TRY(lg_machine_problem_check(problem, error));
    const lg_machine *machine = problem->machine;
    if (!lg_machine_starts_estimated(problem) || machine->directions > 0 || machine->rotations > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "only estimated starts of lines and angles are continued");
    walk x;
    lg_status status = open_walk(context, problem, theta, losses, &x);
    if (status == LG_OK) status = go_along(&x);
    status = lg_tape_conclude(x.tape, status, error);
    close_walk(&x);
    return status;
}

/* ---- states at all rows ---- */

/* Writes the states of windows first, first + 1, ..., at most LG_FIT_CHUNK, to their rows. */
static lg_status write_states(walk *x, size_t first, double *q, double *v) {
    const lg_machine_problem *problem = x->problem;
    const lg_machine *machine = problem->machine;
    const size_t left = problem->windows - first, nq = machine->positions, nv = machine->velocities;
    const uint32_t count = (uint32_t)(left < LG_FIT_CHUNK ? left : LG_FIT_CHUNK);
    size_t at[LG_FIT_CHUNK];
    for (uint32_t i = 0; i < count; i++) {
        at[i] = problem->start[first + i];
        exchange(x, first + i, true, x->z + i * x->numbers, x->theta);
    }
    for (uint32_t j = 0;; j++) {
        for (uint32_t i = 0; i < count; i++) {
            const double *z = x->z + i * x->numbers;
            memcpy(q + at[i] * nq, z, nq * sizeof *q);
            memcpy(v + at[i] * nv, z + nq, nv * sizeof *v);
            lg_machine_unscale_row(machine, q + at[i] * nq, v + at[i] * nv);
        }
        if (j + 1 == problem->window) break;
        LG_TRY(pass(x, &problem->log, at, count, x->z));
        for (uint32_t i = 0; i < count; i++) at[i]++;
    }
    return LG_OK;
}

/* Fits the starts of all windows, and continues them while that changes one. x->trial is overwritten. */
static lg_status settle(walk *x, lg_error *error) {
    enum { ROUNDS = 4 };
    for (int round = 0; round < ROUNDS; round++) {
        for (size_t first = 0; first < x->problem->windows; first += LG_FIT_CHUNK) {
            const size_t left = x->problem->windows - first,
                         count = left < LG_FIT_CHUNK ? left : LG_FIT_CHUNK;
            LG_TRY(lg_machine_fit_starts(x->context, x->problem, first, count, x->theta, error));
        }
        memcpy(x->before, x->theta, x->parameters * sizeof *x->before);
        LG_TRY(lg_tape_conclude(x->tape, go_along(x), error));
        if (memcmp(x->before, x->theta, x->parameters * sizeof *x->before) == 0) break;
    }
    return LG_OK;
}

static lg_status estimate_states(const lg_context *context, const lg_machine_problem *problem, double *q,
                                 double *v, lg_error *error) {
    const size_t n = lg_machine_problem_parameters(problem);
    LG_TRY_SCRATCH(double, theta, context, n + problem->windows, lg_no_memory(error));
    walk x;
    lg_status status = lg_tape_conclude(NULL, open_walk(context, problem, theta, theta + n, &x), error);
    if (status == LG_OK) status = settle(&x, error);
    for (size_t first = 0; first < problem->windows && status == LG_OK; first += LG_FIT_CHUNK)
        status = lg_tape_conclude(x.tape, write_states(&x, first, q, v), error);
    close_walk(&x);
    return status;
}

lg_status lg_machine_estimate_states(const lg_context *context, const lg_machine *machine,
                                     const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                     const lg_machine_log *log, uint32_t window, double *q, double *v,
                                     lg_error *error) {
    lg_machine_problem problem = {.machine = machine,
                                  .scheme = scheme,
                                  .substeps = substeps,
                                  .window = window,
                                  .starts = LG_MACHINE_STARTS_ESTIMATED,
                                  .theta = theta,
                                  .log = *log};
    if (theta == NULL && machine->parameters > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the machine has parameters, and they are NULL");
    if (!machine->accelerations || log->a == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "states are estimated from accelerations, but the log has no accelerations");
    memcpy(q, log->q, log->rows * machine->positions * sizeof *q);
    memcpy(v, log->v, log->rows * machine->velocities * sizeof *v);
    LG_TRY_SCRATCH(size_t, start, context, log->rows, lg_no_memory(error));
    problem.windows = lg_machine_windows(machine, log, window, window - 1, true, start);
    problem.start = start;
    lg_machine_scale_loss(&problem);
    if (problem.windows == 0) return LG_OK;
    LG_TRY(lg_machine_problem_check(&problem, error));
    return estimate_states(context, &problem, q, v, error);
}
