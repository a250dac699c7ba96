/* Machines learned from logs that the tests make: parameters, starts, standard errors.
 * ctest-labels: src/machine */
#include "support/machine_support.h"

#include "liegrad/geometry.h"

enum { PARTS = 6, ROWS = 41, ALL = PARTS * ROWS };

/* An oscillator with m = 2, k = 8, damping .3, driven by u. */
static const double mass = 2.0, stiffness = 8.0, damping = 0.3, dt = 0.1;

static lg_machine oscillator(bool known) {
    const double unit[] = {1.0}, half = 0.5 * stiffness;
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_input(&machine, "u");
    lg_machine_term *m = add_term(&machine, LG_MACHINE_MASS, known ? "known" : "diagonal");
    lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(V, LG_FEATURE_POSITION, 0);
    lg_machine_term *D = add_term(&machine, LG_MACHINE_DAMPING, known ? "known" : "diagonal");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 1, unit);
    if (known) {
        add_values(m, 1, &mass);
        add_values(V, 1, &half);
        add_values(D, 1, &damping);
    }
    assert_machine(&machine);
    return machine;
}

/* Logs of the known oscillator from random starts, with random inputs that are held between rows. */
typedef struct logs {
    size_t first[PARTS + 1], start[PARTS];
    double t[ALL], q[ALL], v[ALL], u[ALL * 4];
    lg_machine_log log;
} logs;

static logs *make_logs(double noise, uint64_t seed) {
    const lg_machine machine = oscillator(true);
    logs *l = TEST_ARRAY(logs, 1);
    double q[ALL], v[ALL];
    lg_rng rng = test_rng(seed, 0);
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, l->u, NULL, NULL, NULL};
    for (size_t row = 0; row < ALL; row++) {
        l->first[row / ROWS] = l->start[row / ROWS] = row / ROWS * ROWS;
        l->t[row] = dt * (double)(row % ROWS);
        l->q[row] = lg_rng_normal(&rng);
        l->v[row] = lg_rng_normal(&rng);
        l->u[row * 4] = 3.0 * lg_rng_normal(&rng);
    }
    l->first[PARTS] = ALL;
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 4, &l->log, l->start, PARTS,
                                  ROWS - 1, q, v, NULL));
    for (size_t row = 0; row < ALL; row++) {
        l->q[row] = q[row] + noise * lg_rng_normal(&rng);
        l->v[row] = v[row] + noise * lg_rng_normal(&rng);
    }
    return l;
}

/* The learning problem of a machine with windows of 11 rows. */
typedef struct task {
    lg_machine machine;
    lg_machine_problem problem;
    size_t start[ALL];
    double *theta;
} task;

static task *make_task(const logs *l, lg_machine_starts starts) {
    task *t = TEST_ARRAY(task, 1);
    t->machine = oscillator(false);
    assert_ok(lg_machine_find_scales(&t->machine, &l->log, NULL));
    t->problem = (lg_machine_problem){.machine = &t->machine,
                                      .scheme = lg_scheme_find("rkmk5"),
                                      .substeps = 2,
                                      .window = 11,
                                      .starts = starts,
                                      .log = l->log,
                                      .start = t->start,
                                      .position_scale = {1.0},
                                      .velocity_scale = {1.0}};
    t->problem.windows = lg_machine_windows(&t->machine, &l->log, 11, 10, false, t->start);
    assert_int_equal(t->problem.windows, 4 * PARTS);
    assert_ok(lg_machine_problem_check(&t->problem, NULL));
    t->theta = TEST_ARRAY(double, lg_machine_problem_parameters(&t->problem));
    lg_rng rng = test_rng(1, 0);
    lg_machine_initialise(&t->machine, &rng, t->theta);
    return t;
}

/* `own`: Levenberg-Marquardt eliminates the starts of each window from its matrix. */
static void fit(task *t, bool own) {
    lg_fit_problem problem;
    lg_machine_fit_problem(&t->problem, &problem);
    if (!own) {
        problem.own = 0;
        problem.linearise = NULL;
    }
    fit_by_lm(&problem, 60, t->theta);
}

enum { NUMBERS = 3 };
static const char *const names[NUMBERS] = {"mass.1.1", "potential.x^2", "damping.x"};
static const double truth[NUMBERS] = {2.0, 4.0, 0.3};

static void read_numbers(const task *t, lg_identified *out) {
    assert_int_equal(lg_machine_numbers(&t->machine, t->theta, NUMBERS, out), NUMBERS);
    for (int i = 0; i < NUMBERS; i++) assert_string_equal(out[i].name, names[i]);
}

TEST("mass, spring and damping are exact for exact logs, in the units of the logs") {
    task *t = make_task(make_logs(0.0, 3), LG_MACHINE_STARTS_MEASURED);
    lg_identified found[NUMBERS];
    double loss, floor;
    fit(t, true);
    read_numbers(t, found);
    for (int i = 0; i < NUMBERS; i++) assert_close(found[i].value, truth[i], 1e-6, 0.0);
    assert_ok(lg_machine_loss(NULL, &t->problem, t->theta, &loss, &floor, NULL));
    assert_true(loss < 1e-12 && floor < 1e-12 && floor > 0.0);
}

