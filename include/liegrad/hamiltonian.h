/* Learned Hamiltonians H_theta on phase spaces. A reader finds here the table of families, the description
 * and initialisation of a model, the training loss, evaluation on a tape, the model as a program, and the
 * files of trajectories, of models and of studies. The library is liegrad; from the section on trajectories
 * on it is liegrad_io. liegrad/model.h evaluates a trained model in a control loop. docs/hamiltonians.md is
 * the guide.
 *
 * A Hamiltonian consists of a function V and of terms that its family gives. V is an MLP whose last layer has
 * no bias, or linear with one weight per coordinate, or linear in a dictionary of functions. A family is an
 * entry of a table, lg_hamiltonian_family; lg_hamiltonian_family_at lists them, and docs/adding.md shows how
 * to add one. Two of them:
 *
 *   "chain": n links on (T*S^2)^n, state q_1, p_1, ..., q_n, p_n (6n numbers).
 *     H = 1/2 p^T M(q)^{-1} p + V(q), M_ij = m_ij P_i P_j (i != j), M_ii = m_ii I, P_i = I - q_i q_i^T,
 *     m = Gamma^T Gamma + diag(max(0, b)). V takes q (3n numbers). Inputs: spatial torques tau_i (3n).
 *     On T*S^2 with v = dH/dp, g = dH/dq:
 *       q' = v - q(q.v), p' = -g + q(q.g) + p(q.v) - q(p.v),
 *     in se(3): xi = q x v, eta = g x q + v x p + tau. docs/mechanics.md has the kinetic gradient, and the
 *     extension of the kinetic energy that schemes use which leave the manifold.
 *   "separable": n degrees of freedom on R^{2n}, state q, p.
 *     H = 1/2 |A p|^2 + V(q). V takes q (n numbers). Inputs: n forces.
 *   "rotation", "rotation-direction", "rotation-line", "pose", "pose-direction", "direction-line": bodies.
 *     A state has R in SO(3) (9 numbers, row-major, body to space) and its spatial angular momentum pi, then
 *     a direction q in S^2 and p, then lines x and their momenta, as far as the family has them.
 *     H = 1/2 p^T M(R, q)^{-1} p + V. M is such that 1/2 sum_ij m_ij v_i'.v_j' is the kinetic energy, with
 *     one constant matrix m = Gamma^T Gamma + diag(max(0, b)) for all vectors v_i: the columns of R, q, and
 *     x_k e_k for line k with a vector e_k of three parameters. V takes R, q, x. Inputs: torques in space on
 *     R and on q, and forces along x. src/hamiltonian/bodies.c has the equations:
 *       R' = hat(omega) R, pi' = omega x pi - sum_j r_j x dH/dr_j + tau,
 *       with omega = dH/dpi and the columns r_j of R; q and p as in a chain; x' = dH/dp, p' = -dH/dx + f.
 *   "constrained": n coordinates with constraints g(q) = 0 of the user, state q, p. H and the equations of
 *     motion are in liegrad/constraint.h, with M = Gamma^T Gamma + diag(max(0, b)). V takes q (n numbers).
 *     Inputs: n forces, of which P input acts.
 *
 * Scaled units. Internally all quantities are divided by the model's scales: times by T (scales.time), part i
 * of a state by s_i (scales.part), energies by E = s_1 s_2 / T. So a system is the same internally
 * whatever its units are. The functions of this header take and return quantities in the units of the data.
 * The functions of a family, V and the parameter vector are in scaled units. All scales are 1 after
 * lg_hamiltonian_init.
 *
 * The flat parameter vector theta has the layers of V in order (weight (in, out) row-major, then bias), then
 * the `arrays` of the family: Gamma (n, n) and b (n) of a chain and of a constrained system, A (n, n) of a
 * separable system, Gamma (k, k), b (k) and e (l, 3) of bodies with k vectors and l lines. */
#ifndef LIEGRAD_HAMILTONIAN_H
#define LIEGRAD_HAMILTONIAN_H

#include "liegrad/constraint.h"
#include "liegrad/fit.h"
#include "liegrad/model.h"

LG_BEGIN_DECLS

/* The form of V(x) with the coordinates x (d numbers): an MLP; linear; or a dictionary, which is linear in
 * the functions
 *   x_i, x_i^2, x_i^3, x_i^4, sin x_i, cos x_i, each for i = 1..d, then x_i x_j for i < j,
 * in this order. x is in scaled units, except in sin and cos, where it is an angle in radians. */
typedef enum lg_potential_kind {
    LG_POTENTIAL_MLP,
    LG_POTENTIAL_LINEAR,
    LG_POTENTIAL_DICTIONARY
} lg_potential_kind;
#define LG_POTENTIAL_KIND_COUNT 3

