/* Machines: their equations compared with their energy and with closed forms, for every kind of coordinate
 * and term. */
#include "liegrad/ops.h"

#include "support/machine_support.h"

#include "machine/internal.h"

enum { MOST_NUMBERS = 256, ROWS = 3, MOST = ROWS * (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES) };

/* The machine recorded on a tape, for random rows. */
typedef struct setting {
    lg_tape *tape;
    lg_machine_vars vars;
    lg_space space;
    double q[MOST], v[MOST], input[ROWS * LG_MACHINE_INPUTS];
    lg_var parts[LG_TAPED_MAX_PARTS], velocities, rates, u;
} setting;

static setting *record_at(const lg_machine *machine, const double *numbers) {
    setting *s = TEST_ARRAY(setting, 1);
    s->tape = test_tape(LG_F64);
    const lg_var theta = machine->parameters == 0
                             ? LG_NONE
                             : lg_parameter(s->tape, lg_shape1((uint32_t)machine->parameters), numbers);
    assert_ok(lg_machine_bind(s->tape, machine, theta, &s->vars));
    assert_ok(lg_machine_space(machine, &s->space));
    random_rows(machine, 7, ROWS, s->q, s->v);
    memcpy(s->input, test_numbers(3, ROWS * LG_MACHINE_INPUTS, -1, 1), sizeof s->input);
    const lg_var q = lg_input_f64(s->tape, lg_shape2(ROWS, machine->positions), s->q),
                 v = lg_input_f64(s->tape, lg_shape2(ROWS, machine->velocities), s->v);
    assert_ok(lg_machine_record_state(s->tape, &s->vars, q, v, s->parts));
    /* Makes the momenta independent variables. */
    for (size_t i = 0; i < lg_taped_parts(&s->space); i++)
        s->parts[i] = lg_stop_gradient(s->tape, s->parts[i]);
    if (machine->input_count > 0)
        s->u = lg_input_f64(s->tape, lg_shape2(ROWS, machine->input_count), s->input);
    s->velocities = lg_machine_record_velocities(s->tape, &s->vars, s->parts);
    s->rates = lg_machine_record_rates(s->tape, &s->vars, s->parts);
    if (lg_tape_status(s->tape) != LG_OK) fail_msg("%s", lg_tape_message(s->tape));
    return s;
}

static setting *record(const lg_machine *machine) {
    return record_at(machine, machine_theta(machine, 5));
}

TEST("positions and velocities can be recovered from the state, with every kind of mass and bias") {
    const lg_term_kind *kind;
    for (int part = LG_MACHINE_MASS; part <= LG_MACHINE_BIAS; part += LG_MACHINE_BIAS - LG_MACHINE_MASS)
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            setting *s = record(&machine);
            assert_reads(s->tape, lg_machine_record_positions(s->tape, &s->vars, s->parts),
                         ROWS * machine.positions, s->q, 1e-14, 1e-14);
            assert_reads(s->tape, s->velocities, ROWS * machine.velocities, s->v, 1e-11, 1e-11);
        }
}

/* dH/dt along the field must be v.f, the power of all forces. */
static void assert_energy_balance(const lg_machine *machine) {
    setting *s = record(machine);
    const size_t parts = lg_taped_parts(&s->space);
    lg_var algebra[LG_TAPED_MAX_PARTS], rate[LG_TAPED_MAX_PARTS], change;
    assert_ok(lg_machine_record_field(s->tape, &s->vars, s->parts, s->u, algebra));
    assert_ok(lg_taped_generator(s->tape, &s->space, algebra, s->parts, rate));
    const lg_var H = lg_machine_record_energy(s->tape, &s->vars, s->parts);
    assert_ok(lg_jvp(s->tape, &H, 1, s->parts, rate, parts, &change));
    lg_var power = lg_full(s->tape, lg_shape2(ROWS, 1), 0.0);
    static const lg_machine_part forces[] = {LG_MACHINE_DAMPING, LG_MACHINE_INPUT_MAP, LG_MACHINE_RESIDUAL,
                                             LG_MACHINE_OFFSET};
    for (size_t i = 0; i < LG_COUNT(forces); i++) {
        const lg_var f = lg_machine_record_force(s->tape, &s->vars, forces[i], s->parts, s->rates, s->u);
        if (!lg_is_none(f)) power = lg_add(s->tape, power, lg_rowdot(s->tape, s->rates, f));
    }
    double expected[ROWS];
    if (lg_tape_status(s->tape) != LG_OK) fail_msg("%s", lg_tape_message(s->tape));
    assert_ok(lg_read(s->tape, power, ROWS, expected));
    assert_true(fabs(expected[0]) > 1e-3);
    assert_reads(s->tape, change, ROWS, expected, 1e-11, 1e-11);
}

