/* The handle behind lg_model_*, and functions that its files share. */
#ifndef LG_MODELS_MODEL_INTERNAL_H
#define LG_MODELS_MODEL_INTERNAL_H

#include "liegrad/model.h"

typedef enum lg_model_function {
    LG_MODEL_VALUE,
    LG_MODEL_GRADIENT,
    LG_MODEL_FIELD,
    LG_MODEL_FORCE,
    LG_MODEL_DRIFT,
    LG_MODEL_LINEAR, /* jac_velocity: Jacobians of y' with respect to state and input */
    LG_MODEL_STATE,  /* momenta: state of a machine from positions and velocities in the order of a log */
    LG_MODEL_VELOCITIES,
    LG_MODEL_POSITIONS,
    LG_MODEL_FUNCTIONS
} lg_model_function;

struct lg_model {
    const lg_context *context;
    lg_program *program;
    size_t parameters, inputs, outputs;
    size_t work, plan_work;            /* bytes of work: in all; for the plans, at its beginning */
    lg_plan *plan[LG_MODEL_FUNCTIONS]; /* NULL: the program has no such function */
    lg_space space;                    /* of the states; without factors if the model does not move */
};

static inline bool lg_model_moves(const lg_model *model) {
    return model != NULL && model->space.factors > 0;
}

/* Runs a function on arrays of its inputs and outputs; y[i] may be NULL if output i is not wanted. */
void lg_model_run(const lg_model *model, lg_model_function function, const double *const *x, double *const *y,
                  void *work);
/* Bytes of work, behind the plans' work, that the functions of a moving model need. */
size_t lg_model_linear_work_size(const lg_model *model);
/* out (r, columns): the tangent coordinates at `state` of the columns of `matrix` (d, columns). `vector` is
 * scratch of d + r numbers. */
void lg_model_coordinates(const lg_model *model, const double *state, const double *matrix, size_t columns,
                          double *vector, double *out);
/* c (r): tangent coordinates of the velocity y' at (state, input); input may be NULL, which is zero. */
void lg_model_drift(const lg_model *model, const double *state, const double *input, double *c, void *work);
/* The velocity y' (d), and its Jacobian (d, d) by the state, in ambient coordinates. Either may be NULL. */
void lg_model_velocity(const lg_model *model, const double *state, const double *input, double *velocity,
                       double *jacobian, void *work);
/* Copies the model's program; exported because liegrad_io uses it. If the model moves and has no function
 * `step` (x, u, h -> next), the copy gets a step of `scheme`; NULL takes lg_model_usual_scheme. Errors:
 * LG_UNSUPPORTED (a scheme is asked for, but the program has its own step), and errors of recording. */
LG_API lg_status lg_model_copy_program(const lg_model *model, const lg_scheme *scheme, lg_program **out,
                                       lg_error *error);
/* The scheme of the step that lg_model_copy_program adds by default; NULL: it adds no step. */
LG_API const lg_scheme *lg_model_usual_scheme(const lg_model *model);
/* The input or, for callers that pass NULL, an input of zeros (m), in `work`. */
const double *lg_model_input(const lg_model *model, const double *input, void *work);

#endif
