/* Learned Hamiltonians: exact parameters reproduce the true system; losses and their gradients.
 * ctest-labels: src/hamiltonian src/model */
#include "autodiff/compiled.h"
#include "autodiff/program_support.h"
#include "support/model_support.h"
#include "support/narrow_tape.h"

#include "liegrad/mechanics.h"
#include "liegrad/ops.h"
#include "hamiltonian/internal.h"

enum { N = 12, M = 4 };

typedef struct data {
    lg_system *system;
    size_t d;
    double t[M], *y, H[N];
} data;

RELEASES(release_system, lg_system_destroy)

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
    assert_ok(lg_system_generate(NULL, set.system, &to, set.t, set.y, set.H, NULL));
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

/* The loss of the whole data set. */
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

/* The exact parameters of a chain, and data of the true chain. The potential is linear with weights (k - i)
 * e3. Gamma has Gamma_lj = 1 for l + j < k and 0 elsewhere, so that Gamma^T Gamma has the entries k - max(i,
 * j). */
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

TEST("a chain with exact parameters has the true energy and field") {
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

TEST("with exact parameters the loss is the integrator's error, which falls with its order") {
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
            /* The squared error of a method of order p falls by 4^p; rounding limits it to 1e-31. */
            const double order = row[r].bound == 1e-4 ? 1.0 : 4.0;
            if (one > 1e-24) assert_true(two < one * pow(0.25, order) * 1.6);
        }
    }
}

/* The first points are moved by exp(a_i). Estimated starts with -a_i undo this, so the loss is only the
 * distance of the moved points. */
TEST("estimated starts are exp(a_i) of the first points, which are part of the loss") {
    for (size_t k = 1; k <= 2; k++) {
        exact e = exact_chain(k);
        lg_space space;
        assert_ok(lg_hamiltonian_space(e.model.family, e.model.n, &space));
        const size_t n = lg_hamiltonian_parameters(&e.model), dim = space.algebra_dim;
        double *theta = room(n + N * dim), distance = 0;
        lg_rng rng = test_rng(4, 0);
        memcpy(theta, e.theta, n * sizeof *theta);
        for (size_t i = 0; i < N; i++) {
            double moved[12], a[12], *y = e.set.y + i * M * e.set.d;
            for (size_t j = 0; j < dim; j++) {
                a[j] = 0.1 * lg_rng_normal(&rng);
                theta[n + i * dim + j] = -a[j];
            }
            lg_space_act(&space, a, y, moved);
            for (size_t c = 0; c < e.set.d; c++) distance += (moved[c] - y[c]) * (moved[c] - y[c]);
            memcpy(y, moved, e.set.d * sizeof *y);
        }
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "cf4");
        const double measured = loss_of(&problem, theta);
        problem.starts = LG_START_ESTIMATED;
        const double mean = distance / (double)(N * M * e.set.d);
        assert_close(loss_of(&problem, theta), mean, 1e-12, 0);
        for (size_t j = 0; j < N * dim; j++) theta[n + j] = 0;
        assert_close(loss_of(&problem, theta), measured * (M - 1) / M, 1e-12, 0);
        assert_true(measured > 0.1 * mean);
    }
}

static double floor_of(const lg_hamiltonian_problem *problem, const double *theta) {
    double value;
    assert_told(lg_hamiltonian_floor(NULL, problem, theta, &value, &told));
    return value;
}

TEST("with exact parameters the floor is the loss") {
    size_t compared = 0;
    for (size_t i = 0; i < 2 * lg_scheme_count(); i++) {
        const exact e = exact_chain(1 + i % 2);
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "cf4");
        problem.scheme = lg_scheme_at(i / 2);
        if (lg_hamiltonian_problem_check(&problem, NULL) != LG_OK) continue;
        const double loss = loss_of(&problem, e.theta);
        if (loss < 1e-26) continue; /* the data have errors too */
        assert_close(floor_of(&problem, e.theta), loss, 0.1, 0.0);
        compared++;
    }
    assert_true(compared >= lg_scheme_count());
}

/* Measures the order between the last two step sizes, where the next order matters least. For order 5 these
 * lie between the next order's contribution and rounding. From order 5 on it is the better one of this result
 * and of the fit over all step sizes: the last error may be rounding, the first one too large. An order that
 * is wrong by 1 is always found. */
static void check_floor(const built *b, const lg_scheme *scheme, const double *y) {
    lg_hamiltonian_problem problem = {.model = &b->hamiltonian,
                                      .scheme = scheme,
                                      .substeps = 1,
                                      .trajectories = N,
                                      .points = 2,
                                      .dt = 1.0,
                                      .data = y};
    if (lg_hamiltonian_problem_check(&problem, NULL) != LG_OK) return;
    const bool high = scheme->order > 5;
    const uint32_t most = high ? 4 : 8;
    const double first = high ? 1e-13 * pow(most, scheme->order) : 1e-9;
    double floor = INFINITY, size[4] = {0.0}; /* log2 of errors; an implicit step that is too long has none */
    size_t n = 0;
    while (lg_hamiltonian_floor(NULL, &problem, b->theta, &floor, NULL) != LG_OK || !(floor < first * first))
        problem.dt *= scheme->order <= 2 ? 0.25 : 0.5;
    for (; problem.substeps <= most; problem.substeps *= 2)
        size[n++] = 0.5 * log2(floor_of(&problem, b->theta));
    const double last = size[n - 2] - size[n - 1], all = (size[0] - size[n - 1]) / (double)(n - 1);
    const double order =
        scheme->order >= 5 && fabs(all - scheme->order) < fabs(last - scheme->order) ? all : last;
    print_message("  %-10s %-16s dt %.2g order %.3f\n", b->hamiltonian.family->name, scheme->name, problem.dt,
                  order);
    assert_close(order, scheme->order, 0.0, high ? 0.7 : scheme->order == 5 ? 0.4 : 0.1);
}

TEST("the floor falls by 4^p with twice the substeps, p the order, for every family and scheme") {
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const built b = build_hamiltonian(lg_hamiltonian_family_at(i), 2, LG_POTENTIAL_MLP, LG_TANH);
        const size_t d = lg_model_inputs(b.model);
        double *y = room(2 * N * d);
        lg_rng rng = test_rng(4, 0);
        for (size_t k = 0; k < 2 * N; k++) draw_state(&b, &rng, y + k * d);
        for (size_t s = 0; s < lg_scheme_count(); s++) check_floor(&b, lg_scheme_at(s), y);
    }
}

/* Off the manifold the extension of the learned Hamiltonian equals that of the true one: with long steps,
 * whose stages are far from the manifold, RK4 on the tape gives the same points as RK4 of the true ambient
 * field. */
