/* Velocities of logs that measure positions alone, from local polynomials. */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "liegrad/minimise.h"
#include "machine/files/recipe.h"

/* Value and derivative at row `row` of the polynomial through the numbers of rows first .. last in the least
 * squares sense; of a lower degree where numbers are few. False: there are too few numbers. */
static bool local(const lg_machine_log *log, const double *x, size_t stride, size_t first, size_t last,
                  size_t row, size_t degree, double out[2]) {
    enum { TERMS = 4, SPARE = 2 };
    const double span = log->t[last] - log->t[first];
    double A[TERMS * TERMS] = {0}, b[TERMS] = {0};
    size_t count = 0, before = 0;
    for (size_t i = first; i <= last; i++)
        if (!isnan(x[i * stride])) count++, before += i <= row;
    if (count < 2 + SPARE || before == 0 || before == count) return false;
    const size_t terms = count > degree + SPARE ? degree + 1 : count - SPARE;
    for (size_t i = first; i <= last; i++) {
        double power[2 * TERMS] = {1};
        const double y = x[i * stride], s = (log->t[i] - log->t[row]) / span;
        if (isnan(y)) continue;
        for (size_t k = 1; k < 2 * TERMS; k++) power[k] = power[k - 1] * s;
        for (size_t k = 0; k < terms; k++) {
            b[k] += power[k] * y;
            for (size_t l = 0; l <= k; l++) A[k * terms + l] += power[k + l];
        }
    }
    /* With the negative ridge the call fails if the rows do not determine the polynomial beyond rounding. */
    if (lg_normal_equations(terms, 1, -1e-12, A, b) != LG_OK) return false;
    out[0] = b[0];
    out[1] = b[1] / span;
    return true;
}

/* Velocities of one coordinate from q and q' of its position, as logs have them. */
static void velocity_of(const lg_machine_offsets *is, const double *q, const double *dq, double *v) {
    const double *R = q + is->places, *dR = dq + is->places;
    if (is->directions > 0) lg_cross3(q, dq, v);
    for (uint32_t i = 0; i < is->places; i++) v[i] = dq[i];
    if (is->rotations == 0) return;
    if (is->places > 0) lg_so3_coadjoint(R, dq, v);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        double sum = 0;
        for (int l = 0; l < 9; l += 3) sum += 0.5 * (R[l + k] * dR[l + j] - R[l + j] * dR[l + k]);
        v[is->places + (uint32_t)i] = sum;
    }
}

static void smooth_row(const lg_machine *machine, const lg_machine_log *log, size_t first, size_t last,
                       size_t row, size_t degree, double *q, double *v) {
    const uint32_t n = machine->positions;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        double dq[12], *own = q + at.position;
        bool there = true;
        for (uint32_t k = 0; k < at.positions; k++) {
            double found[2] = {NAN, NAN};
            there = local(log, log->q + at.position + k, n, first, last, row, degree, found) && there;
            /* Attitudes keep the logged numbers: smoothed ones are not on the manifold. */
            if (k < at.places && there) own[k] = found[0];
            dq[k] = found[1];
        }
        if (there) velocity_of(&at, own, dq, v + at.velocity);
    }
}

lg_status lg_machine_smooth(const lg_context *context, const lg_machine *machine, const lg_machine_log *log,
                            uint32_t half, uint32_t degree, lg_started_log *out, lg_error *error) {
    LG_TRY(lg_started_log_begin(context, machine, log, out, error));
    double *q = out->q, *v = out->v;
    memcpy(q, log->q, log->rows * machine->positions * sizeof *q);
    for (size_t i = 0; i < log->rows * machine->velocities; i++) v[i] = NAN;
    for (lg_log_part p = {0}; lg_log_next(log, &p);)
        for (size_t row = p.first; row < p.end; row++) {
            const size_t first = row - p.first > half ? row - half : p.first,
                         last = p.end - 1 - row > half ? row + half : p.end - 1;
            if (last > first)
                smooth_row(machine, log, first, last, row, degree, q + row * machine->positions,
                           v + row * machine->velocities);
        }
    return LG_OK;
}
