/* Machines: where the numbers of a mass that is a network are told. */
#include <math.h>
#include <string.h>

#include "machine/internal.h"

/* What is compared: sine and cosine of angles, all other positions as they are. */
enum { MOST = LG_MACHINE_POSITIONS + LG_MACHINE_COORDINATES };

/* A mass sees coordinate i. */
static bool is_seen(const lg_machine *machine, uint32_t i) {
    bool seen = machine->grey.system != NULL && (machine->grey.system->seen & 1u << i) != 0;
    for (uint32_t t = 0; t < machine->term_count; t++)
        for (uint32_t k = 0; machine->terms[t].part == LG_MACHINE_MASS && k < machine->terms[t].of_count; k++)
            seen = seen || machine->terms[t].of[k].index == i;
    return seen;
}

/* The numbers of the coordinates that a mass sees; returns how many. */
static uint32_t embed(const lg_machine *machine, const double *positions, double *out) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const double *q = positions + lg_machine_offsets_of(machine, i).position;
        if (!is_seen(machine, i)) continue;
        if (kind == LG_COORDINATE_ANGLE) {
            out[count++] = sin(*q);
            out[count++] = cos(*q);
            continue;
        }
        memcpy(out + count, q, lg_coordinate_positions(kind) * sizeof *out);
        count += lg_coordinate_positions(kind);
    }
    return count;
}

static const double *start_of(const lg_machine_problem *problem, size_t i) {
    return problem->log.q + problem->start[i] * problem->machine->positions;
}

/* Mean and variance of the starts of `windows` windows. */
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

/* The start nearest to `to`, lengths in standard deviations; its distance. What never moves does not count
 * but by being elsewhere. */
static double nearest(const lg_machine_problem *problem, size_t windows, const double *to,
                      const double *variance, size_t *at) {
    double x[MOST] = {0.0}, least = (double)INFINITY;
    for (size_t i = 0; i < windows; i++) {
        const uint32_t count = embed(problem->machine, start_of(problem, i), x);
        double square = 0.0;
        for (uint32_t k = 0; k < count; k++)
            if (x[k] != to[k]) square += (x[k] - to[k]) * (x[k] - to[k]) / variance[k];
        if (square < least || i == 0) least = square, *at = i;
    }
    return sqrt(least);
}

bool lg_machine_mass_at(const lg_machine_problem *problem, double *positions) {
    static const double near = 0.1;
    const lg_machine *machine = problem->machine;
    const size_t windows = problem->windows - problem->validation;
    double mean[MOST], variance[MOST], reference[MOST] = {0.0};
    size_t at = 0;
    lg_machine_reference(machine, positions);
    if (!lg_machine_mass_learned(machine)) return false;
    if (windows == 0) return true;
    measure(problem, windows, mean, variance);
    (void)embed(machine, positions, reference);
    if (nearest(problem, windows, reference, variance, &at) <= near) return true;
    (void)nearest(problem, windows, mean, variance, &at);
    memcpy(positions, start_of(problem, at), machine->positions * sizeof *positions);
    return true;
}
