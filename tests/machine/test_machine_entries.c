/* Machines: numbers that are unknown one by one, with starts, bounds and priors. */
#include "liegrad/ops.h"

#include "support/machine_support.h"

#include "machine/internal.h"

static void open_value(lg_machine_term *term, uint32_t index, double low, double high, double sigma) {
    term->entries[term->entry_count++] = (lg_machine_entry){index, low, high, sigma};
}

/* A line and an angle with two inputs at odd scales; with `open` some of the numbers are unknown. */
static lg_machine mixed(bool open) {
    static const double mass[2] = {2, 3}, map[4] = {1, -0.4, 0, 0.5}, drag[2] = {0.7, 0.2},
                        coulomb[2] = {0.3, 0.9}, offset[2] = {-0.6, 0.1}, pull[2] = {0.4, -0.8};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_input(&machine, "w");
    odd_scales(&machine);
    add_values(add_term(&machine, LG_MACHINE_MASS, "diagonal"), 2, mass);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 4, map);
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "diagonal"), 2, drag);
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "coulomb"), 2, coulomb);
    add_values(add_term(&machine, LG_MACHINE_OFFSET, "known"), 2, offset);
    lg_machine_term *gravity = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(gravity, LG_FEATURE_HEIGHT, 1);
    add_values(gravity, 2, pull);
    if (open) {
        open_value(&machine.terms[0], 1, 0, 0, 0.5);
        open_value(&machine.terms[1], 1, 0, 0, 0.2);
        open_value(&machine.terms[1], 3, 0.1, 4, 0);
        open_value(&machine.terms[2], 0, 0, 0, 0);
        open_value(&machine.terms[3], 1, 0.5, 2, 0.1);
        open_value(&machine.terms[4], 0, -1, 1, 0);
        open_value(&machine.terms[5], 1, 0, 0, 0);
    }
    assert_machine(&machine);
    return machine;
}

/* The velocities' rates of change at one state, (2), in scaled units. */
static void rates_of(const lg_machine *machine, const double *theta, double *out) {
    static const double q[2] = {0.3, 0.8}, v[2] = {0.7, -0.2}, u[2] = {0.4, 1.1};
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS];
    lg_tape *tape = test_tape(LG_F64);
    const lg_shape row = lg_shape2(1, 2);
    assert_ok(lg_machine_bind(tape, machine, lg_machine_parameter(tape, machine, theta), &vars));
    assert_ok(
        lg_machine_record_state(tape, &vars, lg_input_f64(tape, row, q), lg_input_f64(tape, row, v), parts));
    assert_ok(lg_machine_record_field(tape, &vars, parts, lg_input_f64(tape, row, u), algebra));
    assert_ok(lg_read(tape, algebra[lg_machine_parts(machine).m], 2, out));
}

TEST("a machine whose unknown numbers are at their starts is the machine in which they are known") {
    static const char *const names[] = {"mass.2.2",  "input_map.1.2", "input_map.2.2",   "damping.x",
                                        "coulomb.a", "offset.x",      "potential.cos(a)"};
    static const double starts[] = {3, -0.4, 0.5, 0.7, 0.9, -0.6, -0.8};
    const lg_machine known = mixed(false), open = mixed(true);
    const double zeros[7] = {0};
    double a[2], b[2];
    lg_identified numbers[7];
    assert_int_equal(known.parameters, 0);
    assert_int_equal(open.parameters, 7);
    rates_of(&known, NULL, a);
    rates_of(&open, zeros, b);
    assert_all_close(b, a, 2, 1e-14, 0);
    assert_int_equal(lg_machine_numbers(&open, zeros, 7, numbers), 7);
    for (size_t i = 0; i < 7; i++) {
        assert_string_equal(numbers[i].name, names[i]);
        assert_close(numbers[i].value, starts[i], 1e-14, 0);
    }
}

