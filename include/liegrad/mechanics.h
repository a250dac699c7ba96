/* Mechanical systems. A reader finds here the library's systems with their parameters, states, vector fields
 * and invariants; random starts and sampled trajectories; and scenes, the YAML files that describe a system
 * and a start. The library is liegrad; the last section (scene files) is in liegrad_io.
 *
 *   lg_system_options options;
 *   lg_system_options_init(&options);
 *   options.links = 2;
 *   options.parameters = &(lg_named_values){"gravity", &g, 1}, options.parameter_count = 1;
 *   lg_system_create(NULL, "pendulum-chain", &options, &system, &error);
 *   double *work = malloc(lg_system_work_size(system));
 *   lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work);   (then lg_stepper_create, integrators.h)
 *
 * A system is an entry of a table (src/mechanics/system.h), found by name and form. docs/simulate.md has the
 * equations of each system, its parameters with their keys and their names in gradients, the order of its
 * state and its invariants. The systems are oscillator; quartic; coupled-oscillators; pendulum-chain
 * (lagrangian | hamiltonian); rigid-body; rigid-body-attitude; heavy-top (cotangent | direct | lie-poisson |
 * quadratic); satellite; quadrotors (exact-thrusts | attitudes); cart-pole; rotary-pendulum; two-link-arm.
 *
 * A system is immutable after it is made, except by lg_system_set_parameters, so threads may share it;
 * each thread needs its own work memory. Evaluating a system allocates nothing. The cost of a chain is
 * proportional to its number of links. */
#ifndef LIEGRAD_MECHANICS_H
#define LIEGRAD_MECHANICS_H

#include "liegrad/taped.h"

LG_BEGIN_DECLS

typedef struct lg_system lg_system;

/* The values of one parameter: `key` is its name in scenes, and `values` has `count` numbers. The caller
 * owns both. */
typedef struct lg_named_values {
    const char *key;
    const double *values;
    size_t count;
} lg_named_values;

typedef struct lg_system_options {
    size_t size;      /* sizeof(lg_system_options) */
    const char *form; /* NULL: the system's first form. */
    /* Number of links k of pendulum-chain, 1..1000000; default 1. Other systems ignore it. */
    size_t links;
    /* The parameters that are given; the others get their default values. A parameter without a default
     * must be given. */
    const lg_named_values *parameters;
    size_t parameter_count;
} lg_system_options;

LG_API void lg_system_options_init(lg_system_options *options);

typedef enum lg_parameter_rule {
    LG_PARAMETER_FINITE,
    LG_PARAMETER_POSITIVE,
    LG_PARAMETER_UNIT_VECTOR, /* The vector has length 1, to 1e-9. */
    LG_PARAMETER_ANGLE        /* Radians, between -pi and pi. */
} lg_parameter_rule;

/* The description of one parameter of a system. Constant and static. */
typedef struct lg_parameter_entry {
    const char *key; /* Its name in scenes, such as "masses". */
    /* Its name in gradients: the label "m" gives m1, m2, ...; when `count` is 1 the label stands alone,
     * such as "g". */
    const char *label;
    size_t count; /* How many numbers it has; 0 means one per link. */
    lg_parameter_rule rule;
    /* Default values: `count` numbers, or one number for all links when `count` is 0. NULL: the parameter
     * must be given. */
    const double *fallback;
    const char *meaning; /* What it means, with its unit. */
} lg_parameter_entry;

/* The description of one part of the state, such as the directions q of all links. The part consists of
 * `outer` blocks of rows x columns numbers. The first block begins at number `first` of the state, and
 * blocks begin `stride` numbers apart. In scenes a part is a list of lists of lists; a level with one
 * element is left out. In the text of lg_system_layout each block appears as the key with its number
 * ("q2"), or as the key alone when `outer` is 1. */
