/* ctest-labels: slow src/machine
 * The loss that is expected of a model that explains its logs must be the mean loss over logs with random
 * noise. */
#include "liegrad/geometry.h"
#include "support/machine_support.h"
#include "support/seed.h"

/* A cart (line) and a pendulum (angle) side by side: 2 x'' = u - .3 x' - 5 x, a'' = -9 sin a - .2 a'. */
static lg_machine plant(bool known) {
    static const double m[] = {2.0, 1.0}, k[] = {2.5}, g[] = {0.0, -9.0}, d[] = {0.3, 0.2},
                        map[] = {1.0, 0.0};
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_coordinate(&machine, "a", LG_COORDINATE_ANGLE);
    add_input(&machine, "u");
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 2, m);
    lg_machine_term *spring = add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(spring, LG_FEATURE_POSITION, 0);
    lg_machine_term *weight = add_term(&machine, LG_MACHINE_POTENTIAL, "linear");
    add_feature(weight, LG_FEATURE_POSITION, 1);
    lg_machine_term *friction = add_term(&machine, LG_MACHINE_DAMPING, known ? "known" : "diagonal");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, map);
    if (known) {
        add_values(spring, 1, k);
        add_values(weight, 2, g);
        add_values(friction, 2, d);
    }
    assert_machine(&machine);
    return machine;
}

enum { PARTS = 40, ROWS = 101, ALL = PARTS * ROWS, COLUMNS = 2 };
#define DT 0.02

typedef struct logs {
    size_t first[PARTS + 1], start[ALL];
    double t[ALL], true_q[ALL * COLUMNS], true_v[ALL * COLUMNS], q[ALL * COLUMNS], v[ALL * COLUMNS],
        u[ALL * 4];
    lg_machine_log log;
} logs;

static logs *make_logs(void) {
    const lg_machine machine = plant(true);
    logs *l = TEST_ARRAY(logs, 1);
    lg_rng rng = test_rng(1, 0);
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, l->u, NULL, NULL, NULL};
    for (size_t row = 0; row < ALL; row++) {
        l->first[row / ROWS] = l->start[row / ROWS] = row / ROWS * ROWS;
        l->t[row] = DT * (double)(row % ROWS);
        for (int c = 0; c < COLUMNS; c++) {
            l->q[row * COLUMNS + c] = lg_rng_normal(&rng);
            l->v[row * COLUMNS + c] = 2.0 * lg_rng_normal(&rng);
        }
        l->u[row * 4] = 6.0 * lg_rng_normal(&rng);
    }
    l->first[PARTS] = ALL;
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 2, &l->log, l->start, PARTS,
                                  ROWS - 1, l->true_q, l->true_v, NULL));
    return l;
}

static const double of_q[COLUMNS] = {4e-3, 2e-3}, of_v[COLUMNS] = {1e-2, 2e-2};

static void draw_noise(logs *l, bool positions_only, uint64_t seed) {
    lg_rng rng = test_rng(seed, 0);
    for (size_t i = 0; i < ALL * COLUMNS; i++) {
        l->q[i] = l->true_q[i] + of_q[i % COLUMNS] * lg_rng_normal(&rng);
        l->v[i] = positions_only ? (double)NAN : l->true_v[i] + of_v[i % COLUMNS] * lg_rng_normal(&rng);
    }
}

typedef struct way {
    uint32_t window, stride; /* stride 0: neighbouring windows share only their ends */
    lg_machine_starts starts;
    bool positions_only;
    uint64_t seeds; /* number of draws of the noise; enough to know the mean to about .003 */
} way;

static lg_machine_problem problem_of(logs *l, const lg_machine *machine, const way *w) {
    lg_machine_problem p = {.machine = machine,
                            .scheme = lg_scheme_find("cf4"),
                            .substeps = 1,
                            .window = w->window,
                            .starts = w->starts,
                            .log = l->log,
                            .start = l->start};
    for (int c = 0; c < COLUMNS; c++) p.position_scale[c] = of_q[c], p.velocity_scale[c] = of_v[c];
    p.windows = lg_machine_windows(machine, &l->log, w->window, w->stride > 0 ? w->stride : w->window - 1,
                                   w->positions_only, l->start);
    return p;
}

