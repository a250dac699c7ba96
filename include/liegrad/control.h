/* Feedback for linear systems and for learned models: Riccati equations, linear quadratic regulators, an
 * extended Kalman filter.
 *
 *   lg_riccati equation = {sizeof equation, 2, 1, A, B, Q, R, NULL};
 *   void *work = aligned_alloc(64, lg_riccati_work_size(2, 1));
 *   lg_status status = lg_care(&equation, P, K, NULL, NULL, work, lg_riccati_work_size(2, 1), &error);
 *   ... u = -K x
 *
 * Matrices are row-major. All memory is the caller's, aligned to 64 bytes; there is nothing to destroy.
 * Functions of the set-up (lg_care, lg_dare, lg_zero_order_hold, lg_lqr_init) call LAPACK, which may allocate
 * and take locks. Functions of the loop do neither: lg_lqr_control, lg_ekf_predict, lg_ekf_update.
 */
#ifndef LIEGRAD_CONTROL_H
#define LIEGRAD_CONTROL_H

#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/integrators.h"
#include "liegrad/model.h"

LG_BEGIN_DECLS

/* ---- Riccati equations ---- */

/* A system with n states and m inputs, and the weights of x^T Q x + 2 x^T S u + u^T R u. The gain of an
 * estimator is the transpose of K for (A^T, C^T, covariance of the process, of the measurement). */
typedef struct lg_riccati {
    size_t size;         /* sizeof(lg_riccati) */
    size_t n, m;         /* 2 n + m <= 10000 */
    const double *A, *B; /* (n, n), (n, m) */
    const double *Q, *R; /* (n, n), (m, m), symmetric to 1e-8 of their largest number; (X + X^T)/2 is used */
    const double *S;     /* (n, m); NULL: 0 */
} lg_riccati;

typedef struct lg_riccati_result {
    double residual;      /* |sum of the equation's terms|_F over the sum of their |.|_F */
    double correction;    /* |X|_F/|P|_F of the Newton correction X at P: an estimate of the error of P */
    double margin;        /* of the closed loop's eigenvalues z: continuous -max Re z, discrete 1 - max |z| */
    uint32_t refinements; /* Newton steps that were taken, at most 8 */
} lg_riccati_result;

/* Bytes for lg_care and lg_dare: about 8 (11 N^2 + 14 n^2 + 50 N), N = 2 n + m. 0: sizes out of range. */
LG_API size_t lg_riccati_work_size(size_t n, size_t m);

/* The stabilising solution P (n, n), symmetric, of
 *   lg_care   A^T P + P A - (P B + S) R^-1 (B^T P + S^T) + Q = 0        u = -K x minimises the integral
 *             K = R^-1 (B^T P + S^T), and x' = (A - B K) x is stable
 *   lg_dare   A^T P A - P - (A^T P B + S) W^-1 (B^T P A + S^T) + Q = 0  u = -K x minimises the sum
 *             W = R + B^T P B, K = W^-1 (B^T P A + S^T), and x+ = (A - B K) x is stable
 * K (m, n). eigenvalues (n, 2): real and imaginary parts of those of A - B K. Each output may be NULL.
 *
 * Method: the stable deflating subspace of the extended pencil of 2 n + m rows, which needs no inverse of A
 * or R (Van Dooren 1981; Pappas, Laub & Sandell 1980; Laub 1979), by an ordered QZ decomposition after
 * symplectic scaling (Benner 2001); then Newton's method (Kleinman 1966; Hewer 1971) while its correction
 * halves, from residuals that are summed in twice the digits (Ogita, Rump & Oishi 2005).
 *
 * Errors, explained in `error` (may be NULL); no output is touched:
 * - LG_INVALID_ARGUMENT: sizes, NULL, too little or misaligned memory; Q or R not symmetric; lg_care: R not
 *   positive definite
 * - LG_NOT_FINITE: a number of A, B, Q, R, S
 * - LG_CHECK_FAILED: there is no stabilising solution: (A, B) is not stabilisable, or there are eigenvalues
 *   of the pencil on the imaginary axis or the unit circle (those closer than 2e-8 of their own size count
 *   as on it), or double precision finds none: the closed loop of what was found is not stable, Newton's
 *   method does not contract there, or its correction is above 1e-2; lg_dare: W is not positive definite
 * - LG_NO_CONVERGENCE: LAPACK's iteration failed, or the residual is above 1e-6 */
