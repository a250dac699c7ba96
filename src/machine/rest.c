/* Machines: how fast friction stops a motion near rest. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

/* The least width of the machine's friction at velocity k, in the units of the log. */
static double least_width(const lg_machine *machine, uint32_t k) {
    const lg_machine_term none = {.width = 0.0};
    double least = lg_machine_width(machine, &none, k);
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        if (lg_term_has(term, LG_TERM_WIDTH)) least = fmin(least, lg_machine_width(machine, term, k));
    return least;
}

/* Rows of the tape: for each row of the log one per velocity, in which this velocity alone is not 0. */
typedef struct probe {
    uint32_t count; /* rows of the log times velocities */
    double *q, *v, *u, *after;
} probe;

static void fill(const lg_machine *machine, const lg_machine_log *log, const size_t *rows, size_t count,
                 const probe *p) {
    static const double part = 1e-2;
    const size_t n = machine->velocities, m = machine->input_count;
    memset(p->v, 0, p->count * n * sizeof *p->v);
    for (size_t r = 0; r < count; r++)
        for (size_t k = 0; k < n; k++) {
            const size_t at = r * n + k;
            lg_machine_scaled_rows(machine, log, &rows[r], 1, p->q + at * machine->positions, NULL);
            p->v[at * n + k] =
                part * least_width(machine, (uint32_t)k) * machine->scales.time / machine->scales.velocity[k];
            for (size_t j = 0; j < m; j++)
                p->u[at * m + j] = log->u[rows[r] * 4 * m + j] / machine->scales.input[j];
        }
}

/* Reads the velocities after an impulse over the unit of time: what the damping's force gains from v to 2 v,
 * so that friction without a width, which is no matter of the step's length, does not count. `bent`: from
 * bristles that the velocity bent for this time, else from straight ones. */
static lg_status push(lg_tape *tape, const lg_machine *machine, const double *theta, bool bent,
                      const probe *p) {
    const uint32_t n = machine->velocities, m = machine->input_count;
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS], u = LG_NONE;
    LG_TRY(lg_machine_bind(tape, machine, lg_machine_parameter(tape, machine, theta), &vars));
    vars.bias = LG_NONE;
    const lg_var q = lg_input_f64(tape, lg_shape2(p->count, machine->positions), p->q),
                 v = lg_input_f64(tape, lg_shape2(p->count, n), p->v);
    if (m > 0) u = lg_input_f64(tape, lg_shape2(p->count, m), p->u);
    LG_TRY(lg_machine_record_state(tape, &vars, q, v, parts));
    const int z = lg_machine_parts(machine).z;
    lg_var f[2];
    for (int i = 0; i < 2; i++) {
        const lg_var faster = lg_scale(tape, v, i + 1.0);
        if (z >= 0) parts[z] = lg_scale(tape, faster, bent ? 1.0 : 0.0);
        f[i] = lg_machine_record_force(tape, &vars, LG_MACHINE_DAMPING, parts, faster, u);
    }
    lg_machine_push(tape, machine, lg_sub(tape, f[1], f[0]), parts);
    return lg_read(tape, lg_machine_record_rates(tape, &vars, parts), (size_t)p->count * n, p->after);
}

lg_status lg_machine_rest_rate(const lg_context *context, const lg_machine *machine, const double *theta,
                               const lg_machine_log *log, double *rate, lg_error *error) {
    enum { ROWS = 32 };
    size_t rows[ROWS], count = 0;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_NEEDS(error, machine, log, rate);
    *rate = 0.0;
    for (size_t i = 0; i < ROWS && log->rows > 0; i++) {
        const size_t row = i * log->rows / ROWS;
        if (lg_machine_log_complete(machine, log, row, true)) rows[count++] = row;
    }
    if (count == 0 || !lg_machine_has_part(machine, LG_MACHINE_DAMPING)) return LG_OK;
    const size_t n = machine->velocities, all = count * n;
    LG_TRY_SCRATCH(double, memory, context, all *(machine->positions + 2 * n + machine->input_count),
                   lg_no_memory(error));
    probe p = {.count = (uint32_t)all, .v = memory, .after = memory + all * n, .q = memory + 2 * all * n};
    p.u = p.q + all * machine->positions;
    fill(machine, log, rows, count, &p);
    lg_status status = lg_tape_create(context, NULL, &tape);
    for (int bent = 0; status == LG_OK && bent <= (machine->bristles > 0); bent++) {
        status = push(tape, machine, theta, bent, &p);
        for (size_t i = 0; status == LG_OK && i < all; i++) {
            const double v = p.v[i * n + i % n], slowed = 1.0 - p.after[i * n + i % n] / v;
            const double found = bent ? sqrt(fmax(slowed, 0.0)) : slowed; /* bristles are a spring */
            if (isfinite(found)) *rate = fmax(*rate, found / machine->scales.time);
        }
        lg_tape_reset(tape);
    }
    return lg_tape_conclude(tape, status, error);
}
