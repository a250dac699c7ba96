/* A steady training step calls no malloc. Models in a loop: test_model_no_malloc.c; plans: test_plan.c. */
#include "test_support.h"

#include "liegrad/hamiltonian.h"
#include "liegrad/mechanics.h"
#include "models/hamiltonian_internal.h"
#include "support/malloc_count.h"

enum { N = 50, M = 3 };

typedef struct setting {
    const char *system, *integrator;
    uint32_t n;
    const lg_hamiltonian_family *family;
    lg_dtype dtype;
    int threads;
} setting;

typedef struct counting {
    lg_counts used;
    bool done;
} counting;

/* Epoch 1 and 2 warm up; epochs 3..6 are counted. The counters stand outside the library's own work. */
static int count_epochs(void *user, const lg_fit_epoch *report) {
    counting *self = user;
    if (report->epoch == 2) lg_count_begin();
    if (report->epoch == 6) {
        self->used = lg_count_end();
        self->done = true;
    }
    return 0;
}

static void train_counted(const setting *s) {
    lg_system_options so;
    lg_trajectory_options to;
    lg_system *system;
    lg_hamiltonian model;
    lg_rng rng;
    double t[M], H[N];
    const uint32_t hidden[3] = {20, 20, 20};
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    lg_system_options_init(&so);
    so.links = s->n;
    if (s->family == &lg_hamiltonian_chain) {
        so.form = "hamiltonian";
        so.parameters = &given;
        so.parameter_count = 1;
    }
    assert_ok(lg_system_create(NULL, s->system, &so, &system, NULL));
    double *y = malloc(N * M * lg_system_dim(system) * sizeof *y);
    lg_trajectory_options_init(&to);
    to.trajectories = N;
    to.points = M;
    assert_ok(lg_generate_trajectories(NULL, system, &to, t, y, H, NULL));
    assert_ok(lg_hamiltonian_init(&model, s->family, s->n, LG_POTENTIAL_MLP, hidden, 3, LG_TANH));
    double *theta = malloc(lg_hamiltonian_parameters(&model) * sizeof *theta);
    lg_rng_seed(&rng, 1, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);

    lg_hamiltonian_problem problem = {
        .model = &model, .substeps = 1, .trajectories = N, .points = M, .dt = t[1], .data = y};
    problem.scheme = lg_scheme_find(s->integrator);
    lg_fit_problem fit_problem;
    lg_hamiltonian_fit_problem(&problem, &fit_problem);
    counting counted = {.done = false};
    lg_fit_options options;
    lg_fit *fit;
    lg_error error;
    lg_fit_options_init(&options);
    options.dtype = s->dtype;
    options.threads = s->threads;
    options.epochs = 6;
    options.batch = 16;
    options.clip_norm = 1e-3;
    options.on_epoch = count_epochs;
    options.user = &counted;
    assert_ok(lg_fit_create(NULL, &fit_problem, &options, theta, &fit, &error));
    assert_ok(lg_fit_run(fit, &error));
    assert_true(counted.done);
    assert_int_equal(counted.used.allocations, 0);
    assert_int_equal(counted.used.releases, 0);
    lg_fit_destroy(fit);
    lg_system_destroy(NULL, system);
    free(theta);
    free(y);
}

static void a_steady_training_step(void **state) {
    (void)state;
    static const setting settings[] = {
        {"pendulum-chain", "cf4", 1, &lg_hamiltonian_chain, LG_F64, 1},
        {"pendulum-chain", "cf4", 1, &lg_hamiltonian_chain, LG_F32, 2},
        {"pendulum-chain", "rkmk4", 2, &lg_hamiltonian_chain, LG_F64, 2},
        {"pendulum-chain", "rk4", 2, &lg_hamiltonian_chain, LG_F64, 1},
        {"quartic", "stormer-verlet", 2, &lg_hamiltonian_separable, LG_F32, 1},
    };
    if (!lg_count_available()) skip();
    for (size_t i = 0; i < LG_COUNT(settings); i++) train_counted(&settings[i]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_steady_training_step),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
