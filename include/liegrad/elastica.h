/* Euler's elastica: equilibria of a planar inextensible beam that is clamped at both ends, sets of such
 * curves, and surrogates, which are networks that give the curve of a beam from its boundary conditions. The
 * functions are in the library liegrad, those from "files of curves" on in liegrad_io. The guide is
 * docs/beams.md.
 *
 *   lg_elastica beam;
 *   double theta[51];
 *   lg_elastica_init(&beam);                                       (50 intervals)
 *   lg_elastica_set_case(&beam, LG_ELASTICA_BOTH_ENDS, 1.0);
 *   lg_status status = lg_elastica_solve(NULL, &beam, NULL, theta, NULL, &error);
 *
 * The beam has length L and bending stiffness EI. Its curve q(s), 0 <= s <= L, has the unit tangent v(s) =
 * q'(s) = (cos theta(s), sin theta(s)). Given are the ends q(0) and q(L), the angle theta(0) and the rotation
 * theta(L) - theta(0). The curve minimises the bending energy (EI/2) int |q''|^2 ds. Any consistent units may
 * be used: all lengths in one unit, EI in energy times length, angles in radians.
 *
 * Discrete problem. There are N equal intervals of length h = L/N. The energy is the trapezoidal rule for
 * (EI/2) |q''|^2, the sum over the intervals of (h/2)(EI/2)(|a_k^-|^2 + |a_{k+1}^+|^2) with
 *
 *   a_k^-     = ((-2 v_{k+1} - 4 v_k) h + 6 (q_{k+1} - q_k))/h^2,
 *   a_{k+1}^+ = ((4 v_{k+1} + 2 v_k) h - 6 (q_{k+1} - q_k))/h^2,
 *
 * subject to |v_k| = 1. For given tangents the energy is quadratic in q. Its minimum over q is a function of
 * the N - 1 inner angles,
 *
 *   E(theta) = (EI/h) sum_k (1 - cos(theta_{k+1} - theta_k)) + P |r|^2,   P = 18 EI N^2/L^3,
 *   r = (q_N - q_0) - h (v_0/2 + v_1 + ... + v_{N-1} + v_N/2),
 *
 * with the nodes q_{k+1} = q_k + (h/2)(v_k + v_{k+1}) + (h/L) r. The Hessian of E is a tridiagonal matrix
 * plus a matrix of rank two, so a Newton step costs O(N). The Hessian has as many negative eigenvalues as the
 * second variation of the constrained problem; a minimum has none.
 *
 * Continuous problem. EI theta'' = lx sin theta - ly cos theta with the given end angles and int v ds =
 * q(L) - q(0), where (lx, ly) is the force in the beam.
 */
#ifndef LIEGRAD_ELASTICA_H
#define LIEGRAD_ELASTICA_H

#include "liegrad/fit.h"
#include "liegrad/model.h"

LG_BEGIN_DECLS

/* ---- one beam ---- */

#define LG_ELASTICA_MIN_INTERVALS 2
#define LG_ELASTICA_MAX_INTERVALS 100000

/* A boundary value problem. Plain data. The comments give the values of lg_elastica_init. */
typedef struct lg_elastica {
    double length;    /* L > 0; default 3.3 */
    double stiffness; /* EI > 0; default 10 */
    double q0[2];     /* default (0, 0) */
    double qN[2];     /* default (3, 0). |qN - q0| < L is required; qN may be equal to q0 */
    double theta0;    /* angle of the tangent at s = 0, radians; |theta0| <= 1e6; default 0 */
    /* theta(L) - theta(0), radians; default 0. It is followed along the beam, so whole turns count. It may
     * have at most N/2 turns and at most 20 turns. */
    double rotation;
    uint32_t intervals; /* N, default 50. The continuous problem gives the curve at the N + 1 nodes */
} lg_elastica;

/* Sets the defaults that are named in the structure. */
LG_API void lg_elastica_init(lg_elastica *problem);

/* Two families of boundary conditions over a parameter x, of period 2 pi. With w = x wrapped to (-pi, pi]:
 *   both-ends: theta(0) = w, theta(L) = -w (rotation -2w);   right-end: theta(0) = 0, theta(L) = -w.
 * With this rotation the minimum is the global one. The curves of x and of 2 pi - x are mirror images. */
