/* ctest-labels: slow src/machine
 * The loss that is expected of a model that explains its logs must be the mean loss over logs with random
 * noise. */
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

TEST_GROUP(NULL, NULL)