typedef struct lg_state_entry {
    const char *key; /* Its name in scenes and layouts, such as "q". */
    size_t outer;    /* Number of blocks; 0 means one per link. */
    size_t rows, columns, first, stride;
    const double *fallback; /* Default values of one block. NULL: the part must be given. */
} lg_state_entry;

/* Writes name and form of entry `index` of the table of systems; each of the two outputs may be NULL.
 * *form becomes NULL when the system has one form only. Returns false, and writes nothing, beyond the last
 * entry. */
LG_API bool lg_system_at(size_t index, const char **name, const char **form);
/* Return the parameters, and the parts of the state, of a system: a static array that ends with an entry
 * whose key is NULL. The result is NULL for an unknown pair of name and form. `form` NULL means the
 * system's first form. */
LG_API const lg_parameter_entry *lg_system_parameters(const char *name, const char *form);
LG_API const lg_state_entry *lg_system_state(const char *name, const char *form);

/* Makes a system. `options` may be NULL for the defaults; its arrays are copied. options->form NULL means
 * the system's first form. Errors: LG_NOT_FOUND (unknown name or form), LG_INVALID_ARGUMENT (an unknown or
 * repeated key, a wrong number of values, a value against its rule, a missing parameter, links 0 or above a
 * million). */
LG_API lg_status lg_system_create(const lg_context *context, const char *name,
                                  const lg_system_options *options, lg_system **out, lg_error *error);
LG_API void lg_system_destroy(lg_system *system);
/* lg_system_copy makes a second system with the same parameters. lg_system_set_parameters changes all
 * parameters of a system that no other thread uses; `values` has lg_system_parameter_count numbers in the
 * order of lg_system_parameters. Errors: LG_OUT_OF_MEMORY (copy); LG_INVALID_ARGUMENT (set: a value against
 * its rule; nothing is changed then). */
LG_API lg_status lg_system_copy(const lg_context *context, const lg_system *system, lg_system **out);
LG_API lg_status lg_system_set_parameters(lg_system *system, const double *values);

LG_API const char *lg_system_name(const lg_system *system); /* Its name in the table of systems. */
LG_API const char *lg_system_form(const lg_system *system); /* NULL when the system has one form only. */
/* The order of the numbers in a state, as text that lives as long as the system: "q1 omega1 q2 omega2",
 * "q p", "y v R1 Omega1 R2 Omega2 q1 omega1 q2 omega2". */
LG_API const char *lg_system_layout(const lg_system *system);
LG_API const lg_space *lg_system_space(const lg_system *system);
/* The values of all parameters as one vector of lg_system_parameter_count numbers, in the order of
 * lg_system_parameters; the array belongs to the system. lg_system_parameter_label writes the label of
 * number `index` ("m2") into `text`, which has room for at least 32 characters. */
LG_API size_t lg_system_parameter_count(const lg_system *system);
LG_API const double *lg_system_parameter_values(const lg_system *system);
LG_API void lg_system_parameter_label(const lg_system *system, size_t index, char *text);
LG_API size_t lg_system_dim(const lg_system *system); /* Numbers in a state. */
/* How many numbers of a state, counted from its first, are reported to users: all, except for heavy-top in
 * the form quadratic, whose last six numbers (q and p) are not reported. */
LG_API size_t lg_system_reported(const lg_system *system);
/* Number of links of a chain; 0 for other systems. */
LG_API size_t lg_system_links(const lg_system *system);
/* Whether the states lie on a manifold other than R^n. */
LG_API bool lg_system_constrained(const lg_system *system);
LG_API bool lg_system_separable(const lg_system *system); /* H = K(p) + V(q): splitting schemes apply. */

/* Bytes of work memory that the functions below need (at least 8), aligned for doubles. What the memory
 * holds before and after a call does not matter. */
LG_API size_t lg_system_work_size(const lg_system *system);

/* Returns H(y); `work` has lg_system_work_size bytes. NaN for systems without an energy (quadrotors), and
 * at points off the manifold where the energy is not defined. */
LG_API double lg_system_hamiltonian(const lg_system *system, const double *y, double *work);

