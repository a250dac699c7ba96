/* Machines: parameters as numbers with names, in the units of logs. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "machine/internal.h"

void lg_numbers_put(lg_number_list *l, double value, const char *format, ...) {
    va_list arguments;
    if (l->count < l->room) {
        lg_identified *each = &l->out[l->count];
        va_start(arguments, format);
        (void)lg_format_list(each->name, sizeof each->name, format, arguments);
        va_end(arguments);
        each->value = value;
        each->error = NAN;
    }
    l->count++;
}

void lg_numbers_read(lg_number_list *l, lg_var x, size_t count, double *out) {
    if (l->status == LG_OK) l->status = lg_read(l->tape, x, count, out);
    for (size_t i = 0; i < count && l->status != LG_OK; i++) out[i] = NAN;
}

void lg_machine_velocity_name(const lg_machine *machine, uint32_t k, char *text, size_t size) {
    lg_machine_offsets at = {0};
    while (lg_machine_next(machine, &at) && at.velocity + at.velocities <= k) continue;
    const char *name = machine->coordinates[at.index].name;
    if (at.velocities == 1)
        (void)snprintf(text, size, "%s", name);
    else
        (void)snprintf(text, size, "%s.%u", name, k - at.velocity + 1);
}

/* ---- biases ---- */

void lg_numbers_bias(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                     const double *theta) {
    const lg_machine_scales *s = &machine->scales;
    for (uint32_t i = 0; i < term->of_count; i++) {
        const lg_machine_feature of = term->of[i];
        const lg_machine_offsets at = lg_machine_offsets_of(machine, of.index);
        const char *name = machine->coordinates[of.index].name;
        const bool velocity = of.kind == LG_FEATURE_VELOCITY;
        const uint32_t count = velocity ? at.velocities : at.places;
        const char *of_what = !velocity ? "" : machine->accelerations ? ".acceleration" : ".velocity";
        for (uint32_t k = 0; k < count; k++) {
            const double unit =
                velocity ? lg_machine_shown_unit(machine, at.velocity + k) : s->place[at.place + k];
            if (count == 1)
                lg_numbers_put(l, *theta++ * unit, "bias.%s%s", name, of_what);
            else
                lg_numbers_put(l, *theta++ * unit, "bias.%s%s.%u", name, of_what, k + 1);
        }
    }
}

/* ---- mass ---- */

void lg_numbers_put_mass(lg_number_list *l, const lg_machine *machine, lg_var M, lg_mass_rows rows,
                         bool diagonal) {
    const bool directions = rows == LG_MASS_DIRECTIONS;
    uint32_t at[LG_MACHINE_VELOCITIES];
    double m[LG_MACHINE_VALUES];
    const uint32_t n = lg_machine_mass_velocities(machine, rows, at), columns = directions ? 1 : n;
    lg_numbers_read(l, M, (size_t)n * columns, m);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = i; j < (diagonal ? i + 1 : n); j++)
            lg_numbers_put(
                l, m[directions ? i : i * n + j] * (1.0 / lg_machine_unit_mass(machine, at[i], at[j])),
                "mass.%u.%u", at[i] + 1, at[j] + 1);
}

/* The elements of a mass, of a diagonal one those on the diagonal, then the masses of the directions. */
void lg_numbers_mass(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                     const double *theta) {
    uint32_t at[LG_MACHINE_VELOCITIES];
    const bool good = l->status == LG_OK, diagonal = lg_term_has(term, LG_TERM_VALUES);
    for (int directions = 0; directions < 2; directions++) {
        const lg_machine_seen seen = {.rows = 1, .directions = directions};
        if (lg_machine_mass_velocities(machine, directions, at) == 0) continue;
        const lg_term_at of = lg_term_at_of(l->tape, &l->vars, term, &seen);
        const lg_var M = good ? term->kind->record(&of) : LG_NONE;
        lg_numbers_put_mass(l, machine, M, directions, diagonal || directions);
    }
}

/* ---- potentials ---- */

