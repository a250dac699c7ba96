/* Ensembles: many runs of one system, from other starts or with other parameters, side by side.
 *
 *   lg_ensemble_options options;
 *   lg_ensemble_options_init(&options);
 *   options.members = 1000000;
 *   options.times = &t_end, options.count = 1;
 *   lg_ensemble_run(context, system, &options, my_start, &mine, my_keep, &mine, &stats, &error);
 *
 * Explicit schemes of most systems run on the lanes of vector registers: a lane is a member with its own time,
 * step size and parameters, and a member that is done makes room for the next one. Other systems and schemes run
 * one member at a time. Blocks of members go to threads.
 *
 * The numbers of a member depend on its start, its parameters and the options alone: not on the other members, on
 * `first`, `members`, `block` or `threads`. They are the same for the same binary on the same instruction set
 * (lg_cpu_describe).
 */
#ifndef LIEGRAD_ENSEMBLE_H
#define LIEGRAD_ENSEMBLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/archive.h"
#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

/* ---- members ---- */

/* An event: g(y) = sum_i weight_i y_index_i - level changes its sign from one step's end to the next. Its time is
 * found by steps of the scheme itself from the step's start. What comes and goes inside of a step is not seen. */
#define LG_EVENT_TERMS 8
#define LG_EVENTS_MAX  8
typedef struct lg_ensemble_event {
    size_t terms; /* 1..LG_EVENT_TERMS */
    size_t index[LG_EVENT_TERMS];
    double weight[LG_EVENT_TERMS];
    double level;
    int direction; /* 1: g rises; -1: g falls; 0: either */
} lg_ensemble_event;

typedef struct lg_ensemble_member {
    lg_status status; /* LG_OK, or why it ended at `reached`: as lg_integrate_adaptive and lg_step say it, or
                         LG_INVALID_ARGUMENT for a start or a parameter that is not allowed */
    double reached;   /* time */
    uint64_t steps, rejected;
} lg_ensemble_member;

/* Writes the start of a member, lg_system_dim numbers that hold those of the options' `start` or zeros, and its
 * parameters, lg_system_parameter_count numbers that hold the system's own. It must be a function of `member`
 * alone. From several threads at once. A status other than LG_OK ends the run. */
typedef lg_status (*lg_ensemble_start)(void *user, uint64_t member, double *y0, double *parameters);

/* What is known of a block of members, first, first + 1, ..., when they are done. Rows of `room` numbers, a number
 * a member; members that failed have NaN from the time on that they did not reach. */
typedef struct lg_ensemble_block {
    uint64_t first;
    size_t members, room;
    size_t dim, count, parameter_count, event_count;
    const double *start;     /* (dim, room) */
    const double *parameter; /* (parameter_count, room) */
    const double *states;    /* (count, dim, room), at the times of the options */
    const double *events;    /* (event_count, room): times of the first events; NaN: none */
    const lg_ensemble_member *member;
    size_t thread; /* 0..threads-1: no other block of this number is kept at the same time */
} lg_ensemble_block;

/* Keeps what it wants of a block. From several threads at once, in any order of blocks. A status other than LG_OK
 * ends the run. */
typedef lg_status (*lg_ensemble_keep)(void *user, const lg_ensemble_block *block);

typedef struct lg_ensemble_options {
    size_t size;             /* sizeof(lg_ensemble_options) */
    uint64_t first, members; /* the members first .. first + members - 1; 0, 0 */
    size_t block;            /* members of a block; 0: as many as give 4 MB of states, 16 to 1024 */
    int threads;             /* 1 */
    const lg_scheme *scheme; /* NULL: dp54 on R^n, else rkmk54 */
    size_t steps; /* > 0: equal steps, t_end/steps each, after which all times lie unless the scheme has
                              * dense output; 0: adaptive */
    lg_step_controller control; /* adaptive; `observe` is not used, dense is true */
    const double *times;        /* (count): ascending from 0; the last one is t_end > 0 */
    size_t count;
    const double *start; /* (dim) of the scene; NULL: zeros */
    bool varied;         /* parameters differ between members */
    const lg_ensemble_event *events;
    size_t event_count; /* at most LG_EVENTS_MAX */
    bool one_by_one;    /* false; true: no lanes, for comparison */
} lg_ensemble_options;

LG_API void lg_ensemble_options_init(lg_ensemble_options *options);

typedef struct lg_ensemble_stats {
    size_t lanes; /* members side by side in a thread; 1: one at a time */
    size_t block; /* members of a block */
    uint64_t failed;
    uint64_t steps, rejected; /* of all members */
    double occupancy;         /* share of the lanes' steps that belong to a member; NaN where lanes is 1 */
    double seconds;
} lg_ensemble_stats;

/* `keep` may be NULL, `stats` too. Errors: LG_INVALID_ARGUMENT with a sentence (times, steps, events, scheme),
 * LG_UNSUPPORTED (adaptive without an embedded solution, a scheme that does not apply to the system),
 * LG_OUT_OF_MEMORY, LG_CANCELLED, those of `start` and `keep`. Members that fail are no error. */
LG_API lg_status lg_ensemble_run(const lg_context *context, const lg_system *system,
                                 const lg_ensemble_options *options, lg_ensemble_start start,
                                 void *start_user, lg_ensemble_keep keep, void *keep_user,
                                 lg_ensemble_stats *stats, lg_error *error);

LG_END_DECLS

#endif
