/* Many integrations side by side. Each lane of a vector register integrates one member of an ensemble, with
 * its own time, step size and parameters. The code is compiled once for each instruction set
 * (mechanics/lanes.c). The results of a member do not depend on the other lanes: no operation mixes lanes,
 * and a lane that has to wait keeps its values. */
#ifndef LG_LANES_H
#define LG_LANES_H

#include "core/core.h"
#include "liegrad/ensemble.h"
#include "liegrad/integrators.h"

/* Data that is the same for all blocks of an ensemble. */
typedef struct lg_lane_plan {
    lg_ensemble_options run; /* with a scheme; the last of the times is t_end */
    const char *name, *form; /* of the system; form: NULL if it has one only */
    lg_space space;          /* the system's space */
    bool ambient;            /* the scheme works in ambient coordinates, on R^dim */
    size_t links;            /* number of links of a chain */
    size_t parameters;       /* numbers per member: parameters, constants derived from them, workspace */
    size_t constants, work;
    double t_end;
} lg_lane_plan;

/* The members that one call of `run` integrates. Rows of its arrays have `room` numbers, one per member. */
typedef struct lg_lane_block {
    size_t members, room;
    double *start;     /* (dim, room) */
    double *parameter; /* (parameters, room) if run.varied, else (parameters) */
    double *constant;  /* (constants, room) if run.varied, else (constants) */
    double *states;    /* (count, dim, room) */
    double *events;    /* (event_count, room): first time of each event; untouched if it never happens */
    lg_ensemble_member *outcome;
    uint64_t *attempts; /* number of attempted vector steps is added to it */
    void *memory;       /* work memory, as many bytes as `memory` of lg_lane_table says, aligned */
} lg_lane_block;

typedef struct lg_lane_table {
    size_t lanes;
    bool (*knows)(const lg_lane_plan *plan); /* whether the fields of the plan's system exist for lanes */
    size_t (*memory)(const lg_lane_plan *plan, size_t room);
    void (*run)(const lg_lane_plan *plan, const lg_lane_block *block);
} lg_lane_table;

#endif
