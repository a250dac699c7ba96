/* lg-anomaly train with a classical method on features. */
#include <math.h>
#include <stdlib.h>

#include "lg-anomaly/train.h"

enum {
    MAX_GRID = 1024,
    SHOWN_GRID = 8,
    PRUNED_GROUPS = 200,   /* at most so many groups of neighbours keep an equal share of the features */
    PRUNED_WINDOWS = 20000 /* groups times training windows */
};
static const double default_grid[] = {0.1, 1, 10, 100};

/* The candidates for the options, and the chosen candidate. */
typedef struct choice {
    size_t count, best;
    lg_classifier_options *options; /* (count) */
    double *accuracy; /* (count): accuracy in cross-validation; NULL if there was only one candidate */
    double seconds;
} choice;

typedef struct classical {
    const app *app;
    well_model model;
    uint32_t *label; /* the label of each window */
    uint32_t *unit;  /* the run or group of each window; NULL if windows are split one by one */
    double *table;   /* features of all windows */
    /* Features of the series that has the test part. NULL: its windows are judged one by one. */
    double *tested_table;
    double feature_seconds;
    choice chosen;
} classical;

static lg_detector_state *const state = &train_state;

/* ---- features ---- */

static lg_status fit_rocket(const app *program, const lg_scaler *scaler, lg_features *out, lg_error *error) {
    lg_rocket_options options;
    lg_rocket_options_init(&options);
    options.seed = program->seed;
    options.directions_x = train_given.directions == 1;
    if (train_given.features.number > 0) options.features = (uint32_t)train_given.features.number;
    return lg_rocket_fit(program->context, &options, &state->all.data.series, &state->all.windows,
                         state->train.list, state->train.count, scaler, out, error);
}

static lg_status create_features(const app *program, lg_features *out, lg_error *error) {
    const train_values *values = &train_given;
    const lg_series *series = &state->all.data.series;
    const bool baseline = values->method == METHOD_BASELINE;
    lg_scaler scaler;
    lg_status status = lg_scaler_fit(program->context, series, &state->all.windows, state->train.list,
                                     state->train.count, false, &scaler);
    if (status != LG_OK) return lg_fail(error, status, "scaling: %s", lg_status_sentence(status));
    if (values->method == METHOD_ROCKET)
        status = fit_rocket(program, &scaler, out, error);
    else
        status = lg_features_create(
            program->context, baseline ? LG_FEATURES_BASELINE : (lg_feature_kind)values->features.name,
            values->directions == 1, series, (uint32_t)train_run.window, &scaler, out, error);
    lg_scaler_destroy(&scaler);
    return status;
}

static lg_status make_table(const classical *self, const lg_cut_series *from, double **out, lg_error *error) {
    const lg_features *features = &self->model.classifier.features;
    const size_t count = from->windows.count;
    *out = app_try_alloc(count * features->count, sizeof **out);
    if (*out == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory: %zu windows with %u features each", count,
                       features->count);
    return lg_features_table(self->app->context, features, &from->data.series, &from->windows,
                             (int)self->app->threads, *out, error);
}

static double *table_of(const classical *self, const lg_cut_series *from) {
    double *out = NULL;
    APP_MUST(self->app, make_table(self, from, &out, &error));
    return out;
}

/* Copies a value per stored window to each window that was cut from it. Returns NULL if `stored` is NULL. */
static uint32_t *of_windows(const lg_cut_series *from, const uint32_t *stored) {
    if (stored == NULL) return NULL;
    uint32_t *out = app_alloc(from->windows.count, sizeof *out);
    for (size_t i = 0; i < from->windows.count; i++) out[i] = stored[from->windows.first[i]];
    return out;
}

/* Cross-validation keeps together in a fold what the split keeps together. */
static const uint32_t *units_of(const lg_series *series) {
    if (train_run.split == LG_SPLIT_RUN) return series->run;
    return train_run.split == LG_SPLIT_GROUP ? series->group : NULL;
}

static void compute_features(classical *self) {
    const lg_cut_series *all = &state->all;
    const double begin = app_seconds();
    APP_MUST(self->app, create_features(self->app, &self->model.classifier.features, &error));
    self->table = table_of(self, all);
    self->tested_table = self->table;
    if (state->test != NULL)
        self->tested_table = train_given.method == METHOD_ROCKET ? NULL : table_of(self, &state->foreign);
    self->feature_seconds = app_seconds() - begin;
    self->label = of_windows(all, all->data.series.label);
    self->unit = of_windows(all, units_of(&all->data.series));
}

