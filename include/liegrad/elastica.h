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

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"

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

/* ---- surrogates ----
 *
 * Surrogates of the elastica: networks that give the curve of a clamped beam from its boundary conditions
 * x = (q0, v0, qN, vN), 8 numbers.
 *
 * - LG_SURROGATE_DISCRETE: x -> the inner nodes and tangents (q_1, ..., q_{N-1}, v_1, ..., v_{N-1}), 4(N-1)
 *   numbers; the ends are those of x.
 *   Loss, with e_k the errors at node k and e_0 = e_N = 0: the mean square of the 4(N-1) errors plus gamma
 *   times the mean square of the e_{k+1} - e_k (2N of q, 2N of v). With `penalty` LG_SURROGATE_WEIGHTED it
 *   is the mean square of W e, e the vector of the 4(N-1) errors, W = I + gamma G'G, G = S - I,
 *   (S e)_i = e_{i+1} with 0 after the last number: (5.4.1) of the thesis as printed, while its program
 *   computes the other one.
 * - LG_SURROGATE_CONTINUOUS: (s/L, x) -> q(s); v = dq/ds is its derivative (forward mode).
 *   Loss: mean over points of (|q - q_k|^2 + |v - v_k|^2 + gamma (|v|^2 - 1)^2)/2; in the published program
 *   MSE(q) + MSE(v) + (gamma/2) mean (|v|^2 - 1)^2. A sample is a point (s_k, x).
 *   Option `boundary` holds q and v at both ends: with f the network, t = s/L and H the cubic through q0 and
 *   qN with the tangents v0 and vN,
 *     q = H(s) + 16 t^2 (1 - t)^2 f(t, x)
 * - LG_SURROGATE_ANGLE: theta(s) = pi f(theta_0/pi, theta_N/pi, s), v = (cos theta, sin theta), q = q_0 +
 *   int v ds by Gauss's rule of 3 points on panels; theta_0, theta_N in (-pi, pi] from v0, vN.
 *   Option `boundary` holds the end angles:
 *     theta = pi f(s) + (theta_0 - pi f(0)) e^{-100 s^2} + (theta_N - pi f(L)) e^{-100 (s-L)^2}
 *   For a short beam, whose e^{-100 L^2} is not negligible, the two weights are combined so that each is 1 at
 *   its end and 0 at the other.
 *   Option `symmetric` reconstructs q from both ends, as exact at s = L as at 0:
 *     q(s) = (1 - s/L) (q_0 + int_0^s v ds) + (s/L) (q_N - int_s^L v ds)
 *   Loss: mean over nodes of (|q - q_k|^2 + |v - v_k|^2)/2, without gamma. A sample is a curve; its Gauss
 *   points, 3 on each interval between two nodes, serve all its nodes.
 *
 * `normalise`: the x-coordinates of the ends enter as (x - centre)/centre, where centre is half the distance
 * of the ends in the training data. Positions are relative to q0, so moving a beam moves its curve.
 *
 * `between` (continuous network): a network trained at the nodes alone may turn freely between them. With
 * this option sample k of a curve is a point within half an interval of node k, another one in each curve.
 * For continuous data q and v there come from polynomials of degree 11 through six nodes and their tangents.
 * For discrete data, whose tangents are not quite the derivative of the curve, q and v each come from
 * polynomials through six nodes.
 *
 * `modes` (discrete network): K > 0 fixes the last layer. The network gives K coefficients c(x), and
 *     y = mean + sum_k c_k(x) s_k u_k
 *   are the 4(N-1) numbers (reflected by `mirror`, relative to q0). Of the training curves, mean is the mean,
 *   u_k are the leading singular vectors of the differences from it (orthonormal), s_k the root mean squares
 *   of the coefficients along them: every target of c_k has mean 0 and deviation 1. With gamma = 0 the loss
 *   is the mean over curves of sum_k s_k^2 (c_k - c_k*)^2/(4(N-1)), c* the targets. The rest of a curve is
 *   orthogonal to the u_k, so for any set of curves
 *     mean square error of the curves = loss + truncation,
 *   where truncation is the mean square of that rest, which no network lowers. With gamma > 0 the loss is
 *   that of LG_SURROGATE_DISCRETE. mean and s_k u_k are constants of the model, no parameters.
 *
 * `angles` (discrete network): the network gives N - 1 numbers f(x), and
 *     theta_k = theta_0 + (theta_N - theta_0) k/N + f_k(x),  v_k = (cos theta_k, sin theta_k)
 *   are the inner angles and tangents; the nodes follow from them as in liegrad/elastica.h. Tangents are
 *   units, and both ends are exact. theta_0, theta_N in (-pi, pi] come from v0, vN.
 *
 * `loss` LG_SURROGATE_ENERGY (needs `angles`): no curve is learned from. The loss is
 *     mean of (E(theta) - E_curve) L/EI
 *   over the boundary conditions, E the discrete energy of liegrad/elastica.h. Its minimum is the beams',
 *   since the constraints hold for all theta. E_curve, the energy of the data's curve, does not depend
 *   on the network: it makes the loss 0 where the network is as good as the data, and has no part in the
 *   gradient. `gamma` is not used.
 *
 * `mirror`: the problem is symmetric under reflection at the chord. Boundary conditions with v0y < vNy are
 * reflected (all y -> -y) together with their curve. So the network learns one half and is exactly
 * equivariant. If v0y = vNy, the sign of v0y decides, then that of qNy - q0y. */

