/* What a constant force makes of runs: whether a free run integrates an offset, and the forces that the model
 * lacks at each velocity. */
#include <math.h>
#include <string.h>

#include "lg-identify/identify.h"

/* The model with a constant force on each velocity, of a hundredth of the machine's scale of forces. */
typedef struct pushed {
    lg_adaptation to;
    lg_learned_machine model;
} pushed;

static void pushed_destroy(pushed *p) {
    lg_adaptation_destroy(&p->to);
}

/* False: the machine cannot have one, as where its offset is known. */
static bool pushed_create(const app *self, const identify_given *given, pushed *out) {
    static const double part = 0.01;
    const lg_machine *machine = given->model.machine;
    double force[LG_MACHINE_VELOCITIES];
    for (uint32_t k = 0; k < machine->velocities; k++)
        force[k] = part * machine->scales.energy / machine->scales.velocity[k];
    if (lg_adaptation_create(self->context, self->arguments[0], &given->file, "offset", force, &out->to,
                             NULL) != LG_OK)
        return false;
    for (uint32_t k = 0; k < machine->velocities; k++)
        if (lg_adaptation_direction(&out->to, k) == out->to.count) return false;
    out->model = given->model;
    out->model.machine = &out->to.run.machine;
    out->model.theta = out->to.theta;
    return true;
}

/* Pushes velocity k by x hundredths of the scale of forces. */
static void push(pushed *p, uint32_t k, double x) {
    double all[LG_ADAPT_MOST] = {0};
    all[lg_adaptation_direction(&p->to, k)] = x;
    lg_adaptation_move(&p->to, all);
}

/* The force of push(p, k, 1). */
static double force_of(const pushed *p, uint32_t k) {
    return p->to.units[lg_adaptation_direction(&p->to, k)];
}

/* ---- free runs that integrate an offset ---- */

/* Sums over the rows of a column of errors e and of the response s to a constant force. */
typedef struct sums {
    double ee, es, ss, early, late; /* early, late: ss of the second and of the last quarter of each run */
    size_t count, early_count, late_count;
} sums;

static sums add_runs(const lg_machine *machine, const lg_machine_log *log, const double *q,
                     const double *with, const lg_machine_offsets *of) {
    sums out = {0};
    for (lg_log_part part = {0}; lg_log_next(log, &part);) {
        const size_t first = part.first, rows = part.end - first;
        for (size_t i = 0; i < rows; i++) {
            const size_t at = (first + i) * machine->positions + of->position;
            const double off = q[at] - log->q[at], moved = with[at] - q[at],
                         e = of->angle ? lg_machine_wrap(off) : off,
                         s = of->angle ? lg_machine_wrap(moved) : moved;
            if (!isfinite(e) || !isfinite(s)) continue;
            out.ee += e * e, out.es += e * s, out.ss += s * s, out.count++;
            if (4 * i >= rows && 2 * i < rows) out.early += s * s, out.early_count++;
            if (4 * i >= 3 * rows) out.late += s * s, out.late_count++;
        }
    }
    return out;
}

static void look_at(const app *self, const identify_given *given, pushed *p, const identify_runs *runs,
                    const lg_machine_offsets *at, identify_runs *with, identify_offset *out) {
    static const double growth = 1.7;
    const lg_machine_log *log = given->log;
    const lg_machine *machine = given->model.machine;
    const uint32_t velocity = at->velocity;
    push(p, velocity, 1);
    identify_run_log(self, &p->model, log, with);
    push(p, velocity, -1);
    const sums s = add_runs(machine, log, runs->q, with->q, at);
    /* the response to the force still grows at the end, like t or t^2 */
    const bool grows = s.early_count > 0 && s.late_count > 0 &&
                       s.late / (double)s.late_count > growth * growth * s.early / (double)s.early_count;
    if (!(s.ee > 0 && s.ss > 0) || !grows) return;
    const double x = -s.es / s.ss;
    push(p, velocity, x);
    identify_run_log(self, &p->model, log, with);
    push(p, velocity, -x);
    const sums left = add_runs(machine, log, with->q, runs->q, at);
    out->force = x * force_of(p, velocity);
    out->without = sqrt(s.ee / (double)s.count);
    out->with = sqrt(left.ee / (double)left.count);
    out->integrates = out->with < 0.7 * out->without;
}

