/* Machines: kinds of friction and constant forces. Their formulas, that friction never gives energy, the
 * width of friction, and the direction in which the parameters scale it. */
#include "liegrad/ops.h"

#include "support/machine_support.h"

#include "machine/internal.h"

/* A line and an angle with masses 2 and 3, a spring on the line, an input, and odd scales. */
static lg_machine plain(void) {
    static const double mass[2] = {2, 3}, spring[1] = {0.7}, map[2] = {1, 0.5};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    odd_scales(&machine);
    machine.scales.fastest[0] = 4.0;
    machine.scales.fastest[1] = 9.0;
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 2, mass);
    lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(V, LG_FEATURE_POSITION, 0);
    add_values(V, 1, spring);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, map);
    return machine;
}

/* The forces (2) of one part at a state and an input, all in the units of the log. */
static void force_at(const lg_machine *machine, lg_machine_part part, const double *theta, const double *q,
                     const double *v, double u, double *out) {
    const lg_machine_scales *s = &machine->scales;
    const double place[2] = {q[0] / s->place[0], q[1]}, input = u / s->input[0];
    double speed[2];
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    lg_tape *tape = test_tape(LG_F64);
    for (int k = 0; k < 2; k++) speed[k] = v[k] * s->time / s->velocity[k];
    assert_ok(lg_machine_bind(tape, machine, lg_machine_parameter(tape, machine, theta), &vars));
    const lg_var rates = lg_input_f64(tape, lg_shape2(1, 2), speed);
    assert_ok(lg_machine_record_state(tape, &vars, lg_input_f64(tape, lg_shape2(1, 2), place), rates, parts));
    assert_ok(lg_read(
        tape,
        lg_machine_record_force(tape, &vars, part, parts, rates, lg_input_f64(tape, lg_shape2(1, 1), &input)),
        2, out));
    for (int k = 0; k < 2; k++) out[k] *= s->energy / s->velocity[k];
}

/* ---- formulas ---- */

typedef double formula(double v, double w, const double *c, double x);

static double viscous_by_direction(double v, double w, const double *c, double x) {
    (void)x;
    return -(c[0] * v + c[1] * sqrt(v * v + w * w)) + c[1] * w;
}

/* w = 0: without a width. */
static double sign_of(double v, double w) {
    return w > 0 ? tanh(v / w) : v > 0 ? 1 : v < 0 ? -1 : 0;
}

static double stribeck(double v, double w, const double *c, double x) {
    (void)x;
    return -(c[0] + (c[1] - c[0]) * exp(-(v / c[2]) * (v / c[2]))) * sign_of(v, w);
}

static double cubic(double v, double w, const double *c, double x) {
    (void)w, (void)x;
    return -c[0] * v * v * v;
}

static double load(double v, double w, const double *c, double x) {
    return -c[0] * (1 + c[1] * fabs(x)) * sign_of(v, w);
}

static double by_position(double v, double w, const double *c, double x) {
    const double y = 1 + c[1] * x;
    return -c[0] * (y + sqrt(y * y + 0.0025)) / 2 * sign_of(v, w);
}

TEST("known friction has the forces of its formula, in the units of the log") {
    enum { NONE, INPUT, SPRING, PLACE };
    static const struct {
        const char *kind;
        formula *of;
        int by;
        uint32_t blocks;
        double values[3];
    } rows[] = {
        {"asymmetric", viscous_by_direction, NONE, 2, {1.7, -0.6}},
        {"stribeck", stribeck, NONE, 3, {0.8, 1.3, 0.4}},
        {"cubic", cubic, NONE, 1, {0.9}},
        {"load", load, INPUT, 2, {0.8, 0.3}},
        {"load", load, SPRING, 2, {0.8, 0.3}},
        {"position", by_position, PLACE, 2, {0.8, 0.3}},
    };
    static const double speeds[] = {-2.0, -0.2, -1e-3, 0.0, 3e-3, 0.5, 1.5};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (size_t k = 0; k < LG_COUNT(speeds); k++) {
            lg_machine machine = plain();
            lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, rows[i].kind);
            if (rows[i].by == INPUT) add_feature(term, LG_FEATURE_INPUT, 0);
            if (rows[i].by == PLACE) add_feature(term, LG_FEATURE_POSITION, 0);
            term->width = k % 2 == 0 ? 0.05 : 0.0;
            for (uint32_t b = 0; b < rows[i].blocks; b++)
                term->values[2 * b] = term->values[2 * b + 1] = rows[i].values[b];
            term->value_count = 2 * rows[i].blocks;
            assert_machine(&machine);
            const double q[2] = {-1.6, 0.4}, v[2] = {speeds[k], 0.3}, u = -2.5;
            const double w = term->width;
            const double x[] = {0, u, 2 * 0.7 * q[0], q[0]};
            double f[2];
            force_at(&machine, LG_MACHINE_DAMPING, NULL, q, v, u, f);
            assert_close(f[0], rows[i].of(v[0], w, rows[i].values, x[rows[i].by]), 1e-12, 1e-13);
        }
}

