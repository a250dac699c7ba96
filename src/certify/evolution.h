/* Maximisation without derivatives of functions of some ten variables that have kinks. */
#ifndef LG_CERTIFY_EVOLUTION_H
#define LG_CERTIFY_EVOLUTION_H

#include "core/core.h"

/* The evolution strategy with covariance matrix adaptation (Hansen, "The CMA evolution strategy: a tutorial",
 * 2016), with a Cholesky factor where the tutorial has the symmetric root. A generation has `members` points
 * mean + sigma A y, y normal; the better half moves the mean and changes C = A A^T and sigma. */
typedef struct lg_evolution {
    size_t n, members, parents;
    double sigma;
    double *mean, *C, *A;        /* (n), (n, n), (n, n) */
    double *path_sigma, *path_C; /* (n) */
    double *y, *x;               /* (members, n): normal numbers, and the points */
    double *weight;              /* (parents) */
    double *memory;
    double effective, generation;
    lg_rng rng;
} lg_evolution;

/* Starts at mean (n) with standard deviations `spread` (n), all above 0. */
lg_status lg_evolution_begin(const lg_context *context, size_t n, size_t members, const double *mean,
                             const double *spread, uint64_t seed, lg_evolution *out);
void lg_evolution_end(const lg_context *context, lg_evolution *e);
/* Draws the points x of the next generation. */
void lg_evolution_ask(lg_evolution *e);
/* Takes the values of the points, (members); a value that is NaN counts as the worst. */
void lg_evolution_tell(lg_evolution *e, const double *values);

#endif
