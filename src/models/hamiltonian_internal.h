/* Shared by the parts of the learned Hamiltonian: with a tape, without one, in a loop. */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "liegrad/hamiltonian.h"

/* Where Gamma and b, or A, begin in theta: behind the potential. */
size_t lg_hamiltonian_kinetic_offset(const lg_hamiltonian *model);

/* Separable systems: -dV/dq at q, A^T A p at p, n numbers each; work as for lg_hamiltonian_field. */
void lg_hamiltonian_force(const lg_hamiltonian *model, const double *theta, const double *q, double *out,
                          void *work);
void lg_hamiltonian_velocity(const lg_hamiltonian *model, const double *theta, const double *p, double *out,
                             void *work);

/* On a tape; q, p, v = dH/dp, g = dH/dq of shape (B, k, 3), or (B, n). */

/* The unit matrix as a constant (1, k, k). */
lg_var lg_hamiltonian_unit_matrix(lg_tape *tape, uint32_t k);
/* lg_hamiltonian_bind, and for a chain 1/m_ii (1, k, 1). */
lg_status lg_hamiltonian_bind_extended(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                                       lg_hamiltonian_vars *vars, lg_var *inverse_mii);
/* dV/dq in q's shape. */
lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q);
/* Chain: v and g of lg_hamiltonian_gradient. */
void lg_hamiltonian_chain_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var p,
                                   lg_var *v, lg_var *g);
/* Chain: xi = q x v, eta = g x q + v x p + input, y = (q, p); input (B, 3k) or LG_NONE. */
lg_status lg_hamiltonian_chain_lift(lg_tape *tape, const lg_var *y, lg_var v, lg_var g, lg_var input,
                                    lg_var *algebra);

#endif
