/* Variational steps of machines: their order, what they preserve, and learning with them.
 * ctest-labels: src/machine */
#include "support/machine_support.h"
#include "support/plan_support.h"

/* ---- runs ---- */

/* A run of `steps` intervals of length h from one row, in the units of the log. The inputs u are cubics in
 * each interval. */
typedef struct run {
    const lg_machine *machine;
    const double *theta, *q0, *v0;
    size_t steps;
    double h;
    double *q, *v; /* (steps + 1, ...) */
} run;

static double *inputs_over(const lg_machine *machine, size_t rows) {
    return test_numbers(8, rows * 4 * (machine->input_count + 1), -1, 1);
}

static lg_status try_run(run *r, const char *scheme, uint32_t substeps, lg_error *error) {
    const lg_machine *machine = r->machine;
    const size_t rows = r->steps + 1, first[2] = {0, rows}, start = 0;
    double *t = TEST_ARRAY(double, rows), *q = TEST_ARRAY(double, rows * machine->positions),
           *v = TEST_ARRAY(double, rows * machine->velocities);
    for (size_t i = 0; i < rows; i++) t[i] = r->h * (double)i;
    memcpy(q, r->q0, machine->positions * sizeof *q);
    memcpy(v, r->v0, machine->velocities * sizeof *v);
    r->q = TEST_ARRAY(double, rows * machine->positions);
    r->v = TEST_ARRAY(double, rows * machine->velocities);
    const lg_machine_log log = {rows, 1, first, t, q, v, inputs_over(machine, rows), NULL, NULL, NULL};
    return lg_machine_free_run(NULL, machine, r->theta, lg_scheme_find(scheme), substeps, &log, &start, 1,
                               r->steps, r->q, r->v, error);
}

static void run_with(run *r, const char *scheme, uint32_t substeps) {
    assert_told(try_run(r, scheme, substeps, &told));
}

/* ---- order ---- */

static double largest_error(const run *a, const run *b) {
    double most = 0.0;
    const size_t q = a->machine->positions, v = a->machine->velocities;
    for (size_t i = 0; i < (a->steps + 1) * q; i++) most = fmax(most, fabs(a->q[i] - b->q[i]));
    for (size_t i = 0; i < (a->steps + 1) * v; i++) most = fmax(most, fabs(a->v[i] - b->v[i]));
    return most;
}

/* Slope of log error against log h over errors in [1e-11, 1e-3]. */
static double order_of(const lg_machine *machine, const double *theta) {
    enum { HALVINGS = 4 };
    fit_line fit = {0};
    double q0[LG_MACHINE_POSITIONS], v0[LG_MACHINE_VELOCITIES];
    random_rows(machine, 21, 1, q0, v0);
    for (uint32_t i = 0; i < machine->velocities; i++) v0[i] *= 0.3;
    run exact = {machine, theta, q0, v0, 2, 0.2, NULL, NULL}, r = exact;
    run_with(&exact, "cf4", 50);
    for (uint32_t steps = 8; steps <= 8u << HALVINGS; steps *= 2) {
        run_with(&r, "variational", steps);
        const double error = largest_error(&r, &exact);
        if (error > 1e-11 && error < 1e-3) fit_add(&fit, -log(steps), log(error));
    }
    assert_true(fit.n >= HALVINGS);
    return fit_slope(&fit);
}

static void assert_order(const lg_machine *machine, const char *name) {
    const double order = order_of(machine, machine_theta(machine, 5));
    (void)printf("%s: order %.3f\n", name, order);
    assert_true(order > 1.9 && order < 2.1);
}

/* A machine with one coordinate, a full mass if possible, and a potential; `forced`: also inputs and three
 * kinds of damping. */
