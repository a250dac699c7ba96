/* Functions for the data of a surrogate that the recipe and the programs `train` and `evaluate` use. */
#ifndef LG_ELASTICA_RECIPE_H
#define LG_ELASTICA_RECIPE_H

#include "liegrad/elastica.h"

/* Finds out which families are among the boundary conditions (n, 8). A condition is of the right-end family
 * if v0 is along the chord; all others count as both-ends. */
typedef struct lg_elastica_families {
    bool both_ends, right_end;
} lg_elastica_families;
lg_elastica_families lg_elastica_families_of(const double *boundary, size_t n);

/* lg_elastica_data_read, which also warns of nodes that cannot be points of a beam. */
lg_status lg_elastica_data_judge(const lg_context *context, const char *path, lg_elastica_data *out,
                                 lg_error *error);
/* Finds the curves that belong to the part `wanted` of the run's data: their indices in rising order in list
 * (run->curves), and their number. */
lg_status lg_surrogate_part(const lg_context *context, const lg_surrogate_run *run, lg_part wanted,
                            uint32_t *list, size_t *count, lg_error *error);

#endif
