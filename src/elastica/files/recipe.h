/* Curves that a surrogate learns, as train and evaluate take them. */
#ifndef LG_ELASTICA_RECIPE_H
#define LG_ELASTICA_RECIPE_H

#include "liegrad/io.h"

/* Whether boundary conditions (n, 8) are of the right-end family: v0 along the chord; at least one such, and
 * at least one other. */
typedef struct lg_elastica_families {
    bool both_ends, right_end;
} lg_elastica_families;
lg_elastica_families lg_elastica_families_of(const double *boundary, size_t n);

/* lg_elastica_data_read, and a warning about nodes that are no points of a beam. */
lg_status lg_elastica_data_judge(const lg_context *context, const char *path, lg_elastica_data *out,
                                 lg_error *error);
/* The curves of a part of the run's data, rising: list (run->curves) and how many. */
lg_status lg_surrogate_part(const lg_context *context, const lg_surrogate_run *run, lg_part wanted,
                            uint32_t *list, size_t *count, lg_error *error);

#endif