static lg_machine single(lg_coordinate_kind kind, bool forced) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "q", kind);
    if (forced) add_input(&machine, "u");
    odd_scales(&machine);
    add_term(&machine, LG_MACHINE_MASS, "constant");
    add_feature(add_term(&machine, LG_MACHINE_POTENTIAL, "network"), LG_FEATURE_POSITION, 0);
    if (forced) {
        add_term(&machine, LG_MACHINE_DAMPING, "constant");
        add_term(&machine, LG_MACHINE_DAMPING, "quadratic");
        add_feature(add_term(&machine, LG_MACHINE_DAMPING, "network"), LG_FEATURE_VELOCITY, 0);
        add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
        lg_machine_term *rest = add_term(&machine, LG_MACHINE_RESIDUAL, "polynomial");
        add_feature(rest, LG_FEATURE_VELOCITY, 0);
        add_feature(rest, LG_FEATURE_INPUT, 0);
    }
    assert_machine(&machine);
    return machine;
}

TEST("the order is 2 for every kind of coordinate, with and without forces") {
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++)
        for (int forced = 0; forced < 2; forced++) {
            const lg_machine machine = single((lg_coordinate_kind)kind, forced == 1);
            assert_order(&machine, lg_coordinate_row_of((lg_coordinate_kind)kind)->name);
        }
}

TEST("the order is 2 for all coordinates together with a mass that couples them") {
    const lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "constant"), LG_MACHINE_MASS);
    assert_order(&machine, "all");
}

/* ---- conserved quantities ---- */

enum { LONG = 10000 };

static const double inertia[9] = {1.0, 0.2, -0.1, 0.2, 1.4, 0.3, -0.1, 0.3, 0.8};

/* A body about a fixed point with full inertia. `weight`: V = weight . R^T e3, or NULL. */
static lg_machine top(const double *weight) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "body", LG_COORDINATE_ROTATION);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 9, inertia);
    if (weight != NULL) {
        lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
        add_feature(V, LG_FEATURE_HEIGHT, 0);
        add_values(V, 3, weight);
    }
    assert_machine(&machine);
    return machine;
}

static void momentum_of(const double *Omega, double *m) {
    for (int i = 0; i < 3; i++)
        m[i] = inertia[3 * i] * Omega[0] + inertia[3 * i + 1] * Omega[1] + inertia[3 * i + 2] * Omega[2];
}

static double energy_of(const double *weight, const double *R, const double *Omega) {
    double m[3], sum = 0.0;
    momentum_of(Omega, m);
    for (int i = 0; i < 3; i++) sum += 0.5 * m[i] * Omega[i] + weight[i] * R[6 + i];
    return sum;
}

/* The largest |H - H(0)| in the first and in the last tenth of a run. */
static void energy_errors(const run *r, const double *weight, double *early, double *late) {
    const double H = energy_of(weight, r->q, r->v);
    *early = *late = 0.0;
    for (size_t i = 0; i <= r->steps; i++) {
        const double error = fabs(energy_of(weight, r->q + 9 * i, r->v + 3 * i) - H);
        if (i <= r->steps / 10) *early = fmax(*early, error);
        if (i >= r->steps - r->steps / 10) *late = fmax(*late, error);
    }
}

TEST("the energy of a heavy top does not drift in ten thousand steps; with cf4 it does") {
    static const double weight[3] = {0.3, -0.2, 2.0};
    const double R[9] = {1, 0, 0, 0, 0.8, -0.6, 0, 0.6, 0.8}, Omega[3] = {0.4, -0.3, 2.5};
    const lg_machine machine = top(weight);
    run r = {&machine, NULL, R, Omega, LONG, 0.15, NULL, NULL};
    double early, late;
    run_with(&r, "variational", 1);
    energy_errors(&r, weight, &early, &late);
    (void)printf("variational: %.2e early, %.2e late\n", early, late);
    assert_true(late < 1.2 * early && early < 0.1);
    run_with(&r, "cf4", 1);
    energy_errors(&r, weight, &early, &late);
    (void)printf("cf4: %.2e early, %.2e late\n", early, late);
    assert_true(late > 5.0 * early);
}