TEST("the energy changes by the power of the forces, with every kind of term") {
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            assert_energy_balance(&machine);
        }
    }
}

TEST("damping of every kind takes energy away for any parameters, and acts on the coordinates it damps") {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, i)) != NULL; i++) {
        const lg_machine machine = machine_with(kind, LG_MACHINE_DAMPING);
        setting *s = record(&machine);
        double power[ROWS];
        const lg_var f =
            lg_machine_record_force(s->tape, &s->vars, LG_MACHINE_DAMPING, s->parts, s->rates, s->u);
        assert_ok(lg_read(s->tape, lg_rowdot(s->tape, s->rates, f), ROWS, power));
        for (int r = 0; r < ROWS; r++) assert_true(power[r] < -1e-4);
    }
}

/* ---- numbers in the units of logs ---- */

/* Kinds whose numbers can be used as values of the same kind, or of another one. */
static const struct {
    lg_machine_part part;
    const char *kind, *known;
} exchanged[] = {
    {LG_MACHINE_POTENTIAL, "linear", "linear"},       {LG_MACHINE_POTENTIAL, "gravity", "gravity"},
    {LG_MACHINE_POTENTIAL, "quadratic", "quadratic"}, {LG_MACHINE_POTENTIAL, "polynomial", "polynomial"},
    {LG_MACHINE_DAMPING, "diagonal", "known"},        {LG_MACHINE_DAMPING, "coulomb", "coulomb"},
    {LG_MACHINE_DAMPING, "quadratic", "quadratic"},   {LG_MACHINE_INPUT_MAP, "constant", "known"},
    {LG_MACHINE_DAMPING, "cubic", "cubic"},           {LG_MACHINE_DAMPING, "asymmetric", "asymmetric"},
    {LG_MACHINE_DAMPING, "stribeck", "stribeck"},     {LG_MACHINE_DAMPING, "load", "load"},
    {LG_MACHINE_DAMPING, "position", "position"},     {LG_MACHINE_DAMPING, "lugre", "lugre"},
    {LG_MACHINE_OFFSET, "unknown", "known"},          {LG_MACHINE_ACTUATOR, "curve", "curve"},
    {LG_MACHINE_ACTUATOR, "dead_zone", "dead_zone"},
};

/* The effect of the term at some rows: the energy, or the force of its part. */
static void effect_of(const lg_machine *machine, lg_machine_part part, double *out) {
    setting *s = record(machine);
    const lg_var y = part == LG_MACHINE_POTENTIAL
                         ? lg_machine_record_energy(s->tape, &s->vars, s->parts)
                         : lg_machine_record_force(s->tape, &s->vars, part, s->parts, s->rates, s->u);
    assert_ok(lg_read(s->tape, y, lg_shape_count(lg_var_shape(s->tape, y)), out));
}

