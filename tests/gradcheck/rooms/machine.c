/* Gradient checks of every kind of term and every system of the tables: energy and field with respect to
 * state, parameters and input, and the training loss with measured and with estimated starts. */
#include <stdio.h>

#include "gradcheck/table.h"
#include "liegrad/machine.h"
#include "liegrad/ops.h"

enum { BATCH = 2, MOST_ROWS = 96, POINTS = 3, MOST_STATE = 64 };

typedef enum question { ENERGY, FIELD, LOSS } question;

/* What one case checks. It has copies of everything it needs. */
typedef struct settings {
    lg_machine machine;
    question asked;
    lg_machine_starts starts; /* only for LOSS */
    char name[96];
    lg_gradcheck_argument arguments[3];
} settings;

static settings all[MOST_ROWS];
static lg_gradcheck_case cases[MOST_ROWS];
static size_t rows;

/* ---- machines: a line, an angle, a direction, a rotation and a pose, with one term of each kind ---- */

static void add_coordinate(lg_machine *machine, const char *name, lg_coordinate_kind kind) {
    lg_machine_coordinate *c = &machine->coordinates[machine->coordinate_count++];
    (void)snprintf(c->name, sizeof c->name, "%s", name);
    c->kind = kind;
}

static lg_machine_term *add_term(lg_machine *machine, lg_machine_part part, const lg_term_kind *kind) {
    lg_machine_term *term = &machine->terms[machine->term_count++];
    *term = (lg_machine_term){.kind = kind, .part = part, .activation = LG_TANH, .width = 0.5};
    const uint32_t options = lg_term_kind_options(kind);
    if ((options & LG_TERM_HIDDEN) != 0) term->hidden_layers = 1, term->hidden[0] = 3;
    if ((options & LG_TERM_DEGREE) != 0) term->degree = 2;
    if (part == LG_MACHINE_ACTUATOR)
        term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_INPUT, 0};
    else if ((options & LG_TERM_OF) != 0)
        for (uint32_t i = 0; i < 2; i++)
            term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_POSITION, i};
    if ((options & LG_TERM_MOVING) != 0)
        term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_VELOCITY, 1};
    if ((options & LG_TERM_HIDDEN) != 0) term->of[term->of_count++] = (lg_machine_feature){LG_FEATURE_UP, 3};
    return term;
}

static void add_values(const lg_machine *machine, lg_machine_term *term) {
    if ((lg_term_kind_options(term->kind) & LG_TERM_KNOWN) == 0) return;
    term->value_count = machine->velocities * (term->part == LG_MACHINE_INPUT_MAP ? machine->input_count : 1);
    for (uint32_t i = 0; i < term->value_count; i++) term->values[i] = 0.5 + 0.1 * i;
}

static bool make_machine(lg_machine_part part, const lg_term_kind *kind, lg_machine *out) {
    *out = (lg_machine){.input_count = 1, .velocities = 14};
    lg_machine_scales_init(&out->scales);
    for (int k = 0; k < LG_COORDINATE_KIND_COUNT; k++)
        add_coordinate(out, lg_coordinate_row_of((lg_coordinate_kind)k)->name, (lg_coordinate_kind)k);
    (void)snprintf(out->inputs[0], sizeof out->inputs[0], "u");
    (void)add_term(out, LG_MACHINE_MASS, lg_term_kind_find(LG_MACHINE_MASS, "diagonal"));
    (void)add_term(out, LG_MACHINE_POTENTIAL, lg_term_kind_find(LG_MACHINE_POTENTIAL, "gravity"));
    add_values(out, add_term(out, part, kind));
    if (part != LG_MACHINE_INPUT_MAP)
        (void)add_term(out, LG_MACHINE_INPUT_MAP, lg_term_kind_find(LG_MACHINE_INPUT_MAP, "constant"));
    return lg_machine_init(out, NULL) == LG_OK;
}

/* ---- logs and recordings ---- */

/* A log of BATCH parts of POINTS rows. The rows of a part need not be a solution of the equations. */
typedef struct data {
    double t[BATCH * POINTS], q[BATCH * POINTS * LG_MACHINE_POSITIONS],
        v[BATCH * POINTS * LG_MACHINE_VELOCITIES], u[BATCH * POINTS * 4];
    size_t first[BATCH + 1], start[BATCH];
} data;

