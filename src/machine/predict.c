/* Machines: free runs. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "machine/internal.h"

typedef struct runs {
    const lg_machine *machine;
    const double *theta;
    const lg_scheme *scheme;
    uint32_t substeps;
    const lg_machine_log *log;
    const size_t *start;
    size_t count, steps;
    double *positions, *velocities, *state, *row;
    size_t *at;
} runs;

static lg_status begin(lg_tape *tape, const runs *r, lg_machine_vars *vars, lg_machine_flow *flow) {
    lg_tape_reset(tape);
    const lg_var theta = lg_machine_parameter(tape, r->machine, r->theta);
    LG_TRY(lg_machine_bind(tape, r->machine, theta, vars));
    *flow = (lg_machine_flow){.vars = vars, .scheme = r->scheme, .substeps = r->substeps};
    return lg_machine_space(r->machine, &flow->space);
}

/* Writes point `step` of all runs in the log's units; keeps the scaled states in r->state for the next
 * step. */
static lg_status keep(lg_tape *tape, const runs *r, const lg_machine_flow *flow, const lg_var *parts,
                      size_t step) {
    const lg_machine *machine = r->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    double *q = r->row, *v = r->row + r->count * nq;
    const lg_var joined = lg_taped_join(tape, &flow->space, parts);
    LG_TRY(lg_read(tape, joined, r->count * flow->space.dim, r->state));
    LG_TRY(lg_read(tape, lg_machine_record_positions(tape, flow->vars, parts), r->count * nq, q));
    for (size_t i = 0; i < r->count; i++) r->at[i] = r->start[i] + step;
    const lg_var shown = lg_machine_record_shown(tape, flow->vars, r->log, r->at, (uint32_t)r->count, parts);
    LG_TRY(lg_read(tape, shown, r->count * nv, v));
    for (size_t i = 0; i < r->count; i++) {
        lg_machine_unscale_row(machine, q + i * nq, v + i * nv);
        for (size_t k = 0; k < nv && machine->accelerations; k++) v[i * nv + k] /= machine->scales.time;
        const size_t at = i * (r->steps + 1) + step;
        if (r->positions != NULL) memcpy(r->positions + at * nq, q + i * nq, nq * sizeof *q);
        if (r->velocities != NULL) memcpy(r->velocities + at * nv, v + i * nv, nv * sizeof *v);
    }
    return LG_OK;
}

static lg_status first_point(lg_tape *tape, const runs *r) {
    const lg_machine *machine = r->machine;
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var parts[LG_TAPED_MAX_PARTS];
    double *q = r->row, *v = r->row + r->count * machine->positions;
    LG_TRY(begin(tape, r, &vars, &flow));
    lg_machine_scaled_rows(machine, r->log, r->start, r->count, q, v);
    const uint32_t rows = (uint32_t)r->count;
    const lg_var positions = lg_input_f64(tape, lg_shape2(rows, machine->positions), q),
                 velocities = lg_input_f64(tape, lg_shape2(rows, machine->velocities), v);
    LG_TRY(lg_machine_record_state(tape, &vars, positions, velocities, parts));
    LG_TRY(lg_machine_start_bristles(tape, &vars, r->log, r->start, r->count, parts));
    return keep(tape, r, &flow, parts, 0);
}

static lg_status next_point(lg_tape *tape, const runs *r, size_t step) {
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var parts[LG_TAPED_MAX_PARTS];
    LG_TRY(begin(tape, r, &vars, &flow));
    for (size_t i = 0; i < r->count; i++) r->at[i] = r->start[i] + step - 1;
    const lg_var state =
        lg_input_f64(tape, lg_shape2((uint32_t)r->count, (uint32_t)flow.space.dim), r->state);
    LG_TRY(lg_taped_split(tape, &flow.space, state, parts));
    LG_TRY(lg_machine_record_interval(tape, &flow, r->log, r->at, (uint32_t)r->count, parts));
    return keep(tape, r, &flow, parts, step);
}

static lg_status run_all(const lg_context *context, lg_tape *tape, const runs *r) {
    LG_TRY(first_point(tape, r));
    for (size_t step = 1; step <= r->steps; step++) {
        if (lg_cancelled(context)) return LG_CANCELLED;
        LG_TRY(next_point(tape, r, step));
    }
    return LG_OK;
}

lg_status lg_machine_free_run(const lg_context *context, const lg_machine *machine, const double *theta,
                              const lg_scheme *scheme, uint32_t substeps, const lg_machine_log *log,
                              const size_t *start, size_t count, size_t steps, double *positions,
                              double *velocities, lg_error *error) {
    LG_NEEDS(error, machine, scheme, log, start);
    lg_space space;
    lg_tape *tape = NULL;
    if (count == 0 || count > UINT32_MAX || substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "free runs need at least one start and one substep");
    LG_TRY(lg_machine_space(machine, &space));
    runs r = {machine, theta,     scheme,     substeps, log,  start, count,
              steps,   positions, velocities, NULL,     NULL, NULL};
    r.state =
        lg_alloc(context, count * (space.dim + machine->positions + machine->velocities), sizeof *r.state);
    r.at = lg_alloc(context, count, sizeof *r.at);
    lg_status status = r.state != NULL && r.at != NULL ? LG_OK : LG_OUT_OF_MEMORY;
    if (status == LG_OK) status = lg_tape_create(context, NULL, &tape);
    if (status == LG_OK) {
        r.row = r.state + count * space.dim;
        status = run_all(context, tape, &r);
        if (status != LG_OK)
            (void)lg_fail(error, status, "%s",
                          status == LG_CANCELLED ? "the runs were stopped" : lg_tape_message(tape));
    } else {
        (void)lg_fail(error, status, "%s", lg_status_sentence(status));
    }
    lg_tape_destroy(tape);
    LG_FREE_ALL(context, r.state, r.at);
    return status;
}
