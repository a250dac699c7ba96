/* ctest-labels: slow src/machine
 * Machines of named systems: their parameters are learned from trajectories of the library's systems, or of
 * equations that are written here; units; parameters that logs do not determine; refusals. */
#include "support/machine_support.h"

#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"
#include "liegrad/ops.h"

enum { PARTS = 6, ROWS = 31, ALL = PARTS * ROWS, STATE = 64, NUMBERS = 16 };

/* ---- logs ---- */

typedef struct logs {
    size_t first[PARTS + 1], start[ALL];
    double t[ALL], q[ALL * LG_MACHINE_POSITIONS], v[ALL * LG_MACHINE_VELOCITIES];
    lg_machine_log log;
} logs;

/* Converts a state of the system, or of the equations, to positions and velocities in the order of logs. */
typedef struct system_case system_case;
typedef void to_row(const lg_system *system, const double *y, double *q, double *v);

struct system_case {
    const char *system, *form; /* of the simulated system; NULL: `field` is used */
    size_t links;
    const lg_coordinate_kind *coordinates;
    size_t count;
    lg_named_values given[6]; /* the true parameters */
    double spread;            /* of the starts */
    to_row *row;
    void (*field)(const double *y, double *dy); /* for lines and angles: derivative of y = (q, v) */
    double dt;
    const char *grey;       /* name of the machine's system */
    const char *unknown[6]; /* keys, ended by NULL */
    double factor;          /* learning starts at this factor times the truth */
};

RELEASES(release_system, lg_system_destroy)

static lg_system *system_of(const system_case *c) {
    lg_system_options options;
    lg_system *system;
    lg_system_options_init(&options);
    options.form = c->form;
    options.links = c->links;
    options.parameters = c->given;
    const bool none = lg_system_parameters(c->system, c->form)->key == NULL; /* all parameters are 1 */
    while (!none && options.parameter_count < 6 && c->given[options.parameter_count].key != NULL)
        options.parameter_count++;
    assert_told(lg_system_create(NULL, c->system, &options, &system, &told));
    lg_test_owns(system, release_system);
    return system;
}

/* Applies a random group element to the identity rotation, the direction e3 and 0. */
static void draw_start(const system_case *c, const lg_space *space, lg_rng *rng, double *y) {
    double origin[STATE] = {0}, element[STATE];
    for (size_t i = 0; i < space->algebra_dim; i++) element[i] = c->spread * lg_rng_normal(rng);
    for (size_t i = 0; i < 9 && c->coordinates[0] == LG_COORDINATE_ROTATION; i += 4) origin[i] = 1;
    for (size_t i = 2; i < space->dim && c->coordinates[0] == LG_COORDINATE_DIRECTION; i += 6) origin[i] = 1;
    lg_space_act(space, element, origin, y);
}

static void run_system(const system_case *c, logs *l, size_t nq, size_t nv) {
    lg_system *system = system_of(c);
    const size_t d = lg_system_dim(system);
    double *y = TEST_ARRAY(double, PARTS *d), *out = TEST_ARRAY(double, ALL *d);
    lg_rng rng = test_rng(11, 0);
    for (size_t p = 0; p < PARTS; p++) draw_start(c, lg_system_space(system), &rng, y + p * d);
    assert_ok(lg_system_solve(NULL, system, y, PARTS, l->t, ROWS, 1e-13, 1e-14, out, NULL));
    for (size_t r = 0; r < ALL; r++) c->row(system, out + r * d, l->q + r * nq, l->v + r * nv);
}

/* The classical method of order 4, with steps so small that only rounding errors remain. */
static void advance(const system_case *c, size_t n, double *y) {
    enum { STEPS = 100 };
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    const double h = c->dt / STEPS;
    for (int step = 0; step < STEPS; step++) {
        double sum[STATE] = {0}, dy[STATE] = {0}, x[STATE];
        for (int stage = 0; stage < 4; stage++) {
            for (size_t i = 0; i < n; i++) x[i] = y[i] + h * at[stage] * dy[i];
            c->field(x, dy);
            for (size_t i = 0; i < n; i++) sum[i] += h * weight[stage] * dy[i];
        }
        for (size_t i = 0; i < n; i++) y[i] += sum[i];
    }
}

static void run_field(const system_case *c, logs *l, size_t n) {
    lg_rng rng = test_rng(12, 0);
    for (size_t p = 0; p < PARTS; p++) {
        double y[STATE];
        for (size_t i = 0; i < 2 * n; i++) y[i] = c->spread * lg_rng_normal(&rng);
        for (size_t r = 0; r < ROWS; r++) {
            memcpy(l->q + (p * ROWS + r) * n, y, n * sizeof *y);
            memcpy(l->v + (p * ROWS + r) * n, y + n, n * sizeof *y);
            advance(c, 2 * n, y);
        }
    }
}

/* Adds noise that keeps attitudes and directions on their manifolds. */
static void add_noise(const lg_machine *machine, logs *l, double noise) {
    double *q = l->q, *v = l->v;
    lg_rng rng = test_rng(13, 0);
    for (size_t r = 0; r < ALL; r++)
        for (uint32_t i = 0; i < machine->coordinate_count; i++) {
            const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
            double turn[3], turned[9];
            for (int k = 0; k < 3; k++) turn[k] = noise * lg_rng_normal(&rng);
            if (row->directions > 0) lg_so3_exp_act(turn, q, turned);
            if (row->rotations > 0) lg_so3_exp_multiply(turn, q, turned);
            for (uint32_t k = 0; k < row->places; k++) q[k] += noise * lg_rng_normal(&rng);
            if (row->places == 0) memcpy(q, turned, (row->rotations > 0 ? 9 : 3) * sizeof *q);
            for (uint32_t k = 0; k < row->velocities; k++) v[k] += noise * lg_rng_normal(&rng);
            q += lg_coordinate_positions(machine->coordinates[i].kind);
            v += row->velocities;
        }
}

