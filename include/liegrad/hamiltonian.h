/* Learned Hamiltonians: description, initialisation, training loss on a tape, evaluation without one.
 *
 * Two families, H_Theta(q, p):
 * - LG_HAMILTONIAN_CHAIN on (T*S^2)^k, state q_1, p_1, ..., q_k, p_k (6k numbers):
 *   H = 1/2 p^T M(q)^{-1} p + V(q), M_ij = m_ij P_i P_j (i != j), M_ii = m_ii I, P_i = I - q_i q_i^T,
 *   m = Gamma^T Gamma + diag(max(0, b)); V takes q (3k numbers).
 * - LG_HAMILTONIAN_SEPARABLE on R^{2n}, state q, p: H = 1/2 |A p|^2 + V(q).
 *
 * V is an MLP whose last layer has no bias, or linear (one weight a coordinate).
 *
 * The flat parameter vector: V's layers in order (weight (in, out) row-major, then bias), then Gamma (k, k)
 * and b (k), or A (n, n).
 *
 * On T*S^2: q' = v - q(q.v), p' = -g + q(q.g) + p(q.v) - q(p.v) with v = dH/dp, g = dH/dq, lifted to se(3) as
 * xi = q x v, eta = g x q + v x p. The kinetic gradient needs one k x k solve only: W = m^{-1}, G_il =
 * q_i.q_l, (W o G) lambda = u with u_i = q_i.(W p)_i, then v_i = sum_j W_ij (p_j - lambda_j q_j), dT/dq_i =
 * -lambda_i v_i. Schemes that leave the manifold differentiate the extension T = 1/2 p^T W p + 1/2 u^T S^{-1}
 * r, S_il = delta_il (1 - |q_i|^2)/m_ii + W_il G_il, r_i = q_i.p_i/m_ii - u_i, which agrees with it on the
 * manifold and is definite near it.
 */
#ifndef LIEGRAD_HAMILTONIAN_H
#define LIEGRAD_HAMILTONIAN_H

#include "liegrad/context.h"
#include "liegrad/nn.h"
#include "liegrad/random.h"
#include "liegrad/tape.h"
#include "liegrad/program.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

typedef enum lg_hamiltonian_family { LG_HAMILTONIAN_CHAIN, LG_HAMILTONIAN_SEPARABLE } lg_hamiltonian_family;
#define LG_HAMILTONIAN_FAMILY_COUNT 2
typedef enum lg_potential_kind { LG_POTENTIAL_MLP, LG_POTENTIAL_LINEAR } lg_potential_kind;
#define LG_POTENTIAL_KIND_COUNT 2

#define LG_HAMILTONIAN_MAX_LINKS  32
#define LG_HAMILTONIAN_MAX_POINTS 512 /* points of a training trajectory */

/* Immutable after lg_hamiltonian_init; plain data, copied freely, holds no pointers. */
typedef struct lg_hamiltonian {
    lg_hamiltonian_family family;
    uint32_t links; /* k, or n for separable systems */
    lg_potential_kind potential;
    lg_mlp net; /* V: 3k (or n) -> hidden -> 1; without hidden layers for the linear potential */
} lg_hamiltonian;

/* Errors: LG_INVALID_ARGUMENT for links outside 1..LG_HAMILTONIAN_MAX_LINKS, hidden widths of 0 or too many
 * layers. `hidden` is ignored for the linear potential. */
LG_API lg_status lg_hamiltonian_init(lg_hamiltonian *model, lg_hamiltonian_family family, uint32_t links,
                                     lg_potential_kind potential, const uint32_t *hidden,
                                     uint32_t hidden_layers, lg_activation activation);
LG_API size_t lg_hamiltonian_parameters(const lg_hamiltonian *model);
LG_API uint32_t lg_hamiltonian_state_size(const lg_hamiltonian *model); /* 6k or 2n */
/* A start with a nearly singular mass sends trajectories far away, and training may end at a mass near 0,
 * from which no gradient leads away: Gamma and b are drawn again, at most 10000 times, while a pivot of m is
 * below this (of one link, 2 draws in 100). */
