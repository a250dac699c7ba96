/* Machines: kinds of potential energy, and polynomials. All except the network are linear in their
 * parameters. */
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
static lg_var given_coefficients(const lg_term_at *at, const lg_monomials *monomials) {
    double scales[LG_MACHINE_FEATURE_NUMBERS], unit[LG_MACHINE_MONOMIALS];
    (void)lg_machine_feature_scales(at->machine, at->term, scales);
    for (uint32_t i = 0; i < monomials->count; i++) {
        unit[i] = 1.0 / at->machine->scales.energy;
        for (const uint32_t *f = monomials->factor[i]; *f != UINT32_MAX; f++) unit[i] *= scales[*f];
    }
    return lg_machine_record_entries(at, monomials->count, NULL, unit);
}

lg_var lg_machine_record_polynomial(const lg_term_at *at) {
    lg_monomials monomials;
    (void)list(at->machine, at->term, &monomials);
    const lg_shape shape = lg_shape2(monomials.count, outputs(at->machine, at->term));
    const lg_var all = lg_machine_record_monomials(at->tape, &monomials, lg_machine_record_features(at));
    const lg_var c = at->term->value_count > 0 ? given_coefficients(at, &monomials) : at->theta;
    return lg_matmul(at->tape, all, lg_reshape(at->tape, c, shape));
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
