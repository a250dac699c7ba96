/* Models in files. A kind of model is data: a table of what describes its run, the slices of its parameter
 * vector, and where its file structure keeps what all kinds have. Attributes of /model say what is learned,
 * those of /run how and on what; weights lie below /model by name; optimizer, generator and history are the
 * same for all. */
#ifndef LG_RUN_H
#define LG_RUN_H

#include "datasets/h5.h"
#include "liegrad/networks.h"

typedef enum lg_row_type {
    LG_ROW_REAL,
    LG_ROW_U64,
    LG_ROW_U32,
    LG_ROW_FLAG, /* bool; stored as 0 or 1 */
    LG_ROW_TEXT,
    LG_ROW_NAME, /* enumeration, or bool with two names; stored as text */
    LG_ROW_SHOWN /* a text made of several fields; read by the kind's `build` */
} lg_row_type;

/* One attribute of a run. */
typedef struct lg_row {
    const char *group, *name;
    lg_row_type type;
    size_t offset, size;
    double low;                          /* smallest value of a number */
    const char *(*value_name)(uint32_t); /* LG_ROW_NAME: NULL beyond the last */
    const void *(*value_at)(uint32_t);   /* LG_ROW_NAME of a pointer: to the row of that number */
    void (*show)(const void *run, char *text, size_t size); /* LG_ROW_SHOWN */
    bool optional; /* files of earlier versions lack it: the default stands */
} lg_row;

/* A row about a member of `struct`; what follows are designated initialisers, `.low = 0` when there is
 * nothing to say. */
#define LG_ROW(struct_, group_, name_, type_, member, ...)                                                   \
    {                                                                                                        \
        .group = group_, .name = name_, .type = LG_ROW_##type_, .offset = offsetof(struct_, member),         \
        .size = sizeof(((struct_ *)0)->member), __VA_ARGS__                                                  \
    }
#define LG_ROW_TEXT_SIZE 1024 /* of a value as it stands in a sentence */

typedef struct lg_run_kind {
    const char *name;       /* attribute `kind` of a model, */
    const char *checkpoint; /* and of a checkpoint */
    /* The run. */
    const lg_row *rows;
    size_t row_count;
    size_t run_size, training;                                 /* offset of its lg_training */
    const void *defaults;                                      /* a run */
    lg_status (*build)(lg_h5 *h5, void *run, lg_error *error); /* rows read: the model is made from them */
    lg_status (*check)(const void *run);                       /* the model is one that init would make */
    lg_status (*describe)(lg_h5 *h5, const void *run, lg_error *error); /* attributes for people */
    /* Parameters: slice number `index`, named below /model; false beyond the last. */
    size_t (*parameters)(const void *run);
    bool (*slice)(const void *run, uint32_t index, lg_slice_info *out);
    /* The file structure: offsets of what all kinds have. */
    size_t file_run, file_parameters, file_theta, file_epochs, file_history, file_provenance;
    /* What else is in the file; `fitted`: lg_fit_save writes optimizer and generator. */
    lg_status (*put_rest)(lg_h5 *h5, const void *file, bool fitted, lg_error *error);
    lg_status (*get_rest)(lg_h5 *h5, void *file, lg_error *error);
    void (*release)(const lg_context *context, void *file);
} lg_run_kind;

/* ---- runs (run.c) ---- */

lg_status lg_run_check(const char *path, const lg_run_kind *kind, const void *run, lg_error *error);
lg_status lg_run_put(lg_h5 *h5, const lg_run_kind *kind, const void *run, lg_error *error);
/* `complete`: every key of /run must be there, but for optional ones; otherwise missing ones keep their
 * defaults. */
lg_status lg_run_get(lg_h5 *h5, const lg_run_kind *kind, bool complete, void *run, lg_error *error);
lg_status lg_run_compare(const char *path, const lg_run_kind *kind, const void *stored, const void *wanted,
                         lg_error *error);

/* ---- models and checkpoints (model.c) ---- */

lg_status lg_run_save(const lg_context *context, const char *path, const lg_run_kind *kind, const void *file,
                      const lg_fit *fit, lg_error *error);
/* `file`: zeroed; on failure it is released. */
lg_status lg_run_load(const lg_context *context, const char *path, const lg_read_options *options,
                      const lg_run_kind *kind, void *file, lg_error *error);
/* Replaces a model file by a copy that edit(user, h5, error) changed, first for a try in the child of
 * lg_probe. */