TEST("with exact parameters a chain leaves the manifold in the same way as the true one") {
    for (size_t k = 1; k <= 3; k++) {
        const exact e = exact_chain(k);
        lg_system_user user;
        const lg_ode ode = ode_of(e.set.system, LG_COORDINATES_AMBIENT, &user);
        lg_stepper *stepper = test_stepper(lg_scheme_find("rk4"), &ode);
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j + 1 < M; j++) {
                double *y = e.set.y + (i * M + j) * e.set.d;
                assert_ok(lg_stepper_step(stepper, 0.0, 0.3, y, NULL, y + e.set.d));
            }
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "rk4");
        problem.dt = 0.3;
        assert_true(loss_of(&problem, e.theta) < 1e-24);
    }
}

/* A model with V linear in the components along e3, which rotations about e3 do not change. */
static built make_upright(const lg_hamiltonian_family *family, uint32_t n) {
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, family, n, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(8, n);
    lg_hamiltonian_initialise(&model, &rng, theta);
    const uint32_t turned = 9 * n * family->bodies.rotations;
    for (uint32_t i = 0; i < family->inputs * n; i++)
        if (i < turned ? i % 9 < 6 : (i - turned) % 3 != 2) theta[i] = 0.0;
    return build_from(&model, theta);
}

/* sum pi_3 + sum (q x p)_3 of a state of a chain, a rotation or a rotation with a direction. */
static double vertical_momentum(const built *b, const double *y) {
    const size_t d = lg_model_inputs(b->model), turned = 12 * b->hamiltonian.family->bodies.rotations;
    double sum = turned > 0 ? y[11] : 0.0;
    for (size_t i = turned; i < d; i += 6) sum += y[i] * y[i + 4] - y[i + 1] * y[i + 3];
    return sum;
}

/* `count` variational steps of size h from y, to y. */
static void go_variational(const built *b, size_t count, double h, double *y) {
    const lg_space space = space_of(b);
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < count; i++) {
        lg_hamiltonian_vars vars;
        lg_var parts[LG_HAMILTONIAN_MAX_PARTS];
        lg_tape_reset(tape);
        const lg_shape shape = lg_shape1((uint32_t)lg_hamiltonian_parameters(&b->hamiltonian));
        assert_ok(lg_hamiltonian_bind(tape, &b->hamiltonian, lg_input_f64(tape, shape, b->theta), &vars));
        assert_ok(
            lg_taped_split(tape, &space, lg_input_f64(tape, lg_shape2(1, (uint32_t)space.dim), y), parts));
        assert_ok(lg_hamiltonian_variational_step(tape, &vars, &(lg_taped_span){.h = h}, parts, parts));
        assert_ok(lg_read(tape, lg_taped_join(tape, &space, parts), space.dim, y));
    }
}

TEST("variational steps keep the manifold and the vertical momentum, bound the energy, and are reversible") {
    const struct {
        const lg_hamiltonian_family *family;
        uint32_t n;
    } rows[] = {{&lg_hamiltonian_chain, 1},    {&lg_hamiltonian_chain, 3},
                {&lg_hamiltonian_rotation, 1}, {&lg_hamiltonian_rotation_direction, 1},
                {&lg_hamiltonian_pose, 1},     {&lg_hamiltonian_pose_direction, 1}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const built b = make_upright(rows[r].family, rows[r].n);
        const lg_space space = space_of(&b);
        double y[MOST_STATE], start[MOST_STATE], least = INFINITY, most = -INFINITY;
        lg_rng rng = test_rng(9, r);
        assert_ok(lg_space_draw_start(&space, NULL, &rng, y));
        memcpy(start, y, sizeof start);
        const double momentum = vertical_momentum(&b, y), energy = energy_of(&b, y);
        for (int part = 0; part < 10; part++) {
            go_variational(&b, 40, 0.02, y);
            least = fmin(least, energy_of(&b, y) - energy);
            most = fmax(most, energy_of(&b, y) - energy);
            if (rows[r].family->bodies.lines == 0) /* the axes of lines are fixed in space */
                assert_close(vertical_momentum(&b, y), momentum, 0.0, 1e-13);
            assert_true(lg_space_manifold_error(&space, y) < 1e-13);
        }
        print_message("  %s of %u: energy %.1e to %.1e\n", rows[r].family->name, rows[r].n, least, most);
        assert_true(least > -3e-3 && most < 3e-3 && most - least > 1e-9);
        go_variational(&b, 400, -0.02, y);
        for (size_t i = 0; i < space.dim; i++) assert_close(y[i], start[i], 1e-9, 1e-9);
    }
}

/* Scales other than 1: times, the first action, and positions that have a unit. */
static built in_other_units(const built *b) {
    lg_hamiltonian model = b->hamiltonian;
    model.scales.time = 0.4;
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        model.scales.part[i] = i % 2 == 1                ? 3.0 / model.scales.part[i - 1]
                               : model.family->scaled[i] ? 1.7
                                                         : 1.0;
    return build_from(&model, b->theta);
}

/* The distance of the program's step of size h from steps of the accurate scheme under the same input. */
static double step_error(const built *b, const lg_program *program, const double *y, const double *u,
                         double h) {
    enum { PIECES = 50 };
    double next[MOST_STATE], true_next[MOST_STATE], sum = 0.0;
    const double *in[] = {y, lg_model_input_dim(b->model) > 0 ? u : &h, &h};
    double *out = next;
    lg_stepper *stepper = stepper_of(b, lg_scheme_find(b->hamiltonian.family->accurate));
    const size_t d = lg_model_inputs(b->model);
    assert_ok(lg_program_eval(NULL, program, "step", 1, in, &out, NULL));
    memcpy(true_next, y, d * sizeof *y);
    for (int i = 0; i < PIECES; i++)
        assert_ok(lg_stepper_step(stepper, 0.0, h / PIECES, true_next, u, true_next));
    for (size_t i = 0; i < d; i++) sum += pow(next[i] - true_next[i], 2.0);
    return sqrt(sum);
}

TEST("programs have the variational steps of training, of order 2 under an input, in the units of the data") {
    const lg_scheme *scheme = lg_scheme_find("variational");
    for (size_t m = 0; m < motions(); m++) {
        const moving s = make_motion(m, LG_POTENTIAL_MLP, LG_TANH);
        const built other = in_other_units(&s.b);
        const double h = 0.02, zero = 0.0, none[MOST_INPUT] = {0.0}, *in[] = {s.y, s.m > 0 ? none : &h, &h};
        double next[MOST_STATE], y[MOST_STATE], *out = next;
        lg_program *program;
        const lg_status status =
            lg_hamiltonian_program(NULL, &other.hamiltonian, other.theta, scheme, &program, NULL);
        assert_int_equal(status, s.b.hamiltonian.family->ambient == NULL ? LG_UNSUPPORTED : LG_OK);
        if (status != LG_OK) continue;
        const double whole = step_error(&other, program, s.y, s.u, 0.4 * h),
                     half = step_error(&other, program, s.y, s.u, 0.2 * h);
        print_message("  %s of %u: %.1e, half the step %.1e\n", s.b.hamiltonian.family->name, s.n, whole,
                      half);
        assert_true(whole > 1e-9 && half < whole / 6.0);
        lg_program_destroy(program);
        assert_ok(lg_hamiltonian_program(NULL, &s.b.hamiltonian, s.b.theta, scheme, &program, NULL));
        assert_ok(lg_program_eval(NULL, program, "step", 1, in, &out, NULL));
        memcpy(y, s.y, sizeof y);
        go_variational(&s.b, 1, h, y);
        for (size_t i = 0; i < s.d; i++) assert_close(next[i], y[i], 1e-13, 1e-13);
        in[s.m > 0 ? 2 : 1] = &zero;
        assert_ok(lg_program_eval(NULL, program, "step", 1, in, &out, NULL));
        for (size_t i = 0; i < s.d; i++) assert_close(next[i], s.y[i], 1e-13, 1e-13);
        lg_program_destroy(program);
    }
}

