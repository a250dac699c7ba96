/* Internals of lg_model_*: the handle. */
#ifndef LG_MODELS_MODEL_INTERNAL_H
#define LG_MODELS_MODEL_INTERNAL_H

#include "liegrad/model.h"

typedef enum lg_model_function {
    LG_MODEL_VALUE,
    LG_MODEL_GRADIENT,
    LG_MODEL_FIELD,
    LG_MODEL_FORCE,
    LG_MODEL_DRIFT,
    LG_MODEL_LINEAR, /* Jacobian of y' in the state and in the input */
    LG_MODEL_FUNCTIONS
} lg_model_function;

struct lg_model {
    const lg_context *context;
    lg_model_kind kind;
    size_t parameters, inputs, outputs;
    size_t work, plan_work;            /* bytes: in all; of the plans, at the beginning of the work */
    lg_plan *plan[LG_MODEL_FUNCTIONS]; /* NULL: the model has no such function */
    lg_hamiltonian hamiltonian;        /* LG_MODEL_HAMILTONIAN */
};

/* x and y: arrays of the function's inputs and outputs; an output that is not wanted is NULL. */
void lg_model_run(const lg_model *model, lg_model_function function, const double *const *x, double *const *y,
                  void *work);
/* Bytes that a Hamiltonian's functions need in addition to the plans' work. */
size_t lg_model_linear_work_size(const lg_model *model);
/* Zeros for an input that is NULL. */
const double *lg_model_no_input(const lg_model *model, void *work);

#endif
