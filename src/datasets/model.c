/* Learned Hamiltonians and the checkpoints of their training. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "datasets/run.h"

/* ---- the flat parameter vector as named arrays ---- */

typedef struct slice {
    char name[64];
    uint32_t rank;
    uint64_t dims[2];
    size_t offset, count;
} slice;

static void set_slice(slice *s, size_t offset, uint32_t rank, uint64_t rows, uint64_t columns) {
    s->rank = rank;
    s->dims[0] = rows, s->dims[1] = columns;
    s->offset = offset;
    s->count = (size_t)(rows * (rank == 2 ? columns : 1));
}

/* Slice number `index`; false beyond the last. Order: weights and biases of the potential, then the kinetic
 * part. */
static bool slice_at(const lg_hamiltonian *model, uint32_t index, slice *s) {
    const lg_mlp *net = &model->net;
    uint64_t k = model->links;
    for (uint32_t layer = 0; layer < net->layers; layer++) {
        if (index-- == 0) {
            set_slice(s, lg_mlp_weight_offset(net, layer), 2, net->width[layer], net->width[layer + 1]);
            (void)snprintf(s->name, sizeof s->name, "model/potential/layer%u/weight", layer + 1);
            return true;
        }
        if (!lg_mlp_has_bias(net, layer)) continue;
        if (index-- == 0) {
            set_slice(s, lg_mlp_bias_offset(net, layer), 1, net->width[layer + 1], 0);
            (void)snprintf(s->name, sizeof s->name, "model/potential/layer%u/bias", layer + 1);
            return true;
        }
    }
    bool chain = model->family == LG_HAMILTONIAN_CHAIN;
    size_t kinetic = lg_mlp_parameters(net);
    if (index == 0) {
        set_slice(s, kinetic, 2, k, k);
        (void)snprintf(s->name, sizeof s->name, "%s", chain ? "model/mass/gamma" : "model/kinetic/A");
        return true;
    }
    if (index > 1 || !chain) return false;
    set_slice(s, kinetic + (size_t)(k * k), 1, k, 0);
    (void)snprintf(s->name, sizeof s->name, "model/mass/b");
    return true;
}

/* ---- saving ---- */

static lg_status put_slice(lg_h5 *h5, const slice *s, lg_dtype dtype, const double *theta, lg_error *error) {
    if (dtype == LG_F64)
        return lg_h5_put(h5, s->name, LG_ELEMENT_F64, s->rank, s->dims, theta + s->offset, error);
    float *narrow = lg_alloc(h5->context, s->count, sizeof *narrow);
    if (narrow == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(h5->path));
    for (size_t i = 0; i < s->count; i++) narrow[i] = (float)theta[s->offset + i];
    lg_status status = lg_h5_put(h5, s->name, LG_ELEMENT_F32, s->rank, s->dims, narrow, error);
    lg_free(h5->context, narrow);
    return status;
}

static const char *const series_names[LG_FIT_SERIES_COUNT] = {
    [LG_FIT_LOSS] = "train/history/loss",
    [LG_FIT_VALIDATION] = "train/history/validation",
    [LG_FIT_SECONDS] = "train/history/seconds",
    [LG_FIT_RATE] = "train/history/rate",
};

static lg_status put_training(lg_h5 *h5, const lg_hamiltonian_file *file, lg_error *error) {
    uint64_t parameters = file->parameters, epochs = file->epochs_done, words = 4;
    if (file->adam_m != NULL && file->adam_v != NULL) {
        LG_TRY(lg_h5_put(h5, "optimizer/adam/m", LG_ELEMENT_F64, 1, &parameters, file->adam_m, error));
        LG_TRY(lg_h5_put(h5, "optimizer/adam/v", LG_ELEMENT_F64, 1, &parameters, file->adam_v, error));
        LG_TRY(lg_h5_put(h5, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, &file->adam_step, error));
    }
    if (file->has_rng) LG_TRY(lg_h5_put(h5, "rng", LG_ELEMENT_U64, 1, &words, file->rng.s, error));
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++)
        if (file->history[i] != NULL)
            LG_TRY(lg_h5_put(h5, series_names[i], LG_ELEMENT_F64, 1, &epochs, file->history[i], error));
    return LG_OK;
}

/* The archive that lg_fit_save writes through: the root of the file. */
typedef struct fit_target {
    lg_h5 *h5;
    lg_error error;
} fit_target;

static lg_status fit_array(void *user, const char *path, lg_element type, uint32_t rank, const uint64_t *dims,
                           const void *data) {
    fit_target *target = user;
    return lg_h5_put(target->h5, path, type, rank, dims, data, &target->error);
}

static lg_status fit_text(void *user, const char *path, const char *value) {
    fit_target *target = user;
    return lg_h5_put_text(target->h5, "train", path, value, &target->error);
}

