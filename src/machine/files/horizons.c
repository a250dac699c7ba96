/* Errors of free runs of a learned machine. */
#include <math.h>
#include <string.h>

#include "core/median.h"
#include "machine/files/choice.h"

const char *const lg_run_error_names[LG_RUN_ERRORS] = {
    [LG_ERROR_LINE] = "line",           [LG_ERROR_ANGLE] = "angle",
    [LG_ERROR_DIRECTION] = "direction", [LG_ERROR_ROTATION] = "rotation",
    [LG_ERROR_VELOCITY] = "velocity",   [LG_ERROR_ACCELERATION] = "acceleration"};

/* ---- errors of a point ---- */

/* The angle between two unit vectors or rotations, from their chord: 2 sin(angle/2) = |a - b| of vectors,
 * sqrt 8 sin(angle/2) = |A - B|_F of rotation matrices. NaN: b is missing. */
static double angle_of(const double *a, const double *b, uint32_t count) {
    double square = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        if (isnan(b[i])) return NAN;
        square += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return 2.0 * asin(fmin(1.0, sqrt(square) / (count == 3 ? 2.0 : sqrt(8.0))));
}

/* A prediction that is not finite is off by 1e300, whose square overflows. */
static double difference(double predicted, double given, bool angle) {
    if (isnan(given)) return NAN;
    if (!isfinite(predicted)) return 1e300;
    return angle ? lg_machine_wrap(predicted - given) : predicted - given;
}

size_t lg_point_errors(const lg_machine *machine, const double *q, const double *v, const double *given_q,
                       const double *given_v, bool turned, lg_point_error *out) {
    const lg_run_error of_v = machine->accelerations ? LG_ERROR_ACCELERATION : LG_ERROR_VELOCITY;
    size_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        const uint32_t places = at.position + at.places, end = at.position + at.positions;
        const lg_run_error of_q = at.angle ? LG_ERROR_ANGLE : LG_ERROR_LINE,
                           attitude = at.rotations > 0 ? LG_ERROR_ROTATION : LG_ERROR_DIRECTION;
        for (uint32_t k = at.position; k < end && !machine->accelerations; k++) {
            const bool whole = turned && k == places;
            const double error =
                whole ? angle_of(q + k, given_q + k, end - k) : difference(q[k], given_q[k], at.angle);
            out[count++] = (lg_point_error){error, at.index, k, k < places ? of_q : attitude};
            if (whole) break;
        }
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
            out[count++] =
                (lg_point_error){difference(v[k], given_v[k], false), at.index, machine->positions + k, of_v};
    }
    return count;
}

/* ---- runs in memory ---- */

typedef struct runs {
    const lg_context *context;
    const lg_machine *machine;
    const lg_machine_log *log; /* with which the runs are compared */
    size_t steps, count;
    const size_t *start; /* (count) rows of the log where the runs begin */
    double *q, *v;       /* predictions (count, steps + 1, ...); q is owned */
} runs;

static void runs_end(runs *r) {
    lg_free(r->context, r->q);
}

static lg_status predict(lg_runner *runner, const void *model, runs *r, lg_error *error) {
    const size_t points = r->count * (r->steps + 1), nq = r->machine->positions;
    runs_end(r);
    r->q = lg_alloc(r->context, points * (nq + r->machine->velocities), sizeof *r->q);
    if (r->q == NULL) return lg_no_memory(error);
    r->v = r->q + points * nq;
    return runner(model, r->log, r->start, r->count, r->steps, r->q, r->v, error);
}

static lg_status free_run(const lg_learned_machine *m, const lg_machine_log *log, const size_t *start,
                          size_t count, size_t steps, double *q, double *v, lg_error *error) {
    return lg_machine_free_run(m->context, m->machine, m->theta, m->scheme, m->substeps, log, start, count,
                               steps, q, v, error);
}

/* Writes the errors of a step of run i. `unchanged`: the prediction is the state at the start of the run. */
static size_t errors_at(const runs *r, size_t i, size_t step, bool unchanged, bool turned,
                        lg_point_error *out) {
    const size_t nq = r->machine->positions, nv = r->machine->velocities, row = r->start[i] + step,
                 at = i * (r->steps + 1) + (unchanged ? 0 : step);
    return lg_point_errors(r->machine, r->q + at * nq, r->v + at * nv, r->log->q + row * nq,
                           lg_log_shown(r->log) + row * nv, turned, out);
}

