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
    LG_MODEL_STATE,  /* of machines, from positions and velocities in the order of logs */
    LG_MODEL_VELOCITIES,
    LG_MODEL_POSITIONS,
    LG_MODEL_FUNCTIONS
} lg_model_function;

struct lg_model {
    const lg_context *context;
    lg_program *program;
    size_t parameters, inputs, outputs;
    size_t work, plan_work;            /* bytes: in all; of the plans, at the beginning of the work */
    lg_plan *plan[LG_MODEL_FUNCTIONS]; /* NULL: the model has no such function */
    lg_space space;                    /* of the states; without factors: the model does not move */
};

static inline bool lg_model_moves(const lg_model *model) {
    return model != NULL && model->space.factors > 0;
}

/* x and y: arrays of the function's inputs and outputs; an output that is not wanted is NULL. */
void lg_model_run(const lg_model *model, lg_model_function function, const double *const *x, double *const *y,
                  void *work);
/* Bytes that the functions of what moves need in addition to the plans' work. */
size_t lg_model_linear_work_size(const lg_model *model);
/* Coordinates c' (r) of the velocity at (state, input); input may be NULL. */
void lg_model_drift(const lg_model *model, const double *state, const double *input, double *c, void *work);
/* y', and its Jacobian (d, d) in the state y, in ambient coordinates. */
void lg_model_velocity(const lg_model *model, const double *state, const double *input, double *velocity,
                       double *jacobian, void *work);
/* For liegrad_io, therefore exported: a copy of the model's program. Where the model moves and has no
 * function `step` (x, u, h -> next), the copy gets one of `scheme`, NULL: the usual one of the space. Errors:
 * LG_UNSUPPORTED (a scheme is asked for and the program has its own step), and errors of recording. */
LG_API lg_status lg_model_copy_program(const lg_model *model, const lg_scheme *scheme, lg_program **out,
                                       lg_error *error);
/* The scheme of the step that a copy gets unless another one is asked for; NULL: it gets none. */
LG_API const lg_scheme *lg_model_usual_scheme(const lg_model *model);
/* Zeros for an input that is NULL. */
const double *lg_model_no_input(const lg_model *model, void *work);

#endif
