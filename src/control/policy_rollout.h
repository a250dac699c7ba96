/* Runs of a piece of starts, period by period, and the gradient of their cost. */
#ifndef LG_CONTROL_POLICY_ROLLOUT_H
#define LG_CONTROL_POLICY_ROLLOUT_H

#include "control/policy.h"
#include "core/numbers.h"

/* The functions whose plans a rollout has. A piece is a block of `rows` runs. */
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
    lg_dtype dtype;    /* type of the arrays of a piece that are declared as char */
    size_t rows, most; /* number of runs in a piece; largest number of periods of a run */
    /* true: the runs have disturbances. Their state is s = (x, the inputs before), and piece k has draw k of
     * the policy, modulo the number of draws. */
    bool disturbed;
    /* Number of values of each further input of a period; whether they differ from period to period. */
    size_t given[LG_POLICY_GIVEN];
    bool varies[LG_POLICY_GIVEN];
    lg_policy_plans plans;
    size_t state, bytes; /* number of values in the state of a run; bytes of a piece */
} lg_policy_rollout;
/* Makes the plans of these functions of the policy's program: the step, then those of the order above, or
 * other functions. lg_policy_plans_destroy must be called for r->plans, after a failure too. */
lg_status lg_policy_rollout_create(lg_policy_rollout *r, const char *const *functions, size_t count,
                                   lg_error *error);

typedef struct lg_policy_piece {
    char *path, *cost,
        *u; /* (most + 1, rows, state), (most + 1, rows), (most, rows, inputs) without adjoints */
    char *given[LG_POLICY_GIVEN];
    char *weight, *lambda[2]; /* (rows): weights of the costs in the gradient; (rows, state): adjoints */
    char *slope;              /* derivatives with respect to given[0] */
    double *total, *spread;   /* (rows): costs of the runs; (state): deviations of the states in all runs */
    void *work;
    lg_plan *const *plan;
    size_t steps;
} lg_policy_piece;
/* Lays out piece `number` in `memory` (r->bytes). Its runs have r->most periods. */
void lg_policy_piece_at(const lg_policy_rollout *r, char *memory, uint64_t number, lg_policy_piece *out);
/* Stores the starts x (count, policy's state). Rows without a start get the first one. For disturbed runs it
 * also draws the disturbances of piece `number`. */
void lg_policy_begin_runs(const lg_policy_rollout *r, const double *x, size_t count, uint64_t seed,
                          uint64_t number, lg_policy_piece *w);
/* Fill path, cost and u from the starts. lg_policy_cost also adds the terminal cost, and fills `total`. */
void lg_policy_forward(const lg_policy_rollout *r, lg_policy_piece *w);
void lg_policy_cost(const lg_policy_rollout *r, lg_policy_piece *w);
/* Call it after lg_policy_cost. It fills `slope` if given[0] varies, and otherwise adds the derivatives to
 * `sum`. If `bound` is finite, the adjoint lambda of a run is shortened after each period such that a typical
 * change of the state changes the run's cost by at most `bound`. The gradient is then not exact, but chaotic
 * runs do not dominate it. */
void lg_policy_backward(const lg_policy_rollout *r, lg_policy_piece *w, double bound, double *sum);
/* Runs the piece from its starts and returns the mean of the costs. If C is finite, a cost J counts as
 * C (1 - exp(-J/C)). Adds the derivatives of the mean to `sum`. */
double lg_policy_gradient(const lg_policy_rollout *r, lg_policy_piece *w, double C, double bound,
                          double *sum);

#endif