typedef enum lg_elastica_case { LG_ELASTICA_BOTH_ENDS, LG_ELASTICA_RIGHT_END } lg_elastica_case;
#define LG_ELASTICA_CASE_COUNT 2
/* "both-ends" or "right-end"; "unknown" for any other value. */
LG_API const char *lg_elastica_case_name(lg_elastica_case kind);
/* Sets theta0 and rotation of *problem. An unknown family changes nothing. */
LG_API void lg_elastica_set_case(lg_elastica *problem, lg_elastica_case kind, double x);

/* Checks the ranges that are named in lg_elastica. Errors: LG_NOT_FINITE; LG_INVALID_ARGUMENT (a number is
 * out of range, the ends are L or more apart). */
LG_API lg_status lg_elastica_check(const lg_elastica *problem, lg_error *error);

/* The comments give the values of lg_elastica_options_init. */
typedef struct lg_elastica_options {
    size_t size; /* sizeof(lg_elastica_options) */
    /* Default 1e-12, in (0, 1). The iteration ends when the largest |dE/dtheta_k|, divided by the largest
     * term in the sums of the gradient, is at most this. For N in the thousands rounding of the angles
     * exceeds the tolerance; the iteration then ends when its steps no longer shrink. */
    double gradient_tolerance;
    uint32_t max_iterations; /* default 200, >= 1: limit of Newton steps per problem of the continuation */
    /* Default 0.05, in (1e-4, 1]: largest change of an end angle between two problems of the continuation,
     * radians. */
    double max_step;
    const double *guess; /* (N + 1) angles to start from instead of a continuation; default NULL: no guess */
} lg_elastica_options;
LG_API void lg_elastica_options_init(lg_elastica_options *options);

typedef struct lg_elastica_solution {
    double energy;
    /* Discrete problem: largest |dE/dtheta_k| at the solution. The force 2 P r in this gradient is an unknown
     * of the iteration, because r computed from the angles loses digits like 1/N^2. Continuous problem:
     * largest |EI theta'' - lx sin theta + ly cos theta|. */
    double gradient;
    /* Discrete problem: residual of the Euler-Lagrange equations in (q, v, Lambda) at the rounded nodes and
     * tangents, divided by the largest term of the equations (lg_elastica_euler_lagrange). Rounding alone
     * gives about 1e-11 at N = 50 and grows like N^2 to N^3. Continuous problem: largest defect of the
     * differential equation, divided by the larger of the force and EI theta'^2/2. */
    double residual;
    double force[2];               /* (lx, ly): the multiplier of q(L) - q(0), equal to d energy/d(qN - q0) */
    uint32_t negative_eigenvalues; /* of the Hessian in the inner angles; 0 means a local minimum */
    uint32_t iterations;           /* total number of Newton steps */
    uint32_t problems;             /* number of problems solved in the continuation, the last one included */
} lg_elastica_solution;

/* Finds a minimum of the discrete problem by continuation, which starts from a problem with end angles of at
 * most 1 radian. For the two families above it is the global minimum. When the continuation fails, the result
 * is the lowest minimum found from many starts. At x = 0 two arches have the same energy; the upper one is
 * returned. At x = pi (w = pi) the result is the limit of the loops for w < pi. With options->guess the
 * result is the stationary point that a damped, descending Newton method finds from the guess.
 *
 * theta becomes the N + 1 angles: theta[0] = theta0, and theta[N] = theta0 + rotation up to rounding.
 * Neighbouring angles differ by less than pi. `options` NULL stands for the defaults; `solution` may be NULL.
 * Errors: the errors of lg_elastica_check, LG_INVALID_ARGUMENT (an option out of range), LG_NOT_FINITE (the
 * guess), LG_CANCELLED, and LG_NO_CONVERGENCE in two cases:
 * - No solution was found. The sentence has the gradient that was reached. Possible reasons are too few
 *   intervals for the loops of the rotation, or a loop far from both ends of a taut beam, whose position is
 *   undetermined.
 * - The equilibrium found is no minimum. The sentence says so, and theta and solution are filled. */
LG_API lg_status lg_elastica_solve(const lg_context *context, const lg_elastica *problem,
                                   const lg_elastica_options *options, double *theta,
                                   lg_elastica_solution *solution, lg_error *error);