TEST("families without ambient positions refuse variational steps and name a scheme") {
    const data set = make_data("quartic", 0);
    const built b = build_hamiltonian(&lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, LG_TANH);
    lg_hamiltonian_problem problem = problem_of(&b.hamiltonian, &set, "rk4");
    lg_error error = {LG_OK, ""};
    problem.scheme = lg_scheme_find("variational");
    assert_status(lg_hamiltonian_problem_check(&problem, &error), LG_UNSUPPORTED);
    assert_non_null(strstr(error.message, "stormer-verlet"));
}

/* V = (q_1^4 + q_2^4)/4 + (q_1^2 + q_2^2)/2, A^T A = (5, -1; -1, 5). */
TEST("a dictionary has the true energy and field of the quartic system") {
    const data set = make_data("quartic", 0);
    lg_hamiltonian model;
    double theta[64] = {0}, field[4], expected[4];
    lg_system_user user;
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH));
    double *A = theta + lg_hamiltonian_array_offset(&model, 0);
    theta[2] = theta[3] = 0.5, theta[6] = theta[7] = 0.25;
    A[0] = sqrt(5.0), A[1] = -1.0 / sqrt(5.0), A[3] = sqrt(5.0 - 0.2);
    const built b = build_from(&model, theta);
    const lg_ode ode = ode_of(set.system, LG_COORDINATES_AMBIENT, &user);
    for (size_t i = 0; i < N; i++) {
        const double *y = set.y + i * M * 4;
        assert_close(energy_of(&b, y), set.H[i], 1e-13, 1e-13);
        assert_ok(lg_model_field(b.model, y, NULL, field, b.work));
        assert_ok(ode.field(ode.user, 0.0, y, NULL, expected));
        for (size_t j = 0; j < 4; j++) assert_close(field[j], expected[j], 1e-12, 1e-12);
    }
}

/* V with the weight 1 for one function at a time. */
TEST("the functions of a dictionary stand in their order") {
    const double q[2] = {0.7, -1.3};
    const double y[4] = {q[0], q[1], 0.0, 0.0};
    const double expected[] = {q[0],         q[1],         q[0] * q[0],  q[1] * q[1], pow(q[0], 3),
                               pow(q[1], 3), pow(q[0], 4), pow(q[1], 4), sin(q[0]),   sin(q[1]),
                               cos(q[0]),    cos(q[1]),    q[0] * q[1]};
    lg_hamiltonian model;
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH));
    assert_int_equal(lg_hamiltonian_array_offset(&model, 0), LG_COUNT(expected));
    for (size_t i = 0; i < LG_COUNT(expected); i++) {
        double theta[LG_COUNT(expected) + 4] = {0};
        theta[i] = 1.0;
        const built b = build_from(&model, theta);
        assert_close(energy_of(&b, y), expected[i], 1e-14, 0.0);
    }
}

TEST("potentials are even or odd, and their gradients agree with differences") {
    const uint32_t hidden[1] = {5};
    static const double sign[] = {0.0, 1.0, -1.0};
    for (int potential = 0; potential < LG_POTENTIAL_KIND_COUNT; potential++)
        for (int symmetry = LG_SYMMETRY_EVEN; symmetry <= LG_SYMMETRY_ODD; symmetry++) {
            lg_hamiltonian model;
            double theta[128], gradient[4], energy;
            const double minus[4] = {-0.4, 0.9, 0.0, 0.0};
            double y[4] = {0.4, -0.9, 0.0, 0.0}, slope;
            assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, (lg_potential_kind)potential,
                                          hidden, 1, LG_TANH));
            assert_ok(lg_hamiltonian_set_symmetry(&model, (lg_symmetry)symmetry));
            lg_rng rng = test_rng(4, 0);
            lg_hamiltonian_initialise(&model, &rng, theta);
            const built b = build_from(&model, theta);
            assert_close(energy_of(&b, minus), sign[symmetry] * energy_of(&b, y), 1e-14, 1e-15);
            lg_model_jacobian(b.model, y, &energy, gradient, b.work);
            for (size_t i = 0; i < 2; i++) {
                test_slope(model_value_at, &(model_value){b.model, b.work}, y, i, 1e-5, 1, 1, &slope);
                assert_close(gradient[i], slope, 1e-7, 1e-9);
            }
        }
}

