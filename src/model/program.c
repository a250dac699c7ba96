/* The program of a model whose kind has no recipe: a copy, with a step added. */
#include "autodiff/program/program.h"
#include "liegrad/program.h"
#include "liegrad/taped.h"
#include "model/internal.h"

static bool has(const lg_program *program, const char *function) {
    return lg_program_find(program, function, &(size_t){0}, NULL) == LG_OK;
}

const lg_scheme *lg_model_usual_scheme(const lg_model *model) {
    if (!lg_model_moves(model) || has(model->program, "step")) return NULL;
    return lg_scheme_find(lg_space_is_abelian(&model->space) ? "rk4" : "cf4");
}

/* ---- the copy ---- */

static lg_status copy_functions(const lg_program *from, lg_program *to, lg_error *error) {
    for (size_t i = 0; i < lg_program_functions(from); i++) {
        LG_CLEAN(lg_function_image_destroy_at) lg_function_image *image = NULL;
        const lg_status status = lg_function_image_create(from, i, &image);
        if (status != LG_OK) return lg_fail(error, status, "no memory for a function");
        LG_TRY(lg_program_add_image(to, image, error));
    }
    return LG_OK;
}

lg_status lg_model_copy_program(const lg_model *model, const lg_scheme *scheme, lg_program **out,
                                lg_error *error) {
    const lg_program *from = model->program;
    const bool own = has(from, "step");
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    if (own && scheme != NULL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the file has a function 'step', so no other scheme can be chosen");
    LG_TRY(lg_program_bare(from, &made, error));
    LG_TRY(copy_functions(from, made, error));
    if (lg_model_moves(model) && !own)
        LG_TRY(lg_program_add_step(
            made, &model->space, scheme != NULL ? scheme : lg_model_usual_scheme(model), 0.001, 0.05, error));
    return LG_MOVE(out, made);
}
