/* Models in a control loop: a program, and plans of its functions. */
#include "liegrad/model.h"

#include "autodiff/program/program.h"
#include "core/clean.h"
#include "integrators/taped_internal.h"
#include "model/internal.h"

LG_AT(lg_model_destroy, lg_model)

/* ---- functions ---- */

static const char *const function_names[LG_MODEL_FUNCTIONS] = {
    [LG_MODEL_VALUE] = "value",   [LG_MODEL_GRADIENT] = "grad",         [LG_MODEL_FIELD] = "field",
    [LG_MODEL_FORCE] = "force",   [LG_MODEL_DRIFT] = "drift",           [LG_MODEL_LINEAR] = "jac_velocity",
    [LG_MODEL_STATE] = "momenta", [LG_MODEL_VELOCITIES] = "velocities", [LG_MODEL_POSITIONS] = "positions",
};

/* Makes plans of the functions that the program has, and finds the largest work memory. */
static lg_status make_plans(lg_model *model, lg_error *error) {
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.mark_unfit = true;
    for (size_t i = 0; i < LG_MODEL_FUNCTIONS; i++) {
        if (lg_program_find(model->program, function_names[i], &(size_t){0}, NULL) != LG_OK) continue;
        LG_TRY(lg_model_find(model, function_names[i], &options, &model->plan[i], error));
        const size_t bytes = lg_plan_work_size(model->plan[i]);
        if (bytes > model->plan_work) model->plan_work = bytes;
    }
    return LG_OK;
}

/* ---- checks that the functions fit together ---- */

/* How many numbers a port has: D as x, U as the input u, HALF D/2, Y as y, YD and DD and DU as Jacobians, A
 * as an algebra element, Q and V as positions and velocities in a log. */
enum { NONE, D, U, HALF, Y, YD, A, DD, DU, Q, V, SIZES };

static const struct {
    unsigned char in[3], out[3];
} ports[LG_MODEL_FUNCTIONS] = {
    [LG_MODEL_VALUE] = {{D}, {Y}},       [LG_MODEL_GRADIENT] = {{D}, {Y, YD}},
    [LG_MODEL_FIELD] = {{D, U}, {A}},    [LG_MODEL_FORCE] = {{HALF, U}, {HALF}},
    [LG_MODEL_DRIFT] = {{HALF}, {HALF}}, [LG_MODEL_LINEAR] = {{D, U}, {DD, DU}},
    [LG_MODEL_STATE] = {{Q, V}, {D}},    [LG_MODEL_VELOCITIES] = {{D}, {V}},
    [LG_MODEL_POSITIONS] = {{D}, {Q}},
};

static size_t outputs_of(const lg_plan *plan) {
    return plan != NULL ? lg_plan_output_count(plan, 0) : 0;
}

static lg_status check_function(const lg_model *model, lg_model_function function, const size_t *sizes,
                                lg_error *error) {
    const lg_plan *plan = model->plan[function];
    for (size_t i = 0; i < 3; i++) {
        const size_t in = lg_plan_input_count(plan, i), out = lg_plan_output_count(plan, i);
        if (in != sizes[ports[function].in[i]] || out != sizes[ports[function].out[i]])
            return lg_fail(error, LG_SHAPE,
                           "function %s: input %zu has %zu numbers and output %zu has %zu, but the other "
                           "functions and the space need %zu and %zu",
                           function_names[function], i + 1, in, i + 1, out, sizes[ports[function].in[i]],
                           sizes[ports[function].out[i]]);
    }
    return LG_OK;
}

static lg_status check_state(const lg_model *model, size_t numbers, lg_error *error) {
    if (numbers == model->space.dim) return LG_OK;
    return lg_fail(error, LG_SHAPE, "the state has %zu numbers, but the space needs %zu", numbers,
                   model->space.dim);
}

