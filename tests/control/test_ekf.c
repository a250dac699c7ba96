/* The extended Kalman filter: exact for linear systems, its derivative of the flow, consistency for a
 * pendulum and a spinning body, long runs, memory. */
#include "support/models.h"
#include "support/machine_support.h"
#include "support/model_support.h"
#include "support/malloc_count.h"

#include "core/core.h"
#include "liegrad/control.h"

enum { MOST = 40 };

static lg_ekf *filter_of(const lg_model *model, const char *scheme, const double *state, const double *P,
                         const double *W, const lg_sensor *sensors, size_t count) {
    lg_ekf_options options;
    lg_ekf *ekf = NULL;
    lg_ekf_options_init(&options);
    options.scheme = lg_scheme_find(scheme);
    options.state = state, options.P = P, options.W = W, options.sensors = sensors,
    options.sensor_count = count;
    const size_t bytes = lg_ekf_size(model, options.scheme, count);
    assert_true(bytes > 0);
    assert_told(lg_ekf_init(model, &options, &ekf, test_work(bytes), bytes, &told));
    return ekf;
}

/* A diagonal matrix (r, r) with the squares of the deviations. */
static double *diagonal(size_t r, const double *deviations) {
    double *P = room(r * r);
    for (size_t i = 0; i < r; i++) P[i * r + i] = deviations[i] * deviations[i];
    return P;
}

static double *uniform(size_t r, double deviation) {
    double *deviations = room(r);
    for (size_t i = 0; i < r; i++) deviations[i] = deviation;
    return diagonal(r, deviations);
}

/* ---- dense arithmetic of this file, independent of the library ---- */

/* c (m, n) = a (m, k) b (k, n); transposed: b is (n, k). c must not overlap a or b. */
static void product(size_t m, size_t n, size_t k, const double *a, const double *b, bool transposed,
                    double *c) {
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < n; j++) {
            c[i * n + j] = 0.0;
            for (size_t l = 0; l < k; l++)
                c[i * n + j] += a[i * k + l] * (transposed ? b[j * k + l] : b[l * n + j]);
        }
}

/* Replaces b (n, columns) by a^-1 b by elimination; a (n, n) is symmetric positive definite and is
 * overwritten. */
static void solve(size_t n, size_t columns, double *a, double *b) {
    for (size_t p = 0; p < n; p++)
        for (size_t i = 0; i < n; i++) {
            const double factor = i == p ? 0.0 : a[i * n + p] / a[p * n + p];
            for (size_t j = 0; j < n; j++) a[i * n + j] -= factor * a[p * n + j];
            for (size_t j = 0; j < columns; j++) b[i * columns + j] -= factor * b[p * columns + j];
        }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < columns; j++) b[i * columns + j] /= a[i * n + i];
}

static double square_in(size_t n, const double *P, const double *c) {
    double a[MOST * MOST], x[MOST], sum = 0.0;
    memcpy(a, P, n * n * sizeof *a);
    memcpy(x, c, n * sizeof *x);
    solve(n, 1, a, x);
    for (size_t i = 0; i < n; i++) sum += c[i] * x[i];
    return sum;
}

/* ---- the Kalman filter of a linear system ---- */

enum { N = 4 };

/* Two coupled oscillators, each with a force. */
static built build_oscillators(void) {
    double theta[17] = {0.0};
    lg_hamiltonian model;
    theta[2] = 1.0, theta[3] = 2.0, theta[12] = -0.6;  /* q_1^2, q_2^2, q_1 q_2 */
    theta[13] = 1.0, theta[14] = 0.2, theta[16] = 0.8; /* A */
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH));
    assert_int_equal(lg_hamiltonian_parameters(&model), 17);
    return build_from(&model, theta);
}

/* F = 1 + hA + ... + (hA)^4/24, the step of the classical method for c' = A c. */
static void polynomial(const double *A, double h, double *F) {
    double power[N * N] = {0.0}, next[N * N];
    for (int i = 0; i < N; i++) power[i * N + i] = 1.0;
    memcpy(F, power, sizeof power);
    for (int k = 1; k <= 4; k++) {
        product(N, N, N, power, A, false, next);
        for (int i = 0; i < N * N; i++) power[i] = next[i] * h / k, F[i] += power[i];
    }
}