lg_status lg_run_edit(const lg_context *context, const char *path,
                      lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* What lg_run_load does with a file that is open; `file` holds something on failure too. */
lg_status lg_run_get_file(lg_h5 *h5, const lg_run_kind *kind, void *file, lg_error *error);
lg_status lg_run_checkpoint_create(const lg_context *context, const char *path, const lg_run_kind *kind,
                                   const void *run, const lg_provenance *provenance, lg_file_writer **out,
                                   lg_error *error);
/* On failure `run` holds anything. */
lg_status lg_run_checkpoint_open(const lg_context *context, const char *path, const lg_read_options *options,
                                 const lg_run_kind *kind, void *run, lg_file_reader **out, lg_error *error);

/* LG_NOT_FOUND and LG_SHAPE of a key are matters of format in a file: here and in `error` (may be NULL). */
lg_status lg_as_format(lg_status status, lg_error *error);
/* An optional, finite number of the root. */
lg_status lg_model_get_number(lg_h5 *h5, const char *name, bool *has, double *value, lg_error *error);
void lg_history_destroy(const lg_context *context, double *history[LG_FIT_SERIES_COUNT]);

/* ---- a kind and its public functions ---- */

/* Defines, in a file that has rows, defaults, build, check, describe, parameters, slice, put_rest and
 * get_rest of a kind: the table `kind` and the functions of io.h that take its structures lg_kind_file and
 * lg_kind_run: lg_model_save_kind, lg_model_load_kind, checkpoint_create, checkpoint_open,
 * lg_kind_run_compare. Every file structure names the members alike that all kinds have; lg_kind_file_destroy is
 * the kind's own. */
#define LG_RUN_KIND(kind, checkpoint_name, checkpoint_)                                                      \
    static void release(const lg_context *context, void *file) {                                             \
        lg_##kind##_file_destroy(context, file);                                                             \
    }                                                                                                        \
    static const lg_run_kind kind = {.name = #kind,                                                          \
                                     .checkpoint = checkpoint_name,                                          \
                                     .rows = rows,                                                           \
                                     .row_count = LG_COUNT(rows),                                            \
                                     .run_size = sizeof(lg_##kind##_run),                                    \
                                     .training = offsetof(lg_##kind##_run, training),                        \
                                     .defaults = &defaults,                                                  \
                                     .build = build,                                                         \
                                     .check = check,                                                         \
                                     .describe = describe,                                                   \
                                     .parameters = parameters,                                               \
                                     .slice = slice,                                                         \
                                     .file_run = offsetof(lg_##kind##_file, run),                            \
                                     .file_parameters = offsetof(lg_##kind##_file, parameters),              \
                                     .file_theta = offsetof(lg_##kind##_file, theta),                        \
                                     .file_epochs = offsetof(lg_##kind##_file, epochs_done),                 \
                                     .file_history = offsetof(lg_##kind##_file, history),                    \
                                     .file_provenance = offsetof(lg_##kind##_file, provenance),              \
                                     .put_rest = put_rest,                                                   \
                                     .get_rest = get_rest,                                                   \
                                     .release = release};                                                    \
                                                                                                             \
    lg_status lg_model_save_##kind(const lg_context *context, const char *path,                              \
                                   const lg_##kind##_file *file, const lg_fit *fit, lg_error *error) {       \
        return lg_run_save(context, path, &kind, file, fit, error);                                          \
    }                                                                                                        \
                                                                                                             \
    lg_status lg_model_load_##kind(const lg_context *context, const char *path,                              \
                                   const lg_read_options *options, lg_##kind##_file *out, lg_error *error) { \
        if (path == NULL || out == NULL)                                                                     \
            return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name");                         \
        lg_##kind##_file made = {.parameters = 0};                                                           \
        LG_TRY(lg_run_load(context, path, options, &kind, &made, error));                                    \
        *out = made;                                                                                         \
        return LG_OK;                                                                                        \
    }                                                                                                        \
                                                                                                             \
    lg_status checkpoint_##_create(const lg_context *context, const char *path, const lg_##kind##_run *run,  \
                                   const lg_provenance *provenance, lg_file_writer **out, lg_error *error) { \
        return lg_run_checkpoint_create(context, path, &kind, run, provenance, out, error);                  \
    }                                                                                                        \
                                                                                                             \
    lg_status checkpoint_##_open(const lg_context *context, const char *path,                                \
                                 const lg_read_options *options, lg_##kind##_run *run, lg_file_reader **out, \
                                 lg_error *error) {                                                          \
        lg_##kind##_run got;                                                                                 \
        LG_TRY(                                                                                              \
            lg_run_checkpoint_open(context, path, options, &kind, &got, run != NULL ? out : NULL, error));   \
        *run = got;                                                                                          \
        return LG_OK;                                                                                        \
    }                                                                                                        \
                                                                                                             \
    lg_status lg_##kind##_run_compare(const char *path, const lg_##kind##_run *stored,                       \
                                      const lg_##kind##_run *wanted, lg_error *error) {                      \
        return lg_run_compare(path, &kind, stored, wanted, error);                                           \
    }

#endif
