/* Families of Hamiltonians by name, and the family of a system. */
#ifndef LG_HAMILTONIAN_FAMILY_H
#define LG_HAMILTONIAN_FAMILY_H

#include "liegrad/hamiltonian.h"

/* The family that learns the system with this name, and the n of the system; *n is 0 if any n is possible.
 * NULL: the system is unknown, no family learns it, or it cannot be made. */
const lg_hamiltonian_family *lg_family_of(const char *system, size_t *n);
/* Which form of the system models are learned in: "hamiltonian". NULL: the system has only one form. */
const char *lg_learned_form(const char *system);

/* A system has at most LG_MOST_PARAMETERS parameters. A parameter without a default has at most
 * LG_MOST_VALUES numbers. */
enum { LG_MOST_PARAMETERS = 16, LG_MOST_VALUES = 32 };

#define LG_LAYOUT_TEXT (12 * LG_HAMILTONIAN_MAX_COPIES)
/* Writes the layout of the family's states: "q1 p1 q2 p2 ..." or "q p". */
void lg_layout_text(const lg_hamiltonian_family *family, uint32_t n, char text[LG_LAYOUT_TEXT]);

#endif
