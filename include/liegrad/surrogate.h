/* Surrogates of the elastica: networks that give the curve of a clamped beam from its boundary conditions
 * x = (q0, v0, qN, vN), 8 numbers.
 *
 * - LG_SURROGATE_DISCRETE: x -> the inner nodes and tangents (q_1, ..., q_{N-1}, v_1, ..., v_{N-1}), 4(N-1)
 *   numbers; the ends are the given ones.
 *   Loss: mean of squares of the 4(N-1) differences + gamma times the mean of squares of the differences'
 *   own node-to-node differences (2N of q, 2N of v; 0 at the ends).
 * - LG_SURROGATE_CONTINUOUS: (s/L, x) -> q(s), v = dq/ds the true derivative (forward mode).
 *   Loss: mean over points of (|q - q_k|^2 + |v - v_k|^2 + gamma (|v|^2 - 1)^2)/2. (The published program's
 *   sum of means: MSE(q) + MSE(v) + (gamma/2) mean (|v|^2 - 1)^2.) A sample is a point (s_k, x).
 * - LG_SURROGATE_ANGLE: theta(s) = pi f(theta_0/pi, theta_N/pi, s), v = (cos theta, sin theta), q = q_0 +
 *   int v ds by Gauss's rule of 3 points on panels; theta_0, theta_N in (-pi, pi] from v0, vN.
 *   Option `boundary` holds the end angles:
 *     theta = pi f(s) + (theta_0 - pi f(0)) e^{-100 s^2} + (theta_N - pi f(L)) e^{-100 (s-L)^2}
 *   (where a short beam's e^{-100 L^2} counts, the two weights are combined so that each is 1 at its end and
 *   0 at the other).
 *   Loss: mean over nodes of (|q - q_k|^2 + |v - v_k|^2)/2; gamma has no part in it. A sample is a curve: one
 *   set of Gauss points, 3 on each interval between two nodes, serves all its nodes.
 *
 * `normalise`: the x-coordinates of the ends enter as (x - centre)/centre, centre = half the distance of the
 * ends in the training data. Places are counted from q0: moving a beam moves its curve.
 *
 * `between` (continuous network): sample k of a curve is not node k but a point within half an interval of
 * it, another one in each curve, since at the nodes alone a network may turn freely in between. q and v there
 * come from cubics through nodes and tangents (continuous values), or from polynomials through six nodes, q
 * and v by themselves (discrete values, whose tangents are not quite the derivative of their curve).
 *
 * `mirror`: the problem is symmetric under reflection at the chord. Boundary conditions with v0y < vNy are
 * reflected (all y -> -y), and so is their curve: the network learns one half, and is exactly equivariant.
 * Where v0y = vNy the sign of v0y decides, then that of qNy - q0y.
 */
#ifndef LIEGRAD_SURROGATE_H
#define LIEGRAD_SURROGATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/elastica.h"
#include "liegrad/networks.h"
#include "liegrad/nn.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef enum lg_surrogate_kind {
    LG_SURROGATE_DISCRETE,
    LG_SURROGATE_CONTINUOUS,
    LG_SURROGATE_ANGLE
} lg_surrogate_kind;
#define LG_SURROGATE_KIND_COUNT 3
LG_API const char *lg_surrogate_kind_name(lg_surrogate_kind kind); /* "discrete", "continuous", "angle" */
LG_API lg_status lg_surrogate_kind_parse(const char *name, lg_surrogate_kind *out); /* LG_NOT_FOUND */

/* What a network looks like, before the data tell its sizes. */
typedef struct lg_surrogate_options {
    lg_surrogate_kind kind;
    lg_net_kind architecture;
    uint32_t embedding, hidden, layers;
    lg_activation activation;
    bool normalise, mirror, boundary, between;
    double gamma; /* of the loss, >= 0 */
} lg_surrogate_options;

/* Immutable after lg_surrogate_init; plain data. */
typedef struct lg_surrogate {
    lg_surrogate_options options;
    lg_net net;
    uint32_t intervals; /* N of the training data */
    double length;      /* L */
    double centre;      /* for `normalise` */
} lg_surrogate;

/* Errors: LG_INVALID_ARGUMENT (boundary without the angle network, intervals < 2, a length or centre not
 * positive and finite, gamma < 0, what lg_net_init refuses). */
LG_API lg_status lg_surrogate_init(lg_surrogate *model, const lg_surrogate_options *options,
                                   uint32_t intervals, double length, double centre, lg_error *error);
LG_API size_t lg_surrogate_parameters(const lg_surrogate *model); /* those of its network */

/* Published settings and our own. */
typedef struct lg_surrogate_preset {
    const char *name; /* "thesis", "best" */
    lg_surrogate_kind kind;
    bool boundary;      /* angle network */
    bool merged;        /* data of both families */
    double fraction;    /* part of the data trained on; of rows that fit, the nearest is taken */
    const char *source; /* "table 5.3", ... */
    lg_surrogate_options model;
    lg_training training;
} lg_surrogate_preset;
/* NULL for an unknown name or a combination without a row. Static storage. */
LG_API const lg_surrogate_preset *lg_surrogate_preset_find(const char *name, lg_surrogate_kind kind,
                                                           bool boundary, bool merged, double fraction);

/* ---- training ---- */