TEST("a negative b counts as zero, and a positive b adds to the mass") {
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

TEST("both penalties are computed from the predicted points") {
    data set = make_data("coupled-oscillators", 2);
    lg_hamiltonian model;
    const uint32_t hidden[1] = {6};
    double theta[64];
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    lg_rng rng = test_rng(2, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    const double plain = loss_of(&problem, theta);

    /* The same prediction by the plain stepper. */
    const built b = build_from(&model, theta);
    lg_stepper *stepper = stepper_of(&b, lg_scheme_find("rk4"));
    double squares = 0.0, absolute = 0.0, mse = 0.0;
    for (size_t i = 0; i < N; i++) {
        double y[4];
        memcpy(y, set.y + i * M * 4, sizeof y);
        const double G0 = 0.5 * (y[0] * y[0] + y[2] * y[2]);
        for (size_t j = 1; j < M; j++) {
            assert_ok(lg_stepper_step(stepper, 0.0, problem.dt, y, NULL, y));
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
    double alone;
    assert_ok(lg_hamiltonian_mean_squared_error(NULL, &problem, theta, &alone, NULL));
    assert_close(alone, mse, 1e-12, 0.0);
    problem.penalty_form = LG_PENALTY_SUM_ABSOLUTE;
    assert_close(loss_of(&problem, theta), mse + 0.5 * absolute, 1e-12, 0.0);
}

/* theta^2 + |P p - p'|^2, where P is the rotation about q x q' that moves q to q', by Rodrigues' formula. */
static double geodesic_of(const double *y, const double *z) {
    const double c = y[0] * z[0] + y[1] * z[1] + y[2] * z[2];
    double n[3], turned = 0.0, np = 0.0, s = 0.0;
    for (size_t i = 0; i < 3; i++) {
        const size_t j = (i + 1) % 3, k = (i + 2) % 3;
        n[i] = y[j] * z[k] - y[k] * z[j];
        s += n[i] * n[i];
    }
    s = sqrt(s);
    const double theta = atan2(s, c);
    for (size_t i = 0; i < 3; i++) np += n[i] / s * y[3 + i];
    for (size_t i = 0; i < 3; i++) {
        const size_t j = (i + 1) % 3, k = (i + 2) % 3;
        const double cross = (n[j] * y[3 + k] - n[k] * y[3 + j]) / s;
        const double gap = c * y[3 + i] + s * cross + (1 - c) * np * n[i] / s - z[3 + i];
        turned += gap * gap;
    }
    return theta * theta + turned;
}

/* Predictions at t = 0.3 are compared with data that end at 0.06: near the data, and far from them after a
 * shuffle. */
TEST("geodesic distances are distances along great circles, with momenta transported along them") {
    const uint32_t hidden[1] = {6};
    for (size_t far = 0; far < 2; far++) {
        data set = make_data("pendulum-chain", 2);
        lg_hamiltonian model;
        double theta[128], sum = 0.0;
        assert_ok(
            lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
        lg_rng rng = test_rng(6, 0);
        lg_hamiltonian_initialise(&model, &rng, theta);
        lg_hamiltonian_problem problem = problem_of(&model, &set, "cf4");
        problem.dt = 0.3;
        problem.distance = LG_DISTANCE_GEODESIC;
        for (size_t i = 0; far && i < N; i++)
            memcpy(set.y + (i * M + 1) * 12, set.y + ((i + 5) % N) * M * 12, 12 * sizeof(double));
        const built b = build_from(&model, theta);
        lg_stepper *stepper = stepper_of(&b, problem.scheme);
        for (size_t i = 0; i < N; i++) {
            double y[12];
            memcpy(y, set.y + i * M * 12, sizeof y);
            for (size_t j = 1; j < M; j++) {
                assert_ok(lg_stepper_step(stepper, 0.0, problem.dt, y, NULL, y));
                for (size_t c = 0; c < 12; c += 6) sum += geodesic_of(y + c, set.y + (i * M + j) * 12 + c);
            }
        }
        /* Points off the manifold count as their projections. */
        for (size_t i = 0; far && i < N; i++)
            for (size_t c = 0; c < 3; c++) set.y[(i * M + 1) * 12 + c] *= 1.1;
        assert_close(loss_of(&problem, theta), sum / (N * (M - 1) * 12.0), 1e-10, 0.0);
        double alone;
        assert_ok(lg_hamiltonian_mean_squared_error(NULL, &problem, theta, &alone, NULL));
        problem.distance = LG_DISTANCE_AMBIENT;
        assert_close(alone, loss_of(&problem, theta), 1e-12, 0.0);
    }
}

/* The squared distance of (q, p) and (q', p') on T*S^2, and its derivative by q': on a tape, as a plan, and
 * in C. */
RECORDING(record_square) {
    lg_space space;
    (void)user, (void)theta;
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
    y[0] = lg_hamiltonian_squared_distance(tape, LG_DISTANCE_GEODESIC, &space, (const double[2]){1, 1}, x,
                                           x + 2);
}

typedef void (*square_fn)(lg_program *program, const compiled *c, const double *const *in,
                          double *const *out);

static void square_by_tape(lg_program *program, const compiled *c, const double *const *in,
                           double *const *out) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var x[4], y, slope;
    for (int i = 0; i < 4; i++) x[i] = lg_input_f64(tape, lg_shape3(1, 1, 3), in[i]);
    assert_ok(record_square(NULL, tape, NULL, x, &y));
    assert_ok(lg_grad(tape, y, &x[2], 1, &slope));
    assert_ok(lg_read(tape, y, 1, out[0]));
    assert_ok(lg_read(tape, slope, 3, out[3]));
}

static void square_by_plan(lg_program *program, const compiled *c, const double *const *in,
                           double *const *out) {
    assert_ok(lg_program_eval(NULL, program, "square", 1, in, out, NULL));
    assert_ok(lg_program_eval(NULL, program, "adj1_square", 1, in, out + 1, NULL));
}

static void square_by_c(lg_program *program, const compiled *c, const double *const *in, double *const *out) {
    double *work = TEST_ARRAY(double, c->source->work_size);
    shim_of(c, "square")((const void *const *)in, (void *const *)out, work);
    shim_of(c, "adj1_square")((const void *const *)in, (void *const *)(out + 1), work);
}

static lg_program *program_of_square(void) {
    const lg_shape shape = lg_shape3(1, 1, 3);
    const lg_port in[] = {{.name = "q", .shape = shape, .shared = true, .low = 0.1, .high = 0.9},
                          {.name = "p", .shape = shape, .shared = true},
                          {.name = "q1", .shape = shape, .shared = true, .low = 0.1, .high = 0.9},
                          {.name = "p1", .shape = shape, .shared = true}};
    const lg_port out = {.name = "square"};
    const lg_function_spec function = {"square", in, 4, &out, 1, record_square, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    lg_program *program = test_program(&spec);
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "square");
    return program;
}

/* The two states are (a, p) and (b, r) with a = e3, b = (sin d, 0, -cos d), d = pi - theta. At b the geodesic
 * has the direction f = (cos theta, 0, -sin theta), and p transported to b is P p = p1 f + p2 e2. Rotating b
 * about e3 moves b along e2 by sin d, and changes P p by p2 f + p1 (cos theta - 1) e2 - p2 e1. Moving b along
 * f changes only theta. */
TEST("geodesic distances and their derivatives keep their digits up to 1e-12 from the antipode") {
    static const double gaps[] = {1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 0.5, 1.0, 2.0, 2.6};
    static const square_fn ways[] = {square_by_tape, square_by_plan, square_by_c};
    const double p[2] = {0.7, -0.4}, r[2] = {-0.9, 1.3}, one = 1.0; /* in the bases (e1, e2) and (f, e2) */
    lg_program *program = program_of_square();
    compiled code;
    const bool compiles = has_compiler();
    if (compiles && !compile_program(&code, program, "gcc", "-O1", LG_F64, false)) fail_msg("%s", code.why);
    for (size_t n = 0; n < LG_COUNT(gaps) * (compiles ? 3 : 2); n++) {
        const double d = gaps[n % LG_COUNT(gaps)], theta = acos(-1.0) - d, c = -cos(d), s = sin(d);
        const double value = theta * theta + (p[0] - r[0]) * (p[0] - r[0]) + (p[1] - r[1]) * (p[1] - r[1]);
        /* (P p - r) . (p2 f + p1 (c - 1) e2 - p2 e1), with e1.f = c. */
        const double turn = (p[0] - r[0]) * (p[1] - p[1] * c) + (p[1] - r[1]) * p[0] * (c - 1.0);
        const double a[2][3] = {{0, 0, 1}, {p[0], p[1], 0}};
        const double b[2][3] = {{s, 0, c}, {r[0] * c, r[1], -r[0] * s}};
        double found, other[3][3], g[3];
        ways[n / LG_COUNT(gaps)](program, &code, (const double *[]){a[0], a[1], b[0], b[1], &one},
                                 (double *[]){&found, other[0], other[1], g, other[2]});
        assert_close(found, value, 4e-15, 0.0);
        assert_close(g[0] * c - g[2] * s, 2.0 * theta, 1e-14, 1e-14 * fabs(g[1]));
        assert_close(g[1], 2.0 * turn / s, 1e-14, 1e-14);
    }
    if (compiles) assert_true(discard_compiled(&code));
}

TEST("geodesic distances have a gradient at 0 and between antipodes") {
    for (int antipodes = 0; antipodes < 2; antipodes++) {
        exact e = exact_chain(1);
        lg_fit_problem fit;
        const uint32_t sample = 0;
        double gradient[5] = {0}, y[6] = {0.6, 0.0, 0.8, 0.0, 0.0, 0.0}, value;
        lg_var loss;
        lg_tape *tape = test_tape(LG_F64);
        /* Without a force a pendulum at rest stays at rest. */
        for (size_t i = 0; i < 3; i++) e.theta[i] = 0.0;
        for (size_t j = 0; j < M; j++)
            for (size_t c = 0; c < 6; c++) e.set.y[6 * j + c] = antipodes && j > 0 ? -y[c] : y[c];
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "cf4");
        problem.distance = LG_DISTANCE_GEODESIC;
        lg_hamiltonian_fit_problem(&problem, &fit);
        const lg_var theta = lg_parameter(tape, lg_shape1(5), e.theta);
        assert_ok(fit.loss(fit.user, tape, theta, &sample, 1, 1, &loss));
        assert_ok(lg_read(tape, loss, 1, &value));
        assert_close(value, antipodes ? acos(-1.0) * acos(-1.0) / 6.0 : 0.0, 1e-12, 1e-28);
        void *const into[1] = {gradient};
        assert_ok(lg_backward(tape, loss, &theta, 1, into));
        for (size_t i = 0; i < 5; i++) assert_true(isfinite(gradient[i]));
    }
}

/* The Hessian of the first trajectory's loss times (1, ..., 1), for 5 parameters. */
static void curvature_of(const lg_hamiltonian_problem *problem, const double *theta, double *out) {
    static const double ones[5] = {1.0, 1.0, 1.0, 1.0, 1.0};
    const uint32_t sample = 0;
    lg_fit_problem fit;
    lg_var loss, gradient, change;
    lg_tape *tape = test_tape(LG_F64);
    lg_hamiltonian_fit_problem(problem, &fit);
    const lg_var at = lg_parameter(tape, lg_shape1(5), theta), along = lg_input(tape, lg_shape1(5), ones);
    assert_ok(fit.loss(fit.user, tape, at, &sample, 1, 1, &loss));
    assert_ok(lg_grad(tape, loss, &at, 1, &gradient));
    assert_ok(lg_jvp(tape, &gradient, 1, &at, &along, 1, &change));
    assert_ok(lg_read(tape, change, 5, out));
}

/* Tested with a pendulum at rest without a force. */
TEST("where predictions equal the data, geodesic and ambient distances have the same curvature") {
    exact e = exact_chain(1);
    const double y[6] = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
    double geodesic[5], ambient[5], largest = 0.0;
    for (size_t i = 0; i < 3; i++) e.theta[i] = 0.0;
    for (size_t j = 0; j < M; j++) memcpy(e.set.y + 6 * j, y, sizeof y);
    lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "cf4");
    curvature_of(&problem, e.theta, ambient);
    problem.distance = LG_DISTANCE_GEODESIC;
    curvature_of(&problem, e.theta, geodesic);
    for (size_t i = 0; i < 5; i++) {
        assert_close(geodesic[i], ambient[i], 1e-12, 1e-15);
        largest = fmax(largest, fabs(ambient[i]));
    }
    assert_true(largest > 1e-6);
}

/* The first integrals by their formulas, for a state y (d) with n copies. */
static double vertical_momentum_of(const double *y, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++, y += 6) sum += y[0] * y[4] - y[1] * y[3];
    return sum;
}

static double first_oscillator_of(const double *y, size_t n) {
    (void)n;
    return 0.5 * (y[0] * y[0] + y[2] * y[2]);
}

static double first_anharmonic_of(const double *y, size_t n) {
    return first_oscillator_of(y, n) + 0.25 * y[0] * y[0] * y[0] * y[0];
}

static double planar_momentum_of(const double *y, size_t n) {
    (void)n;
    return y[0] * y[3] - y[1] * y[2];
}

/* A first integral of a user: 3 q_2. */
static lg_var own_record(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    (void)vars;
    return lg_scale(tape, lg_slice(tape, y[0], 1, 1, 1), *(double *)user);
}

static double own_of(const double *y, size_t n) {
    (void)n;
    return 3.0 * y[1];
}

TEST("the penalty takes every first integral, at all points") {
    double three = 3.0;
    const lg_first_integral own = {.name = "own", .formula = "3 q", .record = own_record, .user = &three};
    const struct {
        const char *system, *integral;
        double (*value)(const double *y, size_t n);
    } row[] = {{"pendulum-chain", "vertical-angular-momentum", vertical_momentum_of},
               {"coupled-oscillators", "oscillator", first_oscillator_of},
               {"coupled-oscillators", "anharmonic", first_anharmonic_of},
               {"quartic", "angular-momentum", planar_momentum_of},
               {"quartic", NULL, own_of}};
    assert_int_equal(LG_COUNT(row), lg_first_integral_count() + 1);
    for (size_t r = 0; r < LG_COUNT(row); r++) {
        const data set = make_data(row[r].system, r == 0 ? 2 : 0);
        const uint32_t hidden[1] = {6};
        lg_hamiltonian model;
        double theta[128];
        assert_ok(lg_hamiltonian_init(&model, r == 0 ? &lg_hamiltonian_chain : &lg_hamiltonian_separable, 2,
                                      LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
        lg_rng rng = test_rng(5, 0);
        lg_hamiltonian_initialise(&model, &rng, theta);
        lg_hamiltonian_problem problem = problem_of(&model, &set, r == 0 ? "cf4" : "rk4");
        problem.dt = 0.3;
        problem.penalty_integral = row[r].integral != NULL ? lg_first_integral_find(row[r].integral) : &own;
        const double plain = loss_of(&problem, theta);
        const built b = build_from(&model, theta);
        lg_stepper *stepper = stepper_of(&b, problem.scheme);
        double squares = 0.0, of_data[2] = {0.0, 0.0}, change[M];
        for (size_t i = 0; i < N; i++) {
            double y[12];
            memcpy(y, set.y + i * M * set.d, set.d * sizeof *y);
            const double G0 = row[r].value(y, 2);
            const double later = row[r].value(y, 2) - row[r].value(set.y + (i * M + M - 1) * set.d, 2);
            of_data[0] += G0 * G0 / N, of_data[1] += later * later / N;
            for (size_t j = 2; j <= M; j++) {
                assert_ok(lg_stepper_step(stepper, 0.0, problem.dt, y, NULL, y));
                const double gap = row[r].value(y, 2) - G0;
                squares += gap * gap;
            }
        }
        problem.penalty = 10.0;
        assert_ok(lg_hamiltonian_problem_check(&problem, NULL));
        assert_true(squares > 1e-8);
        assert_close(loss_of(&problem, theta) - plain, 10.0 * squares / N, 1e-9, 0.0);
        assert_ok(lg_hamiltonian_integral_changes(NULL, &problem, change));
        for (size_t j = 0; j < 2; j++)
            assert_close(change[j * (M - 1)] * change[j * (M - 1)], of_data[j], 1e-12, 1e-30);
    }
}

/* Over the data of a system that rotations about e3 do not change, the sum is constant; at the starts it is
 * the sum by hand. */
TEST("bodies keep their vertical angular momentum") {
    const struct {
        const char *name;
        const lg_hamiltonian_family *family;
    } row[] = {{"heavy-top", &lg_hamiltonian_rotation}, {"satellite", &lg_hamiltonian_rotation_direction}};
    for (size_t r = 0; r < LG_COUNT(row); r++) {
        const data set = make_data(row[r].name, 0);
        const built b = build_hamiltonian(row[r].family, 1, LG_POTENTIAL_MLP, LG_TANH);
        lg_hamiltonian_problem problem = problem_of(&b.hamiltonian, &set, "cf4");
        double change[M], square = 0.0;
        problem.penalty = 1.0;
        problem.penalty_integral = lg_first_integral_find("vertical-angular-momentum");
        for (size_t i = 0; i < N; i++) {
            const double G = vertical_momentum(&b, set.y + i * M * set.d);
            square += G * G / N;
        }
        assert_ok(lg_hamiltonian_integral_changes(NULL, &problem, change));
        assert_close(change[0] * change[0], square, 1e-13, 0.0);
        assert_true(change[M - 1] * change[M - 1] < 1e-20 * square);
    }
}

/* With the true parameters the listed integral is constant along the flow. */
TEST("a chain under gravity keeps its vertical angular momentum") {
    for (size_t k = 1; k <= 3; k++) {
        const exact e = exact_chain(k);
        lg_hamiltonian_problem problem = problem_of(&e.model, &e.set, "cf4");
        problem.penalty_integral = lg_first_integral_find("vertical-angular-momentum");
        const double plain = loss_of(&problem, e.theta);
        problem.penalty = 1.0;
        assert_close(loss_of(&problem, e.theta), plain, 0.0, 1e-12);
    }
}

/* H = |A p|^2/2 + w.q: p' = -w for any A. In the data p changes by c t, so s = |c|/|w|. */
TEST("the last layer is scaled by the third root of the ratio of the data's forces to the network's") {
    data set = make_data("quartic", 0);
    lg_hamiltonian model;
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    const double w[2] = {0.3, -0.4}, c[2] = {-24.0, 32.0}, theta[6] = {0.3, -0.4, 0.5, 0.1, 0.2, 0.7};
    double scaled[6], factor = 0.0;
    assert_int_equal(lg_hamiltonian_parameters(&model), 6);
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < 2; j++)
            set.y[(i * M + M - 1) * 4 + 2 + j] = set.y[i * M * 4 + 2 + j] + c[j] * problem.dt * (M - 1);
    memcpy(scaled, theta, sizeof theta);
    assert_ok(lg_hamiltonian_scale(NULL, &problem, scaled, &factor));
    assert_close(factor, cbrt(80.0), 1e-12, 0.0);
    for (size_t i = 0; i < 6; i++) assert_close(scaled[i], theta[i] * (i < 2 ? factor : 1.0), 1e-15, 0.0);
    for (size_t i = 0; i < 2; i++) scaled[i] = 1e3 * w[i]; /* steeper than the data: unchanged */
    assert_ok(lg_hamiltonian_scale(NULL, &problem, scaled, &factor));
    assert_true(factor == 1.0 && scaled[0] == 1e3 * w[0] && scaled[1] == 1e3 * w[1]);
    for (size_t i = 0; i < 2; i++) scaled[i] = 0.0; /* no forces: unchanged */
    assert_ok(lg_hamiltonian_scale(NULL, &problem, scaled, &factor));
    assert_true(factor == 1.0 && scaled[0] == 0.0 && scaled[1] == 0.0);
    EVERY_ALLOCATION_FAILS(context, 2, { status = lg_hamiltonian_scale(context, &problem, scaled, NULL); });
    problem.substeps = 0;
    assert_status(lg_hamiltonian_scale(NULL, &problem, scaled, &factor), LG_INVALID_ARGUMENT);
}

/* Numbers of p' of a chain that do not come from V are left out. After scaling by f the forces are f times as
 * large, so that the next factor follows from s/f = f^2. */
TEST("a potential that has been scaled is scaled less the next time") {
    const data set = make_data("pendulum-chain", 2);
    const uint32_t hidden[2] = {5, 4};
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, hidden, 2, LG_TANH));
    const lg_hamiltonian_problem problem = problem_of(&model, &set, "cf4");
    double *theta = room(lg_hamiltonian_parameters(&model)), first, second;
    lg_rng rng = test_rng(8, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    assert_ok(lg_hamiltonian_scale(NULL, &problem, theta, &first));
    assert_ok(lg_hamiltonian_scale(NULL, &problem, theta, &second));
    assert_true(first > 1.2);
    assert_close(second, pow(first, 2.0 / 3.0), 1e-12, 0.0);
}

TEST("for every family the gradient agrees with differences of the value along the group action") {
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

/* y' (d) that the family's field computes from dH at y. */
static void driven_by(const lg_hamiltonian_family *family, uint32_t n, const lg_space *space, const double *y,
                      const double *dH, double *velocity) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var parts[LG_HAMILTONIAN_MAX_PARTS], slopes[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    const lg_shape shape = lg_shape2(1, (uint32_t)space->dim);
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, y), parts));
    assert_ok(lg_taped_split(tape, space, lg_input_f64(tape, shape, dH), slopes));
    const lg_hamiltonian model = {.family = family, .n = n};
    lg_hamiltonian_record_algebra(tape, &model, 1.0, parts, slopes, LG_NONE, out);
    assert_ok(lg_taped_generator(tape, space, out, parts, out));
    assert_ok(lg_read(tape, lg_taped_join(tape, space, out), space->dim, velocity));
}

