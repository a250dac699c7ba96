/* Errors of free runs of a learned machine. */
#include <math.h>
#include <string.h>

#include "core/median.h"
#include "machine/files/recipe.h"

const char *const lg_run_error_names[LG_RUN_ERRORS] = {
    [LG_ERROR_LINE] = "line",           [LG_ERROR_ANGLE] = "angle",
    [LG_ERROR_DIRECTION] = "direction", [LG_ERROR_ROTATION] = "rotation",
    [LG_ERROR_VELOCITY] = "velocity",   [LG_ERROR_ACCELERATION] = "acceleration"};

/* ---- runs in memory ---- */

/* Predicted runs, which a function of type judge then compares with the log. */
typedef struct runs {
    const lg_machine *machine;
    const lg_machine_log *log, *from; /* runs are compared with `log`; they begin in states of `from` */
    size_t steps, count;
    const size_t *start; /* (count) rows of the log where the runs begin */
    double *q, *v;       /* predictions (count, steps + 1, ...) */
} runs;
typedef void judge(void *user, const runs *r);

static lg_status judge_runs(const lg_context *context, lg_runner *runner, const void *model, runs *r,
                            judge *look, void *user, lg_error *error) {
    const size_t points = r->count * (r->steps + 1), nq = r->machine->positions;
    LG_TRY_SCRATCH(double, q, context, points *(nq + r->machine->velocities), lg_no_memory(error));
    r->q = q;
    r->v = q + points * nq;
    LG_TRY(runner(model, r->from, r->start, r->count, r->steps, r->q, r->v, error));
    look(user, r);
    return LG_OK;
}

static lg_status free_run(const lg_learned_machine *m, const lg_machine_log *log, const size_t *start,
                          size_t count, size_t steps, double *q, double *v, lg_error *error) {
    return lg_machine_free_run(m->context, m->machine, m->theta, m->scheme, m->substeps, log, start, count,
                               steps, q, v, error);
}

/* ---- sums of squares ---- */

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

/* The angle between two unit vectors or rotations, from their chord: 2 sin(angle/2) = |a - b| of vectors,
 * sqrt 8 sin(angle/2) = |A - B|_F of rotation matrices. `diameter` is 2 or sqrt 8. */
static double angle_of(const double *a, const double *b, int count, double diameter) {
    double square = 0.0;
    for (int i = 0; i < count; i++) square += (a[i] - b[i]) * (a[i] - b[i]);
    return 2.0 * asin(fmin(1.0, sqrt(square) / diameter));
}

/* Adds the errors of one point; numbers that the data do not have (NaN) are skipped. The prediction must not
 * contain NaN: count_as_infinite is called first. */
static void add_point(const lg_machine *machine, const double *q, const double *v, const double *given_q,
                      const double *given_v, sums *out) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        for (uint32_t k = 0; k < row->places && !machine->accelerations; k++)
            add(&out[kind == LG_COORDINATE_ANGLE ? LG_ERROR_ANGLE : LG_ERROR_LINE],
                kind == LG_COORDINATE_ANGLE ? lg_machine_wrap(q[k] - given_q[k]) : q[k] - given_q[k]);
        if (row->directions > 0 && !isnan(given_q[0]))
            add(&out[LG_ERROR_DIRECTION], angle_of(q, given_q, 3, 2.0));
        if (row->rotations > 0 && !isnan(given_q[row->places]))
            add(&out[LG_ERROR_ROTATION], angle_of(q + row->places, given_q + row->places, 9, sqrt(8.0)));
        for (uint32_t k = 0; k < row->velocities; k++)
            add(&out[machine->accelerations ? LG_ERROR_ACCELERATION : LG_ERROR_VELOCITY], v[k] - given_v[k]);
        q += lg_coordinate_positions(kind), given_q += lg_coordinate_positions(kind);
        v += row->velocities, given_v += row->velocities;
    }
}

/* ---- errors up to a horizon ---- */

/* Rows, `every` rows apart in each part, from which a run of `steps` intervals stays within the part:
 * complete rows, or those from whose start_rows last rows the state can be estimated. */
