/* Standard errors of numbers for residuals that are white or correlated in time, and fits of a few numbers.
 * ctest-labels: src/machine */
#include "machine/internal.h"
#include "support/machine_support.h"

enum { ROWS = 1201, NUMBERS = 3 };

/* An oscillator with m = 2, k = 8, damping .3, driven by u, and units of mass, length and time. */
static const double truth[NUMBERS] = {2.0, 4.0, 0.3}, dt = 0.1;

typedef struct units {
    double mass, length, time;
} units;
static const units usual = {1.0, 1.0, 1.0};

static lg_machine oscillator(const units *in, bool known) {
    const double one = 1.0, m = truth[0] * in->mass, k = truth[1] * in->mass / (in->time * in->time),
                 d = truth[2] * in->mass / in->time;
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_input(&machine, "u");
    lg_machine_term *M = add_term(&machine, LG_MACHINE_MASS, known ? "known" : "diagonal");
    lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(V, LG_FEATURE_POSITION, 0);
    lg_machine_term *D = add_term(&machine, LG_MACHINE_DAMPING, known ? "known" : "diagonal");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 1, &one);
    if (known) {
        add_values(M, 1, &m);
        add_values(V, 1, &k);
        add_values(D, 1, &d);
    }
    assert_machine(&machine);
    return machine;
}

/* A log with white noise of positions and velocities, and a force that the log does not have: AR(1) with the
 * correlation `memory` from row to row. */
typedef struct made {
    size_t first[2], start[ROWS];
    double t[ROWS], q[ROWS], v[ROWS], u[ROWS * 4];
    lg_machine_log log;
    lg_machine machine;
    lg_machine_problem problem;
    double *theta;
} made;

static void run(const units *in, double force, double memory, double noise, uint64_t seed, made *m) {
    const lg_machine machine = oscillator(in, true);
    const double unit = in->mass * in->length / (in->time * in->time);
    lg_rng rng = test_rng(seed, 0);
    double hidden[ROWS], q[ROWS], v[ROWS], f = 0.0;
    m->first[1] = ROWS;
    m->log = (lg_machine_log){
        .rows = ROWS, .parts = 1, .first = m->first, .t = m->t, .q = m->q, .v = m->v, .u = m->u};
    for (size_t row = 0; row < ROWS; row++) {
        f = memory * f + sqrt(1.0 - memory * memory) * force * lg_rng_normal(&rng);
        hidden[row] = unit * f;
        m->t[row] = dt * in->time * (double)row;
        m->u[row * 4] = unit * 3.0 * lg_rng_normal(&rng) + hidden[row];
    }
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 2, &m->log, m->start, 1,
                                  ROWS - 1, q, v, NULL));
    for (size_t row = 0; row < ROWS; row++) {
        m->u[row * 4] -= hidden[row];
        m->q[row] = q[row] + in->length * noise * lg_rng_normal(&rng);
        m->v[row] = v[row] + in->length / in->time * noise * lg_rng_normal(&rng);
    }
}

static made *make(const units *in, double force, double memory, double noise, uint64_t seed,
                  uint32_t window) {
    made *m = TEST_ARRAY(made, 1);
    run(in, force, memory, noise, seed, m);
    m->machine = oscillator(in, false);
    assert_ok(lg_machine_find_scales(&m->machine, &m->log, NULL));
    m->problem = (lg_machine_problem){.machine = &m->machine,
                                      .scheme = lg_scheme_find("rkmk5"),
                                      .substeps = 1,
                                      .window = window,
                                      .starts = LG_MACHINE_STARTS_ESTIMATED,
                                      .log = m->log,
                                      .start = m->start,
                                      .position_scale = {in->length},
                                      .velocity_scale = {in->length / in->time}};
    m->problem.windows = lg_machine_windows(&m->machine, &m->log, window, window - 1, false, m->start);
    m->theta = TEST_ARRAY(double, lg_machine_problem_parameters(&m->problem));
    lg_rng rng = test_rng(1, 0);
    lg_machine_initialise(&m->machine, &rng, m->theta);
    lg_fit_problem fit;
    lg_machine_fit_problem(&m->problem, &fit);
    fit_by_lm(&fit, 40, m->theta);
    return m;
}

static lg_identification identify(const made *m, lg_identified *out) {
    lg_identification all = {.numbers = out};
    assert_ok(lg_machine_identify(NULL, &m->problem, m->theta, &all, NULL));
    return all;
}

