/* Machines: the bristles of LuGre friction at rows of logs. Logs do not have z, but z forgets: it is
 * computed from the measured velocities of the rows before, from steady sliding on, with the velocity of
 * each interval the mean of its ends (liegrad/machine.h has the step). The result goes on the tape as a
 * Taylor polynomial of degree 1 in c, cs - c, vs and s0 about their values, so that the value and first
 * derivatives are exact. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

enum { HISTORY = 200, NUMBERS = 4, C = 0, MORE, SPEED, SPRING };

/* z of one velocity, and its derivatives by the numbers b. */
typedef struct bristle {
    double z, d[NUMBERS];
} bristle;

/* g and its derivatives by the numbers. */
static double sliding(const double *b, double v, double *dg) {
    const double r = v / b[SPEED], e = exp(-r * r);
    dg[C] = 1.0;
    dg[MORE] = e;
    dg[SPEED] = 2.0 * b[MORE] * e * r * r / b[SPEED];
    dg[SPRING] = 0.0;
    return b[C] + b[MORE] * e;
}

static bristle steady(const double *b, double v, double width) {
    double dg[NUMBERS];
    const double g = sliding(b, v, dg), S = tanh(v / width);
    bristle out = {.z = S * g / b[SPRING]};
    for (int i = 0; i < NUMBERS; i++) out.d[i] = S * dg[i] / b[SPRING];
    out.d[SPRING] -= out.z / b[SPRING];
    return out;
}

/* Moves a bristle for the time h: z+ = z e^-x + v h (1 - e^-x)/x, x = s0 |v| h/g. */
static void move(const double *b, double v, double h, bristle *now) {
    static const double small = 1e-5;
    double dg[NUMBERS];
    const double g = sliding(b, v, dg), x = b[SPRING] * fabs(v) * h / g, E = exp(-x);
    const double share = x < small ? 1.0 - x / 2.0 : -expm1(-x) / x,
                 slope = x < small ? -0.5 + x / 3.0 : (E - share) / x;
    const double by_x = v * h * slope - now->z * E;
    for (int i = 0; i < NUMBERS; i++) {
        const double dx = i == SPRING ? x / b[SPRING] : -x * dg[i] / g;
        now->d[i] = E * now->d[i] + by_x * dx;
    }
    now->z = E * now->z + v * h * share;
}

/* All bristles at one row; b (velocities, NUMBERS). */
static void follow(const lg_machine *machine, const lg_machine_log *log, size_t row, const double *b,
                   bristle *out) {
    const lg_machine_term none = {.width = 0.0};
    const size_t part = log->first[lg_machine_log_part(log, row)];
    double q[LG_MACHINE_POSITIONS], v[2][LG_MACHINE_VELOCITIES];
    size_t at = row - part > HISTORY ? row - HISTORY : part;
    lg_machine_scaled_rows(machine, log, &at, 1, q, v[0]);
    for (uint32_t k = 0; k < machine->velocities; k++) {
        const double speed = machine->scales.velocity[k] / machine->scales.time;
        out[k] = steady(b + (size_t)NUMBERS * k, v[0][k], lg_machine_width(machine, &none, k) / speed);
    }
    for (; at < row; at++) {
        const double h = (log->t[at + 1] - log->t[at]) / machine->scales.time;
        const size_t next = at + 1;
        lg_machine_scaled_rows(machine, log, &next, 1, q, v[1]);
        for (uint32_t k = 0; k < machine->velocities; k++)
            move(b + (size_t)NUMBERS * k, (v[0][k] + v[1][k]) / 2.0, h, &out[k]);
        memcpy(v[0], v[1], sizeof v[0]);
    }
}

lg_status lg_machine_start_bristles(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_log *log,
                                    const size_t *at, size_t count, lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const uint32_t n = machine->bristles;
    double all[NUMBERS][LG_MACHINE_VELOCITIES], b[LG_MACHINE_VELOCITIES * NUMBERS];
    bristle found[LG_MACHINE_VELOCITIES];
    lg_var z[NUMBERS + 1];
    void *memory[NUMBERS + 1];
    if (n == 0) return lg_tape_status(tape);
    for (int i = 0; i < NUMBERS; i++) {
        LG_TRY(lg_read(tape, vars->bristles[i], n, all[i]));
        for (uint32_t k = 0; k < n; k++) b[k * NUMBERS + i] = all[i][k];
    }
    for (int i = 0; i <= NUMBERS; i++) {
        z[i] = lg_input_buffer(tape, lg_shape2((uint32_t)count, n), &memory[i]);
        if (lg_is_none(z[i])) return lg_tape_status(tape);
        lg_tape_mark_rows(tape, z[i]);
    }
    for (size_t s = 0; s < count; s++) {
        follow(machine, log, at[s], b, found);
        for (uint32_t k = 0; k < n; k++) {
            for (int i = 0; i < NUMBERS; i++) ((double *)memory[i])[s * n + k] = found[k].d[i];
            ((double *)memory[NUMBERS])[s * n + k] = found[k].z;
        }
    }
    lg_var sum = z[NUMBERS];
    for (int i = 0; i < NUMBERS; i++) {
        const lg_var change = lg_sub(tape, vars->bristles[i], lg_input_f64(tape, lg_shape2(1, n), all[i]));
        sum = lg_add(tape, sum, lg_mul(tape, z[i], change));
    }
    parts[lg_machine_parts(machine).z] = sum;
    return lg_tape_status(tape);
}
