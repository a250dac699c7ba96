/* Compares changes of positions with the integrals of the measured velocities. */
#include <math.h>
#include <stdlib.h>

#include "core/median.h"
#include "machine/files/recipe.h"

double lg_machine_wrap(double angle) {
    const double turn = 6.283185307179586;
    return angle - turn * round(angle / turn);
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
