/* Machines: residuals of windows and their Jacobian, computed interval by interval.
 *
 * z = (positions, velocities) of a row, in the order of logs. An interval maps z of one row to z of the
 * next row, z' = F(z, theta). A change of z has d components along axes: one for each place and velocity,
 * three rotations of a direction (a x q) and three of a rotation (R hat(a)). The bristles of LuGre friction
 * follow in z behind the velocities; they have no residuals. At its first row a window has the bristles of
 * lg_machine_start_bristles. S = dz/d(theta, numbers of the window's start) has the shape (d, columns) and
 * follows
 *   S' = A S + (dF/dtheta, 0),  A = dF/dz.
 * One row of A and dF/dtheta takes one reverse sweep over all windows of the chunk. If theta is known, S
 * has no columns for it. Where accelerations are measured, a = G(z, theta) of each row has the rows
 * dG/dz S + (dG/dtheta, 0), and these take the place of the velocities' rows in the residuals. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "liegrad/geometry.h"
#include "machine/internal.h"

enum { NUMBERS = LG_MACHINE_POSITIONS + 2 * LG_MACHINE_VELOCITIES };

/* ---- axes ---- */

typedef struct axis {
    enum { ALONG, TURN_DIRECTION, TURN_ROTATION } kind;
    uint32_t first; /* index in z of the only number that changes, or of the first of 3 or 9 */
    uint32_t turn;  /* index of the rotation axis, in space for a direction, in the body for a rotation */
} axis;

typedef struct axes {
    uint32_t count, numbers, seen; /* d; numbers of z; axes with residuals */
    axis each[NUMBERS];
} axes;

static void add_axes(axes *all, int kind, uint32_t first, uint32_t count) {
    for (uint32_t k = 0; k < count; k++)
        all->each[all->count++] =
            kind == ALONG ? (axis){ALONG, first + k, 0} : (axis){.kind = kind, .first = first, .turn = k};
}

/* Axes in the order of the numbers of a start: places, directions, rotations, velocities. */
static axes axes_of(const lg_machine *machine) {
    axes all = {.numbers = machine->positions + machine->velocities + machine->bristles};
    for (int kind = ALONG; kind <= TURN_ROTATION; kind++)
        for (uint32_t i = 0; i < machine->coordinate_count; i++) {
            const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
            const uint32_t first = lg_machine_offsets_of(machine, i).position;
            if (kind == ALONG) add_axes(&all, kind, first, row->places);
            if (kind == TURN_DIRECTION && row->directions > 0) add_axes(&all, kind, first, 3);
            if (kind == TURN_ROTATION && row->rotations > 0) add_axes(&all, kind, first + row->places, 3);
        }
    add_axes(&all, ALONG, machine->positions, machine->velocities);
    all.seen = all.count;
    add_axes(&all, ALONG, machine->positions + machine->velocities, machine->bristles);
    return all;
}

/* How many numbers of z, from a->first on, change along an axis. */
static uint32_t width_of(const axis *a) {
    return a->kind == ALONG ? 1 : a->kind == TURN_DIRECTION ? 3 : 9;
}

/* The change of these numbers: 1 for a place or velocity, e_k x q for a direction, the rows r_i x e_k for a
 * rotation. */
static void change_along(const axis *a, const double *z, double *out) {
    const uint32_t k = a->turn, l = (k + 1) % 3, m = (k + 2) % 3;
    if (a->kind == ALONG) {
        out[0] = 1.0;
        return;
    }
    const double sign = a->kind == TURN_DIRECTION ? 1.0 : -1.0;
    for (uint32_t i = 0; i < width_of(a); i += 3) {
        const double *v = z + a->first + i;
        out[i + k] = 0.0;
        out[i + l] = -sign * v[m];
        out[i + m] = sign * v[l];
    }
}

/* Squared length of the change along an axis. */
static double square_of(const axis *a) {
    return a->kind == TURN_ROTATION ? 2.0 : 1.0;
}

static double component(const axis *a, const double *z, const double *x) {
    double along[9], sum = 0.0;
    change_along(a, z, along);
    for (uint32_t i = 0; i < width_of(a); i++) sum += along[i] * x[a->first + i];
    return sum;
}

/* ---- memory ---- */