/* ---- windows ---- */

/* Whether a window that contains the row starts at a complete row and lies in the part. */
static bool is_usable(const lg_machine *machine, const lg_machine_log *log, uint32_t window, bool positions,
                      size_t part, size_t row) {
    for (size_t s = log->first[part]; s <= row && s + window <= log->first[part + 1]; s++)
        if (s + window > row && lg_machine_log_complete(machine, log, s, positions)) return true;
    return false;
}

TEST("every row that can be in a window is in one: random lengths, gaps, missing numbers, windows, "
     "strides") {
    enum { MOST = 120, CASES = 4000 };
    lg_machine machine = oscillator(false);
    lg_rng rng = test_rng(5, 0);
    for (int each = 0; each < CASES; each++) {
        double t[MOST], q[MOST], v[MOST];
        size_t first[MOST + 1] = {0}, start[MOST], parts = 0, at = 0;
        const size_t rows = 2 + lg_rng_below(&rng, MOST - 2), one_in = 2 + lg_rng_below(&rng, 30);
        while (first[parts] < rows) {
            const size_t next = first[parts] + 1 + lg_rng_below(&rng, rows);
            first[++parts] = next < rows ? next : rows;
        }
        for (size_t row = 0; row < rows; row++) {
            t[row] = (double)row;
            q[row] = lg_rng_below(&rng, one_in) == 0 ? (double)NAN : 1.0;
            v[row] = lg_rng_below(&rng, one_in) == 0 ? (double)NAN : 1.0;
        }
        const lg_machine_log log = {rows, parts, first, t, q, v, NULL, NULL, NULL, NULL};
        const uint32_t window = 2 + (uint32_t)lg_rng_below(&rng, 20),
                       stride = 1 + (uint32_t)lg_rng_below(&rng, each % 4 == 0 ? 2 * window : window);
        const bool positions = each % 3 == 0;
        const size_t count = lg_machine_windows(&machine, &log, window, stride, positions, start);
        assert_int_equal(lg_machine_windows(&machine, &log, window, stride, positions, NULL), count);
        for (size_t p = 0; p < parts; p++) {
            size_t after = first[p]; /* rows before `after` follow the start of a window */
            for (; at < count && start[at] < first[p + 1]; at++) {
                assert_true(at == 0 || start[at] > start[at - 1]);
                assert_true(start[at] >= first[p] && start[at] + window <= first[p + 1]);
                assert_true(lg_machine_log_complete(&machine, &log, start[at], positions));
                for (; after < start[at]; after++)
                    if (stride <= window)
                        assert_false(is_usable(&machine, &log, window, positions, p, after));
                after = start[at] + window;
            }
            for (; after < first[p + 1]; after++)
                assert_false(is_usable(&machine, &log, window, positions, p, after));
        }
        assert_int_equal(at, count);
    }
}

TEST("biases of sensors are found, with measured and with estimated starts") {
    enum { BIASES = 2 };
    static const double bias[BIASES] = {0.3, -0.2};
    for (int starts = 0; starts < 2; starts++) {
        logs *l = make_logs(0.0, 3);
        for (size_t row = 0; row < ALL; row++) l->q[row] += bias[0], l->v[row] += bias[1];
        task *t = make_task(l, (lg_machine_starts)starts);
        const lg_machine_scales scales = t->machine.scales;
        lg_identified found[BIASES];
        t->machine = oscillator(true);
        lg_machine_term *term = add_term(&t->machine, LG_MACHINE_BIAS, "constant");
        add_feature(term, LG_FEATURE_POSITION, 0);
        add_feature(term, LG_FEATURE_VELOCITY, 0);
        assert_machine(&t->machine);
        t->machine.scales = scales;
        for (size_t i = 0; i < lg_machine_problem_parameters(&t->problem); i++) t->theta[i] = 0.0;
        fit(t, true);
        assert_int_equal(lg_machine_numbers(&t->machine, t->theta, BIASES, found), BIASES);
        assert_string_equal(found[0].name, "bias.x");
        assert_string_equal(found[1].name, "bias.x.velocity");
        for (int i = 0; i < BIASES; i++) assert_close(found[i].value, bias[i], 1e-6, 0.0);
    }
}