/* The symmetry of V, with N the network, linear function or dictionary.
 *   NONE       V(x) = N(x)
 *   EVEN, ODD  V(x) = (N(x) + N(-x))/2 and (N(x) - N(-x))/2
 *   AXIAL      rotations about e3 do not change V: N takes e3.q_i, q_i.q_j, e3.(q_i x q_j) of all i and all
 *              pairs i < j of a chain, in this order (the last ones change sign in a mirror), or R^T e3, R^T
 *              q_i of bodies without lines
 *   SPHERICAL  no rotation changes V: N takes q_i.q_j, i < j, of chains of two links and more, R^T q_i of
 *              bodies with directions and without lines, or |q|^2 of separable systems, whose kinetic energy
 *              is then |A|^2 |p|^2/(2 n), with |A|^2 the sum of squares
 * docs/hamiltonians.md ("Symmetry") has the momenta that V then conserves. */
typedef enum lg_symmetry {
    LG_SYMMETRY_NONE,
    LG_SYMMETRY_EVEN,
    LG_SYMMETRY_ODD,
    LG_SYMMETRY_AXIAL,
    LG_SYMMETRY_SPHERICAL
} lg_symmetry;
#define LG_SYMMETRY_COUNT 5

#define LG_HAMILTONIAN_MAX_COPIES  32  /* Largest n. */
#define LG_HAMILTONIAN_MAX_POINTS  512 /* Most points of a training trajectory. */
#define LG_HAMILTONIAN_MAX_ARRAYS  3
#define LG_HAMILTONIAN_MAX_FACTORS 5
#define LG_HAMILTONIAN_MAX_PARTS   6

typedef struct lg_hamiltonian_family lg_hamiltonian_family;

/* The scales of a model, in the units of the data: `time` is T, part[i] is the scale of part i of a state. */
typedef struct lg_hamiltonian_scales {
    double time, part[LG_HAMILTONIAN_MAX_PARTS];
} lg_hamiltonian_scales;

/* The description of a learned Hamiltonian, without its parameters. Plain data, filled by
 * lg_hamiltonian_init; it may be copied. `family` must outlive it. */
typedef struct lg_hamiltonian {
    const lg_hamiltonian_family *family;
    uint32_t n; /* Copies of the family's factors: links of a chain, or degrees of freedom. */
    lg_potential_kind potential;
    lg_symmetry symmetry; /* Symmetry of V: NONE after lg_hamiltonian_init. */
    /* V as a network with one output. Its inputs are the family->inputs n coordinates or the invariants of
     * the symmetry, or the functions of the dictionary of these. Only LG_POTENTIAL_MLP has hidden layers. */
    lg_mlp net;
    lg_hamiltonian_scales scales; /* 1 after lg_hamiltonian_init; the caller may change them. */
    /* Family "constrained": the constraint of n coordinates; NULL after lg_hamiltonian_init: no constraint.
     * The caller sets it; it is borrowed and must outlive the model. */
    const lg_constraint *constraint;
} lg_hamiltonian;

/* Variables that depend on theta only and serve all rows of a batch; lg_hamiltonian_bind makes them.
 * Borrows the model. Valid until the tape is rewound. */
typedef struct lg_hamiltonian_vars {
    const lg_hamiltonian *model;
    lg_mlp_vars net;
    lg_var kinetic[5]; /* What the family's `bind` makes of its arrays. */
} lg_hamiltonian_vars;

/* ---- Families ----
 *
 * A family describes one kind of learned Hamiltonian. Training, evaluation, files and exported C use this
 * description. lg_hamiltonian_init also takes a family of the caller, but files refer to the families of
 * the table (src/hamiltonian/families.c) by name. In the functions below, y, gradients and algebra
 * elements are arrays of the space's parts (liegrad/taped.h), in scaled units. The functions record on
 * `tape`, and their errors stick to it. The field of each pair of parts follows from dH/dy: on R^n
 * x' = dH/dp, p' = -dH/dx; on T*S^2 as in a chain; on T*SO(3) R' = hat(omega) R and
 * pi' = omega x pi - sum_j r_j x dH/dr_j with the columns r_j of R. An input (B, forces n) is added to the
 * change of the momenta. */
typedef struct lg_hamiltonian_array {
    const char *name; /* Its name in files, below /model, such as "mass/gamma". */
    uint32_t rank;    /* Shape: 1 for (m), 2 for (m, m) with m = each * n; 0 ends the list. */
    uint32_t each;    /* 0 stands for 1. */
} lg_hamiltonian_array;

