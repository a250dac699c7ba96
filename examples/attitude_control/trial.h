/* One start: the true body and the controller for some time, and what came of it. */
#ifndef TRIAL_H
#define TRIAL_H

#include <stddef.h>
#include <stdint.h>

#include "observer.h"

typedef struct trial_options {
    double period, duration; /* of control, of the whole run; s */
    double hold,
        tolerance; /* success: the angle to the set point stays below tolerance for `hold` at the end */
} trial_options;

typedef struct trial_result {
    bool finite;
    double angle;        /* of the start to the set point, rad */
    double arrived;      /* when the angle was below the tolerance for good, s; NaN: never */
    double worst;        /* largest angle in the last `hold` seconds */
    double torque, rate; /* the largest, N m and rad/s */
    double measured;     /* the largest error of a measured attitude, rad */
} trial_result;

/* Durations of control steps, in memory that is there before the loop. */
typedef struct samples {
    int64_t *ns;
    size_t count, room;
} samples;

/* `state` is the start and becomes the end. `by` (NULL: the controller sees the state itself) gives the
 * controller its estimates. Nothing is allocated here. */
trial_result trial_run(const trial_options *options, plant *truth, controller *control, observer *by,
                       double *state, samples *times);

/* The angle between two attitudes. */
double trial_angle(const double *A, const double *B);
double trial_norm(const double *x);

#endif
