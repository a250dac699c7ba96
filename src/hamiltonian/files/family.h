/* Families of Hamiltonians by name, and the system that each one learns. */
#ifndef LG_HAMILTONIAN_FAMILY_H
#define LG_HAMILTONIAN_FAMILY_H

#include "liegrad/io.h"

const char *lg_name_family(uint32_t value); /* NULL beyond the last */
const void *lg_family_number(uint32_t value);

/* The family that learns the system of this name, and its n, 0 for any; NULL: the system is unknown, is not
 * learned or has no default parameters. */
const lg_hamiltonian_family *lg_family_of(const char *system, size_t *n);
/* The form of a learned system: "hamiltonian", or NULL where there is one form only. */
const char *lg_learned_form(const char *system);

/* At least the parameters of any system. */
enum { LG_MOST_PARAMETERS = 16 };

#define LG_LAYOUT_TEXT (12 * LG_HAMILTONIAN_MAX_COPIES)
/* Layout of the family's states: "q1 p1 q2 p2 ..." or "q p". */
void lg_layout_text(const lg_hamiltonian_family *family, uint32_t n, char text[LG_LAYOUT_TEXT]);

#endif
