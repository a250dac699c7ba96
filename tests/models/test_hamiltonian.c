/* Learned Hamiltonians: the exact parameters reproduce the true system; losses and their gradients. */
#include "models/model_support.h"

#include "liegrad/mechanics.h"
#include "liegrad/ops.h"

enum { N = 12, M = 4 };

typedef struct data {
    lg_system *system;
    size_t d;
    double t[M], *y, H[N];
} data;

static void make_data(data *set, const char *name, size_t links) {
    lg_system_options so;
    lg_trajectory_options to;
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    lg_system_options_init(&so);
    so.links = links;
    if (strcmp(name, "pendulum-chain") == 0) {
        so.form = "hamiltonian";
        so.parameters = &given;
        so.parameter_count = 1;
    }
    assert_ok(lg_system_create(NULL, name, &so, &set->system, NULL));
    set->d = lg_system_dim(set->system);
    set->y = malloc(N * M * set->d * sizeof(double));
    lg_trajectory_options_init(&to);
    to.trajectories = N;
    to.points = M;
    to.t_end = 0.06;
    to.seed = 3;
    assert_ok(lg_generate_trajectories(NULL, set->system, &to, set->t, set->y, set->H, NULL));
}

static void free_data(data *set) {
    lg_system_destroy(NULL, set->system);
    free(set->y);
}

static lg_hamiltonian_problem problem_of(const lg_hamiltonian *model, const data *set,
                                         const char *integrator) {
    lg_hamiltonian_problem problem = {
        .model = model, .substeps = 1, .trajectories = N, .points = M, .dt = set->t[1], .data = set->y};
    problem.scheme = lg_scheme_find(integrator);
    assert_ok(lg_hamiltonian_problem_check(&problem, NULL));
    return problem;
}

/* Loss of the whole set, and its gradient when `gradient` is given. */
static double loss_of(const lg_hamiltonian_problem *problem, const double *theta, double *gradient) {
    uint32_t samples[N];
    lg_fit_problem fit;
    lg_tape *tape;
    lg_var loss;
    double value;
    for (uint32_t i = 0; i < N; i++) samples[i] = i;
    lg_hamiltonian_fit_problem(problem, &fit);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    lg_var parameter = lg_parameter(tape, lg_shape1((uint32_t)fit.parameters), theta);
    assert_ok(fit.loss(fit.user, tape, parameter, samples, N, N, &loss));
    assert_ok(lg_read(tape, loss, &value, 1));
    if (gradient != NULL) {
        memset(gradient, 0, fit.parameters * sizeof *gradient);
        void *out = gradient;
        assert_ok(lg_backward(tape, loss, &parameter, 1, &out));
    }
    lg_tape_destroy(tape);
    return value;
}

/* The exact chain: linear potential with weights (k - i) e3, Gamma upper-right triangular of ones: Gamma^T
 * Gamma has entries k - max(i, j) when Gamma_lj = 1 for l + j < k. */
static void exact_chain(size_t k, lg_hamiltonian *model, double *theta) {
    assert_ok(lg_hamiltonian_init(model, &lg_hamiltonian_chain, (uint32_t)k, LG_POTENTIAL_LINEAR, NULL, 0,
                                  LG_TANH));
    memset(theta, 0, lg_hamiltonian_parameters(model) * sizeof *theta);
    for (size_t i = 0; i < k; i++) {
        theta[3 * i + 2] = (double)(k - i);
        for (size_t l = 0; l < k; l++) theta[3 * k + l * k + i] = l + i < k ? 1.0 : 0.0;
    }
}

