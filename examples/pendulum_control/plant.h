/* The true spherical pendulum, which the controller does not know. It is a pendulum-chain of one link,
 * integrated by a Lie group scheme; the torque is held during a control period. */
#ifndef PLANT_H
#define PLANT_H

#include <stdbool.h>

#include <liegrad/integrators.h>
#include <liegrad/mechanics.h>

enum { PLANT_STEPS = 4 }; /* integrator steps per control period */

typedef struct plant {
    lg_system *system;
    lg_system_user user;
    lg_ode ode; /* the free pendulum */
    lg_stepper *stepper;
    double *work;
    double weight; /* m g L */
    double mass;   /* m L^2 */
} plant;

/* m = L = g = 1, as in scenes/pendulum.yaml. Returns false if memory is short. `self` must not move until
 * plant_destroy. */
bool plant_create(plant *self);
void plant_destroy(plant *self);
/* Advances `state` (q, p) by a period under the torque (3 numbers, about the joint, in inertial axes).
 * Returns false if a step fails. */
bool plant_advance(plant *self, double period, const double *torque, double *state);
double plant_energy(plant *self, const double *state);

#endif
