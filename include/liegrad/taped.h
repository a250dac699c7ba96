/* Integrators on a tape: steps of the schemes in liegrad/integrators.h are recorded for batches of
 * trajectories, so that they can be differentiated.
 *
 * A point of a space and an element of its algebra are tuples of variables, the parts, in the order of the
 * space's factors:
 * - LG_SPACE_RN of dimension n: one part (B, n), or a tensor (B, ...) of n numbers a row; algebra: one part
 *   of the same shape
 * - LG_SPACE_TS2 and LG_SPACE_SE3_DUAL with k copies: two parts (B, k, 3), q and p, or G and P; algebra: two
 *   parts u, v (B, k, 3)
 * - LG_SPACE_SO3 with k copies: one part R (B, k, 9) row-major; algebra: one part u (B, k, 3)
 * - LG_SPACE_SE3 with k copies: two parts R (B, k, 9), r (B, k, 3); algebra: two parts u, v (B, k, 3)
 * - LG_SPACE_SO3_DUAL with k copies: one part x (B, k, 3); algebra: one part u (B, k, 3)
 *
 * Other shapes are refused with LG_SHAPE, of the state and of what a field gives. All errors of this header
 * stick to the tape: functions that return a status return the tape's.
 *
 * Splitting schemes take R^n x R^n, two parts q, p (B, n), or R^2n, one part with q before p. Rows of a batch
 * are independent trajectories: row b of a field depends only on row b of the state, the input and the time.
 *
 * Steps can be differentiated to any order in the start, in whatever the field depends on, and in the input,
 * the time and the step size where they are variables. Implicit schemes (LG_SCHEME_IMPLICIT, LG_SCHEME_SLGI)
 * are an exception: they find their stage with plain numbers and record two Newton corrections at it, whose
 * first and second derivatives are exact; higher ones are not. The plain interpreter and this one agree to
 * rounding on every scheme. LG_SCHEME_VARIATIONAL, dense output and error estimates cannot be recorded.
 */
#ifndef LIEGRAD_TAPED_H
#define LIEGRAD_TAPED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/integrators.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_TAPED_MAX_PARTS (2 * LG_SPACE_MAX_FACTORS)

/* ---- Time ---- */

/* A time for each row of a batch: value + rows + weight step, where LG_NONE counts as zero. The interpreter
 * sets the last term: when the step is a variable, the time t + c h of a stage is recorded only if the field
 * uses it. */
typedef struct lg_taped_time {
    double value;
    lg_var rows; /* (B, 1) or LG_NONE */
    double weight;
    lg_var step; /* (B, 1) or LG_NONE */
} lg_taped_time;

/* False: the time is the number `value`. */
static inline bool lg_taped_time_varies(lg_taped_time t) {
    return !lg_is_none(t.rows) || !lg_is_none(t.step);
}
/* The time as a variable (batch, 1), constant when the time does not vary. Records at most two nodes. Errors:
 * those of the tape. */
LG_API lg_var lg_taped_time_rows(lg_tape *tape, lg_taped_time t, uint32_t batch);

/* ---- Differential equations ---- */

/* Writes the parts of f(t, y) in the algebra. `input` (B, m) is the input of the step, or LG_NONE. A field
 * may ignore t and the input; nothing is recorded for them then. Failures stick to the tape, and a status
 * other than LG_OK ends the run. Implicit schemes call the field during their iteration, use its forward mode
 * (lg_jvp), and rewind these nodes afterwards: the field may use variables made before the step, but must not
 * keep variables of its own. */
typedef lg_status (*lg_taped_field)(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                                    lg_var *algebra);
/* For splitting schemes: force -dV/dq from q, velocity dK/dp from p; t is the time of the positions. */
typedef lg_status (*lg_taped_half_field)(void *user, lg_tape *tape, lg_taped_time t, lg_var half,
                                         lg_var input, lg_var *out);

