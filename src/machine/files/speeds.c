/* Logs that measure velocities alone: a drive's speed. Positions are their integrals from 0 at the start of
 * each part, and nothing may depend on them. */
#include <math.h>
#include <string.h>

#include "machine/files/log_table.h"
#include "machine/files/reading.h"
#include "machine/internal.h"

/* A potential that is linear in a line: a constant force, wherever the line is. */
static bool is_constant_force(const lg_machine *machine, const lg_machine_term *term, uint32_t coordinate) {
    const char *name = lg_term_kind_name(term->kind);
    const bool linear = strcmp(name, "linear") == 0 || strcmp(name, "gravity") == 0;
    return term->part == LG_MACHINE_POTENTIAL && linear &&
           machine->coordinates[coordinate].kind == LG_COORDINATE_LINE;
}

/* Index of the first term that depends on a position, or the number of terms if no term does. */
static uint32_t first_use(const lg_machine *machine, uint32_t *coordinate) {
    for (uint32_t t = 0; t < machine->term_count; t++)
        for (uint32_t k = 0; k < machine->terms[t].of_count; k++) {
            const lg_machine_term *term = &machine->terms[t];
            *coordinate = term->of[k].index;
            if (term->of[k].kind != LG_FEATURE_VELOCITY && term->of[k].kind != LG_FEATURE_INPUT &&
                !is_constant_force(machine, term, *coordinate))
                return t;
        }
    return machine->term_count;
}

lg_status lg_machine_refuse_positions(lg_machine_reading *r) {
    const lg_machine *machine = &r->out->machine;
    uint32_t coordinate;
    if (r->out->measured != LG_MEASURED_VELOCITIES_ONLY) return LG_OK;
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (machine->coordinates[i].kind > LG_COORDINATE_ANGLE)
            return lg_yaml_fail(r->yaml, 1, LG_FORMAT, r->error,
                                "%s: with `measured: velocities-only` a coordinate is a line or an angle",
                                machine->coordinates[i].name);
    const lg_grey_system *system = machine->grey.system;
    if (system != NULL && (system->seen != 0 || system->potential != NULL))
        return lg_yaml_fail(r->yaml, 1, LG_FORMAT, r->error,
                            "system: %s depends on positions, but the log has velocities alone: log the "
                            "positions too",
                            lg_grey_system_name(system));
    const uint32_t term = first_use(machine, &coordinate);
    if (term == machine->term_count) return LG_OK;
    return lg_yaml_fail(r->yaml, r->lines[term], LG_FORMAT, r->error,
                        "%s: depends on the position of %s, but the log has velocities alone: log the "
                        "position too, or leave this out",
                        lg_machine_part_name(machine->terms[term].part),
                        machine->coordinates[coordinate].name);
}

void lg_log_integrate(const lg_log_table *table, double *q, const double *v) {
    const size_t n = table->machine->machine.velocities;
    double held[LG_MACHINE_VELOCITIES], next[LG_MACHINE_VELOCITIES];
    if (table->machine->measured != LG_MEASURED_VELOCITIES_ONLY) return;
    for (size_t part = 0; part < table->parts; part++)
        for (size_t row = table->first[part], begin = row; row < table->first[part + 1]; row++)
            for (size_t k = 0; k < n; k++) {
                const double here = v[row * n + k];
                next[k] = !isnan(here) ? here : row > begin ? held[k] : 0.0;
                const double h = row > begin ? lg_log_time(table, row) - lg_log_time(table, row - 1) : 0.0;
                q[row * n + k] = row > begin ? q[(row - 1) * n + k] + 0.5 * h * (held[k] + next[k]) : 0.0;
                held[k] = next[k];
            }
}