typedef struct chain {
    const lg_machine_problem *problem;
    const double *theta;
    const uint32_t *samples;
    /* count: windows; shared: learned parameters of the machine; own: numbers of a start; columns: shared +
     * own; rows: residuals of one window. */
    size_t count, shared, own, columns, rows;
    double factor;
    axes axes;
    double *z, *next;  /* (count, numbers): z of the current and of the next row */
    double *dz;        /* (count, numbers): gradient with respect to z */
    double *A;         /* (count, d, d) */
    double *apart;     /* (count, shared): gradient with respect to theta for each window */
    double *S, *moved; /* (count, d, columns): S of the current and of the next row */
    /* Where accelerations are measured: those of the current row, (count, velocities), and their rows of the
     * Jacobian, (count, velocities, columns). Else NULL. */
    double *a, *of_a;
    double *r, *jacobian; /* NULL: only the loss is computed, of a machine without directions */
    double loss;
    size_t done; /* rows of r and jacobian that are filled in each window */
} chain;

static size_t chain_numbers(const chain *c) {
    const size_t d = c->axes.count;
    const lg_machine *machine = c->problem->machine;
    const size_t shown = machine->accelerations ? machine->velocities * (c->columns + 1) : 0;
    return c->count * (3 * c->axes.numbers + d * d + c->shared + 2 * d * c->columns + shown);
}

static void place(chain *c, double *memory) {
    const size_t n = c->count * c->axes.numbers, d = c->axes.count;
    c->z = memory;
    c->next = c->z + n;
    c->dz = c->next + n;
    c->A = c->dz + n;
    c->apart = c->A + c->count * d * d;
    c->S = c->apart + c->count * c->shared;
    c->moved = c->S + c->count * d * c->columns;
    if (!c->problem->machine->accelerations) return;
    c->a = c->moved + c->count * d * c->columns;
    c->of_a = c->a + c->count * c->problem->machine->velocities;
}

/* ---- sweeps ---- */

/* z of a state. */
static lg_var joined(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const int z = lg_machine_parts(vars->machine).z;
    const lg_var all[3] = {lg_machine_record_positions(tape, vars, parts),
                           lg_machine_record_velocities(tape, vars, parts), z < 0 ? LG_NONE : parts[z]};
    return lg_concat(tape, all, z < 0 ? 2 : 3, 1);
}

/* Sum over windows of z's component along an axis, which is z . c/|c|^2 with c the change along the axis at
 * c->next, the value of z. */
static lg_var sum_along(lg_tape *tape, const chain *c, lg_var z, const axis *a) {
    void *memory;
    const lg_var seed = lg_input_buffer(tape, lg_var_shape(tape, z), &memory);
    if (lg_is_none(seed)) return seed;
    double along[9];
    memset(memory, 0, c->count * c->axes.numbers * sizeof(double));
    for (size_t s = 0; s < c->count; s++) {
        const size_t at = s * c->axes.numbers;
        change_along(a, c->next + at, along);
        for (uint32_t i = 0; i < width_of(a); i++)
            ((double *)memory)[at + a->first + i] = along[i] / square_of(a);
    }
    return lg_sum(tape, lg_mul(tape, z, seed));
}

/* Gradient of `sum` with respect to z and, where theta is learned, to theta for each window, (count,
 * shared). */
static lg_status sweep(lg_tape *tape, chain *c, lg_var sum, lg_var z, lg_var theta) {
    void *const dz = c->dz;
    if (c->shared == 0) return lg_backward_set(tape, sum, &z, 1, &dz);
    return lg_backward_rows(tape, sum, z, c->dz, theta, c->count, c->apart);
}

/* Computes row i of A and row i of dF/dtheta. The latter goes to the first columns of `moved`. */
static lg_status sweep_interval(lg_tape *tape, chain *c, uint32_t i, lg_var from, lg_var theta, lg_var to) {
    const size_t d = c->axes.count;
    const lg_mark mark = lg_tape_mark(tape);
    const lg_var sum = sum_along(tape, c, to, &c->axes.each[i]);
    LG_TRY(sweep(tape, c, sum, from, theta));
    for (size_t s = 0; s < c->count; s++) {
        const double *z = c->z + s * c->axes.numbers, *dz = c->dz + s * c->axes.numbers;
        double *row = c->moved + (s * d + i) * c->columns;
        for (size_t j = 0; j < d; j++) c->A[(s * d + i) * d + j] = component(&c->axes.each[j], z, dz);
        memcpy(row, c->apart + s * c->shared, c->shared * sizeof *row);
        memset(row + c->shared, 0, c->own * sizeof *row);
    }
    return lg_tape_rewind(tape, mark);
}