/* Solves the continuous problem by Chebyshev collocation; arguments and errors as for lg_elastica_solve.
 * Panels are refined until the defect is at most `gradient_tolerance`. The collocation starts from a discrete
 * solution, which is found from options->guess if it is given. theta (N + 1) and q (N + 1, 2) become the
 * values at the nodes s_k = k h. q may be NULL; it comes from the quadrature of the collocation.
 * negative_eigenvalues is the number of negative eigenvalues of the second variation under the constraint. */
LG_API lg_status lg_elastica_solve_continuous(const lg_context *context, const lg_elastica *problem,
                                              const lg_elastica_options *options, double *theta, double *q,
                                              lg_elastica_solution *solution, lg_error *error);

/* Computes the nodes q and tangents v of the discrete curve, (N + 1, 2) each, from its angles theta (N + 1).
 * q or v may be NULL. */
LG_API void lg_elastica_curve(const lg_elastica *problem, const double *theta, double *q, double *v);
/* The discrete energy E of the angles theta (N + 1). */
LG_API double lg_elastica_energy(const lg_elastica *problem, const double *theta);
/* Checks the discrete Euler-Lagrange equations at any nodes q and tangents v, (N + 1, 2) each. The action is
 * the trapezoidal energy plus h sum Lambda_k (|v_k|^2 - 1). lambda (N - 1), which may be NULL, becomes the
 * multipliers Lambda_1..Lambda_{N-1}. Returns the largest residual of the equations, relative to their
 * largest term, or the largest ||v_k|^2 - 1| if that is larger. NaN if q or v is not finite. */
LG_API double lg_elastica_euler_lagrange(const lg_elastica *problem, const double *q, const double *v,
                                         double *lambda);

/* Finds equilibria of the discrete problem from many starts and sorts them by rising energy: theta
 * (room, N + 1), solutions (room). Without `saddles` only minima are kept. With `saddles` all stationary
 * points are kept, except those with a kink, which is an angle of pi/2 or more between neighbouring tangents.
 * If more are found than `room`, the lowest are kept. *count becomes the number stored, 0 if none was found.
 * The rotation is fixed: a problem with the same end tangents and one more turn is another problem. The
 * result is deterministic. options->guess is not used. Errors: the errors of lg_elastica_check,
 * LG_INVALID_ARGUMENT (room is 0, an option out of range), LG_CANCELLED. */
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
    double *q, *v;             /* (n, N + 1, 2) nodes and tangents */
    double *energy;            /* (n), or NULL */
    double *x;                 /* (n) parameter of the family, or NULL */
    uint32_t *kind;            /* (n) family as lg_elastica_case, or NULL */
    const lg_context *context; /* in whose memory the arrays are */
} lg_elastica_curves;

/* The comments give the values of lg_elastica_sampling_init. */
typedef struct lg_elastica_sampling {
    bool both_ends, right_end; /* families to generate, at least one; default: both_ends only */
    size_t count;              /* number of curves per family; default 1000 */
    double gap;                /* least distance of x/pi from 0, 1 and 2; in [0, 0.5); default 0.01 */
    bool continuous;           /* true: continuous solutions; false, the default: discrete solutions */
    lg_elastica problem; /* beam of all curves; its end angles are not used; default as lg_elastica_init */
    int threads;         /* 1 to 1024; default 1 */
} lg_elastica_sampling;
LG_API void lg_elastica_sampling_init(lg_elastica_sampling *sampling);

/* Generates the curves of the chosen families: all both-ends curves, then all right-end curves. In each
 * family x takes equidistant values in the interval [gap pi, (1 - gap) pi] and in its mirror image, the ends
 * of the intervals included: count/2 values in each interval, one more in the first if count is odd. A single
 * value lies at the beginning of its interval. energy, x and kind of *out are filled too. The result does not
 * depend on `threads`. Errors: LG_INVALID_ARGUMENT, the errors of the solver (the sentence has the family and
 * x of the curve). */
LG_API lg_status lg_elastica_generate(const lg_context *context, const lg_elastica_sampling *sampling,
                                      lg_elastica_curves *out, lg_error *error);
LG_API void lg_elastica_curves_destroy(lg_elastica_curves *curves);