static logs *make_logs(const system_case *c, const lg_machine *machine, double noise) {
    logs *l = TEST_ARRAY(logs, 1);
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, NULL, NULL, NULL, NULL};
    for (size_t r = 0; r < ALL; r++) {
        l->first[r / ROWS] = r / ROWS * ROWS;
        l->t[r] = c->dt * (double)(r % ROWS);
    }
    l->first[PARTS] = ALL;
    if (c->system != NULL)
        run_system(c, l, machine->positions, machine->velocities);
    else
        run_field(c, l, machine->positions);
    if (noise > 0) add_noise(machine, l, noise);
    return l;
}

/* ---- the systems ---- */

/* (q, p), whose momenta are the velocities for unit masses. */
static void line_row(const lg_system *system, const double *y, double *q, double *v) {
    const size_t n = lg_system_dim(system) / 2;
    memcpy(q, y, n * sizeof *q);
    memcpy(v, y + n, n * sizeof *v);
}

static void quartic_row(const lg_system *system, const double *y, double *q, double *v) {
    (void)system;
    memcpy(q, y, 2 * sizeof *q);
    v[0] = 5 * y[2] - y[3], v[1] = 5 * y[3] - y[2];
}

static const double inertia[3] = {0.3, 0.5, 0.4}, mass = 0.8, length = 0.25, chi[3] = {0.36, 0.48, 0.8},
                    gamma0[3] = {0, 0, -9.81};

/* R, then the spatial momentum R I Omega. */
static void body_row(const lg_system *system, const double *y, double *q, double *v) {
    const double *I = lg_system_parameter_values(system);
    memcpy(q, y, 9 * sizeof *q);
    lg_so3_coadjoint(y, y + 9, v);
    for (int k = 0; k < 3; k++) v[k] /= I[k];
}

static const double chain_masses[3] = {0.8, 1.1, 0.6}, chain_lengths[3] = {0.9, 0.6, 0.7};

/* q_1, omega_1, q_2, ... or q_1, p_1, ... */
static void chain_row(const lg_system *system, const double *y, double *q, double *v) {
    double state[STATE];
    memcpy(state, y, lg_system_dim(system) * sizeof *state);
    if (strcmp(lg_system_form(system), "hamiltonian") == 0)
        assert_ok(lg_chain_velocities(system, y, state, test_work(lg_system_work_size(system))));
    for (size_t i = 0; i < lg_system_links(system); i++) {
        memcpy(q + 3 * i, state + 6 * i, 3 * sizeof *q);
        memcpy(v + 3 * i, state + 6 * i + 3, 3 * sizeof *v);
    }
}

/* The textbook equations of a cart of 1.2 kg with a point mass of .3 kg at a distance of .5 m; theta is 0
 * upright. */
static void cart_field(const double *y, double *dy) {
    const double M = 1.2, m = 0.3, L = 0.5, g = 9.81, s = sin(y[1]), c = cos(y[1]);
    const double a = m * s * (L * y[3] * y[3] - g * c) / (M + m * s * s);
    dy[0] = y[2], dy[1] = y[3], dy[2] = a, dy[3] = (g * s - a * c) / L;
}

static const double arm_masses[2] = {1.5, 0.8}, arm_centres[2] = {0.3, 0.25}, arm_inertia[2] = {0.05, 0.03},
                    arm_length = 0.6, gravity = 9.81, cart = 1.2, pole = 0.3, pole_length = 0.5;

/* Spong's equations of a planar arm; the first angle is 0 straight down. */
static void arm_field(const double *y, double *dy) {
    const double *m = arm_masses, *c = arm_centres, *I = arm_inertia, L = arm_length;
    const double h = m[1] * L * c[1], C = h * cos(y[1]), S = h * sin(y[1]);
    const double M22 = I[1] + m[1] * c[1] * c[1], M12 = M22 + C,
                 M11 = I[0] + m[0] * c[0] * c[0] + M22 + m[1] * L * L + 2 * C;
    const double below = m[1] * c[1] * gravity * sin(y[0] + y[1]);
    const double f1 = S * (2 * y[2] * y[3] + y[3] * y[3]) - (m[0] * c[0] + m[1] * L) * gravity * sin(y[0]) -
                      below,
                 f2 = -S * y[2] * y[2] - below, det = M11 * M22 - M12 * M12;
    dy[0] = y[2], dy[1] = y[3];
    dy[2] = (M22 * f1 - M12 * f2) / det, dy[3] = (M11 * f2 - M12 * f1) / det;
}

static const double rotary_arm = 0.02, radius = 0.2, rotary_pole = 0.15, centre = 0.15,
                    rotary_inertia = 0.001;

