/* Mechanical systems, their Hamiltonians and vector fields, and trajectories sampled from them.
 *
 * Rows of the table, state layout, parameters:
 *
 * - pendulum-chain: (T*S^2)^k, state q_1, p_1, q_2, p_2, ... (6k); links, gravity, masses, lengths. e3 points
 *   up. H = 1/2 p^T M(q)^-1 p + sum_i mu_i g L_i e3.q_i with mu_i = sum_{l >= i} m_l, p = M q',
 *   P_i = I - q_i q_i^T, m_ij = mu_max(i,j) L_i L_j, M_ij = m_ij P_i P_j (i != j), M_ii = m_ii I.
 * - quartic: R^4, state q, p. H = 1/2 p^T [5 -1; -1 5] p + (q_1^4 + q_2^4)/4 + (q_1^2 + q_2^2)/2
 * - coupled-oscillators: R^4, state q, p. H = (q_1^2 + p_1^2)/2 + p_2^2/2 + q_2^2/2 + q_2^4/4
 *
 * Invariants: index 0 is always the energy H; chains add the vertical angular momentum sum_i e3.(q_i x p_i),
 * coupled-oscillators add G = (q_1^2 + p_1^2)/2.
 *
 * A system is immutable after it is made and may be shared by threads; each thread brings its own workspace.
 * Evaluation allocates nothing. The chain costs O(k).
 */
#ifndef LIEGRAD_MECHANICS_H
#define LIEGRAD_MECHANICS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/integrators.h"
#include "liegrad/random.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef struct lg_system lg_system;

typedef struct lg_system_options {
    size_t size;           /* sizeof(lg_system_options) */
    size_t links;          /* chains: k >= 1; 1. Others ignore what follows. */
    double gravity;        /* finite; 1 */
    const double *masses;  /* k numbers > 0, or NULL: all 1 */
    const double *lengths; /* k numbers > 0, or NULL: all 1 */
} lg_system_options;

LG_API void lg_system_options_init(lg_system_options *options);

/* The names of the table; NULL beyond. */
LG_API const char *lg_system_name_at(size_t index);

/* `options` may be NULL for the defaults; its arrays are copied. Errors, explained in `error` (may be NULL):
 * LG_NOT_FOUND (name), LG_INVALID_ARGUMENT (links 0, a mass or length that is not finite and > 0, gravity not
 * finite), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_system_create(const lg_context *context, const char *name,
                                  const lg_system_options *options, lg_system **out, lg_error *error);
LG_API void lg_system_destroy(const lg_context *context, lg_system *system); /* NULL is fine */

LG_API const char *lg_system_name(const lg_system *system);
LG_API const char *lg_system_layout(const lg_system *system); /* "q1 p1 q2 p2" (chains) or "q p" */
LG_API size_t lg_system_dim(const lg_system *system);         /* numbers in a state */
LG_API size_t lg_system_links(const lg_system *system);       /* chains: k; others 0 */
LG_API bool lg_system_constrained(const lg_system *system);   /* lives on a manifold other than R^n */
LG_API bool lg_system_separable(const lg_system *system);     /* H = K(p) + V(q): splitting schemes apply */

/* Doubles of workspace that the functions below need (at least 1); the caller's, content irrelevant before
 * and after. */
LG_API size_t lg_system_workspace(const lg_system *system);

/* H(y); work: lg_system_workspace doubles. Chains off the manifold: the extension of
 * lg_chain_gradient_extended; NaN where that is not defined. */
LG_API double lg_system_hamiltonian(const lg_system *system, const double *y, double *work);

LG_API size_t lg_system_invariants(const lg_system *system);
LG_API const char *lg_system_invariant_name(const lg_system *system, size_t index); /* NULL beyond */
LG_API double lg_system_invariant(const lg_system *system, size_t index, const double *y,
                                  double *work); /* NaN beyond */

typedef enum lg_form {
    LG_FORM_LIE,    /* on the space itself, field in the algebra: for Lie group schemes */
    LG_FORM_AMBIENT /* on R^dim, field the ambient velocity: for classical schemes. The same as LIE on R^n. */
} lg_form;

/* The form that a scheme wants: AMBIENT for scheme->ambient and for splitting schemes, LIE otherwise. */
LG_API lg_form lg_system_form_for(const lg_scheme *scheme);

/* Memory of one user of the system: system and workspace behind ode.user. */
typedef struct lg_system_user {
    const lg_system *system;
    double *work;
} lg_system_user;

/* Fills `ode` (space, functions, user). `user` (filled too) and `work` (lg_system_workspace doubles) must
 * outlive its use.
 *
 * Chains, v_i = dH/dp_i, g_i = dH/dq_i:
 *   LIE:     f_i = (xi_i, eta_i) = (q_i x v_i, g_i x q_i + v_i x p_i)
 *   AMBIENT: q_i' = v_i - q_i (q_i.v_i), p_i' = -g_i + q_i (q_i.g_i) + p_i (q_i.v_i) - q_i (p_i.v_i), with
 * the gradient of lg_chain_gradient_extended, as a classical scheme leaves the manifold. Errors:
 * LG_INVALID_ARGUMENT. The field returns LG_NOT_FINITE where the kinetic energy is not defined. */