TEST("a known mass has one number for each direction, or three equal ones") {
    enum { N = 7 };
    static const double one[] = {5, 2, 3}, each[N] = {5, 5, 5, 2, 3, 3, 3};
    double matrix[N * N] = {0}, got[3];
    for (int i = 0; i < N; i++) matrix[i * N + i] = each[i];
    const double *const values[] = {matrix, each, one};
    static const uint32_t counts[] = {N * N, N, 3};
    lg_machine machine;
    for (int k = 0; k < 3; k++) {
        lg_machine_vars vars;
        lg_tape *tape = test_tape(LG_F64);
        machine = empty_machine();
        add_coordinate(&machine, "d", LG_COORDINATE_DIRECTION);
        add_coordinate(&machine, "x", LG_COORDINATE_LINE);
        add_coordinate(&machine, "e", LG_COORDINATE_DIRECTION);
        add_values(add_term(&machine, LG_MACHINE_MASS, "known"), counts[k], values[k]);
        assert_machine(&machine);
        assert_ok(lg_machine_bind(tape, &machine, lg_machine_parameter(tape, &machine, NULL), &vars));
        assert_ok(lg_read(tape, vars.direction_mass, 2, got));
        assert_ok(lg_read(tape, vars.mass, 1, got + 2));
        assert_true(got[0] == 5 && got[1] == 3 && got[2] == 2);
    }
    lg_identified number;
    open_value(&machine.terms[0], 2, 0, 0, 0);
    assert_machine(&machine);
    assert_int_equal(lg_machine_numbers(&machine, got, 1, &number), 1);
    assert_string_equal(number.name, "mass.5.5");
}

TEST("identified numbers, given as known values, make the same machine, for any parameters") {
    static const uint32_t of[7][2] = {{0, 1}, {1, 1}, {1, 3}, {2, 0}, {3, 1}, {4, 0}, {5, 1}};
    for (uint64_t seed = 1; seed < 5; seed++) {
        const lg_machine open = mixed(true);
        lg_machine known = mixed(false);
        const double *theta = machine_theta(&open, seed);
        lg_identified numbers[7];
        double a[2], b[2];
        (void)lg_machine_numbers(&open, theta, 7, numbers);
        for (size_t i = 0; i < 7; i++) known.terms[of[i][0]].values[of[i][1]] = numbers[i].value;
        assert_machine(&known);
        rates_of(&known, NULL, a);
        rates_of(&open, theta, b);
        assert_all_close(b, a, 2, 1e-13, 0);
    }
}

TEST("a known 0 does not fix the common factor of masses and forces, another known number does") {
    for (int known = 0; known < 2; known++) {
        const double pull[2] = {known, (double)NAN}, one = 1;
        lg_machine machine = empty_machine();
        lg_identified number;
        add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
        (void)add_term(&machine, LG_MACHINE_MASS, "diagonal");
        lg_machine_term *gravity = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
        add_feature(gravity, LG_FEATURE_HEIGHT, 0);
        add_values(gravity, 2, pull);
        open_value(gravity, 1, 0, 0, 0);
        machine.scales.energy = 2.5;
        assert_machine(&machine);
        assert_int_equal(machine.normalised, known == 0);
        /* Without a start the coefficient begins at 0, and its unit is that of an energy. */
        machine.terms[0].parameters = 0, machine.terms[0].value_count = 1, gravity->offset = 0;
        assert_int_equal(lg_machine_numbers(&machine, &one, 1, &number), 1);
        assert_close(number.value, 2.5, 1e-14, 0);
    }
}

