/* Machines: finds the scales from logs. */
#include <math.h>

#include "machine/internal.h"

/* Root mean squares over the log, in its units. `force`: forces of a known input map. */
typedef struct moments {
    double velocity[LG_MACHINE_COORDINATES];    /* over all velocities of a coordinate */
    double acceleration[LG_MACHINE_VELOCITIES]; /* of each velocity */
    double fastest[LG_MACHINE_VELOCITIES];      /* largest speed */
    double input[LG_MACHINE_INPUTS], force[LG_MACHINE_VELOCITIES];
} moments;

void lg_squares_add(lg_squares *s, double x) {
    if (isnan(x)) return;
    s->sum += x * x;
    s->count++;
}

double lg_squares_root(const lg_squares *s) {
    return s->count > 0 ? sqrt(s->sum / (double)s->count) : NAN;
}

static double root(const lg_squares *s) {
    return fmax(lg_squares_root(s), 0.0);
}

/* Velocities that were not measured are differences of positions. `plain`: all its scales are 1. */
static void measure_motion(const lg_machine *plain, const lg_machine_log *log, moments *out) {
    lg_squares velocity[LG_MACHINE_COORDINATES] = {{0, 0}}, acceleration[LG_MACHINE_VELOCITIES] = {{0, 0}};
    double before[LG_MACHINE_VELOCITIES] = {0}, q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first; row + 1 < p.end; row++) {
            lg_machine_scaled_rows(plain, log, &row, 1, q, v);
            for (lg_machine_offsets at = {0}; lg_machine_next(plain, &at);) {
                for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
                    lg_squares_add(&velocity[at.index], v[k]);
            }
            for (uint32_t k = 0; k < plain->velocities; k++) {
                if (isfinite(v[k])) out->fastest[k] = fmax(out->fastest[k], fabs(v[k]));
                if (row > p.first)
                    lg_squares_add(&acceleration[k], (v[k] - before[k]) / (log->t[row] - log->t[row - 1]));
                before[k] = v[k];
            }
        }
    for (uint32_t i = 0; i < plain->coordinate_count; i++) out->velocity[i] = root(&velocity[i]);
    for (uint32_t k = 0; k < plain->velocities; k++) out->acceleration[k] = root(&acceleration[k]);
}

static const lg_machine_term *known_term(const lg_machine *machine, lg_machine_part part) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, part, &term);)
        if (term->value_count > 0) return term;
    return NULL;
}

static void measure_inputs(const lg_machine *machine, const lg_machine_log *log, moments *out) {
    const uint32_t m = machine->input_count;
    const lg_machine_term *map = known_term(machine, LG_MACHINE_INPUT_MAP);
    lg_squares input[LG_MACHINE_INPUTS] = {{0, 0}}, force[LG_MACHINE_VELOCITIES] = {{0, 0}};
    for (size_t row = 0; row < log->rows && m > 0; row++) {
        const double *u = log->u + row * 4 * m;
        for (uint32_t j = 0; j < m; j++) lg_squares_add(&input[j], u[j]);
        for (uint32_t i = 0; map != NULL && i < machine->velocities; i++) {
            double f = 0.0;
            for (uint32_t j = 0; j < m; j++) f += map->values[i * m + j] * u[j];
            lg_squares_add(&force[i], f);
        }
    }
    for (uint32_t j = 0; j < m; j++) out->input[j] = root(&input[j]);
    for (uint32_t i = 0; i < machine->velocities; i++) out->force[i] = root(&force[i]);
}

/* ---- time and lengths ---- */

/* Time scale: the time in which a velocity changes by its own size, as the geometric mean over the
 * coordinates that move. It is the root mean square of the velocity divided by the root mean square of the
 * acceleration. */
static double time_of(const lg_machine *machine, const moments *size) {
    double logs = 0.0;
    size_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        double square = 0.0;
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
            square += size->acceleration[k] * size->acceleration[k] / at.velocities;
        if (!(size->velocity[at.index] > 0.0 && square > 0.0)) continue;
        logs += log(size->velocity[at.index] / sqrt(square));
        count++;
    }
    return count > 0 ? exp(logs / (double)count) : 0.0;
}

static void set_lengths(lg_machine *machine, const moments *size) {
    lg_machine_scales *s = &machine->scales;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const bool length = at.places > 0 && !at.angle;
        const double L = length && size->velocity[at.index] > 0.0 ? size->velocity[at.index] * s->time : 1.0;
        for (uint32_t k = 0; k < at.places; k++) s->place[at.place + k] = L;
        for (uint32_t k = 0; k < at.velocities; k++) s->velocity[at.velocity + k] = k < at.places ? L : 1.0;
    }
}

/* A velocity that is always 0 takes the largest speed of all. */
static void set_speeds(lg_machine *machine, const moments *size) {
    double most = 0.0;
    for (uint32_t k = 0; k < machine->velocities; k++) most = fmax(most, size->fastest[k]);
    for (uint32_t k = 0; k < machine->velocities; k++)
        machine->scales.fastest[k] = size->fastest[k] > 0.0 ? size->fastest[k] : most;
}