TEST("biases of angles are converted to (-pi, pi], other biases are not") {
    static const double pi = 3.14159265358979323846;
    static const double angles[][2] = {{0.0, 0.0},
                                       {0.1, 0.1},
                                       {4 * 3.14159265358979323846, 0.0},
                                       {-7.0, -0.7168146928204138},
                                       {3.2, -3.083185307179586},
                                       {-3.2, 3.083185307179586},
                                       {1e4, -2.8310090299012813}};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_coordinate(&machine, "hull", LG_COORDINATE_POSE);
    add_coordinate(&machine, "b", LG_COORDINATE_ANGLE);
    (void)add_term(&machine, LG_MACHINE_MASS, "diagonal");
    lg_machine_term *bias = add_term(&machine, LG_MACHINE_BIAS, "constant");
    for (uint32_t i = 0; i < 4; i++) add_feature(bias, i == 2 ? LG_FEATURE_PLACE : LG_FEATURE_POSITION, i);
    add_feature(bias, LG_FEATURE_VELOCITY, 1);
    assert_machine(&machine);
    /* order of the biases: x, a, 3 of the hull, b, the rate of a */
    const size_t at = machine.terms[1].offset;
    double *theta = TEST_ARRAY(double, machine.parameters);
    for (size_t k = 0; k < LG_COUNT(angles); k++) {
        for (size_t i = 0; i < machine.parameters; i++) theta[i] = 9.0;
        theta[at + 1] = angles[k][0], theta[at + 5] = -angles[k][0];
        lg_machine_wrap_biases(&machine, theta);
        assert_close(theta[at + 1], angles[k][1], 1e-6, 1e-12);
        assert_close(theta[at + 5], -angles[k][1], 1e-6, 1e-12);
        for (size_t i = 0; i < machine.parameters; i++)
            if (i != at + 1 && i != at + 5) assert_close(theta[i], 9.0, 0.0, 0.0);
    }
    theta[at + 1] = -pi, theta[at + 5] = pi;
    lg_machine_wrap_biases(&machine, theta);
    assert_true(theta[at + 1] > 0.0 && theta[at + 5] > 0.0);
}

TEST("eliminated starts give the same fit as starts among the parameters") {
    const logs *l = make_logs(0.01, 4);
    task *a = make_task(l, LG_MACHINE_STARTS_ESTIMATED), *b = make_task(l, LG_MACHINE_STARTS_ESTIMATED);
    fit(a, true);
    fit(b, false);
    const size_t n = lg_machine_problem_parameters(&a->problem);
    assert_int_equal(n, a->machine.parameters + 2 * a->problem.windows);
    for (size_t i = 0; i < n; i++) assert_close(a->theta[i], b->theta[i], 1e-6, 1e-8);
}

TEST("if the machine is known only its starts are learned, and without starts nothing") {
    const logs *l = make_logs(0.01, 6);
    task *all = make_task(l, LG_MACHINE_STARTS_ESTIMATED), *a = make_task(l, LG_MACHINE_STARTS_ESTIMATED),
         *b = make_task(l, LG_MACHINE_STARTS_ESTIMATED);
    fit(all, true);
    const size_t shared = all->machine.parameters, n = 2 * all->problem.windows;
    a->problem.theta = b->problem.theta = all->theta;
    assert_int_equal(lg_machine_problem_parameters(&a->problem), n);
    memset(a->theta, 0, n * sizeof *a->theta);
    memset(b->theta, 0, n * sizeof *b->theta);
    fit(a, true);
    fit(b, false);
    for (size_t i = 0; i < n; i++) {
        assert_close(a->theta[i], all->theta[shared + i], 1e-6, 1e-6);
        assert_close(a->theta[i], b->theta[i], 1e-6, 1e-8);
    }
    double loss, same;
    assert_ok(lg_machine_loss(NULL, &a->problem, a->theta, &loss, NULL, NULL));
    assert_ok(lg_machine_loss(NULL, &all->problem, all->theta, &same, NULL, NULL));
    assert_close(loss, same, 1e-9, 0.0);
    a->problem.starts = LG_MACHINE_STARTS_MEASURED;
    assert_status(lg_machine_problem_check(&a->problem, NULL), LG_INVALID_ARGUMENT);
    const lg_machine known = oscillator(true);
    lg_identification nothing = {.open_count = 7};
    a->problem.machine = &known;
    a->problem.theta = NULL;
    assert_ok(lg_machine_identify(NULL, &a->problem, a->theta, &nothing, NULL));
    assert_int_equal(nothing.open_count, 0);
}

TEST("training problems that cannot be learned are refused, with the reason") {
    const logs *l = make_logs(0.0, 3);
#define REFUSED(status, sentence, ...)                                                                       \
    do {                                                                                                     \
        lg_error error_ = {LG_OK, ""};                                                                       \
        lg_machine_problem *p = &make_task(l, LG_MACHINE_STARTS_MEASURED)->problem;                          \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_machine_problem_check(p, &error_), status);                                         \
        assert_says(error_.message, sentence);                                                               \
    } while (0)
    REFUSED(LG_INVALID_ARGUMENT, "no window of 11 rows without a gap", p->windows = 0);
    REFUSED(LG_INVALID_ARGUMENT, "no window of 11 rows without a gap", p->windows = (size_t)UINT32_MAX + 1);
    REFUSED(LG_INVALID_ARGUMENT, "at least 2 rows", p->window = 1);
    REFUSED(LG_INVALID_ARGUMENT, "at least 1 substep", p->substeps = 0);
    REFUSED(LG_INVALID_ARGUMENT, "no windows are left for training", p->validation = p->windows);
    REFUSED(LG_INVALID_ARGUMENT, "the scales of the loss", p->position_scale[0] = 0);
    REFUSED(LG_INVALID_ARGUMENT, "the scales of the loss", p->velocity_scale[0] = INFINITY);
    REFUSED(LG_INVALID_ARGUMENT, "no accelerations", lg_machine given = *p->machine;
            given.accelerations = true; p->machine = &given);
    REFUSED(LG_UNSUPPORTED,
            "midpoint is an implicit, splitting or slgi scheme, which machines do not have; take cf4, rkmk4 "
            "or another explicit Lie group scheme, or variational",
            p->scheme = lg_scheme_find("midpoint"));
    lg_machine turning = all_coordinates();
    add_term(&turning, LG_MACHINE_MASS, "diagonal");
    add_term(&turning, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&turning);
    REFUSED(LG_UNSUPPORTED, "rk4 does not stay on the manifold", p->scheme = lg_scheme_find("rk4");
            p->machine = &turning;
            for (int i = 0; i < LG_MACHINE_COORDINATES; i++) p->position_scale[i] = p->velocity_scale[i] = 1);
