/* Builds descriptions of machines and their parameters for tests. */
#ifndef LG_MACHINE_SUPPORT_H
#define LG_MACHINE_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/fit.h"
#include "machine/internal.h"

static inline void add_coordinate(lg_machine *machine, const char *name, lg_coordinate_kind kind) {
    lg_machine_coordinate *c = &machine->coordinates[machine->coordinate_count++];
    (void)snprintf(c->name, sizeof c->name, "%s", name);
    c->kind = kind;
}

static inline void add_input(lg_machine *machine, const char *name) {
    (void)snprintf(machine->inputs[machine->input_count++], LG_MACHINE_NAME, "%s", name);
}

static inline lg_machine_term *add_term(lg_machine *machine, lg_machine_part part, const char *kind) {
    lg_machine_term *term = &machine->terms[machine->term_count++];
    *term = (lg_machine_term){.kind = lg_term_kind_find(part, kind), .part = part};
    if (term->kind == NULL) fail_msg("no kind %s", kind);
    term->activation = LG_TANH;
    if ((lg_term_kind_options(term->kind) & LG_TERM_HIDDEN) != 0)
        term->hidden[0] = 5, term->hidden_layers = 1;
    if ((lg_term_kind_options(term->kind) & LG_TERM_DEGREE) != 0) term->degree = 2;
    term->width = 0.02;
    return term;
}

static inline void add_feature(lg_machine_term *term, lg_machine_sight kind, uint32_t index) {
    term->of[term->of_count++] = (lg_machine_feature){kind, index};
}

static inline void add_values(lg_machine_term *term, uint32_t count, const double *values) {
    term->value_count = count;
    memcpy(term->values, values, count * sizeof *values);
}

static inline lg_machine empty_machine(void) {
    lg_machine machine = {.coordinate_count = 0};
    lg_machine_scales_init(&machine.scales);
    return machine;
}

static inline void assert_machine(lg_machine *machine) {
    assert_told(lg_machine_init(machine, &told));
}

/* Gives the machine scales other than 1. A pose has one scale for its places and one for its forces. */
static inline void odd_scales(lg_machine *machine) {
    lg_machine_scales *s = &machine->scales;
    uint32_t place = 0, velocity = 0;
    s->time = 0.7;
    s->energy = 1.9;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        for (uint32_t k = 0; k < row->velocities; k++) {
            const bool length = kind != LG_COORDINATE_ANGLE && k < row->places;
            const double L = length ? 1.3 + 0.2 * i : 1.0;
            s->velocity[velocity + k] = L;
            if (k < row->places) s->place[place + k] = L;
        }
        place += row->places;
        velocity += row->velocities;
    }
    for (uint32_t j = 0; j < machine->input_count; j++) s->input[j] = 2.0 + j;
}

/* Random parameters from [-0.8, 0.8]. */
static inline double *machine_theta(const lg_machine *machine, uint64_t seed) {
    return test_numbers(seed, machine->parameters + 1, -0.8, 0.8);
}

