/* Options of surrogates for tables of tests, and artificial modes: orthogonal vectors of decreasing
 * length. */
#ifndef LG_TEST_MODES_H
#define LG_TEST_MODES_H

#include "support/fixtures.h"

#include <math.h>

#include "liegrad/elastica.h"

/* Options in one row: kind, network and its sizes, then any other members. */
#define SURROGATE(kind_, architecture_, embedding_, hidden_, layers_, activation_, ...)                      \
    {                                                                                                        \
        .kind = LG_SURROGATE_##kind_, .architecture = LG_NET_##architecture_, .embedding = embedding_,       \
        .hidden = hidden_, .layers = layers_, .activation = LG_##activation_, __VA_ARGS__                    \
    }

/* Gives the model its modes: mode k = 1..K is row k of the discrete cosine transform, scaled to the length
 * 1/k. */
static inline void give_modes(lg_surrogate *model) {
    const size_t n = 4 * ((size_t)model->intervals - 1);
    double *modes = TEST_ARRAY(double, lg_surrogate_modes_size(model) + 1);
    if (model->options.modes == 0) return;
    for (size_t i = 0; i < n; i++) modes[i] = 0.3 * sin(1.0 + (double)i);
    for (size_t k = 1; k <= model->options.modes; k++)
        for (size_t i = 0; i < n; i++)
            modes[n * k + i] = sqrt(2.0 / (double)n) / (double)k *
                               cos(3.14159265358979323846 * (double)k * ((double)i + 0.5) / (double)n);
    model->modes = modes;
}

#endif