/* V = 2 (1 - cos q) with M = 1, from 2 rad at rest, where the energy errors of an integrator are large. */
TEST("the energy of a pendulum does not drift in a hundred thousand steps; with cf4 it falls") {
    enum { POINTS = 1000 };
    static const double unit = 1.0, coefficients[2] = {0.0, -2.0}, start = 2.0, rest = 0.0;
    static const char *const schemes[2] = {"variational", "cf4"};
    double errors[2][2] = {{0}};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "q", LG_COORDINATE_ANGLE);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 1, &unit);
    lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "linear");
    add_feature(V, LG_FEATURE_POSITION, 0);
    add_values(V, 2, coefficients);
    assert_machine(&machine);
    for (int k = 0; k < 2; k++) {
        run r = {&machine, NULL, &start, &rest, POINTS, 20.0, NULL, NULL}; /* 100 steps of .2 per row */
        run_with(&r, schemes[k], 100);
        for (size_t i = 1; i <= POINTS; i++) {
            const double H = 0.5 * r.v[i] * r.v[i] - 2.0 * cos(r.q[i]) + 2.0 * cos(start);
            double *worst = &errors[k][i > POINTS / 10];
            *worst = fmax(*worst, fabs(H));
        }
        (void)printf("%s: %.2e early, %.2e later\n", schemes[k], errors[k][0], errors[k][1]);
    }
    assert_true(errors[0][1] < 1.2 * errors[0][0] && errors[0][0] < 0.1);
    assert_true(errors[1][1] > 5.0 * errors[1][0] && errors[1][1] > 2.0 * errors[0][1]);
}

TEST("to rounding a free body keeps its momentum in space, and R stays a rotation") {
    const double R[9] = {1, 0, 0, 0, 0.8, -0.6, 0, 0.6, 0.8}, Omega[3] = {0.4, -1.3, 2.5};
    const lg_machine machine = top(NULL);
    run r = {&machine, NULL, R, Omega, LONG, 0.1, NULL, NULL};
    double first[3] = {0}, turned = 0.0, off = 0.0;
    run_with(&r, "variational", 1);
    for (size_t step = 0; step <= LONG; step += 100) {
        const double *Q = r.q + 9 * step;
        double m[3];
        momentum_of(r.v + 3 * step, m);
        for (int i = 0; i < 3; i++) {
            const double M = Q[3 * i] * m[0] + Q[3 * i + 1] * m[1] + Q[3 * i + 2] * m[2];
            if (step == 0) first[i] = M;
            turned = fmax(turned, fabs(M - first[i]));
            for (int j = 0; j < 3; j++) {
                const double *a = Q + 3 * i, *b = Q + 3 * j;
                off = fmax(off, fabs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] - (i == j)));
            }
        }
    }
    (void)printf("momentum %.1e, R %.1e\n", turned, off);
    assert_true(turned < 1e-11 && off < 1e-11);
    assert_true(fabs(r.v[3 * LONG] - Omega[0]) + fabs(r.v[3 * LONG + 1] - Omega[1]) > 0.05); /* it moved */
}

/* ---- damping ---- */

/* The kinetic energy T of the scaled machine at each point of a run. */
static void kinetic_energies(const run *r, double *out) {
    const lg_machine *machine = r->machine;
    lg_tape *tape = test_tape(LG_F64);
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    const uint32_t rows = (uint32_t)r->steps + 1;
    double *q = TEST_ARRAY(double, rows * machine->positions),
           *v = TEST_ARRAY(double, rows * machine->velocities);
    const size_t nq = machine->positions, nv = machine->velocities;
    for (size_t i = 0; i < rows; i++) {
        memcpy(q + i * nq, r->q + i * nq, nq * sizeof *q);
        memcpy(v + i * nv, r->v + i * nv, nv * sizeof *v);
    }
    assert_ok(lg_machine_bind(tape, machine,
                              lg_parameter(tape, lg_shape1((uint32_t)machine->parameters), r->theta), &vars));
    assert_ok(lg_machine_record_state(tape, &vars, lg_input_f64(tape, lg_shape2(rows, (uint32_t)nq), q),
                                      lg_input_f64(tape, lg_shape2(rows, (uint32_t)nv), v), parts));
    assert_ok(lg_read(tape, lg_machine_record_energy(tape, &vars, parts), rows, out));
}

