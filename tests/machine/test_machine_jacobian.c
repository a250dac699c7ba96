/* Machines: the Jacobian of windows, computed interval by interval, compared with the tape's Jacobian of
 * their residuals.
 * ctest-labels: src/machine */
#include "support/tied_systems.h"

#include "liegrad/fit.h"

#include "machine/internal.h"
#include "nn/fit_internal.h"

enum { PARTS = 3, WINDOW = 3, ROWS = PARTS * WINDOW };

typedef struct task {
    size_t first[PARTS + 1], start[PARTS];
    double t[ROWS], q[ROWS * LG_MACHINE_POSITIONS], v[ROWS * LG_MACHINE_VELOCITIES], *u;
    lg_machine_problem problem;
    lg_fit_problem fit;
} task;

RELEASES(release_fit, lg_fit_destroy)

/* Windows of random rows with residuals of size 1. The time steps have different lengths. In one row a
 * velocity is NaN, and in one row a direction is. */
static task *make_task(const lg_machine *machine, lg_machine_starts starts, const char *scheme,
                       const double *theta) {
    task *t = TEST_ARRAY(task, 1);
    random_rows(machine, 11, ROWS, t->q, t->v);
    for (size_t row = 0; row < ROWS; row++) {
        t->t[row] = 0.05 * (double)row + 0.002 * (double)(row * row % 7);
        t->first[row / WINDOW] = t->start[row / WINDOW] = row / WINDOW * WINDOW;
    }
    t->first[PARTS] = ROWS;
    t->u = test_numbers(4, ROWS * 4 * (machine->input_count + 1), -1, 1);
    t->v[2 * machine->velocities + 1] = (double)NAN;
    lg_machine_offsets of = {0};
    while (lg_machine_next(machine, &of) && of.directions == 0) continue;
    for (uint32_t k = 0; k < 3 && of.directions > 0; k++)
        t->q[machine->positions + of.position + k] = (double)NAN;
    t->problem =
        (lg_machine_problem){.machine = machine,
                             .scheme = lg_scheme_find(scheme),
                             .substeps = 2,
                             .window = WINDOW,
                             .starts = starts,
                             .theta = theta,
                             .log = {ROWS, PARTS, t->first, t->t, t->q, t->v, t->u, NULL, NULL, NULL},
                             .windows = PARTS,
                             .start = t->start};
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        t->problem.position_scale[i] = 0.5 + 0.1 * i, t->problem.velocity_scale[i] = 1.5 - 0.1 * i;
    assert_ok(lg_machine_problem_check(&t->problem, NULL));
    lg_machine_fit_problem(&t->problem, &t->fit);
    return t;
}

enum { DIRECTIONS = 4 };

/* J d for one sample. Column j < shared belongs to parameter j, the other columns to parameters from `first`
 * on. */
static void along(size_t rows, size_t columns, size_t shared, size_t first, const double *J, const double *d,
                  double *out) {
    for (size_t row = 0; row < rows; row++)
        for (size_t j = 0; j < columns; j++)
            out[row] += J[row * columns + j] * d[j < shared ? j : first + j - shared];
}

static double dot(size_t n, const double *a, const double *b) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* Compares the inner products of r and of J d for some d with those of the tape's residuals, `expected`. */
static void assert_products(size_t rows, const double *found, size_t count, const double *expected) {
    for (size_t i = 0; i <= DIRECTIONS; i++)
        for (size_t j = 0; j <= DIRECTIONS; j++) {
            if (i == 0 && j == 0) continue; /* r may lack its part normal to the columns of J */
            const double *a = expected + i * count, *b = expected + j * count;
            const double size = sqrt(dot(count, a, a) * dot(count, b, b)),
                         product = dot(rows, found + i * rows, found + j * rows);
            assert_true(size > 1e-6);
            if (!(fabs(product - dot(count, a, b)) <= 1e-11 * size))
                fail_msg("%zu, %zu: %.17g instead of %.17g", i, j, product, dot(count, a, b));
        }
}

