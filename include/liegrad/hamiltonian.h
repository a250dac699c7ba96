/* Learned Hamiltonians H_Theta on phase spaces: a table of families, description, initialisation, training
 * loss and evaluation on a tape. liegrad/model.h evaluates a trained Hamiltonian in a control loop.
 *
 * Every Hamiltonian has a function V and terms of its family. V is an MLP whose last layer has no bias, or
 * linear with one weight a coordinate, or linear in a dictionary of functions. A family is a row,
 * lg_hamiltonian_family; lg_hamiltonian_family_at lists them, and docs/adding.md adds one. Two of them:
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
 * Inside, quantities are divided by the model's scales: times by T, part i of a state by s_i, energies by
 * E = s_1 s_2 ... / T, so that a system whose units are changed is the same system inside. The functions of
 * this header take and give quantities in the units of the data; the functions of a family, V and the
 * parameter vector are inside. All scales are 1 after lg_hamiltonian_init.
 *
 * The flat parameter vector has V's layers in order (weight (in, out) row-major, then bias), then the
 * `arrays` of the family: Gamma (n, n) and b (n) of a chain, A (n, n) of a separable system.
 */
#ifndef LIEGRAD_HAMILTONIAN_H
#define LIEGRAD_HAMILTONIAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"
#include "liegrad/tape.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

/* V of the coordinates x (d): an MLP; linear; or a dictionary, linear in functions of x, whose order is
 *   x_i, x_i^2, x_i^3, x_i^4, sin x_i, cos x_i, each for i = 1..d, then x_i x_j for i < j.
 * x is divided by its scale, but in sin and cos, where it is an angle in radians. */
typedef enum lg_potential_kind {
    LG_POTENTIAL_MLP,
    LG_POTENTIAL_LINEAR,
    LG_POTENTIAL_DICTIONARY
} lg_potential_kind;
#define LG_POTENTIAL_KIND_COUNT 3

/* With a network or dictionary N: V(x) = N(x), (N(x) + N(-x))/2 or (N(x) - N(-x))/2. */
typedef enum lg_symmetry { LG_SYMMETRY_NONE, LG_SYMMETRY_EVEN, LG_SYMMETRY_ODD } lg_symmetry;

#define LG_HAMILTONIAN_MAX_COPIES 32  /* n */
#define LG_HAMILTONIAN_MAX_POINTS 512 /* points of a training trajectory */
#define LG_HAMILTONIAN_MAX_ARRAYS 2
#define LG_HAMILTONIAN_MAX_PARTS  2

typedef struct lg_hamiltonian_family lg_hamiltonian_family;

/* T and the s_i of the parts of a state, in the units of the data. */
typedef struct lg_hamiltonian_scales {
    double time, part[LG_HAMILTONIAN_MAX_PARTS];
} lg_hamiltonian_scales;

/* Immutable after lg_hamiltonian_init; plain data, copied freely. `family` is static. */
typedef struct lg_hamiltonian {
    const lg_hamiltonian_family *family;
    uint32_t n; /* copies of the family's factors: links of a chain, degrees of freedom */
    lg_potential_kind potential;
    lg_symmetry symmetry; /* of V: none after lg_hamiltonian_init, may be set then */
    /* Of family->inputs n coordinates or the dictionary's functions, to 1; only an MLP has hidden layers. */
    lg_mlp net;
    lg_hamiltonian_scales scales; /* 1 after lg_hamiltonian_init, may be set then */
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
 * (src/hamiltonian/families.c) by name. y, gradients and algebra elements are arrays of the space's
 * parts (liegrad/taped.h), inside (divided by the scales). The functions record on `tape`, and failures
 * stick to it.
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
    /* Parts that have a unit. The product of these units is the unit of an action, energy times time, as for
     * q and p of a pair. Scales of the other parts are 1. */
    bool scaled[LG_HAMILTONIAN_MAX_PARTS];
    /* From `many` copies on, T is `stretch` times longer and s_2 as much smaller: V is larger inside, and
     * small networks learn such systems further (measured, docs/reports/hamiltonian.md). 0: never. */
    uint32_t many;
    double stretch;
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

/* ---- description ---- */

/* Errors: LG_INVALID_ARGUMENT (n outside 1..LG_HAMILTONIAN_MAX_COPIES, a hidden width of 0, too many layers,
 * no family). `hidden` is for an MLP alone. */
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
/* A chain's learned mass matrix s_2 T (Gamma^T Gamma + diag(max(0, b))), (n, n), symmetric. LG_UNSUPPORTED: a
 * family without one. */
LG_API lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m);

