/* Machines: the tables of term kinds, checks and sizes of a machine, and initial parameters. */
#include <math.h>
#include <string.h>

#include "integrators/stepper.h"
#include "kernels/matrix.h"
#include "machine/internal.h"

const char *lg_machine_part_name(lg_machine_part part) {
    static const char *const names[LG_MACHINE_PART_COUNT] = {"mass",     "potential", "damping", "input_map",
                                                             "residual", "bias",      "offset",  "actuator"};
    return (uint32_t)part < LG_MACHINE_PART_COUNT ? names[part] : NULL;
}

/* Each X(name) stands for a table lg_machine_<name>_kinds; a table ends with a row without a name. */
#define TABLES(X)     X(mass) X(potential) X(force) X(bias) X(friction) X(offset) X(actuator)
#define DECLARE(name) extern const lg_term_kind lg_machine_##name##_kinds[];
#define LIST(name)    lg_machine_##name##_kinds,
TABLES(DECLARE)
static const lg_term_kind *const tables[] = {TABLES(LIST)};

const lg_term_kind *lg_term_kind_at(lg_machine_part part, size_t index) {
    for (size_t t = 0; t < LG_COUNT(tables); t++)
        for (const lg_term_kind *kind = tables[t]; kind->name != NULL; kind++)
            if (kind->part == part && index-- == 0) return kind;
    return NULL;
}

const lg_term_kind *lg_term_kind_find(lg_machine_part part, const char *name) {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(part, i)) != NULL; i++)
        if (strcmp(kind->name, name) == 0) return kind;
    return NULL;
}

const char *lg_term_kind_name(const lg_term_kind *kind) {
    return kind->name;
}

uint32_t lg_term_kind_options(const lg_term_kind *kind) {
    return kind->options;
}

/* ---- initialisation ---- */

/* Without a log the width of friction is a thousandth of this, 0.02, as in files without `fastest`. */
static const double unknown_speed = 20.0;

void lg_machine_scales_init(lg_machine_scales *scales) {
    scales->time = scales->energy = scales->held = 1.0;
    scales->lag[0] = 1e-3;
    scales->lag[1] = 1e3;
    for (size_t i = 0; i < LG_MACHINE_POSITIONS; i++) scales->place[i] = 1.0;
    for (size_t i = 0; i < LG_MACHINE_VELOCITIES; i++) {
        scales->velocity[i] = 1.0;
        scales->fastest[i] = unknown_speed;
    }
    for (size_t i = 0; i < LG_MACHINE_INPUTS; i++) scales->input[i] = 1.0;
}

static lg_status count_coordinates(lg_machine *machine, lg_error *error) {
    if (machine->coordinate_count == 0 || machine->coordinate_count > LG_MACHINE_COORDINATES ||
        machine->input_count > LG_MACHINE_INPUTS || machine->term_count > LG_MACHINE_TERMS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a machine has 1 to %d coordinates, up to %d inputs and up to %d terms",
                       LG_MACHINE_COORDINATES, LG_MACHINE_INPUTS, LG_MACHINE_TERMS);
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (lg_coordinate_row_of(machine->coordinates[i].kind) == NULL)
            return lg_fail(error, LG_INVALID_ARGUMENT, "coordinate %u has an unknown kind", i + 1);
    for (uint32_t i = 0; i < machine->coordinate_count && machine->accelerations; i++)
        if (machine->coordinates[i].kind > LG_COORDINATE_ANGLE)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "%s: a coordinate whose acceleration is measured is a line or an angle",
                           machine->coordinates[i].name);
    const lg_machine_offsets all = lg_machine_offsets_of(machine, machine->coordinate_count);
    machine->places = all.place;
    machine->directions = all.direction;
    machine->rotations = all.rotation;
    machine->momenta = all.momentum;
    machine->positions = all.position;
    machine->velocities = all.velocity;
    /* No kind has more than three positions for each velocity, so the positions fit too. */
    if (all.velocity > LG_MACHINE_VELOCITIES)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the coordinates have %u velocities; at most %d are possible", all.velocity,
                       LG_MACHINE_VELOCITIES);
    return LG_OK;
}

static lg_status check_kinds(const lg_machine *machine, lg_error *error) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        if (term->kind == NULL || term->kind->part != term->part)
            return lg_fail(error, LG_INVALID_ARGUMENT, "a term has no kind, or a kind of another part");
    return LG_OK;
}

static lg_status check_names(const lg_machine *machine, lg_error *error) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        for (uint32_t j = 0; j < i; j++)
            if (strcmp(machine->coordinates[i].name, machine->coordinates[j].name) == 0)
                return lg_fail(error, LG_INVALID_ARGUMENT, "two coordinates are called %s",
                               machine->coordinates[i].name);
    return LG_OK;
}

