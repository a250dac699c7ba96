/* Machines of a named system: the system's parameters, and the two terms that it adds. */
#include <math.h>
#include <string.h>

#include "machine/internal.h"
#include "mechanics/system.h"

/* ---- the table ---- */

const lg_energy_row *lg_grey_system_at(size_t index) {
    const lg_energy_row *const *row = lg_energy_rows;
    while (*row != NULL && index-- > 0) row++;
    return *row;
}

/* Systems of lg-simulate that cannot be a machine, and why. */
static const struct {
    const char *name, *why;
} refusals[] = {
    {"rigid-body", "its state is the body momentum alone, and logs have positions: take "
                   "rigid-body-attitude with a coordinate of kind rotation"},
    {"quadrotors",
     "they fly by a control law of their own that depends on the time: give coordinates of kind "
     "pose with a diagonal mass, gravity and an input map"},
};

static lg_status find_system(const char *name, const lg_energy_row **out, lg_error *error) {
    char known[200] = "";
    for (size_t i = 0; (*out = lg_grey_system_at(i)) != NULL; i++) {
        if (strcmp((*out)->name, name) == 0) return LG_OK;
        lg_append(known, sizeof known, "%s%s", i > 0 ? ", " : "", (*out)->name);
    }
    for (size_t i = 0; i < LG_COUNT(refusals); i++)
        if (strcmp(refusals[i].name, name) == 0)
            return lg_fail(error, LG_NOT_FOUND, "%s: %s", name, refusals[i].why);
    return lg_fail(error, LG_NOT_FOUND, "there is no machine for system \"%.40s\"; the systems are: %s", name,
                   known);
}

/* ---- coordinates of a system ---- */

static lg_status check_coordinates(const lg_machine *machine, const lg_energy_row *system, lg_error *error) {
    char wanted[96] = "";
    const bool any = system->count == 0;
    bool fits = machine->coordinate_count > 0 && (any || system->count == machine->coordinate_count);
    for (uint32_t i = 0; i < machine->coordinate_count && fits; i++)
        fits = machine->coordinates[i].kind == system->coordinates[any ? 0 : i];
    if (fits) return LG_OK;
    for (uint32_t i = 0; i < (any ? 1 : system->count); i++)
        lg_append(wanted, sizeof wanted, "%s%s", i > 0 ? ", " : "",
                  lg_coordinate_row_of(system->coordinates[i])->name);
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "%s: the coordinates must be of kind %s%s, in this order, and no others", system->name,
                   wanted, any ? ", one or more" : "");
}

/* ---- parameters of a system ---- */

static uint32_t links_of(const lg_machine *machine) {
    return machine->grey.system->count == 0 ? machine->coordinate_count : 0;
}

static size_t numbers_of(const lg_machine *machine, const lg_parameter_entry *entry) {
    return lg_parameter_numbers(entry, links_of(machine));
}

/* Offset of an entry's first number among all numbers of the system; for NULL the count of all numbers. */
static uint32_t place_of(const lg_machine *machine, const lg_parameter_entry *entry) {
    uint32_t at = 0;
    const lg_parameter_entry *p = machine->grey.system->parameters;
    for (; p->key != NULL && p != entry; p++) at += (uint32_t)numbers_of(machine, p);
    return at;
}

bool lg_grey_known(const lg_machine *machine) {
    const lg_machine_grey *grey = &machine->grey;
    bool known = false;
    for (uint32_t i = 0; i < grey->count; i++) known = known || !grey->unknown[i];
    return grey->system != NULL && known;
}

/* The default of number i of an entry; NaN if it has none. */
static double fallback_of(const lg_parameter_entry *p, size_t i, bool unknown) {
    if (p->fallback != NULL) return p->fallback[p->count > 0 ? i : 0];
    return unknown && p->rule == LG_PARAMETER_POSITIVE ? 1.0 : NAN;
}

