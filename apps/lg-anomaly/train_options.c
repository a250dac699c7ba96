/* The options of lg-anomaly train. */
#include <math.h>
#include <string.h>

#include "lg-anomaly/train.h"

const char *const train_methods[] = {"cnn", "logistic", "tree", "svm-linear", "svm-rbf", "baseline", NULL};
const char *const train_splits[] = {
    [LG_SPLIT_RANDOM] = "random", [LG_SPLIT_RUN] = "run", [LG_SPLIT_GROUP] = "group", NULL};
static const char *const features[] = {
    [LG_FEATURES_RAW] = "raw", [LG_FEATURES_STD] = "std", [LG_FEATURES_COV] = "cov", NULL};
static const char *const directions[] = {"xy", "x", NULL};
static const char *const criteria[] = {[LG_GINI] = "gini", [LG_ENTROPY] = "entropy", NULL};
static const char *const prunings[] = {"none", "pre", "post", NULL};
static const char *const presets[] = {"thesis", "best", NULL};
static const char *const losses[] = {
    [LG_DETECTOR_MSE] = "mse", [LG_DETECTOR_CROSS_ENTROPY] = "cross-entropy", NULL};
static const char *const truths[] = {"no", "yes", NULL};
static const char *const poolings[] = {
    [LG_POOL_NONE] = "none", [LG_POOL_AVERAGE] = "average", [LG_POOL_MAX] = "max", NULL};

#define PRESETS "the preset's"

