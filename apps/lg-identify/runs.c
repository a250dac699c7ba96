/* Runs of all parts of a log, and their starts where positions alone are measured. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"
#include "liegrad/geometry.h"

/* ---- small systems ---- */

static bool factor(double *a, size_t n) {
    for (size_t j = 0; j < n; j++) {
        double d = a[j * n + j];
        for (size_t k = 0; k < j; k++) d -= a[j * n + k] * a[j * n + k];
        if (!(d > 0)) return false;
        a[j * n + j] = sqrt(d);
        for (size_t i = j + 1; i < n; i++) {
            double s = a[i * n + j];
            for (size_t k = 0; k < j; k++) s -= a[i * n + k] * a[j * n + k];
            a[i * n + j] = s / a[j * n + j];
        }
    }
    return true;
}

bool identify_solve(double *a, size_t n, double *b, size_t columns) {
    if (!factor(a, n)) return false;
    for (size_t c = 0; c < columns; c++) {
        for (size_t i = 0; i < n; i++) {
            double s = b[i * columns + c];
            for (size_t k = 0; k < i; k++) s -= a[i * n + k] * b[k * columns + c];
            b[i * columns + c] = s / a[i * n + i];
        }
        for (size_t i = n; i-- > 0;) {
            double s = b[i * columns + c];
            for (size_t k = i + 1; k < n; k++) s -= a[k * n + i] * b[k * columns + c];
            b[i * columns + c] = s / a[i * n + i];
        }
    }
    return true;
}

/* ---- a log of pieces of equal length, cut from another one ---- */

typedef struct pieces {
    lg_machine_log log;
    size_t *first;
    double *t, *q, *v, *u;
    size_t rows; /* of a piece */
} pieces;

static void pieces_begin(pieces *p, const lg_machine *machine, size_t count, size_t rows) {
    const size_t all = count * rows;
    *p = (pieces){.rows = rows};
    p->first = app_alloc(count + 1, sizeof *p->first);
    for (size_t i = 0; i <= count; i++) p->first[i] = i * rows;
    p->t = app_alloc(all, sizeof *p->t);
    p->q = app_alloc(all * machine->positions, sizeof *p->q);
    p->v = app_alloc(all * machine->velocities, sizeof *p->v);
    p->u = app_alloc(all * 4 * machine->input_count + 1, sizeof *p->u);
    p->log = (lg_machine_log){all, count, p->first, p->t, p->q, p->v, p->u};
}

static void pieces_end(pieces *p) {
    free(p->first);
    free(p->t);
    free(p->q);
    free(p->v);
    free(p->u);
}

static size_t part_of(const lg_machine_log *log, size_t row) {
    size_t low = 0, high = log->parts;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (log->first[middle] <= row)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Rows from `row` to the end of its part. */
static size_t rows_from(const lg_machine_log *log, size_t row) {
    return log->first[part_of(log, row) + 1] - row;
}

/* Piece i gets times and inputs from `row` on; what is missing at its end goes on with the last step. */
static void pieces_fill(pieces *p, size_t i, const lg_machine *machine, const lg_machine_log *from,
                        size_t row) {
    const size_t inputs = 4 * machine->input_count, most = rows_from(from, row),
                 count = most < p->rows ? most : p->rows;
    double *t = p->t + i * p->rows;
    memcpy(t, from->t + row, count * sizeof *t);
    const double h = count > 1 ? t[count - 1] - t[count - 2] : 1e-3;
    for (size_t k = count; k < p->rows; k++) t[k] = t[k - 1] + h;
    if (inputs > 0)
        memcpy(p->u + i * p->rows * inputs, from->u + row * inputs, count * inputs * sizeof *p->u);
    memcpy(p->q + i * p->rows * machine->positions, from->q + row * machine->positions,
           machine->positions * sizeof *p->q);
    memcpy(p->v + i * p->rows * machine->velocities, from->v + row * machine->velocities,
           machine->velocities * sizeof *p->v);
}

/* ---- runs to the ends of parts ---- */

typedef struct one {
    size_t row, rows;
} one;

static int longer_first(const void *a, const void *b) {
    const one *x = a, *y = b;
    return x->rows != y->rows ? (x->rows < y->rows) - (x->rows > y->rows)
                              : (x->row > y->row) - (x->row < y->row);
}

/* Runs of similar lengths go together. */
static lg_status run_group(const app *self, const identify_model *model, const lg_machine_log *log,
                           const one *runs, size_t count, double *q, double *v, lg_error *error) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, rows = runs[0].rows;
    pieces p;
    pieces_begin(&p, machine, count, rows);
    for (size_t i = 0; i < count; i++) pieces_fill(&p, i, machine, log, runs[i].row);
    double *out_q = app_alloc(count * rows * nq, sizeof *out_q),
           *out_v = app_alloc(count * rows * nv, sizeof *out_v);
    const lg_status status =
        lg_machine_free_run(self->context, machine, model->theta, model->scheme, model->substeps, &p.log,
                            p.first, count, rows - 1, out_q, out_v, error);
    for (size_t i = 0; i < count * rows * nq && status == LG_OK; i++)
        if (isnan(out_q[i])) out_q[i] = INFINITY;
    for (size_t i = 0; i < count * rows * nv && status == LG_OK; i++)
        if (isnan(out_v[i])) out_v[i] = INFINITY;
    for (size_t i = 0; i < count && status == LG_OK; i++) {
        memcpy(q + runs[i].row * nq, out_q + i * rows * nq, runs[i].rows * nq * sizeof *q);
        memcpy(v + runs[i].row * nv, out_v + i * rows * nv, runs[i].rows * nv * sizeof *v);
    }
    free(out_q);
    free(out_v);
    pieces_end(&p);
    return status;
}

