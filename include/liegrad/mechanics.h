/* Mechanical systems: parameters, states, vector fields, invariants, and trajectories sampled from them.
 *
 * A system is an entry of a table (src/mechanics), found by name and form; docs/systems.md has its
 * equations, keys, state order, invariants and the names of its parameters in gradients. Rows: oscillator;
 * quartic; coupled-oscillators; pendulum-chain (lagrangian | hamiltonian); rigid-body; rigid-body-attitude;
 * heavy-top (cotangent | direct | lie-poisson | quadratic); quadrotors.
 *
 * A system is immutable after it is made (but see lg_system_set_parameters) and may be shared by threads;
 * each thread brings its own workspace. Evaluation allocates nothing. Chains cost O(links).
 */
#ifndef LIEGRAD_MECHANICS_H
#define LIEGRAD_MECHANICS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/integrators.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

typedef struct lg_system lg_system;

/* Values of one parameter, by the key that scenes use. */
typedef struct lg_named_values {
    const char *key;
    const double *values;
    size_t count;
} lg_named_values;

typedef struct lg_system_options {
    size_t size;                       /* sizeof(lg_system_options) */
    const char *form;                  /* NULL: the system's first */
    size_t links;                      /* pendulum-chain: k in 1..1000000; 1. Others ignore it. */
    const lg_named_values *parameters; /* those given; the others have their defaults, where they have one */
    size_t parameter_count;
} lg_system_options;

LG_API void lg_system_options_init(lg_system_options *options);

typedef enum lg_parameter_rule {
    LG_PARAMETER_FINITE,
    LG_PARAMETER_POSITIVE,
    LG_PARAMETER_UNIT_VECTOR, /* of length 1 to 1e-9 */
    LG_PARAMETER_ANGLE        /* radians, at most pi in size */
} lg_parameter_rule;

/* A parameter of a system. */
typedef struct lg_parameter_entry {
    const char *key;   /* in scenes: "masses" */
    const char *label; /* in gradients: "m" gives m1, m2, ...; with `count` 1 it stands alone: "g" */
    size_t count;      /* numbers; 0: one a link */
    lg_parameter_rule rule;
    const double *fallback; /* `count` numbers (one when count is 0, for all links); NULL: must be given */
    const char *meaning;    /* with its unit */
} lg_parameter_entry;

/* A part of the state: `outer` blocks, `stride` numbers apart from `first` on, of rows x columns numbers. In
 * scenes a list of lists of lists; levels of one are left out. In layouts a block is the key with its number,
 * "q2"; where `outer` is 1, the key alone. */
typedef struct lg_state_entry {
    const char *key; /* in scenes and layouts: "q" */
    size_t outer;    /* 0: one a link */
    size_t rows, columns, first, stride;
    const double *fallback; /* of one block; NULL: must be given */
} lg_state_entry;

/* Name and form of entry `index` of the table; false beyond. `form` NULL where there is one only. */
LG_API bool lg_system_at(size_t index, const char **name, const char **form);
/* The parameters and the parts of the state of a system, ended by a key NULL; NULL for an unknown pair.
 * `form` NULL: the system's first. */
LG_API const lg_parameter_entry *lg_system_parameters(const char *name, const char *form);
LG_API const lg_state_entry *lg_system_state(const char *name, const char *form);

/* `options` may be NULL for the defaults; its arrays are copied. `form` NULL is the first form of that name.
 * Errors, explained in `error` (may be NULL): LG_NOT_FOUND (name, form), LG_INVALID_ARGUMENT (an unknown or
 * repeated key, a wrong count, a value against its rule, a parameter missing, links 0 or above a million),
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_system_create(const lg_context *context, const char *name,
                                  const lg_system_options *options, lg_system **out, lg_error *error);
LG_API void lg_system_destroy(lg_system *system); /* NULL is fine */
/* Another one with the same parameters, and other parameters for a system that nobody else uses: all of
 * them, in the order of lg_system_parameters. LG_INVALID_ARGUMENT, nothing changed: a value against its
 * rule. */