/* ---- friction takes energy away ---- */

/* All kinds that change other friction, beside it. */
static lg_machine everything(void) {
    static const char *const kinds[] = {"diagonal", "coulomb", "asymmetric", "stribeck", "position", "cubic"};
    lg_machine machine = plain();
    for (size_t i = 0; i < LG_COUNT(kinds); i++) {
        lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, kinds[i]);
        if (strcmp(kinds[i], "position") == 0) add_feature(term, LG_FEATURE_POSITION, 0);
    }
    add_feature(add_term(&machine, LG_MACHINE_DAMPING, "load"), LG_FEATURE_INPUT, 0);
    assert_machine(&machine);
    return machine;
}

TEST("friction takes energy away at any velocity, position, load and parameters, also beside its base") {
    const lg_machine machine = everything();
    for (uint64_t seed = 1; seed <= 40; seed++) {
        const double *theta = test_numbers(seed, machine.parameters, -4, 4);
        for (double size = 1e-6; size < 200; size *= 7)
            for (int sign = -1; sign <= 1; sign += 2) {
                const double q[2] = {seed % 2 == 0 ? 9.0 : -9.0, 1.0}, v[2] = {sign * size, -sign * size};
                double f[2];
                force_at(&machine, LG_MACHINE_DAMPING, theta, q, v, 3.0, f);
                for (int k = 0; k < 2; k++) assert_true(isfinite(f[k]) && f[k] * v[k] < 0.0);
            }
    }
}

TEST("beside its base a kind has no coefficients of its own; two terms that change the same friction are "
     "refused") {
    lg_machine machine = everything();
    const uint32_t sizes[] = {2, 2, 2, 4, 2, 2, 2};
    for (size_t i = 0; i < LG_COUNT(sizes); i++) assert_int_equal(machine.terms[3 + i].parameters, sizes[i]);
    lg_error error = {LG_OK, ""};
    add_term(&machine, LG_MACHINE_DAMPING, "asymmetric");
    assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "two terms of this kind change the same friction");
}

TEST("values with which friction would give energy are refused") {
    static const struct {
        const char *kind, *sentence;
        uint32_t count;
        double values[6];
    } rows[] = {
        {"asymmetric", "would give energy", 4, {1, 1, 0.5, -1.1}},
        {"stribeck", "friction at rest", 6, {1, 1, 2, 0.9, 1, 1}},
        {"stribeck", "above 0", 6, {1, 1, 2, 2, 1, 0}},
        {"stribeck", "not below 0", 6, {1, -1, 2, 2, 1, 1}},
        {"load", "must not be below 0", 4, {1, 1, 1, -0.1}},
        {"position", "must not be below 0", 4, {1, -1, 1, 1}},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_machine machine = plain();
        lg_error error = {LG_OK, ""};
        lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, rows[i].kind);
        if (strcmp(rows[i].kind, "load") == 0) add_feature(term, LG_FEATURE_INPUT, 0);
        if (strcmp(rows[i].kind, "position") == 0) add_feature(term, LG_FEATURE_POSITION, 0);
        add_values(term, rows[i].count, rows[i].values);
        assert_status(lg_machine_init(&machine, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
    }
}

/* ---- direction of scale ---- */

static void scaled_along(const lg_machine *machine) {
    static const double x = 1e-5, q[2] = {0.8, -0.4}, v[2] = {0.9, -0.02};
    const double *theta = machine_theta(machine, 9);
    double *direction = TEST_ARRAY(double, machine->parameters + 1),
           *moved = TEST_ARRAY(double, machine->parameters + 1);
    double f[2], up[2], down[2];
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        if (term->part != LG_MACHINE_DAMPING || term->parameters == 0) continue;
        assert_non_null(term->kind->scaling);
        term->kind->scaling(machine, term, theta + term->offset, direction + term->offset);
    }
    force_at(machine, LG_MACHINE_DAMPING, theta, q, v, 1.4, f);
    for (size_t i = 0; i < machine->parameters; i++) moved[i] = theta[i] + x * direction[i];
    force_at(machine, LG_MACHINE_DAMPING, moved, q, v, 1.4, up);
    for (size_t i = 0; i < machine->parameters; i++) moved[i] = theta[i] - x * direction[i];
    force_at(machine, LG_MACHINE_DAMPING, moved, q, v, 1.4, down);
    for (int k = 0; k < 2; k++) assert_close((up[k] - down[k]) / (2 * x), f[k], 1e-8, 1e-12);
}