lg_status identify_free_runs(const app *self, const identify_model *model, const lg_machine_log *log,
                             const size_t *start, size_t count, double *q, double *v, lg_error *error) {
    enum { MOST = 1 << 20 };
    const lg_machine *machine = model->machine;
    lg_status status = LG_OK;
    one *runs = app_alloc(count + 1, sizeof *runs);
    for (size_t i = 0; i < log->rows * machine->positions; i++) q[i] = (double)NAN;
    for (size_t i = 0; i < log->rows * machine->velocities; i++) v[i] = (double)NAN;
    for (size_t i = 0; i < count; i++) runs[i] = (one){start[i], rows_from(log, start[i])};
    qsort(runs, count, sizeof *runs, longer_first);
    for (size_t first = 0, end; first < count && status == LG_OK; first = end) {
        for (end = first + 1; end < count && 2 * runs[end].rows >= runs[first].rows &&
                              (end - first) * runs[first].rows < MOST;)
            end++;
        status = run_group(self, model, log, runs + first, end - first, q, v, error);
    }
    free(runs);
    return status;
}

static bool is_complete(const double *x, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (isnan(x[i])) return false;
    return true;
}

size_t identify_first_rows(const lg_machine *machine, const lg_machine_log *log, size_t from, bool positions,
                           size_t *out) {
    size_t count = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p] + from; row + 1 < log->first[p + 1]; row++) {
            if (!is_complete(log->q + row * machine->positions, machine->positions)) continue;
            if (!positions && !is_complete(log->v + row * machine->velocities, machine->velocities)) continue;
            out[count++] = row;
            break;
        }
    return count;
}

/* ---- starts from positions ---- */

enum { MOST_UNKNOWNS = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES, ROUNDS = 12 };

/* The search for one start. */
typedef struct search {
    size_t row, rows; /* rows that are compared */
    double *q, *v;    /* best so far */
    double *trial_q, *trial_v;
    double cost, damping;
    double *matrix, *slope; /* of the best */
} search;

typedef struct estimating {
    const app *app;
    const identify_model *model;
    const lg_machine_log *log;
    size_t unknowns;
    double unit[MOST_UNKNOWNS]; /* steps of the unknowns */
    double *weight;             /* (positions) */
} estimating;

