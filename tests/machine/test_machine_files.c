/* Descriptions of machines in YAML. */
#include "support/io_test.h"
#include "liegrad/machine.h"

RELEASES(release_file, lg_machine_file_destroy)

static lg_machine_file *parse(const char *text) {
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), file, &told));
    lg_test_owns(file, release_file);
    return file;
}

static void refuse(const char *text, lg_status status, const char *line, const char *words) {
    lg_error error = {LG_OK, ""};
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1), *before = TEST_ARRAY(lg_machine_file, 1);
    memset(file, 0x5a, sizeof *file);
    *before = *file;
    const lg_status got = lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), file, &error);
    if (got != status) fail_msg("%s (%s) for: %s", lg_status_name(got), error.message, text);
    assert_memory_equal(file, before, sizeof *file);
    assert_says(error.message, "machine.yaml: ");
    assert_says(error.message, line);
    assert_says(error.message, words);
}

typedef struct refusal {
    const char *text, *line, *words;
} refusal;

static void refuse_all(const refusal *rows, size_t count) {
    for (size_t i = 0; i < count; i++) refuse(rows[i].text, LG_FORMAT, rows[i].line, rows[i].words);
}

static void assert_column(const lg_machine_file *f, uint32_t i, const char *name, lg_log_role role,
                          uint32_t index) {
    assert_string_equal(f->columns[i].name, name);
    assert_int_equal(f->columns[i].role, role);
    assert_int_equal(f->columns[i].index, index);
}

static void assert_term(const lg_machine_file *f, uint32_t i, lg_machine_part part, const char *kind) {
    assert_true(i < f->machine.term_count);
    assert_int_equal(f->machine.terms[i].part, part);
    assert_string_equal(lg_term_kind_name(f->machine.terms[i].kind), kind);
}

static const char cartpole[] =
    "columns: {time: time, run: run, max_step: 0.028}\n"
    "coordinates:\n"
    "  - {name: x, kind: line, velocity: vx}\n"
    "  - {name: theta, kind: angle, columns: angle, velocity: [vtheta]}\n"
    "inputs: {columns: [u], hold: linear, delay: 2}\n"
    "measured: velocities\n"
    "noise: {x: 0.002, vx: 0.01}\n"
    "scale: {angle: 0.0174533, time: 0.001}\n"
    "unwrap: false\n"
    "mass: {kind: network, of: [theta], hidden: [8], activation: swish}\n"
    "potential: {kind: network, of: theta}\n"
    "damping: {kind: diagonal, coulomb: true, quadratic: true, coulomb_width: 0.05}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n"
    "residual: none\n";

TEST("a complete file is read") {
    const lg_machine_file *f = parse(cartpole);
    const lg_machine *m = &f->machine;
    assert_int_equal(f->column_count, 7);
    assert_column(f, 0, "time", LG_LOG_TIME, 0);
    assert_column(f, 1, "run", LG_LOG_RUN, 0);
    assert_column(f, 2, "x", LG_LOG_POSITION, 0);
    assert_column(f, 3, "vx", LG_LOG_VELOCITY, 0);
    assert_column(f, 4, "angle", LG_LOG_POSITION, 1);
    assert_column(f, 5, "vtheta", LG_LOG_VELOCITY, 1);
    assert_column(f, 6, "u", LG_LOG_INPUT, 0);
    assert_true(f->time == 0 && f->run == 1 && f->max_step == 0.028);
    assert_true(f->inputs[0].hold == LG_HOLD_LINEAR && f->inputs[0].delay == 2 && !f->unwrap);
    assert_true(f->columns[2].noise == 0.002 && f->columns[3].noise == 0.01 && f->columns[4].noise == 0);
    assert_true(f->columns[4].scale == 0.0174533 && f->columns[0].scale == 0.001 && f->columns[2].scale == 1);
    assert_int_equal(m->coordinate_count, 2);
    assert_string_equal(m->coordinates[1].name, "theta");
    assert_int_equal(m->coordinates[1].kind, LG_COORDINATE_ANGLE);
    assert_true(m->input_count == 1 && strcmp(m->inputs[0], "u") == 0);
    assert_true(m->positions == 2 && m->velocities == 2); /* lg_machine_init was called */
    assert_true(m->scales.time == 1 && m->scales.velocity[1] == 1);
    assert_string_equal(f->text, cartpole);
    assert_int_equal(f->text_bytes, strlen(cartpole));
}

TEST("terms are read, and each friction of `damping` becomes a term") {
    const lg_machine *m = &parse(cartpole)->machine;
    const lg_machine_file *f = parse(cartpole);
    assert_int_equal(m->term_count, 6);
    assert_term(f, 0, LG_MACHINE_MASS, "network");
    assert_term(f, 1, LG_MACHINE_POTENTIAL, "network");
    assert_term(f, 2, LG_MACHINE_DAMPING, "diagonal");
    assert_term(f, 3, LG_MACHINE_DAMPING, "coulomb");
    assert_term(f, 4, LG_MACHINE_DAMPING, "quadratic");
    assert_term(f, 5, LG_MACHINE_INPUT_MAP, "known");
    const lg_machine_term *t = m->terms;
    assert_true(t[0].hidden_layers == 1 && t[0].hidden[0] == 8 && t[0].activation == LG_SWISH);
    assert_true(t[0].of_count == 1 && t[0].of[0].kind == LG_FEATURE_POSITION && t[0].of[0].index == 1);
    assert_true(t[1].hidden_layers == 2 && t[1].hidden[0] == 16 && t[1].hidden[1] == 16);
    assert_int_equal(t[1].activation, LG_TANH);
    assert_true(t[3].width == 0.05);
    assert_true(t[5].value_count == 2 && t[5].values[0] == 1 && t[5].values[1] == 0);
    assert_true(m->parameters > 0);
}

