/* Noisy sensors, and an extended Kalman filter on the learned body that reads them. */
#ifndef OBSERVER_H
#define OBSERVER_H

#include <liegrad/control.h>

#include "controller.h"
#include "plant.h"

typedef struct observer {
    const lg_model *model;
    lg_ekf *filter;
    void *work, *memory; /* memory of the model, memory of the filter */
    /* Standard deviation of measured angles, rad. For rates it is 10 times as large, rad/s. */
    double noise;
    lg_rng rng;
    /* Attitude and rates: from the sensors, from the filter. */
    double measured[PLANT_STATE], seen[PLANT_STATE];
    double worst; /* standard deviation of an angle according to the filter */
} observer;

/* `work` is as for controller_init. Returns false if the model cannot be filtered or memory is short. */
bool observer_create(observer *self, const lg_model *model, void *work, double noise, uint64_t seed);
void observer_destroy(observer *self);
/* Starts the filter with a measurement of the true state. */
bool observer_start(observer *self, const double *truth);
/* Neither function allocates or locks. observer_look measures the true state and updates `seen`;
 * observer_wait predicts over a period under a torque. */
bool observer_look(observer *self, const double *truth);
bool observer_wait(observer *self, double period, const double *torque);

#endif