static void exact_chain_has_the_true_energy_and_field(void **state) {
    (void)state;
    for (size_t k = 1; k <= 3; k++) {
        data set;
        lg_hamiltonian model;
        double theta[64], field[18], expected[18];
        make_data(&set, "pendulum-chain", k);
        exact_chain(k, &model, theta);
        built b;
        void *system_work = NULL;
        build_from(&b, &model, theta);
        assert_int_equal(posix_memalign(&system_work, 64, lg_system_work_size(set.system)), 0);
        lg_system_user user;
        lg_ode ode;
        assert_ok(lg_system_ode(set.system, LG_COORDINATES_LIE, &user, system_work, &ode));
        for (size_t i = 0; i < N; i++) {
            const double *y = set.y + i * M * set.d;
            assert_close(energy_of(&b, y), set.H[i], 1e-13, 1e-13);
            assert_ok(lg_model_field(b.model, y, NULL, field, b.work));
            assert_ok(ode.field(ode.user, 0.0, y, NULL, expected));
            for (size_t j = 0; j < set.d; j++) assert_close(field[j], expected[j], 1e-12, 1e-12);
        }
        build_free(&b);
        free(system_work);
        free_data(&set);
    }
}

/* What is left of the loss is the integrator's error: it falls with the order. RK4 tests the extension off
 * the manifold. */
static void exact_chain_has_the_integrators_loss(void **state) {
    (void)state;
    static const struct {
        const char *name;
        double bound;
    } row[] = {{"cf4", 1e-16}, {"rkmk4", 1e-16}, {"rk4", 1e-13}, {"lie-euler", 1e-4}, {"euler", 1e-4}};
    for (size_t k = 1; k <= 3; k++) {
        data set;
        lg_hamiltonian model;
        double theta[64];
        make_data(&set, "pendulum-chain", k);
        exact_chain(k, &model, theta);
        for (size_t r = 0; r < LG_COUNT(row); r++) {
            lg_hamiltonian_problem problem = problem_of(&model, &set, row[r].name);
            const double one = loss_of(&problem, theta, NULL);
            problem.substeps = 2;
            const double two = loss_of(&problem, theta, NULL);
            assert_true(one <= row[r].bound);
            /* squared error of a method of order p falls by 4^p; rounding floor 1e-31 */
            const double order = row[r].bound == 1e-4 ? 1.0 : 4.0;
            if (one > 1e-24) assert_true(two < one * pow(0.25, order) * 1.6);
        }
        free_data(&set);
    }
}

/* Off the manifold the extension of the learned Hamiltonian is that of the true one: with long steps, whose
 * stages lie far from it, RK4 on the tape makes the points that RK4 makes of the true ambient field. */
static void exact_chain_leaves_the_manifold_as_the_true_one(void **state) {
    (void)state;
    for (size_t k = 1; k <= 3; k++) {
        data set;
        lg_hamiltonian model;
        double theta[64];
        make_data(&set, "pendulum-chain", k);
        exact_chain(k, &model, theta);
        double *work = NULL;
        assert_int_equal(posix_memalign((void **)&work, 64, lg_system_work_size(set.system)), 0);
        lg_system_user user;
        lg_ode ode;
        lg_stepper *stepper;
        assert_ok(lg_system_ode(set.system, LG_COORDINATES_AMBIENT, &user, work, &ode));
        assert_ok(lg_stepper_create(NULL, lg_scheme_find("rk4"), &ode, &stepper));
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j + 1 < M; j++) {
                double *y = set.y + (i * M + j) * set.d;
                assert_ok(lg_step(stepper, 0.0, 0.3, y, NULL, y + set.d));
            }
        lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
        problem.dt = 0.3;
        assert_true(loss_of(&problem, theta, NULL) < 1e-24);
        lg_stepper_destroy(NULL, stepper);
        free(work);
        free_data(&set);
    }
}

/* A negative b is a zero b, a positive one adds to the mass: p^2/(2 m) by hand for one link. */
static void masses_are_not_negative(void **state) {
    (void)state;
    static const double b[] = {-0.7, 0.0, 0.5}, mass[] = {0.64, 0.64, 1.14};
    const double y[6] = {0.0, 0.6, 0.8, 2.0, 0.0, 0.0};
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    for (size_t i = 0; i < sizeof b / sizeof *b; i++) {
        const double theta[5] = {0.0, 0.0, 1.0, 0.8, b[i]};
        double gradient[6], energy;
        built made;
        build_from(&made, &model, theta);
        assert_close(energy_of(&made, y), 2.0 / mass[i] + 0.8, 1e-14, 0.0);
        lg_model_jacobian(made.model, y, &energy, gradient, made.work);
        assert_close(energy, energy_of(&made, y), 1e-15, 0.0);
        assert_close(gradient[3], 2.0 / mass[i], 1e-14, 0.0);
        build_free(&made);
    }
}

