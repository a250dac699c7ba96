/* Training a surrogate: what `train`, `search` and `evaluate` have in common. */
#ifndef LG_APPS_ELASTICA_TRAIN_H
#define LG_APPS_ELASTICA_TRAIN_H

#include "common/train.h"
#include "lg-elastica/beam.h"

/* Indices of the curves of one part, rising. */
typedef struct part_indices {
    uint32_t *list;
    size_t count;
} part_indices;
/* The split of a run's data. */
lg_status split_curves(const lg_surrogate_run *run, part_indices *train, part_indices *test, lg_error *error);

#endif