/* Adds the errors of run i up to `seconds` to the sums of their kinds. */
static void add_run(const runs *r, size_t i, double seconds, bool unchanged, lg_squares *out) {
    lg_point_error e[LG_POINT_ERRORS];
    for (size_t step = 1; step <= r->steps; step++) {
        if (r->log->t[r->start[i] + step] - r->log->t[r->start[i]] > seconds * (1 + 1e-9)) break;
        const size_t count = errors_at(r, i, step, unchanged, true, e);
        for (size_t k = 0; k < count; k++) lg_squares_add(&out[e[k].kind], e[k].error);
    }
}

/* ---- errors up to a horizon ---- */

size_t lg_log_starts(const lg_machine *machine, const lg_machine_log *log, size_t start_rows, size_t steps,
                     size_t every, bool ended, size_t *out) {
    const bool estimated = start_rows > 0;
    const size_t before = estimated ? start_rows - 1 : 0;
    size_t count = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first; row + steps < p.end; row += every)
            if (row >= p.first + before && lg_machine_log_complete(machine, log, row - before, estimated) &&
                lg_machine_log_complete(machine, log, row, estimated) &&
                (!ended || lg_machine_log_complete(machine, log, row + steps, false)))
                out[count++] = row;
    return count;
}

/* The largest number of steps that fit into `seconds` from any row of the log; 0: all intervals are longer,
 * or no part has two rows. */
static size_t most_steps(const lg_machine_log *log, double seconds) {
    size_t most = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);) {
        size_t end = p.first;
        for (size_t row = p.first; row < p.end; row++) {
            while (end + 1 < p.end && log->t[end + 1] - log->t[row] <= seconds * (1 + 1e-9)) end++;
            if (end - row > most) most = end - row;
        }
    }
    return most;
}

/* Sets the errors of a horizon. own (errors, runs): the root mean square of each run. */
static void set_errors(const runs *r, double *own, lg_horizon *out) {
    lg_squares pooled[LG_RUN_ERRORS] = {{0, 0}}, unchanged[LG_RUN_ERRORS] = {{0, 0}};
    for (size_t i = 0; i < r->count; i++) {
        lg_squares each[LG_RUN_ERRORS] = {{0, 0}};
        add_run(r, i, out->seconds, false, each);
        add_run(r, i, out->seconds, true, unchanged);
        for (int e = 0; e < LG_RUN_ERRORS; e++) {
            pooled[e].sum += each[e].sum;
            pooled[e].count += each[e].count;
            own[(size_t)e * r->count + i] = lg_squares_root(&each[e]);
        }
    }
    for (int e = 0; e < LG_RUN_ERRORS; e++) {
        out->pooled[e] = lg_squares_root(&pooled[e]);
        out->unchanged[e] = lg_squares_root(&unchanged[e]);
        out->median[e] = lg_median(own + (size_t)e * r->count, r->count);
    }
}

lg_status lg_horizon_of(const lg_learned_machine *model, lg_runner *runner, const void *user,
                        const lg_machine_log *log, double seconds, size_t every, lg_horizon *out,
                        lg_error *error) {
    const lg_context *context = model->context;
    *out = (lg_horizon){.seconds = seconds};
    for (int e = 0; e < LG_RUN_ERRORS; e++) out->pooled[e] = out->median[e] = out->unchanged[e] = NAN;
    LG_TRY_SCRATCH(size_t, start, context, log->rows, lg_no_memory(error));
    LG_TRY_SCRATCH(double, own, context, log->rows *LG_RUN_ERRORS, lg_no_memory(error));
    LG_CLEAN(runs_end)
    runs r = {context, model->machine, .log = log, .steps = most_steps(log, seconds), .start = start};
    if (r.steps > 0)
        out->starts = r.count =
            lg_log_starts(r.machine, log, model->start_rows, r.steps, every, false, start);
    if (r.count == 0) return LG_OK;
    LG_TRY(predict(runner, user, &r, error));
    set_errors(&r, own, out);
    return LG_OK;
}

