/* Computes the main results of lg-hamiltonian (in LG_BIN_DIR) a second time: E1 and E2 of `evaluate`; starts,
 * noise and energies of `generate`; medians and geometric means of `study`.
 * ctest-labels: apps/lg-hamiltonian src/hamiltonian */
#include "support/models.h"
#include "cli_files.h"

#include "liegrad/integrators.h"
#include "hamiltonian/internal.h"

static const char lg[] = "lg-hamiltonian";

static const char chain1[] = "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n";
static const char chain2[] = "system: pendulum-chain\ngravity: 1\nmasses: [1, 1.3]\nlengths: [1, 0.8]\n";
/* All u are near (2, 2, 2), so p = q x u is known to 1e-3. */
static const char chain_box[] = "system: pendulum-chain\ngravity: 1\nmasses: [1, 1]\nlengths: [1, 1]\n"
                                "starts: { kind: box, low: 2, high: 2.0005 }\n";
static const char oscillators_box[] =
    "system: coupled-oscillators\nstarts: { kind: box, low: 0.5, high: 0.75, segments: 2 }\n";
static const char grid[] =
    "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\nintegrators: [cf4, euler]\n"
    "N: [12]\nM: [3]\neps: [0, 1e-2]\nrepeats: 3\nt_end: 0.1\nepochs: 2\nbatch: 8\nhidden: [6]\n"
    "test: { trajectories: 4, points: 5 }\nseed: 3\n";

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("chain1.yaml", chain1);
    cli_write("chain2.yaml", chain2);
    cli_write("chain-box.yaml", chain_box);
    cli_write("oscillators.yaml", oscillators_box);
    cli_write("coupled.yaml", "system: coupled-oscillators\n");
    cli_write("grid.yaml", grid);
    return 0;
}

static void write_data(const char *name, lg_trajectories *data) {
    assert_ok(lg_trajectories_write(NULL, cli_at(name), data, NULL));
}

static lg_trajectories *generate(const char *arguments, const char *name) {
    cli_expect(lg, test_text("generate %s --out %s", arguments, name), 0, name);
    return cli_trajectories(name);
}

/* ---- E1 and E2 ---- */

typedef struct learned {
    lg_model *model;
    void *work;
} learned;

static lg_status field(void *user, double t, const double *y, const double *input, double *algebra) {
    const learned *self = user;
    (void)t;
    return lg_model_field(self->model, y, input, algebra, self->work);
}

static void learned_begin(const lg_hamiltonian_file *file, learned *self) {
    assert_ok(test_hamiltonian_model(NULL, &file->run.model, file->theta, &self->model, NULL));
    assert_int_equal(posix_memalign(&self->work, 64, lg_model_work_size(self->model)), 0);
}

static void learned_end(learned *self) {
    lg_model_destroy(self->model);
    free(self->work);
}

/* Mean of the squared difference over trajectories, points (with t = 0) and coordinates. */
static double first_error(const lg_hamiltonian_file *file, const lg_trajectories *test) {
    const bool chain = test->family == &lg_hamiltonian_chain;
    const size_t size = test->points * test->state_dim;
    learned self;
    lg_step_controller control;
    lg_stepper *stepper = NULL;
    double sum = 0, *y = TEST_ARRAY(double, size);
    learned_begin(file, &self);
    lg_ode ode = {.field = field, .user = &self};
    const lg_space_factor links = {LG_SPACE_TS2, test->n};
    assert_ok(chain ? lg_space_init(&ode.space, &links, 1) : lg_space_init_rn(&ode.space, test->state_dim));
    assert_ok(lg_stepper_create(NULL, lg_scheme_find(chain ? "rkmk54" : "dp54"), &ode, &stepper));
    lg_step_controller_init(&control);
    control.rtol = control.atol = 1e-11;
    for (size_t i = 0; i < test->count; i++) {
        const double *given = test->data + i * size;
        assert_ok(
            lg_integrate_adaptive(stepper, &control, test->t[0], given, test->t, test->points, y, NULL));
        for (size_t k = 0; k < size; k++) sum += (y[k] - given[k]) * (y[k] - given[k]);
    }
    lg_stepper_destroy(stepper);
    learned_end(&self);
    return sum / (double)(test->count * size);
}

