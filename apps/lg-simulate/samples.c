/* Chooses the times at which states are kept for --out and --plot. */
#include "lg-simulate/simulate.h"

#include <float.h>
#include <math.h>

/* Default numbers of points: POINTS, or POINTS_OF_STEPS for equal steps; fewer if the states of all
 * points would have more than NUMBERS numbers. */
enum { POINTS = 501, POINTS_OF_STEPS = 1001, NUMBERS = 8000000 };

static size_t default_points(const simulation *sim, size_t points) {
    const size_t most = NUMBERS / sim->dim;
    return points <= most ? points : most > 2 ? most : 2;
}

/* The start, `inner` times in between, and t_end. */
static void allocate(const simulation *sim, size_t inner, samples *out) {
    *out = (samples){.count = inner + 2, .kept = inner + 2};
    out->t = app_keep(out->count, sizeof *out->t);
    out->t[out->count - 1] = sim->t_end;
}

/* Ends the command if a time lies between equal steps and the scheme has no dense output. */
static void check_steps(const simulation *sim, const plan *how, const samples *path) {
    const double h = how->t_end / (double)how->control.steps;
    if (how->control.steps == 0 || how->scheme->dense_order > 0) return;
    for (size_t i = 0; i < path->count; i++) {
        const double n = path->t[i] / h;
        if (fabs(n - round(n)) <= 1e-9 + 4 * DBL_EPSILON * n) continue;
        if (sim->values->points > 0)
            app_stop_usage(
                sim->self,
                "--points: %llu points make %llu intervals, which do not divide %zu steps, and '%s' has no "
                "dense output",
                (unsigned long long)sim->values->points, (unsigned long long)sim->values->points - 1,
                how->control.steps, how->scheme->name);
        app_stop_usage(sim->self,
                       "--times: %.17g is not a multiple of the step %.17g, and '%s' has no dense output",
                       path->t[i], h, how->scheme->name);
    }
}

void samples_times(const simulation *sim, size_t otherwise, samples *out) {
    const size_t points = sim->values->points > 0 ? (size_t)sim->values->points : otherwise;
    const lg_reals *times = &sim->values->times;
    if (times->count == 0) {
        allocate(sim, points - 2, out);
        for (size_t i = 1; i + 1 < points; i++) out->t[i] = sim->t_end * ((double)i / (double)(points - 1));
        return;
    }
    /* 0 and t_end have rows in any case, so they are not counted as inner times. */
    const bool from_zero = times->values[0] == 0, to_end = times->values[times->count - 1] == sim->t_end;
    const size_t inner = times->count - from_zero - to_end;
    allocate(sim, inner, out);
    for (size_t i = 0; i < inner; i++) out->t[i + 1] = times->values[i + from_zero];
    out->first = from_zero ? 0 : 1;
    out->kept = times->count;
}

void samples_choose(const simulation *sim, const plan *how, bool wanted, samples *out) {
    const simulate_values *values = sim->values;
    const size_t steps = how->control.steps, intervals = default_points(sim, POINTS_OF_STEPS) - 1;
    if (wanted && (values->times.count > 0 || values->points > 0 || steps == 0)) {
        samples_times(sim, default_points(sim, POINTS), out);
    } else { /* every k-th step and the last step */
        const size_t every = (steps + intervals - 1) / intervals, inner = wanted ? (steps - 1) / every : 0;
        allocate(sim, inner, out);
        for (size_t i = 1; i <= inner; i++) out->t[i] = (double)(i * every) * (sim->t_end / (double)steps);
    }
    out->y = app_keep(out->count, sim->dim * sizeof *out->y);
    check_steps(sim, how, out);
}