static void gradient_matches_differences(const lg_hamiltonian_problem *problem, double *theta, size_t n) {
    double *gradient = malloc(n * sizeof *gradient);
    (void)loss_of(problem, theta, gradient);
    double largest = 0.0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(gradient[i]));
    assert_true(largest > 0.0);
    for (size_t i = 0; i<n; i += n> 60 ? 37 : 1) {
        const double kept = theta[i], h = 1e-5;
        theta[i] = kept + h;
        const double up = loss_of(problem, theta, NULL);
        theta[i] = kept - h;
        const double down = loss_of(problem, theta, NULL);
        theta[i] = kept;
        assert_close(gradient[i], (up - down) / (2.0 * h), 1e-6, 1e-7 * largest);
    }
    free(gradient);
}

static void loss_gradients(void **state) {
    (void)state;
    static const struct {
        const char *system;
        size_t links;
        const lg_hamiltonian_family *family;
        const char *integrator;
        double penalty;
        lg_penalty_form form;
    } row[] = {
        {"pendulum-chain", 1, &lg_hamiltonian_chain, "cf4", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 1, &lg_hamiltonian_chain, "rk4", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 2, &lg_hamiltonian_chain, "cf4", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 2, &lg_hamiltonian_chain, "rkmk4", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 2, &lg_hamiltonian_chain, "rk4", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 3, &lg_hamiltonian_chain, "euler", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"pendulum-chain", 3, &lg_hamiltonian_chain, "lie-euler", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"quartic", 2, &lg_hamiltonian_separable, "stormer-verlet", 0.0, LG_PENALTY_MEAN_SQUARE},
        {"coupled-oscillators", 2, &lg_hamiltonian_separable, "stormer-verlet", 0.7, LG_PENALTY_MEAN_SQUARE},
        {"coupled-oscillators", 2, &lg_hamiltonian_separable, "rk4", 1e-3, LG_PENALTY_SUM_ABSOLUTE},
    };
    const uint32_t hidden[2] = {7, 5};
    for (size_t r = 0; r < LG_COUNT(row); r++) {
        data set;
        lg_hamiltonian model;
        lg_rng rng;
        make_data(&set, row[r].system, row[r].links);
        assert_ok(lg_hamiltonian_init(&model, row[r].family, (uint32_t)row[r].links, LG_POTENTIAL_MLP, hidden,
                                      2, LG_TANH));
        const size_t n = lg_hamiltonian_parameters(&model);
        double *theta = malloc(n * sizeof *theta);
        lg_rng_seed(&rng, 11, r);
        lg_hamiltonian_initialise(&model, &rng, theta);
        if (row[r].family == &lg_hamiltonian_chain) theta[n - 1] = -0.3; /* max(0, b) on its zero branch */
        lg_hamiltonian_problem problem = problem_of(&model, &set, row[r].integrator);
        problem.penalty = row[r].penalty;
        problem.penalty_form = row[r].form;
        gradient_matches_differences(&problem, theta, n);
        free(theta);
        free_data(&set);
    }
}

