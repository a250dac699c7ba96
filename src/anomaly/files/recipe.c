/* The trainer of detectors: how a convolutional network is trained on labelled series. */
#include "anomaly/files/recipe.h"

#include <math.h>
#include <string.h>

/* ---- options ---- */

enum { NETWORK = 1, DEFAULT_LENGTH = 4096 };

#define ROW(name, type, member, ...) LG_FIELD(lg_detector_state, "", name, type, member, __VA_ARGS__)
const lg_field lg_detector_options[] = {
    ROW("window", REAL, window, .high = 1e9, .unit = "SECONDS", .otherwise = "as stored; baseline: 600 s",
        .usual = true,
        .meaning = "Length of a window; in samples if the sampling rate of the data is unknown"),
    ROW("hop", REAL, hop, .high = 1e9, .unit = "SECONDS", .otherwise = "the window; baseline: 60 s",
        .meaning = "Distance from one window to the next"),
    ROW("preset", NAME, preset, .value_name = lg_preset_name, .value = "best", .methods = NETWORK,
        .meaning = "cnn: where options that are not given come from: the published settings or ours"),
    ROW("filters", WHOLES, filters, .low = 1, .high = 1 << 20, .most = LG_CNN_MAX_BLOCKS, .unit = "n,n,...",
        .methods = NETWORK,
        .otherwise = "2, 4, 8 times the channels of the data; fewer blocks if windows are too short for "
                     "three",
        .meaning = "cnn: channels of each block"),
    ROW("kernel", U64, kernel, .low = 1, .high = 1 << 20, .value = "5", .unit = "n", .methods = NETWORK,
        .meaning = "cnn: samples of a kernel"),
    ROW("stride", U64, stride, .low = 1, .high = 1 << 20, .value = "1", .unit = "n", .methods = NETWORK,
        .meaning = "cnn: stride of the convolutions"),
    ROW("pooling", NAME, pooling, LG_NAMED(lg_pooling_name, LG_POOLING_COUNT), .value = "average",
        .methods = NETWORK, .meaning = "cnn: pooling after each convolution"),
    LG_TEST_ROW(lg_detector_state, "TEST.h5", "Test on this file; DATA.h5 is then all for training",
                .without = "test-fraction"),
    LG_FIELD_END};

/* ---- the data ---- */

static lg_status read_test(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_series like = s->all.data.series;
    if (s->alone) like.classes = 0;
    if (s->test == NULL) return LG_OK;
    self->failed = s->test;
    LG_TRY(lg_series_read_like(self->context, s->test, &like, &s->foreign.data, error));
    self->failed = NULL;
    if (strcmp(s->foreign.data.sha256, s->all.data.sha256) == 0)
        LG_WARN(self, "%s holds the same windows as %s: there is no test on unseen data", s->test,
                self->paths[0]);
    return LG_OK;
}

static lg_status read_data(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    const lg_detector_file *file = self->file;
    if (file != NULL)
        return lg_series_read_like(self->context, self->paths[0], &file->names, &s->all.data, error);
    LG_TRY(lg_series_read(self->context, self->paths[0], NULL, NULL, &s->all.data, error));
    memcpy(self->sha256, s->all.data.sha256, sizeof self->sha256);
    return read_test(self, error);
}

static void close_data(lg_training *self) {
    lg_detector_state *s = self->state;
    lg_series_data_destroy(&s->all.data);
    lg_series_data_destroy(&s->foreign.data);
}

/* ---- the run ---- */

/* Applies the options that the user has given for all blocks. */
static void adopt_block(const lg_training *self, lg_cnn_block *block) {
    const lg_detector_state *s = self->state;
    if (self->given(self, "kernel")) block->kernel = (uint32_t)s->kernel;
    if (self->given(self, "stride")) block->stride = (uint32_t)s->stride;
    if (self->given(self, "pooling")) block->pooling = (lg_pooling)s->pooling;
}

/* Sets the default blocks with the convolutions and pooling that the user has given: three blocks, or fewer
 * if a further block would leave no sample of the window. The first block is set in any case, so that
 * lg_cnn_init can report it as wrong. */
static void default_blocks(const lg_training *self, lg_cnn *net) {
    lg_cnn full;
    lg_cnn_init_default(&full, net->channels, DEFAULT_LENGTH, net->outputs, net->activation);
    const bool pooling_given = self->given(self, "pooling");
    uint64_t left = net->length;
    net->blocks = 0;
    while (net->blocks < full.blocks && (net->blocks == 0 || left > 1)) {
        lg_cnn_block block = full.block[net->blocks];
        if (left < block.kernel) block.kernel = (uint32_t)left;
        adopt_block(self, &block);
        const uint64_t convolved = left < block.kernel ? 0 : (left - block.kernel) / block.stride + 1;
        if (convolved < block.pool_size && !pooling_given) block.pooling = LG_POOL_NONE;
        left = block.pooling == LG_POOL_NONE ? convolved : convolved / block.pool_size;
        if (left == 0 && net->blocks > 0) return;
        net->block[net->blocks++] = block;
    }
}

