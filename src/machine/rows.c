/* Machines: rows of logs in the log's units and in scaled units, and velocities where they are missing. */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "machine/internal.h"

bool lg_log_next(const lg_machine_log *log, lg_log_part *at) {
    if (at->next == log->parts) return false;
    at->first = log->first[at->next++];
    at->end = log->first[at->next];
    return true;
}

size_t lg_machine_log_part(const lg_machine_log *log, size_t row) {
    size_t low = 0;
    for (size_t step = log->parts; step > 0; step /= 2)
        while (low + step < log->parts && log->first[low + step] <= row) low += step;
    return low;
}

bool lg_machine_log_complete(const lg_machine *machine, const lg_machine_log *log, size_t row,
                             bool positions_only) {
    for (uint32_t i = 0; i < machine->positions; i++)
        if (isnan(log->q[row * machine->positions + i])) return false;
    for (uint32_t i = 0; i < machine->velocities && !positions_only; i++)
        if (isnan(log->v[row * machine->velocities + i])) return false;
    return true;
}

void lg_machine_turn_between(const double *A, const double *B, double *out) {
    double C[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
    lg_so3_log(C, out);
}

/* Derivative at `row` of the polynomial through rows first .. last of q, a column of the log with the given
 * stride. */
static double slope(const lg_machine_log *log, const double *q, size_t stride, size_t first, size_t last,
                    size_t row) {
    double sum = 0.0;
    for (size_t j = first; j <= last; j++) {
        double weight = 0.0; /* derivative of the j-th Lagrange polynomial */
        for (size_t k = first; k <= last; k++) {
            if (k == j) continue;
            double product = 1.0 / (log->t[j] - log->t[k]);
            for (size_t l = first; l <= last; l++)
                if (l != j && l != k) product *= (log->t[row] - log->t[l]) / (log->t[j] - log->t[l]);
            weight += product;
        }
        sum += weight * q[j * stride];
    }
    return sum;
}

/* The velocity of coordinate i at `row` from logged positions: places by the polynomial through rows first ..
 * last, directions and rotations from the two neighbouring rows. */
static void difference(const lg_machine *machine, const lg_machine_log *log, uint32_t i, size_t first,
                       size_t last, size_t row, double *out) {
    const lg_machine_offsets at = lg_machine_offsets_of(machine, i);
    const size_t n = machine->positions, before = row > first ? row - 1 : row,
                 after = row < last ? row + 1 : row;
    const double *q = log->q + at.position, *a = q + before * n, *b = q + after * n;
    const double h = log->t[after] - log->t[before];
    double x[3] = {0, 0, 0};
    for (uint32_t k = 0; k < at.places; k++) x[k] = slope(log, q + k, n, first, last, row);
    if (at.rotations > 0) {
        if (at.places > 0) lg_so3_coadjoint(q + row * n + at.places, x, out);
        lg_machine_turn_between(a + at.places, b + at.places, out + at.places);
        for (uint32_t k = at.places; k < at.velocities; k++) out[k] /= h;
    } else if (at.directions > 0) {
        lg_cross3(a, b, out);
        for (int k = 0; k < 3; k++) out[k] /= h;
    } else {
        out[0] = x[0];
    }
}

/* Finds up to two rows before and after a row in the same part of the log. */
static void neighbours(const lg_machine_log *log, size_t row, size_t *first, size_t *last) {
    const size_t *part = log->first + lg_machine_log_part(log, row);
    *first = row < part[0] + 2 ? part[0] : row - 2;
    *last = row + 3 > part[1] ? part[1] - 1 : row + 2;
}

/* The velocity of coordinate i in a row. Where it was not measured, it is computed from positions; 0 where
 * these are missing, too. */
static void velocity_in(const lg_machine *machine, const lg_machine_log *log, size_t row, uint32_t i,
                        double *out) {
    const lg_machine_offsets at = lg_machine_offsets_of(machine, i);
    const double *v = log->v + row * machine->velocities + at.velocity;
    bool known = true;
    memcpy(out, v, at.velocities * sizeof *out);
    for (uint32_t k = 0; k < at.velocities; k++) known = known && !isnan(v[k]);
    if (known) return;
    size_t first, last;
    neighbours(log, row, &first, &last);
    for (uint32_t k = 0; k < at.velocities; k++) out[k] = 0.0;
    if (last > first) difference(machine, log, i, first, last, row, out);
    for (uint32_t k = 0; k < at.velocities; k++)
        if (isnan(out[k])) out[k] = 0.0;
}

void lg_machine_scaled_rows(const lg_machine *machine, const lg_machine_log *log, const size_t *rows,
                            size_t count, double *positions, double *velocities) {
    const lg_machine_scales *s = &machine->scales;
    for (size_t r = 0; r < count; r++)
        for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
            const double *q = log->q + rows[r] * machine->positions + at.position;
            double *x = positions + r * machine->positions + at.position;
            for (uint32_t k = 0; k < at.positions; k++) {
                const double scale = k < at.places ? s->place[at.place + k] : 1.0;
                x[k] = isnan(q[k]) ? 0.0 : q[k] / scale;
            }
            if (velocities == NULL) continue;
            double *v = velocities + r * machine->velocities + at.velocity;
            velocity_in(machine, log, rows[r], at.index, v);
            for (uint32_t k = 0; k < at.velocities; k++) v[k] *= s->time / s->velocity[at.velocity + k];
        }
}

lg_status lg_machine_record_rows(lg_tape *tape, const lg_machine *machine, const lg_machine_log *log,
                                 const size_t *at, size_t count, lg_var *positions, lg_var *velocities) {
    void *memory[2];
    *positions = lg_input_buffer(tape, lg_shape2((uint32_t)count, machine->positions), &memory[0]);
    *velocities = lg_input_buffer(tape, lg_shape2((uint32_t)count, machine->velocities), &memory[1]);
    LG_TRY(lg_tape_status(tape));
    lg_machine_scaled_rows(machine, log, at, count, memory[0], memory[1]);
    return LG_OK;
}

void lg_machine_shown_row(const lg_machine *machine, const lg_machine_log *log, size_t row, double *positions,
                          double *shown) {
    lg_machine_scaled_rows(machine, log, &row, 1, positions, shown);
    for (uint32_t k = 0; k < machine->velocities && machine->accelerations; k++) {
        const double a = log->a[row * machine->velocities + k];
        shown[k] = isnan(a) ? 0.0 : a / lg_machine_shown_unit(machine, k);
    }
}

void lg_machine_unscale_row(const lg_machine *machine, double *positions, double *velocities) {
    const lg_machine_scales *s = &machine->scales;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        for (uint32_t k = 0; k < at.places; k++) positions[at.position + k] *= s->place[at.place + k];
    }
    for (uint32_t k = 0; k < machine->velocities; k++) velocities[k] *= s->velocity[k] / s->time;
}
