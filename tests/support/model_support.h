/* Small models of every kind, as lg_model. The running test owns all of them. */
#ifndef LG_MODEL_SUPPORT_H
#define LG_MODEL_SUPPORT_H

#include "support/models.h"
#include "support/fixtures.h"

#include "liegrad/model.h"
#include "hamiltonian/internal.h"

enum { MOST_STATE = 24, MOST_INPUT = 12, MOST_TANGENT = 16 };

typedef struct built {
    lg_model *model;
    lg_hamiltonian hamiltonian;
    lg_surrogate surrogate;
    lg_detector detector;
    double *theta;
    void *work;
} built;

RELEASES(release_model, lg_model_destroy)

/* Gives the new model to the running test, and allocates the model's work memory. */
static inline built ready_to_run(built b) {
    lg_test_owns(b.model, release_model);
    b.work = test_work(lg_model_work_size(b.model));
    return b;
}

static inline double *room(size_t count) {
    return TEST_ARRAY(double, count);
}

/* A model with this description and these parameters. */
static inline built build_from(const lg_hamiltonian *model, const double *theta) {
    const size_t n = lg_hamiltonian_parameters(model);
    built b = {.hamiltonian = *model, .theta = room(n)};
    memcpy(b.theta, theta, n * sizeof *theta);
    assert_ok(test_hamiltonian_model(NULL, model, theta, &b.model, NULL));
    return ready_to_run(b);
}

static inline built build_hamiltonian(const lg_hamiltonian_family *family, uint32_t n,
                                      lg_potential_kind potential, lg_activation activation) {
    const uint32_t hidden[2] = {9, 8};
    lg_hamiltonian model;
    if (family->most > 0 && n > family->most) n = family->most;
    assert_ok(lg_hamiltonian_init(&model, family, n, potential, hidden, 2, activation));
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(21, n);
    lg_hamiltonian_initialise(&model, &rng, theta);
    return build_from(&model, theta);
}

static inline double energy_of(const built *b, const double *y) {
    double energy;
    lg_model_eval(b->model, y, &energy, b->work);
    return energy;
}

/* H = |p|^2/(2 m) + c q_3 on T*S^2: the spherical pendulum, c/m = gravity/length. */
static inline built build_pendulum(double m, double c) {
    const double theta[5] = {0.0, 0.0, c, 0.0, m};
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    return build_from(&model, theta);
}

static inline built build_surrogate(lg_surrogate_kind kind) {
    const lg_surrogate_options options = {.kind = kind,
                                          .architecture = LG_NET_MULT,
                                          .embedding = 7,
                                          .hidden = 9,
                                          .layers = 2,
                                          .activation = LG_TANH,
                                          .normalise = true,
                                          .boundary = kind == LG_SURROGATE_ANGLE};
    built b = {.model = NULL};
    assert_ok(lg_surrogate_init(&b.surrogate, &options, 6, 3.3, 1.2, NULL));
    const size_t n = lg_surrogate_parameters(&b.surrogate);
    b.theta = room(n);
    lg_rng rng = test_rng(22, (uint64_t)kind);
    for (size_t i = 0; i < n; i++) b.theta[i] = 0.3 * lg_rng_normal(&rng);
    assert_ok(test_surrogate_model(NULL, &b.surrogate, b.theta, &b.model, NULL));
    return ready_to_run(b);
}

static inline built build_detector(lg_activation activation) {
    enum { CHANNELS = 2, LENGTH = 60, CLASSES = 3 };
    double mean[CHANNELS] = {0.1, 1.1}, scale[CHANNELS] = {2.0, 3.0};
    const lg_scaler scaler = {.channels = CHANNELS, .mean = mean, .scale = scale};
    built b = {.detector = {.classes = CLASSES, .loss = LG_DETECTOR_CROSS_ENTROPY}};
    lg_cnn_init_default(&b.detector.net, CHANNELS, LENGTH, CLASSES, activation);
    assert_ok(lg_detector_check(&b.detector, NULL));
    b.theta = room(lg_cnn_parameters(&b.detector.net));
    lg_rng rng = test_rng(23, 0);
    lg_cnn_initialise(&b.detector.net, &rng, b.theta);
    assert_ok(test_detector_model(NULL, &b.detector, &scaler, b.theta, &b.model, NULL));
    return ready_to_run(b);
}

static inline bool is_chain(const built *b) {
    return b->hamiltonian.family == &lg_hamiltonian_chain;
}

static inline lg_space space_of(const built *b) {
    lg_space space;
    assert_ok(lg_hamiltonian_space(b->hamiltonian.family, b->hamiltonian.n, &space));
    return space;
}

/* Draws a random state on the manifold. */
static inline void draw_state(const built *b, lg_rng *rng, double *y) {
    const lg_space space = space_of(b);
    for (size_t i = 0; i < space.dim; i++) y[i] = lg_rng_normal(rng);
    lg_space_project(&space, y);
    if (b->hamiltonian.family->bodies.rotations > 0) assert_ok(lg_space_draw_start(&space, NULL, rng, y));
}

/* The velocity of the state, as a vector of the ambient space. */
static inline void model_velocity(const lg_model *model, const double *y, const double *input, double *out,
                                  void *work) {
    const lg_space *space = lg_model_space(model);
    double field[64];
    assert_true(space->algebra_dim <= LG_COUNT(field));
    assert_ok(lg_model_field(model, y, input, field, work));
    lg_space_generator(space, field, y, out);
}