static void check_system(const lg_system *system) {
    size_t n;
    lg_space space;
    lg_system_user user;
    const lg_hamiltonian_family *family = lg_hamiltonian_family_for(system, &n);
    if (family == NULL) return;
    double y[MOST_STATE], dH[MOST_STATE], velocity[MOST_STATE], algebra[MOST_STATE], expected[MOST_STATE];
    void *work = test_work(lg_system_work_size(system));
    assert_ok(lg_hamiltonian_space(family, (uint32_t)n, &space));
    const lg_ode ode = ode_of(system, LG_COORDINATES_LIE, &user);
    lg_rng rng = test_rng(17, n);
    for (size_t i = 0; i < space.dim; i++) y[i] = lg_rng_uniform_in(&rng, 0.2, 1.2);
    if (family->manifold != NULL) assert_ok(lg_space_draw_start(&space, NULL, &rng, y));
    for (size_t i = 0; i < space.dim; i++) {
        const double kept = y[i], h = 1e-5;
        y[i] = kept + h;
        const double up = lg_system_hamiltonian(system, y, work);
        y[i] = kept - h;
        dH[i] = (up - lg_system_hamiltonian(system, y, work)) / (2.0 * h);
        y[i] = kept;
    }
    driven_by(family, (uint32_t)n, &space, y, dH, velocity);
    assert_ok(ode.field(ode.user, 0.0, y, NULL, algebra));
    lg_space_generator(&ode.space, algebra, y, expected);
    for (size_t i = 0; i < space.dim; i++) assert_close(velocity[i], expected[i], 1e-8, 1e-8);
}