/* mu mean sum (G - G0)^2 and mu sum |2 (G - G0)| against numbers from the predicted points themselves. */
static void penalty_is_what_it_says(void **state) {
    (void)state;
    data set;
    lg_hamiltonian model;
    const uint32_t hidden[1] = {6};
    double theta[64];
    lg_rng rng;
    make_data(&set, "coupled-oscillators", 2);
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    lg_rng_seed(&rng, 2, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    const double plain = loss_of(&problem, theta, NULL);

    /* The same prediction by the plain interpreter. */
    built b;
    build_from(&b, &model, theta);
    const lg_scheme *rk4 = lg_scheme_find("rk4");
    double squares = 0.0, absolute = 0.0, mse = 0.0;
    for (size_t i = 0; i < N; i++) {
        double y[4], k[4][4], z[4];
        memcpy(y, set.y + i * M * 4, sizeof y);
        const double G0 = 0.5 * (y[0] * y[0] + y[2] * y[2]);
        for (size_t j = 1; j < M; j++) {
            for (int s = 0; s < 4; s++) {
                for (int c = 0; c < 4; c++) {
                    z[c] = y[c];
                    for (int l = 0; l < s; l++) z[c] += problem.dt * rk4->a[s][l] * k[l][c];
                }
                assert_ok(lg_model_field(b.model, z, NULL, k[s], b.work));
            }
            for (int c = 0; c < 4; c++)
                for (int l = 0; l < 4; l++) y[c] += problem.dt * rk4->b[l] * k[l][c];
            const double G = 0.5 * (y[0] * y[0] + y[2] * y[2]);
            squares += (G - G0) * (G - G0);
            absolute += 2.0 * fabs(G - G0);
            for (int c = 0; c < 4; c++) {
                const double e = y[c] - set.y[(i * M + j) * 4 + (size_t)c];
                mse += e * e / (N * (M - 1) * 4.0);
            }
        }
    }
    assert_close(plain, mse, 1e-12, 0.0);
    problem.penalty = 0.5;
    assert_close(loss_of(&problem, theta, NULL), mse + 0.5 * squares / N, 1e-12, 0.0);
    problem.penalty_form = LG_PENALTY_SUM_ABSOLUTE;
    assert_close(loss_of(&problem, theta, NULL), mse + 0.5 * absolute, 1e-12, 0.0);
    build_free(&b);
    free_data(&set);
}

/* Of every family: dH along the group action, where H is defined. */
static void gradient_matches_differences_of_the_value(void **state) {
    (void)state;
    static const uint32_t copies[] = {1, 2, 4};
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (size_t k = 0; k < sizeof copies / sizeof *copies; k++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], gradient[MOST_STATE], energy;
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), copies[k], LG_POTENTIAL_MLP, LG_SWISH);
            const lg_space space = space_of(&b);
            lg_rng_seed(&rng, 4, k);
            draw_state(&b, &rng, y);
            lg_model_jacobian(b.model, y, &energy, gradient, b.work);
            assert_close(energy, energy_of(&b, y), 1e-14, 0.0);
            for (size_t a = 0; a < space.algebra_dim; a++) {
                double element[MOST_STATE] = {0}, up[MOST_STATE], down[MOST_STATE], velocity[MOST_STATE];
                const double h = 1e-5;
                double got = 0.0;
                element[a] = h;
                lg_space_act(&space, element, y, up);
                element[a] = -h;
                lg_space_act(&space, element, y, down);
                element[a] = 1.0;
                lg_space_generator(&space, element, y, velocity);
                for (size_t i = 0; i < space.dim; i++) got += gradient[i] * velocity[i];
                assert_close(got, (energy_of(&b, up) - energy_of(&b, down)) / (2.0 * h), 1e-7, 1e-8);
            }
            build_free(&b);
        }
}

/* What the row's field makes of dH at y: y', (d). */
static void driven_by(const lg_hamiltonian_family *family, const lg_space *space, const double *y,
                      const double *dH, double *velocity) {
    lg_tape *tape;
    lg_var parts[LG_HAMILTONIAN_MAX_PARTS], slopes[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    const lg_shape shape = lg_shape2(1, (uint32_t)space->dim);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, y), parts));
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, dH), slopes));
    family->field(tape, parts, slopes, LG_NONE, out);
    assert_ok(lg_taped_generator(tape, space, out, parts, out));
    assert_ok(lg_read(tape, lg_taped_join(tape, space, out), velocity, space->dim));
    lg_tape_destroy(tape);
}