/* The unknowns in their order: numbers of places, rotations of directions and attitudes, velocities. */
static void find_units(estimating *e) {
    const lg_machine *machine = e->model->machine;
    const lg_machine_scales *scales = &machine->scales;
    size_t n = 0, place = 0, velocity = 0, position = 0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        for (uint32_t k = 0; k < row->places; k++) {
            e->weight[position++] = 1 / scales->place[place];
            e->unit[n++] = scales->place[place++];
        }
        const uint32_t turned = 3 * row->directions + 9 * row->rotations;
        for (uint32_t k = 0; k < turned; k++) e->weight[position++] = 1;
        for (uint32_t k = 0; turned > 0 && k < 3; k++) e->unit[n++] = 1;
        for (uint32_t k = 0; k < row->velocities; k++, velocity++)
            e->unit[n++] = scales->velocity[velocity] / scales->time;
    }
    e->unknowns = n;
}

/* The state that is `step` (in units) away. */
static void move(const estimating *e, const double *q, const double *v, const double *step, double *to_q,
                 double *to_v) {
    const lg_machine *machine = e->model->machine;
    const double *unit = e->unit;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        for (uint32_t k = 0; k < row->places; k++) *to_q++ = *q++ + *unit++ * *step++;
        if (row->directions > 0) lg_so3_exp_act(step, q, to_q);
        if (row->rotations > 0) lg_so3_exp_multiply(step, q, to_q);
        const uint32_t turned = 3 * row->directions + 9 * row->rotations;
        for (uint32_t k = 0; k < row->velocities; k++)
            to_v[k] = v[k] + unit[(turned > 0 ? 3 : 0) + k] * step[(turned > 0 ? 3 : 0) + k];
        if (row->directions > 0) {
            const double along = lg_dot3(to_v, to_q);
            for (int k = 0; k < 3; k++) to_v[k] -= along * to_q[k];
        }
        const size_t used = (turned > 0 ? 3 : 0) + row->velocities;
        q += turned, to_q += turned, v += row->velocities, to_v += row->velocities;
        unit += used, step += used;
    }
}

/* A velocity to begin with: the slope over the first rows. */
static void guess(const estimating *e, search *s) {
    const lg_machine *machine = e->model->machine;
    const lg_machine_log *log = e->log;
    const size_t nq = machine->positions;
    size_t last = s->rows > 5 ? 4 : s->rows - 1;
    while (last > 1 && !is_complete(log->q + (s->row + last) * nq, nq)) last--;
    const double *a = log->q + s->row * nq, *b = log->q + (s->row + last) * nq;
    const double h = log->t[s->row + last] - log->t[s->row];
    double *v = s->v;
    memcpy(s->q, a, nq * sizeof *a);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        double rate[6] = {0};
        for (uint32_t k = 0; k < row->places; k++) rate[k] = (b[k] - a[k]) / h;
        if (row->directions > 0) {
            lg_cross3(a, b, rate);
            for (int k = 0; k < 3; k++) rate[k] /= h;
        }
        if (row->rotations > 0) { /* R^T R' */
            const double *A = a + row->places, *B = b + row->places;
            double turn[9], place[3] = {rate[0], rate[1], rate[2]};
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    turn[3 * r + c] = A[r] * B[c] + A[3 + r] * B[3 + c] + A[6 + r] * B[6 + c];
            lg_so3_log(turn, rate + row->places);
            for (uint32_t k = 0; k < 3; k++) rate[row->places + k] /= h;
            for (int k = 0; k < 3 && row->places > 0; k++)
                rate[k] = A[k] * place[0] + A[3 + k] * place[1] + A[6 + k] * place[2];
        }
        for (uint32_t k = 0; k < row->velocities; k++) *v++ = isfinite(rate[k]) ? rate[k] : 0;
        a += lg_coordinate_positions(machine->coordinates[i].kind);
        b += lg_coordinate_positions(machine->coordinates[i].kind);
    }
}

/* Runs of the trial states and of their neighbours by `step` in each unknown. */
static lg_status run_trials(const estimating *e, const search *all, size_t count, double step, double *q,
                            double *v, lg_error *error) {
    const identify_model *model = e->model;
    const lg_machine *machine = model->machine;
    const size_t each = e->unknowns + 1, rows = IDENTIFY_START_ROWS;
    pieces p;
    pieces_begin(&p, machine, count * each, rows);
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < each; k++) {
            double by[MOST_UNKNOWNS] = {0};
            if (k > 0) by[k - 1] = step;
            pieces_fill(&p, i * each + k, machine, e->log, all[i].row);
            move(e, all[i].trial_q, all[i].trial_v, by, p.q + (i * each + k) * rows * machine->positions,
                 p.v + (i * each + k) * rows * machine->velocities);
        }
    const lg_status status =
        lg_machine_free_run(e->app->context, machine, model->theta, model->scheme, model->substeps, &p.log,
                            p.first, count * each, rows - 1, q, v, error);
    pieces_end(&p);
    return status;
}