#undef REFUSED
    lg_machine_problem *p = &make_task(l, LG_MACHINE_STARTS_MEASURED)->problem;
    lg_fit_problem whole;
    p->scheme = lg_scheme_find("rk4"); /* a line is flat */
    assert_ok(lg_machine_problem_check(p, NULL));
    p->window = 100000;
    lg_machine_fit_problem(p, &whole);
    assert_int_equal(whole.chunk, 1);
}

TEST("states are estimated from logs of accelerations; if a log is shorter than a window, the guesses stay") {
    const logs *l = make_logs(0.0, 3);
    const task *t = make_task(l, LG_MACHINE_STARTS_ESTIMATED);
    lg_machine machine = t->machine;
    lg_machine_log log = l->log;
    double q[ALL], v[ALL];
    lg_error error;
#define ESTIMATE(theta, rows)                                                                                \
    lg_machine_estimate_states(NULL, &machine, theta, t->problem.scheme, 1, &log, rows, q, v, &error)
    assert_status(ESTIMATE(NULL, 11), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the machine has parameters, and they are NULL");
    assert_status(ESTIMATE(t->theta, 11), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the log has no accelerations");
    machine.accelerations = true;
    assert_status(ESTIMATE(t->theta, 11), LG_INVALID_ARGUMENT);
    log.a = l->v;
    assert_ok(ESTIMATE(t->theta, ROWS + 1));
    assert_memory_equal(q, log.q, sizeof q);
    assert_memory_equal(v, log.v, sizeof v);
#undef ESTIMATE
}

TEST("where squares of residuals overflow, the expected loss is not finite, which is no lack of memory") {
    task *t = make_task(make_logs(0.0, 3), LG_MACHINE_STARTS_MEASURED);
    const lg_machine_noise noise = {.position = {1}, .velocity = {1}};
    lg_machine_expected found;
    t->problem.position_scale[0] = 1e-200;
    assert_ok(lg_machine_expect(NULL, &t->problem, t->theta, &noise, &found, NULL));
    assert_false(isfinite(found.loss));
}

/* A machine of many lines, whose polynomials would be too many terms. */
static lg_machine many_lines(void) {
    lg_machine machine = empty_machine();
    for (int i = 0; i < LG_MACHINE_COORDINATES; i++)
        add_coordinate(&machine, test_text("x%d", i), LG_COORDINATE_LINE);
    add_term(&machine, LG_MACHINE_MASS, "constant");
    add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    add_term(&machine, LG_MACHINE_DAMPING, "coulomb");
    assert_machine(&machine);
    return machine;
}

TEST("missing forces are not sought where there is no room for their terms, or nothing is learned") {
    const logs *l = make_logs(0.0, 3);
    lg_machine many = many_lines(), large = many;
    large.term_count = 1;
    large.terms[0].kind = lg_term_kind_find(LG_MACHINE_MASS, "known");
    add_values(&large.terms[0], 1, (double[]){1});
    large.parameters = 129;
    for (int i = 0; i < 3; i++) {
        task *t = make_task(l, LG_MACHINE_STARTS_ESTIMATED);
        lg_machine_missing found = {.loss = 7, .ratio = 7};
        if (i == 0) t->problem.machine = &many;
        if (i == 1) t->problem.machine = &large;
        if (i == 2) t->problem.theta = t->theta;
        assert_ok(lg_machine_find_missing(NULL, &t->problem, t->theta, &found, NULL));
        assert_true(found.loss == 0 && found.ratio == 0);
    }
}

TEST("starts of directions and rotations, and starts that are not estimated, are not continued") {
    const logs *l = make_logs(0.0, 3);
    double losses[ALL];
    lg_error error;
    for (int i = 0; i < 3; i++) {
        task *t = make_task(l, i == 0 ? LG_MACHINE_STARTS_MEASURED : LG_MACHINE_STARTS_ESTIMATED);
        lg_machine other = empty_machine();
        if (i > 0) {
            add_coordinate(&other, "r", i == 1 ? LG_COORDINATE_DIRECTION : LG_COORDINATE_ROTATION);
            add_term(&other, LG_MACHINE_MASS, "diagonal");
            assert_machine(&other);
            t->problem.machine = &other;
        }
        assert_status(lg_machine_continue_starts(NULL, &t->problem, t->theta, losses, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, "only estimated starts of lines and angles are continued");
    }
}

TEST("free runs without starts or substeps are refused, and a run can be cancelled") {
    const logs *l = make_logs(0.0, 3);
    const lg_machine machine = oscillator(true);
    const lg_scheme *scheme = lg_scheme_find("cf4");
    static const size_t counts[] = {0, (size_t)UINT32_MAX + 1, 1};
    volatile int cancel = 1;
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        assert_status(lg_machine_free_run(NULL, &machine, NULL, scheme, i < 2, &l->log, l->start, counts[i],
                                          1, NULL, NULL, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, "at least one start and one substep");
    }
    lg_context_options how;
    lg_context *context = NULL;
    lg_context_options_init(&how);
    how.cancel = &cancel;
    assert_ok(lg_context_create(&how, &context));
    LG_STATUS_OF(
        lg_machine_free_run(context, &machine, NULL, scheme, 1, &l->log, l->start, 1, 1, NULL, NULL, &error),
        status);
    lg_context_destroy(context);
    assert_int_equal(status, LG_CANCELLED);
    assert_says(error.message, "the runs were stopped");
}

TEST("runs to the ends of their parts are the runs of so many steps; other rows are NaN") {
    const logs *l = make_logs(0.1, 7);
    const lg_machine machine = oscillator(true);
    const lg_scheme *scheme = lg_scheme_find("cf4");
    size_t start[PARTS], count = 0;
    double q[ALL], v[ALL], one_q[ROWS], one_v[ROWS];
    for (size_t p = 0; p < PARTS; p += 2)
        start[count++] = l->first[p] + (5 * p + 3) % ROWS; /* unequal lengths */
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, scheme, 2, &l->log, start, count, LG_MACHINE_TO_END,
                                  q, v, NULL));
    for (size_t row = 0, i = 0; row < ALL; row++) {
        while (i + 1 < count && row >= start[i + 1]) i++;
        const size_t end = l->first[start[i] / ROWS + 1];
        if (row == start[i])
            assert_ok(lg_machine_free_run(NULL, &machine, NULL, scheme, 2, &l->log, &start[i], 1,
                                          end - row - 1, one_q, one_v, NULL));
        assert_true((row < start[i] || row >= end) == (bool)isnan(q[row]) && isnan(q[row]) == isnan(v[row]));
        if (isnan(q[row])) continue;
        assert_close(q[row], one_q[row - start[i]], 1e-13, 1e-13);
        assert_close(v[row], one_v[row - start[i]], 1e-13, 1e-13);
    }
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, scheme, 2, &l->log, start, 0, LG_MACHINE_TO_END, q,
                                  NULL, NULL));
    for (size_t row = 0; row < ALL; row++) assert_true(isnan(q[row]));
}