/* ---- training ---- */

/* A function G of the state that the true system is known to conserve, beside its energy. */
typedef struct lg_first_integral {
    const char *name;                    /* "vertical-angular-momentum" */
    const char *formula;                 /* in words */
    const lg_hamiltonian_family *family; /* whose states it takes; NULL: any */
    uint32_t n;                          /* it is for so many copies only; 0: for any number */
    bool numbered;                       /* it is that of one copy, j */
    int power
        [LG_HAMILTONIAN_MAX_PARTS]; /* G's unit: part 1's unit to power[0], times part 2's to power[1] ... */
    /* Records G (B, 1) of the parts y; j counts from 0. Failures stick to the tape. */
    lg_var (*record)(void *user, lg_tape *tape, const lg_hamiltonian_vars *vars, uint32_t j, const lg_var *y);
    void *user; /* first argument of record */
} lg_first_integral;

/* The table (src/hamiltonian/integrals.c):
 *   oscillator                  (q_j^2 + p_j^2)/2, both of separable systems in which (q_j, p_j) is not
 *   anharmonic                  (q_j^2 + p_j^2)/2 + q_j^4/4, coupled to the rest
 *   angular-momentum            q_1 p_2 - q_2 p_1 of two degrees of freedom, for K and V that do not change
 *                               when the plane turns
 *   vertical-angular-momentum   sum_i e3.(q_i x p_i) of chains under gravity along e3 */
LG_API size_t lg_first_integral_count(void);
LG_API const lg_first_integral *lg_first_integral_at(size_t index);       /* NULL beyond */
LG_API const lg_first_integral *lg_first_integral_find(const char *name); /* NULL: none */
/* Whether it takes the states of the model. */
LG_API bool lg_first_integral_fits(const lg_first_integral *integral, const lg_hamiltonian *model);

/* First-integral penalty. MEAN_SQUARE: mu times the mean over the batch of sum_j (G(y_j) - G(x))^2 over
 * predicted points. SUM_ABSOLUTE: mu times the sum over the batch of sum_j |2 G(y_j) - 2 G(x)|. */
typedef enum lg_penalty_form { LG_PENALTY_MEAN_SQUARE, LG_PENALTY_SUM_ABSOLUTE } lg_penalty_form;

/* The points j of these sums, 2..M where x is point 1; none listed: all. Increasing. */
#define LG_PENALTY_POINTS 16
typedef struct lg_penalty_points {
    uint32_t count, at[LG_PENALTY_POINTS];
} lg_penalty_points;

/* The distance d of predicted and given points in the loss, the mean of d^2 over (batch, d, M - 1).
 * AMBIENT: |y - z| in R^d.
 * GEODESIC, on each T*S^2, between (q, p) and (q', p'): d^2 = theta^2 + |P p - p'|^2, theta the angle between
 * q and q', P the parallel transport along the geodesic from q to q', P p = p - 2 m (m.p)/|m|^2, m = q + q'.
 * This is the length of the path that goes from q to q' with p carried along and then from P p to p', in the
 * metric that T*S^2 has from S^2 (Sasaki's). d^2 is analytic at 0 and as |y - z|^2 there to first order; it
 * has a kink where q' = -q. Given points are projected to the manifold first. On R^n it is AMBIENT. */
typedef enum lg_hamiltonian_distance { LG_DISTANCE_AMBIENT, LG_DISTANCE_GEODESIC } lg_hamiltonian_distance;

/* Where predictions start. MEASURED: at the first points, which are not part of the loss. ESTIMATED, for
 * first points with noise like the others: at exp(a_i) . y_i1 (liegrad/integrators.h), with an unknown
 * algebra element a_i a trajectory, and the first points are part of the loss. */
typedef enum lg_hamiltonian_starts { LG_START_MEASURED, LG_START_ESTIMATED } lg_hamiltonian_starts;

/* A training problem: trajectories (N, M, d) with equidistant points dt apart, and settings. Borrowed
 * data. */