TEST("the direction of scale of every kind multiplies all friction by 1 + x to first order") {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, i)) != NULL; i++) {
        lg_machine machine = plain();
        const uint32_t options = lg_term_kind_options(kind);
        if ((options & LG_TERM_KNOWN) != 0) continue;
        lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, lg_term_kind_name(kind));
        if ((options & LG_TERM_OF) != 0) add_feature(term, LG_FEATURE_POSITION, 0);
        if ((options & LG_TERM_INPUTS) != 0) add_feature(term, LG_FEATURE_INPUT, 0);
        assert_machine(&machine);
        scaled_along(&machine);
    }
    const lg_machine machine = everything();
    scaled_along(&machine);
}

TEST("the numbers of every learned friction, given as known values, make the same friction") {
    enum { MOST = 16 };
    static const double q[2] = {0.3, -0.8};
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, i)) != NULL; i++) {
        const uint32_t options = lg_term_kind_options(kind);
        if ((options & LG_TERM_VALUES) == 0 || (options & LG_TERM_KNOWN) != 0) continue;
        for (uint64_t seed = 0; seed < 5; seed++) {
            lg_machine learned = plain(), known;
            lg_machine_term *term = add_term(&learned, LG_MACHINE_DAMPING, lg_term_kind_name(kind));
            if ((options & LG_TERM_OF) != 0) add_feature(term, LG_FEATURE_POSITION, 0);
            if ((options & LG_TERM_INPUTS) != 0) add_feature(term, LG_FEATURE_INPUT, 0);
            known = learned;
            assert_machine(&learned);
            const double *theta = machine_theta(&learned, seed), v[2] = {0.7 * (double)seed - 1.5, 0.4};
            lg_identified numbers[MOST];
            const size_t count = lg_machine_numbers(&learned, theta, MOST, numbers);
            double values[MOST], f[2], g[2];
            for (size_t k = 0; k < count; k++) values[k] = numbers[k].value;
            add_values(&known.terms[known.term_count - 1], (uint32_t)count, values);
            assert_machine(&known);
            force_at(&learned, LG_MACHINE_DAMPING, theta, q, v, -1.2, f);
            force_at(&known, LG_MACHINE_DAMPING, NULL, q, v, -1.2, g);
            assert_all_close(g, f, 2, 1e-12, 1e-14);
        }
    }
}

/* ---- offsets ---- */

TEST("an offset is a constant force on the velocities of its coordinates, and its number is in the log's "
     "units") {
    for (int known = 0; known < 2; known++) {
        lg_machine machine = plain();
        lg_machine_term *term = add_term(&machine, LG_MACHINE_OFFSET, known == 1 ? "known" : "unknown");
        const double theta[1] = {0.8}, value = theta[0] * machine.scales.energy;
        lg_identified number;
        double f[2];
        add_feature(term, LG_FEATURE_POSITION, 1);
        if (known == 1) add_values(term, 1, &value);
        assert_machine(&machine);
        force_at(&machine, LG_MACHINE_OFFSET, theta, (const double[]){1, 2}, (const double[]){3, -4}, 1, f);
        assert_close(f[0], 0, 0, 0);
        assert_close(f[1], value, 1e-14, 0);
        assert_int_equal(lg_machine_numbers(&machine, theta, 1, &number), 1 - known);
        if (known == 1) continue;
        assert_string_equal(number.name, "offset.a");
        assert_close(number.value, value, 1e-14, 0);
    }
}