static void fill(const lg_machine *machine, data *d) {
    static const double R[2][9] = {{1, 0, 0, 0, 0.6, -0.8, 0, 0.8, 0.6}, {0, -1, 0, 1, 0, 0, 0, 0, 1}};
    const double numbers[] = {0.3, -0.7, 0.5, 0.9, -0.2, 0.6, -0.4};
    double *q = d->q, *v = d->v;
    for (size_t row = 0; row < BATCH * POINTS; row++) {
        d->t[row] = 0.1 * (double)row;
        d->first[row / POINTS] = d->start[row / POINTS] = row / POINTS * POINTS;
        for (int k = 0; k < 4; k++) d->u[4 * row + k] = numbers[(row + k) % LG_COUNT(numbers)];
        for (uint32_t i = 0; i < machine->coordinate_count; i++) {
            const lg_coordinate_row *kind = lg_coordinate_row_of(machine->coordinates[i].kind);
            for (uint32_t k = 0; k < kind->places; k++) *q++ = numbers[(row + k) % LG_COUNT(numbers)];
            for (uint32_t k = 0; k < 3 * kind->directions; k++) *q++ = R[row % 2][k];
            for (uint32_t k = 0; k < 9 * kind->rotations; k++) *q++ = R[row % 2][k];
            for (uint32_t k = 0; k < kind->velocities; k++) *v++ = numbers[(row + k + i) % LG_COUNT(numbers)];
        }
    }
    d->first[BATCH] = BATCH * POINTS;
}

static lg_machine_problem problem_of(const settings *s, const data *d) {
    lg_machine_problem problem = {
        .machine = &s->machine,
        .scheme = lg_scheme_find("cf4"),
        .substeps = 1,
        .window = POINTS,
        .starts = s->starts,
        .log = {BATCH * POINTS, BATCH, d->first, d->t, d->q, d->v, d->u, NULL, NULL, NULL},
        .windows = BATCH,
        .start = d->start,
    };
    for (uint32_t i = 0; i < LG_MACHINE_COORDINATES; i++)
        problem.position_scale[i] = problem.velocity_scale[i] = 0.5;
    return problem;
}

static lg_var build_loss(const settings *s, lg_tape *tape, lg_var theta) {
    static const uint32_t samples[BATCH] = {0, 1};
    data d;
    lg_fit_problem fit;
    lg_var r = LG_NONE;
    fill(&s->machine, &d);
    const lg_machine_problem problem = problem_of(s, &d);
    lg_machine_fit_problem(&problem, &fit);
    const lg_status status = fit.residuals(fit.user, tape, theta, samples, BATCH, BATCH, &r);
    return status == LG_OK ? lg_sum(tape, lg_square(tape, r))
                           : lg_tape_fail(tape, status, "machine", "the loss failed");
}

/* x: for LOSS theta alone; else the state (B, d), theta and, for FIELD, the input. */
static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    const settings *s = user;
    lg_machine_vars vars;
    lg_space space;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS], flat[LG_TAPED_MAX_PARTS];
    if (s->asked == LOSS) return build_loss(s, tape, x[0]);
    if (lg_machine_bind(tape, &s->machine, x[1], &vars) != LG_OK ||
        lg_machine_space(&s->machine, &space) != LG_OK || lg_taped_split(tape, &space, x[0], parts) != LG_OK)
        return LG_NONE;
    if (s->asked == ENERGY) return lg_machine_record_energy(tape, &vars, parts);
    if (lg_machine_record_field(tape, &vars, parts, x[2], algebra) != LG_OK) return LG_NONE;
    const size_t count = lg_taped_parts(&space);
    for (size_t i = 0; i < count; i++) {
        const uint32_t numbers = (uint32_t)lg_shape_count(lg_var_shape(tape, algebra[i])) / BATCH;
        flat[i] = lg_reshape(tape, algebra[i], lg_shape2(BATCH, numbers));
    }
    return lg_concat(tape, flat, count, 1);
}

/* ---- list of cases ---- */

static lg_gradcheck_argument vectors(size_t width) {
    return (lg_gradcheck_argument){.shape = {2, {BATCH, (uint32_t)width}}, .low = 0.2, .high = 0.9};
}

