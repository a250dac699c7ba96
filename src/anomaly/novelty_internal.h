/* Declarations that the files of novelty.h share. */
#ifndef LG_NOVELTY_INTERNAL_H
#define LG_NOVELTY_INTERNAL_H

#include "core/core.h"
#include "liegrad/novelty.h"

/* Features of a channel, in this order; those of channel c begin at c (NOVELTY_BAND + bands). Pairs (0, 1),
 * (0, 2), ..., (1, 2), ... follow the last channel. */
enum { NOVELTY_MEAN, NOVELTY_DEVIATION, NOVELTY_CREST, NOVELTY_BAND };

/* Groups: number 0 is the whole window, 1 + c channel c, 1 + channels the pairs. */
typedef struct novelty_group {
    uint32_t first, count; /* features */
    size_t block;          /* offset of its factor in `block` of a class */
} novelty_group;
uint32_t lg_novelty_groups(const lg_novelty *novelty);
novelty_group lg_novelty_group(const lg_novelty *novelty, uint32_t group);
size_t lg_novelty_block(const lg_novelty *novelty); /* doubles of a class */

/* Sizes alone, and the numbers of pairs and features that follow from them. */
lg_novelty lg_novelty_sized(uint32_t channels, uint32_t length, uint32_t classes, uint32_t bands);
/* With the arrays, zeroed, and the spectrum. */
lg_status lg_novelty_allocate(const lg_context *context, uint32_t channels, uint32_t length, uint32_t classes,
                              uint32_t bands, lg_novelty *out, lg_error *error);
/* Sets `block` from `precision`. LG_FORMAT: a matrix is not positive definite. */
lg_status lg_novelty_factor(lg_novelty *novelty, lg_error *error);

/* x (channels, length) -> features; still and extreme (channels) as counted. False: not finite. */
bool lg_novelty_features(const lg_novelty *novelty, const float *x, double *features, double *still,
                         double *extreme, void *work);
/* The squared distances of features to a class: square (groups). work: 2 features doubles. */
void lg_novelty_distances(const lg_novelty *novelty, uint32_t class_index, const double *features,
                          double *square, double *work);

#endif
