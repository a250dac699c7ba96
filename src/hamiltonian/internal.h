/* Shared by the parts of the learned Hamiltonian. */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "liegrad/hamiltonian.h"
#include "liegrad/ops.h"

/* The table: X(name) stands for the row lg_hamiltonian_<name>. Data that do not name their system belong to
 * the first row that they fit. */
#define LG_HAMILTONIAN_FAMILIES(X) X(chain) X(separable)

#define LG_HAMILTONIAN_DECLARE(name) extern const lg_hamiltonian_family lg_hamiltonian_##name;
LG_HAMILTONIAN_FAMILIES(LG_HAMILTONIAN_DECLARE)
#undef LG_HAMILTONIAN_DECLARE

enum { LG_HAMILTONIAN_LARGEST = 6 * LG_HAMILTONIAN_MAX_COPIES }; /* numbers of a state */

/* x times a number; x itself for 1. */
static inline lg_var lg_hamiltonian_scaled(lg_tape *tape, lg_var x, double by) {
    return by == 1.0 ? x : lg_scale(tape, x, by);
}
/* The unit of energy inside, E. */
double lg_hamiltonian_energy_scale(const lg_hamiltonian *model);
/* -dH/dq + input and dH/dp in the units of the data; the family's functions are inside. */
lg_var lg_hamiltonian_record_force(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input);
lg_var lg_hamiltonian_record_drift(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p);

/* For the functions of a family: V (B, 1) of x (B, ...), which has `inputs` n numbers a row, and dV/dx in the
 * shape of x. The third function gives `input` the shape of `part`; the numbers of rows and of elements must
 * be equal. */
lg_var lg_hamiltonian_potential(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);
lg_var lg_hamiltonian_input_like(lg_tape *tape, lg_var input, lg_var part);

/* The field for lg_taped_step_over, with force and velocity where the family has them. `vars` must
 * outlive the use of `ode`. */
lg_status lg_hamiltonian_taped_ode(lg_hamiltonian_vars *vars, lg_taped_ode *ode);
/* The equation that training solves with a scheme, inside and without input: on the manifold for Lie group
 * schemes, else on R^d with the parts of `start`. `vars` must outlive the use of `ode`. */
lg_status lg_hamiltonian_training_ode(lg_tape *tape, lg_hamiltonian_vars *vars, const lg_scheme *scheme,
                                      const lg_var *start, lg_taped_ode *ode);

/* Whether every factor of the space has a row of geodesics. */
bool lg_hamiltonian_has_geodesics(const lg_space *space);
/* Sum of squared distances of the points a and b, given as parts; the squares of part i times weight[i]. */
lg_var lg_hamiltonian_squared_distance(lg_tape *tape, lg_hamiltonian_distance kind, const lg_space *space,
                                       const double *weight, const lg_var *a, const lg_var *b);

/* A kind of potential: a network with or without hidden layers, on `count` functions of d coordinates. */
#define LG_DICTIONARY_COORDINATES (3 * LG_HAMILTONIAN_MAX_COPIES)
typedef struct lg_potential_row {
    bool layered;
    uint32_t (*count)(uint32_t d);
    /* (B, d) -> (B, count), of coordinates in units of `unit`; NULL: x itself */
    lg_var (*record)(lg_tape *tape, lg_var x, double unit);
} lg_potential_row;
const lg_potential_row *lg_potential_row_of(lg_potential_kind kind); /* NULL: none */

#endif
