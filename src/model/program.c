/* The program of a model whose kind has no recipe: a copy, with a step added. */
#include "autodiff/program/program.h"
#include "core/core.h"
#include "integrators/taped_internal.h"
#include "liegrad/program.h"
#include "model/internal.h"

/* ---- the step: its right-hand sides call functions of the program ---- */

typedef struct recording {
    const lg_space *space;
    const lg_scheme *scheme;
    size_t inputs;  /* number of inputs of the field: x, u or x only */
    bool separable; /* the program has force and drift */
} recording;

static lg_status call_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                            lg_var *algebra) {
    const recording *r = user;
    const lg_var in[2] = {lg_taped_join(tape, r->space, y), input};
    (void)t;
    return lg_taped_split_algebra(tape, r->space, lg_program_call(tape, "field", 0, in), algebra);
}

static lg_status call_force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input, lg_var *out) {
    const lg_var in[2] = {q, input};
    (void)user, (void)t;
    *out = lg_program_call(tape, "force", 0, in);
    return lg_tape_status(tape);
}

static lg_status call_drift(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input, lg_var *out) {
    (void)user, (void)t, (void)input;
    *out = lg_program_call(tape, "drift", 0, &p);
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const lg_taped_ode ode = {.space = *r->space,
                              .field = call_field,
                              .force = r->separable ? call_force : NULL,
                              .velocity = r->separable ? call_drift : NULL,
                              .user = user};
    const lg_taped_interval over = {.h_rows = x[r->inputs], .input = r->inputs > 1 ? x[1] : LG_NONE};
    lg_var parts[LG_TAPED_MAX_PARTS];
    (void)theta;
    LG_TRY(lg_taped_split(tape, r->space, x[0], parts));
    LG_TRY(lg_taped_step_over(tape, r->scheme, &ode, &over, parts, parts));
    y[0] = lg_taped_join(tape, r->space, parts);
    return lg_tape_status(tape);
}

static bool has(const lg_program *program, const char *function) {
    return lg_program_find(program, function, &(size_t){0}) == LG_OK;
}

static lg_status add_step(const lg_model *model, const lg_scheme *scheme, lg_program *program,
                          lg_error *error) {
    size_t field, count;
    (void)lg_program_find(program, "field", &field);
    const lg_port *of_field = lg_program_inputs(program, field, &count);
    recording r = {.space = &model->space,
                   .scheme = scheme != NULL ? scheme : lg_model_usual_scheme(model),
                   .inputs = count,
                   .separable = has(program, "force") && has(program, "drift")};
    const lg_port h = {.name = "h", .shape = lg_shape1(1), .low = 0.001, .high = 0.05},
                  next = {.name = "next"};
    lg_port in[3] = {of_field[0], count > 1 ? of_field[1] : h, h};
    const lg_function_spec spec = {"step", in, count + 1, &next, 1, step, &r};
    return lg_program_record_function(program, &spec, false, error);
}

const lg_scheme *lg_model_usual_scheme(const lg_model *model) {
    if (!lg_model_moves(model) || has(model->program, "step")) return NULL;
    return lg_scheme_find(lg_space_is_abelian(&model->space) ? "rk4" : "cf4");
}

/* ---- the copy ---- */

static lg_status copy_functions(const lg_program *from, lg_program *to, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_functions(from) && status == LG_OK; i++) {
        lg_function_image *image;
        status = lg_function_image_create(from, i, &image);
        if (status != LG_OK) return lg_fail(error, status, "no memory for a function");
        status = lg_program_add_image(to, image, error);
        lg_function_image_destroy(image);
    }
    return status;
}

static lg_status copy_parameters(const lg_program *from, lg_program *to, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < lg_program_parameters(from) && status == LG_OK; i++) {
        const lg_parameter_spec p = lg_program_parameter(from, i);
        status = lg_program_add_parameter(to, &p, error);
    }
    return status;
}

lg_status lg_model_copy_program(const lg_model *model, const lg_scheme *scheme, lg_program **out,
                                lg_error *error) {
    const lg_program *from = model->program;
    const bool own = has(from, "step");
    lg_program_spec spec;
    lg_program *made;
    if (own && scheme != NULL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the file has a function 'step', so no other scheme can be chosen");
    lg_program_spec_init(&spec);
    spec.description = lg_program_description(from);
    LG_TRY(lg_program_begin(model->context, &spec, &made, error));
    lg_status status = copy_parameters(from, made, error);
    if (status == LG_OK) status = copy_functions(from, made, error);
    if (status == LG_OK && lg_model_moves(model) && !own) status = add_step(model, scheme, made, error);
    if (status == LG_OK)
        *out = made;
    else
        lg_program_destroy(made);
    return status;
}
