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

static void release_system(void *system) {
    lg_system_destroy(system);
}

static data make_data(const char *name, size_t links) {
    data set;
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
    assert_ok(lg_system_create(NULL, name, &so, &set.system, NULL));
    lg_test_owns(set.system, release_system);
    set.d = lg_system_dim(set.system);
    set.y = room(N * M * set.d);
    lg_trajectory_options_init(&to);
    to.trajectories = N;
    to.points = M;
    to.t_end = 0.06;
    to.seed = 3;
    assert_ok(lg_generate_trajectories(NULL, set.system, &to, set.t, set.y, set.H, NULL));
    return set;
}

static lg_hamiltonian_problem problem_of(const lg_hamiltonian *model, const data *set,
                                         const char *integrator) {
    lg_hamiltonian_problem problem = {
        .model = model, .substeps = 1, .trajectories = N, .points = M, .dt = set->t[1], .data = set->y};
    problem.scheme = lg_scheme_find(integrator);
    assert_ok(lg_hamiltonian_problem_check(&problem, NULL));
    return problem;
}

/* Loss of the whole set. */
static double loss_of(const lg_hamiltonian_problem *problem, const double *theta) {
    uint32_t samples[N];
    lg_fit_problem fit;
    lg_tape *tape = test_tape(LG_F64);
    lg_var loss;
    double value;
    for (uint32_t i = 0; i < N; i++) samples[i] = i;
    lg_hamiltonian_fit_problem(problem, &fit);
    const lg_var parameter = lg_parameter(tape, lg_shape1((uint32_t)fit.parameters), theta);
    assert_ok(fit.loss(fit.user, tape, parameter, samples, N, N, &loss));
    assert_ok(lg_read(tape, loss, 1, &value));
    return value;
}

/* The exact chain and data of the true one: linear potential with weights (k - i) e3, Gamma upper-right
 * triangular of ones: Gamma^T Gamma has entries k - max(i, j) when Gamma_lj = 1 for l + j < k. */
typedef struct exact {
    data set;
    lg_hamiltonian model;
    double theta[64];
} exact;

static exact exact_chain(size_t k) {
    exact e = {.set = make_data("pendulum-chain", k)};
    assert_ok(lg_hamiltonian_init(&e.model, &lg_hamiltonian_chain, (uint32_t)k, LG_POTENTIAL_LINEAR, NULL, 0,
                                  LG_TANH));
    for (size_t i = 0; i < k; i++) {
        e.theta[3 * i + 2] = (double)(k - i);
        for (size_t l = 0; l < k; l++) e.theta[3 * k + l * k + i] = l + i < k ? 1.0 : 0.0;
    }
    return e;
}

static lg_ode ode_of(const lg_system *system, lg_coordinates coordinates, lg_system_user *user) {
    lg_ode ode;
    assert_ok(lg_system_ode(system, coordinates, &ode, user, test_work(lg_system_work_size(system))));
    return ode;
}

TEST("an exact chain has the true energy and field") {
    for (size_t k = 1; k <= 3; k++) {
        const exact e = exact_chain(k);
        const built b = build_from(&e.model, e.theta);
        double field[18], expected[18];
        lg_system_user user;
        const lg_ode ode = ode_of(e.set.system, LG_COORDINATES_LIE, &user);
        for (size_t i = 0; i < N; i++) {
            const double *y = e.set.y + i * M * e.set.d;
            assert_close(energy_of(&b, y), e.set.H[i], 1e-13, 1e-13);
            assert_ok(lg_model_field(b.model, y, NULL, field, b.work));
            assert_ok(ode.field(ode.user, 0.0, y, NULL, expected));
            for (size_t j = 0; j < e.set.d; j++) assert_close(field[j], expected[j], 1e-12, 1e-12);
        }
    }
}

TEST("of an exact chain the loss is the integrator's error, which falls with its order") {
    static const struct {
        const char *name;
        double bound;
    } row[] = {{"cf4", 1e-16}, {"rkmk4", 1e-16}, {"rk4", 1e-13}, {"lie-euler", 1e-4}, {"euler", 1e-4}};
    for (size_t k = 1; k <= 3; k++) {
        const exact e = exact_chain(k);
        for (size_t r = 0; r < LG_COUNT(row); r++) {
            lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, row[r].name);
            const double one = loss_of(&problem, e.theta);
            problem.substeps = 2;
            const double two = loss_of(&problem, e.theta);
            assert_true(one <= row[r].bound);
            /* squared error of a method of order p falls by 4^p; rounding floor 1e-31 */
            const double order = row[r].bound == 1e-4 ? 1.0 : 4.0;
            if (one > 1e-24) assert_true(two < one * pow(0.25, order) * 1.6);
        }
    }
}

/* Off the manifold the extension of the learned Hamiltonian is that of the true one: with long steps, whose
 * stages lie far from it, RK4 on the tape makes the points that RK4 makes of the true ambient field. */
