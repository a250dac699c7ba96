/* Integrators on a tape: steps of the schemes of liegrad/integrators.h are recorded for batches of
 * trajectories, so that they can be differentiated. The last section computes gradients of long runs in
 * bounded memory. The library is liegrad.
 *
 * A point of a space and an element of its algebra are arrays of variables, called parts. They follow the
 * space's factors in order. B is the number of rows of the batch:
 * - LG_SPACE_RN of dimension n: one part (B, n), or a tensor (B, ...) with n numbers per row; algebra: one
 *   part of the same shape
 * - LG_SPACE_TS2 and LG_SPACE_SE3_DUAL with k copies: two parts (B, k, 3), q and p, or G and P; algebra: two
 *   parts u and v (B, k, 3)
 * - LG_SPACE_SO3 with k copies: one part R (B, k, 9), row-major; algebra: one part u (B, k, 3)
 * - LG_SPACE_SE3 with k copies: two parts R (B, k, 9) and r (B, k, 3); algebra: two parts u and v (B, k, 3)
 * - LG_SPACE_SO3_DUAL with k copies: one part x (B, k, 3); algebra: one part u (B, k, 3)
 *
 * A state, or a value of a field, of another shape is an error LG_SHAPE. Errors of all functions up to the
 * section on long runs stick to the tape, and functions that return a status return the tape's status.
 *
 * Splitting schemes take the space R^n x R^n with two parts q and p (B, n), or R^2n with one part that has q
 * before p. Rows of a batch are independent trajectories: row b of a field may depend only on row b of the
 * state, of the input and of the time.
 *
 * Steps can be differentiated to any order with respect to the start, everything that the field depends
 * on, and the input, the time and the step size where they are variables. Implicit schemes
 * (LG_SCHEME_IMPLICIT, LG_SCHEME_SLGI) are an exception: they find their stage with plain numbers and
 * record two Newton corrections there, whose first and second derivatives are exact; higher derivatives
 * are not. lg_stepper_step and lg_taped_step agree to rounding for every scheme that can be recorded.
 * LG_SCHEME_VARIATIONAL, dense output and error estimates cannot be recorded; implicit schemes cannot be
 * recorded in a program (liegrad/program.h). */
#ifndef LIEGRAD_TAPED_H
#define LIEGRAD_TAPED_H

#include "liegrad/integrators.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

#define LG_TAPED_MAX_PARTS (2 * LG_SPACE_MAX_FACTORS)

/* ---- Time ---- */

/* A time per row of a batch: value + rows + weight * step, where LG_NONE counts as zero. Callers set
 * `value` and `rows`. The integrator sets `weight` and `step`: when the step size is a variable, the time
 * t + c h of a stage is recorded only if the field uses it. */
typedef struct lg_taped_time {
    double value;
    lg_var rows; /* (B, 1) or LG_NONE */
    double weight;
    lg_var step; /* (B, 1) or LG_NONE */
} lg_taped_time;

/* True when the time is a variable, false when it is the number `value`. */
static inline bool lg_taped_time_varies(lg_taped_time t) {
    return !lg_is_none(t.rows) || !lg_is_none(t.step);
}
/* Returns the time as a variable (batch, 1), which is constant when the time does not vary. Records at
 * most two nodes. Errors: LG_SHAPE (the parts of the time are not (batch, 1)), those of the tape; returns
 * LG_NONE then. */
LG_API lg_var lg_taped_time_rows(lg_tape *tape, lg_taped_time t, uint32_t batch);

/* ---- Differential equations ---- */

/* The right-hand side: writes the parts of f(t, y), an algebra element, to `algebra`. `y` has the parts of
 * the state. `input` (B, m) is the input of the step, or LG_NONE. A field may ignore the time and the
 * input; then nothing is recorded for them. Errors of recorded operations stick to the tape; a status
 * other than LG_OK ends the run, too. Implicit schemes call the field within their iteration, also in
 * forward mode (lg_jvp), and then rewind the tape to remove these nodes. Therefore the field may use
 * variables made before the step, but must not keep variables that it made itself. */
typedef lg_status (*lg_taped_field)(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                                    lg_var *algebra);
/* One half of a separable system, for splitting schemes: the force -dV/dq where `half` is q, the velocity
 * dK/dp where `half` is p. t is the time that the positions q have reached. `out` has the shape of `half`. */
typedef lg_status (*lg_taped_half_field)(void *user, lg_tape *tape, lg_taped_time t, lg_var half,
                                         lg_var input, lg_var *out);

typedef struct lg_taped_ode {
    lg_space space;
    lg_taped_field field;         /* May be NULL when only splitting schemes are used. */
    lg_taped_half_field force;    /* For splitting schemes, else NULL. */
    lg_taped_half_field velocity; /* For splitting schemes, else NULL. */
    void *user;
    /* For schemes with `project`: the manifold in R^n on which the states lie; its dim equals that of
     * `space`. factors = 0 means that there is no manifold. */
    lg_space manifold;
} lg_taped_ode;