TEST(
    "numbers stay in their bounds and positive for extreme parameters, and slopes are those of the numbers") {
    const lg_machine machine = mixed(true);
    static const double extremes[] = {-60, -5, 0, 2, 60};
    for (size_t k = 0; k < LG_COUNT(extremes); k++) {
        double theta[7];
        lg_identified n[7];
        for (size_t i = 0; i < 7; i++) theta[i] = extremes[k];
        (void)lg_machine_numbers(&machine, theta, 7, n);
        assert_true(n[0].value > 0 && n[3].value > 0);
        assert_true(n[2].value >= 0.1 && n[2].value <= 4 && n[4].value >= 0.5 && n[4].value <= 2);
        assert_true(n[5].value >= -1 && n[5].value <= 1);
        for (size_t i = 0; i < 7; i++) assert_true(isfinite(n[i].value));
    }
    const lg_machine_entry bounded = {.low = 1, .high = 10};
    const lg_number_map maps[] = {lg_machine_entry_map(&bounded, 3, 2, true),
                                  lg_machine_entry_map(&(lg_machine_entry){.index = 0}, 3, 2, true),
                                  lg_machine_entry_map(&(lg_machine_entry){.index = 0}, -3, 2, false)};
    for (size_t i = 0; i < LG_COUNT(maps); i++) {
        double slope;
        assert_close(fabs(lg_number_at(&maps[i], 0, NULL)), 3, 1e-14, 0);
        (void)lg_number_at(&maps[i], 0.4, &slope);
        const double up = lg_number_at(&maps[i], 0.4 + 1e-5, NULL),
                     down = lg_number_at(&maps[i], 0.4 - 1e-5, NULL);
        assert_close(slope, (up - down) / 2e-5, 1e-8, 0);
    }
}

TEST("numbers without a start begin at the same machine in any unit") {
    static const double units[] = {1, 1e-9, 1e9};
    double first[2];
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        lg_machine machine = mixed(true);
        double rates[2];
        const double zeros[16] = {0};
        machine.scales.energy *= units[k];
        for (uint32_t i = 0; i < machine.term_count; i++)
            for (uint32_t j = 0; j < machine.terms[i].value_count; j++) {
                lg_machine_term *term = &machine.terms[i];
                term->values[j] *= units[k];
                for (uint32_t e = 0; e < term->entry_count; e++)
                    if (term->entries[e].index == j) term->values[j] = (double)NAN;
            }
        for (uint32_t i = 0; i < machine.term_count; i++)
            for (uint32_t e = 0; e < machine.terms[i].entry_count; e++)
                machine.terms[i].entries[e].low = machine.terms[i].entries[e].high =
                    machine.terms[i].entries[e].sigma = 0;
        assert_machine(&machine);
        assert_true(machine.parameters <= LG_COUNT(zeros));
        rates_of(&machine, zeros, k == 0 ? first : rates);
        if (k > 0) assert_all_close(rates, first, 2, 1e-12, 0);
    }
}

TEST("entries that do not fit are refused") {
    static const struct {
        uint32_t term, index;
        double start, low, high, sigma;
        const char *sentence;
    } rows[] = {{0, 0, -1, 0, 0, 0, "a start above 0"},     {0, 0, 2, 3, 4, 0, "inside of its bounds"},
                {0, 0, 2, -1, 4, 0, "bounds not below 0"},  {1, 0, NAN, 0, 0, 1, "needs a start"},
                {0, 0, 5, 3, 4, 0, "inside of its bounds"}, {1, 9, 1, 0, 0, 0, "is not among its values"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        lg_machine machine = mixed(false);
        lg_machine_term *term = &machine.terms[rows[i].term];
        if (rows[i].index < term->value_count) term->values[rows[i].index] = rows[i].start;
        open_value(term, rows[i].index, rows[i].low, rows[i].high, rows[i].sigma);
        assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
    }
}

TEST("known masses and damping may have unknown numbers; the prior of one number fixes the common factor") {
    for (int prior = 0; prior < 2; prior++) {
        lg_machine machine = empty_machine();
        add_coordinate(&machine, "x", LG_COORDINATE_LINE);
        lg_machine_term *mass = add_term(&machine, LG_MACHINE_MASS, "diagonal");
        add_values(mass, 1, (double[]){2});
        open_value(mass, 0, 0, 0, prior * 0.5);
        assert_machine(&machine);
        assert_true(!machine.normalised && machine.free_gauge == (prior == 0));
        *add_term(&machine, LG_MACHINE_MASS, "diagonal") = *mass;
        assert_machine(&machine);
        assert_int_equal(machine.parameters, 2);
    }
    lg_machine machine = mixed(false);
    machine.terms[0].kind = lg_term_kind_find(LG_MACHINE_MASS, "known");
    machine.terms[2].kind = lg_term_kind_find(LG_MACHINE_DAMPING, "known");
    open_value(&machine.terms[0], 1, 0, 0, 0);
    open_value(&machine.terms[2], 0, 0, 0, 0);
    assert_machine(&machine);
    assert_int_equal(machine.parameters, 2);
    lg_error error;
    machine.terms[2].values[1] = -0.1; /* a known number */
    assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the values must not be below 0");
}

TEST("more unknown numbers than a term may have are refused") {
    lg_error error = {LG_OK, ""};
    lg_machine machine = mixed(false);
    machine.terms[1].entry_count = LG_MACHINE_ENTRIES + 1;
    assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "has too many unknown numbers among its values");
}