LG_API lg_status lg_system_copy(const lg_context *context, const lg_system *system, lg_system **out);
LG_API lg_status lg_system_set_parameters(lg_system *system, const double *values);

LG_API const char *lg_system_name(const lg_system *system);
LG_API const char *lg_system_form(const lg_system *system); /* NULL where there is one only */
/* The order of the state: "q1 omega1 q2 omega2", "q p", "y v R1 Omega1 R2 Omega2 q1 omega1 q2 omega2". */
LG_API const char *lg_system_layout(const lg_system *system);
LG_API const lg_space *lg_system_space(const lg_system *system);
/* All parameters, in the order of lg_system_parameters: lg_system_parameter_count numbers; the label of each
 * ("m2") into `text`, at least 32 characters. */
LG_API size_t lg_system_parameter_count(const lg_system *system);
LG_API const double *lg_system_parameter_values(const lg_system *system);
LG_API void lg_system_parameter_label(const lg_system *system, size_t index, char *text);
LG_API size_t lg_system_dim(const lg_system *system); /* numbers in a state */
/* How many of them, from the first, are reported: all, except for heavy-top in the form quadratic, whose last
 * six numbers are p and q. */
LG_API size_t lg_system_reported(const lg_system *system);
LG_API size_t lg_system_links(const lg_system *system);     /* chains: k; others 0 */
LG_API bool lg_system_constrained(const lg_system *system); /* lives on a manifold other than R^n */
LG_API bool lg_system_separable(const lg_system *system);   /* H = K(p) + V(q): splitting schemes apply */

/* Bytes of work memory that the functions below need (at least 8). Its content does not matter before or
 * after a call. */
LG_API size_t lg_system_work_size(const lg_system *system);

/* H(y); work: lg_system_work_size bytes. NaN for systems without an energy (quadrotors), and off the manifold
 * where the energy is not defined. */
LG_API double lg_system_hamiltonian(const lg_system *system, const double *y, double *work);

/* What is seen of a state when it is compared with another one: of a chain the positions x_1, ..., x_k of its
 * masses, x_i = L_1 q_1 + ... + L_i q_i, then their velocities (6k numbers); of other systems the reported
 * part of the state. lg_system_observed numbers into `out`, which does not overlap y. Errors: LG_NOT_FINITE
 * (momenta without a velocity). */
LG_API size_t lg_system_observed(const lg_system *system);
LG_API lg_status lg_system_observe(const lg_system *system, const double *y, double *out, double *work);

/* First integrals of the exact flow: "energy" first if the system has one, then those of docs/systems.md. */
LG_API size_t lg_system_invariants(const lg_system *system);
LG_API const char *lg_system_invariant_name(const lg_system *system, size_t index); /* NULL beyond */
LG_API double lg_system_invariant(const lg_system *system, size_t index, const double *y,
                                  double *work); /* NaN beyond */

typedef enum lg_coordinates {
    LG_COORDINATES_LIE,    /* on the space itself, field in the algebra: for Lie group schemes */
    LG_COORDINATES_AMBIENT /* on R^dim, field the ambient velocity: for classical schemes; as LIE on R^n */
} lg_coordinates;

/* The coordinates that a scheme needs: AMBIENT for scheme->ambient and for splitting schemes, LIE
 * otherwise. */
LG_API lg_coordinates lg_system_coordinates_for(const lg_scheme *scheme);

/* Memory of one user of the system: system and workspace behind ode.user. */
typedef struct lg_system_user {
    const lg_system *system;
    double *work;
} lg_system_user;

