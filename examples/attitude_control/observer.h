/* Sensors with noise, and an extended Kalman filter on the learned body that reads them. */
#ifndef OBSERVER_H
#define OBSERVER_H

#include <liegrad/control.h>

#include "controller.h"
#include "plant.h"

typedef struct observer {
    const lg_model *model;
    lg_ekf *filter;
    void *work, *memory; /* of the model, of the filter */
    double noise;        /* standard deviation of measured angles, rad; of rates 10 times as much, rad/s */
    lg_rng rng;
    double measured[PLANT_STATE], seen[PLANT_STATE]; /* attitude and rates: of the sensors, of the filter */
    double worst; /* standard deviation of an angle, as the filter has it */
} observer;

/* `work`: as for controller_init. False when the model cannot be filtered, or memory is short. */
bool observer_create(observer *self, const lg_model *model, void *work, double noise, uint64_t seed);
void observer_destroy(observer *self);
/* Begins with what the sensors say of the true state. */
bool observer_start(observer *self, const double *truth);
/* No allocation, no lock: a look at the true state fills `seen`; a period passes under a torque. */
bool observer_look(observer *self, const double *truth);
bool observer_wait(observer *self, double period, const double *torque);

#endif
