/* A linear model to compare the machine with: v' = A (q, v, u, 1), fitted to the same logs on which it is
 * judged. */
#include <math.h>
#include <string.h>

#include "lg-identify/identify.h"
#include "liegrad/geometry.h"

static void input_at(const lg_machine *machine, const lg_machine_log *log, size_t row, double s,
                     double *out) {
    const size_t m = machine->input_count;
    for (size_t k = 0; k < m; k++) {
        const double *u = log->u + row * 4 * m + k;
        out[k] = u[0] + s * (u[m] + s * (u[2 * m] + s * u[3 * m]));
    }
}

static void fill(const lg_machine *machine, const double *q, const double *v, const double *u, double *x) {
    memcpy(x, q, machine->positions * sizeof *x);
    memcpy(x + machine->positions, v, machine->velocities * sizeof *x);
    x += machine->positions + machine->velocities;
    if (machine->input_count > 0) memcpy(x, u, machine->input_count * sizeof *x);
    x[machine->input_count] = 1;
}

void identify_linear_fit(const app *self, const lg_machine *machine, const lg_machine_log *log,
                         identify_linear *linear) {
    double left;
    *linear = (identify_linear){
        .machine = machine, .features = machine->positions + machine->velocities + machine->input_count + 1};
    for (size_t i = 0; i < LG_COUNT(linear->A); i++) linear->A[i] = (double)NAN;
    APP_MUST(self, lg_machine_unexplained(self->context, machine, log, linear->A, &left, &error));
}

/* ---- runs ---- */

static void slope(const identify_linear *linear, const double *q, const double *v, const double *u,
                  double *dq, double *dv) {
    const lg_machine *machine = linear->machine;
    const size_t nv = machine->velocities;
    double x[IDENTIFY_FEATURES];
    fill(machine, q, v, u, x);
    for (size_t k = 0; k < nv; k++) dv[k] = 0;
    for (size_t i = 0; i < linear->features; i++)
        for (size_t k = 0; k < nv; k++) dv[k] += linear->A[k * linear->features + i] * x[i];
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        const double *R = q + row->places, *rate = v + row->velocities - 3;
        for (uint32_t k = 0; k < row->places; k++) dq[k] = row->rotations > 0 ? lg_dot3(R + 3 * k, v) : v[k];
        if (row->directions > 0) lg_cross3(v, q, dq);
        for (int r = 0; r < 3 && row->rotations > 0; r++)
            lg_cross3(R + 3 * r, rate, dq + row->places + 3 * r);
        q += lg_coordinate_positions(machine->coordinates[i].kind);
        dq += lg_coordinate_positions(machine->coordinates[i].kind);
        v += row->velocities;
    }
}

static void project(const lg_machine *machine, double *q) {
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
        if (row->rotations > 0) lg_so3_project(q + row->places);
        if (row->directions > 0) {
            const double norm = sqrt(lg_dot3(q, q));
            for (int k = 0; k < 3; k++) q[k] /= norm;
        }
        q += lg_coordinate_positions(machine->coordinates[i].kind);
    }
}

/* Makes one RK4 step from q, v over the interval that begins at `row`. */
static void advance(const identify_linear *linear, const lg_machine_log *log, size_t row, double *q,
                    double *v) {
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1 / 6.0, 1 / 3.0, 1 / 3.0, 1 / 6.0};
    const lg_machine *machine = linear->machine;
    const size_t nq = machine->positions, nv = machine->velocities;
    const double h = log->t[row + 1] - log->t[row];
    double sum[IDENTIFY_FEATURES] = {0}, d[IDENTIFY_FEATURES] = {0}, y[IDENTIFY_FEATURES],
           u[LG_MACHINE_INPUTS];
    for (int stage = 0; stage < 4; stage++) {
        for (size_t k = 0; k < nq; k++) y[k] = q[k] + h * at[stage] * d[k];
        for (size_t k = 0; k < nv; k++) y[nq + k] = v[k] + h * at[stage] * d[nq + k];
        if (machine->input_count > 0) input_at(machine, log, row, at[stage], u);
        slope(linear, y, y + nq, u, d, d + nq);
        for (size_t k = 0; k < nq + nv; k++) sum[k] += h * weight[stage] * d[k];
    }
    for (size_t k = 0; k < nq; k++) q[k] += sum[k];
    for (size_t k = 0; k < nv; k++) v[k] += sum[nq + k];
    project(machine, q);
}

lg_status identify_linear_run(const void *user, const lg_machine_log *log, const size_t *start, size_t count,
                              size_t steps, double *q, double *v, lg_error *error) {
    const identify_linear *linear = user;
    (void)error;
    const size_t nq = linear->machine->positions, nv = linear->machine->velocities;
    for (size_t i = 0; i < count; i++, q += (steps + 1) * nq, v += (steps + 1) * nv) {
        memcpy(q, log->q + start[i] * nq, nq * sizeof *q);
        memcpy(v, log->v + start[i] * nv, nv * sizeof *v);
        for (size_t step = 0; step < steps; step++) {
            memcpy(q + (step + 1) * nq, q + step * nq, nq * sizeof *q);
            memcpy(v + (step + 1) * nv, v + step * nv, nv * sizeof *v);
            advance(linear, log, start[i] + step, q + (step + 1) * nq, v + (step + 1) * nv);
        }
    }
    return LG_OK;
}
