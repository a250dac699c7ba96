/* Machines: kinds of potential energy, and polynomials. All except the network are linear in their
 * parameters. */
#include "liegrad/ops.h"
#include "machine/internal.h"

/* ---- monomials of features ---- */

static bool list(const lg_machine *machine, const lg_machine_term *term, lg_monomials *out) {
    const uint32_t most = term->kind->most > 0 ? term->kind->most : term->degree;
    return lg_machine_monomials(lg_machine_feature_numbers(machine, term), term->kind->least, most, out);
}

/* How many numbers a polynomial has: one, or a residual force. */
static uint32_t outputs(const lg_machine *machine, const lg_machine_term *term) {
    return term->part == LG_MACHINE_POTENTIAL ? 1 : machine->velocities;
}

size_t lg_machine_polynomial_parameters(const lg_machine *machine, const lg_machine_term *term) {
    lg_monomials monomials;
    return list(machine, term, &monomials) ? (size_t)monomials.count * outputs(machine, term) : SIZE_MAX;
}

/* Given coefficients in scaled units, (1, count): the coefficient in the log's units times the scales of its
 * factors, divided by E. */
static lg_var given_coefficients(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                                 const lg_monomials *monomials) {
    const lg_machine *machine = vars->machine;
    double scales[LG_MACHINE_FEATURE_NUMBERS], unit[LG_MACHINE_MONOMIALS];
    uint32_t index[LG_MACHINE_MONOMIALS];
    (void)lg_machine_feature_scales(machine, &machine->terms[term], scales);
    for (uint32_t i = 0; i < monomials->count; i++) {
        index[i] = i;
        unit[i] = 1.0 / machine->scales.energy;
        for (const uint32_t *f = monomials->factor[i]; *f != UINT32_MAX; f++) unit[i] *= scales[*f];
    }
    return lg_machine_record_entries(tape, vars, term, monomials->count, index, unit);
}

lg_var lg_machine_record_polynomial(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                                    const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    const lg_machine_term *own = &machine->terms[term];
    lg_monomials monomials;
    (void)list(machine, own, &monomials);
    const lg_var x = lg_machine_record_features(tape, machine, own, seen);
    const lg_var all = lg_machine_record_monomials(tape, &monomials, x);
    const lg_var c =
        own->value_count > 0 ? given_coefficients(tape, vars, term, &monomials) : vars->theta[term];
    return lg_matmul(tape, all, lg_reshape(tape, c, lg_shape2(monomials.count, outputs(machine, own))));
}

/* ---- network ---- */

static uint32_t one(const lg_machine *machine) {
    return 1;
}

/* ---- the table ---- */

#define MONOMIALS                                                                                            \
    .part = LG_MACHINE_POTENTIAL, .parameters = lg_machine_polynomial_parameters,                            \
    .record = lg_machine_record_polynomial, .each = LG_PARAMETER_ITSELF, .entry = lg_machine_potential_entry
#define FORM (LG_TERM_OF | LG_TERM_VALUES)
const lg_term_kind lg_machine_potential_kinds[] = {
    {.name = "linear", .options = FORM, .least = 1, .most = 1, MONOMIALS},
    {.name = "gravity", .options = FORM, .heights = true, .least = 1, .most = 1, MONOMIALS},
    {.name = "quadratic", .options = FORM, .least = 2, .most = 2, MONOMIALS},
    {.name = "polynomial", .options = FORM | LG_TERM_DEGREE, .least = 1, MONOMIALS},
    {.name = "network",
     .part = LG_MACHINE_POTENTIAL,
     .options = LG_TERM_OF | LG_TERM_HIDDEN,
     .outputs = one,
     .record = lg_machine_record_network},
    {.name = NULL}};
