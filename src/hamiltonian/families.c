/* The table of families. */
#include <string.h>

#include "hamiltonian/internal.h"

#define ROW(name) &lg_hamiltonian_##name,
static const lg_hamiltonian_family *const families[] = {LG_HAMILTONIAN_FAMILIES(ROW)};

size_t lg_hamiltonian_family_count(void) {
    return LG_COUNT(families);
}

const lg_hamiltonian_family *lg_hamiltonian_family_at(size_t index) {
    return index < LG_COUNT(families) ? families[index] : NULL;
}

const lg_hamiltonian_family *lg_hamiltonian_family_find(const char *name) {
    for (size_t i = 0; i < LG_COUNT(families); i++)
        if (strcmp(families[i]->name, name) == 0) return families[i];
    return NULL;
}

/* Whether the family with *n copies has the system's space; on R^2n, whether both are separable. */
static bool learns(const lg_hamiltonian_family *family, const lg_system *system, size_t *n) {
    const lg_space *space = lg_system_space(system);
    const bool flat = lg_space_is_abelian(space);
    *n = flat ? space->dim / 2 : lg_system_links(system) > 0 ? lg_system_links(system) : 1;
    if (flat) return family->drift != NULL && lg_system_separable(system);
    if (space->factor[0].kind == LG_SPACE_SE3) /* T*SO(3): R and pi */
        return space->factors == 1 && family == &lg_hamiltonian_rotation;
    const lg_space own = lg_hamiltonian_space_of(family, (uint32_t)*n);
    bool same = own.factors == space->factors;
    for (size_t i = 0; i < own.factors && same; i++)
        same = own.factor[i].kind == space->factor[i].kind && own.factor[i].count == space->factor[i].count;
    return same;
}

const lg_hamiltonian_family *lg_hamiltonian_family_for(const lg_system *system, size_t *n) {
    for (size_t i = 0; i < LG_COUNT(families); i++)
        if (learns(families[i], system, n)) return families[i];
    return NULL;
}
