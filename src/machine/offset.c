/* Machines: constant forces. `of` lists coordinates; without it there is one force for each velocity. */
#include <stdio.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

uint32_t lg_machine_offset_velocities(const lg_machine *machine, const lg_machine_term *term, uint32_t *out) {
    uint32_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        bool listed = term->of_count == 0;
        for (uint32_t k = 0; k < term->of_count; k++) listed = listed || term->of[k].index == at.index;
        for (uint32_t k = 0; listed && k < at.velocities; k++) out[count++] = at.velocity + k;
    }
    return count;
}

static size_t count_forces(const lg_machine *machine, const lg_machine_term *term) {
    uint32_t list[LG_MACHINE_VELOCITIES];
    return lg_machine_offset_velocities(machine, term, list);
}

/* The forces, (B, velocities); 0 on velocities on which the term does not act. */
static lg_var record(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const lg_machine *machine = at->machine;
    uint32_t list[LG_MACHINE_VELOCITIES];
    double factor[LG_MACHINE_VELOCITIES];
    const uint32_t n = machine->velocities, count = lg_machine_offset_velocities(machine, at->term, list);
    for (uint32_t i = 0; i < count; i++)
        factor[i] = machine->scales.velocity[list[i]] / machine->scales.energy;
    const lg_var force = at->term->value_count > 0 ? lg_machine_record_entries(at, count, NULL, factor)
                                                   : lg_reshape(tape, at->theta, lg_shape2(1, count));
    const lg_var all = lg_matmul(tape, force, lg_machine_record_selection(tape, list, count, n));
    const lg_var zeros = lg_full(tape, lg_shape2(at->seen->rows, n), 0.0);
    lg_tape_mark_rows(tape, zeros);
    return lg_add(tape, zeros, all);
}

static void entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                  lg_entry_about *out) {
    uint32_t list[LG_MACHINE_VELOCITIES];
    char name[48];
    (void)lg_machine_offset_velocities(machine, term, list);
    *out = (lg_entry_about){.unit = machine->scales.energy / machine->scales.velocity[list[index]],
                            .single = true};
    lg_machine_velocity_name(machine, list[index], name, sizeof name);
    (void)snprintf(out->name, sizeof out->name, "offset.%s", name);
}

#define OFFSET                                                                                               \
    .part = LG_MACHINE_OFFSET, .parameters = count_forces, .record = record, .each = LG_PARAMETER_ITSELF,    \
    .entry = entry
const lg_term_kind lg_machine_offset_kinds[] = {
    {.name = "unknown", .options = LG_TERM_SOME, OFFSET},
    {.name = "known", .options = LG_TERM_SOME | LG_TERM_VALUES | LG_TERM_KNOWN, OFFSET},
    {.name = NULL}};
