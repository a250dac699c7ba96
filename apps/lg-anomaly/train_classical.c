/* lg-anomaly train with a classical method: a classifier of features, or novelty, which learns what windows
 * of the healthy class look like, and nothing else. */
#include <math.h>
#include <stdlib.h>

#include "lg-anomaly/train.h"

enum {
    PRUNED_GROUPS = 200,   /* at most so many groups of neighbours keep an equal share of the features */
    PRUNED_WINDOWS = 20000 /* groups times training windows */
};
static const double default_grid[] = {0.1, 1, 10, 100};
/* Of --classifier novelty. Smaller than the default, which is for a third answer in addition to the classes
 * of a classifier. Here single windows beyond the limit are outvoted, while damage stays beyond it. */
static const double MARGIN = 1.6;

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
    char names[2][LG_SERIES_NAME]; /* the classes of --classifier novelty */
    double feature_seconds;
    choice chosen;
} classical;

static lg_detector_state *const state = &train_state;

/* ---- features ---- */

static lg_status create_features(const app *program, lg_features *out, lg_error *error) {
    const lg_series *series = &state->all.data.series;
    const bool baseline = train_given.method == METHOD_BASELINE;
    lg_rocket_options options;
    lg_scaler scaler;
    lg_rocket_options_init(&options);
    options.seed = program->seed;
    options.directions_x = train_given.directions == 1;
    if (train_is_number(train_given.features)) options.features = (uint32_t)train_given.features;
    lg_status status = lg_scaler_fit(program->context, series, &state->all.windows, state->train.list,
                                     state->train.count, false, &scaler);
    if (status != LG_OK) return lg_fail(error, status, "scaling: %s", lg_status_sentence(status));
    if (train_given.method == METHOD_ROCKET)
        status = lg_rocket_fit(program->context, &options, series, &state->all.windows, state->train.list,
                               state->train.count, &scaler, out, error);
    else
        status = lg_features_create(
            program->context,
            baseline ? LG_FEATURES_BASELINE : (lg_feature_kind)train_name(train_given.features),
            train_given.directions == 1, series, (uint32_t)train_run.window, &scaler, out, error);
    lg_scaler_destroy(&scaler);
    return status;
}

static lg_status make_table(const classical *self, const lg_cut_series *from, double **out, lg_error *error) {
    const lg_features *features = &self->model.file.classifier.features;
    const size_t count = from->windows.count;
    *out = app_try_alloc(count * features->count, sizeof **out);
    if (*out == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory: %zu windows with %u features each", count,
                       features->count);
    return lg_features_table(self->app->context, features, &from->data.series, &from->windows,
                             (int)self->app->threads, *out, error);
}

/* Copies a value per stored window to each window that was cut from it. Returns NULL if `stored` is NULL. */
static uint32_t *of_windows(const lg_cut_series *from, const uint32_t *stored) {
    if (stored == NULL) return NULL;
    uint32_t *out = app_alloc(from->windows.count, sizeof *out);
    for (size_t i = 0; i < from->windows.count; i++) out[i] = stored[from->windows.first[i]];
    return out;
}

static lg_status compute_features(classical *self, lg_error *error) {
    const lg_cut_series *all = &state->all;
    const double begin = app_seconds();
    LG_TRY(create_features(self->app, &self->model.file.classifier.features, error));
    LG_TRY(make_table(self, all, &self->table, error));
    if (state->test == NULL)
        self->tested_table = self->table;
    else if (train_given.method != METHOD_ROCKET)
        LG_TRY(make_table(self, &state->foreign, &self->tested_table, error));
    self->feature_seconds = app_seconds() - begin;
    const lg_series *series = &all->data.series;
    self->label = of_windows(all, series->label);
    /* Cross-validation keeps together in a fold what the split keeps together. */
    self->unit = of_windows(all, train_run.split == LG_SPLIT_RUN     ? series->run
                                 : train_run.split == LG_SPLIT_GROUP ? series->group
                                                                     : NULL);
    return LG_OK;
}

/* ---- candidates for the options ---- */