struct lg_hamiltonian_family {
    const char *name;        /* Its name in files, such as "chain". */
    const char *description; /* Description in words, for programs. */
    const char *copy;        /* What n counts, such as "link". */
    uint32_t most;           /* Largest n; 0 stands for LG_HAMILTONIAN_MAX_COPIES. */
    /* The factors of the space. Factor i has each[i] * n copies, where each[i] = 0 stands for 1. The parts of
     * a state are pairs: positions, then the momenta that are conjugate to them. */
    lg_space_kind factor[LG_HAMILTONIAN_MAX_FACTORS];
    uint32_t each[LG_HAMILTONIAN_MAX_FACTORS];
    uint32_t factors;
    /* For families of bodies: how many rotations, directions and lines one copy has. */
    struct {
        uint32_t rotations, directions, lines;
    } bodies;
    /* true for the parts of a state that have a unit, and so a scale; the scales of the other parts are 1.
     * In each pair of parts the product of the two units must be the unit of an action (energy times time),
     * as for q and p. */
    bool scaled[LG_HAMILTONIAN_MAX_PARTS];
    /* With n >= `many`, lg_hamiltonian_find_scales makes T `stretch` times longer and s_2 `stretch` times
     * smaller. Then V is larger in scaled units, and small networks learn such systems better (measured,
     * docs/reports/training.md). many = 0: never. */
    uint32_t many;
    double stretch;
    uint32_t inputs; /* Numbers per copy that V takes. */
    uint32_t forces; /* Numbers per copy of an input u. */
    /* Names of the parts of a state, such as "q", "p"; NULL ends the list. */
    const char *layout[LG_HAMILTONIAN_MAX_PARTS + 1];
    bool numbered;                         /* The state is q1 p1 q2 p2 ... instead of q p. */
    const char *state_units, *energy_unit; /* The units of a state and of H, as text in files. */
    /* Words for the headers of exported C: the formula of H, what an input is, what the field is. NULL:
     * not written. */
    const char *formula, *input_meaning, *field_meaning;
    const char *scheme;   /* Name of the default scheme of training and of exported steps. */
    const char *accurate; /* Name of the embedded scheme that integrates learned flows accurately. */
    lg_hamiltonian_array arrays[LG_HAMILTONIAN_MAX_ARRAYS + 1];
    /* Initial arrays are drawn from U[0, 1], and drawn again while this function returns false. NULL:
     * always usable. */
    bool (*usable)(const lg_hamiltonian_family *family, uint32_t n, const double *arrays);
    /* Makes vars->kinetic from the arrays, which are variables of their shapes. NULL: nothing to do. */
    void (*bind)(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars);
    /* Records H (B, 1). */
    lg_var (*energy)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y);
    /* Records dH/dy. NULL: the energy is differentiated. */
    void (*gradient)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out);
    /* Records dH/dy in a shorter form that holds only on the manifold, for training with Lie group
     * schemes. NULL: `gradient` is used. */
    void (*gradient_on_manifold)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                 lg_var *out);
    /* For variational steps: records K (1, N, N), constant in y, and z' (B, N) with the kinetic energy 1/2
     * z'.K z', where z has the positions of all parts one after the other. NULL: no variational steps. */
    void (*ambient)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *K, lg_var *rate);
    /* Records y' for schemes that leave the manifold. NULL: y' is the generator of the field at y. */
    void (*velocity)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out);
    /* For separable systems, H = K(p) + V(q), and their splitting schemes: records dH/dp from p. NULL: the
     * family is not separable. */
    lg_var (*drift)(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p);
    /* Says in words what holds on the manifold of the states. NULL: every state lies on it. */
    const char *manifold;
    bool constrained; /* lg_hamiltonian.constraint is used, and gives the manifold. */
};

LG_API size_t lg_hamiltonian_family_count(void);
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_at(size_t index);       /* NULL beyond the last. */
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_find(const char *name); /* NULL: unknown name. */
/* Returns the first family that can learn the system, and its n; NULL when there is none. */
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_for(const lg_system *system, size_t *n);
/* Writes the space of the states. Errors: those of lg_space_init. */
LG_API lg_status lg_hamiltonian_space(const lg_hamiltonian_family *family, uint32_t n, lg_space *space);
/* Returns the distance of a state from the manifold, the largest over all copies of all factors: on T*S^2
 * the larger one of ||q| - 1| and |q.p|/|p|; on SO(3) the largest number of |R^T R - I|, or 2 if the
 * determinant of R is not positive. If the distance is above 0, *copy becomes the index, from 0, of the
 * worst copy in its factor. */
LG_API double lg_hamiltonian_off_manifold(const lg_hamiltonian_family *family, uint32_t n,
                                          const double *state, uint32_t *copy);

/* ---- Description of a model ---- */

/* Fills `model`. `hidden` has `hidden_layers` widths; both, and `activation`, count only for
 * LG_POTENTIAL_MLP. Errors: LG_INVALID_ARGUMENT (n outside 1..family->most, unknown
 * potential, a hidden width of 0, too many layers, family NULL). */
LG_API lg_status lg_hamiltonian_init(lg_hamiltonian *model, const lg_hamiltonian_family *family, uint32_t n,
                                     lg_potential_kind potential, const uint32_t *hidden,
                                     uint32_t hidden_layers, lg_activation activation);
/* Sets the symmetry of the model's potential, and with it the number of inputs of model->net. Call it before
 * parameters are made. Errors, the model is then unchanged: LG_INVALID_ARGUMENT (an unknown symmetry, a model
 * that lg_hamiltonian_init did not make), LG_UNSUPPORTED (the family's coordinates have no such symmetry; V
 * would be constant, as for SPHERICAL and one link; a dictionary of more than 96 invariants). */
