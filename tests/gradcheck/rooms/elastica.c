/* Cases of the gradient check: losses of the surrogates, differentiated by all parameters. */
#include "gradcheck/table.h"
#include "liegrad/elastica.h"

enum { CURVES = 2, INTERVALS = 3, NODES = INTERVALS + 1, MAX_SAMPLES = CURVES * NODES };

/* Two curves: nodes, then unit tangents. They need not be minima of the energy. `mirror` reflects the second
 * one. */
static double nodes[CURVES * NODES * 2] = {0.0, 0.0,  0.3, 0.35, 0.7, 0.3,   0.9,  0.0,
                                           0.0, -0.1, 0.4, -0.3, 0.8, -0.35, 0.95, 0.05};
static double tangents[CURVES * NODES * 2] = {0.6, 0.8,  0.8, 0.6,  1.0, 0.0,  0.6, -0.8,
                                              0.8, -0.6, 1.0, -0.0, 0.8, 0.60, 0.0, 1.0};
static double boundary[CURVES * 8] = {0.0, 0.0,  0.6, 0.8,  0.9,  0.0,  0.6, -0.8,
                                      0.0, -0.1, 0.8, -0.6, 0.95, 0.05, 0.0, 1.0};

/* For networks with modes: mean and two vectors; targets of both curves. */
enum { MODES = 2 };
static const double modes[(MODES + 1) * 4 * (INTERVALS - 1)] = {0.3, 0.1, 0.6,  0.2, 0.7, 0.1, 0.9,  -0.1,
                                                                0.5, 0.2, -0.1, 0.4, 0.2, 0.3, -0.3, 0.1,
                                                                0.1, 0.2, -0.1, 0.3, 0.2, 0.1, 0.3,  -0.2};
static const double coefficients[CURVES * MODES] = {0.7, -0.4, -1.1, 0.3};

static lg_var build(const void *user, lg_tape *tape, const lg_var *x) {
    static const uint32_t training[CURVES] = {0, 1};
    const lg_elastica_curves curves = {.count = CURVES,
                                       .intervals = INTERVALS,
                                       .length = 1.1,
                                       .stiffness = 1.0,
                                       .boundary = boundary,
                                       .q = nodes,
                                       .v = tangents};
    uint32_t samples[MAX_SAMPLES];
    lg_surrogate model;
    lg_fit_problem fit;
    lg_var loss = LG_NONE;
    lg_status status = lg_surrogate_init(&model, user, INTERVALS, curves.length, 0.5, NULL);
    const lg_surrogate_problem problem = {&model, &curves, training, CURVES, coefficients};
    model.modes = modes;
    if (status == LG_OK) status = lg_surrogate_problem_check(&problem, NULL);
    if (status != LG_OK) return lg_tape_fail(tape, status, "surrogate", "not a learning problem");
    lg_surrogate_fit_problem(&problem, &fit);
    if (fit.parameters != lg_var_shape(tape, x[0]).dims[0])
        return lg_tape_fail(tape, LG_SHAPE, "surrogate",
                            "the number of parameters is not the number of the surrogate");
    for (uint32_t i = 0; i < fit.samples; i++) samples[i] = i;
    status = fit.loss(fit.user, tape, x[0], samples, fit.samples, fit.samples, &loss);
    return status == LG_OK ? loss : lg_tape_fail(tape, status, "surrogate", "the loss failed");
}

/* Number of parameters with i inputs, o outputs and one hidden layer of 3:
 *   perceptron             (i + 1) 3 + 12 + 4 o; a residual network has 9 more
 *   multiplicative network 3 (i + 1) 3 + 12 + 4 o; with an affine gate 12 more
 * An embedding of 2 adds (i + 1) 2 parameters in front, and then i = 2. */
#define ROW(label, parameters, ...)                                                                          \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "surrogate " label,                                                                      \
            .build = build,                                                                                  \
            .user =                                                                                          \
                &(const lg_surrogate_options){__VA_ARGS__, .hidden = 3, .layers = 1, .activation = LG_TANH}, \
            INPUTS({.shape = S1(parameters), .low = -0.6, .high = 0.6, .scale = 0.5})                        \
        }                                                                                                    \
    }

static const lg_gradcheck_case rows[] = {
    ROW("discrete", 27 + 12 + 4 * 8, .kind = LG_SURROGATE_DISCRETE, .architecture = LG_NET_MLP),
    ROW("discrete, differences", 27 + 12 + 9 + 4 * 8, .kind = LG_SURROGATE_DISCRETE,
        .architecture = LG_NET_RESNET, .normalise = true, .mirror = true, .gamma = 0.7),
    ROW("discrete, modes", 27 + 12 + 4 * MODES, .kind = LG_SURROGATE_DISCRETE, .architecture = LG_NET_MLP,
        .mirror = true, .modes = MODES),
    ROW("discrete, modes and differences", 27 + 12 + 4 * MODES, .kind = LG_SURROGATE_DISCRETE,
        .architecture = LG_NET_MLP, .mirror = true, .modes = MODES, .gamma = 0.7),
    ROW("discrete, angles", 27 + 12 + 4 * 2, .kind = LG_SURROGATE_DISCRETE, .architecture = LG_NET_MLP,
        .normalise = true, .mirror = true, .angles = true),
    ROW("discrete, energy", 27 + 12 + 4 * 2, .kind = LG_SURROGATE_DISCRETE, .architecture = LG_NET_MLP,
        .mirror = true, .angles = true, .loss = LG_SURROGATE_ENERGY),
    ROW("continuous", 3 * 30 + 12 + 8, .kind = LG_SURROGATE_CONTINUOUS, .architecture = LG_NET_MULT),
    ROW("continuous, unit tangents", 20 + 3 * 9 + 24 + 8, .kind = LG_SURROGATE_CONTINUOUS,
        .architecture = LG_NET_MULT_AFFINE, .embedding = 2, .normalise = true, .mirror = true, .gamma = 0.7),
    ROW("angle", 12 + 12 + 4, .kind = LG_SURROGATE_ANGLE, .architecture = LG_NET_MLP),
    ROW("angle, ends held", 8 + 3 * 9 + 24 + 4, .kind = LG_SURROGATE_ANGLE,
        .architecture = LG_NET_MULT_AFFINE, .embedding = 2, .mirror = true, .boundary = true),
    ROW("discrete, curves and energy", 27 + 12 + 4 * 2, .kind = LG_SURROGATE_DISCRETE,
        .architecture = LG_NET_MLP, .mirror = true, .angles = true, .energy = 0.3),
    ROW("continuous, residual", 3 * 30 + 12 + 8, .kind = LG_SURROGATE_CONTINUOUS, .architecture = LG_NET_MULT,
        .mirror = true, .residual = 0.2),
    ROW("continuous, ends held, energy", 30 + 12 + 8, .kind = LG_SURROGATE_CONTINUOUS,
        .architecture = LG_NET_MLP, .mirror = true, .boundary = true, .energy = 0.3),
    ROW("angle, residual", 12 + 12 + 4, .kind = LG_SURROGATE_ANGLE, .architecture = LG_NET_MLP,
        .mirror = true, .symmetric = true, .residual = 0.2),
    ROW("angle, ends held, energy and residual", 12 + 12 + 4, .kind = LG_SURROGATE_ANGLE,
        .architecture = LG_NET_MLP, .mirror = true, .boundary = true, .energy = 0.3, .residual = 0.2),
};

FAMILY(elastica)