static lg_status put_model(lg_h5 *h5, const lg_hamiltonian_file *file, const lg_fit *fit, lg_error *error) {
    slice s;
    LG_TRY(lg_h5_put_header(h5, "hamiltonian", &file->provenance, error));
    LG_TRY(lg_run_put(h5, &file->run, error));
    for (uint32_t i = 0; slice_at(&file->run.model, i, &s); i++)
        LG_TRY(put_slice(h5, &s, file->run.dtype, file->theta, error));
    if (file->has_e1) LG_TRY(lg_h5_put_number(h5, "", "E1", LG_ELEMENT_F64, &file->e1, error));
    if (file->has_e2) LG_TRY(lg_h5_put_number(h5, "", "E2", LG_ELEMENT_F64, &file->e2, error));
    if (fit == NULL) return put_training(h5, file, error);
    fit_target target = {.h5 = h5};
    lg_archive_writer writer = {.user = &target, .array = fit_array, .text = fit_text};
    return lg_fit_save(fit, &writer, error);
}

lg_status lg_model_save_hamiltonian(const lg_context *context, const char *path,
                                    const lg_hamiltonian_file *file, const lg_fit *fit, lg_error *error) {
    if (path == NULL || file == NULL || file->theta == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name and parameters");
    LG_TRY(lg_run_check(path, &file->run, error));
    if (file->parameters != lg_hamiltonian_parameters(&file->run.model))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %zu parameters, the model has %zu",
                       lg_shown_path(path), file->parameters, lg_hamiltonian_parameters(&file->run.model));
    slice s;
    for (uint32_t i = 0; slice_at(&file->run.model, i, &s); i++)
        LG_TRY(lg_check_finite(path, s.name, s.rank, s.dims, file->theta + s.offset, error));
    lg_h5 *h5;
    LG_TRY(lg_h5_create(context, path, &h5, error));
    lg_status status = put_model(h5, file, fit, error);
    if (status == LG_OK) status = lg_h5_commit(h5, error);
    lg_h5_close(h5);
    return status;
}

/* ---- loading ---- */

typedef struct load_call {
    const lg_context *context;
    const char *path;
    const lg_read_options *options;
    lg_hamiltonian_file *out;
} load_call;

static lg_status as_format(lg_status status, lg_error *error) {
    if (status != LG_NOT_FOUND && status != LG_SHAPE) return status;
    if (error != NULL) error->status = LG_FORMAT;
    return LG_FORMAT;
}

static lg_status no_memory(const lg_h5 *h5, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(h5->path));
}

/* Shapes are compared before anything of the size that the attributes claim is allocated. */
static lg_status check_slices(lg_h5 *h5, const lg_hamiltonian *model, lg_error *error) {
    slice s;
    for (uint32_t i = 0; slice_at(model, i, &s); i++) {
        uint32_t rank;
        uint64_t dims[4];
        LG_TRY(as_format(lg_h5_shape(h5, s.name, &rank, dims, NULL, error), error));
        if (rank != s.rank || dims[0] != s.dims[0] || (rank == 2 && dims[1] != s.dims[1]))
            return lg_fail(error, LG_FORMAT, "%s: /%s: has the wrong shape for the attributes of /model",
                           lg_shown_path(h5->path), s.name);
    }
    return LG_OK;
}

static lg_status get_weights(lg_h5 *h5, lg_hamiltonian_file *out, lg_error *error) {
    slice s;
    LG_TRY(check_slices(h5, &out->run.model, error));
    out->parameters = lg_hamiltonian_parameters(&out->run.model);
    out->theta = lg_alloc(h5->context, out->parameters, sizeof *out->theta);
    if (out->theta == NULL) return no_memory(h5, error);
    for (uint32_t i = 0; slice_at(&out->run.model, i, &s); i++) {
        double *at = out->theta + s.offset;
        LG_TRY(as_format(lg_h5_get(h5, s.name, LG_ELEMENT_F64, s.rank, s.dims, at, error), error));
        LG_TRY(lg_check_finite(h5->path, s.name, s.rank, s.dims, at, error));
    }
    return LG_OK;
}

static lg_status get_moment(lg_h5 *h5, const char *name, size_t parameters, double **out, lg_error *error) {
    uint64_t dims[4];
    LG_TRY(as_format(lg_h5_get_doubles(h5, name, 1, dims, out, error), error));
    if (dims[0] == parameters) return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: /%s: has %llu values for %zu parameters", lg_shown_path(h5->path),
                   name, (unsigned long long)dims[0], parameters);
}

static lg_status get_optimizer(lg_h5 *h5, lg_hamiltonian_file *out, lg_error *error) {
    uint64_t words = 4;
    if (lg_h5_has(h5, "optimizer/adam")) {
        LG_TRY(get_moment(h5, "optimizer/adam/m", out->parameters, &out->adam_m, error));
        LG_TRY(get_moment(h5, "optimizer/adam/v", out->parameters, &out->adam_v, error));
        LG_TRY(as_format(
            lg_h5_get(h5, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, &out->adam_step, error), error));
        for (size_t i = 0; i < out->parameters; i++)
            if (out->adam_v[i] < 0)
                return lg_fail(error, LG_FORMAT, "%s: /optimizer/adam/v: is negative at index (%zu)",
                               lg_shown_path(h5->path), i);
    }
    out->has_rng = lg_h5_has(h5, "rng");
    if (out->has_rng)
        LG_TRY(as_format(lg_h5_get(h5, "rng", LG_ELEMENT_U64, 1, &words, out->rng.s, error), error));
    return LG_OK;
}