static size_t find_starts(const lg_machine *machine, const lg_machine_log *log, size_t start_rows,
                          size_t steps, size_t every, size_t *out) {
    const bool estimated = start_rows > 0;
    const size_t before = estimated ? start_rows - 1 : 0;
    size_t count = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row + steps < log->first[p + 1]; row += every)
            if (row >= log->first[p] + before &&
                lg_machine_log_complete(machine, log, row - before, estimated) &&
                lg_machine_log_complete(machine, log, row, estimated))
                out[count++] = row;
    return count;
}

/* The largest number of steps that fit into `seconds` from any row of the log; 0: all intervals are longer,
 * or no part has two rows. */
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

/* Adds the errors of run i up to `seconds`. With `unchanged` the prediction is that nothing changes. */
static void judge_run(const runs *r, size_t i, double seconds, bool unchanged, sums *out) {
    const size_t nq = r->machine->positions, nv = r->machine->velocities;
    for (size_t step = 1; step <= r->steps; step++) {
        const size_t row = r->start[i] + step, at = i * (r->steps + 1) + (unchanged ? 0 : step);
        if (r->log->t[row] - r->log->t[r->start[i]] > seconds * (1 + 1e-9)) break;
        add_point(r->machine, r->q + at * nq, r->v + at * nv, r->log->q + row * nq,
                  lg_log_shown(r->log) + row * nv, out);
    }
}

/* Replaces predictions that are not finite by 1e300, whose squared errors overflow, so that they are not
 * skipped. */
static void count_as_infinite(double *x, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!isfinite(x[i])) x[i] = 1e300;
}

typedef struct horizon {
    lg_horizon *out;
    double *own; /* (errors, runs): the root mean square of each run */
} horizon;

static void judge_horizon(void *user, const runs *r) {
    const horizon *h = user;
    lg_horizon *out = h->out;
    sums pooled[LG_RUN_ERRORS] = {{0, 0}}, unchanged[LG_RUN_ERRORS] = {{0, 0}};
    count_as_infinite(r->q, r->count * (r->steps + 1) * (r->machine->positions + r->machine->velocities));
    for (size_t i = 0; i < r->count; i++) {
        sums each[LG_RUN_ERRORS] = {{0, 0}};
        judge_run(r, i, out->seconds, false, each);
        judge_run(r, i, out->seconds, true, unchanged);
        for (int e = 0; e < LG_RUN_ERRORS; e++) {
            pooled[e].sum += each[e].sum;
            pooled[e].count += each[e].count;
            h->own[(size_t)e * r->count + i] = root(&each[e]);
        }
    }
    for (int e = 0; e < LG_RUN_ERRORS; e++) {
        out->pooled[e] = root(&pooled[e]);
        out->unchanged[e] = root(&unchanged[e]);
        out->median[e] = lg_median(h->own + (size_t)e * r->count, r->count);
    }
}

lg_status lg_horizon_of(const lg_context *context, const lg_machine *machine, lg_runner *runner,
                        const void *user, size_t start_rows, const lg_machine_log *from,
                        const lg_machine_log *log, double seconds, size_t every, lg_horizon *out,
                        lg_error *error) {
    *out = (lg_horizon){.seconds = seconds};
    for (int e = 0; e < LG_RUN_ERRORS; e++) out->pooled[e] = out->median[e] = out->unchanged[e] = (double)NAN;
    LG_TRY_SCRATCH(size_t, start, context, log->rows, lg_no_memory(error));
    LG_TRY_SCRATCH(double, own, context, log->rows *LG_RUN_ERRORS, lg_no_memory(error));
    horizon h = {out, own};
    runs r = {
        .machine = machine, .log = log, .from = from, .steps = most_steps(log, seconds), .start = start};
    if (r.steps > 0) out->starts = r.count = find_starts(machine, from, start_rows, r.steps, every, start);
    return r.count > 0 ? judge_runs(context, runner, user, &r, judge_horizon, &h, error) : LG_OK;
}

/* ---- estimated starts ---- */

