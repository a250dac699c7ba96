/* Published hyperparameters of the surrogates, and our own. Each row is a setting. Among the rows that fit,
 * the one with the nearest part of the data is used. */
#include <math.h>
#include <string.h>

#include "core/count.h"
#include "liegrad/surrogate.h"

/* Network, then training, in the order of the columns below. */
#define MODEL(kind_, architecture_, embedding_, layers_, hidden_, activation_, normalise_, mirror_,          \
              boundary_, between_, gamma_)                                                                   \
    {                                                                                                        \
        .kind = kind_, .architecture = architecture_, .embedding = embedding_, .hidden = hidden_,            \
        .layers = layers_, .activation = activation_, .normalise = normalise_, .mirror = mirror_,            \
        .boundary = boundary_, .between = between_, .gamma = gamma_                                          \
    }
#define TRAINING(epochs_, batch_, lr_, schedule_, every_, factor_, decay_, clip_, shards_)                   \
    {                                                                                                        \
        .dtype = LG_F32, .epochs = epochs_, .batch = batch_, .lr = lr_, .schedule = LG_SCHEDULE_##schedule_, \
        .lr_step = every_, .lr_gamma = factor_, .weight_decay = decay_, .adam_eps = 1e-8, .clip = clip_,     \
        .validation = 0.0, .shards = shards_, .seed = 1                                                      \
    }
/* Multilayer perceptron from the boundary conditions to all inner nodes. It has more parameters than a batch
 * has numbers, hence one shard. */
#define DISCRETE(name, merged, fraction, source, layers, hidden, act, normalise, mirror, gamma, ...)         \
    {                                                                                                        \
        name, LG_SURROGATE_DISCRETE, false, merged, fraction, source,                                        \
            MODEL(LG_SURROGATE_DISCRETE, LG_NET_MLP, 0, layers, hidden, act, normalise, mirror, false,       \
                  false, gamma),                                                                             \
            TRAINING(__VA_ARGS__)                                                                            \
    }
/* Multiplicative network of s and the boundary conditions, after an embedding of the same width. */
#define CONTINUOUS(name, merged, fraction, source, kind, layers, hidden, act, normalise, mirror, between,    \
                   gamma, ...)                                                                               \
    {                                                                                                        \
        name, LG_SURROGATE_CONTINUOUS, false, merged, fraction, source,                                      \
            MODEL(LG_SURROGATE_CONTINUOUS, LG_NET_##kind, hidden, layers, hidden, act, normalise, mirror,    \
                  false, between, gamma),                                                                    \
            TRAINING(__VA_ARGS__)                                                                            \
    }
/* The same network of the end angles and s; a batch of 20 curves has about 1000 points. */
#define ANGLE(name, boundary, merged, fraction, source, kind, layers, hidden, act, mirror, ...)              \
    {                                                                                                        \
        name, LG_SURROGATE_ANGLE, boundary, merged, fraction, source,                                        \
            MODEL(LG_SURROGATE_ANGLE, LG_NET_##kind, hidden, layers, hidden, act, false, mirror, boundary,   \
                  false, 0.0),                                                                               \
            TRAINING(__VA_ARGS__)                                                                            \
    }