TEST("a covariance that is not finite has no open directions, and is no lack of memory") {
    const lg_identified numbers[2] = {{.error = 1.0}, {.error = 1.0}};
    for (int i = 0; i < 2; i++) {
        double covariance[4] = {NAN, i, i, NAN}, open[4];
        lg_identification out = {.numbers = (lg_identified *)numbers, .open = open};
        assert_ok(lg_machine_relate(NULL, 2, covariance, &out));
        assert_int_equal(out.open_count, 0);
    }
}

TEST("a machine takes 64 numbers with a prior, and refuses more") {
    static const char *const damping[] = {"diagonal", "coulomb", "quadratic", "cubic"};
    enum { LINES = 12, MOST = LG_MACHINE_PRIORS };
    double ones[LINES];
    for (int i = 0; i < LINES; i++) ones[i] = 1.0;
    for (int priors = MOST; priors <= MOST + 1; priors++) {
        lg_machine machine = empty_machine();
        for (int i = 0; i < LINES; i++)
            add_coordinate(&machine, (char[]){(char)('a' + i), 0}, LG_COORDINATE_LINE);
        add_values(add_term(&machine, LG_MACHINE_MASS, "diagonal"), LINES, ones);
        for (size_t i = 0; i < LG_COUNT(damping); i++)
            add_values(add_term(&machine, LG_MACHINE_DAMPING, damping[i]), LINES, ones);
        add_values(add_term(&machine, LG_MACHINE_OFFSET, "known"), LINES, ones);
        for (uint32_t i = 0; i < (uint32_t)priors; i++)
            open_value(&machine.terms[i / LINES], i % LINES, 0, 0, 0.5);
        lg_error error = {LG_OK, ""};
        assert_status(lg_machine_init(&machine, &error), priors > MOST ? LG_INVALID_ARGUMENT : LG_OK);
        if (priors > MOST) assert_says(error.message, "at most 64 unknown numbers");
    }
}

TEST("known friction with unknown numbers is scaled along its direction; at the end of bounds it cannot be") {
    lg_machine machine = mixed(true);
    for (int end = 0; end < 2; end++) {
        const lg_machine_term *drag = &machine.terms[2], *coulomb = &machine.terms[3];
        double theta[7] = {0.1, 0.1, 0.1, 0.1, end == 1 ? 800 : 0.1, 0.1, 0.1}, direction[7];
        assert_true(lg_machine_scale_friction(&machine, theta, direction));
        lg_identified before[7], after[7];
        (void)lg_machine_numbers(&machine, theta, 7, before);
        for (size_t i = 0; i < 7; i++) theta[i] += 1e-6 * direction[i];
        (void)lg_machine_numbers(&machine, theta, 7, after);
        for (size_t i = 0; i < 7; i++) {
            const bool scaled = i == drag->offset || (i == coulomb->offset && end == 0);
            assert_close(after[i].value / before[i].value - 1, scaled ? 1e-6 : 0, 1e-4, 1e-12);
        }
    }
}