/* Binds the machine's parameters: known ones, or the first parameters of the fit. */
static lg_status bind(lg_tape *tape, const chain *c, lg_var *theta, lg_machine_vars *vars) {
    const lg_machine *machine = c->problem->machine;
    *theta = lg_machine_parameter(tape, machine, c->shared > 0 ? c->theta : c->problem->theta);
    return lg_machine_bind(tape, machine, *theta, vars);
}

static size_t row_of(const chain *c, size_t sample, uint32_t point) {
    return c->problem->start[c->samples[sample]] + point;
}

/* The state of point j of all windows, from z; `at` gets its rows of the log. */
static lg_status record_point(lg_tape *tape, const chain *c, const lg_machine_vars *vars, uint32_t j,
                              size_t *at, lg_var *from, lg_var *parts) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t n = c->axes.numbers, rows = (uint32_t)c->count;
    for (size_t s = 0; s < c->count; s++) at[s] = row_of(c, s, j);
    *from = lg_input_f64(tape, lg_shape2(rows, n), c->z);
    lg_tape_mark_rows(tape, *from);
    LG_TRY(lg_machine_record_state(tape, vars, lg_machine_columns(tape, *from, 0, machine->positions),
                                   lg_machine_columns(tape, *from, machine->positions, machine->velocities),
                                   parts));
    if (j == 0) return lg_machine_start_bristles(tape, vars, &c->problem->log, at, rows, parts);
    if (machine->bristles > 0)
        parts[lg_machine_parts(machine).z] =
            lg_machine_columns(tape, *from, n - machine->bristles, machine->bristles);
    return lg_tape_status(tape);
}

/* Moves z and S over the interval from point j to point j + 1. */
static lg_status pass_interval(lg_tape *tape, chain *c, uint32_t j, size_t *at) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t n = c->axes.numbers, rows = (uint32_t)c->count;
    const size_t d = c->axes.count;
    lg_machine_vars vars;
    lg_var theta, from, parts[LG_TAPED_MAX_PARTS];
    lg_tape_reset(tape);
    LG_TRY(bind(tape, c, &theta, &vars));
    lg_machine_flow flow = {.vars = &vars, .scheme = c->problem->scheme, .substeps = c->problem->substeps};
    LG_TRY(lg_machine_space(machine, &flow.space));
    LG_TRY(record_point(tape, c, &vars, j, at, &from, parts));
    LG_TRY(lg_machine_record_interval(tape, &flow, &c->problem->log, at, rows, parts));
    const lg_var to = joined(tape, &vars, parts);
    LG_TRY(lg_read(tape, to, c->count * n, c->next));
    for (uint32_t i = 0; i < d; i++) LG_TRY(sweep_interval(tape, c, i, from, theta, to));
    if (j > 0 || c->own > 0)
        for (size_t s = 0; s < c->count; s++)
            tape->k->gemm(d, c->columns, d, c->A + s * d * d, d, 1, c->S + s * d * c->columns, c->columns,
                          c->moved + s * d * c->columns, c->columns, true);
    double *spare = c->S;
    c->S = c->moved;
    c->moved = spare;
    memcpy(c->z, c->next, c->count * n * sizeof *c->z);
    return LG_OK;
}

/* ---- starts ---- */

/* Moves the starts by their parameters; S becomes the derivative with respect to these, in the last `own`
 * columns. */
static lg_status move_starts(lg_tape *tape, chain *c, lg_var positions, lg_var velocities) {
    const size_t d = c->axes.count, own = c->own;
    lg_machine_vars vars;
    lg_var theta, parts[LG_TAPED_MAX_PARTS];
    void *memory;
    const lg_var numbers = lg_input_buffer(tape, lg_shape2((uint32_t)c->count, (uint32_t)own), &memory);
    if (lg_is_none(numbers)) return lg_tape_status(tape);
    for (size_t s = 0; s < c->count; s++)
        memcpy((double *)memory + s * own, c->theta + c->shared + c->samples[s] * own, own * sizeof(double));
    LG_TRY(bind(tape, c, &theta, &vars));
    LG_TRY(lg_machine_move_starts(tape, c->problem, &vars, numbers, positions, velocities, parts));
    const lg_var z = joined(tape, &vars, parts);
    LG_TRY(lg_read(tape, z, c->count * c->axes.numbers, c->next));
    memset(c->S, 0, c->count * d * c->columns * sizeof *c->S);
    for (uint32_t i = 0; i < d; i++) {
        const lg_var sum = sum_along(tape, c, z, &c->axes.each[i]);
        void *const into = c->moved; /* (count, own) */
        LG_TRY(lg_backward_set(tape, sum, &numbers, 1, &into));
        for (size_t s = 0; s < c->count; s++)
            memcpy(c->S + (s * d + i) * c->columns + c->shared, c->moved + s * own, own * sizeof(double));
    }
    memcpy(c->z, c->next, c->count * c->axes.numbers * sizeof *c->z);
    return LG_OK;
}