LG_API lg_status lg_hamiltonian_set_symmetry(lg_hamiltonian *model, lg_symmetry symmetry);
LG_API size_t lg_hamiltonian_parameters(const lg_hamiltonian *model);  /* Number of parameters. */
LG_API uint32_t lg_hamiltonian_state_dim(const lg_hamiltonian *model); /* d: numbers in a state. */
/* m = forces n: numbers in an input. */
LG_API uint32_t lg_hamiltonian_input_dim(const lg_hamiltonian *model);
/* Offset in theta of array `index` of the family. */
LG_API size_t lg_hamiltonian_array_offset(const lg_hamiltonian *model, size_t index);
/* lg_hamiltonian_initialise draws Gamma and b of a chain again, at most 10000 times, while a Cholesky
 * pivot of m is below this number (for one link, 2 of 100 draws are). A nearly singular initial mass sends
 * trajectories far away, and training may end at a mass near 0, where gradients vanish. */
#define LG_HAMILTONIAN_LEAST_PIVOT 0.1
/* Draws theta (lg_hamiltonian_parameters): weights and biases from U(+-1/sqrt(fan_in)), the family's
 * arrays from U[0, 1]. */
LG_API void lg_hamiltonian_initialise(const lg_hamiltonian *model, lg_rng *rng, double *theta);
/* Writes the learned mass matrix m (n, n) of a chain or a constrained system in the units of the data, s_2 T
 * (Gamma^T Gamma + diag(max(0, b))), for a constrained system divided by s_1; row-major and symmetric.
 * Errors: LG_UNSUPPORTED (another family). */
LG_API lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m);

/* ---- Training ---- */

/* A first integral G: a function of the state that the true system is known to conserve, besides its
 * energy. */
typedef struct lg_first_integral {
    const char *name;                    /* Such as "vertical-angular-momentum". */
    const char *formula;                 /* The formula of G, as text. */
    const lg_hamiltonian_family *family; /* The family whose states G takes; NULL: any. */
    bool vectors;                        /* G takes states of chains and of bodies without lines only. */
    uint32_t n;                          /* Number of copies for which G is defined; 0: any number. */
    int power
        [LG_HAMILTONIAN_MAX_PARTS]; /* Unit of G: (unit of part 1)^power[0] * (unit of part 2)^power[1] ... */
    bool measured; /* `power` does not apply: lg_hamiltonian_integral_unit finds a unit from the data. */
    /* Records G (B, 1) from the parts y of states in the units of the data. Errors stick to the tape. */
    lg_var (*record)(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y);
    void *user; /* First argument of `record`. */
} lg_first_integral;

/* The table of first integrals (src/hamiltonian/integrals.c):
 *   oscillator                  (q_1^2 + p_1^2)/2, for separable systems in which (q_1, p_1) is an oscillator
 *                               that is not coupled to the rest
 *   anharmonic                  (q_1^2 + p_1^2)/2 + q_1^4/4, likewise
 *   angular-momentum            q_1 p_2 - q_2 p_1 of two degrees of freedom, for K and V that do not change
 *                               when the plane is rotated
 *   vertical-angular-momentum   sum e3.pi + sum_i e3.(q_i x p_i) of chains, and of bodies without lines,
 *                               under gravity along e3 */
LG_API size_t lg_first_integral_count(void);
LG_API const lg_first_integral *lg_first_integral_at(size_t index);       /* NULL beyond the last. */
LG_API const lg_first_integral *lg_first_integral_find(const char *name); /* NULL: unknown name. */
/* Whether G takes the states of the model (its family and n). */
LG_API bool lg_first_integral_fits(const lg_first_integral *integral, const lg_hamiltonian *model);
/* Makes a first integral of the function `integral` (x) -> G of a program: x (B, d) is a state of the model
 * in the units of the data, G is one number per row. `measured` is set. `program` and `name`, which messages
 * show, are borrowed and must outlive *out. Errors: LG_NOT_FOUND (no such function), LG_SHAPE (it has other
 * inputs or outputs). */
LG_API lg_status lg_first_integral_from(const lg_program *program, const lg_hamiltonian *model,
                                        const char *name, lg_first_integral *out, lg_error *error);

/* The penalty on changes of a first integral G along predictions y_j from the start x. MEAN_SQUARE: mu
 * times the mean over the batch of sum_j (G(y_j) - G(x))^2. SUM_ABSOLUTE: mu times the sum over the batch
 * of sum_j |2 G(y_j) - 2 G(x)|. */
typedef enum lg_penalty_form { LG_PENALTY_MEAN_SQUARE, LG_PENALTY_SUM_ABSOLUTE } lg_penalty_form;

/* The distance D between a predicted point y and a given point z in the loss. The loss is the sum of D^2 over
 * trajectories and points, divided by batch * d * (M - 1), where d is the number of numbers in a state.
 * - AMBIENT: D = |y - z| in R^d.
 * - GEODESIC, on each T*S^2 with y = (q, p) and z = (q', p'): D^2 = theta^2 + |P p - p'|^2. theta is the
 *   angle between q and q'. P is the parallel transport along the geodesic from q to q': P p = p - 2 m
 *   (m.p)/|m|^2 with m = q + q'. D is the length, in the metric that Sasaki
 *   gives T*S^2, of the path on which q moves along the geodesic to q' while the carried p changes evenly to
 *   p'. For y near z, D^2 is |y - z|^2 - ((q' - q).p)^2 to leading order. It has a kink where q' = -q.
 *   Given points are projected to the manifold first. On R^n it is the same as AMBIENT. */
