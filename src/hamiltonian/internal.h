/* Functions and tables that the files of the learned Hamiltonian share. "Inside" means divided by the model's
 * scales (liegrad/hamiltonian.h). */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "integrators/taped_internal.h"
#include "liegrad/hamiltonian.h"
#include "mechanics/engine.h"

/* The table of families: X(name) stands for the row lg_hamiltonian_<name>. Data that do not name their system
 * are assigned to the first family that they fit. */
#define LG_HAMILTONIAN_FAMILIES(X)                                                                           \
    X(chain)                                                                                                 \
    X(rotation)                                                                                              \
    X(rotation_direction)                                                                                    \
    X(rotation_line) X(pose) X(pose_direction) X(direction_line) X(constrained) X(separable)

#define LG_HAMILTONIAN_DECLARE(name) extern const lg_hamiltonian_family lg_hamiltonian_##name;
LG_HAMILTONIAN_FAMILIES(LG_HAMILTONIAN_DECLARE)
#undef LG_HAMILTONIAN_DECLARE

enum { LG_HAMILTONIAN_LARGEST = 6 * LG_HAMILTONIAN_MAX_COPIES }; /* most numbers in a state */
#define LG_HAMILTONIAN_AMBIENT (3 * LG_HAMILTONIAN_MAX_COPIES) /* most numbers in the positions of a state */
#define LG_HAMILTONIAN_NO_SCALES                                                                             \
    {                                                                                                        \
        1.0, {                                                                                               \
            1.0, 1.0, 1.0, 1.0, 1.0, 1.0                                                                     \
        }                                                                                                    \
    }

static inline uint32_t lg_hamiltonian_most_copies(const lg_hamiltonian_family *family) {
    return family->most > 0 ? family->most : LG_HAMILTONIAN_MAX_COPIES;
}
/* m of array `index` of the family, which has the shape (m) or (m, m). */
static inline uint32_t lg_hamiltonian_array_length(const lg_hamiltonian *model, size_t index) {
    const uint32_t each = model->family->arrays[index].each;
    return model->n * (each > 0 ? each : 1);
}
/* m = Gamma^T Gamma + diag(max(0, b)), (n, n), from the arrays Gamma (n, n) and b (n). */
void lg_hamiltonian_gram(size_t n, const double *arrays, double *m);
/* The same matrix on a tape, (1, n, n). */
lg_var lg_hamiltonian_record_gram(lg_tape *tape, uint32_t n, lg_var gamma, lg_var b);
/* The matrix (3 n, 3 n) with the blocks m_ij I; m is (1, n, n). */
lg_var lg_hamiltonian_record_blocks(lg_tape *tape, uint32_t n, lg_var m);

/* x times `by`; for 1 it is x itself, without an operation. */
static inline lg_var lg_hamiltonian_scaled(lg_tape *tape, lg_var x, double by) {
    return by == 1.0 ? x : lg_scale(tape, x, by);
}
/* The scale of energy, E: H in the units of the data is E times H inside. */
double lg_hamiltonian_energy_scale(const lg_hamiltonian *model);
/* The force -dH/dq + input, and the drift dH/dp. Arguments and results are in the units of the data, in
 * contrast to the family's function drift. */
lg_var lg_hamiltonian_record_force(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input);
lg_var lg_hamiltonian_record_drift(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p);

/* For the functions of a family: V (B, 1) at x (B, ...), which has family->inputs n numbers per row, and
 * dV/dx in the shape of x. */
lg_var lg_hamiltonian_potential(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);

/* Returns how many numbers a row of the part has. If the tape has failed, returns 0 or 1. */
uint32_t lg_hamiltonian_width(lg_tape *tape, lg_var part);
/* The positions (odd = 0) or the momenta (odd = 1) of all pairs of parts y, one after the other, (B, N); and
 * the inverse, which cuts x into out[odd], out[2 + odd], ... in the shapes of these parts of y. */
lg_var lg_hamiltonian_joined(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y, size_t odd);
void lg_hamiltonian_cut(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y, lg_var x,
                        size_t odd, lg_var *out);
/* One step of LG_SCHEME_VARIATIONAL over a span, inside and without input; out may be y. For families with
 * `ambient`. */
lg_status lg_hamiltonian_variational_step(lg_tape *tape, const lg_hamiltonian_vars *vars,
                                          const lg_taped_span *over, const lg_var *y, lg_var *out);

/* The field, an algebra element, from dH/dy. With a constraint: `unit` times q has the units of the data. */
void lg_hamiltonian_record_algebra(lg_tape *tape, const lg_hamiltonian *model, double unit, const lg_var *y,
                                   const lg_var *dH, lg_var input, lg_var *out);
/* For families whose first arrays are Gamma and b: whether all Cholesky pivots of m are at least
 * LG_HAMILTONIAN_LEAST_PIVOT. If these are Gamma (n, n) and b (n), the second function sets vars->kinetic:
 * m^-1 (1, n, n), NaN unless m is positive definite, 1/m_ii (1, n, 1), and m (1, n, n). */
