/* Machines: their equations against their energy and against solutions known in closed form; every kind of
 * coordinate and of term. */
#include "models/machine_support.h"

enum { ROWS = 3, MOST = ROWS * (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES) };

/* ---- one machine with every kind of coordinate ---- */

static void see_everything(const lg_machine *machine, lg_machine_term *term, bool moving, bool inputs) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        add_feature(term, LG_FEATURE_POSITION, i);
        if (moving) add_feature(term, LG_FEATURE_VELOCITY, i);
    }
    if (inputs) add_feature(term, LG_FEATURE_INPUT, 0);
}

/* Line, angle, direction, rotation, pose. */
static lg_machine all_coordinates(void) {
    lg_machine machine = empty_machine();
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++)
        add_coordinate(&machine, lg_coordinate_row_of((lg_coordinate_kind)kind)->name,
                       (lg_coordinate_kind)kind);
    add_input(&machine, "u");
    add_input(&machine, "w");
    odd_scales(&machine);
    return machine;
}

static double *some_values(uint32_t count) {
    return test_numbers(count, count, 0.3, 1.2);
}

/* The values that a term of this kind may have. */
static uint32_t fitting_values(const lg_machine *machine, const lg_machine_term *term) {
    if (term->part == LG_MACHINE_INPUT_MAP) return machine->velocities * machine->input_count;
    return machine->velocities;
}

/* A machine with one term of the kind, a mass and a potential. */
static lg_machine machine_with(const lg_term_kind *kind, lg_machine_part part) {
    lg_machine machine = all_coordinates();
    machine.velocities = 14;
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    see_everything(&machine, add_term(&machine, LG_MACHINE_POTENTIAL, "network"), false, false);
    lg_machine_term *term = add_term(&machine, part, lg_term_kind_name(kind));
    const uint32_t options = lg_term_kind_options(kind);
    if ((options & LG_TERM_OF) != 0 && (options & LG_TERM_HIDDEN) == 0)
        add_feature(term, LG_FEATURE_POSITION, 1), add_feature(term, LG_FEATURE_HEIGHT, 4);
    else if ((options & LG_TERM_OF) != 0)
        see_everything(&machine, term, (options & LG_TERM_MOVING) != 0, part == LG_MACHINE_RESIDUAL);
    if ((options & LG_TERM_KNOWN) != 0)
        add_values(term, fitting_values(&machine, term), some_values(fitting_values(&machine, term)));
    if (part != LG_MACHINE_INPUT_MAP) add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

/* The machine on a tape with random rows. */
typedef struct setting {
    lg_tape *tape;
    lg_machine_vars vars;
    lg_space space;
    double q[MOST], v[MOST], input[ROWS * LG_MACHINE_INPUTS];
    lg_var parts[LG_TAPED_MAX_PARTS], velocities, u;
} setting;

static setting *record(const lg_machine *machine) {
    setting *s = TEST_ARRAY(setting, 1);
    s->tape = test_tape(LG_F64);
    const lg_var theta =
        lg_parameter(s->tape, lg_shape1((uint32_t)machine->parameters), machine_theta(machine, 5));
    assert_ok(lg_machine_bind(s->tape, machine, theta, &s->vars));
    assert_ok(lg_machine_space(machine, &s->space));
    random_rows(machine, 7, ROWS, s->q, s->v);
    memcpy(s->input, test_numbers(3, ROWS * LG_MACHINE_INPUTS, -1, 1), sizeof s->input);
    const lg_var q = lg_input_f64(s->tape, lg_shape2(ROWS, machine->positions), s->q),
                 v = lg_input_f64(s->tape, lg_shape2(ROWS, machine->velocities), s->v);
    assert_ok(lg_machine_record_state(s->tape, &s->vars, q, v, s->parts));
    /* The momenta are independent variables. */
    for (size_t i = 0; i < lg_taped_parts(&s->space); i++)
        s->parts[i] = lg_stop_gradient(s->tape, s->parts[i]);
    if (machine->input_count > 0)
        s->u = lg_input_f64(s->tape, lg_shape2(ROWS, machine->input_count), s->input);
    s->velocities = lg_machine_record_velocities(s->tape, &s->vars, s->parts);
    if (lg_tape_status(s->tape) != LG_OK) fail_msg("%s", lg_tape_message(s->tape));
    return s;
}

TEST("positions and velocities come back from the state, with every kind of mass") {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_MASS, i)) != NULL; i++) {
        const lg_machine machine = machine_with(kind, LG_MACHINE_MASS);
        setting *s = record(&machine);
        assert_reads(s->tape, lg_machine_record_positions(s->tape, &s->vars, s->parts),
                     ROWS * machine.positions, s->q, 1e-14, 1e-14);
        assert_reads(s->tape, s->velocities, ROWS * machine.velocities, s->v, 1e-11, 1e-11);
    }
}