/* Lagrange's equations of a Furuta pendulum, written out by hand; the second angle is 0 upright. */
static void rotary_field(const double *y, double *dy) {
    const double K = rotary_inertia + rotary_pole * centre * centre, h = rotary_pole * radius * centre;
    const double s = sin(y[1]), c = cos(y[1]), M11 = rotary_arm + rotary_pole * radius * radius + K * s * s;
    const double f1 = h * s * y[3] * y[3] - 2 * K * s * c * y[2] * y[3],
                 f2 = K * s * c * y[2] * y[2] + rotary_pole * gravity * centre * s;
    const double M12 = h * c, det = M11 * K - M12 * M12;
    dy[0] = y[2], dy[1] = y[3];
    dy[2] = (K * f1 - M12 * f2) / det, dy[3] = (M11 * f2 - M12 * f1) / det;
}

static const double one[2] = {1, 1};
static const lg_coordinate_kind lines[2] = {LG_COORDINATE_LINE, LG_COORDINATE_LINE},
                                directions[3] = {LG_COORDINATE_DIRECTION, LG_COORDINATE_DIRECTION,
                                                 LG_COORDINATE_DIRECTION},
                                body[1] = {LG_COORDINATE_ROTATION},
                                cart_and_pole[2] = {LG_COORDINATE_LINE, LG_COORDINATE_ANGLE},
                                angles[2] = {LG_COORDINATE_ANGLE, LG_COORDINATE_ANGLE};

/* Arguments: the coordinates and their number, the size of the motion, the time step of the log; the
 * machine's system, and the factor of the starting values of learned parameters. */
#define CASE(coordinates_, count_, spread_, dt_, grey_, factor_, ...)                                        \
    {                                                                                                        \
        .coordinates = coordinates_, .count = count_, .spread = spread_, .dt = dt_, .grey = grey_,           \
        .factor = factor_, __VA_ARGS__                                                                       \
    }

static const system_case cases[] = {
    CASE(lines, 1, 1, 0.1, "oscillator", 4, .system = "oscillator", .row = line_row,
         .given = {{"mass", one, 1}, {"stiffness", one, 1}}, .unknown = {"stiffness"}),
    CASE(lines, 1, 1, 0.1, "oscillator", 0.2, .system = "oscillator", .row = line_row,
         .given = {{"mass", one, 1}, {"stiffness", one, 1}}, .unknown = {"mass"}),
    CASE(lines, 2, 0.7, 0.05, "quartic", 2, .system = "quartic", .row = quartic_row,
         .given = {{"stiffness", one, 2}, {"cubic", one, 2}}, .unknown = {"stiffness", "cubic"}),
    CASE(lines, 2, 1, 0.1, "coupled-oscillators", 3, .system = "coupled-oscillators", .row = line_row,
         .given = {{"masses", one, 2}, {"stiffness", one, 2}, {"cubic", one, 1}},
         .unknown = {"stiffness", "cubic"}),
    CASE(body, 1, 1, 0.05, "heavy-top", 2, .system = "heavy-top", .form = "cotangent", .row = body_row,
         .given = {{"inertia", inertia, 3}, {"mass", &mass, 1}, {"length", &length, 1}, {"chi", chi, 3}},
         .unknown = {"length"}),
    CASE(body, 1, 1, 0.05, "heavy-top", 1.7, .system = "heavy-top", .form = "direct", .row = body_row,
         .given = {{"inertia", inertia, 3}, {"mass", &mass, 1}, {"length", &length, 1}, {"chi", chi, 3}},
         .unknown = {"inertia", "chi"}),
    CASE(body, 1, 1, 0.05, "heavy-top", 0.6, .system = "heavy-top", .form = "direct", .row = body_row,
         .given = {{"inertia", inertia, 3},
                   {"mass", &mass, 1},
                   {"length", &length, 1},
                   {"chi", chi, 3},
                   {"gamma0", gamma0, 3}},
         .unknown = {"gamma0"}),
    CASE(directions, 1, 1, 0.05, "pendulum-chain", 1.5, .system = "pendulum-chain", .form = "lagrangian",
         .links = 1, .row = chain_row,
         .given = {{"gravity", &gravity, 1}, {"masses", chain_masses, 1}, {"lengths", chain_lengths, 1}},
         .unknown = {"lengths"}),
    CASE(directions, 2, 1, 0.03, "pendulum-chain", 1.3, .system = "pendulum-chain", .form = "lagrangian",
         .links = 2, .row = chain_row,
         .given = {{"gravity", &gravity, 1}, {"masses", chain_masses, 2}, {"lengths", chain_lengths, 2}},
         .unknown = {"lengths"}),
    CASE(directions, 3, 0.7, 0.03, "pendulum-chain", 0.8, .system = "pendulum-chain", .form = "hamiltonian",
         .links = 3, .row = chain_row,
         .given = {{"gravity", &gravity, 1}, {"masses", chain_masses, 3}, {"lengths", chain_lengths, 3}},
         .unknown = {"lengths"}),
    CASE(cart_and_pole, 2, 1, 0.05, "cart-pole", 2, .field = cart_field,
         .given =
             {{"cart", &cart, 1}, {"pole", &pole, 1}, {"length", &pole_length, 1}, {"gravity", &gravity, 1}},
         .unknown = {"pole", "length", "gravity"}),
    CASE(angles, 2, 0.7, 0.02, "rotary-pendulum", 1.5, .field = rotary_field,
         .given = {{"arm", &rotary_arm, 1},
                   {"radius", &radius, 1},
                   {"pole", &rotary_pole, 1},
                   {"centre", &centre, 1},
                   {"inertia", &rotary_inertia, 1},
                   {"gravity", &gravity, 1}},
         .unknown = {"arm", "inertia"}),
    CASE(angles, 2, 0.7, 0.02, "two-link-arm", 1.5, .field = arm_field,
         .given = {{"masses", arm_masses, 2},
                   {"centres", arm_centres, 2},
                   {"inertia", arm_inertia, 2},
                   {"length", &arm_length, 1},
                   {"gravity", &gravity, 1}},
         .unknown = {"centres", "gravity"}),
};