TEST("identified numbers, used as values of known terms, have the same effect at any scales") {
    for (size_t i = 0; i < LG_COUNT(exchanged); i++) {
        lg_machine free = all_coordinates();
        lg_identified numbers[MOST_NUMBERS];
        double before[MOST] = {0}, after[MOST] = {0}, masses[14];
        for (int k = 0; k < 14; k++) masses[k] = 1.0;
        add_values(add_term(&free, LG_MACHINE_MASS, "known"), 14, masses);
        lg_machine_term *term = add_term(&free, exchanged[i].part, exchanged[i].kind);
        if (exchanged[i].part == LG_MACHINE_ACTUATOR)
            add_feature(term, LG_FEATURE_INPUT, 1), add_feature(term, LG_FEATURE_INPUT, 0);
        else if ((lg_term_kind_options(term->kind) & LG_TERM_OF) != 0)
            add_feature(term, LG_FEATURE_POSITION, 0), add_feature(term, LG_FEATURE_POSITION, 4);
        if ((lg_term_kind_options(term->kind) & LG_TERM_INPUTS) != 0)
            add_feature(term, LG_FEATURE_INPUT, 0), add_feature(term, LG_FEATURE_INPUT, 1);
        if (exchanged[i].part != LG_MACHINE_INPUT_MAP)
            add_values(add_term(&free, LG_MACHINE_INPUT_MAP, "known"), 28, some_values(28));
        assert_machine(&free);
        const size_t count = lg_machine_numbers(&free, machine_theta(&free, 5), MOST_NUMBERS, numbers);
        assert_true(count > 0 && count == free.parameters && count <= MOST_NUMBERS);
        lg_machine known = free;
        known.terms[1].kind = lg_term_kind_find(exchanged[i].part, exchanged[i].known);
        known.terms[1].value_count = (uint32_t)count;
        for (size_t k = 0; k < count; k++) known.terms[1].values[k] = numbers[k].value;
        assert_machine(&known);
        assert_int_equal(known.parameters, 0);
        effect_of(&free, exchanged[i].part, before);
        effect_of(&known, exchanged[i].part, after);
        assert_all_close(after, before, MOST, 1e-12, 1e-13);
    }
}

/* Compares M of the network at `positions`, in the log's units, with energies at q, in scaled units. */
static void expect_mass_at(const double *positions, const double *q);

TEST("the numbers of a mass that is a network are M at one position: twice the energy of unit velocities") {
    expect_mass_at(NULL, (const double[]){0, 0});
    expect_mass_at((const double[]){0.3, -0.9}, (const double[]){0.3 / 1.3, -0.9});
}

static void expect_mass_at(const double *positions, const double *q) {
    lg_machine machine = empty_machine();
    lg_identified numbers[3];
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    odd_scales(&machine);
    lg_machine_term *mass = add_term(&machine, LG_MACHINE_MASS, "network");
    add_feature(mass, LG_FEATURE_POSITION, 0);
    add_feature(mass, LG_FEATURE_POSITION, 1);
    assert_machine(&machine);
    const double *theta = machine_theta(&machine, 8), *units = machine.scales.velocity;
    assert_int_equal(lg_machine_numbers_at(&machine, theta, positions, 3, numbers, NULL), 3);
    const double M[3] = {numbers[0].value, numbers[2].value, numbers[1].value}; /* M11, M22, M12 */
    assert_string_equal(numbers[1].name, "mass.1.2");
    for (int k = 0; k < 3; k++) {
        lg_tape *tape = test_tape(LG_F64);
        lg_machine_vars vars;
        lg_var parts[LG_TAPED_MAX_PARTS];
        double energy;
        const double speed[2] = {k != 1 ? machine.scales.time / units[0] : 0.0,
                                 k != 0 ? machine.scales.time / units[1] : 0.0};
        assert_ok(lg_machine_bind(tape, &machine,
                                  lg_parameter(tape, lg_shape1((uint32_t)machine.parameters), theta), &vars));
        assert_ok(lg_machine_record_state(tape, &vars, lg_input_f64(tape, lg_shape2(1, 2), q),
                                          lg_input_f64(tape, lg_shape2(1, 2), speed), parts));
        assert_ok(lg_read(tape, lg_machine_record_energy(tape, &vars, parts), 1, &energy));
        const double expected = k < 2 ? M[k] : M[0] + M[1] + 2 * M[2];
        assert_close(2 * energy * machine.scales.energy, expected, 1e-12, 1e-12);
    }
}

/* ---- free flight of a rigid body, known in closed form ---- */

enum { STEPS = 20 };

