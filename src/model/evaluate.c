/* Models in a control loop: runs plans of functions; value and Jacobian. */
#include "model/internal.h"

size_t lg_model_input_dim(const lg_model *model) {
    return lg_model_moves(model) ? lg_plan_input_count(model->plan[LG_MODEL_FIELD], 1) : 0;
}

void lg_model_run(const lg_model *model, lg_model_function function, const double *const *x, double *const *y,
                  void *work) {
    lg_plan_eval(model->plan[function], (const void *const *)x, (void *const *)y, work);
}

void lg_model_eval(const lg_model *model, const double *x, double *y, void *work) {
    if (model->plan[LG_MODEL_VALUE] != NULL) lg_model_run(model, LG_MODEL_VALUE, &x, &y, work);
}

void lg_model_jacobian(const lg_model *model, const double *x, double *y, double *jacobian, void *work) {
    double *const out[] = {y, jacobian};
    if (model->plan[LG_MODEL_GRADIENT] != NULL) lg_model_run(model, LG_MODEL_GRADIENT, &x, out, work);
}