typedef struct kalman {
    double F[N * N], W[N * N], y[N], P[N * N];
} kalman;

static void kalman_predict(kalman *s, double h, const double *y_next) {
    double FP[N * N];
    memcpy(s->y, y_next, sizeof s->y);
    product(N, N, N, s->F, s->P, false, FP);
    product(N, N, N, FP, s->F, true, s->P);
    for (int i = 0; i < N * N; i++) s->P[i] += h * s->W[i];
}

/* An update with two measured components of the state, in Joseph's form. */
static double kalman_update(kalman *s, const size_t *of, const double *noise, const double *z) {
    double S[4], T[4], K[2 * N], HP[2 * N], M[N * N], MP[N * N], nu[2];
    for (int i = 0; i < 2; i++) {
        nu[i] = z[i] - s->y[of[i]];
        memcpy(HP + i * N, s->P + of[i] * N, N * sizeof *HP);
        for (int j = 0; j < 2; j++)
            S[2 * i + j] = s->P[of[i] * N + of[j]] + (i == j ? noise[i] * noise[i] : 0.0);
    }
    memcpy(T, S, sizeof S);
    memcpy(K, HP, sizeof K);
    solve(2, N, T, K); /* K^T */
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) M[i * N + j] = i == j ? 1.0 : 0.0;
        for (int k = 0; k < 2; k++) M[i * N + of[k]] -= K[k * N + i];
        for (int k = 0; k < 2; k++) s->y[i] += K[k * N + i] * nu[k];
    }
    product(N, N, N, M, s->P, false, MP);
    product(N, N, N, MP, M, true, s->P);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            for (int k = 0; k < 2; k++) s->P[i * N + j] += K[k * N + i] * noise[k] * noise[k] * K[k * N + j];
    return square_in(2, S, nu);
}

TEST("for a linear system the filter is the Kalman filter, to rounding") {
    const built b = build_oscillators();
    const double h = 0.1, zero[N] = {0.0}, start[N] = {1.0, -0.5, 0.2, 0.0}, noise[2] = {0.1, 0.03};
    const size_t of[2] = {0, 3};
    const lg_sensor sensors[2] = {{LG_SENSOR_STATE, 0, 0.1, 0.0}, {LG_SENSOR_STATE, 3, 0.03, 0.0}};
    kalman s;
    double A[N * N], P[N * N], nis;
    double W[N * N] = {1e-4, 0, 2e-5, 0, 0, 2e-4, 0, 0, 2e-5, 0, 1e-3, 1e-4, 0, 0, 1e-4, 0};
    W[N * N - 1] = 2e-3;
    memcpy(s.W, W, sizeof W);
    memcpy(s.y, start, sizeof start);
    memcpy(s.P, uniform(N, 0.5), sizeof s.P);
    assert_ok(lg_model_linearise(b.model, zero, NULL, A, NULL, NULL, b.work));
    polynomial(A, h, s.F);
    lg_ekf *ekf = filter_of(b.model, "rk4", start, s.P, W, sensors, 2);
    lg_stepper *stepper = stepper_of(&b, lg_scheme_find("rk4"));
    for (int n = 0; n < 300; n++) {
        const double u[2] = {sin(0.3 * n), 0.2}, z[2] = {cos(0.1 * n), 0.3 * sin(0.17 * n)};
        double next[N];
        assert_ok(lg_stepper_step(stepper, 0.0, h, s.y, u, next));
        kalman_predict(&s, h, next);
        assert_ok(lg_ekf_predict(ekf, h, u));
        assert_ok(lg_ekf_update(ekf, z, &nis));
        assert_close(nis, kalman_update(&s, of, noise, z), 1e-10, 1e-13);
        lg_ekf_covariance(ekf, P);
        assert_all_close(lg_ekf_state(ekf), s.y, N, 1e-12, 1e-12);
        assert_all_close(P, s.P, N * N, 1e-10, 1e-15);
    }
}

/* ---- the derivative of the flow ---- */

