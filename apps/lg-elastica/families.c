/* Whether curves lie in the training range of a network. */
#include <math.h>

#include "lg-elastica/beam.h"

/* A curve is outside when it is farther away than this many times the reach. */
static const double outside_factor = 2;

outside count_outside(const lg_surrogate *model, const double *trained, size_t trained_count,
                      const double *boundary_rows, const uint32_t *chosen, size_t count) {
    if (trained_count == 0) return (outside){.reach = (double)NAN, .largest = (double)NAN};
    outside out = {.reach = lg_surrogate_reach(trained, trained_count)};
    for (size_t i = 0; i < count; i++) {
        const double *x = boundary_rows + 8 * (chosen != NULL ? chosen[i] : i);
        const double distance = lg_surrogate_distance(model, trained, trained_count, x);
        out.largest = fmax(out.largest, distance);
        out.count += distance > outside_factor * out.reach;
    }
    return out;
}