TEST("keys that are left out have their defaults") {
    const lg_machine_file *f = parse("coordinates: [{name: q, kind: line, velocity: v}]\n");
    assert_int_equal(f->column_count, 3);
    assert_column(f, 0, "t", LG_LOG_TIME, 0);
    assert_column(f, 1, "q", LG_LOG_POSITION, 0);
    assert_true(f->run == f->column_count && f->max_step == 0 && f->unwrap);
    assert_true(f->measured == LG_MEASURED_VELOCITIES && !f->hold_given);
    assert_int_equal(f->machine.term_count, 1);
    assert_term(f, 0, LG_MACHINE_MASS, "constant");
    f = parse("coordinates: [{name: q, kind: line, velocity: v}]\ninputs: {columns: u, delay: estimate}\n"
              "damping: {kind: none, coulomb: true}\n");
    assert_int_equal(f->machine.term_count, 3);
    assert_term(f, 1, LG_MACHINE_DAMPING, "coulomb");
    assert_true(f->machine.terms[1].width == 0); /* from the log */
    assert_term(f, 2, LG_MACHINE_INPUT_MAP, "constant");
    assert_true(f->inputs[0].estimate_delay && f->inputs[0].delay == 0);
    f = parse("coordinates: [{name: q, kind: line}]\nmeasured: positions\nresidual: none\n");
    assert_true(f->coordinates[0].velocities == 0 && f->column_count == 2);
}

TEST("hold and delay are read for all inputs or one by one") {
    const lg_machine_file *f =
        parse("coordinates: [{name: q, kind: line, velocity: v}]\n"
              "inputs: {columns: [u, w, x], hold: [linear, auto, zero], delay: [auto, 3, estimate]}\n");
    const lg_log_input *in = f->inputs;
    assert_true(in[0].hold == LG_HOLD_LINEAR && in[1].hold == LG_HOLD_ZERO && in[2].hold == LG_HOLD_ZERO);
    assert_true(!in[0].choose_hold && in[1].choose_hold && !in[2].choose_hold && f->hold_given);
    assert_true(in[0].choose_delay && !in[1].choose_delay && !in[2].choose_delay);
    assert_true(!in[0].estimate_delay && !in[1].estimate_delay && in[2].estimate_delay);
    assert_true(in[0].delay == 0 && in[1].delay == 3 && in[2].delay == 0);
    f = parse("coordinates: [{name: q, kind: line, velocity: v}]\n"
              "inputs: {columns: [u, w], hold: cubic, delay: 2}\n");
    for (int i = 0; i < 2; i++) assert_true(f->inputs[i].hold == LG_HOLD_CUBIC && f->inputs[i].delay == 2);
}

TEST("columns of directions, rotations and poses are found") {
    const lg_machine_file *f = parse(
        "coordinates:\n"
        "  - {name: rod, kind: direction, columns: [a, b, c], velocity: [d, e, f]}\n"
        "  - {name: body, kind: rotation, columns: [r1, r2, r3, r4, r5, r6, r7, r8, r9], velocity: [o1, "
        "o2, o3]}\n"
        "  - {name: hull, kind: pose, position: [x, y, z], columns: [qw, qx, qy, qz],\n"
        "     velocity: [vx, vy, vz], rates: [wx, wy, wz], frame: space}\n"
        "mass: [{kind: constant}, diagonal]\n");
    const lg_log_coordinate *c = f->coordinates;
    assert_int_equal(f->column_count, 1 + 6 + 12 + 13);
    assert_true(c[0].places == 0 && c[0].attitude == 1 && c[0].attitudes == 3 && c[0].velocity == 4);
    assert_true(c[1].attitudes == 9 && c[1].velocities == 3);
    assert_true(c[2].places == 3 && c[2].attitudes == 4 && c[2].velocities == 6 && c[2].space_frame);
    assert_column(f, c[2].place, "x", LG_LOG_POSITION, 2);
    assert_column(f, c[2].attitude, "qw", LG_LOG_POSITION, 2);
    assert_column(f, c[2].velocity, "vx", LG_LOG_VELOCITY, 2);
    assert_column(f, c[2].velocity + 3, "wx", LG_LOG_VELOCITY, 2);
    assert_int_equal(f->machine.velocities, 12);
}

TEST("names in `of` are features") {
    const lg_machine_file *f =
        parse("coordinates:\n"
              "  - {name: hull, kind: pose, position: [x, y, z], columns: [qw, qx, qy, qz], velocity: [vx, "
              "vy, vz], "
              "rates: [wx, wy, wz]}\n"
              "  - {name: arm, kind: angle, velocity: varm}\n"
              "inputs: {columns: [u]}\n"
              "potential: {kind: network, of: [hull.place, hull.rotation, hull.up, hull.height, arm]}\n"
              "residual: {kind: network, of: [hull, hull.velocity, varm, u]}\n");
    static const lg_machine_feature potential[] = {{LG_FEATURE_PLACE, 0},
                                                   {LG_FEATURE_ROTATION, 0},
                                                   {LG_FEATURE_UP, 0},
                                                   {LG_FEATURE_HEIGHT, 0},
                                                   {LG_FEATURE_POSITION, 1}};
    static const lg_machine_feature residual[] = {
        {LG_FEATURE_POSITION, 0}, {LG_FEATURE_VELOCITY, 0}, {LG_FEATURE_VELOCITY, 1}, {LG_FEATURE_INPUT, 0}};
    const lg_machine_term *t = f->machine.terms;
    assert_true(t[1].of_count == 5 && t[3].of_count == 4);
    for (int i = 0; i < 5; i++)
        assert_true(t[1].of[i].kind == potential[i].kind && t[1].of[i].index == potential[i].index);
    for (int i = 0; i < 4; i++)
        assert_true(t[3].of[i].kind == residual[i].kind && t[3].of[i].index == residual[i].index);
}

TEST("a bias may be of positions of lines and angles, of places and of velocities") {
    const lg_machine_file *f =
        parse("coordinates:\n"
              "  - {name: arm, kind: angle, velocity: w}\n"
              "  - {name: top, kind: rotation, columns: [a, b, c, d], velocity: [e, f, "
              "g]}\n"
              "mass: diagonal\n"
              "bias: {kind: constant, of: [arm, top.velocity, w]}\n");
    const lg_machine *m = &f->machine;
    assert_int_equal(m->term_count, 2);
    assert_int_equal(m->terms[1].part, LG_MACHINE_BIAS);
    assert_int_equal(m->terms[1].parameters, 5);
}