TEST("a parameter of a system gets bounds and a prior only where it is unknown and they hold its start") {
    lg_machine machine = empty_machine();
    const double values[2] = {1, 2};
    const bool unknown[2] = {false, true};
    lg_prior priors[LG_MACHINE_PRIORS];
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "y", LG_COORDINATE_LINE);
    assert_ok(lg_machine_set_system(&machine, "coupled-oscillators", NULL));
    assert_ok(lg_machine_set_parameter(&machine, "masses", 2, values, unknown, NULL));
    assert_status(lg_machine_bound_parameter(&machine, "masses", 0, 0.5, 4, 0, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_machine_bound_parameter(&machine, "masses", 1, 3, 4, 0, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_machine_bound_parameter(&machine, "masses", 1, 0.5, 2, 0, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_machine_bound_parameter(&machine, "masses", 2, 0.5, 4, 0, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_machine_bound_parameter(&machine, "masses", 1, -1, 4, 0, NULL), LG_INVALID_ARGUMENT);
    assert_ok(lg_machine_bound_parameter(&machine, "masses", 1, 0.5, 4, 0.3, NULL));
    assert_machine(&machine);
    assert_int_equal(machine.parameters, 1);
    static const double extremes[] = {-50, 0, 50}, expected[] = {0.5, 2, 4};
    for (size_t i = 0; i < LG_COUNT(extremes); i++) {
        lg_identified number;
        assert_int_equal(lg_machine_numbers(&machine, &extremes[i], 1, &number), 1);
        assert_close(number.value, expected[i], 1e-12, 0);
    }
    assert_int_equal(lg_machine_list_priors(&machine, priors), 1);
    assert_close(lg_number_at(&priors[0].map, 0, NULL), 2, 1e-14, 0);
    assert_close(priors[0].centre, 2, 0, 0);
}

TEST("systems and their parameters that do not fit are refused, and the machine stays unchanged") {
    static const struct {
        lg_coordinate_kind kind;
        uint32_t count;
        const char *system, *sentence;
    } rows[] = {
        {LG_COORDINATE_LINE, 0, "coupled-oscillators",
         "the coordinates must be of kind line, line, in this order"},
        {LG_COORDINATE_LINE, 2, "pendulum-chain", "must be of kind direction, one or more, in this order"},
        {LG_COORDINATE_LINE, 2, "cart-pole", "must be of kind line, angle, in this order, and no others"},
        {LG_COORDINATE_LINE, 2, "cartpole",
         "there is no machine for system \"cartpole\"; the systems are: oscillator"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        lg_machine machine = empty_machine();
        for (uint32_t k = 0; k < rows[i].count; k++)
            add_coordinate(&machine, k == 0 ? "x" : "y", rows[i].kind);
        const lg_machine before = machine;
        assert_true(lg_machine_set_system(&machine, rows[i].system, &error) != LG_OK);
        assert_says(error.message, rows[i].sentence);
        assert_memory_equal(&machine, &before, sizeof machine);
    }
    lg_error error;
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "top", LG_COORDINATE_ROTATION);
    machine.term_count = LG_MACHINE_TERMS - 1;
    assert_status(lg_machine_set_system(&machine, "heavy-top", &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "more than 16 terms");
    machine.term_count = 0;
    assert_ok(lg_machine_set_system(&machine, "heavy-top", NULL));
    const double axis[3] = {0, 0.6, 0.8}, one = 1;
    const bool open[3] = {true, true, true};
    assert_status(lg_machine_set_parameter(&machine, "chi", 1, &one, NULL, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "chi: 1 number is given, 3 are expected");
    assert_status(lg_machine_set_parameter(&machine, "mass", 3, axis, NULL, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "mass: 3 numbers are given, 1 is expected");
    assert_ok(lg_machine_set_parameter(&machine, "chi", 3, axis, open, NULL));
    assert_status(lg_machine_bound_parameter(&machine, "chi", 0, -1, 1, 0, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "only an unknown number has bounds or a prior");
    lg_machine alone = machine;
    alone.grey.system = NULL; /* the terms stay */
    assert_status(lg_machine_init(&alone, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "either a system and the terms of this system, or neither");
    alone = machine;
    alone.term_count = 0;
    assert_status(lg_machine_init(&alone, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "either a system and the terms of this system, or neither");
}
