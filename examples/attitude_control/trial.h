/* A run from one start: simulates the true body with the controller and judges the result. */
#ifndef TRIAL_H
#define TRIAL_H

#include <stddef.h>
#include <stdint.h>

#include "observer.h"

typedef struct trial_options {
    double period, duration; /* control period, duration of the run; s */
    /* Success: at the end, the angle to the set point stays below `tolerance` for `hold` seconds. */
    double hold, tolerance;
} trial_options;

typedef struct trial_result {
    bool finite;
    double angle;        /* angle between start and set point, rad */
    double arrived;      /* when the angle fell below the tolerance and stayed there, s; NaN: never */
    double worst;        /* largest angle in the last `hold` seconds */
    double torque, rate; /* largest torque and rate, N m and rad/s */
    double measured;     /* largest error of a measured attitude, rad */
} trial_result;

/* Durations of control steps, in memory that is allocated before the loop. */
typedef struct samples {
    int64_t *ns;
    size_t count, room;
} samples;

/* Runs one trial without allocating memory. `state` is the start and becomes the end. `by` estimates the
 * state for the controller; if it is NULL, the controller gets the true state. */
trial_result trial_run(const trial_options *options, plant *truth, controller *control, observer *by,
                       double *state, samples *times);

/* The angle between two attitudes, rad. */
double trial_angle(const double *A, const double *B);
double trial_norm(const double *x);

#endif