TEST("a known potential is a form with values and without parameters") {
    const lg_machine_file *f = parse("coordinates: [{name: q, kind: line, velocity: v}]\n"
                                     "potential:\n"
                                     "  - {kind: known, form: polynomial, degree: 2, of: q, values: [0, 3]}\n"
                                     "  - {kind: linear, of: q}\n");
    const lg_machine_term *t = f->machine.terms;
    assert_int_equal(f->machine.term_count, 3);
    assert_term(f, 1, LG_MACHINE_POTENTIAL, "polynomial");
    assert_true(t[1].degree == 2 && t[1].value_count == 2 && t[1].values[1] == 3 && t[1].parameters == 0);
    assert_term(f, 2, LG_MACHINE_POTENTIAL, "linear");
    assert_true(t[2].value_count == 0 && t[2].parameters == 1);
}

TEST("matrices are lists of rows") {
    const lg_machine *m =
        &parse("coordinates: [{name: a, kind: line, velocity: va}, {name: b, kind: line, velocity: vb}]\n"
               "mass: {kind: known, values: [[1, 2], [2, 5]]}\ndamping: {kind: known, values: [0.5, 0.25]}\n")
             ->machine;
    static const double mass[] = {1, 2, 2, 5};
    assert_int_equal(m->terms[0].value_count, 4);
    assert_memory_equal(m->terms[0].values, mass, sizeof mass);
    assert_true(m->terms[1].value_count == 2 && m->terms[1].values[1] == 0.25);
}

/* ---- refused descriptions ---- */

#define HEAD "coordinates: [{name: q, kind: line, velocity: v}]\n" /* one line */
#define ROD                                                                                                  \
    "coordinates: [{name: d, kind: direction, columns: [a, b, c], velocity: [e, f, g]}, {name: q, kind: "    \
    "line, velocity: v}]\n"

TEST("wrong keys are refused with their line") {
    static const refusal wrong[] = {
        {"measured: velocities\n", "line 1", "'coordinates' is missing"},
        {HEAD "colums: {time: t}\n", "line 2", "unknown key 'colums'"},
        {HEAD "columns: {tme: t}\n", "line 2", "unknown key 'columns.tme'"},
        {HEAD "columns: {max_step: 0}\n", "line 2", "columns.max_step"},
        {HEAD "coordinates: []\n", "line 2", "stands twice"},
        {"coordinates: []\n", "line 1", "a list of {name"},
        {"coordinates: {name: q}\n", "line 1", "a list of {name"},
        {"coordinates: [q]\n", "line 1", "keys and values"},
        {"coordinates:\n  - {kind: line, velocity: v}\n", "line 2", "'name' is missing"},
        {"coordinates:\n  - {name: q, velocity: v}\n", "line 2", "'kind' is missing"},
        {"coordinates:\n  - {name: q, kind: spring}\n", "line 2",
         "'spring' is none of line, angle, direction, rotation, pose; a state without inertia"},
        {"coordinates:\n  - {name: q.a, kind: line, velocity: v}\n", "line 2", "letters, digits"},
        {"coordinates:\n  - {name: q, kind: line, colour: red}\n", "line 2", "unknown key 'colour'"},
        {"coordinates:\n  - {name: q, kind: line, kind: angle}\n", "line 2", "stands twice"},
        {"coordinates:\n  - {name: q, kind: line}\n", "line 2", "key 'velocity' is missing"},
        {"coordinates:\n  - {name: q, kind: line, velocity: [v, w]}\n", "line 2",
         "has 2 columns, expected 1"},
        {"coordinates:\n  - {name: q, kind: line, velocity: v, rates: w}\n", "line 2",
         "does not take this key"},
        {"coordinates:\n  - {name: q, kind: line, velocity: v, frame: body}\n", "line 2",
         "only poses take this key"},
        {"coordinates:\n  - {name: q, kind: line, velocity: q}\n", "line 2", "column 'q' is used twice"},
        {"coordinates:\n  - {name: q, kind: line, velocity: t}\n", "line 2", "column 't' is used twice"},
        {"coordinates:\n  - {name: q, kind: line, velocity: v}\n  - {name: q, kind: line, columns: x, "
         "velocity: w}\n",
         "line 3", "two coordinates have the name 'q'"},
        {"coordinates:\n  - {name: b, kind: rotation, velocity: [x, y, z]}\n", "line 2",
         "'columns' is missing: it names 4 columns (w, x, y, z) or 9"},
        {"coordinates:\n  - {name: b, kind: rotation, columns: [a, b, c], velocity: [x, y, z]}\n", "line 2",
         "has 3 columns, expected 4 (w, x, y, z) or 9"},
        {"coordinates:\n  - {name: b, kind: pose, position: [x, y, z], columns: [a, b, c, d], velocity: [e, "
         "f, g]}\n",
         "line 2", "key 'rates' is missing"},
        {"measured: positions\ncoordinates:\n  - {name: q, kind: line, velocity: v}\n", "line 3",
         "with `measured: positions`"},
        {HEAD "measured: speeds\n", "line 2", "none of velocities, momenta, positions"},
        {HEAD "inputs: {hold: zero}\n", "line 2", "'inputs.columns' is missing"},
        {HEAD "inputs: {columns: [u], hold: first}\n", "line 2", "known: zero, linear, cubic"},
        {HEAD "inputs: {columns: [u], delay: -1}\n", "line 2", "`estimate`"},
        {HEAD "inputs: {columns: [u, w], delay: [1, 2, 3]}\n", "line 2", "one for each of the 2 inputs"},
        {HEAD "inputs: {columns: [u, w], hold: [zero]}\n", "line 2", "one for each of the 2 inputs"},
        {HEAD "inputs:\n  columns: [u, w]\n  hold:\n    - zero\n    - [zero]\n", "line 6",
         "inputs.hold: '?' is"},
        {HEAD "inputs:\n  columns: [u, w]\n  delay:\n    - auto\n    - 0.5\n", "line 6", "a whole number"},
        {HEAD "inputs: {columns: [u, u]}\n", "line 2", "column 'u' is used twice"},
        {"coordinates: [{name: q, kind: line, columns: x, velocity: v}]\ninputs: {columns: [q]}\n", "line 2",
         "has the name of a coordinate"},
        {HEAD "noise: {w: 1}\n", "line 2", "'w' is not a column"},
        {HEAD "noise: {q: -1}\n", "line 2", "outside (0"},
        {HEAD "noise: {q: 1, q: 2}\n", "line 2", "'q' is given twice"},
        {HEAD "noise: 0.1\n", "line 2", "{COLUMN: number}"},
        {HEAD "scale: {q: 0}\n", "line 2", "must not be 0"},
        {HEAD "scale: {q: m}\n", "line 2", "'m' is not a number"},
        {HEAD "unwrap: perhaps\n", "line 2", "none of false, true"},
        {HEAD "mass: {kind: known, values: [-1]}\n", "line 2", "above 0"},
        {HEAD "mass: {kind: known, values: [0]}\n", "line 2", "above 0"},
        {HEAD "damping: {kind: known, values: [-1]}\n", "line 2", "below 0"},
        {HEAD "mass:\n  - {kind: known, values: [1e308]}\n  - {kind: known, values: [1e308]}\n", "line 3",
         "the sum of the known values overflows"},
        {HEAD "mass:\n  - diagonal\n  - {kind: known, values: [-1]}\n", "line 4", "below 0"},
        {HEAD "mass: {kind: known, values: [1, 2]}\n", "line 2", "has 2 values, expected 1"},
        {"coordinates: [{name: a, kind: line, velocity: b}, {name: c, kind: line, velocity: d}]\n"
         "mass: {kind: known, values: [[1, 2], [2, 1]]}\n",
         "line 2", "positive definite"},
        {ROD "mass: {kind: known, values: [1, 7, 9, 2]}\n", "line 2", "one number for each direction"},
        {ROD "mass: {kind: diagonal, values: [unknown, 1, 1, 2]}\n", "line 2", "one number for each"},
        {ROD "mass: {kind: known, values: [[1,0,0,0.4],[0,1,0,0],[0,0,1,0],[0.4,0,0,2]]}\n", "line 2",
         "without couplings"},
        {ROD "mass: {kind: known, values: [1, 1, 1]}\n", "line 2", "has 3 values, expected 2 or 16"},
        {"", "line 1", ""},
        {"coordinates: [\n", "line", "is not YAML"},
    };
    refuse_all(wrong, LG_COUNT(wrong));
}