typedef enum lg_surrogate_kind {
    LG_SURROGATE_DISCRETE,
    LG_SURROGATE_CONTINUOUS,
    LG_SURROGATE_ANGLE
} lg_surrogate_kind;
#define LG_SURROGATE_KIND_COUNT 3
LG_API const char *lg_surrogate_kind_name(lg_surrogate_kind kind); /* "discrete", "continuous", "angle" */

typedef enum lg_surrogate_loss { LG_SURROGATE_MSE, LG_SURROGATE_ENERGY } lg_surrogate_loss;
#define LG_SURROGATE_LOSS_COUNT 2
/* What gamma weighs in the loss of the discrete network. */
typedef enum lg_surrogate_penalty { LG_SURROGATE_DIFFERENCES, LG_SURROGATE_WEIGHTED } lg_surrogate_penalty;
#define LG_SURROGATE_PENALTY_COUNT 2
LG_API const char *lg_surrogate_loss_name(lg_surrogate_loss loss); /* "mse", "energy" */

/* Settings of a network; the data give its sizes. */
typedef struct lg_surrogate_options {
    lg_surrogate_kind kind;
    lg_net_kind architecture;
    uint32_t embedding, hidden, layers;
    lg_activation activation;
    bool normalise, mirror, boundary, between, symmetric;
    uint32_t modes; /* K, 0: all layers are learned */
    bool angles;
    lg_surrogate_loss loss;
    double gamma; /* of the loss, >= 0 */
    lg_surrogate_penalty penalty;
} lg_surrogate_options;

/* Immutable after lg_surrogate_init; plain data. */
typedef struct lg_surrogate {
    lg_surrogate_options options;
    lg_net net;
    uint32_t intervals; /* N of the training data */
    double length;      /* L */
    double centre;      /* for `normalise` */
    /* (K + 1, 4(N - 1)): mean, then s_k u_k. Set by the user (lg_surrogate_find_modes, or from a file) before
     * the model with `modes` is trained, recorded or saved. Borrowed: lives as long as the model is used. */
    const double *modes;
} lg_surrogate;

/* modes = NULL. Errors: LG_INVALID_ARGUMENT (boundary with the discrete network, symmetric without the angle
 * network, an unknown penalty, modes without the discrete
 * one or more than 4(N - 1), intervals < 2, a length or centre not positive and finite, gamma < 0, angles
 * without the discrete network or with modes, the energy without angles, what lg_net_init refuses). */
LG_API lg_status lg_surrogate_init(lg_surrogate *model, const lg_surrogate_options *options,
                                   uint32_t intervals, double length, double centre, lg_error *error);
LG_API size_t lg_surrogate_parameters(const lg_surrogate *model); /* those of its network */

/* ---- modes ---- */

/* K + 1 times 4(N - 1); 0 without modes. */
LG_API size_t lg_surrogate_modes_size(const lg_surrogate *model);
/* How many modes `count` curves, whose numbers `training` gives, need: the least K <= options.modes that
 * leaves at most 1e-12 of the variance of the curves, or a rest without a leading direction: the next mode
 * has less than a tenth of it, as in noise. K is less than `count`. Errors, *modes untouched: those of
 * lg_surrogate_find_modes. */