/* clang-format off */
static const lg_surrogate_preset presets[] = {
    /*       name     merged  part  source        l  hidden  activation   norm.  mirror gamma      epochs batch lr        schedule every factor decay clip shards */
    DISCRETE("thesis", false, 0.1, "table 5.12", 4,  950, LG_TANH,        false, false, 8.595e-3,  300,  64, 1.019e-3,  STEP, 100, 0.1, 1.79e-6, 0.0,  1),
    DISCRETE("thesis", false, 0.2, "table 5.12", 4,  351, LG_TANH,        false, false, 2.973e-3,  300,  32, 5.455e-3,  STEP, 100, 0.1, 2.142e-7, 0.0,  1),
    DISCRETE("thesis", false, 0.4, "table 5.12", 3,  904, LG_TANH,        false, false, 9.338e-3,  300,  32, 1.429e-3,  STEP, 100, 0.1, 1.317e-7, 0.0,  1),
    DISCRETE("thesis", false, 0.9, "table 5.3",  4,  879, LG_TANH,        true,  false, 4.242e-3,  300,  32, 1.378e-3,  STEP, 100, 0.1, 1.535e-7, 0.0,  1),
    DISCRETE("thesis", true,  0.9, "table 5.5",  2, 1006, LG_LEAKY_RELU,  true,  false, 6.388e-3,  300,  32, 3.611e-3,  STEP, 100, 0.1, 1.515e-7, 0.0,  1),
    DISCRETE("best",   false, 0.9, "ours",       4,  128, LG_TANH,        true,  true,  4.242e-3,  300,  16, 3.0e-3,  COSINE, 1, 1e-4, 0.0, 1e-2, 1),
    DISCRETE("best",   true,  0.9, "ours",       4,  128, LG_TANH,        true,  true,  4.242e-3,  300,  16, 3.0e-3,  COSINE, 1, 1e-4, 0.0, 1e-2, 1),

    CONTINUOUS("thesis", false, 0.1, "table 5.13", MULT_AFFINE, 5, 193, LG_TANH, true, false, false, 2e-2,  100, 1024, 4.548e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.2, "table 5.13", MULT_AFFINE, 6, 121, LG_TANH, true, false, false, 2e-2,  100, 1024, 4.913e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.4, "table 5.13", MULT_AFFINE, 6, 169, LG_SINE, true, false, false, 2e-2,  100, 1024, 4.2e-3,    STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("thesis", false, 0.9, "table 5.7",  MULT_AFFINE, 5, 190, LG_TANH, true, false, false, 2e-2,  100, 1024, 3.025e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    CONTINUOUS("best",   false, 0.9, "ours",       MULT,        4,  64, LG_TANH, true, true,  true,  2e-2,  100,  256, 3.0e-3,    COSINE, 1, 1e-3, 0.0, 1e-2, 4),
    CONTINUOUS("best",   true,  0.9, "ours",       MULT,        4,  64, LG_TANH, true, true,  true,  2e-2,  100,  256, 3.0e-3,    COSINE, 1, 1e-3, 0.0, 1e-2, 4),

    /*     name   boundary merged  part   source       l  hidden  act.   mirror epochs batch lr     schedule every factor decay clip shards */
    ANGLE("thesis", false, false, 0.9, "table 5.10", MULT_AFFINE, 7, 143, LG_TANH, false,  100, 20, 3.007e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    ANGLE("thesis", true,  false, 0.9, "table 5.11", MULT_AFFINE, 4, 175, LG_TANH, false,  100, 20, 1.846e-3,  STEP, 45, 0.1, 0.0, 0.0,  4),
    ANGLE("best",   false, false, 0.9, "ours",       MULT,        4,  64, LG_TANH, true,   100,  5, 3.0e-3,  COSINE, 1, 1e-3, 0.0, 1e-2, 4),
    ANGLE("best",   true,  false, 0.9, "ours",       MULT,        4,  64, LG_TANH, true,   100,  5, 3.0e-3,  COSINE, 1, 1e-3, 0.0, 1e-2, 4),
    ANGLE("best",   false, true,  0.9, "ours",       MULT,        4,  64, LG_TANH, true,   100,  5, 3.0e-3,  COSINE, 1, 1e-3, 0.0, 1e-2, 4),
    ANGLE("best",   true,  true,  0.9, "ours",       MULT,        4,  64, LG_TANH, true,   100,  5, 3.0e-3,  COSINE, 1, 1e-3, 0.0, 1e-2, 4),
};
/* clang-format on */

const lg_surrogate_preset *lg_surrogate_preset_find(const char *name, lg_surrogate_kind kind, bool boundary,
                                                    bool merged, double fraction) {
    const lg_surrogate_preset *best = NULL;
    if (name == NULL || isnan(fraction)) return NULL;
    for (size_t i = 0; i < LG_COUNT(presets); i++) {
        const lg_surrogate_preset *row = &presets[i];
        if (strcmp(row->name, name) != 0 || row->kind != kind || row->boundary != boundary ||
            row->merged != merged)
            continue;
        if (best == NULL || fabs(row->fraction - fraction) < fabs(best->fraction - fraction)) best = row;
    }
    return best;
}