/* `rows` random positions and velocities on the manifold, with their columns in the order of logs. */
static inline void random_rows(const lg_machine *machine, uint64_t seed, size_t rows, double *q, double *v) {
    lg_rng rng = test_rng(seed, 0);
    for (size_t r = 0; r < rows; r++)
        for (uint32_t i = 0; i < machine->coordinate_count; i++) {
            const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
            for (uint32_t k = 0; k < row->places; k++) *q++ = lg_rng_normal(&rng);
            for (uint32_t k = 0; k < row->velocities; k++) v[k] = lg_rng_normal(&rng);
            if (row->directions > 0) {
                lg_space sphere;
                double state[6];
                assert_ok(lg_space_init(&sphere, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
                for (int k = 0; k < 3; k++) state[k] = lg_rng_normal(&rng), state[3 + k] = v[k];
                lg_space_project(&sphere, state);
                for (int k = 0; k < 3; k++) *q++ = state[k], v[k] = state[3 + k];
            }
            if (row->rotations > 0) {
                const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
                lg_space group;
                double a[3];
                for (int k = 0; k < 3; k++) a[k] = lg_rng_normal(&rng);
                assert_ok(lg_space_init(&group, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
                lg_space_act(&group, a, unit, q);
                q += 9;
            }
            v += row->velocities;
        }
}

/* ---- a machine with every kind of coordinate ---- */

static inline void see_everything(const lg_machine *machine, lg_machine_term *term, bool moving,
                                  bool inputs) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        add_feature(term, LG_FEATURE_POSITION, i);
        if (moving) add_feature(term, LG_FEATURE_VELOCITY, i);
    }
    if (inputs) add_feature(term, LG_FEATURE_INPUT, 0);
}

/* A machine with a line, an angle, a direction, a rotation and a pose, and two inputs. */
static inline lg_machine all_coordinates(void) {
    lg_machine machine = empty_machine();
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++)
        add_coordinate(&machine, lg_coordinate_row_of((lg_coordinate_kind)kind)->name,
                       (lg_coordinate_kind)kind);
    add_input(&machine, "u");
    add_input(&machine, "w");
    odd_scales(&machine);
    return machine;
}

static inline double *some_values(uint32_t count) {
    return test_numbers(count, count, 0.3, 1.2);
}

/* How many values the term must have. */
static inline uint32_t fitting_values(const lg_machine *machine, const lg_machine_term *term) {
    if (term->part == LG_MACHINE_INPUT_MAP) return machine->velocities * machine->input_count;
    return machine->velocities;
}

/* The mass of a direction is one number. */
static inline void same_mass_of_directions(const lg_machine *machine, double *values) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        if (row->directions > 0) values[1] = values[2] = values[0];
        values += row->velocities;
    }
}

/* A machine with a mass, a potential and a term of this kind. */
static inline lg_machine machine_with(const lg_term_kind *kind, lg_machine_part part) {
    lg_machine machine = all_coordinates();
    machine.velocities = 14;
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    see_everything(&machine, add_term(&machine, LG_MACHINE_POTENTIAL, "network"), false, false);
    lg_machine_term *term = add_term(&machine, part, lg_term_kind_name(kind));
    const uint32_t options = lg_term_kind_options(kind);
    if (part == LG_MACHINE_BIAS)
        add_feature(term, LG_FEATURE_POSITION, 1), add_feature(term, LG_FEATURE_PLACE, 4),
            add_feature(term, LG_FEATURE_VELOCITY, 0), add_feature(term, LG_FEATURE_VELOCITY, 3);
    else if (part == LG_MACHINE_ACTUATOR)
        add_feature(term, LG_FEATURE_INPUT, 1);
    else if ((options & LG_TERM_OF) != 0 && (options & LG_TERM_HIDDEN) == 0)
        add_feature(term, LG_FEATURE_POSITION, 1), add_feature(term, LG_FEATURE_HEIGHT, 4);
    else if ((options & LG_TERM_OF) != 0)
        see_everything(&machine, term, (options & LG_TERM_MOVING) != 0, part == LG_MACHINE_RESIDUAL);
    if ((options & LG_TERM_KNOWN) != 0)
        add_values(term, fitting_values(&machine, term), some_values(fitting_values(&machine, term)));
    if (part == LG_MACHINE_MASS && term->value_count > 0) same_mass_of_directions(&machine, term->values);
    if (part != LG_MACHINE_INPUT_MAP) add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

/* Whether the mass of a machine without a system depends on the state: only a network makes it do so. */
static inline bool machine_moves(const lg_machine *machine) {
    for (uint32_t i = 0; i < machine->term_count; i++)
        if (machine->terms[i].part == LG_MACHINE_MASS &&
            (lg_term_kind_options(machine->terms[i].kind) & LG_TERM_HIDDEN) != 0)
            return true;
    return false;
}

/* Trains with Levenberg-Marquardt. theta is input and output: the parameters, followed by the starts where
 * starts are learned. */
static inline void fit_by_lm(const lg_fit_problem *problem, uint32_t epochs, double *theta) {
    lg_fit_options options;
    lg_fit *fit;
    lg_fit_options_init(&options);
    assert_ok(lg_fit_plan_parse("lm", true, &options.plan, NULL));
    options.epochs = epochs;
    assert_ok(lg_fit_create(NULL, problem, &options, theta, &fit, NULL));
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, theta);
    lg_fit_destroy(fit);
}

#endif