/* ---- surrogates ----
 *
 * Networks that give the curve of a clamped beam from its boundary conditions x = (q0, v0, qN, vN), 8
 * numbers. "The thesis" is the published work that docs/reports/accuracy.md reproduces.
 *
 *   LG_SURROGATE_DISCRETE    x -> the inner nodes and tangents (q_1, ..., q_{N-1}, v_1, ..., v_{N-1}), 4(N-1)
 *                            numbers; the ends are taken from x
 *   LG_SURROGATE_CONTINUOUS  (s/L, x) -> q(s); the tangent v = dq/ds is its derivative (forward mode)
 *   LG_SURROGATE_ANGLE       theta(s) = pi f(theta_0/pi, theta_N/pi, s), where f is the network, and theta_0
 *                            and theta_N in (-pi, pi] are the angles of v0 and vN; v = (cos theta, sin
 *                            theta), and q = q_0 + int v ds by Gauss's rule of 3 points on panels
 *
 * docs/beams.md ("How the networks learn") has the formulas of the losses, and of what the options below
 * change. A sample is a curve; of the continuous network without `energy` and `residual` a point (s_k, x). */

typedef enum lg_surrogate_kind {
    LG_SURROGATE_DISCRETE,
    LG_SURROGATE_CONTINUOUS,
    LG_SURROGATE_ANGLE
} lg_surrogate_kind;
#define LG_SURROGATE_KIND_COUNT 3
/* "discrete", "continuous" or "angle"; "unknown" for any other value. */
LG_API const char *lg_surrogate_kind_name(lg_surrogate_kind kind);

typedef enum lg_surrogate_loss { LG_SURROGATE_MSE, LG_SURROGATE_ENERGY } lg_surrogate_loss;
#define LG_SURROGATE_LOSS_COUNT 2
/* How gamma enters the loss of the discrete network: as a weight of differences, or in the matrix W. */
typedef enum lg_surrogate_penalty { LG_SURROGATE_DIFFERENCES, LG_SURROGATE_WEIGHTED } lg_surrogate_penalty;
#define LG_SURROGATE_PENALTY_COUNT 2

/* Settings of a network. The sizes of its input and output follow from the data. */
typedef struct lg_surrogate_options {
    lg_surrogate_kind kind;
    lg_net_kind architecture;
    uint32_t embedding, hidden, layers; /* arguments of lg_net_init */
    lg_activation activation;
    bool normalise, mirror, boundary, between, symmetric;
    uint32_t modes; /* K; 0 means that all layers are learned */
    bool angles;
    lg_surrogate_loss loss;
    double gamma;            /* weight in the loss, >= 0 */
    double energy, residual; /* weights in the loss, >= 0 */
    lg_surrogate_penalty penalty;
} lg_surrogate_options;

/* The description of a network; plain data, immutable after lg_surrogate_init except `modes`. The parameters
 * are a separate vector theta (lg_surrogate_parameters). */
typedef struct lg_surrogate {
    lg_surrogate_options options;
    lg_net net;
    uint32_t intervals; /* N of the training data */
    double length;      /* L */
    double centre;      /* scale of the x-coordinates with `normalise` */
    /* (K + 1, 4(N - 1)): the mean curve, then s_k u_k for each of the K modes: its singular value times its
     * singular vector. The caller sets it (from lg_surrogate_find_modes
     * or from a file) before a model with options.modes > 0 is trained, recorded or saved. Borrowed: the
     * array must live as long as the model is used. */
    const double *modes;
} lg_surrogate;

/* Makes a model for beams of `length` with N = `intervals`; `centre` is used by `normalise`. Sets
 * model->modes to NULL. Errors: LG_INVALID_ARGUMENT (`boundary` with the discrete network, `symmetric`
 * without the angle network, an unknown kind, loss or penalty, `modes` without the discrete network or more
 * than 4(N - 1), `angles` without the discrete network or together with `modes`, an energy or a residual that
 * the kind of network does not have, intervals out of range, a length or centre that is not positive and
 * finite, a weight that is negative or not finite), the errors of lg_net_init. */
LG_API lg_status lg_surrogate_init(lg_surrogate *model, const lg_surrogate_options *options,
                                   uint32_t intervals, double length, double centre, lg_error *error);
LG_API size_t lg_surrogate_parameters(const lg_surrogate *model); /* number of parameters of its network */

/* ---- modes ---- */

/* Length of lg_surrogate.modes: (K + 1) 4(N - 1); 0 for a model without modes. */
LG_API size_t lg_surrogate_modes_size(const lg_surrogate *model);
/* Computes how many modes the training curves need. training (count) has the indices of these curves. *modes
 * becomes the least K <= options.modes for which one of two conditions holds: the modes after K have at most
 * 1e-12 of the variance of the curves; or, as in noise, mode K + 1 has less than a tenth of the variance of
 * all modes after K. If there is no such K, *modes is options.modes. Errors: the errors of
 * lg_surrogate_find_modes. */
