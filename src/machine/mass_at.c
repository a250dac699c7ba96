/* Machines: lists all parameters as numbers with names; finds the position at which a network mass is
 * reported. */
#include <math.h>
#include <string.h>

#include "machine/internal.h"

/* Most numbers to compare: sine and cosine of angles, all other positions unchanged. */
enum { MOST = LG_MACHINE_POSITIONS + LG_MACHINE_COORDINATES };

/* Writes the positions of the coordinates on which the mass depends, angles as sine and cosine; returns how
 * many numbers these are. */
static uint32_t embed(const lg_machine *machine, const double *positions, double *out) {
    uint32_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const double *q = positions + at.position;
        if (!lg_machine_sees(machine, LG_MACHINE_MASS, at.index)) continue;
        if (at.angle) {
            out[count++] = sin(*q);
            out[count++] = cos(*q);
        }
        for (uint32_t k = 0; k < at.positions && !at.angle; k++) out[count++] = q[k];
    }
    return count;
}

static const double *start_of(const lg_machine_problem *problem, size_t i) {
    return problem->log.q + problem->start[i] * problem->machine->positions;
}

/* Mean and variance, over the first `windows` windows, of embed's numbers at their first rows. */
static void measure(const lg_machine_problem *problem, size_t windows, double *mean, double *variance) {
    double x[MOST] = {0.0};
    memset(mean, 0, MOST * sizeof *mean);
    memset(variance, 0, MOST * sizeof *variance);
    for (size_t i = 0; i < windows; i++) {
        const uint32_t count = embed(problem->machine, start_of(problem, i), x);
        for (uint32_t k = 0; k < count; k++) {
            const double before = x[k] - mean[k];
            mean[k] += before / (double)(i + 1);
            variance[k] += before * (x[k] - mean[k]);
        }
    }
    for (uint32_t k = 0; k < MOST; k++) variance[k] /= (double)windows;
}

/* Sets `at` to the window whose start is nearest to `to`, in standard deviations, and returns the distance. A
 * number with variance 0 adds nothing if it equals its number in `to`; otherwise it makes the distance
 * infinite. */
static double nearest(const lg_machine_problem *problem, size_t windows, const double *to,
                      const double *variance, size_t *at) {
    double x[MOST] = {0.0}, least = INFINITY;
    for (size_t i = 0; i < windows; i++) {
        const uint32_t count = embed(problem->machine, start_of(problem, i), x);
        double square = 0.0;
        for (uint32_t k = 0; k < count; k++)
            if (x[k] != to[k]) square += (x[k] - to[k]) * (x[k] - to[k]) / variance[k];
        if (square < least || i == 0) least = square, *at = i;
    }
    return sqrt(least);
}

/* Whether a mass of the machine is a network. */
static bool is_learned(const lg_machine *machine) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_MASS, &term);)
        if (term->kind->outputs != NULL) return true;
    return false;
}

bool lg_machine_mass_at(const lg_machine_problem *problem, double *positions) {
    static const double near = 0.1;
    const lg_machine *machine = problem->machine;
    const size_t windows = problem->windows - problem->validation;
    double mean[MOST], variance[MOST], reference[MOST] = {0.0};
    size_t at = 0;
    lg_machine_reference(machine, positions);
    if (!is_learned(machine)) return false;
    if (windows == 0) return true;
    measure(problem, windows, mean, variance);
    (void)embed(machine, positions, reference);
    if (nearest(problem, windows, reference, variance, &at) <= near) return true;
    (void)nearest(problem, windows, mean, variance, &at);
    memcpy(positions, start_of(problem, at), machine->positions * sizeof *positions);
    return true;
}

/* ---- numbers with names ---- */

/* The sum of all terms of the mass, at rest at `positions`. */
static void put_moving_mass(lg_number_list *l, const lg_machine *machine, const double *positions) {
    lg_var parts[LG_TAPED_MAX_PARTS], M = LG_NONE;
    if (l->status == LG_OK) l->status = lg_machine_record_rest(l->tape, &l->vars, positions, parts);
    if (l->status == LG_OK) M = lg_machine_record_mass(l->tape, &l->vars, parts);
    lg_numbers_put_mass(l, machine, M, lg_machine_tied(machine) ? LG_MASS_ALL : LG_MASS_MOMENTA, false);
}

/* If a mass is a network, the entries of M at `positions` replace the numbers of all mass terms, except the
 * numbers of a system (lg_grey_mass_kind). */
size_t lg_machine_numbers_at(const lg_machine *machine, const double *theta, const double *positions,
                             size_t room, lg_identified *out, lg_status *status) {
    lg_number_list l = {.room = room, .out = out, .vars = {.machine = machine}};
    const bool network = is_learned(machine);
    l.status = lg_tape_create(NULL, NULL, &l.tape);
    if (l.status == LG_OK)
        l.status = lg_machine_bind(l.tape, machine, lg_machine_parameter(l.tape, machine, theta), &l.vars);
    if (network && theta != NULL) put_moving_mass(&l, machine, positions);
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (network && term->part == LG_MACHINE_MASS && term->kind != &lg_grey_mass_kind) continue;
        if (term->entry_count > 0) lg_numbers_entries(&l, machine, term, theta + term->offset);
        lg_term_numbers *own = term->kind->each != LG_PARAMETER_OTHER ? lg_numbers_each : term->kind->numbers;
        if (term->value_count == 0 && own != NULL) own(&l, machine, term, theta + term->offset);
    }
    lg_tape_destroy(l.tape);
    if (status != NULL && l.status != LG_OK) *status = l.status;
    return l.count;
}

size_t lg_machine_numbers(const lg_machine *machine, const double *theta, size_t room, lg_identified *out) {
    return lg_machine_numbers_at(machine, theta, NULL, room, out, NULL);
}
