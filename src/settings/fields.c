/* The tables of hyperparameters; fields from and to text and numbers. */
#include "liegrad/fields.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "settings/names.h"
#include "model/files/recipe.h"
#include "liegrad/machine_model.h"

_Static_assert(sizeof(lg_dtype) == sizeof(uint32_t) && sizeof(lg_activation) == sizeof(uint32_t) &&
                   sizeof(bool) == 1,
               "enumerations are read through their representation");

/* ---- rows ---- */

/* What every kind has: how it is trained. VALUE(text) says the default. */
#define TRAINING(run_, member, type, ...) LG_FIELD(run_, "run", #member, type, training.member, __VA_ARGS__)
#define TRAINING_ROWS(run_, method_, losses_, samples, methods_, VALUE)                                      \
    LG_FIELD(run_, "run", method_, PHRASE, training.plan, .parse = parse_##losses_, .phrase = show_plan,     \
             .value_name = name_##losses_, .form = "phases as in adam:100,ssbroyden", .optional = true,      \
             .methods = methods_, VALUE("adam"), .unit = "M",                                                \
             .meaning = "Method of training; an epoch of the others is one "                                 \
                        "evaluation of the loss of all data"),                                               \
        TRAINING(run_, dtype, NAME, .value_name = lg_name_dtype, .methods = methods_, VALUE("f64"),          \
                 .meaning = "Type of the weights in training"),                                              \
        TRAINING(run_, epochs, U64, .low = 1, .high = 1e9, .methods = methods_, VALUE("100"), .unit = "E",   \
                 .meaning = "Planned total number of epochs, those before a resume included"),               \
        TRAINING(run_, batch, U64, .adam = true, .low = 1, .high = 1e9, .methods = methods_, VALUE("80"),    \
                 .unit = "B", .meaning = samples " in a batch"),                                             \
        TRAINING(run_, lr, REAL, .adam = true, .high = 1e3, .above = true, .methods = methods_,              \
                 VALUE("1e-2"), .unit = "R", .meaning = "Learning rate of Adam"),                            \
        TRAINING(run_, schedule, NAME, .adam = true, .value_name = lg_name_schedule, .optional = true,       \
                 .methods = methods_, VALUE("step"), .meaning = "Schedule of the learning rate"),            \
        TRAINING(run_, lr_step, U64, .adam = true, .low = 1, .high = 1e9, .methods = methods_, VALUE("50"),  \
                 .unit = "E",                                                                                \
                 .meaning = "step: number of epochs after which the rate is multiplied by --lr-gamma"),      \
        TRAINING(run_, lr_gamma, REAL, .adam = true, .high = 1, .methods = methods_, VALUE("0.1"),           \
                 .unit = "G", .meaning = "step: that factor, above 0; cosine: the last factor"),             \
        TRAINING(run_, weight_decay, REAL, .high = 1e3, .methods = methods_, VALUE("0"), .unit = "W",        \
                 .meaning = "L2 penalty in the gradient"),                                                   \
        TRAINING(run_, prior, REAL, .high = 1e6, .optional = true, .methods = methods_, VALUE("0"),          \
                 .unit = "S",                                                                                \
                 .meaning = "Standard deviation of the weights before any data: with it "                    \
                            "ssbroyden and lbfgs do not learn the noise of the data; 0 for none"),           \
        TRAINING(run_, adam_eps, REAL, .adam = true, .high = 1, .above = true, .methods = methods_,          \
                 VALUE("1e-12"), .unit = "EPS", .meaning = "Adam's eps"),                                    \
        TRAINING(run_, clip, REAL, .adam = true, .high = 1e300, .methods = methods_, VALUE("1e-3"),          \
                 .unit = "NORM", .meaning = "Bound on the gradient's norm, 0 for none"),                     \
        TRAINING(run_, shards, U32, .high = 1024, .methods = methods_, VALUE("0"), .unit = "n",              \
                 .meaning = "Pieces of a batch that threads work on, 0: by the work, 1 to 4; the bits "      \
                            "of the result depend on it"),                                                   \
        TRAINING(run_, patience, U64, .high = 1e9, .optional = true, .methods = methods_, VALUE("0"),        \
                 .unit = "E",                                                                                \
                 .meaning = "Stop after so many epochs, or accepted steps of the other methods than Adam, "  \
                            "without a lower loss, of the validation part if there is one; 0 for never"),    \
        TRAINING(run_, seed, U64, .high = 0x1p64, .option = "", .value = "1", .unit = "S",                   \
                 .meaning = "Seed of all random numbers")
#define VALIDATION                                                                                           \
    .high = 0.9, .unit = "F",                                                                                \
    .meaning = "Fraction kept for validation; the parameters of the best epoch are then the result"

