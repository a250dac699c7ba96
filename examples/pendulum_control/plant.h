/* The true spherical pendulum, which the controller does not know: a pendulum-chain of one link, integrated
 * with a Lie group scheme, the torque held over a control period. */
#ifndef PLANT_H
#define PLANT_H

#include <stdbool.h>

#include <liegrad/integrators.h>
#include <liegrad/mechanics.h>

enum { PLANT_STEPS = 4 }; /* integrator steps a control period */

typedef struct plant {
    lg_system *system;
    lg_system_user user;
    lg_ode ode; /* of the free pendulum */
    lg_stepper *stepper;
    double *work;
    double weight; /* m g L */
    double mass;   /* m L^2 */
} plant;

/* m = L = g = 1, as scenes/pendulum.yaml. False when memory is short. `self` must stay where it is until
 * plant_destroy. */
bool plant_create(plant *self);
void plant_destroy(plant *self);
/* `state` (q p) a period further under the torque (3, about the joint, in inertial axes). False when it is
 * not finite. */
bool plant_advance(plant *self, double period, const double *torque, double *state);
double plant_energy(plant *self, const double *state);

#endif
