/* Machines whose logs measure accelerations alone: the accelerations of a model, the residuals of windows and
 * their Jacobian, and starts of windows that are far off.
 * ctest-labels: src/machine */
#include "support/machine_support.h"

/* Fails unless the call, which may use &told, refuses its argument with a sentence that contains `part`. */
#define REFUSED(call, part)                                                                                  \
    do {                                                                                                     \
        lg_error told = {LG_OK, ""};                                                                         \
        assert_status(call, LG_INVALID_ARGUMENT);                                                            \
        assert_says(told.message, part);                                                                     \
    } while (0)

enum { ROWS = 61, WINDOW = 21, WINDOWS = 3 };

/* An arm of two links with a bias of the first acceleration, or a pendulum. */
static lg_machine arm(bool accelerations, bool bias) {
    static const double friction[] = {0.1, 0.2}, map[] = {1, 0.3, 0, 1}, lag[] = {0.15};
    lg_machine machine = empty_machine();
    machine.accelerations = accelerations;
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_coordinate(&machine, "b", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_input(&machine, "w");
    assert_ok(lg_machine_set_system(&machine, "two-link-arm", NULL));
    add_values(add_term(&machine, LG_MACHINE_DAMPING, "known"), 2, friction);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 4, map);
    lg_machine_term *slow = add_term(&machine, LG_MACHINE_ACTUATOR, "lag");
    add_feature(slow, LG_FEATURE_INPUT, 0);
    add_values(slow, 1, lag);
    if (bias) add_feature(add_term(&machine, LG_MACHINE_BIAS, "constant"), LG_FEATURE_VELOCITY, 0);
    odd_scales(&machine);
    assert_machine(&machine);
    return machine;
}

typedef struct data {
    size_t first[2], start[WINDOWS];
    double t[ROWS], q[2 * ROWS], v[2 * ROWS], a[2 * ROWS], u[8 * ROWS];
    lg_machine_log log;
} data;

/* A log with constant inputs and unknown motion. */
static data *rest(const lg_machine *machine, double step) {
    data *d = TEST_ARRAY(data, 1);
    d->first[1] = ROWS;
    for (size_t row = 0; row < ROWS; row++) {
        d->t[row] = step * (double)row;
        for (uint32_t k = 0; k < machine->input_count; k++)
            d->u[row * 4 * machine->input_count + k] = 0.7 - 0.4 * k;
    }
    for (size_t w = 0; w < WINDOWS; w++) d->start[w] = w * (WINDOW - 1);
    d->log = (lg_machine_log){.rows = ROWS,
                              .parts = 1,
                              .first = d->first,
                              .t = d->t,
                              .q = d->q,
                              .v = d->v,
                              .u = machine->input_count > 0 ? d->u : NULL,
                              .a = machine->accelerations ? d->a : NULL};
    return d;
}

TEST("accelerations are the slopes of the velocities, plus the bias of the sensor") {
    static const double step = 2e-3, bias = 0.25;
    const lg_machine plain = arm(false, false), flagged = arm(true, true);
    const lg_scheme *scheme = lg_scheme_find("rkmk5");
    const size_t start = 0;
    double v[2 * ROWS], a[2 * ROWS];
    data *d = rest(&plain, step);
    d->q[0] = 1.2, d->q[1] = -0.8, d->v[0] = 0.6, d->v[1] = -1.5;
    const double theta = bias * flagged.scales.time * flagged.scales.time; /* an angle: L = 1 */
    lg_identified number;
    assert_int_equal(lg_machine_numbers(&flagged, &theta, 1, &number), 1);
    assert_string_equal(number.name, "bias.a.acceleration");
    assert_close(number.value, bias, 1e-12, 0);
    assert_ok(
        lg_machine_free_run(NULL, &plain, NULL, scheme, 4, &d->log, &start, 1, ROWS - 1, NULL, v, NULL));
    assert_ok(
        lg_machine_free_run(NULL, &flagged, &theta, scheme, 4, &d->log, &start, 1, ROWS - 1, NULL, a, NULL));
    for (size_t i = 4; i < 2 * (ROWS - 2); i++) {
        const double slope = (v[i - 4] - 8 * v[i - 2] + 8 * v[i + 2] - v[i + 4]) / (12 * step);
        assert_close(a[i], slope + (i % 2 == 0 ? bias : 0), 1e-8, 1e-8);
    }
    assert_true(fabs(a[0] - a[2 * ROWS - 2]) > 0.5);
}