/* Residuals (unknowns + 1, positions) of one row: base, then differences. */
static double add_row(const estimating *e, const double *given, const double *runs, size_t stride,
                      double step, double *matrix, double *slope) {
    const size_t nq = e->model->machine->positions, n = e->unknowns;
    double cost = 0, column[MOST_UNKNOWNS];
    for (size_t k = 0; k < nq; k++) {
        if (isnan(given[k])) continue;
        const double r = e->weight[k] * (runs[k] - given[k]);
        for (size_t j = 0; j < n; j++)
            column[j] = e->weight[k] * (runs[(j + 1) * stride + k] - runs[k]) / step;
        cost += r * r;
        for (size_t j = 0; j < n; j++) {
            slope[j] += column[j] * r;
            for (size_t i = 0; i <= j; i++) matrix[j * n + i] += column[j] * column[i];
        }
    }
    return cost;
}

/* Takes the trial when it is better, and makes the next one. */
static void advance(const estimating *e, search *s, const double *runs, double step) {
    const lg_machine *machine = e->model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, n = e->unknowns;
    double *matrix = app_alloc(n * n, sizeof *matrix), slope[MOST_UNKNOWNS] = {0}, by[MOST_UNKNOWNS];
    double cost = 0;
    for (size_t j = 0; j < s->rows; j++)
        cost += add_row(e, e->log->q + (s->row + j) * nq, runs + j * nq, IDENTIFY_START_ROWS * nq, step,
                        matrix, slope);
    const bool better = cost <= s->cost;
    if (better) {
        memcpy(s->q, s->trial_q, nq * sizeof *s->q);
        memcpy(s->v, s->trial_v, nv * sizeof *s->v);
        memcpy(s->matrix, matrix, n * n * sizeof *matrix);
        memcpy(s->slope, slope, n * sizeof *slope);
        s->cost = cost;
    }
    s->damping *= better ? 0.1 : 10;
    memcpy(matrix, s->matrix, n * n * sizeof *matrix);
    double largest = 0;
    for (size_t j = 0; j < n; j++) largest = fmax(largest, matrix[j * n + j]);
    for (size_t j = 0; j < n; j++) {
        matrix[j * n + j] += s->damping * matrix[j * n + j] + 1e-12 * largest;
        by[j] = -s->slope[j];
    }
    if (identify_solve(matrix, n, by, 1)) move(e, s->q, s->v, by, s->trial_q, s->trial_v);
    free(matrix);
}

static void search_begin(const estimating *e, search *s, size_t row, double *q, double *v) {
    const lg_machine *machine = e->model->machine;
    const size_t most = rows_from(e->log, row), n = e->unknowns;
    *s =
        (search){.row = row, .rows = most < IDENTIFY_START_ROWS ? most : IDENTIFY_START_ROWS, .q = q, .v = v};
    s->trial_q = app_alloc(machine->positions, sizeof *q);
    s->trial_v = app_alloc(machine->velocities, sizeof *v);
    s->matrix = app_alloc(n * n, sizeof *s->matrix);
    s->slope = app_alloc(n, sizeof *s->slope);
    s->cost = INFINITY;
    s->damping = 1e-3;
    guess(e, s);
    memcpy(s->trial_q, s->q, machine->positions * sizeof *q);
    memcpy(s->trial_v, s->v, machine->velocities * sizeof *v);
}

static void search_end(search *s) {
    free(s->trial_q);
    free(s->trial_v);
    free(s->matrix);
    free(s->slope);
}