typedef enum lg_hamiltonian_distance { LG_DISTANCE_AMBIENT, LG_DISTANCE_GEODESIC } lg_hamiltonian_distance;

/* Where predictions start. MEASURED: at the first points, which then are not in the loss. ESTIMATED, for
 * first points that have noise like the others: at exp(a_i) . y_i1, where y_i1 is the first point of
 * trajectory i and a_i an unknown algebra element; the first points are then in the loss. */
typedef enum lg_hamiltonian_starts { LG_START_MEASURED, LG_START_ESTIMATED } lg_hamiltonian_starts;

/* A training problem: trajectories (N, M, d) of equidistant points, dt apart, and settings. All pointers
 * are borrowed. */
typedef struct lg_hamiltonian_problem {
    const lg_hamiltonian *model;
    const lg_scheme *scheme; /* Must be recordable on a tape and fit the space. */
    uint32_t substeps;       /* Integrator steps between two points, >= 1. */
    double penalty;          /* mu; 0 means no penalty. */
    lg_penalty_form penalty_form;
    /* G: an entry of the table or your own; NULL: the first entry. */
    const lg_first_integral *penalty_integral;
    lg_hamiltonian_distance distance;
    lg_hamiltonian_starts starts;
    /* The factor of the squared differences of part i, in scaled units, in the loss. All 0 means all 1. */
    double weight[LG_HAMILTONIAN_MAX_PARTS];
    size_t trajectories, points;
    double dt;
    const double *data; /* (N, M, d), states in the family's layout. */
} lg_hamiltonian_problem;

/* Checks a training problem. Errors:
 * - LG_INVALID_ARGUMENT: no model, data, trajectories or scheme; points outside 2..LG_HAMILTONIAN_MAX_POINTS;
 *   N M above 2^32 - 1; substeps 0; dt or penalty out of range or not finite; an unknown penalty_form, kind
 *   of starts or distance
 * - LG_UNSUPPORTED: a scheme that cannot be recorded or that projects; a splitting scheme for a family
 *   without force and drift; LG_SCHEME_VARIATIONAL for a family without `ambient`; a first integral that
 *   does not fit the model; geodesic distances on other spaces than R^n and T*S^2, or with a scheme that
 *   leaves the manifold; estimated starts with a constraint */
LG_API lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error);

/* Computes scales from the data; the caller sets them in the model before training. In scaled units numbers
 * have sizes about 1. If the units of the data change, numbers in scaled units change by rounding only, and
 * not at all if the factors are powers of 2. Root mean squares are over all points, with the squares of the
 * numbers of a copy added. The rate of a part is the root mean square of its change over a lag, divided by
 * the lag; the lag is the shortest of 1, 2, 4, ... points over which a part changes by more than half its
 * spread, or a whole trajectory.
 *   T    the geometric mean of spread/rate over the parts that change
 *   s_1  the size (root mean square) of q where the family scales it, else 1
 *   s_2  s_1 |p| / (|q'| T), with |p| the size of p and |q'| the rate of q: then q moves as in the
 *        data when the mass is 1 in scaled units
 *   the scales of further pairs of parts have the product s_1 s_2, too. Where the position has a unit, they
 *        are such that it moves as in the data when the mass is 1
 * With n >= family->many, T is then family->stretch times longer and s_2 as much smaller. Where nothing
 * moves, T is the duration of a trajectory and s_i the size. Only model, trajectories, points, dt and data
 * of the problem are read. Errors: LG_INVALID_ARGUMENT (one of them is missing), LG_NOT_FINITE (sizes out
 * of range). */
LG_API lg_status lg_hamiltonian_find_scales(const lg_hamiltonian_problem *problem, lg_hamiltonian_scales *out,
                                            lg_error *error);
/* Sets problem->weight from the data, so that the parts count alike in the loss: one over the mean square
 * of the part's change from the first point to the others, in scaled units. Errors: LG_INVALID_ARGUMENT as
 * lg_hamiltonian_find_scales. */
LG_API lg_status lg_hamiltonian_weigh(lg_hamiltonian_problem *problem, lg_error *error);

/* Fills a problem for lg_fit from a training problem, which is borrowed and must outlive the fit. The loss
 * is the mean over (batch, d, M - 1) of the squared differences of predicted and given points in scaled
 * units, times the weights of their parts; the first points are left out. With another distance its
 * squares take the place of the squared differences. The penalty is added, with G in the units of the
 * data. With estimated starts the mean is over M points, and the fit's parameters are theta, then the a_i
 * (N, algebra_dim), which should start at zero. */
LG_API void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out);

/* Writes the mean squared difference of predicted and given points over all trajectories, in the units of
 * the data, with the ambient distance, without weights and penalty, in double precision. A measured start
 * does not count. `theta` has the fit's parameters. *out is not finite where a prediction is not. Errors:
 * those of lg_hamiltonian_problem_check and of the integrator. */
