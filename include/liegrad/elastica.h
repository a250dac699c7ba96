/* Euler's elastica: equilibria of a planar inextensible beam clamped at both ends.
 *
 * The beam has length L and bending stiffness EI; its curve q(s), 0 <= s <= L, has the unit tangent
 * v(s) = q'(s) = (cos theta(s), sin theta(s)). The ends q(0), q(L), the angle theta(0) and the rotation
 * theta(L) - theta(0) are given. The curve minimises the bending energy (EI/2) int |q''|^2 ds. Units may be
 * any consistent ones: lengths in one unit, EI in energy times length.
 *
 * Discrete problem. On N equal intervals of length h = L/N the energy is the trapezoidal rule on
 * (EI/2)(|a_k^-|^2 + |a_{k+1}^+|^2) with
 *
 *   a_k^-     = ((-2 v_{k+1} - 4 v_k) h + 6 (q_{k+1} - q_k))/h^2,
 *   a_{k+1}^+ = ((4 v_{k+1} + 2 v_k) h - 6 (q_{k+1} - q_k))/h^2,
 *
 * subject to |v_k| = 1. For given tangents it is quadratic in q. Its minimum over q is a function of the
 * N - 1 inner angles,
 *
 *   E(theta) = (EI/h) sum_k (1 - cos(theta_{k+1} - theta_k)) + P |r|^2,   P = 18 EI N^2/L^3,
 *   r = (q_N - q_0) - h (v_0/2 + v_1 + ... + v_{N-1} + v_N/2),
 *   q_{k+1} = q_k + (h/2)(v_k + v_{k+1}) + (h/L) r,
 *
 * Its Hessian is tridiagonal plus a matrix of rank two, so a Newton step costs O(N). The inertia of the
 * Hessian is that of the constrained problem: a minimum has no negative eigenvalue.
 *
 * Continuous problem. EI theta'' = lx sin theta - ly cos theta with the end angles and int v ds = q_N - q_0;
 * (lx, ly) is the force in the beam.
 */
#ifndef LIEGRAD_ELASTICA_H
#define LIEGRAD_ELASTICA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

#define LG_ELASTICA_MIN_INTERVALS 2
#define LG_ELASTICA_MAX_INTERVALS 100000

/* A boundary value problem. Plain data. */
typedef struct lg_elastica {
    double length;      /* L > 0; 3.3 */
    double stiffness;   /* EI > 0; 10 */
    double q0[2];       /* (0, 0) */
    double qN[2];       /* (3, 0); |qN - q0| < L. It may be q0 */
    double theta0;      /* tangent angle at s = 0, radians; |theta0| <= 1e6 */
    double rotation;    /* theta(L) - theta(0) along the beam, radians: whole turns count. At most N/2 turns
                         * and at most 20 */
    uint32_t intervals; /* N, 50; the continuous problem gives the curve at the N + 1 nodes */
} lg_elastica;

/* The defaults named above, theta0 = rotation = 0. */
LG_API void lg_elastica_init(lg_elastica *problem);

/* Two families of boundary conditions over x, of period 2 pi. With w = x wrapped to (-pi, pi]:
 *   both-ends: theta0 = w, theta(L) = -w (rotation -2w);   right-end: theta0 = 0, theta(L) = -w.
 * The rotation is the one of the global minimum. x and 2 pi - x are mirror images. */
typedef enum lg_elastica_case { LG_ELASTICA_BOTH_ENDS, LG_ELASTICA_RIGHT_END } lg_elastica_case;
#define LG_ELASTICA_CASE_COUNT 2
LG_API const char *lg_elastica_case_name(lg_elastica_case kind); /* "both-ends", "right-end" */
/* Sets theta0 and rotation of *problem. */
LG_API void lg_elastica_set_case(lg_elastica *problem, lg_elastica_case kind, double x);

/* LG_INVALID_ARGUMENT, with a sentence: a number out of range, an endpoint farther away than L;
 * LG_NOT_FINITE. */
LG_API lg_status lg_elastica_check(const lg_elastica *problem, lg_error *error);

typedef struct lg_elastica_options {
    size_t size;               /* sizeof(lg_elastica_options) */
    double gradient_tolerance; /* 1e-12: largest |dE/dtheta_k| relative to the largest of its terms. With N in
                                * the thousands rounding of the angles exceeds it; the iteration then ends
                                * when its steps no longer shrink */
    uint32_t max_iterations;   /* 200: Newton steps for one problem of the continuation */
    double max_step;           /* 0.05: largest change of an end angle between two problems */
    const double *guess;       /* (N + 1) angles to start from instead of the continuation, or NULL */
} lg_elastica_options;
LG_API void lg_elastica_options_init(lg_elastica_options *options);

typedef struct lg_elastica_solution {
    double energy;
    double gradient; /* largest |dE/dtheta_k| at the solution. Its force 2 P r is an unknown of the iteration,
                      * because r computed from the angles loses digits like 1/N^2. Continuous problem:
                      * largest |EI theta'' - lx sin theta + ly cos theta| */
    double residual; /* of the discrete Euler-Lagrange equations in (q, v, Lambda) at the rounded nodes and
                      * tangents, relative to their largest term. Rounding alone gives about 1e-11 at N = 50
                      * and grows like N^2 to N^3. Continuous problem: largest defect of the differential
                      * equation, relative to the larger of force and EI theta'^2/2 */
    double force[2]; /* (lx, ly): the multiplier of q(L) - q(0), which is d energy/d(qN - q0) */
    uint32_t negative_eigenvalues; /* of the Hessian in the inner angles; 0: a local minimum */
    uint32_t iterations;           /* Newton steps in all */
    uint32_t problems;             /* of the continuation, the last one included */
} lg_elastica_solution;