/* Sets the blocks from the options that are given; without any of these options the blocks stay as they are.
 * `fresh`: there is no stored model to continue from. */
static void build_blocks(const lg_training *self, bool fresh, lg_cnn *net) {
    static const char *const options[] = {"filters", "kernel", "stride", "pooling"};
    const lg_detector_state *s = self->state;
    bool any = false;
    for (size_t i = 0; i < LG_COUNT(options); i++) any = any || self->given(self, options[i]);
    if (!any) return;
    const bool filters = self->given(self, "filters");
    if (fresh && !filters) {
        default_blocks(self, net);
        return;
    }
    if (filters) net->blocks = (uint32_t)s->filters.count;
    for (uint32_t i = 0; i < net->blocks; i++) {
        if (filters)
            net->block[i] = (lg_cnn_block){.channels = s->filters.values[i],
                                           .kernel = 5,
                                           .stride = 1,
                                           .pooling = LG_POOL_AVERAGE,
                                           .pool_size = 2,
                                           .pool_stride = 2};
        adopt_block(self, &net->block[i]);
    }
}

/* Completes run->model from the options, the data and the stored model, if there is one. Activation and plane
 * are hyperparameters and come from the run; the blocks of a stored model are kept, except for options that
 * are given. */
static lg_status complete_model(const lg_training *self, lg_error *error) {
    const lg_series *series = &((lg_detector_state *)self->state)->all.data.series;
    const lg_detector_run *stored = self->stored;
    lg_detector_run *run = self->run;
    lg_detector *model = &run->model;
    const lg_activation activation = model->net.activation;
    const uint32_t plane = model->net.plane;
    if (model->loss == LG_DETECTOR_MSE && series->classes != 2)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--loss mse is for two classes, but the data have %u: use cross-entropy",
                       series->classes);
    model->classes = series->classes;
    const uint32_t outputs = model->loss == LG_DETECTOR_MSE ? 1 : series->classes;
    if (stored != NULL)
        model->net = stored->model.net;
    else
        lg_cnn_init_default(&model->net, series->channels, (uint32_t)run->window, outputs, activation);
    model->net.activation = activation;
    model->net.plane = plane;
    model->net.outputs = outputs;
    build_blocks(self, stored == NULL, &model->net);
    LG_TRY(lg_cnn_init(&model->net, error));
    return lg_detector_check(model, error);
}

static void adopt_row(lg_training *self, const lg_detector_preset *preset, uint32_t classes) {
    const lg_detector_run from = {.model = {.net.activation = preset->activation,
                                            .loss = classes == 2 ? preset->loss : LG_DETECTOR_CROSS_ENTROPY},
                                  .training = preset->training};
    lg_training_adopt(self, &from, true);
}

/* The cases are the levels of noise that presets have. */
static bool usual(lg_training *self, uint32_t at) {
    static const double levels[] = {NAN, 1.0, 10.0, 50.0};
    if (at < LG_COUNT(levels)) adopt_row(self, lg_detector_preset_find(self->preset, levels[at]), 2);
    return at < LG_COUNT(levels);
}

static lg_status adopt_preset(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_fit_settings *training = lg_training_settings(self);
    const lg_series_data *data = &s->all.data;
    const char *name = lg_preset_name(s->preset);
    const lg_detector_preset *preset = s->from = lg_detector_preset_find(name, data->noise);
    if (preset == NULL) return lg_fail(error, LG_UNSUPPORTED, "--preset: there are no settings for %s", name);
    adopt_row(self, preset, data->series.classes);
    const lg_fit_plan *plan = &training->plan;
    for (uint32_t i = 0; i < plan->phases && !self->given(self, "dtype"); i++)
        if (!lg_fit_method_batches((lg_fit_method)plan->phase[i].method))
            training->dtype = LG_F64; /* methods without batches need double precision */
    return LG_OK;
}

/* A window is a stored window, unless the data are recordings and long windows are asked for. If the rate is
 * unknown, a long window has ten stored windows. */
