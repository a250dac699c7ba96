/* lg-identify fit --suggest on simulated machines. Each machine has one kind of term that its file lacks. For
 * 18 of 20 machines, the first term that the command names must be this term.
 * ctest-labels: study apps/lg-identify src/machine */
#include "identify_support.h"

/* m x'' = -k x - b x' - (friction and spring) + (actuator of u) + offset: numbers of the machine `kind`. */
typedef struct plant {
    const char *kind, *part, *term; /* the candidate's name; its part and kind in the table of terms */
    double m, k, b, more[2], width;
} plant;

static const plant kinds[] = {
    {.kind = "offset", .part = "offset", .term = "unknown"},
    {.kind = "coulomb", .part = "damping", .term = "coulomb"},
    {.kind = "asymmetric", .part = "damping", .term = "asymmetric"},
    {.kind = "quadratic", .part = "damping", .term = "quadratic"},
    {.kind = "cubic", .part = "damping", .term = "cubic"},
    {.kind = "stribeck", .part = "damping", .term = "stribeck"},
    {.kind = "lag", .part = "actuator", .term = "lag"},
    {.kind = "dead zone", .part = "actuator", .term = "dead_zone"},
    {.kind = "curve", .part = "actuator", .term = "curve"},
    {.kind = "delay 2"},
    {.kind = "cubic spring of x", .part = "potential", .term = "polynomial"},
    {.kind = "second-order lag", .part = "actuator", .term = "second_order_lag"},
};

static bool is_here(const plant *p) {
    for (int part = 0; p->part != NULL && part < LG_MACHINE_PART_COUNT; part++)
        if (strcmp(lg_machine_part_name((lg_machine_part)part), p->part) == 0)
            return lg_term_kind_find((lg_machine_part)part, p->term) != NULL;
    return p->part == NULL;
}

static bool is(const plant *p, const char *kind) {
    return strcmp(p->kind, kind) == 0;
}

static double friction(const plant *p, double v) {
    const double sign = tanh(v / p->width), a = p->more[0];
    if (is(p, "coulomb")) return a * sign;
    if (is(p, "asymmetric")) return p->b * a * fabs(v);
    if (is(p, "quadratic")) return a * fabs(v) * v;
    if (is(p, "cubic")) return a * v * v * v;
    if (is(p, "stribeck")) return a * (1 + 1.5 * exp(-v * v / 0.02)) * sign;
    return 0;
}

static double actuator(const plant *p, double u, const double *lagged) {
    const double a = p->more[0];
    if (is(p, "lag")) return lagged[0];
    if (is(p, "second-order lag")) return lagged[1];
    if (is(p, "dead zone")) return copysign(fmax(fabs(u) - a, 0), u);
    if (is(p, "curve")) return u + 0.5 * a * u * u;
    return is(p, "offset") ? u + a : u;
}

static const double interval = 0.02;

static double input_at(double t, double phase) {
    return 1.5 * sin(1.1 * t + phase) + 1.2 * sin(2.9 * t + 1) + 0.8 * sin(6.3 * t + 2 * phase) +
           0.5 * sin(17 * t);
}

static void write_log(const plant *p, double phase, lg_rng *rng) {
    enum { ROWS = 2500, STEPS = 400 };
    const double h = interval / STEPS, noise = 1e-3;
    double x = 0.3, v = 0, lagged[2] = {0, 0};
    FILE *file = fopen(cli_at("log.csv"), "w");
    assert_non_null(file);
    (void)fprintf(file, "t,x,vx,u\n");
    for (int k = 0; k < ROWS; k++) {
        const double u = input_at((k - 2 * is(p, "delay 2")) * interval, phase);
        (void)fprintf(file, "%.9g,%.9g,%.9g,%.17g\n", k * interval, x + noise * lg_rng_normal(rng),
                      v + 2 * noise * lg_rng_normal(rng), input_at(k * interval, phase));
        for (int i = 0; i < STEPS; i++) {
            lagged[1] += h / (0.3 * p->more[0]) * (lagged[0] - lagged[1]);
            lagged[0] += h / (0.3 * p->more[0]) * (u - lagged[0]);
            const double spring = p->k * x + is(p, "cubic spring of x") * 3 * p->more[0] * x * x * x;
            v += h / p->m * (actuator(p, u, lagged) - spring - p->b * v - friction(p, v));
            x += h * v;
        }
    }
    assert_int_equal(fclose(file), 0);
}

/* A machine's file without the kind; stribeck friction is Coulomb friction to it. */
static void write_machine(const plant *p) {
    cli_write("machine.yaml",
              test_text("columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                        "inputs: {columns: [u], hold: zero}\nmass: diagonal\n"
                        "potential: {kind: quadratic, of: x}\ndamping: {kind: diagonal%s}\n"
                        "input_map: {kind: known, values: [[1]]}\n",
                        is(p, "stribeck") ? ", coulomb: true" : ""));
}

