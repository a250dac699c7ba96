/* Saves and loads models and checkpoints of any kind. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model/files/program_file.h"
#include "model/files/recipe.h"

static const void *run_of(const lg_recipe *kind, const void *file) {
    return (const char *)file + kind->file_run;
}

/* A slice of the parameters, and its path in the file. */
typedef struct slice {
    lg_slice_info info;
    char name[64];
} slice;

static bool slice_at(const lg_recipe *kind, const void *run, uint32_t index, slice *s) {
    if (kind->slice == NULL || !kind->slice(run, index, &s->info)) return false;
    (void)snprintf(s->name, sizeof s->name, "model/%s", s->info.name);
    return true;
}

static const char *const series_names[LG_FIT_SERIES_COUNT] = {
    [LG_FIT_LOSS] = "train/history/loss",
    [LG_FIT_VALIDATION] = "train/history/validation",
    [LG_FIT_SECONDS] = "train/history/seconds",
    [LG_FIT_RATE] = "train/history/rate",
};

/* ---- saving ---- */

static lg_status put_slice(lg_h5 *h5, const slice *s, lg_dtype dtype, const double *theta, lg_error *error) {
    const lg_slice_info *info = &s->info;
    if (dtype == LG_F64)
        return lg_h5_put(h5, s->name, LG_ELEMENT_F64, info->rank, info->dims, theta + info->offset, error);
    LG_TRY_SCRATCH(float, narrow, h5->context, info->count, lg_h5_no_memory(h5, error));
    for (size_t i = 0; i < info->count; i++) narrow[i] = (float)theta[info->offset + i];
    return lg_h5_put(h5, s->name, LG_ELEMENT_F32, info->rank, info->dims, narrow, error);
}

/* ---- functions ---- */

/* The scheme for models whose own scheme cannot be part of a program, because it is implicit. */
static const char explicit_scheme[] = "cf4";

/* Finds the slice that begins at `offset` in theta. */
static bool slice_from(const lg_recipe *recipe, const void *run, size_t offset, slice *s) {
    for (uint32_t i = 0; slice_at(recipe, run, i, s); i++)
        if (s->info.offset == offset && s->info.count > 0) return true;
    return false;
}

/* Writes theta as a list of places: the slices in the order of their offsets, which leave no gaps. */
static lg_status put_parameters(lg_h5 *h5, const lg_recipe *recipe, const void *run,
                                const lg_program *program, lg_error *error) {
    enum { MOST = LG_PROGRAM_MOST_NAMES };
    lg_program_source places[MOST];
    LG_TRY_SCRATCH(lg_program_key, names, h5->context, MOST, lg_h5_no_memory(h5, error));
    slice s;
    const size_t parameters = lg_recipe_parameters(recipe, run);
    size_t count = 0, at = 0;
    for (; count < MOST && slice_from(recipe, run, at, &s); at += s.info.count) {
        (void)snprintf(names[count].text, sizeof names[count].text, "%s", s.name);
        places[count] = (lg_program_source){"theta", names[count].text};
        count++;
    }
    for (const lg_program_source *p = recipe->places; p != NULL && p->parameter != NULL && count < MOST; p++)
        places[count++] = *p;
    if (at == parameters) return lg_program_put_parameters(h5, program, places, count, error);
    return lg_fail(error, LG_UNSUPPORTED, "%s: the model has more than %d arrays of weights",
                   lg_shown_path(h5->path), MOST);
}

static lg_status put_functions(lg_h5 *h5, const lg_recipe *recipe, const void *file, lg_error *error) {
    const lg_scheme *scheme = recipe->scheme != NULL ? recipe->scheme(file) : NULL;
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    if (recipe->program == NULL) return lg_program_put_version(h5, error);
    lg_status status = recipe->program(h5->context, file, scheme, &program, error);
    if (status == LG_UNSUPPORTED && scheme != NULL) {
        scheme = lg_scheme_find(explicit_scheme);
        status = recipe->program(h5->context, file, scheme, &program, error);
    }
    LG_TRY(status);
    LG_TRY(put_parameters(h5, recipe, run_of(recipe, file), program, error));
    LG_TRY(lg_program_put_functions(h5, program, error));
    return scheme != NULL ? lg_h5_put_text(h5, "functions", "scheme", scheme->name, error) : LG_OK;
}

/* A minimiser's state is far larger than the model: only checkpoints keep it; model files keep the history of
 * the fit, or without a fit that of the file. */
static lg_status put_training(lg_h5 *h5, const lg_model_head *head, const lg_fit *fit, lg_error *error) {
    lg_h5_view view = {.h5 = h5, .failure = &(lg_error){LG_OK, ""}};
    const lg_archive_writer writer = lg_h5_view_writer(&view);
    if (fit != NULL && lg_fit_method_batches(lg_fit_method_now(fit))) return lg_fit_save(fit, &writer, error);
    const uint64_t epochs = fit != NULL ? lg_fit_epochs_done(fit) : head->epochs_done;
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) {
        const double *series = fit != NULL ? lg_fit_history(fit, (lg_fit_series)i) : head->history[i];
        if (series != NULL && (fit == NULL || epochs > 0))
            LG_TRY(lg_h5_put(h5, series_names[i], LG_ELEMENT_F64, 1, &epochs, series, error));
    }
    return LG_OK;
}