TEST("for every family and system that it can learn, the true energy gives the true motion") {
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

TEST("a heavy top is learned as a body in each form whose state is R and pi") {
    static const char *const forms[] = {"cotangent", "direct"};
    for (size_t i = 0; i < LG_COUNT(forms); i++) {
        lg_system_options options;
        lg_system *system;
        size_t n = 0;
        lg_system_options_init(&options);
        options.form = forms[i];
        assert_ok(lg_system_create(NULL, "heavy-top", &options, &system, NULL));
        lg_test_owns(system, release_system);
        assert_string_equal(lg_hamiltonian_family_for(system, &n)->name, "rotation");
        assert_int_equal(n, 1);
    }
}

TEST("every family has all of its texts, and a different name") {
    const lg_hamiltonian_family *row;
    for (size_t i = 0; (row = lg_hamiltonian_family_at(i)) != NULL; i++) {
        const char *const words[] = {row->name,        row->description, row->copy,   row->state_units,
                                     row->energy_unit, row->layout[0],   row->formula};
        for (size_t w = 0; w < LG_COUNT(words); w++) assert_true(words[w] != NULL && words[w][0] != '\0');
        assert_ptr_equal(lg_hamiltonian_family_find(row->name), row);
    }
    assert_null(lg_hamiltonian_family_find("nothing"));
    assert_null(lg_potential_row_of((lg_potential_kind)LG_POTENTIAL_KIND_COUNT));
    assert_null(lg_first_integral_at(lg_first_integral_count()));
    assert_null(lg_first_integral_find("nothing"));
}

/* The recorded loss for training with this scheme; random states serve as data. */
static double loss_by_default(const moving *s, const lg_scheme *scheme) {
    data set = {.d = s->d, .t = {0.0, 0.02}, .y = room(N * M * s->d)};
    lg_rng rng = test_rng(5, 1);
    for (size_t i = 0; i < N * M; i++) draw_state(&s->b, &rng, set.y + i * s->d);
    const lg_hamiltonian_problem problem = {.model = &s->b.hamiltonian,
                                            .scheme = scheme,
                                            .substeps = 1,
                                            .trajectories = N,
                                            .points = M,
                                            .dt = set.t[1],
                                            .data = set.y};
    assert_told(lg_hamiltonian_problem_check(&problem, &told));
    return loss_of(&problem, s->b.theta);
}

TEST("for every family the default scheme trains, steps and is exported, and the accurate one estimates "
     "errors") {
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
            assert_ok(lg_stepper_step(stepper_of(&s.b, schemes[i]), 0.0, 0.01, s.y, s.u, next));
        }
    }
}

