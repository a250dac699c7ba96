/* Machines: free runs. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

typedef struct runs {
    lg_machine_problem problem; /* its machine, parameters, scheme, substeps and log; runs are windows */
    size_t steps;
    double *positions, *velocities;
} runs;

/* Points of the runs of a chain: the rows of the log in which their parts end, and the rows of the results
 * that get the current points. */
typedef struct points {
    size_t end[LG_FIT_CHUNK], out[LG_FIT_CHUNK];
} points;

/* Writes the current point of run i in the log's units. */
static void keep(const runs *r, const lg_chain *c, size_t i, size_t out) {
    const lg_machine *machine = r->problem.machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    double row[LG_CHAIN_NUMBERS], *q = row, *v = row + nq;
    lg_chain_shown(c, i, row);
    for (size_t k = 0; k < nq + nv && r->steps == LG_MACHINE_TO_END; k++)
        if (isnan(row[k])) row[k] = INFINITY; /* NaN marks rows that are not predicted */
    lg_machine_unscale_row(machine, q, v);
    for (size_t k = 0; k < nv && machine->accelerations; k++) v[k] /= machine->scales.time;
    if (r->positions != NULL) memcpy(r->positions + out * nq, q, nq * sizeof *q);
    if (r->velocities != NULL) memcpy(r->velocities + out * nv, v, nv * sizeof *v);
}

/* Leaves out the runs whose parts end with the current point, and goes to the next rows of the results. */
static void end_runs(lg_chain *c, points *p) {
    const size_t n = c->axes.numbers;
    size_t kept = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (c->at[i] + 1 >= p->end[i]) continue;
        c->at[kept] = c->at[i];
        p->end[kept] = p->end[i];
        p->out[kept] = p->out[i] + 1;
        memmove(c->z + kept++ * n, c->z + i * n, n * sizeof *c->z);
    }
    c->count = kept;
}

static lg_status run_group(const runs *r, lg_chain *c, points *p) {
    LG_TRY(lg_chain_first_points(c));
    for (size_t step = 0;; step++) {
        if (lg_cancelled(c->tape->context)) return LG_CANCELLED;
        LG_TRY(lg_chain_show(c));
        for (size_t i = 0; i < c->count; i++) keep(r, c, i, p->out[i]);
        end_runs(c, p);
        if (step == r->steps || c->count == 0) return LG_OK;
        LG_TRY(lg_chain_advance(c));
    }
}

static lg_status run_all(lg_tape *tape, const runs *r) {
    const lg_machine_problem *problem = &r->problem;
    const lg_machine_log *log = &problem->log;
    points p;
    for (size_t first = 0; first < problem->windows; first += LG_FIT_CHUNK) {
        const size_t left = problem->windows - first, count = left < LG_FIT_CHUNK ? left : LG_FIT_CHUNK;
        for (size_t i = 0; i < count; i++) {
            const size_t run = first + i, row = problem->start[run];
            p.end[i] = log->first[lg_machine_log_part(log, row) + 1];
            p.out[i] = r->steps == LG_MACHINE_TO_END ? row : run * (r->steps + 1);
        }
        LG_CLEAN(lg_chain_close) lg_chain c;
        LG_TRY(lg_chain_open(tape, problem, NULL, NULL, first, count, false, &c));
        LG_TRY(run_group(r, &c, &p));
    }
    return LG_OK;
}

static void fill(double *x, size_t count, double value) {
    for (size_t i = 0; x != NULL && i < count; i++) x[i] = value;
}

lg_status lg_machine_free_run(const lg_context *context, const lg_machine *machine, const double *theta,
                              const lg_scheme *scheme, uint32_t substeps, const lg_machine_log *log,
                              const size_t *start, size_t count, size_t steps, double *positions,
                              double *velocities, lg_error *error) {
    LG_NEEDS(error, machine, scheme, log, start);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    const bool to_end = steps == LG_MACHINE_TO_END;
    if ((count == 0 && !to_end) || count > UINT32_MAX || substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "free runs need at least one start and one substep");
    if (to_end) fill(positions, log->rows * machine->positions, NAN);
    if (to_end) fill(velocities, log->rows * machine->velocities, NAN);
    const runs r = {.problem = {.machine = machine,
                                .scheme = scheme,
                                .substeps = substeps,
                                .theta = theta,
                                .log = *log,
                                .start = start,
                                .windows = count},
                    .steps = steps,
                    .positions = positions,
                    .velocities = velocities};
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    const lg_status status = run_all(tape, &r);
    return status == LG_OK
               ? status
               : lg_fail(error, status, "%s",
                         status == LG_CANCELLED ? "the runs were stopped" : lg_tape_message(tape));
}
