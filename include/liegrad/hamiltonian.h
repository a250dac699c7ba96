/* Learned Hamiltonians H_Theta on phase spaces: a table of families, description, initialisation, training
 * loss and evaluation on a tape. liegrad/model.h evaluates a trained Hamiltonian in a control loop.
 *
 * Every Hamiltonian has a function V and terms of its family. V is an MLP whose last layer has no bias, or
 * linear with one weight a coordinate. A family is a row, lg_hamiltonian_family; lg_hamiltonian_family_at
 * lists them, and docs/adding.md adds one. Two of them:
 *
 * - "chain", n links on (T*S^2)^n, state q_1, p_1, ..., q_n, p_n (6n numbers):
 *   H = 1/2 p^T M(q)^{-1} p + V(q), M_ij = m_ij P_i P_j (i != j), M_ii = m_ii I, P_i = I - q_i q_i^T,
 *   m = Gamma^T Gamma + diag(max(0, b)). V takes q (3n numbers). Forces: spatial torques tau_i.
 *   On T*S^2 with v = dH/dp, g = dH/dq:
 *     q' = v - q(q.v), p' = -g + q(q.g) + p(q.v) - q(p.v),
 *   lifted to se(3) as xi = q x v, eta = g x q + v x p + tau. The kinetic gradient takes one n x n solve:
 *     W = m^{-1}, G_il = q_i.q_l, (W o G) lambda = u with u_i = q_i.(W p)_i,
 *     v_i = sum_j W_ij (p_j - lambda_j q_j), dT/dq_i = -lambda_i v_i.
 *   Schemes that leave the manifold differentiate an extension of T, which equals T on the manifold and is
 *   definite near it:
 *     T = 1/2 p^T W p + 1/2 u^T S^{-1} r, S_il = delta_il (1 - |q_i|^2)/m_ii + W_il G_il,
 *     r_i = q_i.p_i/m_ii - u_i.
 * - "separable", n degrees of freedom on R^{2n}, state q, p: H = 1/2 |A p|^2 + V(q), V takes q. Forces: n.
 *
 * The flat parameter vector has V's layers in order (weight (in, out) row-major, then bias), then the
 * `arrays` of the family: Gamma (n, n) and b (n) of a chain, A (n, n) of a separable system.
 */
#ifndef LIEGRAD_HAMILTONIAN_H
#define LIEGRAD_HAMILTONIAN_H

#include "liegrad/context.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"
#include "liegrad/nn.h"
#include "liegrad/program.h"
#include "liegrad/random.h"
#include "liegrad/tape.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

typedef enum lg_potential_kind { LG_POTENTIAL_MLP, LG_POTENTIAL_LINEAR } lg_potential_kind;
#define LG_POTENTIAL_KIND_COUNT 2

#define LG_HAMILTONIAN_MAX_COPIES 32  /* n */
#define LG_HAMILTONIAN_MAX_POINTS 512 /* points of a training trajectory */
#define LG_HAMILTONIAN_MAX_ARRAYS 2
#define LG_HAMILTONIAN_MAX_PARTS  2

typedef struct lg_hamiltonian_family lg_hamiltonian_family;

/* Immutable after lg_hamiltonian_init; plain data, copied freely. `family` is static. */
typedef struct lg_hamiltonian {
    const lg_hamiltonian_family *family;
    uint32_t n; /* copies of the family's factors: links of a chain, degrees of freedom */
    lg_potential_kind potential;
    lg_mlp net; /* V: family->inputs n -> hidden -> 1; without hidden layers for the linear potential */
} lg_hamiltonian;

/* Variables that depend on theta alone and serve all rows of a batch. lg_hamiltonian_bind makes them once.
 * Borrows the model; valid until the tape is rewound. */
typedef struct lg_hamiltonian_vars {
    const lg_hamiltonian *model;
    lg_mlp_vars net;
    lg_var kinetic[2]; /* what the family's `bind` makes of its arrays */
} lg_hamiltonian_vars;

/* ---- families ----
 *
 * A family describes one kind of learned Hamiltonian. Training, evaluation, files and C use this description.
 * lg_hamiltonian_init also takes a family of your own; files refer to the families of the table
 * (src/models/hamiltonian_families.c) by name. y, gradients and algebra elements are arrays of the space's
 * parts (liegrad/taped.h). The functions record on `tape`, and failures stick to it.
 */
typedef struct lg_hamiltonian_array {
    const char *name; /* in files, below /model: "mass/gamma" */
    uint32_t rank;    /* shape (n) or (n, n); 0 ends the list */
} lg_hamiltonian_array;