/* theta is input and output: the machine's parameters, followed by room for starts. */
static void fit(const lg_machine_problem *p, double *theta) {
    lg_fit_problem problem;
    lg_machine_fit_problem(p, &problem);
    fit_by_lm(&problem, 30, theta);
}

/* The loss of the best fit divided by the expected loss. Starts from the parameters of exact logs. */
static double ratio_of(logs *l, const lg_machine *machine, const double *truth, const way *w) {
    const lg_machine_problem p = problem_of(l, machine, w);
    lg_machine_noise noise = {.position = {0}};
    lg_machine_expected expected;
    double loss;
    for (int c = 0; c < COLUMNS; c++) noise.position[c] = of_q[c], noise.velocity[c] = of_v[c];
    double *theta = lg_test_memory(lg_machine_problem_parameters(&p) * sizeof *theta);
    memset(theta, 0, lg_machine_problem_parameters(&p) * sizeof *theta);
    memcpy(theta, truth, machine->parameters * sizeof *theta);
    fit(&p, theta);
    assert_ok(lg_machine_loss(NULL, &p, theta, &loss, NULL, NULL));
    assert_ok(lg_machine_expect(NULL, &p, theta, &noise, &expected, NULL));
    return loss / expected.loss;
}

/* The parameters fitted to logs without noise, and the scales of these logs. */
static double *learn_exact(logs *l, lg_machine *machine) {
    static const way exact = {5, 0, LG_MACHINE_STARTS_MEASURED, false, 1};
    lg_rng rng = test_rng(1, 0);
    memcpy(l->q, l->true_q, sizeof l->q);
    memcpy(l->v, l->true_v, sizeof l->v);
    assert_ok(lg_machine_find_scales(machine, &l->log, NULL));
    const lg_machine_problem p = problem_of(l, machine, &exact);
    double *truth = TEST_ARRAY(double, machine->parameters);
    lg_machine_initialise(machine, &rng, truth);
    fit(&p, truth);
    return truth;
}

TEST("the mean loss of fits is within a hundredth of the expected loss, for all starts, columns and "
     "windows") {
    static const way ways[] = {
        {2, 0, LG_MACHINE_STARTS_MEASURED, false, 24},   {5, 0, LG_MACHINE_STARTS_MEASURED, false, 40},
        {9, 3, LG_MACHINE_STARTS_MEASURED, false, 48},   {3, 0, LG_MACHINE_STARTS_ESTIMATED, false, 12},
        {5, 0, LG_MACHINE_STARTS_ESTIMATED, false, 12},  {20, 7, LG_MACHINE_STARTS_ESTIMATED, false, 12},
        {60, 0, LG_MACHINE_STARTS_ESTIMATED, false, 12}, {5, 0, LG_MACHINE_STARTS_ESTIMATED, true, 24},
        {20, 0, LG_MACHINE_STARTS_ESTIMATED, true, 16},  {101, 0, LG_MACHINE_STARTS_ESTIMATED, true, 16}};
    logs *l = make_logs();
    lg_machine machine = plant(false);
    double *truth = learn_exact(l, &machine);
    for (size_t i = commit_seed() % 2; i < LG_COUNT(ways); i += 2) {
        double sum = 0.0, squares = 0.0;
        for (uint64_t seed = 1; seed <= ways[i].seeds; seed++) {
            draw_noise(l, ways[i].positions_only, seed);
            const double ratio = ratio_of(l, &machine, truth, &ways[i]);
            sum += ratio, squares += ratio * ratio;
        }
        const double n = (double)ways[i].seeds, mean = sum / n,
                     deviation = sqrt((squares / n - mean * mean) / (n - 1.0));
        if (!(fabs(mean - 1.0) < 0.01) || !(deviation < 0.005))
            fail_msg("way %zu: the loss is %.4f +- %.4f of the expected one", i, mean, deviation);
    }
}

