/* What the tests of all kinds of models in files share. Before it is included, MODEL_KIND names the kind
 * (`surrogate`: lg_surrogate_file, lg_model_save_surrogate, ...), MODEL_BAD the example that is made bad,
 * and MODEL_SINGLE one in single precision; afterwards the test defines make_run and make_model: run and
 * model number `which` of its examples. Checkpoints are of example 0. */
#ifndef LG_MODEL_FILE_CHECKS_H
#define LG_MODEL_FILE_CHECKS_H

#include "io_test.h"

#include "liegrad/networks.h"
#include "liegrad/ops.h"

#define JOIN_(a, b, c) a##b##c
#define JOIN(a, b, c)  JOIN_(a, b, c)
typedef JOIN(lg_, MODEL_KIND, _file) model_file;
typedef JOIN(lg_, MODEL_KIND, _run) model_run;
#define model_save JOIN(lg_model_save_, MODEL_KIND, )
#define model_load JOIN(lg_model_load_, MODEL_KIND, )
#define model_free JOIN(lg_, MODEL_KIND, _file_destroy)
#define model_kind &JOIN(lg_run_, MODEL_KIND, )

static model_run make_run(size_t which);
static void make_model(size_t which, model_file *file);

/* As exact as dtype. */
static inline double *numbers(size_t count, lg_rng *rng, lg_dtype dtype) {
    double *out = lg_alloc(NULL, count, sizeof *out);
    assert_non_null(out);
    for (size_t i = 0; i < count; i++)
        out[i] = dtype == LG_F32 ? (double)(float)lg_rng_normal(rng) : lg_rng_normal(rng);
    return out;
}

/* ---- models ---- */

static inline const char *good_model(size_t which) {
    char name[32];
    (void)snprintf(name, sizeof name, "model%zu.original", which);
    const char *path = scratch_path("model.h5"), *original = scratch_path(name);
    if (access(original, F_OK) != 0) {
        model_file file;
        make_model(which, &file);
        assert_ok(model_save(NULL, original, &file, NULL, NULL));
        model_free(&file);
    }
    copy_file(original, path);
    return path;
}

static inline const char *fresh_model(void) {
    return good_model(MODEL_BAD);
}

static inline lg_status read_model(const lg_context *context, const char *path,
                                   const lg_read_options *options, lg_error *error) {
    model_file file;
    const lg_status status = model_load(context, path, options, &file, error);
    if (status == LG_OK) model_free(&file);
    return status;
}

/* Slice of the file's parameters: an array below /model, in the type of the training. */
static inline void assert_slice_stored(lg_h5 *h5, const lg_slice_info *slice, const double *theta,
                                       lg_dtype dtype) {
    char name[64];
    double values[512], epsilon;
    uint64_t dims[4];
    uint32_t rank;
    (void)snprintf(name, sizeof name, "model/%s", slice->name);
    assert_true(slice->count <= LG_COUNT(values));
    assert_ok(lg_h5_get(h5, name, LG_ELEMENT_F64, slice->rank, slice->dims, values, NULL));
    assert_memory_equal(values, theta + slice->offset, slice->count * sizeof(double));
    assert_ok(lg_h5_shape(h5, name, &rank, dims, &epsilon, NULL));
    assert_true(dtype == LG_F32 ? epsilon > 1e-8 : epsilon < 1e-15);
}

/* ---- a model with the state of its fit, and checkpoints ---- */

static inline lg_status square_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                    size_t count, size_t batch, lg_var *loss) {
    (void)user, (void)samples;
    *loss = lg_scale(tape, lg_sum(tape, lg_mul(tape, theta, theta)), (double)count / (double)batch);
    return lg_tape_status(tape);
}

static inline lg_fit *make_fit(const double *theta, size_t parameters) {
    const lg_fit_problem problem = {.parameters = parameters, .samples = 12, .loss = square_loss};
    lg_training training = make_run(MODEL_BAD).training;
    lg_fit_options options;
    lg_fit *fit;
    lg_fit_options_init(&options);
    training.epochs = 5;
    training.batch = 5;
    lg_training_apply(&training, &options);
    options.stop_after = 3;
    assert_ok(lg_fit_create(NULL, &problem, &options, theta, &fit, NULL));
    return fit;
}

/* Saved with its fit of 3 epochs, and loaded. */
static inline void load_fitted(model_file *again) {
    model_file file;
    const char *path = scratch_path("fitted.h5");
    make_model(MODEL_BAD, &file);
    lg_fit *fit = make_fit(file.theta, file.parameters);
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, file.theta);
    assert_ok(model_save(NULL, path, &file, fit, NULL));
    assert_ok(model_load(NULL, path, NULL, again, NULL));
    assert_memory_equal(again->theta, file.theta, file.parameters * sizeof(double));
    assert_int_equal(again->epochs_done, 3);
    assert_memory_equal(again->history[LG_FIT_LOSS], lg_fit_history(fit, LG_FIT_LOSS), 3 * sizeof(double));
    lg_fit_destroy(fit);
    model_free(&file);
}

static inline void model_with_fit(void) {
    model_file again;
    load_fitted(&again);
    model_free(&again);
}