static lg_status first_points(lg_tape *tape, chain *c) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t rows = (uint32_t)c->count, n = c->axes.numbers;
    void *memory[2];
    lg_tape_reset(tape);
    const lg_var positions = lg_input_buffer(tape, lg_shape2(rows, machine->positions), &memory[0]),
                 velocities = lg_input_buffer(tape, lg_shape2(rows, machine->velocities), &memory[1]);
    LG_TRY(lg_tape_status(tape));
    memset(c->z, 0, c->count * n * sizeof *c->z);
    for (size_t s = 0; s < c->count; s++) {
        const size_t row = row_of(c, s, 0);
        double *q = (double *)memory[0] + s * machine->positions,
               *v = (double *)memory[1] + s * machine->velocities;
        lg_machine_scaled_rows(machine, &c->problem->log, &row, 1, q, v);
        memcpy(c->z + s * n, q, machine->positions * sizeof *q);
        memcpy(c->z + s * n + machine->positions, v, machine->velocities * sizeof *v);
    }
    return c->own > 0 ? move_starts(tape, c, positions, velocities) : LG_OK;
}

/* ---- accelerations ---- */

/* Computes row k of `of_a`: dG/dz S + (dG/dtheta, 0). */
static lg_status sweep_acceleration(lg_tape *tape, chain *c, uint32_t k, lg_var from, lg_var theta,
                                    lg_var a) {
    const size_t nv = c->problem->machine->velocities, d = c->axes.count;
    const lg_mark mark = lg_tape_mark(tape);
    LG_TRY(sweep(tape, c, lg_sum(tape, lg_slice(tape, a, 1, k, 1)), from, theta));
    for (size_t s = 0; s < c->count; s++) {
        const double *z = c->z + s * c->axes.numbers, *dz = c->dz + s * c->axes.numbers;
        double *row = c->of_a + (s * nv + k) * c->columns;
        memcpy(row, c->apart + s * c->shared, c->shared * sizeof *row);
        memset(row + c->shared, 0, c->own * sizeof *row);
        for (size_t j = 0; j < d; j++)
            tape->k->axpy(c->columns, component(&c->axes.each[j], z, dz), c->S + (s * d + j) * c->columns,
                          row);
    }
    return lg_tape_rewind(tape, mark);
}

/* Fills `a` and `of_a` at point j, where accelerations are measured. */
static lg_status show_accelerations(lg_tape *tape, chain *c, uint32_t j, size_t *at) {
    const lg_machine *machine = c->problem->machine;
    lg_machine_vars vars;
    lg_var theta, from, parts[LG_TAPED_MAX_PARTS];
    if (!machine->accelerations) return LG_OK;
    lg_tape_reset(tape);
    LG_TRY(bind(tape, c, &theta, &vars));
    LG_TRY(record_point(tape, c, &vars, j, at, &from, parts));
    const lg_var a = lg_machine_record_shown(tape, &vars, &c->problem->log, at, (uint32_t)c->count, parts);
    LG_TRY(lg_read(tape, a, c->count * machine->velocities, c->a));
    for (uint32_t k = 0; k < machine->velocities; k++) LG_TRY(sweep_acceleration(tape, c, k, from, theta, a));
    return LG_OK;
}

/* ---- residuals ---- */

/* Row s of z with what the log shows in place of the velocities. */
static void shown_of(const chain *c, size_t s, double *out) {
    const lg_machine *machine = c->problem->machine;
    memcpy(out, c->z + s * c->axes.numbers, c->axes.numbers * sizeof *out);
    if (machine->accelerations)
        memcpy(out + machine->positions, c->a + s * machine->velocities, machine->velocities * sizeof *out);
}

/* The derivatives of the number on axis i of row s. */
static const double *slopes_of(const chain *c, size_t s, size_t i) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t first = c->axes.each[i].first;
    if (machine->accelerations && first >= machine->positions)
        return c->of_a + (s * machine->velocities + first - machine->positions) * c->columns;
    return c->S + (s * c->axes.count + i) * c->columns;
}