/* Largest difference between the covariance after a step without noise and F P F^T, with F by differences. */
static double flow_error(const built *b, const double *y, const double *u, double h) {
    const size_t d = lg_model_inputs(b->model), r = lg_model_tangent_dim(b->model);
    const lg_sensor sensor = {LG_SENSOR_STATE, 0, 1.0, 0.0};
    const double e = 1e-4;
    const lg_scheme *scheme =
        lg_scheme_find(b->theta == NULL || b->hamiltonian.family->manifold != NULL ? "rkmk4" : "rk4");
    lg_stepper *stepper = stepper_of(b, scheme);
    double *c = room(r), *F = room(r * r), *FF = room(r * r), *P = room(r * r), *moved = room(d),
           *next = room(d), *end = room(d), *columns = room(2 * r), worst = 0.0;
    lg_ekf *ekf = filter_of(b->model, scheme->name, y, uniform(r, 1.0), uniform(r, 0.0), &sensor, 1);
    assert_ok(lg_ekf_predict(ekf, h, u));
    lg_ekf_covariance(ekf, P);
    assert_ok(lg_stepper_step(stepper, 0.0, h, y, u, next));
    assert_all_close(lg_ekf_state(ekf), next, d, 0.0, 0.0);
    for (size_t j = 0; j < r; j++) {
        for (int side = 0; side < 2; side++) {
            memset(c, 0, r * sizeof *c);
            c[j] = side == 0 ? e : -e;
            assert_ok(lg_model_retract(b->model, y, c, moved, b->work));
            assert_ok(lg_stepper_step(stepper, 0.0, h, moved, u, end));
            assert_ok(lg_model_deviation(b->model, next, end, columns + (size_t)side * r, b->work));
        }
        for (size_t i = 0; i < r; i++) F[i * r + j] = (columns[i] - columns[r + i]) / (2.0 * e);
    }
    product(r, r, r, F, F, true, FF);
    for (size_t i = 0; i < r * r; i++) worst = fmax(worst, fabs(FF[i] - P[i]) / (1.0 + fabs(FF[i])));
    return worst;
}

TEST("the covariance is propagated by the derivative of the step, with rotating frames and inputs") {
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_TANH);
        const double coarse = flow_error(&s.b, s.y, s.u, 0.1), fine = flow_error(&s.b, s.y, s.u, 0.05);
        print_message("  model %zu: %.1e with h = 0.1, %.1e with 0.05\n", i, coarse, fine);
        assert_true(fine < 1e-3 && (fine < 0.08 * coarse || fine < 1e-8));
    }
    const lg_machine machine = machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES], u[2] = {0.3, -0.2};
    built b = {.model = NULL};
    assert_ok(test_machine_model(NULL, &machine, machine_theta(&machine, 4), &b.model, NULL));
    b = ready_to_run(b);
    double *y = room(lg_model_inputs(b.model));
    random_rows(&machine, 2, 1, q, v);
    assert_ok(lg_model_machine_state(b.model, q, v, y, b.work));
    const double fine = flow_error(&b, y, u, 1e-3);
    print_message("  machine with every coordinate: %.1e with h = 0.001\n", fine);
    assert_true(fine < 1e-6);
}

/* ---- consistency ---- */

typedef struct trial {
    const built *b;
    const char *scheme;
    /* deviations: W of the process, as a deviation per root second; sigma of the sensors; P0 of the start */
    double h, W, sigma, P0;
    const lg_sensor *sensors;
    size_t count;
    void (*measure)(const built *b, const double *y, double *z);
} trial;

/* *nees: the mean of c^T P^-1 c over `runs` runs at the end of `steps` steps. *nis: the mean of nu^T S^-1 nu
 * over all updates. */