static void usual_window(const lg_detector_state *s, lg_detector_run *run) {
    enum { WINDOW = 600, HOP = 60, STORED = 10 }; /* WINDOW, HOP: seconds */
    const lg_series *series = &s->all.data.series;
    run->window = series->length;
    run->hop = 0;
    if (!s->long_windows || series->run == NULL) return;
    run->hop = run->window;
    run->window *= STORED;
    if (!(series->rate > 0)) return;
    run->window = (uint64_t)fmax(floor(WINDOW * series->rate + 0.5), 1);
    run->hop = (uint64_t)fmax(floor(HOP * series->rate + 0.5), 1);
}

static lg_status describe(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_detector_run *run = self->run;
    const lg_detector_run *stored = self->stored;
    const lg_series *series = &s->all.data.series;
    s->from = NULL;
    if (stored == NULL) LG_TRY(adopt_preset(self, error));
    if (s->test != NULL) run->test_fraction = 0;
    if (s->classical) run->validation_fraction = 0;
    /* The windows are not cut yet; until then the stored number of windows, if any, is used. */
    run->windows = stored != NULL ? stored->windows : 0;
    memcpy(run->data_sha256, s->all.data.sha256, sizeof run->data_sha256);
    LG_TRY(lg_detector_settle(self, error));
    usual_window(s, run);
    LG_TRY(lg_detector_window(self, &run->window, &run->hop, error));
    if (stored != NULL && !self->given(self, "window") && !self->given(self, "hop")) {
        run->window = stored->window;
        run->hop = stored->hop;
    }
    if (series->classes < 2 && !s->alone)
        return lg_fail(error, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'",
                       series->class_name[0]);
    return s->classical ? LG_OK : complete_model(self, error);
}

static lg_status hold_out(lg_training *self, double validation, lg_error *error) {
    ((lg_detector_run *)self->run)->validation_fraction = validation;
    LG_TRY(lg_detector_split_training(self, error));
    if (((lg_detector_state *)self->state)->validation.count > 0) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "the validation part has no windows: increase --validation-fraction");
}

/* ---- the problem ---- */

static lg_status make_problem(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    const lg_detector_run *run = self->run;
    const lg_cut_series *all = &s->all;
    const size_t count = s->train.count + s->validation.count;
    uint32_t *chosen;
    LG_TRAINING_ARRAY(self, chosen, count, error);
    memcpy(chosen, s->train.list, s->train.count * sizeof *chosen);
    memcpy(chosen + s->train.count, s->validation.list, s->validation.count * sizeof *chosen);
    const lg_status scaled = lg_scaler_fit(self->context, &all->data.series, &all->windows, s->train.list,
                                           s->train.count, run->model.centred, &s->scaler);
    if (scaled != LG_OK) return lg_fail(error, scaled, "scaling: %s", lg_status_sentence(scaled));
    LG_TRY(lg_detector_data_create(self->context, &run->model, &s->scaler, &all->data.series, &all->windows,
                                   chosen, count, run->training.dtype, &s->data, error));
    s->problem = (lg_detector_problem){&run->model, &s->data, s->train.count, run->training.seed};
    lg_detector_fit_problem(&s->problem, &self->problem);
    self->options.keep_best = self->problem.validation > 0;
    self->options.restarts = run->restarts;
    LG_TRAINING_ARRAY(self, self->theta, self->problem.parameters, error);
    lg_detector_initialise(&run->model, run->training.seed, 0, self->theta);
    return LG_OK;
}

static void release(lg_training *self) {
    lg_detector_state *s = self->state;
    lg_window_list *const parts[] = {&s->train, &s->validation, &s->tested};
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        lg_free(self->context, parts[i]->list);
        *parts[i] = (lg_window_list){NULL, 0};
    }
    lg_detector_data_destroy(&s->data);
    lg_scaler_destroy(&s->scaler);
    lg_novelty_destroy(&s->novelty);
    lg_judgement_destroy(&s->train_judged);
    lg_judgement_destroy(&s->judged);
    lg_windows_destroy(&s->all.windows);
    lg_windows_destroy(&s->foreign.windows);
}

/* ---- the result ---- */

static lg_status score(const void *plan, const float *x, double *score, double *plane, void *work) {
    lg_detector_eval(plan, x, score, plane, work);
    return LG_OK;
}

lg_scorer lg_detector_scorer(const lg_detector_plan *plan, const lg_detector *model, uint32_t healthy) {
    return (lg_scorer){
        score, plan, lg_detector_work_size(plan), model->classes, healthy, model->net.plane == 2, true};
}

