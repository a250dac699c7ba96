/* The options of lg-elastica train, and the run they describe. */
#include <math.h>
#include <string.h>

#include "lg-elastica/train.h"

static const char *const presets[] = {"thesis", "best", NULL};
static const char *const networks[] = {"discrete", "continuous", "angle", NULL};
static const char *const architectures[] = {"mlp", "resnet", "mult", "mult-affine", NULL};
static const char *const truths[] = {"false", "true", NULL};

#define PRESETS "the preset's"

const app_option train_options[] = {
    FIT_OUT_ROW(train_values, fit),
    APP_ROW_CHOICE(train_values, network, "network", networks, "discrete (default), continuous or angle"),
    APP_ROW_CHOICE(
        train_values, preset, "preset", presets,
        "Where options that are not given come from: thesis, the published settings, or best, ours "
        "(default)"),
    APP_ROW_CHOICE(train_values, architecture, "architecture", architectures,
                   "mlp, resnet, mult or mult-affine"),
    APP_ROW_SIZE(train_values, embedding, "embedding", "E", 0, 1048576,
                 "Width of the layer sin(2 pi (x A + b)) before the network, 0 for none"),
    APP_ROW_SIZE(train_values, hidden, "hidden", "W", 1, 1048576, "Width of the hidden layers"),
    APP_ROW_SIZE(train_values, layers, "layers", "l", 0, LG_NET_MAX_LAYERS,
                 "Hidden layers after the first one"),
    APP_ROW_CHOICE(train_values, activation, "activation", fit_activations,
                   "tanh, sigmoid, swish, relu, leaky-relu, sine, identity"),
    APP_ROW_CHOICE(train_values, normalise, "normalise", truths,
                   "true or false: the ends' x enter as (x - c)/c, c half their distance"),
    APP_ROW_CHOICE(train_values, mirror, "mirror", truths,
                   "true or false: learn one half of the boundary conditions, the other is its mirror image"),
    APP_ROW_CHOICE(train_values, between, "between", truths,
                   "true or false: continuous network: learn from points between the nodes too, by "
                   "interpolation"),
    APP_ROW_CHOICE(train_values, boundary, "boundary", truths,
                   "true or false: angle network that holds the end angles by construction (default false)"),
    APP_ROW_REAL(train_values, gamma, "gamma", "G", 0, 1e300,
                 "discrete: weight of node-to-node differences; continuous: of |v|^2 = 1"),
    APP_ROW_REAL(train_values, train_fraction, "train-fraction", "F", 0, 1,
                 "Part of the curves that is trained on (default 0.9)"),
    APP_ROW_REAL(train_values, test_fraction, "test-fraction", "F", 0, 1,
                 "Part that is tested on, the same for every --train-fraction (default 0.1)"),
    FIT_TRAINING_ROWS(train_values, fit, "Curves (continuous: points)", PRESETS, PRESETS, PRESETS, PRESETS,
                      PRESETS, PRESETS, PRESETS, PRESETS, PRESETS, PRESETS, PRESETS),
    FIT_FILE_ROWS(train_values, fit),
    APP_ROW_END};

train_values train_given = {.preset = 1, .train_fraction = 0.9, .test_fraction = 0.1};

bool train_is_hyperparameter(const char *option) {
    static const char *const files[] = {"out",     "checkpoint", "checkpoint-every", "stop-after", "resume",
                                        "history", "plot"};
    for (size_t i = 0; i < APP_COUNT(files); i++)
        if (strcmp(files[i], option) == 0) return false;
    for (size_t i = 0; train_options[i].name != NULL; i++)
        if (strcmp(train_options[i].name, option) == 0) return true;
    return false;
}

/* ---- the model's options ---- */

static lg_surrogate_options options_of(const train_values *values) {
    lg_surrogate_options options = {.kind = (lg_surrogate_kind)values->network,
                                    .architecture = (lg_net_kind)values->architecture,
                                    .embedding = (uint32_t)values->embedding,
                                    .hidden = (uint32_t)values->hidden,
                                    .layers = (uint32_t)values->layers,
                                    .activation = LG_TANH,
                                    .normalise = values->normalise == 1,
                                    .mirror = values->mirror == 1,
                                    .boundary = values->boundary == 1,
                                    .between = values->between == 1,
                                    .gamma = values->gamma};
    (void)lg_activation_parse(fit_activations[values->activation], &options.activation);
    return options;
}