lg_status lg_started_log_create(const lg_learned_machine *model, const lg_machine_log *log, const size_t *row,
                                size_t count, lg_started_log *out, lg_error *error) {
    const lg_context *context = model->context;
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    *out = (lg_started_log){.log = *log, .context = context};
    out->log.q = out->q = lg_alloc(context, log->rows * (nq + nv), sizeof *out->q);
    LG_TRY_SCRATCH(double, q, context, count *(nq + nv), lg_no_memory(error));
    if (out->q == NULL) return lg_no_memory(error);
    double *v = q + count * nq;
    lg_machine_log guessed = *log;
    const uint32_t rows = model->start_rows;
    out->log.v = out->v = out->q + log->rows * nq;
    if (machine->accelerations) { /* the guesses of the log are not good enough for the model's own starts */
        LG_TRY(lg_machine_estimate_states(context, machine, model->theta, model->scheme, model->substeps, log,
                                          rows, out->q, out->v, error));
        guessed.q = out->q, guessed.v = out->v;
    }
    LG_TRY(lg_machine_estimate_starts(context, machine, model->theta, model->scheme, model->substeps,
                                      &guessed, row, count, rows, q, v, error));
    for (size_t i = 0; i < count; i++) {
        memcpy(out->q + row[i] * nq, q + i * nq, nq * sizeof *q);
        memcpy(out->v + row[i] * nv, v + i * nv, nv * sizeof *v);
    }
    return LG_OK;
}

void lg_started_log_destroy(lg_started_log *started) {
    lg_free(started->context, started->q);
    started->q = started->v = NULL;
}

/* ---- runs and horizons of a model ---- */

/* Copies the last steps + 1 points of each run from `all`, whose runs begin `before` rows earlier. */
static void keep_ends(const double *all, size_t count, size_t before, size_t steps, size_t n, double *out) {
    for (size_t i = 0; i < count; i++)
        memcpy(out + i * (steps + 1) * n, all + (i * (before + steps + 1) + before) * n,
               (steps + 1) * n * sizeof *out);
}

lg_status lg_machine_run(const void *user, const lg_machine_log *log, const size_t *start, size_t count,
                         size_t steps, double *q, double *v, lg_error *error) {
    const lg_learned_machine *model = user;
    const lg_context *context = model->context;
    const lg_machine *m = model->machine;
    const size_t nq = m->positions, before = model->start_rows > 0 ? model->start_rows - 1 : 0,
                 points = count * (before + steps + 1);
    LG_CLEAN(lg_started_log_destroy) lg_started_log begun = {.context = context};
    if (model->start_rows == 0) return free_run(model, log, start, count, steps, q, v, error);
    LG_TRY_SCRATCH(size_t, from, context, count, lg_no_memory(error));
    LG_TRY_SCRATCH(double, all, context, points *(nq + m->velocities), lg_no_memory(error));
    for (size_t i = 0; i < count; i++) from[i] = start[i] - before;
    LG_TRY(lg_started_log_create(model, log, from, count, &begun, error));
    LG_TRY(free_run(model, &begun.log, from, count, before + steps, all, all + points * nq, error));
    keep_ends(all, count, before, steps, nq, q);
    keep_ends(all + points * nq, count, before, steps, m->velocities, v);
    return LG_OK;
}

lg_status lg_machine_horizon(const lg_learned_machine *model, const lg_machine_log *log, double seconds,
                             size_t every, lg_horizon *out, lg_error *error) {
    return lg_horizon_of(model->context, model->machine, lg_machine_run, model, model->start_rows, log, log,
                         seconds, every, out, error);
}

lg_status lg_machine_states(const lg_learned_machine *model, const lg_machine_log *log, size_t every,
                            lg_started_log *out, lg_error *error) {
    const lg_context *context = model->context;
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, n = nq + nv;
    *out = (lg_started_log){.log = *log, .context = context};
    out->log.q = out->q = lg_alloc(context, log->rows * n, sizeof *out->q);
    LG_TRY_SCRATCH(double, states, context, log->rows *n, lg_no_memory(error));
    LG_TRY_SCRATCH(size_t, start, context, log->rows, lg_no_memory(error));
    if (out->q == NULL) return lg_no_memory(error);
    out->log.v = out->v = out->q + log->rows * nq;
    memcpy(out->q, log->q, log->rows * nq * sizeof *out->q);
    for (size_t i = 0; i < log->rows * nv; i++) out->v[i] = (double)NAN;
    const size_t count = find_starts(machine, log, model->start_rows, 0, every, start);
    double *v = states + count * nq;
    if (count > 0) LG_TRY(lg_machine_run(model, log, start, count, 0, states, v, error));
    for (size_t i = 0; i < count; i++) {
        memcpy(out->q + start[i] * nq, states + i * nq, nq * sizeof *v);
        memcpy(out->v + start[i] * nv, v + i * nv, nv * sizeof *v);
    }
    return LG_OK;
}

