/* Declarations shared by the training and the use of the surrogates. */
#ifndef LG_SURROGATE_INTERNAL_H
#define LG_SURROGATE_INTERNAL_H

#include "core/numbers.h"
#include "liegrad/elastica.h"

/* Gauss's rule of 3 points on [0, 1]: abscissae (1 - sqrt(3/5))/2, 1/2, (1 + sqrt(3/5))/2, and weights. */
#define LG_GAUSS_POINTS 3
static const double lg_gauss_at[LG_GAUSS_POINTS] = {0.11270166537925831, 0.5, 0.88729833462074169};
static const double lg_gauss_weight[LG_GAUSS_POINTS] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};

#define LG_SURROGATE_PI 3.14159265358979323846

/* Number of quantities that the angle network computes once per curve, for all points of it: R (the sign of
 * the mirror), theta_0, theta_N and the errors of pi f at both ends. */
enum { LG_SURROGATE_ENDS = 5 };

/* Offsets of q0, v0, qN and vN in the boundary conditions x (8). */
enum { LG_AT_Q0 = 0, LG_AT_V0 = 2, LG_AT_QN = 4, LG_AT_VN = 6 };

/* For the continuous network with held ends: q = H + w f at s (B, 1), from the output f (B, 2) of the
 * network. H is a combination of q0, L v0, qN and L vN of x (B, 8); w is a scalar weight. */
lg_var lg_surrogate_hold_ends(lg_tape *tape, const lg_surrogate *model, lg_var s, lg_var x, lg_var f);

/* Returns -1 if the network works on the mirror image of these boundary conditions, otherwise 1. */
double lg_surrogate_sign(const lg_surrogate *model, const double *x);
/* Computes theta_0 and theta_N, each in (-pi, pi]. For sign = -1 they belong to the mirror image. */
void lg_surrogate_angles(const double *x, double sign, double *angles);
/* For training with `between`: returns how far the point of a sample is from its node, in intervals. The
 * number is pseudo-random, uniform in [-1/2, 1/2), and depends only on the number of the sample. */
double lg_surrogate_shift(uint64_t sample);
/* Computes one row of the network's input at s: 8 numbers (discrete), 9 (continuous) or 3 (angle). */
void lg_surrogate_row(const lg_surrogate *model, const double *x, double sign, double s, double *row);
/* Computes the weights at s with which the errors of the two end angles are corrected. They are (1, 0) at s =
 * 0 and (0, 1) at s = L. `slopes` become their derivatives. */
void lg_surrogate_end_weights(const lg_surrogate *model, double s, double *weights, double *slopes);
/* Number of outputs of the program's function `value`: 4(N - 1) for the discrete network, otherwise the
 * number of outputs of the network. */
uint32_t lg_surrogate_outputs(const lg_surrogate *model);
/* Error LG_INVALID_ARGUMENT: the model has modes, but model->modes is NULL. */
lg_status lg_surrogate_check_modes(const lg_surrogate *model, lg_error *error);
/* Returns mean + sum_k c_k times mode k, for coefficients c (B, K): (B, 4(N - 1)). */
lg_var lg_surrogate_sum_modes(lg_tape *tape, const lg_surrogate *model, lg_var c);
/* Returns the angles (B, 1) of the tangents v (B, 2), each in (-pi, pi]. */
lg_var lg_surrogate_angle(lg_tape *tape, lg_var v);
/* Makes rows (1, N + 1) with the numbers k/N, and with the numbers 1 - k/N, for k = 0..N. */
void lg_surrogate_shares(lg_tape *tape, uint32_t intervals, lg_var *rising, lg_var *falling);
/* Returns the sums over the first 1, 2, ..., n entries along axis 1 of x, which has n of them. They are
 * computed by doubling: after the step with d, an entry is the sum over the 2d entries that end there. */
lg_var lg_surrogate_running_sums(lg_tape *tape, lg_var x, uint32_t n);
/* For a model with `angles`: the angles of all nodes (B, N + 1), ends included. x (B, 8) is the network's
 * input. */
lg_var lg_surrogate_node_angles(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x);
/* Computes qN - q0 (B, 2) from the network's input x (B, 8). */
lg_var lg_surrogate_chord(lg_tape *tape, const lg_surrogate *model, lg_var x);
/* Computes the network's output as numbers of the curve (B, lg_surrogate_outputs) from the network's input x
 * (B, inputs). Applies the modes or the angles if the model has them. */
lg_var lg_surrogate_net(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x);
/* The mechanics of B curves on a tape, in units of L, EI/L (energy) and EI/L^2 (force).
 * lg_surrogate_moments: the error of the bending moment (B, n), L theta' - m - fx y/L + fy x/L, at n points
 *   of each curve. m and f are the numbers with the smallest mean square. turning: theta'; x, y: positions;
 *   (B, n) each.
 * lg_surrogate_bending: the mean of (L theta')^2/2 over n points (B, 1), for theta' (B, n).
 * lg_surrogate_closing: f r/L + 18 N^2 |r/L|^2 (B, 1), for f and r (B, 2). */
lg_var lg_surrogate_moments(lg_tape *tape, const lg_surrogate *model, lg_var turning, lg_var x, lg_var y);
lg_var lg_surrogate_bending(lg_tape *tape, const lg_surrogate *model, lg_var turning);
lg_var lg_surrogate_closing(lg_tape *tape, const lg_surrogate *model, lg_var force, lg_var r);
/* Computes the force (2) in a curve from its nodes q and tangents v, (N + 1, 2) each, in units of EI/L^2. */
void lg_surrogate_force(double length, uint32_t intervals, const double *q, const double *v, double *force);
/* Error LG_SHAPE: the curves do not fit the model. */
lg_status lg_surrogate_check_curves(const lg_surrogate *model, const lg_elastica_curves *curves,
                                    lg_error *error);

#endif