/* Compares the Jacobian of `windows` windows with the tape's. */
static void assert_products_of(task *t, uint32_t windows) {
    static const uint32_t orders[][PARTS] = {{0}, {2, 0, 1}};
    const uint32_t *samples = orders[windows > 1];
    const size_t n = t->fit.parameters, own = t->fit.own, shared = n - own * windows, columns = shared + own,
                 rows = t->fit.rows;
    double *theta = test_numbers(6, n, -0.3, 0.3), loss = 0.0;
    double *J = TEST_ARRAY(double, rows *windows *columns),
           *found = TEST_ARRAY(double, (DIRECTIONS + 1) * rows * windows);
    lg_tape *tape = test_tape(LG_F64);
    const lg_status status =
        t->fit.linearise(t->fit.user, tape, theta, samples, windows, windows, &loss, found, J);
    if (status != LG_OK) fail_msg("%s", lg_tape_message(tape));
    lg_tape_reset(tape);
    const lg_var x = lg_parameter(tape, lg_shape1((uint32_t)n), theta);
    lg_var all;
    assert_ok(t->fit.residuals(t->fit.user, tape, x, samples, windows, windows, &all));
    const size_t count = lg_shape_count(lg_var_shape(tape, all));
    double *expected = TEST_ARRAY(double, (DIRECTIONS + 1) * count);
    assert_ok(lg_read(tape, all, count, expected));
    for (size_t i = 1; i <= DIRECTIONS; i++) {
        const double *d = test_numbers(20 + i, n, -1, 1);
        const lg_var direction = lg_input_f64(tape, lg_shape1((uint32_t)n), d);
        lg_var change;
        assert_ok(lg_jvp(tape, &all, 1, &x, &direction, 1, &change));
        assert_ok(lg_read(tape, change, count, expected + i * count));
        for (size_t s = 0; s < windows; s++)
            along(rows, columns, shared, shared + own * samples[s], J + s * rows * columns, d,
                  found + (i * windows + s) * rows);
    }
    assert_true(fabs(loss - dot(count, expected, expected)) <= 1e-11 * loss);
    assert_products(rows * windows, found, count, expected);
}

/* `known`: the machine's parameters, which are then not learned, or NULL. */
static void assert_jacobian(const lg_machine *machine, lg_machine_starts starts, const char *scheme,
                            const double *known) {
    assert_products_of(make_task(machine, starts, scheme, known), PARTS);
}

TEST("the Jacobian of windows agrees with the tape, with every kind of term") {
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            assert_jacobian(&machine, LG_MACHINE_STARTS_MEASURED, "cf4", NULL);
        }
    }
}

/* A line and an angle with a mass that depends on the angle, an input, and friction of one kind. */
static lg_machine rubbing(const lg_term_kind *kind, double width) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    odd_scales(&machine);
    assert_told(lg_machine_set_system(&machine, "cart-pole", &told));
    add_feature(add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic"), LG_FEATURE_POSITION, 0);
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, (double[]){1, 0.5});
    lg_machine_term *term = add_term(&machine, LG_MACHINE_DAMPING, lg_term_kind_name(kind));
    const uint32_t options = lg_term_kind_options(kind);
    if ((options & LG_TERM_INPUTS) != 0) add_feature(term, LG_FEATURE_INPUT, 0);
    if ((options & LG_TERM_OF) != 0) add_feature(term, LG_FEATURE_POSITION, 0);
    term->width = width;
    assert_machine(&machine);
    return machine;
}

TEST("the Jacobian of machines whose friction sticks, by plans, agrees with the tape") {
    const lg_term_kind *kind;
    for (size_t i = 0; (kind = lg_term_kind_at(LG_MACHINE_DAMPING, i)) != NULL; i++) {
        if ((lg_term_kind_options(kind) & LG_TERM_WIDTH) == 0) continue;
        const lg_machine machine = rubbing(kind, 0.0);
        assert_true(machine.sticks == 3);
        assert_jacobian(&machine, LG_MACHINE_STARTS_MEASURED, "cf4", NULL);
        assert_jacobian(&machine, LG_MACHINE_STARTS_ESTIMATED, "cf4", NULL);
    }
}

