/* Batches of runs of the closed loop with their gradient, for training. */
#ifndef LG_CONTROL_POLICY_GRADIENT_H
#define LG_CONTROL_POLICY_GRADIENT_H

#include "control/policy.h"

enum {
    LG_POLICY_CLOSED,
    LG_POLICY_TERMINAL,
    LG_POLICY_ADJOINT_CLOSED,
    LG_POLICY_ADJOINT_TERMINAL,
    LG_POLICY_PLANS
};

/* `points` parameters, each with `count` starts (a multiple of LG_POLICY_ROWS). The caller sets starts,
 * theta, steps, cut and ranks before a run. The number of threads and ranks does not change the results. */
typedef struct lg_policy_batch {
    const lg_policy *policy;
    lg_dtype dtype;      /* of the runs; costs and gradients are sums in double precision */
    bool disturbed;      /* as the task is */
    uint64_t seed, draw; /* of the disturbances; piece k of a point is piece draw * pieces + k */
    size_t points, count, pieces;
    size_t most, *steps;            /* periods of a run: at most; of each point, `most` by default */
    size_t state;                   /* numbers in the state of a run: x, or s of disturbed runs */
    const double **starts, **theta; /* of each point: (count, state), (parameters) */
    double cut;                     /* INFINITY: none */
    /* Largest change of a run's cost by a typical change of its state: what goes back through a period of
     * the run is shortened to it. Then the gradient is not exact, but runs whose motion is chaotic do not
     * drown the others. INFINITY: none. */
    double bound;
    lg_policy_plans plans;
    lg_thread_pool *pool;
    const lg_ranks *ranks; /* each runs a part of the pieces; NULL: this process runs all */
    size_t first;          /* piece of this rank */
    char *memory;
    size_t piece_bytes;
    double *sums; /* (points, pieces, parameters + 1): gradient, cost */
} lg_policy_batch;
/* On failure there is nothing to destroy. */
lg_status lg_policy_batch_create(const lg_policy *policy, lg_dtype dtype, size_t points, size_t count,
                                 int threads, lg_policy_batch *b, lg_error *error);
void lg_policy_batch_destroy(lg_policy_batch *b);
/* cost (points): mean of the cut costs; gradient[point] (parameters). Errors: those of an exchange between
 * ranks. */
lg_status lg_policy_batch_run(lg_policy_batch *b, double *cost, double *const *gradient);

#endif