/* Finds a minimum by continuation from a moderate problem. For the two cases above it is the global minimum.
 * When the continuation fails, the result is the lowest minimum found from many starts. At x = 0 two arches
 * have the same energy, and the upper one is returned. At x = pi (w = pi) the result is the limit of the
 * loops for w < pi. With options->guess the result is the stationary point that a damped, descending Newton
 * method finds from the guess. theta: N + 1 angles, theta[0] = theta0, theta[N] = theta0 + rotation to
 * rounding; neighbouring angles differ by less than pi. `options` NULL: defaults; `solution` may be NULL.
 * Errors: those of lg_elastica_check, LG_OUT_OF_MEMORY, LG_CANCELLED, and LG_NO_CONVERGENCE:
 * - no solution; the sentence has the gradient that was reached. Possible reasons: too few intervals for the
 *   loops of the rotation; a loop far from both ends of a taut beam, whose position is undetermined
 * - the result is no minimum; the sentence says so, and theta and solution are filled */
LG_API lg_status lg_elastica_solve(const lg_context *context, const lg_elastica *problem,
                                   const lg_elastica_options *options, double *theta,
                                   lg_elastica_solution *solution, lg_error *error);
/* The same for the continuous problem, by Chebyshev collocation. Panels are refined until the defect is at
 * `gradient_tolerance`. The start is a discrete solution, found from the guess when there is one. theta
 * (N + 1) and q (N + 1, 2) are values at the nodes s_k = k h; q, which may be NULL, comes from the quadrature
 * of the collocation. Negative eigenvalues are those of the second variation under the constraint. */
LG_API lg_status lg_elastica_solve_continuous(const lg_context *context, const lg_elastica *problem,
                                              const lg_elastica_options *options, double *theta, double *q,
                                              lg_elastica_solution *solution, lg_error *error);

/* Nodes and tangents of the discrete curve, (N + 1, 2) each, from its angles; either may be NULL. */
LG_API void lg_elastica_curve(const lg_elastica *problem, const double *theta, double *q, double *v);
/* E(theta). */
LG_API double lg_elastica_energy(const lg_elastica *problem, const double *theta);
/* The discrete Euler-Lagrange equations of the action (trapezoidal energy) + h sum Lambda_k (|v_k|^2 - 1) at
 * any nodes and tangents q, v (N + 1, 2). lambda (N - 1), which may be NULL, becomes the multipliers
 * Lambda_1..Lambda_{N-1}. Returns the largest residual of the equations (as in lg_elastica_solution) and of
 * |v_k|^2 = 1; NaN when q or v is not finite. */
LG_API double lg_elastica_euler_lagrange(const lg_elastica *problem, const double *q, const double *v,
                                         double *lambda);

/* All equilibria of the discrete problem that a search from many starts finds, by rising energy: theta
 * (room, N + 1), solutions (room). They are minima; with `saddles` all stationary points except those with a
 * kink, an angle of pi/2 or more between neighbouring nodes. When more are found than fit, the lowest are
 * kept. *count is the number stored, 0 when there is none. The rotation is fixed: the same tangents with
 * whole turns more or less are another problem. Deterministic. Errors: those of lg_elastica_check,
 * LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY, LG_CANCELLED. */
LG_API lg_status lg_elastica_branches(const lg_context *context, const lg_elastica *problem,
                                      const lg_elastica_options *options, bool saddles, size_t room,
                                      double *theta, lg_elastica_solution *solutions, size_t *count,
                                      lg_error *error);

/* ---- sets of curves ---- */

/* n curves over families of boundary conditions. */
typedef struct lg_elastica_curves {
    size_t count;       /* n */
    uint32_t intervals; /* N */
    double length, stiffness;
    bool continuous;           /* true: nodes of continuous solutions; false: discrete solutions */
    double *boundary;          /* (n, 8): q0, v0, qN, vN */
    double *q, *v;             /* (n, N + 1, 2) */
    double *energy;            /* (n), or NULL */
    double *x;                 /* (n), or NULL */
    uint32_t *kind;            /* (n), lg_elastica_case of each, or NULL */
    const lg_context *context; /* whose memory the arrays are in */
} lg_elastica_curves;

typedef struct lg_elastica_sampling {
    bool both_ends, right_end; /* which families, in this order; at least one */
    size_t count;              /* curves of each; 1000 */
    double gap;                /* distance kept from x = 0, pi and 2 pi, in units of pi; 0.01, in [0, 0.5) */
    bool continuous;           /* false: discrete solutions */
    lg_elastica problem;       /* endpoints, length, stiffness, intervals */
    int threads;               /* 1 */
} lg_elastica_sampling;
LG_API void lg_elastica_sampling_init(lg_elastica_sampling *sampling); /* both-ends only */

/* x takes equidistant values in the interval [gap pi, (1 - gap) pi] and in its mirror image, ends included:
 * count/2 values in each, one more in the first when count is odd. A single value lies at the beginning of
 * its interval. The optional arrays are filled. The result does not depend on `threads`. Errors: those of the
 * solver, with the x of the curve; LG_INVALID_ARGUMENT. */
LG_API lg_status lg_elastica_generate(const lg_context *context, const lg_elastica_sampling *sampling,
                                      lg_elastica_curves *out, lg_error *error);
LG_API void lg_elastica_curves_destroy(lg_elastica_curves *curves); /* leaves it zeroed */

LG_END_DECLS

#endif