/* ---- Points and algebra elements ---- */

/* lg_taped_split cuts a state (B, dim), in the order of the plain integrators, into its parts;
 * lg_taped_join makes the state of the parts. Errors: LG_STALE_HANDLE, LG_SHAPE, those of the tape. On
 * failure the parts are not written, and lg_taped_join returns LG_NONE. */
LG_API lg_status lg_taped_split(lg_tape *tape, const lg_space *space, lg_var y, lg_var *parts);
LG_API lg_var lg_taped_join(lg_tape *tape, const lg_space *space, const lg_var *parts);

/* Number of parts of a point of the space; an algebra element has the same number of parts. */
LG_API size_t lg_taped_parts(const lg_space *space);

/* out = exp(a) . y. The arguments are arrays of parts; here and in the next two functions `out` may be one
 * of the inputs. Errors: those of the tape, among them LG_SHAPE. */
LG_API lg_status lg_taped_act(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,
                              lg_var *out);
/* out = dexp_a^-1(b); `truncation` is as in lg_space_dexpinv. Errors: LG_INVALID_ARGUMENT (no such
 * truncation), those of the tape. */
LG_API lg_status lg_taped_dexpinv(lg_tape *tape, const lg_space *space, int truncation, const lg_var *a,
                                  const lg_var *b, lg_var *out);

/* out = a . y, the ambient velocity that the algebra element a gives at y, in parts of the shapes of y.
 * Errors: those of the tape. */
LG_API lg_status lg_taped_generator(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,
                                    lg_var *out);

/* ---- Steps ---- */

/* Start and size of one step, and the input, which is constant over the step. In a designated initialiser the
 * members that are not named become zero, which is LG_NONE for a variable:
 *   {.t = {.value = 0.5}, .h = 0.1}
 *   {.t = {.rows = times}, .h_rows = steps, .input = u} */
typedef struct lg_taped_interval {
    lg_taped_time t; /* The time at the start. */
    double h;        /* The step size of all rows; not read when h_rows is set. */
    lg_var h_rows;   /* (B, 1), a step size per row, or LG_NONE. */
    lg_var input;    /* (B, m), for the field, or LG_NONE. */
} lg_taped_interval;

/* One step from (t, y): `out` becomes the parts of the point at t + h; `out` may be y. Nothing is kept
 * between calls. A stage that only the next step or an error estimate would need is not recorded. Times
 * and step sizes given as variables give the same numbers as constants, to rounding. Errors: those of
 * lg_taped_integrate; LG_SHAPE (the time, step size or input has not the stated shape with the B of the
 * state). */
LG_API lg_status lg_taped_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                               const lg_taped_interval *over, const lg_var *y, lg_var *out);

/* Records `steps` steps of size h from the point y0 at t0, without an input. `every` must divide `steps`. The
 * point after every `every`-th step is kept: out has (steps/every) x lg_taped_parts variables, first the
 * parts of the point after `every` steps. A force at an unchanged q is evaluated once, and FSAL schemes use
 * the last evaluation of a step in the next one. The memory on the tape grows linearly with `steps`. A step
 * of an implicit scheme keeps two evaluations of the field and a matrix (B, m, m), where m is the dimension
 * of the algebra. Errors, besides those of the field and the tape:
 * - LG_INVALID_ARGUMENT: steps or every is 0, every does not divide steps, a function that the scheme needs
 *   is missing, an inconsistent scheme, a manifold of another dimension than the space
 * - LG_UNSUPPORTED: an ambient, implicit or splitting scheme on a space that is not R^n, LG_SCHEME_SLGI on a
 *   space that is not T*G, an implicit scheme in a program, LG_SCHEME_VARIATIONAL
 * - LG_NO_CONVERGENCE: Newton's method for an implicit stage
 * - LG_NOT_FINITE: the field at the start of an implicit step */
LG_API lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    double t0, double h, size_t steps, size_t every, const lg_var *y0,
                                    lg_var *out);

/* ---- A step as a function of a program ---- */

/* Adds the function `step` (x, u, h -> next) to a program that has the function `field`: next (dim) is the
 * state one step of size h (1) after x (dim), by `scheme`. `field` (x, u -> algebra element of `space`) is
 * the equation; u may be missing, then step has no u either. u is constant over the step. Splitting
 * schemes also need the functions force (q, u -> p') and drift (p -> q'). h_low and h_high are the
 * range of step sizes (lg_port). Other functions can call `step`, and lg_program_add_loop repeats it:
 *   lg_space_init_rn(&space, 2);
 *   lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0.01, 0.1, &error);
 * Errors: LG_NOT_FOUND (no function `field`), LG_SHAPE (inputs of `field` that do not fit the space),
 * LG_INVALID_ARGUMENT (step sizes), LG_UNSUPPORTED (a scheme that cannot be recorded, or does not fit the
 * space), those of lg_program_add_function. On failure the program is unchanged. */
LG_API lg_status lg_program_add_step(lg_program *program, const lg_space *space, const lg_scheme *scheme,
                                     double h_low, double h_high, lg_error *error);