static bool feature_fits(const lg_machine *machine, const lg_machine_term *term, lg_machine_feature of) {
    const bool input = of.kind == LG_FEATURE_INPUT;
    if (of.index >= (input ? machine->input_count : machine->coordinate_count)) return false;
    if (input)
        return term->part == LG_MACHINE_RESIDUAL || term->part == LG_MACHINE_ACTUATOR ||
               lg_term_has(term, LG_TERM_INPUTS);
    if (term->part == LG_MACHINE_ACTUATOR || lg_term_has(term, LG_TERM_INPUTS)) return false;
    if (term->part == LG_MACHINE_OFFSET) return of.kind == LG_FEATURE_POSITION;
    const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[of.index].kind);
    if (term->part == LG_MACHINE_BIAS && of.kind != LG_FEATURE_VELOCITY && of.kind != LG_FEATURE_PLACE)
        return of.kind == LG_FEATURE_POSITION && row->directions == 0 && row->rotations == 0 &&
               !machine->accelerations;
    switch (of.kind) {
    case LG_FEATURE_PLACE:
        return row->places > 0 && row->rotations > 0;
    case LG_FEATURE_ROTATION:
        return row->places > 0 && row->rotations > 0;
    case LG_FEATURE_UP:
        return row->rotations > 0;
    case LG_FEATURE_VELOCITY:
        return lg_term_has(term, LG_TERM_MOVING);
    default:
        return true;
    }
}

static lg_status term_fails(const lg_machine_term *term, lg_error *error, const char *what) {
    return lg_fail(error, LG_INVALID_ARGUMENT, "%s of kind %s: %s", lg_machine_part_name(term->part),
                   term->kind->name, what);
}

/* Whether an earlier term of the same kind changes the coefficients of the same term: together they might
 * give energy. */
static bool changes_again(const lg_machine *machine, const lg_machine_term *term) {
    if (lg_machine_base(machine, term) == NULL) return false;
    for (const lg_machine_term *other = machine->terms; other < term; other++)
        if (other->kind == term->kind && lg_machine_base(machine, other) != NULL) return true;
    return false;
}

static lg_status check_term(const lg_machine *machine, const lg_machine_term *term, lg_error *error) {
    const uint32_t options = term->kind->options;
    if ((options & LG_TERM_OF) != 0 && term->of_count == 0)
        return term_fails(term, error, "needs `of`, the coordinates that it depends on");
    if (term->of_count > LG_MACHINE_FEATURES || term->hidden_layers > LG_MACHINE_HIDDEN)
        return term_fails(term, error, "has too many features or layers");
    for (uint32_t i = 0; i < term->of_count; i++)
        if (!feature_fits(machine, term, term->of[i]))
            return term_fails(term, error, "cannot depend on what `of` lists");
    if ((options & LG_TERM_DEGREE) != 0 &&
        (term->degree < term->kind->least || term->degree > LG_MACHINE_DEGREE))
        return term_fails(term, error,
                          term->kind->least > 1 ? "the degree must be 2 to 8" : "the degree must be 1 to 8");
    if ((options & LG_TERM_WIDTH) != 0 && !(term->width >= 0.0 && isfinite(term->width)))
        return term_fails(term, error, "the width must be above 0, or 0 for a width from the log");
    if ((options & LG_TERM_INPUTS) != 0 && term->of_count == 0 &&
        !lg_machine_has_part(machine, LG_MACHINE_POTENTIAL))
        return term_fails(term, error,
                          "needs `of`, the inputs that load it, or a potential whose force does");
    if (term->kind->base != NULL && changes_again(machine, term))
        return term_fails(term, error, "two terms of this kind change the same friction; give one");
    size_t fits[2] = {0, 0};
    if (term->kind->values != NULL)
        term->kind->values(machine, term, fits);
    else if ((options & LG_TERM_VALUES) != 0)
        fits[0] = fits[1] = term->kind->parameters(machine, term);
    const bool needed = (options & LG_TERM_KNOWN) != 0, given = term->value_count > 0;
    if ((needed || given) && term->value_count != fits[0] && term->value_count != fits[1])
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s of kind %s: has %u values, expected %zu%s%.0zu",
                       lg_machine_part_name(term->part), term->kind->name, term->value_count, fits[0],
                       fits[1] != fits[0] ? " or " : "", fits[1] != fits[0] ? fits[1] : (size_t)0);
    const char *wrong = lg_machine_entries_fault(machine, term);
    if (wrong != NULL) return term_fails(term, error, wrong);
    const char *fault = given && term->kind->fault != NULL ? term->kind->fault(machine, term) : NULL;
    return fault != NULL ? term_fails(term, error, fault) : LG_OK;
}