/* ---- the rows that estimate a start ---- */

/* The sum of the logarithms of the errors up to horizons of 2, 8, 32, ... rows. Errors below a thousandth of
 * the motion count alike: logs without noise do not show how many rows logs with noise need. */
static void judge_rows(void *user, const runs *r) {
    static const double nothing = 1e-3;
    double *score = user;
    count_as_infinite(r->q, r->count * (r->steps + 1) * (r->machine->positions + r->machine->velocities));
    for (size_t steps = 2; steps <= r->steps; steps *= 4) {
        sums pooled[LG_RUN_ERRORS] = {{0, 0}}, unchanged[LG_RUN_ERRORS] = {{0, 0}};
        for (size_t i = 0; i < r->count; i++) {
            const double seconds = r->log->t[r->start[i] + steps] - r->log->t[r->start[i]];
            judge_run(r, i, seconds, false, pooled);
            judge_run(r, i, seconds, true, unchanged);
        }
        for (int e = 0; e < LG_RUN_ERRORS; e++)
            if (pooled[e].sum > 0) *score += log(hypot(root(&pooled[e]), nothing * root(&unchanged[e])));
    }
}

lg_status lg_machine_choose_start_rows(lg_learned_machine *model, const lg_machine_log *log,
                                       lg_error *error) {
    enum { STEPS = 32, LONG = 128, STARTS = 100, MOST_ROWS = 200, PART = 8 };
    /* Another number of rows than the usual one is taken only if it lowers the error by this much. */
    static const double clear = 0.05, parts[] = {1, 2, 4, 0.5, 0.32, 0.2, 0.12, 0.08};
    const lg_context *context = model->context;
    const lg_machine *machine = model->machine;
    const size_t usual = lg_start_rows(machine), every = 1 + log->rows / STARTS,
                 part = log->parts > 0 ? log->rows / log->parts / PART : 0,
                 most = part < MOST_ROWS ? part : MOST_ROWS;
    lg_learned_machine tried = *model;
    double best = INFINITY;
    LG_TRY_SCRATCH(size_t, start, context, log->rows, lg_no_memory(error));
    runs r = {
        .machine = machine, .log = log, .from = log, .steps = most < LONG ? STEPS : LONG, .start = start};
    model->start_rows = (uint32_t)usual;
    r.count = find_starts(machine, log, most > usual ? most : usual, r.steps, every, start);
    for (size_t i = 0; i < LG_COUNT(parts) && r.count > 0; i++) {
        double score = 0;
        tried.start_rows = (uint32_t)(parts[i] * (double)usual + 0.5);
        if (tried.start_rows > most && parts[i] > 1) continue;
        LG_TRY(judge_runs(context, lg_machine_run, &tried, &r, judge_rows, &score, error));
        if (!(score < best - clear)) continue;
        best = score;
        model->start_rows = tried.start_rows;
    }
    return LG_OK;
}

/* ---- the range of states that no column shows ---- */

lg_status lg_machine_widen_range(const lg_learned_machine *model, const lg_machine_problem *problem,
                                 lg_machine_range *range, lg_error *error) {
    enum { MOST = 1 << 20 };
    const lg_context *context = model->context;
    lg_machine states = *model->machine;
    const size_t nq = states.positions, nv = states.velocities, rows = problem->window,
                 all = problem->windows - problem->validation,
                 count = all * rows < MOST ? all : MOST / rows + 1;
    bool known = true;
    for (size_t i = 0; i < nq + nv; i++) known = known && range->low[i] <= range->high[i];
    if (known || count == 0) return LG_OK;
    LG_CLEAN(lg_started_log_destroy) lg_started_log begun = {.context = context};
    lg_machine_range found;
    LG_TRY_SCRATCH(double, q, context, count *rows *(nq + nv), lg_no_memory(error));
    LG_TRY_SCRATCH(size_t, start, context, count, lg_no_memory(error));
    double *v = q + count * rows * nq;
    for (size_t i = 0; i < count; i++) start[i] = problem->start[lg_spread(i, all, count)];
    LG_TRY(lg_started_log_create(model, &problem->log, start, count, &begun, error));
    LG_TRY(free_run(model, &begun.log, start, count, rows - 1, q, v, error));
    lg_machine_log shown = {.rows = count * rows, .q = q, .v = v};
    if (states.accelerations) /* v of a run has accelerations */
        shown.rows = begun.log.rows, shown.q = begun.q, shown.v = begun.v;
    states.accelerations = false, states.input_count = 0;
    lg_machine_find_range(&states, &shown, &found);
    for (size_t i = 0; i < nq + nv; i++)
        if (range->low[i] > range->high[i] && isfinite(found.low[i]) && isfinite(found.high[i]))
            range->low[i] = found.low[i], range->high[i] = found.high[i];
    return LG_OK;
}

