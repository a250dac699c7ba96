/* From the options to a trained network. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

enum { STREAM_WEIGHTS = 1 };

static const char *const presets[] = {"thesis", "best"};

/* ---- the run ---- */

static bool any_given(const app *self, const char *const *options, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (app_given(self, options[i])) return true;
    return false;
}

/* The default blocks where convolutions and pooling are given: three, or as many as are left something of the
 * window. The first is there in any case, for lg_cnn_init to refuse. */
static void default_blocks(const app *self, const train_values *values, lg_cnn *net) {
    enum { LONG = 4096 };
    const lg_cnn full = lg_cnn_defaults(net->channels, LONG, net->outputs, net->activation);
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

/* Blocks as the options say, the rest as they are. */
static void build_blocks(const app *self, const train_values *values, bool fresh, lg_cnn *net) {
    static const char *const options[] = {"filters", "kernel", "stride", "padding", "pooling", "pool-size"};
    if (app_given(self, "plane")) net->plane = (uint32_t)values->plane;
    if (!any_given(self, options, APP_COUNT(options))) return;
    const bool filters = app_given(self, "filters");
    if (fresh && !filters) {
        default_blocks(self, values, net);
        return;
    }
    if (filters)
        net->blocks =
            (uint32_t)(values->filters.count < LG_CNN_MAX_BLOCKS ? values->filters.count : LG_CNN_MAX_BLOCKS);
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

static lg_status model_of(const app *self, const train_values *values, const lg_series *series,
                          uint32_t length, const lg_detector *stored, const lg_detector_preset *preset,
                          lg_detector *out, lg_error *error) {
    lg_activation activation = stored != NULL ? stored->net.activation : preset->activation;
    *out = (lg_detector){.classes = series->classes};
    out->loss = stored != NULL         ? stored->loss
                : series->classes == 2 ? preset->loss
                                       : LG_DETECTOR_CROSS_ENTROPY;
    out->centred = stored != NULL && stored->centred;
    if (app_given(self, "loss")) out->loss = (lg_detector_loss)values->loss;
    if (app_given(self, "centred")) out->centred = values->centred == 1;
    if (app_given(self, "activation"))
        (void)lg_activation_parse(fit_activations[values->activation], &activation);
    if (series->classes < 2)
        return app_error(error, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'",
                         series->class_name[0]);
    if (out->loss == LG_DETECTOR_MSE && series->classes != 2)
        return app_error(error, LG_INVALID_ARGUMENT,
                         "--loss mse: is for two classes, the data have %u: take cross-entropy",
                         series->classes);
    const uint32_t outputs = out->loss == LG_DETECTOR_MSE ? 1 : series->classes;
    out->net = stored != NULL ? stored->net : lg_cnn_defaults(series->channels, length, outputs, activation);
    out->net.activation = activation;
    out->net.outputs = outputs;
    if (values->filters.count > LG_CNN_MAX_BLOCKS && app_given(self, "filters"))
        return app_error(error, LG_INVALID_ARGUMENT, "--filters: %zu blocks are more than %d",
                         values->filters.count, LG_CNN_MAX_BLOCKS);
    build_blocks(self, values, stored == NULL, &out->net);
    const lg_status status = lg_cnn_init(&out->net, error);
    return status == LG_OK ? lg_detector_check(out, error) : status;
}

/* What was not given becomes the stored run's. */
static void adopt(app *self, train_values *values, const lg_detector_run *stored) {
    const double validation = values->fit.validation;
    fit_adopt(self, &values->fit, &stored->training, true);
    values->fit.validation = app_given(self, "validation") ? validation : stored->validation_fraction;
    if (!app_given(self, "split")) values->split = (int)stored->split;
    if (!app_given(self, "test-fraction")) values->test_fraction = stored->test_fraction;
}

lg_status network_run(app *self, train_values *values, const lg_series_data *data,
                      const lg_detector_run *stored, lg_detector_run *run, const lg_detector_preset **preset,
                      lg_error *error) {
    const double validation = values->fit.validation;
    *preset = NULL;
    if (stored != NULL) {
        adopt(self, values, stored);
    } else {
        *preset = lg_detector_preset_find(presets[values->preset], data->noise);
        if (*preset == NULL)
            return app_error(error, LG_UNSUPPORTED, "--preset: %s has no settings", presets[values->preset]);
        fit_adopt(self, &values->fit, &(*preset)->training, false);
        values->fit.validation = validation;
    }
    *run = (lg_detector_run){.training = fit_training(&values->fit, self->seed),
                             .split = (lg_split)values->split,
                             .test_fraction = values->test != NULL ? 0 : values->test_fraction,
                             .validation_fraction = values->fit.validation};
    run->training.validation = 0; /* the part is ours to draw: runs and groups stay whole */
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    lg_status status = window_of(self, values, &data->series, &run->window, &run->hop, error);
    if (status != LG_OK) return status;
    if (stored != NULL && !app_given(self, "window") && !app_given(self, "hop")) {
        run->window = stored->window;
        run->hop = stored->hop;
    }
    return model_of(self, values, &data->series, (uint32_t)run->window,
                    stored != NULL ? &stored->model : NULL, *preset, &run->model, error);
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
    const lg_detector_run *run = &net->run;
    lg_fit_options wanted = *options;
    wanted.keep_best = net->fit_problem.validation > 0;
    double *theta = app_try_alloc(net->fit_problem.parameters, sizeof *theta);
    if (theta == NULL)
        return app_error(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters",
                         net->fit_problem.parameters);
    lg_rng rng;
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_cnn_initialise(&run->model.net, LG_INIT_FAN_IN, &rng, theta);
    const lg_status status = lg_fit_create(context, &net->fit_problem, &wanted, theta, &net->fit, error);
    free(theta);
    return status;
}

lg_status network_create(const lg_context *context, const lg_detector_run *run, const lg_series *series,
                         const lg_windows *windows, const part_indices *train, const part_indices *validation,
                         const lg_fit_options *options, network *out, lg_error *error) {
    *out = (network){.run = *run};
    const size_t count = train->count + validation->count;
    uint32_t *chosen = app_alloc(count, sizeof *chosen);
    memcpy(chosen, train->list, train->count * sizeof *chosen);
    memcpy(chosen + train->count, validation->list, validation->count * sizeof *chosen);
    lg_status status =
        lg_scaler_fit(context, series, windows, train->list, train->count, run->model.centred, &out->scaler);
    if (status != LG_OK) (void)app_error(error, status, "scaling: %s", lg_status_sentence(status));
    if (status == LG_OK)
        status = lg_detector_data_create(context, &out->run.model, &out->scaler, series, windows, chosen,
                                         count, run->training.dtype, &out->data, error);
    free(chosen);
    if (status == LG_OK) {
        out->problem = (lg_detector_problem){&out->run.model, &out->data, train->count};
        lg_detector_fit_problem(&out->problem, &out->fit_problem);
        status = create_fit(context, options, out, error);
    }
    if (status != LG_OK) network_destroy(context, out);
    return status;
}

void network_destroy(const lg_context *context, network *net) {
    lg_fit_destroy(net->fit);
    lg_detector_data_destroy(context, &net->data);
    lg_scaler_destroy(context, &net->scaler);
    net->fit = NULL;
}

lg_detector_file network_file(const network *net, const lg_series *series) {
    lg_detector_file file = {.run = net->run,
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
