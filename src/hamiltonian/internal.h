/* Functions and tables that the files of the learned Hamiltonian share. "Inside" means divided by the model's
 * scales (liegrad/hamiltonian.h). */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "liegrad/hamiltonian.h"
#include "liegrad/ops.h"

/* The table of families: X(name) stands for the row lg_hamiltonian_<name>. Data that do not name their system
 * are assigned to the first family that they fit. */
#define LG_HAMILTONIAN_FAMILIES(X) X(chain) X(separable)

#define LG_HAMILTONIAN_DECLARE(name) extern const lg_hamiltonian_family lg_hamiltonian_##name;
LG_HAMILTONIAN_FAMILIES(LG_HAMILTONIAN_DECLARE)
#undef LG_HAMILTONIAN_DECLARE

enum { LG_HAMILTONIAN_LARGEST = 6 * LG_HAMILTONIAN_MAX_COPIES }; /* most numbers in a state */

/* x times `by`; for 1 it is x itself, without an operation. */
static inline lg_var lg_hamiltonian_scaled(lg_tape *tape, lg_var x, double by) {
    return by == 1.0 ? x : lg_scale(tape, x, by);
}
/* The scale of energy, E: H in the units of the data is E times H inside. */
double lg_hamiltonian_energy_scale(const lg_hamiltonian *model);
/* The force -dH/dq + input, and the drift dH/dp. Arguments and results are in the units of the data, in
 * contrast to the family's functions force and drift. */
lg_var lg_hamiltonian_record_force(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input);
lg_var lg_hamiltonian_record_drift(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p);

/* For the functions of a family: V (B, 1) at x (B, ...), which has family->inputs n numbers per row, and
 * dV/dx in the shape of x. The third function reshapes `input` to the shape of `part`; both must have the
 * same number of rows and of elements. */
lg_var lg_hamiltonian_potential(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
lg_var lg_hamiltonian_input_like(lg_tape *tape, lg_var input, lg_var part);

/* The equation of motion for lg_taped_step_over, in the units of the data; with force and velocity (dH/dp) if
 * the family has them. `vars` must outlive the use of `ode`. */
lg_status lg_hamiltonian_taped_ode(lg_hamiltonian_vars *vars, lg_taped_ode *ode);
/* The equation that training integrates by `scheme`, inside and without input. For Lie group schemes it lives
 * on the manifold, for other schemes on R^d, split into parts like `start`. `vars` must outlive the use of
 * `ode`. */
lg_status lg_hamiltonian_training_ode(lg_tape *tape, lg_hamiltonian_vars *vars, const lg_scheme *scheme,
                                      const lg_var *start, lg_taped_ode *ode);

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

#endif