/* lg_system_observe writes the quantities by which two states are compared: lg_system_observed numbers
 * into `out`, which must not overlap y. For a chain these are the positions x_1, ..., x_k of its masses,
 * x_i = L_1 q_1 + ... + L_i q_i, then their velocities (6k numbers); for other systems the reported part
 * of the state. Errors: LG_NOT_FINITE (the velocities do not follow from the momenta). */
LG_API size_t lg_system_observed(const lg_system *system);
LG_API lg_status lg_system_observe(const lg_system *system, const double *y, double *out, double *work);

/* First integrals of the exact flow. There are lg_system_invariants of them: first "energy" if the system
 * has an energy, then the others that docs/simulate.md lists. */
LG_API size_t lg_system_invariants(const lg_system *system);
/* NULL when index is too large. */
LG_API const char *lg_system_invariant_name(const lg_system *system, size_t index);
LG_API double lg_system_invariant(const lg_system *system, size_t index, const double *y,
                                  double *work); /* NaN when index is too large. */

typedef enum lg_coordinates {
    /* States on the system's space; the field has values in the Lie algebra. For Lie group schemes. */
    LG_COORDINATES_LIE,
    /* States in R^dim; the field is the ambient velocity. For classical schemes. On R^n the same as LIE. */
    LG_COORDINATES_AMBIENT
} lg_coordinates;

/* The coordinates that a scheme needs: LG_COORDINATES_AMBIENT for splitting schemes and those with
 * `ambient`, LG_COORDINATES_LIE for all others. */
LG_API lg_coordinates lg_system_coordinates_for(const lg_scheme *scheme);

/* What ode.user of lg_system_ode points to: a system, and work memory for one thread. */
typedef struct lg_system_user {
    const lg_system *system;
    double *work;
} lg_system_user;

/* Fills `ode`: the space, the functions, `user`, and for AMBIENT the manifold. It also fills `user`. `user`,
 * `system` and `work` (lg_system_work_size bytes) must outlive the use of `ode`. The ambient field is the
 * generator of the LIE field, f(t, y) . y; docs/simulate.md has the fields of all systems. Exception: for
 * chains in Hamiltonian form AMBIENT is, with v_i = dH/dp_i and g_i = dH/dq_i,
 *   q_i' = v_i - q_i (q_i.v_i), p_i' = -g_i + q_i (q_i.g_i) + p_i (q_i.v_i) - q_i (p_i.v_i)
 * of an extension of H to the ambient space, because a classical scheme leaves the manifold
 * (src/mechanics/chain.h). The field returns LG_NOT_FINITE where the kinetic energy is not defined.
 *
 * ode.step, for variational schemes, is set for two systems. For the oscillator it is the midpoint rule
 * (discrete Lagrangian h L((q0 + q1)/2, (q1 - q0)/h)). For chains in both forms it is the trapezoidal
 * discrete Lagrangian in ambient coordinates with the constraints |q_i| = 1 (SHAKE for the positions, RATTLE
 * for the velocities; Hairer, Lubich, Wanner, Geometric Numerical Integration, VII.1.4), solved by Newton's
 * method to rounding; it returns LG_NO_CONVERGENCE when the step is too large.
 *
 * Errors: LG_INVALID_ARGUMENT (an argument is NULL, or the coordinates are unknown). */
LG_API lg_status lg_system_ode(const lg_system *system, lg_coordinates coordinates, lg_ode *ode,
                               lg_system_user *user, double *work);

/* What lg_system_taped_ode fills. */
typedef struct lg_system_taped_user {
    const lg_system *system;
    lg_var parameters;
} lg_system_taped_user;
/* Like lg_system_ode, for a tape (liegrad/taped.h). `parameters` is a variable of
 * lg_system_parameter_count elements; `user` is filled; `user` and `system` must outlive the use of `ode`.
 * Chains in Lagrangian form are one custom operation with hand-written first derivatives, which cost O(k)
 * in lg_backward and lg_jvp. Derivatives of these derivatives, and lg_grad, are made of plain operations
 * on k x k matrices, to any order. Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (AMBIENT for chains in
 * Hamiltonian form). */
