/* Runs of all parts of a log, and their starts where positions alone are measured. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "lg-identify/runs.h"

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

/* Rows from `row` to the end of its part. */
static size_t rows_from(const lg_machine_log *log, size_t row) {
    return log->first[lg_machine_log_part(log, row) + 1] - row;
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

size_t identify_first_rows(const lg_machine *machine, const lg_machine_log *log, size_t from, bool positions,
                           size_t *out) {
    size_t count = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p] + from; row + 1 < log->first[p + 1]; row++) {
            if (!lg_machine_log_complete(machine, log, row, positions)) continue;
            out[count++] = row;
            break;
        }
    return count;
}

/* ---- starts from positions ---- */

lg_status identify_with_starts(const app *self, const identify_model *model, const lg_machine_log *log,
                               const size_t *row, size_t count, identify_started *out, lg_error *error) {
    const lg_machine *machine = model->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    double *q = app_alloc(count * nq + 1, sizeof *q), *v = app_alloc(count * nv + 1, sizeof *v);
    out->q = app_alloc(log->rows * nq, sizeof *out->q);
    out->v = app_alloc(log->rows * nv, sizeof *out->v);
    out->log = *log;
    out->log.q = out->q, out->log.v = out->v;
    const lg_status status =
        lg_machine_estimate_starts(self->context, machine, model->theta, model->scheme, model->substeps, log,
                                   row, count, IDENTIFY_START_ROWS, q, v, error);
    for (size_t i = 0; i < count; i++) {
        memcpy(out->q + row[i] * nq, q + i * nq, nq * sizeof *q);
        memcpy(out->v + row[i] * nv, v + i * nv, nv * sizeof *v);
    }
    free(q);
    free(v);
    return status;
}

void identify_started_release(identify_started *started) {
    free(started->q);
    free(started->v);
}

lg_status identify_run_log(const app *self, const identify_model *model, const lg_machine_log *log,
                           const size_t *start, size_t count, bool positions, double *q, double *v,
                           lg_error *error) {
    if (!positions) return identify_free_runs(self, model, log, start, count, q, v, error);
    identify_started from;
    lg_status status = identify_with_starts(self, model, log, start, count, &from, error);
    if (status == LG_OK) status = identify_free_runs(self, model, &from.log, start, count, q, v, error);
    identify_started_release(&from);
    return status;
}