/* ---- scales of logs ---- */

enum { FEW = 6 };

/* Two lines, an input and a diagonal mass after a potential. */
static lg_machine two_lines(void) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "y", LG_COORDINATE_LINE);
    add_input(&machine, "u");
    add_feature(add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic"), LG_FEATURE_POSITION, 0);
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

/* Finds the scales from a log of the velocities vx and vy (FEW). */
static lg_status scales_of(lg_machine *machine, const double *vx, const double *vy, lg_error *error) {
    static const size_t first[] = {0, FEW};
    double t[FEW], q[2 * FEW], v[2 * FEW], u[4 * FEW] = {0};
    for (size_t i = 0; i < FEW; i++) {
        t[i] = 0.1 * (double)i;
        q[2 * i] = q[2 * i + 1] = 0;
        v[2 * i] = vx[i], v[2 * i + 1] = vy[i];
    }
    const lg_machine_log log = {.rows = FEW, .parts = 1, .first = first, .t = t, .q = q, .v = v, .u = u};
    LG_STATUS_OF(lg_machine_find_scales(machine, &log, error), status);
    return status;
}

TEST("a log in which nothing moves, or nothing changes its speed, or numbers overflow, gives no scales") {
    static const struct {
        double v[FEW];
        const char *sentence;
    } rows[] = {
        {{0}, "nothing moves in the logs"},
        {{2, 2, 2, 2, 2, 2}, "all velocities are constant in the logs"},
        {{1e200, -1e200, 1e200, -1e200, 1e200, -1e200}, "in the logs overflow: give them in larger units"},
        {{1.5e308, -1.5e308, 1e308, 0, 0, 0}, "in the logs overflow: give them in larger units"}};
    static const double rest[FEW] = {0};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_machine machine = two_lines();
        lg_error error = {LG_OK, ""};
        assert_int_equal(scales_of(&machine, rows[i].v, rest, &error), LG_FORMAT);
        assert_says(error.message, rows[i].sentence);
        assert_close(machine.scales.time, 1, 0, 0);
    }
}

