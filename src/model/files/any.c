/* A model file of any kind, as one handle. */
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "core/text.h"
#include "files/h5.h"
#include "liegrad/machine_model.h"
#include "model/files/recipe.h"

/* ---- the recipes ---- */

const lg_recipe *const lg_recipes[] = {&lg_recipe_hamiltonian, &lg_recipe_surrogate,     &lg_recipe_detector,
                                       &lg_recipe_table,       &lg_recipe_machine_model, NULL};

const lg_recipe *lg_recipe_find(const char *name) {
    size_t i = 0;
    while (lg_recipes[i] != NULL && strcmp(lg_recipes[i]->name, name) != 0) i++;
    return lg_recipes[i];
}

const char *lg_recipe_name(const lg_recipe *recipe) {
    return recipe->name;
}

/* ---- what is no model ---- */

/* Words for the sentence; the last row is for any other kind. */
static const struct {
    const char *kind, *what;
} others[] = {
    {"", "the file does not say what it is (attribute kind)"},
    {"classifier", "it is a classical classifier, which lg_classifier_load reads"},
    {"program", "it is a program of functions, which lg_program_load reads"},
    {"trajectories", "it holds data, trajectories"},
    {"trajectory", "it holds data, a trajectory"},
    {"elastica", "it holds data, curves of the elastica"},
    {"series", "it holds data, labelled series"},
    {NULL, "its kind is unknown"},
};

static const char *what_is(const char *kind) {
    size_t i = 0;
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++)
        if (strcmp((*recipe)->checkpoint, kind) == 0) return "it is the checkpoint of an unfinished training";
    while (others[i].kind != NULL && strcmp(others[i].kind, kind) != 0) i++;
    return others[i].what;
}

static lg_status refuse(const char *path, const char *kind, lg_error *error) {
    char names[256] = "";
    for (size_t i = 0, used = 0; lg_recipes[i] != NULL && used < sizeof names; i++)
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s",
                                 i == 0                      ? ""
                                 : lg_recipes[i + 1] == NULL ? " or "
                                                             : ", ",
                                 lg_recipes[i]->name);
    return lg_fail(error, LG_FORMAT, "%s: attribute kind is '%s', expected %s: %s", lg_shown_path(path), kind,
                   names, what_is(kind));
}

/* ---- outside ---- */

enum { KIND_TEXT = 64 };

static lg_status load(const lg_context *context, const char *path, const lg_read_options *options,
                      lg_model_file *made, lg_error *error) {
    const lg_recipe *recipe = made->recipe;
    if (made->contents == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a model");
    *(const lg_context **)(void *)((char *)made->contents + recipe->file_context) = context;
    LG_TRY(lg_run_load(context, path, options, recipe, made->contents, error));
    lg_program *program;
    lg_space space;
    const void *run = (const char *)made->contents + recipe->file_run;
    if (recipe->space != NULL) LG_TRY(recipe->space(run, &space));
    LG_TRY(recipe->program(context, made->contents, NULL, &program, error));
    return lg_model_create(context, program, recipe->space != NULL ? &space : NULL, &made->model, error);
}

lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                        lg_model_file *out, lg_error *error) {
    char kind[KIND_TEXT];
    if (path == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name, the model a place");
    LG_TRY(lg_file_kind(context, path, options, kind, sizeof kind, error));
    lg_model_file made = {.context = context, .recipe = lg_recipe_find(kind)};
    if (made.recipe == NULL) return refuse(path, kind, error);
    made.contents = lg_alloc(context, 1, made.recipe->file_size);
    const lg_status status = load(context, path, options, &made, error);
    if (status == LG_OK)
        *out = made;
    else
        lg_model_file_destroy(&made);
    return status;
}

void lg_model_file_destroy(lg_model_file *file) {
    if (file == NULL) return;
    lg_model_destroy(file->model);
    if (file->contents != NULL) file->recipe->release(file->contents);
    lg_free(file->context, file->contents);
    memset(file, 0, sizeof *file);
}

const void *lg_model_file_of(const lg_model_file *file, const lg_recipe *recipe) {
    return file != NULL && file->recipe == recipe ? file->contents : NULL;
}

lg_status lg_model_file_program(const lg_model_file *file, const lg_scheme *scheme, lg_program **out,
                                lg_error *error) {
    LG_NEEDS(error, file, out);
    return file->recipe->program(file->context, file->contents, scheme, out, error);
}

const lg_scheme *lg_model_file_scheme(const lg_model_file *file) {
    return file->recipe->scheme != NULL ? file->recipe->scheme(file->contents) : NULL;
}

bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                         const double **values) {
    const lg_recipe *recipe = file->recipe;
    const char *at = file->contents;
    if (!recipe->slice(at + recipe->file_run, index, out)) return false;
    *values = *(double *const *)(const void *)(at + recipe->file_theta) + out->offset;
    return true;
}
