/* Compares changes of positions with the integrals of the measured velocities. */
#include <math.h>
#include <stdlib.h>

#include "core/median.h"
#include "liegrad/geometry.h"
#include "machine/files/recipe.h"

double lg_machine_wrap(double angle) {
    const double turn = 6.283185307179586;
    return angle - turn * round(angle / turn);
}

/* Sums over rows: `moved` of the squared changes of a coordinate from row to row, `missed` of their squared
 * differences from the integral of the velocity (trapezoid). */
typedef struct motion {
    double moved, missed;
    size_t count;
} motion;

static void add_motion(motion *m, double change, double integral) {
    if (!isfinite(change) || !isfinite(integral)) return;
    m->moved += change * change;
    m->missed += (change - integral) * (change - integral);
    m->count++;
}

static void add_step(const lg_coordinate_row *row, const double *a, const double *b, const double *va,
                     const double *vb, double h, bool angle, motion *m) {
    double change[3] = {0}, mean[3], turn[9];
    const double *A = a + row->places, *B = b + row->places, *rate_a = va, *rate_b = vb;
    for (uint32_t k = 0; k < row->places; k++) {
        const double moved = angle ? lg_machine_wrap(b[k] - a[k]) : b[k] - a[k];
        const double speed_a = row->rotations > 0 ? lg_dot3(A + 3 * k, va) : va[k],
                     speed_b = row->rotations > 0 ? lg_dot3(B + 3 * k, vb) : vb[k];
        add_motion(m, moved, h * (speed_a + speed_b) / 2);
    }
    if (row->rotations == 0 && row->directions == 0) return;
    rate_a += row->velocities - 3, rate_b += row->velocities - 3;
    if (row->directions > 0) {
        lg_cross3(a, b, change);
    } else {
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                turn[3 * r + c] = A[r] * B[c] + A[3 + r] * B[3 + c] + A[6 + r] * B[6 + c];
        lg_so3_log(turn, change);
    }
    for (int k = 0; k < 3; k++) mean[k] = h * (rate_a[k] + rate_b[k]) / 2;
    for (int k = 0; k < 3; k++) add_motion(m, change[k], mean[k]);
}

void lg_machine_motions(const lg_machine_data *data, int lag, double *out) {
    const lg_machine *machine = &data->file.machine;
    const lg_machine_log *log = &data->logs.log;
    motion found[LG_MACHINE_COORDINATES] = {{0, 0, 0}};
    for (size_t p = 0; p < log->parts; p++) {
        const size_t first = log->first[p] + (lag < 0 ? (size_t)-lag : 0);
        const size_t end = log->first[p + 1] - (lag > 0 ? (size_t)lag : 0);
        for (size_t row = first; row + 1 < end && end <= log->first[p + 1]; row++) {
            const size_t other = lag < 0 ? row - (size_t)-lag : row + (size_t)lag;
            const double *q = log->q + row * machine->positions, *v = log->v + other * machine->velocities;
            for (uint32_t i = 0; i < machine->coordinate_count; i++) {
                const lg_coordinate_kind kind = machine->coordinates[i].kind;
                const lg_coordinate_row *each = lg_coordinate_row_of(kind);
                add_step(each, q, q + machine->positions, v, v + machine->velocities,
                         log->t[row + 1] - log->t[row], kind == LG_COORDINATE_ANGLE, &found[i]);
                q += lg_coordinate_positions(kind), v += each->velocities;
            }
        }
    }
    const bool compared = data->file.measured == LG_MEASURED_VELOCITIES;
    for (uint32_t i = 0; i < machine->coordinate_count; i++)
        out[i] = compared && found[i].moved > 0 ? sqrt(found[i].missed / found[i].moved) : (double)NAN;
}

/* ---- two clocks ---- */

/* A lag is accepted if its velocities leave less than half of what the velocities of the same rows leave;
 * velocities of other rows do not reach this by chance. */
void lg_machine_lags(const lg_machine_data *data, int *lag, double *left) {
    enum { MOST = 12 };
    static const double better = 0.5;
    const uint32_t n = data->file.machine.coordinate_count;
    double best[LG_MACHINE_COORDINATES], each[LG_MACHINE_COORDINATES];
    lg_machine_motions(data, 0, best);
    for (uint32_t i = 0; i < n; i++) lag[i] = 0, best[i] *= better, left[i] = best[i];
    for (int k = -MOST; k <= MOST; k++) {
        lg_machine_motions(data, k, each);
        for (uint32_t i = 0; i < n; i++)
            if (each[i] < best[i]) best[i] = left[i] = each[i], lag[i] = k;
    }
}