/* ---- windows ---- */

/* Squared difference of two positions a and b in the order of logs, summed over coordinates: the mean square
 * of a coordinate's places, and the squared angle of its direction or rotation. Numbers missing in b count as
 * 0. */
static double position_loss(const lg_machine *machine, const double *a, const double *b) {
    double sum = 0.0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_coordinate_row *row = lg_coordinate_row_of(kind);
        double square = 0.0, angle = 0.0;
        for (uint32_t k = 0; k < row->places; k++) {
            const double e = kind == LG_COORDINATE_ANGLE ? lg_machine_wrap(a[k] - b[k]) : a[k] - b[k];
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

static void judge_windows(void *user, const runs *r) {
    const size_t nq = r->machine->positions, nv = r->machine->velocities, points = r->steps + 1;
    double sum = 0.0, *out = user;
    for (size_t i = 0; i < r->count; i++)
        for (size_t j = 1; j < points; j++) {
            const double *a = r->q + (i * points + j) * nq, *b = r->log->q + (r->start[i] + j) * nq;
            const double *va = r->v + (i * points + j) * nv, *vb = r->log->v + (r->start[i] + j) * nv;
            double speeds = 0.0;
            size_t measured = 0;
            for (size_t k = 0; k < nv; k++)
                if (!isnan(vb[k])) speeds += (va[k] - vb[k]) * (va[k] - vb[k]), measured++;
            if (measured > 0) sum += speeds / (double)measured;
            sum += position_loss(r->machine, a, b);
        }
    *out = sum / ((double)r->count * (double)r->steps);
}

lg_status lg_machine_window_loss(const lg_learned_machine *model, const lg_machine_log *log, uint32_t window,
                                 double *out, lg_error *error) {
    *out = (double)NAN;
    LG_TRY_SCRATCH(size_t, start, model->context, log->rows, lg_no_memory(error));
    runs r = {.machine = model->machine, .log = log, .from = log, .steps = window - 1, .start = start};
    if (!model->machine->accelerations)
        r.count = lg_machine_windows(model->machine, log, window, 1, false, start);
    return r.count > 0 ? judge_runs(model->context, lg_machine_run, model, &r, judge_windows, out, error)
                       : LG_OK;
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

static void judge_residuals(void *user, const runs *r) {
    const lg_machine *machine = r->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    lg_machine_noise *out = user;
    sums positions[LG_MACHINE_COORDINATES] = {{0, 0}}, velocities[LG_MACHINE_COORDINATES] = {{0, 0}};
    for (size_t i = 0; i < r->count; i++)
        for (size_t j = 1; j <= r->steps; j++) {
            const size_t at = i * (r->steps + 1) + j, row = r->start[i] + j;
            add_residuals(machine, r->q + at * nq, r->v + at * nv, r->log->q + row * nq, r->log->v + row * nv,
                          positions, velocities);
        }
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        out->position[i] = root(&positions[i]), out->velocity[i] = root(&velocities[i]);
}

lg_status lg_machine_residuals(const lg_learned_machine *model, const lg_machine_problem *problem,
                               lg_machine_noise *out, lg_error *error) {
    runs r = {.machine = model->machine,
              .log = &problem->log,
              .from = &problem->log,
              .steps = problem->window - 1,
              .count = problem->windows - problem->validation,
              .start = problem->start};
    return judge_runs(model->context, lg_machine_run, model, &r, judge_residuals, out, error);
}