static lg_status put_model(lg_h5 *h5, const lg_recipe *kind, const void *file, const lg_fit *fit,
                           lg_error *error) {
    slice s;
    const lg_model_head *head = file;
    const void *run = run_of(kind, file);
    const lg_fit_settings *training = (const void *)((const char *)run + kind->training);
    lg_space space;
    LG_TRY(lg_h5_put_header(h5, kind->name, &head->provenance, error));
    LG_TRY(lg_run_put(h5, kind, run, error));
    if (kind->space != NULL) {
        LG_TRY(kind->space(run, &space));
        LG_TRY(lg_program_put_space(h5, &space, error));
    }
    for (uint32_t i = 0; slice_at(kind, run, i, &s); i++)
        LG_TRY(put_slice(h5, &s, training->dtype, head->theta, error));
    if (kind->put_rest != NULL) LG_TRY(kind->put_rest(h5, file, error));
    LG_TRY(lg_items_put(h5, kind, file, error));
    LG_TRY(put_functions(h5, kind, file, error));
    return put_training(h5, head, fit, error);
}

static lg_status check_saved(const char *path, const lg_recipe *kind, const void *file, lg_error *error) {
    slice s;
    const lg_model_head *head = file;
    const void *run = run_of(kind, file);
    if (head->theta == NULL && kind->slice != NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the file's name, the model or its parameters are NULL");
    LG_TRY(lg_run_check(path, kind, run, error));
    if (head->parameters != lg_recipe_parameters(kind, run))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %zu parameters are given, but the model has %zu",
                       lg_shown_path(path), head->parameters, lg_recipe_parameters(kind, run));
    for (uint32_t i = 0; slice_at(kind, run, i, &s); i++)
        LG_TRY(lg_check_finite(path, s.name, s.info.rank, s.info.dims, head->theta + s.info.offset, error));
    return LG_OK;
}

lg_status lg_recipe_save(const lg_context *context, const char *path, const lg_recipe *kind, const void *file,
                         const lg_fit *fit, lg_error *error) {
    LG_NEEDS(error, path, kind, file);
    LG_TRY(check_saved(path, kind, file, error));
    lg_h5 *h5;
    LG_TRY(lg_h5_create(context, path, &h5, error));
    return lg_h5_finish(h5, put_model(h5, kind, file, fit, error), error);
}

/* ---- loading ---- */

/* Shapes are compared before any array is allocated whose size comes from attributes. */
static lg_status get_weights(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_model_head *head,
                             lg_error *error) {
    slice s;
    for (uint32_t i = 0; slice_at(kind, run, i, &s); i++) {
        lg_h5_about about;
        LG_TRY(lg_as_format(lg_h5_look(h5, s.name, sizeof(double), &about, error), error));
        bool same = about.rank == s.info.rank;
        for (uint32_t d = 0; d < about.rank && same; d++) same = about.dims[d] == s.info.dims[d];
        if (!same)
            return lg_h5_fail(h5, error, "/%s: has the wrong shape for the attributes of /model", s.name);
    }
    head->parameters = lg_recipe_parameters(kind, run);
    head->theta = lg_alloc(h5->context, head->parameters, sizeof *head->theta);
    if (head->theta == NULL) return lg_h5_no_memory(h5, error);
    for (uint32_t i = 0; slice_at(kind, run, i, &s); i++) {
        double *at = head->theta + s.info.offset;
        LG_TRY(lg_h5_get_finite(h5, s.name, s.info.rank, s.info.dims, at, error));
    }
    return LG_OK;
}

/* The history may hold NaN: the validation series is NaN if there is no validation part. */
static lg_status get_history(lg_h5 *h5, lg_model_head *head, lg_error *error) {
    lg_h5_size epochs = {0, "epochs", NULL};
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++) {
        lg_h5_about about;
        const lg_h5_array series = {series_names[i], &head->history[i], {&epochs}, true};
        if (!lg_h5_has(h5, series.name)) continue;
        LG_TRY(lg_h5_fit(h5, &series, sizeof(double), false, &about, error));
        head->history[i] = lg_alloc(h5->context, about.count, sizeof(double));
        if (head->history[i] == NULL) return lg_h5_no_memory(h5, error);
        LG_TRY(lg_h5_get(h5, series.name, LG_ELEMENT_F64, about.rank, about.dims, head->history[i], error));
    }
    head->epochs_done = (size_t)epochs.n;
    return LG_OK;
}