/* METHOD_LOGISTIC and the following ones are in the order of lg_classifier_method. */
static lg_classifier_method method_of(uint32_t method) {
    if (method == METHOD_ROCKET) return LG_METHOD_RIDGE;
    return method == METHOD_BASELINE ? LG_METHOD_LOGISTIC : (lg_classifier_method)(method - METHOD_LOGISTIC);
}

/* The largest depth of trees that `--prune pre` tries, as published (table 6.7), by features and criterion. A
 * spectrum has the value of the covariance. */
static uint32_t deepest(void) {
    const uint32_t features = train_name(train_given.features);
    if (features != LG_FEATURES_COV && features != LG_FEATURES_SPECTRUM) return 13;
    if (train_given.components > 0) return 8;
    return train_given.criterion == LG_ENTROPY ? 5 : 6;
}

static double published_alpha(void) {
    const bool entropy = train_given.criterion == LG_ENTROPY;
    if (train_name(train_given.features) == LG_FEATURES_STD) return entropy ? 0.003 : 0.002;
    /* The published level nearest to this noise is 50. */
    if (entropy && train_given.components > 0 && state->all.data.noise > 30) return 0.003;
    return entropy ? 0.01 : 0.003;
}

static lg_classifier_options base_options(const app *self) {
    lg_classifier_options options;
    lg_classifier_options_init(&options);
    options.method = method_of(train_given.method);
    options.components = (uint32_t)train_given.components;
    options.c = train_given.c;
    options.gamma = train_given.gamma;
    options.threads = (int)self->threads;
    options.tree.criterion = (lg_tree_criterion)train_given.criterion;
    options.tree.max_depth = (uint32_t)train_given.max_depth;
    if (train_name(train_given.prune) == PRUNE_POST)
        options.tree.ccp_alpha = app_given(self, "ccp-alpha") ? train_given.ccp_alpha : published_alpha();
    return options;
}

static void list_candidates(const app *self, choice *out) {
    const lg_classifier_options base = base_options(self);
    const bool svm = train_given.method == METHOD_SVM_LINEAR || train_given.method == METHOD_SVM_RBF,
               tree = train_given.method == METHOD_TREE && train_name(train_given.prune) == PRUNE_PRE,
               given = train_given.grid.count > 0, automatic = svm && !app_given(self, "c") && !given;
    const double *grid = given ? train_given.grid.values : default_grid;
    const size_t count = given ? train_given.grid.count : automatic ? LG_COUNT(default_grid) : 0;
    out->count = tree ? 6 * (deepest() - 1) : count > 0 ? count : 1;
    out->options = app_keep(out->count, sizeof *out->options);
    for (uint32_t i = 0; i < out->count; i++) {
        lg_classifier_options *option = &out->options[i];
        *option = base;
        if (tree) {
            option->tree.max_depth = 2 + i / 6;
            option->tree.min_samples_split = 2 + i / 2 % 3;
            option->tree.min_samples_leaf = 1 + i % 2;
        } else if (count > 0) {
            option->c = grid[i];
        }
    }
}

static void choose(classical *self) {
    choice *chosen = &self->chosen;
    list_candidates(self->app, chosen);
    if (chosen->count == 1) return;
    chosen->accuracy = app_keep(chosen->count, sizeof *chosen->accuracy);
    const double begin = app_seconds();
    APP_DO(self->app, lg_classifier_search, chosen->options, chosen->count, (uint32_t)train_given.folds,
           self->table, self->label, self->unit, state->train.list, state->train.count,
           self->model.file.classifier.features.count, self->model.file.names.classes,
           (int)self->app->threads, chosen->accuracy, &chosen->best);
    chosen->seconds = app_seconds() - begin;
}

static lg_status fit(const classical *self, const lg_classifier_options *options, lg_classifier *out,
                     lg_error *error) {
    return lg_classifier_fit(self->app->context, options, self->table, self->label, state->train.list,
                             state->train.count, self->model.file.classifier.features.count,
                             self->model.file.names.classes, out, error);
}

/* ---- pruning of random convolution features ---- */

/* Keeps features with large weights, and fits their model again. Of few windows the weights say little: then
 * many small groups of features keep their largest ones. The table (rows, d) becomes (rows, count). */