TEST("a thrown rigid body follows a parabola and keeps its angular momentum in space, in the log's units") {
    const double g = 9.81, m[6] = {2, 2, 2, 0.3, 0.5, 0.7}, weight[1] = {2 * 9.81};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "body", LG_COORDINATE_POSE);
    odd_scales(&machine);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 6, m);
    add_values(add_term(&machine, LG_MACHINE_POTENTIAL, "gravity"), 1, weight);
    assert_machine(&machine);
    double q[(STEPS + 1) * 12], v[(STEPS + 1) * 6], t[STEPS + 1], q1[(STEPS + 1) * 12], v1[(STEPS + 1) * 6];
    const size_t first[2] = {0, STEPS + 1}, start = 0;
    random_rows(&machine, 9, STEPS + 1, q, v);
    for (int i = 0; i <= STEPS; i++) t[i] = 0.02 * i;
    const lg_machine_log log = {STEPS + 1, 1, first, t, q, v, NULL, NULL, NULL, NULL};
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 4, &log, &start, 1, STEPS,
                                  q1, v1, NULL));
    for (int i = 0; i < 12; i++)
        assert_close(q1[i], q[i], 1e-12, 1e-12); /* the first point is the logged one */
    for (int i = 0; i < 6; i++) assert_close(v1[i], v[i], 1e-12, 1e-12);
    double velocity[3], momentum[2][3];
    for (int i = 0; i < 3; i++) {
        const double *R = q + 3 + 3 * i;
        velocity[i] = R[0] * v[0] + R[1] * v[1] + R[2] * v[2];
        for (int end = 0; end < 2; end++) {
            const double *Re = q1 + end * STEPS * 12 + 3 + 3 * i, *w = v1 + end * STEPS * 6 + 3;
            momentum[end][i] = Re[0] * m[3] * w[0] + Re[1] * m[4] * w[1] + Re[2] * m[5] * w[2];
        }
    }
    for (int i = 0; i < 3; i++) {
        const double T = t[STEPS], x = q[i] + velocity[i] * T - (i == 2 ? 0.5 * g * T * T : 0.0);
        assert_close(q1[STEPS * 12 + i], x, 1e-9, 1e-9);
        assert_close(momentum[1][i], momentum[0][i], 1e-9, 1e-9);
    }
}

/* ---- what is refused ---- */

TEST("descriptions that do not fit are refused with a message") {
    static const struct {
        lg_machine_part part;
        const char *kind;
        uint32_t values, features;
        const char *sentence;
    } rows[] = {
        {LG_MACHINE_POTENTIAL, "network", 0, 0, "needs `of`"},
        {LG_MACHINE_DAMPING, "known", 3, 0, "has 3 values, expected 2 or 4"},
        {LG_MACHINE_INPUT_MAP, "known", 1, 0, "has 1 values, expected 2"},
        {LG_MACHINE_POTENTIAL, "polynomial", 0, 1, "degree"},
        {LG_MACHINE_DAMPING, "coulomb", 0, 0, "width"},
        {LG_MACHINE_DAMPING, "load", 0, 0, "needs `of`, the inputs"},
        {LG_MACHINE_DAMPING, "stribeck", 4, 0, "expected 6"},
        {LG_MACHINE_OFFSET, "known", 1, 0, "has 1 values, expected 2"},
        {LG_MACHINE_OFFSET, "known", 0, 0, "has 0 values, expected 2"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        lg_machine machine = empty_machine();
        add_coordinate(&machine, "x", LG_COORDINATE_LINE);
        add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
        add_input(&machine, "u");
        add_term(&machine, LG_MACHINE_MASS, "constant");
        add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
        assert_machine(&machine);
        lg_machine_term *term = add_term(&machine, rows[i].part, rows[i].kind);
        if (rows[i].values > 0) add_values(term, rows[i].values, some_values(rows[i].values));
        for (uint32_t k = 0; k < rows[i].features; k++) add_feature(term, LG_FEATURE_POSITION, k);
        term->degree = 0;
        term->width = strcmp(rows[i].sentence, "width") == 0 ? -1 : 0;
        assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
    }
}

/* A line and an angle with one input, a constant mass and a constant input map. */
static lg_machine sound(void) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_term(&machine, LG_MACHINE_MASS, "constant");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

/* The sound machine after `change`, statements about `m`, must be refused with the sentence. */
#define REFUSED(sentence, ...)                                                                               \
    do {                                                                                                     \
        lg_error error_ = {LG_OK, ""};                                                                       \
        lg_machine machine_ = sound(), *m = &machine_;                                                       \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_machine_init(m, &error_), LG_INVALID_ARGUMENT);                                     \
        assert_says(error_.message, sentence);                                                               \
    } while (0)
