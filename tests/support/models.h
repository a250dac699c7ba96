/* Makes models from descriptions and parameters, for tests. */
#ifndef LG_TEST_MODELS_H
#define LG_TEST_MODELS_H

#include "liegrad/anomaly.h"
#include "liegrad/elastica.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/machine.h"
#include "liegrad/model.h"
#include "liegrad/table.h"

/* A model and its work memory, as the argument `user` of test_slope. */
typedef struct model_value {
    const lg_model *model;
    void *work;
} model_value;

static inline void model_value_at(const void *of, const double *x, double *y) {
    const model_value *v = of;
    lg_model_eval(v->model, x, y, v->work);
}

static inline lg_status test_hamiltonian_model(const lg_context *context, const lg_hamiltonian *model,
                                               const double *theta, lg_model **out, lg_error *error) {
    lg_program *program;
    lg_space space;
    lg_status status = lg_hamiltonian_space(model->family, model->n, &space);
    if (status == LG_OK) status = lg_hamiltonian_program(context, model, theta, NULL, &program, error);
    return status == LG_OK ? lg_model_create(context, program, &space, out, error) : status;
}

static inline lg_status test_machine_model(const lg_context *context, const lg_machine *machine,
                                           const double *theta, lg_model **out, lg_error *error) {
    lg_program *program;
    lg_space space;
    lg_status status = lg_machine_full_space(machine, &space);
    if (status == LG_OK) status = lg_machine_program(context, machine, theta, NULL, false, &program, error);
    return status == LG_OK ? lg_model_create(context, program, &space, out, error) : status;
}

static inline lg_status test_surrogate_model(const lg_context *context, const lg_surrogate *model,
                                             const double *theta, lg_model **out, lg_error *error) {
    lg_program *program;
    const lg_status status = lg_surrogate_program(context, model, theta, &program, error);
    return status == LG_OK ? lg_model_create(context, program, NULL, out, error) : status;
}

static inline lg_status test_detector_model(const lg_context *context, const lg_detector *model,
                                            const lg_scaler *scaler, const double *theta, lg_model **out,
                                            lg_error *error) {
    lg_program *program;
    const lg_status status = lg_detector_program(context, model, scaler, theta, &program, error);
    return status == LG_OK ? lg_model_create(context, program, NULL, out, error) : status;
}

static inline lg_status test_table_model(const lg_context *context, const lg_table *model,
                                         const lg_scaler *inputs, const lg_scaler *outputs,
                                         const double *theta, lg_model **out, lg_error *error) {
    lg_program *program;
    const lg_status status = lg_table_program(context, model, inputs, outputs, theta, &program, error);
    return status == LG_OK ? lg_model_create(context, program, NULL, out, error) : status;
}

#endif