/* Gravity depends on heights: where `of` lists none, on the heights of all coordinates except lines. */
static void set_heights(const lg_machine *machine, lg_machine_term *term) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        if (machine->coordinates[i].kind != LG_COORDINATE_LINE)
            term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_HEIGHT, i};
}

static lg_status set_term(const lg_machine *machine, lg_machine_term *term, lg_error *error) {
    if (term->kind->heights) {
        if (term->of_count == 0) set_heights(machine, term);
        for (uint32_t i = 0; i < term->of_count; i++)
            if (term->of[i].kind == LG_FEATURE_POSITION) term->of[i].kind = LG_FEATURE_HEIGHT;
    }
    LG_TRY(check_term(machine, term, error));
    if (term->kind->outputs != NULL) {
        const lg_status status = lg_mlp_init(&term->net, lg_machine_feature_numbers(machine, term),
                                             term->hidden, term->hidden_layers, term->kind->outputs(machine),
                                             term->activation, term->part != LG_MACHINE_POTENTIAL);
        if (status != LG_OK) return term_fails(term, error, "a network of this size cannot be made");
        term->parameters = lg_mlp_parameters(&term->net);
        return LG_OK;
    }
    const bool known = term->value_count > 0;
    term->parameters = known || term->kind->parameters == NULL ? 0 : term->kind->parameters(machine, term);
    if (known) term->parameters = term->entry_count;
    if (term->parameters == SIZE_MAX) return term_fails(term, error, "has too many monomials");
    return LG_OK;
}

/* Fails if the machine has no mass, or if its directions have none. */
static lg_status check_mass(const lg_machine *machine, lg_error *error) {
    bool directions = machine->directions == 0;
    if (!lg_machine_has_part(machine, LG_MACHINE_MASS))
        return lg_fail(error, LG_INVALID_ARGUMENT, "a machine needs a mass");
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_MASS, &term);)
        directions = directions || term->kind->outputs == NULL;
    if (directions) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "the mass of a direction is one number: add a mass of kind diagonal or known");
}

/* ---- values that are not physical ---- */

/* Adds the values of a known mass or damping to `sum`: a diagonal or a matrix of all velocities. Unknown ones
 * are positive and left out. */
static void add_known(const lg_machine *machine, const lg_machine_term *term, double *sum) {
    const uint32_t n = machine->velocities;
    for (uint32_t i = 0; i < n * n; i++) {
        const uint32_t index = lg_machine_mass_place(machine, term, i / n, i % n);
        if (index != UINT32_MAX && !lg_machine_is_entry_of(term, index)) sum[i] += term->values[index];
    }
}

/* Whether the symmetric part of the matrix has no eigenvalue below `least` times the largest absolute entry.
 * With `least` above 0 the matrix must also be symmetric. */
static bool is_definite(uint32_t n, const double *matrix, double least) {
    static const double rounding = 1e-12;
    double part[LG_MACHINE_VALUES], L[LG_MACHINE_VALUES], largest = 0.0;
    for (uint32_t i = 0; i < n * n; i++) largest = fmax(largest, fabs(matrix[i]));
    if (largest == 0.0) return least <= 0.0;
    for (uint32_t i = 0; i < n * n; i++) {
        const double turned = matrix[i % n * n + i / n];
        if (least > 0.0 && fabs(matrix[i] - turned) > rounding * largest) return false;
        part[i] = matrix[i] / largest - (i % (n + 1) == 0 ? least : 0.0);
    }
    return lg_matrix_cholesky(n, part, L);
}

/* Checks that the sum of the known masses, or of the known dampings, is positive semidefinite. A mass that
 * consists of known terms alone must be positive definite. */
static lg_status check_positive(const lg_machine *machine, lg_machine_part part, lg_error *error) {
    static const double rounding = 1e-12;
    double sum[LG_MACHINE_VALUES] = {0};
    const lg_machine_term *known = NULL;
    bool alone = part == LG_MACHINE_MASS && machine->grey.system == NULL;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, part, &term);) {
        if (strcmp(term->kind->name, "known") == 0) known = term, add_known(machine, term, sum);
        alone = alone && known == term && term->entry_count == 0;
    }
    if (known == NULL) return LG_OK;
    if (!lg_all_finite((size_t)machine->velocities * machine->velocities, sum))
        return term_fails(known, error, "the sum of the known values overflows");
    return is_definite(machine->velocities, sum, alone ? rounding : -rounding)
               ? LG_OK
               : term_fails(
                     known, error,
                     alone ? "the values must be above 0; a matrix must be symmetric and positive definite"
                           : "the values must not be below 0; a matrix must not be indefinite");
}