/* Every kind of coordinate, moving freely except for damping; all scales are 1. T of a body with unequal
 * moments of inertia changes slightly even without damping. */
static lg_machine damped(const lg_term_kind *kind) {
    lg_machine machine = all_coordinates();
    lg_machine_scales_init(&machine.scales);
    machine.input_count = 0;
    machine.velocities = 14;
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, lg_term_kind_name(kind));
    const uint32_t options = lg_term_kind_options(kind);
    if ((options & LG_TERM_OF) != 0) see_everything(&machine, term, (options & LG_TERM_MOVING) != 0, false);
    if ((options & LG_TERM_KNOWN) != 0) add_values(term, 14, some_values(14));
    /* Newton's method does not find a step over many widths of strong friction. */
    if ((options & LG_TERM_WIDTH) != 0) term->width = 0.2;
    assert_machine(&machine);
    return machine;
}

TEST("damping of every kind only takes energy away, even with long steps") {
    enum { STEPS = 30 };
    const lg_term_kind *kind;
    for (size_t k = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, k)) != NULL; k++) {
        if ((lg_term_kind_options(kind) & LG_TERM_INPUTS) != 0) continue; /* nothing loads this machine */
        const lg_machine machine = damped(kind);
        if (machine.bristles > 0) continue; /* refused */
        double q0[LG_MACHINE_POSITIONS], v0[LG_MACHINE_VELOCITIES], T[STEPS + 1];
        random_rows(&machine, 4, 1, q0, v0);
        run r = {&machine, machine_theta(&machine, 6), q0, v0, STEPS, 0.4, NULL, NULL};
        run_with(&r, "variational", 1);
        kinetic_energies(&r, T);
        for (int i = 0; i < STEPS; i++)
            if (!(T[i + 1] <= T[i] * (1.0 + 1e-5)))
                fail_msg("%s: %.12g after %.12g", lg_term_kind_name(kind), T[i + 1], T[i]);
        assert_true(T[STEPS] < 0.97 * T[0]);
    }
}

/* ---- learning ---- */

enum { PARTS = 4, WINDOW = 50, ROWS = PARTS * WINDOW };

typedef struct lesson {
    lg_machine machine;
    lg_machine_problem problem;
    lg_fit_problem fit;
    size_t first[PARTS + 1], start[PARTS];
    double t[ROWS], q[ROWS * 9], v[ROWS * 3], u[ROWS * 4];
} lesson;

static const double drag[3] = {0.25, 0.4, 0.15};

/* A pendulum on SO(3) with one torque. known: with the true damping; otherwise damping is learned. */
static lg_machine pendulum(bool known) {
    static const double weight[3] = {0.0, 0.0, 5.0}, torque[3] = {0.0, 1.0, 0.5};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "body", LG_COORDINATE_ROTATION);
    add_input(&machine, "u");
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 9, inertia);
    lg_machine_term *V = add_term(&machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(V, LG_FEATURE_HEIGHT, 0);
    add_values(V, 3, weight);
    lg_machine_term *D = add_term(&machine, LG_MACHINE_DAMPING, known ? "known" : "diagonal");
    if (known) add_values(D, 3, drag);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 3, torque);
    assert_machine(&machine);
    return machine;
}

