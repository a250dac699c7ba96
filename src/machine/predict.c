/* Machines: free runs. */
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "machine/internal.h"

/* A run: its first row of the log, the row in which its part ends, and the row of the results that gets its
 * first point. */
typedef struct one {
    size_t start, end, out;
} one;

typedef struct runs {
    lg_machine_problem problem; /* its machine, parameters, scheme, substeps and log */
    size_t count, steps, dim;   /* runs that have not ended; dim: of a state */
    double *positions, *velocities, *state, *row;
    one *run;
    size_t *at;
} runs;

static void find_rows(const runs *r, size_t step) {
    for (size_t i = 0; i < r->count; i++) r->at[i] = r->run[i].start + step;
}

/* Writes point `step` of all runs in the log's units; keeps the scaled states in r->state for the next
 * step. */
static lg_status keep(lg_tape *tape, const runs *r, const lg_machine_flow *flow, const lg_var *parts,
                      size_t step) {
    const lg_machine *machine = r->problem.machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    double *q = r->row, *v = r->row + r->count * nq;
    const lg_var joined = lg_taped_join(tape, &flow->space, parts);
    LG_TRY(lg_read(tape, joined, r->count * r->dim, r->state));
    LG_TRY(lg_read(tape, lg_machine_record_positions(tape, flow->vars, parts), r->count * nq, q));
    find_rows(r, step);
    const lg_var shown =
        lg_machine_record_shown(tape, flow->vars, &r->problem.log, r->at, (uint32_t)r->count, parts);
    LG_TRY(lg_read(tape, shown, r->count * nv, v));
    for (size_t k = 0; k < r->count * (nq + nv) && r->steps == LG_MACHINE_TO_END; k++)
        if (isnan(r->row[k])) r->row[k] = INFINITY; /* NaN marks rows that are not predicted */
    for (size_t i = 0; i < r->count; i++) {
        lg_machine_unscale_row(machine, q + i * nq, v + i * nv);
        for (size_t k = 0; k < nv && machine->accelerations; k++) v[i * nv + k] /= machine->scales.time;
        const size_t at = r->run[i].out + step;
        if (r->positions != NULL) memcpy(r->positions + at * nq, q + i * nq, nq * sizeof *q);
        if (r->velocities != NULL) memcpy(r->velocities + at * nv, v + i * nv, nv * sizeof *v);
    }
    return LG_OK;
}

/* Computes point `step` of all runs: from the log, or from the point before. */
static lg_status take_point(lg_tape *tape, const runs *r, size_t step) {
    const lg_machine_problem *problem = &r->problem;
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var parts[LG_TAPED_MAX_PARTS], positions, velocities;
    lg_tape_reset(tape);
    LG_TRY(lg_machine_begin_flow(tape, problem, lg_machine_problem_parameter(tape, problem, NULL), &vars,
                                 &flow));
    find_rows(r, step > 0 ? step - 1 : 0);
    if (step == 0) {
        LG_TRY(lg_machine_record_rows(tape, problem->machine, &problem->log, r->at, r->count, &positions,
                                      &velocities));
        LG_TRY(lg_machine_record_state(tape, &vars, positions, velocities, parts));
        LG_TRY(lg_machine_start_bristles(tape, &vars, &problem->log, r->at, r->count, parts));
    } else {
        const lg_var state = lg_input_f64(tape, lg_shape2((uint32_t)r->count, (uint32_t)r->dim), r->state);
        LG_TRY(lg_taped_split(tape, &flow.space, state, parts));
        LG_TRY(lg_machine_record_interval(tape, &flow, &problem->log, r->at, (uint32_t)r->count, parts));
    }
    return keep(tape, r, &flow, parts, step);
}

/* Leaves out the runs whose parts have no row for point `step`. */
static void end_runs(runs *r, size_t step) {
    size_t kept = 0;
    for (size_t i = 0; i < r->count; i++) {
        if (r->run[i].start + step >= r->run[i].end) continue;
        r->run[kept] = r->run[i];
        memmove(r->state + kept++ * r->dim, r->state + i * r->dim, r->dim * sizeof *r->state);
    }
    r->count = kept;
}

static lg_status run_all(const lg_context *context, lg_tape *tape, runs *r) {
    for (size_t step = 0; step <= r->steps; step++) {
        if (lg_cancelled(context)) return LG_CANCELLED;
        end_runs(r, step);
        if (r->count == 0) break;
        LG_TRY(take_point(tape, r, step));
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
    lg_space space;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    const bool to_end = steps == LG_MACHINE_TO_END;
    if ((count == 0 && !to_end) || count > UINT32_MAX || substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "free runs need at least one start and one substep");
    LG_TRY(lg_machine_space(machine, &space));
    if (to_end) fill(positions, log->rows * machine->positions, NAN);
    if (to_end) fill(velocities, log->rows * machine->velocities, NAN);
    if (count == 0) return LG_OK;
    LG_TRY_SCRATCH(double, state, context, count *(space.dim + machine->positions + machine->velocities),
                   lg_no_memory(error));
    LG_TRY_SCRATCH(size_t, at, context, count, lg_no_memory(error));
    LG_TRY_SCRATCH(one, run, context, count, lg_no_memory(error));
    runs r = {
        .problem = {.machine = machine, .scheme = scheme, .substeps = substeps, .theta = theta, .log = *log},
        .count = count,
        .steps = steps,
        .dim = space.dim,
        .positions = positions,
        .velocities = velocities,
        .state = state,
        .row = state + count * space.dim,
        .run = run,
        .at = at};
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    for (size_t i = 0; i < count; i++)
        run[i] = (one){start[i], log->first[lg_machine_log_part(log, start[i]) + 1],
                       to_end ? start[i] : i * (steps + 1)};
    const lg_status status = run_all(context, tape, &r);
    return status == LG_OK
               ? status
               : lg_fail(error, status, "%s",
                         status == LG_CANCELLED ? "the runs were stopped" : lg_tape_message(tape));
}
