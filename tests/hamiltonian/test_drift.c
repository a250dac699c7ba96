/* Warnings about data whose energy drifts: oscillators with damping, and what a learned Hamiltonian makes of
 * them.
 * ctest-labels: src/hamiltonian */
#include "hamiltonian/learned.h"
#include "liegrad/fit.h"
#include "support/fixtures.h"
#include "test_support.h"

enum { N = 12, M = 16, EPOCHS = 100 };
static const double dt = 0.15;

/* q'' = -q - 2 c q'; the starts lie on no curve of constant energy. */
static void oscillate(double c, double *data) {
    const double w = sqrt(1 - c * c);
    for (size_t i = 0; i < N; i++) {
        const double a = 1 + 0.05 * (double)(3 * i % N), q = a * cos(0.8 * (double)i),
                     p = a * sin(0.8 * (double)i);
        for (size_t j = 0; j < M; j++) {
            const double t = dt * (double)j, fall = exp(-c * t), C = cos(w * t), S = sin(w * t) / w;
            data[2 * (i * M + j)] = fall * (q * C + (p + c * q) * S);
            data[2 * (i * M + j) + 1] = fall * (p * C - (c * p + q) * S);
        }
    }
}

typedef struct learned {
    lg_hamiltonian model;
    lg_hamiltonian_problem problem;
    lg_fit *fit;
    double data[2 * N * M], *theta, loss;
} learned;

RELEASES(release_fit, lg_fit_destroy)

/* Minimises the loss from l->theta on. */
static void minimise(learned *l, const char *method) {
    lg_fit_problem problem;
    lg_fit_options options;
    lg_hamiltonian_fit_problem(&l->problem, &problem);
    lg_fit_options_init(&options);
    assert_ok(lg_fit_plan_parse(method, true, &options.plan, NULL));
    options.epochs = EPOCHS;
    assert_told(lg_fit_create(NULL, &problem, &options, l->theta, &l->fit, &told));
    lg_test_owns(l->fit, release_fit);
    assert_told(lg_fit_run(l->fit, &told));
    lg_fit_parameters(l->fit, l->theta);
    l->loss = lg_fit_history(l->fit, LG_FIT_LOSS)[lg_fit_epochs_done(l->fit) - 1];
}

static void learn_with(lg_symmetry symmetry, double damping, const char *scheme, const char *method,
                       learned *l) {
    lg_rng rng = test_rng(4, 0);
    oscillate(damping, l->data);
    assert_ok(lg_hamiltonian_init(&l->model, lg_hamiltonian_family_find("separable"), 1,
                                  LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH));
    assert_ok(lg_hamiltonian_set_symmetry(&l->model, symmetry));
    l->problem = (lg_hamiltonian_problem){.model = &l->model,
                                          .scheme = lg_scheme_find(scheme),
                                          .substeps = 1,
                                          .trajectories = N,
                                          .points = M,
                                          .dt = dt,
                                          .data = l->data};
    l->theta = TEST_ARRAY(double, lg_hamiltonian_parameters(&l->model));
    lg_hamiltonian_initialise(&l->model, &rng, l->theta);
    minimise(l, method);
}

static void learn(double damping, const char *scheme, const char *method, learned *l) {
    learn_with(LG_SYMMETRY_NONE, damping, scheme, method, l);
}

static void keep(void *user, lg_log_level level, const char *message) {
    (void)level;
    (void)snprintf(user, 512, "%s", message);
}

/* The warning about this problem, or ""; about the floor if it is not 0. */
static const char *warning_near(const learned *l, const lg_hamiltonian_problem *problem, double loss,
                                double floor) {
    static char said[512];
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.log = keep, options.log_user = said;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    said[0] = '\0';
    if (floor > 0)
        lg_hamiltonian_warn_of_floor(context, problem, loss, floor);
    else
        assert_told(lg_hamiltonian_warn_of_drift(context, problem, l->fit, l->theta, loss, 0.0, &told));
    return said;
}

