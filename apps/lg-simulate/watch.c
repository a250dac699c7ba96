/* What is observed along a run: invariants, distance from the manifold, step sizes. */
#include "lg-simulate/simulate.h"

#include <math.h>
#include <string.h>

enum { TRACE_MAX = 4096 };

/* The larger number; NaN if one of them is NaN. */
static double larger(double a, double b) {
    return isnan(a) || a > b ? a : b; /* if b is NaN, a > b is false */
}

static double *grown(const double *old, size_t used, size_t room) {
    double *new = app_keep(room, sizeof *new);
    if (used > 0) memcpy(new, old, used * sizeof *new);
    return new;
}

/* ---- the trace ---- */

static void merge_rows(double *into, const double *row, size_t width) {
    into[0] = row[0];
    for (size_t i = 1; i < width; i++) into[i] = larger(into[i], row[i]);
}

/* If there is no room, pairs of rows are merged; from then on each row stands for twice as many steps. */
static void trace_add(trace *at, const double *row) {
    const size_t size = at->width * sizeof *row;
    if (at->pending == 0 && at->count == TRACE_MAX) {
        at->count /= 2;
        at->stride *= 2;
        for (size_t i = 0; i < at->count; i++) {
            double *to = at->rows + i * at->width;
            memmove(to, at->rows + 2 * i * at->width, size);
            merge_rows(to, at->rows + (2 * i + 1) * at->width, at->width);
        }
    }
    if (at->pending > 0)
        merge_rows(at->rows + (at->count - 1) * at->width, row, at->width);
    else
        memcpy(at->rows + at->count++ * at->width, row, size);
    at->pending = (at->pending + 1) % at->stride;
}

/* ---- observing ---- */

static double invariant(const watch *self, size_t i, const double *y) {
    return lg_system_invariant(self->sim->system, i, y, self->work);
}

/* Sets self->rest to y with momenta and velocities of zero. These are the second half of R^2n, an R^n behind
 * another factor, the second group of numbers of the other spaces, and all of so(3)*. */
static void put_to_rest(watch *self, const double *y) {
    const lg_space *space = lg_system_space(self->sim->system);
    double *rest = self->rest;
    memcpy(rest, y, self->sim->dim * sizeof *rest);
    for (size_t f = 0; f < space->factors; f++) {
        const size_t count = space->factor[f].count;
        const size_t state = lg_space_kind_entry(space->factor[f].kind)->state;
        const lg_space_kind kind = space->factor[f].kind;
        for (size_t copy = 0; kind != LG_SPACE_RN && copy < count; copy++, rest += state) {
            const size_t first = kind == LG_SPACE_SO3_DUAL ? 0 : kind == LG_SPACE_SO3 ? 9 : state - 3;
            memset(rest + first, 0, (state - first) * sizeof *rest);
        }
        if (kind != LG_SPACE_RN) continue;
        const size_t first = f > 0 ? 0 : count / 2;
        memset(rest + first, 0, (count - first) * sizeof *rest);
        rest += count;
    }
}

/* Updates the largest kinetic energy, H(q, p) - H(q, 0). If a run has gained energy, the energy of the start
 * replaces H(q, p), so that a run that diverges is not compared with its own energy. */
static void look_at_kinetic(watch *self) {
    const double potential = invariant(self, 0, self->rest), kinetic = fabs(self->end[0] - potential);
    self->kinetic = fmax(self->kinetic, fmin(kinetic, fmax(self->start[0] - potential, self->kinetic)));
}

/* Updates the largest distances from the manifold. Returns the distance of y. */
static double look_at_manifold(watch *self, const double *y) {
    const lg_space *space = lg_system_space(self->sim->system);
    const double error = lg_space_manifold_error(space, y);
    put_to_rest(self, y);
    self->manifold = larger(self->manifold, error);
    self->placed = larger(self->placed, lg_space_manifold_error(space, self->rest));
    return error;
}