static lg_status prune(classical *self, lg_error *error) {
    lg_classifier *model = &self->model.file.classifier;
    const size_t d = model->features.count,
                 count = train_is_number(train_given.prune) ? train_given.prune : 0,
                 few = PRUNED_WINDOWS / state->train.count,
                 groups = few < 1               ? 1
                          : few > PRUNED_GROUPS ? PRUNED_GROUPS
                                                : few;
    if (count == 0 || count >= d) return LG_OK;
    APP_FREE uint32_t *keep = app_alloc(count, sizeof *keep);
    lg_classifier whole = *model;
    LG_TRY(lg_classifier_largest(self->app->context, model, groups, count, keep, error));
    LG_TRY(lg_rocket_prune(&model->features, keep, count, error));
    for (size_t i = 0; i < state->all.windows.count; i++)
        for (size_t j = 0; j < count; j++) self->table[i * count + j] = self->table[i * d + keep[j]];
    LG_TRY(fit(self, &self->chosen.options[self->chosen.best], model, error));
    whole.features = (lg_features){0};
    lg_classifier_destroy(&whole);
    return LG_OK;
}

/* Scores windows from the features of all windows, table (windows, d), on one thread: so out->seconds is the
 * time on one thread. Without a table the windows are scored one by one. */
static lg_status judge_part(const app *self, const well_model *model, const lg_cut_series *from,
                            const lg_window_list *part, const double *table, lg_judgement *out,
                            lg_error *error) {
    const lg_classifier *classifier = &model->file.classifier;
    const lg_scorer by = well_model_scorer(model);
    if (table == NULL) return lg_judge(self->context, &by, from, part, self->threads, out, error);
    APP_FREE void *work = app_alloc(lg_classifier_work_size(classifier), 1);
    LG_TRY(lg_judgement_begin(self->context, &by, from, part, out, error));
    for (size_t i = 0; i < out->count; i++)
        lg_classifier_score(classifier, table + (size_t)part->list[i] * classifier->features.count,
                            out->score + i * out->classes, work);
    return lg_judgement_end(out, LG_OK, error);
}

/* ---- accuracy of pruned trees against alpha ---- */

static double accuracy_of(const classical *self, const well_model *model, const lg_cut_series *from,
                          const lg_window_list *part, const double *table) {
    APP_CLEAN(lg_judgement_destroy) lg_judgement judged = {0};
    APP_MUST(self->app, judge_part(self->app, model, from, part, table, &judged, &error));
    return judged.metrics.accuracy;
}

/* Draws accuracy, nodes and depth against alpha: of the tree without pruning, pruned at each step. */
void put_pruning(app_plot *plot, const void *view) {
    const classical *self = ((const viewing *)view)->classical;
    const app *program = self->app;
    const char *path = app_plot_given.plot;
    lg_classifier_options options = self->chosen.options[self->chosen.best];
    well_model model = self->model;
    APP_CLEAN(lg_classifier_destroy) lg_classifier whole = {.classes = 0};
    size_t count = 0;
    app_plot_text(plot, "%.9g", options.tree.ccp_alpha);
    options.tree.ccp_alpha = 0;
    APP_MUST_FILE(program, path, fit(self, &options, &whole, &error));
    const lg_tree *tree = &whole.tree;
    APP_FREE lg_pruning_step *steps = app_alloc(tree->count, sizeof *steps);
    APP_MUST_FILE(program, path, lg_tree_pruning_path(program->context, tree, tree->count, steps, &count));
    for (size_t i = 0; i < count; i += 1 + count / 200) { /* each step prunes the whole tree */
        lg_tree *pruned = &model.file.classifier.tree;
        APP_MUST_FILE(program, path, lg_tree_prune(program->context, tree, steps[i].alpha, pruned));
        APP_PLOT_ROW(plot, 9, steps[i].alpha,
                     accuracy_of(self, &model, &state->all, &state->train, self->table),
                     accuracy_of(self, &model, lg_detector_tested(state), &state->tested, self->tested_table),
                     pruned->count, pruned->depth);
        lg_tree_destroy(pruned);
    }
}

/* ---- results ---- */