static const char *warning(const learned *l, const lg_hamiltonian_problem *problem, double loss) {
    return warning_near(l, problem, loss, 0);
}

TEST("the energy of damped oscillators falls, backward in time it rises; free oscillators keep it") {
    learned *l = TEST_ARRAY(learned, 1), *calm = TEST_ARRAY(learned, 1);
    learn(0.03, "stormer-verlet", "lbfgs", l);
    assert_says(warning(l, &l->problem, l->loss), "the learned energy falls");
    lg_hamiltonian_problem back = l->problem;
    double reversed[2 * N * M];
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < M; j++)
            for (size_t k = 0; k < 2; k++)
                reversed[2 * (i * M + j) + k] = (k == 0 ? 1 : -1) * l->data[2 * (i * M + M - 1 - j) + k];
    back.data = reversed;
    assert_says(warning(l, &back, l->loss), "the learned energy rises");
    lg_hamiltonian_problem one = l->problem, pairs = l->problem;
    one.trajectories = 1, pairs.points = 2;
    assert_null(strstr(warning(l, &one, l->loss), "not conservative"));
    assert_null(strstr(warning(l, &pairs, l->loss), "does not explain"));
    assert_string_equal(warning(l, &one, 1e-9), "");
    one.scheme = lg_scheme_find("variational"); /* has no stepper for this model */
    assert_string_equal(warning(l, &one, l->loss), "");
    learn(0.0, "stormer-verlet", "lbfgs", calm);
    assert_string_equal(warning(calm, &calm->problem, calm->loss), "");
}

/* The oscillator's V = q^2/2 is even. */
TEST("with a mirror symmetry a warning names the symmetry first, and a right symmetry causes none") {
    static const struct {
        lg_symmetry symmetry;
        double damping;
        const char *begins;
    } rows[] = {{LG_SYMMETRY_EVEN, 0.0, ""},
                {LG_SYMMETRY_ODD, 0.0, "the potential may not have the symmetry"},
                {LG_SYMMETRY_EVEN, 0.03, "the potential may not have the symmetry"},
                {LG_SYMMETRY_ODD, 0.03, "the potential may not have the symmetry"},
                {LG_SYMMETRY_NONE, 0.03, "the data are not conservative"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        learned *l = TEST_ARRAY(learned, 1);
        learn_with(rows[i].symmetry, rows[i].damping, "stormer-verlet", "lbfgs", l);
        const char *said = warning(l, &l->problem, l->loss);
        if (strncmp(said, rows[i].begins, strlen(rows[i].begins)) != 0 || (i == 0) != (said[0] == '\0'))
            fail_msg("row %zu: %s", i, said);
        if (rows[i].symmetry == LG_SYMMETRY_EVEN && rows[i].damping > 0) continue;
        const double loss = fmax(l->loss, 1e-9);
        said = warning_near(l, &l->problem, loss, loss / 2);
        assert_says(said, "is near the floor");
        assert_int_equal(strstr(said, "may not have the symmetry") != NULL,
                         rows[i].symmetry == LG_SYMMETRY_ODD);
    }
}

TEST("energy that only the error of the scheme costs causes no warning") {
    learned *l = TEST_ARRAY(learned, 1);
    learn(0.0, "lie-euler", "lbfgs", l);
    assert_null(strstr(warning(l, &l->problem, l->loss), "not conservative"));
}

TEST("after few epochs data are judged if the minimiser has ended by itself") {
    learned *l = TEST_ARRAY(learned, 1);
    learn(0.03, "stormer-verlet", "lm", l);
    minimise(l, "lm");
    assert_true(lg_fit_epochs_done(l->fit) < 16);
    assert_int_equal(lg_fit_why_finished(l->fit), LG_FIT_END_MINIMISER);
    assert_says(warning(l, &l->problem, l->loss), "the learned energy falls");
}
