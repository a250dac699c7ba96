/* Regressions of accelerations on positions, velocities and inputs: a linear model, and how much a
 * quadratic one leaves, which estimates the inputs' delay. */
#include <math.h>

#include "liegrad/minimise.h"
#include "machine/files/recipe.h"

enum {
    MOST_NUMBERS = 2 * LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS,
    MOST_ROWS = 20000
};

/* Writes the numbers that may explain the acceleration between a row and the next one: mean positions
 * (sine and cosine of angles unless `linear`), mean velocities, and the inputs in the middle of the
 * interval. Returns how many numbers these are. */
static size_t fill(const lg_machine *machine, const lg_machine_log *log, bool linear, size_t row, double *z) {
    const size_t nq = machine->positions, nv = machine->velocities, m = machine->input_count;
    const double *q = log->q + row * nq, *v = log->v + row * nv;
    size_t used = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        for (uint32_t k = at.position; k < at.position + at.positions; k++) {
            const double mean = 0.5 * (q[k] + q[nq + k]);
            const bool angle = at.angle && !linear;
            z[used++] = angle ? sin(mean) : mean;
            if (angle) z[used++] = cos(mean);
        }
    }
    for (size_t k = 0; k < nv; k++) z[used++] = 0.5 * (v[k] + v[nv + k]);
    for (size_t k = 0; k < m; k++) {
        const double *u = log->u + row * 4 * m + k;
        z[used++] = u[0] + 0.5 * (u[m] + 0.5 * (u[2 * m] + 0.5 * u[3 * m]));
    }
    return used;
}

/* Numbers x, 1 and, unless `linear`, products of two numbers, and accelerations y of the interval after
 * `row`. False: a number is missing. */
static bool interval(const lg_machine *machine, const lg_machine_log *log, bool linear, size_t row, double *x,
                     double *y) {
    const size_t nv = machine->velocities, numbers = fill(machine, log, linear, row, x);
    const double *v = log->v + row * nv, h = log->t[row + 1] - log->t[row];
    size_t n = numbers;
    bool finite = true;
    x[n++] = 1;
    for (size_t i = 0; i < numbers && !linear; i++)
        for (size_t j = 0; j <= i; j++) x[n++] = x[i] * x[j];
    for (size_t i = 0; i < n; i++) finite = finite && isfinite(x[i]);
    for (size_t k = 0; k < nv; k++) {
        y[k] = (v[nv + k] - v[k]) / h;
        finite = finite && isfinite(y[k]);
    }
    return finite;
}

/* First pass, A NULL: sums of the normal equations. Second pass: sum of the squared residuals of the solution
 * A. */
typedef struct regression {
    bool linear;
    size_t n, nv;
    /* matrix (n, n); right and A (nv, n); x (n); left: sum of squared residuals. */
    double *matrix, *right, *A, *x, left, rows;
} regression;

static void add(regression *r, const double *y) {
    const double *x = r->x;
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
    double y[LG_MACHINE_VELOCITIES];
    const size_t every = r->linear ? 1 : log->rows / MOST_ROWS + 1;
    r->rows = 0;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first; row + 1 < p.end; row += every)
            if (interval(machine, log, r->linear, row, r->x, y)) add(r, y);
}

lg_status lg_machine_unexplained(const lg_context *context, const lg_machine *machine,
                                 const lg_machine_log *log, double *linear, double *out, lg_error *error) {
    double z[MOST_NUMBERS];
    const bool plain = linear != NULL;
    const size_t numbers = log->rows > 1 ? fill(machine, log, plain, 0, z) : 0;
    const size_t n = 1 + numbers + (plain ? 0 : numbers * (numbers + 1) / 2), nv = machine->velocities;
    *out = NAN;
    LG_TRY_SCRATCH(double, matrix, context, n *(n + nv + 1), lg_no_memory(error));
    regression r = {.linear = plain, .n = n, .nv = nv, .matrix = matrix, .right = matrix + n * n};
    r.x = r.right + n * nv;
    pass(machine, log, &r);
    if (r.rows > 0 && lg_normal_equations(n, nv, plain ? 1e-10 : 1e-9, r.matrix, r.right) == LG_OK) {
        r.A = r.right;
        pass(machine, log, &r);
        *out = r.left / r.rows;
        for (size_t i = 0; i < n * nv && plain; i++) linear[i] = r.A[i];
    }
    return LG_OK;
}