TEST("the Jacobian has the derivatives by the starts, each start in its own columns") {
    const lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
    assert_jacobian(&machine, LG_MACHINE_STARTS_ESTIMATED, "cf4", NULL);
    lg_machine rods = empty_machine();
    add_coordinate(&rods, "x", LG_COORDINATE_LINE);
    add_coordinate(&rods, "y", LG_COORDINATE_LINE);
    add_coordinate(&rods, "d", LG_COORDINATE_DIRECTION);
    add_coordinate(&rods, "e", LG_COORDINATE_DIRECTION);
    odd_scales(&rods);
    add_values(add_term(&rods, LG_MACHINE_MASS, "diagonal"), 8,
               (double[]){2, 3, 1.2, 1.2, 1.2, 0.7, 0.7, 0.7});
    see_everything(&rods, add_term(&rods, LG_MACHINE_POTENTIAL, "network"), false, false);
    assert_machine(&rods);
    assert_jacobian(&rods, LG_MACHINE_STARTS_ESTIMATED, "cf4", NULL);
}

TEST("the Jacobian of machines with directions beside other coordinates agrees with the tape") {
    for (size_t i = 0; i < LG_COUNT(tied_rows); i++) {
        const lg_machine machine = tied_machine(tied_rows[i]);
        assert_jacobian(&machine, LG_MACHINE_STARTS_MEASURED, "cf4", NULL);
        assert_jacobian(&machine, LG_MACHINE_STARTS_ESTIMATED, "rkmk4", NULL);
    }
}

/* A window of so many rows that a plan passes them, of lines and angles. */
TEST("a plan passes the rows of a long window: loss, residuals and Jacobian are the tape's") {
    enum { LONG = 520, ALL = LONG + PARTS - 1 };
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "y", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    (void)add_term(&machine, LG_MACHINE_MASS, "constant");
    lg_machine_term *spring = add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(spring, LG_FEATURE_POSITION, 0);
    add_feature(spring, LG_FEATURE_POSITION, 1);
    (void)add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    lg_machine_term *map = add_term(&machine, LG_MACHINE_INPUT_MAP, "known");
    add_values(map, 2, (double[]){1, 0.5});
    map->entries[map->entry_count++] = (lg_machine_entry){1, 0, 0, 0.2}; /* its prior has a row */
    odd_scales(&machine);
    assert_machine(&machine);
    task *t = make_task(&machine, LG_MACHINE_STARTS_ESTIMATED, "cf4", NULL);
    double *time = test_numbers(7, ALL, 0, 1), *q = test_numbers(8, 2 * ALL, -0.1, 0.1),
           *v = test_numbers(9, 2 * ALL, -0.1, 0.1), *u = test_numbers(10, 4 * ALL, -0.1, 0.1);
    for (uint32_t i = 0; i < ALL; i++) time[i] = 0.02 * i + 0.005 * time[i];
    q[101] = v[202] = (double)NAN;
    t->first[1] = ALL;
    t->problem.log =
        (lg_machine_log){.rows = ALL, .parts = 1, .first = t->first, .t = time, .q = q, .v = v, .u = u};
    t->problem.window = LONG;
    t->problem.windows = PARTS;
    t->problem.start = (const size_t[]){0, 1, 2};
    lg_machine_fit_problem(&t->problem, &t->fit);
    assert_products_of(t, PARTS);
    /* lg_machine_loss takes the same way. */
    const double *theta = test_numbers(6, t->fit.parameters, -0.3, 0.3);
    double loss = 0, floor = 0, whole = 0;
    lg_tape *tape = test_tape(LG_F64);
    const uint32_t samples[PARTS] = {0, 1, 2};
    lg_var taped;
    assert_ok(lg_machine_loss(NULL, &t->problem, theta, &loss, &floor, NULL));
    const lg_var x = lg_parameter(tape, lg_shape1((uint32_t)t->fit.parameters), theta);
    assert_ok(t->fit.residuals(t->fit.user, tape, x, samples, PARTS, PARTS, &taped));
    assert_ok(lg_read(tape, lg_sum(tape, lg_square(tape, taped)), 1, &whole));
    assert_close(loss, whole, 1e-11, 0);
    if (!(floor > 0 && floor < 0.01 * loss)) fail_msg("floor %g of the loss %g", floor, loss);
}

