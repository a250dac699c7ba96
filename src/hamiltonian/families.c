/* The table of families. */
#include <string.h>

#include "core/core.h"
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

const lg_hamiltonian_family *lg_hamiltonian_family_for(const lg_system *system, size_t *n) {
    for (size_t i = 0; i < LG_COUNT(families); i++)
        if (families[i]->learns != NULL && families[i]->learns(system, n)) return families[i];
    return NULL;
}