/* ---- systems ---- */

#define TOP                                                                                                  \
    "coordinates: [{name: top, kind: rotation, columns: [a, b, c, d], velocity: [e, f, g]}]\n"               \
    "system: heavy-top\n"

TEST("a system gives the machine its mass and potential, and numbers that are known or unknown") {
    const lg_machine_file *f = parse(TOP "form: direct\nparameters:\n  inertia: [0.3, unknown, 0.5]\n"
                                         "  mass: unknown\n  length: {start: 0.4}\n"
                                         "  chi: {start: [0, 0, 1], unknown: true}\n"
                                         "  gamma0: {start: [0, 0, -9], unknown: [false, false, true]}\n"
                                         "damping: diagonal\n");
    static const double start[11] = {0.3, 0.46875, 0.5, 15, 0.4, 0, 0, 1, 0, 0, -9};
    static const bool unknown[11] = {0, 1, 0, 1, 1, 1, 1, 1, 0, 0, 1};
    const lg_machine *m = &f->machine;
    assert_int_equal(m->term_count, 3);
    assert_term(f, 0, LG_MACHINE_MASS, "system");
    assert_term(f, 1, LG_MACHINE_POTENTIAL, "system");
    assert_term(f, 2, LG_MACHINE_DAMPING, "diagonal");
    assert_string_equal(m->grey.system->name, "heavy-top");
    assert_int_equal(m->grey.count, 11);
    for (int i = 0; i < 11; i++)
        assert_true(m->grey.start[i] == start[i] && m->grey.unknown[i] == unknown[i]);
    assert_int_equal(m->parameters, 6 + 3); /* a direction has two parameters */
    assert_true(!m->normalised && !m->free_gauge);
    f = parse(TOP);
    assert_int_equal(f->machine.parameters, 0);
    f = parse(TOP "mass: diagonal\npotential: {kind: network, of: top.up}\n");
    assert_int_equal(f->machine.term_count, 4);
}

TEST("wrong systems and parameters are refused with their line") {
    static const refusal wrong[] = {
        {HEAD "parameters: {gravity: 9.81}\n", "line 2", "key 'system' is missing"},
        {HEAD "form: direct\n", "line 2", "key 'system' is missing"},
        {HEAD "system: heavy-top\n", "line 2", "the coordinates must be of kind rotation"},
        {HEAD "system: top\n", "line 2", "no machine for system \"top\"; the systems are: oscillator"},
        {HEAD "system: rigid-body\n", "line 2", "take rigid-body-attitude"},
        {HEAD "mass: system\n", "line 2", "mass: kind 'system' is unknown; expected one of"},
        {TOP "form: indirect\n", "line 3", "heavy-top has no form 'indirect'"},
        {TOP "parameters: {masse: 1}\n", "line 3", "no parameter \"masse\"; its parameters are inertia"},
        {TOP "parameters: {mass: 1, mass: 2}\n", "line 3", "key 'mass' is given twice"},
        {TOP "parameters: {inertia: [1, 2]}\n", "line 3", "inertia: 2 numbers are given, 3 are expected"},
        {TOP "parameters:\n  mass: -1\n", "line 4", "mass = -1 is not a positive number"},
        {TOP "parameters: {mass: {start: 0, unknown: true}}\n", "line 3", "is not a positive number"},
        {TOP "parameters: {mass: heavy}\n", "line 3", "'heavy' is not a number"},
        {TOP "parameters: {mass: []}\n", "line 3", "1 to 32 numbers"},
        {TOP "parameters: {mass: {unknown: true}}\n", "line 3", "'start' is missing"},
        {TOP "parameters: {mass: {start: unknown}}\n", "line 3", "start: expected a number"},
        {TOP "parameters: {mass: {start: 1, unknown: perhaps}}\n", "line 3", "true, false, or a list"},
        {TOP "parameters: {inertia: {start: [1, 2, 3], unknown: [true, false]}}\n", "line 3",
         "for each of the 3 numbers"},
        {TOP "parameters: {chi: [1, 1, 1]}\n", "line 3", "chi has length 1.73205"},
        {TOP "parameters: 3\n", "line 3", "expected {KEY: ...}"},
    };
    refuse_all(wrong, LG_COUNT(wrong));
}