/* Windows of 50 rows, .04 s apart, from runs of the true machine. */
static lesson *make_lesson(void) {
    lesson *l = TEST_ARRAY(lesson, 1);
    const lg_machine truth = pendulum(true);
    double q[ROWS * 9], v[ROWS * 3];
    random_rows(&truth, 14, ROWS, l->q, l->v);
    memcpy(l->u, test_numbers(15, ROWS * 4, -1, 1), sizeof l->u);
    for (size_t row = 0; row < ROWS; row++) {
        l->t[row] = 0.04 * (double)(row % WINDOW);
        l->first[row / WINDOW] = l->start[row / WINDOW] = row / WINDOW * WINDOW;
    }
    l->first[PARTS] = ROWS;
    l->problem =
        (lg_machine_problem){.scheme = lg_scheme_find("variational"),
                             .substeps = 4,
                             .window = WINDOW,
                             .log = {ROWS, PARTS, l->first, l->t, l->q, l->v, l->u, NULL, NULL, NULL},
                             .windows = PARTS,
                             .start = l->start,
                             .position_scale = {1.0},
                             .velocity_scale = {1.0}};
    assert_ok(lg_machine_free_run(NULL, &truth, NULL, lg_scheme_find("rkmk5"), 4, &l->problem.log, l->start,
                                  PARTS, WINDOW - 1, q, v, NULL));
    memcpy(l->q, q, sizeof q);
    memcpy(l->v, v, sizeof v);
    l->machine = pendulum(false);
    assert_ok(lg_machine_find_scales(&l->machine, &l->problem.log, NULL));
    l->problem.machine = &l->machine;
    assert_ok(lg_machine_problem_check(&l->problem, NULL));
    lg_machine_fit_problem(&l->problem, &l->fit);
    return l;
}

TEST("windows of fifty rows of a damped pendulum determine its damping") {
    lesson *l = make_lesson();
    double theta[3] = {0.1, 0.1, 0.1};
    lg_identified found[3];
    fit_by_lm(&l->fit, 40, theta);
    assert_int_equal(lg_machine_numbers(&l->machine, theta, 3, found), 3);
    for (int i = 0; i < 3; i++) {
        (void)printf("%s = %.6f\n", found[i].name, found[i].value);
        assert_close(found[i].value, drag[i], 5e-3, 0.0);
    }
}

TEST("the derivative of the loss agrees with difference quotients") {
    lesson *l = make_lesson();
    const double theta[3] = {0.3, 0.5, 0.4}, step = 1e-5;
    const uint32_t samples[PARTS] = {0, 1, 2, 3};
    const size_t rows = l->fit.rows;
    double *J = TEST_ARRAY(double, rows *PARTS * 3), *r = TEST_ARRAY(double, rows *PARTS), loss;
    assert_ok(l->fit.linearise(l->fit.user, test_tape(LG_F64), theta, samples, PARTS, PARTS, &loss, r, J));
    for (int j = 0; j < 3; j++) {
        double ends[2], moved[3], gradient = 0.0;
        for (int end = 0; end < 2; end++) {
            memcpy(moved, theta, sizeof moved);
            moved[j] += end == 0 ? -step : step;
            assert_ok(lg_machine_loss(NULL, &l->problem, moved, &ends[end], NULL, NULL));
        }
        for (size_t i = 0; i < rows * PARTS; i++) gradient += 2.0 * r[i] * J[i * 3 + (size_t)j];
        assert_close((ends[1] - ends[0]) / (2.0 * step), gradient, 1e-6, 1e-9);
    }
}

/* ---- runs that fail, refusals ---- */

TEST("a run that is not finite does not affect the others") {
    const lg_machine machine = pendulum(true);
    const size_t first[3] = {0, 2, 4}, start[2] = {0, 2};
    double t[4] = {0, 0.1, 0, 0.1}, u[16] = {0}, q[36], v[12], both_q[36], both_v[12], q1[18], v1[6];
    random_rows(&machine, 3, 4, q, v);
    v[0] = 1e200;
    const lg_machine_log log = {4, 2, first, t, q, v, u, NULL, NULL, NULL};
    const lg_scheme *scheme = lg_scheme_find("variational");
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, scheme, 1, &log, start, 2, 1, both_q, both_v, NULL));
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, scheme, 1, &log, start + 1, 1, 1, q1, v1, NULL));
    assert_true(isnan(both_v[3]));
    for (int i = 0; i < 3; i++) assert_true(both_v[9 + i] == v1[3 + i] && isfinite(v1[3 + i]));
    for (int i = 0; i < 9; i++) assert_true(both_q[27 + i] == q1[9 + i]);
}