/* Mean of |d - mean d|, where d = H - H_Theta at the starts. */
static double second_error(const lg_hamiltonian_file *file, const lg_trajectories *test) {
    double d[64], mean = 0, sum = 0;
    learned self;
    assert_true(test->count <= 64);
    learned_begin(file, &self);
    for (size_t i = 0; i < test->count; i++) {
        const double *start = test->data + i * test->points * test->state_dim;
        double energy;
        lg_model_eval(self.model, start, &energy, self.work);
        d[i] = test->hamiltonian[i] - energy;
        mean += d[i] / (double)test->count;
    }
    for (size_t i = 0; i < test->count; i++) sum += fabs(d[i] - mean);
    learned_end(&self);
    return sum / (double)test->count;
}

/* Trains model.h5 for a few epochs, and writes test.h5. */
static lg_hamiltonian_file *learn(const char *scene, const char *integrator, const char *noise) {
    char line[512];
    (void)snprintf(line, sizeof line, "%s --trajectories 24 --points 3 --t-end 0.2 --seed 4 --noise %s",
                   scene, noise);
    (void)generate(line, "train.h5");
    (void)snprintf(line, sizeof line, "%s --trajectories 6 --points 4 --t-end 1 --seed 5 --noise %s", scene,
                   noise);
    (void)generate(line, "test.h5");
    (void)snprintf(line, sizeof line,
                   "train train.h5 --hidden 8,8 --batch 8 --epochs 2 --integrator %s --out model.h5",
                   integrator);
    cli_expect(lg, line, 0, "model.h5");
    return cli_hamiltonian("model.h5");
}