/* The attribute is for readers that do not know the kind; models that were written by hand may lack it. */
static lg_status check_space(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error) {
    lg_space space, found;
    lg_error reason = {LG_OK, ""};
    char text[LG_SPACE_TEXT], expected[LG_SPACE_TEXT];
    if (kind->space == NULL || !lg_h5_has_attribute(h5, "model", "space")) return LG_OK;
    LG_TRY(kind->space(run, &space));
    lg_space_text(&space, expected);
    LG_TRY(lg_as_format(lg_h5_text(h5, "model", "space", text, sizeof text, error), error));
    if (lg_space_read(lg_tamed(text), &found, &reason) == LG_OK) {
        if (strcmp(text, expected) == 0) return LG_OK;
        (void)lg_fail(&reason, LG_FORMAT, "is '%s'", text);
    }
    return lg_h5_fail(h5, error,
                      "/model: attribute space: %s, but the other attributes describe a model on %s: "
                      "correct one of them, or remove the attribute space",
                      reason.message, expected);
}

lg_status lg_run_get_file(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error) {
    lg_model_head *head = file;
    void *run = (char *)file + kind->file_run;
    LG_TRY(lg_h5_check_format(h5, kind->name, false, error));
    LG_TRY(lg_program_check_version(h5, error));
    LG_TRY(lg_run_get(h5, kind, false, run, error));
    LG_TRY(get_weights(h5, kind, run, head, error));
    LG_TRY(check_space(h5, kind, run, error));
    LG_TRY(get_history(h5, head, error));
    if (kind->get_rest != NULL) LG_TRY(kind->get_rest(h5, file, error));
    LG_TRY(lg_items_get(h5, kind, file, error));
    lg_h5_provenance(h5, &head->provenance);
    return LG_OK;
}

typedef struct load_call {
    const lg_recipe *kind;
    void *file;
} load_call;

static lg_status load_file(void *user, lg_h5 *h5, lg_error *error) {
    const load_call *call = user;
    return lg_run_get_file(h5, call->kind, call->file, error);
}

lg_status lg_recipe_load(const lg_context *context, const char *path, const lg_read_options *options,
                         const lg_recipe *kind, void *file, lg_error *error) {
    LG_NEEDS(error, path, kind, file);
    load_call call = {kind, file};
    memset(file, 0, kind->file_size);
    ((lg_model_head *)file)->context = context;
    const lg_status status = lg_h5_read(context, path, options, load_file, &call, error);
    if (status != LG_OK) lg_recipe_release(kind, file);
    return status;
}

/* ---- editing ---- */

typedef struct edit_call {
    const lg_context *context;
    const char *path;
    lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error);
    void *user;
    bool commit;
} edit_call;

static lg_status edit_file(void *user, lg_error *error) {
    const edit_call *call = user;
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    LG_TRY(lg_h5_edit(call->context, call->path, &h5, error));
    LG_TRY(call->edit(call->user, h5, error));
    return call->commit ? lg_h5_commit(h5, error) : LG_OK;
}

lg_status lg_run_edit(const lg_context *context, const char *path,
                      lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error), void *user,
                      lg_error *error) {
    edit_call call = {context, path, edit, user, false};
    LG_TRY(lg_probe(context, path, NULL, edit_file, &call, error));
    call.commit = true;
    return edit_file(&call, error);
}

void lg_recipe_release(const lg_recipe *kind, void *file) {
    if (kind == NULL || file == NULL) return;
    const lg_model_head head = *(const lg_model_head *)file;
    if (kind->release != NULL) kind->release(file);
    lg_items_release(head.context, kind, file);
    lg_free(head.context, head.theta);
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++) lg_free(head.context, head.history[i]);
    memset(file, 0, kind->file_size);
}

/* ---- checkpoints ---- */

lg_status lg_checkpoint_create(const lg_context *context, const char *path, const lg_recipe *kind,
                               const void *run, const lg_provenance *provenance, lg_file_writer **out,
                               lg_error *error) {
    LG_NEEDS(error, path, kind, run, out);
    LG_CLEAN(lg_file_writer_destroy_at) lg_file_writer *writer = NULL;
    LG_TRY(lg_run_check(path, kind, run, error));
    LG_TRY(lg_file_writer_create(context, path, kind->checkpoint, provenance, &writer, error));
    LG_TRY(lg_run_put(lg_file_writer_h5(writer), kind, run, error));
    return LG_MOVE(out, writer);
}

lg_status lg_checkpoint_open(const lg_context *context, const char *path, const lg_read_options *options,
                             const lg_recipe *kind, void *run, lg_file_reader **out, lg_error *error) {
    LG_NEEDS(error, kind, run, out);
    LG_CLEAN(lg_file_reader_destroy_at) lg_file_reader *reader = NULL;
    LG_TRY(lg_file_reader_create(context, path, kind->checkpoint, options, &reader, error));
    LG_SCRATCH(char, got, context, kind->run_size);
    if (got == NULL) return lg_no_memory_for(path, error);
    LG_TRY(lg_run_get(lg_file_reader_h5(reader), kind, true, got, error));
    memcpy(run, got, kind->run_size);
    return LG_MOVE(out, reader);
}