/* The methods for a loss that is a sum of squares, and for any loss. */
static lg_status parse_squares(const char *text, void *member, lg_error *error) {
    return lg_fit_plan_parse(text, member, error);
}

static lg_status parse_any_loss(const char *text, void *member, lg_error *error) {
    return lg_fit_plan_parse_any_loss(text, member, error);
}

static const char *name_squares(uint32_t value) {
    return lg_fit_method_name((lg_fit_method)value);
}

static const char *name_any_loss(uint32_t value) {
    for (uint32_t method = 0; method < LG_FIT_METHOD_COUNT; method++)
        if (!lg_fit_method_squares((lg_fit_method)method) && value-- == 0) return name_squares(method);
    return NULL;
}

static void show_plan(const void *member, char *text, size_t size) {
    char plan[LG_FIT_PLAN_TEXT];
    lg_fit_plan_show(member, plan);
    (void)snprintf(text, size, "%s", plan);
}

#define CONSTANT(text) .value = text
#define PRESET(text)   .otherwise = "the preset's"

static uint32_t get_hidden(const void *member, double *values) {
    const lg_mlp *net = member;
    const uint32_t count = net->layers > 0 && net->layers <= LG_MLP_MAX_LAYERS ? net->layers - 1 : 0;
    for (uint32_t i = 0; i < count; i++) values[i] = net->width[i + 1];
    return count;
}

static void put_hidden(void *member, const double *values, uint32_t count) {
    lg_mlp *net = member;
    net->layers = count + 1;
    for (uint32_t i = 0; i < count; i++) net->width[i + 1] = (uint32_t)values[i];
}

/* No points stand for all of them: 0 as text. */
static uint32_t get_points(const void *member, double *values) {
    const lg_penalty_points *points = member;
    values[0] = 0;
    for (uint32_t i = 0; i < points->count && i < LG_PENALTY_POINTS; i++) values[i] = points->at[i];
    return points->count > 0 ? points->count : 1;
}

static void put_points(void *member, const double *values, uint32_t count) {
    lg_penalty_points *points = member;
    *points = (lg_penalty_points){.count = count == 1 && values[0] == 0 ? 0 : count};
    for (uint32_t i = 0; i < points->count; i++) points->at[i] = (uint32_t)values[i];
}