/* Fills `ode` (space, functions, user, for AMBIENT the manifold). `user` (filled too) and `work`
 * (lg_system_work_size bytes) must outlive its use. The ambient field is the generator of the LIE field,
 * f(t, y) . y, except for chains in Hamiltonian form. Chains, e3 up:
 *
 * Lagrangian form, state q_1, omega_1, q_2, omega_2, ... The tensions lambda of the links solve a symmetric
 * tridiagonal system, d_i lambda_i + e_{i-1} lambda_{i-1} + e_i lambda_{i+1} = b_i with
 *   d_i = 1/m_i + [i > 1]/m_{i-1}, e_i = -q_i.q_{i+1}/m_i, b_i = L_i |omega_i|^2 - [i = 1] g e3.q_1;
 *   a_i = (lambda_{i+1} q_{i+1} - lambda_i q_i)/m_i - g e3 is the acceleration of mass i, a_0 = 0;
 *   q_i'' = (a_i - a_{i-1})/L_i
 *   LIE:     f_i = (omega_i, q_i (q_i.q_i'') - q_i'')
 *   AMBIENT: q_i' = omega_i x q_i, omega_i' = q_i x q_i''; the same formulas hold off the manifold
 *
 * Hamiltonian form, v_i = dH/dp_i, g_i = dH/dq_i:
 *   LIE:     f_i = (xi_i, eta_i) = (q_i x v_i, g_i x q_i + v_i x p_i)
 *   AMBIENT: q_i' = v_i - q_i (q_i.v_i), p_i' = -g_i + q_i (q_i.g_i) + p_i (q_i.v_i) - q_i (p_i.v_i)
 * AMBIENT takes v and g from an extension of H to the ambient space, because a classical scheme leaves the
 * manifold (src/mechanics/chain.h). The field returns LG_NOT_FINITE where the kinetic energy is not defined.
 *
 * ode.step: oscillator, the midpoint rule (discrete Lagrangian h L((q0 + q1)/2, (q1 - q0)/h)); chains in both
 * forms, the trapezoidal discrete Lagrangian in ambient coordinates with the constraints |q_i| = 1 (SHAKE for
 * the positions, RATTLE for the velocities; Hairer, Lubich, Wanner, Geometric Numerical Integration,
 * VII.1.4), by Newton's method to rounding; LG_NO_CONVERGENCE when the step is too large for it.
 *
 * Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_system_ode(const lg_system *system, lg_coordinates coordinates, lg_ode *ode,
                               lg_system_user *user, double *work);

/* The same on a tape: `parameters` is a variable of lg_system_parameter_count elements, `user` is filled and
 * must outlive the use of `ode`. Chains in Lagrangian form are one custom operation with hand-written first
 * derivatives of cost O(k) in lg_backward and lg_jvp; derivatives of those, and lg_grad, are built of plain
 * operations on k x k matrices, to any order. Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (AMBIENT for chains
 * in Hamiltonian form). */
typedef struct lg_system_taped_user {
    const lg_system *system;
    lg_var parameters;
} lg_system_taped_user;

LG_API lg_status lg_system_taped_ode(const lg_system *system, lg_coordinates coordinates, lg_var parameters,
                                     lg_taped_ode *ode, lg_system_taped_user *user);

/* ---- The chain's parts (LG_UNSUPPORTED for another system) ---- */

/* The constant k x k matrix m_ij = mu_max(i,j) L_i L_j, mu_i = sum_{l >= i} m_l, row-major. Both forms. */
LG_API lg_status lg_chain_mass_matrix(const lg_system *system, double *m);
/* V(q) = sum_i weight_i e3.q_i: the k weights mu_i g L_i. Both forms. */
LG_API lg_status lg_chain_potential_weights(const lg_system *system, double *weights);
/* Converts states between the two forms with the same parameters: q_1, omega_1, ... to q_1, p_1, ... and
 * back. `from` and `to` (6k) may be equal. With q_i' = omega_i x q_i: p_i = m_ii q_i' + P_i sum_{j != i} m_ij
 * q_j', P_i = I - q_i q_i^T; back q_i' = dH/dp_i and omega_i = q_i x q_i'. Systems of either form. O(k).
 * work: lg_system_work_size bytes. Errors: LG_NOT_FINITE (back only). */