typedef struct lg_hamiltonian_problem {
    const lg_hamiltonian *model;
    const lg_scheme *scheme; /* any that can be recorded on a tape and fits the space */
    uint32_t substeps;       /* integrator steps between two points, >= 1 */
    double penalty;          /* mu; 0: none */
    lg_penalty_form penalty_form;
    const lg_first_integral *penalty_integral; /* G, of the table or your own; NULL: the first of the table */
    uint32_t penalty_copy;                     /* of a numbered G: j, counted from 1; 0 is 1 */
    lg_penalty_points penalty_points;
    lg_hamiltonian_distance distance;
    lg_hamiltonian_starts starts;
    /* Of the squares of part i, divided by its scale, in the loss; all 0: 1. */
    double weight[LG_HAMILTONIAN_MAX_PARTS];
    size_t trajectories, points;
    double dt;
    const double *data; /* (N, M, d) in the state's layout */
} lg_hamiltonian_problem;

/* Errors: LG_INVALID_ARGUMENT (nothing to learn from, points outside 2..LG_HAMILTONIAN_MAX_POINTS, N M above
 * 2^32 - 1, substeps 0, dt or penalty out of range or not finite, no scheme, an unknown penalty_form,
 * with a penalty: penalty_copy above n, points of it outside 2..M or not increasing),
 * LG_UNSUPPORTED (a scheme that cannot be recorded, a splitting scheme for a family without force and drift,
 * a first integral that does not fit the model, geodesic distances of other spaces than R^n and T*S^2 or with
 * a scheme that leaves the manifold), an unknown kind of starts or distance. */
LG_API lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error);

/* Scales by the data, to be set in the model before training: numbers inside have sizes about 1, and a change
 * of units changes nothing inside but rounding; by powers of 2, no bit. With root mean squares over all
 * points, of the numbers of a copy together, and rates of change over so many points that a part changes by
 * half its spread, or over all:
 *   T    the geometric mean over the parts that change of spread / rate,
 *   s_1  the size of q, where the family scales it, else 1,
 *   s_2  s_1 |p| / (|q'| T): a mass of 1 inside moves as the data do.
 * From family->many copies on, T is family->stretch times longer and s_2 as much smaller.
 * Where nothing moves, T is the time of a trajectory and s_i the size. Only model, trajectories, points, dt
 * and data of the problem are read. Errors: LG_INVALID_ARGUMENT (one of them is missing), LG_NOT_FINITE
 * (sizes out of range). */
LG_API lg_status lg_hamiltonian_find_scales(const lg_hamiltonian_problem *problem, lg_hamiltonian_scales *out,
                                            lg_error *error);
/* out (d): the scale of each number of a state, s_i for part i. */
LG_API void lg_hamiltonian_number_scales(const lg_hamiltonian *model, double *out);
/* Whether a part of the states changes along the trajectories by more than rounding; false for a problem with
 * the same errors. */
LG_API bool lg_hamiltonian_moves(const lg_hamiltonian_problem *problem);
/* Sets problem->weight by the data: one over the mean square of the change of a part from the first point to
 * the others, so that the parts count alike in the loss. Errors as above. */
LG_API lg_status lg_hamiltonian_weigh(lg_hamiltonian_problem *problem, lg_error *error);

/* Fills a training problem for lg_fit: loss = mean squared difference over (batch, d, M - 1) of predicted and
 * given points inside, the initial point excluded, or with another distance, and with the weights of the
 * parts, plus the penalty, whose G is in the units of the data.
 * `problem` is borrowed and must outlive the fit. With estimated starts the mean is over M points, and the
 * a_i, zero at first, follow the parameters of the model: N algebra_dim more numbers. */
LG_API void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out);

/* That mean squared difference over all trajectories in the units of the data, ambient and without weights
 * and penalty, in double precision; not finite where a prediction is not. Errors, with *out untouched: those
 * of lg_hamiltonian_problem_check and of the integrator. */
LG_API lg_status lg_hamiltonian_mean_squared_error(const lg_context *context,
                                                   const lg_hamiltonian_problem *problem, const double *theta,
                                                   double *out, lg_error *error);
