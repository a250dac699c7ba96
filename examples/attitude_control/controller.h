/* Holds an attitude with a learned machine: geometric feedback on SO(3) that compensates inertia, gravity and
 * damping as the machine has learned them.
 *
 *     e_R = 1/2 vee(Rd^T R - R^T Rd), e_Omega = Omega (the set point is at rest)
 *     B u = M alpha - p'(R, Omega, u = 0),   alpha = -stiffness e_R - damping e_Omega
 *
 * If the machine is right, Omega' = alpha, and W = stiffness tr(I - Rd^T R)/2 + |Omega|^2/2 decreases at the
 * rate damping |Omega|^2. Then every start ends at Rd, except starts at rest at an angle of pi (Bullo and
 * Murray, 1999; Lee, Leok and McClamroch, 2010).
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include <liegrad/model.h>

enum { STATE = 12, TANGENT = 6, MOMENTUM = 9 /* MOMENTUM: index of the momentum in a state */ };

typedef struct controller {
    const lg_model *model;
    void *work;
    double target[STATE];  /* attitude Rd, at rest */
    double inverse_map[9]; /* B^-1, at the set point */
    double stiffness, damping, torque_max;
    double error[3]; /* e_R of the last step: the rotation axis times the sine of the angle */
} controller;

/* `work` has lg_model_work_size bytes, 64-byte aligned. Returns false, with a message in `why` (256 bytes),
 * if the model is not a machine of one rotation with three inputs that can turn it about all axes. */
bool controller_init(controller *self, const lg_model *model, void *work, const double *Rd, double frequency,
                     double torque_max, char *why);
/* Does not allocate or lock. If the state is not finite, the torque is zero. A torque beyond the bound is
 * scaled down to it. */
void controller_step(controller *self, const double *R, const double *Omega, double *torque);

#endif
