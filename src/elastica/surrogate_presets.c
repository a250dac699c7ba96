/* Presets of hyperparameters for the surrogates: published ones and our own. Among the rows that match a
 * request, the row whose fraction of training data is nearest to the requested one is used. */
#include <math.h>
#include <string.h>

#include "core/count.h"
#include "liegrad/elastica.h"

/* The settings of network and training, in the order of the table's columns. */
#define MODEL(kind_, architecture_, embedding_, layers_, hidden_, activation_, normalise_, mirror_,          \
              boundary_, between_, modes_, loss_, gamma_)                                                    \
    {                                                                                                        \
        .kind = kind_, .architecture = architecture_, .embedding = embedding_, .hidden = hidden_,            \
        .layers = layers_, .activation = activation_, .normalise = normalise_, .mirror = mirror_,            \
        .boundary = boundary_, .between = between_, .modes = modes_, .loss = loss_,                          \
        .angles = (loss_) == LG_SURROGATE_ENERGY, .gamma = gamma_                                            \
    }
#define TRAINING(epochs_, batch_, lr_, schedule_, every_, factor_, decay_, clip_, shards_)                   \
    {                                                                                                        \
        .dtype = LG_F32, .epochs = epochs_, .batch = batch_, .lr = lr_, .schedule = LG_SCHEDULE_##schedule_, \
        .lr_step = every_, .lr_gamma = factor_, .weight_decay = decay_, .adam_eps = 1e-8, .clip = clip_,     \
        .validation = 0.0, .shards = shards_, .seed = 1                                                      \
    }
/* Training by a minimiser that uses the loss of all samples (ssbroyden). Batch and learning rate are for
 * --optimizer adam. */
#define SECOND_ORDER(epochs_, batch_, shards_)                                                               \
    {                                                                                                        \
        .plan = {1, {{LG_FIT_SSBROYDEN, 0}}}, .dtype = LG_F64, .epochs = epochs_, .batch = batch_,           \
        .lr = 3e-3, .schedule = LG_SCHEDULE_COSINE, .lr_step = 1, .lr_gamma = 1e-3, .weight_decay = 0.0,     \
        .adam_eps = 1e-8, .clip = 1e-2, .validation = 0.0, .shards = shards_, .seed = 1                      \
    }
/* Perceptrons that output modes (mean square error) or angles (energy). */
#define SMALL(merged, layers, hidden, modes, loss, epochs)                                                   \
    {                                                                                                        \
        "best", LG_SURROGATE_DISCRETE, false, merged, 0.9, "ours",                                           \
            MODEL(LG_SURROGATE_DISCRETE, LG_NET_MLP, 0, layers, hidden, LG_TANH, true, true, false, false,   \
                  modes, loss, 0.0),                                                                         \
            SECOND_ORDER(epochs, 16, 4), 0                                                                   \
    }
/* Perceptrons that take s. Each evaluation of the loss uses all points of all curves; that is why few curves
 * are used. */
#define SMALL_OF_S(kind, boundary, merged, layers, hidden, between, gamma, epochs, batch, curves)            \
    {                                                                                                        \
        "best", LG_SURROGATE_##kind, boundary, merged, 0.9, "ours",                                          \
            MODEL(LG_SURROGATE_##kind, LG_NET_MLP, 0, layers, hidden, LG_TANH,                               \
                  LG_SURROGATE_##kind == LG_SURROGATE_CONTINUOUS, true, boundary, between, 0,                \
                  LG_SURROGATE_MSE, gamma),                                                                  \
            SECOND_ORDER(epochs, batch, 4), curves                                                           \
    }
/* Multilayer perceptron from the boundary conditions to all inner nodes. It has more parameters than a batch
 * has numbers, so adding up the gradients of several shards would cost more than it saves: there is one
 * shard. */
#define DISCRETE(name, merged, fraction, source, layers, hidden, act, normalise, mirror, gamma, ...)         \
    {                                                                                                        \
        name, LG_SURROGATE_DISCRETE, false, merged, fraction, source "; penalty of the published program",   \
            MODEL(LG_SURROGATE_DISCRETE, LG_NET_MLP, 0, layers, hidden, act, normalise, mirror, false,       \
                  false, 0, LG_SURROGATE_MSE, gamma),                                                        \
            TRAINING(__VA_ARGS__), 0                                                                         \
    }
/* Multiplicative network of s and the boundary conditions, behind an embedding of the same width. */
#define CONTINUOUS(name, merged, fraction, source, kind, layers, hidden, act, normalise, mirror, between,    \
                   gamma, ...)                                                                               \
    {                                                                                                        \
        name, LG_SURROGATE_CONTINUOUS, false, merged, fraction,                                              \
            source "; network and gamma of the published program, not of the text",                          \
            MODEL(LG_SURROGATE_CONTINUOUS, LG_NET_##kind, hidden, layers, hidden, act, normalise, mirror,    \
                  false, between, 0, LG_SURROGATE_MSE, gamma),                                               \
            TRAINING(__VA_ARGS__), 0                                                                         \
    }