LG_API lg_status lg_system_taped_ode(const lg_system *system, lg_coordinates coordinates, lg_var parameters,
                                     lg_taped_ode *ode, lg_system_taped_user *user);

/* ---- Mass matrix and potential of a system, as formulas on a tape ----
 *
 * The kinetic energy of a system is 1/2 v^T M(q) v, its potential energy V(q). The velocity of a line or an
 * angle is x', of a direction q', of a rotation the angular velocity in the body. */

typedef enum lg_coordinate_kind {
    LG_COORDINATE_LINE,
    LG_COORDINATE_ANGLE,
    LG_COORDINATE_DIRECTION,
    LG_COORDINATE_ROTATION,
    LG_COORDINATE_POSE
} lg_coordinate_kind;
#define LG_COORDINATE_KIND_COUNT 5

/* What M and V depend on, for B states in the units of the parameters. */
typedef struct lg_at {
    uint32_t rows;     /* B */
    uint32_t size;     /* n: rows of M */
    lg_var parameters; /* (P), in the order of the row's table. */
    /* The positions, a variable for each factor: lines and angles (B, n), directions (B, n, 3), rotations
     * (B, 1, 9). NULL for a mass matrix that does not depend on them. */
    const lg_var *state;
} lg_at;

/* A system as a row of formulas. Constant and static. */
typedef struct lg_energy_row {
    const char *name;
    const lg_parameter_entry *parameters; /* The list ends with a NULL key. */
    /* Records M, (B, n, n) or (1, n, n), with a row for each velocity, three for a direction. The constant M
     * of one direction alone is one number. With `count` 0 a direction has one row: M_ij I_3 couples two. */
    lg_var (*mass)(lg_tape *tape, const lg_at *at);
    lg_var (*potential)(lg_tape *tape, const lg_at *at); /* Records V (B, 1). NULL: V = 0. */
    uint32_t count; /* Number of coordinates; 0: any number, all of kind coordinates[0]. */
    lg_coordinate_kind coordinates[4];
    unsigned seen; /* Bit i: M or V depends on coordinate i. */
    bool moving;   /* True if M depends on the positions. */
} lg_energy_row;

/* ---- Parts of a chain (LG_UNSUPPORTED for other systems) ---- */

/* Writes the constant matrix m (k, k), row-major: m_ij = mu_max(i,j) L_i L_j with mu_i = sum_{l >= i} m_l,
 * where m_l is mass l. It is the same in both forms. */
LG_API lg_status lg_chain_mass_matrix(const lg_system *system, double *m);
/* Writes the k weights mu_i g L_i of the potential V(q) = sum_i weight_i e3.q_i. They are the same in both
 * forms. */
LG_API lg_status lg_chain_potential_weights(const lg_system *system, double *weights);
/* Convert states between the two forms of a chain with the same parameters. lg_chain_momenta takes q_1,
 * omega_1, ... to q_1, p_1, ...; lg_chain_velocities takes q_1, p_1, ... to q_1, omega_1, .... `from` and
 * `to` have 6k numbers and may be equal; `system` may have either form; `work` has lg_system_work_size
 * bytes. With q_i' = omega_i x q_i, p_i = m_ii q_i' + P_i sum_{j != i} m_ij q_j', P_i = I - q_i q_i^T;
 * back, q_i' = dH/dp_i and omega_i = q_i x q_i'. The cost is O(k). Errors: LG_NOT_FINITE
 * (lg_chain_velocities only). */
LG_API lg_status lg_chain_momenta(const lg_system *system, const double *from, double *to, double *work);
LG_API lg_status lg_chain_velocities(const lg_system *system, const double *from, double *to, double *work);

/* ---- Starts and trajectories ---- */

