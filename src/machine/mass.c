/* Machines: kinds of mass. Masses are positive: exp of a parameter, or L L^T where the diagonal of L is exp
 * of parameters. */
#include <stdio.h>

#include "machine/internal.h"

/* ---- known ---- */

uint32_t lg_machine_mass_place(const lg_machine *machine, const lg_machine_term *term, uint32_t i,
                               uint32_t j) {
    const uint32_t n = machine->velocities;
    lg_machine_offsets at = {0};
    if (term->value_count == n * n) return i * n + j;
    if (i != j || term->value_count == n) return i == j ? i : UINT32_MAX;
    while (lg_machine_next(machine, &at) && at.velocity + at.velocities <= i) {
    }
    return at.momentum + at.direction + (at.directions > 0 ? 0 : i - at.velocity);
}

/* The three values of a direction in a full list or matrix must be equal, known and without couplings. */
static const char *direction_fault(const lg_machine *machine, const lg_machine_term *term) {
    const uint32_t n = machine->velocities;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at) && term->value_count >= n;)
        for (uint32_t k = 0; k < 3 * n && at.directions > 0; k++) {
            const uint32_t i = at.velocity + k / n, j = k % n, first = at.velocity;
            const uint32_t to = lg_machine_mass_place(machine, term, i, j),
                           from = lg_machine_mass_place(machine, term, j, i);
            const double given =
                i == j ? term->values[lg_machine_mass_place(machine, term, first, first)] : 0.0;
            if (to != UINT32_MAX && (term->values[to] != given || term->values[from] != given ||
                                     lg_machine_is_entry_of(term, to)))
                return "the mass of a direction is one number without couplings: give a list with one number "
                       "for each direction, or three equal known numbers";
        }
    return NULL;
}

static lg_var known(const lg_term_at *at) {
    const bool directions = at->seen->directions;
    uint32_t list[LG_MACHINE_VELOCITIES], index[LG_MACHINE_VALUES];
    double factor[LG_MACHINE_VALUES];
    const uint32_t n = lg_machine_mass_velocities(at->machine, directions, list),
                   columns = directions ? 1 : n;
    for (uint32_t k = 0; k < n * columns; k++) {
        const uint32_t i = list[k / columns], j = directions ? i : list[k % n];
        index[k] = lg_machine_mass_place(at->machine, at->term, i, j);
        factor[k] = lg_machine_unit_mass(at->machine, i, j);
    }
    return lg_reshape(at->tape, lg_machine_record_entries(at, n * columns, index, factor),
                      lg_shape3(1, n, columns));
}

static void known_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                        lg_entry_about *out) {
    const uint32_t n = machine->velocities;
    uint32_t k = 0;
    while (lg_machine_mass_place(machine, term, k / n, k % n) != index) k++;
    const uint32_t i = k / n, j = k % n;
    *out = (lg_entry_about){
        .unit = 1.0 / lg_machine_unit_mass(machine, i, j), .start = 1.0, .positive = true, .single = i == j};
    (void)snprintf(out->name, sizeof out->name, "mass.%u.%u", i + 1, j + 1);
}

static void diagonal_values(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]) {
    const uint32_t n = machine->velocities;
    fits[0] = fits[1] = term->value_count == n ? n : machine->momenta + machine->directions;
}

static void known_values(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]) {
    diagonal_values(machine, term, fits);
    fits[1] = (size_t)machine->velocities * machine->velocities;
}

/* ---- diagonal and constant ----
 *
 * Parameters of "diagonal": logs of the masses of the momenta, then of the directions. Parameters of
 * "constant": the packed triangle, then logs of the masses of the directions. In a normalised machine the
 * number scales.held, counted from 1, is fixed at 0 and is not a parameter. */

static uint32_t held(const lg_machine *machine) {
    return machine->normalised ? 1 : 0;
}

