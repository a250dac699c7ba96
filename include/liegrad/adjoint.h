/* Gradients of functionals of a trajectory in its start and in parameters, with bounded memory.
 *
 * With y_{n+1} = Phi_n(y_n, theta) the step of size h_n from t_n,
 *
 *   J = sum_n J_n(y_n),   lambda_N = dJ_N/dy,   lambda_n = dJ_n/dy + (dPhi_n/dy)^T lambda_{n+1},
 *   dJ/dy_0 = lambda_0,   dJ/dtheta = sum_n (dPhi_n/dtheta)^T lambda_{n+1}:
 *
 * the derivative of the discrete flow, exact to rounding. The steps are given and held fixed: equal steps, or
 * the steps that an adaptive integration accepted (lg_step_controller.observe).
 *
 * The plain interpreter computes the states once forward and keeps C + 1 checkpoints: the starts of C
 * segments of floor(N/C) or ceil(N/C) steps, and the end. Then, from the last segment to the first, the
 * states inside a segment are computed again, with the same bits. Each step is recorded alone on a tape and
 * swept backwards. Time: at most two plain integrations and one recorded one. Memory:
 *
 *   8 dim (C + 1 + ceil(N/C)) bytes of states + the tape of one step.
 *
 * It is least near C = sqrt(N): a million steps of 120 numbers take 2 MB. lg_adjoint_stats reports the memory
 * used.
 */
#ifndef LIEGRAD_ADJOINT_H
#define LIEGRAD_ADJOINT_H

#include "liegrad/context.h"
#include "liegrad/integrators.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

/* Fills in `ode`, the form of the equation that the tape can record. `parameters` is a variable of shape
 * (parameter_count) on this tape, or LG_NONE when there are none. Called before each recorded step, on a tape
 * that has leaves only. Memory that `ode` points to must live until the next call. Its space has the
 * dimension of the plain one; for splitting schemes it may be R^2n in one factor or two. */
typedef lg_status (*lg_adjoint_bind)(void *user, lg_tape *tape, lg_var parameters, lg_taped_ode *ode);

/* The functional's derivative in the state after step n (0 is the start), at time t: adds dJ_n/dy to
 * gradient, dim numbers that are zero. Called once for each n, from N down to 0. */
typedef lg_status (*lg_adjoint_source)(void *user, size_t n, double t, const double *y, double *gradient);

typedef struct lg_adjoint_problem {
    size_t size; /* sizeof(lg_adjoint_problem) */
    const lg_scheme *scheme;
    const lg_ode *ode; /* plain, with the same parameters */
    lg_adjoint_bind bind;
    const double *parameters; /* parameter_count numbers; 0: none */
    size_t parameter_count;
    lg_adjoint_source source;
    void *user;          /* of bind and source */
    const double *t, *h; /* N starts of steps and their sizes, finite; h < 0 goes back in time */
    size_t steps;        /* N >= 1 */
    size_t checkpoints;  /* C, 1..N; 0: ceil(sqrt(N)) */
} lg_adjoint_problem;

typedef struct lg_adjoint_stats {
    size_t checkpoints; /* C */
    size_t states_size; /* 8 dim (C + 1 + ceil(N/C)) */
    size_t tape_size;   /* the tape's high-water mark */
    double seconds;
} lg_adjoint_stats;

/* Sets the size and zeroes everything else. */
LG_API void lg_adjoint_problem_init(lg_adjoint_problem *problem);

/* y_end (dim): the state after step N; dy0 (dim): dJ/dy0 in the ambient space, unprojected; dparameters
 * (parameter_count). Any of them may be NULL; it is then not computed. stats may be NULL. Before the run the
 * first step is computed both from `ode` and from the form that bind makes, and the two results are compared.
 * Errors, explained in `error` (may be NULL): LG_INVALID_ARGUMENT (also: the two forms differ),
 * LG_UNSUPPORTED (the scheme has no form that the tape can record), LG_OUT_OF_MEMORY, LG_NOT_FINITE (a state,
 * the gradient), LG_CANCELLED, those of the field, of bind and of source. On failure nothing is written. */
LG_API lg_status lg_adjoint_gradient(const lg_context *context, const lg_adjoint_problem *problem,
                                     const double *y0, double *y_end, double *dy0, double *dparameters,
                                     lg_adjoint_stats *stats, lg_error *error);

/* Projects the ambient gradient g at y onto the tangent space of the manifold, in place (orthogonally, in the
 * ambient metric). Its product with tangent vectors stays the same; with normal vectors it becomes zero. */
LG_API void lg_space_project_gradient(const lg_space *space, const double *y, double *g);

LG_END_DECLS

#endif