/* ---- candidates for the options ---- */

static lg_classifier_method method_of(int method) {
    static const lg_classifier_method methods[] = {
        [METHOD_LOGISTIC] = LG_METHOD_LOGISTIC,     [METHOD_TREE] = LG_METHOD_TREE,
        [METHOD_SVM_LINEAR] = LG_METHOD_SVM_LINEAR, [METHOD_SVM_RBF] = LG_METHOD_SVM_RBF,
        [METHOD_BASELINE] = LG_METHOD_LOGISTIC,     [METHOD_ROCKET] = LG_METHOD_RIDGE};
    return methods[method];
}

/* The largest depth of trees that `--prune pre` tries, as published (table 6.7), by features and criterion. A
 * spectrum has the value of the covariance. */
static uint32_t deepest(const train_values *values) {
    if (values->features.name != LG_FEATURES_COV && values->features.name != LG_FEATURES_SPECTRUM) return 13;
    if (values->components > 0) return 8;
    return values->criterion == LG_ENTROPY ? 5 : 6;
}

static double published_alpha(const train_values *values, double noise) {
    const bool entropy = values->criterion == LG_ENTROPY;
    if (values->features.name == LG_FEATURES_STD) return entropy ? 0.003 : 0.002;
    /* The published level nearest to this noise is 50. */
    if (entropy && values->components > 0 && noise > 30) return 0.003;
    return entropy ? 0.01 : 0.003;
}

static lg_classifier_options base_options(const app *self, const train_values *values, double noise) {
    lg_classifier_options options;
    lg_classifier_options_init(&options);
    options.method = method_of(values->method);
    options.components = (uint32_t)values->components;
    options.c = values->c;
    options.gamma = values->gamma;
    options.threads = (int)self->threads;
    options.tree.criterion = (lg_tree_criterion)values->criterion;
    options.tree.max_depth = (uint32_t)values->max_depth;
    options.tree.min_samples_leaf = (uint32_t)values->min_leaf;
    if (values->prune.name == PRUNE_POST)
        options.tree.ccp_alpha =
            app_given(self, "ccp-alpha") ? values->ccp_alpha : published_alpha(values, noise);
    return options;
}

static void list_candidates(const app *self, const train_values *values, double noise, choice *out) {
    const lg_classifier_options base = base_options(self, values, noise);
    const bool svm = values->method == METHOD_SVM_LINEAR || values->method == METHOD_SVM_RBF;
    out->options = app_alloc(MAX_GRID, sizeof *out->options);
    out->count = 0;
    if (values->method == METHOD_TREE && values->prune.name == PRUNE_PRE) {
        for (uint32_t depth = 2; depth <= deepest(values); depth++)
            for (uint32_t split = 2; split <= 4; split++)
                for (uint32_t leaf = 1; leaf <= 2; leaf++) {
                    lg_classifier_options *option = &out->options[out->count++];
                    *option = base;
                    option->tree.max_depth = depth;
                    option->tree.min_samples_split = split;
                    option->tree.min_samples_leaf = leaf;
                }
        return;
    }
    const bool given = values->grid.count > 0, automatic = svm && !app_given(self, "c") && !given;
    const double *grid = given ? values->grid.values : default_grid;
    const size_t count = given ? values->grid.count : automatic ? LG_COUNT(default_grid) : 0;
    for (size_t i = 0; i < count; i++) {
        out->options[i] = base;
        out->options[i].c = grid[i];
    }
    out->count = count;
    if (count == 0) out->options[out->count++] = base;
}

static void choose(classical *self) {
    choice *chosen = &self->chosen;
    list_candidates(self->app, &train_given, state->all.data.noise, chosen);
    if (chosen->count == 1) return;
    chosen->accuracy = app_alloc(chosen->count, sizeof *chosen->accuracy);
    const double begin = app_seconds();
    APP_MUST(self->app, lg_classifier_search(
                            self->app->context, chosen->options, chosen->count, (uint32_t)train_given.folds,
                            self->table, self->label, self->unit, state->train.list, state->train.count,
                            self->model.classifier.features.count, self->model.classes,
                            (int)self->app->threads, chosen->accuracy, &chosen->best, &error));
    chosen->seconds = app_seconds() - begin;
}