/* ---- the Jacobian ---- */

/* An arm of which numbers, a lag and a bias are learned. */
static lg_machine unknown_arm(void) {
    static const bool both[] = {true, true};
    lg_machine machine = arm(true, true);
    assert_ok(lg_machine_set_parameter(&machine, "centres", 2, (const double[]){0.3, 0.2}, both, NULL));
    for (uint32_t i = 0; i < machine.term_count; i++) {
        lg_machine_term *term = &machine.terms[i];
        if (term->part != LG_MACHINE_ACTUATOR && term->part != LG_MACHINE_DAMPING) continue;
        if (term->part == LG_MACHINE_DAMPING) term->kind = lg_term_kind_find(LG_MACHINE_DAMPING, "diagonal");
        term->value_count = 0;
    }
    machine.scales.lag[0] = 0.01, machine.scales.lag[1] = 10;
    assert_machine(&machine);
    assert_int_equal(machine.parameters, 6);
    return machine;
}

static lg_machine_problem problem_of(const lg_machine *machine, const data *d, lg_machine_starts starts) {
    lg_machine_problem problem = {.machine = machine,
                                  .scheme = lg_scheme_find("cf4"),
                                  .substeps = 1,
                                  .window = WINDOW,
                                  .starts = starts,
                                  .log = d->log,
                                  .windows = WINDOWS,
                                  .start = d->start};
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        problem.position_scale[i] = 0.1, problem.velocity_scale[i] = 0.8 + 0.3 * i;
    assert_told(lg_machine_problem_check(&problem, &told));
    return problem;
}

/* Compares the Jacobian that is computed interval by interval with the tape's. */
static void compare(const lg_machine_problem *problem) {
    const uint32_t samples[] = {2, 0};
    lg_fit_problem fit;
    lg_machine_fit_problem(problem, &fit);
    const size_t n = fit.parameters, own = fit.own, shared = n - own * WINDOWS, columns = shared + own,
                 rows = fit.rows;
    double *theta = test_numbers(6, n, -0.2, 0.2), loss = 0;
    double *J = TEST_ARRAY(double, 2 * rows * columns), *r = TEST_ARRAY(double, 2 * rows),
           *taped = TEST_ARRAY(double, 4 * rows), *whole = TEST_ARRAY(double, 4 * rows * n);
    lg_tape *tape = test_tape(LG_F64);
    assert_ok(fit.linearise(fit.user, tape, theta, samples, 2, 2, &loss, r, J));
    lg_tape_reset(tape);
    const lg_var x = lg_parameter(tape, lg_shape1((uint32_t)n), theta);
    lg_var all;
    assert_ok(fit.residuals(fit.user, tape, x, samples, 2, 2, &all));
    const size_t count = lg_shape_count(lg_var_shape(tape, all));
    assert_int_equal(count, 2 * rows); /* the tape has positions, then accelerations of all rows */
    assert_ok(lg_read(tape, all, count, taped));
    assert_ok(lg_read(tape, lg_jacobian(tape, all, x), count * n, whole));
    const size_t points = rows / 4;
    double sum = 0, largest = 0;
    for (size_t s = 0; s < 2; s++)
        for (size_t i = 0; i < rows; i++) {
            const size_t point = i / 4, k = i % 4;
            const size_t at = s * rows + (k < 2 ? 2 * point + k : 2 * points + 2 * point + k - 2);
            assert_close(r[s * rows + i], taped[at], 1e-11, 1e-12);
            if (k < 2) assert_true(r[s * rows + i] == 0);
            sum += taped[at] * taped[at];
            for (size_t j = 0; j < columns; j++) {
                const size_t parameter = j < shared ? j : shared + samples[s] * own + j - shared;
                assert_close(J[(s * rows + i) * columns + j], whole[at * n + parameter], 1e-9, 1e-11);
                largest = fmax(largest, fabs(whole[at * n + parameter]));
            }
        }
    assert_close(loss, sum, 1e-11, 0);
    assert_true(largest > 0.1);
}