typedef struct lg_taped_ode {
    lg_space space;
    lg_taped_field field;         /* may be NULL when only splitting schemes are used */
    lg_taped_half_field force;    /* for splitting schemes, else NULL */
    lg_taped_half_field velocity; /* likewise */
    void *user;
    lg_space manifold; /* for schemes that project: where the joined states of R^n lie; its dim is that of
                        * `space`. factors 0: no manifold */
} lg_taped_ode;

/* ---- Points and algebra elements ---- */

/* From a state (B, dim), as the plain interpreter has it, to parts, and back. Errors: LG_STALE_HANDLE,
 * LG_SHAPE, the tape's. On failure the parts are not written, and lg_taped_join returns LG_NONE. */
LG_API lg_status lg_taped_split(lg_tape *tape, const lg_space *space, lg_var y, lg_var *parts);
LG_API lg_var lg_taped_join(lg_tape *tape, const lg_space *space, const lg_var *parts);

/* Number of parts of a point (and of an algebra element) of the space. */
LG_API size_t lg_taped_parts(const lg_space *space);

/* out = exp(a) . y; arrays of parts; `out` may be an input, here and below. Errors: those of the tape. */
LG_API lg_status lg_taped_act(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,
                              lg_var *out);
/* out = dexp_a^-1(b), truncation as in lg_space_dexpinv. Errors: LG_INVALID_ARGUMENT (truncation), the
 * tape's. */
LG_API lg_status lg_taped_dexpinv(lg_tape *tape, const lg_space *space, int truncation, const lg_var *a,
                                  const lg_var *b, lg_var *out);

/* out = a . y, ambient velocities; arrays of parts. */
LG_API lg_status lg_taped_generator(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,
                                    lg_var *out);

/* ---- Steps ---- */

/* Start and size of a step, and the input, which is constant over the step. Designated initialisers set the
 * members that are not named to LG_NONE:
 *   {.t = {.value = 0.5}, .h = 0.1}
 *   {.t = {.rows = times}, .h_rows = steps, .input = u} */
typedef struct lg_taped_interval {
    lg_taped_time t; /* the start */
    double h;        /* the step; not read when h_rows is set */
    lg_var h_rows;   /* (B, 1), a step for each row, or LG_NONE */
    lg_var input;    /* (B, m) for the field, or LG_NONE */
} lg_taped_interval;

/* One step from (t, y): out is the point at t + h; it may be y. Nothing is kept between calls, and a stage
 * that only the next step or an error estimate needs is not recorded. Times and steps as variables give the
 * same numbers as constants, to rounding. Errors: the same as lg_taped_integrate; LG_SHAPE (a
 * time, step or input that has not the stated shape with the state's B). On failure `out` is untouched. */
LG_API lg_status lg_taped_step_over(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    const lg_taped_interval *over, const lg_var *y, lg_var *out);
/* The same with one constant t and h for all rows, without input. */
LG_API lg_status lg_taped_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, double t,
                               double h, const lg_var *y, lg_var *out);

/* `steps` steps of size h from t0 and y0. Every `every`-th point is kept: out has (steps/every) x parts
 * variables, and row 0 is the point after `every` steps. A force at an unchanged q is evaluated once; FSAL
 * schemes reuse the last evaluation of a step. Memory on the tape grows linearly with steps. A step of an
 * implicit scheme keeps two evaluations of the field and a matrix (B, m, m), m the dimension of the algebra.
 * Errors, beside those of the field and the tape:
 * - LG_INVALID_ARGUMENT: steps or every 0, every does not divide steps, missing functions, an inconsistent
 *   scheme, a manifold of another dimension
 * - LG_UNSUPPORTED: an ambient, implicit or splitting scheme on a space that is not R^n, LG_SCHEME_SLGI on a
 *   space that is not T*G, LG_SCHEME_VARIATIONAL
 * - LG_NO_CONVERGENCE (an implicit stage), LG_NOT_FINITE (the field at its start) */
LG_API lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    double t0, double h, size_t steps, size_t every, const lg_var *y0,
                                    lg_var *out);

/* ---- gradients of long runs ----
 *
 * Gradients of functionals of a trajectory in its start and in parameters, with bounded memory.
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
 * used. */

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
