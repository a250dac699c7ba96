/* Swings up and stabilises a spherical pendulum with a bounded torque. The controller knows only the model
 * file of a learned Hamiltonian and the bound of the torque.
 *
 * The state is (q, p), 6 numbers, where q is a unit vector and q.p = 0.
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include <liegrad/control.h>
#include <liegrad/model.h>

enum { STATE = 6, TORQUE = 3, TANGENT = 4 };

typedef enum mode { SWING_UP, BALANCE } mode;

typedef struct controller {
    const lg_model *model;
    double torque_max;
    double upright[STATE]; /* stationary point of the learned potential near e3, at rest */
    double energy_up;      /* H at `upright` */
    /* Learned m g L: half the difference of H between `upright` and the opposite point. */
    double energy_scale;
    double mass;   /* learned m L^2, |p| / |q'| */
    lg_lqr lqr;    /* regulator about `upright`; the caller owns its memory */
    double region; /* BALANCE is possible where c^T P c < region */
    mode mode;
    double energy; /* H at the last state */
} controller;

/* Finds the upright equilibrium, linearises there and solves the Riccati equation. Returns false, with a
 * message in `why` (256 bytes), if the model is not a Hamiltonian of one link, or has no unstable equilibrium
 * within 0.5 rad of e3. `work` has controller_work_size bytes, 64-byte aligned; the caller owns it. */
size_t controller_work_size(const lg_model *model);
bool controller_init(controller *self, const lg_model *model, void *work, double torque_max, char *why);

/* One control step: computes the torque (3) to hold until the next step. It does not allocate, lock or call
 * the system. |torque| <= torque_max always holds. If the state is not finite, the torque is zero. */
void controller_step(controller *self, const double *state, double *torque);

/* Angle between q and e3, rad; accurate near 0. */
double pendulum_angle(const double *state);

#endif