LG_API lg_status lg_hamiltonian_mean_squared_error(const lg_context *context,
                                                   const lg_hamiltonian_problem *problem, const double *theta,
                                                   double *out, lg_error *error);
/* Writes the unit in which the first integral of the penalty is weighed, a positive number in the unit of G.
 * It is s_1^power[0] s_2^power[1], with s_i the scales of the model. If G is `measured`, it is the root mean
 * square, over all points of the data, of the length of dG/dy, with each number of y divided by its scale:
 * how much G changes when the state moves by its scales. Errors: those of lg_hamiltonian_problem_check with a
 * penalty, LG_NOT_FINITE (`measured`: G or a derivative is not finite, or all derivatives are zero, at the
 * points of the data), LG_NOT_DIFFERENTIABLE. */
LG_API lg_status lg_hamiltonian_integral_unit(const lg_context *context,
                                              const lg_hamiltonian_problem *problem, double *out,
                                              lg_error *error);
/* Writes the truncation floor: what the integrator's own error adds to lg_hamiltonian_mean_squared_error when
 * the model is exact. Let y_s be the predictions from the given starts with s substeps, and k the order of
 * the scheme. By Richardson's extrapolation the error of y_s is 2^k/(2^k - 1) (y_s - y_2s) to leading order,
 * so
 *   floor = (2^k/(2^k - 1))^2 mean (y_s - y_2s)^2
 * over the same trajectories, components and points. Twice the substeps divide the floor by about 2^(2k).
 * A loss near the floor measures the steps, not the model. Errors: those of
 * lg_hamiltonian_mean_squared_error, LG_INVALID_ARGUMENT (2^31 substeps or more). */
LG_API lg_status lg_hamiltonian_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      const double *theta, double *out, lg_error *error);

/* Makes the initial potential V steeper if its forces are too small for the data: full-batch methods then
 * adapt the mass matrix first, and may end in a minimum where V hardly varies. Call it after
 * lg_hamiltonian_initialise. It multiplies the last layer of V in theta by max(1, s^(1/3)), where s is the
 * root mean square of the forces in the data divided by that of the network's forces:
 *   s^2 = sum (D - f)^2 / sum g^2
 * Here y' = f + g, and g is the part that comes from V. D is the mean velocity from the first to the last
 * point of a trajectory. The sums are over up to 256 trajectories and over the components of the state in
 * which g is not 0. The whole factor s would make V too steep, which takes longer to train; the power 1/3 was
 * found by measurement (docs/reports/training.md). `factor` (may be NULL) becomes the factor.
 * Errors: those of lg_hamiltonian_problem_check. */
LG_API lg_status lg_hamiltonian_scale(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      double *theta, double *factor);

/* Settings of Adam for Hamiltonians. The norm of the gradient is clipped, because early in a run a nearly
 * singular mass matrix gives gradients a million times larger than at the end. Adam's second moment
 * remembers them for a thousand steps, more than a run of a hundred epochs has, and the mass matrix stops
 * moving (about one seed in nine). eps is smaller than the usual 1e-8, because gradients near the end are
 * that small, and the usual value would slow Adam down. */
#define LG_HAMILTONIAN_ADAM_EPS 1e-12
#define LG_HAMILTONIAN_CLIP     1e-3

/* ---- Evaluation on a tape ----
 *
 * These functions record the formulas of the opening comment for batches of states, with theta as a
 * variable. Rows are independent. The results can be differentiated to any order with respect to states,
 * inputs and theta. On failure the functions return LG_NONE, and the error sticks to the tape (LG_SHAPE: a
 * state or an input of another shape). */

/* Makes the variables that depend on theta only; theta is the flat vector (lg_hamiltonian_parameters).
 * Errors stick to the tape (LG_SHAPE: theta has another length). */
LG_API lg_status lg_hamiltonian_bind(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                                     lg_hamiltonian_vars *vars);
/* state (B, d) -> H (B, 1) */
LG_API lg_var lg_hamiltonian_record_value(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d) -> dH/dstate (B, d), in the layout of the state. For a chain the numbers at p_i are v_i,
 * and those at q_i are dT/dq_i + dV/dq_i with T the kinetic energy. Rows are NaN where the mass matrix or
 * W o G is not positive definite. */
LG_API lg_var lg_hamiltonian_record_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d), input (B, m) or LG_NONE -> the field, an algebra element: (xi, eta) of each link, where
 * eta includes the torque, or (q', p'), where p' includes the force. */
LG_API lg_var lg_hamiltonian_record_field(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                          lg_var input);
/* state (B, d), input (B, m) or LG_NONE -> y' (B, d). */
LG_API lg_var lg_hamiltonian_record_velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                             lg_var input);