static lg_status check_entry(const lg_machine *machine, const lg_parameter_entry *p, lg_error *error) {
    const lg_machine_grey *grey = &machine->grey;
    const uint32_t at = place_of(machine, p);
    const size_t n = numbers_of(machine, p);
    size_t unknown = 0;
    for (size_t i = at; i < at + n; i++) unknown += grey->unknown[i];
    for (size_t i = at; i < at + n; i++)
        if (isnan(grey->start[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           grey->unknown[i] ? "%s: parameter \"%s\" (%s) has no default to start from: give "
                                              "{start: ..., unknown: true}"
                                            : "%s: parameter \"%s\" (%s) must be given",
                           grey->system->name, p->key, p->meaning);
    if (p->rule == LG_PARAMETER_UNIT_VECTOR && unknown > 0 && unknown < n)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: either all numbers of a direction are unknown, or none of them", p->key);
    return lg_parameter_check(p, grey->start + at, n, error);
}

lg_status lg_grey_check(const lg_machine *machine, lg_error *error) {
    const lg_energy_row *system = machine->grey.system;
    bool term = false;
    for (const lg_machine_term *at = NULL; lg_machine_next_term(machine, LG_MACHINE_MASS, &at);)
        term = term || at->kind == &lg_grey_mass_kind;
    if ((system != NULL) != term)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a machine has either a system and the terms of this system, or neither");
    if (!term) return LG_OK;
    LG_TRY(check_coordinates(machine, system, error));
    for (const lg_parameter_entry *p = system->parameters; p->key != NULL; p++)
        LG_TRY(check_entry(machine, p, error));
    return LG_OK;
}

lg_status lg_machine_set_parameter(lg_machine *machine, const char *key, size_t count, const double *values,
                                   const bool *unknown, lg_error *error) {
    LG_NEEDS(error, machine, key);
    if (count > 0) LG_NEEDS(error, values);
    const lg_energy_row *system = machine->grey.system;
    const lg_parameter_entry *p = NULL;
    if (system == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the machine has no system, so it has no parameters");
    LG_TRY(lg_parameter_find(system->name, system->parameters, key, &p, error));
    const size_t n = numbers_of(machine, p);
    if (count != 0 && count != n)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %zu number%s given, %zu%s expected", key, count,
                       count == 1 ? " is" : "s are", n, n == 1 ? " is" : " are");
    lg_machine changed = *machine;
    const uint32_t at = place_of(machine, p);
    for (size_t i = 0; i < n; i++) {
        const bool open = unknown != NULL && unknown[count > 0 ? i : 0];
        const double value = count > 0 ? values[i] : NAN;
        changed.grey.unknown[at + i] = open;
        changed.grey.start[at + i] = isnan(value) ? fallback_of(p, i, open) : value;
    }
    LG_TRY(check_entry(&changed, p, error));
    machine->grey = changed.grey;
    return LG_OK;
}

lg_status lg_machine_bound_parameter(lg_machine *machine, const char *key, size_t index, double low,
                                     double high, double sigma, lg_error *error) {
    LG_NEEDS(error, machine, key);
    lg_machine_grey *grey = &machine->grey;
    const lg_parameter_entry *p = NULL;
    if (grey->system == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the machine has no system, so it has no parameters");
    LG_TRY(lg_parameter_find(grey->system->name, grey->system->parameters, key, &p, error));
    const size_t at = place_of(machine, p) + index;
    if (index >= numbers_of(machine, p) || !grey->unknown[at] || p->rule == LG_PARAMETER_UNIT_VECTOR)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: only an unknown number has bounds or a prior", key);
    if (low != high && !(low < grey->start[at] && grey->start[at] < high))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the start must be inside of its bounds", key);
    if (low < high && p->rule == LG_PARAMETER_POSITIVE && low < 0.0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: bounds of this number must not be below 0", key);
    grey->low[at] = low, grey->high[at] = high, grey->sigma[at] = sigma;
    return LG_OK;
}

/* ---- theta: 1 number for each unknown number of the system, 2 for an unknown unit vector ---- */

static size_t unknown_numbers(const lg_machine *machine, const lg_machine_term *term) {
    const lg_machine_grey *grey = &machine->grey;
    size_t count = 0;
    for (uint32_t i = 0; i < grey->count; i++) count += grey->unknown[i];
    for (const lg_parameter_entry *p = grey->system->parameters; p->key != NULL; p++)
        count -= p->rule == LG_PARAMETER_UNIT_VECTOR && grey->unknown[place_of(machine, p)];
    return count;
}

/* Number i of the system is map[i] at t_i of t = theta S. */
typedef struct mapping {
    lg_number_map map[LG_MACHINE_PARAMETERS];
    double S[LG_MACHINE_PARAMETERS * LG_MACHINE_PARAMETERS]; /* (size of theta, numbers of the system) */
    uint32_t used;                                           /* filled rows of S */
} mapping;

static void map_entry(const lg_machine_grey *grey, const lg_parameter_entry *p, uint32_t at, size_t n,
                      mapping *m) {
    const bool positive = p->rule == LG_PARAMETER_POSITIVE;
    double scale = 0.0, *rows = m->S + m->used * grey->count + at;
    for (size_t i = at; i < at + n; i++) scale = fmax(scale, fabs(grey->start[i]));
    for (size_t i = at; i < at + n; i++) m->map[i] = (lg_number_map){.b = grey->start[i], .s = 1.0};
    if (p->rule == LG_PARAMETER_UNIT_VECTOR) {
        if (!grey->unknown[at]) return;
        const double n_at_rest[6] = {grey->start[at], grey->start[at + 1], grey->start[at + 2]};
        double basis[6 * 4]; /* of the tangent space; its first columns are orthogonal to n */
        lg_space_kind_entry(LG_SPACE_TS2)->basis(n_at_rest, 4, basis);
        for (int i = 0; i < 3; i++) rows[i] = basis[4 * i], rows[grey->count + i] = basis[4 * i + 1];
        m->used += 2;
        return;
    }
    for (size_t k = at; k < at + n; k++) {
        const lg_machine_entry ends = {.low = grey->low[k], .high = grey->high[k]};
        const bool free = !positive && !(ends.low < ends.high);
        if (!grey->unknown[k]) continue;
        m->S[m->used++ * grey->count + k] = free && scale > 0.0 ? scale : 1.0;
        if (!free) m->map[k] = lg_machine_entry_map(&ends, grey->start[k], 0.0, positive);
    }
}

static void map_all(const lg_machine *machine, mapping *m) {
    const lg_parameter_entry *p = machine->grey.system->parameters;
    for (; p->key != NULL; p++) map_entry(&machine->grey, p, place_of(machine, p), numbers_of(machine, p), m);
}

/* Unit vectors n + t (t orthogonal to the start n) become cos|t| n + sin|t|/|t| t: the start turned by the
 * angle |t|. */
static lg_var turned(lg_tape *tape, const double *start, lg_var moved, uint32_t n) {
    const lg_var from = lg_input_f64(tape, lg_shape1(n), start), t = lg_sub(tape, moved, from);
    const lg_var c = lg_stumpff_functions(tape, lg_rownorm2(tape, t), 1);
    return lg_add(tape, lg_mul(tape, lg_slice(tape, c, -1, 0, 1), from),
                  lg_mul(tape, lg_slice(tape, c, -1, 1, 1), t));
}

static lg_var with_unit_vectors(lg_tape *tape, const lg_machine *machine, lg_var numbers) {
    const uint32_t all = machine->grey.count;
    for (const lg_parameter_entry *p = machine->grey.system->parameters; p->key != NULL; p++) {
        const uint32_t at = place_of(machine, p), n = (uint32_t)p->count;
        if (p->rule != LG_PARAMETER_UNIT_VECTOR || !machine->grey.unknown[at]) continue;
        lg_var parts[3];
        size_t used = 0;
        if (at > 0) parts[used++] = lg_slice(tape, numbers, 0, 0, at);
        parts[used++] = turned(tape, machine->grey.start + at, lg_slice(tape, numbers, 0, at, n), n);
        if (at + n < all) parts[used++] = lg_slice(tape, numbers, 0, at + n, all - at - n);
        numbers = lg_concat(tape, parts, used, 0);
    }
    return numbers;
}

lg_var lg_grey_record(lg_tape *tape, const lg_machine *machine, lg_var theta) {
    const lg_machine_grey *grey = &machine->grey;
    const lg_shape flat = lg_shape1(grey->count);
    mapping m = {.used = 0};
    if (lg_is_none(theta)) return lg_input_f64(tape, flat, grey->start);
    map_all(machine, &m);
    const lg_var S = lg_input_f64(tape, lg_shape2(m.used, grey->count), m.S),
                 t = lg_matmul(tape, lg_reshape(tape, theta, lg_shape2(1, m.used)), S);
    const lg_var all = lg_machine_record_maps(tape, m.map, grey->count, t);
    return with_unit_vectors(tape, machine, lg_reshape(tape, all, flat));
}

static uint32_t priors(const lg_machine *machine, uint32_t term, lg_prior *out, uint32_t count) {
    const lg_machine_grey *grey = &machine->grey;
    mapping m = {.used = 0};
    map_all(machine, &m);
    for (uint32_t row = 0; row < m.used; row++)
        for (uint32_t i = 0; i < grey->count; i++) {
            const double s = m.S[row * grey->count + i];
            if (s == 0.0 || !(grey->sigma[i] > 0.0)) continue;
            lg_number_map map = m.map[i];
            map.s *= s;
            if (count < LG_MACHINE_PRIORS)
                out[count] = (lg_prior){term, row, map, grey->start[i], grey->sigma[i]};
            count++;
        }
    return count;
}

/* ---- terms ---- */

/* x in the units of the log: each scaled number times its scale. */
static lg_var places_in_logs(lg_tape *tape, const lg_machine *machine, lg_var x) {
    bool any = false;
    for (uint32_t i = 0; i < machine->places; i++) any = any || machine->scales.place[i] != 1.0;
    if (!any) return x;
    return lg_mul(tape, x, lg_input_f64(tape, lg_shape2(1, machine->places), machine->scales.place));
}

/* `state` gets the positions in the units of the log. */
static lg_at at_of(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen, lg_var *state) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places part = lg_machine_parts(machine);
    lg_at at = {.rows = seen->rows, .parameters = vars->grey};
    at.size = lg_machine_tied(machine) ? machine->velocities : machine->directions + machine->momenta;
    if (seen->parts == NULL) return at;
    at.state = state;
    if (part.x >= 0) *state++ = places_in_logs(tape, machine, seen->parts[part.x]);
    if (part.q >= 0) *state++ = seen->parts[part.q];
    if (part.R >= 0) *state = seen->parts[part.R];
    return at;
}

/* M in the order of lg_machine_mass_velocities, converted from the log's units to scaled units. */
static lg_var mass(const lg_term_at *of) {
    lg_tape *tape = of->tape;
    const lg_machine *machine = of->machine;
    uint32_t list[LG_MACHINE_VELOCITIES];
    double unit[LG_MACHINE_VALUES];
    lg_var state[3];
    const lg_at at = at_of(tape, of->vars, of->seen, state);
    lg_var M = machine->grey.system->mass(tape, &at);
    const lg_mass_rows wanted = of->seen->directions ? LG_MASS_DIRECTIONS : LG_MASS_MOMENTA,
                       rows = lg_machine_tied(machine) ? LG_MASS_ALL : wanted;
    const uint32_t n = lg_machine_mass_velocities(machine, rows, list);
    const uint32_t given = lg_var_shape(tape, M).dims[1];
    if (given < n) M = lg_mul(tape, M, lg_unit_matrix(tape, n)); /* one number */
    if (given > n)
        (void)lg_tape_fail(tape, LG_UNSUPPORTED, machine->grey.system->name,
                           "the constant mass of a direction that is the only coordinate must be one number");
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < n; j++) unit[i * n + j] = lg_machine_unit_mass(machine, list[i], list[j]);
    return lg_mul(tape, M, lg_input_f64(tape, lg_shape3(1, n, n), unit));
}

static lg_var potential(const lg_term_at *of) {
    lg_var state[3];
    const lg_at at = at_of(of->tape, of->vars, of->seen, state);
    return lg_scale(of->tape, of->machine->grey.system->potential(of->tape, &at),
                    1.0 / of->machine->scales.energy);
}

static bool moves(const lg_machine *machine) {
    return machine->grey.system->moving;
}

const lg_term_kind lg_grey_mass_kind = {.name = "system",
                                        .part = LG_MACHINE_MASS,
                                        .parameters = unknown_numbers,
                                        .record = mass,
                                        .numbers = lg_numbers_grey,
                                        .moving = moves,
                                        .priors = priors};
const lg_term_kind lg_grey_potential_kind = {
    .name = "system", .part = LG_MACHINE_POTENTIAL, .record = potential};

/* ---- a system is given to a machine ---- */

static void add_term(lg_machine *machine, const lg_term_kind *kind) {
    lg_machine_term *term = &machine->terms[machine->term_count++];
    *term = (lg_machine_term){.kind = kind, .part = kind->part};
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if ((machine->grey.system->seen >> i & 1U) != 0)
            term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_POSITION, i};
}

lg_status lg_grey_use(lg_machine *machine, const lg_energy_row *system, lg_error *error) {
    if (machine->grey.system != NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the machine already has a system");
    if (machine->term_count + 2 > LG_MACHINE_TERMS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "more than %d terms", LG_MACHINE_TERMS);
    LG_TRY(check_coordinates(machine, system, error));
    machine->grey = (lg_machine_grey){.system = system};
    machine->grey.count = place_of(machine, NULL);
    const lg_parameter_entry *p = system->parameters;
    for (uint32_t at = 0; p->key != NULL; p++)
        for (size_t i = 0; i < numbers_of(machine, p); i++)
            machine->grey.start[at++] = fallback_of(p, i, false);
    add_term(machine, &lg_grey_mass_kind);
    if (system->potential != NULL) add_term(machine, &lg_grey_potential_kind);
    return LG_OK;
}

lg_status lg_machine_set_system(lg_machine *machine, const char *name, lg_error *error) {
    LG_NEEDS(error, machine, name);
    const lg_energy_row *system = NULL;
    LG_TRY(find_system(name, &system, error));
    return lg_grey_use(machine, system, error);
}

/* ---- numbers with names ---- */

void lg_numbers_grey(lg_number_list *list, const lg_machine *machine, const lg_machine_term *term,
                     const double *theta) {
    const lg_machine_grey *grey = &machine->grey;
    double values[LG_MACHINE_PARAMETERS];
    if (term->parameters == 0) return;
    lg_numbers_read(list, list->vars.grey, grey->count, values);
    for (uint32_t i = 0; i < grey->count; i++) {
        char label[LG_PARAMETER_LABEL];
        if (!grey->unknown[i]) continue;
        lg_parameter_label(grey->system->parameters, links_of(machine), i, label);
        lg_numbers_put(list, values[i], "%s", label);
    }
}

/* ---- scale of energies ---- */

/* M at the reference and the initial parameters, M_ij L_i L_j/T^2: energies in the units of the log. */
static lg_var initial_mass(lg_tape *tape, const lg_machine *machine) {
    const uint32_t unknown = (uint32_t)unknown_numbers(machine, NULL);
    const lg_var theta = unknown > 0 ? lg_full(tape, lg_shape1(unknown), 0.0) : LG_NONE;
    const lg_machine_vars vars = {.machine = machine, .grey = lg_grey_record(tape, machine, theta)};
    double q[LG_MACHINE_POSITIONS];
    lg_var parts[LG_TAPED_MAX_PARTS];
    lg_machine_reference(machine, q);
    lg_machine_split_positions(tape, machine, lg_input_f64(tape, lg_shape2(1, machine->positions), q), parts);
    const lg_machine_seen seen = {.parts = parts, .rows = 1, .directions = machine->momenta == 0};
    const lg_term_at at = lg_term_at_of(tape, &vars, machine->terms, &seen);
    return mass(&at);
}

lg_status lg_grey_energy(const lg_machine *machine, double *out) {
    lg_machine plain = *machine;
    double M[LG_MACHINE_VALUES], logs = 0.0;
    const uint32_t n =
        lg_machine_tied(machine) ? machine->velocities : machine->momenta + machine->directions;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    *out = 0.0;
    if (machine->grey.system == NULL) return LG_OK;
    plain.scales.energy = 1.0;
    lg_status status = lg_tape_create(NULL, NULL, &tape);
    if (status == LG_OK) status = lg_read(tape, initial_mass(tape, &plain), (size_t)n * n, M);
    if (status != LG_OK) return status == LG_OUT_OF_MEMORY ? status : LG_OK;
    for (uint32_t i = 0; i < n; i++) logs += log(M[i * n + i]);
    *out = exp(logs / n);
    return LG_OK;
}