LG_API lg_status lg_care(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                         lg_riccati_result *result, void *work, size_t bytes, lg_error *error);
LG_API lg_status lg_dare(const lg_riccati *equation, double *P, double *K, double *eigenvalues,
                         lg_riccati_result *result, void *work, size_t bytes, lg_error *error);

/* x' = A x + B u under an input held for h seconds is x+ = Ad x + Bd u with (Ad, Bd; 0, 1) = exp((A, B; 0, 0)
 * h); Ad (n, n), Bd (n, m); they may be A and B. Pade's approximation [13/13] with scaling and squaring
 * (Al-Mohy & Higham, SIAM J. Matrix Anal. Appl. 31, 2009) of the matrix balanced by powers of 2. Relative
 * errors of Ad and Bd: about 1e-15 max(1, c), c the condition number of the exponential: |A| h or more, far
 * more where exp(A h) is much smaller than exp(|A| h). Errors:
 * LG_INVALID_ARGUMENT (sizes as above, NULL, memory), LG_NOT_FINITE (A, B, h, or the result). */
LG_API size_t lg_zero_order_hold_work_size(size_t n, size_t m);
LG_API lg_status lg_zero_order_hold(size_t n, size_t m, const double *A, const double *B, double h,
                                    double *Ad, double *Bd, void *work, size_t bytes, lg_error *error);

/* ---- linear quadratic regulator of a model ----
 *
 * About an equilibrium (state, input) of a Hamiltonian or machine, in the coordinates c (r) of
 * lg_model_linearise:
 *   u = input - K c(state now),  c of lg_model_deviation
 */
typedef struct lg_lqr_options {
    size_t size;                 /* sizeof(lg_lqr_options) */
    const double *state, *input; /* d; m or NULL, which is zero */
    const double *Q, *R, *S;     /* weights of c and u - input: (r, r), (m, m), (r, m) or NULL */
    double period;     /* 0: the integral is minimised; > 0: seconds for which u is held, and the sum over the
                        * periods */
    double most_drift; /* the equilibrium's largest |c'_i| a second; 1e-6 */
} lg_lqr_options;
LG_API void lg_lqr_options_init(lg_lqr_options *options);

/* All arrays are in the memory that lg_lqr_init was given, beside work of the model, which must outlive them.
 * One thread at a time. */
typedef struct lg_lqr {
    const lg_model *model;
    size_t r, m;
    double period, drift;              /* drift: largest |c'_i| at the equilibrium */
    const double *state, *input;       /* copies */
    const double *A, *B;               /* c' = A c + B du; with a period c+ = A c + B du */
    const double *P, *K, *eigenvalues; /* (r, r), (m, r), (r, 2) as lg_care and lg_dare give them */
    lg_riccati_result result;
    double *c; /* (r), of the last lg_lqr_control */
    void *work;
} lg_lqr;
/* Bytes; 0: the model has no inputs or does not move. */
LG_API size_t lg_lqr_size(const lg_model *model);
/* Errors: LG_UNSUPPORTED (no inputs, does not move), LG_CHECK_FAILED (not an equilibrium: most_drift; and as
 * lg_care), LG_INVALID_ARGUMENT, LG_NOT_FINITE, LG_NO_CONVERGENCE. */
LG_API lg_status lg_lqr_init(const lg_model *model, const lg_lqr_options *options, lg_lqr *out, void *memory,
                             size_t bytes, lg_error *error);
/* u (m) at `state` (d). LG_NOT_FINITE: u would not be finite; u is untouched. */
LG_API lg_status lg_lqr_control(const lg_lqr *lqr, const double *state, double *u);

