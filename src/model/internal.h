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

/* Where the states of a model that moves are, and coordinates c of the tangent space at one of them. */
typedef struct lg_model_motion {
    bool moves;
    lg_space space;
    size_t forces, tangent; /* numbers of an input and of c */
    /* Columns of directions (dim, tangent), and c of a vector (dim). */
    void (*basis)(const lg_model *model, const double *state, double *basis);
    void (*coordinates)(const lg_model *model, const double *state, const double *vector, double *c);
    const lg_hamiltonian_family *family; /* of Hamiltonians */
    uint32_t copies;
} lg_model_motion;

struct lg_model {
    const lg_context *context;
    size_t parameters, inputs, outputs;
    size_t work, plan_work;            /* bytes: in all; of the plans, at the beginning of the work */
    lg_plan *plan[LG_MODEL_FUNCTIONS]; /* NULL: the model has no such function */
    lg_model_motion motion;
};

static inline bool lg_model_moves(const lg_model *model) {
    return model != NULL && model->motion.moves;
}

/* Of a Hamiltonian, and of a machine on its product space. */
lg_status lg_model_hamiltonian_motion(const lg_hamiltonian *hamiltonian, lg_model_motion *out);
lg_status lg_model_machine_motion(const lg_machine *machine, lg_model_motion *out);

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
/* The algebra element (algebra_dim) whose generator at `state` is `vector` (d), tangent there.
 * LG_UNSUPPORTED: a factor of the space has none. */
lg_status lg_space_lift(const lg_space *space, const double *state, const double *vector, double *algebra);
/* Pushes the columns of x (d, columns), vectors at a state, by exp(algebra), in place; `column`: d
 * numbers. */
void lg_space_push(const lg_space *space, const double *algebra, size_t columns, double *x, double *column);
/* Zeros for an input that is NULL. */
const double *lg_model_no_input(const lg_model *model, void *work);

#endif
