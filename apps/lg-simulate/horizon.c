/* Checks whether a result can be known at its tolerance: repeats adaptive runs with ten times the
 * tolerance. */
#include "lg-simulate/simulate.h"

#include <math.h>
#include <string.h>

/* Number of times at which two runs are compared, to find when they separate. */
enum { MOMENTS = 200 };

/* A warning is printed if the relative difference exceeds both TOLD and the square root of the larger of the
 * two tolerances. */
#define TOLD 1e-2

/* Sizes of the parts of a state. All blocks with the same key form a part: all q_i, or all omega_i. */
typedef struct sizes {
    const simulation *sim;
    size_t *part; /* (blocks): index of the first block with the same key */
    /* (blocks), used at first blocks only: largest |y_i| in the run; largest difference of two states. */
    double *largest, *apart;
} sizes;

static sizes sizes_of(const simulation *sim) {
    const size_t count = sim->block_count;
    sizes self = {sim, app_keep(count, sizeof *self.part), app_keep(count, sizeof *self.largest),
                  app_keep(count, sizeof *self.apart)};
    for (size_t b = 0; b < count; b++)
        while (strcmp(sim->blocks[self.part[b]].key, sim->blocks[b].key) != 0) self.part[b]++;
    return self;
}

/* into[part] = max(into[part], |x_i - y_i| over the part); y NULL: 0. */
static void widen(const sizes *self, const double *x, const double *y, double *into) {
    for (size_t b = 0; b < self->sim->block_count; b++) {
        const block *at = &self->sim->blocks[b];
        double *most = &into[self->part[b]];
        for (size_t i = at->offset; i < at->offset + at->count; i++)
            *most = fmax(*most, fabs(x[i] - (y != NULL ? y[i] : 0)));
    }
}

static lg_status look_at_sizes(void *user, double t, double h, const double *y) {
    const sizes *self = user;
    (void)t;
    (void)h;
    widen(self, y, NULL, self->largest);
    return LG_OK;
}

/* Relative difference of two states, in the part of the state where it is smallest. Other parts can mislead:
 * the velocities of a body at rest are only rounding errors, and differ by as much as their size. */
static double difference(const sizes *self, const double *x, const double *y) {
    double least = INFINITY;
    for (size_t b = 0; b < self->sim->block_count; b++) self->apart[b] = 0;
    widen(self, x, y, self->apart);
    for (size_t b = 0; b < self->sim->block_count; b++)
        if (self->largest[b] > 0) least = fmin(least, self->apart[b] / self->largest[b]);
    return isfinite(least) ? least : 0;
}

/* The first of the compared times at which the runs differ by more than `bound`; t_end if there is none. */
static double parting(const simulation *sim, plan fine, plan coarse, const sizes *size, double bound) {
    double t[MOMENTS], found = fine.t_end;
    APP_FREE double *a = app_alloc(2 * MOMENTS * sim->dim, sizeof *a);
    double *b = a + MOMENTS * sim->dim;
    outcome run;
    for (size_t i = 0; i < MOMENTS; i++) t[i] = fine.t_end * ((double)(i + 1) / MOMENTS);
    fine.times = coarse.times = t;
    fine.count = coarse.count = MOMENTS;
    fine.control.observe = coarse.control.observe = NULL;
    if (integrate(sim, &fine, sim->scene.state, a, &run, NULL) == LG_OK &&
        integrate(sim, &coarse, sim->scene.state, b, &run, NULL) == LG_OK)
        for (size_t i = MOMENTS; i-- > 0;)
            if (difference(size, a + i * sim->dim, b + i * sim->dim) > bound) found = t[i];
    return found;
}

void horizon_warn(const simulation *sim, const plan *how, const double *y) {
    const double coarse_tolerance = 10 * how->control.rtol, bound = fmax(TOLD, sqrt(coarse_tolerance));
    plan coarse = *how;
    outcome run;
    if (how->control.steps > 0 || coarse_tolerance >= 1) return;
    sizes size = sizes_of(sim);
    APP_FREE double *end = app_alloc(sim->dim, sizeof *end);
    (void)look_at_sizes(&size, 0, 0, sim->scene.state);
    coarse.control.rtol = coarse_tolerance;
    coarse.control.atol *= 10;
    coarse.times = &how->t_end;
    coarse.count = 1;
    coarse.control.observe = look_at_sizes;
    coarse.control.observer = &size;
    if (integrate(sim, &coarse, sim->scene.state, end, &run, NULL) == LG_OK) {
        const double apart = difference(&size, y, end);
        if (apart > bound)
            app_warn(sim->self,
                     "from t = %.4g on the result is not reliable: a run at ten times the tolerance differs "
                     "from it by %.2g of the size of the state there, and by %.2g at the end; give a "
                     "smaller --tolerance, or ask for statistics of many runs (--ensemble)",
                     parting(sim, *how, coarse, &size, bound), bound, apart);
    }
}
