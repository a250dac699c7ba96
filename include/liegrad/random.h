/* Random numbers: xoshiro256** (Blackman & Vigna 2018) seeded through splitmix64. Caller's memory, no hidden
 * state; the four words are all there is to save for a bitwise restart. */
#ifndef LIEGRAD_RANDOM_H
#define LIEGRAD_RANDOM_H

#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"

LG_BEGIN_DECLS

typedef struct lg_rng {
    uint64_t s[4];
} lg_rng;

/* Different (seed, stream) pairs give independent generators. */
LG_API void lg_rng_seed(lg_rng *rng, uint64_t seed, uint64_t stream);
LG_API uint64_t lg_rng_next(lg_rng *rng);
LG_API double lg_rng_uniform(lg_rng *rng);                          /* [0, 1), 53 bits */
LG_API double lg_rng_uniform_in(lg_rng *rng, double a, double b);   /* [a, b) */
LG_API double lg_rng_normal(lg_rng *rng);                           /* N(0, 1), polar method, no state kept */
LG_API uint64_t lg_rng_below(lg_rng *rng, uint64_t n);              /* {0..n-1} without bias; 0 for n = 0 */
LG_API void lg_rng_shuffle(lg_rng *rng, uint32_t *items, size_t n); /* Fisher-Yates */

LG_END_DECLS

#endif