/* ---- width, and steps that reach rest ---- */

enum { ROWS = 41 };

/* A log of x = A sin t, a = B sin t, whose velocities are differences of positions if `positions` is true. */
static void log_of(double A, double B, bool positions, double *t, double *q, double *v, size_t *first,
                   lg_machine_log *out) {
    for (size_t i = 0; i < ROWS; i++) {
        t[i] = 0.1 * (double)i;
        q[2 * i] = A * sin(t[i]), q[2 * i + 1] = B * sin(t[i]);
        v[2 * i] = positions ? (double)NAN : A * cos(t[i]);
        v[2 * i + 1] = positions ? (double)NAN : B * cos(t[i]);
    }
    first[0] = 0, first[1] = ROWS;
    *out = (lg_machine_log){.rows = ROWS, .parts = 1, .first = first, .t = t, .q = q, .v = v};
}

TEST("the width of friction is a thousandth of each velocity's largest speed in the log, in any unit") {
    static const double units[] = {1, 1e-9, 1e9};
    for (size_t i = 0; i < LG_COUNT(units); i++)
        for (int positions = 0; positions < 2; positions++) {
            double t[ROWS], q[2 * ROWS], v[2 * ROWS];
            size_t first[2];
            lg_machine_log log;
            lg_machine machine = empty_machine();
            add_coordinate(&machine, "x", LG_COORDINATE_LINE);
            add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
            add_term(&machine, LG_MACHINE_MASS, "diagonal");
            lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, "coulomb");
            term->width = 0;
            assert_machine(&machine);
            assert_close(lg_machine_width(&machine, term, 1), 0.02, 1e-15, 0); /* before there is a log */
            log_of(3 * units[i], 0.2, positions == 1, t, q, v, first, &log);
            assert_ok(lg_machine_find_scales(&machine, &log, NULL));
            assert_close(lg_machine_width(&machine, term, 0), 3e-3 * units[i], 4e-3, 0);
            assert_close(lg_machine_width(&machine, term, 1), 2e-4, 4e-3, 0);
            term->width = 0.5;
            assert_close(lg_machine_width(&machine, term, 0), 0.5, 0, 0);
        }
}

TEST("the rate at which friction stops a machine near rest is the slope of its force, divided by the mass") {
    static const double c[2] = {1.5, 6};
    double t[ROWS], q[2 * ROWS], v[2 * ROWS], u[4 * ROWS] = {0}, rate;
    size_t first[2];
    lg_machine_log log;
    lg_machine machine = plain();
    log_of(1, 1, false, t, q, v, first, &log);
    log.u = u;
    assert_machine(&machine);
    assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
    assert_close(rate, 0, 0, 0);
    lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, "coulomb");
    add_values(term, 2, c);
    term->width = 0;
    assert_machine(&machine);
    assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
    assert_close(rate, 0, 0, 0); /* without a width friction sticks in one step */
    term->width = 9e-3;
    assert_machine(&machine);
    assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
    assert_close(rate, 6 / (3 * 9e-3), 1e-3, 0); /* of the angle: mass 3, width 0.009 */
    term->width = 1e-3;
    assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
    assert_close(rate, 6 / (3 * 1e-3), 1e-3, 0);
}

TEST("bristles stop a machine near rest at the rate of their spring or of their damping, whichever is "
     "larger") {
    static const double rows[][2] = {{2e4, 0}, {2e-2, 1e3}}; /* stiffness, damping */
    double t[ROWS], q[2 * ROWS], v[2 * ROWS], u[4 * ROWS] = {0}, rate;
    size_t first[2];
    lg_machine_log log;
    log_of(1, 1, false, t, q, v, first, &log);
    log.u = u;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const double values[10] = {1, 1, 1.5, 1.5, 0.1, 0.1, rows[i][0], rows[i][0], rows[i][1], rows[i][1]};
        lg_machine machine = plain();
        lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, "lugre");
        add_values(term, 10, values);
        assert_machine(&machine);
        assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
        assert_close(rate, i == 0 ? sqrt(2e4 / 2) : 1e3 / 2, 1e-2, 0); /* of the line: mass 2 */
    }
}