/* Judges the training part (if it has windows) and the test part. */
static lg_status judge_parts(const lg_training *self, const lg_scaler *scaler, const double *theta,
                             lg_error *error) {
    lg_detector_state *s = self->state;
    const lg_detector_run *run = self->run;
    lg_detector_plan *plan;
    LG_TRY(lg_detector_plan_create(self->context, &run->model, scaler, theta, run->training.dtype, &plan,
                                   error));
    const lg_scorer by = lg_detector_scorer(plan, &run->model, s->healthy);
    lg_status status =
        lg_judge(self->context, &by, &s->all, &s->train, self->threads, &s->train_judged, error);
    if (status == LG_OK)
        status =
            lg_judge(self->context, &by, lg_detector_tested(s), &s->tested, self->threads, &s->judged, error);
    lg_detector_plan_destroy(plan);
    return status;
}

/* Counts the dead units of the result. A network that has died makes the training fail. */
static lg_status judge_units(lg_training *self, const double *theta, uint64_t *dead, lg_error *error) {
    lg_detector_state *s = self->state;
    const lg_status status = lg_detector_count_units(&s->problem, theta, &s->units);
    if (status != LG_OK) return lg_fail(error, status, "dead units: %s", lg_status_sentence(status));
    for (uint32_t i = 0; i < s->units.layers; i++) *dead += s->units.layer[i].constant;
    self->verdict.failed = s->units.died;
    return LG_OK;
}

static void warn_of_units(const lg_training *self) {
    const lg_detector_run *run = self->run;
    const lg_detector_units *units = &((const lg_detector_state *)self->state)->units;
    const uint64_t restarts = lg_fit_restarts(self->fit);
    if (restarts > 0)
        LG_WARN(self,
                "the network died and was started again with other weights (restart %llu of at most %u)",
                (unsigned long long)restarts, run->restarts);
    for (uint32_t i = 0; i < units->layers; i++) {
        lg_slice_info info;
        if (units->layer[i].constant == 0) continue;
        (void)lg_cnn_slice(&run->model.net, 2 * i, &info);
        LG_WARN(self, "dead units of layer %.*s: %u of %u have the same value for all training windows",
                (int)strcspn(info.name, "/"), info.name, units->layer[i].constant, units->layer[i].units);
    }
    if (units->died)
        LG_WARN(self, "the network has died and gives all windows one class: decrease --lr, or take "
                      "--activation swish, another --seed or a wider --plane");
}

void lg_detector_tell(lg_training *self, const lg_judgement *judged, uint64_t hop, double rate,
                      char (*class_name)[LG_SERIES_NAME]) {
    const lg_metrics *metrics = &judged->metrics;
    const char *mean = judged->classes == 2 ? NULL : "mean over the classes";
    LG_TELL(self, LG_REAL("accuracy", metrics->accuracy, NULL),
            LG_REAL("precision", metrics->precision, mean), LG_REAL("recall", metrics->recall, mean),
            LG_REAL("f1", metrics->f1, mean), LG_REAL("auc", judged->auc, NULL),
            LG_REAL("false_positive_rate", metrics->false_positive_rate, NULL),
            LG_REAL("false_alarms_per_day", lg_judgement_alarms(judged, hop, rate), "window by window"),
            LG_AS_CONFUSION("confusion", judged->count > 0 ? judged->confusion : NULL, judged->classes,
                            class_name));
}

void lg_detector_tell_training(lg_training *self, const char *method, uint32_t classes,
                               char (*class_name)[LG_SERIES_NAME]) {
    const lg_detector_state *s = self->state;
    const lg_detector_run *run = self->run;
    const lg_series *series = &s->all.data.series;
    LG_TELL(self, LG_REAL("train_accuracy", s->train_judged.metrics.accuracy, "of the training part"),
            LG_REAL("train_f1", s->train_judged.metrics.f1, "of the training part"),
            LG_REAL("train_seconds", self->seconds, NULL), LG_REAL("test_seconds", s->judged.seconds, NULL),
            LG_TEXT("method", method, NULL), LG_AS_TEXTS("classes", class_name, classes),
            LG_WHOLE("channels", series->channels, NULL), LG_WHOLE("window", run->window, "samples"),
            LG_WHOLE("hop", run->hop, "samples"),
            LG_REAL("rate", series->rate > 0 ? series->rate : (double)NAN, "samples per second"),
            LG_WHOLE("windows", s->all.windows.count, NULL), LG_WHOLE("train_windows", s->train.count, NULL),
            LG_WHOLE("validation_windows", s->validation.count, NULL),
            LG_WHOLE("test_windows", s->tested.count, NULL), LG_TEXT("test", s->test, NULL),
            LG_TEXT("data_sha256", run->data_sha256, NULL));
}