struct lg_hamiltonian_family {
    const char *name;                               /* of files, "chain" */
    const char *description;                        /* of programs */
    const char *copy;                               /* what n counts, "link" */
    lg_space_kind factor[LG_HAMILTONIAN_MAX_PARTS]; /* of the space, n copies each */
    uint32_t factors;
    uint32_t inputs;                       /* of V, for each of the n */
    uint32_t forces;                       /* numbers of an input for each of the n */
    const char *layout[3];                 /* names of the parts of a state, ended by NULL: "q", "p" */
    bool numbered;                         /* the state is q1 p1 q2 p2 ... instead of q p */
    const char *state_units, *energy_unit; /* in files */
    /* For headers of exported C: H, an input and a field in words; NULL: not said. */
    const char *formula, *input_meaning, *field_meaning;
    const char *scheme;   /* default of training and of exported steps */
    const char *accurate; /* embedded pair with which learned flows are integrated */
    lg_hamiltonian_array arrays[LG_HAMILTONIAN_MAX_ARRAYS + 1];
    /* Initial arrays, drawn from U[0, 1], are drawn again while this is false. NULL: always usable. */
    bool (*usable)(uint32_t n, const double *arrays);
    /* vars->kinetic from the arrays (variables of their shapes). NULL: nothing to do. */
    void (*bind)(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars);
    lg_var (*energy)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y); /* H (B, 1) */
    /* dH/dy. NULL: the energy is differentiated. */
    void (*gradient)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out);
    /* A shorter form that holds on the manifold, for training with Lie group schemes. NULL: `gradient`. */
    void (*gradient_on_manifold)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                 lg_var *out);
    /* The field from dH/dy: an algebra element; input (B, forces n) or LG_NONE. */
    void (*field)(lg_tape *tape, const lg_var *y, const lg_var *gradient, lg_var input, lg_var *algebra);
    /* y' for schemes that leave the manifold. NULL: `field` acts on y. */
    void (*velocity)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out);
    /* Separable systems, for splitting schemes: -dH/dq + input from q, dH/dp from p. Both or NULL. */
    lg_var (*force)(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input);
    lg_var (*drift)(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p);
    /* Coordinates of the tangent space, `tangent` for each of the n: the columns of basis (d, r) are their
     * directions; c (r) are the coordinates of an ambient vector (d). NULL: those of R^d. */
    uint32_t tangent;
    void (*basis)(uint32_t n, const double *state, double *basis);
    void (*coordinates)(uint32_t n, const double *state, const double *vector, double *c);
    /* Whether trajectories of the system can be learned, and with which n. */
    bool (*learns)(const lg_system *system, size_t *n);
    /* Distance of one copy of the state from the manifold, relative to its momentum. NULL: every state lies
     * on it. `manifold` says in words what must hold there. */
    double (*off_manifold)(const double *copy);
    const char *manifold;
};

LG_API size_t lg_hamiltonian_family_count(void);
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_at(size_t index);       /* NULL beyond */
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_find(const char *name); /* NULL: none */
/* The first family that learns the system, and its n; NULL: none does. */
LG_API const lg_hamiltonian_family *lg_hamiltonian_family_for(const lg_system *system, size_t *n);
/* Errors: those of lg_space_init. */
LG_API lg_status lg_hamiltonian_space(const lg_hamiltonian_family *family, uint32_t n, lg_space *space);

/* For the functions of a family: V (B, 1) of x (B, ...), which has `inputs` n numbers a row, and dV/dx in the
 * shape of x. The third function gives `input` the shape of `part`; the numbers of rows and of elements must
 * be equal. */
LG_API lg_var lg_hamiltonian_potential(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
LG_API lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
LG_API lg_var lg_hamiltonian_input_like(lg_tape *tape, lg_var input, lg_var part);

/* ---- description ---- */

/* Errors: LG_INVALID_ARGUMENT (n outside 1..LG_HAMILTONIAN_MAX_COPIES, a hidden width of 0, too many layers,
 * no family). `hidden` is ignored for the linear potential. */
LG_API lg_status lg_hamiltonian_init(lg_hamiltonian *model, const lg_hamiltonian_family *family, uint32_t n,
                                     lg_potential_kind potential, const uint32_t *hidden,
                                     uint32_t hidden_layers, lg_activation activation);
LG_API size_t lg_hamiltonian_parameters(const lg_hamiltonian *model);
LG_API uint32_t lg_hamiltonian_state_dim(const lg_hamiltonian *model); /* d */
LG_API uint32_t lg_hamiltonian_input_dim(const lg_hamiltonian *model); /* m = forces n */
/* Where array `index` begins in theta. */
LG_API size_t lg_hamiltonian_array_offset(const lg_hamiltonian *model, size_t index);
/* While a pivot of m is below this number, Gamma and b of a chain are drawn again, at most 10000 times (2 of
 * 100 draws for one link). A nearly singular initial mass sends trajectories far away, and training may end
 * at a mass near 0, where gradients vanish. */
#define LG_HAMILTONIAN_LEAST_PIVOT 0.1
/* Weights and biases are drawn from U(+-1/sqrt(fan_in)), the family's arrays from U[0, 1]. */
LG_API void lg_hamiltonian_initialise(const lg_hamiltonian *model, lg_rng *rng, double *theta);
/* A chain's learned mass matrix m = Gamma^T Gamma + diag(max(0, b)), (n, n), symmetric. LG_UNSUPPORTED: a
 * family without one. */
LG_API lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m);

