/* Makes and trains a network from the options. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

/* ---- the run ---- */

static bool any_given(const app *self, const char *const *options, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (app_given(self, options[i])) return true;
    return false;
}

/* The default blocks for given convolutions and pooling: three, or as many as leave a sample of the window.
 * The first block is always there, so that lg_cnn_init can refuse it. */
static void default_blocks(const app *self, lg_cnn *net) {
    enum { LONG = 4096 };
    const train_values *values = &train_given;
    lg_cnn full;
    lg_cnn_init_default(&full, net->channels, LONG, net->outputs, net->activation);
    const uint64_t padding = app_given(self, "padding") ? values->padding : 0;
    const bool pooling_given = app_given(self, "pooling") || app_given(self, "pool-size");
    uint64_t left = net->length;
    net->blocks = 0;
    while (net->blocks < full.blocks && (net->blocks == 0 || left > 1)) {
        const uint64_t padded = left + 2 * padding;
        lg_cnn_block block = full.block[net->blocks];
        if (padded < block.kernel) block.kernel = (uint32_t)padded;
        if (app_given(self, "kernel")) block.kernel = (uint32_t)values->kernel;
        if (app_given(self, "stride")) block.stride = (uint32_t)values->stride;
        if (app_given(self, "pooling")) block.pooling = (lg_pooling)values->pooling;
        if (app_given(self, "pool-size")) block.pool_size = block.pool_stride = (uint32_t)values->pool_size;
        block.padding = (uint32_t)padding;
        const uint64_t convolved = padded < block.kernel ? 0 : (padded - block.kernel) / block.stride + 1;
        if (convolved < block.pool_size && !pooling_given) block.pooling = LG_POOL_NONE;
        left = block.pooling == LG_POOL_NONE ? convolved : convolved / block.pool_size;
        if (left == 0 && net->blocks > 0) return;
        net->block[net->blocks++] = block;
    }
}

/* Sets blocks from the options; the others do not change. */
static void build_blocks(const app *self, bool fresh, lg_cnn *net) {
    static const char *const options[] = {"filters", "kernel", "stride", "padding", "pooling", "pool-size"};
    const train_values *values = &train_given;
    if (!any_given(self, options, LG_COUNT(options))) return;
    const bool filters = app_given(self, "filters");
    if (fresh && !filters) {
        default_blocks(self, net);
        return;
    }
    if (filters) net->blocks = (uint32_t)values->filters.count;
    for (uint32_t i = 0; i < net->blocks; i++) {
        lg_cnn_block *block = &net->block[i];
        if (filters) {
            *block = (lg_cnn_block){.channels = values->filters.values[i],
                                    .kernel = 5,
                                    .stride = 1,
                                    .pooling = LG_POOL_AVERAGE,
                                    .pool_size = 2,
                                    .pool_stride = 2};
        }
        if (app_given(self, "kernel")) block->kernel = (uint32_t)values->kernel;
        if (app_given(self, "stride")) block->stride = (uint32_t)values->stride;
        if (app_given(self, "padding")) block->padding = (uint32_t)values->padding;
        if (app_given(self, "pooling")) block->pooling = (lg_pooling)values->pooling;
        if (app_given(self, "pool-size")) block->pool_size = block->pool_stride = (uint32_t)values->pool_size;
    }
}

/* The model of options and data. The blocks of a stored model are not hyperparameters. */
static lg_status complete_model(const app *self, const lg_series *series, const lg_detector *stored,
                                lg_error *error) {
    lg_detector *model = &train_run.model;
    const lg_activation activation = model->net.activation;
    const uint32_t plane = model->net.plane;
    if (series->classes < 2)
        return app_error(error, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'",
                         series->class_name[0]);
    if (model->loss == LG_DETECTOR_MSE && series->classes != 2)
        return app_error(error, LG_INVALID_ARGUMENT,
                         "--loss mse is for two classes, but the data have %u: use cross-entropy",
                         series->classes);
    model->classes = series->classes;
    const uint32_t outputs = model->loss == LG_DETECTOR_MSE ? 1 : series->classes;
    if (stored != NULL)
        model->net = stored->net;
    else
        lg_cnn_init_default(&model->net, series->channels, (uint32_t)train_run.window, outputs, activation);
    model->net.activation = activation;
    model->net.plane = plane;
    model->net.outputs = outputs;
    build_blocks(self, stored == NULL, &model->net);
    const lg_status status = lg_cnn_init(&model->net, error);
    return status == LG_OK ? lg_detector_check(model, error) : status;
}

