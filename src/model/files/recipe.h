/* A recipe: what files know of a kind of model, as one row: the fields of the run, the slices of the
 * parameter vector, the model's functions, and the offsets of the members that all file structures have.
 * Attributes of /model say what is learned, attributes of /run how and from which data. Weights are below
 * /model by name. Optimizer, generator and history are the same for all recipes. */
#ifndef LG_RECIPE_H
#define LG_RECIPE_H

#include "liegrad/fields.h"
#include "liegrad/io.h"
#include "liegrad/networks.h"
#include "settings/settings.h"

/* A row for a fact about the model or its data, which nobody sets. The last arguments are designated
 * initialisers; `.low = 0` adds nothing. */
#define LG_FACT(struct_, group_, name_, type_, member, ...)                                                  \
    LG_FIELD(struct_, group_, name_, type_, member, .high = 1e300, __VA_ARGS__)

typedef struct lg_h5 lg_h5; /* files/h5.h */

struct lg_recipe {
    const char *name;       /* attribute `kind` of a model, */
    const char *checkpoint; /* and of a checkpoint */
    /* The run. Both tables end with a row without a name. */
    const lg_field *facts, *fields;
    size_t run_size, training; /* offset of its lg_training */
    const void *defaults;      /* a run with the values for attributes that a file lacks */
    lg_status (*build)(lg_h5 *h5, void *run,
                       lg_error *error); /* rows read: the model is made from them; may be NULL */
    lg_status (*check)(const void *run); /* the model is one that init would make */
    lg_status (*describe)(lg_h5 *h5, const void *run,
                          lg_error *error); /* attributes for people; may be NULL */
    /* Parameters: slice number `index`, named below /model; false beyond the last. */
    size_t (*parameters)(const void *run);
    bool (*slice)(const void *run, uint32_t index, lg_slice_info *out);
    /* The functions of the model in a file structure, with steps of `scheme` (NULL: the usual one). */
    lg_status (*program)(const lg_context *context, const void *file, const lg_scheme *scheme,
                         lg_program **out, lg_error *error);
    lg_status (*space)(const void *run, lg_space *out); /* of the states; NULL: the model does not move */
    const struct lg_program_source *places; /* of the program's other parameters than theta; ended by NULL */
    const lg_scheme *(*scheme)(const void *file); /* of the program's steps; NULL: it has none */
    /* The file structure: its size, offsets of what all kinds have. */
    size_t file_size, file_context, file_run, file_parameters, file_theta, file_epochs, file_history,
        file_provenance;
    /* Writes the rest of the file; may be NULL. `fitted`: lg_fit_save writes optimizer and generator. */
    lg_status (*put_rest)(lg_h5 *h5, const void *file, bool fitted, lg_error *error);
    lg_status (*get_rest)(lg_h5 *h5, void *file, lg_error *error);
    void (*release)(void *file);      /* NULL: theta and history are all that it owns */
    const struct lg_learner *learner; /* the training half (model/files/learning.h) */
};

/* ---- runs (recipe.c) ---- */

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error);
lg_status lg_run_put(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error);
/* `complete`: all keys of /run except optional ones must exist; otherwise missing ones keep their
 * defaults. */
lg_status lg_run_get(lg_h5 *h5, const lg_recipe *kind, bool complete, void *run, lg_error *error);

/* ---- models and checkpoints (model.c) ---- */

lg_status lg_run_save(const lg_context *context, const char *path, const lg_recipe *kind, const void *file,
                      const lg_fit *fit, lg_error *error);
/* `file`: zero but for its context; on failure it is released. */
lg_status lg_run_load(const lg_context *context, const char *path, const lg_read_options *options,
                      const lg_recipe *kind, void *file, lg_error *error);
/* Replaces a model file by a copy that edit(user, h5, error) has changed. The child of lg_probe tries it
 * first. */
lg_status lg_run_edit(const lg_context *context, const char *path,
                      lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* lg_run_load for an open file; on failure `file` may have arrays, which the caller frees. */
lg_status lg_run_get_file(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error);

/* An optional, finite number of the root. */
lg_status lg_model_get_number(lg_h5 *h5, const char *name, bool *has, double *value, lg_error *error);
void lg_run_release(const lg_recipe *kind, void *file);
void lg_history_destroy(const lg_context *context, double *history[LG_FIT_SERIES_COUNT]);

/* ---- a kind and its public functions ---- */

/* The names of a row and the offsets of its structures, lg_kind_run and lg_kind_file. */
#define LG_RECIPE_LAYOUT(kind)                                                                               \
    .name = #kind, .fields = lg_##kind##_fields, .run_size = sizeof(lg_##kind##_run),                        \
    .training = offsetof(lg_##kind##_run, training), .file_size = sizeof(lg_##kind##_file),                  \
    .file_context = offsetof(lg_##kind##_file, context), .file_run = offsetof(lg_##kind##_file, run),        \
    .file_parameters = offsetof(lg_##kind##_file, parameters),                                               \
    .file_theta = offsetof(lg_##kind##_file, theta), .file_epochs = offsetof(lg_##kind##_file, epochs_done), \
    .file_history = offsetof(lg_##kind##_file, history),                                                     \
    .file_provenance = offsetof(lg_##kind##_file, provenance)

/* Defines, in a file that has facts, defaults, build, check, describe, parameters, slice, program, put_rest
 * and get_rest of a kind: lg_recipe_kind, and the functions that take its structures: lg_model_save_kind,
 * lg_model_load_kind. Every file structure names the members alike that all kinds have;
 * lg_kind_file_destroy is the kind's own. More members of the row may follow. */
#define LG_RECIPE(kind, checkpoint_name, ...)                                                                \
    lg_status lg_model_save_##kind(const lg_context *context, const char *path,                              \
                                   const lg_##kind##_file *file, const lg_fit *fit, lg_error *error) {       \
        return lg_run_save(context, path, &lg_recipe_##kind, file, fit, error);                              \
    }                                                                                                        \
                                                                                                             \
    lg_status lg_model_load_##kind(const lg_context *context, const char *path,                              \
                                   const lg_read_options *options, lg_##kind##_file *out, lg_error *error) { \
        if (path == NULL || out == NULL)                                                                     \
            return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name");                         \
        lg_##kind##_file made = {.context = context};                                                        \
        LG_TRY(lg_run_load(context, path, options, &lg_recipe_##kind, &made, error));                        \
        *out = made;                                                                                         \
        return LG_OK;                                                                                        \
    }                                                                                                        \
    static void release(void *file) {                                                                        \
        lg_##kind##_file_destroy(file);                                                                      \
    }                                                                                                        \
    const lg_recipe lg_recipe_##kind = {LG_RECIPE_LAYOUT(kind), .checkpoint = checkpoint_name,               \
                                        .facts = facts,         .defaults = &defaults,                       \
                                        .build = build,         .check = check,                              \
                                        .describe = describe,   .parameters = parameters,                    \
                                        .slice = slice,         .program = program,                          \
                                        .put_rest = put_rest,   .get_rest = get_rest,                        \
                                        .release = release,     __VA_ARGS__}

#endif
