/* Runs of a piece of starts, period by period, and the gradient of their cost. */
#ifndef LG_CONTROL_POLICY_ROLLOUT_H
#define LG_CONTROL_POLICY_ROLLOUT_H

#include "control/policy.h"
#include "core/numbers.h"

/* Functions whose plans a rollout has. */
enum {
    LG_POLICY_STEP, /* (state, given...) -> next, cost, u */
    LG_POLICY_END,  /* (state) -> cost */
    LG_POLICY_ADJOINT_STEP,
    LG_POLICY_ADJOINT_END,
    LG_POLICY_PLANS
};
enum { LG_POLICY_GIVEN = 3 };

/* The caller sets the members before `disturbed`. */
typedef struct lg_policy_rollout {
    const lg_policy *policy;
    lg_dtype dtype;    /* of all arrays of a piece, but for doubles */
    size_t rows, most; /* runs of a piece, periods of a run at most */
    bool disturbed;    /* the state of a run is s, not x, and the policy's draws run in turn */
    /* How many numbers a period takes besides the state; those that vary are others in each period. */
    size_t given[LG_POLICY_GIVEN];
    bool varies[LG_POLICY_GIVEN];
    lg_policy_plans plans;
    size_t state, bytes; /* numbers in the state of a run; memory of a piece */
} lg_policy_rollout;
/* `functions` of the policy's program, in the order above, or others instead of those behind the step. On
 * failure too, lg_policy_plans_destroy must be called for r->plans. */
lg_status lg_policy_rollout_create(lg_policy_rollout *r, const char *const *functions, size_t count,
                                   lg_error *error);

typedef struct lg_policy_piece {
    char *path, *cost,
        *u; /* (most + 1, rows, state), (most + 1, rows), (most, rows, inputs) without adjoints */
    char *given[LG_POLICY_GIVEN];
    char *weight, *lambda[2]; /* (rows): of the costs; (rows, state) */
    char *slope;              /* the derivatives by given[0] */
    double *total, *spread;   /* (rows): costs of the runs; (state): deviations of the states in all runs */
    void *work;
    lg_plan *const *plan;
    size_t steps;
} lg_policy_piece;
/* The piece `number` in its memory, with runs of r->most periods. */
void lg_policy_piece_at(const lg_policy_rollout *r, char *memory, uint64_t number, lg_policy_piece *out);
/* Stores starts x (count, policy's state), the first one again in the rows that are left, and of disturbed
 * runs the disturbances of the piece `number`. */
void lg_policy_begin_runs(const lg_policy_rollout *r, const double *x, size_t count, uint64_t seed,
                          uint64_t number, lg_policy_piece *w);
/* Fills path, cost and u from the starts. lg_policy_cost also takes the cost of the ends, and sums. */
void lg_policy_forward(const lg_policy_rollout *r, lg_policy_piece *w);
void lg_policy_cost(const lg_policy_rollout *r, lg_policy_piece *w);
/* After lg_policy_cost: fills slope if given[0] varies, and otherwise adds the derivatives to `sum`.
 * `bound`: largest change of a run's cost by a typical change of its state; what goes back through a period
 * of the run is shortened to it. Then the gradient is not exact, but runs whose motion is chaotic do not
 * drown the others. INFINITY: none. */
void lg_policy_backward(const lg_policy_rollout *r, lg_policy_piece *w, double bound, double *sum);
/* Runs the piece from its starts and returns the mean cost, where a cost J is cut: C (1 - exp(-J/C)) (C
 * INFINITY: not cut). Adds the derivatives of the mean to `sum`. */
double lg_policy_gradient(const lg_policy_rollout *r, lg_policy_piece *w, double C, double bound,
                          double *sum);

#endif