LG_API lg_status lg_system_ode(const lg_system *system, lg_form form, lg_system_user *user, double *work,
                               lg_ode *ode);

/* ---- The chain's parts (LG_UNSUPPORTED for another system) ---- */

/* The constant k x k matrix m_ij = mu_max(i,j) L_i L_j, row-major. */
LG_API lg_status lg_chain_mass_matrix(const lg_system *system, double *m);
/* V(q) = sum_i weight_i e3.q_i: the k weights mu_i g L_i. */
LG_API lg_status lg_chain_potential_weights(const lg_system *system, double *weights);

/* On the manifold. dH/dp_i -> v (3k), dH/dq_i -> g (3k), from y (6k). W = m^-1 is tridiagonal; with G_il =
 * q_i.q_l and u_i = q_i.(W p)_i, (W o G) lambda = u: v_i = sum_j W_ij (p_j - lambda_j q_j), dT/dq_i =
 * -lambda_i v_i, plus dV/dq. The k x k system is symmetric positive definite and tridiagonal: O(k). work:
 * lg_system_workspace doubles. Errors: LG_NOT_FINITE (a pivot is not positive: NaN in y, or a link of length
 * 0). */
LG_API lg_status lg_chain_gradient(const lg_system *system, const double *y, double *v, double *g,
                                   double *work);

/* Near the manifold: the gradient of T = 1/2 p^T W p + 1/2 u^T S^-1 r, symmetric
 * S_il = delta_il (1 - |q_i|^2)/m_ii + W_il G_il, r_i = q_i.p_i/m_ii - u_i, which equals the kinetic energy
 * on it (k = 1: |p|^2/(2 m_11) everywhere). Its field is that of lg_chain_gradient on the manifold; v and g
 * themselves differ there by what the field does not see. Errors: LG_NOT_FINITE (S is not positive definite).
 */
LG_API lg_status lg_chain_gradient_extended(const lg_system *system, const double *y, double *v, double *g,
                                            double *work);

/* ---- Starts and trajectories ---- */

typedef enum lg_starts {
    LG_STARTS_THESIS, /* chains: q_i = normalised N(0, I_3), p_i = q_i x u, u ~ U[0,1]^3; others: U[-1,1]^d */
    LG_STARTS_BOX     /* U[-1,1]^d; LG_UNSUPPORTED for chains */
} lg_starts;

/* One random start, lg_system_dim numbers. */
LG_API lg_status lg_system_start(const lg_system *system, lg_starts kind, lg_rng *rng, double *y);

typedef enum lg_noise { LG_NOISE_NORMAL /* eps N(0, 1) */, LG_NOISE_UNIFORM /* eps U(-1, 1) */ } lg_noise;

typedef struct lg_trajectory_options {
    size_t size;         /* sizeof(lg_trajectory_options) */
    size_t trajectories; /* N >= 1; 500 */
    size_t points;       /* M >= 2, the start included; 5 */
    double t_end;        /* T > 0; t_j = j T/(M - 1); 0.1 */
    double noise;        /* eps >= 0; 0 */
    lg_noise noise_kind; /* normal */
    lg_starts starts;    /* thesis */
    /* s >= 1: each start is followed for s consecutive trajectories of length T; 1. With 3, 900 trajectories
     * come from 300 starts. */
    size_t segments;
    uint64_t seed;     /* 1 */
    double rtol, atol; /* of the reference integration; 1e-12, 1e-13 */
} lg_trajectory_options;

LG_API void lg_trajectory_options_init(lg_trajectory_options *options);

/* Samples trajectories with RKMK(5,4) on manifolds and Dormand-Prince 5(4) on R^n. Outputs: t (M),
 * trajectories (N, M, d), hamiltonian (N) = H at each start. Noise is added to all points but the first, in
 * ambient coordinates, after the integration. The start of number i depends on (seed, i) only, its noise
 * likewise: the starts are the same for every noise, N, M and T (with segments = 1). `options` NULL: the
 * defaults. Errors, explained in `error` (may be NULL): LG_INVALID_ARGUMENT, LG_UNSUPPORTED (starts),
 * LG_OUT_OF_MEMORY, LG_CANCELLED, those of lg_integrate_adaptive. On failure nothing is written. */
LG_API lg_status lg_generate_trajectories(const lg_context *context, const lg_system *system,
                                          const lg_trajectory_options *options, double *t,
                                          double *trajectories, double *hamiltonian, lg_error *error);

/* The same reference from given starts (N, d), without noise: for judging. `times` as in
 * lg_integrate_adaptive from t0 = 0, out (N, count, d). rtol, atol <= 0: 1e-12, 1e-13. Errors as above; on
 * failure nothing is written. */
LG_API lg_status lg_reference_trajectories(const lg_context *context, const lg_system *system,
                                           const double *starts, size_t n, const double *times, size_t count,
                                           double rtol, double atol, double *out, lg_error *error);

LG_END_DECLS

#endif