/* ---- extended Kalman filter on a model's manifold ----
 *
 * The estimate is a state y of the model and a covariance P (r, r) of the coordinates c (lg_model_linearise)
 * of the true state at y. P = L L^T is kept by its lower triangular L: it is symmetric and positive
 * semidefinite by construction (square root filter; Kaminski, Bryson & Schmidt 1971, Bierman 1977).
 *
 * predict   y+ is one step of the scheme with the input held. F = dc+/dc is the derivative of the flow, by
 *           the classical Runge-Kutta method for X' = J(y(t), u) X from X = basis(y), J the exact Jacobian of
 *           the ambient velocity at y, in the middle of the cubic Hermite polynomial through both ends (taken
 *           to the manifold) and at y+; F = coordinates at y+ of X. Its error is O(h^5).
 *           P+ = F P F^T + h W, as L+ from an LQ decomposition of (F L, sqrt(h) W^1/2).
 * update    nu = z - h(y), H = dh/dc, exact for numbers of the state, else by central differences of 1/100 of
 *           the standard deviations; S = H P H^T + R, gain G = P H^T S^-1, from an LQ decomposition of
 *           (R^1/2, H L; 0, L). y+ = lg_model_retract(y, G nu); L is moved to y+ by the group element of that
 *           step (parallel transport), so the frames may turn or change.
 */
typedef enum lg_sensor_kind {
    LG_SENSOR_STATE,    /* a number of the state; all models that move */
    LG_SENSOR_POSITION, /* of lg_model_machine_positions: row-major rotations, directions, places; machines */
    LG_SENSOR_VELOCITY  /* of lg_model_machine_velocities; machines */
} lg_sensor_kind;
#define LG_SENSOR_KIND_COUNT 3
typedef struct lg_sensor {
    lg_sensor_kind kind;
    size_t index;
    double noise;  /* standard deviation, > 0; independent of the others */
    double period; /* 2 pi for an angle: nu is taken in -period/2 .. period/2; 0: none */
} lg_sensor;

typedef struct lg_ekf_options {
    size_t size;             /* sizeof(lg_ekf_options) */
    const lg_scheme *scheme; /* of the step, which must outlive the filter */
    const double *state;     /* the first estimate (d) */
    const double *P;         /* its covariance (r, r), positive semidefinite */
    const double *W;         /* (r, r), positive semidefinite: what the process adds to P a second */
    const lg_sensor *sensors;
    size_t sensor_count; /* k >= 1 */
} lg_ekf_options;
LG_API void lg_ekf_options_init(lg_ekf_options *options);

typedef struct lg_ekf lg_ekf; /* in the caller's memory; one thread at a time */
/* Bytes for this model, scheme and number of sensors; 0: lg_ekf_init would refuse them. */
LG_API size_t lg_ekf_size(const lg_model *model, const lg_scheme *scheme, size_t sensor_count);
/* The model must outlive the filter; arrays of the options are copied. Allocates nothing. Errors:
 * LG_UNSUPPORTED (as lg_model_stepper_init; positions or velocities of a model that is no
 * machine), LG_INVALID_ARGUMENT (memory, an index or noise of a sensor, P or W not symmetric to 1e-8 or not
 * positive semidefinite), LG_NOT_FINITE. */
LG_API lg_status lg_ekf_init(const lg_model *model, const lg_ekf_options *options, lg_ekf **out, void *memory,
                             size_t bytes, lg_error *error);
/* A step of h > 0 seconds; input (m) or NULL, which is zero. LG_NOT_FINITE, LG_INVALID_ARGUMENT (h): the
 * estimate is as before. Errors of lg_step. */
LG_API lg_status lg_ekf_predict(lg_ekf *ekf, double h, const double *input);
/* z (k) in the order of the sensors. *nis (may be NULL): nu^T S^-1 nu, chi-square of k degrees of freedom if
 * model and noise are right. LG_NOT_FINITE: z, or the result; the estimate is as before. */
LG_API lg_status lg_ekf_update(lg_ekf *ekf, const double *z, double *nis);
/* The estimate (d), borrowed, and its covariance P (r, r). */
LG_API const double *lg_ekf_state(const lg_ekf *ekf);
LG_API void lg_ekf_covariance(const lg_ekf *ekf, double *P);

LG_END_DECLS

#endif