/* ---- machines ---- */

static const lg_named_values *given_for(const system_case *c, const char *key) {
    for (int i = 0; i < 6 && c->given[i].key != NULL; i++)
        if (strcmp(c->given[i].key, key) == 0) return &c->given[i];
    return NULL;
}

static void set_parameter(lg_machine *machine, const char *key, size_t count, const double *values,
                          bool unknown) {
    bool each[LG_MACHINE_PARAMETERS];
    for (int i = 0; i < LG_MACHINE_PARAMETERS; i++) each[i] = unknown;
    assert_told(lg_machine_set_parameter(machine, key, count, values, each, &told));
}

static void set_system(lg_machine *machine, const char *name) {
    assert_told(lg_machine_set_system(machine, name, &told));
}

/* The machine with true parameters. With `unknown`, the keys that are learned get other starting values. */
static lg_machine machine_of(const system_case *c, bool unknown) {
    lg_machine machine = empty_machine();
    for (size_t i = 0; i < c->count; i++) {
        const char name[] = {(char)('a' + i), '\0'};
        add_coordinate(&machine, name, c->coordinates[i]);
    }
    set_system(&machine, c->grey);
    for (int i = 0; i < 6 && c->given[i].key != NULL; i++)
        set_parameter(&machine, c->given[i].key, c->given[i].count, c->given[i].values, false);
    for (int i = 0; unknown && i < 6 && c->unknown[i] != NULL; i++) {
        const lg_named_values *truth = given_for(c, c->unknown[i]);
        double start[LG_MACHINE_PARAMETERS];
        for (size_t k = 0; k < truth->count; k++) start[k] = truth->values[k] * c->factor;
        if (truth->values == chi) start[0] = 0.6, start[1] = 0, start[2] = -0.8; /* an error of 115 degrees */
        set_parameter(&machine, c->unknown[i], truth->count, start, true);
    }
    assert_machine(&machine);
    return machine;
}

/* ---- learning ---- */

typedef struct task {
    lg_machine machine;
    lg_machine_problem problem;
    size_t start[ALL];
    double *theta;
    lg_identified numbers[NUMBERS];
    double correlations[NUMBERS * NUMBERS], open[NUMBERS * NUMBERS];
    lg_identification found;
    size_t count;
    double loss;
} task;

static task *make_task(const lg_machine *machine, const logs *l, bool noisy) {
    enum { NOISY = 6, EXACT = 3 };
    task *t = TEST_ARRAY(task, 1);
    t->machine = *machine;
    assert_ok(lg_machine_find_scales(&t->machine, &l->log, NULL));
    t->problem =
        (lg_machine_problem){.machine = &t->machine,
                             .scheme = lg_scheme_find("rkmk5"),
                             .substeps = noisy ? 2 : 4,
                             .window = noisy ? NOISY : EXACT,
                             .starts = noisy ? LG_MACHINE_STARTS_ESTIMATED : LG_MACHINE_STARTS_MEASURED,
                             .log = l->log,
                             .start = t->start};
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        t->problem.position_scale[i] = t->problem.velocity_scale[i] = t->machine.scales.velocity[0];
    t->problem.windows =
        lg_machine_windows(&t->machine, &l->log, t->problem.window, t->problem.window - 1, false, t->start);
    assert_told(lg_machine_problem_check(&t->problem, &told));
    t->theta = TEST_ARRAY(double, lg_machine_problem_parameters(&t->problem));
    lg_rng rng = test_rng(1, 0);
    lg_machine_initialise(&t->machine, &rng, t->theta);
    return t;
}

static task *learn(const lg_machine *machine, const logs *l, bool noisy) {
    task *t = make_task(machine, l, noisy);
    lg_fit_problem problem;
    double floor;
    lg_machine_fit_problem(&t->problem, &problem);
    fit_by_lm(&problem, 100, t->theta);
    assert_ok(lg_machine_loss(NULL, &t->problem, t->theta, &t->loss, &floor, NULL));
    t->count = lg_machine_numbers(&t->machine, t->theta, NUMBERS, t->numbers);
    assert_true(t->count <= NUMBERS);
    t->found = (lg_identification){.numbers = t->numbers, .correlations = t->correlations, .open = t->open};
    assert_ok(lg_machine_identify(NULL, &t->problem, t->theta, &t->found, NULL));
    return t;
}

/* The true numbers in the order of the learned ones. */
static size_t truth_of(const system_case *c, const lg_machine *machine, double *out) {
    const lg_machine exact = machine_of(c, false);
    size_t count = 0;
    for (uint32_t i = 0; i < machine->grey.count; i++)
        if (machine->grey.unknown[i]) out[count++] = exact.grey.start[i];
    return count;
}

static const lg_identified *number_of(const task *t, const char *name) {
    for (size_t i = 0; i < t->count; i++)
        if (strcmp(t->numbers[i].name, name) == 0) return &t->numbers[i];
    fail_msg("no number %s", name);
    return NULL;
}

