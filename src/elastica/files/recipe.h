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

/* `count`: number of curves whose boundary conditions are outside the range of the trained ones, as
 * docs/beams.md defines it. All distances are NaN if the model file has no boundary conditions of its
 * training part. */
typedef struct lg_elastica_outside {
    double reach, largest; /* largest: largest distance of a curve */
    double spread, off;    /* off: largest distance of a curve from the family */
    size_t count;
} lg_elastica_outside;
/* `chosen` (count): the rows of `boundary` to count; NULL: the first `count` rows. */
lg_elastica_outside lg_elastica_count_outside(const lg_surrogate_file *file, const double *boundary,
                                              const uint32_t *chosen, size_t count);
/* Warns if the boundary conditions (8) of a prediction are outside. */
lg_elastica_outside lg_elastica_warn_outside(const lg_context *context, const lg_surrogate_file *file,
                                             const double *boundary);

/* Indices of the curves of one part, in rising order. */
typedef struct lg_curves_part {
    uint32_t *list;
    size_t count;
} lg_curves_part;

/* The parts of the data that `evaluate` can use. */
enum { LG_CURVES_ALL, LG_CURVES_TRAIN, LG_CURVES_TEST };
extern const char *const lg_curves_part_names[];

/* The trainer's state. */
typedef struct lg_surrogate_state {
    int part; /* evaluate: option, the part of the curves */
    lg_elastica_data data;
    const lg_surrogate_preset *preset; /* preset that was adopted; NULL when training is resumed */
    /* in a hyperparameter search `test` is held out of the training part; evaluate: the curves used */
    lg_curves_part train, test;
    lg_curves_part learned; /* curves of `train` that are learned, at most run->most_curves */
    double *modes, *coefficients, truncation; /* of a network with modes; otherwise NULL, NULL, NaN */
    lg_surrogate_problem problem;
    lg_surrogate_errors errors; /* evaluate: and at each node, (N + 1, 2) */
    double *node_error;
} lg_surrogate_state;

#endif
