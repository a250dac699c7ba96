/* What evaluate and predict share: the training range of a network, and the curves that it computes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/beam.h"

/* A curve is outside if its distance exceeds the reach or the spread times this factor. */
static const double outside_factor = 2;

outside count_outside(const lg_surrogate_file *file, const double *boundary_rows, const uint32_t *chosen,
                      size_t count) {
    const double none = (double)NAN;
    if (file->trained_count == 0) return (outside){none, none, none, none, 0};
    outside out = {.reach = lg_surrogate_reach(file->trained, file->trained_count),
                   .spread = lg_surrogate_spread(file->trained, file->trained_count)};
    for (size_t i = 0; i < count; i++) {
        const double *x = boundary_rows + 8 * (chosen != NULL ? chosen[i] : i);
        const double distance =
            lg_surrogate_distance(&file->run.model, file->trained, file->trained_count, x);
        const double off = lg_surrogate_off_family(&file->run.model, file->trained, file->trained_count, x);
        out.largest = fmax(out.largest, distance);
        out.off = fmax(out.off, off);
        out.count += distance > outside_factor * out.reach || off > outside_factor * out.spread;
    }
    return out;
}

lg_elastica beam_of_model(const lg_surrogate_file *file, bool *known) {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.length = file->run.model.length;
    problem.intervals = file->run.model.intervals;
    *known = file->run.stiffness > 0;
    if (*known) problem.stiffness = file->run.stiffness;
    if (file->trained_count > 0) {
        memcpy(problem.q0, file->trained, sizeof problem.q0);
        memcpy(problem.qN, file->trained + 4, sizeof problem.qN);
    }
    return problem;
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
