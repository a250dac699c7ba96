/* Parts of the recipe of machines: windows that are held out, numbers that are adapted, the text that a model
 * keeps.
 * ctest-labels: src/machine */
#include "liegrad/geometry.h"
#include "machine/files/choice.h"
#include "machine/internal.h"
#include "support/machine_models.h"
#include "support/machine_support.h"

/* ---- windows that are held out ---- */

enum { PARTS = 2, ROWS = 450, ALL = PARTS * ROWS };

/* A line and an angle on springs. All numbers are known. */
typedef struct swinging {
    lg_machine machine;
    size_t first[PARTS + 1];
    double t[ALL], q[2 * ALL], v[2 * ALL];
    uint32_t run[PARTS];
    lg_logs logs; /* log is a view of the arrays above */
} swinging;

static swinging *swing(void) {
    static const double mass[2] = {1, 1}, spring[3] = {0.5, 0, 0};
    swinging *s = TEST_ARRAY(swinging, 1);
    s->machine = empty_machine();
    add_coordinate(&s->machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&s->machine, "a", LG_COORDINATE_ANGLE);
    add_values(add_term(&s->machine, LG_MACHINE_MASS, "known"), 2, mass);
    lg_machine_term *V = add_term(&s->machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(V, LG_FEATURE_POSITION, 0);
    add_values(V, 1, spring);
    assert_machine(&s->machine);
    for (size_t row = 0; row < ALL; row++) {
        const double t = 0.1 * (double)(row % ROWS);
        s->first[row / ROWS] = row / ROWS * ROWS;
        s->t[row] = t;
        s->q[2 * row] = sin(t), s->q[2 * row + 1] = 0.5 * t - 3;
        s->v[2 * row] = cos(t), s->v[2 * row + 1] = 0.5;
    }
    s->first[PARTS] = ALL;
    s->run[1] = 1;
    s->logs.log =
        (lg_machine_log){.rows = ALL, .parts = PARTS, .first = s->first, .t = s->t, .q = s->q, .v = s->v};
    s->logs.part_run = s->run;
    return s;
}

RELEASES(release_held, lg_held_out_destroy)

static lg_held_out *plan(const swinging *s, double part, bool estimated) {
    lg_held_out *held = TEST_ARRAY(lg_held_out, 1);
    assert_ok(
        lg_held_out_plan(NULL, &s->machine, &s->logs.log, part, LG_HELD_OUT_WINDOWS, estimated, held, NULL));
    lg_test_owns(held, release_held);
    return held;
}

TEST("windows are held out where rows are complete; a log that is too short has no held-out windows") {
    swinging *s = swing();
    const lg_held_out *held = plan(s, 0.3, false);
    assert_true(held->count >= 4 && held->steps >= 5);
    for (size_t w = 0; w < held->count; w++) {
        const size_t start = held->start[w];
        assert_true(start % ROWS >= LG_HELD_OUT_DELAY && start % ROWS + held->steps < ROWS);
        assert_true(lg_held_out_has(held, start + 1, 1) && lg_held_out_has(held, start + held->steps, 1));
    }
    /* Motions that change by their size in 11 rows: windows of ten times as many rows fit into the log. */
    swinging *fast = swing();
    for (size_t row = 0; row < ALL; row++)
        fast->q[2 * row + 1] = fast->q[2 * row], fast->v[2 * row + 1] = fast->v[2 * row];
    assert_int_equal(plan(fast, 1.0, false)->steps, 110);
    size_t first[21];
    for (size_t p = 0; p < LG_COUNT(first); p++) first[p] = 45 * p;
    fast->logs.log.parts = 20, fast->logs.log.first = first;
    assert_int_equal(plan(fast, 1.0, false)->steps, 45 - LG_HELD_OUT_DELAY - 1);
    const size_t without = held->start[0];
    s->q[2 * without] = (double)NAN;
    held = plan(s, 0.3, false);
    for (size_t w = 0; w < held->count; w++) assert_true(held->start[w] != without);
    static const size_t short_rows[] = {5, 20, 60};
    for (size_t i = 0; i < LG_COUNT(short_rows); i++) {
        s->first[1] = short_rows[i], s->first[2] = 2 * short_rows[i];
        s->logs.log.rows = 2 * short_rows[i];
        assert_int_equal(plan(s, 0.1, i == 2)->count, 0);
    }
}

TEST("in logs of accelerations the errors of accelerations count, and windows need complete rows") {
    swinging *s = swing();
    s->machine.accelerations = true;
    s->logs.log.a = s->v;
    const lg_held_out *held = plan(s, 0.3, false);
    assert_true(held->count > 0 && held->weight[0] == 0 && held->weight[1] == 0 && held->weight[2] > 0);
    const lg_learned_machine model = {.machine = &s->machine, .scheme = lg_scheme_find("cf4"), .substeps = 1};
    double *square = TEST_ARRAY(double, held->count);
    s->logs.log.a = TEST_ARRAY(double, 2 * ALL);
    for (size_t row = 0; row < ALL; row++) ((double *)(uintptr_t)s->logs.log.a)[2 * row] = -sin(s->t[row]);
    assert_ok(lg_held_out_judge(held, &model, &s->logs.log, square, NULL));
    for (size_t w = 0; w < held->count; w++) assert_true(square[w] < 1e-6);
    s = swing();
    for (size_t i = 0; i < LG_COUNT(s->q); i++) s->q[i] = (double)NAN;
    held = plan(s, 0.3, false);
    assert_true(held->steps > 0 && held->count == 0 && held->weight[0] == 0);
}

TEST("angles count modulo turns; without positions velocities count; a run that is not finite counts as "
     "infinite") {
    swinging *s = swing();
    const lg_learned_machine model = {.machine = &s->machine, .scheme = lg_scheme_find("cf4"), .substeps = 1};
    const lg_held_out *held = plan(s, 0.3, false);
    double *square = TEST_ARRAY(double, held->count);
    for (size_t row = 0; row < ALL; row++)
        if (row % 7 == 3) s->q[2 * row + 1] += 2 * 3.14159265358979323846;
    assert_ok(lg_held_out_judge(held, &model, &s->logs.log, square, NULL));
    for (size_t w = 0; w < held->count; w++) assert_true(square[w] < 1e-6);
    for (size_t row = 0; row < ALL; row++) s->q[2 * row] = s->q[2 * row + 1] = (double)NAN;
    lg_held_out blind = *held;
    memset(blind.weight, 0, sizeof blind.weight);
    assert_ok(lg_held_out_judge(&blind, &model, &s->logs.log, square, NULL));
    assert_true(isnan(square[0])); /* nothing counts */
    s = swing();
    for (size_t w = 0; w < held->count; w++) s->v[2 * held->start[w]] = 1e200;
    s->machine.terms[1].values[0] = 1e200;
    assert_machine(&s->machine);
    assert_ok(lg_held_out_judge(held, &(lg_learned_machine){&s->machine, NULL, model.scheme, 1, false, NULL},
                                &s->logs.log, square, NULL));
    for (size_t w = 0; w < held->count; w++) assert_true(isinf(square[w]));
}

TEST("with positions alone a run begins in the row that is asked for, in the state that is estimated there") {
    enum { STEPS = 6, ROW = 60 };
    const swinging *true_motion = swing();
    swinging *s = swing();
    const lg_learned_machine model = {
        .machine = &s->machine, .scheme = lg_scheme_find("cf4"), .substeps = 1, .start_rows = 25};
    const size_t start = ROW;
    double q[2 * (STEPS + 1)], v[2 * (STEPS + 1)];
    for (size_t i = 0; i < LG_COUNT(s->v); i++) s->v[i] = (double)NAN;
    assert_ok(lg_machine_run(&model, &s->logs.log, &start, 1, STEPS, q, v, NULL));
    for (size_t i = 0; i < LG_COUNT(q); i++) {
        assert_close(q[i], true_motion->q[2 * ROW + i], 0, 1e-4);
        assert_close(v[i], true_motion->v[2 * ROW + i], 0, 1e-3);
    }
    const lg_held_out *held = plan(s, 0.3, true);
    double *square = TEST_ARRAY(double, held->count + 1);
    assert_true(held->count > 0);
    assert_ok(lg_held_out_judge(held, &model, &s->logs.log, square, NULL));
    for (size_t w = 0; w < held->count; w++) assert_true(square[w] < 1e-6);
}

/* The result must be destroyed after an error too. */
static lg_status match(const lg_held_out *held, const lg_logs *from, const lg_logs *to, lg_held_out *out,
                       lg_error *error) {
    for (;;) {
        const lg_status status = lg_held_out_match(held, from, to, out, error);
        if (!lg_test_again(status)) return status;
        lg_held_out_destroy(out);
    }
}

TEST("windows are found again by time and run; a log without their rows is refused") {
    swinging *s = swing(), *other = swing();
    const lg_held_out *held = plan(s, 0.3, true);
    assert_true(held->before > 0 && held->count > 0);
    lg_held_out found;
    lg_error error;
    assert_int_equal(match(held, &s->logs, &other->logs, &found, &error), LG_OK);
    assert_memory_equal(found.start, held->start, held->count * sizeof *found.start);
    lg_held_out_destroy(&found);
    const size_t start = held->start[0], part = start / ROWS;
    for (int change = 0; change < 5; change++) {
        other = swing();
        if (change == 0) other->run[part] = 7;
        if (change == 1) other->t[start] += 0.01; /* the time is missing */
        if (change == 2)
            for (size_t row = part * ROWS; row < (part + 1) * ROWS; row++)
                other->t[row] -= 100; /* the whole log lies before the window */
        if (change == 3) {            /* the part ends within the window */
            other->first[part + 1] = start + held->steps;
            if (part + 1 < PARTS) other->run[part + 1] = 7;
        }
        if (change == 4) other->first[part] = start - 1; /* too few rows before the window */
        assert_int_equal(match(held, &s->logs, &other->logs, &found, &error), LG_FORMAT);
        lg_held_out_destroy(&found);
        assert_says(error.message, "rows of the windows that judge are missing in this log");
    }
}

TEST("errors of windows are compared by the mean of their logarithms; missing errors do not count") {
    enum { N = 12 };
    double a[N], b[N];
    for (size_t i = 0; i < N; i++) b[i] = 1.0 + 0.01 * (double)(i % 3), a[i] = 0.25 * b[i];
    lg_held_out_ratio found = lg_held_out_compare(N, a, b);
    assert_close(found.ratio, 0.5, 1e-12, 0);
    assert_true(found.better && !lg_held_out_compare(N, b, a).better && !lg_held_out_compare(N, a, a).better);
    a[3] = b[4] = (double)NAN;
    found = lg_held_out_compare(N, a, b);
    assert_close(found.ratio, 0.5, 1e-2, 0);
    assert_true(found.better);
    for (size_t i = 1; i < N; i++) a[i] = (double)NAN;
    assert_false(lg_held_out_compare(N, a, b).better); /* one window */
    for (size_t i = 0; i < N; i++) a[i] = 1, b[i] = 2;
    b[5] = INFINITY;
    assert_true(lg_held_out_compare(N, a, b).better && !lg_held_out_compare(N, b, a).better);
}

TEST("gains of very different sizes count by their signs, if there are 8 windows or more") {
    double a[12], b[12];
    for (size_t i = 0; i < 12; i++) b[i] = 1, a[i] = exp(i == 3 ? -30 : -0.1);
    assert_true(lg_held_out_compare(12, a, b).better && lg_held_out_compare(8, a, b).better);
    assert_false(lg_held_out_compare(7, a, b).better);
    for (size_t i = 4; i < 12; i += 3) a[i] = 1.01;
    assert_false(lg_held_out_compare(12, a, b).better); /* 9 of 12 */
}

/* ---- errors of free runs ---- */

TEST("a model has no error on its own run; what is missing does not count, and angles count modulo turns") {
    enum { N = 80 };
    const lg_machine_model_file *file = make_machine_model(
        "coordinates: [{name: x, kind: line, velocity: vx}, {name: a, kind: angle, velocity: va},\n"
        "  {name: rod, kind: direction, columns: [p, q, r], velocity: [d, e, f]},\n"
        "  {name: body, kind: rotation, columns: [g, h, i, j], velocity: [k, l, m]}]\n"
        "mass: diagonal\npotential: [{kind: quadratic, of: [x, a]}, gravity]\ndamping: diagonal\n",
        7);
    const lg_machine *machine = &file->run.machine;
    const size_t nq = machine->positions, nv = machine->velocities, first[] = {0, N}, start = 0;
    double *q = TEST_ARRAY(double, N *nq), *v = TEST_ARRAY(double, N *nv), *t = TEST_ARRAY(double, N), loss;
    const lg_machine_log log = {.rows = N, .parts = 1, .first = first, .t = t, .q = q, .v = v};
    const lg_learned_machine model = {machine, file->theta, lg_scheme_find("cf4"), 2, false, NULL};
    q[0] = 0.3, q[1] = 1, q[2] = 0.6, q[4] = 0.8, v[0] = 1, v[1] = -1, v[3] = 0.5;
    q[5] = q[9] = q[13] = 1, v[5] = 0.4;
    for (size_t i = 1; i < N; i++) t[i] = t[i - 1] + (i < N / 2 ? 0.02 : 0.03);
    assert_ok(
        lg_machine_free_run(NULL, machine, model.theta, model.scheme, 2, &log, &start, 1, N - 1, q, v, NULL));
    for (size_t i = 3; i < N; i += 7) {
        q[i * nq] = q[i * nq + 2] = q[i * nq + 5] = v[i * nv + 1] = (double)NAN;
        q[(i + 1) * nq + 1] += 2 * 3.14159265358979323846;
    }
    for (size_t k = 0; k < nv; k++) v[5 * nv + k] = (double)NAN;
    lg_horizon found;
    assert_ok(lg_machine_window_loss(&model, &log, 6, &loss, NULL));
    assert_true(loss < 1e-20);
    assert_ok(lg_horizon_of(&model, lg_machine_run, &model, &log, 0.1, 5, &found, NULL));
    assert_true(found.starts > 5 && found.pooled[LG_ERROR_LINE] < 1e-10 &&
                found.pooled[LG_ERROR_ANGLE] < 1e-10 && found.pooled[LG_ERROR_DIRECTION] < 1e-7 &&
                found.pooled[LG_ERROR_ROTATION] < 1e-7 && found.pooled[LG_ERROR_VELOCITY] < 1e-10);
    assert_true(isnan(found.pooled[LG_ERROR_ACCELERATION]) && found.unchanged[LG_ERROR_LINE] > 1e-3);
}

/* Predicts x 2 too far, the angle 0.3 too far and a turn, the rod 0.5 off, the body 0.7 off. */
TEST("errors of a point: wrapped angles, angles of attitudes or their numbers, missing and infinite ones") {
    enum { X, A, ROD = 2, BODY = 5 };
    static const double turn = 6.283185307179586;
    const double given_q[14] = {1, 0.1, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1}, given_v[8] = {0};
    const double v[8] = {0.5, 0, 0, 0, 0, 0, 0, -2};
    double q[14] = {3, 0.4 + turn, 0, sin(0.5), cos(0.5)};
    lg_point_error e[LG_POINT_ERRORS];
    const lg_machine_model_file *file = make_machine_model(
        "coordinates: [{name: x, kind: line, velocity: vx}, {name: a, kind: angle, velocity: va},\n"
        "  {name: rod, kind: direction, columns: [p, q, r], velocity: [d, e, f]},\n"
        "  {name: body, kind: rotation, columns: [g, h, i, j], velocity: [k, l, m]}]\n"
        "mass: diagonal\n",
        0);
    const lg_machine *machine = &file->run.machine;
    lg_so3_exp((const double[3]){0, 0.7, 0}, q + BODY);
    const double errors[4] = {2, 0.3, 0.5, 0.7}, numbers[4] = {X, A, ROD, BODY};
    assert_int_equal(lg_point_errors(machine, q, v, given_q, given_v, true, e), 4 + 8);
    for (uint32_t i = 0, at = 0; i < 4; i++) {
        assert_close(e[at].error, errors[i], 1e-12, 0);
        assert_true(e[at].coordinate == i && e[at].kind == (lg_run_error)i && e[at].number == numbers[i]);
        at += 1 + lg_coordinate_row_of(machine->coordinates[i].kind)->velocities;
    }
    assert_true(e[11].kind == LG_ERROR_VELOCITY && e[11].number == 21 && e[11].coordinate == 3);
    assert_close(e[11].error, -2, 0, 0);
    assert_int_equal(lg_point_errors(machine, q, v, given_q, given_v, false, e), 14 + 8);
    for (uint32_t k = 0; k < 9; k++) {
        assert_true(e[10 + k].kind == LG_ERROR_ROTATION && e[10 + k].number == BODY + k);
        assert_close(e[10 + k].error, q[BODY + k] - given_q[BODY + k], 0, 0);
    }
    q[X] = (double)NAN, q[A] = q[ROD] = (double)INFINITY;
    assert_int_equal(lg_point_errors(machine, q, v, given_q, given_v, true, e), 12);
    assert_true(isinf(e[0].error * e[0].error) && isinf(e[2].error * e[2].error));
    assert_close(e[4].error, turn / 2, 1e-15, 0);
    assert_int_equal(lg_point_errors(machine, q, v, q, given_v, true, e), 12);
    assert_true(isnan(e[0].error));
}

/* ---- velocities from positions, and the share of forces that inputs explain ---- */

/* Positions of a machine with a line, a direction, a rotation and a pose that all turn about one axis, and
 * their velocities. */
static void turning(double t, double *q, double *v) {
    static const double axis[3] = {0.6, 0, 0.8}, first[3] = {0, 1, 0};
    const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, angle[3] = {0.5 * t * axis[0], 0, 0.5 * t * axis[2]};
    lg_space group;
    double R[9], place[3] = {t, 2 - t * t, 0.3 * t}, rate[3] = {1, -2 * t, 0.3};
    assert_ok(lg_space_init(&group, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
    lg_space_act(&group, angle, unit, R);
    *q++ = 1 + 2 * t - t * t * t, *v++ = 2 - 3 * t * t;
    for (int i = 0; i < 3; i++)
        *q++ = R[3 * i] * first[0] + R[3 * i + 1] * first[1] + R[3 * i + 2] * first[2];
    for (int i = 0; i < 6; i++) *v++ = 0.5 * axis[i % 3]; /* the direction is at right angles to the axis */
    memcpy(q, R, sizeof R), q += 9;
    memcpy(q, place, sizeof place), memcpy(q + 3, R, sizeof R);
    for (int i = 0; i < 3; i++) *v++ = R[i] * rate[0] + R[3 + i] * rate[1] + R[6 + i] * rate[2];
    for (int i = 0; i < 3; i++) *v++ = 0.5 * axis[i];
}

static void smooth(const lg_machine *machine, const lg_machine_log *log, double *q, double *v) {
    lg_started_log found;
    assert_ok(lg_machine_smooth(NULL, machine, log, 6, 3, &found, NULL));
    memcpy(q, found.q, log->rows * machine->positions * sizeof *q);
    memcpy(v, found.v, log->rows * machine->velocities * sizeof *v);
    lg_started_log_destroy(&found);
}

TEST("velocities of every kind of coordinate follow from local cubics of positions, and are missing where "
     "rows "
     "are few") {
    enum { N = 60, NQ = 25, NV = 13 };
    lg_machine machine = empty_machine();
    static const lg_coordinate_kind kinds[] = {LG_COORDINATE_LINE, LG_COORDINATE_DIRECTION,
                                               LG_COORDINATE_ROTATION, LG_COORDINATE_POSE};
    for (size_t i = 0; i < LG_COUNT(kinds); i++)
        add_coordinate(&machine, lg_coordinate_row_of(kinds[i])->name, kinds[i]);
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    assert_machine(&machine);
    assert_true(machine.positions == NQ && machine.velocities == NV);
    static const size_t first[] = {0, N - 2, N - 1, N}; /* two parts of few rows */
    double t[N], q[N * NQ], v[N * NV], found_q[N * NQ], found_v[N * NV];
    for (size_t i = 0; i < N; i++) turning(t[i] = 0.02 * (double)i, q + i * NQ, v + i * NV);
    q[20 * NQ] = (double)NAN;
    const lg_machine_log log = {.rows = N, .parts = 3, .first = first, .t = t, .q = q, .v = v};
    smooth(&machine, &log, found_q, found_v);
    for (size_t i = 0; i < N - 3; i++) { /* the last row has no row after it */
        for (int k = 0; k < NV; k++) assert_close(found_v[i * NV + k], v[i * NV + k], 2e-3, 2e-3);
        assert_close(found_q[i * NQ], 1 + 2 * t[i] - t[i] * t[i] * t[i], 1e-9, 1e-9);
    }
    for (size_t i = (N - 2) * NV; i < (size_t)N * NV; i++) assert_true(isnan(found_v[i]));
    /* The smoothing takes velocities that a row lacks from the neighbouring rows. */
    lg_machine_log lacking = log;
    const size_t at = 10;
    double row_q[LG_MACHINE_POSITIONS], row_v[NV];
    lacking.v = found_v + (N - 2) * NV - at * NV;
    lg_machine_scaled_rows(&machine, &lacking, &at, 1, row_q, row_v);
    for (int k = 0; k < NV; k++) assert_close(row_v[k], v[10 * NV + k], 2e-3, 2e-3);
    for (size_t row = 0; row < N; row++)
        if (row % 20 > 3) q[row * NQ] = q[row * NQ + 13] = (double)NAN;
    smooth(&machine, &log, found_q, found_v);
    assert_true(isnan(found_v[10 * NV]) && isnan(found_v[10 * NV + 7])); /* no row near it */
    assert_true(isnan(found_v[17 * NV]));                                /* all rows come later */
    assert_true(isfinite(found_v[10 * NV + 1]));
    for (size_t row = 0; row < N; row++) t[row] = 1e-9 * (double)row + (row < 5 ? 0 : 1);
    smooth(&machine, &log, found_q, found_v);
    assert_true(isnan(found_v[4 * NV + 1])); /* two times do not determine a cubic */
}

TEST(
    "what polynomials do not explain of accelerations is 0 for a pendulum with its sine, and unknown without "
    "rows") {
    enum { N = 200 };
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    static const size_t first[] = {0, N};
    double t[N], *q = test_numbers(3, N, -2, 2), *v = test_numbers(4, N, -1, 1), u[4 * N] = {0}, left;
    for (size_t i = 0; i < N; i++) {
        t[i] = 0.1 * (double)i;
        u[4 * i] = q[N - 1 - i];
        if (i > 0) v[i] = v[i - 1] + 0.1 * (u[4 * (i - 1)] - 3 * sin(0.5 * (q[i] + q[i - 1])));
    }
    lg_machine_log log = {.rows = N, .parts = 1, .first = first, .t = t, .q = q, .v = v, .u = u};
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(left < 1e-10);
    q[50] = v[70] = (double)NAN; /* their rows do not count */
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(left < 1e-10);
    u[4 * 20] += 1;
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(left > 1e-4);
    const double before = v[90];
    v[90] = 1e100; /* whose squares can be added, but not multiplied */
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(isnan(left));
    v[90] = before;
    for (size_t i = 0; i < N; i++) q[i] = (double)NAN;
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(isnan(left));
    log.rows = 1;
    log.first = (const size_t[]){0, 1};
    assert_ok(lg_machine_unexplained(NULL, &machine, &log, NULL, &left, NULL));
    assert_true(isnan(left));
}

/* ---- numbers that are adapted ---- */

#define DRIVE                                                                                                \
    "coordinates: [{name: x, kind: line, velocity: vx}, {name: y, kind: line, velocity: vy}]\n"              \
    "mass: diagonal\npotential: {kind: quadratic, of: [x, y], values: [1, 0, 1]}\n"

RELEASES(release_adaptation, lg_adaptation_destroy)

/* Prepares `names` for the machine, whose friction has forces of 2 and 3. */
static lg_status adapt(const char *yaml, const char *names, lg_adaptation **out, lg_error *error) {
    static const double force[2] = {2, 3};
    const lg_machine_model_file *file = make_machine_model(yaml, 4);
    *out = TEST_ARRAY(lg_adaptation, 1);
    lg_test_owns(*out, release_adaptation);
    lg_status status;
    do {
        lg_adaptation_destroy(*out);
        status = lg_adaptation_create(NULL, "m.h5", file, names, force, *out, error);
    } while (lg_test_again(status));
    return status;
}

TEST("numbers that cannot be adapted, stand twice, or are not in the machine are refused") {
    static const struct {
        const char *yaml, *names, *sentence;
    } rows[] = {
        {DRIVE "damping: diagonal\n", "frictiox", "\"frictiox\" is no number that can be adapted"},
        {DRIVE "damping: diagonal\n", "offset,",
         "\"\" is no number that can be adapted; take of: offset, friction"},
        {DRIVE "damping: diagonal\n", "friction,offset,friction", "\"friction\" stands twice"},
        {DRIVE "damping: {kind: known, values: [1, 1]}\n", "friction",
         "--numbers friction: the machine has no learned friction"},
        {DRIVE "damping: diagonal\noffset: {kind: known, values: [1, 1]}\n", "offset",
         "--numbers offset: the machine has no learned offset"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_adaptation *a;
        lg_error error = {LG_OK, ""};
        assert_int_equal(adapt(rows[i].yaml, rows[i].names, &a, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
    }
}

TEST(
    "an offset has one direction for each of its velocities, friction has one for all, and a machine without "
    "an offset gets one") {
    static const struct {
        const char *yaml;
        size_t count;
        const char *first, *last;
    } rows[] = {
        {DRIVE "damping: [diagonal, coulomb]\noffset: {kind: unknown, of: y}\n", 2, "offset.y", "friction"},
        {DRIVE "damping: [diagonal, coulomb]\noffset: {kind: unknown, of: [x, y]}\n", 3, "offset.x",
         "friction"},
        {DRIVE "damping: [diagonal, coulomb]\noffset: unknown\n", 3, "offset.x", "friction"},
        {DRIVE "damping: [diagonal, coulomb]\n", 3, "offset.x", "friction"},
        {DRIVE "damping: diagonal\noffset: {kind: known, values: [1, unknown]}\n", 2, "offset.y", "friction"},
        {"{coordinates: [{name: x, kind: line, velocity: v}], mass: diagonal, damping: diagonal}\n", 2,
         "offset.x", "friction"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_adaptation *a;
        lg_error error = {LG_OK, ""};
        if (adapt(rows[i].yaml, "offset,friction", &a, &error) != LG_OK) fail_msg("%s", error.message);
        assert_int_equal(a->count, rows[i].count);
        assert_string_equal(a->names[0], rows[i].first);
        assert_string_equal(a->names[a->count - 1], rows[i].last);
        assert_close(a->units[0], strcmp(rows[i].first, "offset.y") == 0 ? 3 : 2, 0, 0);
        /* A change by one deviation changes the first offset by its unit. */
        lg_identified before[16], after[16];
        const size_t count = lg_machine_numbers(&a->run.machine, a->theta, 16, before);
        const double one[3] = {1, 0, 0};
        lg_adaptation_move(a, one);
        assert_int_equal(lg_machine_numbers(&a->run.machine, a->theta, 16, after), count);
        for (size_t k = 0; k < count; k++) {
            const double moved = strcmp(after[k].name, rows[i].first) == 0 ? a->units[0] : 0;
            assert_close(after[k].value - before[k].value, moved, 1e-12, 1e-12);
        }
    }
}

TEST("if the machine's text has no room for an offset, adapting an offset is refused") {
    char *text = TEST_ARRAY(char, LG_MACHINE_TEXT);
    size_t used = (size_t)sprintf(text, "%s", DRIVE "damping: diagonal\nprovenance: x");
    memset(text + used, 'x', LG_MACHINE_TEXT - 3 - used);
    lg_machine_model_file *file = make_machine_model(DRIVE "damping: diagonal\n", 4);
    lg_adaptation a;
    lg_error error;
    static const double force[2] = {1, 1};
    memcpy(file->run.text, text, LG_MACHINE_TEXT);
    assert_status(lg_adaptation_create(NULL, "m.h5", file, "offset", force, &a, &error), LG_FORMAT);
    lg_adaptation_destroy(&a);
    assert_says(error.message, "too long for a further line");
}

/* ---- the text that a model keeps ---- */

TEST("a model keeps its machine's text without comments and empty lines; quotes protect a #") {
    static const char text[] = "a: 'x # y'  # comment\r\n# whole\n\n \t\nb: \"'#z\"\t#c\n  #d\nc#d: 1";
    lg_machine_model_run *run = TEST_ARRAY(lg_machine_model_run, 1);
    lg_error error;
    assert_ok(lg_machine_model_describe(run, "m.yaml", text, NULL));
    assert_string_equal(run->text, "a: 'x # y'\nb: \"'#z\"\nc#d: 1\n");
    char *large = TEST_ARRAY(char, LG_MACHINE_TEXT + 1);
    memset(large, 'x', LG_MACHINE_TEXT - 2);
    assert_ok(lg_machine_model_describe(run, "m.yaml", large, &error));
    assert_int_equal(strlen(run->text), LG_MACHINE_TEXT - 1);
    large[LG_MACHINE_TEXT - 2] = 'x';
    assert_status(lg_machine_model_describe(run, "m.yaml", large, &error), LG_FORMAT);
    assert_says(error.message, "m.yaml: is longer than the 4095 bytes");
}

TEST("the hash of a log contains its accelerations, and their guessed positions have no range") {
    swinging *s = swing();
    char plain[LG_SHA256_TEXT], with[LG_SHA256_TEXT];
    lg_machine_range range;
    lg_machine_log log = s->logs.log;
    lg_machine_log_sha256(&s->machine, &log, plain);
    log.a = s->v;
    lg_machine_log_sha256(&s->machine, &log, with);
    assert_string_not_equal(plain, with);
    lg_machine_find_range(&s->machine, &log, &range);
    assert_close(range.high[1], 0.5 * 0.1 * (ROWS - 1) - 3, 1e-12, 0);
    s->machine.accelerations = true;
    lg_machine_find_range(&s->machine, &log, &range);
    assert_close(range.high[1], -1e300, 0, 0);
}
