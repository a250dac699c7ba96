/* Machines: constant biases of sensors. Biases are added to the positions of lines, angles and poses and to
 * the velocities of all coordinates in logs. States and their equations contain no biases. */
#include <math.h>

#include "machine/internal.h"

/* Writes to `out` the columns of a log row (positions, then velocities) to which the term adds its
 * parameters. Returns their number. */
static uint32_t columns_of(const lg_machine *machine, const lg_machine_term *term, uint32_t *out) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < term->of_count; i++) {
        const lg_machine_feature of = term->of[i];
        const lg_machine_offsets at = lg_machine_offsets_of(machine, of.index);
        const bool velocity = of.kind == LG_FEATURE_VELOCITY;
        const uint32_t first = velocity ? machine->positions + at.velocity : at.position;
        for (uint32_t k = 0; k < (velocity ? at.velocities : at.places); k++) out[count++] = first + k;
    }
    return count;
}

static size_t bias_parameters(const lg_machine *machine, const lg_machine_term *term) {
    uint32_t columns[LG_MACHINE_FEATURES * 6];
    return columns_of(machine, term, columns);
}

void lg_machine_wrap_biases(const lg_machine *machine, double *theta) {
    static const double turn = 6.283185307179586;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_BIAS, &term);) {
        double *bias = theta + term->offset;
        for (uint32_t k = 0; k < term->of_count; k++) {
            const lg_machine_feature of = term->of[k];
            const lg_machine_offsets at = lg_machine_offsets_of(machine, of.index);
            if (of.kind != LG_FEATURE_VELOCITY && at.angle) *bias -= turn * ceil(*bias / turn - 0.5);
            bias += of.kind == LG_FEATURE_VELOCITY ? at.velocities : at.places;
        }
    }
}

/* The biases of all columns, (1, positions + velocities), in scaled units; 0 in columns without a bias. */
static lg_var record(const lg_term_at *at) {
    const uint32_t n = at->machine->positions + at->machine->velocities;
    uint32_t columns[LG_MACHINE_FEATURES * 6];
    const uint32_t count = columns_of(at->machine, at->term, columns);
    const lg_var place = lg_machine_record_selection(at->tape, columns, count, n);
    return lg_matmul(at->tape, lg_reshape(at->tape, at->theta, lg_shape2(1, count)), place);
}

const lg_term_kind lg_machine_bias_kinds[] = {{.name = "constant",
                                               .part = LG_MACHINE_BIAS,
                                               .options = LG_TERM_OF | LG_TERM_MOVING,
                                               .parameters = bias_parameters,
                                               .record = record,
                                               .numbers = lg_numbers_bias},
                                              {.name = NULL}};