/* ---- coordinates with one number: lines and angles ---- */

typedef struct number {
    const lg_machine_log *log;
    const double *q, *v; /* values in row 0 */
    size_t positions, velocities;
    bool angle;
} number;

/* Finds the number of a line or angle. False: another kind of coordinate, or no velocities. */
static bool find_number(const lg_machine_data *data, uint32_t coordinate, number *out) {
    const lg_machine *machine = &data->file.machine;
    const lg_machine_log *log = &data->logs.log;
    const lg_log_place at = lg_log_place_of(machine, coordinate);
    const lg_coordinate_kind kind = machine->coordinates[coordinate].kind;
    *out = (number){log,
                    log->q + at.position,
                    log->v + at.velocity,
                    machine->positions,
                    machine->velocities,
                    kind == LG_COORDINATE_ANGLE};
    return data->file.measured == LG_MEASURED_VELOCITIES &&
           (kind == LG_COORDINATE_LINE || kind == LG_COORDINATE_ANGLE);
}

/* The change of position from a row to the next; `way` gets the integral of the velocity (trapezoid). */
static double change_of(const number *n, size_t row, double *way) {
    const double *q = n->q + row * n->positions, *v = n->v + row * n->velocities;
    const double moved = q[n->positions] - q[0];
    *way = (n->log->t[row + 1] - n->log->t[row]) * (v[0] + v[n->velocities]) / 2;
    return n->angle ? lg_machine_wrap(moved) : moved;
}

double lg_machine_position_noise(const lg_machine_data *data, uint32_t coordinate) {
    number n;
    double sum = 0.0, way;
    size_t count = 0;
    if (!find_number(data, coordinate, &n)) return 0.0;
    for (size_t p = 0; p < n.log->parts; p++) {
        double before = (double)NAN;
        for (size_t row = n.log->first[p]; row + 1 < n.log->first[p + 1]; row++) {
            const double change = change_of(&n, row, &way), off = change - way;
            if (isfinite(off * before)) sum += off * before, count++;
            before = off;
        }
    }
    return count > 0 && sum < 0.0 ? sqrt(-sum / (double)count) : 0.0;
}

/* The median size of the changes that are not 0; infinity if all are 0. `sizes` has room for one number per
 * row. */
static double usual_change(const number *n, double *sizes) {
    double way;
    size_t count = 0;
    for (size_t p = 0; p < n->log->parts; p++)
        for (size_t row = n->log->first[p]; row + 1 < n->log->first[p + 1]; row++) {
            const double size = fabs(change_of(n, row, &way));
            if (size > 0.0) sizes[count++] = size;
        }
    qsort(sizes, count, sizeof *sizes, lg_compare_doubles);
    return count > 0 ? sizes[count / 2] : (double)INFINITY;
}

static lg_standstill longest_standstill(const number *n, double usual) {
    /* In usual changes. Coarsely rounded positions stand still only until they have moved by one rounding
     * step. */
    static const double far = 6.0;
    lg_standstill worst = {0, 0, 0};
    for (size_t p = 0; p < n->log->parts; p++) {
        double gone = 0.0, way;
        size_t since = n->log->first[p];
        for (size_t row = since; row + 1 < n->log->first[p + 1]; row++) {
            if (change_of(n, row, &way) != 0.0)
                since = row + 1, gone = 0.0;
            else if (fabs(gone += way) > far * usual && row + 2 - since > worst.rows)
                worst = (lg_standstill){since, row + 2 - since, n->q[row * n->positions]};
        }
    }
    return worst;
}

lg_status lg_machine_stuck(const lg_context *context, const lg_machine_data *data, uint32_t coordinate,
                           lg_standstill *out, lg_error *error) {
    number n;
    *out = (lg_standstill){0, 0, 0};
    if (!find_number(data, coordinate, &n)) return LG_OK;
    double *sizes = lg_alloc(context, n.log->rows, sizeof *sizes);
    if (sizes == NULL) return lg_no_memory(error);
    *out = longest_standstill(&n, usual_change(&n, sizes));
    lg_free(context, sizes);
    return LG_OK;
}