/* What the data do to the penalty's first integral G: the mean over the trajectories of (G(y_j) - G(y_1))^2,
 * j = `point` in 2..M, or of G(y_1)^2 for point 1, in double precision. It grows with j where G is not
 * conserved; from noise alone it does not. Errors: those of lg_hamiltonian_problem_check with a penalty,
 * LG_INVALID_ARGUMENT for a point outside 1..M. */
LG_API lg_status lg_hamiltonian_integral_change(const lg_context *context,
                                                const lg_hamiltonian_problem *problem, const double *theta,
                                                size_t point, double *out, lg_error *error);
/* The truncation floor: what the integrator's own error adds to that mean squared difference when the model
 * is exact. With y_s the predictions from the given starts with s substeps, and p the order of the scheme,
 *   floor = (2^p/(2^p - 1))^2 mean (y_s - y_2s)^2
 * over the same trajectories, components and points: by Richardson's extrapolation the error of y_s is
 * 2^p/(2^p - 1) (y_s - y_2s) to leading order. Twice the substeps divide the floor by about 2^(2p). A loss
 * near the floor is about the steps, not about the model. Errors: as above; LG_INVALID_ARGUMENT (2^31
 * substeps or more). */
LG_API lg_status lg_hamiltonian_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      const double *theta, double *out, lg_error *error);

/* Multiplies the last layer of V in theta, as drawn by lg_hamiltonian_initialise, by max(1, s^(1/3)). s is
 * the root mean square of the forces in the data over that of the network: with y' = f + g, g the part of V,
 *   s^2 = sum (D - f)^2 / sum g^2 over the numbers where g is not 0, at up to 256 starts,
 * D the difference of the last point and the first over the time. A potential that is far too flat at first
 * keeps full-batch methods busy with the mass matrix, and they may end in a minimum where V hardly varies;
 * one that is too steep in the last layer alone takes longer. The power 1/3 is by measurement
 * (docs/reports/chains.md). `factor` (may be NULL): that number. Errors: those of
 * lg_hamiltonian_problem_check, LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_hamiltonian_scale(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      double *theta, double *factor);

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

/* The model as a program (liegrad/program.h) with parameter theta and the functions
 *   value (x) -> y                H
 *   grad  (x) -> y, g             H and its gradient, as lg_hamiltonian_record_gradient
 *   field (x, u) -> f             as lg_hamiltonian_record_field
 *   force (q, u) -> f             -dV/dq + u, where the family has it (separable ones)
 *   drift (p) -> f                dT/dp, likewise
 *   velocity (x, u) -> f          x', the generator of the field: a vector of the ambient space
 *   jac_velocity (x, u) -> jac_f_x, jac_f_u
 *   step  (x, u, h) -> next       one step of `scheme` (NULL: the family's), u held
 * with x (d), u (m), h (1), q and p (d/2). Errors: those of lg_program_build; LG_UNSUPPORTED (an implicit
 * scheme, which finds its stage by iteration). */
LG_API lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model,
                                        const double *theta, const lg_scheme *scheme, lg_program **out,
                                        lg_error *error);

/* ---- trajectories (library liegrad_io from here on) ---- */

/* Systems have the names of liegrad/mechanics.h ("pendulum-chain", "quartic", "oscillator", ...). A data
 * set may have another name, or none; its layout then determines the family. */
#define LG_SYSTEM_NAME 64