TEST("a biased gyroscope shows the same motion with its bias added") {
    enum { STEPS = 20 };
    static const char *const schemes[] = {"variational", "cf4"};
    static const double bias[3] = {0.5, -0.3, 0.8};
    const lg_machine plain = pendulum(true);
    lg_machine biased = plain;
    double q0[9], v0[3], shown[3];
    add_feature(add_term(&biased, LG_MACHINE_BIAS, "constant"), LG_FEATURE_VELOCITY, 0);
    assert_machine(&biased);
    assert_int_equal(biased.parameters, 3);
    random_rows(&plain, 2, 1, q0, v0);
    for (int k = 0; k < 3; k++) shown[k] = v0[k] + bias[k];
    for (size_t i = 0; i < LG_COUNT(schemes); i++) {
        run a = {&plain, NULL, q0, v0, STEPS, 0.05, NULL, NULL},
            b = {&biased, bias, q0, shown, STEPS, 0.05, NULL, NULL};
        assert_ok(try_run(&a, schemes[i], 1, NULL));
        assert_ok(try_run(&b, schemes[i], 1, NULL));
        assert_all_close(b.q, a.q, 9 * (STEPS + 1), 1e-11, 1e-11);
        for (size_t k = 0; k < 3 * (STEPS + 1); k++) assert_close(b.v[k], a.v[k] + bias[k % 3], 1e-11, 1e-11);
    }
}

/* ---- the program ---- */

/* Steps of the program with held inputs against the runs of fits, which iterate until rounding is reached. */
static void check_program(const lg_machine *machine, double h, double *next) {
    enum { STEPS = 5 };
    const double *theta = machine_theta(machine, 5);
    lg_program *program = NULL;
    assert_told(
        lg_machine_program(NULL, machine, theta, lg_scheme_find("variational"), false, &program, &told));
    lg_test_owns(program, release_program);
    const ready step = make_ready(program, "step", 1, LG_F64),
                momenta = make_ready(program, "momenta", 1, LG_F64),
                positions = make_ready(program, "positions", 1, LG_F64),
                velocities = make_ready(program, "velocities", 1, LG_F64);
    const size_t first[2] = {0, STEPS + 1}, start = 0, m = machine->input_count;
    double t[STEPS + 1], *q = TEST_ARRAY(double, (STEPS + 1) * machine->positions),
                         *v = TEST_ARRAY(double, (STEPS + 1) * machine->velocities),
                         *u = inputs_over(machine, STEPS + 1), got[LG_MACHINE_POSITIONS];
    random_rows(machine, 21, 1, q, v);
    for (size_t i = 0; i <= STEPS; i++) t[i] = h * (double)i;
    for (size_t i = 0; i < (STEPS + 1) * 4 * m; i++) u[i] *= i % (4 * m) < m;
    const lg_machine_log log = {STEPS + 1, 1, first, t, q, v, u, NULL, NULL, NULL};
    double *run_q = TEST_ARRAY(double, (STEPS + 1) * machine->positions),
           *run_v = TEST_ARRAY(double, (STEPS + 1) * machine->velocities);
    assert_told(lg_machine_free_run(NULL, machine, theta, lg_scheme_find("variational"), 1, &log, &start, 1,
                                    STEPS, run_q, run_v, &told));
    lg_plan_eval(momenta.plan, (const void *const[]){q, v}, (void *const[]){next}, momenta.work);
    for (size_t i = 1; i <= STEPS; i++) {
        const void *const in[] = {next, m > 0 ? (const void *)(u + 4 * m * (i - 1)) : &h, &h};
        lg_plan_eval(step.plan, in, (void *const[]){next}, step.work);
        lg_plan_eval(positions.plan, (const void *const[]){next}, (void *const[]){got}, positions.work);
        assert_all_close(got, run_q + i * machine->positions, machine->positions, 1e-10, 1e-11);
        lg_plan_eval(velocities.plan, (const void *const[]){next}, (void *const[]){got}, velocities.work);
        assert_all_close(got, run_v + i * machine->velocities, machine->velocities, 1e-10, 1e-11);
    }
}