void watch_begin(watch *self, const simulation *sim, bool traced, bool recorded, const double *y0) {
    *self = (watch){.sim = sim, .traced = traced, .recorded = recorded};
    self->invariants = lg_system_invariants(sim->system);
    self->work = app_keep(lg_system_work_size(sim->system), 1);
    self->start = app_keep(self->invariants, sizeof *self->start);
    self->end = app_keep(self->invariants, sizeof *self->end);
    self->drift = app_keep(self->invariants, sizeof *self->drift);
    self->trace = (trace){.width = 3 + self->invariants, .stride = 1};
    if (traced) self->trace.rows = app_keep((TRACE_MAX + 1) * self->trace.width, sizeof *self->trace.rows);
    self->rest = app_keep(sim->dim, sizeof *self->rest);
    self->energetic = self->invariants > 0 && strcmp(lg_system_invariant_name(sim->system, 0), "energy") == 0;
    watch_again(self, y0);
}

void watch_again(watch *self, const double *y0) {
    for (size_t i = 0; i < self->invariants; i++) {
        self->start[i] = self->end[i] = invariant(self, i, y0);
        self->drift[i] = 0;
    }
    self->manifold = self->placed = self->kinetic = 0;
    (void)look_at_manifold(self, y0);
    if (self->energetic) look_at_kinetic(self);
}

lg_status watch_step(void *user, double t, double h, const double *y) {
    watch *self = user;
    const double begin = app_seconds();
    const double manifold = look_at_manifold(self, y);
    for (size_t i = 0; i < self->invariants; i++) {
        self->end[i] = invariant(self, i, y);
        self->drift[i] = larger(self->drift[i], fabs(self->end[i] - self->start[i]));
    }
    if (self->energetic) look_at_kinetic(self);
    if (self->traced) {
        double *row = self->trace.rows + TRACE_MAX * self->trace.width; /* behind the rows */
        row[0] = t + h;
        row[1] = h;
        row[2] = manifold;
        for (size_t i = 0; i < self->invariants; i++) row[3 + i] = fabs(self->end[i] - self->start[i]);
        trace_add(&self->trace, row);
    }
    if (self->recorded && self->steps == self->room) {
        self->room = self->room > 0 ? 2 * self->room : 1024;
        self->t = grown(self->t, self->steps, self->room);
        self->h = grown(self->h, self->steps, self->room);
    }
    if (self->recorded) {
        self->t[self->steps] = t;
        self->h[self->steps++] = h;
    }
    self->spent += app_seconds() - begin;
    return LG_OK;
}

/* The energy's drift is reported above ENERGY_TOLD times the largest kinetic energy. A method of order 1
 * always loses energy, so it is reported only above the whole kinetic energy. For a body at rest a drift
 * below ENERGY_ROUNDING times the energy is only rounding. */
#define ENERGY_TOLD     0.1
#define ENERGY_ROUNDING 1e-10
/* Constraints of positions are of size 1: |q|^2 = 1, R^T R = 1. The constraint q.p = 0 has the unit of p. */
#define MANIFOLD_TOLD 0.01

bool watch_lost_energy(const watch *self, const lg_scheme *scheme) {
    const double told = scheme->order > 1 ? ENERGY_TOLD : 1;
    return self->energetic &&
           !(self->drift[0] <= fmax(told * self->kinetic, ENERGY_ROUNDING * fabs(self->start[0])));
}

bool watch_left_manifold(const watch *self) {
    return self->placed > MANIFOLD_TOLD;
}

void watch_warn(const watch *self, const plan *how, const outcome *run) {
    const double turn = run->stats.max_angle;
    if (turn > 3.14159265358979323846)
        app_warn(self->sim->self,
                 "a step turns a body by %.3g rad, which is more than pi: the steps are too long for '%s'; "
                 "give more --steps",
                 turn, how->scheme->name);
    const char *remedy = how->control.steps > 0 ? "more --steps" : "a smaller --tolerance";
    if (watch_lost_energy(self, how->scheme))
        app_warn(self->sim->self,
                 "the energy, which is constant, changes by %.3g; the largest kinetic energy is %.3g: the "
                 "result is far from the solution; give %s",
                 self->drift[0], self->kinetic, remedy);
    if (watch_left_manifold(self))
        app_warn(self->sim->self,
                 "the state leaves the manifold: a constraint is violated by %.3g: give %s, or a method that "
                 "stays on it, such as cf4",
                 self->placed, remedy);
}
