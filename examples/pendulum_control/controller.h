/* Swing-up and stabilisation of a spherical pendulum with a bounded torque, from a learned Hamiltonian alone.
 *
 * What it knows: the model file and the bound of the torque. State: q p, 6 numbers, q a unit vector and q.p =
 * 0. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include <liegrad/control.h>
#include <liegrad/io.h>

enum { STATE = 6, TORQUE = 3, TANGENT = 4 };

typedef enum mode { SWING_UP, BALANCE } mode;

typedef struct controller {
    const lg_model *model;
    double torque_max;
    double upright[STATE]; /* where the learned potential is stationary, at rest */
    double energy_up;      /* H there */
    double energy_scale;   /* m g L as learned: half the difference to the lowest point */
    double mass;           /* |p| / |q'| as learned, m L^2 */
    lg_lqr lqr;            /* about it; its memory is the caller's */
    double region;         /* BALANCE where c^T P c < region */
    mode mode;
    double energy; /* H at the last state seen */
} controller;

/* Finds the upright equilibrium, linearises there, solves the Riccati equation. False and a sentence in `why`
 * (256) when the model is no Hamiltonian of one link, has no equilibrium within 0.5 rad of e3, or not an
 * unstable one. `work`: from controller_work_size, 64-byte aligned, the caller's. */
size_t controller_work_size(const lg_model *model);
bool controller_init(controller *self, const lg_model *model, void *work, double torque_max, char *why);

/* One control step: the torque (3) to hold until the next. No allocation, no lock, no system call; always
 * |torque| <= torque_max; for a state that is not finite it is zero. */
void controller_step(controller *self, const double *state, double *torque);

/* Angle between q and e3, rad; accurate near 0. */
double pendulum_angle(const double *state);

#endif