TEST("the step of a program is that of fits, for every kind of coordinate; a step that is too long is not "
     "finite") {
    double next[LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES];
    for (int kind = 0; kind < LG_COORDINATE_KIND_COUNT; kind++)
        for (int forced = 0; forced < 2; forced++) {
            const lg_machine machine = single((lg_coordinate_kind)kind, forced == 1);
            check_program(&machine, 0.02, next);
        }
    const lg_machine all = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "constant"), LG_MACHINE_MASS);
    check_program(&all, 0.02, next);
    const lg_machine body = top(NULL);
    lg_program *program = NULL;
    assert_told(lg_machine_program(NULL, &body, NULL, lg_scheme_find("variational"), false, &program, &told));
    lg_test_owns(program, release_program);
    const ready step = make_ready(program, "step", 1, LG_F64);
    const double x[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 40, -30, 20}, h[2] = {0.01, 1};
    lg_plan_eval(step.plan, (const void *const[]){x, &h[0]}, (void *const[]){next}, step.work);
    for (int i = 0; i < 12; i++) assert_true(isfinite(next[i]));
    lg_plan_eval(step.plan, (const void *const[]){x, &h[1]}, (void *const[]){next}, step.work);
    for (int i = 0; i < 12; i++) assert_false(isfinite(next[i]));
    const ready single = make_ready(program, "step", 1, LG_F32);
    for (int k = 0; k < 200; k++) { /* fast bodies in single precision: rounding is no failure */
        const double *w = test_numbers((uint64_t)k, 3, -100, 100);
        const float y[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, (float)w[0], (float)w[1], (float)w[2]}, tiny = 1e-3f;
        float after[12];
        lg_plan_eval(single.plan, (const void *const[]){y, &tiny}, (void *const[]){after}, single.work);
        for (int i = 0; i < 12; i++) assert_true(isfinite(after[i]));
    }
}

TEST("fits and exported steps reject masses that depend on the state") {
    const lg_machine moving = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
    lg_error error = {LG_OK, ""};
    double q0[LG_MACHINE_POSITIONS], v0[LG_MACHINE_VELOCITIES];
    random_rows(&moving, 2, 1, q0, v0);
    run r = {&moving, machine_theta(&moving, 1), q0, v0, 1, 0.1, NULL, NULL};
    assert_status(try_run(&r, "variational", 1, &error), LG_UNSUPPORTED);
    assert_says(error.message, "masses that do not depend on the state");
    lesson *l = make_lesson();
    l->problem.machine = &moving;
    for (uint32_t i = 0; i < moving.coordinate_count; i++)
        l->problem.position_scale[i] = l->problem.velocity_scale[i] = 1.0;
    assert_status(lg_machine_problem_check(&l->problem, &error), LG_UNSUPPORTED);
    assert_says(error.message, "masses that do not depend on the state");
    lg_program *program;
    assert_status(
        lg_machine_program(NULL, &moving, r.theta, lg_scheme_find("variational"), false, &program, &error),
        LG_UNSUPPORTED);
    assert_says(error.message, "masses that do not depend on the state");
    lg_machine chain = empty_machine();
    add_coordinate(&chain, "q1", LG_COORDINATE_DIRECTION);
    add_coordinate(&chain, "q2", LG_COORDINATE_DIRECTION);
    assert_ok(lg_machine_set_system(&chain, "pendulum-chain", &error));
    assert_ok(lg_machine_set_parameter(&chain, "gravity", 1, (const double[]){9.81}, NULL, &error));
    assert_machine(&chain);
    random_rows(&chain, 2, 1, q0, v0);
    run swing = {&chain, machine_theta(&chain, 1), q0, v0, 1, 0.1, NULL, NULL};
    assert_status(try_run(&swing, "variational", 1, &error), LG_UNSUPPORTED);
    assert_says(error.message, "a mass matrix couples them");
}
