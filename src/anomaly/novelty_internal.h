/* Declarations shared by the source files of the novelty detector (liegrad/anomaly.h). */
#ifndef LG_NOVELTY_INTERNAL_H
#define LG_NOVELTY_INTERNAL_H

#include "core/clean.h"
#include "core/stored.h"
#include "liegrad/anomaly.h"

/* Order of the features of a channel. The features of channel c begin at index c (NOVELTY_BAND + bands). The
 * features of the channel pairs (0, 1), (0, 2), ..., (1, 2), ... follow the last channel. */
enum { NOVELTY_MEAN, NOVELTY_DEVIATION, NOVELTY_CREST, NOVELTY_BAND };

/* Groups of features: group 0 is all features of the window, group 1 + c is channel c, and group 1 + channels
 * is all pairs. */
typedef struct novelty_group {
    uint32_t first, count; /* index of the first feature, number of features */
    /* Offset of the group's Cholesky factor from where the class's factors begin in lg_novelty.block. */
    size_t block;
} novelty_group;
uint32_t lg_novelty_groups(const lg_novelty *novelty);
novelty_group lg_novelty_group(const lg_novelty *novelty, uint32_t group);

/* Sets the numbers of pairs and features, and lists the arrays that are learned, with their shapes. The other
 * sizes must be set. */
enum { NOVELTY_ARRAYS = 9 };
void lg_novelty_list(lg_novelty *novelty, lg_stored rows[NOVELTY_ARRAYS]);
/* Allocates `block` and creates the spectrum. */
lg_status lg_novelty_prepare(lg_novelty *novelty, lg_error *error);
/* Computes `block` from `precision`. Error LG_FORMAT: a block of `precision` is not positive definite. */
lg_status lg_novelty_factor(lg_novelty *novelty, lg_error *error);

/* Computes the features of x (channels, length). still (channels) becomes the longest run of equal samples,
 * extreme (channels) the number of samples at the channel's least or largest value, whichever number is
 * larger. Returns false if a feature is not finite. work: lg_novelty_work_size bytes suffice. */
bool lg_novelty_features(const lg_novelty *novelty, const float *x, double *features, double *still,
                         double *extreme, void *work);
/* Computes the squared distance between the features and a class in each group: square (groups). work: 2
 * doubles per feature. */
void lg_novelty_distances(const lg_novelty *novelty, uint32_t class_index, const double *features,
                          double *square, double *work);
/* Writes the name of a channel, or "channel 1" for the first one without a name. names may be NULL. */
enum { NOVELTY_NAME = LG_SERIES_NAME + 16 }; /* bytes */
LG_API void lg_novelty_channel(char (*names)[LG_SERIES_NAME], uint32_t channel, char text[NOVELTY_NAME]);

#endif