LG_API lg_status lg_chain_momenta(const lg_system *system, const double *from, double *to, double *work);
LG_API lg_status lg_chain_velocities(const lg_system *system, const double *from, double *to, double *work);

/* ---- Starts and trajectories ---- */

/* How starts are drawn. On T*S^2 q = normalised N(0, I_3) and p = q x u with u uniform in a box; on R^n,
 * so(3)* and se(3)* the state is uniform in a box. */
typedef enum lg_starts {
    LG_STARTS_THESIS, /* the box is [0, 1]^3 on T*S^2, [-1, 1]^n elsewhere */
    LG_STARTS_BOX,    /* the box is [low, high] in every coordinate */
    /* Chains of at most LG_PLANE_LINKS links in the plane of e1 and e3, hanging along -e3 on average.
     * Angles a_i and rates w_i are N(0, 1); nodes x_i = sum_{j <= i} L_j (sin a_j, -cos a_j) and their
     * velocities v_i, then x_i + .2 N and 3 (.5 v_i + .4 N), brought back to the constraints |x_i -
     * x_{i-1}| = L_i by Newton's method with steps of least norm in (x, v). After Finzi, Wang, Wilson,
     * NeurIPS 2020. */
    LG_STARTS_PLANE
} lg_starts;
#define LG_STARTS_COUNT 3
#define LG_PLANE_LINKS  32

typedef enum lg_noise { LG_NOISE_NORMAL /* eps N(0, 1) */, LG_NOISE_UNIFORM /* eps U(-1, 1) */ } lg_noise;

typedef struct lg_trajectory_options {
    size_t size;         /* sizeof(lg_trajectory_options) */
    size_t trajectories; /* N >= 1; 500 */
    size_t points;       /* M >= 2, the start included; 5 */
    double t_end;        /* T > 0; t_j = j T/(M - 1); 0.1 */
    double noise;        /* eps >= 0; 0 */
    lg_noise noise_kind; /* normal */
    bool noise_first;    /* false; true: on the first points, too, which then go back to their manifold */
    lg_starts starts;    /* thesis */
    double low, high;    /* of a box, low < high; -1, 1 */
    double ahead;        /* >= 0: a trajectory begins where its start is after a time of U[0, ahead]; 0 */
    /* s >= 1: each start is followed for s consecutive trajectories of length T; 1. With 3, 900 trajectories
     * come from 300 starts. */
    size_t segments;
    size_t first;      /* 0: number of the first trajectory, a multiple of segments: a part of a larger set */
    uint64_t seed;     /* 1 */
    double rtol, atol; /* of the reference integration, as in lg_step_controller; 1e-12, -1e-13 */
} lg_trajectory_options;

LG_API void lg_trajectory_options_init(lg_trajectory_options *options);

/* One random start, space->dim numbers, as `starts`, `low` and `high` of the options say (NULL: the
 * defaults), factor by factor. Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (a factor SO(3) or SE(3), kind
 * PLANE). */
LG_API lg_status lg_space_start(const lg_space *space, const lg_trajectory_options *options, lg_rng *rng,
                                double *y);
/* The same on the system's space, PLANE for chains; `ahead` is not used. lg_generate_trajectories draws its
 * first one from stream 0 of the seed. Errors also: LG_NO_CONVERGENCE. */
LG_API lg_status lg_system_start(const lg_system *system, const lg_trajectory_options *options, lg_rng *rng,
                                 double *y);