TEST("an exact chain leaves the manifold as the true one") {
    for (size_t k = 1; k <= 3; k++) {
        const exact e = exact_chain(k);
        lg_system_user user;
        const lg_ode ode = ode_of(e.set.system, LG_COORDINATES_AMBIENT, &user);
        lg_stepper *stepper = test_stepper(lg_scheme_find("rk4"), &ode);
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j + 1 < M; j++) {
                double *y = e.set.y + (i * M + j) * e.set.d;
                assert_ok(lg_step(stepper, 0.0, 0.3, y, NULL, y + e.set.d));
            }
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "rk4");
        problem.dt = 0.3;
        assert_true(loss_of(&problem, e.theta) < 1e-24);
    }
}

TEST("a negative b is a zero b, and a positive one adds to the mass") {
    static const double b[] = {-0.7, 0.0, 0.5}, mass[] = {0.64, 0.64, 1.14};
    const double y[6] = {0.0, 0.6, 0.8, 2.0, 0.0, 0.0};
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    for (size_t i = 0; i < LG_COUNT(b); i++) {
        const double theta[5] = {0.0, 0.0, 1.0, 0.8, b[i]};
        double gradient[6], energy;
        const built made = build_from(&model, theta);
        assert_close(energy_of(&made, y), 2.0 / mass[i] + 0.8, 1e-14, 0.0);
        lg_model_jacobian(made.model, y, &energy, gradient, made.work);
        assert_close(energy, energy_of(&made, y), 1e-15, 0.0);
        assert_close(gradient[3], 2.0 / mass[i], 1e-14, 0.0);
    }
}

TEST("both penalties are those of the predicted points") {
    data set = make_data("coupled-oscillators", 2);
    lg_hamiltonian model;
    const uint32_t hidden[1] = {6};
    double theta[64];
    lg_rng rng;
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    lg_rng_seed(&rng, 2, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    const double plain = loss_of(&problem, theta);

    /* The same prediction by the plain interpreter. */
    const built b = build_from(&model, theta);
    lg_stepper *stepper = stepper_of(&b, lg_scheme_find("rk4"));
    double squares = 0.0, absolute = 0.0, mse = 0.0;
    for (size_t i = 0; i < N; i++) {
        double y[4];
        memcpy(y, set.y + i * M * 4, sizeof y);
        const double G0 = 0.5 * (y[0] * y[0] + y[2] * y[2]);
        for (size_t j = 1; j < M; j++) {
            assert_ok(lg_step(stepper, 0.0, problem.dt, y, NULL, y));
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
    assert_close(loss_of(&problem, theta), mse + 0.5 * squares / N, 1e-12, 0.0);
    problem.penalty_form = LG_PENALTY_SUM_ABSOLUTE;
    assert_close(loss_of(&problem, theta), mse + 0.5 * absolute, 1e-12, 0.0);
}

TEST("of every family the gradient is the difference of the value along the group action") {
    for (size_t m = 0; m < motions(); m++) {
        const moving s = make_motion(m, LG_POTENTIAL_MLP, LG_SWISH);
        const lg_space space = space_of(&s.b);
        double gradient[MOST_STATE], energy;
        lg_model_jacobian(s.b.model, s.y, &energy, gradient, s.b.work);
        assert_close(energy, energy_of(&s.b, s.y), 1e-14, 0.0);
        for (size_t a = 0; a < space.algebra_dim; a++) {
            double element[MOST_STATE] = {0}, up[MOST_STATE], down[MOST_STATE], velocity[MOST_STATE];
            const double h = 1e-5;
            double got = 0.0;
            element[a] = h;
            lg_space_act(&space, element, s.y, up);
            element[a] = -h;
            lg_space_act(&space, element, s.y, down);
            element[a] = 1.0;
            lg_space_generator(&space, element, s.y, velocity);
            for (size_t i = 0; i < space.dim; i++) got += gradient[i] * velocity[i];
            assert_close(got, (energy_of(&s.b, up) - energy_of(&s.b, down)) / (2.0 * h), 1e-7, 1e-8);
        }
    }
}

/* What the row's field makes of dH at y: y', (d). */
static void driven_by(const lg_hamiltonian_family *family, const lg_space *space, const double *y,
                      const double *dH, double *velocity) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var parts[LG_HAMILTONIAN_MAX_PARTS], slopes[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    const lg_shape shape = lg_shape2(1, (uint32_t)space->dim);
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, y), parts));
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, dH), slopes));
    family->field(tape, parts, slopes, LG_NONE, out);
    assert_ok(lg_taped_generator(tape, space, out, parts, out));
    assert_ok(lg_read(tape, lg_taped_join(tape, space, out), space->dim, velocity));
}