TEST("wrong terms are refused with their line") {
    static const refusal wrong[] = {
        {HEAD "mass: {}\n", "line 2", "'kind' is missing"},
        {HEAD "mass: heavy\n", "line 2",
         "mass: kind 'heavy' is unknown; expected one of none, known, diagonal"},
        {HEAD "mass: [[constant]]\n", "line 2", "the name of a kind"},
        {HEAD "mass: []\n", "line 2", "the list is empty"},
        {HEAD "mass:\n  kind: constant\n  hidden: [3]\n", "line 4",
         "hidden: mass of kind constant does not take"},
        {HEAD "mass:\n  kind: constant\n  colour: red\n", "line 4", "unknown key 'colour'"},
        {HEAD "mass: {kind: diagonal, of: q}\n", "line 2",
         "of: mass of kind diagonal does not take this key"},
        {HEAD "mass: {kind: constant, values: 1}\n", "line 2",
         "values: mass of kind constant does not take this key"},
        {HEAD "mass: {kind: diagonal, degree: 1}\n", "line 2",
         "degree: mass of kind diagonal does not take this key"},
        {HEAD "mass: {kind: diagonal, coulomb: true}\n", "line 2",
         "coulomb: mass of kind diagonal does not take this key"},
        {HEAD "mass: {kind: diagonal, form: linear}\n", "line 2",
         "form: mass of kind diagonal does not take this key"},
        {HEAD "damping: {kind: diagonal, coulomb_width: 1}\n", "line 2", "without `coulomb: true`"},
        {HEAD "damping: {kind: diagonal, width: 1}\n", "line 2", "without `coulomb: true`"},
        {HEAD "damping: {kind: coulomb, width: 1, coulomb_width: 1}\n", "line 2", "is the same as `width`"},
        {HEAD "damping: {kind: stribeck, width: 0}\n", "line 2", "width: 0 is outside"},
        {HEAD "damping: {kind: load, of: q}\n", "line 2", "'q' is not an input"},
        {HEAD "damping: load\n", "line 2", "needs `of`, the inputs that load it"},
        {HEAD "damping: position\n", "line 2", "needs `of`"},
        {HEAD "damping: {kind: asymmetric, values: [[1], [2]]}\n", "line 2", "friction would give energy"},
        {HEAD "mass: {kind: diagonal, values: [{start: 3, within: [4, 10]}]}\n", "line 2",
         "start 3 is not between"},
        {HEAD "mass: {kind: diagonal, values: [{start: 3, within: [10, 4]}]}\n", "line 2",
         "expected [low, high]"},
        {HEAD "mass: {kind: diagonal, values: [{sigma: 1}]}\n", "line 2", "sigma needs a start"},
        {HEAD "mass: {kind: diagonal, values: [{begin: 1}]}\n", "line 2", "unknown key 'begin'"},
        {HEAD "mass: {kind: diagonal, values: [{start: -1}]}\n", "line 2", "a start above 0"},
        {HEAD "damping: {kind: asymmetric, values: [[1], [unknown]]}\n", "line 2", "either all numbers"},
        {HEAD "system: oscillator\nparameters: {mass: {start: 1, within: [2, 3]}}\n", "line 3",
         "start must be inside"},
        {HEAD "offset: [p]\n", "line 2", "'p' is neither a kind (unknown, known) nor a coordinate"},
        {HEAD "offset: [q, v]\n", "line 2", "'v' is given twice"},
        {HEAD "offset: {kind: known, values: [1, 2]}\n", "line 2", "has 2 values, expected 1"},
        {HEAD "damping: {kind: diagonal, coulomb: maybe}\n", "line 2", "none of false, true"},
        {HEAD "mass: {kind: network, of: [p]}\n", "line 2", "of: 'p' is unknown; expected one of q"},
        {HEAD "mass: {kind: network, of: [q.up]}\n", "line 2", "of: 'q.up' is unknown; expected one of q"},
        {HEAD "mass: {kind: network, of: [q.mass]}\n", "line 2", "of: 'q.mass' is unknown"},
        {HEAD "mass: {kind: network, of: [t]}\n", "line 2", "of: 't' is unknown"},
        {HEAD "inputs: {columns: u}\ndamping: {kind: network, of: [u]}\n", "line 3", "'u' is an input"},
        {HEAD "mass: {kind: network, of: [q.velocity]}\n", "line 2", "'q.velocity' is a velocity"},
        {HEAD "mass: {kind: network, of: [v]}\n", "line 2", "'v' is a velocity"},
        {"coordinates: [{name: b, kind: rotation, columns: [a, b, c, d], velocity: [e, f, g]}]\n"
         "residual: {kind: network, of: [e]}\n",
         "line 2", "of: 'e' is unknown; expected one of b"},
        {"coordinates: [{name: b, kind: rotation, columns: [a, b, c, d], velocity: [e, f, g]}]\n"
         "bias: {kind: constant, of: b}\n",
         "", "bias of kind constant: cannot depend on"},
        {HEAD "mass: {kind: network, of: [q, q]}\n", "line 2", "'q' is given twice"},
        {HEAD "mass: {kind: network, of: [{q: 1}]}\n", "line 2", "a name of 1 to"},
        {HEAD "mass: {kind: network, of: [q], hidden: [0]}\n", "line 2", "hidden: 0 is outside"},
        {HEAD "mass: {kind: network, of: [q], hidden: [1, 1, 1, 1, 1]}\n", "line 2", "has 5 values"},
        {HEAD "mass: {kind: network, of: [q], activation: step}\n", "line 2", "'step' is none of"},
        {HEAD "inputs: {columns: u}\nmass: {kind: network, of: [u]}\n", "line 3", "'u' is an input"},
        {HEAD "mass: {kind: known, values: [[1, 2], [3]]}\n", "line 2", "has 1 number, 2 are expected"},
        {HEAD "mass: {kind: known, values: [one]}\n", "line 2", "'one' is not a number"},
        {HEAD "mass: {kind: known, values: [1, 2]}\n", "", "2 values"},
        {HEAD "mass: none\n", "", "needs a mass"},
        {HEAD "input_map: constant\n", "line 2", "this machine has no inputs"},
        {HEAD "potential: known\n", "line 2", "{kind: known, form"},
        {HEAD "potential: {kind: known, values: 1}\n", "line 2", "needs key 'form'"},
        {HEAD "potential: {kind: known, form: linear, of: q}\n", "line 2", "needs key 'values'"},
        {HEAD "potential: {kind: known, form: network, of: q, values: 1}\n", "line 2",
         "'network' is unknown; expected linear"},
        {HEAD "potential: {kind: linear, of: q, degree: 2}\n", "line 2", "degree: potential of kind linear"},
        {HEAD "potential: {kind: polynomial, of: q, degree: 9}\n", "line 2", "degree: 9 is outside"},
        {HEAD "potential: {kind: none, of: q}\n", "line 2",
         "of: potential of kind none does not take this key"},
        {HEAD "potential: [{kind: linear, of: q},\n  {kind: lnear}]\n", "line 3", "'lnear'"},
    };
    refuse_all(wrong, LG_COUNT(wrong));
}

