/* Integrates an ensemble one member at a time, for systems and schemes that lanes do not support. */
#ifndef LG_ENSEMBLE_MEMBER_H
#define LG_ENSEMBLE_MEMBER_H

#include "integrators/lanes.h"
#include "mechanics/system.h"

typedef struct lg_one_by_one {
    const lg_context *context;
    const lg_lane_plan *plan;
    lg_system_user user;
    lg_stepper *stepper, *looker; /* `looker` makes the steps of the searches for events */
    double *rows, *y, *before, *trial, *velocity, *work; /* in one block of memory, which begins with rows */
    double events[LG_EVENTS_MAX]; /* times of the current member's events, NaN before they happen */
    double slopes[LG_EVENTS_MAX]; /* time derivative of each event's g at `before` */
    double reached;
} lg_one_by_one;

/* `system` must have the parameters of the current member whenever lg_one_by_one_run is called. */
lg_status lg_one_by_one_begin(const lg_context *context, const lg_lane_plan *plan, const lg_system *system,
                              lg_one_by_one *out);
void lg_one_by_one_end(lg_one_by_one *one); /* `one` may be zeroed */
/* Integrates a member from y0 and writes its results to column `member` of the block. */
void lg_one_by_one_run(lg_one_by_one *one, const double *y0, size_t member, const lg_lane_block *block);

#endif