TEST("the stiffness of learned bristles can be set to a part of its range, the stiffness of known bristles "
     "cannot") {
    static const double values[10] = {1, 1, 1.5, 1.5, 0.1, 0.1, 2, 2, 0, 0};
    for (int known = 0; known < 2; known++) {
        lg_machine machine = plain();
        lg_identified numbers[2][10];
        (void)add_term(&machine, LG_MACHINE_DAMPING, "coulomb");
        lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, "lugre");
        if (known == 1) add_values(term, 10, values);
        assert_machine(&machine);
        double *theta = machine_theta(&machine, 3);
        assert_true(lg_machine_set_bristles(&machine, 0.1, theta) == (known == 0));
        (void)lg_machine_numbers(&machine, theta, 10, numbers[0]);
        (void)lg_machine_set_bristles(&machine, 0.9, theta);
        const size_t count = lg_machine_numbers(&machine, theta, 10, numbers[1]);
        for (size_t i = 0; i < count && i < 10; i++) {
            const bool stiffness = strncmp(numbers[0][i].name, "bristle_stiffness.", 18) == 0;
            assert_true((numbers[0][i].value != numbers[1][i].value) == stiffness);
        }
    }
}

TEST("a log without complete rows tells no rate") {
    double t[ROWS], q[2 * ROWS], v[2 * ROWS], u[4 * ROWS] = {0}, rate = 1;
    size_t first[2];
    lg_machine_log log;
    lg_machine machine = plain();
    static const double c[2] = {1.5, 6};
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "diagonal"), 2, c);
    assert_machine(&machine);
    log_of(1, 1, false, t, q, v, first, &log);
    log.u = u;
    q[0] = (double)NAN; /* the other rows are enough */
    assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
    assert_close(rate, 2, 1e-9, 0); /* damping by mass of the angle */
    for (size_t i = 0; i < LG_COUNT(q); i++) q[i] = (double)NAN;
    for (int rows = 0; rows < 2; rows++) {
        log.rows = rows == 0 ? ROWS : 0;
        rate = 1;
        assert_ok(lg_machine_rest_rate(NULL, &machine, NULL, &log, &rate, NULL));
        assert_close(rate, 0, 0, 0);
    }
}

TEST("a term that changes a base lists the numbers of this term only, whether the base is known or learned") {
    static const struct {
        const char *kind, *base, *first;
        size_t own;
    } rows[] = {{"asymmetric", "diagonal", "asymmetric.x", 2},
                {"stribeck", "coulomb", "breakaway.x", 4},
                {"load", "coulomb", "load.x", 2},
                {"position", "coulomb", "position.x", 2}};
    static const double c[2] = {1.5, 6};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (int known = 0; known < 2; known++) {
            lg_machine machine = plain();
            lg_identified numbers[8];
            lg_machine_term *base = add_term(&machine, LG_MACHINE_DAMPING, rows[i].base);
            if (known == 1) add_values(base, 2, c);
            lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, rows[i].kind);
            if (strcmp(rows[i].kind, "load") == 0) add_feature(term, LG_FEATURE_INPUT, 0);
            if (strcmp(rows[i].kind, "position") == 0) add_feature(term, LG_FEATURE_POSITION, 0);
            assert_machine(&machine);
            const size_t before = known == 1 ? 0 : 2;
            assert_int_equal(lg_machine_numbers(&machine, machine_theta(&machine, 3), 8, numbers),
                             rows[i].own + before);
            assert_string_equal(numbers[before].name, rows[i].first);
            double f[2];
            force_at(&machine, LG_MACHINE_DAMPING, machine_theta(&machine, 3), (const double[]){0.3, 0.2},
                     (const double[]){0.4, -0.6}, 0.5, f);
            assert_true(f[0] < 0 && f[1] > 0);
        }
}