static lg_status check_functions(const lg_model *model, lg_error *error) {
    const size_t d = model->inputs, y = model->outputs, m = lg_model_input_dim(model),
                 q = outputs_of(model->plan[LG_MODEL_POSITIONS]),
                 v = outputs_of(model->plan[LG_MODEL_VELOCITIES]);
    const size_t sizes[SIZES] = {
        [D] = d,      [U] = m,      [HALF] = d / 2, [Y] = y, [YD] = y * d, [A] = model->space.algebra_dim,
        [DD] = d * d, [DU] = d * m, [Q] = q,        [V] = v};
    if (lg_model_moves(model)) LG_TRY(check_state(model, d, error));
    for (size_t i = 0; i < LG_MODEL_FUNCTIONS; i++)
        if (model->plan[i] != NULL) LG_TRY(check_function(model, (lg_model_function)i, sizes, error));
    return LG_OK;
}

/* ---- the handle ---- */

static lg_status complete(lg_model *made, lg_error *error) {
    if (lg_model_moves(made)) {
        size_t field, count;
        if (lg_program_find(made->program, "field", &field, NULL) != LG_OK)
            return lg_fail(error, LG_NOT_FOUND, "the model has a space, but no function 'field'");
        const lg_port *in = lg_program_inputs(made->program, field, &count);
        LG_TRY(check_state(made, lg_shape_count(in[0].shape), error));
        LG_TRY(lg_program_add_velocity(made->program, &made->space, error));
    }
    LG_TRY(make_plans(made, error));
    const lg_plan *value = made->plan[LG_MODEL_VALUE], *field = made->plan[LG_MODEL_FIELD];
    if (value == NULL && field == NULL)
        return lg_fail(
            error, LG_NOT_FOUND,
            "the program has neither a function 'value' nor a function 'field': it is not a model, "
            "but lg_program_load can load it");
    if (lg_program_parameters(made->program) > 0)
        made->parameters = lg_shape_count(lg_program_parameter(made->program, 0).shape);
    made->inputs = lg_plan_input_count(value != NULL ? value : field, 0);
    made->outputs = outputs_of(value);
    LG_TRY(check_functions(made, error));
    made->work = made->plan_work + lg_model_linear_work_size(made);
    return LG_OK;
}

lg_status lg_model_create(const lg_context *context, lg_program *program, const lg_space *space,
                          lg_model **out, lg_error *error) {
    LG_NEEDS(error, program, out);
    LG_CLEAN(lg_model_destroy_at) lg_model *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) {
        lg_program_destroy(program);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a model");
    }
    *made = (lg_model){.context = context, .program = program};
    if (space != NULL) made->space = *space;
    LG_TRY(complete(made, error));
    return LG_MOVE(out, made);
}

lg_status lg_model_find(const lg_model *model, const char *function, const lg_plan_options *options,
                        lg_plan **out, lg_error *error) {
    LG_NEEDS(error, model, function, out);
    size_t at;
    LG_TRY(lg_program_find(model->program, function, &at, error));
    return lg_plan_create(model->program, at, options, out, error);
}

const lg_program *lg_model_program(const lg_model *model) {
    return model->program;
}

void lg_model_destroy(lg_model *model) {
    if (model == NULL) return;
    for (size_t i = 0; i < LG_MODEL_FUNCTIONS; i++) lg_plan_destroy(model->plan[i]);
    lg_program_destroy(model->program);
    lg_free(model->context, model);
}

/* ---- sizes ---- */

const lg_space *lg_model_space(const lg_model *model) {
    return lg_model_moves(model) ? &model->space : NULL;
}

size_t lg_model_parameters(const lg_model *model) {
    return model != NULL ? model->parameters : 0;
}

size_t lg_model_inputs(const lg_model *model) {
    return model != NULL ? model->inputs : 0;
}

size_t lg_model_outputs(const lg_model *model) {
    return model != NULL ? model->outputs : 0;
}

size_t lg_model_work_size(const lg_model *model) {
    return model != NULL ? model->work : 0;
}
