/* The true body, which the controller does not know: a rigid body on a pivot, with its centre of mass beside
 * it, a spring that depends on the vertical, and friction. */
#ifndef PLANT_H
#define PLANT_H

#include <stdbool.h>

#include <liegrad/integrators.h>
#include <liegrad/random.h>

enum { ATTITUDE = 9, PLANT_STATE = 12, TORQUE = 3, PLANT_STEPS = 4 /* of the integrator in a period */ };

/* J Omega' = J Omega x Omega + Gamma x dV/dGamma - d Omega - c |Omega| Omega + u, R' = R hat(Omega),
 * with the vertical Gamma = R^T e3 and V = w.Gamma + k Gamma_2^2/2, in kg m^2, N m, rad/s. */
typedef struct body {
    double J[9], w[3], k, d[3], c[3];
} body;
extern const body true_body;

/* State: R (row-major, body to space), then Omega in the body. */
typedef struct plant {
    lg_stepper *stepper;
    double inverse[9]; /* of J */
} plant;

/* False when memory is short. `self` must stay where it is until plant_destroy. */
bool plant_create(plant *self);
void plant_destroy(plant *self);
/* A period further under a torque that is held. False when the state is not finite. */
bool plant_advance(plant *self, double period, const double *torque, double *state);
/* Any attitude; rates are normal numbers times `rate`. */
void plant_start(lg_rng *rng, double rate, double *state);
/* Attitude of a rotation vector. */
void plant_attitude(const double *vector, double *R);
/* 3 x 3: false when it is singular. */
bool invert3(const double *M, double *out);

#endif