static size_t diagonal_parameters(const lg_machine *machine, const lg_machine_term *term) {
    return machine->momenta + machine->directions - held(machine);
}

static size_t constant_parameters(const lg_machine *machine, const lg_machine_term *term) {
    return lg_triangle(machine->momenta) + machine->directions - held(machine);
}

/* Numbers first .. first + count - 1 of the term, (1, count), with the 0 of a normalised machine. */
static lg_var numbers(const lg_term_at *at, uint32_t first, uint32_t count) {
    lg_tape *tape = at->tape;
    lg_var all = at->theta;
    if (held(at->machine) > 0) {
        const uint32_t before = (uint32_t)at->machine->scales.held - 1;
        const uint32_t more = (uint32_t)at->term->parameters - before;
        lg_var parts[3];
        size_t used = 0;
        if (before > 0) parts[used++] = lg_slice(tape, all, 0, 0, before);
        parts[used++] = lg_full(tape, lg_shape1(1), 0.0);
        if (more > 0) parts[used++] = lg_slice(tape, all, 0, before, more);
        all = used == 1 ? parts[0] : lg_concat(tape, parts, used, 0);
    }
    return lg_reshape(tape, lg_slice(tape, all, 0, first, count), lg_shape2(1, count));
}

/* L L^T of packed triangles. */
static lg_var square(const lg_term_at *at, lg_var packed) {
    const lg_var L = lg_machine_record_triangle(at->tape, packed, at->machine->momenta, true);
    return lg_matmul_nt(at->tape, L, L);
}

static lg_var direction_masses(const lg_term_at *at, uint32_t first) {
    const uint32_t n = at->machine->directions;
    return lg_reshape(at->tape, lg_exp(at->tape, numbers(at, first, n)), lg_shape3(1, n, 1));
}

static lg_var diagonal(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const uint32_t n = at->machine->momenta;
    if (at->term->value_count > 0) return known(at);
    if (at->seen->directions) return direction_masses(at, n);
    const lg_var m = lg_exp(tape, numbers(at, 0, n));
    return lg_mul(tape, lg_reshape(tape, m, lg_shape3(1, 1, n)), lg_unit_matrix(tape, n));
}

static lg_var constant(const lg_term_at *at) {
    const uint32_t n = at->machine->momenta;
    return at->seen->directions ? direction_masses(at, lg_triangle(n))
                                : square(at, numbers(at, 0, lg_triangle(n)));
}

/* ---- network ---- */

static uint32_t triangle_outputs(const lg_machine *machine) {
    return lg_triangle(machine->momenta);
}

static bool always(const lg_machine *machine) {
    return true;
}

static lg_var network(const lg_term_at *at) {
    return square(at, lg_machine_record_network(at));
}

/* ---- the table ---- */

const lg_term_kind lg_machine_mass_kinds[] = {{.name = "known",
                                               .part = LG_MACHINE_MASS,
                                               .options = LG_TERM_VALUES | LG_TERM_KNOWN,
                                               .values = known_values,
                                               .fault = direction_fault,
                                               .entry = known_entry,
                                               .record = known},
                                              {.name = "diagonal",
                                               .part = LG_MACHINE_MASS,
                                               .numbers = lg_numbers_mass,
                                               .options = LG_TERM_VALUES,
                                               .values = diagonal_values,
                                               .fault = direction_fault,
                                               .entry = known_entry,
                                               .parameters = diagonal_parameters,
                                               .record = diagonal},
                                              {.name = "constant",
                                               .part = LG_MACHINE_MASS,
                                               .numbers = lg_numbers_mass,
                                               .parameters = constant_parameters,
                                               .record = constant},
                                              {.name = "network",
                                               .part = LG_MACHINE_MASS,
                                               .options = LG_TERM_OF | LG_TERM_HIDDEN,
                                               .outputs = triangle_outputs,
                                               .record = network,
                                               .moving = always},
                                              {.name = NULL}};