/* The same kind of network, of the end angles and s. A batch of 20 curves has about 1000 points. */
#define ANGLE(name, boundary, merged, fraction, source, kind, layers, hidden, act, mirror, ...)              \
    {                                                                                                        \
        name, LG_SURROGATE_ANGLE, boundary, merged, fraction,                                                \
            source "; network of the published program, not of the text",                                    \
            MODEL(LG_SURROGATE_ANGLE, LG_NET_##kind, hidden, layers, hidden, act, false, mirror, boundary,   \
                  false, 0, LG_SURROGATE_MSE, 0.0),                                                          \
            TRAINING(__VA_ARGS__), 0                                                                         \
    }

/* clang-format off */
static const lg_surrogate_preset presets[] = {
    /*       name     merged  part  source        l  hidden  activation   norm.  mirror gamma      epochs batch lr        schedule every factor decay clip shards */
    DISCRETE("thesis", false, 0.1, "table 5.12", 4,  950, LG_TANH,        false, false, 8.595e-3,  300,  64, 1.019e-3,  STEP, 100, 0.1, 1.79e-6, 0.0,  1),
    DISCRETE("thesis", false, 0.2, "table 5.12", 4,  351, LG_TANH,        false, false, 2.973e-3,  300,  32, 5.455e-3,  STEP, 100, 0.1, 2.142e-7, 0.0,  1),
    DISCRETE("thesis", false, 0.4, "table 5.12", 3,  904, LG_TANH,        false, false, 9.338e-3,  300,  32, 1.429e-3,  STEP, 100, 0.1, 1.317e-7, 0.0,  1),
    DISCRETE("thesis", false, 0.9, "table 5.3",  4,  879, LG_TANH,        true,  false, 4.242e-3,  300,  32, 1.378e-3,  STEP, 100, 0.1, 1.535e-7, 0.0,  1),
    DISCRETE("thesis", true,  0.9, "table 5.5",  2, 1006, LG_LEAKY_RELU,  true,  false, 6.388e-3,  300,  32, 3.611e-3,  STEP, 100, 0.1, 1.515e-7, 0.0,  1),
    /*    merged l  hidden most modes, loss  epochs */
    SMALL(false, 1, 16, 64, LG_SURROGATE_MSE,    5000),
    SMALL(true,  1, 20, 64, LG_SURROGATE_MSE,    5000),
    SMALL(false, 1, 16, 0,  LG_SURROGATE_ENERGY, 3000),
    SMALL(true,  1, 16, 0,  LG_SURROGATE_ENERGY, 3000),

    CONTINUOUS("thesis", false, 0.1, "table 5.13", MULT_AFFINE, 5, 193, LG_TANH, true, false, false, 2e-2,  100, 1024, 4.548e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.2, "table 5.13", MULT_AFFINE, 6, 121, LG_TANH, true, false, false, 2e-2,  100, 1024, 4.913e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.4, "table 5.13", MULT_AFFINE, 6, 169, LG_SINE, true, false, false, 2e-2,  100, 1024, 4.2e-3,    STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.9, "table 5.7",  MULT_AFFINE, 5, 190, LG_TANH, true, false, false, 2e-2,  100, 1024, 3.025e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),

    /*     name   boundary merged  part   source       l  hidden  act.   mirror epochs batch lr     schedule every factor decay clip shards */
    ANGLE("thesis", false, false, 0.9, "table 5.10", MULT_AFFINE, 7, 143, LG_TANH, false,  100, 20, 3.007e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    ANGLE("thesis", true,  false, 0.9, "table 5.11", MULT_AFFINE, 4, 175, LG_TANH, false,  100, 20, 1.846e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),

    /*         kind       boundary merged l  hidden between gamma epochs batch curves */
    SMALL_OF_S(CONTINUOUS, false, false,  3, 24, true,  2e-2, 2000, 256, 200),
    SMALL_OF_S(CONTINUOUS, false, true,   3, 24, true,  2e-2, 2000, 256, 400),
    SMALL_OF_S(CONTINUOUS, true,  false,  3, 24, true,  2e-2, 2000, 256, 200),
    SMALL_OF_S(CONTINUOUS, true,  true,   3, 24, true,  2e-2, 2000, 256, 400),
    SMALL_OF_S(ANGLE,      false, false,  2, 20, false, 0.0,  2000, 5,   200),
    SMALL_OF_S(ANGLE,      true,  false,  2, 20, false, 0.0,  2000, 5,   200),
    SMALL_OF_S(ANGLE,      false, true,   2, 20, false, 0.0,  2000, 5,   400),
    SMALL_OF_S(ANGLE,      true,  true,   2, 20, false, 0.0,  2000, 5,   400),
};
/* clang-format on */

const lg_surrogate_preset *lg_surrogate_preset_find(const char *name, lg_surrogate_kind kind, bool boundary,
                                                    lg_surrogate_loss loss, bool merged, double fraction) {
    const lg_surrogate_preset *best = NULL;
    if (name == NULL || isnan(fraction)) return NULL;
    for (size_t i = 0; i < LG_COUNT(presets); i++) {
        const lg_surrogate_preset *row = &presets[i];
        if (row->kind != kind || row->boundary != boundary || row->model.loss != loss ||
            row->merged != merged || strcmp(row->name, name) != 0)
            continue;
        if (best == NULL || fabs(row->fraction - fraction) < fabs(best->fraction - fraction)) best = row;
    }
    return best;
}
