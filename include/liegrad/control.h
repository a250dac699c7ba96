/* Feedback control of linear systems and of learned models: Riccati equations, the zero-order hold, linear
 * quadratic regulators and an extended Kalman filter. The library is liegrad. docs/control.md is the guide.
 *
 *   lg_riccati equation = {sizeof equation, 2, 1, A, B, Q, R, NULL};
 *   void *work = aligned_alloc(64, lg_riccati_work_size(2, 1));
 *   lg_status status = lg_care(&equation, P, K, NULL, NULL, work, lg_riccati_work_size(2, 1), &error);
 *   ... u = -K x
 *
 * Matrices are row-major. The caller provides all memory, aligned to 64 bytes; there is nothing to
 * destroy. `bytes` is the size of the memory that a function gets. Functions that are called once, before
 * a loop (lg_care, lg_dare, lg_zero_order_hold, lg_lqr_init), call LAPACK, which may allocate memory and
 * take locks. Functions for the loop do neither: lg_lqr_control, lg_ekf_predict, lg_ekf_update. `error`
 * may be NULL. */
#ifndef LIEGRAD_CONTROL_H
#define LIEGRAD_CONTROL_H

#include "liegrad/model.h"

LG_BEGIN_DECLS

/* ---- Riccati equations ---- */

/* A linear system with n states and m inputs, and the weights of the cost x^T Q x + 2 x^T S u + u^T R u.
 * For an estimator use A^T in place of A, C^T in place of B, and the covariances of process and
 * measurement in place of Q and R; its gain is the transpose of K. */
typedef struct lg_riccati {
    size_t size;         /* sizeof(lg_riccati) */
    size_t n, m;         /* 2 n + m <= 10000 */
    const double *A, *B; /* (n, n), (n, m) */
    /* (n, n), (m, m); symmetric to 1e-8 of their largest number. The functions use (X + X^T)/2. */
    const double *Q, *R;
    const double *S; /* (n, m); NULL means 0. */
} lg_riccati;

typedef struct lg_riccati_result {
    /* Frobenius norm of the sum of the equation's terms, divided by the sum of the norms of the terms. */
    double residual;
    /* |X|_F/|P|_F with the Newton correction X at P: an estimate of the relative error of P. */
    double correction;
    /* Distance of the closed loop's eigenvalues z from instability: -max Re z for lg_care, 1 - max |z| for
     * lg_dare. */
    double margin;
    uint32_t refinements; /* Newton steps that were taken, at most 8. */
} lg_riccati_result;

/* Bytes of work memory for lg_care and lg_dare, about 8 (11 N^2 + 14 n^2 + 50 N) with N = 2 n + m. 0:
 * sizes out of range. */
LG_API size_t lg_riccati_work_size(size_t n, size_t m);

/* Compute the stabilising solution P (n, n), symmetric, of
 *   lg_care   A^T P + P A - (P B + S) R^-1 (B^T P + S^T) + Q = 0
 *             K = R^-1 (B^T P + S^T), and x' = (A - B K) x is stable;
 *             u = -K x minimises the integral of the cost
 *   lg_dare   A^T P A - P - (A^T P B + S) W^-1 (B^T P A + S^T) + Q = 0 with W = R + B^T P B
 *             K = W^-1 (B^T P A + S^T), and x+ = (A - B K) x is stable;
 *             u = -K x minimises the sum of the cost
 * Further outputs: the gain K (m, n), and `eigenvalues` (n, 2), the real and imaginary parts of the
 * eigenvalues of A - B K. Each output may be NULL.
 *
 * Method: the stable deflating subspace of the extended pencil of 2 n + m rows, which needs no inverse of A
 * or R (Van Dooren 1981; Pappas, Laub & Sandell 1980; Laub 1979), by an ordered QZ decomposition after
 * symplectic scaling (Benner 2001). Then Newton's method (Kleinman 1966; Hewer 1971) continues as long as
 * each correction is at most half the one before, with residuals that are summed in twice the digits (Ogita,
 * Rump & Oishi 2005).
 *
 * Errors; no output is touched then:
 * - LG_INVALID_ARGUMENT: sizes, NULL, too little or misaligned memory; Q or R not symmetric; lg_care: R not
 *   positive definite
 * - LG_NOT_FINITE: a number of A, B, Q, R or S
 * - LG_CHECK_FAILED: there is no stabilising solution, because (A, B) is not stabilisable, or because the
 *   pencil has eigenvalues on the imaginary axis (lg_care) or the unit circle (lg_dare); eigenvalues closer
 *   to it than 2e-8 of their own size count as on it. Or double precision does not suffice to find the
 *   solution: the closed loop that was found is not stable, Newton's method does not contract there, or its
 *   correction is above 1e-2. lg_dare: W is not positive definite
 * - LG_NO_CONVERGENCE: LAPACK's iteration failed, or the residual is above 1e-6 */
