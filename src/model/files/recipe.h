/* A recipe tells files about a kind of model, in one row: the fields of the run, the slices of the parameter
 * vector, the model's functions, and the offsets of the members that every file structure has. Attributes of
 * /model say what is learned, attributes of /run say how and from which data. Weights are below /model, by
 * name. Optimizer state, random generator and history are stored alike for all recipes. */
#ifndef LG_RECIPE_H
#define LG_RECIPE_H

#include <float.h>

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

/* What every file structure begins with. */
typedef struct lg_model_head {
    LG_MODEL_HEAD
} lg_model_head;

struct lg_recipe {
    const char *name;       /* attribute `kind` of a model file */
    const char *checkpoint; /* attribute `kind` of a checkpoint */
    /* The fields of the run. Both tables end with a row without a name. */
    const lg_field *facts, *fields;
    size_t run_size, training; /* size of the run; offset of lg_fit_settings in it */
    const void *defaults;      /* a run with the values for attributes that a file lacks */
    /* Reads into the run what is no row; may be NULL. */
    lg_status (*read)(lg_h5 *h5, void *run, lg_error *error);
    /* Makes the model from the values of the rows. `why` says what is wrong with them; it begins with the
     * group if it is not about the whole model. Called again on a copy of a run, it must make the same bytes
     * at `made`, of which there are made_size. */
    lg_status (*make)(void *run, lg_error *why);
    size_t made, made_size;
    lg_status (*describe)(lg_h5 *h5, const void *run,
                          lg_error *error); /* writes attributes for people; may be NULL */
    /* Slice `index` of the parameters, which is stored below /model by its name; false beyond the last
     * slice. NULL: the model has no parameters. */
    bool (*slice)(const void *run, uint32_t index, lg_slice_info *out);
    /* Makes the program of the model in a file structure. `scheme`: of its steps; NULL: the usual scheme.
     * NULL: files have no functions. */
    lg_status (*program)(const lg_context *context, const void *file, const lg_scheme *scheme,
                         lg_program **out, lg_error *error);
    lg_status (*space)(const void *run, lg_space *out); /* of the states; NULL: the model does not move */
    /* places of the program's parameters other than theta, ended by NULL; may be NULL */
    const struct lg_program_source *places;
    /* usual scheme of the program's steps; NULL: it has no steps */
    const lg_scheme *(*scheme)(const void *file);
    size_t file_size, file_run;  /* the file structure: its size, and the offset of the run */
    const struct lg_item *items; /* what else the file holds; may be NULL */
    /* Write and read what is no item, before the items; may be NULL. */
    lg_status (*put_rest)(lg_h5 *h5, const void *file, lg_error *error);
    lg_status (*get_rest)(lg_h5 *h5, void *file, lg_error *error);
    void (*release)(void *file);      /* frees what is not theta, the history or an item; may be NULL */
    const struct lg_trainer *trainer; /* the training half, never NULL (model/files/training.h) */
};

/* ---- runs (recipe.c) ---- */

size_t lg_recipe_parameters(const lg_recipe *kind, const void *run); /* all slices together */

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error);
lg_status lg_run_put(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error);
/* complete: all attributes of /run but optional ones must exist; else missing ones keep their default. */
lg_status lg_run_get(lg_h5 *h5, const lg_recipe *kind, bool complete, void *run, lg_error *error);

/* ---- models and checkpoints (model.c) ---- */

/* Replaces a model file by a copy that edit(user, h5, error) has changed. The edit is first tried in the
 * child process of lg_probe. */
