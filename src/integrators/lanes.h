/* Many integrations side by side: a lane of a vector register is a member, with its own time, step and
 * parameters. Compiled once for each instruction set (mechanics/lanes.c). What a member gets does not depend
 * on the other lanes: each operation is that of its own lane, and a lane that waits keeps its numbers. */
#ifndef LG_LANES_H
#define LG_LANES_H

#include "core/core.h"
#include "liegrad/ensemble.h"
#include "liegrad/integrators.h"

/* The systems with fields on lanes. */
typedef enum lg_lane_system {
    LG_LANES_NONE,
    LG_LANES_OSCILLATOR,
    LG_LANES_QUARTIC,
    LG_LANES_COUPLED,
    LG_LANES_CHAIN_LAGRANGIAN,
    LG_LANES_CHAIN_HAMILTONIAN,
    LG_LANES_RIGID_BODY,
    LG_LANES_ATTITUDE,
    LG_LANES_TOP_COTANGENT,
    LG_LANES_TOP_DIRECT,
    LG_LANES_TOP_LIE_POISSON,
    LG_LANES_TOP_QUADRATIC,
    LG_LANES_SYSTEMS
} lg_lane_system;

/* What all blocks of an ensemble share. */
typedef struct lg_lane_plan {
    const lg_scheme *scheme;
    lg_lane_system system;
    lg_space space;    /* the system's */
    bool ambient;      /* the scheme works on R^dim */
    size_t links;      /* of a chain */
    size_t parameters; /* numbers of a member: parameters, then constants made of them, then workspace */
    size_t constants, work;
    bool varied; /* each member has its own parameters */
    const lg_step_controller *control;
    size_t steps; /* > 0: equal ones; 0: adaptive */
    double t_end;
    const double *times; /* (count) where states are kept, ascending; the last is t_end */
    size_t count;
    const lg_ensemble_event *events;
    size_t event_count;
} lg_lane_plan;

/* Members that one thread integrates. Arrays of members have rows of `room` numbers, a number a member. */
typedef struct lg_lane_block {
    size_t members, room;
    const double *start;     /* (dim, room) */
    const double *parameter; /* (parameters, room), or (parameters) where they are not varied */
    const double *constant;  /* (constants, room) or (constants) */
    double *states;          /* (count, dim, room) */
    double *events; /* (event_count, room): the time of the first one; untouched where there is none */
    lg_ensemble_member *outcome;
    uint64_t *attempts; /* of vectors of steps, added */
    void *memory;       /* of `memory` bytes, aligned */
} lg_lane_block;

typedef struct lg_lane_table {
    size_t lanes;
    size_t (*memory)(const lg_lane_plan *plan, size_t room);
    void (*run)(const lg_lane_plan *plan, const lg_lane_block *block);
} lg_lane_table;

/* Of the instruction set in use. */
const lg_lane_table *lg_lanes(void);
/* Whether the system has a field on lanes and the scheme steps on them. */
bool lg_lanes_fit(const lg_lane_plan *plan);

#endif
