/* Shared by training and use of the surrogates. */
#ifndef LG_SURROGATE_INTERNAL_H
#define LG_SURROGATE_INTERNAL_H

#include "liegrad/surrogate.h"

/* Gauss's rule of 3 points on [0, 1]: abscissae (1 -+ sqrt(3/5))/2 and weights. */
#define LG_GAUSS_POINTS 3
static const double lg_gauss_at[LG_GAUSS_POINTS] = {0.11270166537925831, 0.5, 0.88729833462074169};
static const double lg_gauss_weight[LG_GAUSS_POINTS] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};

/* Pi to double precision. */
#define LG_SURROGATE_PI 3.14159265358979323846

/* Size of the numbers of a curve that serve all places of the angle network: R, theta_0, theta_N and the
 * errors of pi f at both ends. */
enum { LG_SURROGATE_ENDS = 5 };

/* Offsets of the components of boundary conditions x = (q0, v0, qN, vN). */
enum { LG_AT_Q0 = 0, LG_AT_V0 = 2, LG_AT_QN = 4, LG_AT_VN = 6 };

/* Continuous network with held ends: q = H + w f. With t = s/L and u = 1 - t, H is the sum over (q0, L v0,
 * qN, L vN) of columns 0 to 3, and w column 4, of the products of
 *   (u^3, t u^2, t^2 u, t^3, t^2 u^2) with `value`; by t, of (u^2, t u, t^2, t u^2, t^2 u) with `slope`. */
enum { LG_HELD = 5 };
static const double lg_held_value[LG_HELD][LG_HELD] = {
    {1, 0, 0, 0, 0}, {3, 1, 0, 0, 0}, {0, 0, 3, -1, 0}, {0, 0, 1, 0, 0}, {0, 0, 0, 0, 16}};
static const double lg_held_slope[LG_HELD][LG_HELD] = {
    {0, 1, 0, 0, 0}, {-6, -2, 6, -2, 0}, {0, 0, 0, 1, 0}, {0, 0, 0, 0, 32}, {0, 0, 0, 0, -32}};
/* H and its derivative by s, w and its derivative, for boundary conditions x. */
typedef struct lg_surrogate_held {
    double q[2], v[2], weight, slope;
} lg_surrogate_held;
void lg_surrogate_hold(const lg_surrogate *model, double s, const double *x, lg_surrogate_held *out);

/* -1 if the network works on the mirror image of these boundary conditions, else 1. */
double lg_surrogate_sign(const lg_surrogate *model, const double *x);
/* theta_0 and theta_N in (-pi, pi], of the mirror image for sign -1. */
void lg_surrogate_angles(const double *x, double sign, double *angles);
/* For training `between` nodes: a sample's distance from its node in intervals, U[-1/2, 1/2). The same sample
 * always has the same distance. */
double lg_surrogate_shift(uint64_t sample);
/* The cubic through both nodes q (2, 2) with their tangents v (2, 2) at 0 <= t <= 1 of an interval of length
 * h, and its derivative by arc length. */
void lg_surrogate_hermite(const double *q, const double *v, double h, double t, double *point,
                          double *tangent);
/* A row of the network's input at s: 8 numbers (discrete), 9 (continuous) or 3 (angle). */
void lg_surrogate_row(const lg_surrogate *model, const double *x, double sign, double s, double *row);
/* Weights at s of the corrections of the two end angles: (1, 0) at s = 0, (0, 1) at s = L. */
void lg_surrogate_end_weights(const lg_surrogate *model, double s, double *weights);
/* Numbers that the functions of a curve hand over: 4(N - 1) for the discrete network, else those of the
 * network. */
uint32_t lg_surrogate_outputs(const lg_surrogate *model);
/* LG_INVALID_ARGUMENT for a model with modes whose numbers are missing. */
lg_status lg_surrogate_check_modes(const lg_surrogate *model, lg_error *error);
/* mean + c (modes) for coefficients c (B, K). */
lg_var lg_surrogate_sum_modes(lg_tape *tape, const lg_surrogate *model, lg_var c);
/* Angle in (-pi, pi] of the tangents v (B, 2): (B, 1). */
lg_var lg_surrogate_angle(lg_tape *tape, lg_var v);
/* Angles of the nodes (B, N + 1), ends included, of a network of angles at x (B, 8), the network's input. */
lg_var lg_surrogate_node_angles(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x);
/* qN - q0 from the network's input x (B, 8): (B, 2). */
lg_var lg_surrogate_chord(lg_tape *tape, const lg_surrogate *model, lg_var x);
/* The curve's numbers from the network's input x (B, inputs), with modes and angles: (B,
 * lg_surrogate_outputs). */
lg_var lg_surrogate_net(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x);
/* LG_SHAPE if these curves do not fit the model. */
lg_status lg_surrogate_check_curves(const lg_surrogate *model, const lg_elastica_curves *curves,
                                    lg_error *error);

static inline void lg_surrogate_put(lg_dtype dtype, void *values, size_t at, const double *from, size_t n) {
    if (dtype == LG_F64)
        for (size_t i = 0; i < n; i++) ((double *)values)[at + i] = from[i];
    else
        for (size_t i = 0; i < n; i++) ((float *)values)[at + i] = (float)from[i];
}

static inline double lg_surrogate_get(lg_dtype dtype, const void *values, size_t at) {
    return dtype == LG_F64 ? ((const double *)values)[at] : (double)((const float *)values)[at];
}

#endif