/* Removes the components along the logged directions from the velocities' rows of the residuals and the
 * Jacobian. */
static void keep_across(const chain *c, size_t row, double *r, double *jacobian) {
    const lg_machine *machine = c->problem->machine;
    double along[LG_MACHINE_VELOCITIES];
    lg_machine_along_row(c->problem, row, along);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const uint32_t first = lg_machine_offsets_of(machine, i).velocity;
        const double *q = along + first;
        double *of_r = r + first, *J = jacobian + first * c->columns;
        if (machine->coordinates[i].kind != LG_COORDINATE_DIRECTION) continue;
        const double dot = lg_dot3(q, of_r);
        for (uint32_t m = 0; m < 3; m++) of_r[m] -= dot * q[m];
        for (size_t j = 0; j < c->columns; j++) {
            double *column[] = {J + j, J + c->columns + j, J + 2 * c->columns + j};
            const double sum = q[0] * *column[0] + q[1] * *column[1] + q[2] * *column[2];
            for (uint32_t m = 0; m < 3; m++) *column[m] -= sum * q[m];
        }
    }
}

/* Writes the rows of point j of all windows: the residual along each axis, and S times the weight. */
static void put_rows(const lg_kernels *k, chain *c, uint32_t j) {
    const lg_machine *machine = c->problem->machine;
    const size_t seen = c->axes.seen, numbers = machine->positions + machine->velocities;
    double z[NUMBERS], data[NUMBERS], weight[NUMBERS], r[NUMBERS];
    for (size_t s = 0; s < c->count; s++) {
        const size_t row = row_of(c, s, j), first = s * c->rows + c->done;
        shown_of(c, s, z);
        lg_machine_shown_row(machine, &c->problem->log, row, data, data + machine->positions);
        lg_machine_weigh_row(c->problem, row, c->factor, weight, weight + machine->positions);
        for (uint32_t i = 0; i < numbers; i++) {
            r[i] = weight[i] * (z[i] - data[i]);
            if (i < machine->positions) c->loss += r[i] * r[i];
        }
        for (uint32_t i = machine->positions; c->r == NULL && i < numbers; i++) c->loss += r[i] * r[i];
        if (c->r == NULL) continue;
        for (size_t i = 0; i < seen; i++) {
            const axis *a = &c->axes.each[i];
            const double length = sqrt(square_of(a));
            double *out = c->jacobian + (first + i) * c->columns;
            c->r[first + i] = component(a, z, r) / length;
            k->fill(c->columns, 0.0, out);
            k->axpy(c->columns, length * weight[a->first], slopes_of(c, s, i), out);
        }
        double *of_v = c->r + first + seen - machine->velocities;
        if (machine->directions > 0)
            keep_across(c, row, of_v, c->jacobian + (first + seen - machine->velocities) * c->columns);
        for (uint32_t i = 0; i < machine->velocities; i++) c->loss += of_v[i] * of_v[i];
    }
    c->done += seen;
}

/* Writes the rows of the priors behind the points of each window, and adds them to the loss. */
static void put_priors(chain *c, size_t batch) {
    lg_prior priors[LG_MACHINE_PRIORS];
    const lg_machine *machine = c->problem->machine;
    const uint32_t count =
        lg_machine_problem_priors(c->problem) > 0 ? lg_machine_list_priors(machine, priors) : 0;
    const double weight = lg_machine_prior_weight(c->problem, batch);
    for (uint32_t i = 0; i < count; i++) {
        const lg_prior *p = &priors[i];
        const size_t column = machine->terms[p->term].offset + p->index;
        double slope;
        const double x = lg_number_at(&p->map, c->theta[column], &slope);
        const double r = weight * (x - p->centre) / p->sigma;
        for (size_t s = 0; s < c->count; s++) {
            const size_t row = s * c->rows + c->done + i;
            c->loss += r * r;
            if (c->r == NULL) continue; /* only the loss is wanted */
            memset(c->jacobian + row * c->columns, 0, c->columns * sizeof *c->jacobian);
            c->jacobian[row * c->columns + column] = weight * slope / p->sigma;
            c->r[row] = r;
        }
    }
}

static uint32_t first_residual(const lg_machine_problem *problem) {
    return lg_machine_starts_estimated(problem) ? 0 : 1;
}

size_t lg_machine_linearised_rows(const lg_machine_problem *problem) {
    return (size_t)(problem->window - first_residual(problem)) * axes_of(problem->machine).seen +
           lg_machine_problem_priors(problem);
}