/* How many of the numbers are within two of their errors, and how often the errors were corrected. */
static void cover(double force, double memory, double noise, uint32_t window, int repeats, int *inside,
                  int *corrected, double *ratio) {
    double told[NUMBERS] = {0.0}, square[NUMBERS] = {0.0};
    *inside = *corrected = 0;
    *ratio = 0.0;
    for (int i = 0; i < repeats; i++) {
        const size_t mark = lg_test_owned();
        lg_identified found[NUMBERS];
        const made *m = make(&usual, force, memory, noise, 500 + (uint64_t)i, window);
        *corrected += identify(m, found).block > 0.0;
        for (int k = 0; k < NUMBERS; k++) {
            const double off = found[k].value - truth[k];
            *inside += fabs(off) <= 2.0 * found[k].error;
            told[k] += found[k].error * found[k].error;
            square[k] += off * off;
        }
        lg_test_give_back(mark);
    }
    for (int k = 0; k < NUMBERS; k++) *ratio += sqrt(told[k] / square[k]) / NUMBERS;
}

TEST("numbers are within two of their errors in 95 of 100 cases, for white noise and for forces with a "
     "memory") {
    enum { REPEATS = 16, FEW = 2, LEAST = 43 };
    static const struct {
        double force, memory, noise;
    } cases[] = {{0.0, 0.0, 0.02}, {0.3, 0.5, 0.002}, {0.3, 0.9, 0.002}};
    for (size_t c = 0; c < LG_COUNT(cases); c++) {
        int inside, corrected;
        double ratio;
        cover(cases[c].force, cases[c].memory, cases[c].noise, 11, REPEATS, &inside, &corrected, &ratio);
        assert_true(inside >= LEAST);
        if (cases[c].memory > 0.0)
            assert_true(corrected == REPEATS && ratio > 0.9 && ratio < 1.6);
        else
            assert_true(corrected <= FEW && ratio > 0.85 && ratio < 1.1);
    }
}

/* The covariance of theta that a model file keeps gives the same errors: of the mass, whose number is
 * proportional to exp of its parameter, or to a power of it. */
TEST("covariance and errors of the numbers agree, also if the errors are corrected") {
    const made *m = make(&usual, 0.3, 0.9, 0.002, 7, 11);
    lg_identified found[NUMBERS], up[NUMBERS], down[NUMBERS];
    double spread[9], theta[NUMBERS];
    lg_identification all = {.numbers = found, .spread = spread};
    assert_int_equal(m->machine.parameters, NUMBERS);
    assert_ok(lg_machine_identify(NULL, &m->problem, m->theta, &all, NULL));
    assert_true(all.block > 4.0 * dt && all.block < 0.2 * dt * ROWS);
    for (int k = 0; k < NUMBERS; k++) {
        double variance = 0.0;
        for (int j = 0; j < NUMBERS; j++) {
            static const double step = 1e-4;
            for (int i = 0; i < NUMBERS; i++) theta[i] = m->theta[i] + step * spread[i * NUMBERS + j];
            (void)lg_machine_numbers(&m->machine, theta, NUMBERS, up);
            for (int i = 0; i < NUMBERS; i++) theta[i] = m->theta[i] - step * spread[i * NUMBERS + j];
            (void)lg_machine_numbers(&m->machine, theta, NUMBERS, down);
            const double slope = (up[k].value - down[k].value) / (2.0 * step);
            variance += slope * slope;
        }
        assert_close(sqrt(variance), found[k].error, 1e-3, 0.0);
    }
}

TEST("corrected errors do not depend on the units of mass, length and time") {
    static const units all[] = {{1e9, 1.0, 1.0}, {1.0, 1e-9, 1.0}, {1.0, 1.0, 1e9}, {1e-9, 1e9, 1e-9}};
    lg_identified usually[NUMBERS], found[NUMBERS];
    const lg_identification first = identify(make(&usual, 0.3, 0.9, 0.002, 7, 11), usually);
    for (size_t i = 0; i < LG_COUNT(all); i++) {
        const double unit[NUMBERS] = {all[i].mass, all[i].mass / (all[i].time * all[i].time),
                                      all[i].mass / all[i].time};
        const lg_identification same = identify(make(&all[i], 0.3, 0.9, 0.002, 7, 11), found);
        assert_close(same.block, first.block * all[i].time, 1e-6, 0.0);
        for (int k = 0; k < NUMBERS; k++) {
            assert_close(found[k].value, unit[k] * usually[k].value, 1e-5, 0.0);
            assert_close(found[k].error, unit[k] * usually[k].error, 1e-4, 0.0);
        }
    }
}

TEST("few windows: their stretches show the correlation too") {
    enum { LONG = 301 };
    lg_identified found[NUMBERS];
    const made *m = make(&usual, 0.3, 0.9, 0.002, 7, LONG);
    assert_true(m->problem.windows < 8);
    assert_true(identify(m, found).block > 0.0);
    for (int k = 0; k < NUMBERS; k++) assert_true(fabs(found[k].value - truth[k]) < 4.0 * found[k].error);
}