static void check_system(const lg_system *system) {
    size_t n;
    lg_space space;
    lg_system_user user;
    lg_rng rng;
    const lg_hamiltonian_family *family = lg_hamiltonian_family_for(system, &n);
    if (family == NULL || family->off_manifold != NULL) return;
    double y[MOST_STATE], dH[MOST_STATE], velocity[MOST_STATE], algebra[MOST_STATE], expected[MOST_STATE];
    void *work = test_work(lg_system_work_size(system));
    assert_ok(lg_hamiltonian_space(family, (uint32_t)n, &space));
    const lg_ode ode = ode_of(system, LG_COORDINATES_LIE, &user);
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
}

TEST("of every family and every system that it learns the true energy drives the true motion") {
    const char *name, *form;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        lg_system_options options;
        lg_system *system;
        lg_system_options_init(&options);
        options.form = form;
        if (lg_system_create(NULL, name, &options, &system, NULL) != LG_OK) continue;
        lg_test_owns(system, release_system);
        check_system(system);
    }
}

TEST("every family has all of its words, and a name of its own") {
    const lg_hamiltonian_family *row;
    for (size_t i = 0; (row = lg_hamiltonian_family_at(i)) != NULL; i++) {
        const char *const words[] = {row->name,        row->description, row->copy,   row->state_units,
                                     row->energy_unit, row->layout[0],   row->formula};
        for (size_t w = 0; w < LG_COUNT(words); w++) assert_true(words[w] != NULL && words[w][0] != '\0');
        assert_true((row->off_manifold == NULL) == (row->manifold == NULL));
        assert_ptr_equal(lg_hamiltonian_family_find(row->name), row);
    }
}

/* Random states as data: the loss of training with the family's scheme, recorded. */
static double loss_by_default(const moving *s, const lg_scheme *scheme) {
    data set = {.d = s->d, .t = {0.0, 0.02}, .y = room(N * M * s->d)};
    lg_error error = {LG_OK, ""};
    lg_rng rng;
    lg_rng_seed(&rng, 5, 1);
    for (size_t i = 0; i < N * M; i++) draw_state(&s->b, &rng, set.y + i * s->d);
    const lg_hamiltonian_problem problem = {.model = &s->b.hamiltonian,
                                            .scheme = scheme,
                                            .substeps = 1,
                                            .trajectories = N,
                                            .points = M,
                                            .dt = set.t[1],
                                            .data = set.y};
    if (lg_hamiltonian_problem_check(&problem, &error) != LG_OK) fail_msg("%s", error.message);
    return loss_of(&problem, s->b.theta);
}

TEST("of every family the default scheme trains, steps and is a program, the accurate one estimates") {
    for (size_t m = 0; m < motions(); m++) {
        const moving s = make_motion(m, LG_POTENTIAL_MLP, LG_TANH);
        const lg_hamiltonian_family *family = s.b.hamiltonian.family;
        const lg_scheme *schemes[] = {lg_scheme_find(family->scheme), lg_scheme_find(family->accurate)};
        lg_program *program;
        lg_error error = {LG_OK, ""};
        assert_true(schemes[0] != NULL && schemes[1] != NULL && schemes[1]->embedded_order > 0);
        assert_true(isfinite(loss_by_default(&s, schemes[0])));
        if (lg_hamiltonian_program(NULL, &s.b.hamiltonian, s.b.theta, NULL, &program, &error) != LG_OK)
            fail_msg("%s: %s", family->name, error.message);
        lg_program_destroy(program);
        for (size_t i = 0; i < LG_COUNT(schemes); i++) {
            double next[MOST_STATE];
            assert_ok(lg_step(stepper_of(&s.b, schemes[i]), 0.0, 0.01, s.y, s.u, next));
        }
    }
}

TEST("whatever the seed, no start has a nearly singular mass") {
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
TEST("the mass is Gamma^T Gamma + diag(max(0, b)), and separable systems have none") {
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

TEST("Newton reaches the same floor from two starts") {
    data set = make_data("pendulum-chain", 1);
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    lg_fit_problem fit;
    lg_hamiltonian_fit_problem(&problem, &fit);
    double theta[2][5] = {{0.3, -0.2, 0.4, 0.7, 0.3}, {-0.5, 0.1, 0.2, 0.9, 0.6}};
    lg_newton_result result[2];
    for (int i = 0; i < 2; i++) {
        const double before = loss_of(&problem, theta[i]);
        assert_ok(lg_newton_fit(NULL, &fit, NULL, theta[i], &result[i]));
        assert_true(result[i].loss < 1e-9 * before);
    }
    assert_close(result[0].loss, result[1].loss, 1e-6, 0.0);
    for (int j = 0; j < 3; j++) assert_close(theta[0][j], theta[1][j], 0.0, 1e-10);
    fit.parameters = LG_NEWTON_MAX_PARAMETERS + 1;
    assert_status(lg_newton_fit(NULL, &fit, NULL, theta[0], NULL), LG_INVALID_ARGUMENT);
}

TEST("bad problems and models are refused") {
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