/* ---- files ---- */

static lg_status read_machine(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_error *error) {
    (void)options;
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    const lg_status status = lg_machine_file_read(context, path, file, error);
    if (status == LG_OK) lg_machine_file_destroy(file);
    return status;
}

#define SPEED                                                                                                \
    "measured: velocities-only\ncoordinates: [{name: q, kind: line, velocity: v}, {name: a, kind: angle, "   \
    "velocity: w}]\n"
TEST("with velocities alone nothing may depend on a position, except constant forces and offsets") {
    static const refusal wrong[] = {
        {"measured: velocities-only\ncoordinates: [{name: d, kind: direction, velocity: [u, v, w]}]\n"
         "mass: diagonal\n",
         "line 1", "d: with `measured: velocities-only` a coordinate is a line or an angle"},
        {"measured: velocities-only\ncoordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, "
         "velocity: w}]\nsystem: coupled-oscillators\n",
         "line 1", "system: coupled-oscillators depends on positions"},
        {SPEED "mass: diagonal\npotential: {kind: quadratic, of: q}\n", "line 4",
         "potential: depends on the position of q, but the log has velocities alone"},
        {SPEED "mass: diagonal\npotential: {kind: linear, of: a}\n", "line 4", "the position of a"},
        {SPEED "mass: diagonal\npotential: {kind: gravity, of: [q, a]}\n", "line 4", "the position of a"},
        {SPEED "mass: diagonal\nresidual: {kind: network, of: [q.velocity, a], hidden: [3]}\n", "line 4",
         "residual: depends on the position of a"},
        {SPEED "mass: {kind: network, of: q, hidden: [3]}\n", "line 3", "mass: depends on the position of q"},
    };
    static const char *const right[] = {
        "potential: {kind: linear, of: q}\n", "potential: {kind: gravity, of: q}\n",
        "offset: {kind: unknown, of: [q, a]}\n",
        "residual: {kind: polynomial, of: [q.velocity, a.velocity], degree: 2}\n"};
    refuse_all(wrong, LG_COUNT(wrong));
    for (size_t i = 0; i < LG_COUNT(right); i++) {
        const char *text = test_text("%smass: diagonal\n%s", SPEED, right[i]);
        lg_machine_file file;
        assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), &file, &told));
        lg_machine_file_destroy(&file);
    }
}

TEST("a file gives the same as its text, and damaged files are refused") {
    const char *path = scratch_path("cartpole.yaml");
    write_text_to(path, cartpole);
    lg_machine_file *f = TEST_ARRAY(lg_machine_file, 1);
    assert_ok(lg_machine_file_read(NULL, path, f, NULL));
    lg_test_owns(f, release_file);
    const lg_machine_file *g = parse(f->text);
    assert_string_equal(f->text, cartpole);
    assert_memory_equal(&f->machine.coordinates, &g->machine.coordinates, sizeof f->machine.coordinates);
    assert_int_equal(f->machine.parameters, g->machine.parameters);
    assert_refused(read_machine, scratch_path("nothing-here"), LG_NOT_FOUND, "", "");
    assert_refused(read_machine, scratch, LG_FILE, "regular", "");
    survive_changed_bytes(read_machine, path, 300);
    lg_machine_file_destroy(NULL);
}

TEST("every allocation may fail") {
    const char *path = scratch_path("cartpole.yaml");
    write_text_to(path, cartpole);
    assert_true(fail_every_reading(read_machine, path) >= 4);
}

