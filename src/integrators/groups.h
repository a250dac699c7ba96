/* The groups of a state: numbers with one unit, whose sizes are compared with each other. They are the single
 * coordinates of R^n; q and p, R, R and r, x, G and P of each copy of the other spaces. */
#ifndef LG_GROUPS_H
#define LG_GROUPS_H

#include <stdint.h>

#include "liegrad/integrators.h"

/* Writes the ends of the groups in the state, ascending, at most dim numbers. Returns how many. */
size_t lg_space_groups(const lg_space *space, size_t *end);

/* A default tolerance does not take rounding of the field for error: it counts as rounding what y' does when
 * the state moves by this part of its size. */
#define LG_VECTOR_FIELD_ROUNDING 0x1p-49

/* +1 or -1: which way the number i of a state is moved for this. No pattern that a field could cancel. */
static inline double lg_rounding_sign(size_t i) {
    return ((uint32_t)i * 2654435761u >> 16 & 1u) != 0 ? -1.0 : 1.0;
}

#endif