const app_option train_options[] = {
    FIT_OUT_ROW(train_values, fit),
    APP_ROW_CHOICE(train_values, method, "method", train_methods,
                   "cnn (default), logistic, tree, svm-linear, svm-rbf, or baseline: ten minutes sliding by "
                   "one, lines of moment against acceleration, logistic"),
    APP_ROW_TEXT(train_values, test, "test", "TEST.h5",
                 "Test on this file; DATA.h5 is then all for training"),
    APP_ROW_CHOICE(train_values, split, "split", train_splits,
                   "What stays together: random (windows one by one, default), run (recordings) or group "
                   "(such as sea states). Windows of one recording resemble each other: random flatters"),
    APP_ROW_REAL(train_values, test_fraction, "test-fraction", "F", 0, 0.95,
                 "Part that is tested on (default 0.2)"),
    APP_ROW_REAL(train_values, window, "window", "SECONDS", 0, 1e9,
                 "Length of a window; samples where the data do not tell their rate (default: as stored; "
                 "baseline: 600 s)"),
    APP_ROW_REAL(train_values, hop, "hop", "SECONDS", 0, 1e9,
                 "From one window to the next (default: the window; baseline: 60 s)"),
    APP_ROW_CHOICE(train_values, features, "features", features,
                   "Classical methods: cov (square root of the covariance, default), std (standard "
                   "deviations) or raw (the samples)"),
    APP_ROW_SIZE(train_values, components, "components", "k", 0, 1048576,
                 "Principal components, 0: none are formed (default 0)"),
    APP_ROW_CHOICE(train_values, directions, "directions", directions,
                   "xy: all channels (default); x: those whose name ends in _x, or every second one"),
    APP_ROW_CHOICE(train_values, criterion, "criterion", criteria, "Trees: gini (default) or entropy"),
    APP_ROW_CHOICE(train_values, prune, "prune", prunings,
                   "Trees: none (default), pre (depth and leaf sizes by cross-validation) or post "
                   "(cost-complexity with --ccp-alpha)"),
    APP_ROW_REAL(train_values, ccp_alpha, "ccp-alpha", "A", 0, 1e300,
                 "post: the alpha (default .002 or .003 for std, .003 or .01 otherwise, gini or entropy)"),
    APP_ROW_SIZE(train_values, max_depth, "max-depth", "n", 1, 1000000, "Trees: (default: no limit)"),
    APP_ROW_SIZE(train_values, min_split, "min-samples-split", "n", 2, 1000000000,
                 "Trees: a node of fewer windows is not split (default 2)"),
    APP_ROW_SIZE(train_values, min_leaf, "min-samples-leaf", "n", 1, 1000000000,
                 "Trees: windows of a leaf at least (default 1)"),
    APP_ROW_POSITIVE(train_values, c, "c", "C",
                     "Inverse of the penalty (default: logistic 1; svm: the best of --grid)"),
    APP_ROW_REALS(train_values, grid, "grid", "C,C,...",
                  "Choose C among these by cross-validation on the training part (default for svm: "
                  "0.1,1,10,100)",
                  NULL),
    APP_ROW_SIZE(train_values, folds, "folds", "n", 2, 1000, "Of cross-validation (default 5)"),
    APP_ROW_POSITIVE(train_values, gamma, "gamma", "G",
                     "svm-rbf: exp(-G |x - y|^2) (default 1/(features x their variance))"),
    APP_ROW_CHOICE(train_values, preset, "preset", presets,
                   "cnn: where options that are not given come from: thesis, the published settings, or "
                   "best, ours (default)"),
    APP_ROW_CHOICE(train_values, loss, "loss", losses,
                   "cnn: mse (two classes) or cross-entropy (default " PRESETS
                   "; cross-entropy for more classes)"),
    APP_ROW_CHOICE(train_values, centred, "centred", truths,
                   "cnn: yes or no: take each window's mean off its channels, so that the network learns "
                   "from the motion alone (default no)"),
    APP_ROW_CHOICE(train_values, activation, "activation", fit_activations,
                   "cnn: tanh, sigmoid, swish, relu, leaky-relu, sine, identity (default " PRESETS ")"),
    APP_ROW_SIZES(train_values, filters, "filters", "n,n,...", 1, 1048576,
                  "cnn: channels of each block (default 2, 4, 8 times those of the data; fewer blocks where "
                  "windows are too short for three)"),
    APP_ROW_SIZE(train_values, kernel, "kernel", "n", 1, 1048576, "cnn: samples of a kernel (default 5)"),
    APP_ROW_SIZE(train_values, stride, "stride", "n", 1, 1048576, "cnn: of convolutions (default 1)"),
    APP_ROW_SIZE(train_values, padding, "padding", "n", 0, 1048576,
                 "cnn: zeros at both ends of a series (default 0)"),
    APP_ROW_CHOICE(train_values, pooling, "pooling", poolings, "cnn: average (default), max or none"),
    APP_ROW_SIZE(train_values, pool_size, "pool-size", "n", 1, 1048576,
                 "cnn: samples that are pooled to one (default 2)"),
    APP_ROW_SIZE(train_values, plane, "plane", "n", 0, 1048576,
                 "cnn: width of the layer before the output, 0 for none (default 2, which can be drawn)"),
    FIT_VALIDATED_ROWS("0.1, cnn only", train_values, fit, "cnn: windows", PRESETS, PRESETS, PRESETS, PRESETS,
                       PRESETS, PRESETS, PRESETS, PRESETS, PRESETS, PRESETS, PRESETS),
    FIT_FILE_ROWS(train_values, fit),
    APP_ROW_CHOICE(train_values, picture, "picture", view_names, VIEW_HELP),
    APP_ROW_END};

train_values train_given = {.fit = {.validation = 0.1},
                            .preset = 1,
                            .test_fraction = 0.2,
                            .features = LG_FEATURES_COV,
                            .min_split = 2,
                            .min_leaf = 1,
                            .folds = 5,
                            .c = 1,
                            .kernel = 5,
                            .stride = 1,
                            .pooling = LG_POOL_AVERAGE,
                            .pool_size = 2,
                            .plane = 2};