/* ---- common factor ---- */

/* Whether one of the term's values is known and not 0: 0 fixes no factor. */
static bool gives_factor(const lg_machine_term *term) {
    for (uint32_t i = 0; i < term->value_count; i++)
        if (term->values[i] != 0.0 && !lg_machine_is_entry_of(term, i)) return true;
    return false;
}

/* Decides what fixes the common factor of M, V, D and B (see lg_machine in liegrad/machine.h). */
static void find_gauge(lg_machine *machine) {
    const bool grey = machine->grey.system != NULL;
    bool given = lg_grey_known(machine), moving = false, single = false;
    uint32_t masses = 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (term->part == LG_MACHINE_ACTUATOR) continue;
        given = given || gives_factor(term);
        for (uint32_t k = 0; k < term->entry_count; k++) given = given || term->entries[k].sigma > 0.0;
        if (term->part != LG_MACHINE_MASS) continue;
        single = single || term->entry_count > 0;
        masses++;
        moving = moving || term->kind->moving != NULL;
    }
    machine->normalised = !given && !grey && !moving && !single && masses == 1;
    machine->free_gauge = !given && !machine->normalised;
}

/* Sets the offsets of the terms that are networks, or of all other terms, from `offset` on; returns the
 * end. */
static size_t place_parameters(lg_machine *machine, bool networks, size_t offset) {
    for (uint32_t i = 0; i < machine->term_count; i++) {
        if ((machine->terms[i].kind->outputs != NULL) != networks) continue;
        machine->terms[i].offset = offset;
        offset += machine->terms[i].parameters;
    }
    return offset;
}

lg_status lg_machine_init(lg_machine *machine, lg_error *error) {
    LG_NEEDS(error, machine);
    LG_TRY(count_coordinates(machine, error));
    LG_TRY(check_names(machine, error));
    LG_TRY(check_kinds(machine, error));
    LG_TRY(lg_grey_check(machine, error));
    find_gauge(machine);
    for (uint32_t i = 0; i < machine->term_count; i++) LG_TRY(set_term(machine, &machine->terms[i], error));
    LG_TRY(check_positive(machine, LG_MACHINE_MASS, error));
    LG_TRY(check_positive(machine, LG_MACHINE_DAMPING, error));
    if (!lg_machine_find_lags(machine))
        return lg_fail(error, LG_INVALID_ARGUMENT, "actuator of kind lag: an input has two lags");
    if (!lg_machine_find_bristles(machine))
        return lg_fail(error, LG_INVALID_ARGUMENT, "damping of kind lugre: give one term of this kind");
    machine->sticks = lg_machine_find_sticking(machine);
    machine->weights = place_parameters(machine, true, 0);
    machine->parameters = place_parameters(machine, false, machine->weights);
    if (machine->input_count > 0 && !lg_machine_has_part(machine, LG_MACHINE_INPUT_MAP) &&
        !lg_machine_has_part(machine, LG_MACHINE_RESIDUAL))
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are inputs, but no input_map");
    lg_prior priors[LG_MACHINE_PRIORS];
    if (lg_machine_list_priors(machine, priors) > LG_MACHINE_PRIORS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "at most %d unknown numbers can have a prior (sigma)",
                       LG_MACHINE_PRIORS);
    return check_mass(machine, error);
}

/* ---- initial parameters ---- */

static void scale_last(const lg_mlp *net, double *theta) {
    for (size_t i = lg_mlp_weight_offset(net, net->layers - 1); i < lg_mlp_parameters(net); i++)
        theta[i] *= 0.1;
}

void lg_machine_initialise(const lg_machine *machine, lg_rng *rng, double *theta) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        double *slice = theta + term->offset;
        for (size_t j = 0; j < term->parameters; j++) slice[j] = 0.0;
        if (term->kind->outputs != NULL) {
            lg_mlp_initialise(&term->net, rng, slice);
            scale_last(&term->net, slice);
        }
        const bool free = term->entry_count == 0;
        if (free && term->parameters > 0 && term->kind->initialise != NULL)
            term->kind->initialise(machine, term, slice);
        for (uint32_t k = 0; free && term->kind->each != LG_PARAMETER_OTHER && k < term->parameters; k++) {
            lg_entry_about about;
            term->kind->entry(machine, term, k, &about);
            slice[k] = term->kind->each == LG_PARAMETER_SQUARED ? sqrt(about.start) : about.start;
        }
    }
}