static lg_var free_energy(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const lg_var kinetic = lg_scale(tape, lg_rownorm2(tape, y[1]), 0.5);
    return lg_add(tape, kinetic, lg_hamiltonian_potential(tape, vars, y[0]));
}

/* H = |p|^2/2 + V(q): q' = p and p' = -dV/dq. */
TEST("a family of the caller may have no arrays, no input and no gradient") {
    enum { COPIES = 3 };
    lg_hamiltonian_family own = lg_hamiltonian_separable;
    own.arrays[0].rank = 0, own.bind = NULL, own.forces = 0, own.energy = free_energy, own.gradient = NULL;
    own.drift = NULL, own.scheme = "rk4";
    const built b = build_hamiltonian(&own, COPIES, LG_POTENTIAL_MLP, LG_TANH);
    const double h = 1e-5;
    double y[2 * COPIES], f[2 * COPIES];
    lg_rng rng = test_rng(6, 0);
    assert_int_equal(lg_model_input_dim(b.model), 0);
    draw_state(&b, &rng, y);
    assert_ok(lg_model_field(b.model, y, NULL, f, b.work));
    for (size_t i = 0; i < COPIES; i++) {
        const double q = y[i];
        y[i] = q + h;
        const double up = energy_of(&b, y);
        y[i] = q - h;
        assert_close(f[COPIES + i], -(up - energy_of(&b, y)) / (2 * h), 1e-7, 1e-9);
        assert_close(f[i], y[COPIES + i], 1e-15, 0);
        y[i] = q;
    }
}

static bool never(const lg_hamiltonian_family *family, uint32_t n, const double *arrays) {
    (void)family, (void)n, (void)arrays;
    return false;
}

TEST("a family of the caller whose arrays are never usable gets numbers of the last draw") {
    lg_hamiltonian_family own = lg_hamiltonian_chain;
    lg_hamiltonian model;
    own.usable = never;
    assert_ok(lg_hamiltonian_init(&model, &own, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(8, 0);
    lg_hamiltonian_initialise(&model, &rng, theta);
    for (size_t i = lg_hamiltonian_array_offset(&model, 0); i < lg_hamiltonian_parameters(&model); i++)
        assert_true(theta[i] > 0.0 && theta[i] < 1.0);
}

typedef struct narrow_loss {
    lg_fit_problem fit;
    const double *theta;
    bool residuals;
} narrow_loss;

static lg_status record_loss(lg_tape *tape, const void *user) {
    const narrow_loss *l = user;
    static const uint32_t samples[2] = {0, 1};
    lg_var loss;
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)l->fit.parameters), l->theta);
    return (l->residuals ? l->fit.residuals : l->fit.loss)(l->fit.user, tape, theta, samples, 2, N, &loss);
}

TEST("recording a loss may run out of memory at any point, for every family and kind of scheme") {
    static const char *const schemes[] = {NULL, "rk4", "cf4", "variational", "midpoint"};
    for (size_t m = 0; m < motions(); m++) {
        const moving s = make_motion(m, LG_POTENTIAL_MLP, LG_TANH);
        data set = {.d = s.d, .t = {0.0, 0.02}, .y = room(N * M * s.d)};
        lg_rng rng = test_rng(5, 1);
        for (size_t i = 0; i < N * M; i++) draw_state(&s.b, &rng, set.y + i * s.d);
        for (size_t k = 0; k < 2 * LG_COUNT(schemes); k++) {
            const char *name = schemes[k / 2];
            lg_hamiltonian_problem problem = {.model = &s.b.hamiltonian, .substeps = 1, .trajectories = N};
            problem.points = 3, problem.dt = 0.02, problem.data = set.y;
            problem.scheme = lg_scheme_find(name != NULL ? name : s.b.hamiltonian.family->scheme);
            assert_non_null(problem.scheme);
            narrow_loss l = {.theta = s.b.theta, .residuals = k % 2 == 1};
            if (k == 0) problem.starts = LG_START_ESTIMATED;
            if (lg_hamiltonian_problem_check(&problem, NULL) != LG_OK) continue;
            lg_hamiltonian_fit_problem(&problem, &l.fit);
            double *theta = room(l.fit.parameters);
            memcpy(theta, s.b.theta, lg_hamiltonian_parameters(&s.b.hamiltonian) * sizeof *theta);
            l.theta = theta;
            assert_true(record_narrow(LG_F64, record_loss, &l) > 0);
        }
    }
}

