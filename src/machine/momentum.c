/* Machines: windows as a regression of momenta.
 *
 * Momenta p = M(q) v and forces are linear in masses, stiffnesses and dampings, so that the equations of
 * motion integrated over logged rows,
 *   p(row M) - p(row 1) = sum over rows of h f(q, v, u),
 * hardly have local minima, however wrong the parameters are. Velocities predicted with M^-1 do. */
#include <math.h>

#include "machine/internal.h"

/* The momenta of a state, (B, numbers). */
static lg_var momenta_of(lg_tape *tape, const lg_machine *machine, const lg_var *parts) {
    const lg_machine_places at = lg_machine_parts(machine);
    lg_var both[2];
    uint32_t count = 0;
    if (at.m >= 0) both[count++] = parts[at.m];
    if (at.p >= 0) {
        const uint32_t rows = lg_rows_of(tape, parts[at.p]);
        both[count++] = lg_reshape(tape, parts[at.p], lg_shape2(rows, 3 * machine->directions));
    }
    return lg_joined(tape, both, count);
}

/* 1/sqrt(batch) for windows whose rows are complete, 0 for others: (count, 1). */
static lg_var weights_of(lg_tape *tape, const lg_machine_problem *problem, const size_t *at, size_t count,
                         size_t batch) {
    void *memory;
    const lg_var out = lg_input_buffer(tape, lg_shape2((uint32_t)count, 1), &memory);
    for (size_t s = 0; s < count && !lg_is_none(out); s++) {
        bool complete = true;
        for (uint32_t j = 0; j < problem->window && complete; j++)
            complete = lg_machine_log_complete(problem->machine, &problem->log, at[s] + j, false);
        ((double *)memory)[s] = complete ? 1.0 / sqrt((double)batch) : 0.0;
    }
    return out;
}

static lg_status momentum_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                    size_t count, size_t batch, lg_var *r) {
    const lg_machine_problem *problem = user;
    const lg_machine *machine = problem->machine;
    size_t at[LG_FIT_CHUNK];
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var parts[LG_TAPED_MAX_PARTS], q, v, sum = LG_NONE;
    for (size_t s = 0; s < count; s++) at[s] = problem->start[samples[s]];
    const lg_var weights = weights_of(tape, problem, at, count, batch);
    LG_TRY(lg_machine_begin_flow(tape, problem, theta, &vars, &flow));
    for (uint32_t j = 0;; j++) {
        LG_TRY(lg_machine_record_rows(tape, machine, &problem->log, at, count, &q, &v));
        LG_TRY(lg_machine_record_state(tape, &vars, q, v, parts));
        const lg_var logged = momenta_of(tape, machine, parts);
        if (j > 0) sum = lg_add(tape, sum, logged);
        if (j + 1 == problem->window) break;
        LG_TRY(lg_machine_record_interval(tape, &flow, &problem->log, at, (uint32_t)count, parts));
        const lg_var predicted = momenta_of(tape, machine, parts);
        sum = j > 0 ? lg_sub(tape, sum, predicted) : lg_neg(tape, predicted);
        for (size_t s = 0; s < count; s++) at[s]++;
    }
    *r = lg_mul(tape, sum, weights);
    return lg_tape_status(tape);
}

void lg_machine_momentum_problem(const lg_machine_problem *problem, lg_fit_problem *out) {
    *out = (lg_fit_problem){.parameters = problem->machine->parameters,
                            .samples = problem->windows,
                            .residuals = momentum_residuals,
                            .user = (void *)(uintptr_t)problem, /* never written */
                            .validation = problem->validation};
}