TEST("each fitted parameter lowers the expected loss: a short log, where this is a fortieth of the loss") {
    enum { FEW = 49 };
    static const way estimated = {20, 0, LG_MACHINE_STARTS_ESTIMATED, false, 500};
    logs *l = make_logs();
    lg_machine machine = plant(false);
    double *truth = learn_exact(l, &machine);
    l->log.parts = 1, l->log.rows = l->first[1] = FEW;
    double sum = 0.0;
    for (uint64_t seed = 1; seed <= estimated.seeds; seed++) {
        draw_noise(l, false, seed);
        sum += ratio_of(l, &machine, truth, &estimated);
    }
    const double mean = sum / (double)estimated.seeds;
    if (!(fabs(mean - 1.0) < 0.01)) fail_msg("the loss is %.4f of the expected one", mean);
}

/* ---- all kinds of coordinates ---- */

/* The machines of the table. Their damping is unknown; everything else is known. */
static void add_pendulum(lg_machine *machine) {
    static const double m[] = {1.0}, g[] = {0.0, -9.0};
    add_coordinate(machine, "a", LG_COORDINATE_ANGLE);
    add_values(add_term(machine, LG_MACHINE_MASS, "known"), 1, m);
    lg_machine_term *weight = add_term(machine, LG_MACHINE_POTENTIAL, "linear");
    add_feature(weight, LG_FEATURE_POSITION, 0);
    add_values(weight, 2, g);
}

static void add_system(lg_machine *machine, const char *name, size_t count, const char *const *keys,
                       const double *const *values, const size_t *lengths) {
    assert_told(lg_machine_set_system(machine, name, &told));
    for (size_t i = 0; i < count; i++)
        assert_told(lg_machine_set_parameter(machine, keys[i], lengths[i], values[i], NULL, &told));
}

static void add_cart(lg_machine *machine) {
    static const double gravity[] = {-9.81}, pole[] = {0.3}, length[] = {0.5};
    add_coordinate(machine, "x", LG_COORDINATE_LINE);
    add_coordinate(machine, "a", LG_COORDINATE_ANGLE);
    add_system(machine, "cart-pole", 3, (const char *[]){"gravity", "pole", "length"},
               (const double *[]){gravity, pole, length}, (size_t[]){1, 1, 1});
}

static void add_satellite(lg_machine *machine) {
    static const double inertia[] = {0.3, 0.4, 0.2};
    add_coordinate(machine, "body", LG_COORDINATE_ROTATION);
    add_system(machine, "rigid-body-attitude", 1, (const char *[]){"inertia"}, (const double *[]){inertia},
               (size_t[]){3});
}

static void add_top(lg_machine *machine) {
    static const double inertia[] = {0.3, 0.4, 0.2}, mass[] = {0.8}, length[] = {0.25}, chi[] = {0, 0.6, 0.8};
    add_coordinate(machine, "top", LG_COORDINATE_ROTATION);
    add_system(machine, "heavy-top", 4, (const char *[]){"inertia", "mass", "length", "chi"},
               (const double *[]){inertia, mass, length, chi}, (size_t[]){3, 1, 1, 3});
}

static void add_bob(lg_machine *machine) {
    static const double m[] = {1.0, 1.0, 1.0}, g[] = {9.81};
    add_coordinate(machine, "d", LG_COORDINATE_DIRECTION);
    add_values(add_term(machine, LG_MACHINE_MASS, "known"), 3, m);
    lg_machine_term *weight = add_term(machine, LG_MACHINE_POTENTIAL, "gravity");
    add_feature(weight, LG_FEATURE_POSITION, 0);
    add_values(weight, 1, g);
}

static void add_chain(lg_machine *machine) {
    static const double gravity[] = {9.81}, masses[] = {1.0, 0.7, 0.5}, lengths[] = {0.5, 0.4, 0.3};
    for (int i = 0; i < 3; i++)
        add_coordinate(machine, (const char *[]){"a", "b", "c"}[i], LG_COORDINATE_DIRECTION);
    add_system(machine, "pendulum-chain", 3, (const char *[]){"gravity", "masses", "lengths"},
               (const double *[]){gravity, masses, lengths}, (size_t[]){1, 3, 3});
}

static const struct {
    const char *name;
    void (*add)(lg_machine *machine);
} kinds[] = {{"pendulum", add_pendulum},   {"cart with a pendulum", add_cart},
             {"satellite", add_satellite}, {"spherical pendulum", add_bob},
             {"heavy top", add_top},       {"chain on S^2", add_chain}};

