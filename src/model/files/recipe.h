/* A recipe tells files about a kind of model, in one row: the fields of the run, the slices of the parameter
 * vector, the model's functions, and the offsets of the members that every file structure has. Attributes of
 * /model say what is learned, attributes of /run say how and from which data. Weights are below /model, by
 * name. Optimizer state, random generator and history are stored alike for all recipes. */
#ifndef LG_RECIPE_H
#define LG_RECIPE_H

#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/integrators.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"
#include "settings/settings.h"

/* A field for a fact about the model or its data, which no user sets. The last arguments are designated
 * initialisers; pass `.low = 0` if there is nothing to add. */
#define LG_FACT(struct_, group_, name_, type_, member, ...)                                                  \
    LG_FIELD(struct_, group_, name_, type_, member, .high = 1e300, __VA_ARGS__)

typedef struct lg_h5 lg_h5; /* in files/h5.h */

struct lg_recipe {
    const char *name;       /* attribute `kind` of a model file */
    const char *checkpoint; /* attribute `kind` of a checkpoint */
    /* The fields of the run. Both tables end with a row without a name. */
    const lg_field *facts, *fields;
    size_t run_size, training; /* size of the run; offset of lg_fit_settings in it */
    const void *defaults;      /* a run with the values for attributes that a file lacks */
    lg_status (*build)(lg_h5 *h5, void *run,
                       lg_error *error); /* makes the model after the rows are read; may be NULL */
    lg_status (*check)(const void *run); /* fails unless init would make this model */
    lg_status (*describe)(lg_h5 *h5, const void *run,
                          lg_error *error); /* writes attributes for people; may be NULL */
    /* The number of parameters, and slice `index` of them, which is stored below /model by its name; false
     * beyond the last slice. */
    size_t (*parameters)(const void *run);
    bool (*slice)(const void *run, uint32_t index, lg_slice_info *out);
    /* Makes the program of the model in a file structure. `scheme`: of its steps; NULL: the usual scheme. */
    lg_status (*program)(const lg_context *context, const void *file, const lg_scheme *scheme,
                         lg_program **out, lg_error *error);
    lg_status (*space)(const void *run, lg_space *out); /* of the states; NULL: the model does not move */
    /* places of the program's parameters other than theta, ended by NULL; may be NULL */
    const struct lg_program_source *places;
    /* usual scheme of the program's steps; NULL: it has no steps */
    const lg_scheme *(*scheme)(const void *file);
    /* The file structure: its size, and the offsets of the members that all kinds have. */
    size_t file_size, file_context, file_run, file_parameters, file_theta, file_epochs, file_history,
        file_provenance;
    /* Write and read the rest of the file; may be NULL. fitted: lg_fit_save writes the optimizer. */
    lg_status (*put_rest)(lg_h5 *h5, const void *file, bool fitted, lg_error *error);
    lg_status (*get_rest)(lg_h5 *h5, void *file, lg_error *error);
    void (*release)(void *file);      /* NULL: the file structure owns only theta and the history */
    const struct lg_trainer *trainer; /* the training half, never NULL (model/files/training.h) */
};

/* ---- runs (recipe.c) ---- */

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error);
lg_status lg_run_put(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error);
/* complete: all attributes of /run but optional ones must exist; else missing ones keep their default. */
lg_status lg_run_get(lg_h5 *h5, const lg_recipe *kind, bool complete, void *run, lg_error *error);

/* ---- models and checkpoints (model.c) ---- */

lg_status lg_run_save(const lg_context *context, const char *path, const lg_recipe *kind, const void *file,
                      const lg_fit *fit, lg_error *error);
/* `file` must be zero except for its context; on failure it is released. */
lg_status lg_run_load(const lg_context *context, const char *path, const lg_read_options *options,
                      const lg_recipe *kind, void *file, lg_error *error);
/* Replaces a model file by a copy that edit(user, h5, error) has changed. The edit is first tried in the
 * child process of lg_probe. */
lg_status lg_run_edit(const lg_context *context, const char *path,
                      lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* lg_run_load for an open file. On failure the caller must release `file`, which may have arrays. */
lg_status lg_run_get_file(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error);

/* Reads an optional attribute of the root, which must be a finite number. */
lg_status lg_model_get_number(lg_h5 *h5, const char *name, bool *has, double *value, lg_error *error);
/* Members of a model's file that are attributes of the root; one that is NaN is unknown and not stored. The
 * list ends with a row without name. */
typedef struct lg_model_number {
    const char *name;
    size_t offset;
} lg_model_number;
lg_status lg_model_put_numbers(lg_h5 *h5, const lg_model_number *rows, const void *file, lg_error *error);
lg_status lg_model_get_numbers(lg_h5 *h5, const lg_model_number *rows, void *file, lg_error *error);
void lg_run_release(const lg_recipe *kind, void *file);
void lg_history_destroy(const lg_context *context, double *history[LG_FIT_SERIES_COUNT]);

/* ---- the recipe of a kind, and its public functions ---- */

/* Members of a recipe that follow from its kind: names, offsets in lg_<kind>_run and lg_<kind>_file. */
#define LG_RECIPE_LAYOUT(kind)                                                                               \
    .name = #kind, .fields = lg_##kind##_fields, .run_size = sizeof(lg_##kind##_run),                        \
    .training = offsetof(lg_##kind##_run, training), .file_size = sizeof(lg_##kind##_file),                  \
    .file_context = offsetof(lg_##kind##_file, context), .file_run = offsetof(lg_##kind##_file, run),        \
    .file_parameters = offsetof(lg_##kind##_file, parameters),                                               \
    .file_theta = offsetof(lg_##kind##_file, theta), .file_epochs = offsetof(lg_##kind##_file, epochs_done), \
    .file_history = offsetof(lg_##kind##_file, history),                                                     \
    .file_provenance = offsetof(lg_##kind##_file, provenance)

/* Defines lg_recipe_<kind>, lg_<kind>_save and lg_<kind>_load. The source file must define facts,
 * defaults, build, check, describe, parameters, slice, program, put_rest and get_rest of the kind. The common
 * members have the same names in every file structure; the kind itself provides lg_<kind>_file_destroy.
 * Further members of the row may follow as arguments. */
#define LG_RECIPE(kind, checkpoint_name, ...)                                                                \
    lg_status lg_##kind##_save(const lg_context *context, const char *path, const lg_##kind##_file *file,    \
                               const lg_fit *fit, lg_error *error) {                                         \
        return lg_run_save(context, path, &lg_recipe_##kind, file, fit, error);                              \
    }                                                                                                        \
                                                                                                             \
    lg_status lg_##kind##_load(const lg_context *context, const char *path, const lg_read_options *options,  \
                               lg_##kind##_file *out, lg_error *error) {                                     \
        if (path == NULL || out == NULL)                                                                     \
            return lg_fail(error, LG_INVALID_ARGUMENT, "the file's name or `out` is NULL");                  \
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