TEST("E1 and E2 agree with those computed here") {
    static const char *const rows[][3] = {
        {"chain1.yaml", "cf4", "0"},         {"chain2.yaml", "lie-euler", "1e-2"},
        {"chain1.yaml", "rkmk54", "0"},   /* an embedded pair, used without step size control */
        {"oscillators.yaml", "cf4", "0"}, /* R^n is a Lie group too */
        {"oscillators.yaml", "rk4", "1e-2"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_hamiltonian_file *model = learn(rows[i][0], rows[i][1], rows[i][2]);
        const lg_trajectories *test = cli_trajectories("test.h5");
        cli_json(lg, "evaluate model.h5 test.h5", "");
        assert_string_equal(result.err, "");
        assert_close(json_number(result.out, "E1"), first_error(model, test), 1e-6, 0);
        assert_close(json_number(result.out, "E2"), second_error(model, test), 1e-6, 0);
    }
}

/* The outputs that the relative error is computed from: x_1, x_1 + L_2 q_2 and their velocities, for two
 * links with masses 1, 1.3 and lengths 1, .8. Iteration solves p = M(q) v for the tangent vectors v. */
static void seen2(const double *y, double *z) {
    const double *q1 = y, *p1 = y + 3, *q2 = y + 6, *p2 = y + 9, length = 0.8;
    const double m11 = 2.3, m12 = 1.3 * 0.8, m22 = 1.3 * 0.64;
    double v1[3] = {0}, v2[3] = {0};
    for (int round = 0; round < 400; round++) { /* the error shrinks by m12^2/(m11 m22) = .57 per round */
        double along1 = 0, along2 = 0;
        for (int c = 0; c < 3; c++) along1 += q1[c] * v2[c];
        for (int c = 0; c < 3; c++) v1[c] = (p1[c] - m12 * (v2[c] - along1 * q1[c])) / m11;
        for (int c = 0; c < 3; c++) along2 += q2[c] * v1[c];
        for (int c = 0; c < 3; c++) v2[c] = (p2[c] - m12 * (v1[c] - along2 * q2[c])) / m22;
    }
    for (int c = 0; c < 3; c++) {
        z[c] = q1[c], z[3 + c] = q1[c] + length * q2[c];
        z[6 + c] = v1[c], z[9 + c] = v1[c] + length * v2[c];
    }
}

/* The learned flow of model.h5 from a start of 12 numbers, at the four points of [0, 1]. */
static const double *predicted2(const double *start) {
    char line[1024];
    size_t used =
        (size_t)snprintf(line, sizeof line, "predict model.h5 --t-end 1 --points 4 --tolerance 1e-12");
    for (size_t k = 0; k < 12; k++)
        used += (size_t)snprintf(line + used, sizeof line - used, "%s%.17g",
                                 k > 0 ? "," : " --initial=", start[k]);
    (void)snprintf(line + used, sizeof line - used, " --out path.h5");
    cli_expect(lg, line, 0, "t  ");
    return cli_trajectories("path.h5")->data;
}

TEST("relative errors are those of the masses' positions and velocities, as computed here") {
    (void)learn("chain2.yaml", "cf4", "0");
    const lg_trajectories *test = cli_trajectories("test.h5");
    cli_json(lg, "evaluate model.h5 test.h5 --metric relative --tolerance 1e-12", "relative >0");
    const double relative = json_number(result.out, "relative");
    const double worst = json_number(result.out, "relative_worst");
    double sum = 0, largest = -1e300;
    for (size_t i = 0; i < test->count; i++) {
        const double *given = test->data + i * test->points * 12, *predicted = predicted2(given);
        double mean = 0;
        for (size_t j = 0; j < 4; j++) {
            double a[12], b[12], difference = 0, total = 0;
            seen2(given + 12 * j, a);
            seen2(predicted + 12 * j, b);
            for (int k = 0; k < 12; k++) {
                difference += (a[k] - b[k]) * (a[k] - b[k]);
                total += (a[k] + b[k]) * (a[k] + b[k]);
            }
            mean += log(sqrt(difference / total) + 1e-8) / 4;
        }
        sum += mean / (double)test->count;
        largest = fmax(largest, mean);
    }
    assert_close(relative, exp(sum), 1e-5, 0);
    assert_close(worst, exp(largest), 1e-5, 0);
}

TEST("relative errors use the state if a system has no other outputs; a chain's parameters must be known") {
    (void)learn("oscillators.yaml", "rk4", "0");
    lg_trajectories *test = cli_trajectories("test.h5");
    for (size_t i = 0; i < test->count;
         i++) /* all points but the first; the predictions and the data are much larger than for the others */
        for (size_t k = 4; k < 16; k++) test->data[16 * i + k] = 1e6;
    write_data("far.h5", test);
    cli_json(lg, "evaluate model.h5 far.h5 --metric relative", "relative >0");
    /* the errors at the other points are 1 */
    assert_close(json_number(result.out, "relative"), pow(1e-8, 0.25), 1e-4, 0);
    cli_expect(lg, "evaluate model.h5 far.h5 --metric relative", 0, "relative  ");
    (void)learn("chain1.yaml", "cf4", "0");
    test = cli_trajectories("test.h5");
    lg_system_destroy(test->truth);
    test->truth = NULL;
    write_data("unknown.h5", test);
    cli_expect(lg, "evaluate model.h5 unknown.h5 --metric relative", 3, "/parameters");
}

static void expect_not_finite(const char *name, const char *words, const char *members) {
    cli_expect(lg, test_text("evaluate model.h5 %s --json", name), 4, words);
    json_expect(result.out, members);
}

TEST("results that overflow are null and named in a message; an unknown E2 is no failure") {
    (void)learn("oscillators.yaml", "rk4", "1e-2");
    lg_trajectories *test = cli_trajectories("test.h5"), unknown = *test;
    const size_t last = test->points * test->state_dim - 1;
    const double kept = test->data[last];
    test->data[last] = 1e200;
    write_data("far.h5", test);
    expect_not_finite("far.h5", "far.h5: E1 is not finite", "E1 null, E2 >0");
    test->data[last] = kept;
    for (size_t i = 0; i < test->count; i++) test->hamiltonian[i] = i % 2 == 0 ? 1.7e308 : -1.7e308;
    write_data("high.h5", test);
    expect_not_finite("high.h5", "high.h5: E2 is not finite", "E2 null, E1 >0");
    unknown.hamiltonian = NULL;
    write_data("unknown.h5", &unknown);
    cli_json(lg, "evaluate model.h5 unknown.h5", "E2 null");
}

/* A flow that turns a million times between two points, as a badly trained model's flow may. */
TEST("judging does not run forever: a flow that needs too many steps is reported") {
    (void)learn("chain1.yaml", "cf4", "0");
    lg_trajectories *test = cli_trajectories("test.h5");
    for (size_t j = 0; j < test->points; j++) test->t[j] *= 1e7;
    write_data("long.h5", test);
    cli_expect(lg, "evaluate model.h5 long.h5", 4, "needs more than 28000 steps");
}

TEST("test data of another system are reported") {
    (void)learn("oscillators.yaml", "rk4", "1e-2");
    lg_trajectories *test = cli_trajectories("test.h5");
    (void)snprintf(test->system, sizeof test->system, "quartic");
    write_data("quartic.h5", test);
    test->system[0] = '\0';
    write_data("nameless.h5", test);
    cli_json(lg, "evaluate model.h5 quartic.h5", "E1 *");
    assert_says(result.err, "model.h5 was trained on coupled-oscillators");
    assert_says(result.err, "quartic.h5 holds quartic");
    cli_json(lg, "evaluate model.h5 nameless.h5", "E1 *");
    assert_string_equal(result.err, "");
}

TEST("trajectories with too many points are refused") {
    (void)generate("oscillators.yaml --trajectories 2 --points 513 --t-end 0.5", "long.h5");
    cli_expect(lg, "train long.h5 --integrator rk4 --epochs 1 --out m.h5", 3,
               "long.h5: /trajectories has 513 points");
    assert_non_null(strstr(result.err, "512"));
    assert_false(cli_exists("m.h5"));
}

/* ---- starts and noise ---- */

static const double *point(const lg_trajectories *data, size_t i, size_t j) {
    return data->data + (i * data->points + j) * data->state_dim;
}

TEST("starts of a chain lie in the given box") {
    const lg_trajectories *data =
        generate("chain-box.yaml --trajectories 10 --points 3 --t-end 0.1 --noise 1e-2", "box.h5");
    for (size_t i = 0; i < data->count; i++)
        for (size_t link = 0; link < 2; link++) {
            const double *q = point(data, i, 0) + 6 * link, *p = q + 3;
            assert_close(q[0] * q[0] + q[1] * q[1] + q[2] * q[2], 1, 1e-14, 0);
            for (int c = 0; c < 3; c++) assert_close(p[c], 2 * (q[(c + 1) % 3] - q[(c + 2) % 3]), 0, 2e-3);
        }
}

/* H = (q1^2 + p1^2)/2 + p2^2/2 + q2^2/2 + q2^4/4 for the state q1 q2 p1 p2. */
static double oscillators_energy(const double *y) {
    return (y[0] * y[0] + y[2] * y[2] + y[3] * y[3] + y[1] * y[1]) / 2 + pow(y[1], 4) / 4;
}

static void check_noise(const lg_trajectories *clean, const char *kind, double eps, double variance) {
    char line[256];
    double sum = 0;
    const size_t d = clean->state_dim;
    (void)snprintf(line, sizeof line,
                   "oscillators.yaml --trajectories 40 --points 9 --t-end 0.5 --noise %g --noise-kind %s",
                   eps, kind);
    const lg_trajectories *noisy = generate(line, "noisy.h5");
    for (size_t i = 0; i < clean->count; i++) {
        assert_memory_equal(point(clean, i, 0), point(noisy, i, 0), d * sizeof(double));
        assert_close(noisy->hamiltonian[i], clean->hamiltonian[i], 0, 0);
        for (size_t k = d; k < clean->points * d; k++) {
            const double off = point(noisy, i, 0)[k] - point(clean, i, 0)[k];
            assert_true(off != 0 && fabs(off) < 6 * eps);
            sum += off * off;
        }
    }
    /* With 1280 numbers the mean of their squares is within 20 percent. */
    assert_close(sum / (double)(clean->count * (clean->points - 1) * d), variance, 0.2, 0);
}

TEST("starts lie in the box, and the noise has the given size") {
    const lg_trajectories *clean =
        generate("oscillators.yaml --trajectories 40 --points 9 --t-end 0.5", "clean.h5");
    for (size_t i = 0; i < clean->count; i++) {
        const double *y = point(clean, i, 0);
        for (size_t c = 0; c < 4 && i % 2 == 0; c++) assert_true(y[c] >= 0.5 && y[c] < 0.75);
        if (i % 2 == 1) /* the second of two segments begins where the first ends */
            assert_memory_equal(y, point(clean, i - 1, clean->points - 1), 4 * sizeof(double));
        assert_close(clean->hamiltonian[i], oscillators_energy(y), 1e-14, 0);
        for (size_t j = 1; j < clean->points; j++)
            assert_close(oscillators_energy(point(clean, i, j)), clean->hamiltonian[i], 1e-9, 0);
    }
    check_noise(clean, "normal", 1e-2, 1e-4);
    check_noise(clean, "uniform", 1e-2, 1e-4 / 3);
}

/* ---- study ---- */

enum { ROWS = 12, RESULTS = 4 };
static const char *const measures[RESULTS] = {"loss", "E1", "E2", "seconds"};

typedef struct row {
    char integrator[16];
    double eps, values[RESULTS];
} row;

static size_t read_rows(const char *name, row rows[ROWS]) {
    char text[8192];
    size_t n = 0;
    cli_read(name, text, sizeof text);
    char *save = NULL, *line = strtok_r(text, "\n", &save);
    for (line = strtok_r(NULL, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save)) {
        row *r = &rows[n];
        assert_true(n++ < ROWS);
        assert_int_equal(sscanf(line, "%15[^,],%*u,%*u,%*u,%lf,%*f,%*u,%*u,%lf,%lf,%lf,%lf", r->integrator,
                                &r->eps, &r->values[0], &r->values[1], &r->values[2], &r->values[3]),
                         6);
    }
    return n;
}

/* Collects measure k of the rows of an integrator with this noise (eps < 0: any noise), in increasing
 * order. */
static size_t pick(const row rows[ROWS], const char *integrator, double eps, int k, double out[ROWS]) {
    size_t n = 0;
    for (size_t i = 0; i < ROWS; i++) {
        if (strcmp(rows[i].integrator, integrator) != 0 || (eps >= 0 && rows[i].eps != eps)) continue;
        size_t at = n++;
        for (; at > 0 && out[at - 1] > rows[i].values[k]; at--) out[at] = out[at - 1];
        out[at] = rows[i].values[k];
    }
    return n;
}

static double geometric(const double *values, size_t n) {
    double product = 1;
    for (size_t i = 0; i < n; i++) product *= pow(values[i], 1.0 / (double)n);
    return product;
}

/* Checks the objects of the list `key`. Each has its own integrator and, in some lists, its own noise. */
static int check_list(const char *key, const row rows[ROWS], double eps, size_t expected, bool median) {
    int count = 0;
    const char *s = json_find(result.out, key);
    assert_non_null(s);
    for (s = json_space(s + 1); *s == '{'; count++) {
        char integrator[16] = "";
        double values[ROWS];
        assert_int_equal(sscanf(json_find(s, "integrator"), "\"%15[^\"]", integrator), 1);
        const double noise = json_find(s, "eps") != NULL ? json_number(s, "eps") : eps;
        assert_close(json_number(s, "runs"), (double)expected, 0, 0);
        assert_close(json_number(s, "failed"), 0, 0, 0);
        for (int k = 0; k < RESULTS; k++) {
            assert_int_equal(pick(rows, integrator, noise, k, values), expected);
            assert_close(json_number(s, measures[k]),
                         median ? values[expected / 2] : geometric(values, expected), 1e-9, 0);
        }
        s = json_space(json_value(s));
        if (*s == ',') s = json_space(s + 1);
    }
    return count;
}

TEST("the results of a study agree with judging each of its models") {
    static const char *const names[] = {"cf4", "euler"};
    row rows[ROWS];
    double values[ROWS];
    char words[64];
    cli_expect(lg, "study grid.yaml --out study.csv --jobs 2 --threads 2 --json", 0, "\"done\": 12");
    assert_int_equal(read_rows("study.csv", rows), ROWS);
    assert_int_equal(check_list("medians", rows, 0, 3, true), 4);
    assert_int_equal(check_list("geometric_means", rows, -1, 6, false), 2);
    assert_int_equal(check_list("best_without_noise", rows, 0, 3, false), 2);
    assert_int_equal(check_list("best_with_noise", rows, 1e-2, 3, false), 2);
    cli_expect(lg, "study grid.yaml --out study.csv", 0, "Geometric means");
    const char *means = strstr(result.out, "Geometric means");
    for (size_t i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            const size_t n = pick(rows, names[i], -1, k, values);
            (void)snprintf(words, sizeof words, "%.6g", geometric(values, n));
            if (strstr(means, words) == NULL) fail_msg("%s is not in %s", words, means);
            (void)pick(rows, names[i], 0, k, values);
            (void)snprintf(words, sizeof words, "%.6g", values[1]);
            if (strstr(result.out, words) == NULL) fail_msg("%s is not in %s", words, result.out);
        }
}

/* ---- data that no Hamiltonian explains ---- */

/* Momenta decrease by the part `loss` from point to point. */
static void damp(lg_trajectories *data, double loss) {
    for (size_t i = 0; i < data->count * data->points; i++)
        for (size_t k = 3; k < 6; k++) data->data[i * 6 + k] *= pow(1.0 - loss, (double)(i % data->points));
}

TEST("training reports that damped data are not conservative, and does not report other data, noisy or "
     "not") {
    static const struct {
        const char *generate;
        double loss;
        bool told;
    } rows[] = {{"chain1.yaml --trajectories 150 --points 5 --t-end 0.4 --seed 2", 0.0, false},
                {"chain1.yaml --trajectories 150 --points 5 --t-end 0.4 --seed 2 --noise 0.03", 0.0, false},
                {"chain1.yaml --trajectories 150 --points 5 --t-end 0.4 --seed 2", 0.01, true},
                {"chain1.yaml --trajectories 150 --points 5 --t-end 0.4 --seed 2 --noise 0.03", 0.02, true}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_trajectories *data = generate(rows[i].generate, "plain.h5");
        damp(data, rows[i].loss);
        write_data("damped.h5", data);
        cli_expect(lg, "train damped.h5 --out damped-model.h5 --epochs 200", 0, "parameters");
        assert_int_equal(strstr(result.err, "not conservative") != NULL, rows[i].told);
    }
}

/* Multiplies momenta by `by` and keeps the times: data of a system with another mass. */
static void change_mass(lg_trajectories *data, double by) {
    for (size_t i = 0; i < data->count * data->points; i++)
        for (size_t k = 3; k < 6; k++) data->data[i * 6 + k] *= by;
}

TEST("exact data are not called damped where the model has not learned them yet, in any units") {
    static const struct {
        double mass, t_end;
        const char *options;
        int code;
    } rows[] = {{1.0, 0.1, "--epochs 3", 0},
                {1.0, 0.1, "--preset thesis --epochs 3", 0},
                {1.0, 1.0, "--epochs 2", 0}, /* most of the data is explained, but the loss still falls */
                {1.0, 1.0, "--preset thesis --lr 1e-3 --epochs 8", 0},
                {1.0, 1.0, "--preset thesis --lr 1e-9 --epochs 20", 0}, /* nothing is explained */
                {1.0, 1.0, "--preset thesis --lr 2e-5 --epochs 40", 0}, /* little is explained */
                {1e3, 0.1, "--epochs 100 --units given", 0},
                {1e-6, 0.1, "--epochs 100", 0}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char command[128];
        (void)snprintf(command, sizeof command,
                       "chain1.yaml --trajectories 150 --points 5 --t-end %g --seed 2", rows[i].t_end);
        lg_trajectories *data = generate(command, "plain3.h5");
        change_mass(data, rows[i].mass);
        write_data("mass.h5", data);
        (void)snprintf(command, sizeof command, "train mass.h5 --out mass-model.h5 %s", rows[i].options);
        cli_expect(lg, command, rows[i].code, "");
        assert_null(strstr(result.err, "not conservative"));
        assert_null(strstr(result.err, "repeat another"));
        assert_null(strstr(result.err, "nothing moves"));
    }
}

/* Replaces trajectory i by trajectory i modulo `kinds`. With `rest` all points of a trajectory become its
 * first point with momentum 0. */
static void repeat(lg_trajectories *data, size_t kinds, bool rest) {
    const size_t size = data->points * 6;
    for (size_t i = 0; i < data->count; i++)
        memmove(data->data + i * size, data->data + i % kinds * size, size * sizeof *data->data);
    for (size_t i = 0; rest && i < data->count * size; i++)
        data->data[i] = i % 6 < 3 ? data->data[i / size * size + i % 6] : 0.0;
}

TEST("trajectories that repeat each other, and data at rest, are reported as such") {
    static const struct {
        size_t kinds;
        bool rest;
        const char *told, *also;
    } rows[] = {{1, false, "149 of 150 trajectories repeat another one", "the data have 24 numbers"},
                {7, false, "143 of 150 trajectories repeat another one", "the data have 168 numbers"},
                {150, true, "nothing moves", NULL}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_trajectories *data =
            generate("chain1.yaml --trajectories 150 --points 5 --t-end 0.1 --seed 2", "plain4.h5");
        repeat(data, rows[i].kinds, rows[i].rest);
        write_data("again.h5", data);
        cli_expect(lg, "train again.h5 --out again-model.h5 --epochs 100", 0, "parameters");
        assert_null(strstr(result.err, "not conservative"));
        assert_non_null(strstr(result.err, rows[i].told));
        if (rows[i].also != NULL) assert_non_null(strstr(result.err, rows[i].also));
        assert_int_equal(strstr(result.err, "nothing moves") != NULL, rows[i].rest);
    }
}

/* Solutions of q'' = -4 q - c q' from the starts of the data. */
static void make_damped(lg_trajectories *data, double c) {
    const double rate = c / 2, square = 4 - rate * rate, w = sqrt(fabs(square));
    for (size_t i = 0; i < data->count; i++) {
        double *first = data->data + i * data->points * 2;
        const double q = first[0], b = (first[1] + rate * q) / w;
        for (size_t j = 1; j < data->points; j++) {
            const double t = data->t[j] - data->t[0], e = exp(-rate * t),
                         C = square > 0 ? cos(w * t) : cosh(w * t), S = square > 0 ? sin(w * t) : sinh(w * t);
            first[2 * j] = e * (q * C + b * S);
            first[2 * j + 1] = e * (w * (b * C - (square > 0 ? q : -q) * S) - rate * (q * C + b * S));
        }
    }
}

TEST("sixty trajectories of different energies show that an oscillator is damped, and an undamped one is "
     "not reported") {
    static const struct {
        double c;
        int epochs;
    } rows[] = {{0.0, 100}, {0.05, 200}, {1.0, 100}, {10.0, 100}};
    cli_write("oscillator.yaml", "system: oscillator\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_trajectories *data =
            generate("oscillator.yaml --trajectories 60 --points 11 --t-end 1 --seed 3", "plain2.h5");
        make_damped(data, rows[i].c);
        write_data("damped2.h5", data);
        cli_expect(lg, test_text("train damped2.h5 --out damped-model.h5 --epochs %d", rows[i].epochs), 0,
                   "parameters");
        const bool told = strstr(result.err, "not conservative") != NULL;
        const bool unexplained = strstr(result.err, "does not explain") != NULL;
        /* with this damping hardly one turn is left, so the other message is right too */
        if ((told || (rows[i].c > 2 && unexplained)) != (rows[i].c > 0))
            fail_msg("damping %g, %d epochs: %s%s", rows[i].c, rows[i].epochs, result.out, result.err);
    }
}

TEST("a warning does not come from a peak of the loss") {
    (void)generate("chain1.yaml --trajectories 60 --points 9 --t-end 2 --noise 0.03 --seed 2", "peak.h5");
    cli_expect(lg, "train peak.h5 --out peak-model.h5 --preset thesis --epochs 40", 0, "");
    assert_null(strstr(result.err, "not conservative"));
}

TEST("the error of an integration scheme is not taken for friction") {
    static const char *const schemes[] = {"euler", "symplectic-euler"};
    (void)generate("oscillator.yaml --trajectories 60 --points 11 --t-end 2 --seed 3", "scheme.h5");
    for (size_t i = 0; i < LG_COUNT(schemes); i++) {
        char command[128];
        (void)snprintf(command, sizeof command,
                       "train scheme.h5 --out scheme-model.h5 --epochs 2000 --integrator %s", schemes[i]);
        cli_expect(lg, command, 0, "parameters");
        assert_null(strstr(result.err, "not conservative"));
        assert_null(strstr(result.err, "does not explain"));
    }
}

/* Trajectory i is a e^(-ct) (cos t, 0, -sin t, 0) with a from .5 to 1.5: the second of two oscillators is at
 * rest. */
static void turn_and_shrink(lg_trajectories *data, double c) {
    for (size_t i = 0; i < data->count; i++)
        for (size_t j = 0; j < data->points; j++) {
            double *y = data->data + (i * data->points + j) * 4;
            const double t = data->t[j], a = (0.5 + (double)i / (double)data->count) * exp(-c * t);
            y[0] = a * cos(t), y[1] = 0.0, y[2] = -a * sin(t), y[3] = 0.0;
        }
}

/* All starts lie on one ray, and no trajectory passes where another one has been. A Hamiltonian whose energy
 * is constant along the trajectories could therefore pass through all states, only at wrong times. */
TEST("friction is reported even where the learned energy does not show it, and noise is not taken for "
     "friction") {
    static const struct {
        double friction, noise;
        bool told;
    } rows[] = {{0.0, 0.0, false}, {0.0, 0.1, false}, {0.1, 0.0, true}, {1.0, 0.0, true}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char command[128];
        (void)snprintf(command, sizeof command,
                       "coupled.yaml --trajectories 30 --points 20 --t-end 1.9 --seed 3 --noise %g",
                       rows[i].noise);
        lg_trajectories *data = generate(command, "ray.h5");
        if (rows[i].noise == 0.0) turn_and_shrink(data, rows[i].friction);
        write_data("ray2.h5", data);
        cli_expect(lg, "train ray2.h5 --out ray-model.h5 --epochs 100", 0, "parameters");
        assert_int_equal(strstr(result.err, "errors of neighbouring steps are correlated") != NULL,
                         rows[i].told);
        assert_null(strstr(result.err, "not conservative:"));
    }
}

TEST("training reports how it interprets data of a system that it does not know") {
    lg_trajectories *data =
        generate("oscillator.yaml --trajectories 8 --points 3 --t-end 0.3 --seed 3", "known.h5");
    cli_expect(lg, "train known.h5 --out m.h5 --epochs 1", 0, "");
    assert_null(strstr(result.err, "is not a known system"));
    (void)snprintf(data->system, sizeof data->system, "oscilator");
    write_data("typo.h5", data);
    cli_expect(lg, "train typo.h5 --out m.h5 --epochs 1", 0, "");
    assert_says(result.err, "'oscilator' is not a known system: from attribute layout");
}

TEST("training warns of fewer numbers than parameters, and says how many trajectories would be enough") {
    lg_trajectories *data =
        generate("chain1.yaml --trajectories 4 --points 5 --t-end 0.4 --seed 2", "few.h5");
    assert_int_equal(data->count, 4);
    cli_expect(lg, "train few.h5 --out few-model.h5 --epochs 1 --hidden 20,20", 0, "");
    assert_non_null(strstr(result.err, "the data have 96 numbers, fewer than the"));
    cli_expect(lg, "train plain.h5 --out few-model.h5 --epochs 1 --hidden 20,20", 0, "");
    assert_null(strstr(result.err, "fewer than the"));
}

TEST_GROUP(setup, cli_end)
