/* Predicts all parts of a log by free runs of the model. If only positions or accelerations were
 * measured, the states at the
 * starts of the runs are estimated first. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-identify/identify.h"

/* ---- making logs ---- */

void identify_pieces_begin(identify_pieces *p, const lg_machine *machine, size_t count, size_t rows) {
    const size_t all = count * rows;
    *p = (identify_pieces){.rows = rows};
    p->first = app_alloc(count + 1, sizeof *p->first);
    for (size_t i = 0; i <= count; i++) p->first[i] = i * rows;
    p->t = app_alloc(all, sizeof *p->t);
    p->q = app_alloc(all * machine->positions, sizeof *p->q);
    p->v = app_alloc(all * machine->velocities, sizeof *p->v);
    p->u = app_alloc(all * 4 * machine->input_count + 1, sizeof *p->u);
    p->log = (lg_machine_log){all, count, p->first, p->t, p->q, p->v, p->u, NULL, NULL, NULL};
}

void identify_pieces_end(identify_pieces *p) {
    free(p->first);
    free(p->t);
    free(p->q);
    free(p->v);
    free(p->u);
    free(p->lag);
}

void identify_pieces_lag(const app *self, identify_pieces *p, const lg_learned_machine *model,
                         const lg_machine_log *log, const size_t *row) {
    const lg_machine *machine = model->machine;
    const size_t count = p->log.parts, n = machine->lags;
    if (n == 0 || count == 0) return;
    p->log.lag = p->lag = app_alloc(count * n, sizeof *p->lag);
    APP_MUST(self,
             lg_machine_lagged_inputs(self->context, machine, model->theta, log, row, count, p->lag, &error));
}

size_t identify_first_run(const lg_logs *logs) {
    size_t parts = 1;
    while (parts < logs->log.parts && logs->part_run[parts] == logs->part_run[0]) parts++;
    return parts;
}

void identify_run(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                  const size_t *start, size_t count, size_t steps, double *q, double *v) {
    APP_MUST(self, lg_machine_free_run(self->context, model->machine, model->theta, model->scheme,
                                       model->substeps, log, start, count, steps, q, v, &error));
}

/* ---- runs to the ends of parts ---- */

/* Rows from `row` to the end of its part, `row` included. */
static size_t rows_from(const lg_machine_log *log, size_t row) {
    return log->first[lg_machine_log_part(log, row) + 1] - row;
}

/* Fills piece i with times and inputs of the log from `row` on, and with the state at `row`. If the piece is
 * longer than the part, times continue with the last step. */
static void fill_piece(identify_pieces *p, size_t i, const lg_machine *machine, const lg_machine_log *from,
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

typedef struct one {
    size_t row, rows;
} one;

static int longer_first(const void *a, const void *b) {
    const one *x = a, *y = b;
    return x->rows != y->rows ? (x->rows < y->rows) - (x->rows > y->rows)
                              : (x->row > y->row) - (x->row < y->row);
}

/* Copies numbers; a NaN becomes infinite, since NaN marks rows that are not predicted. */
static void copy_run(const double *from, size_t count, double *to) {
    for (size_t i = 0; i < count; i++) to[i] = isnan(from[i]) ? INFINITY : from[i];
}

/* Runs several starts as pieces of equal length, the longest one's. Callers group runs of similar lengths. */
static void run_group(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                      const one *runs, size_t count, double *q, double *v) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities, rows = runs[0].rows;
    APP_CLEAN(identify_pieces_end) identify_pieces p;
    identify_pieces_begin(&p, machine, count, rows);
    APP_FREE size_t *row = app_alloc(count, sizeof *row);
    for (size_t i = 0; i < count; i++) fill_piece(&p, i, machine, log, row[i] = runs[i].row);
    identify_pieces_lag(self, &p, model, log, row);
    APP_FREE double *out_q = app_alloc(count * rows * nq, sizeof *out_q);
    APP_FREE double *out_v = app_alloc(count * rows * nv, sizeof *out_v);
    identify_run(self, model, &p.log, p.first, count, rows - 1, out_q, out_v);
    for (size_t i = 0; i < count; i++) {
        copy_run(out_q + i * rows * nq, runs[i].rows * nq, q + runs[i].row * nq);
        copy_run(out_v + i * rows * nv, runs[i].rows * nv, v + runs[i].row * nv);
    }
}

static void run_to_ends(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                        const size_t *start, size_t count, double *q, double *v) {
    enum { MOST = 1 << 20 };
    const lg_machine *machine = model->machine;
    APP_FREE one *runs = app_alloc(count + 1, sizeof *runs);
    for (size_t i = 0; i < log->rows * machine->positions; i++) q[i] = (double)NAN;
    for (size_t i = 0; i < log->rows * machine->velocities; i++) v[i] = (double)NAN;
    for (size_t i = 0; i < count; i++) runs[i] = (one){start[i], rows_from(log, start[i])};
    qsort(runs, count, sizeof *runs, longer_first);
    for (size_t first = 0, end; first < count; first = end) {
        for (end = first + 1; end < count && 2 * runs[end].rows >= runs[first].rows &&
                              (end - first) * runs[first].rows < MOST;)
            end++;
        run_group(self, model, log, runs + first, end - first, q, v);
    }
}

size_t identify_first_rows(const lg_learned_machine *model, const lg_machine_log *log, size_t from,
                           size_t *out) {
    size_t count = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p] + from; row + 1 < log->first[p + 1]; row++) {
            if (!lg_machine_log_complete(model->machine, log, row, model->start_rows > 0)) continue;
            out[count++] = row;
            break;
        }
    return count;
}

/* ---- runs over a log ---- */

void identify_run_log(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                      const size_t *start, size_t count, double *q, double *v) {
    APP_CLEAN(lg_started_log_destroy) lg_started_log from = {.log = *log};
    if (model->start_rows > 0) APP_MUST(self, lg_started_log_create(model, log, start, count, &from, &error));
    run_to_ends(self, model, &from.log, start, count, q, v);
}

void identify_leave_out(const lg_learned_machine *model, const lg_machine_log *log, const size_t *start,
                        size_t count, double *q, double *v) {
    const size_t nq = model->machine->positions, nv = model->machine->velocities;
    for (size_t i = 0; i < count; i++)
        for (size_t row = start[i]; row < start[i] + model->start_rows && row < log->rows; row++) {
            for (size_t k = 0; k < nq; k++) q[row * nq + k] = (double)NAN;
            for (size_t k = 0; k < nv; k++) v[row * nv + k] = (double)NAN;
        }
}