static void check_system(const lg_system *system) {
    size_t n;
    lg_space space;
    lg_system_user user;
    lg_ode ode;
    lg_rng rng;
    const lg_hamiltonian_family *family = lg_hamiltonian_family_for(system, &n);
    if (family == NULL || family->off_manifold != NULL) return;
    double y[MOST_STATE], dH[MOST_STATE], velocity[MOST_STATE], algebra[MOST_STATE], expected[MOST_STATE];
    double *work = malloc(lg_system_work_size(system));
    assert_ok(lg_hamiltonian_space(family, (uint32_t)n, &space));
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &user, work, &ode));
    lg_rng_seed(&rng, 17, n);
    for (size_t i = 0; i < space.dim; i++) y[i] = lg_rng_uniform_in(&rng, 0.2, 1.2);
    for (size_t i = 0; i < space.dim; i++) {
        const double kept = y[i], h = 1e-5;
        y[i] = kept + h;
        const double up = lg_system_hamiltonian(system, y, work);
        y[i] = kept - h;
        dH[i] = (up - lg_system_hamiltonian(system, y, work)) / (2.0 * h);
        y[i] = kept;
    }
    driven_by(family, &space, y, dH, velocity);
    assert_ok(ode.field(ode.user, 0.0, y, NULL, algebra));
    lg_space_generator(&ode.space, algebra, y, expected);
    for (size_t i = 0; i < space.dim; i++) assert_close(velocity[i], expected[i], 1e-8, 1e-8);
    free(work);
}

/* Of every family without constraints and every system that it learns: the true energy drives the row's field
 * as the system moves. Chains: exact_chain_has_the_true_energy_and_field. */
static void true_energies_drive_the_true_motion(void **state) {
    (void)state;
    const char *name, *form;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        lg_system_options options;
        lg_system *system;
        lg_system_options_init(&options);
        options.form = form;
        if (lg_system_create(NULL, name, &options, &system, NULL) != LG_OK) continue;
        check_system(system);
        lg_system_destroy(NULL, system);
    }
}

/* Whatever the seed, no start has a nearly singular mass. Of one link m = Gamma^2 + b. */
static void starts_have_a_mass(void **state) {
    (void)state;
    lg_hamiltonian model;
    double theta[3 + 2], least = INFINITY, largest = 0.0;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    for (uint64_t seed = 0; seed < 5000; seed++) {
        lg_rng rng;
        lg_rng_seed(&rng, seed, 1);
        lg_hamiltonian_initialise(&model, &rng, theta);
        const double m = theta[3] * theta[3] + theta[4];
        assert_true(theta[3] >= 0.0 && theta[3] < 1.0 && theta[4] >= 0.0 && theta[4] < 1.0);
        least = fmin(least, m);
        largest = fmax(largest, m);
    }
    assert_true(least >= LG_HAMILTONIAN_LEAST_PIVOT && least < 1.1 * LG_HAMILTONIAN_LEAST_PIVOT);
    assert_true(largest > 1.8);
}

/* m = Gamma^T Gamma + diag(max(0, b)) by hand; none for separable systems. */
static void mass_by_hand(void **state) {
    (void)state;
    lg_hamiltonian model;
    /* V linear: 9 weights; Gamma rows (1, 2, 0), (0, 1, 3), (2, 0, 1); b = (0.5, -4, 0). */
    double theta[21] = {0.0}, m[9];
    const double gamma[9] = {1, 2, 0, 0, 1, 3, 2, 0, 1}, b[3] = {0.5, -4, 0};
    const double want[9] = {5.5, 2, 2, 2, 5, 3, 2, 3, 10};
    memcpy(theta + 9, gamma, sizeof gamma);
    memcpy(theta + 18, b, sizeof b);
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 3, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    assert_ok(lg_hamiltonian_mass(&model, theta, m));
    for (size_t i = 0; i < 9; i++) assert_close(m[i], want[i], 1e-15, 0.0);
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    assert_int_equal(lg_hamiltonian_mass(&model, theta, m), LG_UNSUPPORTED);
}