bool train_is_hyperparameter(const char *option) {
    static const char *const files[] = {"out",    "test",    "checkpoint", "checkpoint-every", "stop-after",
                                        "resume", "history", "plot",       "picture",          "validation"};
    for (size_t i = 0; i < APP_COUNT(files); i++)
        if (strcmp(files[i], option) == 0) return false;
    for (size_t i = 0; train_options[i].name != NULL; i++)
        if (strcmp(train_options[i].name, option) == 0) return true;
    return false;
}

/* ---- which method has which option ---- */

enum {
    CNN = 1u << METHOD_CNN,
    LOGISTIC = 1u << METHOD_LOGISTIC,
    TREE = 1u << METHOD_TREE,
    LINEAR = 1u << METHOD_SVM_LINEAR,
    RBF = 1u << METHOD_SVM_RBF,
    BASELINE = 1u << METHOD_BASELINE,
    CLASSICAL = LOGISTIC | TREE | LINEAR | RBF
};

static const struct {
    const char *option;
    unsigned methods;
} owners[] = {{"features", CLASSICAL},
              {"components", CLASSICAL | BASELINE},
              {"directions", CLASSICAL | BASELINE},
              {"criterion", TREE},
              {"prune", TREE},
              {"ccp-alpha", TREE},
              {"max-depth", TREE},
              {"min-samples-split", TREE},
              {"min-samples-leaf", TREE},
              {"c", LOGISTIC | LINEAR | RBF | BASELINE},
              {"grid", LOGISTIC | LINEAR | RBF | BASELINE},
              {"folds", CLASSICAL | BASELINE},
              {"gamma", RBF},
              {"preset", CNN},
              {"loss", CNN},
              {"centred", CNN},
              {"activation", CNN},
              {"filters", CNN},
              {"kernel", CNN},
              {"stride", CNN},
              {"padding", CNN},
              {"pooling", CNN},
              {"pool-size", CNN},
              {"plane", CNN},
              {"epochs", CNN},
              {"batch", CNN},
              {"lr", CNN},
              {"schedule", CNN},
              {"lr-step", CNN},
              {"lr-gamma", CNN},
              {"weight-decay", CNN},
              {"adam-eps", CNN},
              {"clip", CNN},
              {"dtype", CNN},
              {"validation", CNN},
              {"shards", CNN},
              {"checkpoint", CNN},
              {"checkpoint-every", CNN},
              {"stop-after", CNN},
              {"resume", CNN},
              {"history", CNN}};

bool train_has_option(int method, const char *option) {
    for (size_t i = 0; i < APP_COUNT(owners); i++)
        if (strcmp(owners[i].option, option) == 0) return (owners[i].methods & 1u << method) != 0;
    return true;
}

int train_check_options(const app *self, const train_values *values) {
    for (size_t i = 0; i < APP_COUNT(owners); i++)
        if (app_given(self, owners[i].option) && !train_has_option(values->method, owners[i].option))
            return app_usage(self, "--%s: --method %s has no such option", owners[i].option,
                             train_methods[values->method]);
    if (app_given(self, "c") && app_given(self, "grid"))
        return app_usage(self, "--grid: chooses C, which --c gives");
    for (size_t i = 0; i < values->grid.count; i++)
        if (!(values->grid.values[i] > 0)) return app_usage(self, "--grid: C must be above 0");
    if (app_given(self, "ccp-alpha") && values->prune != PRUNE_POST)
        return app_usage(self, "--ccp-alpha: belongs to --prune post");
    if (values->prune == PRUNE_PRE && (app_given(self, "max-depth") || app_given(self, "min-samples-split") ||
                                       app_given(self, "min-samples-leaf")))
        return app_usage(self,
                         "--prune pre: chooses --max-depth, --min-samples-split and --min-samples-leaf");
    if (app_given(self, "picture") && values->fit.plot == NULL)
        return app_usage(self, "--picture: needs --plot FILE");
    if (values->test != NULL && app_given(self, "test-fraction"))
        return app_usage(self, "--test: does not go with --test-fraction");
    return APP_EXIT_OK;
}