static lg_machine machine_of(size_t kind, bool known) {
    static const double damping[] = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1};
    lg_machine machine = empty_machine();
    kinds[kind].add(&machine);
    uint32_t velocities = 0;
    for (uint32_t i = 0; i < machine.coordinate_count; i++)
        velocities += lg_coordinate_row_of(machine.coordinates[i].kind)->velocities;
    lg_machine_term *friction = add_term(&machine, LG_MACHINE_DAMPING, known ? "known" : "diagonal");
    if (known) add_values(friction, velocities, damping);
    assert_machine(&machine);
    return machine;
}

/* As a sensor's errors: turns attitudes by, and adds to places and velocities, normal numbers of these
 * deviations; omega stays across the direction as it was logged. */
static void disturb(const lg_machine *machine, lg_rng *rng, double position, double velocity, double *q,
                    double *v) {
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        double turn[3], turned[9], *x = q + at.position, *w = v + at.velocity;
        for (uint32_t k = 0; k < at.places; k++) x[k] += position * lg_rng_normal(rng);
        for (int k = 0; k < 3; k++) turn[k] = position * lg_rng_normal(rng);
        if (at.directions > 0) lg_so3_exp_act(turn, x, turned), memcpy(x, turned, 3 * sizeof *x);
        if (at.rotations > 0) lg_so3_exp_multiply(turn, x, turned), memcpy(x, turned, sizeof turned);
        for (uint32_t k = 0; k < at.velocities; k++) w[k] += velocity * lg_rng_normal(rng);
        if (at.directions == 0) continue;
        const double along = lg_dot3(w, x);
        for (int k = 0; k < 3; k++) w[k] -= along * x[k];
    }
}

enum { SOME = 4, EACH = 41, POINTS = SOME * EACH };

typedef struct motion {
    size_t first[SOME + 1], start[POINTS];
    double t[POINTS], q[2][POINTS * LG_MACHINE_POSITIONS], v[2][POINTS * LG_MACHINE_VELOCITIES];
    lg_machine_log log; /* of q[1] and v[1], which have the noise; q[0] and v[0] have none */
} motion;

static motion *move(size_t kind) {
    const lg_machine machine = machine_of(kind, true);
    const size_t nq = machine.positions, nv = machine.velocities;
    motion *m = TEST_ARRAY(motion, 1);
    lg_rng rng = test_rng(3, kind);
    m->log = (lg_machine_log){POINTS, SOME, m->first, m->t, m->q[1], m->v[1], NULL, NULL, NULL, NULL};
    for (size_t row = 0; row < POINTS; row++) {
        double *q = m->q[1] + row * nq, *v = m->v[1] + row * nv;
        m->first[row / EACH] = m->start[row / EACH] = row / EACH * EACH;
        m->t[row] = DT * (double)(row % EACH);
        lg_machine_reference(&machine, q);
        for (lg_machine_offsets at = {0}; lg_machine_next(&machine, &at);)
            if (at.directions > 0) q[at.position + 2] = -1.0; /* it hangs */
        disturb(&machine, &rng, 0.7, 1.5, q, v);
    }
    m->first[SOME] = POINTS;
    assert_ok(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("rkmk5"), 8, &m->log, m->start, SOME,
                                  EACH - 1, m->q[0], m->v[0], NULL));
    return m;
}

typedef struct trial {
    const char *scheme;
    uint32_t window, stride;
    lg_machine_starts starts;
    bool positions_only;
    double position, velocity; /* noise */
} trial;