LG_API lg_status lg_care(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                         lg_riccati_result *result, void *work, size_t bytes, lg_error *error);
LG_API lg_status lg_dare(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                         lg_riccati_result *result, void *work, size_t bytes, lg_error *error);

/* Discretises a system whose input is held: x' = A x + B u with constant u gives x+ = Ad x + Bd u after h
 * seconds, where (Ad, Bd; 0, 1) = exp((A, B; 0, 0) h). Ad (n, n) and Bd (n, m) may be A and B.
 * lg_zero_order_hold_work_size returns the bytes of work memory; 0: sizes out of range. Method: after
 * balancing by powers of 2, Taylor's polynomial of exp(M/2^k) - 1 and k squarings (1 + X)^2 - 1 = X X + 2 X,
 * which lose no small part of the matrix, relative to its largest element, however large k is. The relative
 * errors of Ad and Bd are about 1e-15 max(1, c), where c is the condition number of the exponential: at
 * least |A| h, and far larger where exp(A h) is much smaller than exp(|A| h).
 * Errors: LG_INVALID_ARGUMENT (sizes as for lg_riccati, NULL, memory), LG_NOT_FINITE (A, B, h or the
 * result). */
LG_API size_t lg_zero_order_hold_work_size(size_t n, size_t m);
LG_API lg_status lg_zero_order_hold(size_t n, size_t m, const double *A, const double *B, double h,
                                    double *Ad, double *Bd, void *work, size_t bytes, lg_error *error);

/* ---- Linear quadratic regulator of a model ----
 *
 * Holds a Hamiltonian or machine at an equilibrium (state, input). It works in the tangent coordinates c (r
 * numbers) of lg_model_linearise:
 *   u = input - K c, where c are the coordinates of the current state (lg_model_deviation)
 * d is the number of numbers in a state, m in an input. */
typedef struct lg_lqr_options {
    size_t size; /* sizeof(lg_lqr_options) */
    /* The equilibrium: state (d), input (m); an input of NULL means zero. */
    const double *state, *input;
    /* Q (r, r) weighs c, R (m, m) weighs u - input, S (r, m) their products; S may be NULL. */
    const double *Q, *R, *S;
    /* 0: the integral of the cost is minimised. > 0: u is held for this many seconds, and the sum over
     * such periods is minimised. */
    double period;
    double most_drift; /* Largest allowed |c'_i| at the equilibrium, per second; default 1e-6. */
} lg_lqr_options;
LG_API void lg_lqr_options_init(lg_lqr_options *options);

/* A regulator. Its arrays, and work memory of the model, lie in the memory that lg_lqr_init was given;
 * this memory and the model must outlive it. Only one thread at a time may use it. */
typedef struct lg_lqr {
    const lg_model *model;
    size_t r, m;
    double period, drift;              /* `drift` is the largest |c'_i| at the equilibrium. */
    const double *state, *input;       /* Copies of the options' arrays. */
    const double *A, *B;               /* c' = A c + B du; with a period c+ = A c + B du. */
    const double *P, *K, *eigenvalues; /* (r, r), (m, r), (r, 2), as from lg_care or lg_dare. */
    lg_riccati_result result;
    double *c; /* (r): coordinates in the last lg_lqr_control. */
    void *work;
} lg_lqr;
/* Bytes of memory for lg_lqr_init; 0: the model has no inputs or does not move. */
LG_API size_t lg_lqr_size(const lg_model *model);
/* Computes a regulator in `memory` (`bytes` bytes). Errors: LG_UNSUPPORTED (the model has no inputs or
 * does not move), LG_CHECK_FAILED (the state is not an equilibrium: see most_drift; and as lg_care),
 * LG_INVALID_ARGUMENT, LG_NOT_FINITE, LG_NO_CONVERGENCE. */
LG_API lg_status lg_lqr_init(const lg_model *model, const lg_lqr_options *options, lg_lqr *out, void *memory,
                             size_t bytes, lg_error *error);
/* Writes the input u (m) for `state` (d). Errors: LG_NOT_FINITE (u would not be finite; u is then
 * untouched). */
LG_API lg_status lg_lqr_control(const lg_lqr *lqr, const double *state, double *u);