void lg_machine_feature_name(const lg_machine *machine, const lg_machine_term *term, uint32_t number,
                             char *text, size_t size) {
    static const char *const suffix[] = {
        [LG_FEATURE_POSITION] = "", [LG_FEATURE_PLACE] = ".place",   [LG_FEATURE_ROTATION] = ".rotation",
        [LG_FEATURE_UP] = ".up",    [LG_FEATURE_HEIGHT] = ".height", [LG_FEATURE_INPUT] = ""};
    uint32_t i = 0;
    for (; number >= lg_machine_feature_count(machine, term->of[i]); i++)
        number -= lg_machine_feature_count(machine, term->of[i]);
    const lg_machine_feature of = term->of[i];
    const bool input = of.kind == LG_FEATURE_INPUT, single = lg_machine_feature_count(machine, of) == 1;
    const char *name = input ? machine->inputs[of.index] : machine->coordinates[of.index].name;
    if (!input && machine->coordinates[of.index].kind == LG_COORDINATE_ANGLE)
        (void)snprintf(text, size, "%s(%s)", number == 0 ? "sin" : "cos", name);
    else if (single)
        (void)snprintf(text, size, "%s%s", name, suffix[of.kind]);
    else
        (void)snprintf(text, size, "%s%s.%u", name, suffix[of.kind], number + 1);
}

/* Name of a monomial: "x^2*y". */
static void monomial_name(const lg_machine *machine, const lg_machine_term *term, const uint32_t *factor,
                          char *text, size_t size) {
    text[0] = '\0';
    for (uint32_t i = 0; factor[i] != UINT32_MAX;) {
        char name[48];
        uint32_t power = 1;
        while (factor[i + power] == factor[i]) power++;
        lg_machine_feature_name(machine, term, factor[i], name, sizeof name);
        lg_append(text, size, power > 1 ? "%s%s^%u" : "%s%s", i > 0 ? "*" : "", name, power);
        i += power;
    }
}

/* 1 divided by the product of the factors' scales. The unit of a monomial's coefficient is this times E. */
static double coefficient_unit(const double *scales, const uint32_t *factor) {
    double unit = 1.0;
    for (; *factor != UINT32_MAX; factor++) unit /= scales[*factor];
    return unit;
}

void lg_machine_potential_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                                lg_entry_about *out) {
    double scales[LG_MACHINE_FEATURE_NUMBERS];
    char name[64];
    lg_monomials monomials;
    const uint32_t most = term->kind->most > 0 ? term->kind->most : term->degree;
    (void)lg_machine_monomials(lg_machine_feature_scales(machine, term, scales), term->kind->least, most,
                               &monomials);
    const uint32_t *factor = monomials.factor[index];
    monomial_name(machine, term, factor, name, sizeof name);
    *out =
        (lg_entry_about){.unit = machine->scales.energy * coefficient_unit(scales, factor), .single = true};
    (void)snprintf(out->name, sizeof out->name, "potential.%s", name);
}

/* ---- forces ---- */

double lg_machine_drag_unit(const lg_machine *machine, uint32_t i, uint32_t j, int power) {
    const lg_machine_scales *s = &machine->scales;
    const double speed = s->velocity[j] / s->time;
    double unit = s->energy / s->velocity[i];
    for (int k = 0; k < power; k++) unit /= speed;
    return unit;
}

void lg_numbers_each(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                     const double *theta) {
    lg_entry_about about;
    for (uint32_t i = 0; i < term->parameters; i++) {
        const bool squared = term->kind->each == LG_PARAMETER_SQUARED;
        term->kind->entry(machine, term, i, &about);
        lg_numbers_put(l, (squared ? theta[i] * theta[i] : theta[i]) * about.unit, "%s", about.name);
    }
}

/* The forces at unit velocities are the rows of -D. */
void lg_numbers_constant_damping(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                                 const double *theta) {
    double D[LG_MACHINE_VALUES];
    const uint32_t n = machine->velocities;
    lg_machine_seen seen = {.rows = n};
    lg_var f = LG_NONE;
    if (l->status == LG_OK) {
        seen.v = lg_reshape(l->tape, lg_unit_matrix(l->tape, n), lg_shape2(n, n));
        const lg_term_at of = lg_term_at_of(l->tape, &l->vars, term, &seen);
        f = term->kind->record(&of);
    }
    lg_numbers_read(l, f, (size_t)n * n, D);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = i; j < n; j++)
            lg_numbers_put(l, -D[i * n + j] * lg_machine_drag_unit(machine, i, j, 1), "damping.%u.%u", i + 1,
                           j + 1);
}