/* Samples trajectories with RKMK(5,4) on manifolds and Dormand-Prince 5(4) on R^n. Outputs: t (M),
 * trajectories (N, M, d), hamiltonian (N) = H at each start. Noise is added to all points but the first (see
 * noise_first), in ambient coordinates, after the integration. Start and noise of number i depend on (seed,
 * i) only, so the starts are the same for every noise, N, M and T (with segments = 1). `options` NULL: the
 * defaults. Errors, explained in `error` (may be NULL): LG_INVALID_ARGUMENT, LG_UNSUPPORTED (starts),
 * LG_OUT_OF_MEMORY, LG_CANCELLED, those of lg_integrate_adaptive. On failure nothing is written. */
LG_API lg_status lg_generate_trajectories(const lg_context *context, const lg_system *system,
                                          const lg_trajectory_options *options, double *t,
                                          double *trajectories, double *hamiltonian, lg_error *error);

/* The same reference solutions from given starts (N, d), without noise, for judging models. `times` as in
 * lg_integrate_adaptive from t0 = 0, out (N, count, d). rtol <= 0: 1e-12; atol 0: -1e-13, as in
 * lg_step_controller. Errors as above; on failure nothing is written. */
LG_API lg_status lg_reference_trajectories(const lg_context *context, const lg_system *system,
                                           const double *starts, size_t n, const double *times, size_t count,
                                           double rtol, double atol, double *out, lg_error *error);

/* ---- scene files (library liegrad_io) ---- */

/* A system of liegrad/mechanics.h with its parameters and a start. Keys and shapes are those of its tables
 * there. */
typedef struct lg_scene {
    lg_system *system; /* owned */
    bool has_initial;
    double *state;     /* owned: lg_system_dim numbers, in the system's form; NULL without `initial` until
                          lg_scene_draw_start */
    bool projected;    /* the start was off the manifold by rounding (<= 1e-6) and was projected */
    double projection; /* by how much */
    bool has_t_end;
    double t_end;
    bool has_starts; /* otherwise thesis, 1 segment */
    lg_starts starts;
    double low, high;   /* box: chains p = q x u, u ~ U[low,high]^3; others U[low,high]^d; -1, 1 */
    double ahead;       /* trajectories begin where their start is after a time of U[0, ahead]; 0 */
    uint32_t segments;  /* consecutive trajectories from one start, >= 1 */
    char ensemble[256]; /* what the members of an ensemble have of their own, as lg-simulate --vary; "" */
    uint32_t line_system, line_form, line_initial,
        line_starts;           /* for the caller's own messages; 0 when absent */
    const lg_context *context; /* whose memory the arrays are in */
} lg_scene;

/* A YAML (or JSON) file. Keys: `system`; `form`; the parameters of the system; `links` where lists have one
 * entry a link (else the lists determine it); `initial` with the parts of the state; `t_end`; `starts`
 * {kind, low, high, segments, ahead}; `ensemble`, a text; quadrotors: `reference` (parabola). Chains take
 * `omega` or `p` in either form and convert them: p_i = m_ii q_i' + P_i sum_{j != i} m_ij q_j', q_i' =
 * omega_i x q_i. If the system has the form `form_wanted`, the scene has this form, whatever `form` says. If
 * form_wanted is NULL, the form is `form`, else the first form whose state `initial` gives, else the
 * system's first. A projection is logged as a warning with its line. `out` is overwritten. */
LG_API lg_status lg_scene_read(const lg_context *context, const char *path, const char *form_wanted,
                               lg_scene *out, lg_error *error);
/* Draws the start of a scene without `initial` according to `starts`, `ahead` left out. It is the first
 * start of lg_generate_trajectories with this seed and ahead 0. Errors: LG_INVALID_ARGUMENT (the scene has
 * a start), LG_OUT_OF_MEMORY, those of lg_system_start. */
LG_API lg_status lg_scene_draw_start(lg_scene *scene, uint64_t seed);
/* With the context it was read with. Leaves it zeroed; NULL and a zeroed scene are fine. */
LG_API void lg_scene_destroy(lg_scene *scene);

LG_END_DECLS

#endif
