/* Shared by the parts of the learned Hamiltonian. */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "liegrad/hamiltonian.h"

/* The table: X(name) stands for the row lg_hamiltonian_<name>. Data that do not name their system belong to
 * the first row that they fit. */
#define LG_HAMILTONIAN_FAMILIES(X) X(chain) X(separable)

#define LG_HAMILTONIAN_DECLARE(name) extern const lg_hamiltonian_family lg_hamiltonian_##name;
LG_HAMILTONIAN_FAMILIES(LG_HAMILTONIAN_DECLARE)
#undef LG_HAMILTONIAN_DECLARE

/* dH/dy of the parts y, by the family's row. */
void lg_hamiltonian_gradient_parts(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                   lg_var *out);
/* y' of the parts y for schemes that leave the manifold. */
lg_status lg_hamiltonian_velocity_parts(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                        lg_var input, lg_var *out);
/* The equation that training solves with a scheme: on the manifold for Lie group schemes, else on R^d with
 * the parts of `start`. `vars` must outlive the use of `ode`. */
lg_status lg_hamiltonian_training_ode(lg_tape *tape, lg_hamiltonian_vars *vars, const lg_scheme *scheme,
                                      const lg_var *start, lg_taped_ode *ode);
/* The functions of a model in a loop: value, grad and field as in lg_hamiltonian_program; velocity (x, u) ->
 * y' and its Jacobian jac_velocity; force (q, u) and drift (p) if the family has them. */
lg_status lg_hamiltonian_bundle(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                lg_program **out, lg_error *error);

#endif
