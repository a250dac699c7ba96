/* Sets of curves: reading, their family, and whether they lie in the training range of a network. */
#include <math.h>

#include "lg-elastica/beam.h"

/* A curve is outside when it is farther away than this many times the reach. */
static const double outside_factor = 2;

/* Twice as far as any number of a curve can be from its first node, or of a tangent from 0. */
static bool is_impossible(const lg_elastica_curves *curves, size_t curve, size_t node) {
    const size_t nodes = (size_t)curves->intervals + 1;
    const double *first = curves->q + 2 * nodes * curve, *q = first + 2 * node,
                 *v = curves->v + 2 * (nodes * curve + node);
    return !(hypot(q[0] - first[0], q[1] - first[1]) <= 2 * curves->length && hypot(v[0], v[1]) <= 2);
}

static void warn_impossible(const app *self, const char *path, const lg_elastica_curves *curves) {
    size_t count = 0, curve = 0, node = 0;
    for (size_t i = curves->count; i-- > 0;)
        for (size_t k = (size_t)curves->intervals + 1; k-- > 0;)
            if (is_impossible(curves, i, k)) curve = i, node = k, count++;
    if (count > 0)
        app_warn(
            self,
            "%s: %zu nodes are no points of a beam, the first is node %zu of curve %zu (from 0): more than "
            "twice the length from its start, or a tangent longer than 2; most of the error comes from them",
            path, count, node, curve);
}

int read_curves(const app *self, const char *path, lg_elastica_data *out) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_elastica_data_read(self->context, path, NULL, out, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    warn_impossible(self, path, &out->curves);
    return APP_EXIT_OK;
}

families families_of(const double *boundary_rows, size_t n) {
    families found = {false, false};
    for (size_t i = 0; i < n; i++) {
        const double *x = boundary_rows + 8 * i, dx = x[4] - x[0], dy = x[5] - x[1];
        const double along = x[2] * dx + x[3] * dy, across = x[2] * dy - x[3] * dx;
        const bool right_end = along > 0 && fabs(across) <= 1e-9 * along;
        found.right_end = found.right_end || right_end;
        found.both_ends = found.both_ends || !right_end;
    }
    return found;
}

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