/* Checks that the basis is the space's, that A and B agree with central differences of the field along the
 * basis and in the input, and that each of the three is the same when only it is requested. */
static inline void check_linearisation(const lg_model *model, const double *y, const double *input,
                                       double tolerance, void *work) {
    const size_t mark = lg_test_owned();
    const lg_space *space = lg_model_space(model);
    const size_t d = space->dim, r = space->tangent_dim, m = lg_model_input_dim(model);
    double *A = room(r * r), *B = room(r * m), *basis = room(d * r), *own = room(d * (r + m));
    double *c = room(r), *at = room(d), *u = room(m), *sides[2] = {room(d), room(d)}, largest = 0.0;
    assert_ok(lg_model_linearise(model, y, input, A, B, basis, work));
    lg_space_basis(space, y, own);
    assert_memory_equal(basis, own, d * r * sizeof *basis);
    for (size_t i = 0; i < r * r; i++) largest = fmax(largest, fabs(A[i]));
    assert_true(largest > 1e-3);
    for (size_t j = 0; j < r + m; j++) {
        const double h = j < r ? 1e-5 : 1.0; /* large, because fields are linear in inputs */
        for (int side = 0; side < 2; side++) {
            for (size_t i = 0; i < r; i++) c[i] = i == j ? (side == 0 ? h : -h) : 0.0;
            for (size_t i = 0; i < m; i++)
                u[i] = (input != NULL ? input[i] : 0.0) + (i + r == j ? (side == 0 ? h : -h) : 0.0);
            assert_ok(lg_model_retract(model, y, c, at, work));
            model_velocity(model, j < r ? at : y, u, sides[side], work);
        }
        for (size_t i = 0; i < d; i++) at[i] = (sides[0][i] - sides[1][i]) / (2.0 * h);
        lg_space_coordinates(space, y, at, c);
        for (size_t i = 0; i < r && j < r; i++)
            assert_close(A[i * r + j], c[i], tolerance, 0.1 * tolerance * largest);
        for (size_t i = 0; i < r && j >= r; i++)
            assert_close(B[i * m + j - r], c[i], 1e-5 * tolerance, 1e-5 * tolerance);
    }
    assert_ok(lg_model_linearise(model, y, input, own, NULL, NULL, work));
    assert_memory_equal(own, A, r * r * sizeof *A);
    assert_ok(lg_model_linearise(model, y, input, NULL, own, NULL, work));
    assert_memory_equal(own, B, r * m * sizeof *B);
    assert_ok(lg_model_linearise(model, y, input, NULL, NULL, own, work));
    assert_memory_equal(own, basis, d * r * sizeof *basis);
    lg_test_give_back(mark);
}

static inline void assert_all_nan(const double *x, size_t n) {
    for (size_t i = 0; i < n; i++) assert_true(isnan(x[i]));
}

/* One number of x that is not finite must make value, Jacobian and field NaN. */
static inline void check_unfit(const lg_model *model, double *x, void *work) {
    const size_t n = lg_model_inputs(model), m = lg_model_outputs(model);
    double *y = room(m), *jacobian = room(m * n);
    for (size_t i = 0; i < n; i++) {
        const double finite = x[i];
        x[i] = i % 2 == 0 ? (double)NAN : (double)-INFINITY;
        lg_model_eval(model, x, y, work);
        assert_all_nan(y, m);
        memset(y, 0, m * sizeof *y);
        lg_model_jacobian(model, x, y, jacobian, work);
        assert_all_nan(y, m);
        assert_all_nan(jacobian, m * n);
        if (lg_model_space(model) != NULL) {
            assert_ok(lg_model_field(model, x, NULL, jacobian, work));
            assert_all_nan(jacobian, lg_model_space(model)->algebra_dim);
        }
        x[i] = finite;
    }
}

/* A stepper in exactly as many bytes of memory as lg_model_stepper_size asks for. */
static inline lg_stepper *stepper_of(const built *b, const lg_scheme *scheme) {
    lg_stepper *stepper;
    const size_t bytes = lg_model_stepper_size(b->model, scheme);
    assert_true(bytes > 0);
    assert_ok(lg_model_stepper_init(b->model, scheme, &stepper, test_work(bytes), bytes));
    return stepper;
}

/* A learned Hamiltonian with a random state and a random input. */
typedef struct moving {
    built b;
    uint32_t n;
    size_t d, m, r; /* numbers in a state, an input and the tangent coordinates */
    double y[MOST_STATE], u[MOST_INPUT];
} moving;

static inline moving put_in_motion(built b, uint64_t seed) {
    moving s = {.b = b,
                .n = b.hamiltonian.n,
                .d = lg_model_inputs(b.model),
                .m = lg_model_input_dim(b.model),
                .r = lg_model_tangent_dim(b.model)};
    assert_true(s.d <= MOST_STATE && s.m <= MOST_INPUT && s.r <= MOST_TANGENT);
    lg_rng rng = test_rng(3, seed);
    draw_state(&b, &rng, s.y);
    for (size_t i = 0; i < s.m; i++) s.u[i] = lg_rng_normal(&rng);
    return s;
}

/* Number of models for make_motion: each family with one, two and three copies. */
static inline size_t motions(void) {
    return 3 * lg_hamiltonian_family_count();
}

static inline moving make_motion(size_t i, lg_potential_kind potential, lg_activation activation) {
    const uint32_t n = 1 + (uint32_t)i % 3;
    return put_in_motion(build_hamiltonian(lg_hamiltonian_family_at(i / 3), n, potential, activation), i);
}

#endif
