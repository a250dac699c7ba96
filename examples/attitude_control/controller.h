/* Holds an attitude by a learned machine: geometric feedback on SO(3), with what the machine has learned of
 * inertia, gravity and damping compensated.
 *
 *   e_R = 1/2 vee(Rd^T R - R^T Rd), e_Omega = Omega (the set point is at rest)
 *   B u = M alpha - p'(R, Omega, u = 0),   alpha = -stiffness e_R - damping e_Omega
 *
 * If the machine is right, Omega' = alpha, and W = stiffness tr(I - Rd^T R)/2 + |Omega|^2/2 falls with the
 * rate damping |Omega|^2: every start but those of angle pi at rest ends at Rd (Bullo and Murray,
 * 1999; Lee, Leok and McClamroch, 2010). */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include <liegrad/model.h>

enum { STATE = 12, TANGENT = 6, MOMENTUM = 9 /* where it begins in a state */ };

typedef struct controller {
    const lg_model *model;
    void *work;
    double target[STATE];  /* Rd at rest */
    double inverse_map[9]; /* B^-1, at the set point */
    double stiffness, damping, torque_max;
    double error[3]; /* e_R of the last step: its axis times the sine of the angle */
} controller;

/* `work`: lg_model_work_size bytes, 64-byte aligned. False, and a sentence in why (256 bytes), when the model
 * is not that of one rotation with three inputs that move it. */
bool controller_init(controller *self, const lg_model *model, void *work, const double *Rd, double frequency,
                     double torque_max, char *why);
/* No allocation, no lock. A state that is not finite gives no torque; a torque beyond the bound is
 * shortened. */
void controller_step(controller *self, const double *R, const double *Omega, double *torque);

#endif