static void consistency(const trial *t, const double *start, int runs, int steps, double *nees, double *nis) {
    const lg_model *model = t->b->model;
    const size_t d = lg_model_inputs(model), r = lg_model_tangent_dim(model);
    double *y = room(d), *c = room(r), *P = room(r * r), z[16], one;
    lg_stepper *stepper = stepper_of(t->b, lg_scheme_find(t->scheme));
    lg_rng rng = test_rng(11, 0);
    *nees = *nis = 0.0;
    for (int run = 0; run < runs; run++) {
        const size_t mark = lg_test_owned();
        lg_ekf *ekf =
            filter_of(model, t->scheme, start, uniform(r, t->P0), uniform(r, t->W), t->sensors, t->count);
        for (size_t i = 0; i < r; i++) c[i] = t->P0 * lg_rng_normal(&rng);
        assert_ok(lg_model_retract(model, start, c, y, t->b->work));
        for (int n = 0; n < steps; n++) {
            assert_ok(lg_stepper_step(stepper, 0.0, t->h, y, NULL, y));
            for (size_t i = 0; i < r; i++) c[i] = sqrt(t->h) * t->W * lg_rng_normal(&rng);
            assert_ok(lg_model_retract(model, y, c, y, t->b->work));
            t->measure(t->b, y, z);
            for (size_t i = 0; i < t->count; i++) z[i] += t->sensors[i].noise * lg_rng_normal(&rng);
            assert_ok(lg_ekf_predict(ekf, t->h, NULL));
            assert_ok(lg_ekf_update(ekf, z, &one));
            *nis += one / (runs * steps);
        }
        lg_ekf_covariance(ekf, P);
        assert_ok(lg_model_deviation(model, lg_ekf_state(ekf), y, c, t->b->work));
        *nees += square_in(r, P, c) / runs;
        lg_test_give_back(mark);
    }
}

/* The mean of `samples` chi-square numbers with `freedom` degrees must be within 3.5 standard deviations of
 * its expectation. */
static void assert_chi_square(const char *name, double mean, double freedom, double samples) {
    const double deviation = sqrt(2.0 * freedom / samples);
    print_message("  %s: %.3f, expected %.0f +- %.3f\n", name, mean, freedom, deviation);
    assert_close(mean, freedom, 0.0, 3.5 * deviation);
}

static void two_of_q(const built *b, const double *y, double *z) {
    (void)b;
    z[0] = y[0], z[1] = y[1];
}

TEST("a pendulum's estimate is as good as its covariance says, though the frames rotate and change") {
    enum { RUNS = 200, STEPS = 250 };
    const built b = build_pendulum(1.0, 4.0);
    const lg_sensor sensors[2] = {{LG_SENSOR_STATE, 0, 0.01, 0.0}, {LG_SENSOR_STATE, 1, 0.03, 0.0}};
    const trial t = {&b, "rkmk4", 0.02, 0.02, 0.0, 0.05, sensors, 2, two_of_q};
    const double start[6] = {0.6, 0.0, -0.8, 0.0, 1.5, 0.0};
    double nees, nis;
    consistency(&t, start, RUNS, STEPS, &nees, &nis);
    assert_chi_square("error of the state", nees, 4.0, RUNS);
    assert_chi_square("innovation", nis, 2.0, RUNS * STEPS);
}

static built build_body(lg_machine *machine) {
    const double inertia[3] = {1.0, 2.0, 3.0};
    built b = {.model = NULL};
    *machine = empty_machine();
    add_coordinate(machine, "body", LG_COORDINATE_ROTATION);
    add_values(add_term(machine, LG_MACHINE_MASS, "known"), 3, inertia);
    assert_machine(machine);
    assert_ok(test_machine_model(NULL, machine, machine_theta(machine, 1), &b.model, NULL));
    return ready_to_run(b);
}

static void attitude_and_rate(const built *b, const double *y, double *z) {
    double positions[9], velocities[3];
    assert_ok(lg_model_machine_positions(b->model, y, positions, b->work));
    assert_ok(lg_model_machine_velocities(b->model, y, velocities, b->work));
    memcpy(z, positions, sizeof positions);
    z[9] = velocities[0];
}

