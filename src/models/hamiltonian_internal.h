/* Shared by the two halves of the learned Hamiltonian, with and without a tape. */
#ifndef LG_HAMILTONIAN_INTERNAL_H
#define LG_HAMILTONIAN_INTERNAL_H

#include "liegrad/hamiltonian.h"

/* Where Gamma and b, or A, begin in theta: behind the potential. */
size_t lg_hamiltonian_kinetic_offset(const lg_hamiltonian *model);

#endif