static lg_status fit(const classical *self, const lg_classifier_options *options, lg_classifier *out,
                     lg_error *error) {
    return lg_classifier_fit(self->app->context, options, self->table, self->label, state->train.list,
                             state->train.count, self->model.classifier.features.count, self->model.classes,
                             out, error);
}

/* ---- pruning of random convolution features ---- */

/* Moves the columns keep (count) of a table (rows, d) to its front, as a table (rows, count). */
static void keep_columns(double *table, size_t rows, size_t d, const uint32_t *keep, size_t count) {
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < count; j++) table[i * count + j] = table[i * d + keep[j]];
}

/* Of few windows the weights say little: then many small groups of features keep their largest ones. */
static size_t pruned_groups(void) {
    const size_t groups = PRUNED_WINDOWS / state->train.count;
    return groups < 1 ? 1 : groups > PRUNED_GROUPS ? PRUNED_GROUPS : groups;
}

/* Keeps features with large weights, and fits their model again. */
static lg_status prune(classical *self, const lg_classifier_options *options, lg_error *error) {
    lg_classifier *model = &self->model.classifier;
    const size_t d = model->features.count, count = train_given.prune.number;
    if (count == 0 || count >= d) return LG_OK;
    APP_FREE uint32_t *keep = app_alloc(count, sizeof *keep);
    lg_classifier whole = *model;
    LG_TRY(lg_classifier_largest(self->app->context, model, pruned_groups(), count, keep, error));
    LG_TRY(lg_rocket_prune(&model->features, keep, count, error));
    keep_columns(self->table, state->all.windows.count, d, keep, count);
    LG_TRY(fit(self, options, model, error));
    whole.features = (lg_features){0};
    lg_classifier_destroy(&whole);
    return LG_OK;
}

static void judge(const classical *self) {
    APP_MUST(self->app, judge_rows(self->app, &self->model, &state->all, &state->train, self->table,
                                   &state->train_judged, &error));
    const lg_cut_series *tested = lg_detector_tested(state);
    if (self->tested_table == NULL)
        APP_MUST(self->app,
                 judge_windows(self->app, &self->model, tested, &state->tested, &state->judged, &error));
    else
        APP_MUST(self->app, judge_rows(self->app, &self->model, tested, &state->tested, self->tested_table,
                                       &state->judged, &error));
}

/* ---- accuracy of pruned trees against alpha ---- */

static double tree_accuracy(const lg_tree *tree, const lg_pca *pca, const double *table,
                            const uint32_t *label, const lg_window_list *part) {
    const uint32_t d = pca->inputs, k = lg_pca_outputs(pca);
    double *memory = app_alloc(k + d, sizeof *memory);
    size_t right = 0;
    for (size_t i = 0; i < part->count; i++) {
        lg_pca_eval(pca, table + (size_t)part->list[i] * d, 1, memory, memory + k);
        const uint32_t leaf = lg_tree_leaf(tree, memory),
                       *counts = tree->counts + (size_t)leaf * tree->classes;
        uint32_t given = 0;
        for (uint32_t c = 1; c < tree->classes; c++)
            if (counts[c] > counts[given] || (tree->classes == 2 && counts[c] == counts[given])) given = c;
        right += given == label[part->list[i]];
    }
    free(memory);
    return part->count > 0 ? (double)right / (double)part->count : (double)NAN;
}

