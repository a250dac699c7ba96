/* How well inputs explain accelerations: for the delay with which they act. */
#include <math.h>

#include "lg-identify/runs.h"
#include "liegrad/minimise.h"

enum {
    MOST_NUMBERS = 2 * LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS,
    MOST_ROWS = 20000
};

/* Positions with sines and cosines of angles, velocities and the input in the middle, means of both ends of
 * an interval; returns how many. */
static size_t fill(const lg_machine *machine, const lg_machine_log *log, size_t row, double *z) {
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    const double *q = log->q + row * nq, *v = log->v + row * nv, *u = log->u + row * 4 * m;
    size_t used = 0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const uint32_t count = lg_coordinate_positions(machine->coordinates[i].kind);
        for (uint32_t k = 0; k < count; k++) {
            const double mean = 0.5 * (q[k] + q[nq + k]);
            const bool angle = machine->coordinates[i].kind == LG_COORDINATE_ANGLE;
            z[used++] = angle ? sin(mean) : mean;
            if (angle) z[used++] = cos(mean);
        }
        q += count;
    }
    for (size_t k = 0; k < nv; k++) z[used++] = 0.5 * (v[k] + v[nv + k]);
    for (size_t k = 0; k < m; k++)
        z[used++] = u[k] + 0.5 * (u[m + k] + 0.5 * (u[2 * m + k] + 0.5 * u[3 * m + k]));
    return used;
}

/* 1, z_i and z_i z_j; returns how many. */
static size_t square(const double *z, size_t count, double *x) {
    size_t used = 0;
    x[used++] = 1.0;
    for (size_t i = 0; i < count; i++) {
        x[used++] = z[i];
        for (size_t j = 0; j <= i; j++) x[used++] = z[i] * z[j];
    }
    return used;
}

/* Monomials x of an interval and its accelerations y. False: a number is missing. */
static bool interval(const lg_machine *machine, const lg_machine_log *log, size_t row, double *x, double *y) {
    double z[MOST_NUMBERS];
    const size_t nv = machine->velocities, n = square(z, fill(machine, log, row, z), x);
    const double *v = log->v + row * nv, h = log->t[row + 1] - log->t[row];
    bool finite = true;
    for (size_t i = 0; i < n; i++) finite = finite && isfinite(x[i]);
    for (size_t k = 0; k < nv; k++) {
        y[k] = (v[nv + k] - v[k]) / h;
        finite = finite && isfinite(y[k]);
    }
    return finite;
}

/* Sums of the normal equations, or with `A` of the squares that are left. */
typedef struct regression {
    size_t n, nv;
    double *matrix, *right, *A, left, rows; /* (n, n); (nv, n), A too */
} regression;

static void add(regression *r, const double *x, const double *y) {
    r->rows++;
    if (r->A == NULL) {
        for (size_t i = 0; i < r->n; i++) {
            for (size_t j = 0; j <= i; j++) r->matrix[i * r->n + j] += x[i] * x[j];
            for (size_t k = 0; k < r->nv; k++) r->right[k * r->n + i] += x[i] * y[k];
        }
        return;
    }
    for (size_t k = 0; k < r->nv; k++) {
        double e = y[k];
        for (size_t i = 0; i < r->n; i++) e -= x[i] * r->A[k * r->n + i];
        r->left += e * e;
    }
}

static void pass(const lg_machine *machine, const lg_machine_log *log, regression *r) {
    APP_FREE double *x = app_alloc(r->n, sizeof *x);
    double y[LG_MACHINE_VELOCITIES];
    const size_t every = log->rows / MOST_ROWS + 1;
    r->rows = 0;
    for (size_t p = 0; p < log->parts; p++)
        for (size_t row = log->first[p]; row + 1 < log->first[p + 1]; row += every)
            if (interval(machine, log, row, x, y)) add(r, x, y);
}

double identify_unexplained(const lg_machine *machine, const lg_machine_log *log) {
    double z[MOST_NUMBERS];
    const size_t numbers = log->rows > 1 ? fill(machine, log, 0, z) : 0;
    regression r = {.n = 1 + numbers + numbers * (numbers + 1) / 2, .nv = machine->velocities};
    APP_FREE double *matrix = r.matrix = app_alloc(r.n * r.n, sizeof *r.matrix);
    APP_FREE double *right = r.right = app_alloc(r.n * r.nv, sizeof *r.right);
    pass(machine, log, &r);
    if (!(r.rows > 0) || lg_normal_equations(r.n, r.nv, 1e-9, matrix, right) != LG_OK) return (double)NAN;
    r.A = right;
    pass(machine, log, &r);
    return r.left / r.rows;
}