#define TERM(part, kind)               add_term(m, LG_MACHINE_##part, kind)
#define OF(part, kind, feature, index) with_feature(TERM(part, kind), LG_FEATURE_##feature, index)
static lg_machine_term *with_feature(lg_machine_term *term, lg_machine_sight kind, uint32_t index) {
    add_feature(term, kind, index);
    return term;
}

TEST("machines beyond the limits, without a mass or an input map, or with terms of no kind are refused") {
    static const double skew[] = {2, 0.5, 0.4, 1};
    REFUSED("a machine has 1 to 12 coordinates", m->coordinate_count = 0);
    REFUSED("a machine has 1 to 12 coordinates", m->coordinate_count = LG_MACHINE_COORDINATES + 1);
    REFUSED("up to 16 inputs", m->input_count = LG_MACHINE_INPUTS + 1);
    REFUSED("up to 16 terms", m->term_count = LG_MACHINE_TERMS + 1);
    REFUSED("coordinate 2 has an unknown kind", m->coordinates[1].kind = LG_COORDINATE_KIND_COUNT);
    REFUSED("18 velocities; at most 16", m->coordinates[0].kind = m->coordinates[1].kind = LG_COORDINATE_POSE,
            add_coordinate(m, "b", LG_COORDINATE_POSE));
    REFUSED("two coordinates are called a", add_coordinate(m, "a", LG_COORDINATE_LINE));
    REFUSED("a term has no kind", m->terms[0].kind = NULL);
    REFUSED("a term has no kind", TERM(DAMPING, "asymmetric"), TERM(DAMPING, "diagonal")->kind = NULL);
    REFUSED("a kind of another part", m->terms[0].part = LG_MACHINE_DAMPING);
    REFUSED("a machine needs a mass", m->terms[0] = m->terms[--m->term_count]);
    REFUSED("there are inputs, but no input_map", m->term_count = 1);
    REFUSED("the mass of a direction is one number", m->coordinates[1].kind = LG_COORDINATE_DIRECTION,
            m->terms[0] = *OF(MASS, "network", POSITION, 0), m->term_count = 2);
    REFUSED("must be symmetric", m->term_count = 0, add_values(TERM(MASS, "known"), 4, skew),
            TERM(INPUT_MAP, "constant"));
    REFUSED("has 1 values, expected 0", m->terms[0].value_count = 1);
    REFUSED("an input has two lags", OF(ACTUATOR, "lag", INPUT, 0),
            OF(ACTUATOR, "second_order_lag", INPUT, 0));
    assert_null(lg_machine_part_name(LG_MACHINE_PART_COUNT));
}