/* N trajectories of M equidistant points of d numbers. */
typedef struct lg_trajectories {
    char system[LG_SYSTEM_NAME];         /* "" when the file does not say */
    const lg_hamiltonian_family *family; /* that learns them */
    uint32_t n;                          /* copies of its factors: links of a chain, degrees of freedom */
    size_t count, points;                /* N >= 1, M >= 2 */
    uint32_t state_dim;                  /* d */
    uint32_t input_dim;                  /* m, 0 without inputs */
    double dt;                           /* (t[M-1] - t[0])/(M-1) */
    double *t;                           /* (M) */
    double *data;                        /* (N, M, d) */
    double *hamiltonian;                 /* (N), energies of the starts, or NULL */
    double *inputs;                      /* (N, M-1, m), or NULL */
    bool guessed;      /* the file gives neither system nor layout: the family is the first that fits */
    double starts_off; /* how far first points were off the manifold before they were brought back */
    lg_system *truth;  /* the system that made them, or NULL: unknown; owned */
    char sha256[LG_SHA256_TEXT]; /* of t, data and inputs as little-endian doubles, one after the other; set
                                     by reader and writer */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_trajectories;

/* Sets system (may be ""), family, n, sizes, dt and t = 0, dt, ..., t_end; allocates t, data
 * and, where asked, hamiltonian and inputs, zeroed. `out` is overwritten. Errors: LG_INVALID_ARGUMENT (a
 * known system of another family or size), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_trajectories_create(const lg_context *context, const char *system,
                                        const lg_hamiltonian_family *family, uint32_t n, size_t count,
                                        size_t points, double t_end, bool with_hamiltonian,
                                        uint32_t input_dim, lg_trajectories *out);
/* A copy of the system that made the data becomes data->truth, in the place of an earlier one. Errors:
 * LG_INVALID_ARGUMENT (a system of another name, family or size), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_trajectories_set_truth(lg_trajectories *data, const lg_system *system);
/* Datasets /t (M), /trajectories (N, M, d), optional /hamiltonian (N), /inputs (N, M-1, m) and the
 * parameters of the system, /parameters/KEY (numbers), any integer or float type. `truth` is made when the
 * system is known and all its parameters are there. Attributes of the root (or of /trajectories), all
 * optional where they can be derived: `system`, `links` (chains), `layout`. Checked: /t increasing and
 * equidistant (each point within 1e-6 dt and the rounding of its stored type), everything finite, d fits
 * system and links, first points of a chain on T*S^2 within 1e-6 (later ones may carry noise; with
 * options->project_starts they too). */
LG_API lg_status lg_trajectories_read(const lg_context *context, const char *path,
                                      const lg_read_options *options, lg_trajectories *out, lg_error *error);
/* Fills data->sha256. Non-finite data is refused with LG_NOT_FINITE: a file that could not be read back is
 * not written. */
LG_API lg_status lg_trajectories_write(const lg_context *context, const char *path, lg_trajectories *data,
                                       lg_error *error);
LG_API void lg_trajectories_destroy(lg_trajectories *data);

/* ---- files of learned Hamiltonians ---- */

/* What training computes in: the units of the data, or scales and weights by the data
 * (lg_hamiltonian_find_scales, lg_hamiltonian_weigh). */
typedef enum lg_hamiltonian_units { LG_UNITS_GIVEN, LG_UNITS_DATA } lg_hamiltonian_units;

/* Model, training and data of a run. Models and checkpoints store it, and a resumed run is compared with
 * it. */
typedef struct lg_hamiltonian_run {
    lg_hamiltonian model;
    char system[LG_SYSTEM_NAME];
    const lg_scheme *scheme; /* of the library: attribute `integrator` */
    uint32_t substeps;
    double penalty; /* mu */
    lg_penalty_form penalty_form;
    uint32_t penalty_integral; /* lg_first_integral_at */
    uint32_t penalty_copy;     /* from 1; 0 is 1 */
    lg_penalty_points penalty_points;
    lg_hamiltonian_distance distance;
    bool scaled; /* lg_hamiltonian_scale before training */
    lg_hamiltonian_units units;
    lg_hamiltonian_starts starts;
    lg_training training;
    uint64_t trajectories, points; /* N, M */
    double dt;
    char data_sha256[LG_SHA256_TEXT];
} lg_hamiltonian_run;
LG_API extern const lg_field lg_hamiltonian_fields[]; /* of lg_hamiltonian_run */

/* The test set that a model was judged on. 0 and "": unknown. */
typedef struct lg_test_set {
    uint64_t trajectories, points; /* N, M */
    double t_end;                  /* from the first point to the last */
    char sha256[LG_SHA256_TEXT];   /* as in lg_trajectories */
} lg_test_set;

typedef struct lg_hamiltonian_file {
    lg_hamiltonian_run run;
    size_t parameters;       /* lg_hamiltonian_parameters(&run.model) */
    double *theta;           /* (parameters); stored as run.training.dtype */
    double *adam_m, *adam_v; /* (parameters), or both NULL */
    uint64_t adam_step;
    bool has_rng;
    lg_rng rng;
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* (epochs_done) each, or NULL; may hold NaN (no validation part) */
    bool has_e1, has_e2;
    double e1, e2;    /* errors on a test set, if one was evaluated: lg_model_record_hamiltonian */
    lg_test_set test; /* which one */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_hamiltonian_file;

/* /model/potential/layer1/{weight (in, out), bias} ..., /model/mass/{gamma (k, k), b (k)} or
 * /model/kinetic/A (n, n), /optimizer/adam/{m, v, step}, /rng, /train/history/{loss, validation, seconds,
 * rate}. `file` is borrowed with everything that it points to. A `fit` (may be NULL) replaces the file's
 * history by its own, and while it trains by Adam optimizer and rng too; the state of other methods is far
 * larger than the model and is kept in checkpoints alone. theta is always the file's. The model's functions
 * are written too (lg_model_save), with the scheme of `step`.
 * Errors also: LG_NOT_FINITE for parameters that are not finite, LG_INVALID_ARGUMENT for a model that
 * lg_hamiltonian_init would refuse. */
LG_API lg_status lg_model_save_hamiltonian(const lg_context *context, const char *path,
                                           const lg_hamiltonian_file *file, const lg_fit *fit,
                                           lg_error *error);
/* Checks that weights are finite and that lg_hamiltonian_init accepts the model. A model written by hand
 * needs `kind`, `family`, `links`, `potential`, `activation`, `hidden` and /model; everything else becomes
 * zero or the default. Files of earlier versions lack `schedule`; the schedule is then LG_SCHEDULE_STEP. */
LG_API lg_status lg_model_load_hamiltonian(const lg_context *context, const char *path,
                                           const lg_read_options *options, lg_hamiltonian_file *out,
                                           lg_error *error);
/* Writes the results on a test set (members has_e1 to test of `file`) into the model file at `path`, where
 * they replace earlier results. Everything else in the file stays as it is, entries unknown to this version
 * included. A failure changes nothing.
 *   E1 = mean over trajectories, coordinates and points (the first included) of the squared difference
 *        between the test trajectories and the accurately integrated learned flow
 *   E2 = mean |d - mean d|, d = true H - learned H at the starts. Trajectories determine H up to a function
 *        that is constant along the motion of every Hamiltonian. On T*S^2 and R^2n that is a number, which E2
 *        removes. On so(3)* it is a function of |mu|^2, which remains in E2.
 * Run and theta of `file` must be those of the file at `path`, as loaded or saved. Errors also:
 * LG_INVALID_ARGUMENT for another model, such as one trained in the meantime; LG_NOT_FINITE for E1 or E2 that
 * is not finite. */
LG_API lg_status lg_model_record_hamiltonian(const lg_context *context, const char *path,
                                             const lg_hamiltonian_file *file, lg_error *error);
LG_API void lg_hamiltonian_file_destroy(lg_hamiltonian_file *file);

/* ---- grids of `lg-hamiltonian study` ---- */

#define LG_GRID_VALUES 16

/* Runs are the product of the lists: integrators x N x M x eps x penalty x substeps x repeats. */
typedef struct lg_grid {
    lg_scene scene; /* in Hamiltonian form, owned; `scene: FILE` (relative to the grid's folder), or `system`
                       and the scene's keys in the grid itself */
    uint32_t integrator_count, n_count, m_count, eps_count, penalty_count, substeps_count;
    const lg_scheme *integrators[LG_GRID_VALUES];  /* required */
    uint32_t n[LG_GRID_VALUES], m[LG_GRID_VALUES]; /* required; keys N and M */
    double eps[LG_GRID_VALUES];                    /* 0 */
    double penalty[LG_GRID_VALUES];                /* 0 */
    uint32_t substeps[LG_GRID_VALUES];             /* 1 */
    uint32_t repeats;                              /* 1 */
    double t_end;                            /* of the grid, else of the scene; required in one of them */
    lg_hamiltonian_run run;                  /* hyperparameters that all runs share, each under its name in
                             * lg_hamiltonian_fields; the model is not made yet */
    lg_noise noise_kind;                     /* normal */
    uint32_t test_trajectories, test_points; /* 100, 15; key test: {trajectories, points} */
    uint64_t seed;                           /* 1 */
} lg_grid;

LG_API lg_status lg_grid_read(const lg_context *context, const char *path, lg_grid *out, lg_error *error);
LG_API void lg_grid_destroy(lg_grid *grid); /* as lg_scene_destroy */

LG_END_DECLS

#endif