void lg_machine_row_variances(const lg_machine_problem *problem, const lg_machine_noise *noise, size_t row,
                              double factor, double *out, double *part) {
    const lg_machine *machine = problem->machine;
    const axes all = axes_of(machine);
    const double *q = problem->log.q + row * machine->positions;
    double share[NUMBERS], along[LG_MACHINE_VELOCITIES];
    lg_machine_weigh_row(problem, row, factor, share, share + machine->positions);
    lg_machine_along_row(problem, row, along);
    for (uint32_t i = 0; i < machine->positions + machine->velocities; i++) share[i] = share[i] != 0.0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_machine_offsets at = lg_machine_offsets_of(machine, i);
        const double position = factor * noise->position[i] / problem->position_scale[i],
                     velocity = factor * noise->velocity[i] / problem->velocity_scale[i];
        double *of_q = share + at.position, *of_v = share + machine->positions + at.velocity;
        for (uint32_t k = 0; k < lg_coordinate_positions(kind); k++) of_q[k] *= position * position;
        for (uint32_t k = 0; k < lg_coordinate_row_of(kind)->velocities; k++) of_v[k] *= velocity * velocity;
    }
    for (uint32_t i = 0; i < all.seen; i++) {
        const axis *a = &all.each[i];
        const double by = a->kind == TURN_DIRECTION        ? q[a->first + a->turn]
                          : a->first >= machine->positions ? along[a->first - machine->positions]
                                                           : 0.0;
        out[i] = isnan(share[a->first]) ? 0.0 : share[a->first];
        part[i] = isnan(by) ? 0.0 : 1.0 - by * by;
    }
}

static lg_status put_point(lg_tape *tape, chain *c, uint32_t j, size_t *at) {
    LG_TRY(show_accelerations(tape, c, j, at));
    put_rows(tape->k, c, j);
    return LG_OK;
}

static lg_status pass_window(lg_tape *tape, chain *c) {
    size_t at[LG_FIT_CHUNK];
    const uint32_t first = first_residual(c->problem);
    LG_TRY(first_points(tape, c));
    if (first == 0) LG_TRY(put_point(tape, c, 0, at));
    for (uint32_t j = 0; j + 1 < c->problem->window; j++) {
        LG_TRY(pass_interval(tape, c, j, at));
        LG_TRY(put_point(tape, c, j + 1, at));
    }
    return LG_OK;
}

/* ---- long windows ---- */

/* A window of M rows is a system of M - 1 equations z_{j+1} = F_j(z_j). Newton's method solves all of them at
 * the same time, from the logged rows: F_j and dF_j/dz are computed for many rows at once, and
 *   d_{j+1} = F_j(z_j) - z_{j+1} + dF_j/dz d_j
 * is the change of z_{j+1}. A machine whose runs do not spread fast needs few rounds. */
enum { LONG = 512, ROUNDS = 12 };

typedef struct run {
    chain *of;      /* one window */
    double *z;      /* (M, numbers) */
    double *F;      /* (M - 1, numbers) */
    double *A, *B;  /* (M - 1, d, d), (M - 1, d, shared) */
    double *memory; /* of the batches of rows */
    size_t *start;  /* (LG_FIT_CHUNK) */
} run;

static size_t run_numbers(const chain *c, size_t batch) {
    const size_t M = c->problem->window, d = c->axes.count, n = c->axes.numbers;
    return M * (2 * n + d * d + d * c->shared) + batch;
}

/* F, A and B of all intervals at z. */
static lg_status evaluate_run(lg_tape *tape, run *x) {
    const chain *c = x->of;
    const size_t n = c->axes.numbers, d = c->axes.count, all = c->problem->window - 1,
                 first = row_of(c, 0, 0);
    lg_machine_problem rows = *c->problem;
    uint32_t samples[LG_FIT_CHUNK];
    size_t at[LG_FIT_CHUNK];
    rows.start = x->start;
    for (size_t j = 0; j < all; j += LG_FIT_CHUNK) {
        const size_t count = all - j < LG_FIT_CHUNK ? all - j : LG_FIT_CHUNK;
        chain batch = *c;
        for (size_t s = 0; s < count; s++) samples[s] = (uint32_t)s, x->start[s] = first + j + s;
        batch.problem = &rows;
        batch.samples = samples;
        batch.count = count;
        batch.own = 0;
        batch.columns = c->shared;
        place(&batch, x->memory);
        memcpy(batch.z, x->z + j * n, count * n * sizeof *batch.z);
        LG_TRY(pass_interval(tape, &batch, 0, at));
        memcpy(x->F + j * n, batch.next, count * n * sizeof *x->F);
        memcpy(x->A + j * d * d, batch.A, count * d * d * sizeof *x->A);
        memcpy(x->B + j * d * c->shared, batch.S, count * d * c->shared * sizeof *x->B);
    }
    return LG_OK;
}