TEST("a coordinate that rests, or keeps its speed, and an input that stays 0 have scales of 1, and their "
     "missing rows do not count") {
    static const double moves[FEW] = {1, -1, 1, -1, 1, -1}, rest[FEW] = {0}, steady[FEW] = {3, 3, 3, 3, 3, 3};
    lg_machine machine = two_lines();
    assert_int_equal(scales_of(&machine, moves, rest, NULL), LG_OK);
    assert_close(machine.scales.time, 1.0 / 20, 1e-14, 0);
    assert_close(machine.scales.place[0], 1.0 / 20, 1e-14, 0);
    assert_close(machine.scales.place[1], 1, 0, 0);
    assert_close(machine.scales.input[0], 1, 0, 0);
    assert_close(machine.scales.fastest[1], 1, 0, 0); /* the largest speed of all */
    assert_close(machine.scales.held, 1, 0, 0);
    assert_int_equal(scales_of(&machine, moves, steady, NULL), LG_OK);
    assert_close(machine.scales.time, 1.0 / 20, 1e-14, 0);
    assert_close(machine.scales.fastest[1], 3, 0, 0);
    assert_int_equal(scales_of(&machine, steady, moves, NULL), LG_OK);
    assert_close(machine.scales.held, 2, 0, 0); /* the mass whose velocity changes most */
}

static lg_status identify(const task *t, lg_identified *out) {
    lg_identification all = {.numbers = out};
    return lg_machine_identify(NULL, &t->problem, t->theta, &all, NULL);
}

TEST("standard errors agree with the scatter over repeated logs, with starts measured exactly or "
     "estimated") {
    enum { REPEATS = 60 };
    double sum[NUMBERS] = {0}, squares[NUMBERS] = {0}, told[NUMBERS] = {0};
    for (uint64_t i = 0; i < REPEATS; i++) {
        const size_t mark = lg_test_owned();
        task *t = make_task(make_logs(0.02, 100 + i), LG_MACHINE_STARTS_ESTIMATED);
        lg_identified found[NUMBERS];
        fit(t, true);
        assert_ok(identify(t, found));
        for (int k = 0; k < NUMBERS; k++) {
            sum[k] += found[k].value - truth[k];
            squares[k] += (found[k].value - truth[k]) * (found[k].value - truth[k]);
            told[k] += found[k].error / REPEATS;
        }
        lg_test_give_back(mark);
    }
    for (int k = 0; k < NUMBERS; k++) {
        const double spread = sqrt(squares[k] / REPEATS), bias = sum[k] / REPEATS;
        assert_true(fabs(bias) < 4.0 * spread / sqrt(REPEATS));
        assert_close(told[k], spread, 0.35, 0.0);
    }
}

TEST("a number that the logs do not show has an infinite error: an input map whose input stays 0") {
    logs *l = make_logs(0.01, 5);
    task *t = make_task(l, LG_MACHINE_STARTS_MEASURED);
    lg_identified found[NUMBERS + 1];
    for (size_t i = 0; i < 4 * ALL; i++) l->u[i] = 0.0;
    t->machine.terms[0].kind = lg_term_kind_find(LG_MACHINE_MASS, "known");
    add_values(&t->machine.terms[0], 1, &mass);
    t->machine.terms[3].kind = lg_term_kind_find(LG_MACHINE_INPUT_MAP, "constant");
    t->machine.terms[3].value_count = 0;
    assert_machine(&t->machine);
    assert_int_equal(lg_machine_numbers(&t->machine, t->theta, 3, found), 3);
    fit(t, true);
    assert_ok(identify(t, found));
    assert_string_equal(found[2].name, "input_map.1.1");
    assert_true(found[0].error < 0.2 && found[1].error < 0.2 && isinf(found[2].error));
}

/* Identifies the numbers with damping of this kind, whose parameter is moved from its best value. */
static void identify_moved(task *t, const char *kind, double damping_at, lg_identification *of) {
    t->machine.terms[2].kind = lg_term_kind_find(LG_MACHINE_DAMPING, kind);
    assert_machine(&t->machine);
    const size_t at = t->machine.terms[2].offset;
    const double before = t->theta[at];
    t->theta[at] = damping_at;
    assert_ok(lg_machine_identify(NULL, &t->problem, t->theta, of, NULL));
    t->theta[at] = before;
}

TEST("numbers at a bound have the error that they have near the bound") {
    static const char *const kinds[] = {"diagonal", "constant", "coulomb", "quadratic"};
    static const double near[] = {0.0, 1e-200, -1e-30, 1e-9, 1e-3};
    lg_identified found[NUMBERS];
    double correlations[NUMBERS * NUMBERS], open[NUMBERS * NUMBERS];
    lg_identification of = {.numbers = found, .correlations = correlations, .open = open};
    for (size_t k = 0; k < LG_COUNT(kinds); k++) {
        task *t = make_task(make_logs(0.01, 5), LG_MACHINE_STARTS_ESTIMATED);
        fit(t, true);
        identify_moved(t, kinds[k], 0.05, &of);
        const double error = found[2].error;
        assert_true(error > 0.0 && error < 0.2);
        for (size_t i = 0; i < LG_COUNT(near); i++) {
            identify_moved(t, kinds[k], near[i], &of);
            assert_close(found[2].error, error, 0.25, 0.0);
            assert_true(fabs(correlations[2]) < 1.0 && isfinite(correlations[2 * NUMBERS]));
        }
    }
}

