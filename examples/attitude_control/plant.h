/* The true body, which the controller does not know: a rigid body on a pivot. Its centre of mass is beside
 * the pivot; a spring that depends on the vertical and friction act on it. */
#ifndef PLANT_H
#define PLANT_H

#include <stdbool.h>

#include <liegrad/core.h>
#include <liegrad/integrators.h>

enum { ATTITUDE = 9, PLANT_STATE = 12, TORQUE = 3, PLANT_STEPS = 4 /* integrator steps per period */ };

/* J Omega' = J Omega x Omega + Gamma x dV/dGamma - d Omega - c |Omega| Omega + u, R' = R hat(Omega),
 * with the vertical Gamma = R^T e3 and V = w.Gamma + k Gamma_2^2/2, in kg m^2, N m, rad/s. */
typedef struct body {
    double J[9], w[3], k, d[3], c[3];
} body;
extern const body true_body;

/* The state is R (row-major, body to space), then Omega in body axes. */
typedef struct plant {
    lg_stepper *stepper;
    double inverse[9]; /* J^-1 */
} plant;

/* Returns false if memory is short. `self` must not move until plant_destroy. */
bool plant_create(plant *self);
void plant_destroy(plant *self);
/* Advances the state by a period under a constant torque. Returns false if the state is not finite. */
bool plant_advance(plant *self, double period, const double *torque, double *state);
/* Draws a random attitude, and rates that are normal numbers times `rate`. */
void plant_start(lg_rng *rng, double rate, double *state);
/* The attitude R of a rotation vector. */
void plant_attitude(const double *vector, double *R);
/* Inverts a 3 x 3 matrix. Returns false if it is singular. */
bool invert3(const double *M, double *out);

#endif
