/* Machines: estimates the start of a window from the neighbouring window, and the states at all rows of a
 * log. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

typedef struct walk {
    const lg_context *context;
    const lg_machine_problem *problem;
    lg_machine_problem back; /* its log has the rows in reverse order: time falls */
    lg_tape *tape;
    size_t parameters, numbers; /* of the fit; of a start */
    double *theta, *trial;      /* (parameters): the best so far, and a trial */
    double *before;             /* (parameters): work of settle */
    double *losses, *found;     /* (windows) of theta and of trial; losses belong to the caller */
    double *t, *u;              /* of the reversed log */
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
    x->back = *x->problem;
    x->back.log.t = x->t;
    x->back.log.u = m > 0 ? x->u : NULL;
}

/* ---- states ---- */

/* Makes z the start of window w in `trial`. */
static void put_start(const walk *x, size_t w, const double *z) {
    const lg_machine *machine = x->problem->machine;
    double unit[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES],
        guess[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES];
    double *own = x->trial + lg_machine_shared(x->problem) + w * x->numbers;
    lg_machine_start_units(x->problem, unit);
    lg_machine_scaled_rows(machine, &x->problem->log, &x->problem->start[w], 1, guess,
                           guess + machine->positions);
    for (size_t k = 0; k < x->numbers; k++) own[k] = (z[k] - guess[k]) / unit[k];
}

/* Moves the windows of the chain from their starts over a window, in either direction. */
static lg_status pass(const walk *x, lg_chain *c, bool backwards) {
    LG_TRY(lg_chain_first_points(c));
    if (backwards) c->problem = &x->back;
    for (size_t i = 0; i < c->count && backwards; i++) c->at[i] = x->problem->log.rows - 1 - c->at[i];
    for (uint32_t j = 0; j + 1 < x->problem->window; j++) LG_TRY(lg_chain_advance(c));
    return LG_OK;
}

/* Sets the starts in `trial` of up to LG_FIT_CHUNK windows that follow windows first, first + 1, ..., or of
 * these windows from those that follow. */
static lg_status follow(walk *x, size_t first, bool backwards) {
    const lg_machine_problem *problem = x->problem;
    uint32_t from[LG_FIT_CHUNK], of[LG_FIT_CHUNK], count = 0;
    for (size_t w = first; w < first + LG_FIT_CHUNK && w + 1 < problem->windows; w++) {
        const size_t last = problem->start[w] + problem->window - 1; /* row of window w */
        if (problem->start[w + 1] != last) continue;
        from[count] = (uint32_t)w + backwards;
        of[count++] = (uint32_t)w + !backwards;
    }
    if (count == 0) return LG_OK;
    LG_CLEAN(lg_chain_close) lg_chain c;
    LG_TRY(lg_chain_open(x->tape, problem, x->theta, from, 0, count, false, &c));
    LG_TRY(pass(x, &c, backwards));
    for (uint32_t i = 0; i < count; i++) put_start(x, of[i], c.z + i * c.axes.numbers);
    return LG_OK;
}

/* ---- losses ---- */

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
    LG_TRY(lg_machine_losses(x->context, x->problem, x->trial, x->found, NULL));
    *kept = keep_better(x);
    return LG_OK;
}

static lg_status go_along(walk *x) {
    enum { ROUNDS = 20 };
    const bool both = x->problem->machine->lags == 0 && x->problem->machine->bristles == 0;
    LG_TRY(lg_machine_losses(x->context, x->problem, x->theta, x->losses, NULL));
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
    LG_FREE_ALL(x->context, x->trial, x->before, x->found, x->t, x->u);
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
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(x->trial, x->parameters), LG_ARRAY(x->before, x->parameters),
                        LG_ARRAY(x->found, problem->windows), LG_ARRAY(x->t, rows),
                        LG_ARRAY(x->u, rows * 4 * problem->machine->input_count)));
    reverse(x);
    return lg_tape_create(context, NULL, &x->tape);
}

lg_status lg_machine_continue_starts(const lg_context *context, const lg_machine_problem *problem,
                                     double *theta, double *losses, lg_error *error) {
    LG_TRY(lg_machine_problem_check(problem, error));
    const lg_machine *machine = problem->machine;
    if (!lg_machine_starts_estimated(problem) || machine->directions > 0 || machine->rotations > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "only estimated starts of lines and angles are continued");
    LG_CLEAN(close_walk) walk x;
    lg_status status = open_walk(context, problem, theta, losses, &x);
    if (status == LG_OK) status = go_along(&x);
    return lg_tape_conclude(x.tape, status, error);
}

/* ---- states at all rows ---- */

/* Writes the states of windows first, first + 1, ..., at most LG_FIT_CHUNK, to their rows. */
static lg_status write_states(walk *x, size_t first, double *q, double *v) {
    const lg_machine *machine = x->problem->machine;
    const size_t left = x->problem->windows - first, count = left < LG_FIT_CHUNK ? left : LG_FIT_CHUNK;
    LG_CLEAN(lg_chain_close) lg_chain c;
    LG_TRY(lg_chain_open(x->tape, x->problem, x->theta, NULL, first, count, false, &c));
    LG_TRY(lg_chain_first_points(&c));
    for (;;) {
        for (size_t i = 0; i < count; i++)
            lg_chain_read(&c, i, q + c.at[i] * machine->positions, v + c.at[i] * machine->velocities);
        if (c.point + 1 == x->problem->window) return LG_OK;
        LG_TRY(lg_chain_advance(&c));
    }
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
    LG_CLEAN(close_walk) walk x;
    LG_TRY(lg_tape_conclude(NULL, open_walk(context, problem, theta, theta + n, &x), error));
    LG_TRY(settle(&x, error));
    for (size_t first = 0; first < problem->windows; first += LG_FIT_CHUNK)
        LG_TRY(lg_tape_conclude(x.tape, write_states(&x, first, q, v), error));
    return LG_OK;
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