/* dH/dt along the field, and the power v.f of all forces. */
static void assert_energy_balance(const lg_machine *machine) {
    setting *s = record(machine);
    const size_t parts = lg_taped_parts(&s->space);
    lg_var algebra[LG_TAPED_MAX_PARTS], rate[LG_TAPED_MAX_PARTS], change;
    assert_ok(lg_machine_record_field(s->tape, &s->vars, s->parts, s->u, algebra));
    assert_ok(lg_taped_generator(s->tape, &s->space, algebra, s->parts, rate));
    const lg_var H = lg_machine_record_energy(s->tape, &s->vars, s->parts);
    assert_ok(lg_jvp(s->tape, &H, 1, s->parts, rate, parts, &change));
    lg_var power = lg_full(s->tape, lg_shape2(ROWS, 1), 0.0);
    for (uint32_t part = LG_MACHINE_DAMPING; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_var f =
            lg_machine_record_force(s->tape, &s->vars, (lg_machine_part)part, s->parts, s->velocities, s->u);
        if (!lg_is_none(f)) power = lg_add(s->tape, power, lg_rowdot(s->tape, s->velocities, f));
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

TEST("damping of every kind takes energy away at any parameters, and moves what it damps") {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, i)) != NULL; i++) {
        const lg_machine machine = machine_with(kind, LG_MACHINE_DAMPING);
        setting *s = record(&machine);
        double power[ROWS];
        const lg_var f =
            lg_machine_record_force(s->tape, &s->vars, LG_MACHINE_DAMPING, s->parts, s->velocities, s->u);
        assert_ok(lg_read(s->tape, lg_rowdot(s->tape, s->velocities, f), ROWS, power));
        for (int r = 0; r < ROWS; r++) assert_true(power[r] < -1e-4);
    }
}

/* ---- free flight of a rigid body: known in closed form ---- */

enum { STEPS = 20 };

TEST("a thrown rigid body has a parabola and keeps its angular momentum in space, in the log's units") {
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
    const lg_machine_log log = {STEPS + 1, 1, first, t, q, v, NULL};
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 4, &log, &start, 1, STEPS,
                                  q1, v1, NULL));
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

TEST("descriptions that do not fit are refused with a sentence") {
    static const struct {
        lg_machine_part part;
        const char *kind;
        uint32_t values, features;
        const char *sentence;
    } rows[] = {
        {LG_MACHINE_POTENTIAL, "network", 0, 0, "needs `of`"},
        {LG_MACHINE_DAMPING, "known", 3, 0, "has 3 values, 2 or 4 are expected"},
        {LG_MACHINE_INPUT_MAP, "known", 1, 0, "has 1 values, 2 or 2 are expected"},
        {LG_MACHINE_POTENTIAL, "polynomial", 0, 1, "degree"},
        {LG_MACHINE_DAMPING, "coulomb", 0, 0, "width"},
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
        term->width = 0;
        assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
    }
}