LG_API lg_status lg_surrogate_count_modes(const lg_context *context, const lg_surrogate *model,
                                          const lg_elastica_curves *curves, const uint32_t *training,
                                          size_t count, uint32_t *modes, lg_error *error);
/* Computes the mean and the modes of the training curves, whose indices are training (count), and writes them
 * to modes (lg_surrogate_modes_size). Errors: LG_INVALID_ARGUMENT (a model without modes, fewer than K + 1
 * curves, an index out of range), LG_SHAPE (curves that do not fit the model), LG_NOT_FINITE. */
LG_API lg_status lg_surrogate_find_modes(const lg_context *context, const lg_surrogate *model,
                                         const lg_elastica_curves *curves, const uint32_t *training,
                                         size_t count, double *modes, lg_error *error);
/* Computes the targets coefficients (count, K) of the curves with the indices training (count), from
 * model->modes. *truncation (may be NULL) becomes the mean square that the modes leave out:
 *   c*_k = u_k . (y - mean)/s_k, 0 for s_k = 0;  truncation = mean |y - mean - sum_k c*_k s_k u_k|^2/(4(N-1))
 * Errors: LG_INVALID_ARGUMENT (a model without modes, model->modes NULL, an index out of range), LG_SHAPE. */
LG_API lg_status lg_surrogate_coefficients(const lg_context *context, const lg_surrogate *model,
                                           const lg_elastica_curves *curves, const uint32_t *training,
                                           size_t count, double *coefficients, double *truncation,
                                           lg_error *error);

/* ---- presets ---- */

/* A set of settings: published in the thesis, or our own. */
typedef struct lg_surrogate_preset {
    const char *name; /* "thesis" or "best" (our own) */
    lg_surrogate_kind kind;
    bool boundary;
    bool merged;                /* the data have curves of both families */
    double fraction;            /* part of the data that is used for training */
    const char *source;         /* where the settings are from, and how they differ from the text; "ours" */
    lg_surrogate_options model; /* model.modes is an upper limit, for lg_surrogate_count_modes */
    lg_fit_settings training;
    uint64_t most_curves; /* largest number of curves to learn from; 0: the whole training part */
} lg_surrogate_preset;
/* Returns the preset with this name, kind, boundary, model.loss and merged. Of several, it returns the one
 * whose fraction is nearest. NULL for an unknown name or a combination without a preset. */
LG_API const lg_surrogate_preset *lg_surrogate_preset_find(const char *name, lg_surrogate_kind kind,
                                                           bool boundary, lg_surrogate_loss loss, bool merged,
                                                           double fraction);

/* ---- training ---- */

/* Splits n curves: parts (n) becomes the lg_part of each curve (liegrad/fit.h). The split is drawn with
 * `seed` in a random stream of its own. test_fraction n curves (rounded) are the test part, which does not
 * depend on train_fraction. train_fraction n of the other curves are the training part. The rest is
 * LG_PART_NONE. Errors: LG_INVALID_ARGUMENT (fractions outside [0, 1] or with a sum above 1, or a training
 * part without a curve). */
LG_API lg_status lg_surrogate_split(size_t n, double train_fraction, double test_fraction, uint64_t seed,
                                    uint8_t *parts);

/* A model and the curves it learns from. All pointers are borrowed. */
typedef struct lg_surrogate_problem {
    const lg_surrogate *model;
    const lg_elastica_curves *curves;
    const uint32_t *training; /* (training_count) indices of the curves to learn from */
    size_t training_count;
    /* (training_count, K), from lg_surrogate_coefficients; needed only for a model with modes and gamma =
     * 0. */
    const double *coefficients;
} lg_surrogate_problem;
/* Checks a problem. Errors: LG_SHAPE (the curves have another length than the model, or, for the discrete
 * network, another N), LG_INVALID_ARGUMENT (nothing to learn from, an index out of range, 2^32 samples or
 * more, a model with modes without model->modes or coefficients). */
LG_API lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error);
/* Fills *out for lg_fit. `problem` is borrowed and must outlive the fit. */
LG_API void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out);

/* ---- as a program ---- */

