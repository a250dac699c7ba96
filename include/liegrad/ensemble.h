/* Ensembles: many runs of one system, from other starts or with other parameters, side by side.
 *
 *   lg_ensemble_options options;
 *   lg_ensemble_options_init(&options);
 *   options.members = 1000000;
 *   options.times = &t_end, options.count = 1;
 *   lg_ensemble_run(context, system, &options, my_start, &mine, my_keep, &mine, &stats, &error);
 *
 * Explicit schemes of most systems run on the lanes of vector registers: a lane is a member with its own
 * time, step size and parameters, and a member that is done makes room for the next one. Other systems and
 * schemes run one member at a time. Blocks of members go to threads.
 *
 * The numbers of a member depend on its start, its parameters and the options alone: not on the other
 * members, on `first`, `members`, `block` or `threads`. They are the same for the same binary on the same
 * instruction set (lg_cpu_describe). */
#ifndef LIEGRAD_ENSEMBLE_H
#define LIEGRAD_ENSEMBLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

LG_BEGIN_DECLS

/* ---- members ---- */

/* An event: g(y) = sum_i weight_i y_index_i - level changes its sign. Its time is found by steps of the
 * scheme itself from the start of the step in which it lies. Where g has the same sign at both ends of a
 * step, the cubic with the values and slopes of the ends says whether g may have come to 0 between them, and
 * steps to its extremum decide. Not seen: a g that passes 0 again and again in a step, which the cubic does
 * not follow; of three changes in a step, the time of one is given. */
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

/* Writes the start of a member, lg_system_dim numbers that hold those of the options' `start` or zeros, and
 * its parameters, lg_system_parameter_count numbers that hold the system's own. It must be a function of
 * `member` alone. From several threads at once. A status other than LG_OK ends the run. */
typedef lg_status (*lg_ensemble_start)(void *user, uint64_t member, double *y0, double *parameters);

/* What is known of a block of members, first, first + 1, ..., when they are done. Rows of `room` numbers, a
 * number a member; members that failed have NaN from the time on that they did not reach. */
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

/* Keeps what it wants of a block. From several threads at once, in any order of blocks. A status other than
 * LG_OK ends the run. */
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
/* Members of a block, for states of `dim` numbers. */
LG_API size_t lg_ensemble_block_size(const lg_ensemble_options *options, size_t dim);

typedef struct lg_ensemble_stats {
    size_t lanes; /* members side by side in a thread; 1: one at a time */
    size_t block; /* members of a block */
    uint64_t failed;
    uint64_t steps, rejected; /* of all members */
    double occupancy;         /* share of the lanes' steps that belong to a member; NaN where lanes is 1 */
    double seconds;
} lg_ensemble_stats;

/* `start`, `keep` and `stats` may be NULL. Errors: LG_INVALID_ARGUMENT with a sentence (times, steps, events,
 * scheme), LG_UNSUPPORTED (adaptive without an embedded solution, a scheme that does not apply to the
 * system), LG_OUT_OF_MEMORY, LG_CANCELLED, those of `start` and `keep`. Members that fail are no error. */
LG_API lg_status lg_ensemble_run(const lg_context *context, const lg_system *system,
                                 const lg_ensemble_options *options, lg_ensemble_start start,
                                 void *start_user, lg_ensemble_keep keep, void *keep_user,
                                 lg_ensemble_stats *stats, lg_error *error);

/* ---- statistics in fixed memory ---- */

/* Of a table of cells (rows, columns), say times and components: count, mean, standard deviation, least,
 * largest and quantiles of the numbers added to each. Sums are exact, so that the result does not depend on
 * the order or the parts in which numbers and objects were added: only the sums of one call of
 * lg_statistics_add are rounded, and ensembles call it for whole blocks. About (1.1 + bins/256) KB a cell. */
typedef struct lg_statistics lg_statistics;

/* Where the bins of a cell lie: equal ones in [low, high], or in its logarithm, and one on either side.
 * `centre` is subtracted before squares are summed. */
typedef struct lg_statistics_range {
    double low, high, centre;
} lg_statistics_range;

/* `bins` in 1..65536; `logarithmic` (columns) or NULL: those columns hold numbers >= 0 whose bins lie in the
 * logarithm. Ranges are those of 0..1 until they are set. Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_statistics_create(const lg_context *context, size_t rows, size_t columns, size_t bins,
                                      const bool *logarithmic, lg_statistics **out);
LG_API void lg_statistics_destroy(lg_statistics *statistics); /* NULL is fine */
/* An empty one with the same cells and ranges. */
LG_API lg_status lg_statistics_like(const lg_statistics *statistics, lg_statistics **out);
/* Before the first number. */
LG_API void lg_statistics_set_range(lg_statistics *statistics, size_t row, size_t column,
                                    const lg_statistics_range *range);
/* From a sample of `count` numbers (NaN are left out): theirs, and a quarter of its width more on either
 * side. */
LG_API lg_statistics_range lg_statistics_range_of(const lg_statistics *statistics, size_t column,
                                                  const double *values, size_t count);
/* Adds `count` numbers to a cell; those that are not finite are left out. */
LG_API void lg_statistics_add(lg_statistics *statistics, size_t row, size_t column, const double *values,
                              size_t count);
/* `into` += `from`. LG_SHAPE: other cells, bins or ranges; LG_CHECK_FAILED: counts or sums overflow. `into`
 * is untouched then. */
LG_API lg_status lg_statistics_merge(lg_statistics *into, const lg_statistics *from);

typedef struct lg_statistics_cell {
    uint64_t count;
    double mean, deviation; /* divisor count - 1 */
    double least, largest;
    double resolution; /* width of a bin; of the logarithm (base e) in logarithmic columns */
} lg_statistics_cell;

/* NaN where too few numbers were added. */
LG_API lg_statistics_cell lg_statistics_of(const lg_statistics *statistics, size_t row, size_t column);
/* 0 <= p <= 1: from the bins, to within `resolution` unless it lies beyond the range. */
LG_API double lg_statistics_quantile(const lg_statistics *statistics, size_t row, size_t column, double p);
/* (bins + 2): below the range, in the bins, above it. */
LG_API const uint64_t *lg_statistics_bins(const lg_statistics *statistics, size_t row, size_t column);
LG_API lg_statistics_range lg_statistics_range_at(const lg_statistics *statistics, size_t row, size_t column);

/* All that there is, as arrays: count, least, largest, sum, square, bins, low, high, centre. Loading needs an
 * object of the same cells, bins and logarithmic columns. Errors: those of the archive; LG_CHECK_FAILED: bins
 * that do not sum up to the count, ends or a range that are not in order, sums that so many numbers cannot
 * have. After a failure the object may be destroyed alone. */
LG_API lg_status lg_statistics_save(const lg_statistics *statistics, const lg_archive_writer *archive);
LG_API lg_status lg_statistics_load(lg_statistics *statistics, const lg_archive_reader *archive);

LG_END_DECLS

#endif
