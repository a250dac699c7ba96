/* Machines: the axes along which a row of a log may change. */
#include "machine/chain.h"

static void add_axes(lg_row_axes *all, int kind, const lg_machine_offsets *at, uint32_t first,
                     uint32_t count) {
    for (uint32_t k = 0; k < count; k++)
        all->each[all->count++] = (lg_row_axis){.kind = kind,
                                                .first = first + (kind == LG_ALONG ? k : 0),
                                                .turn = kind == LG_ALONG ? 0 : k,
                                                .coordinate = at->index,
                                                .turns = kind != LG_ALONG || k >= at->places};
}

lg_row_axes lg_row_axes_of(const lg_machine *machine) {
    const lg_machine_offsets none = {0};
    lg_row_axes all = {.numbers = machine->positions + machine->velocities + machine->bristles};
    for (int kind = LG_ALONG; kind <= LG_TURN_ROTATION; kind++)
        for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
            const uint32_t axes[] = {at.places, 3 * at.directions, 3 * at.rotations};
            add_axes(&all, kind, &at, at.position + (kind == LG_TURN_ROTATION ? at.places : 0), axes[kind]);
        }
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        add_axes(&all, LG_ALONG, &at, machine->positions + at.velocity, at.velocities);
    all.seen = all.count;
    add_axes(&all, LG_ALONG, &none, machine->positions + machine->velocities, machine->bristles);
    return all;
}

uint32_t lg_row_axis_width(const lg_row_axis *a) {
    return a->kind == LG_ALONG ? 1 : a->kind == LG_TURN_DIRECTION ? 3 : 9;
}

void lg_row_axis_change(const lg_row_axis *a, const double *z, double *out) {
    const uint32_t k = a->turn, l = (k + 1) % 3, m = (k + 2) % 3;
    if (a->kind == LG_ALONG) {
        out[0] = 1.0;
        return;
    }
    const double sign = a->kind == LG_TURN_DIRECTION ? 1.0 : -1.0;
    for (uint32_t i = 0; i < lg_row_axis_width(a); i += 3) {
        const double *v = z + a->first + i;
        out[i + k] = 0.0;
        out[i + l] = -sign * v[m];
        out[i + m] = sign * v[l];
    }
}

double lg_row_axis_square(const lg_row_axis *a) {
    return a->kind == LG_TURN_ROTATION ? 2.0 : 1.0;
}

double lg_row_axis_component(const lg_row_axis *a, const double *z, const double *x) {
    double along[9], sum = 0.0;
    lg_row_axis_change(a, z, along);
    for (uint32_t i = 0; i < lg_row_axis_width(a); i++) sum += along[i] * x[a->first + i];
    return sum;
}
