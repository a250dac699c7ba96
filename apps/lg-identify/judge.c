/* Errors of free runs. */
#include "lg-identify/runs.h"

#include <math.h>
#include <string.h>

const char *const identify_error_names[IDENTIFY_ERRORS] = {[ERROR_LINE] = "line",
                                                           [ERROR_ANGLE] = "angle",
                                                           [ERROR_DIRECTION] = "direction",
                                                           [ERROR_ROTATION] = "rotation",
                                                           [ERROR_VELOCITY] = "velocity"};

typedef struct sums {
    double sum;
    size_t count;
} sums;

static void add(sums *s, double error) {
    if (isnan(error)) return;
    s->sum += error * error;
    s->count++;
}

static double root(const sums *s) {
    return s->count > 0 ? sqrt(s->sum / (double)s->count) : (double)NAN;
}

/* Angles from chords |a - b| = 2 sin(angle/2) of unit vectors, |A - B|_F = sqrt 8 sin(angle/2). */
static double angle_of(const double *a, const double *b, int count, double diameter) {
    double square = 0.0;
    for (int i = 0; i < count; i++) square += (a[i] - b[i]) * (a[i] - b[i]);
    return 2.0 * asin(fmin(1.0, sqrt(square) / diameter));
}

/* Adds the errors of one point; NaN of the data is left out, NaN of the prediction is infinite. */
static void add_point(const lg_machine *machine, const double *q, const double *v, const double *given_q,
                      const double *given_v, sums *out) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        for (uint32_t k = 0; k < row->places; k++)
            add(&out[kind == LG_COORDINATE_ANGLE ? ERROR_ANGLE : ERROR_LINE],
                kind == LG_COORDINATE_ANGLE ? identify_wrap(q[k] - given_q[k]) : q[k] - given_q[k]);
        if (row->directions > 0) add(&out[ERROR_DIRECTION], angle_of(q, given_q, 3, 2.0));
        if (row->rotations > 0 && !isnan(given_q[row->places]))
            add(&out[ERROR_ROTATION], angle_of(q + row->places, given_q + row->places, 9, sqrt(8.0)));
        for (uint32_t k = 0; k < row->velocities; k++) add(&out[ERROR_VELOCITY], v[k] - given_v[k]);
        q += lg_coordinate_positions(kind), given_q += lg_coordinate_positions(kind);
        v += row->velocities, given_v += row->velocities;
    }
}

double identify_position_loss(const lg_machine *machine, const double *a, const double *b) {
    double sum = 0.0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        double square = 0.0, angle = 0.0;
        for (uint32_t k = 0; k < row->places; k++) {
            const double e = kind == LG_COORDINATE_ANGLE ? identify_wrap(a[k] - b[k]) : a[k] - b[k];
            square += isnan(b[k]) ? 0.0 : e * e / row->places;
        }
        if (row->directions > 0 && !isnan(b[0])) angle = angle_of(a, b, 3, 2.0);
        if (row->rotations > 0 && !isnan(b[row->places]))
            angle = angle_of(a + row->places, b + row->places, 9, sqrt(8.0));
        sum += square + angle * angle;
        a += lg_coordinate_positions(kind), b += lg_coordinate_positions(kind);
    }
    return sum;
}

/* Rows from which a run of so many steps fits into a part, `every` rows apart. */
static size_t find_starts(const lg_machine *machine, const lg_machine_log *log, size_t steps, size_t every,
                          size_t *out) {
    size_t count = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row + steps < log->first[p + 1]; row += every)
            if (lg_machine_log_complete(machine, log, row, false)) out[count++] = row;
    return count;
}

/* The most steps within `seconds` of any row of the log; 0: the log is shorter. */
static size_t most_steps(const lg_machine_log *log, double seconds) {
    size_t most = 0;
    for (size_t p = 0; p < log->parts; p++) {
        size_t end = log->first[p];
        for (size_t row = log->first[p]; row < log->first[p + 1]; row++) {
            while (end + 1 < log->first[p + 1] && log->t[end + 1] - log->t[row] <= seconds * (1 + 1e-9))
                end++;
            if (end - row > most) most = end - row;
        }
    }
    return most;
}