/* ---- Extended Kalman filter on a model's manifold ----
 *
 * The estimate is a state y of the model, and a covariance P (r, r) of the tangent coordinates c
 * (lg_model_linearise) of the true state at y. P = L L^T is stored as its lower triangular factor L; so it is
 * symmetric and positive semidefinite by construction (square root filter; Kaminski, Bryson & Schmidt 1971,
 * Bierman 1977).
 *
 * - predict: y+ is one step of the scheme with the input held. F = dc+/dc is the derivative of the flow: the
 *   classical Runge-Kutta method integrates X' = J(y(t), u) X from X = basis(y), and F has the coordinates of
 *   X at y+. J is the exact Jacobian of the ambient velocity; it is evaluated at y, at y+ and in the middle
 *   of the cubic Hermite polynomial through both ends, projected to the manifold. The error of F is O(h^5).
 *   P+ = F P F^T + h W; L+ comes from an LQ decomposition of (F L, sqrt(h) W^1/2).
 * - update: nu = z - h(y), H = dh/dc. H is exact if all sensors measure numbers of the state; otherwise it
 *   comes from central differences with steps of 1/100 of the standard deviations. S = H P H^T + R and the
 *   gain G = P H^T S^-1 come from an LQ decomposition of (R^1/2, H L; 0, L). y+ =
 *   lg_model_retract(y, G nu). The group element of this step moves L to y+ (parallel transport), so the
 *   frames at y and y+ may differ. */
typedef enum lg_sensor_kind {
    LG_SENSOR_STATE, /* A number of the state; for all models that move. */
    /* A number of lg_model_machine_positions (row-major rotations, directions, places); machines only. */
    LG_SENSOR_POSITION,
    LG_SENSOR_VELOCITY /* A number of lg_model_machine_velocities; machines only. */
} lg_sensor_kind;
#define LG_SENSOR_KIND_COUNT 3
typedef struct lg_sensor {
    lg_sensor_kind kind;
    size_t index;
    double noise; /* Standard deviation, > 0; sensors are independent. */
    /* 2 pi for an angle: nu is then taken in -period/2 .. period/2. 0: the number is not periodic. */
    double period;
} lg_sensor;

typedef struct lg_ekf_options {
    size_t size;             /* sizeof(lg_ekf_options) */
    const lg_scheme *scheme; /* Scheme of the prediction; must outlive the filter. */
    const double *state;     /* The first estimate (d). */
    const double *P;         /* Its covariance (r, r), positive semidefinite. */
    const double *W;         /* (r, r), positive semidefinite: what the process adds to P per second. */
    const lg_sensor *sensors;
    size_t sensor_count; /* k >= 1 */
} lg_ekf_options;
LG_API void lg_ekf_options_init(lg_ekf_options *options);

typedef struct lg_ekf lg_ekf; /* Lies in the caller's memory; one thread at a time. */
/* Bytes of memory for this model, scheme and number of sensors; 0: lg_ekf_init would refuse them. */
LG_API size_t lg_ekf_size(const lg_model *model, const lg_scheme *scheme, size_t sensor_count);
/* Makes a filter in `memory` (`bytes` bytes), which must outlive it, as must the model. Arrays of the
 * options are copied. Allocates nothing. Errors: LG_UNSUPPORTED (as lg_model_stepper_init; sensors of
 * positions or velocities of a model that is not a machine), LG_INVALID_ARGUMENT (memory, index or noise
 * of a sensor, P or W not symmetric to 1e-8 or not positive semidefinite), LG_NOT_FINITE. */
LG_API lg_status lg_ekf_init(const lg_model *model, const lg_ekf_options *options, lg_ekf **out, void *memory,
                             size_t bytes, lg_error *error);
/* Predicts over a step of h > 0 seconds; `input` (m) may be NULL, which is zero. Errors: LG_NOT_FINITE,
 * LG_INVALID_ARGUMENT (h), those of lg_stepper_step; the estimate is then as before. */
LG_API lg_status lg_ekf_predict(lg_ekf *ekf, double h, const double *input);
/* Corrects the estimate by the measurements z (k), in the order of the sensors. *nis (may be NULL) becomes
 * nu^T S^-1 nu, which is chi-square distributed with k degrees of freedom if model and noise are right.
 * Errors: LG_NOT_FINITE (z, or the result; the estimate is then as before). */
LG_API lg_status lg_ekf_update(lg_ekf *ekf, const double *z, double *nis);
/* lg_ekf_state returns the estimate (d), which belongs to the filter; lg_ekf_covariance writes its
 * covariance P (r, r). */
LG_API const double *lg_ekf_state(const lg_ekf *ekf);
LG_API void lg_ekf_covariance(const lg_ekf *ekf, double *P);

LG_END_DECLS

#endif