/* Draws accuracy, nodes and depth against alpha: of the tree without pruning, pruned at each step. */
static void draw_pruning(const classical *self, const char *path) {
    const app *program = self->app;
    lg_classifier_options options = self->chosen.options[self->chosen.best];
    APP_CLEAN(lg_classifier_destroy) lg_classifier whole = {.classes = 0};
    app_plot plot;
    size_t count = 0;
    app_plot_begin(&plot, "pruning", path);
    app_plot_text(&plot, "%.9g", options.tree.ccp_alpha);
    options.tree.ccp_alpha = 0;
    APP_MUST_FILE(program, path, fit(self, &options, &whole, &error));
    const lg_tree *tree = &whole.tree;
    APP_FREE lg_pruning_step *steps = app_alloc(tree->count, sizeof *steps);
    APP_MUST_FILE(program, path, lg_tree_pruning_path(program->context, tree, tree->count, steps, &count));
    /* The windows of --test have their labels in a series of their own. */
    const lg_cut_series *tested = lg_detector_tested(state);
    APP_FREE uint32_t *label = of_windows(tested, tested->data.series.label);
    for (size_t i = 0; i < count; i++) {
        lg_tree pruned;
        APP_MUST_FILE(program, path, lg_tree_prune(program->context, tree, steps[i].alpha, &pruned));
        APP_PLOT_ROW(&plot, 9, steps[i].alpha,
                     tree_accuracy(&pruned, &whole.pca, self->table, self->label, &state->train),
                     tree_accuracy(&pruned, &whole.pca, self->tested_table, label, &state->tested),
                     pruned.count, lg_tree_depth(&pruned));
        lg_tree_destroy(&pruned);
    }
    app_plot_end(program, &plot);
}

static void draw(const classical *self) {
    const int view = view_of(&self->model, train_given.plot_kind, true);
    if (train_given_files.plot != NULL && view == VIEW_PRUNING)
        draw_pruning(self, train_given_files.plot);
    else
        draw_tested(self->app, view, &self->model,
                    state->tested.count > 0 ? &state->judged : &state->train_judged);
}

/* ---- results ---- */