TEST(
    "the Jacobian of accelerations agrees with the tape: numbers, a lag, a bias and starts; a gap counts 0") {
    const lg_machine machine = unknown_arm();
    data *d = rest(&machine, 0.05);
    const double *numbers = test_numbers(3, 6 * ROWS, -1, 1);
    memcpy(d->q, numbers, sizeof d->q);
    memcpy(d->v, numbers + 2 * ROWS, sizeof d->v);
    memcpy(d->a, numbers + 4 * ROWS, sizeof d->a);
    d->a[11] = (double)NAN;
    for (int starts = 0; starts < 2; starts++) {
        const lg_machine_problem problem = problem_of(&machine, d, (lg_machine_starts)starts);
        compare(&problem);
    }
    lg_machine_problem none = problem_of(&machine, d, LG_MACHINE_STARTS_ESTIMATED);
    none.log.a = NULL;
    REFUSED(lg_machine_problem_check(&none, &told), "no accelerations");
}

TEST("accelerations are of lines and angles, and only they have biases") {
    lg_machine machine = arm(true, false);
    add_feature(add_term(&machine, LG_MACHINE_BIAS, "constant"), LG_FEATURE_POSITION, 0);
    REFUSED(lg_machine_init(&machine, &told), "");
    machine = empty_machine();
    machine.accelerations = true;
    add_coordinate(&machine, "r", LG_COORDINATE_ROTATION);
    (void)add_term(&machine, LG_MACHINE_MASS, "diagonal");
    REFUSED(lg_machine_init(&machine, &told), "a line or an angle");
}

/* ---- starts that are far off ---- */

/* A pendulum of unit mass with a torque. */
static lg_machine pendulum(bool accelerations) {
    static const double mass = 1, gravity[2] = {0, -9};
    lg_machine machine = empty_machine();
    machine.accelerations = accelerations;
    add_coordinate(&machine, "th", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 1, &mass);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 1, &mass);
    lg_machine_term *pull = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(pull, LG_FEATURE_HEIGHT, 0);
    add_values(pull, 2, gravity);
    (void)add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    assert_machine(&machine);
    return machine;
}

/* A log of the pendulum's motion with inputs that are cubics between rows. */
static data *swing(const double *theta) {
    const lg_machine plain = pendulum(false), machine = pendulum(true);
    const lg_scheme *scheme = lg_scheme_find("cf4");
    const size_t start = 0;
    double v[ROWS];
    data *d = rest(&machine, 0.04);
    memcpy(d->u, test_numbers(17, 4 * ROWS, -1, 1), 4 * ROWS * sizeof *d->u);
    d->q[0] = 2.5;
    assert_ok(
        lg_machine_free_run(NULL, &plain, theta, scheme, 1, &d->log, &start, 1, ROWS - 1, d->q, v, NULL));
    assert_ok(lg_machine_free_run(NULL, &machine, theta, scheme, 1, &d->log, &start, 1, ROWS - 1, NULL, d->a,
                                  NULL));
    memcpy(d->v, v, sizeof v);
    return d;
}

TEST("starts that are far off come from the windows before and behind") {
    const lg_machine machine = pendulum(true);
    double theta[1 + 2 * WINDOWS] = {0.3}, losses[WINDOWS], wrong[1 + 2 * WINDOWS];
    const data *d = swing(theta);
    const lg_machine_problem problem = problem_of(&machine, d, LG_MACHINE_STARTS_ESTIMATED);
    for (size_t bad = 0; bad < WINDOWS; bad++) {
        memcpy(wrong, theta, sizeof wrong);
        wrong[1 + 2 * bad] = 0.8, wrong[2 + 2 * bad] = -3;
        assert_ok(lg_machine_continue_starts(NULL, &problem, wrong, losses, NULL));
        for (size_t w = 0; w < WINDOWS; w++)
            if (!(losses[w] < 1e-5)) fail_msg("window %zu of loss %g, window %zu was off", w, losses[w], bad);
        assert_true(wrong[0] == theta[0]);
    }
    /* A single window has no neighbour, so its start stays as it is. */
    lg_machine_problem alone = problem;
    alone.windows = 1;
    wrong[1] = 0.8;
    assert_ok(lg_machine_continue_starts(NULL, &alone, wrong, losses, NULL));
    assert_true(wrong[1] == 0.8 && losses[0] > 1);
    alone.starts = LG_MACHINE_STARTS_MEASURED;
    REFUSED(lg_machine_continue_starts(NULL, &alone, wrong, losses, &told), "estimated");
}

