/* Holonomic constraints g(q) = 0 that a user writes as a program. Library liegrad. docs/hamiltonians.md is
 * the guide; examples/own_constraint shows the whole way from g to a learned Hamiltonian.
 *
 * A mechanical system with q in R^n, constant mass matrix M and m constraints moves on Q = {q: g(q) = 0}. Its
 * states (q, p) lie on T*Q: g(q) = 0 and P(q) p = p, where p = P M q' and
 *   G = dg/dq (m, n),   P = I - G^T (G G^T)^-1 G.
 * With W = M^-1, the velocity v and the Hamiltonian are
 *   v = W (p - G^T lambda),   (G W G^T) lambda = G W p,   H = 1/2 p.v + V(q).
 * So v is tangent, and 1/2 p.v = 1/2 p^T (P M P)^-1 p on the tangent space. The equations of motion are
 *   q' = P dH/dp,   p' = -P dH/dq + W(q, p) dH/dp,
 * with W(q, p) = P L^T P + L P - P L^T and L = d(P p)/dq. On T*Q this is
 *   q' = v,   p' = -P dH/dq - G^T (G G^T)^-1 (G'[v] p),   dH/dq = dV/dq - G'[v]^T lambda,
 * where G'[v] is the derivative of G along v. None of these formulas changes when the rows of G are
 * multiplied by numbers, so the units of g do not matter.
 *
 * The program has the functions
 *   constraint (q) -> g    q (n) and g (m), one row per state; 1 <= m < n <= 32
 *   potential (q) -> V     one number; needed to integrate and to generate data
 *   mass (q) -> M          (n), the diagonal, or (n, n); must not depend on q; default: the unit matrix
 * The range of q (lg_port.low, high) should be the range of the motion: random starts are drawn from it.
 *
 * What is refused. `rank` measures how far G is from losing rank, whatever the units of q and g are: row i of
 * G is divided by max(|G_i|, L |H_i|), where H_i is the Hessian of g_i and L a length that is typical of the
 * motion, such as |q| at the start; then `rank` is the smallest singular value, in 0..1. It is small where
 * constraints depend on each other, where a row of G vanishes, and near points where this happens. Below
 * LG_CONSTRAINT_LEAST_RANK nothing is computed.
 *
 * A state is q, then p (2n numbers). The object does not change after its creation: threads may share it. */
#ifndef LIEGRAD_CONSTRAINT_H
#define LIEGRAD_CONSTRAINT_H

#include "liegrad/mechanics.h"

LG_BEGIN_DECLS

#define LG_CONSTRAINT_MOST_COORDINATES 32
#define LG_CONSTRAINT_LEAST_RANK       1e-6 /* lowest `rank` */
#define LG_CONSTRAINT_TOLERANCE                                                                              \
    1e-6 /* largest distance of a start from T*Q, relative; see lg_constraint_look */

typedef struct lg_constraint lg_constraint;

/* Makes the object from a program, which is only read. Derivatives of g are exact. Errors, with the function
 * in `error`: LG_FORMAT (no function `constraint`; wrong inputs, outputs or sizes; a mass that depends on q
 * or is not symmetric and positive definite), LG_NOT_FINITE (a mass), those of lg_program_build and
 * lg_program_derive. */
LG_API lg_status lg_constraint_create(const lg_context *context, const lg_program *program,
                                      lg_constraint **out, lg_error *error);
LG_API void lg_constraint_destroy(lg_constraint *constraint);
LG_API uint32_t lg_constraint_coordinates(const lg_constraint *constraint); /* n */
LG_API uint32_t lg_constraint_equations(const lg_constraint *constraint);   /* m */
LG_API bool lg_constraint_moves(const lg_constraint *constraint); /* Whether there is a `potential`. */
/* The functions `constraint`, `potential` and `mass` as far as they were given, with constants in place of
 * parameters: what files of data carry. Belongs to the object. */
LG_API const lg_program *lg_constraint_program(const lg_constraint *constraint);

/* ---- points ---- */