TEST("terms that depend on what they cannot see, or are too large, are refused") {
    static const char none[] = "cannot depend on what `of` lists";
    REFUSED(none, OF(POTENTIAL, "network", POSITION, 2));
    REFUSED(none, OF(RESIDUAL, "network", INPUT, 1));
    REFUSED(none, OF(POTENTIAL, "network", INPUT, 0));
    REFUSED(none, OF(POTENTIAL, "network", VELOCITY, 0));
    REFUSED(none, OF(ACTUATOR, "dead_zone", POSITION, 0));
    REFUSED(none, OF(DAMPING, "load", POSITION, 0));
    REFUSED(none, OF(OFFSET, "unknown", VELOCITY, 0));
    REFUSED(none, OF(BIAS, "constant", HEIGHT, 0));
    REFUSED(none, OF(BIAS, "constant", POSITION, 1), m->coordinates[1].kind = LG_COORDINATE_DIRECTION);
    REFUSED(none, OF(BIAS, "constant", POSITION, 1), m->coordinates[1].kind = LG_COORDINATE_ROTATION);
    for (int kind = LG_COORDINATE_LINE; kind < LG_COORDINATE_POSE; kind++) {
        REFUSED(none, OF(POTENTIAL, "network", PLACE, 1), m->coordinates[1].kind = (lg_coordinate_kind)kind);
        REFUSED(none, OF(POTENTIAL, "network", ROTATION, 1),
                m->coordinates[1].kind = (lg_coordinate_kind)kind);
    }
    REFUSED(none, OF(POTENTIAL, "network", UP, 1));
    REFUSED("too many features or layers", TERM(POTENTIAL, "network")->of_count = LG_MACHINE_FEATURES + 1);
    REFUSED("too many features or layers", OF(POTENTIAL, "network", POSITION, 0),
            m->terms[2].hidden_layers = LG_MACHINE_HIDDEN + 1);
    REFUSED("a network of this size cannot be made", OF(POTENTIAL, "network", POSITION, 0),
            m->terms[2].hidden[0] = 0);
    REFUSED("the degree must be 1 to 8", OF(POTENTIAL, "polynomial", POSITION, 0), m->terms[2].degree = 9);
    REFUSED("the degree must be 2 to 8", OF(ACTUATOR, "curve", INPUT, 0), m->terms[2].degree = 1);
    REFUSED("has too many monomials", OF(POTENTIAL, "polynomial", POSITION, 0),
            add_feature(&m->terms[2], LG_FEATURE_POSITION, 1), m->terms[2].degree = 8);
    REFUSED("has too many monomials", OF(RESIDUAL, "polynomial", POSITION, 0),
            add_feature(&m->terms[2], LG_FEATURE_POSITION, 1), m->terms[2].degree = 8);
    REFUSED("the width must be above 0", TERM(DAMPING, "coulomb")->width = INFINITY);
}

TEST(
    "known damping of zeros is accepted, a residual may take the place of the input map, and gravity without "
    "`of` acts on heights") {
    static const double none[2] = {0, 0};
    lg_machine machine = sound();
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "known"), 2, none);
    assert_machine(&machine);
    machine = sound();
    lg_machine_term *term = &machine.terms[1];
    *term = (lg_machine_term){.kind = lg_term_kind_find(LG_MACHINE_RESIDUAL, "polynomial"),
                              .part = LG_MACHINE_RESIDUAL,
                              .degree = 1};
    add_feature(term, LG_FEATURE_INPUT, 0);
    assert_machine(&machine);
    machine = sound();
    term = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    assert_machine(&machine);
    assert_int_equal(term->of_count, 1); /* not the line */
    assert_true(term->of[0].index == 1 && term->of[0].kind == LG_FEATURE_HEIGHT);
}

TEST("initial parameters are finite, and damping with them takes energy away, with every kind of term") {
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            double *theta = TEST_ARRAY(double, machine.parameters + 1), power[ROWS];
            lg_identified numbers[MOST_NUMBERS];
            lg_rng rng = test_rng(1, 2);
            for (size_t k = 0; k < machine.parameters; k++) theta[k] = (double)NAN;
            lg_machine_initialise(&machine, &rng, theta);
            for (size_t k = 0; k < machine.parameters; k++) assert_true(isfinite(theta[k]));
            const size_t count = lg_machine_numbers(&machine, theta, MOST_NUMBERS, numbers);
            for (size_t k = 0; k < count; k++) assert_true(isfinite(numbers[k].value));
            if (part != LG_MACHINE_DAMPING) continue;
            setting *s = record_at(&machine, theta);
            const lg_var f =
                lg_machine_record_force(s->tape, &s->vars, LG_MACHINE_DAMPING, s->parts, s->rates, s->u);
            assert_ok(lg_read(s->tape, lg_rowdot(s->tape, s->rates, f), ROWS, power));
            for (int r = 0; r < ROWS; r++) assert_true(power[r] < 0);
        }
    }
}

TEST("initially input j drives velocity j, however many inputs there are") {
    lg_machine machine = empty_machine();
    double theta[3] = {NAN, NAN, NAN};
    lg_rng rng = test_rng(1, 2);
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    for (int i = 0; i < 2; i++) add_input(&machine, i == 0 ? "u" : "w");
    const double one = 1;
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 1, &one);
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    lg_machine_initialise(&machine, &rng, theta);
    assert_true(theta[0] == 1 && theta[1] == 0);
}
