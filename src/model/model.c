/* Models in a loop: one handle for the plans of the functions of a bundle. */
#include "liegrad/model.h"

#include "core/core.h"
#include "hamiltonian/internal.h"
#include "machine/internal.h"
#include "model/internal.h"

/* ---- functions ---- */

static const char *const function_names[LG_MODEL_FUNCTIONS] = {
    [LG_MODEL_VALUE] = "value",   [LG_MODEL_GRADIENT] = "grad",         [LG_MODEL_FIELD] = "field",
    [LG_MODEL_FORCE] = "force",   [LG_MODEL_DRIFT] = "drift",           [LG_MODEL_LINEAR] = "jac_velocity",
    [LG_MODEL_STATE] = "momenta", [LG_MODEL_VELOCITIES] = "velocities", [LG_MODEL_POSITIONS] = "positions",
};

/* Makes plans of the functions that the bundle has, and finds the largest work. */
static lg_status make_plans(lg_model *model, const lg_program *bundle, lg_error *error) {
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.mark_unfit = true;
    for (size_t i = 0; i < LG_MODEL_FUNCTIONS; i++) {
        size_t function;
        if (lg_program_find(bundle, function_names[i], &function) != LG_OK) continue;
        LG_TRY(lg_plan_create(bundle, function, &options, &model->plan[i], error));
        const size_t bytes = lg_plan_work_size(model->plan[i]);
        if (bytes > model->plan_work) model->plan_work = bytes;
    }
    return LG_OK;
}

/* Makes a model from a bundle with value and grad, and destroys the bundle. `space`: NULL for what does not
 * move. */
static lg_status create(const lg_context *context, const lg_space *space,
                        lg_program *bundle, lg_model **out, lg_error *error) {
    lg_model *made = lg_alloc(context, 1, sizeof *made);
    lg_status status = LG_OUT_OF_MEMORY;
    if (made == NULL) {
        (void)lg_fail(error, status, "no memory for a model");
    } else {
        *made = (lg_model){.context = context};
        if (space != NULL) made->space = *space;
        status = make_plans(made, bundle, error);
    }
    if (status == LG_OK) {
        if (lg_program_parameters(bundle) > 0)
            made->parameters = lg_shape_count(lg_program_parameter(bundle, 0).shape);
        made->inputs = lg_plan_input_count(made->plan[LG_MODEL_VALUE], 0);
        made->outputs = lg_plan_output_count(made->plan[LG_MODEL_VALUE], 0);
        made->work = made->plan_work + lg_model_linear_work_size(made);
        *out = made;
    } else {
        lg_model_destroy(made);
    }
    lg_program_destroy(bundle);
    return status;
}

lg_status lg_model_create_hamiltonian(const lg_context *context, const lg_hamiltonian *hamiltonian,
                                      const double *theta, lg_model **out, lg_error *error) {
    LG_NEEDS(error, hamiltonian, theta, out);
    lg_program *bundle;
    lg_space space;
    LG_TRY(lg_hamiltonian_space(hamiltonian->family, hamiltonian->n, &space));
    LG_TRY(lg_hamiltonian_bundle(context, hamiltonian, theta, &bundle, error));
    return create(context, &space, bundle, out, error);
}

lg_status lg_model_create_machine(const lg_context *context, const lg_machine *machine, const double *theta,
                                  lg_model **out, lg_error *error) {
    LG_NEEDS(error, machine, out);
    lg_program *bundle;
    lg_space space;
    LG_TRY(lg_machine_space(machine, &space));
    LG_TRY(lg_machine_bundle(context, machine, theta, &bundle, error));
    return create(context, &space, bundle, out, error);
}

lg_status lg_model_create_surrogate(const lg_context *context, const lg_surrogate *surrogate,
                                    const double *theta, lg_model **out, lg_error *error) {
    LG_NEEDS(error, surrogate, theta, out);
    lg_program *bundle;
    LG_TRY(lg_surrogate_program(context, surrogate, theta, &bundle, error));
    return create(context, NULL, bundle, out, error);
}

lg_status lg_model_create_detector(const lg_context *context, const lg_detector *detector,
                                   const lg_scaler *scaler, const double *theta, lg_model **out,
                                   lg_error *error) {
    LG_NEEDS(error, detector, scaler, theta, out);
    lg_program *bundle;
    LG_TRY(lg_detector_program(context, detector, scaler, theta, &bundle, error));
    return create(context, NULL, bundle, out, error);
}

lg_status lg_model_create_table(const lg_context *context, const lg_table *table, const lg_scaler *inputs,
                                const lg_scaler *outputs, const double *theta, lg_model **out,
                                lg_error *error) {
    LG_NEEDS(error, table, inputs, theta, out);
    lg_program *bundle;
    LG_TRY(lg_table_program(context, table, inputs, outputs, theta, &bundle, error));
    return create(context, NULL, bundle, out, error);
}

void lg_model_destroy(lg_model *model) {
    if (model == NULL) return;
    for (size_t i = 0; i < LG_MODEL_FUNCTIONS; i++) lg_plan_destroy(model->plan[i]);
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

/* ---- value and Jacobian ---- */

void lg_model_run(const lg_model *model, lg_model_function function, const double *const *x, double *const *y,
                  void *work) {
    lg_plan_eval(model->plan[function], (const void *const *)x, (void *const *)y, work);
}

void lg_model_eval(const lg_model *model, const double *x, double *y, void *work) {
    lg_model_run(model, LG_MODEL_VALUE, &x, &y, work);
}

void lg_model_jacobian(const lg_model *model, const double *x, double *y, double *jacobian, void *work) {
    double *const out[] = {y, jacobian};
    lg_model_run(model, LG_MODEL_GRADIENT, &x, out, work);
}