typedef struct lg_constraint_view {
    double residual; /* largest |g_i| */
    double off;      /* |G^T (G G^T)^-1 g| / L, the distance of q from Q to first order, in units of L */
    double across;   /* |p - P p| / |p|; 0 for p = 0 */
    double rank;     /* see above */
} lg_constraint_view;

/* Looks at a state. `size` is L; 0 means |q|. Errors, with the point in `error`: LG_NOT_FINITE (g or its
 * derivatives), LG_FORMAT (rank below LG_CONSTRAINT_LEAST_RANK). `out` is written unless the status is
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_constraint_look(const lg_constraint *constraint, double size, const double *state,
                                    lg_constraint_view *out, lg_error *error);
/* Replaces q by the point of Q that Newton's method, q -= G^T (G G^T)^-1 g, finds from q, to rounding; then p
 * by P p. Errors: those of lg_constraint_look at the new point or at q; LG_NO_CONVERGENCE. Then `state` is
 * unchanged. */
LG_API lg_status lg_constraint_project(const lg_constraint *constraint, double size, double *state,
                                       lg_error *error);

/* ---- motions; LG_UNSUPPORTED without `potential` ---- */

/* H at a state on T*Q. Errors: LG_UNSUPPORTED. */
LG_API lg_status lg_constraint_energy(const lg_constraint *constraint, const double *state, double *out,
                                      lg_error *error);
/* `steps` steps of RATTLE (Andersen 1983) of size h, which is symplectic on T*Q. With u = p - G^T lambda:
 *   u += -h/2 dV/dq - G(q)^T l;   q += h W u, with l such that g(q) = 0;
 *   u += -h/2 dV/dq - G(q)^T k, with k such that G W u = 0.
 * Newton's method finds l to rounding, so |g(q)| does not grow with the number of steps. `order` is 2, or 4
 * for Suzuki's composition of five steps (each of the five counts as one in the cost, not in `steps`).
 * out (steps/every + 1, 2n) gets every `every`-th state, beginning with y0, which is not projected; p of the
 * others satisfies P p = p. Errors, with the time and the point in `error`: LG_INVALID_ARGUMENT (order, h,
 * steps, every does not divide steps), LG_NO_CONVERGENCE (h is too long, or the normals of Q turn by a right
 * angle within a step), LG_FORMAT and LG_NOT_FINITE as lg_constraint_look, LG_UNSUPPORTED, LG_CANCELLED. Rows
 * before the failure are written. */
LG_API lg_status lg_constraint_rattle(const lg_constraint *constraint, int order, double h, size_t steps,
                                      size_t every, const double *y0, double *out, lg_error *error);
/* The motion at `times` (increasing), which starts at y0 at times[0]: out (count, 2n). The scheme is dp85 in
 * R^2n with the relative tolerance `tolerance`; the state is projected onto T*Q at each of the times. For
 * exact data; lg_constraint_rattle is for long runs. Errors: those of lg_constraint_project and
 * lg_integrate_adaptive, LG_UNSUPPORTED. */
LG_API lg_status lg_constraint_flow(const lg_constraint *constraint, double tolerance, const double *times,
                                    size_t count, const double *y0, double *out, lg_error *error);

/* Samples trajectories as the options say; `starts`, `ahead`, `segments` and the tolerances are not used.
 * Starts: q is drawn evenly from the range of the port q and projected onto Q; p is P M v with v drawn evenly
 * from (low, high)^n. Start number i depends on `seed` and i only. Writes t (points), data (trajectories,
 * points, 2n) and hamiltonian (trajectories), the energies of the starts without noise; t and hamiltonian may
 * be NULL. Errors: LG_INVALID_ARGUMENT, LG_NO_CONVERGENCE (no start on Q was found in 1000 draws; LG_FORMAT
 * if the rank is the reason), those of lg_constraint_flow. */
LG_API lg_status lg_constraint_generate(const lg_constraint *constraint, const lg_trajectory_options *options,
                                        double *t, double *data, double *hamiltonian, lg_error *error);

LG_END_DECLS

#endif