#define TREE_SIZES(option)                                                                                   \
    LG_AS_WHOLE("max_depth", option->tree.max_depth),                                                        \
        LG_AS_WHOLE("min_samples_split", option->tree.min_samples_split),                                    \
        LG_AS_WHOLE("min_samples_leaf", option->tree.min_samples_leaf)

static void put_choice(app_json *out, const choice *chosen) {
    APP_PUT(out,
            LG_REAL("cv_accuracy", chosen->accuracy[chosen->best], "best of the grid by cross-validation"),
            LG_AS_REAL("grid_seconds", chosen->seconds));
    app_json_open(out, "grid", '[');
    for (size_t i = 0; i < chosen->count; i++) {
        const lg_classifier_options *option = &chosen->options[i];
        const lg_result accuracy = LG_AS_REAL("accuracy", chosen->accuracy[i]);
        if (train_given.method == METHOD_TREE)
            APP_OBJECT(out, NULL, TREE_SIZES(option), accuracy);
        else
            APP_OBJECT(out, NULL, LG_AS_REAL("c", option->c), accuracy);
    }
    app_json_close(out, ']');
}

static void put_method(app_json *out, const lg_classifier *model, const lg_classifier_options *option) {
    if (model->method == LG_METHOD_TREE) {
        APP_PUT(out, LG_WHOLE("depth", model->tree.depth, NULL), LG_WHOLE("nodes", model->tree.count, NULL),
                LG_AS_TEXT("criterion", lg_tree_criterion_name(option->tree.criterion)),
                LG_AS_REAL("ccp_alpha", option->tree.ccp_alpha), TREE_SIZES(option));
    } else if (model->method == LG_METHOD_RIDGE) {
        app_result_real(out, "penalty", model->logistic.penalty, NULL);
    } else {
        app_result_real(out, "c", option->c, NULL);
        if (model->method == LG_METHOD_LOGISTIC) {
            app_json_put(out, LG_WHOLE("iterations", model->logistic.iterations, NULL));
            return;
        }
        APP_PUT(out, LG_WHOLE("support_vectors", model->svm.vectors, NULL),
                LG_AS_REAL("gamma", model->method == LG_METHOD_SVM_RBF ? model->svm.gamma : (double)NAN));
    }
}

static void put_classical(app_json *out, const classical *self) {
    const lg_classifier *model = &self->model.file.classifier;
    if (self->model.sort == WELL_NOVELTY) {
        APP_PUT(out, LG_WHOLE("feature_count", self->model.file.novelty.features, NULL),
                LG_AS_WHOLE("bands", self->model.file.novelty.bands));
        return;
    }
    APP_PUT(out, LG_TEXT("features", lg_feature_kind_name(model->features.kind), NULL),
            LG_WHOLE("feature_count", model->features.count, NULL),
            LG_WHOLE("components", model->pca.components, NULL),
            LG_AS_TEXT("directions", train_given.directions == 1 ? "x" : "xy"),
            LG_REAL("feature_seconds", self->feature_seconds, NULL));
    put_method(out, model, &self->chosen.options[self->chosen.best]);
    if (self->chosen.accuracy != NULL) put_choice(out, &self->chosen);
}

static void report(const classical *self) {
    const app *program = self->app;
    const well_model *model = &self->model;
    lg_training *training = &network_recipe.training;
    app_json *out = program->out;
    put_metrics(out, &state->judged, model);
    lg_detector_tell_training(training, model->method, model->file.names.classes,
                              model->file.names.class_name);
    train_put_results(out, training, 0, training->result_count);
    APP_PUT(out, LG_TEXT("healthy", train_run.healthy[0] != '\0' ? train_run.healthy : NULL, NULL),
            LG_TEXT("split", lg_split_name(train_run.split), NULL),
            LG_AS_REAL("test_fraction", train_run.test_fraction));
    put_classical(out, self);
    APP_PUT(out, LG_AS_WHOLE("seed", program->seed), LG_AS_WHOLE("threads", program->threads),
            LG_TEXT("out", train_given_files.out, NULL));
    if (model->sort == WELL_CLASSICAL) app_json_real(out, "floor", (double)NAN);
}

/* ---- training ---- */