/* ---- estimated starts ---- */

lg_status lg_started_log_begin(const lg_context *context, const lg_machine *machine,
                               const lg_machine_log *log, lg_started_log *out, lg_error *error) {
    const size_t nq = machine->positions, n = nq + machine->velocities;
    *out = (lg_started_log){.log = *log, .context = context};
    out->log.q = out->q = lg_alloc(context, log->rows * n, sizeof *out->q);
    if (out->q == NULL) return lg_no_memory(error);
    out->log.v = out->v = out->q + log->rows * nq;
    return LG_OK;
}

lg_status lg_started_log_create(const lg_learned_machine *model, const lg_machine_log *log, const size_t *row,
                                size_t count, lg_started_log *out, lg_error *error) {
    const lg_context *context = model->context;
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    const uint32_t rows = model->start_rows;
    lg_machine_log guessed = *log;
    LG_TRY(lg_started_log_begin(context, machine, log, out, error));
    LG_TRY_SCRATCH(double, q, context, count *(nq + nv), lg_no_memory(error));
    double *v = q + count * nq;
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
    if (model->start_rows == 0) return free_run(model, log, start, count, steps, q, v, error);
    LG_CLEAN(lg_started_log_destroy) lg_started_log begun = {.context = context};
    LG_TRY_SCRATCH(size_t, from, context, count, lg_no_memory(error));
    LG_TRY_SCRATCH(double, all, context, points *(nq + m->velocities), lg_no_memory(error));
    for (size_t i = 0; i < count; i++) from[i] = start[i] - before;
    LG_TRY(lg_started_log_create(model, log, from, count, &begun, error));
    LG_TRY(free_run(model, &begun.log, from, count, before + steps, all, all + points * nq, error));
    keep_ends(all, count, before, steps, nq, q);
    keep_ends(all + points * nq, count, before, steps, m->velocities, v);
    return LG_OK;
}

/* ---- the rows that estimate a start ---- */

/* The sum of the logarithms of the errors up to horizons of 2, 8, 32, ... rows. Errors below a thousandth of
 * the motion count alike: logs without noise do not show how many rows logs with noise need. */
static double score_of(const runs *r) {
    static const double nothing = 1e-3;
    double score = 0;
    for (size_t steps = 2; steps <= r->steps; steps *= 4) {
        lg_squares pooled[LG_RUN_ERRORS] = {{0, 0}}, unchanged[LG_RUN_ERRORS] = {{0, 0}};
        for (size_t i = 0; i < r->count; i++) {
            const double seconds = r->log->t[r->start[i] + steps] - r->log->t[r->start[i]];
            add_run(r, i, seconds, false, pooled);
            add_run(r, i, seconds, true, unchanged);
        }
        for (int e = 0; e < LG_RUN_ERRORS; e++)
            if (pooled[e].sum > 0)
                score += log(hypot(lg_squares_root(&pooled[e]), nothing * lg_squares_root(&unchanged[e])));
    }
    return score;
}