/* Makes a program with the parameter `theta` (with modes also `mean` and `modes`) and these functions. s and
 * x of `point` and `place` are: s per row, x (8) or ends (5) shared by all rows.
 *   value  all kinds: x -> y, and grad  x -> y, g: y and its Jacobian, with the inputs and outputs that
 *          liegrad/model.h lists for the kind
 *   point  continuous: s, x -> q, v at s; angle: s, ends -> theta at s
 *   place  continuous: s, x -> q at s
 *   ends   angle: x (8) -> ends: R, theta_0, theta_N, theta_0 - pi f(0), theta_N - pi f(L). R is -1 if
 *          `mirror` reflects x, and otherwise 1. The last two numbers are 0 without `boundary`
 *   span   angle: s, ends, length -> the integral of (cos theta, sin theta) from s to s + length, by Gauss's
 *          rule of 3 points
 * theta (lg_surrogate_parameters) is copied. Errors: LG_INVALID_ARGUMENT (a model with modes whose
 * model->modes is NULL), the errors of lg_program_build. */
LG_API lg_status lg_surrogate_program(const lg_context *context, const lg_surrogate *model,
                                      const double *theta, lg_program **out, lg_error *error);

/* ---- evaluation without a tape ---- */

/* Makes plans that compute the curves of a network. They are immutable; threads may share them, each with its
 * own work memory. theta is copied and rounded to `dtype`, in which the program's functions compute; cubics
 * and sums of integrals are computed in double. `points` is the usual number of points per curve and affects
 * only the speed. Errors: the errors of lg_surrogate_program and lg_plan_create. */
typedef struct lg_surrogate_curves lg_surrogate_curves;
LG_API lg_status lg_surrogate_curves_create(const lg_context *context, const lg_surrogate *model,
                                            const double *theta, lg_dtype dtype, size_t points,
                                            lg_surrogate_curves **out, lg_error *error);
LG_API void lg_surrogate_curves_destroy(lg_surrogate_curves *curves);
/* Bytes of work memory for lg_surrogate_curve; the memory must be aligned to 64 bytes. */
LG_API size_t lg_surrogate_curves_work_size(const lg_surrogate_curves *curves);
/* Computes the curve for the boundary conditions x (8) at the arc lengths s (points), 0 <= s <= L, in rising
 * order. q and v (points, 2) receive positions and tangents; each may be NULL.
 * - The discrete network is interpolated between its nodes by a cubic Hermite polynomial and its derivative.
 *   At a node the result is the network's output, or x at the ends.
 * - The angle network is integrated over fixed panels, equal parts of the N intervals and at least 50, and
 *   then from the end of the last whole panel to s. So the result at s depends on the other points by
 *   rounding only, and at the nodes of the data it follows the quadrature of the loss. q costs many more
 *   evaluations of the network than v alone.
 * If x is not finite the whole curve is NaN; if one s is not finite that point is NaN. Does not allocate or
 * lock. */
LG_API void lg_surrogate_curve(const lg_surrogate_curves *curves, const double *x, const double *s,
                               size_t points, double *q, double *v, void *work);

/* Errors of a network over the nodes and components of given curves. The network is evaluated in double. */
typedef struct lg_surrogate_errors {
    double mse; /* mean square; discrete network: the 4(N-1) inner components, others: all 4(N+1) */
    double mse_q, mse_v;
    double max_error; /* largest absolute error of a component */
    /* Largest difference from the boundary conditions at s = 0 and s = L. For the angle network without
     * `symmetric` only the tangents count, because its q(L) follows from its angles. */
    double boundary_error;
    double unit_tangent_error;   /* largest ||v| - 1| over all nodes */
    double unit_tangent_between; /* largest ||v| - 1| half-way between the nodes, where there are no data */
} lg_surrogate_errors;
/* Computes the errors over the curves with the indices chosen (count). `chosen` NULL stands for all curves;
 * `count` is then not read. node_error (N + 1, 2), or NULL, becomes the means over the curves of |q - q_k|
 * and of |v - v_k| at each node. Errors: LG_SHAPE (curves that do not fit the model), LG_INVALID_ARGUMENT (no
 * curves, an index out of range), LG_NOT_FINITE (the differences). */
LG_API lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model,
                                       const double *theta, const lg_elastica_curves *curves,
                                       const uint32_t *chosen, size_t count, double *node_error,
                                       lg_surrogate_errors *out, lg_error *error);