static void add_row(const lg_machine *machine, question what, lg_machine_starts starts, const char *label) {
    settings *s = &all[rows];
    lg_space space;
    size_t inputs = 0;
    if (rows == MOST_ROWS || lg_machine_space(machine, &space) != LG_OK) return;
    *s = (settings){.machine = *machine, .asked = what, .starts = starts};
    (void)snprintf(s->name, sizeof s->name, "machine %s", label);
    data d;
    const lg_machine_problem problem = problem_of(s, &d);
    const size_t theta = what == LOSS ? lg_machine_problem_parameters(&problem) : machine->parameters;
    if (what != LOSS) s->arguments[inputs++] = vectors(space.dim);
    s->arguments[inputs++] =
        (lg_gradcheck_argument){.shape = {1, {(uint32_t)theta}}, .low = 0.1, .high = 0.5};
    if (what == FIELD) s->arguments[inputs++] = vectors(machine->input_count);
    cases[rows++].function = (lg_gradcheck_function){
        .name = s->name, .inputs = (uint32_t)inputs, .arguments = s->arguments, .build = build, .user = s};
}

/* A machine of the system in which all parameters are unknown. */
static bool make_system(const lg_energy_row *system, lg_machine *out) {
    static const double start = 9.0;
    static const bool unknown = true;
    const uint32_t wanted = system->count, count = wanted > 0 ? wanted : 2;
    *out = (lg_machine){.input_count = 1};
    lg_machine_scales_init(&out->scales);
    for (uint32_t i = 0; i < count; i++) {
        const char name[] = {(char)('a' + i), '\0'};
        add_coordinate(out, name, system->coordinates[wanted > 0 ? i : 0]);
    }
    (void)snprintf(out->inputs[0], sizeof out->inputs[0], "u");
    if (lg_machine_set_system(out, system->name, NULL) != LG_OK) return false;
    for (const lg_parameter_entry *p = system->parameters; p->key != NULL; p++) {
        const bool given = p->fallback == NULL && p->rule != LG_PARAMETER_POSITIVE;
        if (lg_machine_set_parameter(out, p->key, given ? p->count : 0, &start, &unknown, NULL) != LG_OK)
            return false;
    }
    (void)add_term(out, LG_MACHINE_INPUT_MAP, lg_term_kind_find(LG_MACHINE_INPUT_MAP, "constant"));
    return lg_machine_init(out, NULL) == LG_OK;
}

static void add_system(const lg_energy_row *system) {
    static const char *const names[] = {[ENERGY] = "energy", [FIELD] = "field"};
    lg_machine machine;
    char label[64];
    if (!make_system(system, &machine)) return;
    for (int what = ENERGY; what <= FIELD; what++) {
        (void)snprintf(label, sizeof label, "%s, %s", system->name, names[what]);
        add_row(&machine, (question)what, LG_MACHINE_STARTS_MEASURED, label);
    }
}

static void add_kind(lg_machine_part part, const lg_term_kind *kind) {
    lg_machine machine;
    char label[64];
    if (!make_machine(part, kind, &machine)) return;
    if (part == LG_MACHINE_BIAS) {
        add_row(&machine, LOSS, LG_MACHINE_STARTS_MEASURED, "loss with biases");
        return;
    }
    if (part == LG_MACHINE_ACTUATOR) {
        (void)snprintf(label, sizeof label, "loss with %s", lg_term_kind_name(kind));
        add_row(&machine, LOSS, LG_MACHINE_STARTS_MEASURED, label);
        /* The lagged inputs of the log are computed outside of the tape, for one value of the lag. */
        if (machine.lags > 0) cases[rows - 1].no_program = "a constant";
    }
    (void)snprintf(label, sizeof label, "%s %s, field", lg_machine_part_name(part), lg_term_kind_name(kind));
    add_row(&machine, FIELD, LG_MACHINE_STARTS_MEASURED, label);
    if (part > LG_MACHINE_POTENTIAL) return;
    (void)snprintf(label, sizeof label, "%s %s, energy", lg_machine_part_name(part), lg_term_kind_name(kind));
    add_row(&machine, ENERGY, LG_MACHINE_STARTS_MEASURED, label);
}

static void add_all(void) {
    const lg_term_kind *kind;
    lg_machine machine;
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++)
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++)
            add_kind((lg_machine_part)part, kind);
    const lg_energy_row *system;
    for (size_t i = 0; (system = lg_grey_system_at(i)) != NULL; i++) add_system(system);
    if (!make_machine(LG_MACHINE_DAMPING, lg_term_kind_find(LG_MACHINE_DAMPING, "diagonal"), &machine))
        return;
    add_row(&machine, LOSS, LG_MACHINE_STARTS_MEASURED, "loss");
    add_row(&machine, LOSS, LG_MACHINE_STARTS_ESTIMATED, "loss with estimated starts");
}

const lg_gradcheck_case *lg_gradcheck_machine(size_t *count) {
    static bool made;
    if (!made) add_all();
    made = true;
    *count = rows;
    return cases;
}
