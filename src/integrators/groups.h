/* The groups of a state. A group is a run of numbers that have the same unit, so that their sizes can be
 * compared. On R^n each coordinate is a group, or each three (lg_space.vectors). In each copy of another
 * space the groups are: T*S^2 q and p; SO(3) R; SE(3) R and r; so(3)* x; se(3)* G and P. */
#ifndef LG_GROUPS_H
#define LG_GROUPS_H

#include <stdint.h>

#include "liegrad/integrators.h"

/* Writes for each group the index behind its last number in the state, in ascending order. `end` needs room
 * for dim numbers. Returns the number of groups. */
size_t lg_space_groups(const lg_space *space, size_t *end);

/* Default tolerances (atol < 0) allow for rounding errors of the field. Their size is measured: it is the
 * change of y' when each number of the state moves by this fraction of its group's size. */
#define LG_VECTOR_FIELD_ROUNDING 0x1p-49

/* +1 or -1: the direction in which number i of the state is moved for this measurement. The signs are
 * pseudo-random, so that their effects on a field do not cancel systematically. */
static inline double lg_rounding_sign(size_t i) {
    return ((uint32_t)i * 2654435761u >> 16 & 1u) != 0 ? -1.0 : 1.0;
}

#endif
