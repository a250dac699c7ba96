/* The options of lg-anomaly train. */
#include "lg-anomaly/train.h"

#include <string.h>

/* ---- hyperparameters that are not in lg_detector_run ---- */

enum {
    LOGISTIC = 1u << METHOD_LOGISTIC,
    TREE = 1u << METHOD_TREE,
    LINEAR = 1u << METHOD_SVM_LINEAR,
    RBF = 1u << METHOD_SVM_RBF,
    BASELINE = 1u << METHOD_BASELINE,
    ROCKET = 1u << METHOD_ROCKET,
    CLASSICAL = LOGISTIC | TREE | LINEAR | RBF
};

#define ROW(name, type, member, ...) LG_FIELD(train_values, "", name, type, member, __VA_ARGS__)
static const lg_field rows[] = {
    ROW("method", NAME, method, .option = "classifier", .usual = true, .value_name = classifier_method_name,
        .value = "cnn",
        .meaning =
            "The network (cnn) or a classical method; baseline: windows of ten minutes every minute, "
            "regression lines of moment against acceleration, logistic regression; rocket: ridge regression "
            "on random convolutions; novelty: learns the healthy class alone, the others only test it"),
    ROW("features", U64, features, .low = 1, .high = TRAIN_NUMBERS,
        LG_NAMED(lg_feature_kind_name, LG_FEATURES_BASELINE), .form = "a number", .value = "cov",
        .usual = true, .methods = CLASSICAL | ROCKET,
        .meaning = "Features of classical methods: the samples, standard deviations, the square root of the "
                   "covariance, the logarithms of the power in bands of frequency, or levels (mean, minimum, "
                   "maximum and slope of each channel, for slow plants); rocket: their number (10000)"),
    ROW("components", U64, components, .high = 1 << 20, .value = "0", .unit = "k",
        .methods = CLASSICAL | BASELINE, .meaning = "Number of principal components; 0: none"),
    ROW("directions", NAME, directions, LG_NAMES("xy", "x"), .value = "xy",
        .methods = CLASSICAL | BASELINE | ROCKET,
        .meaning = "Channels to use: all, or x (names that end in _x, or every second channel)"),
    ROW("criterion", NAME, criterion, LG_NAMES("gini", "entropy"), .value = "gini", .methods = TREE,
        .meaning = "Trees: measure of impurity"),
    ROW("prune", U64, prune, .low = 1, .high = TRAIN_NUMBERS,
        LG_NAMES([PRUNE_NONE] = "none", [PRUNE_PRE] = "pre", [PRUNE_POST] = "post"), .form = "a number",
        .value = "none", .methods = TREE | ROCKET,
        .meaning = "Trees: pre (depth and leaf sizes by cross-validation) or post (cost-complexity with "
                   "--ccp-alpha); rocket: number of features to keep, those with the largest weights"),
    ROW("ccp_alpha", REAL, ccp_alpha, .high = 1e300, .unit = "A", .methods = TREE,
        .otherwise = ".002 or .003 for std, .003 or .01 otherwise, gini or entropy",
        .meaning = "post: the alpha of cost-complexity pruning"),
    ROW("max_depth", U64, max_depth, .low = 1, .high = 1e6, .unit = "n", .methods = TREE,
        .otherwise = "no limit", .meaning = "Trees: largest depth"),
    ROW("c", REAL, c, .above = true, .high = 1e300, .value = "1", .unit = "C",
        .methods = LOGISTIC | LINEAR | RBF | BASELINE,
        .meaning = "Inverse of the penalty; svm: if not given, the best value of --grid"),
    ROW("folds", U64, folds, .low = 2, .high = 1000, .value = "5", .unit = "n",
        .methods = CLASSICAL | BASELINE, .meaning = "Folds of cross-validation"),
    ROW("gamma", REAL, gamma, .above = true, .high = 1e300, .unit = "G", .methods = RBF,
        .otherwise = "1/(features x their variance)", .meaning = "svm-rbf: exp(-G |x - y|^2)"),
    LG_FIELD_END};

train_values train_given;
lg_detector_run train_run;
lg_detector_state train_state;

static const lg_field train_options[] = {
    LG_OPTION(train_values, grid, REALS, "C,C,...",
              "Choose C among these by cross-validation on the training part (default for svm: 0.1,1,10,100)",
              .without = "c", LG_POSITIVE, .methods = LOGISTIC | LINEAR | RBF | BASELINE),
    LG_FIELD_END};

const app_settings train_settings[] = {{lg_detector_fields, &train_run, sizeof train_run},
                                       {rows, &train_given, sizeof train_given},
                                       APP_GIVEN(lg_detector_options, train_state),
                                       APP_GIVEN(train_options, train_given),
                                       TRAIN_SHARED_NO_SIZE,
                                       APP_SETTINGS_END};

/* ---- options that cannot be combined ---- */

lg_status train_check_options(const app *self, lg_error *error) {
    const train_values *values = &train_given;
    const bool rocket = values->method == METHOD_ROCKET;
    const uint32_t prune = train_name(values->prune);
    const char *why = NULL;
    train_state.classical = values->method != METHOD_CNN;
    train_state.alone = values->method == METHOD_NOVELTY;
    train_state.long_windows = values->method == METHOD_BASELINE;
    /* Only the network has a fit, so only it has the options for files, except --out. */
    for (const app_slot *slot = self->slots; slot < self->slots + self->slot_count; slot++)
        if (values->method != METHOD_CNN && slot->given && slot->values == &train_given_files &&
            strcmp(slot->name, "out") != 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "--%s: --classifier %s has no such option", slot->name,
                           classifier_method_name(values->method));
    if (app_given(self, "features") && train_is_number(values->features) != rocket)
        why = rocket ? "--features: --classifier rocket needs a number, such as 10000"
                     : "--features: only --classifier rocket takes a number";
    else if (app_given(self, "prune") && train_is_number(values->prune) != rocket)
        why = rocket ? "--prune: --classifier rocket needs a number, such as 1000"
                     : "--prune: --classifier tree takes none, pre or post";
    else if (app_given(self, "ccp-alpha") && prune != PRUNE_POST)
        why = "--ccp-alpha: needs --prune post";
    else if (prune == PRUNE_PRE && app_given(self, "max-depth"))
        why = "--prune pre: chooses --max-depth";
    return why == NULL ? LG_OK : lg_fail(error, LG_INVALID_ARGUMENT, "%s", why);
}
