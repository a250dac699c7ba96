#include "controller.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "plant.h"

static const double damping_ratio = 0.9;

static bool refuse(char *why, const char *sentence) {
    (void)snprintf(why, 256, "%s", sentence);
    return false;
}

/* Computes the inverse of the map from torques to p' at the set point. */
static bool find_map(controller *self) {
    double B[TANGENT * TORQUE];
    return lg_model_linearise(self->model, self->target, NULL, NULL, B, NULL, self->work) == LG_OK &&
           invert3(B + 3 * TORQUE, self->inverse_map);
}

bool controller_init(controller *self, const lg_model *model, void *work, const double *Rd, double frequency,
                     double torque_max, char *why) {
    const double rest[3] = {0.0, 0.0, 0.0};
    if (lg_model_inputs(model) != STATE || lg_model_tangent_dim(model) != TANGENT ||
        lg_model_input_dim(model) != TORQUE)
        return refuse(why, "the model is not a machine of one rotation with three inputs");
    *self = (controller){.model = model,
                         .work = work,
                         .stiffness = frequency * frequency,
                         .damping = 2.0 * damping_ratio * frequency,
                         .torque_max = torque_max};
    if (lg_model_machine_state(model, Rd, rest, self->target, work) != LG_OK || !find_map(self))
        return refuse(why, "the learned inputs do not move the body about all axes");
    return true;
}

/* Computes the moment B u, the change of p' that is needed for the angular acceleration alpha. */
static bool missing(controller *self, const double *R, const double *Omega, double *moment) {
    double state[STATE], wanted[STATE], field[TANGENT], c[TANGENT], alpha[3];
    if (lg_model_machine_state(self->model, R, Omega, state, self->work) != LG_OK ||
        lg_model_deviation(self->model, self->target, state, c, self->work) != LG_OK ||
        lg_model_field(self->model, state, NULL, field, self->work) != LG_OK)
        return false;
    memcpy(self->error, c, sizeof self->error);
    for (int i = 0; i < 3; i++) alpha[i] = -self->stiffness * c[i] - self->damping * Omega[i];
    /* The machine state with velocity alpha has the momentum M alpha. */
    if (lg_model_machine_state(self->model, R, alpha, wanted, self->work) != LG_OK) return false;
    for (int i = 0; i < 3; i++) moment[i] = wanted[MOMENTUM + i] - field[3 + i];
    return true;
}

void controller_step(controller *self, const double *R, const double *Omega, double *torque) {
    double moment[3], square = 0.0;
    const bool good = missing(self, R, Omega, moment);
    for (int i = 0; i < TORQUE; i++) {
        torque[i] = 0.0;
        for (int j = 0; j < 3; j++) torque[i] += self->inverse_map[3 * i + j] * moment[j];
        square += torque[i] * torque[i];
    }
    const double size = sqrt(square);
    /* A NaN must not reach the motor. */
    const double factor = !good || !isfinite(size)  ? 0.0
                          : size > self->torque_max ? self->torque_max * (1.0 - 1e-15) / size
                                                    : 1.0;
    for (int i = 0; i < TORQUE; i++) torque[i] = factor > 0.0 ? factor * torque[i] : 0.0;
}