#define LG_HAMILTONIAN_LEAST_PIVOT 0.1
/* Weights and biases U(+-1/sqrt(fan_in)); Gamma, b, A ~ U[0, 1]. */
LG_API void lg_hamiltonian_initialise(const lg_hamiltonian *model, lg_rng *rng, double *theta);

/* Integrators that training can look through. */
typedef enum lg_train_integrator {
    LG_TRAIN_EULER,
    LG_TRAIN_LIE_EULER,
    LG_TRAIN_RK4,
    LG_TRAIN_CF4,
    LG_TRAIN_RKMK4,
    LG_TRAIN_STORMER_VERLET
} lg_train_integrator;
#define LG_TRAIN_INTEGRATOR_COUNT 6
LG_API const char *lg_train_integrator_name(lg_train_integrator integrator); /* "euler", "lie-euler", ... */
LG_API lg_status lg_train_integrator_parse(const char *name, lg_train_integrator *out);

/* First-integral penalty: G = (q_1^2 + p_1^2)/2 of the coupled oscillators. TEXT: mu times the mean over the
 * batch of sum_j (G(y_j) - G(x))^2 over the predicted points. PUBLISHED: mu times the sum over the batch of
 * sum_j |2 G(y_j) - 2 G(x)|, where 2 G = q_1^2 + p_1^2. */
typedef enum lg_penalty_form { LG_PENALTY_MEAN_SQUARE, LG_PENALTY_SUM_ABSOLUTE } lg_penalty_form;

/* Trajectories (N, M, d) with equidistant points dt apart, and how to learn from them. Borrowed data. */
typedef struct lg_hamiltonian_problem {
    const lg_hamiltonian *model;
    lg_train_integrator integrator;
    uint32_t substeps; /* integrator steps between two points, >= 1 */
    double penalty;    /* mu; 0: none */
    lg_penalty_form penalty_form;
    size_t trajectories, points;
    double dt;
    const double *data; /* (N, M, d) in the state's layout */
} lg_hamiltonian_problem;

/* Errors: LG_INVALID_ARGUMENT (nothing to learn from, points outside 2..LG_HAMILTONIAN_MAX_POINTS, N M above
 * 2^32 - 1, substeps 0, dt or penalty out of range or not finite, an unknown integrator or form),
 * LG_UNSUPPORTED (Lie integrators for separable systems, Stormer-Verlet for chains, a penalty for chains). */
LG_API lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error);

/* Fills a training problem for lg_fit: loss = mean squared difference over (batch, d, M - 1) of predicted and
 * given points, the initial point excluded, plus the penalty. `problem` is borrowed and must outlive the fit.
 */
LG_API void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out);

/* Settings of Adam that training a Hamiltonian wants, beside its default betas. Early in a run a nearly
 * singular mass matrix gives gradients a million times those of the end; Adam's second moment remembers them
 * for a thousand steps, longer than a run of a hundred epochs has, and the mass matrix stops moving (about
 * one seed in nine): hence a bound on the norm. Near the end gradients are of the size of the usual eps =
 * 1e-8, which then acts as a brake. */
#define LG_HAMILTONIAN_ADAM_EPS 1e-12
#define LG_HAMILTONIAN_CLIP     1e-3

/* ---- on a tape: batches of states, theta a variable ----
 *
 * What the functions without a tape below give for one state, to rounding, for each row of a batch; rows are
 * independent. Recorded: to be differentiated to any order in states, inputs and theta, by the formulas as
 * they stand at the top. Functions return LG_NONE with the tape's error (LG_SHAPE: a state or an input whose
 * shape is not as said). */

/* What theta gives to all rows, made once. Borrows the model; valid until rewound. */
typedef struct lg_hamiltonian_vars {
    const lg_hamiltonian *model;
    lg_mlp_vars net;
    lg_var W; /* chain: m^-1 (1, k, k), NaN where m is not positive definite */
    lg_var K; /* separable: A^T A (n, n) */
} lg_hamiltonian_vars;

/* theta: the flat vector, (lg_hamiltonian_parameters). Errors: the tape's (LG_SHAPE when theta is longer or
 * shorter), which stick; `vars` is untouched then. */
