/* Ensembles: many runs (members) of one system, side by side, from different starts or with different
 * parameters; and statistics of their numbers in fixed memory. The library is liegrad.
 *
 *   lg_ensemble_options options;
 *   lg_ensemble_options_init(&options);
 *   options.members = 1000000;
 *   options.times = &t_end, options.count = 1;
 *   lg_ensemble_run(context, system, &options, my_start, &mine, my_keep, &mine, &stats, &error);
 *
 * Explicit schemes of most systems run on the lanes of vector registers. A lane holds one member with its own
 * time, step size and parameters; when a member is done, the next member takes its lane. Other systems and
 * schemes run one member at a time. Members are dealt to threads in blocks.
 *
 * The results of a member depend only on its start, its parameters and the options, not on the other
 * members or on `first`, `members`, `block` and `threads`. They have the same bits for the same binary on
 * the same instruction set (lg_cpu_describe). */
#ifndef LIEGRAD_ENSEMBLE_H
#define LIEGRAD_ENSEMBLE_H

#include "liegrad/mechanics.h"

LG_BEGIN_DECLS

/* ---- Members ---- */

/* An event of a member is a sign change of g(y) = sum_i weight_i y_index_i - level in the given direction.
 * For the step in which it lies, its time is found by shorter steps of the scheme from the start of this
 * step. If g has the same sign at both ends of a step, the cubic with the values and slopes of both ends
 * tells whether g may have reached 0 in between; then such shorter steps to the cubic's extremum decide.
 * Events are missed where g oscillates within one step, so that the cubic does not follow it. If g changes
 * its sign three times in a step, the time of one of the changes is given. */
#define LG_EVENT_TERMS 8
#define LG_EVENTS_MAX  8
typedef struct lg_ensemble_event {
    size_t terms; /* 1..LG_EVENT_TERMS */
    size_t index[LG_EVENT_TERMS];
    double weight[LG_EVENT_TERMS];
    double level;
    /* Sign changes that count: 1 where g rises, -1 where g falls, 0 both. */
    int direction;
} lg_ensemble_event;

typedef struct lg_ensemble_member {
    /* LG_OK, or why the member ended at the time `reached`: a status of lg_integrate_adaptive or
     * lg_stepper_step, or LG_INVALID_ARGUMENT for a start off the manifold or a parameter against its
     * rule. */
    lg_status status;
    double reached; /* The last time that was reached. */
    uint64_t steps, rejected;
} lg_ensemble_member;

/* Writes the start and the parameters of one member. On entry y0 (lg_system_dim numbers) holds the
 * options' `start`, or zeros, and `parameters` (lg_system_parameter_count numbers) holds the system's
 * parameters. Changes of parameters count only if the options' `varied` is true. A start within 1e-6 of
 * the manifold, relative to the size of its parts, is projected; one farther away makes the member fail.
 * The result must depend on `member` only. Several threads call the function at once. A status other than
 * LG_OK ends the whole run. */
typedef lg_status (*lg_ensemble_start)(void *user, uint64_t member, double *y0, double *parameters);

/* The results of a block of members, which have the numbers first, first + 1, ... In the arrays the last
 * index is the member: each row has `room` >= members numbers, of which the first `members` count. States
 * of a member that failed are NaN at the times that it did not reach. The arrays are valid only during the
 * call of lg_ensemble_keep. */
typedef struct lg_ensemble_block {
    uint64_t first;
    size_t members, room;
    size_t dim, count, parameter_count, event_count;
    const double *start;     /* (dim, room) */
    const double *parameter; /* (parameter_count, room); NULL unless `varied`. */
    const double *states;    /* (count, dim, room), at the options' times. */
    const double *events;    /* (event_count, room): time of the first event; NaN: none. */
    const lg_ensemble_member *member;
    size_t thread; /* 0..threads-1; the calls with one value never overlap. */
} lg_ensemble_block;

/* Takes what the caller wants from a block. Several threads call it at once, and blocks come in any order.
 * A status other than LG_OK ends the whole run. */
typedef lg_status (*lg_ensemble_keep)(void *user, const lg_ensemble_block *block);

typedef struct lg_ensemble_options {
    size_t size;             /* sizeof(lg_ensemble_options) */
    uint64_t first, members; /* The members are first .. first + members - 1; default 0, 0. */
    /* Members per block; default 0: a power of 2 in 16..1024 such that the states of a block take at most
     * 4 MB if possible. */
    size_t block;
    int threads;             /* 1..1024; default 1. */
    const lg_scheme *scheme; /* Default NULL: dp54 on R^n, else rkmk54. */
    /* > 0: equal steps of size t_end/steps; without dense output each of the times must then be a multiple
     * of this size. Default 0: adaptive steps. */
    size_t steps;
    /* For adaptive steps. `observe` is ignored, and `dense` is always taken as true. */
    lg_step_controller control;
    const double *times; /* (count), ascending from 0; the last one is t_end > 0. */
    size_t count;
    const double *start; /* (dim), the start on entry to lg_ensemble_start; NULL: zeros. */
    bool varied;         /* Members have different parameters; default false. */
    const lg_ensemble_event *events;
    size_t event_count; /* at most LG_EVENTS_MAX */
    bool one_by_one;    /* true: no lanes, for comparison; default false. */
} lg_ensemble_options;

LG_API void lg_ensemble_options_init(lg_ensemble_options *options);
/* Returns the members per block, for states of `dim` numbers. */
LG_API size_t lg_ensemble_block_size(const lg_ensemble_options *options, size_t dim);