/* One round of Newton's method; returns the largest change, in scaled units. */
static double correct_run(run *x) {
    const size_t n = x->of->axes.numbers, all = x->of->problem->window - 1;
    double change[NUMBERS] = {0}, next[NUMBERS], most = 0;
    for (size_t j = 0; j < all; j++) {
        double *z = x->z + (j + 1) * n;
        for (size_t i = 0; i < n; i++) {
            next[i] = x->F[j * n + i] - z[i];
            for (size_t k = 0; k < n; k++) next[i] += x->A[(j * n + i) * n + k] * change[k];
            most = fabs(next[i]) <= most ? most : fabs(next[i]);
        }
        for (size_t i = 0; i < n; i++) z[i] += change[i] = next[i];
    }
    return most;
}

/* Logged rows as first guesses; where a number is missing, the one before. */
static void guess_run(run *x) {
    const chain *c = x->of;
    const lg_machine *machine = c->problem->machine;
    const size_t n = c->axes.numbers;
    double there[NUMBERS];
    memcpy(x->z, c->z, n * sizeof *x->z);
    for (uint32_t j = 1; j < c->problem->window; j++) {
        const size_t row = row_of(c, 0, j);
        double *z = x->z + j * n;
        lg_machine_scaled_rows(machine, &c->problem->log, &row, 1, z, z + machine->positions);
        lg_machine_weigh_row(c->problem, row, 1.0, there, there + machine->positions);
        for (size_t i = 0; i < machine->positions; i++)
            if (there[i] == 0.0) z[i] = (z - n)[i];
    }
}

/* Solves for a whole window. *found false: the rounds do not converge. */
static lg_status solve_run(lg_tape *tape, run *x, bool *found) {
    static const double enough = 1e-10, beyond = 1e6;
    guess_run(x);
    *found = false;
    for (int round = 0; round < ROUNDS && !*found; round++) {
        LG_TRY(evaluate_run(tape, x));
        const double most = correct_run(x);
        if (!(most < beyond)) return LG_OK;
        *found = most < enough;
    }
    return LG_OK;
}

static bool along_only(const axes *all) {
    for (uint32_t i = 0; i < all->count; i++)
        if (all->each[i].kind != ALONG) return false;
    return true;
}

/* S of point j + 1 from S of point j. */
static void pass_S(const lg_kernels *k, run *x, uint32_t j) {
    chain *c = x->of;
    const size_t d = c->axes.count;
    memset(c->moved, 0, d * c->columns * sizeof *c->moved);
    for (size_t i = 0; i < d; i++)
        memcpy(c->moved + i * c->columns, x->B + (j * d + i) * c->shared, c->shared * sizeof *c->moved);
    if (j > 0 || c->own > 0)
        k->gemm(d, c->columns, d, x->A + j * d * d, d, 1, c->S, c->columns, c->moved, c->columns, true);
    double *spare = c->S;
    c->S = c->moved;
    c->moved = spare;
}

/* As pass_window, for a chain of one window. */
static lg_status pass_long(lg_tape *tape, chain *c, run *x) {
    bool found;
    LG_TRY(first_points(tape, c));
    LG_TRY(solve_run(tape, x, &found));
    if (!found) return pass_window(tape, c);
    if (first_residual(c->problem) == 0) put_rows(tape->k, c, 0);
    for (uint32_t j = 0; j + 1 < c->problem->window; j++) {
        pass_S(tape->k, x, j);
        memcpy(c->z, x->z + (j + 1) * c->axes.numbers, c->axes.numbers * sizeof *c->z);
        put_rows(tape->k, c, j + 1);
    }
    return LG_OK;
}