/* ---- Gradients of long runs ----
 *
 * Gradients of a functional J of a trajectory with respect to its start and to parameters, with bounded
 * memory. With y_{n+1} = Phi_n(y_n, theta), the step of size h_n from t_n,
 *
 *   J = sum_n J_n(y_n),   lambda_N = dJ_N/dy,   lambda_n = dJ_n/dy + (dPhi_n/dy)^T lambda_{n+1},
 *   dJ/dy_0 = lambda_0,   dJ/dtheta = sum_n (dPhi_n/dtheta)^T lambda_{n+1}.
 *
 * This is the derivative of the discrete flow, exact to rounding. The steps are given and held fixed: equal
 * steps, or the steps that an adaptive integration accepted (lg_step_controller.observe reports them).
 *
 * First the plain integrator computes all states once and keeps C + 1 checkpoints: the starts of C segments
 * of floor(N/C) or ceil(N/C) steps, and the end. Then, from the last segment to the first, it computes the
 * states inside the segment again, with the same bits, and each step of the segment is recorded alone on a
 * tape and swept backwards. The time is at most that of two plain integrations and one recorded integration.
 * The memory is
 *
 *   8 dim (C + 1 + ceil(N/C)) bytes of states + the tape of one step.
 *
 * It is smallest near C = sqrt(N): a million steps of 120 numbers take 2 MB. lg_adjoint_stats reports the
 * memory used. */

/* Fills in `ode`, the equation in the form that the tape can record, with the same parameters.
 * `parameters` is a variable of shape (parameter_count) on this tape, or LG_NONE when there are none. It
 * is called before each recorded step, when the tape holds only the state and the parameters. Memory that
 * `ode` points to must live until the next call. The space of `ode` has the dimension of the plain space;
 * for splitting schemes it may be R^2n as one factor or as two. A status other than LG_OK ends the run. */
typedef lg_status (*lg_adjoint_bind)(void *user, lg_tape *tape, lg_var parameters, lg_taped_ode *ode);

/* The derivative of J_n with respect to the state y after n steps (n = 0 is the start), at time t: adds
 * dJ_n/dy to `gradient` (dim numbers, which are zero before the call). It is called once per n, from N
 * down to 0. A status other than LG_OK ends the run. */
typedef lg_status (*lg_adjoint_source)(void *user, size_t n, double t, const double *y, double *gradient);

typedef struct lg_adjoint_problem {
    size_t size; /* sizeof(lg_adjoint_problem) */
    const lg_scheme *scheme;
    /* The equation in plain doubles, with the same parameters as `bind` uses. */
    const lg_ode *ode;
    lg_adjoint_bind bind;
    const double *parameters; /* parameter_count numbers, borrowed. */
    size_t parameter_count;
    lg_adjoint_source source;
    void *user; /* First argument of bind and source. */
    /* Start times and sizes of the N steps, all finite; h < 0 goes back in time. */
    const double *t, *h;
    size_t steps;       /* N >= 1 */
    size_t checkpoints; /* C in 1..N; 0 means ceil(sqrt(N)). */
} lg_adjoint_problem;

typedef struct lg_adjoint_stats {
    size_t checkpoints; /* C */
    size_t states_size; /* Bytes of states: 8 dim (C + 1 + ceil(N/C)) */
    size_t tape_size;   /* Bytes: the largest size that the tape had. */
    double seconds;
} lg_adjoint_stats;

/* Sets the size and zeroes everything else. */
LG_API void lg_adjoint_problem_init(lg_adjoint_problem *problem);

/* Integrates from y0 (dim) and computes the gradient of J. The outputs are y_end (dim), the state after
 * step N; dy0 (dim), which is dJ/dy0 as a vector of the ambient space that is not projected (see
 * lg_space_project_gradient); and dparameters (parameter_count), which is dJ/dtheta. Each output may be
 * NULL and is then not computed. `stats` may be NULL. Before the run the first step is computed both with
 * problem->ode and with the equation that `bind` fills in, and the two results are compared. Errors:
 * LG_INVALID_ARGUMENT (the problem is inconsistent, or the two results differ by more than 1e-8 of the
 * largest |y_i|), LG_UNSUPPORTED (the scheme cannot be recorded on a tape), LG_NOT_FINITE (a state or the
 * gradient), LG_CANCELLED, those of the field, of bind and of source. */
LG_API lg_status lg_adjoint_gradient(const lg_context *context, const lg_adjoint_problem *problem,
                                     const double *y0, double *y_end, double *dy0, double *dparameters,
                                     lg_adjoint_stats *stats, lg_error *error);

/* Projects the ambient gradient g (dim) at y onto the tangent space of the manifold at y, orthogonally in
 * the ambient metric, in place. Products of g with tangent vectors stay the same; products with normal
 * vectors become zero. */
LG_API void lg_space_project_gradient(const lg_space *space, const double *y, double *g);

LG_END_DECLS

#endif