LG_API lg_status lg_hamiltonian_bind(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                                     lg_hamiltonian_vars *vars);
/* state (B, d), d = 6k or 2n -> H (B, 1) */
LG_API lg_var lg_hamiltonian_record_value(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d) -> dH/dstate (B, d), as lg_hamiltonian_gradient */
LG_API lg_var lg_hamiltonian_record_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d), input (B, 3k) or (B, n), or LG_NONE -> field (B, d), as lg_model_field (liegrad/model.h):
 * algebra elements (xi, eta) a link, eta with the torque, or (q', p'), p' with the force. */
LG_API lg_var lg_hamiltonian_record_field(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                          lg_var input);
/* The same field for lg_taped_step_over: space (T*S^2)^k, or R^n x R^n with force and velocity. `vars` must
 * outlive the use of `ode`. */
LG_API lg_status lg_hamiltonian_taped_ode(lg_hamiltonian_vars *vars, lg_taped_ode *ode);

/* The model as a bundle (liegrad/program.h) with parameter theta and the functions
 *   value (x) -> y                H
 *   grad  (x) -> y, g             H and its gradient, as lg_hamiltonian_gradient
 *   field (x, u) -> f             as lg_model_field
 *   step  (x, u, h) -> next       one step of `scheme` (NULL: cf4 for chains, stormer-verlet otherwise), u
 * held with x (state size), u (3k or n), h (1). Errors: those of lg_program_build; LG_UNSUPPORTED, an
 * implicit scheme: its stage is found with numbers. */
LG_API lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model,
                                        const double *theta, const lg_scheme *scheme, lg_program **out,
                                        lg_error *error);

/* ---- evaluation without a tape: caller's memory, no allocation, no lock ---- */

/* Bytes of work memory for the functions below (one state). */
LG_API size_t lg_hamiltonian_work_size(const lg_hamiltonian *model);
/* theta: doubles. Work: at least lg_hamiltonian_work_size bytes, 64-byte aligned. */
LG_API double lg_hamiltonian_value(const lg_hamiltonian *model, const double *theta, const double *state,
                                   void *work);
/* A chain's learned mass matrix m = Gamma^T Gamma + diag(max(0, b)) and W = m^-1, both (k, k), symmetric;
 * either may be NULL. W is NaN where m is not positive definite. Work as above. LG_UNSUPPORTED: a separable
 * system. */
LG_API lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m, double *W,
                                     void *work);
/* dH/dstate in the state's layout (2n or 6k numbers), chains by the formula above: v_i at p_i, and
 * dT/dq_i + dV/dq_i at q_i. Returns H, as lg_hamiltonian_value does. NaN where the mass matrix or W o G is
 * not positive definite. */
LG_API double lg_hamiltonian_gradient(const lg_hamiltonian *model, const double *theta, const double *state,
                                      double *gradient, void *work);
/* dH(state)[tangent] = sum_i dH/dstate_i tangent_i, the gradient above on a tangent in the state's layout. */
LG_API double lg_hamiltonian_jvp(const lg_hamiltonian *model, const double *theta, const double *state,
                                 const double *tangent, void *work);
/* Directional derivative of the gradient above, in the same layout: dgradient = d/de gradient(state + e
 * tangent) at e = 0, of the formulas as they stand at the top (any tangent, also off the manifold); gradient
 * may be NULL. `work`: lg_hamiltonian_hessian_work_size bytes. */
LG_API size_t lg_hamiltonian_hessian_work_size(const lg_hamiltonian *model);
LG_API void lg_hamiltonian_gradient_jvp(const lg_hamiltonian *model, const double *theta, const double *state,
                                        const double *tangent, double *gradient, double *dgradient,
                                        void *work);
/* Chain: algebra elements (xi, eta) a link, 6k numbers; separable: (q', p'), 2n numbers. */
LG_API void lg_hamiltonian_field(const lg_hamiltonian *model, const double *theta, const double *state,
                                 double *field, void *work);

LG_END_DECLS

#endif