/* The part of the loss of one window that comes from the steps: see shard_floor. */
static lg_status add_floor(lg_tape *tape, chain *c, run *x, double *floor) {
    const size_t numbers = c->problem->window * c->axes.numbers;
    const double power = ldexp(1.0, c->problem->scheme->order), factor = c->factor * power / (power - 1.0);
    lg_machine_problem twice = *c->problem;
    const lg_machine_problem *once = c->problem;
    double weight[NUMBERS], *before = lg_pool_take(tape, numbers * sizeof *before);
    bool found[2] = {false, false};
    if (before == NULL) return lg_tape_status(tape);
    lg_status status = first_points(tape, c);
    if (status == LG_OK) status = solve_run(tape, x, &found[0]);
    memcpy(before, x->z, numbers * sizeof *before);
    twice.substeps *= 2;
    c->problem = &twice;
    if (status == LG_OK) status = solve_run(tape, x, &found[1]);
    c->problem = once;
    if (!found[0] || !found[1]) *floor = (double)NAN;
    for (uint32_t j = first_residual(once); status == LG_OK && j < once->window; j++) {
        lg_machine_weigh_row(once, row_of(c, 0, j), factor, weight, weight + once->machine->positions);
        for (size_t i = 0, k = j * c->axes.numbers; i < c->axes.numbers; i++, k++) {
            const double r = weight[i] * (x->z[k] - before[k]);
            *floor += r * r;
        }
    }
    lg_pool_give(tape, before, numbers * sizeof *before);
    return status;
}

/* Each window by itself. floor: if not NULL, it is computed in place of everything else. */
static lg_status pass_each(lg_tape *tape, chain *all, double *floor) {
    chain batch = *all;
    size_t start[LG_FIT_CHUNK];
    batch.count = LG_FIT_CHUNK;
    batch.own = 0;
    batch.columns = all->shared;
    const size_t room = chain_numbers(&batch), M = all->problem->window, n = all->axes.numbers,
                 d = all->axes.count, bytes = run_numbers(all, room) * sizeof(double);
    run x = {.z = lg_pool_take(tape, bytes), .start = start};
    if (x.z == NULL) return lg_tape_status(tape);
    double loss = 0.0;
    x.F = x.z + M * n;
    x.A = x.F + M * n;
    x.B = x.A + M * d * d;
    x.memory = x.B + M * d * all->shared;
    lg_status status = LG_OK;
    for (size_t s = 0; s < all->count && status == LG_OK; s++) {
        chain one = *all;
        one.count = 1;
        one.samples = all->samples + s;
        if (all->r != NULL) {
            one.r = all->r + s * all->rows;
            one.jacobian = all->jacobian + s * all->rows * all->columns;
        }
        x.of = &one;
        status = floor != NULL ? add_floor(tape, &one, &x, floor) : pass_long(tape, &one, &x);
        loss += one.loss;
    }
    all->loss = loss;
    lg_pool_give(tape, x.z, bytes);
    return status;
}

bool lg_machine_is_long(const lg_machine_problem *problem) {
    const axes all = axes_of(problem->machine);
    return problem->window >= LONG && problem->machine->bristles == 0 && along_only(&all) &&
           !problem->machine->accelerations;
}

static lg_status run_chain(const lg_machine_problem *problem, lg_tape *tape, const double *theta,
                           const uint32_t *samples, size_t count, size_t batch, double *loss, double *floor,
                           double *r, double *jacobian) {
    const uint32_t first = first_residual(problem);
    chain c = {.problem = problem,
               .theta = theta,
               .samples = samples,
               .count = count,
               .shared = lg_machine_shared(problem),
               .own = first == 0 ? lg_machine_start_numbers(problem->machine) : 0,
               .rows = lg_machine_linearised_rows(problem),
               .factor = 1.0 / sqrt((double)batch * (double)(problem->window - first)),
               .axes = axes_of(problem->machine),
               .r = r,
               .jacobian = jacobian};
    c.columns = c.shared + c.own;
    const size_t bytes = chain_numbers(&c) * sizeof(double);
    double *memory = lg_pool_take(tape, bytes);
    if (memory == NULL) return lg_tape_status(tape);
    place(&c, memory);
    const lg_status status = lg_machine_is_long(problem) ? pass_each(tape, &c, floor) : pass_window(tape, &c);
    if (status == LG_OK) put_priors(&c, batch);
    lg_pool_give(tape, memory, bytes);
    *loss = c.loss;
    return status;
}

lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    return run_chain(user, tape, theta, samples, count, batch, loss, NULL, r, jacobian);
}

lg_status lg_machine_long_loss(const lg_machine_problem *problem, lg_tape *tape, const double *theta,
                               const uint32_t *samples, size_t count, size_t batch, double *loss,
                               double *floor) {
    return run_chain(problem, tape, theta, samples, count, batch, loss, floor, NULL, NULL);
}