/* Makes a program (liegrad/program.h) of the model with the parameter theta. Functions:
 *   value (x) -> y                H
 *   grad  (x) -> y, g             H and its gradient as lg_hamiltonian_record_gradient
 *   field (x, u) -> f             as lg_hamiltonian_record_field
 *   force (q, u) -> f             -dV/dq + u, if the family is separable
 *   drift (p) -> f                dT/dp of the kinetic energy T, if the family is separable
 *   velocity (x, u) -> f          x', the generator of the field at x: a vector of the ambient space
 *   jac_velocity (x, u) -> jac_f_x, jac_f_u   the Jacobians of velocity
 *   step  (x, u, h) -> next       one step of `scheme` (NULL: the family's default) with constant u
 * with x (d), u (m), h (1), q and p (d/2). u is absent when the family has no inputs. With a constraint there
 * are also the functions `constraint`, `potential` and `mass` of the learned system, as lg_constraint_create
 * takes them. With LG_SCHEME_VARIATIONAL `step` adds h u/2 to the momenta before and after the step of
 * training. Six iterations of Newton's method compute the scaled multipliers nu. The result is not finite if
 * the last iteration changes nu by more than 1e-5 (1 + max |nu|). Errors: those of lg_program_build;
 * LG_UNSUPPORTED (an implicit scheme, which finds its stage by iteration; LG_SCHEME_VARIATIONAL for a family
 * without `ambient`). */
LG_API lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model,
                                        const double *theta, const lg_scheme *scheme, lg_program **out,
                                        lg_error *error);

/* ---- Trajectories (library liegrad_io from here on) ---- */

/* Bytes of a system's name. Systems have the names of liegrad/mechanics.h ("pendulum-chain", "quartic",
 * "oscillator", ...). A data set may have another name or none; then its layout determines the family. */
#define LG_SYSTEM_NAME 64

/* A data set: N trajectories of M equidistant points with d numbers each. Owns its arrays; free them with
 * lg_trajectories_destroy. */
typedef struct lg_trajectories {
    char system[LG_SYSTEM_NAME];         /* "" when the file does not say. */
    const lg_hamiltonian_family *family; /* The family that learns them. */
    /* Copies of the family's factors: links of a chain, or degrees of freedom. */
    uint32_t n;
    size_t count, points; /* N >= 1, M >= 2 */
    uint32_t state_dim;   /* d: numbers in a state. */
    uint32_t input_dim;   /* m: numbers in an input; 0 without inputs. */
    double dt;            /* (t[M-1] - t[0])/(M-1) */
    double *t;            /* (M) */
    double *data;         /* (N, M, d) */
    double *hamiltonian;  /* (N), the energies of the starts, or NULL. */
    double *inputs;       /* (N, M-1, m), constant between two points, or NULL. */
    /* The file gives neither system nor layout; then the family is the first one whose sizes and manifold
     * fit. */
    bool guessed;
    /* The largest distance of first points from the manifold in the file, before any was projected. */
    double starts_off;
    /* The system that made the data; NULL: unknown. Owned. */
    lg_system *truth;
    /* Family "constrained": the constraint, which the file or lg_read_options gives. Owned. */
    lg_constraint *constraint;
    /* Hash of t, data and inputs as little-endian doubles, one after the other, and of the constraint. The
     * functions that read and write files set it. */
    char sha256[LG_SHA256_TEXT];
    lg_provenance provenance;
    const lg_context *context; /* The memory of the arrays comes from it. */
} lg_trajectories;

/* Makes a data set: sets system (may be ""), family, n, the sizes, dt and t = 0, dt, ..., t_end, and
 * allocates t, data and, where asked for, hamiltonian and inputs; all but t are zero. The earlier contents
 * of `out` are overwritten. Errors: LG_INVALID_ARGUMENT (sizes; the system is known and has another family
 * or n). */
LG_API lg_status lg_trajectories_create(const lg_context *context, const char *system,
                                        const lg_hamiltonian_family *family, uint32_t n, size_t count,
                                        size_t points, double t_end, bool with_hamiltonian,
                                        uint32_t input_dim, lg_trajectories *out);
/* Sets data->truth to a copy of the system that made the data; an earlier one is destroyed. Errors:
 * LG_INVALID_ARGUMENT (a system of another name, family or n). */
LG_API lg_status lg_trajectories_set_truth(lg_trajectories *data, const lg_system *system);
/* Sets data->constraint from a program (liegrad/constraint.h); an earlier one is destroyed. Errors:
 * LG_INVALID_ARGUMENT (data of another family or n), those of lg_constraint_create. */
LG_API lg_status lg_trajectories_set_constraint(lg_trajectories *data, const lg_program *program,
                                                lg_error *error);
/* Reads a data set from an HDF5 file with the contents and checks that docs/files.md lists ("Trajectories").
 * out->truth is made when the system is known and all its parameters are there. First points off their
 * manifold by more than 1e-6 are an error, or with options->project_starts are projected. If the file or the
 * options have a function `constraint` (liegrad/constraint.h), the family is "constrained", out->constraint
 * is made, and G must have full rank at all points. */
LG_API lg_status lg_trajectories_read(const lg_context *context, const char *path,
                                      const lg_read_options *options, lg_trajectories *out, lg_error *error);
/* Writes a data set to a file, and sets data->sha256. Errors: LG_NOT_FINITE (a number is not finite: such
 * a file could not be read back and is not written), LG_FILE. */