static bool names(const plant *kind, int round) {
    lg_rng rng = test_rng(36, (uint64_t)round);
    plant p = *kind;
    p.m = lg_rng_uniform_in(&rng, 0.5, 2);
    p.k = lg_rng_uniform_in(&rng, 1, 6);
    p.b = lg_rng_uniform_in(&rng, 0.2, 0.8);
    p.more[0] = lg_rng_uniform_in(&rng, 0.2, 0.6);
    p.width = 1e-3;
    write_log(&p, lg_rng_uniform_in(&rng, 0, 6), &rng);
    write_machine(&p);
    cli_json(identify, "fit machine.yaml log.csv --out m.h5 --suggest -", "loss *");
    const char *list = json_find(result.out, "suggested"), *wanted = test_text("[\"%s\"", p.kind);
    const bool good = list != NULL && strncmp(list, wanted, strlen(wanted)) == 0;
    print_message("%s: %.*s\n", p.kind, list != NULL ? (int)strcspn(list, "]") + 1 : 0, list);
    return good;
}

TEST("--suggest names the unknown kind of term for 18 of 20 machines") {
    enum { MACHINES = 20 };
    int good = 0, tried = 0;
    for (size_t i = 0; tried < MACHINES; i++) {
        const plant *kind = &kinds[i % LG_COUNT(kinds)];
        const size_t mark = lg_test_owned();
        if (!is_here(kind)) continue;
        good += names(kind, tried++);
        lg_test_give_back(mark);
    }
    print_message("%d of %d\n", good, MACHINES);
    assert_true(good >= 18);
}

/* Appends one run of a drive: u - b v - c tanh(v/.3) + d |v| - f, with a torque ripple that is forgotten
 * after 20 ms, an encoder of 10000 counts and rounded velocities. */
static void write_drive(FILE *file, int run, bool asymmetric, const double *levels, lg_rng *rng) {
    enum { ROWS = 1000, STEPS = 20 };
    const double count = 2 * 3.14159265358979 / 10000, step = 0.628, h = interval / STEPS;
    double x = 0, v = 0, ripple = 0;
    for (int k = 0; k < ROWS; k++) {
        const double u = levels[k >= ROWS / 2];
        (void)fprintf(file, "%.9g,%d,%.9g,%.9g,%.9g\n", k * interval, run, round(x / count) * count,
                      round(v / step) * step, u);
        for (int i = 0; i < STEPS; i++) {
            ripple += -h / 0.02 * ripple + 1.9e-4 * lg_rng_normal(rng);
            const double own = asymmetric ? 0.0197 * tanh(v / 0.3) - 3.9e-5 * fabs(v) + 0.0159 : 0;
            v += h * (u - 1.37e-4 * v - own + ripple) / 1.58e-4;
            x += h * v;
        }
    }
}

TEST("of a drive whose friction differs by direction the true term is taken, not a network; a viscous drive "
     "asks "
     "for none") {
    static const double levels[][2] = {{0.05, 0.065}, {-0.03, -0.045}};
    static const double truth[] = {1.58e-4, 1.37e-4, 0.0197, -3.9e-5, -0.0159};
    static const char *const numbers[] = {"mass.1.1", "damping.x", "coulomb.x", "asymmetric.x", "offset.x"};
    for (uint64_t seed = 0; seed < 3; seed++) {
        lg_rng rng = test_rng(37, seed);
        const bool asymmetric = seed < 2;
        FILE *file = fopen(cli_at("drive.csv"), "w");
        assert_non_null(file);
        (void)fprintf(file, "t,run,x,vx,u\n");
        for (int run = 0; run < 2; run++) write_drive(file, run, asymmetric, levels[run], &rng);
        assert_int_equal(fclose(file), 0);
        cli_write("drive.yaml",
                  test_text("columns: {time: t, run: run}\ncoordinates:\n"
                            "  - {name: x, kind: line, velocity: vx}\ninputs: {columns: [u]}\n"
                            "mass: diagonal\ndamping: %s\ninput_map: {kind: known, values: [[1]]}\n",
                            asymmetric ? "[diagonal, coulomb]" : "diagonal"));
        cli_json(identify, "fit drive.yaml drive.csv --out m.h5 --suggest -", "loss *");
        assert_non_null(
            strstr(result.out, asymmetric ? "\"suggested\": [\"asymmetric\"]" : "\"suggested\": []"));
        for (size_t i = 0; i < LG_COUNT(numbers) && asymmetric; i++)
            assert_close(json_number(json_find(json_find(result.out, "identified"), numbers[i]), "value"),
                         truth[i], 0.03, 0);
        const bool explained = strstr(result.err, "does not explain the logs: ") == NULL;
        assert_int_equal(strstr(result.err, "asks for no further term") != NULL, explained);
    }
}

static int setup(void **state) {
    (void)state;
    return cli_begin();
}

TEST_GROUP(setup, cli_end)