static lg_status adopt_preset(app *self, const lg_series_data *data, const lg_detector_preset **preset,
                              lg_error *error) {
    const char *name = lg_preset_name(train_given.preset);
    *preset = lg_detector_preset_find(name, data->noise);
    if (*preset == NULL) return app_error(error, LG_UNSUPPORTED, "--preset: %s has no settings", name);
    const lg_detector_run from = {
        .model = {.net.activation = (*preset)->activation,
                  .loss = data->series.classes == 2 ? (*preset)->loss : LG_DETECTOR_CROSS_ENTROPY},
        .training = (*preset)->training};
    app_adopt(self, train_settings, &from, true);
    const lg_fit_plan *plan = &train_run.training.plan;
    for (uint32_t i = 0; i < plan->phases && !app_given(self, "dtype"); i++)
        if (!lg_fit_method_batches((lg_fit_method)plan->phase[i].method))
            train_run.training.dtype = LG_F64; /* the others need it */
    return LG_OK;
}

lg_status network_run(app *self, const lg_series_data *data, const lg_detector_run *stored,
                      const lg_detector_preset **preset, lg_error *error) {
    lg_detector_run *run = &train_run;
    *preset = NULL;
    lg_status status = stored == NULL ? adopt_preset(self, data, preset, error) : LG_OK;
    if (status != LG_OK) return status;
    if (train_given.test != NULL) run->test_fraction = 0;
    /* Before the windows are cut they are taken to be as many as they were. */
    run->windows = stored != NULL ? stored->windows : 0;
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    status = window_of(self, &data->series, &run->window, &run->hop, error);
    if (status != LG_OK) return status;
    if (stored != NULL && !app_given(self, "window") && !app_given(self, "hop")) {
        run->window = stored->window;
        run->hop = stored->hop;
    }
    return complete_model(self, &data->series, stored != NULL ? &stored->model : NULL, error);
}

well_cut cut_of_run(const lg_detector_run *run) {
    well_cut out = {.split = run->split,
                    .test_fraction = run->test_fraction,
                    .validation_fraction = run->validation_fraction,
                    .seed = run->training.seed,
                    .windows = run->windows,
                    .window = run->window,
                    .hop = run->hop};
    memcpy(out.data_sha256, run->data_sha256, sizeof out.data_sha256);
    return out;
}

/* ---- the fit ---- */

static lg_status create_fit(const lg_context *context, const lg_fit_options *options, network *net,
                            lg_error *error) {
    const lg_detector_run *run = &train_run;
    lg_fit_options wanted = *options;
    wanted.keep_best = net->fit_problem.validation > 0;
    double *theta = app_try_alloc(net->fit_problem.parameters, sizeof *theta);
    if (theta == NULL)
        return app_error(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters",
                         net->fit_problem.parameters);
    wanted.restarts = run->restarts;
    lg_detector_initialise(&run->model, run->training.seed, 0, theta);
    const lg_status status = lg_fit_create(context, &net->fit_problem, &wanted, theta, &net->fit, error);
    free(theta);
    return status;
}

lg_status network_create(const lg_context *context, const lg_series *series, const lg_windows *windows,
                         const part_indices *train, const part_indices *validation,
                         const lg_fit_options *options, network *out, lg_error *error) {
    const lg_detector_run *run = &train_run;
    *out = (network){.fit = NULL};
    const size_t count = train->count + validation->count;
    uint32_t *chosen = app_alloc(count, sizeof *chosen);
    memcpy(chosen, train->list, train->count * sizeof *chosen);
    memcpy(chosen + train->count, validation->list, validation->count * sizeof *chosen);
    lg_status status =
        lg_scaler_fit(context, series, windows, train->list, train->count, run->model.centred, &out->scaler);
    if (status != LG_OK) (void)app_error(error, status, "scaling: %s", lg_status_sentence(status));
    if (status == LG_OK)
        status = lg_detector_data_create(context, &run->model, &out->scaler, series, windows, chosen, count,
                                         run->training.dtype, &out->data, error);
    free(chosen);
    if (status == LG_OK) {
        out->problem = (lg_detector_problem){&run->model, &out->data, train->count, run->training.seed};
        lg_detector_fit_problem(&out->problem, &out->fit_problem);
        status = create_fit(context, options, out, error);
    }
    if (status != LG_OK) network_destroy(out);
    return status;
}

void network_destroy(network *net) {
    lg_fit_destroy(net->fit);
    lg_detector_data_destroy(&net->data);
    lg_scaler_destroy(&net->scaler);
    *net = (network){.fit = NULL};
}

lg_detector_file network_file(const network *net, const lg_series *series) {
    lg_detector_file file = {.run = train_run,
                             .parameters = net->fit_problem.parameters,
                             .scaler = net->scaler,
                             .class_name = series->class_name,
                             .class_label = series->class_label,
                             .channel_name = series->channel_name,
                             .rate = series->rate,
                             .accuracy = NAN,
                             .f1 = NAN,
                             .test_mse = NAN};
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    lg_fit_parameters(net->fit, file.theta);
    return file;
}