TEST("descriptions beyond the limits are refused") {
    char text[8192] = "measured: positions\ncoordinates:\n";
    for (int i = 0; i <= LG_MACHINE_COORDINATES; i++)
        (void)sprintf(text + strlen(text), "  - {name: q%d, kind: line}\n", i);
    refuse(text, LG_FORMAT, "line 15", "more than 12 coordinates");
    (void)strcpy(text, HEAD "mass: [");
    for (int i = 0; i <= LG_MACHINE_TERMS; i++) (void)strcat(text, "constant, ");
    refuse(strcat(text, "constant]\n"), LG_FORMAT, "line 2", "more than 16 terms");
    (void)strcpy(text, HEAD "inputs: {columns: [");
    for (int i = 0; i <= LG_MACHINE_INPUTS; i++) (void)sprintf(text + strlen(text), "u%d, ", i);
    refuse(strcat(text, "w]}\n"), LG_FORMAT, "line 2", "more than 16 inputs");
    (void)strcpy(text, HEAD "inputs: {columns: [");
    for (int i = 0; i < LG_MACHINE_INPUTS; i++) (void)sprintf(text + strlen(text), "u%d, ", i);
    (void)strcat(text, "], curve: [");
    for (int i = 0; i < LG_MACHINE_INPUTS; i++)
        (void)strcat(text, i % 2 == 0 ? "{degree: 2, dead_zone: unknown}, "
                                      : "{degree: 3, values: [1, 1], dead_zone: 1}, ");
    (void)strcat(text, "]}\nmass: [");
    for (int i = 0; i + 4 < LG_MACHINE_TERMS; i++) (void)strcat(text, "constant, ");
    refuse(strcat(text, "]\n"), LG_FORMAT, "line 2", "more than 16 terms");
    (void)strcpy(text, "measured: positions\ncoordinates:\n");
    for (int i = 0; i < LG_MACHINE_COORDINATES; i++)
        (void)sprintf(text + strlen(text), "  - {name: q%d, kind: line}\n", i);
    (void)strcat(text, "residual: {kind: polynomial, degree: 1, of: [");
    for (int i = 0; i < LG_MACHINE_COORDINATES; i++)
        (void)sprintf(text + strlen(text), "q%d, q%d.velocity, ", i, i);
    refuse(strcat(text, "]}\n"), LG_FORMAT, "line 15", "of: more than 16 names");
    static const struct {
        const char *begin, *item, *end;
        int count;
        const char *words;
    } lists[] = {
        {"[", "1, ", "1]", 256, "values: more than 256 numbers"},
        {"[[", "1, ", "1]]", 256, "values: more than 256 numbers"},
        {"[[1, 1]", ", [1, 1]", "]", 128, "values: more than 256 numbers"},
        {"[", "1, ", "unknown]", 256, "values: more than 256 numbers, or 32 unknown ones"},
        {"[", "unknown, ", "1]", 33, "values: more than 256 numbers, or 32 unknown ones"},
    };
    for (size_t k = 0; k < LG_COUNT(lists); k++) {
        (void)sprintf(text, HEAD "damping: {kind: known, values: %s", lists[k].begin);
        for (int i = 0; i < lists[k].count; i++) (void)strcat(text, lists[k].item);
        (void)sprintf(text + strlen(text), "%s}\n", lists[k].end);
        refuse(text, LG_FORMAT, "line 2", lists[k].words);
    }
    (void)strcpy(text, "coordinates:\n");
    for (int i = 0; i < 5; i++) {
        (void)sprintf(text + strlen(text), "  - {name: h%d, kind: pose", i);
        static const char *const keys[] = {"position", "columns", "velocity", "rates"};
        for (int k = 0; k < 4; k++) {
            (void)sprintf(text + strlen(text), ", %s: [", keys[k]);
            for (int j = 0; j < (k == 1 ? 9 : 3); j++)
                (void)sprintf(text + strlen(text), "c%d%d%d, ", i, k, j);
            (void)strcat(text, "]");
        }
        (void)strcat(text, "}\n");
    }
    refuse(text, LG_FORMAT, "line 6", "more than 82 columns");
    (void)strcpy(text, HEAD "system: oscillator\nparameters: {mass: [");
    for (int i = 0; i < LG_MACHINE_PARAMETERS; i++) (void)strcat(text, "1, ");
    refuse(strcat(text, "1]}\n"), LG_FORMAT, "line 3", "mass: expected 1 to 32 numbers");
    for (int name = 0; name < 4; name++) {
        static const char *const texts[] = {"columns: {time: %s}\n", "columns: {run: %s}\n",
                                            "mass: {kind: network, of: %s}\n", "inputs: {columns: %s}\n"};
        char longest[128];
        (void)snprintf(longest, sizeof longest, "%0*d", name == 3 ? LG_MACHINE_NAME : 100, 0);
        refuse(test_text("%s%s", HEAD, test_text(texts[name], longest)), LG_FORMAT, "line 2",
               name == 3   ? "the name of an input has at most 31 bytes"
               : name == 2 ? "of: expected a name of 1 to 63 bytes"
                           : "63 bytes");
    }
    (void)snprintf(text, sizeof text, "coordinates: [{name: %032d, kind: line, velocity: v}]\n", 0);
    refuse(text, LG_FORMAT, "line 1", "name: expected 1 to 31 letters, digits, _ and -");
}