/* What was not given becomes that of `from`; `network` too: the kind and its boundary conditions. */
static void adopt_model(const app *self, train_values *values, const lg_surrogate_options *from,
                        bool network) {
    const struct {
        const char *option;
        int *target, value;
        bool wanted;
    } names[] = {{"network", &values->network, (int)from->kind, network},
                 {"boundary", &values->boundary, from->boundary, network},
                 {"architecture", &values->architecture, (int)from->architecture, true},
                 {"activation", &values->activation,
                  fit_position_of(fit_activations, lg_activation_name(from->activation), 0), true},
                 {"normalise", &values->normalise, from->normalise, true},
                 {"mirror", &values->mirror, from->mirror, true},
                 {"between", &values->between, from->between, true}};
    const struct {
        const char *option;
        uint64_t *target, value;
    } sizes[] = {{"embedding", &values->embedding, from->embedding},
                 {"hidden", &values->hidden, from->hidden},
                 {"layers", &values->layers, from->layers}};
    for (size_t i = 0; i < APP_COUNT(names); i++)
        if (names[i].wanted && !app_given(self, names[i].option)) *names[i].target = names[i].value;
    for (size_t i = 0; i < APP_COUNT(sizes); i++)
        if (!app_given(self, sizes[i].option)) *sizes[i].target = sizes[i].value;
    if (!app_given(self, "gamma")) values->gamma = from->gamma;
}

void train_adopt(app *self, train_values *values, const lg_surrogate_run *stored) {
    adopt_model(self, values, &stored->model.options, true);
    fit_adopt(self, &values->fit, &stored->training, true);
    if (!app_given(self, "train-fraction")) values->train_fraction = stored->train_fraction;
    if (!app_given(self, "test-fraction")) values->test_fraction = stored->test_fraction;
}

static lg_status adopt_preset(app *self, train_values *values, const lg_elastica_data *data,
                              const lg_surrogate_preset **out, lg_error *error) {
    const families found = families_of(data->curves.boundary, data->curves.count);
    const bool merged = found.both_ends && found.right_end;
    const lg_surrogate_preset *preset =
        lg_surrogate_preset_find(presets[values->preset], (lg_surrogate_kind)values->network,
                                 values->boundary == 1, merged, values->train_fraction);
    if (preset == NULL)
        return app_error(error, LG_UNSUPPORTED, "--preset: %s has no settings for the %s network%s%s",
                         presets[values->preset], networks[values->network],
                         values->boundary == 1 ? " with --boundary true" : "",
                         merged ? " on data of both families" : "");
    adopt_model(self, values, &preset->model, false);
    fit_adopt(self, &values->fit, &preset->training, false);
    *out = preset;
    return LG_OK;
}

/* ---- the run ---- */

/* Half of the largest distance of the ends: the same bits wherever all curves have one distance. */
static double centre_of(const lg_elastica_curves *curves) {
    double largest = 0;
    for (size_t i = 0; i < curves->count; i++) {
        const double *x = curves->boundary + 8 * i;
        largest = fmax(largest, hypot(x[4] - x[0], x[5] - x[1]));
    }
    return 0.5 * largest;
}

lg_status train_run(app *self, train_values *values, const lg_elastica_data *data, bool resumed,
                    lg_surrogate_run *run, const lg_surrogate_preset **preset, lg_error *error) {
    const lg_elastica_curves *curves = &data->curves;
    *preset = NULL;
    if (values->boundary == 1 && values->network != LG_SURROGATE_ANGLE)
        return app_error(error, LG_INVALID_ARGUMENT, "--boundary: only --network angle can hold them");
    if (values->network == LG_SURROGATE_ANGLE && app_given(self, "gamma") && values->gamma != 0)
        return app_error(error, LG_INVALID_ARGUMENT, "--gamma: has no part in the loss of the angle network");
    const lg_status found = resumed ? LG_OK : adopt_preset(self, values, data, preset, error);
    if (found != LG_OK) return found;
    *run = (lg_surrogate_run){.training = fit_training(&values->fit, self->seed),
                              .train_fraction = values->train_fraction,
                              .test_fraction = values->test_fraction,
                              .curves = curves->count,
                              .continuous = curves->continuous};
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    const lg_surrogate_options options = options_of(values);
    return lg_surrogate_init(&run->model, &options, curves->intervals, curves->length, centre_of(curves),
                             error);
}
