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
 * are independent trajectories: a field's row depends on the same row of the state only.
 *
 * Everything recorded can be differentiated to any order, in the start and in whatever the field depends on,
 * except steps of implicit schemes, LG_SCHEME_IMPLICIT and LG_SCHEME_SLGI: those find their stage with plain
 * numbers and record two Newton corrections at it, whose first and second derivatives are exact (higher ones
 * are not). The plain interpreter and this one agree to rounding on every scheme. LG_SCHEME_VARIATIONAL has
 * no taped form; dense output and error estimates have none either.
 */
#ifndef LIEGRAD_TAPED_H
#define LIEGRAD_TAPED_H

#include "liegrad/integrators.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_TAPED_MAX_PARTS (2 * LG_SPACE_MAX_FACTORS)

/* Writes the parts of f(t, y) in the algebra. Failures stick to the tape; a status other than LG_OK ends the
 * run. Implicit schemes call it while they search, on nodes that are rewound afterwards: it may use variables
 * made before the step, but must not keep any that it made. They ask for its forward mode (lg_jvp). */
typedef lg_status (*lg_taped_field)(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *algebra);
/* For splitting schemes: force -dV/dq from q, velocity dK/dp from p. */
typedef lg_status (*lg_taped_half_field)(void *user, lg_tape *tape, double t, lg_var half, lg_var *out);

typedef struct lg_taped_ode {
    lg_space space;
    lg_taped_field field;         /* NULL only when all that is used is a splitting scheme */
    lg_taped_half_field force;    /* for splitting schemes, else NULL */
    lg_taped_half_field velocity; /* likewise */
    void *user;
    lg_space manifold; /* for schemes that project: where the states of R^n, joined, ought to lie; its dim is
                        * that of `space`. factors 0: everywhere */
} lg_taped_ode;

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

/* One step of size h from (t, y): out is the point at t + h; it may be y. Nothing is kept between calls; a
 * stage that only the next step or an error estimate would use is not recorded. Errors as lg_taped_integrate;
 * on failure `out` is untouched. */
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