typedef struct judging {
    const lg_machine *machine;
    const lg_machine_log *log;
    size_t steps, count;
    const size_t *start;
    const double *q, *v; /* (count, steps + 1, ...) */
    double seconds;
} judging;

/* The errors of run i, or of "nothing changes". */
static void judge_run(const judging *j, size_t i, bool unchanged, sums *out) {
    const size_t nq = j->machine->positions, nv = j->machine->velocities;
    for (size_t step = 1; step <= j->steps; step++) {
        const size_t row = j->start[i] + step, at = i * (j->steps + 1) + (unchanged ? 0 : step);
        if (j->log->t[row] - j->log->t[j->start[i]] > j->seconds * (1 + 1e-9)) break;
        add_point(j->machine, j->q + at * nq, j->v + at * nv, j->log->q + row * nq, j->log->v + row * nv,
                  out);
    }
}

static void judge_all(const judging *j, identify_horizon *out) {
    sums pooled[IDENTIFY_ERRORS] = {{0, 0}}, unchanged[IDENTIFY_ERRORS] = {{0, 0}};
    APP_FREE double *own = app_alloc(j->count * IDENTIFY_ERRORS, sizeof *own);
    for (size_t i = 0; i < j->count; i++) {
        sums each[IDENTIFY_ERRORS] = {{0, 0}};
        judge_run(j, i, false, each);
        judge_run(j, i, true, unchanged);
        for (int e = 0; e < IDENTIFY_ERRORS; e++) {
            pooled[e].sum += each[e].sum;
            pooled[e].count += each[e].count;
            own[(size_t)e * j->count + i] = root(&each[e]);
        }
    }
    for (int e = 0; e < IDENTIFY_ERRORS; e++) {
        out->pooled[e] = root(&pooled[e]);
        out->unchanged[e] = root(&unchanged[e]);
        out->median[e] = app_median(own + (size_t)e * j->count, j->count);
    }
}

/* A prediction that is not finite is not left out: its errors overflow. */
static void count_as_infinite(double *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!isfinite(x[i])) x[i] = 1e300;
}

void identify_horizon_errors_of(const lg_machine *machine, identify_runner *runner, void *user,
                                const lg_machine_log *log, double seconds, size_t every,
                                identify_horizon *out) {
    const size_t steps = most_steps(log, seconds);
    *out = (identify_horizon){.seconds = seconds};
    for (int e = 0; e < IDENTIFY_ERRORS; e++)
        out->pooled[e] = out->median[e] = out->unchanged[e] = (double)NAN;
    APP_FREE size_t *start = app_alloc(log->rows, sizeof *start);
    out->starts = steps > 0 ? find_starts(machine, log, steps, every, start) : 0;
    if (out->starts == 0) return;
    const size_t points = out->starts * (steps + 1);
    APP_FREE double *q = app_alloc(points * machine->positions, sizeof *q);
    APP_FREE double *v = app_alloc(points * machine->velocities, sizeof *v);
    runner(user, log, start, out->starts, steps, q, v);
    count_as_infinite(q, points * machine->positions);
    count_as_infinite(v, points * machine->velocities);
    const judging j = {machine, log, steps, out->starts, start, q, v, seconds};
    judge_all(&j, out);
}

/* ---- runs of a model ---- */

enum { BEFORE = IDENTIFY_START_ROWS - 1 }; /* rows before a start, where positions alone are measured */

typedef struct model_runner {
    const app *app;
    const identify_model *model;
    const lg_machine_log *log;
} model_runner;

static void run_model(void *user, const lg_machine_log *log, const size_t *start, size_t count, size_t steps,
                      double *q, double *v) {
    const model_runner *r = user;
    identify_run(r->app, r->model, log, start, count, steps, q, v);
}

/* Of runs over `steps` intervals after those before the start the last steps + 1 points. */
static void keep_ends(const double *runs, size_t count, size_t steps, size_t n, double *out) {
    for (size_t i = 0; i < count; i++)
        memcpy(out + i * (steps + 1) * n, runs + (i * (BEFORE + steps + 1) + BEFORE) * n,
               (steps + 1) * n * sizeof *out);
}