void identify_find_offsets(const app *self, const identify_given *given, const identify_runs *runs,
                           identify_offset *out) {
    const lg_machine *machine = given->model.machine;
    APP_CLEAN(pushed_destroy) pushed p = {.model = {.machine = NULL}};
    memset(out, 0, LG_MACHINE_COORDINATES * sizeof *out);
    if (!pushed_create(self, given, &p)) return;
    identify_runs with = identify_runs_begin(&given->model, given->log, 0);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        if (at.positions == 1) /* a line or an angle */
            look_at(self, given, &p, runs, &at, &with, &out[at.index]);
}

/* ---- velocities of logs that have positions alone ---- */

lg_started_log identify_slopes(const app *self, const lg_learned_machine *model, const lg_machine_log *log) {
    enum { HALF = 10, LINE = 1 };
    lg_started_log out = {.log = *log};
    if (model->start_rows == 0) return out;
    APP_DO(self, lg_machine_smooth, model->machine, log, HALF, LINE, &out);
    out.log.q = log->q;
    return out;
}

/* ---- forces that the model lacks ---- */

size_t identify_lacking(const app *self, const identify_given *given, double **velocity, double **force) {
    enum { STEPS = 20, MOST = 1500 };
    const lg_machine *machine = given->model.machine;
    const size_t nq = machine->positions, nv = machine->velocities, points = STEPS + 1;
    APP_CLEAN(lg_started_log_destroy) lg_started_log slopes = {.q = NULL};
    APP_CLEAN(pushed_destroy) pushed p = {.model = {.machine = NULL}};
    *velocity = *force = NULL;
    if (machine->accelerations || !pushed_create(self, given, &p)) return 0;
    slopes = identify_slopes(self, &given->model, given->log);
    const lg_machine_log *log = &slopes.log;
    APP_FREE size_t *start = app_alloc(log->rows, sizeof *start);
    const size_t every = log->rows / MOST,
                 count = lg_log_starts(machine, log, 0, STEPS, every > STEPS ? every : STEPS, true, start);
    if (count == 0) return 0;
    APP_FREE double *q = app_alloc(count * points * nq, sizeof *q);
    APP_FREE double *v = app_alloc(count * points * nv, sizeof *v);
    APP_FREE double *with = app_alloc(count * points * nv, sizeof *with);
    APP_FREE double *middle_q = app_alloc(count * nq, sizeof *middle_q);
    double *x = *velocity = app_keep(count * nv, sizeof *x), *f = *force = app_keep(count * nv, sizeof *f);
    identify_run(self, &given->model, log, start, count, STEPS, q, v);
    for (size_t i = 0; i < count; i++) {
        memcpy(middle_q + i * nq, q + (i * points + STEPS / 2) * nq, nq * sizeof *q);
        memcpy(x + i * nv, v + (i * points + STEPS / 2) * nv, nv * sizeof *x);
    }
    identify_values(self, &given->model, count, middle_q, x, NULL, f);
    for (uint32_t k = 0; k < nv; k++) {
        push(&p, k, 1);
        identify_run(self, &p.model, log, start, count, STEPS, NULL, with);
        push(&p, k, -1);
        for (size_t i = 0; i < count; i++) {
            const size_t end = (i * points + STEPS) * nv + k;
            const double change = (with[end] - v[end]) / force_of(&p, k);
            f[i * nv + k] += (log->v[(start[i] + STEPS) * nv + k] - v[end]) / change;
        }
    }
    return count;
}