/* The validation series of a run without validation part is NaN: history is not checked for finiteness. */
static lg_status get_history(lg_h5 *h5, lg_hamiltonian_file *out, lg_error *error) {
    bool first = true;
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++) {
        uint32_t rank;
        uint64_t dims[4];
        if (!lg_h5_has(h5, series_names[i])) continue;
        LG_TRY(lg_h5_shape(h5, series_names[i], &rank, dims, NULL, error));
        if (rank != 1 || (!first && dims[0] != out->epochs_done))
            return lg_fail(error, LG_FORMAT, "%s: /%s: expected one number an epoch", lg_shown_path(h5->path),
                           series_names[i]);
        first = false;
        out->epochs_done = (size_t)dims[0];
        out->history[i] = lg_alloc(h5->context, out->epochs_done, sizeof(double));
        if (out->history[i] == NULL) return no_memory(h5, error);
        LG_TRY(as_format(lg_h5_get(h5, series_names[i], LG_ELEMENT_F64, 1, dims, out->history[i], error),
                         error));
    }
    return LG_OK;
}

static lg_status get_error(lg_h5 *h5, const char *name, bool *has, double *value, lg_error *error) {
    *has = lg_h5_has_attribute(h5, "", name);
    if (!*has) return LG_OK;
    LG_TRY(lg_h5_number(h5, "", name, LG_ELEMENT_F64, value, error));
    if (isfinite(*value)) return LG_OK;
    return lg_fail(error, LG_NOT_FINITE, "%s: attribute %s is not finite", lg_shown_path(h5->path), name);
}

static lg_status get_model(lg_h5 *h5, lg_hamiltonian_file *out, lg_error *error) {
    LG_TRY(lg_h5_check_format(h5, "hamiltonian", false, error));
    LG_TRY(lg_run_get(h5, false, &out->run, error));
    LG_TRY(get_weights(h5, out, error));
    LG_TRY(get_optimizer(h5, out, error));
    LG_TRY(get_history(h5, out, error));
    LG_TRY(get_error(h5, "E1", &out->has_e1, &out->e1, error));
    LG_TRY(get_error(h5, "E2", &out->has_e2, &out->e2, error));
    lg_h5_provenance(h5, &out->provenance);
    return LG_OK;
}

void lg_hamiltonian_file_free(const lg_context *context, lg_hamiltonian_file *file) {
    if (file == NULL) return;
    lg_free(context, file->theta);
    lg_free(context, file->adam_m);
    lg_free(context, file->adam_v);
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++) lg_free(context, file->history[i]);
    *file = (lg_hamiltonian_file){0};
}

static lg_status load_file(void *user, lg_error *error) {
    load_call *call = user;
    lg_h5 *h5;
    LG_TRY(lg_h5_open(call->context, call->path, call->options, &h5, error));
    lg_status status = get_model(h5, call->out, error);
    lg_h5_close(h5);
    return status;
}

lg_status lg_model_load_hamiltonian(const lg_context *context, const char *path,
                                    const lg_read_options *options, lg_hamiltonian_file *out,
                                    lg_error *error) {
    if (path == NULL || out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name");
    lg_hamiltonian_file made = {.parameters = 0};
    load_call call = {context, path, options, &made};
    LG_TRY(lg_probe(path, options, load_file, &call, error));
    lg_status status = load_file(&call, error);
    if (status == LG_OK)
        *out = made;
    else
        lg_hamiltonian_file_free(context, &made);
    return status;
}

/* ---- checkpoints ---- */

lg_status lg_checkpoint_create(const lg_context *context, const char *path, const lg_hamiltonian_run *run,
                               const lg_provenance *provenance, lg_file_writer **out, lg_error *error) {
    if (path == NULL || run == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a checkpoint needs a name and a run");
    lg_file_writer *writer;
    LG_TRY(lg_run_check(path, run, error));
    LG_TRY(lg_file_writer_create(context, path, "checkpoint", provenance, &writer, error));
    lg_status status = lg_run_put(lg_file_writer_h5(writer), run, error);
    if (status == LG_OK)
        *out = writer;
    else
        lg_file_writer_destroy(writer);
    return status;
}

lg_status lg_checkpoint_open(const lg_context *context, const char *path, const lg_read_options *options,
                             lg_hamiltonian_run *run, lg_file_reader **out, lg_error *error) {
    if (run == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a checkpoint is read into a run and a reader");
    lg_file_reader *reader;
    lg_hamiltonian_run got;
    LG_TRY(lg_file_reader_open(context, path, "checkpoint", options, &reader, error));
    lg_status status = lg_run_get(lg_file_reader_h5(reader), true, &got, error);
    if (status != LG_OK) {
        lg_file_reader_close(reader);
        return status;
    }
    *run = got;
    *out = reader;
    return LG_OK;
}