/* How random starts are drawn. On T*S^2, q is uniform on the sphere (a normalised N(0, I_3)), and
 * p = q x u with u uniform in a box. On R^n, so(3)* and se(3)* the whole state is uniform in a box. */
typedef enum lg_starts {
    LG_STARTS_THESIS, /* The box is [0, 1]^3 on T*S^2 and [-1, 1]^n elsewhere. */
    LG_STARTS_BOX,    /* The box is [low, high] in every coordinate. */
    /* For chains of at most LG_PLANE_LINKS links: starts in the plane of e1 and e3 that hang along -e3 on
     * average. First angles a_i and rates w_i are drawn from N(0, 1). They give the nodes x_i =
     * sum_{j <= i} L_j (sin a_j, -cos a_j) and their velocities v_i. Then x_i + .2 N and 3 (.5 v_i + .4
     * N), with N from N(0, I_2), are brought back to the constraints |x_i - x_{i-1}| = L_i by Newton's
     * method with steps of least norm in (x, v). After Finzi, Wang, Wilson, NeurIPS 2020. */
    LG_STARTS_PLANE
} lg_starts;
#define LG_STARTS_COUNT 3
#define LG_PLANE_LINKS  32

typedef enum lg_noise { LG_NOISE_NORMAL /* eps N(0, 1) */, LG_NOISE_UNIFORM /* eps U(-1, 1) */ } lg_noise;

typedef struct lg_trajectory_options {
    size_t size;         /* sizeof(lg_trajectory_options) */
    size_t trajectories; /* N >= 1; default 500. */
    size_t points;       /* M >= 2 points of a trajectory, with the start; default 5. */
    double t_end;        /* T > 0, the duration of a trajectory: t_j = j T/(M - 1); default 0.1. */
    double noise;        /* eps >= 0, in the units of the state; default 0. */
    lg_noise noise_kind; /* Default normal. */
    /* true: first points get noise, too, and are then projected to their manifold. Default false. */
    bool noise_first;
    lg_starts starts; /* Default thesis. */
    double low, high; /* The box of LG_STARTS_BOX, low < high; default -1, 1. */
    /* >= 0. A trajectory begins where the system is a random time, drawn from U[0, ahead], after its drawn
     * start. Default 0. */
    double ahead;
    /* s >= 1. The motion from each start is cut into s consecutive trajectories of length T; with s = 3,
     * 900 trajectories come from 300 starts. Default 1. */
    size_t segments;
    /* Number of the first trajectory, a multiple of `segments`; not 0 where this set is a part of a larger
     * one. Default 0. */
    size_t first;
    uint64_t seed; /* Default 1. */
    /* Tolerances of the reference integration, as in lg_step_controller; default 1e-12 and -1e-13. */
    double rtol, atol;
} lg_trajectory_options;

LG_API void lg_trajectory_options_init(lg_trajectory_options *options);

/* Draws one random start y (space->dim numbers), factor by factor, as `starts`, `low` and `high` of the
 * options say; the other options are not used. `options` NULL means the defaults. Errors:
 * LG_INVALID_ARGUMENT, LG_UNSUPPORTED (the space has a factor SO(3) or SE(3), or `starts` is
 * LG_STARTS_PLANE). */
LG_API lg_status lg_space_draw_start(const lg_space *space, const lg_trajectory_options *options, lg_rng *rng,
                                     double *y);
/* Like lg_space_draw_start, on the system's space; here chains may have LG_STARTS_PLANE. `ahead` is not used.
 * lg_system_generate draws its first start from stream 0 of the seed with this function. Errors:
 * those of lg_space_draw_start, LG_NO_CONVERGENCE (LG_STARTS_PLANE). */
LG_API lg_status lg_system_draw_start(const lg_system *system, const lg_trajectory_options *options,
                                      lg_rng *rng, double *y);

