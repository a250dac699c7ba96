/* What evaluate and predict share: the training range of a network, and the curves that it computes. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"

/* A curve is outside if its distance exceeds the reach times this factor. */
static const double outside_factor = 2;

outside count_outside(const lg_surrogate_file *file, const double *boundary_rows, const uint32_t *chosen,
                      size_t count) {
    if (file->trained_count == 0) return (outside){.reach = (double)NAN, .largest = (double)NAN};
    outside out = {.reach = lg_surrogate_reach(file->trained, file->trained_count)};
    for (size_t i = 0; i < count; i++) {
        const double *x = boundary_rows + 8 * (chosen != NULL ? chosen[i] : i);
        const double distance =
            lg_surrogate_distance(&file->run.model, file->trained, file->trained_count, x);
        out.largest = fmax(out.largest, distance);
        out.count += distance > outside_factor * out.reach;
    }
    return out;
}

learned learned_open(const app *self, const lg_surrogate_file *file, size_t points) {
    learned out;
    APP_MUST(self, lg_surrogate_curves_create(self->context, &file->run.model, file->theta, LG_F64, points,
                                              &out.curves, &error));
    out.work = app_alloc(lg_surrogate_curves_work_size(out.curves), 1);
    return out;
}

void learned_close(learned *curves) {
    free(curves->work);
    lg_surrogate_curves_destroy(curves->curves);
}

double equidistant(double length, size_t k, size_t n) {
    return k + 1 < n ? length * ((double)k / (double)(n - 1)) : length;
}