TEST("exact trajectories of every system give its parameters, from distant starting values") {
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const size_t mark = lg_test_owned();
        const lg_machine machine = machine_of(&cases[i], true);
        double truth[NUMBERS], worst = 0;
        const task *t = learn(&machine, make_logs(&cases[i], &machine, 0), false);
        assert_int_equal(truth_of(&cases[i], &machine, truth), t->count);
        for (size_t k = 0; k < t->count; k++)
            worst = fmax(worst, fabs(t->numbers[k].value - truth[k]) / fmax(fabs(truth[k]), 0.1));
        print_message("%s: loss %.1e, largest relative error %.1e\n", cases[i].grey, t->loss, worst);
        for (size_t k = 0; k < t->count; k++) assert_close(t->numbers[k].value, truth[k], 1e-6, 1e-7);
        lg_test_give_back(mark);
    }
}

TEST("noisy trajectories give the parameters within four of the stated standard errors") {
    double most = 0;
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const size_t mark = lg_test_owned();
        const lg_machine machine = machine_of(&cases[i], true);
        double truth[NUMBERS];
        const task *t = learn(&machine, make_logs(&cases[i], &machine, 1e-3), true);
        (void)truth_of(&cases[i], &machine, truth);
        for (size_t k = 0; k < t->count; k++) {
            const double off = (t->numbers[k].value - truth[k]) / t->numbers[k].error;
            print_message("%s %s: %.6g of %.6g, %.2f standard errors\n", cases[i].grey, t->numbers[k].name,
                          t->numbers[k].value, truth[k], off);
            if (!(fabs(off) < 4)) fail_msg("%s: %s", cases[i].grey, t->numbers[k].name);
            assert_true(t->numbers[k].error < 0.2 * fmax(fabs(truth[k]), 1));
            most = fmax(most, fabs(off));
        }
        lg_test_give_back(mark);
    }
    assert_true(most > 0.25); /* so the standard errors are not too large */
}

/* ---- units ---- */

/* m x'' = -k x - d x', from x(0) = a at rest. */
static void fill_decaying(logs *l, double m, double k, double d, double dt) {
    const double decay = d / (2 * m), rate = sqrt(k / m - decay * decay);
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, NULL, NULL, NULL, NULL};
    for (size_t r = 0; r < ALL; r++) {
        const double t = dt * (double)(r % ROWS), a = 1e-3 * (1.0 + 0.3 * (double)(r / ROWS));
        const double falling = a * exp(-decay * t), c = cos(rate * t), s = sin(rate * t);
        l->first[r / ROWS] = r / ROWS * ROWS;
        l->t[r] = t;
        l->q[r] = falling * (c + decay / rate * s);
        l->v[r] = -falling * (decay * decay / rate + rate) * s;
    }
    l->first[PARTS] = ALL;
}

TEST("for an oscillator of 5 mg in millimetres, spring and damping or mass and damping are found in the "
     "log's units") {
    static const struct {
        const char *known, *unknown, *label;
        double given, start, truth;
    } rows[] = {{"mass", "stiffness", "k", 5e-6, 6e-3, 2e-3}, {"stiffness", "mass", "m", 2e-3, 2e-6, 5e-6}};
    logs *l = TEST_ARRAY(logs, 1);
    fill_decaying(l, 5e-6, 2e-3, 1e-5, 0.02);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_machine machine = empty_machine();
        add_coordinate(&machine, "x", LG_COORDINATE_LINE);
        set_system(&machine, "oscillator");
        set_parameter(&machine, rows[i].known, 1, &rows[i].given, false);
        set_parameter(&machine, rows[i].unknown, 1, &rows[i].start, true);
        add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
        assert_machine(&machine);
        const task *t = learn(&machine, l, false);
        assert_true(t->machine.scales.energy < 1e-6);
        assert_close(number_of(t, rows[i].label)->value, rows[i].truth, 1e-6, 0);
        assert_close(number_of(t, "damping.x")->value, 1e-5, 1e-6, 0);
        assert_int_equal(t->found.open_count, 0);
    }
}

/* ---- every system ---- */

static void fill_coordinates(lg_machine *machine, const lg_energy_row *system) {
    const uint32_t wanted = system->count, count = wanted > 0 ? wanted : 3;
    for (uint32_t i = 0; i < count; i++) {
        const char name[] = {(char)('a' + i), '\0'};
        add_coordinate(machine, name, system->coordinates[wanted > 0 ? i : 0]);
    }
    add_input(machine, "u");
    odd_scales(machine);
}

/* A machine of the system with all parameters unknown, moved off their starting values by theta, and with
 * damping. */