/* Which curves are trained on and tested on: a permutation drawn by `seed` (in a stream of its own), whose
 * first test_fraction n entries (rounded) are the test part, the same for every train_fraction, and whose
 * following train_fraction n the training part. parts (n): lg_part of each curve (liegrad/nn.h).
 * LG_INVALID_ARGUMENT: fractions outside [0, 1], together more than 1, or a training part without a curve. */
LG_API lg_status lg_surrogate_split(size_t n, double train_fraction, double test_fraction, uint64_t seed,
                                    uint8_t *parts);

/* A model and the curves it learns from. Borrowed. */
typedef struct lg_surrogate_problem {
    const lg_surrogate *model;
    const lg_elastica_curves *curves;
    const uint32_t *training; /* (training_count) indices of curves */
    size_t training_count;
} lg_surrogate_problem;
/* LG_SHAPE: curves with another N (discrete) or length than the model's. LG_INVALID_ARGUMENT: nothing to
 * learn from, an index out of range, 2^32 samples or more. */
LG_API lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error);
/* Fills a problem for lg_fit. `problem` is borrowed and must outlive the fit. */
LG_API void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out);

/* ---- as a program ---- */

/* A bundle on one parameter `theta`, of the kind's functions:
 *   value  x -> y, and grad  x -> y, g: y and its Jacobian, as liegrad/model.h says for the kind
 *   point  continuous: s, x (8, one for all rows) -> q, v at s; angle: s, ends (5, one for all rows) -> theta
 *   place  continuous: s, x (8, one for all rows) -> q at s
 *   ends   angle: x (8) -> ends: R, theta_0, theta_N, and what pi f lacks at both ends (0 without `boundary`)
 * Errors: those of lg_program_build. */
LG_API lg_status lg_surrogate_program(const lg_context *context, const lg_surrogate *model,
                                      const double *theta, lg_program **out, lg_error *error);

/* ---- use, without a tape ---- */

/* Plans for the curves of a network; immutable, threads may share them, each with work of its own. theta is
 * copied, and rounded to `dtype`, in which the program computes; cubics and integrals are double. `points`:
 * of how many points a curve has as a rule, for speed. Errors: those of lg_surrogate_program and
 * lg_plan_create. */
typedef struct lg_surrogate_curves lg_surrogate_curves;
LG_API lg_status lg_surrogate_curves_create(const lg_context *context, const lg_surrogate *model,
                                            const double *theta, lg_dtype dtype, size_t points,
                                            lg_surrogate_curves **out, lg_error *error);
LG_API void lg_surrogate_curves_destroy(lg_surrogate_curves *curves); /* NULL is fine */
/* Bytes, to be aligned to 64. */
LG_API size_t lg_surrogate_curves_work_size(const lg_surrogate_curves *curves);
/* The curve of boundary conditions x (8) at s (points), 0 <= s <= L, rising: q, v (points, 2) or NULL. The
 * discrete network interpolates between its nodes (cubic Hermite, and its derivative; at its own nodes its
 * own values); the angle network integrates over fixed panels, equal
 * parts of the N intervals and at least 50, and from the last whole one to s: what it gives at s depends on
 * what else is asked for by rounding alone, and at the data's nodes it is the rule of the loss; q asks for
 * many more evaluations than v alone. A number of x that is not finite makes the curve NaN, one of s its
 * point. No allocation, no lock. */
LG_API void lg_surrogate_curve(const lg_surrogate_curves *curves, const double *x, const double *s,
                               size_t points, double *q, double *v, void *work);

/* Errors over nodes and components, in double precision. */
typedef struct lg_surrogate_errors {
    double mse; /* discrete: 4(N-1) inner components; others: 4(N+1) */
    double mse_q, mse_v;
    double max_error;            /* largest component */
    double boundary_error;       /* largest difference from the boundary conditions at s = 0 and L. The angle
                                  * network: tangents only, because its q(L) follows from its angles */
    double unit_tangent_error;   /* largest ||v| - 1| over all nodes */
    double unit_tangent_between; /* the same half-way between the nodes: what a curve does where no data is */
} lg_surrogate_errors;
/* Over curves `chosen` (count), NULL: all of them, whatever `count`. node_error: (N + 1, 2) or NULL, mean
 * over the curves of |q - q_k| and of |v - v_k| at each node. Errors: LG_SHAPE as above, LG_INVALID_ARGUMENT
 * (no curves, an index out of range), LG_OUT_OF_MEMORY, LG_NOT_FINITE. */
LG_API lg_status lg_surrogate_evaluate(const lg_context *context, const lg_surrogate *model,
                                       const double *theta, const lg_elastica_curves *curves,
                                       const uint32_t *chosen, size_t count, double *node_error,
                                       lg_surrogate_errors *out, lg_error *error);

/* ---- range ---- */

/* Outside the boundary conditions that it was trained on, a network's curve means nothing. `trained` (n, 8)
 * are the training part's. Distances are of (qN - q0, v0, vN). The largest distance of one of them from its
 * nearest other one, up to one in a hundred (at most 32) left out, which may stand alone; 0 for n < 2. */
LG_API double lg_surrogate_reach(const double *trained, size_t n);
/* Distance of x, for a model with `mirror` of x or its mirror image, from the nearest trained boundary
 * condition; infinite for n = 0 or NaN in x. A query farther than twice the reach lies outside the trained
 * range. */
LG_API double lg_surrogate_distance(const lg_surrogate *model, const double *trained, size_t n,
                                    const double *x);

LG_END_DECLS

#endif