LG_API lg_status lg_surrogate_count_modes(const lg_context *context, const lg_surrogate *model,
                                          const lg_elastica_curves *curves, const uint32_t *training,
                                          size_t count, uint32_t *modes, lg_error *error);
/* Modes of `count` curves, whose numbers `training` gives, into modes (lg_surrogate_modes_size). Errors,
 * modes untouched: LG_INVALID_ARGUMENT (a model without modes, fewer than K + 1 curves, an index out of
 * range), LG_SHAPE (curves that do not fit the model), LG_OUT_OF_MEMORY, LG_NOT_FINITE. */
LG_API lg_status lg_surrogate_find_modes(const lg_context *context, const lg_surrogate *model,
                                         const lg_elastica_curves *curves, const uint32_t *training,
                                         size_t count, double *modes, lg_error *error);
/* Targets c* (count, K) of these curves by the model's modes, and the truncation (may be NULL):
 *   c*_k = u_k . (y - mean)/s_k, 0 for s_k = 0;  truncation = mean |y - mean - sum_k c*_k s_k u_k|^2/(4(N-1))
 * Errors: those of lg_surrogate_find_modes. */
LG_API lg_status lg_surrogate_coefficients(const lg_context *context, const lg_surrogate *model,
                                           const lg_elastica_curves *curves, const uint32_t *training,
                                           size_t count, double *coefficients, double *truncation,
                                           lg_error *error);

/* Published settings and our own. */
typedef struct lg_surrogate_preset {
    const char *name; /* "thesis", "best" */
    lg_surrogate_kind kind;
    bool boundary;
    bool merged;                /* data of both families */
    double fraction;            /* part of the data used for training; the nearest preset is taken */
    const char *source;         /* "table 5.3", ... */
    lg_surrogate_options model; /* its modes are a limit, for lg_surrogate_count_modes */
    lg_training training;
    uint64_t most_curves; /* to learn from; 0: all of the training part */
} lg_surrogate_preset;
/* The preset of this kind, `boundary`, `loss` (a member of its model) and kind of data. NULL for an unknown
 * name or a combination without a preset. Static storage. */
LG_API const lg_surrogate_preset *lg_surrogate_preset_find(const char *name, lg_surrogate_kind kind,
                                                           bool boundary, lg_surrogate_loss loss, bool merged,
                                                           double fraction);

/* ---- training ---- */

/* Splits curves into parts (n): lg_part of each curve (liegrad/nn.h). `seed` draws a permutation (in a stream
 * of its own). Its first test_fraction n entries (rounded) are the test part, which does not depend on
 * train_fraction; the next train_fraction n entries are the training part. LG_INVALID_ARGUMENT: fractions
 * outside [0, 1], together more than 1, or a training part without a curve. */
LG_API lg_status lg_surrogate_split(size_t n, double train_fraction, double test_fraction, uint64_t seed,
                                    uint8_t *parts);

/* A model and the curves it learns from. Borrowed. */
typedef struct lg_surrogate_problem {
    const lg_surrogate *model;
    const lg_elastica_curves *curves;
    const uint32_t *training; /* (training_count) indices of curves */
    size_t training_count;
    /* (training_count, K), from lg_surrogate_coefficients; only for a model with modes and gamma = 0. */
    const double *coefficients;
} lg_surrogate_problem;
/* LG_SHAPE: curves with another N (discrete) or length than the model's. LG_INVALID_ARGUMENT: nothing to
 * learn from, an index out of range, 2^32 samples or more, a model with modes without their numbers. */
LG_API lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error);
/* Fills a problem for lg_fit. `problem` is borrowed and must outlive the fit. */
LG_API void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out);

/* ---- as a program ---- */

/* A program with the parameter `theta` (with modes also `mean` and `modes`) and the functions of the kind:
 *   value  x -> y, and grad  x -> y, g: y and its Jacobian, as liegrad/model.h says for the kind
 *   point  continuous: s, x (8, one for all rows) -> q, v at s; angle: s, ends (5, one for all rows) -> theta
 *   place  continuous: s, x (8, one for all rows) -> q at s
 *   ends   angle: x (8) -> ends: R, theta_0, theta_N, theta_0 - pi f(0) and theta_N - pi f(L) (the last two
 *          are 0 without `boundary`)
 * Errors: those of lg_program_build. */