/* ---- the position at which the mass of a network is reported ---- */

/* The oscillator with a network of x as mass, and logs shifted by `far`. */
static task *make_network_task(double far) {
    logs *l = make_logs(0.0, 3);
    for (size_t row = 0; row < ALL; row++) l->q[row] += far;
    task *t = make_task(l, LG_MACHINE_STARTS_MEASURED);
    t->machine.terms[0].kind = lg_term_kind_find(LG_MACHINE_MASS, "network");
    t->machine.terms[0].hidden[0] = 5, t->machine.terms[0].hidden_layers = 1;
    add_feature(&t->machine.terms[0], LG_FEATURE_POSITION, 0);
    assert_machine(&t->machine);
    return t;
}

TEST("the mass of a network is reported at 0 if the logs come there, otherwise at the start nearest to "
     "their mean") {
    double at = 7, mean = 0, best = 1e9;
    assert_false(lg_machine_mass_at(&make_task(make_logs(0.0, 3), LG_MACHINE_STARTS_MEASURED)->problem, &at));
    assert_true(lg_machine_mass_at(&make_network_task(0)->problem, &at));
    task *none = make_network_task(0);
    none->problem.validation = none->problem.windows;
    assert_true(lg_machine_mass_at(&none->problem, &at));
    assert_close(at, 0, 0, 0);
    task *t = make_network_task(20);
    const lg_machine_problem *p = &t->problem;
    assert_true(lg_machine_mass_at(p, &at));
    for (size_t i = 0; i < p->windows; i++) mean += p->log.q[p->start[i]] / (double)p->windows;
    for (size_t i = 0; i < p->windows; i++) {
        const double q = p->log.q[p->start[i]];
        if (fabs(q - mean) < fabs(best - mean)) best = q;
    }
    assert_close(at, best, 0, 0);
    assert_true(fabs(mean - 20) < 1);
}

TEST("an angle counts as the same after full turns, and windows that are held out do not count") {
    task *t = make_network_task(6 * 3.14159265358979323846);
    double at = 7;
    t->machine.coordinates[0].kind = LG_COORDINATE_ANGLE;
    assert_machine(&t->machine);
    assert_true(lg_machine_mass_at(&t->problem, &at));
    assert_close(at, 0, 0, 0);
    logs *l = make_logs(0.0, 3);
    for (size_t row = 0; row < ALL; row++) l->q[row] = row < ALL / 2 ? 2.0 + 0.1 * l->q[row] : 0.0;
    t = make_network_task(0);
    t->problem.log = l->log;
    assert_true(lg_machine_mass_at(&t->problem, &at));
    assert_close(at, 0, 0, 0);
    t->problem.validation = t->problem.windows / 2;
    assert_true(lg_machine_mass_at(&t->problem, &at));
    assert_close(at, 2, 0, 0.3);
}

/* ---- estimated starts of a known machine ---- */

enum { RUNS = 4, RUN = 40, POINTS = RUNS * RUN, WINDOW = 30, STARTS = 4 };

/* A line, a direction and a rotation, coupled by a network and driven. */
static lg_machine coupled(void) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "d", LG_COORDINATE_DIRECTION);
    add_coordinate(&machine, "R", LG_COORDINATE_ROTATION);
    add_input(&machine, "u");
    odd_scales(&machine);
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    see_everything(&machine, add_term(&machine, LG_MACHINE_POTENTIAL, "network"), false, false);
    add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

typedef struct runs {
    lg_machine machine;
    const double *theta;
    size_t first[RUNS + 1];
    double t[POINTS], q[POINTS * LG_MACHINE_POSITIONS], v[POINTS * LG_MACHINE_VELOCITIES];
    double true_q[POINTS * LG_MACHINE_POSITIONS], true_v[POINTS * LG_MACHINE_VELOCITIES];
    lg_machine_log log;
} runs;

/* The positions of one row with noise; direction and rotation are turned by the noise. */
static void shake(lg_rng *rng, double noise, const double *q, double *out) {
    double by[7];
    for (int k = 0; k < 7; k++) by[k] = noise * lg_rng_normal(rng);
    out[0] = q[0] + by[0];
    lg_so3_exp_act(by + 1, q + 1, out + 1);
    lg_so3_exp_multiply(by + 4, q + 4, out + 4);
}

