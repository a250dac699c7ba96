/* Integrators that the tape can see through: the schemes of liegrad/integrators.h on batches of trajectories.
 *
 * A point of a space and an element of its algebra are tuples of variables, the parts, in the order of the
 * space's factors:
 * - LG_SPACE_RN of dimension n: one part (B, n); algebra: one part (B, n)
 * - LG_SPACE_TS2 and LG_SPACE_SE3_DUAL with k copies: two parts (B, k, 3), q and p, or G and P; algebra: two
 *   parts u, v (B, k, 3)
 * - LG_SPACE_SO3 with k copies: one part R (B, k, 9) row-major; algebra: one part u (B, k, 3)
 * - LG_SPACE_SE3 with k copies: two parts R (B, k, 9), r (B, k, 3); algebra: two parts u, v (B, k, 3)
 * - LG_SPACE_SO3_DUAL with k copies: one part x (B, k, 3); algebra: one part u (B, k, 3)
 *
 * Splitting schemes take R^n x R^n, two parts q, p (B, n), or R^2n, one part with q before p. Rows of a batch
 * are independent trajectories: a field's row depends on the same row of the state, the input and the time
 * only.
 *
 * Everything recorded can be differentiated to any order, in the start, the input, time and step size where
 * they are variables, and in whatever the field depends on, except steps of implicit schemes,
 * LG_SCHEME_IMPLICIT and LG_SCHEME_SLGI: those find their stage with plain numbers and record two Newton
 * corrections at it, whose first and second derivatives are exact (higher ones are not). The plain
 * interpreter and this one agree to rounding on every scheme. LG_SCHEME_VARIATIONAL has no taped form; dense
 * output and error estimates have none either.
 */
#ifndef LIEGRAD_TAPED_H
#define LIEGRAD_TAPED_H

#include "liegrad/integrators.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_TAPED_MAX_PARTS (2 * LG_SPACE_MAX_FACTORS)

/* ---- Time ---- */

/* A time for each row of a batch: value + rows + weight step, where LG_NONE counts as zero. The last term is
 * the interpreter's: where the step is a variable, a stage's t + c h is recorded only if its field asks for
 * it. */
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
/* The time as a variable (batch, 1), a constant one where it does not vary; at most two nodes. Errors: those
 * of the tape. */
LG_API lg_var lg_taped_time_rows(lg_tape *tape, lg_taped_time t, uint32_t batch);

/* ---- Differential equations ---- */

/* Writes the parts of f(t, y) in the algebra. `input` is what the step was given, (B, m), or LG_NONE. A field
 * that does not depend on t, or on the input, ignores it and nothing is recorded for it. Failures stick to
 * the tape; a status other than LG_OK ends the run. Implicit schemes call it while they search, on nodes that
 * are rewound afterwards: it may use variables made before the step, but must not keep any that it made. They
 * ask for its forward mode (lg_jvp). */
typedef lg_status (*lg_taped_field)(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                                    lg_var *algebra);
/* For splitting schemes: force -dV/dq from q, velocity dK/dp from p; t is the time of the positions. */
typedef lg_status (*lg_taped_half_field)(void *user, lg_tape *tape, lg_taped_time t, lg_var half,
                                         lg_var input, lg_var *out);

typedef struct lg_taped_ode {
    lg_space space;
    lg_taped_field field;         /* NULL only when all that is used is a splitting scheme */
    lg_taped_half_field force;    /* for splitting schemes, else NULL */
    lg_taped_half_field velocity; /* likewise */
    void *user;
    lg_space manifold; /* for schemes that project: where the states of R^n, joined, ought to lie; its dim is
                        * that of `space`. factors 0: everywhere */
} lg_taped_ode;

/* ---- Points and algebra elements ---- */

/* From a state as the plain interpreter has it, (B, dim), to parts, and back. Errors: LG_STALE_HANDLE,
 * LG_SHAPE, the tape's; on failure nothing is written, or LG_NONE returned. */
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

/* From where a step goes, how far, and the input that is held meanwhile. With designated initialisers what is
 * not named is LG_NONE: {.t = {.value = 0.5}, .h = 0.1}; {.t = {.rows = times}, .h_rows = steps, .input = u}.
 */
typedef struct lg_taped_interval {
    lg_taped_time t; /* the start */
    double h;        /* the step where h_rows is LG_NONE, else not read */
    lg_var h_rows;   /* (B, 1), a step for each row, or LG_NONE */
    lg_var input;    /* (B, m), goes to the field as it is, or LG_NONE */
} lg_taped_interval;

/* One step from (t, y): out is the point at t + h; it may be y. Nothing is kept between calls; a stage that
 * only the next step or an error estimate would use is not recorded. A row equals the step with the same
 * numbers as constants to rounding. Errors as lg_taped_integrate, and on the tape too LG_SHAPE (a time, step
 * or input whose shape is not as said, B that of the state); on failure `out` is untouched. */
LG_API lg_status lg_taped_step_over(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    const lg_taped_interval *over, const lg_var *y, lg_var *out);
/* The same with one constant t and h for all rows, without input. */
LG_API lg_status lg_taped_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, double t,
                               double h, const lg_var *y, lg_var *out);

/* `steps` steps of size h from t0 and y0. Every `every`-th point is kept: out has (steps/every) x parts
 * variables, row 0 is the point after `every` steps. A force at an unchanged q is evaluated once, and so is
 * what FSAL schemes know at the end of a step. Memory on the tape grows linearly with steps; a step of an
 * implicit scheme keeps two evaluations of the field and a matrix of (B, m, m), m the dimension of the
 * algebra. Errors: LG_INVALID_ARGUMENT (steps or every 0, every not dividing steps, missing functions,
 * inconsistent scheme, a manifold of another dimension), LG_UNSUPPORTED (an ambient, implicit or splitting
 * scheme on a space that is not R^n, LG_SCHEME_SLGI on one that is not its own, LG_SCHEME_VARIATIONAL),
 * LG_NO_CONVERGENCE (an implicit stage) and LG_NOT_FINITE (the field at its start), both also on the tape;
 * the field's, the tape's. */
LG_API lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    double t0, double h, size_t steps, size_t every, const lg_var *y0,
                                    lg_var *out);

LG_END_DECLS

#endif