TEST("for any seed the initial mass is not nearly singular") {
    lg_hamiltonian model;
    double theta[3 + 2], least = INFINITY, largest = 0.0;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    for (uint64_t seed = 0; seed < 5000; seed++) {
        lg_rng rng = test_rng(seed, 1);
        lg_hamiltonian_initialise(&model, &rng, theta);
        const double m = theta[3] * theta[3] + theta[4];
        assert_true(theta[3] >= 0.0 && theta[3] < 1.0 && theta[4] >= 0.0 && theta[4] < 1.0);
        least = fmin(least, m);
        largest = fmax(largest, m);
    }
    assert_true(least >= LG_HAMILTONIAN_LEAST_PIVOT && least < 1.1 * LG_HAMILTONIAN_LEAST_PIVOT);
    assert_true(largest > 1.8);
    assert_true(lg_hamiltonian_usable_mass(&lg_hamiltonian_chain, 2, (double[]){1, 0, 0, 1, 0, 0}));
    assert_false(lg_hamiltonian_usable_mass(&lg_hamiltonian_chain, 2, (double[]){1, 0, 0, 0, 0, 0}));
}

/* m = Gamma^T Gamma + diag(max(0, b)) by hand; separable systems have no mass. */
TEST("the mass is Gamma^T Gamma + diag(max(0, b)), and separable systems have none") {
    lg_hamiltonian model;
    /* V linear: 9 weights; Gamma has the rows (1, 2, 0), (0, 1, 3), (2, 0, 1); b = (0.5, -4, 0). */
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

TEST("Newton's method reaches the same lowest loss from two starts") {
    data set = make_data("pendulum-chain", 1);
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_hamiltonian_problem problem = problem_of(&model, &set, "rk4");
    lg_fit_problem fit;
    lg_hamiltonian_fit_problem(&problem, &fit);
    double theta[2][5] = {{0.3, -0.2, 0.4, 0.7, 0.3}, {-0.5, 0.1, 0.2, 0.9, 0.6}};
    lg_fit_newton_result result[2];
    for (int i = 0; i < 2; i++) {
        const double before = loss_of(&problem, theta[i]);
        assert_ok(lg_fit_newton(NULL, &fit, theta[i], &result[i]));
        assert_true(result[i].loss < 1e-9 * before);
    }
    assert_close(result[0].loss, result[1].loss, 1e-6, 0.0);
    for (int j = 0; j < 3; j++) assert_close(theta[0][j], theta[1][j], 0.0, 1e-10);
    fit.parameters = LG_NEWTON_MAX_PARAMETERS + 1;
    assert_status(lg_fit_newton(NULL, &fit, theta[0], NULL), LG_INVALID_ARGUMENT);
}

TEST("invalid problems and models are refused") {
    lg_hamiltonian chain;
    lg_error error;
    const uint32_t hidden[1] = {4}, zero[1] = {0};
    const double y[24] = {0}, theta[64] = {0};
    double value = 7.0;
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
        assert_status(lg_hamiltonian_floor(NULL, &bad, theta, &value, NULL), status);                        \
        assert_true(error.message[0] != '\0');                                                               \
    } while (0)
    REFUSED(bad.points = 1, LG_INVALID_ARGUMENT);
    REFUSED(bad.starts = LG_START_ESTIMATED + 1, LG_INVALID_ARGUMENT);
    REFUSED(bad.points = LG_HAMILTONIAN_MAX_POINTS + 1, LG_INVALID_ARGUMENT);
    REFUSED(bad.dt = 0.0, LG_INVALID_ARGUMENT);
    REFUSED(bad.dt = NAN, LG_INVALID_ARGUMENT);
    REFUSED(bad.dt = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty_form = (lg_penalty_form)(LG_PENALTY_SUM_ABSOLUTE + 1), LG_INVALID_ARGUMENT);
    REFUSED(bad.model = NULL, LG_INVALID_ARGUMENT);
    REFUSED(bad.trajectories = 0, LG_INVALID_ARGUMENT);
    REFUSED(bad.trajectories = UINT32_MAX, LG_INVALID_ARGUMENT);
    REFUSED(bad.substeps = 0, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty = -1.0, LG_INVALID_ARGUMENT);
    REFUSED(bad.penalty = 1.0, LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("stormer-verlet"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("slgi"), LG_UNSUPPORTED);
    REFUSED(bad.scheme = lg_scheme_find("rk4-projected"), LG_UNSUPPORTED);
    REFUSED(bad.distance = LG_DISTANCE_GEODESIC + 1, LG_INVALID_ARGUMENT);
    REFUSED((bad.distance = LG_DISTANCE_GEODESIC, bad.scheme = lg_scheme_find("rk4")), LG_UNSUPPORTED);
    REFUSED(bad.scheme = NULL, LG_INVALID_ARGUMENT);
    REFUSED(bad.data = NULL, LG_INVALID_ARGUMENT);
    lg_hamiltonian_problem short_one = good;
    short_one.points = 1;
    assert_status(lg_hamiltonian_mean_squared_error(NULL, &short_one, theta, &value, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_integral_unit(NULL, &short_one, &value, NULL), LG_INVALID_ARGUMENT);
    double wrong[64] = {NAN};
    lg_program *program;
    assert_status(lg_hamiltonian_program(NULL, &chain, wrong, NULL, &program, &error), LG_NOT_FINITE);
    assert_says(error.message, "a parameter is not finite");
    lg_hamiltonian_problem many = good;
    many.substeps = 1u << 31;
    assert_status(lg_hamiltonian_floor(NULL, &many, theta, &value, NULL), LG_INVALID_ARGUMENT);
    assert_close(value, 7.0, 0.0, 0.0);
    lg_hamiltonian model;
    for (uint32_t n = 2; n <= 3; n++) {
        assert_ok(
            lg_hamiltonian_init(&model, &lg_hamiltonian_separable, n, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
        assert_int_equal(lg_first_integral_fits(lg_first_integral_find("angular-momentum"), &model), n == 2);
    }
    assert_status(
        lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 0, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH),
        LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1,
                                      (lg_potential_kind)LG_POTENTIAL_KIND_COUNT, NULL, 0, LG_TANH),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, LG_HAMILTONIAN_MAX_COPIES + 1,
                                      LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, zero, 1, LG_TANH),
                  LG_INVALID_ARGUMENT);
}
