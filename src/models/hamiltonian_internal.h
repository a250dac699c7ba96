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

#endif