static lg_machine unknown_machine(const lg_energy_row *system) {
    lg_machine machine = empty_machine();
    fill_coordinates(&machine, system);
    set_system(&machine, system->name);
    for (const lg_parameter_entry *p = system->parameters; p->key != NULL; p++) {
        if (p->fallback != NULL || p->rule == LG_PARAMETER_POSITIVE)
            set_parameter(&machine, p->key, 0, NULL, true);
        else
            set_parameter(&machine, p->key, p->count, &gravity, true);
    }
    add_term(&machine, LG_MACHINE_DAMPING, "constant");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

enum { FEW = 3, MOST = FEW * (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES) };

TEST("positions and velocities are recovered from the state, and energy changes by the power of the "
     "forces") {
    const lg_energy_row *system;
    for (size_t i = 0; (system = lg_grey_system_at(i)) != NULL; i++) {
        const lg_machine machine = unknown_machine(system);
        double q[MOST], v[MOST], u[FEW], expected[FEW];
        lg_tape *tape = test_tape(LG_F64);
        lg_machine_vars vars;
        lg_space space;
        lg_var parts[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS], rate[LG_TAPED_MAX_PARTS], change;
        const lg_var theta =
            lg_parameter(tape, lg_shape1((uint32_t)machine.parameters), machine_theta(&machine, 5));
        assert_ok(lg_machine_bind(tape, &machine, theta, &vars));
        assert_ok(lg_machine_space(&machine, &space));
        random_rows(&machine, 7, FEW, q, v);
        memcpy(u, test_numbers(3, FEW, -1, 1), sizeof u);
        const lg_var positions = lg_input_f64(tape, lg_shape2(FEW, machine.positions), q),
                     velocities = lg_input_f64(tape, lg_shape2(FEW, machine.velocities), v),
                     input = lg_input_f64(tape, lg_shape2(FEW, 1), u);
        assert_ok(lg_machine_record_state(tape, &vars, positions, velocities, parts));
        for (size_t k = 0; k < lg_taped_parts(&space); k++) parts[k] = lg_stop_gradient(tape, parts[k]);
        assert_reads(tape, lg_machine_record_positions(tape, &vars, parts), FEW * machine.positions, q, 1e-13,
                     1e-13);
        const lg_var again = lg_machine_record_velocities(tape, &vars, parts);
        assert_reads(tape, again, FEW * machine.velocities, v, 1e-10, 1e-10);
        assert_ok(lg_machine_record_field(tape, &vars, parts, input, algebra));
        assert_ok(lg_taped_generator(tape, &space, algebra, parts, rate));
        const lg_var H = lg_machine_record_energy(tape, &vars, parts);
        assert_ok(lg_jvp(tape, &H, 1, parts, rate, lg_taped_parts(&space), &change));
        const lg_var f =
            lg_add(tape, lg_machine_record_force(tape, &vars, LG_MACHINE_DAMPING, parts, again, input),
                   lg_machine_record_force(tape, &vars, LG_MACHINE_INPUT_MAP, parts, again, input));
        assert_ok(lg_read(tape, lg_rowdot(tape, again, f), FEW, expected));
        assert_true(fabs(expected[0]) > 1e-3);
        assert_reads(tape, change, FEW, expected, 1e-10, 1e-10);
    }
}

/* ---- parameters that logs do not determine ---- */

static void assert_open(const task *t, const char *sentence) {
    char text[512];
    for (size_t k = 0; k < t->found.open_count; k++) {
        (void)lg_identification_sentence(&t->found, t->count, k, text, sizeof text);
        if (strstr(text, sentence) != NULL) return;
    }
    for (size_t k = 0; k < t->found.open_count; k++) {
        (void)lg_identification_sentence(&t->found, t->count, k, text, sizeof text);
        print_message("%s\n", text);
    }
    fail_msg("nothing says: %s", sentence);
}

static const system_case *case_of(const char *grey) {
    size_t i = 0;
    while (strcmp(cases[i].grey, grey) != 0) i++;
    return &cases[i];
}

TEST("mass and length of a top appear only as a product; all numbers but one are determined only up to a "
     "factor") {
    const double noises[] = {0, 1e-3};
    for (size_t i = 0; i < LG_COUNT(noises); i++) {
        lg_machine machine = machine_of(case_of("heavy-top"), true);
        set_parameter(&machine, "mass", 1, &mass, true);
        assert_machine(&machine);
        const logs *l = make_logs(case_of("heavy-top"), &machine, noises[i]);
        const task *t = learn(&machine, l, noises[i] > 0);
        assert_int_equal(t->found.open_count, 1);
        assert_open(t, "m and L appear only as a product: give one of them as known");
        assert_close(number_of(t, "m")->value * number_of(t, "L")->value, mass * length, 1e-3, 0);
        assert_true(isinf(number_of(t, "m")->error) && isinf(number_of(t, "L")->error));
        set_parameter(&machine, "inertia", 3, inertia, true);
        assert_machine(&machine);
        t = learn(&machine, l, noises[i] > 0);
        assert_int_equal(t->found.open_count, 2);
        assert_open(t, "m and L appear only as a product");
        assert_open(t, "I1, I2, I3 and");
        assert_open(t, "are determined only up to a common factor: give one of them as known");
    }
}

TEST("an arm without inputs shows masses and inertias only up to a factor") {
    lg_machine machine = machine_of(case_of("two-link-arm"), false);
    set_parameter(&machine, "masses", 2, arm_masses, true);
    set_parameter(&machine, "inertia", 2, arm_inertia, true);
    assert_machine(&machine);
    const task *t = learn(&machine, make_logs(case_of("two-link-arm"), &machine, 0), false);
    assert_int_equal(t->found.open_count, 1);
    assert_open(t, "m1, m2, I1 and I2 are determined only up to a common factor: give one of them as known");
}

TEST("a number that went to 0 has an infinite error and is listed alone, the others keep their errors") {
    static const double far[] = {-60.0, -700.0, -745.0, -800.0, -1e9};
    const system_case *c = case_of("two-link-arm");
    lg_machine machine = machine_of(c, false);
    const double little[2] = {1e-9 * arm_inertia[0], arm_inertia[1]}; /* M consists mostly of the masses */
    set_parameter(&machine, "inertia", 2, little, true);
    assert_machine(&machine);
    task *t = learn(&machine, make_logs(c, &machine, 1e-3), true);
    const size_t at = machine.terms[0].offset;
    for (size_t i = 0; i < LG_COUNT(far); i++) {
        t->theta[at] = far[i];
        assert_ok(lg_machine_identify(NULL, &t->problem, t->theta, &t->found, NULL));
        assert_string_equal(t->numbers[0].name, "I1");
        assert_true(t->numbers[0].value < 1e-20 && isinf(t->numbers[0].error));
        assert_true(isfinite(number_of(t, "I2")->error) && number_of(t, "I2")->error > 0.0);
        for (size_t k = 1; k < t->count; k++)
            assert_true(t->correlations[k] == 0.0 && t->correlations[k * t->count] == 0.0);
        assert_int_equal(t->found.open_count, 1);
        for (size_t k = 0; k < t->count; k++) assert_int_equal(t->open[k] != 0.0, k == 0);
    }
}

TEST("a free body shows only ratios of its moments of inertia; if one is given, the others follow") {
    lg_machine machine = empty_machine();
    const system_case free_body = {.system = "rigid-body-attitude",
                                   .coordinates = body,
                                   .count = 1,
                                   .spread = 1,
                                   .given = {{"inertia", inertia, 3}},
                                   .row = body_row,
                                   .dt = 0.1,
                                   .grey = "rigid-body-attitude"};
    machine = machine_of(&free_body, true);
    const logs *l = make_logs(&free_body, &machine, 0);
    const double start[3] = {inertia[0], 1.3, 0.9};
    set_parameter(&machine, "inertia", 3, start, true);
    assert_machine(&machine);
    const task *t = learn(&machine, l, false);
    assert_int_equal(t->found.open_count, 1);
    assert_open(t, "I1, I2 and I3 are determined only up to a common factor");
    const bool unknown[3] = {false, true, true};
    assert_ok(lg_machine_set_parameter(&machine, "inertia", 3, start, unknown, NULL));
    assert_machine(&machine);
    t = learn(&machine, l, false);
    assert_int_equal(t->found.open_count, 0);
    assert_int_equal(t->count, 2);
    assert_close(number_of(t, "I2")->value, inertia[1], 1e-6, 0);
    assert_close(number_of(t, "I3")->value, inertia[2], 1e-6, 0);
}

TEST("correlations are those of the errors: 1 on the diagonal, symmetric, large where numbers compensate "
     "each other") {
    const system_case *c = case_of("cart-pole");
    const lg_machine machine = machine_of(c, true);
    const task *t = learn(&machine, make_logs(c, &machine, 1e-3), true);
    for (size_t i = 0; i < t->count; i++)
        for (size_t j = 0; j < t->count; j++) {
            const double r = t->correlations[i * t->count + j];
            assert_close(r, t->correlations[j * t->count + i], 0, 1e-12);
            assert_true(i == j ? r == 1 : fabs(r) <= 1 + 1e-12);
        }
    /* theta'' = g/L sin(theta) - ...: a change of gravity can be compensated by length. */
    assert_true(t->correlations[1 * t->count + 2] > 0.9);
}

TEST("a chain without inputs shows ratios of its masses, and with unknown gravity ratios of its lengths") {
    const system_case *c = case_of("pendulum-chain") + 1;
    const bool second[2] = {false, true};
    const double start[2] = {chain_masses[0], 2};
    lg_machine machine = machine_of(c, true);
    const logs *l = make_logs(c, &machine, 0);
    assert_ok(lg_machine_set_parameter(&machine, "masses", 2, start, second, NULL));
    assert_machine(&machine);
    const task *t = learn(&machine, l, false);
    assert_int_equal(t->found.open_count, 0);
    assert_close(number_of(t, "m2")->value, chain_masses[1], 1e-6, 0);
    assert_close(number_of(t, "L1")->value, chain_lengths[0], 1e-6, 0);
    set_parameter(&machine, "masses", 2, start, true);
    set_parameter(&machine, "gravity", 1, &gravity, true);
    assert_machine(&machine);
    t = learn(&machine, l, false);
    assert_int_equal(t->found.open_count, 2);
    assert_open(t, "m1 and m2 appear only as a ratio: give one of them as known");
    assert_open(t, "g, L1 and L2 are determined only up to a common factor: give one of them as known");
}

/* ---- learned terms in addition to a system ---- */

TEST("terms in addition to the system are learned with it: a spring at the cart and damping") {
    const double unit[4] = {1, 0}, friction[2] = {0.4, 0.05}, spring = 1.5;
    lg_machine known = machine_of(case_of("cart-pole"), false);
    add_input(&known, "u");
    lg_machine_term *V = add_term(&known, LG_MACHINE_POTENTIAL, "quadratic");
    add_feature(V, LG_FEATURE_POSITION, 0);
    add_values(V, 1, &spring);
    add_values(add_term(&known, LG_MACHINE_DAMPING, "known"), 2, friction);
    add_values(add_term(&known, LG_MACHINE_INPUT_MAP, "known"), 2, unit);
    assert_machine(&known);
    assert_int_equal(known.parameters, 0);
    logs *l = TEST_ARRAY(logs, 1);
    double *u = TEST_ARRAY(double, ALL * 4), *q = TEST_ARRAY(double, ALL * 2),
           *v = TEST_ARRAY(double, ALL * 2);
    memcpy(l->q, test_numbers(1, ALL * 2, -1, 1), ALL * 2 * sizeof *q);
    memcpy(l->v, test_numbers(2, ALL * 2, -1, 1), ALL * 2 * sizeof *v);
    for (size_t r = 0; r < ALL; r++) {
        l->first[r / ROWS] = l->start[r / ROWS] = r / ROWS * ROWS;
        l->t[r] = 0.05 * (double)(r % ROWS);
        u[4 * r] = 3 * sin(0.7 * (double)r);
    }
    l->first[PARTS] = ALL;
    l->log = (lg_machine_log){ALL, PARTS, l->first, l->t, l->q, l->v, u, NULL, NULL, NULL};
    assert_ok(lg_machine_free_run(NULL, &known, NULL, lg_scheme_find("rkmk5"), 32, &l->log, l->start, PARTS,
                                  ROWS - 1, q, v, NULL));
    memcpy(l->q, q, ALL * 2 * sizeof *q);
    memcpy(l->v, v, ALL * 2 * sizeof *v);
    lg_machine machine = machine_of(case_of("cart-pole"), false);
    set_parameter(&machine, "cart", 1, one, true);
    set_parameter(&machine, "pole", 1, one, true);
    add_input(&machine, "u");
    add_feature(add_term(&machine, LG_MACHINE_POTENTIAL, "quadratic"), LG_FEATURE_POSITION, 0);
    add_term(&machine, LG_MACHINE_DAMPING, "diagonal");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, unit);
    assert_machine(&machine);
    const task *t = learn(&machine, l, false);
    static const struct {
        const char *name;
        double truth;
    } truths[] = {
        {"m_c", 1.2}, {"m_p", 0.3}, {"potential.a^2", 1.5}, {"damping.a", 0.4}, {"damping.b", 0.05}};
    assert_int_equal(t->count, LG_COUNT(truths));
    for (size_t i = 0; i < LG_COUNT(truths); i++)
        assert_close(number_of(t, truths[i].name)->value, truths[i].truth, 1e-6, 0);
}