LG_API lg_status lg_surrogate_program(const lg_context *context, const lg_surrogate *model,
                                      const double *theta, lg_program **out, lg_error *error);

/* ---- use, without a tape ---- */

/* Plans for the curves of a network. They are immutable; threads may share them, each with its own work
 * memory. theta is copied and rounded to `dtype`, in which the program computes; cubics and integrals are
 * double. `points` is the usual number of points of a curve; it affects speed only. Errors: those of
 * lg_surrogate_program and lg_plan_create. */
typedef struct lg_surrogate_curves lg_surrogate_curves;
LG_API lg_status lg_surrogate_curves_create(const lg_context *context, const lg_surrogate *model,
                                            const double *theta, lg_dtype dtype, size_t points,
                                            lg_surrogate_curves **out, lg_error *error);
LG_API void lg_surrogate_curves_destroy(lg_surrogate_curves *curves); /* NULL is fine */
/* Bytes, to be aligned to 64. */
LG_API size_t lg_surrogate_curves_work_size(const lg_surrogate_curves *curves);
/* The curve of boundary conditions x (8) at s (points), 0 <= s <= L, rising: q, v (points, 2) or NULL.
 * - The discrete network interpolates between its nodes: cubic Hermite and its derivative. At a node the
 *   result is the network's own value.
 * - The angle network integrates over fixed panels, equal parts of the N intervals and at least 50, and from
 *   the last whole panel to s. The result at s depends on the other points by rounding only, and at the nodes
 *   of the data it follows the rule of the loss. q takes many more evaluations than v alone.
 * An x that is not finite makes the curve NaN, an s that is not finite its point. No allocation, no lock. */
LG_API void lg_surrogate_curve(const lg_surrogate_curves *curves, const double *x, const double *s,
                               size_t points, double *q, double *v, void *work);

/* Errors over nodes and components, in double precision. */
typedef struct lg_surrogate_errors {
    double mse; /* discrete: 4(N-1) inner components; others: 4(N+1) */
    double mse_q, mse_v;
    double max_error;            /* largest component */
    double boundary_error;       /* largest difference from the boundary conditions at s = 0 and L. The angle
                                  * network that is not `symmetric`: tangents only, because its q(L) follows
                                  * from its angles */
    double unit_tangent_error;   /* largest ||v| - 1| over all nodes */
    double unit_tangent_between; /* the same half-way between the nodes, where there are no data */
} lg_surrogate_errors;
/* Errors over the curves `chosen` (count); NULL: all curves, and count is not read. node_error (N + 1, 2) or
 * NULL: mean over the curves of |q - q_k| and of |v - v_k| at each node. Errors: LG_SHAPE as above,
 * LG_INVALID_ARGUMENT (no curves, an index out of range), LG_OUT_OF_MEMORY, LG_NOT_FINITE. */
LG_API lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model,
                                       const double *theta, const lg_elastica_curves *curves,
                                       const uint32_t *chosen, size_t count, double *node_error,
                                       lg_surrogate_errors *out, lg_error *error);

/* ---- range ---- */

/* A network's curve means nothing outside the boundary conditions that it was trained on: `trained` (n, 8),
 * those of the training part. The distance between two boundary conditions is the Euclidean one of
 * (v0, qN - q0, vN).
 *
 * The reach: each trained condition has a distance to its nearest neighbour. The n/100 largest of these
 * distances (at most 32) are left out, because single conditions may stand alone; the largest of the others
 * is returned. 0 for n < 2. */
LG_API double lg_surrogate_reach(const double *trained, size_t n);
/* Distance of x from the nearest trained boundary condition; for a model with `mirror` the smaller one of x
 * and its mirror image. Infinite for n = 0 or NaN in x. A query is outside the trained range when its
 * distance is more than twice the reach. */
LG_API double lg_surrogate_distance(const lg_surrogate *model, const double *trained, size_t n,
                                    const double *x);