/* Samples trajectories with adaptive steps of rkmk54 on manifolds and of dp54 on R^n. Outputs: t (M),
 * trajectories (N, M, d) with d numbers per state, and hamiltonian (N), the energy H of each trajectory's
 * first point without noise. Noise is added after the integration, in ambient coordinates, to all points
 * but the first (see noise_first). The start and the noise of trajectory i depend only on (seed, i) when
 * segments = 1, so the starts are the same for every noise, N, M and T. `options` NULL means the defaults.
 * Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (the kind of starts), LG_CANCELLED, those of
 * lg_integrate_adaptive. */
LG_API lg_status lg_system_generate(const lg_context *context, const lg_system *system,
                                    const lg_trajectory_options *options, double *t, double *trajectories,
                                    double *hamiltonian, lg_error *error);

/* The same reference integration from given starts (n, d), without noise, for judging models. `times`
 * (count) are as in lg_integrate_adaptive, from t0 = 0; out has shape (n, count, d). rtol <= 0 means
 * 1e-12, and atol = 0 means -1e-13; else both are as in lg_step_controller. Errors: those of
 * lg_system_generate. */
LG_API lg_status lg_system_solve(const lg_context *context, const lg_system *system, const double *starts,
                                 size_t n, const double *times, size_t count, double rtol, double atol,
                                 double *out, lg_error *error);

/* ---- Scene files (library liegrad_io) ---- */

/* A scene: a system with its parameters and, if the file gives one, a start. The keys and shapes in the
 * file are those of lg_system_parameters and lg_system_state. */
typedef struct lg_scene {
    lg_system *system; /* Owned. */
    bool has_initial;
    /* The start: lg_system_dim numbers in the order of the system's form; owned. Without the key `initial`
     * it is NULL until lg_scene_draw_start. */
    double *state;
    /* The start was off the manifold, by at most 1e-6, and was projected. */
    bool projected;
    double projection; /* How far the start was off the manifold. */
    bool has_t_end;
    double t_end;
    /* The file has the key `starts`. Without it `starts` is thesis and `segments` is 1. */
    bool has_starts;
    lg_starts starts;
    /* The box of starts of kind box: chains have p = q x u with u from U[low, high]^3, other systems a
     * state from U[low, high]^d. Default -1, 1. */
    double low, high;
    double ahead;      /* As in lg_trajectory_options; default 0. */
    uint32_t segments; /* As in lg_trajectory_options; default 1. */
    /* How the members of an ensemble differ from the scene, in the syntax of lg-simulate --vary; "" when
     * it is not given. */
    char ensemble[256];
    uint32_t line_system, line_form, line_initial,
        /* Lines of these keys in the file, for the caller's messages; 0: no such key. */
        line_starts;
    const lg_context *context; /* The memory of the arrays comes from it. */
} lg_scene;

/* Reads a scene from a YAML (or JSON) file into `out`, whose earlier contents are overwritten. docs/files.md
 * has the keys. Chains in either form take `omega` or `p` and convert it.
 *
 * The form of the scene is `form_wanted` if this is not NULL and the system has such a form. Otherwise it
 * is the value of the key `form`; without this key, the first form for which `initial` has all required
 * parts; and without such a form, the system's first form. When a start is projected, a warning with its
 * line is logged. Errors: LG_FORMAT (with the line). */
LG_API lg_status lg_scene_read(const lg_context *context, const char *path, const char *form_wanted,
                               lg_scene *out, lg_error *error);
/* Draws the start of a scene without `initial` as `starts`, `low` and `high` say; `ahead` is not used. It
 * is the first start of lg_system_generate with this seed and ahead = 0. Errors: LG_INVALID_ARGUMENT
 * (the scene has a start), those of lg_system_draw_start. */
LG_API lg_status lg_scene_draw_start(lg_scene *scene, uint64_t seed);
/* Frees what the scene owns and zeroes the struct. NULL and a zeroed scene are allowed. */
LG_API void lg_scene_destroy(lg_scene *scene);

LG_END_DECLS

#endif