TEST("rows that are in two windows count once in the errors") {
    enum { WINDOW = 41, STARTS = 2 };
    lg_identified once[NUMBERS], twice[NUMBERS];
    const made *m = make(&usual, 0.0, 0.0, 0.02, 7, WINDOW);
    made *again = make(&usual, 0.0, 0.0, 0.02, 7, WINDOW);
    const size_t windows = m->problem.windows;
    again->problem.windows = 2 * windows;
    again->theta = TEST_ARRAY(double, NUMBERS + STARTS * 2 * windows);
    memcpy(again->theta, m->theta, NUMBERS * sizeof *m->theta);
    for (size_t w = 0; w < 2 * windows; w++) {
        again->start[w] = m->start[w / 2];
        for (size_t i = 0; i < STARTS; i++) /* in units of the square root of the number of windows */
            again->theta[NUMBERS + STARTS * w + i] = m->theta[NUMBERS + STARTS * (w / 2) + i] / sqrt(2.0);
    }
    assert_true(identify(m, once).block == 0.0);
    assert_true(identify(again, twice).block == 0.0);
    for (int k = 0; k < NUMBERS; k++) {
        assert_true(once[k].error < 0.1 * once[k].value);
        assert_close(twice[k].error, once[k].error, 1e-6, 0.0);
    }
}

TEST("scores of one kind are white, scores that drift are one block, and scores that are not finite say "
     "nothing") {
    enum { COUNT = 64 };
    for (int i = 0; i < 4; i++) {
        double h[COUNT], P = i == 3 ? 1 : 0, F = 7;
        size_t block = 7;
        for (int k = 0; k < COUNT; k++) h[k] = i == 1 ? k : i == 2 && k == 3 ? NAN : 1;
        assert_ok(lg_fit_colour(NULL, COUNT, 1, 1, 1.0, i == 2, &P, h, &F, &block));
        assert_int_equal(block, i == 1 ? COUNT / 8 : 0);
        if (i == 1) assert_true(F > 2);
    }
}