/* Five parameters, full batch: Newton reaches the same floor from two starts, and the gradient is rounding
 * there. */
static void newton_reaches_the_floor(void **state) {
    (void)state;
    data set;
    lg_hamiltonian model;
    make_data(&set, "pendulum-chain", 1);
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    lg_fit_problem fit;
    lg_hamiltonian_fit_problem(&problem, &fit);
    double theta[2][5] = {{0.3, -0.2, 0.4, 0.7, 0.3}, {-0.5, 0.1, 0.2, 0.9, 0.6}};
    lg_newton_result result[2];
    for (int i = 0; i < 2; i++) {
        const double before = loss_of(&problem, theta[i], NULL);
        assert_ok(lg_newton_fit(NULL, &fit, NULL, theta[i], &result[i]));
        assert_true(result[i].loss < 1e-9 * before);
    }
    assert_close(result[0].loss, result[1].loss, 1e-6, 0.0);
    for (int j = 0; j < 3; j++) assert_close(theta[0][j], theta[1][j], 0.0, 1e-10);
    fit.parameters = LG_NEWTON_MAX_PARAMETERS + 1;
    assert_status(lg_newton_fit(NULL, &fit, NULL, theta[0], NULL), LG_INVALID_ARGUMENT);
    free_data(&set);
}

static void bad_problems(void **state) {
    (void)state;
    lg_hamiltonian chain;
    lg_error error;
    const uint32_t hidden[1] = {4}, zero[1] = {0};
    const double y[24] = {0};
    assert_ok(lg_hamiltonian_init(&chain, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    const lg_hamiltonian_problem good = {.model = &chain,
                                         .scheme = lg_scheme_find("cf4"),
                                         .substeps = 1,
                                         .trajectories = 1,
                                         .points = 2,
                                         .dt = 0.1,
                                         .data = y};
    assert_ok(lg_hamiltonian_problem_check(&good, &error));
#define REFUSED(change, status)                                                                              \
    do {                                                                                                     \
        lg_hamiltonian_problem bad = good;                                                                   \
        change;                                                                                              \
        error.message[0] = '\0';                                                                             \
        assert_status(lg_hamiltonian_problem_check(&bad, &error), status);                                   \
        assert_true(error.message[0] != '\0');                                                               \
    } while (0)
    REFUSED(bad.points = 1, LG_INVALID_ARGUMENT);
    REFUSED(bad.points = LG_HAMILTONIAN_MAX_POINTS + 1, LG_INVALID_ARGUMENT);
    REFUSED(bad.dt = 0.0, LG_INVALID_ARGUMENT);
    REFUSED(bad.dt = NAN, LG_INVALID_ARGUMENT);
    REFUSED(bad.substeps = 0, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty = -1.0, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty = 1.0, LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("stormer-verlet"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("variational"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("slgi"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("rk4-projected"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = NULL, LG_INVALID_ARGUMENT);
    REFUSED(bad.data = NULL, LG_INVALID_ARGUMENT);
    lg_hamiltonian model;
    assert_status(
        lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 0, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH),
        LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, LG_HAMILTONIAN_MAX_COPIES + 1,
                                      LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, zero, 1, LG_TANH),
                  LG_INVALID_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exact_chain_has_the_true_energy_and_field),
        cmocka_unit_test(exact_chain_has_the_integrators_loss),
        cmocka_unit_test(exact_chain_leaves_the_manifold_as_the_true_one),
        cmocka_unit_test(masses_are_not_negative),
        cmocka_unit_test(loss_gradients),
        cmocka_unit_test(penalty_is_what_it_says),
        cmocka_unit_test(gradient_matches_differences_of_the_value),
        cmocka_unit_test(true_energies_drive_the_true_motion),
        cmocka_unit_test(starts_have_a_mass),
        cmocka_unit_test(mass_by_hand),
        cmocka_unit_test(newton_reaches_the_floor),
        cmocka_unit_test(bad_problems),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