lg_status lg_machine_choose_start_rows(lg_learned_machine *model, const lg_machine_log *log,
                                       lg_error *error) {
    enum { STEPS = 32, LONG = 128, STARTS = 100, MOST_ROWS = 200, PART = 8 };
    /* Another number of rows than the usual one is taken only if it lowers the error by this much. */
    static const double clear = 0.05, parts[] = {1, 2, 4, 0.5, 0.32, 0.2, 0.12, 0.08};
    const lg_machine *machine = model->machine;
    const size_t usual = lg_start_rows(machine), every = 1 + log->rows / STARTS,
                 part = log->parts > 0 ? log->rows / log->parts / PART : 0,
                 most = part < MOST_ROWS ? part : MOST_ROWS;
    lg_learned_machine tried = *model;
    double best = INFINITY;
    LG_TRY_SCRATCH(size_t, start, model->context, log->rows, lg_no_memory(error));
    LG_CLEAN(runs_end)
    runs r = {model->context, machine, .log = log, .steps = most < LONG ? STEPS : LONG, .start = start};
    model->start_rows = (uint32_t)usual;
    r.count = lg_log_starts(machine, log, most > usual ? most : usual, r.steps, every, false, start);
    for (size_t i = 0; i < LG_COUNT(parts) && r.count > 0; i++) {
        tried.start_rows = (uint32_t)(parts[i] * (double)usual + 0.5);
        if (tried.start_rows > most && parts[i] > 1) continue;
        LG_TRY(predict(lg_machine_run, &tried, &r, error));
        const double score = score_of(&r);
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
    lg_machine states = *model->machine;
    const size_t nq = states.positions, nv = states.velocities, rows = problem->window,
                 all = problem->windows - problem->validation,
                 count = all * rows < MOST ? all : MOST / rows + 1;
    bool known = true;
    for (size_t i = 0; i < nq + nv; i++) known = known && range->low[i] <= range->high[i];
    if (known || count == 0) return LG_OK;
    LG_CLEAN(lg_started_log_destroy) lg_started_log begun = {.context = model->context};
    lg_machine_range found;
    LG_TRY_SCRATCH(double, q, model->context, count *rows *(nq + nv), lg_no_memory(error));
    LG_TRY_SCRATCH(size_t, start, model->context, count, lg_no_memory(error));
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

/* The squares of a point: the mean of each coordinate's places, of angles of attitudes, and the mean of all
 * velocities. Missing numbers count as 0. */
static double point_loss(const lg_machine *machine, const lg_point_error *e, size_t count) {
    double sum = 0.0, speeds = 0.0, measured = 0.0;
    for (size_t k = 0; k < count; k++) {
        const double square = e[k].error * e[k].error;
        if (isnan(square)) continue;
        if (e[k].kind == LG_ERROR_VELOCITY)
            speeds += square, measured++;
        else
            sum += e[k].kind == LG_ERROR_LINE
                       ? square / lg_machine_offsets_of(machine, e[k].coordinate).places
                       : square;
    }
    return measured > 0.0 ? sum + speeds / measured : sum;
}

lg_status lg_machine_window_loss(const lg_learned_machine *model, const lg_machine_log *log, uint32_t window,
                                 double *out, lg_error *error) {
    lg_point_error e[LG_POINT_ERRORS];
    double sum = 0.0;
    *out = NAN;
    LG_TRY_SCRATCH(size_t, start, model->context, log->rows, lg_no_memory(error));
    LG_CLEAN(runs_end)
    runs r = {model->context, model->machine, .log = log, .steps = window - 1, .start = start};
    if (!model->machine->accelerations)
        r.count = lg_machine_windows(model->machine, log, window, 1, false, start);
    if (r.count == 0) return LG_OK;
    LG_TRY(predict(lg_machine_run, model, &r, error));
    for (size_t i = 0; i < r.count; i++)
        for (size_t step = 1; step <= r.steps; step++)
            sum += point_loss(r.machine, e, errors_at(&r, i, step, false, true, e));
    *out = sum / ((double)r.count * (double)r.steps);
    return LG_OK;
}

lg_status lg_held_out_judge(const lg_held_out *held, const lg_learned_machine *model,
                            const lg_machine_log *log, double *square, lg_error *error) {
    lg_point_error e[LG_POINT_ERRORS];
    lg_learned_machine own = *model;
    own.start_rows = held->estimated ? (uint32_t)held->before + 1 : 0;
    LG_CLEAN(runs_end)
    runs r = {held->context,        model->machine,       .log = log,
              .steps = held->steps, .count = held->count, .start = held->start};
    LG_TRY(predict(lg_machine_run, &own, &r, error));
    for (size_t i = 0; i < r.count; i++) {
        double sum = 0, count = 0;
        for (size_t step = 1; step <= r.steps; step++)
            for (size_t k = errors_at(&r, i, step, false, false, e); k-- > 0;) {
                const double weight = held->weight[e[k].number];
                if (!(weight > 0) || isnan(e[k].error)) continue;
                sum += weight * e[k].error * e[k].error;
                count++;
            }
        square[i] = count > 0 ? sum / count : NAN;
    }
    return LG_OK;
}