static void tell_network(lg_training *self, const lg_cnn *net) {
    LG_TELL(self, LG_WHOLE("parameters", lg_cnn_parameters(net), NULL));
    lg_result_open(self, "blocks", '[');
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *block = &net->block[i];
        LG_RESULT_OBJECT(
            self, NULL, LG_AS_WHOLE("filters", block->channels), LG_AS_WHOLE("kernel", block->kernel),
            LG_AS_WHOLE("stride", block->stride), LG_AS_WHOLE("padding", block->padding),
            LG_AS_TEXT("pooling", lg_pooling_name(block->pooling)),
            LG_AS_WHOLE("pool_size", block->pool_size), LG_AS_WHOLE("length", net->lengths[i + 1]));
    }
    lg_result_close(self, ']');
}

static lg_status judge(lg_training *self, double *theta, lg_error *error) {
    const lg_detector_state *s = self->state;
    const lg_detector_run *run = self->run;
    const lg_series *series = &s->all.data.series;
    uint64_t dead = 0;
    LG_TRY(judge_parts(self, &s->scaler, theta, error));
    self->verdict =
        (lg_training_verdict){.what = "share of wrong windows",
                              .guess = "the most frequent class",
                              .error = 1.0 - s->train_judged.metrics.accuracy,
                              .guessed = lg_guess_class(s->train_judged.confusion, s->train_judged.classes)};
    LG_TRY(judge_units(self, theta, &dead, error));
    lg_detector_tell(self, &s->judged, run->hop, series->rate, series->class_name);
    lg_detector_tell_training(self, "cnn", series->classes, series->class_name);
    LG_TELL(self, LG_REAL("mse", s->judged.mse, "of the test part"),
            LG_REAL("train_mse", s->train_judged.mse, "of the training part"));
    self->first_count = self->result_count;
    tell_network(self, &run->model.net);
    LG_TELL(self, LG_WHOLE("restarts", lg_fit_restarts(self->fit), NULL), LG_WHOLE("dead_units", dead, NULL),
            LG_TEXT("preset", s->from != NULL ? s->from->name : NULL, NULL),
            LG_TEXT("source", s->from != NULL ? s->from->source : NULL, NULL));
    return LG_OK;
}

/* The warnings about dead units are here because `save` runs after the verdict has been told. */
static lg_status save(lg_training *self, void *into, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_detector_file *file = into;
    warn_of_units(self);
    LG_TRY(lg_detector_fit_novelty(self, &s->novelty, error));
    file->scaler = s->scaler;
    file->names = s->all.data.series;
    file->novelty = s->novelty;
    file->accuracy = s->judged.metrics.accuracy;
    file->f1 = s->judged.metrics.f1;
    file->test_mse = s->judged.mse;
    return LG_OK;
}

/* Evaluates a stored model. If the data are the ones that the model was trained on, only the test part is
 * used; otherwise all windows are used. */
static lg_status evaluate(lg_training *self, const void *from, lg_error *error) {
    const lg_detector_file *file = from;
    const lg_detector_run *run = self->run;
    lg_detector_state *s = self->state;
    LG_TRY(lg_detector_settle(self, error));
    LG_TRY(lg_windows_create(self->context, &s->all.data.series, run->model.net.length, (size_t)run->hop,
                             &s->all.windows, error));
    const bool same =
        strcmp(run->data_sha256, s->all.data.sha256) == 0 && run->windows == s->all.windows.count;
    LG_TRY(lg_window_part(self->context, &s->all, same && run->test_fraction > 0 ? run : NULL, LG_PART_TEST,
                          &s->tested, error));
    LG_TRY(judge_parts(self, &file->scaler, file->theta, error));
    LG_TRY(lg_judgement_check(&s->judged, error));
    LG_TELL(self, LG_WHOLE("windows", s->judged.count, NULL));
    lg_detector_tell(self, &s->judged, run->hop, file->names.rate, file->names.class_name);
    LG_TELL(self, LG_REAL("mse", s->judged.mse, NULL));
    return LG_OK;
}

const lg_trainer lg_detector_learner = {.data = "DATA.h5",
                                        .state_size = sizeof(lg_detector_state),
                                        .options = lg_detector_options,
                                        .method = "classifier",
                                        .held_out = "validation-fraction",
                                        .read = read_data,
                                        .describe = describe,
                                        .usual = usual,
                                        .prepare = lg_detector_split,
                                        .hold_out = hold_out,
                                        .problem = make_problem,
                                        .judge = judge,
                                        .save = save,
                                        .evaluate = evaluate,
                                        .release = release,
                                        .close = close_data};