/* The loss of the fit that begins at the truth, divided by the expected loss. */
static double ratio_in(motion *m, const lg_machine *machine, const double *truth, const trial *w,
                       lg_rng rng) {
    lg_machine_noise noise = {.position = {0}};
    lg_machine_expected expected;
    double loss;
    memcpy(m->q[1], m->q[0], sizeof m->q[1]);
    memcpy(m->v[1], m->v[0], sizeof m->v[1]);
    for (size_t row = 0; row < POINTS; row++)
        disturb(machine, &rng, w->position, w->velocity, m->q[1] + row * machine->positions,
                m->v[1] + row * machine->velocities);
    for (size_t i = 0; i < POINTS * machine->velocities && w->positions_only; i++) m->v[1][i] = NAN;
    lg_machine_problem p = {.machine = machine,
                            .scheme = lg_scheme_find(w->scheme),
                            .substeps = 1,
                            .window = w->window,
                            .starts = w->starts,
                            .log = m->log,
                            .start = m->start};
    /* Scales that are not the noise. */
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        noise.position[i] = w->position, noise.velocity[i] = w->velocity;
        p.position_scale[i] = 2.0 * w->position, p.velocity_scale[i] = 3.0 * w->velocity;
    }
    p.windows = lg_machine_windows(machine, &m->log, w->window, w->stride, w->positions_only, m->start);
    double *theta = TEST_ARRAY(double, lg_machine_problem_parameters(&p));
    memcpy(theta, truth, machine->parameters * sizeof *theta);
    fit(&p, theta);
    assert_ok(lg_machine_loss(NULL, &p, theta, &loss, NULL, NULL));
    assert_ok(lg_machine_expect(NULL, &p, theta, &noise, &expected, NULL));
    return loss / (expected.loss + expected.steps);
}

/* The mean over 20 logs must be 1 to within what chance makes of it: Student's t with 19 degrees of freedom
 * exceeds 3.883 in one of 1000 cases. `bend`: what may be off as well where errors are so large that they do
 * not add up linearly. */
static void assert_expected(size_t kind, const trial *w, double bend) {
    enum { SEEDS = 20 };
    static const double student = 3.883;
    motion *m = move(kind);
    const lg_machine machine = machine_of(kind, false);
    double *truth = TEST_ARRAY(double, machine.parameters), sum = 0.0, squares = 0.0;
    for (size_t k = 0; k < machine.parameters; k++) truth[k] = sqrt(0.1);
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        const double ratio = ratio_in(m, &machine, truth, w, test_rng(seed, 10 + kind));
        sum += ratio, squares += ratio * ratio;
    }
    const double mean = sum / SEEDS, error = sqrt((squares / SEEDS - mean * mean) / (SEEDS - 1));
    (void)printf("%s, %s, window %u, stride %u, %s%s: %.4f +- %.4f\n", kinds[kind].name, w->scheme, w->window,
                 w->stride, w->starts == LG_MACHINE_STARTS_MEASURED ? "measured" : "estimated",
                 w->positions_only ? ", positions" : "", mean, error);
    if (!(fabs(mean - 1.0) < fmax(student * error, bend)))
        fail_msg("%s, %s, window %u: the loss is %.4f +- %.4f of the expected one", kinds[kind].name,
                 w->scheme, w->window, mean, error);
}

TEST("the mean loss is the expected loss for all kinds of coordinates, starts, windows and columns") {
    static const trial trials[] = {{"cf4", 6, 5, LG_MACHINE_STARTS_MEASURED, false, 2e-3, 1e-2},
                                   {"cf4", 9, 3, LG_MACHINE_STARTS_MEASURED, false, 4e-3, 5e-3},
                                   {"cf4", 11, 10, LG_MACHINE_STARTS_ESTIMATED, false, 2e-3, 1e-2},
                                   {"cf4", 20, 7, LG_MACHINE_STARTS_ESTIMATED, false, 4e-3, 5e-3},
                                   {"cf4", 21, 20, LG_MACHINE_STARTS_ESTIMATED, true, 2e-3, 1e-2}};
    for (size_t kind = 0; kind < LG_COUNT(kinds); kind++)
        for (size_t i = 0; i < LG_COUNT(trials); i++) assert_expected(kind, &trials[i], 0.0);
}

TEST("what the starts and parameters leave of the steps' own error is expected, not all of it") {
    static const trial trials[] = {{"lie-heun", 11, 10, LG_MACHINE_STARTS_ESTIMATED, false, 1e-4, 1e-3},
                                   {"lie-heun", 6, 5, LG_MACHINE_STARTS_MEASURED, false, 1e-4, 1e-3}};
    for (size_t kind = 0; kind < LG_COUNT(kinds); kind++)
        for (size_t i = 0; i < LG_COUNT(trials); i++) assert_expected(kind, &trials[i], 0.05);
}

TEST_GROUP(NULL, NULL)