static void json_choice(app_json *json, const classical *self) {
    const choice *chosen = &self->chosen;
    if (chosen->accuracy == NULL) return;
    const bool tree = train_given.method == METHOD_TREE;
    app_json_real(json, "cv_accuracy", chosen->accuracy[chosen->best]);
    app_json_real(json, "grid_seconds", chosen->seconds);
    app_json_open(json, "grid", '[');
    for (size_t i = 0; i < chosen->count; i++) {
        const lg_classifier_options *option = &chosen->options[i];
        app_json_open(json, NULL, '{');
        if (tree) {
            app_json_size(json, "max_depth", option->tree.max_depth);
            app_json_size(json, "min_samples_split", option->tree.min_samples_split);
            app_json_size(json, "min_samples_leaf", option->tree.min_samples_leaf);
        } else {
            app_json_real(json, "c", option->c);
        }
        app_json_real(json, "accuracy", chosen->accuracy[i]);
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
}

static void json_method(app_json *json, const classical *self) {
    const lg_classifier *model = &self->model.classifier;
    const lg_classifier_options *option = &self->chosen.options[self->chosen.best];
    if (model->method == LG_METHOD_TREE) {
        app_json_size(json, "depth", lg_tree_depth(&model->tree));
        app_json_size(json, "nodes", model->tree.count);
        app_json_text(json, "criterion", lg_tree_criterion_name(option->tree.criterion));
        app_json_real(json, "ccp_alpha", option->tree.ccp_alpha);
        app_json_size(json, "max_depth", option->tree.max_depth);
        app_json_size(json, "min_samples_split", option->tree.min_samples_split);
        app_json_size(json, "min_samples_leaf", option->tree.min_samples_leaf);
        return;
    }
    if (model->method == LG_METHOD_RIDGE) {
        app_json_real(json, "penalty", model->logistic.penalty);
        return;
    }
    app_json_real(json, "c", option->c);
    if (model->method == LG_METHOD_LOGISTIC) {
        app_json_size(json, "iterations", model->logistic.iterations);
        return;
    }
    app_json_size(json, "support_vectors", model->svm.vectors);
    app_json_real(json, "gamma", model->method == LG_METHOD_SVM_RBF ? model->svm.gamma : (double)NAN);
}

static void report_json(const classical *self) {
    const lg_classifier *model = &self->model.classifier;
    app_json json;
    app_json_begin(&json);
    json_trained(&json, &self->model);
    app_json_text(&json, "split", lg_split_name(train_run.split));
    app_json_real(&json, "test_fraction", train_run.test_fraction);
    app_json_text(&json, "features", lg_feature_kind_name(model->features.kind));
    app_json_size(&json, "feature_count", model->features.count);
    app_json_size(&json, "components", model->pca.components);
    app_json_text(&json, "directions", train_given.directions == 1 ? "x" : "xy");
    app_json_real(&json, "feature_seconds", self->feature_seconds);
    json_method(&json, self);
    json_choice(&json, self);
    app_json_size(&json, "seed", self->app->seed);
    app_json_size(&json, "threads", self->app->threads);
    app_json_text(&json, "out", train_given_files.out);
    app_json_real(&json, "floor", (double)NAN);
    app_json_warnings(&json, self->app);
    app_json_end(&json);
}

static void report(const classical *self) {
    const lg_classifier *model = &self->model.classifier;
    const lg_classifier_options *option = &self->chosen.options[self->chosen.best];
    if (self->app->json) {
        report_json(self);
        return;
    }
    app_put(stdout, "%s: %s on %u %s features", train_given_files.out, self->model.method,
            model->features.count, lg_feature_kind_name(model->features.kind));
    if (model->pca.components > 0) app_put(stdout, ", %u components", model->pca.components);
    if (model->method == LG_METHOD_TREE)
        app_put(stdout, "; %u nodes, depth %u", model->tree.count, lg_tree_depth(&model->tree));
    else if (model->method == LG_METHOD_RIDGE)
        app_put(stdout, "; penalty %g", model->logistic.penalty);
    else
        app_put(stdout, "; C = %g", option->c);
    if (model->svm.vectors > 0) app_put(stdout, ", %u support vectors", model->svm.vectors);
    if (self->chosen.accuracy != NULL)
        app_put(stdout, " (best of %zu by cross-validation: %.4f)", self->chosen.count,
                self->chosen.accuracy[self->chosen.best]);
    app_put(stdout, "\nfeatures in %.3f s, fitted in %.4f s\n", self->feature_seconds,
            network_recipe.training.seconds);
    print_trained(&self->model);
}

/* ---- a trial of a search ---- */

static lg_status run_trial(classical *self, lg_trial *trial, lg_error *error) {
    const lg_classifier_options options = base_options(self->app, &train_given, state->all.data.noise);
    lg_classifier *model = &self->model.classifier;
    lg_judgement judged = {0};
    LG_TRY(create_features(self->app, &model->features, error));
    LG_TRY(make_table(self, &state->all, &self->table, error));
    LG_TRY(fit(self, &options, model, error));
    LG_TRY(prune(self, &options, error));
    LG_TRY(judge_rows(self->app, &self->model, &state->all, &state->validation, self->table, &judged, error));
    trial->parameters = (uint64_t)model->features.count * (self->model.classes > 2 ? self->model.classes : 1);
    trial->objective = 1.0 - judged.metrics.accuracy;
    lg_judgement_destroy(&judged);
    return LG_OK;
}

lg_status train_trial(const app *program, lg_trial *trial, lg_error *error) {
    if (train_given.method == METHOD_CNN) return LG_NOT_FOUND;
    classical self = {.app = program, .model = trained_model(WELL_CLASSICAL, "rocket")};
    self.model.classifier.method = method_of((int)train_given.method);
    self.label = of_windows(&state->all, state->all.data.series.label);
    const lg_status status = run_trial(&self, trial, error);
    lg_classifier_destroy(&self.model.classifier);
    free(self.label);
    free(self.table);
    return status;
}

/* ---- training ---- */

void train_classical(const app *program) {
    const lg_classifier_method method = method_of(train_given.method);
    classical self = {.app = program};
    self.model = trained_model(WELL_CLASSICAL, train_method_name(train_given.method));
    self.model.classifier.method = method;
    self.model.probabilities = method <= LG_METHOD_TREE;
    compute_features(&self);
    choose(&self);
    const double begin = app_seconds();
    APP_MUST(program, fit(&self, &self.chosen.options[self.chosen.best], &self.model.classifier, &error));
    APP_MUST(program, prune(&self, &self.chosen.options[self.chosen.best], &error));
    network_recipe.training.seconds = app_seconds() - begin;
    check_plot(program, &self.model);
    judge(&self);
    APP_MUST(program, lg_detector_fit_novelty(&network_recipe.training, &self.model.novelty, &error));
    save_trained(program, &self.model);
    draw(&self);
    report(&self);
    lg_classifier_destroy(&self.model.classifier);
    lg_novelty_destroy(&self.model.novelty);
    if (self.tested_table != self.table) free(self.tested_table);
    free(self.label);
    free(self.unit);
    free(self.table);
    free(self.chosen.options);
    free(self.chosen.accuracy);
}