#define TWO "coordinates: [{name: q, kind: line, velocity: v}, {name: a, kind: angle, velocity: w}]\n"
TEST("wrong names, numbers with bounds, and values of unequal length are refused with their line") {
    static const refusal wrong[] = {
        {"coordinates: [{name: \"\", kind: line, velocity: v}]\n", "line 1", "name"},
        {"coordinates: [{name: \"q{\", kind: line, velocity: v}]\n", "line 1", "letters, digits, _ and -"},
        {"measured: velocities-only\ncoordinates: [{name: h, kind: pose, position: [x, y, z], velocity: [a, "
         "b, c], "
         "rates: [d, e, f]}]\n",
         "line 2", "columns of positions are not allowed with `measured: velocities-only`"},
        {"coordinates: [{name: \"q[\", kind: line, velocity: v}]\n", "line 1", "letters, digits, _ and -"},
        {"coordinates: [{name: \"q:\", kind: line, velocity: v}]\n", "line 1", "letters, digits, _ and -"},
        {"coordinates: [{name: \"q z\", kind: line, velocity: v}]\n", "line 1", "letters, digits, _ and -"},
        {"coordinates: [{name: q, kind: line, velocity: \"v\\x7f\"}]\n", "line 1", "control character"},
        {"coordinates: [{name: q, kind: line, velocity: \"v\\t\"}]\n", "line 1", "control character"},
        {"coordinates: [{name: q, kind: line, velocity: \"v\\0w\"}]\n", "line 1", "a name of 1 to"},
        {HEAD "noise: {[q]: 1}\n", "line 2", "noise: '?' is not a column"},
        {HEAD "inputs: {columns: u, delay: [[1]]}\n", "line 2", "inputs.delay: expected a whole number"},
        {HEAD "inputs: {columns: u, delay: 1000001}\n", "line 2", "inputs.delay: expected a whole number"},
        {HEAD "mass: {kind: diagonal, values: {start: 2, within: [1]}}\n", "line 2",
         "within: expected [low, high]"},
        {HEAD "mass: {kind: diagonal, values: {start: 5, within: [1, 4]}}\n", "line 2",
         "start 5 is not between 1 and 4"},
        {HEAD "mass: {kind: diagonal, values: {start: 1, within: [1, 4]}}\n", "line 2",
         "start 1 is not between"},
        {TWO "damping: {kind: known, values: [[unknown, 0], [1]]}\n", "line 2",
         "values: rows of different length"},
        {TWO "damping: {kind: known, values: [[unknown, unknown], [0, 1]]}\n", "line 2",
         "only numbers on the diagonal of a matrix"},
        {TWO "mass: {kind: known, values: [[2, unknown], [0, 1]]}\n", "line 2",
         "only numbers on the diagonal of a matrix"},
        {TWO "mass: none\noffset: q\n", "machine.yaml", "a machine needs a mass"},
        {TWO "mass: diagonal\noffset: [r]\n", "line 3", "neither a kind (unknown, known) nor a coordinate"},
        {TWO "mass: diagonal\noffset: [q, v]\n", "line 3", "of: 'v' is given twice"},
        {"coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
         "system: coupled-oscillators\nparameters: {[1]: 2}\n",
         "line 3", "parameters: a key is too long"},
        {"coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
         "system: coupled-oscillators\nparameters: {masses_of_all_bodies_of_the_machine: 2}\n",
         "line 3", "parameters: a key is too long"},
        {"coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
         "system: coupled-oscillators\nparameters: {masses: {start: [1, 1], within: [2]}}\n",
         "line 3", "masses: within: expected [low, high]"},
        {"coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
         "system: coupled-oscillators\nparameters: {masses: {start: [1, 1], within: [2, 2]}}\n",
         "line 3", "masses: within: expected [low, high]"},
    };
    refuse_all(wrong, LG_COUNT(wrong));
}

TEST("offsets of coordinates are one term; a term without names, or with values, is another one") {
    static const struct {
        const char *text;
        uint32_t terms, numbers;
    } rows[] = {{"offset: [q, w]\n", 1, 2},
                {"offset: [unknown, q]\n", 2, 3},
                {"offset: [{kind: known, of: q, values: 1}, a]\n", 2, 1},
                {"offset: {kind: unknown, of: a}\n", 1, 1}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_machine *m =
            &parse(test_text("%s%s", TWO "mass: {kind: known, values: [1, 1]}\n", rows[i].text))->machine;
        assert_int_equal(m->term_count, 1 + rows[i].terms);
        assert_int_equal(m->parameters, rows[i].numbers);
    }
}

TEST("names may have letters of both cases, digits, _ and -") {
    const lg_machine *m =
        &parse("coordinates: [{name: Q_1-z, kind: line, velocity: v}]\nmass: diagonal\n")->machine;
    assert_string_equal(m->coordinates[0].name, "Q_1-z");
}

TEST("a switch of friction that is false adds no term, and a prior of a system's parameter is kept") {
    const lg_machine *m =
        &parse(TWO "mass: diagonal\ndamping: {kind: diagonal, coulomb: false, quadratic: false}\n")->machine;
    assert_int_equal(m->term_count, 2);
    m = &parse(TWO "mass: diagonal\ndamping: {kind: coulomb, width: 0.5}\n")->machine;
    assert_close(m->terms[1].width, 0.5, 0, 0);
    m = &parse("coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
               "system: coupled-oscillators\nparameters: {masses: {start: [1, 2], sigma: 0.5, unknown: "
               "[true, false]}}\n")
             ->machine;
    assert_close(m->grey.sigma[0], 0.5, 0, 0);
    assert_close(m->grey.sigma[1], 0, 0, 0);
}

TEST("friction may load inputs, and a number with bounds and no start begins between them") {
    lg_identified mass;
    const double theta[16] = {0};
    const lg_machine *m =
        &parse(TWO "inputs: {columns: u}\nmass: {kind: diagonal, values: [{within: [1, 5]}, 2]}\n"
                   "damping: [coulomb, {kind: load, of: u}]\n")
             ->machine;
    assert_int_equal(m->terms[2].of[0].kind, LG_FEATURE_INPUT);
    (void)lg_machine_numbers(m, theta, 1, &mass);
    assert_true(m->parameters <= LG_COUNT(theta));
    assert_string_equal(mass.name, "mass.1.1");
    assert_close(mass.value, 3, 1e-12, 0);
}

TEST("numbers of potentials of a pose's place, and one unknown number of a polynomial, have names") {
    static const char *const names[] = {"1^2", "1*h.place.2", "1*h.place.3", "2^2", "2*h.place.3", "3^2"};
    enum { MASSES = 6, LAST = MASSES + LG_COUNT(names), NUMBERS = LAST + 1 };
    const double theta[NUMBERS] = {0};
    lg_identified numbers[NUMBERS];
    const lg_machine *m =
        &parse("coordinates: [{name: h, kind: pose, position: [x, y, z], columns: [a, b, c, d], velocity: "
               "[e, f, g],\n"
               "  rates: [i, j, k]}]\nmass: diagonal\npotential: [{kind: quadratic, of: h.place},\n"
               "  {kind: polynomial, degree: 2, of: h.height, values: [1, unknown]}]\n")
             ->machine;
    assert_int_equal(lg_machine_numbers(m, theta, NUMBERS, numbers), NUMBERS);
    for (size_t i = 0; i < LG_COUNT(names); i++)
        assert_string_equal(numbers[MASSES + i].name, test_text("potential.h.place.%s", names[i]));
    assert_string_equal(numbers[LAST].name, "potential.h.height^2");
}