bool lg_hamiltonian_usable_mass(const lg_hamiltonian_family *family, uint32_t n, const double *arrays);
void lg_hamiltonian_bind_mass(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars);

/* The equation that training integrates by `scheme`, inside. For Lie group schemes it lives
 * on the manifold, for other schemes on R^d, split into parts like `start`. `vars` must outlive the use of
 * `ode`. */
lg_status lg_hamiltonian_training_ode(lg_tape *tape, lg_hamiltonian_vars *vars, const lg_scheme *scheme,
                                      const lg_var *start, lg_taped_ode *ode);

/* Returns the space of n copies of the family. lg_hamiltonian_init must have accepted n. */
lg_space lg_hamiltonian_space_of(const lg_hamiltonian_family *family, uint32_t n);
lg_space lg_hamiltonian_model_space(const lg_hamiltonian *model);
/* The parts of a state, or of a gradient, times factor/scale of each part; and each times its scale. */
void lg_hamiltonian_over_scales(lg_tape *tape, const lg_hamiltonian *model, double factor, const lg_var *y,
                                lg_var *out);
void lg_hamiltonian_by_scales(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y, lg_var *out);

/* Whether geodesic distances are known for every factor of the space. */
bool lg_hamiltonian_has_geodesics(const lg_space *space);
/* The sum over all rows of the squared distances of the points a and b, which are given as parts. The squares
 * of part i are multiplied by weight[i]. */
lg_var lg_hamiltonian_squared_distance(lg_tape *tape, lg_hamiltonian_distance kind, const lg_space *space,
                                       const double *weight, const lg_var *a, const lg_var *b);

/* A kind of potential: a network of `count` functions of the d coordinates; layered: with hidden layers. */
#define LG_DICTIONARY_COORDINATES (3 * LG_HAMILTONIAN_MAX_COPIES)
typedef struct lg_potential_row {
    bool layered;
    uint32_t (*count)(uint32_t d);
    /* Computes these functions, (B, d) -> (B, count); x times `unit` is in the units of the data. NULL: the
     * functions are x itself. */
    lg_var (*record)(lg_tape *tape, lg_var x, double unit);
} lg_potential_row;
const lg_potential_row *lg_potential_row_of(lg_potential_kind kind); /* NULL: unknown kind */

/* A symmetry of the potential: V(x) = (N(x) + sign N(-x))/2, or N(x) if sign is 0. */
typedef struct lg_symmetry_row {
    double sign;
    /* How many invariants of a group there are, and their values, (B, d) -> (B, count). N is then a function
     * of the invariants instead of x. NULL: N is a function of x. count returns 0 if the group does not act
     * on the family's coordinates or has no invariant. */
    uint32_t (*count)(const lg_hamiltonian *model);
    lg_var (*record)(lg_tape *tape, const lg_hamiltonian *model, lg_var x);
    int degree; /* an invariant is multiplied by s^degree if x is multiplied by s; directions have s = 1 */
    bool isotropic; /* the group has all rotations of R^n */
    /* What the flow of a symmetric potential conserves, from the parts of states: (B, k). NULL: nothing. */
    lg_var (*momentum)(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y);
} lg_symmetry_row;
const lg_symmetry_row *lg_symmetry_row_of(lg_symmetry symmetry); /* NULL: unknown symmetry */
/* How many vectors of R^3 the positions consist of: columns of rotations, then directions; 0 if there are
 * other numbers among them. */
uint32_t lg_hamiltonian_vectors(const lg_hamiltonian *model);
/* a_i b_j for i < j, (B, n) -> (B, n(n-1)/2), in the order 12, 13, ..., 23, ...; n is 2 or more */
lg_var lg_hamiltonian_pairs(lg_tape *tape, lg_var a, lg_var b);

/* ---- what trajectories show ---- */

/* Writes the scale of each number of a state to out (d). */
void lg_hamiltonian_number_scales(const lg_hamiltonian *model, double *out);
/* Whether any part of the states changes along the trajectories by more than rounding. */
bool lg_hamiltonian_moves(const lg_hamiltonian_problem *problem);
/* How much the momentum that the model's symmetry conserves moves; 0 for a symmetry without a momentum. */
typedef struct lg_momentum_motion {
    double moved; /* root mean square of the largest change in a trajectory */
    double size;  /* root mean square of |pi| + sum |q| |p|, a bound on the momentum */
    bool moves; /* by more than noise, equal at all points, and a decay common to all trajectories explain */
} lg_momentum_motion;
lg_status lg_hamiltonian_momentum_motion(const lg_context *context, const lg_hamiltonian_problem *problem,
                                         lg_momentum_motion *out);
/* The first integral G of the penalty; and root mean squares over the trajectories: out[0] of G at the first
 * point, out[j] (j = 1..M - 1) of its change from there to point j. lg_hamiltonian_problem_check must have
 * accepted the problem. */
const lg_first_integral *lg_hamiltonian_integral_of(const lg_hamiltonian_problem *problem);
lg_status lg_hamiltonian_integral_changes(const lg_context *context, const lg_hamiltonian_problem *problem,
                                          double *out);

#endif