/* Residuals of momenta of windows of `rows` rows from the given rows on. */
static void momenta_of(task *t, uint32_t rows, const size_t *start, size_t count, double *out) {
    static const uint32_t samples[PARTS] = {0, 1, 2};
    lg_machine_problem problem = t->problem;
    lg_fit_problem of;
    lg_tape *tape = test_tape(LG_F64);
    lg_var r;
    problem.window = rows;
    problem.windows = count;
    problem.start = start;
    lg_machine_momentum_problem(&problem, &of);
    const lg_var x = lg_machine_parameter(tape, problem.machine, test_numbers(6, of.parameters, -0.3, 0.3));
    assert_ok(of.residuals(of.user, tape, x, samples, count, 1, &r));
    assert_ok(lg_read(tape, r, lg_shape_count(lg_var_shape(tape, r)), out));
}

TEST("residuals of momenta add up over the rows of a window; a window that lacks a number counts nothing") {
    static const size_t start[PARTS] = {0, WINDOW, 2 * WINDOW}, next[PARTS] = {1, WINDOW + 1, 2 * WINDOW + 1};
    lg_machine rod = empty_machine();
    add_coordinate(&rod, "x", LG_COORDINATE_DIRECTION);
    odd_scales(&rod);
    add_term(&rod, LG_MACHINE_MASS, "diagonal");
    add_term(&rod, LG_MACHINE_DAMPING, "diagonal");
    assert_machine(&rod);
    const lg_machine all = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "constant"), LG_MACHINE_MASS),
                     *const machines[] = {&rod, &all};
    for (size_t m = 0; m < LG_COUNT(machines); m++) {
        task *t = make_task(machines[m], LG_MACHINE_STARTS_MEASURED, "cf4", NULL);
        const size_t n = machines[m]->velocities;
        double whole[PARTS * LG_MACHINE_VELOCITIES], first[PARTS * LG_MACHINE_VELOCITIES],
            second[PARTS * LG_MACHINE_VELOCITIES];
        momenta_of(t, WINDOW, start, PARTS, whole);
        momenta_of(t, 2, start, PARTS, first);
        momenta_of(t, 2, next, PARTS, second);
        for (size_t i = 0; i < PARTS * n; i++)
            assert_close(whole[i], i < n ? 0 : first[i] + second[i], 1e-12, 1e-13);
    }
}

TEST("with known parameters the Jacobian has only the columns of the starts") {
    const lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
    assert_jacobian(&machine, LG_MACHINE_STARTS_ESTIMATED, "cf4", machine_theta(&machine, 7));
}

/* Variational steps solve implicit equations; the Jacobian must contain the derivative of their solution. */
TEST("the Jacobian of variational steps agrees with the tape too, with every kind of term and with starts") {
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            if (machine_moves(&machine) || machine.bristles > 0) continue;
            assert_jacobian(&machine, LG_MACHINE_STARTS_MEASURED, "variational", NULL);
        }
    }
    const lg_machine full = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "constant"), LG_MACHINE_MASS);
    assert_jacobian(&full, LG_MACHINE_STARTS_ESTIMATED, "variational", NULL);
}

