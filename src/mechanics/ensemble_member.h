/* One member of an ensemble at a time: what runs where there are no lanes. */
#ifndef LG_ENSEMBLE_MEMBER_H
#define LG_ENSEMBLE_MEMBER_H

#include "integrators/lanes.h"
#include "mechanics/system.h"

typedef struct lg_one_by_one {
    const lg_context *context;
    const lg_lane_plan *plan;
    lg_system_user user;
    lg_stepper *stepper, *looker; /* the second one makes the steps of searches for events */
    double *work, *rows, *y, *before, *trial, *velocity;
    double *events; /* of the member at hand, LG_EVENTS_MAX */
    double *slopes; /* LG_EVENTS_MAX: of what the events look at, at `before` */
    double reached;
} lg_one_by_one;

/* `system` holds the parameters of the member at hand. */
lg_status lg_one_by_one_begin(const lg_context *context, const lg_lane_plan *plan, const lg_system *system,
                              lg_one_by_one *out);
void lg_one_by_one_end(lg_one_by_one *one); /* a zeroed one is fine */
/* From y0 into column `member` of the block. */
void lg_one_by_one_run(lg_one_by_one *one, const double *y0, size_t member, const lg_lane_block *block);

#endif
