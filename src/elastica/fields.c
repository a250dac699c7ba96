/* The hyperparameters of a beam surrogate. */
#include "liegrad/elastica.h"

#include "settings/training.h"

enum {
    DISCRETE = 1u << LG_SURROGATE_DISCRETE,
    CONTINUOUS = 1u << LG_SURROGATE_CONTINUOUS,
    ANGLE = 1u << LG_SURROGATE_ANGLE
};

static const char *loss_name(lg_surrogate_loss loss) {
    static const char *const names[LG_SURROGATE_LOSS_COUNT] = {"mse", "energy"};
    return names[loss];
}

#define SURROGATE(group, name, type, member, ...)                                                            \
    LG_FIELD(lg_surrogate_run, group, name, type, member, __VA_ARGS__)
#define OPTION(group, member, type, ...) SURROGATE(group, #member, type, model.options.member, __VA_ARGS__)
const lg_field lg_surrogate_fields[] = {
    SURROGATE("model", "network", NAME, model.options.kind,
              LG_NAMED(lg_surrogate_kind_name, LG_SURROGATE_KIND_COUNT), .value = "discrete", .usual = true,
              .meaning = "Kind of network"),
    OPTION("model", architecture, NAME, LG_NAMED(lg_net_kind_name, LG_NET_KIND_COUNT), PRESET(),
           .usual = true, .meaning = "Architecture of the network"),
    ACTIVATION(lg_surrogate_run, model.options.activation, "Activation of the hidden layers", PRESET()),
    OPTION("model", embedding, U32, .high = 1 << 20, PRESET(), .unit = "E",
           .meaning = "Width of the layer sin(2 pi (x A + b)) before the network, 0 for none"),
    OPTION("model", hidden, U32, .usual = true, .low = 1, .high = 1 << 20, PRESET(), .unit = "W",
           .meaning = "Width of the hidden layers"),
    OPTION("model", layers, U32, .high = LG_NET_MAX_LAYERS, PRESET(), .unit = "l",
           .meaning = "Hidden layers after the first one"),
    OPTION("model", normalise, FLAG, LG_NAMES("false", "true"), PRESET(),
           .meaning = "Scale the ends' x-coordinates to (x - c)/c, c half their distance"),
    OPTION("model", mirror, FLAG, LG_NAMES("false", "true"), PRESET(),
           .meaning = "Learn one half of the boundary conditions; the other is its mirror image"),
    OPTION("model", boundary, FLAG, LG_NAMES("false", "true"), .value = "false",
           .methods = CONTINUOUS | ANGLE,
           .meaning = "Hold the ends by construction; continuous: q and v, angle: the end angles"),
    OPTION("model", symmetric, FLAG, LG_NAMES("false", "true"), .optional = true, .value = "false",
           .methods = ANGLE, .meaning = "Reconstruct q from both ends; false: from the first"),
    OPTION("model", modes, U32, .high = 1 << 20, .optional = true,
           .otherwise = LG_CHOSEN ": as many as the curves need", .unit = "K", .methods = DISCRETE,
           .meaning =
               "Fixed last layer: leading singular vectors of the training curves, 0 for a learned one"),
    OPTION("model", angles, FLAG, LG_NAMES("false", "true"), .optional = true, PRESET(), .methods = DISCRETE,
           .meaning = "Discrete network gives the inner angles: tangents are then unit vectors, nodes follow "
                      "from them"),
    OPTION("run", loss, NAME, LG_NAMED(loss_name, LG_SURROGATE_LOSS_COUNT), .optional = true, .value = "mse",
           .methods = DISCRETE,
           .meaning = "mse: mean squared error of the curves; energy: energy of the predicted curves, which "
                      "needs --angles true but no solved curves"),
    OPTION("run", gamma, REAL, .option = "penalty", .high = 1e12, PRESET(), .unit = "G",
           .methods = DISCRETE | CONTINUOUS,
           .meaning = "discrete: weight of node-to-node differences; continuous: of |v|^2 = 1"),
    OPTION("run", energy, REAL, .high = 1e12, .optional = true, .value = "0", .unit = "W",
           .meaning = "Weight of the beam's energy, with its constraints' multipliers, in the loss"),
    OPTION("run", residual, REAL, .high = 1e12, .optional = true, .value = "0", .unit = "W",
           .methods = CONTINUOUS | ANGLE,
           .meaning = "Weight of the error of the beam's differential equation in the loss"),
    PENALTY_FORM(lg_surrogate_run, model.options.penalty,
                 LG_NAMES([LG_SURROGATE_DIFFERENCES] = "published", [LG_SURROGATE_WEIGHTED] = "text"),
                 .optional = true, .value = "published", .methods = DISCRETE,
                 .meaning =
                     "What --penalty weighs: text, the matrix W of (5.4.1); published, the differences that "
                     "the thesis' program takes"),
    OPTION("run", between, FLAG, LG_NAMES("false", "true"), PRESET(),
           .meaning = "Continuous network: learn from interpolated points between the nodes too"),
    SURROGATE("run", "train_fraction", REAL, train_fraction, .high = 1, .value = "0.9", .unit = "F",
              .usual = true, .meaning = "Part of the curves for training"),
    TEST_FRACTION(lg_surrogate_run, "Part of the curves for testing, the same for every --train-fraction",
                  .high = 1, .value = "0.1"),
    SURROGATE(
        "run", "most_curves", U64, most_curves, .high = 1e9, .optional = true, PRESET(), .unit = "n",
        .meaning =
            "Learn from at most this many curves of the training part, evenly chosen; 0: from all curves"),
    TRAINING_ROWS(lg_surrogate_run, "method", any_loss, "Curves (continuous: points)", 0, PRESET, PRESET),
    VALIDATION(lg_surrogate_run, PRESET()),
    LG_FIELD_END};