/* ---- trained range ----
 *
 * The curve that a network gives is meaningless outside the boundary conditions that it was trained on.
 * `trained` (n, 8) has those of the training part. docs/beams.md ("Range") has the definitions: a query is
 * outside if its lg_surrogate_distance is more than twice the lg_surrogate_reach, or its
 * lg_surrogate_off_family more than twice the lg_surrogate_spread. */

/* The largest distance of a trained boundary condition from its nearest neighbour, after the n/100 largest
 * (at most 32) are left out, because a few conditions may stand alone. 0 for n < 2. */
LG_API double lg_surrogate_reach(const double *trained, size_t n);
/* The distance of x (8) from the nearest trained boundary condition; for a model with `mirror` the smaller of
 * the distances of x and of its mirror image. Infinite for n = 0 or a NaN in x. */
LG_API double lg_surrogate_distance(const lg_surrogate *model, const double *trained, size_t n,
                                    const double *x);
/* The distance of x (8) from the nearest line through two of the six nearest trained boundary conditions,
 * extended at both ends by the distance of the two. Mirror images, n = 0, NaN: as for
 * lg_surrogate_distance. */
LG_API double lg_surrogate_off_family(const lg_surrogate *model, const double *trained, size_t n,
                                      const double *x);
/* The largest distance of a trained boundary condition from the family of the others, without the n/100
 * largest ones; but at least r^2/2 (the height of an arc of unit curvature above a chord of 2 r) and 2 % of r
 * for the reach r. */
LG_API double lg_surrogate_spread(const double *trained, size_t n);

/* ---- files of curves (library liegrad_io from here on) ---- */

typedef struct lg_elastica_data {
    lg_elastica_curves curves;
    char sha256[LG_SHA256_TEXT]; /* of boundary, q, v as little-endian doubles; set by reader and writer */
    lg_provenance provenance;
} lg_elastica_data;

/* Reads an HDF5 file of curves: the datasets /boundary, /q and /v and what else docs/files.md lists, with the
 * way in which it estimates a length that the file does not have. Errors: LG_FORMAT also for N outside
 * LG_ELASTICA_MIN_INTERVALS .. LG_ELASTICA_MAX_INTERVALS, curves that do not begin and end as /boundary says,
 * and ends that are farther apart than `length`. */
LG_API lg_status lg_elastica_data_read(const lg_context *context, const char *path,
                                       const lg_read_options *options, lg_elastica_data *out,
                                       lg_error *error);
/* Writes a file of curves in this form (kind "elastica") and fills data->sha256. Errors: LG_NOT_FINITE (a
 * number is not finite), LG_INVALID_ARGUMENT (a length or stiffness that is not positive, an unknown family),
 * LG_FILE. */
LG_API lg_status lg_elastica_data_write(const lg_context *context, const char *path, lg_elastica_data *data,
                                        lg_error *error);
LG_API void lg_elastica_data_destroy(lg_elastica_data *data);

/* ---- files of surrogates ---- */

/* Model, training and data of a run. Models and checkpoints store it. */
typedef struct lg_surrogate_run {
    lg_surrogate model;
    lg_fit_settings training;
    double train_fraction, test_fraction;
    uint64_t most_curves; /* largest number of curves of the training part to learn from; 0: all */
    uint64_t curves;      /* number of curves in the data, before the split */
    bool continuous;      /* the data are continuous solutions */
    double stiffness;     /* EI of the data; 0 if unknown (files of earlier versions) */
    char data_sha256[LG_SHA256_TEXT];
} lg_surrogate_run;
/* The fields of lg_surrogate_run, ended by a row whose name is NULL (liegrad/settings.h). Bit k of
 * lg_field.methods stands for the lg_surrogate_kind with the value k. */
LG_API extern const lg_field lg_surrogate_fields[];

typedef struct lg_surrogate_file {
    LG_MODEL_FILE(lg_surrogate_run);
    size_t trained_count;
    double *trained; /* (trained_count, 8): boundary conditions of the training part, or NULL */
    /* After loading: the array to which run.model.modes points. lg_recipe_save does not read it. */
    double *modes;
    bool has_errors;            /* train_mse and test_mse are known */
    double train_mse, test_mse; /* test_mse is NaN without a test part */
} lg_surrogate_file;

LG_END_DECLS

#endif
