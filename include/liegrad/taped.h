/* Integrators that the tape can see through: the schemes of liegrad/integrators.h on batches of trajectories.
 *
 * A point of a space and an element of its algebra are tuples of variables, the parts, in the order of the
 * space's factors:
 * - LG_SPACE_RN of dimension n: one part (B, n); algebra: one part (B, n)
 * - LG_SPACE_TS2 with k copies: two parts q, p (B, k, 3); algebra: two parts u, v (B, k, 3)
 *
 * Splitting schemes take two parts q, p (B, n). Everything recorded can be differentiated to any order, in
 * the start and in whatever the field depends on. The plain interpreter and this one agree to rounding on
 * every scheme.
 */
#ifndef LIEGRAD_TAPED_H
#define LIEGRAD_TAPED_H

#include "liegrad/integrators.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_TAPED_MAX_PARTS (2 * LG_SPACE_MAX_FACTORS)

/* Writes the parts of f(t, y) in the algebra. Failures stick to the tape; a status other than LG_OK ends the
 * run. */
typedef lg_status (*lg_taped_field)(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *algebra);
/* For splitting schemes: force -dV/dq from q, velocity dK/dp from p. */
typedef lg_status (*lg_taped_half_field)(void *user, lg_tape *tape, double t, lg_var half, lg_var *out);

typedef struct lg_taped_ode {
    lg_space space;
    lg_taped_field field;         /* NULL only when all that is used is a splitting scheme */
    lg_taped_half_field force;    /* for splitting schemes, else NULL */
    lg_taped_half_field velocity; /* likewise */
    void *user;
} lg_taped_ode;

/* Number of parts of a point (and of an algebra element) of the space. */
LG_API size_t lg_taped_parts(const lg_space *space);

/* out = exp(a) . y; arrays of parts. */
LG_API lg_status lg_taped_act(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y,
                              lg_var *out);
/* out = dexp_a^-1(b), truncation as in lg_space_dexpinv. */
LG_API lg_status lg_taped_dexpinv(lg_tape *tape, const lg_space *space, int truncation, const lg_var *a,
                                  const lg_var *b, lg_var *out);

/* `steps` steps of size h from t0 and y0. Every `every`-th point is kept: out has (steps/every) x parts
 * variables, row 0 is the point after `every` steps. A force at an unchanged q is evaluated once. Memory on
 * the tape grows linearly with steps. Errors: LG_INVALID_ARGUMENT (steps or every 0, every not dividing
 * steps, missing functions, inconsistent scheme), LG_UNSUPPORTED (an ambient or splitting scheme on a space
 * that is not R^n), the field's, the tape's. */
LG_API lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                    double t0, double h, size_t steps, size_t every, const lg_var *y0,
                                    lg_var *out);

LG_END_DECLS

#endif
