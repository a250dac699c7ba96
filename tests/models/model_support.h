/* Small models of every kind behind the one handle. */
#ifndef LG_MODEL_SUPPORT_H
#define LG_MODEL_SUPPORT_H

#include "test_support.h"

#include "liegrad/model.h"
#include "models/hamiltonian_internal.h"

enum { MOST_STATE = 24, MOST_INPUT = 12, MOST_TANGENT = 16 };

typedef struct built {
    lg_model *model;
    lg_hamiltonian hamiltonian;
    lg_surrogate surrogate;
    lg_detector detector;
    lg_scaler scaler;
    double *theta, *mean, *scale;
    void *work;
    size_t bytes;
} built;

/* Work that holds something else, and a piece behind it that must stay as it is. */
static inline void build_work(built *b) {
    b->bytes = lg_model_work_size(b->model);
    assert_true(b->bytes > 0);
    assert_int_equal(posix_memalign(&b->work, 64, b->bytes + 64), 0);
    memset(b->work, 0x41, b->bytes + 64);
}

static inline double *room(size_t count) {
    double *out = malloc(count * sizeof *out);
    assert_non_null(out);
    return out;
}

static inline void build_hamiltonian(built *b, const lg_hamiltonian_family *family, uint32_t n,
                                     lg_potential_kind potential, lg_activation activation) {
    const uint32_t hidden[2] = {9, 8};
    lg_rng rng;
    *b = (built){.model = NULL};
    assert_ok(lg_hamiltonian_init(&b->hamiltonian, family, n, potential, hidden, 2, activation));
    b->theta = room(lg_hamiltonian_parameters(&b->hamiltonian));
    lg_rng_seed(&rng, 21, n);
    lg_hamiltonian_initialise(&b->hamiltonian, &rng, b->theta);
    assert_ok(lg_model_create_hamiltonian(NULL, &b->hamiltonian, b->theta, &b->model, NULL));
    build_work(b);
}

/* From a description and parameters of one's own. */
static inline void build_from(built *b, const lg_hamiltonian *model, const double *theta) {
    *b = (built){.hamiltonian = *model};
    assert_ok(lg_model_create_hamiltonian(NULL, model, theta, &b->model, NULL));
    build_work(b);
}

static inline double energy_of(const built *b, const double *y) {
    double energy;
    lg_model_eval(b->model, y, &energy, b->work);
    return energy;
}

/* The model with what theta is now. */
static inline void build_again(built *b) {
    lg_model_destroy(b->model);
    assert_ok(lg_model_create_hamiltonian(NULL, &b->hamiltonian, b->theta, &b->model, NULL));
}

/* H = |p|^2/(2 m) + c q_3 on T*S^2: the spherical pendulum, c/m = gravity/length. */
static inline void build_pendulum(built *b, double m, double c) {
    build_hamiltonian(b, &lg_hamiltonian_chain, 1, LG_POTENTIAL_LINEAR, LG_TANH);
    const double theta[5] = {0.0, 0.0, c, 0.0, m};
    memcpy(b->theta, theta, sizeof theta);
    build_again(b);
}

static inline void build_surrogate(built *b, lg_surrogate_kind kind) {
    const lg_surrogate_options options = {.kind = kind,
                                          .architecture = LG_NET_MULT,
                                          .embedding = 7,
                                          .hidden = 9,
                                          .layers = 2,
                                          .activation = LG_TANH,
                                          .normalise = true,
                                          .boundary = kind == LG_SURROGATE_ANGLE};
    lg_rng rng;
    *b = (built){.model = NULL};
    assert_ok(lg_surrogate_init(&b->surrogate, &options, 6, 3.3, 1.2, NULL));
    const size_t n = lg_surrogate_parameters(&b->surrogate);
    b->theta = room(n);
    lg_rng_seed(&rng, 22, (uint64_t)kind);
    for (size_t i = 0; i < n; i++) b->theta[i] = 0.3 * lg_rng_normal(&rng);
    assert_ok(lg_model_create_surrogate(NULL, &b->surrogate, b->theta, &b->model, NULL));
    build_work(b);
}

static inline void build_detector(built *b, lg_activation activation) {
    enum { CHANNELS = 2, LENGTH = 60, CLASSES = 3 };
    lg_rng rng;
    *b = (built){.model = NULL};
    b->detector = (lg_detector){.net = lg_cnn_defaults(CHANNELS, LENGTH, CLASSES, activation),
                                .classes = CLASSES,
                                .loss = LG_DETECTOR_CROSS_ENTROPY};
    assert_ok(lg_detector_check(&b->detector, NULL));
    b->mean = room(CHANNELS);
    b->scale = room(CHANNELS);
    for (int c = 0; c < CHANNELS; c++) b->mean[c] = 0.1 + c, b->scale[c] = 2.0 + c;
    b->scaler = (lg_scaler){.channels = CHANNELS, .mean = b->mean, .scale = b->scale};
    b->theta = room(lg_cnn_parameters(&b->detector.net));
    lg_rng_seed(&rng, 23, 0);
    lg_cnn_initialise(&b->detector.net, LG_INIT_FAN_IN, &rng, b->theta);
    assert_ok(lg_model_create_detector(NULL, &b->detector, &b->scaler, b->theta, &b->model, NULL));
    build_work(b);
}

static inline void build_free(built *b) {
    for (size_t i = 0; i < 64; i++) assert_int_equal(((unsigned char *)b->work)[b->bytes + i], 0x41);
    lg_model_destroy(b->model);
    free(b->work);
    free(b->theta);
    free(b->mean);
    free(b->scale);
}

static inline bool is_chain(const built *b) {
    return b->hamiltonian.family == &lg_hamiltonian_chain;
}

static inline lg_space space_of(const built *b) {
    lg_space space;
    assert_ok(lg_hamiltonian_space(b->hamiltonian.family, b->hamiltonian.n, &space));
    return space;
}

/* A random state, on the manifold. */
static inline void draw_state(const built *b, lg_rng *rng, double *y) {
    const lg_space space = space_of(b);
    for (size_t i = 0; i < space.dim; i++) y[i] = lg_rng_normal(rng);
    lg_space_project(&space, y);
}

#endif