/* ---- what is refused ---- */

static void refuse_system(const lg_coordinate_kind *kinds, size_t count, const char *name,
                          const char *sentence) {
    lg_error error = {LG_OK, ""};
    lg_machine machine = empty_machine();
    for (size_t i = 0; i < count; i++) {
        const char text[] = {(char)('a' + i), '\0'};
        add_coordinate(&machine, text, kinds[i]);
    }
    assert_true(lg_machine_set_system(&machine, name, &error) != LG_OK);
    assert_says(error.message, sentence);
    assert_int_equal(machine.term_count, 0);
}

TEST("systems that are not machines, and coordinates that do not belong to the system, are refused") {
    refuse_system(body, 1, "rigid-body", "rigid-body-attitude");
    refuse_system(body, 1, "quadrotors", "control law");
    refuse_system(body, 1, "pendulum",
                  "there is no machine for system \"pendulum\"; the systems are: oscillator");
    refuse_system(lines, 1, "heavy-top", "heavy-top: the coordinates must be of kind rotation");
    refuse_system(lines, 2, "oscillator", "oscillator: the coordinates must be of kind line");
    refuse_system(angles, 2, "cart-pole", "the coordinates must be of kind line, angle, in this order");
}

TEST("parameters that do not fit are refused, and the machine stays unchanged") {
    static const struct {
        const char *key;
        size_t count;
        double values[3];
        bool unknown[3];
        const char *sentence;
    } rows[] = {
        {"masse", 1, {1}, {false}, "heavy-top has no parameter \"masse\"; its parameters are inertia, mass"},
        {"inertia", 2, {1, 1}, {false}, "inertia: 2 numbers are given, 3 are expected"},
        {"mass", 2, {1, 1}, {false}, "mass: 2 numbers are given, 1 is expected"},
        {"mass", 1, {-1}, {true}, "mass = -1 is not a positive number"},
        {"chi", 3, {1, 1, 0}, {false}, "chi has length 1.41421"},
        {"chi",
         3,
         {1, 0, 0},
         {true, false, false},
         "chi: either all numbers of a direction are unknown, or none"},
    };
    lg_machine machine = machine_of(case_of("heavy-top"), true);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        const lg_machine_grey before = machine.grey;
        assert_status(lg_machine_set_parameter(&machine, rows[i].key, rows[i].count, rows[i].values,
                                               rows[i].unknown, &error),
                      LG_INVALID_ARGUMENT);
        assert_says(error.message, rows[i].sentence);
        assert_memory_equal(&machine.grey, &before, sizeof before);
    }
    lg_error error = {LG_OK, ""};
    assert_status(lg_machine_set_system(&machine, "heavy-top", &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "already has a system");
}

TEST("if everything is known there is nothing to learn, which is reported") {
    lg_error error = {LG_OK, ""};
    const lg_machine machine = machine_of(case_of("heavy-top"), false);
    const logs *l = make_logs(case_of("heavy-top"), &machine, 0);
    lg_machine_problem problem = {.machine = &machine,
                                  .scheme = lg_scheme_find("cf4"),
                                  .substeps = 1,
                                  .window = 2,
                                  .log = l->log,
                                  .start = l->first,
                                  .windows = PARTS,
                                  .position_scale = {1},
                                  .velocity_scale = {1}};
    assert_int_equal(machine.parameters, 0);
    assert_status(lg_machine_problem_check(&problem, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "everything is known");
}
