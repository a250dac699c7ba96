/* Loads a model file of any kind as one handle. */
#include <string.h>

#include "core/core.h"
#include "files/h5.h"
#include "model/files/program_file.h"
#include "model/files/recipe.h"
#include "model/internal.h"

/* ---- the recipes ---- */

/* Compile this file with -DLG_OWN_RECIPE=NAME to add a recipe of your own to the list. */
#ifdef LG_OWN_RECIPE
extern const lg_recipe LG_OWN_RECIPE;
#define OWN_ROW &LG_OWN_RECIPE,
#else
#define OWN_ROW
#endif

/* X(name) for each row lg_recipe_<name>. */
#define RECIPES(X)    X(hamiltonian) X(surrogate) X(detector) X(table) X(machine_model)
#define DECLARE(name) extern const lg_recipe lg_recipe_##name;
#define LIST(name)    &lg_recipe_##name,
RECIPES(DECLARE)
const lg_recipe *const lg_recipes[] = {RECIPES(LIST) OWN_ROW NULL};

const lg_recipe *lg_recipe_find(const char *name) {
    size_t i = 0;
    while (lg_recipes[i] != NULL && strcmp(lg_recipes[i]->name, name) != 0) i++;
    return lg_recipes[i];
}

/* ---- files that are no models ---- */

static lg_status refuse(const char *path, const char *kind, lg_error *error) {
    lg_name_list names = {.used = 0};
    const char *what = lg_h5_what_is(kind);
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++) {
        lg_name_list_add(&names, (*recipe)->name);
        if (strcmp((*recipe)->checkpoint, kind) == 0) what = "it is the checkpoint of an unfinished training";
    }
    return lg_fail(error, LG_FORMAT, "%s: attribute kind is '%s', expected %s or any kind with functions: %s",
                   lg_shown_path(path), kind, names.text, what);
}

/* ---- loading ---- */

/* What was read from a file: the contents as its recipe stores them, and the program if the file has
 * functions. moves: `space` is set. */
typedef struct reading {
    lg_model_file made;
    lg_program *program;
    lg_space space;
    bool moves;
} reading;

static void end_reading(reading *r) {
    lg_program_destroy(r->program);
    lg_model_file_destroy(&r->made);
}

static lg_status read_contents(reading *r, lg_h5 *h5, lg_error *error) {
    const lg_recipe *recipe = r->made.recipe;
    char *contents = r->made.contents = lg_alloc(h5->context, 1, recipe->file_size);
    if (contents == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a model");
    ((lg_model_head *)(void *)contents)->context = h5->context;
    LG_TRY(lg_run_get_file(h5, recipe, contents, error));
    r->moves = recipe->space != NULL;
    return r->moves ? recipe->space(contents + recipe->file_run, &r->space) : LG_OK;
}

/* Reads the space of a model whose kind has no recipe. */
static lg_status read_space(reading *r, lg_h5 *h5, lg_error *error) {
    char text[LG_SPACE_TEXT];
    lg_error why = {LG_OK, ""};
    r->moves = lg_h5_has(h5, "model") && lg_h5_has_attribute(h5, "model", "space");
    if (!r->moves) return LG_OK;
    LG_TRY(lg_as_format(lg_h5_text(h5, "model", "space", text, sizeof text, error), error));
    if (lg_space_read(lg_tamed(text), &r->space, &why) == LG_OK) return LG_OK;
    return lg_h5_fail(h5, error, "/model: attribute space: %s", why.message);
}

static lg_status read_model(void *user, lg_h5 *h5, lg_error *error) {
    reading *r = user;
    char kind[LG_H5_KIND];
    LG_TRY(lg_h5_kind(h5, kind, error));
    r->made.recipe = lg_recipe_find(kind);
    const bool functions = lg_h5_has(h5, "functions");
    if (r->made.recipe == NULL && (!functions || kind[0] == '\0')) return refuse(h5->path, kind, error);
    LG_TRY(r->made.recipe != NULL ? read_contents(r, h5, error) : read_space(r, h5, error));
    return functions ? lg_program_get(h5, &r->program, error) : LG_OK;
}

/* A model that was written by hand may have no functions; then the recipe makes the program. */
static lg_status make_model(reading *r, const char *path, lg_error *error) {
    lg_model_file *made = &r->made;
    lg_error why = {LG_OK, ""};
    if (r->program == NULL)
        LG_TRY(made->recipe->program(made->context, made->contents, NULL, &r->program, error));
    lg_program *program = r->program;
    r->program = NULL; /* lg_model_create takes ownership */
    const lg_status status =
        lg_model_create(made->context, program, r->moves ? &r->space : NULL, &made->model, &why);
    if (status == LG_OK) return LG_OK;
    (void)lg_fail(error, status, "%s: %s", lg_shown_path(path), why.message);
    return lg_as_format(status, error);
}

lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                        lg_model_file *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(end_reading) reading r = {.made.context = context};
    LG_TRY(lg_h5_read(context, path, options, read_model, &r, error));
    LG_TRY(make_model(&r, path, error));
    return LG_GIVE(out, r.made);
}

void lg_model_file_destroy(lg_model_file *file) {
    if (file == NULL) return;
    lg_model_destroy(file->model);
    if (file->contents != NULL) lg_recipe_release(file->recipe, file->contents);
    lg_free(file->context, file->contents);
    memset(file, 0, sizeof *file);
}

const void *lg_model_file_of(const lg_model_file *file, const lg_recipe *recipe) {
    return file != NULL && file->recipe == recipe ? file->contents : NULL;
}

/* Whether the recipe makes the program with its steps; else steps are made from the field in the file. */
static bool has_steps(const lg_model_file *file) {
    return file->recipe != NULL && file->recipe->program != NULL &&
           (file->recipe->scheme != NULL || lg_model_space(file->model) == NULL);
}

lg_status lg_model_file_program(const lg_model_file *file, const lg_scheme *scheme, lg_program **out,
                                lg_error *error) {
    LG_NEEDS(error, file, out);
    if (!has_steps(file)) return lg_model_copy_program(file->model, scheme, out, error);
    return file->recipe->program(file->context, file->contents, scheme, out, error);
}

const lg_scheme *lg_model_file_scheme(const lg_model_file *file) {
    if (!has_steps(file)) return lg_model_usual_scheme(file->model);
    return file->recipe->scheme != NULL ? file->recipe->scheme(file->contents) : NULL;
}

bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                         const double **values) {
    const lg_recipe *recipe = file->recipe;
    const char *at = file->contents;
    if (recipe == NULL || !recipe->slice(at + recipe->file_run, index, out)) return false;
    *values = ((const lg_model_head *)file->contents)->theta + out->offset;
    return true;
}