/* ---- training ---- */

/* First-integral penalty: G = (q_1^2 + p_1^2)/2 of the coupled oscillators. MEAN_SQUARE: mu times the mean
 * over the batch of sum_j (G(y_j) - G(x))^2 over the predicted points. SUM_ABSOLUTE: mu times the sum over
 * the batch of sum_j |2 G(y_j) - 2 G(x)|, where 2 G = q_1^2 + p_1^2. */
typedef enum lg_penalty_form { LG_PENALTY_MEAN_SQUARE, LG_PENALTY_SUM_ABSOLUTE } lg_penalty_form;

/* A training problem: trajectories (N, M, d) with equidistant points dt apart, and settings. Borrowed
 * data. */
typedef struct lg_hamiltonian_problem {
    const lg_hamiltonian *model;
    const lg_scheme *scheme; /* any that can be recorded on a tape and fits the space */
    uint32_t substeps;       /* integrator steps between two points, >= 1 */
    double penalty;          /* mu; 0: none */
    lg_penalty_form penalty_form;
    size_t trajectories, points;
    double dt;
    const double *data; /* (N, M, d) in the state's layout */
} lg_hamiltonian_problem;

/* Errors: LG_INVALID_ARGUMENT (nothing to learn from, points outside 2..LG_HAMILTONIAN_MAX_POINTS, N M above
 * 2^32 - 1, substeps 0, dt or penalty out of range or not finite, no scheme, an unknown penalty_form),
 * LG_UNSUPPORTED (a scheme that cannot be recorded, a splitting scheme for a family without force and drift,
 * a penalty outside R^d). */
LG_API lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error);

/* Fills a training problem for lg_fit: loss = mean squared difference over (batch, d, M - 1) of predicted and
 * given points, the initial point excluded, plus the penalty. `problem` is borrowed and must outlive the fit.
 */
LG_API void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out);

/* Settings of Adam for Hamiltonians. The gradient's norm is clipped for this reason: early in a run a nearly
 * singular mass matrix gives gradients a million times larger than those at the end. Adam's second moment
 * remembers them for a thousand steps, more than a run of a hundred epochs has, and the mass matrix stops
 * moving (about one seed in nine). eps is smaller than the usual 1e-8, because gradients near the end are
 * that small and the usual value would slow Adam down. */
#define LG_HAMILTONIAN_ADAM_EPS 1e-12
#define LG_HAMILTONIAN_CLIP     1e-3

/* ---- on a tape: batches of states, theta a variable ----
 *
 * The formulas at the top are recorded; rows are independent. Results can be differentiated to any order in
 * states, inputs and theta. Functions return LG_NONE with the tape's error (LG_SHAPE: a state or an input of
 * another shape than stated).
 */

/* theta (lg_hamiltonian_parameters) is the flat vector. Errors stick to the tape (LG_SHAPE: theta has another
 * length); `vars` is untouched then. */
LG_API lg_status lg_hamiltonian_bind(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                                     lg_hamiltonian_vars *vars);
/* state (B, d) -> H (B, 1) */
LG_API lg_var lg_hamiltonian_record_value(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d) -> dH/dstate (B, d) in the layout of the state. For a chain the numbers at p_i are v_i, those
 * at q_i are dT/dq_i + dV/dq_i. Rows are NaN where the mass matrix or W o G is not positive definite. */
LG_API lg_var lg_hamiltonian_record_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state);
/* state (B, d), input (B, m) or LG_NONE -> field, an algebra element: (xi, eta) of each link, where eta
 * includes the torque, or (q', p'), where p' includes the force. */
LG_API lg_var lg_hamiltonian_record_field(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                          lg_var input);
/* The same -> y' (B, d). */
LG_API lg_var lg_hamiltonian_record_velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                             lg_var input);
/* The same field for lg_taped_step_over, with force and velocity where the family has them. `vars` must
 * outlive the use of `ode`. */
LG_API lg_status lg_hamiltonian_taped_ode(lg_hamiltonian_vars *vars, lg_taped_ode *ode);

/* The model as a bundle (liegrad/program.h) with parameter theta and the functions
 *   value (x) -> y                H
 *   grad  (x) -> y, g             H and its gradient, as lg_hamiltonian_record_gradient
 *   field (x, u) -> f             as lg_hamiltonian_record_field
 *   force (q, u) -> f             -dV/dq + u, where the family has it (separable ones)
 *   drift (p) -> f                dT/dp, likewise
 *   step  (x, u, h) -> next       one step of `scheme` (NULL: the family's), u held
 * with x (d), u (m), h (1), q and p (d/2). Errors: those of lg_program_build; LG_UNSUPPORTED (an implicit
 * scheme, which finds its stage by iteration). */
LG_API lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model,
                                        const double *theta, const lg_scheme *scheme, lg_program **out,
                                        lg_error *error);

LG_END_DECLS

#endif
