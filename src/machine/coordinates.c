/* Machines: the kinds of coordinates, and the offsets of each coordinate's numbers in states and logs. */
#include <string.h>

#include "machine/internal.h"

static const lg_coordinate_row coordinate_rows[LG_COORDINATE_KIND_COUNT] = {
    [LG_COORDINATE_LINE] = {"line", 1, 0, 0, 1},
    [LG_COORDINATE_ANGLE] = {"angle", 1, 0, 0, 1},
    [LG_COORDINATE_DIRECTION] = {"direction", 0, 1, 0, 3},
    [LG_COORDINATE_ROTATION] = {"rotation", 0, 0, 1, 3},
    [LG_COORDINATE_POSE] = {"pose", 3, 0, 1, 6},
};

const lg_coordinate_row *lg_coordinate_row_of(lg_coordinate_kind kind) {
    return (uint32_t)kind < LG_COORDINATE_KIND_COUNT ? &coordinate_rows[kind] : NULL;
}

uint32_t lg_coordinate_positions(lg_coordinate_kind kind) {
    const lg_coordinate_row *row = &coordinate_rows[kind];
    return row->places + 3 * row->directions + 9 * row->rotations;
}

bool lg_machine_next(const lg_machine *machine, lg_machine_offsets *at) {
    static const lg_coordinate_row none = {0};
    const bool more = at->next < machine->coordinate_count;
    const lg_coordinate_kind kind = more ? machine->coordinates[at->next].kind : LG_COORDINATE_LINE;
    const lg_coordinate_row *row = more ? &coordinate_rows[kind] : &none;
    *at = (lg_machine_offsets){.place = at->place + at->places,
                               .direction = at->direction + at->directions,
                               .rotation = at->rotation + at->rotations,
                               .momentum = at->momentum + (at->directions > 0 ? 0 : at->velocities),
                               .position = at->position + at->positions,
                               .velocity = at->velocity + at->velocities,
                               .places = row->places,
                               .directions = row->directions,
                               .rotations = row->rotations,
                               .positions = more ? lg_coordinate_positions(kind) : 0,
                               .velocities = row->velocities,
                               .index = at->next,
                               .next = at->next + 1,
                               .angle = kind == LG_COORDINATE_ANGLE};
    return more;
}

bool lg_machine_next_term(const lg_machine *machine, lg_machine_part part, const lg_machine_term **term) {
    const lg_machine_term *at = *term == NULL ? machine->terms : *term + 1;
    while (at < machine->terms + machine->term_count && part != LG_MACHINE_PART_COUNT && at->part != part)
        at++;
    *term = at;
    return at < machine->terms + machine->term_count;
}

lg_machine_offsets lg_machine_offsets_of(const lg_machine *machine, uint32_t coordinate) {
    lg_machine_offsets at = {0};
    for (uint32_t i = 0; i <= coordinate; i++) (void)lg_machine_next(machine, &at);
    return at;
}

lg_machine_places lg_machine_parts(const lg_machine *machine) {
    int next = 0;
    lg_machine_places at = {-1, -1, -1, -1, -1, -1};
    if (machine->places > 0) at.x = next++;
    if (machine->directions > 0) at.q = next++, at.p = next++;
    if (machine->rotations > 0) at.R = next++;
    if (machine->momenta > 0) at.m = next++;
    if (machine->bristles > 0) at.z = next++;
    return at;
}

static lg_status space_of(const lg_machine *machine, bool full, lg_space *space) {
    lg_space_factor factors[6];
    size_t count = 0;
    if (machine->places > 0) factors[count++] = (lg_space_factor){LG_SPACE_RN, machine->places};
    if (machine->directions > 0) factors[count++] = (lg_space_factor){LG_SPACE_TS2, machine->directions};
    if (machine->rotations > 0) factors[count++] = (lg_space_factor){LG_SPACE_SO3, machine->rotations};
    if (machine->momenta > 0) factors[count++] = (lg_space_factor){LG_SPACE_RN, machine->momenta};
    if (machine->bristles > 0) factors[count++] = (lg_space_factor){LG_SPACE_RN, machine->bristles};
    if (full && machine->lags > 0) factors[count++] = (lg_space_factor){LG_SPACE_RN, machine->lags};
    return lg_space_init(space, factors, count);
}

lg_status lg_machine_space(const lg_machine *machine, lg_space *space) {
    LG_NEEDS(NULL, machine, space);
    return space_of(machine, false, space);
}

lg_status lg_machine_full_space(const lg_machine *machine, lg_space *space) {
    LG_NEEDS(NULL, machine, space);
    return space_of(machine, true, space);
}

void lg_machine_reference(const lg_machine *machine, double *positions) {
    memset(positions, 0, machine->positions * sizeof *positions);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        if (at.directions > 0) positions[at.position + 2] = 1.0;
        for (uint32_t k = 0; k < 3 * at.rotations; k++) positions[at.position + at.places + 4 * k] = 1.0;
    }
}

bool lg_machine_tied(const lg_machine *machine) {
    const lg_energy_row *system = machine->grey.system;
    return system != NULL && system->count > 0 && machine->directions > 0 &&
           (machine->velocities > 3 || system->moving);
}

uint32_t lg_machine_mass_velocities(const lg_machine *machine, lg_mass_rows rows, uint32_t *list) {
    uint32_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        if (rows != LG_MASS_ALL && (at.directions > 0) != (rows == LG_MASS_DIRECTIONS)) continue;
        const uint32_t each = rows == LG_MASS_DIRECTIONS ? 1 : at.velocities;
        for (uint32_t k = 0; k < each; k++) list[count++] = at.velocity + k;
    }
    return count;
}

double lg_machine_unit_mass(const lg_machine *machine, uint32_t i, uint32_t j) {
    const lg_machine_scales *s = &machine->scales;
    return s->velocity[i] * s->velocity[j] / (s->energy * s->time * s->time);
}

double lg_machine_width(const lg_machine *machine, const lg_machine_term *term, uint32_t velocity) {
    static const double part = 1e-3;
    return term->width > 0.0 ? term->width : part * machine->scales.fastest[velocity];
}