/* Runs of the machine; their log has only positions, with noise. */
static runs *make_runs(double noise) {
    runs *r = TEST_ARRAY(runs, 1);
    r->machine = coupled();
    r->theta = machine_theta(&r->machine, 8);
    random_rows(&r->machine, 9, POINTS, r->q, r->v);
    for (size_t row = 0; row < POINTS; row++) {
        r->first[row / RUN] = row / RUN * RUN;
        r->t[row] = 0.03 * (double)(row % RUN);
    }
    r->first[RUNS] = POINTS;
    r->log = (lg_machine_log){POINTS, RUNS, r->first, r->t, r->q, r->v, test_numbers(3, POINTS * 4, -1, 1),
                              NULL,   NULL, NULL};
    assert_ok(lg_machine_free_run(NULL, &r->machine, r->theta, lg_scheme_find("cf4"), 2, &r->log, r->first,
                                  RUNS, RUN - 1, r->true_q, r->true_v, NULL));
    lg_rng rng = test_rng(2, 0);
    for (size_t row = 0; row < POINTS; row++)
        shake(&rng, noise, r->true_q + row * r->machine.positions, r->q + row * r->machine.positions);
    for (size_t i = 0; i < POINTS * r->machine.velocities; i++) r->v[i] = (double)NAN;
    return r;
}

/* The largest errors of the estimated states at rows start[0..STARTS-1]. */
static void estimate(const runs *r, const size_t *start, double *position, double *velocity) {
    const uint32_t nq = r->machine.positions, nv = r->machine.velocities;
    double q[STARTS * LG_MACHINE_POSITIONS], v[STARTS * LG_MACHINE_VELOCITIES];
    *position = *velocity = 0.0;
    assert_told(lg_machine_estimate_starts(NULL, &r->machine, r->theta, lg_scheme_find("cf4"), 2, &r->log,
                                           start, STARTS, WINDOW, q, v, &told));
    for (size_t i = 0; i < STARTS; i++) {
        for (uint32_t k = 0; k < nq; k++)
            *position = fmax(*position, fabs(q[i * nq + k] - r->true_q[start[i] * nq + k]));
        for (uint32_t k = 0; k < nv; k++)
            *velocity = fmax(*velocity, fabs(v[i * nv + k] - r->true_v[start[i] * nv + k]));
    }
}

/* Windows of 30, 30, 12 and 2 rows; the last two end with their parts. */
static const size_t some_starts[STARTS] = {0, RUN + 5, 3 * RUN - 12, 4 * RUN - 2};

TEST("starts of a known machine are found from positions alone, also near the end of a part") {
    double position, velocity;
    estimate(make_runs(0.0), some_starts, &position, &velocity);
    print_message("errors of positions %.1e, of velocities %.1e\n", position, velocity);
    assert_true(position < 1e-8 && velocity < 1e-8);
}

TEST("starts of more windows than are on a tape at once are found") {
    enum { MANY = 140, SHORT = 4 };
    const runs *r = make_runs(0.0);
    const uint32_t nq = r->machine.positions, nv = r->machine.velocities;
    size_t start[MANY];
    double *q = TEST_ARRAY(double, MANY *nq), *v = TEST_ARRAY(double, MANY *nv);
    for (size_t i = 0; i < MANY; i++) start[i] = i / 35 * RUN + i % 35;
    assert_told(lg_machine_estimate_starts(NULL, &r->machine, r->theta, lg_scheme_find("cf4"), 2, &r->log,
                                           start, MANY, SHORT, q, v, &told));
    for (size_t i = 0; i < MANY; i++) {
        assert_all_close(q + i * nq, r->true_q + start[i] * nq, nq, 0, 1e-6);
        assert_all_close(v + i * nv, r->true_v + start[i] * nv, nv, 0, 1e-4);
    }
}

TEST("many noisy rows give a start that is more accurate than its row, and a velocity better than "
     "differences") {
    const size_t starts[STARTS] = {0, RUN + 3, 2 * RUN + 7, 3 * RUN + 10};
    const double noise = 1e-3;
    double position, velocity;
    estimate(make_runs(noise), starts, &position, &velocity);
    print_message("errors of positions %.1e, of velocities %.1e\n", position, velocity);
    assert_true(position < noise && velocity < 4.0 * noise);
}

TEST("a start in the last row of a part is refused, and one without a finite run keeps its first guess") {
    runs *r = make_runs(0.0);
    double q[2 * LG_MACHINE_POSITIONS], v[2 * LG_MACHINE_VELOCITIES];
    const size_t last = RUN - 1, both[2] = {0, RUN};
    const uint32_t nq = r->machine.positions, nv = r->machine.velocities;
    lg_error error = {LG_OK, ""};
    assert_status(lg_machine_estimate_starts(NULL, &r->machine, r->theta, lg_scheme_find("cf4"), 2, &r->log,
                                             &last, 1, WINDOW, q, v, &error),
                  LG_INVALID_ARGUMENT);
    ((double *)(uintptr_t)r->log.u)[0] = 1e200; /* held over the first interval */
    assert_ok(lg_machine_estimate_starts(NULL, &r->machine, r->theta, lg_scheme_find("cf4"), 2, &r->log, both,
                                         2, WINDOW, q, v, &error));
    for (uint32_t k = 0; k < nq; k++) {
        assert_close(q[k], r->q[k], 1e-12, 1e-12);
        assert_close(q[nq + k], r->true_q[RUN * nq + k], 0.0, 1e-8);
    }
    for (uint32_t k = 0; k < nv; k++) {
        assert_true(isfinite(v[k]));
        assert_close(v[nv + k], r->true_v[RUN * nv + k], 0.0, 1e-8);
    }
}