static void run_from_positions(void *user, const lg_machine_log *marked, const size_t *start, size_t count,
                               size_t steps, double *q, double *v) {
    const model_runner *r = user;
    const size_t nq = r->model->machine->positions, nv = r->model->machine->velocities,
                 points = count * (BEFORE + steps + 1);
    APP_CLEAN(identify_started_release) identify_started begun;
    APP_FREE size_t *from = app_alloc(count, sizeof *from);
    APP_FREE double *all_q = app_alloc(points * nq, sizeof *all_q);
    APP_FREE double *all_v = app_alloc(points * nv, sizeof *all_v);
    (void)marked;
    for (size_t i = 0; i < count; i++) from[i] = start[i] - BEFORE;
    identify_with_starts(r->app, r->model, r->log, from, count, &begun);
    identify_run(r->app, r->model, &begun.log, from, count, BEFORE + steps, all_q, all_v);
    keep_ends(all_q, count, steps, nq, q);
    keep_ends(all_v, count, steps, nv, v);
}

/* Velocities are there, as 0, where a run can start. */
static double *mark_starts(const lg_machine *machine, const lg_machine_log *log, size_t every) {
    const size_t nv = machine->velocities;
    double *v = app_alloc(log->rows * nv, sizeof *v);
    for (size_t i = 0; i < log->rows * nv; i++) v[i] = (double)NAN;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row < log->first[p + 1]; row += every) {
            const bool starts =
                row >= log->first[p] + BEFORE && lg_machine_log_complete(machine, log, row - BEFORE, true);
            for (size_t k = 0; starts && k < nv; k++) v[row * nv + k] = 0;
        }
    return v;
}

void identify_horizon_errors(const app *self, const identify_model *model, const lg_machine_log *log,
                             double seconds, size_t every, identify_horizon *out) {
    model_runner runner = {self, model, log};
    lg_machine_log marked = *log;
    APP_FREE double *v = model->positions ? mark_starts(model->machine, log, every) : NULL;
    if (v != NULL) marked.v = v;
    identify_horizon_errors_of(model->machine, v != NULL ? run_from_positions : run_model, &runner, &marked,
                               seconds, every, out);
    if (v == NULL) return;
    out->pooled[ERROR_VELOCITY] = out->median[ERROR_VELOCITY] = out->unchanged[ERROR_VELOCITY] = (double)NAN;
}

/* ---- residuals of windows ---- */

static void add_residuals(const lg_machine *machine, const double *q, const double *v, const double *given_q,
                          const double *given_v, sums *positions, sums *velocities) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        const uint32_t count = lg_coordinate_positions(kind);
        for (uint32_t k = 0; k < count; k++) {
            const double unit = k >= row->places && row->rotations > 0 ? sqrt(0.5) : 1.0;
            add(&positions[i], unit * (q[k] - given_q[k]));
        }
        for (uint32_t k = 0; k < row->velocities; k++) add(&velocities[i], v[k] - given_v[k]);
        q += count, given_q += count;
        v += row->velocities, given_v += row->velocities;
    }
}

static void residuals_of(const lg_machine_problem *problem, size_t count, const double *q, const double *v,
                         identify_residual *out) {
    const lg_machine *machine = problem->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    sums positions[LG_MACHINE_COORDINATES] = {{0, 0}}, velocities[LG_MACHINE_COORDINATES] = {{0, 0}};
    for (size_t i = 0; i < count; i++)
        for (uint32_t j = 1; j < problem->window; j++) {
            const size_t at = i * problem->window + j, row = problem->start[i] + j;
            add_residuals(machine, q + at * nq, v + at * nv, problem->log.q + row * nq,
                          problem->log.v + row * nv, positions, velocities);
        }
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        out[i] = (identify_residual){root(&positions[i]), root(&velocities[i])};
}

lg_status identify_residuals(const app *self, const identify_model *model, const lg_machine_problem *problem,
                             identify_residual *out, lg_error *error) {
    const lg_machine *machine = model->machine;
    const size_t count = problem->windows - problem->validation, points = count * problem->window;
    APP_FREE double *q = app_alloc(points * machine->positions, sizeof *q);
    APP_FREE double *v = app_alloc(points * machine->velocities, sizeof *v);
    LG_TRY(lg_machine_free_run(self->context, machine, model->theta, model->scheme, model->substeps,
                               &problem->log, problem->start, count, problem->window - 1, q, v, error));
    residuals_of(problem, count, q, v, out);
    return LG_OK;
}