/* The states at the last rows that were compared. */
static lg_status keep_last(const estimating *e, search *all, size_t count, double *last_q, double *last_v,
                           lg_error *error) {
    const lg_machine *machine = e->model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, rows = IDENTIFY_START_ROWS,
                 each = e->unknowns + 1;
    double *q = app_alloc(count * each * rows * nq, sizeof *q),
           *v = app_alloc(count * each * rows * nv, sizeof *v);
    for (size_t i = 0; i < count; i++) {
        memcpy(all[i].trial_q, all[i].q, nq * sizeof *q);
        memcpy(all[i].trial_v, all[i].v, nv * sizeof *v);
    }
    const lg_status status = run_trials(e, all, count, 0, q, v, error);
    for (size_t i = 0; i < count && status == LG_OK; i++) {
        const size_t at = i * each * rows + all[i].rows - 1;
        memcpy(last_q + i * nq, q + at * nq, nq * sizeof *q);
        memcpy(last_v + i * nv, v + at * nv, nv * sizeof *v);
    }
    free(q);
    free(v);
    return status;
}

static lg_status estimate(const estimating *e, search *all, size_t count, lg_error *error) {
    static const double step = 1e-6;
    const lg_machine *machine = e->model->machine;
    const size_t each = e->unknowns + 1, points = count * each * IDENTIFY_START_ROWS,
                 stride = each * IDENTIFY_START_ROWS * machine->positions;
    double *q = app_alloc(points * machine->positions, sizeof *q),
           *v = app_alloc(points * machine->velocities, sizeof *v);
    lg_status status = LG_OK;
    for (int round = 0; round < ROUNDS && status == LG_OK; round++) {
        status = run_trials(e, all, count, step, q, v, error);
        for (size_t i = 0; i < count && status == LG_OK; i++) advance(e, &all[i], q + i * stride, step);
    }
    free(q);
    free(v);
    return status;
}

lg_status identify_estimate_starts(const app *self, const identify_model *model, const lg_machine_log *log,
                                   const size_t *row, size_t count, double *q, double *v, double *last_q,
                                   double *last_v, lg_error *error) {
    const size_t nq = model->machine->positions, nv = model->machine->velocities;
    double weight[LG_MACHINE_POSITIONS];
    estimating e = {.app = self, .model = model, .log = log, .weight = weight};
    find_units(&e);
    const size_t most = 4096 / (e.unknowns + 1) + 1;
    search *all = app_alloc(most, sizeof *all);
    lg_status status = LG_OK;
    for (size_t first = 0; first < count && status == LG_OK; first += most) {
        const size_t some = count - first < most ? count - first : most;
        for (size_t i = 0; i < some; i++)
            search_begin(&e, &all[i], row[first + i], q + (first + i) * nq, v + (first + i) * nv);
        status = estimate(&e, all, some, error);
        if (status == LG_OK && last_q != NULL)
            status = keep_last(&e, all, some, last_q + first * nq, last_v + first * nv, error);
        for (size_t i = 0; i < some; i++) search_end(&all[i]);
    }
    free(all);
    return status;
}

lg_status identify_run_log(const app *self, const identify_model *model, const lg_machine_log *log,
                           const size_t *start, size_t count, bool positions, double *q, double *v,
                           lg_error *error) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    if (!positions) return identify_free_runs(self, model, log, start, count, q, v, error);
    lg_machine_log copy = *log;
    double *own_q = app_alloc(log->rows * nq, sizeof *own_q),
           *own_v = app_alloc(log->rows * nv, sizeof *own_v), *from_q = app_alloc(count * nq, sizeof *from_q),
           *from_v = app_alloc(count * nv, sizeof *from_v);
    lg_status status =
        identify_estimate_starts(self, model, log, start, count, from_q, from_v, NULL, NULL, error);
    memcpy(own_q, log->q, log->rows * nq * sizeof *own_q);
    for (size_t i = 0; i < count; i++) {
        memcpy(own_q + start[i] * nq, from_q + i * nq, nq * sizeof *own_q);
        memcpy(own_v + start[i] * nv, from_v + i * nv, nv * sizeof *own_v);
    }
    copy.q = own_q, copy.v = own_v;
    if (status == LG_OK) status = identify_free_runs(self, model, &copy, start, count, q, v, error);
    free(own_q);
    free(own_v);
    free(from_q);
    free(from_v);
    return status;
}