#define HAMILTONIAN(group, name, type, member, ...)                                                          \
    LG_FIELD(lg_hamiltonian_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_hamiltonian_fields[] = {
    HAMILTONIAN("model", "potential", NAME, model.potential, .value_name = lg_name_potential, .value = "mlp",
                .meaning = "The potential energy"),
    HAMILTONIAN("model", "symmetry", NAME, model.symmetry, .value_name = lg_name_symmetry, .optional = true,
                .value = "none", .meaning = "V(-q) = V(q) or -V(q)"),
    HAMILTONIAN("model", "activation", NAME, model.net.activation, .value_name = lg_name_activation,
                .value = "tanh", .meaning = "Activation of the hidden layers"),
    HAMILTONIAN("model", "hidden", WHOLES, model.net, .get = get_hidden, .put = put_hidden, .low = 1,
                .high = 1 << 20, .most = LG_MLP_MAX_LAYERS - 1, .value = "100,100,100", .unit = "W,W,...",
                .meaning = "Widths of the hidden layers of the potential"),
    HAMILTONIAN("run", "integrator", NAME, scheme, .value_name = lg_name_scheme, .value_at = lg_scheme_number,
                .otherwise = "that of the family, see lg-hamiltonian --help",
                .meaning = "Scheme of the steps between two points"),
    HAMILTONIAN("run", "substeps", U32, substeps, .low = 1, .high = 1e6, .value = "1", .unit = "n",
                .meaning = "Integrator steps between two points"),
    HAMILTONIAN("run", "penalty", REAL, penalty, .high = 1e12, .value = "0", .unit = "MU",
                .meaning = "Penalty on the change of a first integral, 0 for none"),
    HAMILTONIAN("run", "penalty_integral", NAME, penalty_integral, .value_name = lg_name_integral,
                .optional = true, .value = "oscillator",
                .meaning =
                    "The first integral of the penalty; not given, the first one that fits the system"),
    HAMILTONIAN("run", "penalty_copy", U32, penalty_copy, .optional = true, .high = LG_HAMILTONIAN_MAX_COPIES,
                .value = "0", .unit = "j",
                .meaning = "oscillator and anharmonic: number of the degree of freedom, from 1; 0 is 1"),
    HAMILTONIAN("run", "penalty_points", WHOLES, penalty_points, .get = get_points, .put = put_points,
                .high = LG_HAMILTONIAN_MAX_POINTS, .most = LG_PENALTY_POINTS, .optional = true, .value = "0",
                .unit = "j,j,...",
                .meaning =
                    "Points that have the penalty, from 2 on because a trajectory starts at 1; 0 for all"),
    HAMILTONIAN("run", "penalty_form", NAME, penalty_form, .value_name = lg_name_penalty_form,
                .value = "text",
                .meaning = "text: mean over the batch of squares; published: sum over the batch of absolute "
                           "values"),
    HAMILTONIAN("run", "distance", NAME, distance, .value_name = lg_name_distance, .optional = true,
                .value = "ambient",
                .meaning = "Distance of points in the loss: that of R^d, or along geodesics of the manifold"),
    HAMILTONIAN("run", "scaled", FLAG, scaled, .value_name = lg_name_yes, .optional = true, .value = "no",
                .meaning =
                    "Scale the potential's last layer before training, towards the forces of the data"),
    HAMILTONIAN(
        "run", "units", NAME, units, .value_name = lg_name_units, .optional = true, .value = "given",
        .meaning =
            "Units in which training computes and weighs its loss (given: the units of the data; data: "
            "scales of the data, so that the result does not depend on the units)"),
    HAMILTONIAN("run", "starts", NAME, starts, .value_name = lg_name_start, .optional = true,
                .value = "measured",
                .meaning = "Where predictions start: at the first points, or at estimated points near them, "
                           "for first points with noise"),
    TRAINING_ROWS(lg_hamiltonian_run, "method", squares, "Trajectories", 0, CONSTANT),
    TRAINING(lg_hamiltonian_run, validation, REAL, .value = "0", VALIDATION),
    LG_FIELD_END};

enum {
    DISCRETE = 1u << LG_SURROGATE_DISCRETE,
    CONTINUOUS = 1u << LG_SURROGATE_CONTINUOUS,
    ANGLE = 1u << LG_SURROGATE_ANGLE
};

#define SURROGATE(group, name, type, member, ...)                                                            \
    LG_FIELD(lg_surrogate_run, group, name, type, member, __VA_ARGS__)
#define OPTION(group, member, type, ...) SURROGATE(group, #member, type, model.options.member, __VA_ARGS__)
const lg_field lg_surrogate_fields[] = {
    SURROGATE("model", "network", NAME, model.options.kind, .value_name = lg_name_surrogate,
              .value = "discrete", .meaning = "Kind of network"),
    OPTION("model", architecture, NAME, .value_name = lg_name_net, PRESET(),
           .meaning = "Architecture of the network"),
    OPTION("model", activation, NAME, .value_name = lg_name_activation, PRESET(),
           .meaning = "Activation of the hidden layers"),
    OPTION("model", embedding, U32, .high = 1 << 20, PRESET(), .unit = "E",
           .meaning = "Width of the layer sin(2 pi (x A + b)) before the network, 0 for none"),
    OPTION("model", hidden, U32, .low = 1, .high = 1 << 20, PRESET(), .unit = "W",
           .meaning = "Width of the hidden layers"),
    OPTION("model", layers, U32, .high = LG_NET_MAX_LAYERS, PRESET(), .unit = "l",
           .meaning = "Hidden layers after the first one"),
    OPTION("model", normalise, FLAG, .value_name = lg_name_truth, PRESET(),
           .meaning = "Scale the ends' x-coordinates to (x - c)/c, c half their distance"),
    OPTION("model", mirror, FLAG, .value_name = lg_name_truth, PRESET(),
           .meaning = "Learn one half of the boundary conditions; the other is its mirror image"),
    OPTION("model", boundary, FLAG, .value_name = lg_name_truth, .value = "false",
           .methods = CONTINUOUS | ANGLE,
           .meaning = "Hold the ends by construction; continuous: q and v, angle: the end angles"),
    OPTION("model", symmetric, FLAG, .value_name = lg_name_truth, .optional = true, .value = "false",
           .methods = ANGLE, .meaning = "Reconstruct q from both ends; false: from the first"),
    OPTION("model", modes, U32, .high = 1 << 20, .optional = true,
           .otherwise = "the preset's, as many as the curves need", .unit = "K", .methods = DISCRETE,
           .meaning =
               "Fixed last layer: leading singular vectors of the training curves, 0 for a learned one"),
    OPTION("model", angles, FLAG, .value_name = lg_name_truth, .optional = true, PRESET(),
           .methods = DISCRETE,
           .meaning = "Discrete network of the inner angles: tangents are units, nodes follow from them"),
    OPTION("run", loss, NAME, .value_name = lg_name_surrogate_loss, .optional = true, .value = "mse",
           .methods = DISCRETE,
           .meaning = "mse of the curves, or the energy of the predicted ones, which needs --angles true and "
                      "no curves"),
    OPTION("run", gamma, REAL, .high = 1e12, PRESET(), .unit = "G", .methods = DISCRETE | CONTINUOUS,
           .meaning = "discrete: weight of node-to-node differences; continuous: of |v|^2 = 1"),
    SURROGATE("run", "penalty_form", NAME, model.options.penalty, .value_name = lg_name_surrogate_penalty,
              .optional = true, .value = "published", .methods = DISCRETE,
              .meaning =
                  "What --gamma weighs: text, the matrix W of (5.4.1); published, the differences that "
                  "the thesis' program takes"),
    OPTION("run", between, FLAG, .value_name = lg_name_truth, PRESET(),
           .meaning = "Continuous network: learn from interpolated points between the nodes too"),
    SURROGATE("run", "train_fraction", REAL, train_fraction, .high = 1, .value = "0.9", .unit = "F",
              .meaning = "Part of the curves for training"),
    SURROGATE("run", "test_fraction", REAL, test_fraction, .high = 1, .value = "0.1", .unit = "F",
              .meaning = "Part of the curves for testing, the same for every --train-fraction"),
    SURROGATE("run", "most_curves", U64, most_curves, .high = 1e9, .optional = true, PRESET(), .unit = "n",
              .meaning =
                  "Learn from at most so many curves of the training part, evenly chosen; 0: from all"),
    TRAINING_ROWS(lg_surrogate_run, "method", any_loss, "Curves (continuous: points)", 0, PRESET),
    TRAINING(lg_surrogate_run, validation, REAL, PRESET(), VALIDATION),
    LG_FIELD_END};

/* The network. The validation part is drawn here and not by lg_fit, so that recordings and groups stay
 * whole. */
enum { NETWORK = 1 };

#define DETECTOR(group, name, type, member, ...)                                                             \
    LG_FIELD(lg_detector_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_detector_fields[] = {
    DETECTOR("model", "plane", U32, model.net.plane, .high = 1 << 20, .value = "2", .unit = "n",
             .methods = NETWORK,
             .meaning = "cnn: width of the layer before the output, 0 for none; 2 can be drawn"),
    DETECTOR("model", "activation", NAME, model.net.activation, .value_name = lg_name_activation, PRESET(),
             .methods = NETWORK, .meaning = "cnn: activation of all layers"),
    DETECTOR("model", "loss", NAME, model.loss, .value_name = lg_name_detector_loss,
             .otherwise = "the preset's; cross-entropy for more than two classes", .methods = NETWORK,
             .meaning = "cnn: loss function; mse is for two classes"),
    DETECTOR(
        "model", "centred", FLAG, model.centred, .value_name = lg_name_yes, .value = "no", .methods = NETWORK,
        .meaning = "cnn: subtract each window's mean from its channels, so that the network learns from the "
                   "motion alone"),
    DETECTOR("run", "split", NAME, split, .value_name = lg_name_split, .value = "random",
             .meaning = "Units of the split: random (single windows), run (recordings) or group (such as sea "
                        "states); windows of one recording resemble each other, so random gives too good "
                        "figures"),
    DETECTOR("run", "test_fraction", REAL, test_fraction, .high = 0.95, .value = "0.2", .unit = "F",
             .meaning = "Part of the windows for testing"),
    DETECTOR("run", "validation_fraction", REAL, validation_fraction, .option = "validation", .value = "0.1",
             .methods = NETWORK, VALIDATION),
    DETECTOR("run", "max_restarts", U32, restarts, .high = 1000, .optional = true, .value = "10", .unit = "n",
             .methods = NETWORK,
             .meaning =
                 "cnn: at most so many times a network that died (a layer is constant over all training "
                 "windows) starts again with other weights of the same seed"),
    TRAINING_ROWS(lg_detector_run, "optimizer", any_loss, "cnn: windows", NETWORK, PRESET),
    TRAINING(lg_detector_run, validation, REAL, .value = "0", .option = "", VALIDATION),
    LG_FIELD_END};

static uint32_t get_widths(const void *member, double *values) {
    const lg_table_options *o = member;
    const uint32_t count = o->hidden_count < LG_TABLE_LAYERS ? o->hidden_count : LG_TABLE_LAYERS;
    for (uint32_t i = 0; i < count; i++) values[i] = o->hidden[i];
    return count;
}

static void put_widths(void *member, const double *values, uint32_t count) {
    lg_table_options *o = member;
    o->hidden_count = count;
    for (uint32_t i = 0; i < count; i++) o->hidden[i] = (uint32_t)values[i];
}

static uint32_t get_decay(const void *member, double *values) {
    const lg_table_decay *decay = member;
    for (uint32_t i = 0; i < decay->count; i++) values[i] = decay->value[i];
    return decay->count;
}

static void put_decay(void *member, const double *values, uint32_t count) {
    lg_table_decay *decay = member;
    decay->count = count;
    for (uint32_t i = 0; i < count; i++) decay->value[i] = values[i];
}

#define TABLE(group, name, type, member, ...) LG_FIELD(lg_table_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_table_fields[] = {
    TABLE("model", "network", NAME, model.options.network, .value_name = lg_name_net, .value = "mlp",
          .meaning = "Architecture of the network"),
    TABLE("model", "activation", NAME, model.options.activation, .value_name = lg_name_activation,
          .value = "tanh", .meaning = "Activation of the hidden layers"),
    TABLE("model", "hidden", WHOLES, model.options, .get = get_widths, .put = put_widths, .low = 1,
          .high = 1 << 20, .most = LG_TABLE_LAYERS,
          .otherwise = "one layer, as wide as the evidence of the data says; 32 for a classification; where "
                       "Adam takes part or "
                       "weight decay is given, by rows and columns",
          .unit = "W,W,...",
          .meaning = "Widths of the hidden layers, all equal; the first one reads the inputs"),
    TABLE("model", "linear", FLAG, model.options.linear, .value_name = lg_name_truth, .value = "true",
          .meaning = "A linear map of the inputs is added to the network"),
    TABLE("run", "decay", REALS, decay, .get = get_decay, .put = put_decay, .high = 1e12,
          .most = LG_TABLE_SLICES,
          .otherwise = "by the evidence of the data; none for a classification, or where --weight-decay or "
                       "--prior is given",
          .unit = "D,D,...",
          .meaning = "Weights D/2 of the squares of each array of parameters, in their order in the file"),
    TRAINING_ROWS(lg_table_run, "method", squares, "Rows", 0, PRESET),
    TRAINING(lg_table_run, validation, REAL, .otherwise = "0.1; 0 with --test, for a regression", VALIDATION),
    LG_FIELD_END};

#define MACHINE(name, type, member, ...)                                                                     \
    LG_FIELD(lg_machine_model_run, "run", name, type, member, __VA_ARGS__)
const lg_field lg_machine_model_fields[] = {
    MACHINE("integrator", NAME, scheme, .value_name = lg_name_scheme, .value_at = lg_scheme_number,
            .value = "cf4", .meaning = "Scheme of the steps between two rows"),
    MACHINE("substeps", U32, substeps, .low = 1, .high = 1e6,
            .otherwise = "1 to 4, so that the steps' error is small against the loss", .unit = "n",
            .meaning = "Integrator steps between two rows"),
    MACHINE("window", U32, window, .low = 2, .high = LG_MACHINE_WINDOW,
            .otherwise = "5; 20 with noise, 60 where positions alone are measured", .unit = "M",
            .meaning = "Rows of a window: predictions start at its first row"),
    MACHINE("stride", U32, stride, .high = 1e9,
            .otherwise = "M - 1: windows touch; where this gives fewer than 2000 windows, less", .unit = "n",
            .meaning = "Rows from one window to the next"),
    MACHINE("starts", NAME, starts, .value_name = lg_name_machine_start,
            .otherwise = "estimated where the machine's `noise` is given or positions alone are measured",
            .meaning = "Where predictions start: at the logged rows, or at estimated states near them"),
    TRAINING_ROWS(lg_machine_model_run, "method", squares, "Windows", 0, CONSTANT),
    TRAINING(lg_machine_model_run, validation, REAL, .value = "0", .option = "validation-part", VALIDATION),
    LG_FIELD_END};

/* ---- names ---- */

void lg_field_option(const lg_field *row, char *text, size_t size) {
    (void)snprintf(text, size, "%s", row->option != NULL ? row->option : row->name);
    if (row->option != NULL) return;
    for (char *c = text; *c != '\0'; c++)
        if (*c == '_') *c = '-';
}

const lg_field *lg_field_find(const lg_field *rows, const char *name) {
    char option[LG_SYSTEM_NAME];
    for (; rows->name != NULL; rows++) {
        lg_field_option(rows, option, sizeof option);
        if (strcmp(rows->name, name) == 0 || strcmp(option, name) == 0) return rows;
    }
    return NULL;
}

/* ---- values ---- */

static const void *member_of(const lg_field *row, const void *run) {
    return (const char *)run + row->offset;
}

/* Number of the row that a pointer points to; beyond the last when it points to none. */
static uint64_t row_number(const lg_field *row, const void *at) {
    const void *pointer;
    uint32_t value = 0;
    memcpy(&pointer, at, sizeof pointer);
    while (row->value_name(value) != NULL && row->value_at(value) != pointer) value++;
    return value;
}

/* The whole number of a name, a flag or an integer member of any width. */
static uint64_t whole_at(const lg_field *row, const void *run) {
    const void *at = member_of(row, run);
    if (row->value_at != NULL) return row_number(row, at);
    bool flag = false;
    uint32_t narrow = 0;
    uint64_t wide = 0;
    memcpy(row->size == sizeof wide     ? (void *)&wide
           : row->size == sizeof narrow ? (void *)&narrow
                                        : &flag,
           at, row->size);
    return wide + narrow + flag;
}

static void set_whole(const lg_field *row, void *run, uint64_t value) {
    const bool flag = value != 0;
    const uint32_t narrow = (uint32_t)value;
    const void *const pointer = row->value_at != NULL ? row->value_at(narrow) : NULL;
    if (row->value_at != NULL) {
        memcpy((char *)run + row->offset, &pointer, sizeof pointer);
        return;
    }
    memcpy((char *)run + row->offset,
           row->size == sizeof value    ? (const void *)&value
           : row->size == sizeof narrow ? (const void *)&narrow
                                        : &flag,
           row->size);
}

static bool is_named(const lg_field *row) {
    return row->type == LG_FIELD_NAME || row->type == LG_FIELD_FLAG;
}

static bool is_whole(const lg_field *row) {
    return row->type == LG_FIELD_U64 || row->type == LG_FIELD_U32;
}

static bool is_list(const lg_field *row) {
    return row->type == LG_FIELD_WHOLES || row->type == LG_FIELD_REALS;
}

/* The name of a value; NULL beyond the last. */
static const char *name_at(const lg_field *row, uint32_t value) {
    if (row->names == NULL) return row->value_name(value);
    const char *const *name = row->names;
    while (*name != NULL && value > 0) name++, value--;
    return *name;
}

static uint32_t get_wholes(const void *member, double *values) {
    const lg_wholes *list = member;
    for (size_t i = 0; i < list->count; i++) values[i] = list->values[i];
    return (uint32_t)list->count;
}

static uint32_t get_reals(const void *member, double *values) {
    const lg_reals *list = member;
    memcpy(values, list->values, list->count * sizeof *values);
    return (uint32_t)list->count;
}

static void put_wholes(void *member, const double *values, uint32_t count) {
    lg_wholes *list = member;
    list->count = count;
    for (size_t i = 0; i < count; i++) list->values[i] = (uint32_t)values[i];
}

static void put_reals(void *member, const double *values, uint32_t count) {
    lg_reals *list = member;
    list->count = count;
    for (size_t i = 0; i < count; i++) list->values[i] = values[i];
}

uint32_t lg_field_list(const lg_field *row, const void *run, double *values) {
    const bool whole = row->type == LG_FIELD_WHOLES;
    if (!is_list(row)) return 0;
    return (row->get != NULL ? row->get : whole ? get_wholes : get_reals)(member_of(row, run), values);
}

static void put_list(const lg_field *row, const double *values, uint32_t count, void *run) {
    const bool whole = row->type == LG_FIELD_WHOLES;
    (row->put != NULL ? row->put : whole ? put_wholes : put_reals)((char *)run + row->offset, values, count);
}

uint64_t lg_field_whole(const lg_field *row, const void *run) {
    return is_named(row) || is_whole(row) || row->type == LG_FIELD_SWITCH ? whole_at(row, run) : 0;
}

double lg_field_number(const lg_field *row, const void *run) {
    double real;
    if (is_named(row) || is_whole(row)) return (double)whole_at(row, run);
    if (row->type != LG_FIELD_REAL) return (double)NAN;
    memcpy(&real, member_of(row, run), sizeof real);
    return real;
}

static bool in_range(const lg_field *row, double value) {
    return (row->above ? value > row->low : value >= row->low) && value <= row->high;
}

bool lg_field_fits(const lg_field *row, const void *run) {
    if (is_named(row)) return name_at(row, (uint32_t)whole_at(row, run)) != NULL;
    if (row->type != LG_FIELD_REAL && !is_whole(row)) return true;
    return in_range(row, lg_field_number(row, run));
}

static void show_list(const lg_field *row, const void *run, char *text, size_t size) {
    double values[LG_FIELD_LIST_MAX];
    const uint32_t count = lg_field_list(row, run, values);
    size_t used = 0;
    text[0] = '\0';
    for (uint32_t i = 0; i < count && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%.17g", i > 0 ? "," : "", values[i]);
}

void lg_field_show(const lg_field *row, const void *run, char *text, size_t size) {
    const char *name;
    switch (row->type) {
    case LG_FIELD_REAL:
        (void)snprintf(text, size, "%.17g", lg_field_number(row, run));
        break;
    case LG_FIELD_U64:
    case LG_FIELD_U32:
        (void)snprintf(text, size, "%llu", (unsigned long long)whole_at(row, run));
        break;
    case LG_FIELD_FLAG:
    case LG_FIELD_NAME:
        name = name_at(row, (uint32_t)whole_at(row, run));
        (void)snprintf(text, size, "%s", name != NULL ? name : "?");
        break;
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
        show_list(row, run, text, size);
        break;
    case LG_FIELD_SWITCH:
        (void)snprintf(text, size, "%s", whole_at(row, run) != 0 ? "true" : "false");
        break;
    case LG_FIELD_STRING:
        memcpy(&name, member_of(row, run), sizeof name);
        (void)snprintf(text, size, "%s", name != NULL ? name : "");
        break;
    case LG_FIELD_TEXT:
        (void)snprintf(text, size, "%s", (const char *)member_of(row, run));
        break;
    case LG_FIELD_SHOWN:
        row->show(run, text, size);
        break;
    case LG_FIELD_PHRASE:
        row->phrase(member_of(row, run), text, size);
        break;
    }
}

void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run) {
    if (is_list(row))
        put_list(row, values, count, run);
    else if (row->type == LG_FIELD_REAL)
        memcpy((char *)run + row->offset, values, sizeof *values);
    else
        set_whole(row, run, (uint64_t)values[0]);
}

void lg_field_copy(const lg_field *row, const void *from, void *to) {
    double values[LG_FIELD_LIST_MAX];
    if (is_list(row))
        put_list(row, values, lg_field_list(row, from, values), to);
    else
        memcpy((char *)to + row->offset, member_of(row, from), row->size);
}

void lg_fields_default(const lg_field *rows, void *run) {
    for (; rows->name != NULL; rows++)
        if (rows->value != NULL) (void)lg_field_set(rows, rows->value, run, NULL);
}

/* ---- what a row takes, in words ---- */

/* Writes 15 digits if they give the number back, else 17. */
static void bound_text(double bound, char out[32]) {
    (void)snprintf(out, 32, "%.15g", bound);
    if (strtod(out, NULL) != bound) (void)snprintf(out, 32, "%.17g", bound);
}

/* Whether a number of the list (or the only one) is beyond the upper bound. */
static bool exceeds(const lg_field *row, const char *text) {
    for (char *end;; text = end + 1) {
        const double value = strtod(text, &end);
        if (value > row->high || (row->high == 0x1p64 && value >= row->high)) return true;
        if (end == text || *end != ',') return false;
    }
}

/* Bounds that mean "none" are named only when `text` is beyond them. */
static size_t number_text(const lg_field *row, const char *text, char *out, size_t size) {
    const bool list = is_list(row), whole = row->type == LG_FIELD_WHOLES || is_whole(row);
    const bool low = row->low > -1e300, high = row->high < 0x1p63 || exceeds(row, text);
    char bound[32];
    size_t used = (size_t)snprintf(out, size, "%s%s", list ? "a list, separated by commas, of: " : "",
                                   whole ? "a whole number" : "a number");
    bound_text(row->low, bound);
    if (low)
        used +=
            (size_t)snprintf(out + used, size - used, " %s %s", row->above ? "above" : "of at least", bound);
    bound_text(row->high, bound);
    if (high && row->high == 0x1p64)
        used += (size_t)snprintf(out + used, size - used, " and below 2^64");
    else if (high)
        used +=
            (size_t)snprintf(out + used, size - used, " %s %s", low ? "and at most" : "of at most", bound);
    return used;
}

static size_t names_text(const lg_field *row, const char *last, char *out, size_t size) {
    size_t used = 0;
    const char *name;
    for (uint32_t i = 0; used < size && (name = name_at(row, i)) != NULL; i++)
        used += (size_t)snprintf(out + used, size - used, "%s%s",
                                 i == 0                        ? ""
                                 : name_at(row, i + 1) == NULL ? last
                                                               : ", ",
                                 name);
    return used;
}

/* "adam, lbfgs or lm, or phases as in adam:100,lbfgs": single names, where there are, and the form. */
static void form_text(const lg_field *row, char *out, size_t size) {
    const size_t used = row->value_name != NULL ? names_text(row, " or ", out, size) : 0;
    if (used < size) (void)snprintf(out + used, size - used, "%s%s", used > 0 ? ", or " : "", row->form);
}

/* "1 to 1048576", "above 0 to 1", "0 or more". */
static void span_text(const lg_field *row, char *text, size_t size) {
    char low[32], high[32] = "";
    bound_text(row->low, low);
    if (row->high < 0x1p63) (void)snprintf(high, sizeof high, row->high < 1e7 ? "%.15g" : "%g", row->high);
    (void)snprintf(text, size, "%s%s%s%s%s", is_list(row) ? "each " : "", row->above ? "above " : "", low,
                   high[0] != '\0' ? " to "
                   : row->above    ? ""
                                   : " or more",
                   high);
}

int lg_field_describe(const lg_field *row, char *text, size_t size) {
    char range[512] = "";
    const char *value = row->value != NULL ? row->value : row->otherwise,
               *is = value != NULL ? "default " : "";
    if (value == NULL) value = "";
    if (row->group == NULL)
        return snprintf(text, size, value[0] != '\0' ? "%s (%s%s)" : "%s", row->meaning, is, value);
    if (!is_named(row)) {
        if (row->form != NULL)
            form_text(row, range, sizeof range);
        else
            span_text(row, range, sizeof range);
        return snprintf(text, size, "%s (%s%s%s%s)", row->meaning, range, value[0] != '\0' ? "; " : "", is,
                        value);
    }
    (void)names_text(row, " or ", range, sizeof range);
    return snprintf(text, size, "%s: %s%s%s%s%s", row->meaning, range, value[0] != '\0' ? " (" : "", is,
                    value, value[0] != '\0' ? ")" : "");
}

/* ---- from text ---- */

enum { SHOWN = 80 /* so much of a wrong text stands in a sentence */ };

static lg_status refuse_number(const lg_field *row, const char *text, lg_error *error) {
    char range[256];
    (void)number_text(row, text, range, sizeof range);
    return lg_fail(error, LG_INVALID_ARGUMENT, "'%.*s%s' is not %s", SHOWN, text,
                   strlen(text) > SHOWN ? "..." : "", range);
}

static lg_status set_name(const lg_field *row, const char *text, void *run, lg_error *error) {
    char names[512] = "";
    const char *name;
    for (uint32_t i = 0; (name = name_at(row, i)) != NULL; i++)
        if (strcmp(name, text) == 0) {
            set_whole(row, run, i);
            return LG_OK;
        }
    (void)names_text(row, ", ", names, sizeof names);
    return lg_fail(error, LG_INVALID_ARGUMENT, "'%.*s' is not one of %s", SHOWN, text, names);
}

static bool take_whole(const lg_field *row, const char *text, uint64_t *out) {
    return lg_integer_parse(text, out) == LG_OK && in_range(row, (double)*out);
}

static bool take_real(const lg_field *row, const char *text, double *out) {
    return lg_number_parse(text, out) == LG_OK && in_range(row, *out);
}

/* One number of a list, `length` bytes of it; whole ones are below 2^53. */
static bool take_item(const lg_field *row, const char *text, size_t length, double *out) {
    char item[64];
    uint64_t whole = 0;
    if (length >= sizeof item) return false;
    memcpy(item, text, length);
    item[length] = '\0';
    if (row->type == LG_FIELD_REALS) return take_real(row, item, out);
    const bool good = take_whole(row, item, &whole);
    *out = (double)whole;
    return good;
}

static lg_status set_list(const lg_field *row, const char *text, void *run, lg_error *error) {
    double values[LG_FIELD_LIST_MAX];
    uint32_t items = 1;
    for (const char *c = text; *c != '\0'; c++) items += *c == ',';
    const uint32_t most = row->most > 0 ? row->most : LG_FIELD_LIST_MAX;
    if (items > most)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a list of %u numbers is too long: at most %u%s%s", items,
                       most, row->longer != NULL ? "; " : "", row->longer != NULL ? row->longer : "");
    const char *at = text;
    for (uint32_t i = 0; i < items; i++) {
        const size_t length = strcspn(at, ",");
        if (!take_item(row, at, length, &values[i])) return refuse_number(row, text, error);
        at += length + 1;
    }
    put_list(row, values, items, run);
    return LG_OK;
}