TEST("the states at all rows of a log come from its accelerations, whatever the guesses are") {
    const lg_machine machine = pendulum(true);
    const lg_scheme *scheme = lg_scheme_find("cf4");
    const double theta[] = {0.3};
    double q[ROWS], v[ROWS], found_q[ROWS], found_v[ROWS];
    data *d = swing(theta);
    memcpy(q, d->q, sizeof q);
    memcpy(v, d->v, sizeof v);
    /* Guesses that are right in the last window, and far off in the others. */
    for (size_t row = 0; row < ROWS; row++)
        d->q[row] = row < 40 ? 0.5 : q[row], d->v[row] = row < 40 ? -1 : v[row];
    assert_ok(lg_machine_estimate_states(NULL, &machine, theta, scheme, 1, &d->log, WINDOW, found_q, found_v,
                                         NULL));
    assert_all_close(found_q, q, ROWS, 0, 1e-6);
    assert_all_close(found_v, v, ROWS, 0, 1e-6);
    lg_machine_log none = d->log;
    none.a = NULL;
    REFUSED(
        lg_machine_estimate_states(NULL, &machine, theta, scheme, 1, &none, WINDOW, found_q, found_v, &told),
        "the log has no accelerations");
}

TEST("the states of a known machine come from more windows than are on a tape at once") {
    enum { PARTS = 5, ALL = PARTS * ROWS };
    static const size_t first[] = {0, ROWS, 2 * ROWS, 3 * ROWS, 4 * ROWS, ALL};
    const double theta[] = {0.3};
    lg_machine machine = pendulum(true);
    lg_identified friction;
    (void)lg_machine_numbers(&machine, theta, 1, &friction);
    add_values(&machine.terms[3], 1, &friction.value);
    assert_machine(&machine);
    const data *d = swing(theta);
    double t[ALL], q[ALL], v[ALL], a[ALL], u[4 * ALL], found_q[ALL], found_v[ALL];
    for (size_t p = 0; p < PARTS; p++) {
        memcpy(t + p * ROWS, d->t, sizeof d->t);
        memcpy(q + p * ROWS, d->q, ROWS * sizeof *q);
        memcpy(v + p * ROWS, d->v, ROWS * sizeof *v);
        memcpy(a + p * ROWS, d->a, ROWS * sizeof *a);
        memcpy(u + 4 * p * ROWS, d->u, 4 * ROWS * sizeof *u);
    }
    const lg_machine_log log = {
        .rows = ALL, .parts = PARTS, .first = first, .t = t, .q = q, .v = v, .u = u, .a = a};
    assert_ok(lg_machine_estimate_states(NULL, &machine, NULL, lg_scheme_find("cf4"), 1, &log, 3, found_q,
                                         found_v, NULL));
    assert_all_close(found_q, q, ALL, 0, 1e-6);
    assert_all_close(found_v, v, ALL, 0, 1e-6);
}

TEST("windows of accelerations give back the numbers and the bias of their sensor") {
    enum { BEGIN = 6 };
    lg_machine truth = unknown_arm(), *machine = &truth;
    const size_t start = 0;
    data *d = rest(machine, 0.03);
    double theta[BEGIN + 4 * WINDOWS] = {0};
    const double *exact = test_numbers(12, BEGIN, -0.3, 0.3);
    d->q[0] = 0.9, d->v[1] = 2;
    assert_ok(lg_machine_free_run(NULL, machine, exact, lg_scheme_find("cf4"), 1, &d->log, &start, 1,
                                  ROWS - 1, d->q, d->a, NULL));
    for (size_t i = 2; i + 2 < 2 * ROWS; i++) d->v[i] = (d->q[i + 2] - d->q[i - 2]) / 0.06;
    for (size_t i = 0; i < 2 * ROWS; i++) d->q[i] += 0.02 * sin((double)i);
    const lg_machine_problem problem = problem_of(machine, d, LG_MACHINE_STARTS_ESTIMATED);
    lg_fit_problem fit;
    lg_machine_fit_problem(&problem, &fit);
    assert_int_equal(fit.parameters, LG_COUNT(theta));
    for (size_t k = 0; k < BEGIN; k++) theta[k] = exact[k] + 0.05 * cos((double)k);
    fit_by_lm(&fit, 60, theta);
    lg_identified given[BEGIN], found[BEGIN];
    assert_int_equal(lg_machine_numbers(machine, exact, BEGIN, given), BEGIN);
    (void)lg_machine_numbers(machine, theta, BEGIN, found);
    for (size_t k = 0; k < BEGIN; k++) assert_close(found[k].value, given[k].value, 1e-5, 0);
}