/* ---- energy ---- */

/* The energy scale in which a mass of 1 of velocity k has the scaled value 1. */
static double unit_energy(const lg_machine *machine, uint32_t k) {
    const double speed = machine->scales.velocity[k] / machine->scales.time;
    return speed * speed;
}

/* Velocities in the order of the numbers of a diagonal mass: momenta on R^n first, then one velocity per
 * direction. */
static uint32_t mass_velocities(const lg_machine *machine, uint32_t *out) {
    const uint32_t count = lg_machine_mass_velocities(machine, false, out);
    return count + lg_machine_mass_velocities(machine, true, out + count);
}

/* Whether the first mass is learned and diagonal. */
static bool has_diagonal_mass(const lg_machine *machine) {
    const lg_machine_term *mass = machine->terms;
    while (mass->part != LG_MACHINE_MASS) mass++; /* each machine has one */
    return mass->kind->parameters != NULL &&
           mass->kind->parameters(machine, mass) < machine->momenta + machine->directions;
}

/* Sets scales.held, the number of the mass that is fixed at 1 in the log's units: of a diagonal mass the one
 * whose velocity has the largest acceleration, else the first. Returns its velocity. */
static uint32_t hold_mass(lg_machine *machine, const moments *size) {
    uint32_t at[LG_MACHINE_VELOCITIES], best = 0;
    const uint32_t count = mass_velocities(machine, at);
    for (uint32_t i = 1; i < count && has_diagonal_mass(machine); i++)
        if (size->acceleration[at[i]] > size->acceleration[at[best]]) best = i;
    machine->scales.held = best + 1.0;
    return at[best];
}

/* Geometric mean of the known masses times L^2/T^2, an energy. Without a known mass, masses are guessed as
 * known force divided by acceleration. 0: nothing is known. */
static double known_energy(const lg_machine *machine, const moments *size) {
    const lg_machine_term *mass = known_term(machine, LG_MACHINE_MASS);
    const uint32_t n = machine->velocities;
    double logs = 0.0;
    size_t count = 0;
    for (uint32_t k = 0; k < n; k++) {
        double m = 0.0;
        if (mass != NULL)
            m = mass->values[lg_machine_mass_place(machine, mass, k, k)];
        else if (size->acceleration[k] > 0.0)
            m = size->force[k] / size->acceleration[k];
        if (!(m > 0.0)) continue;
        logs += log(m * unit_energy(machine, k));
        count++;
    }
    return count > 0 ? exp(logs / (double)count) : 0.0;
}

/* Fails with the reason why there is no time scale. */
static lg_status refuse_motion(const lg_machine *machine, const moments *size, lg_error *error) {
    bool moves = false, turns = false;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) moves = moves || size->velocity[i] > 0.0;
    for (uint32_t k = 0; k < machine->velocities; k++) turns = turns || size->acceleration[k] > 0.0;
    return lg_fail(
        error, LG_FORMAT, "%s",
        !moves   ? "nothing moves in the logs: nothing can be learned"
        : !turns ? "all velocities are constant in the logs: forces that would change them, and masses, "
                   "cannot be learned; log a motion that speeds up or slows down"
                 : "velocities or accelerations in the logs overflow: give them in larger units");
}

/* The range of time constants that are learned. */
static void set_lags(lg_machine_scales *s, const lg_machine_log *log) {
    static const double part = 0.2, least = 10.0;
    double sum = 0.0, longest = 0.0;
    size_t steps = 0; /* not 0, because something moves in the log */
    for (lg_log_part p = {0}; lg_log_next(log, &p);) {
        const double length = log->t[p.end - 1] - log->t[p.first];
        sum += length;
        steps += p.end - p.first - 1;
        longest = fmax(longest, length);
    }
    s->lag[0] = part * sum / (double)steps;
    s->lag[1] = fmax(part * longest, least * s->lag[0]);
}

lg_status lg_machine_find_scales(lg_machine *machine, const lg_machine_log *log, lg_error *error) {
    LG_NEEDS(error, machine, log);
    moments size = {{0}, {0}, {0}, {0}, {0}};
    lg_machine plain = *machine;
    lg_machine_scales_init(&plain.scales);
    measure_motion(&plain, log, &size);
    if (machine->input_count > 0) measure_inputs(machine, log, &size);
    const double time = time_of(machine, &size);
    if (!(time > 0.0 && isfinite(time))) return refuse_motion(machine, &size, error);
    machine->scales.time = time;
    set_lengths(machine, &size);
    set_speeds(machine, &size);
    for (uint32_t j = 0; j < machine->input_count; j++)
        machine->scales.input[j] = size.input[j] > 0.0 ? size.input[j] : 1.0;
    if (machine->lags > 0) set_lags(&machine->scales, log);
    double energy = known_energy(machine, &size);
    if (!(energy > 0.0) && lg_grey_energy(machine, &energy) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
    const uint32_t held = hold_mass(machine, &size);
    machine->scales.energy = energy > 0.0 ? energy : unit_energy(machine, held);
    return LG_OK;
}