TEST("a spinning body's estimate is consistent through half turns, with attitude sensor and gyroscope") {
    enum { RUNS = 150, STEPS = 150 };
    lg_machine machine;
    const built b = build_body(&machine);
    lg_sensor sensors[10];
    for (size_t i = 0; i < 9; i++) sensors[i] = (lg_sensor){LG_SENSOR_POSITION, i, 0.03, 0.0};
    sensors[9] = (lg_sensor){LG_SENSOR_VELOCITY, 0, 0.02, 0.0};
    const trial t = {&b, "rkmk4", 0.02, 0.05, 0.0, 0.1, sensors, 10, attitude_and_rate};
    double start[12] = {-1, 0, 0, 0, -1, 0, 0, 0, 1, 0.4, 3.0, 4.0}, nees, nis;
    const double velocity[3] = {0.5, 1.0, 2.0};
    assert_int_equal(lg_model_inputs(b.model), 12);
    assert_ok(lg_model_machine_state(b.model, start, velocity, start, b.work));
    consistency(&t, start, RUNS, STEPS, &nees, &nis);
    assert_chi_square("error of the state", nees, 6.0, RUNS);
    assert_chi_square("innovation", nis, 10.0, RUNS * STEPS);
}

/* ---- long runs ---- */

TEST("after 100000 steps with sensors a million times better than the start, P is symmetric and definite") {
    enum { R = 4 };
    const built b = build_pendulum(1.0, 4.0);
    const lg_sensor sensors[3] = {
        {LG_SENSOR_STATE, 0, 1e-6, 0.0}, {LG_SENSOR_STATE, 1, 1e-6, 0.0}, {LG_SENSOR_STATE, 2, 1e-6, 0.0}};
    const lg_space space = space_of(&b);
    double y[6] = {0.6, 0.0, 0.8, 0.0, 1.5, 0.0}, guess[6] = {0.6, 0.0, 0.8, 0.0, 1.0, 0.0}, P[R * R], c[R],
           nis;
    const double deviations[R] = {1.0, 1.0, 1.0, 1.0};
    lg_stepper *stepper = stepper_of(&b, lg_scheme_find("rkmk4"));
    lg_ekf *ekf = filter_of(b.model, "rkmk4", guess, diagonal(R, deviations), uniform(R, 1e-7), sensors, 3);
    lg_rng rng = test_rng(12, 0);
    for (int n = 0; n < 100000; n++) {
        double z[3];
        assert_ok(lg_stepper_step(stepper, 0.0, 0.01, y, NULL, y));
        assert_ok(lg_ekf_predict(ekf, 0.01, NULL));
        for (int i = 0; i < 3; i++) z[i] = y[i] + 1e-6 * lg_rng_normal(&rng);
        assert_ok(lg_ekf_update(ekf, z, &nis));
        if (n % 997 != 0) continue;
        lg_ekf_covariance(ekf, P);
        for (int i = 0; i < R; i++) {
            assert_true(P[i * R + i] > 0.0 && P[i * R + i] < 1.0);
            for (int j = 0; j < R; j++) {
                assert_true(P[i * R + j] == P[j * R + i]);
                c[j] = i == j ? 1.0 : 0.0;
            }
            const double inverse = square_in(R, P, c);
            assert_true(inverse > 0.0 && isfinite(inverse));
        }
        assert_true(lg_space_manifold_error(&space, lg_ekf_state(ekf)) < 1e-14);
    }
    assert_ok(lg_model_deviation(b.model, lg_ekf_state(ekf), y, c, b.work));
    for (int i = 0; i < R; i++) assert_close(c[i], 0.0, 0.0, 5e-6);
    assert_true(square_in(R, P, c) < 40.0);
}

TEST("the covariance is transformed when an update changes the frame of the state") {
    /* Before the correction along e_1 |q_1| < |q_2|, afterwards not; the correction turns about e_2. */
    const built b = build_pendulum(1.0, 4.0);
    const lg_space space = space_of(&b);
    const lg_sensor sensor = {LG_SENSOR_STATE, 0, 0.01, 0.0};
    const double deviations[4] = {0.1, 1e-4, 0.1, 0.1};
    double y[6] = {0.50, 0.51, 0.7, 0.0, 0.0, 0.0}, basis[24], P[16], z[1], sum = 0.0, along[4] = {0.0};
    lg_space_project(&space, y);
    assert_ok(lg_model_linearise(b.model, y, NULL, NULL, NULL, basis, b.work));
    const double axis[3] = {basis[1], basis[5], basis[9]};
    lg_ekf *ekf = filter_of(b.model, "rkmk4", y, diagonal(4, deviations), uniform(4, 0.0), &sensor, 1);
    z[0] = y[0] + 0.1;
    assert_ok(lg_ekf_update(ekf, z, NULL));
    const double *q = lg_ekf_state(ekf);
    assert_true(fabs(y[0]) < fabs(y[1]) && fabs(q[0]) > fabs(q[1]));
    lg_ekf_covariance(ekf, P);
    assert_ok(lg_model_linearise(b.model, q, NULL, NULL, NULL, basis, b.work));
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 3; i++) along[j] += axis[i] * basis[4 * i + j];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) sum += along[i] * P[4 * i + j] * along[j];
    assert_close(sum, 1e-8, 1e-3, 0.0);
}