static lg_status set_string(const lg_field *row, const char *text, void *run, lg_error *error) {
    if (text[0] == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "the value is empty");
    memcpy((char *)run + row->offset, &text, sizeof text);
    return LG_OK;
}

lg_status lg_field_set(const lg_field *row, const char *text, void *run, lg_error *error) {
    LG_NEEDS(error, row, run);
    double real;
    uint64_t whole;
    if (row->type == LG_FIELD_SWITCH) {
        set_whole(row, run, true);
        return LG_OK;
    }
    LG_NEEDS(error, text);
    if (is_named(row)) return set_name(row, text, run, error);
    if (is_list(row)) return set_list(row, text, run, error);
    if (row->type == LG_FIELD_REAL) {
        if (!take_real(row, text, &real)) return refuse_number(row, text, error);
        memcpy((char *)run + row->offset, &real, sizeof real);
        return LG_OK;
    }
    if (row->type == LG_FIELD_STRING) return set_string(row, text, run, error);
    if (row->type == LG_FIELD_PHRASE) return row->parse(text, (char *)run + row->offset, error);
    if (!is_whole(row)) return lg_fail(error, LG_INVALID_ARGUMENT, "%s cannot be set", row->name);
    if (!take_whole(row, text, &whole)) return refuse_number(row, text, error);
    set_whole(row, run, whole);
    return LG_OK;
}