/* ---- files of curves (library liegrad_io from here on) ---- */

typedef struct lg_elastica_data {
    lg_elastica_curves curves;
    char sha256[LG_SHA256_TEXT]; /* of boundary, q and v as little-endian doubles; set by reader and writer */
    lg_provenance provenance;
} lg_elastica_data;

/* Datasets /boundary (n, 8) as q0, v0, qN, vN; /q, /v (n, N + 1, 2); optional /energy, /x (n) and /case (n; 0
 * both-ends, 1 right-end); any integer or float type, any byte order, chunked and compressed as well.
 * Attributes of the root, optional: `length`, `stiffness` (10), `values` ("discrete" or "continuous";
 * discrete).
 *
 * Without `length` the reader estimates it from the curves, in two ways. The first is the sum over the
 * intervals of chord (phi/2)/sin(phi/2), phi the turning of the tangent (arcs). The second is N times the
 * regression of the second differences of q_k on those of (v_k + v_{k+1})/2 (exact for minimisers of the
 * discrete energy). The reader takes the estimate that varies less over the curves, from the first to the
 * last tenth, and rounds its median to three significant digits (at most 0.5 %). A length with more digits
 * needs the attribute.
 *
 * Checked: everything finite, 2 <= N <= LG_ELASTICA_MAX_INTERVALS, |v| = 1 within 1e-6 at the ends, the first
 * and last nodes and tangents are the boundary's within 1e-6 (1 + their size), no ends farther apart than
 * `length`. */
LG_API lg_status lg_elastica_data_read(const lg_context *context, const char *path,
                                       const lg_read_options *options, lg_elastica_data *out,
                                       lg_error *error);
/* Fills data->sha256. LG_NOT_FINITE for data that could not be read back; LG_INVALID_ARGUMENT for a length or
 * stiffness that is not positive, an unknown case. */
LG_API lg_status lg_elastica_data_write(const lg_context *context, const char *path, lg_elastica_data *data,
                                        lg_error *error);
LG_API void lg_elastica_data_destroy(lg_elastica_data *data);

/* ---- files of surrogates ---- */

typedef struct lg_surrogate_run {
    lg_surrogate model;
    lg_training training;
    double train_fraction, test_fraction;
    uint64_t most_curves; /* of the training part that are learned from; 0: all */
    uint64_t curves;      /* n of the data, before the split */
    bool continuous;      /* of the data's values */
    char data_sha256[LG_SHA256_TEXT];
} lg_surrogate_run;
/* The rows of lg_surrogate_run. The method is its network, in the order of lg_surrogate_kind. */
LG_API extern const lg_field lg_surrogate_fields[];

typedef struct lg_surrogate_file {
    lg_surrogate_run run;
    size_t parameters;
    double *theta; /* (parameters); stored as training.dtype */
    size_t trained_count;
    double *trained; /* (trained_count, 8): boundary conditions of the training part */
    double *modes;   /* loaded: the numbers behind run.model.modes; not read by lg_model_save_surrogate */
    bool has_errors;
    double train_mse, test_mse; /* test_mse NaN without a test part */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* as in lg_hamiltonian_file */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_surrogate_file;

/* Kind "surrogate": /model/embedding, /model/layer1, ... as lg_net_slice names them, /trained (n, 8; may be
 * missing when written by hand: then NULL), attributes `train_mse` and `test_mse` of the root; otherwise like
 * the model files of learned Hamiltonians, with the same laws. A model written by hand needs `kind` and the
 * attributes of /model: `network`, `architecture`, `activation`, `embedding`, `hidden`, `layers`,
 * `normalise`, `mirror`, `boundary`, `intervals`, `length`, `centre`, and for `modes` above 0 the arrays
 * /model/mean (4(N - 1)) and /model/modes (K, 4(N - 1)): s_k u_k of liegrad/surrogate.h. `fit` as
 * above. */
LG_API lg_status lg_model_save_surrogate(const lg_context *context, const char *path,
                                         const lg_surrogate_file *file, const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_surrogate(const lg_context *context, const char *path,
                                         const lg_read_options *options, lg_surrogate_file *out,
                                         lg_error *error);
LG_API void lg_surrogate_file_destroy(lg_surrogate_file *file);

LG_END_DECLS

#endif