TEST("differences of angles are taken in the shorter direction") {
    lg_machine machine = empty_machine();
    const double inertia[1] = {1.0}, start[2] = {3.1, 0.0};
    const lg_sensor sensor = {LG_SENSOR_POSITION, 0, 0.1, 2.0 * 3.14159265358979323846};
    double z[1] = {-3.1};
    built b = {.model = NULL};
    add_coordinate(&machine, "arm", LG_COORDINATE_ANGLE);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), 1, inertia);
    assert_machine(&machine);
    assert_ok(test_machine_model(NULL, &machine, machine_theta(&machine, 1), &b.model, NULL));
    b = ready_to_run(b);
    lg_ekf *ekf = filter_of(b.model, "rk4", start, uniform(2, 0.1), uniform(2, 0.0), &sensor, 1);
    assert_ok(lg_ekf_update(ekf, z, NULL));
    /* half of the difference 0.083 is added */
    assert_close(lg_ekf_state(ekf)[0], 3.14159265358979323846, 1e-9, 0.0);
}

/* ---- errors and memory ---- */

TEST("filters that cannot be made and invalid measurements are refused with a reason") {
    const built b = build_pendulum(1.0, 4.0), surrogate = build_surrogate(LG_SURROGATE_DISCRETE);
    const double start[6] = {0.6, 0.0, 0.8, 0.0, 0.0, 0.0};
    double P[16], W[16], z[1] = {NAN}, nis = 7.0, before[6];
    lg_sensor sensor = {LG_SENSOR_STATE, 0, 0.1, 0.0};
    const size_t bytes = lg_ekf_size(b.model, lg_scheme_find("rkmk4"), 1);
    void *memory = test_work(bytes);
    lg_ekf_options options;
    lg_ekf *ekf = NULL;
    lg_error error;
    memcpy(P, uniform(4, 1.0), sizeof P);
    memcpy(W, uniform(4, 1.0), sizeof W);
    lg_ekf_options_init(&options);
    assert_status(lg_ekf_init(b.model, &options, &ekf, memory, bytes, &error), LG_INVALID_ARGUMENT);
    options = (lg_ekf_options){sizeof options, lg_scheme_find("rkmk4"), start, P, W, &sensor, 1};
#define REFUSED(status, part)                                                                                \
    do {                                                                                                     \
        assert_status(lg_ekf_init(b.model, &options, &ekf, memory, bytes, &error), status);                  \
        assert_says(error.message, part);                                                                    \
    } while (0)
    P[1] = 0.5;
    REFUSED(LG_INVALID_ARGUMENT, "P is not symmetric");
    P[4] = 0.5, W[5] = -1.0;
    REFUSED(LG_INVALID_ARGUMENT, "W is not positive semidefinite");
    W[5] = INFINITY;
    REFUSED(LG_NOT_FINITE, "W is not finite");
    W[5] = 1.0, sensor.index = 6;
    REFUSED(LG_INVALID_ARGUMENT, "its index is 6, but there are only 6 numbers");
    sensor.index = 0, sensor.noise = 0.0;
    REFUSED(LG_INVALID_ARGUMENT, "noise must be above 0");
    sensor.noise = 1.0, sensor.kind = LG_SENSOR_VELOCITY;
    REFUSED(LG_UNSUPPORTED, "need a model of a machine");
    sensor.kind = LG_SENSOR_STATE, options.scheme = lg_scheme_find("rk4");
    REFUSED(LG_UNSUPPORTED, "scheme does not fit");
    assert_null(ekf);
    options.scheme = lg_scheme_find("rkmk4");
    assert_status(lg_ekf_init(b.model, &options, &ekf, memory, bytes - 1, &error), LG_INVALID_ARGUMENT);
    assert_ok(lg_ekf_init(b.model, &options, &ekf, memory, bytes, &error));
    memcpy(before, lg_ekf_state(ekf), sizeof before);
    assert_status(lg_ekf_update(ekf, z, &nis), LG_NOT_FINITE);
    assert_status(lg_ekf_predict(ekf, 0.0, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_ekf_predict(ekf, NAN, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_ekf_predict(ekf, INFINITY, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_ekf_predict(ekf, 0.01, (double[]){0, NAN, 0}), LG_NOT_FINITE);
    assert_true(nis == 7.0);
    assert_memory_equal(before, lg_ekf_state(ekf), sizeof before);
    assert_int_equal(lg_ekf_size(surrogate.model, options.scheme, 1), 0);
    assert_int_equal(lg_ekf_size(b.model, options.scheme, 0), 0);
    assert_int_equal(lg_ekf_size(b.model, options.scheme, (size_t)UINT16_MAX + 1), 0);
    assert_int_equal(lg_ekf_size(b.model, NULL, 1), 0);
    sensor.kind = (lg_sensor_kind)LG_SENSOR_KIND_COUNT;
    REFUSED(LG_INVALID_ARGUMENT, "is unknown");
    sensor.kind = LG_SENSOR_STATE, sensor.noise = INFINITY;
    REFUSED(LG_INVALID_ARGUMENT, "the period 0 or more");
    sensor.noise = 1.0, sensor.period = -1.0;
    REFUSED(LG_INVALID_ARGUMENT, "the period 0 or more");
    sensor.period = INFINITY;
    REFUSED(LG_INVALID_ARGUMENT, "the period 0 or more");
    sensor.period = 0.0;
    const double far[6] = {INFINITY, 0, 0, 0, 0, 0};
    options.state = far;
    REFUSED(LG_NOT_FINITE, "the state is not finite");
    options.state = start;
    const lg_ekf_options good = options;
    for (int i = 0; i < 6; i++) {
        options = good;
        if (i == 0) options.size = 3;
        if (i == 1) options.scheme = NULL;
        if (i == 2) options.state = NULL;
        if (i == 3) options.P = NULL;
        if (i == 4) options.W = NULL;
        if (i == 5) options.sensors = NULL;
        REFUSED(LG_INVALID_ARGUMENT, "options' size is wrong");
    }
}

TEST("a filter in a loop allocates nothing and takes no lock") {
    lg_machine machine;
    const built body = build_body(&machine), pendulum = build_pendulum(1.0, 4.0);
    const lg_sensor rate = {LG_SENSOR_VELOCITY, 0, 0.02, 0.0}, place = {LG_SENSOR_STATE, 0, 0.01, 0.0};
    double spin[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 2, 3}, still[6] = {0.6, 0, 0.8, 0, 0, 0}, z[1] = {0.5};
    lg_status status[2] = {LG_CHECK_FAILED, LG_CHECK_FAILED};
    lg_ekf *const filters[] = {
        filter_of(body.model, "rkmk4", spin, uniform(6, 0.1), uniform(6, 0.1), &rate, 1),
        filter_of(pendulum.model, "rkmk4", still, uniform(4, 0.1), uniform(4, 0.1), &place, 1)};
    for (size_t i = 0; i < LG_COUNT(filters); i++) {
        const double begin = lg_seconds();
        for (int n = 0; n < 2000; n++) {
            assert_ok(lg_ekf_predict(filters[i], 1e-3, NULL));
            assert_ok(lg_ekf_update(filters[i], z, NULL));
        }
        print_message("  %s: %.1f us a step\n", i == 0 ? "body" : "pendulum", (lg_seconds() - begin) / 2e-3);
        if (!lg_count_available()) continue;
        assert_no_malloc_no_lock(status[0] = lg_ekf_predict(filters[i], 1e-3, NULL));
        assert_no_malloc_no_lock(status[1] = lg_ekf_update(filters[i], z, NULL));
        assert_ok(status[0]);
        assert_ok(status[1]);
    }
}