lg_status lg_run_edit(const lg_context *context, const char *path,
                      lg_status (*edit)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* lg_recipe_load for an open file. On failure the caller must release `file`, which may have arrays. */
lg_status lg_run_get_file(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error);

/* A slice of rank 1 (first) or 2 (first, second); the caller sets its name. */
void lg_slice_set(lg_slice_info *s, size_t offset, uint32_t rank, uint64_t first, uint64_t second);
/* Slice number *index of a network whose parameters begin at `offset`: PART/layer1/weight,
 * PART/layer1/bias, ... False if the network has fewer slices; their number is then subtracted from
 * *index. */
bool lg_slice_of_mlp(const lg_mlp *net, const char *part, size_t offset, uint32_t *index, lg_slice_info *s);

/* ---- items (items.c) ---- */

/* An array in a member `double *`; the arrays NAME/mean and NAME/scale in a member lg_scaler; an attribute of
 * the root. The list ends with LG_ITEM_END. */
typedef enum lg_item_type { LG_ITEM_END, LG_ITEM_ARRAY, LG_ITEM_SCALER, LG_ITEM_ATTRIBUTE } lg_item_type;
/* A dimension of an array: a member uint32_t or size_t of the file structure, or (bytes = 0) the number
 * `offset`. A size_t that is 0 becomes what the file has. */
typedef struct lg_item_size {
    size_t offset, bytes;
    const char *what; /* what it counts, in messages */
} lg_item_size;
typedef struct lg_item {
    lg_item_type type;
    const char *name; /* path; NULL: the array is only freed */
    size_t offset;    /* of the member in the file structure */
    lg_item_size dims[2];
    bool optional;                    /* the file may lack the array */
    bool (*applies)(const void *run); /* whether the model has the array; NULL: always */
    /* An attribute: a real, whole number or text. NaN, 0 and "" are unknown, and are not stored. */
    lg_field field;
    size_t
        known; /* offset of the bool that says whether the number is known; `optional`: it may be NaN then */
    bool lenient; /* a wrong value in a file is unknown; reals are above 0 */
} lg_item;
#define LG_DIM(struct_, member, what_)                                                                       \
    { offsetof(struct_, member), sizeof(((struct_ *)0)->member), what_ }
#define LG_ATTRIBUTE(struct_, type_, name_, member, ...)                                                     \
    {                                                                                                        \
        .type = LG_ITEM_ATTRIBUTE, .field = LG_FIELD(struct_, "", name_, type_, member, .high = DBL_MAX),    \
        __VA_ARGS__                                                                                          \
    }
/* Whether the attribute has a known value. */
bool lg_item_is_known(const lg_item *item, const void *file);
lg_status lg_items_put(lg_h5 *h5, const lg_recipe *kind, const void *file, lg_error *error);
lg_status lg_items_get(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error);
void lg_items_release(const lg_context *context, const lg_recipe *kind, void *file);

/* ---- the recipe of a kind ---- */

/* Members of a recipe that follow from its kind: names, offsets in lg_<kind>_run and lg_<kind>_file. */
#define LG_RECIPE_LAYOUT(kind)                                                                               \
    .name = #kind, .fields = lg_##kind##_fields, .run_size = sizeof(lg_##kind##_run),                        \
    .training = offsetof(lg_##kind##_run, training), .file_size = sizeof(lg_##kind##_file),                  \
    .file_run = offsetof(lg_##kind##_file, run)

#define LG_MADE(struct_, member)                                                                             \
    .made = offsetof(struct_, member), .made_size = sizeof(((struct_ *)0)->member)
/* Defines lg_recipe_<kind>. The source file must define facts, defaults, make, describe, slice and program of
 * the kind. The common members have the same names in every file structure. Further members of the row may
 * follow as arguments. */
#define LG_RECIPE(kind, checkpoint_name, ...)                                                                \
    const lg_recipe lg_recipe_##kind = {LG_RECIPE_LAYOUT(kind),                                              \
                                        .checkpoint = checkpoint_name,                                       \
                                        .facts = facts,                                                      \
                                        .defaults = &defaults,                                               \
                                        .make = make,                                                        \
                                        .describe = describe,                                                \
                                        .slice = slice,                                                      \
                                        .program = program,                                                  \
                                        __VA_ARGS__}

#endif
