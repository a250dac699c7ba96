/* Machines: starts of windows as unknowns of the fit. */
#include <math.h>

#include "machine/chain.h"

uint32_t lg_machine_start_numbers(const lg_machine *machine) {
    return machine->places + 3 * machine->directions + 3 * machine->rotations + machine->velocities;
}

uint32_t lg_machine_own(const lg_machine_problem *problem) {
    return lg_machine_starts_estimated(problem) ? lg_machine_start_numbers(problem->machine) : 0;
}

void lg_machine_start_units(const lg_machine_problem *problem, double *scale) {
    const lg_machine *machine = problem->machine;
    const lg_row_axes all = lg_row_axes_of(machine);
    const double unit = sqrt((double)problem->windows), T = machine->scales.time;
    for (uint32_t i = 0; i < all.seen; i++) {
        const lg_row_axis *a = &all.each[i];
        const double shown = unit * problem->velocity_scale[a->coordinate];
        const double q = machine->accelerations ? T * T * shown
                                                : unit * problem->position_scale[a->coordinate],
                     v = machine->accelerations ? T * shown : shown;
        scale[i] = i < machine->places ? q / machine->scales.place[i]
                   : a->first < machine->positions
                       ? q
                       : v * T / machine->scales.velocity[a->first - machine->positions];
    }
}

/* Turns each of `count` copies of R or q by its rotation vector: exp(a) . part. The vectors begin at column
 * `first` of a. */
static lg_var turn(lg_tape *tape, lg_var a, uint32_t first, uint32_t count, lg_var part) {
    lg_space space;
    const uint32_t rows = lg_rows_of(tape, a), width = lg_var_shape(tape, part).dims[2];
    const lg_var u = lg_reshape(tape, lg_slice(tape, a, 1, first, 3 * count), lg_shape3(rows, count, 3));
    const lg_space_factor factor = {width == 9 ? LG_SPACE_SO3 : LG_SPACE_SO3_DUAL, count};
    lg_var out = part;
    if (lg_space_init(&space, &factor, 1) != LG_OK) return LG_NONE;
    (void)lg_taped_act(tape, &space, &u, &part, &out);
    return out;
}

lg_status lg_machine_move_starts(lg_tape *tape, const lg_machine_problem *problem,
                                 const lg_machine_vars *vars, lg_var numbers, lg_var positions,
                                 lg_var velocities, lg_var *parts) {
    const lg_machine *machine = problem->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    double scale[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES];
    lg_machine_start_units(problem, scale);
    const lg_var a =
        lg_mul(tape, numbers, lg_input_f64(tape, lg_shape2(1, lg_machine_start_numbers(machine)), scale));
    const uint32_t directions = machine->places, rotations = directions + 3 * machine->directions,
                   first = lg_machine_start_numbers(machine) - machine->velocities;
    const lg_var v = lg_add(tape, velocities, lg_slice(tape, a, 1, first, machine->velocities));
    LG_TRY(lg_machine_record_state(tape, vars, positions, v, parts));
    if (at.x >= 0) parts[at.x] = lg_add(tape, parts[at.x], lg_machine_columns(tape, a, 0, machine->places));
    if (at.q >= 0) parts[at.q] = turn(tape, a, directions, machine->directions, parts[at.q]);
    if (at.R >= 0) parts[at.R] = turn(tape, a, rotations, machine->rotations, parts[at.R]);
    /* Momenta must be computed again at the new positions, because the mass may depend on them. */
    return lg_machine_record_state(tape, vars, lg_machine_record_positions(tape, vars, parts), v, parts);
}