TEST("the Jacobian has the rows of priors, of values and of a system's parameters") {
    static const double start[2] = {0.4, 1.2};
    static const bool unknown = true;
    for (int starts = 0; starts < 2; starts++) {
        lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "known"), LG_MACHINE_MASS);
        lg_machine_term *map = &machine.terms[machine.term_count - 1];
        map->kind = lg_term_kind_find(LG_MACHINE_INPUT_MAP, "known");
        add_values(map, 28, some_values(28));
        map->entries[map->entry_count++] = (lg_machine_entry){3, 0, 0, 0.2};
        map->entries[map->entry_count++] = (lg_machine_entry){5, -4, 9, 0.1};
        assert_machine(&machine);
        assert_jacobian(&machine, (lg_machine_starts)starts, "cf4", NULL);
        lg_machine arm = empty_machine();
        add_coordinate(&arm, "a", LG_COORDINATE_ANGLE);
        add_coordinate(&arm, "b", LG_COORDINATE_ANGLE);
        assert_ok(lg_machine_set_system(&arm, "two-link-arm", NULL));
        assert_ok(lg_machine_set_parameter(&arm, "masses", 2, start, NULL, NULL));
        assert_ok(lg_machine_set_parameter(&arm, "inertia", 2, start, &(const bool[2]){true, true}[0], NULL));
        assert_ok(lg_machine_set_parameter(&arm, "centres", 2, start, NULL, NULL));
        assert_ok(lg_machine_set_parameter(&arm, "length", 1, start, &unknown, NULL));
        assert_ok(lg_machine_bound_parameter(&arm, "inertia", 1, 0.1, 3, 0.4, NULL));
        assert_ok(lg_machine_bound_parameter(&arm, "length", 0, 0, 0, 0.3, NULL));
        assert_machine(&arm);
        assert_jacobian(&arm, (lg_machine_starts)starts, "cf4", NULL);
    }
}

/* Loss and gradient at theta, by plans or on the tape. Returns whether by plans. */
static bool gradient_of(task *t, bool plans, const double *theta, double *loss, double *gradient) {
    lg_fit_options o;
    lg_fit *fit = NULL;
    lg_fit_options_init(&o);
    o.shards = 1;
    assert_true(t->fit.repeats);
    t->fit.repeats = plans;
    assert_told(lg_fit_create(NULL, &t->fit, &o, theta, &fit, &told));
    t->fit.repeats = true;
    lg_test_owns(fit, release_fit);
    for (int again = 0; again < 2; again++) {
        fit->point = fit->state.theta;
        assert_told(lg_fit_batch_loss(fit, fit->state.order, PARTS, true, "test", loss, &told));
    }
    memcpy(gradient, fit->shards[0].gradient, t->fit.parameters * sizeof *gradient);
    return lg_fit_by_plans(fit);
}

static bool assert_plan(const lg_machine *machine, lg_machine_starts starts, const char *scheme,
                        double tolerance) {
    task *t = make_task(machine, starts, scheme, NULL);
    const size_t n = t->fit.parameters;
    double *theta = test_numbers(6, n, -0.3, 0.3), *by_plan = TEST_ARRAY(double, n),
           *by_tape = TEST_ARRAY(double, n), loss[2];
    const bool planned = gradient_of(t, true, theta, &loss[0], by_plan);
    assert_false(gradient_of(t, false, theta, &loss[1], by_tape));
    assert_close(loss[0], loss[1], 1e-12, 0);
    const double size = sqrt(dot(n, by_tape, by_tape));
    for (size_t i = 0; i < n; i++)
        if (!(fabs(by_plan[i] - by_tape[i]) <= tolerance * size))
            fail_msg("parameter %zu of %zu: %.17g, on the tape %.17g", i, n, by_plan[i], by_tape[i]);
    return planned;
}

TEST("loss and gradient by plans are those of the tape, with every kind of term, with a scheme or starts for "
     "each") {
    static const char *const schemes[] = {"cf4", "rkmk5", "cg3"};
    size_t planned = 0, tried = 0;
    for (uint32_t part = 0; part < LG_MACHINE_PART_COUNT; part++) {
        const lg_term_kind *kind;
        for (size_t i = 0; (kind = lg_term_kind_at((lg_machine_part)part, i)) != NULL; i++) {
            const lg_machine machine = machine_with(kind, (lg_machine_part)part);
            const size_t s = tried++ % LG_COUNT(schemes);
            planned += assert_plan(
                &machine, (lg_machine_starts)(s == 1 && machine.bristles == 0), schemes[s],
                part == LG_MACHINE_DAMPING && s == 1 ? 2e-10 : 1e-13); /* kinks of friction at the starts */
        }
    }
    print_message("%zu of %zu by plans\n", planned, tried);
    assert_true(2 * planned > tried);
}