static inline lg_status write_checkpoint(const lg_context *context, const char *path, const lg_fit *fit,
                                         lg_error *error) {
    const model_run run = make_run(0);
    lg_file_writer *writer;
    lg_archive_writer archive;
    LG_TRY(lg_checkpoint_create(context, path, model_kind, &run, NULL, &writer, error));
    lg_status status = lg_file_writer_archive(writer, "fit", &archive);
    if (status == LG_OK && fit != NULL) status = lg_fit_save(fit, &archive, error);
    if (status == LG_OK) status = archive.text(archive.user, "note/author", "nobody");
    if (status == LG_OK) status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}

static inline lg_status read_checkpoint(const lg_context *context, const char *path,
                                        const lg_read_options *options, lg_error *error) {
    model_run run;
    lg_file_reader *reader;
    const lg_status status = lg_checkpoint_open(context, path, options, model_kind, &run, &reader, error);
    if (status == LG_OK) lg_file_reader_destroy(reader);
    return status;
}

static inline const char *good_checkpoint(void) {
    const double theta[3] = {1, 2, 3};
    const char *path = scratch_path("check.h5"), *original = scratch_path("check.original");
    if (access(original, F_OK) != 0) {
        lg_fit *fit = make_fit(theta, 3);
        assert_ok(lg_fit_run(fit, NULL));
        assert_ok(write_checkpoint(NULL, original, fit, NULL));
        lg_fit_destroy(fit);
    }
    copy_file(original, path);
    return path;
}

/* 3 epochs, checkpoint, 2 more: the same bits as 5. `look` (may be NULL) sees what was opened. */
static inline void resume_checkpoint(void (*look)(const model_run *run, lg_file_reader *reader,
                                                  const lg_archive_reader *archive)) {
    const double theta[3] = {1, 2, 3};
    double straight[3], resumed[3];
    const model_run wanted = make_run(0);
    model_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    lg_fit *fit = make_fit(theta, 3);
    assert_ok(lg_fit_run(fit, NULL));
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, straight);
    lg_fit_destroy(fit);
    assert_ok(lg_checkpoint_open(NULL, good_checkpoint(), NULL, model_kind, &run, &reader, NULL));
    assert_ok(lg_run_compare(model_kind, &run, &wanted, "check.h5", NULL));
    assert_ok(lg_file_reader_archive(reader, "fit", &archive));
    fit = make_fit(theta, 3);
    assert_ok(lg_fit_load(fit, &archive, NULL));
    if (look != NULL) look(&run, reader, &archive);
    lg_file_reader_destroy(reader);
    assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, resumed);
    lg_fit_destroy(fit);
    assert_memory_equal(straight, resumed, sizeof straight);
}

/* Damage all over; keys of /run that must be there; model and checkpoint exchanged. */
static inline void refuse_damaged_checkpoints(const char *model_name, const char *checkpoint_name,
                                              size_t changes, const char *const *needed, size_t count) {
    refuse_damaged_files(read_checkpoint, good_checkpoint(), "");
    survive_changed_bytes(read_checkpoint, good_checkpoint(), changes);
    for (size_t i = 0; i < count; i++) {
        const char *path = good_checkpoint();
        delete_attribute(path, "run", needed[i]);
        assert_refused(read_checkpoint, path, LG_FORMAT, needed[i], "missing");
    }
    assert_refused(read_checkpoint, good_model(0), LG_FORMAT, "kind", checkpoint_name);
    assert_refused(read_model, good_checkpoint(), LG_FORMAT, "kind", model_name);
}

/* words[i]: how runs[i] is not the wanted one. */
static inline void refuse_other_runs(const model_run *wanted, const model_run *runs, const char *const *words,
                                     size_t count) {
    lg_error error;
    for (size_t i = 0; i < count; i++) {
        assert_status(lg_run_compare(model_kind, &runs[i], wanted, "a.h5", &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "a.h5"));
        if (strstr(error.message, words[i]) == NULL) fail_msg("no '%s' in: %s", words[i], error.message);
    }
    assert_ok(lg_run_compare(model_kind, wanted, wanted, "a.h5", &error));
}

/* ---- memory ---- */

static inline lg_status save_step(const lg_context *context, void *user, lg_error *error) {
    model_file file;
    make_model(MODEL_SINGLE, &file);
    const lg_status status = model_save(context, user, &file, NULL, error);
    model_free(&file);
    return status;
}

static inline lg_status open_step(const lg_context *context, void *user, lg_error *error) {
    model_run run;
    lg_file_reader *reader;
    lg_archive_reader archive;
    const lg_read_options options = without_probe();
    LG_TRY(lg_checkpoint_open(context, user, &options, model_kind, &run, &reader, error));
    const lg_status status = lg_file_reader_archive(reader, "fit", &archive);
    lg_file_reader_destroy(reader);
    return status;
}

static inline lg_status checkpoint_step(const lg_context *context, void *user, lg_error *error) {
    return write_checkpoint(context, user, NULL, error);
}

/* `load` and `save`: how many allocations these have at the least. No file is left behind. */
static inline void fail_model_allocations(size_t load, size_t save) {
    const char *model = good_model(0), *checkpoint = good_checkpoint();
    const size_t files = scratch_files();
    assert_true(fail_every_reading(read_model, model) >= load);
    assert_true(fail_every_allocation(save_step, (void *)model) >= save);
    assert_true(fail_every_allocation(open_step, (void *)checkpoint) >= 4);
    assert_true(fail_every_allocation(checkpoint_step, (void *)checkpoint) >= 6);
    assert_int_equal(scratch_files(), files);
}

#endif