static lg_status learn(classical *self, lg_error *error) {
    LG_TRY(compute_features(self, error));
    choose(self);
    const double begin = app_seconds();
    LG_TRY(fit(self, &self->chosen.options[self->chosen.best], &self->model.file.classifier, error));
    LG_TRY(prune(self, error));
    network_recipe.training.seconds = app_seconds() - begin;
    return LG_OK;
}

/* A trial of a search. */
static lg_status run_trial(classical *self, lg_trial *trial, lg_error *error) {
    const lg_classifier *model = &self->model.file.classifier;
    lg_judgement judged = {0};
    LG_TRY(learn(self, error));
    LG_TRY(judge_part(self->app, &self->model, &state->all, &state->validation, self->table, &judged, error));
    trial->parameters = (uint64_t)model->features.count * (model->classes > 2 ? model->classes : 1);
    trial->objective = 1.0 - judged.metrics.accuracy;
    lg_judgement_destroy(&judged);
    return LG_OK;
}

/* Learns the training windows of the healthy class, number 0; all others are of one class. */
static lg_status train_novelty(classical *self, lg_error *error) {
    lg_window_list *train = &state->train;
    const lg_cut_series *all = &state->all;
    lg_novelty_options options;
    size_t kept = 0;
    (void)snprintf(self->names[0], LG_SERIES_NAME, "%s", train_run.healthy);
    (void)snprintf(self->names[1], LG_SERIES_NAME, "unlike");
    lg_series *names = &self->model.file.names;
    self->model.sort = WELL_NOVELTY;
    names->classes = 2;
    names->class_name = self->names;
    names->class_label = NULL;
    for (size_t i = 0; i < train->count; i++)
        if (all->data.series.label[all->windows.first[train->list[i]]] == 0)
            train->list[kept++] = train->list[i];
    train->count = kept;
    const double begin = app_seconds();
    lg_novelty_options_init(&options);
    options.margin = MARGIN;
    LG_TRY(lg_novelty_fit(self->app->context, &options, &all->data.series, &all->windows, train->list,
                          train->count, (int)self->app->threads, &self->model.file.novelty, error));
    network_recipe.training.seconds = app_seconds() - begin;
    return LG_OK;
}

static void run_training(classical *self) {
    const app *program = self->app;
    if (program->rank_count > 1)
        app_stop_usage(program, "only --classifier cnn can be trained by several ranks");
    APP_MUST(program, (state->alone ? train_novelty : learn)(self, &error));
    if (!state->alone)
        APP_MUST(program,
                 lg_detector_fit_novelty(&network_recipe.training, &self->model.file.novelty, &error));
    app_plot_check(program, plots_of(&self->model, true));
    APP_MUST(program, judge_part(program, &self->model, &state->all, &state->train, self->table,
                                 &state->train_judged, &error));
    APP_MUST(program, judge_part(program, &self->model, lg_detector_tested(state), &state->tested,
                                 self->tested_table, &state->judged, &error));
    classifier_file *file = &self->model.file;
    file->accuracy = state->judged.metrics.accuracy;
    file->f1 = state->judged.metrics.f1;
    file->provenance = app_provenance(program, train_run.training.seed);
    APP_FILE(program, train_given_files.out, lg_recipe_save, &classifier_recipe, file, NULL);
    app_plot_draw(program, plots_of(&self->model, true),
                  &(viewing){&self->model, lg_detector_tested(state),
                             state->tested.count > 0 ? &state->judged : &state->train_judged,
                             .classical = self});
    report(self);
}

lg_status train_classical(const app *program, lg_trial *trial, lg_error *error) {
    const char *method = classifier_method_name(train_given.method);
    classical self = {.app = program, .model = trained_model(WELL_CLASSICAL, method)};
    lg_status status = LG_OK;
    if (train_given.method == METHOD_CNN) return LG_NOT_FOUND;
    if (trial != NULL)
        status = run_trial(&self, trial, error);
    else
        run_training(&self);
    lg_classifier_destroy(&self.model.file.classifier);
    lg_novelty_destroy(&self.model.file.novelty);
    if (self.tested_table != self.table) free(self.tested_table);
    free(self.label);
    free(self.unit);
    free(self.table);
    return status;
}