typedef struct lg_ensemble_stats {
    size_t lanes; /* Members side by side in a thread; 1: one at a time. */
    size_t block; /* Members per block. */
    uint64_t failed;
    uint64_t steps, rejected; /* Sums over all members. */
    /* Steps of members, divided by the steps that the lanes had room for; NaN without lanes. */
    double occupancy;
    double seconds;
} lg_ensemble_stats;

/* Runs all members. `start`, `keep`, `stats` and `error` may be NULL; without `start` all members have the
 * options' start. A member that fails is not an error: stats->failed counts it. Errors: LG_INVALID_ARGUMENT
 * (times, steps, events, scheme, threads), LG_UNSUPPORTED (adaptive steps with a scheme without an embedded
 * solution, or a scheme that does not apply to the system), LG_CANCELLED, those of `start` and `keep`. */
LG_API lg_status lg_ensemble_run(const lg_context *context, const lg_system *system,
                                 const lg_ensemble_options *options, lg_ensemble_start start,
                                 void *start_user, lg_ensemble_keep keep, void *keep_user,
                                 lg_ensemble_stats *stats, lg_error *error);

/* ---- Statistics in fixed memory ---- */

/* Statistics of a table of cells (rows, columns), for example times and components of the state. Each cell
 * has the count, mean, standard deviation, least, largest and quantiles of the numbers that were added to
 * it. The sums of single calls of lg_statistics_add are added up without rounding. Therefore the result
 * does not depend on the order of these calls or on how they are spread over objects that are merged
 * later; it does depend on which numbers one call adds, and ensembles add whole blocks. Memory: about
 * (1.1 + bins/128) KB per cell. */
typedef struct lg_statistics lg_statistics;

/* Where the bins of a cell lie: `bins` equal bins in [low, high], and one more on either side. In a
 * logarithmic column low and high are natural logarithms of the numbers. `centre` (never a logarithm) is
 * subtracted from numbers before they and their squares are summed. */
typedef struct lg_statistics_range {
    double low, high, centre;
} lg_statistics_range;

/* Makes empty statistics. `bins` is in 1..65536. `logarithmic` (columns) may be NULL, which means no column;
 * a column where it is true holds numbers >= 0, and its bins lie in the logarithm. Ranges are 0..1 until they
 * are set. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_statistics_create(const lg_context *context, size_t rows, size_t columns, size_t bins,
                                      const bool *logarithmic, lg_statistics **out);
LG_API void lg_statistics_destroy(lg_statistics *statistics);
/* Makes empty statistics with the same cells, bins and ranges. */
LG_API lg_status lg_statistics_create_like(const lg_statistics *statistics, lg_statistics **out);
/* Sets the range of a cell; must be called before a number is added to it. */
LG_API void lg_statistics_set_range(lg_statistics *statistics, size_t row, size_t column,
                                    const lg_statistics_range *range);
/* Returns a range for a column from a sample of `count` numbers: from the least to the largest, extended
 * by a quarter of that width on either side, with the mean as the centre. Numbers that are not finite are
 * left out. */
LG_API lg_statistics_range lg_statistics_range_of(const lg_statistics *statistics, size_t column,
                                                  const double *values, size_t count);
/* Adds `count` numbers to a cell; numbers that are not finite are left out. */
LG_API void lg_statistics_add(lg_statistics *statistics, size_t row, size_t column, const double *values,
                              size_t count);
/* Adds the numbers of `from` to `into`. Errors: LG_SHAPE (different cells, bins or ranges),
 * LG_CHECK_FAILED (counts or sums would overflow); `into` is then untouched. */
LG_API lg_status lg_statistics_merge(lg_statistics *into, const lg_statistics *from);

typedef struct lg_statistics_cell {
    uint64_t count;
    double mean, deviation; /* The deviation has the divisor count - 1. */
    double least, largest;
    /* Width of a bin; in logarithmic columns the width in the natural logarithm. */
    double resolution;
} lg_statistics_cell;

/* Returns the results of a cell. Mean, least and largest are NaN without a number, the deviation with
 * fewer than two. Mean and deviation are also NaN if the sums of (x - centre) or of its squares might
 * overflow. */
LG_API lg_statistics_cell lg_statistics_of(const lg_statistics *statistics, size_t row, size_t column);
/* Returns the quantile of 0 <= p <= 1, interpolated in the bins: exact to `resolution`, unless the
 * quantile lies outside the range. NaN without a number, or for another p. */
LG_API double lg_statistics_quantile(const lg_statistics *statistics, size_t row, size_t column, double p);
/* Returns the counts of a cell, (bins + 2): below the range, in each bin, above the range. They belong to
 * the statistics. */
LG_API const uint64_t *lg_statistics_bins(const lg_statistics *statistics, size_t row, size_t column);
/* Returns the range of the bins of a cell. */
LG_API lg_statistics_range lg_statistics_range_at(const lg_statistics *statistics, size_t row, size_t column);

/* Save and load all contents as the arrays count, least, largest, sum, square, bins, low, high and centre.
 * The object to load into must have the same cells, bins and logarithmic columns. Errors: those of the
 * archive; LG_CHECK_FAILED (bins that do not add up to the count, a least number above the largest, a range
 * that is not in order, sums that so many numbers cannot have). After a failed load the object may only be
 * destroyed. */
LG_API lg_status lg_statistics_save(const lg_statistics *statistics, const lg_archive_writer *archive);
LG_API lg_status lg_statistics_load(lg_statistics *statistics, const lg_archive_reader *archive);

LG_END_DECLS

#endif