LG_API lg_status lg_trajectories_write(const lg_context *context, const char *path, lg_trajectories *data,
                                       lg_error *error);
LG_API void lg_trajectories_destroy(lg_trajectories *data);

/* ---- Files of learned Hamiltonians ---- */

/* The units in which training computes its loss: GIVEN: the units of the data. DATA: scaled units, with
 * scales and weights from the data (lg_hamiltonian_find_scales, lg_hamiltonian_weigh). */
typedef enum lg_hamiltonian_units { LG_UNITS_GIVEN, LG_UNITS_DATA } lg_hamiltonian_units;

/* Model, training and data of a run. Model files and checkpoints store it, and a resumed run is compared
 * with it. */
#define LG_INTEGRAL_TEXT 256
typedef struct lg_hamiltonian_run {
    lg_hamiltonian model;
    char system[LG_SYSTEM_NAME];
    const lg_scheme *scheme; /* A scheme of the library: attribute `integrator`. */
    uint32_t substeps;
    double penalty; /* mu */
    lg_penalty_form penalty_form;
    /* The name of a first integral in the table, or the path of a file with a program, whose function
     * `integral` is G (lg_first_integral_from). "": the first entry of the table. */
    char penalty_integral[LG_INTEGRAL_TEXT];
    char penalty_sha256[LG_SHA256_TEXT]; /* Hash of this program's functions and parameters; "": no file. */
    lg_hamiltonian_distance distance;
    bool scaled; /* lg_hamiltonian_scale was applied before training. */
    lg_hamiltonian_units units;
    lg_hamiltonian_starts starts;
    lg_fit_settings training;
    uint64_t trajectories, points; /* N, M */
    double dt;
    char data_sha256[LG_SHA256_TEXT];
} lg_hamiltonian_run;
/* The table of the hyperparameters in lg_hamiltonian_run. */
LG_API extern const lg_field lg_hamiltonian_fields[];

/* The test set on which a model was evaluated. 0 and "" mean unknown. */
typedef struct lg_test_set {
    uint64_t trajectories, points; /* N, M */
    double t_end;                  /* Time from the first point to the last. */
    char sha256[LG_SHA256_TEXT];   /* As in lg_trajectories. */
} lg_test_set;

typedef struct lg_hamiltonian_file {
    LG_MODEL_FILE(lg_hamiltonian_run);
    lg_constraint *constraint; /* what run.model.constraint points to in a file that was loaded; owned */
    bool has_e1, has_e2;
    /* E1 and E2 of lg_hamiltonian_save_errors, if the model was evaluated on a test set. */
    double e1, e2;
    lg_test_set test; /* That test set. */
} lg_hamiltonian_file;

/* Writes the results on a test set (members has_e1 to test of `file`) into the model file at `path`, where
 * they replace earlier results. Everything else in the file stays as it is, also entries that this version
 * does not know. A failure changes nothing.
 * docs/hamiltonians.md ("Judging a model") has E1 and E2. E2 removes a constant, up to which trajectories
 * determine H on T*S^2 and R^2n; on so(3)* a function of |mu|^2 remains in it.
 * `run` and `theta` of `file` must be those in the file at `path`. Errors: LG_INVALID_ARGUMENT (the file
 * holds another model, for example one that was trained in the meantime), LG_NOT_FINITE (E1 or E2 is not
 * finite), those of readers. */
LG_API lg_status lg_hamiltonian_save_errors(const lg_context *context, const char *path,
                                            const lg_hamiltonian_file *file, lg_error *error);

/* ---- Grids of `lg-hamiltonian study` ---- */

#define LG_GRID_VALUES 16

/* A study trains one model for each combination: integrators x N x M x eps x penalty x substeps x repeats. */
typedef struct lg_grid {
    /* In Hamiltonian form; owned. The grid has the key `scene: FILE` (relative to the grid's folder), or
     * itself the key `system` and the other keys of a scene. */
    lg_scene scene;
    uint32_t integrator_count;
    const lg_scheme *integrators[LG_GRID_VALUES]; /* Required. */
    lg_wholes n, m;                               /* Required; keys N and M. */
    lg_reals eps;                                 /* Noise of the data; default 0. */
    lg_reals penalty;                             /* mu; default 0. */
    lg_wholes substeps;                           /* Default 1. */
    uint32_t repeats;                             /* Default 1. */
    /* Duration of a trajectory: from the grid, else from the scene; one of them must have it. */
    double t_end;
    /* The hyperparameters that all runs share; each has its name in lg_hamiltonian_fields as the key.
     * run.model is not made yet. */
    lg_hamiltonian_run run;
    lg_noise noise_kind;                     /* Default normal. */
    uint32_t test_trajectories, test_points; /* Default 100 and 15; key test: {trajectories, points}. */
    uint64_t seed;                           /* Default 1. */
} lg_grid;

/* Reads the grid of a study from a YAML file. */
LG_API lg_status lg_grid_read(const lg_context *context, const char *path, lg_grid *out, lg_error *error);
LG_API void lg_grid_destroy(lg_grid *grid); /* Frees what the grid owns and zeroes it; NULL is allowed. */

LG_END_DECLS

#endif