TEST("numbers that only appear together are told in words, and a text without room is cut") {
    static const struct {
        double move[4];
        size_t moving;
        const char *sentence;
    } rows[] = {
        {{1, -1, 0, 0}, 2, "m and k appear only as a product: give one of them as known"},
        {{0, 1, 1, 0}, 2, "k and d appear only as a ratio: give one of them as known"},
        {{-1, -0.99, -1, 0},
         3,
         "m, k and d are determined only up to a common factor: give one of them as known"},
        {{1, 0.99, 1, 1},
         4,
         "m, k, d and b are determined only up to a common factor: give one of them as known"},
        {{1, -0.25, 0, 0.5},
         3,
         "m by +1 %, k by -0.25 % and b by +0.5 % can change together without changing what the logs show: "
         "give "
         "one of them as known"},
        {{1, -1, -1, 0},
         3,
         "m by +1 %, k by -1 % and d by -1 % can change together without changing what the logs show: give "
         "one "
         "of them as known"},
    };
    lg_identified numbers[4] = {{.name = "m"}, {.name = "k"}, {.name = "d"}, {.name = "b"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double open[4];
        char text[200], little[9] = "********";
        memcpy(open, rows[i].move, sizeof open);
        const lg_identification of = {.numbers = numbers, .open = open, .open_count = 1};
        assert_int_equal(lg_identification_sentence(&of, 4, 0, text, sizeof text), rows[i].moving);
        assert_string_equal(text, rows[i].sentence);
        assert_int_equal(lg_identification_sentence(&of, 4, 0, little, 4), rows[i].moving);
        assert_true(strlen(little) <= 3 && strncmp(text, little, strlen(little)) == 0);
        assert_string_equal(little + 4, "****");
        little[0] = 'x';
        assert_int_equal(lg_identification_sentence(&of, 4, 0, little, 0), rows[i].moving);
        assert_int_equal(little[0], 'x');
    }
}

/* ---- a few numbers ---- */

/* theta moved so that friction has the factor 1/1.2, and the restriction to this factor, in units of .1. */
static lg_machine_restriction weaker(const made *m, double *theta, double *direction) {
    assert_true(lg_machine_scale_friction(&m->machine, m->theta, direction));
    memcpy(theta, m->theta, m->machine.parameters * sizeof *theta);
    for (size_t i = 0; i < m->machine.parameters; i++) {
        if (direction[i] != 0.0) theta[i] /= sqrt(1.2);
        direction[i] *= 0.1 / sqrt(1.2);
    }
    return (lg_machine_restriction){&m->problem, theta, 1, direction};
}

TEST("a restricted problem has the loss of the moved machine, and the Jacobian of its residuals") {
    const made *m = make(&usual, 0.0, 0.0, 0.01, 3, 11);
    double theta[NUMBERS], direction[NUMBERS];
    const lg_machine_restriction restriction = weaker(m, theta, direction);
    const size_t starts = 2 * m->problem.windows;
    double *x = TEST_ARRAY(double, 1 + starts), *all = TEST_ARRAY(double, NUMBERS + starts), before, after;
    lg_fit_problem fit, without;
    lg_machine_restricted_problem(&restriction, &fit);
    assert_int_equal(fit.parameters, 1 + starts);
    without = fit;
    without.own = 0;
    without.linearise = NULL;
    double *y = TEST_ARRAY(double, 1 + starts);
    fit_by_lm(&fit, 20, x);
    fit_by_lm(&without, 20, y);
    for (size_t i = 0; i < fit.parameters; i++) assert_close(x[i], y[i], 1e-6, 1e-8);
    for (int i = 0; i < NUMBERS; i++) all[i] = theta[i] + x[0] * direction[i];
    memcpy(all + NUMBERS, x + 1, starts * sizeof *x);
    assert_ok(lg_machine_loss(NULL, &m->problem, all, &after, NULL, NULL));
    assert_ok(lg_machine_loss(NULL, &m->problem, m->theta, &before, NULL, NULL));
    assert_close(after, before, 0.02, 0.0);
}

TEST("with measured starts the variables of a restricted problem are its numbers, and its loss is the loss "
     "of the moved machine") {
    made *m = make(&usual, 0.0, 0.0, 0.01, 3, 11);
    double theta[NUMBERS], direction[NUMBERS], moved[NUMBERS], losses[2];
    const double x = 0.3;
    const uint32_t samples[3] = {0, 2, 5};
    m->problem.starts = LG_MACHINE_STARTS_MEASURED;
    const lg_machine_restriction restriction = weaker(m, theta, direction);
    lg_fit_problem fit, all;
    lg_machine_restricted_problem(&restriction, &fit);
    lg_machine_fit_problem(&m->problem, &all);
    assert_int_equal(fit.parameters, 1);
    for (int i = 0; i < NUMBERS; i++) moved[i] = theta[i] + x * direction[i];
    for (int i = 0; i < 2; i++) {
        const lg_fit_problem *each = i == 0 ? &fit : &all;
        lg_tape *tape = test_tape(LG_F64);
        lg_var r;
        assert_ok(each->residuals(
            each->user, tape, lg_parameter(tape, lg_shape1((uint32_t)each->parameters), i == 0 ? &x : moved),
            samples, 3, 3, &r));
        assert_ok(lg_read(tape, lg_sum(tape, lg_square(tape, r)), 1, &losses[i]));
    }
    assert_close(losses[0], losses[1], 1e-13, 0);
}

TEST("friction that is 20 percent higher is found by one number; little data leave it at its prior") {
    const made *m = make(&usual, 0.0, 0.0, 0.01, 3, 11);
    double theta[NUMBERS], direction[NUMBERS], x, error, alone;
    const lg_machine_restriction restriction = weaker(m, theta, direction);
    lg_machine_adapted found = {.x = &x, .error = &error, .alone = &alone};
    assert_ok(lg_machine_adapt(NULL, &restriction, &found, NULL));
    assert_true(found.after < found.before && error < 0.2 && fabs(error - alone) < 0.1 * alone);
    assert_close((1.0 + 0.05 * x) * (1.0 + 0.05 * x), 1.2, 0.03, 0.0);
    made *little = make(&usual, 0.0, 0.0, 2.0, 3, 11);
    little->problem.windows = 2;
    const lg_machine_restriction same = {&little->problem, theta, 1, direction};
    assert_ok(lg_machine_adapt(NULL, &same, &found, NULL));
    assert_true(fabs(x) < 1.0 && error > 0.9 && error <= 1.0 && alone > 2.0);
}

TEST("errors of numbers can be cancelled") {
    const made *m = make(&usual, 0.0, 0.0, 0.01, 500, 20);
    lg_identified found[NUMBERS];
    lg_identification all = {.numbers = found};
    volatile int cancel = 1;
    lg_context_options how;
    lg_context *context = NULL;
    lg_context_options_init(&how);
    how.cancel = &cancel;
    assert_ok(lg_context_create(&how, &context));
    LG_STATUS_OF(lg_machine_identify(context, &m->problem, m->theta, &all, NULL), status);
    lg_context_destroy(context);
    assert_int_equal(status, LG_CANCELLED);
}
