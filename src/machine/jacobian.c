/* Machines: residuals of windows and their Jacobian, computed interval by interval.
 *
 * z = (positions, velocities) of a row, in the order of logs. An interval maps z of one row to z of the next
 * row, z' = F(z, theta). A change of z has d components along axes: one for each place and velocity, three
 * rotations of a direction (a x q) and three of a rotation (R hat(a)). S = dz/d(theta, numbers of the
 * window's start) has the shape (d, columns) and follows
 *   S' = A S + (dF/dtheta, 0),  A = dF/dz.
 * One row of A and dF/dtheta takes one reverse sweep over all windows of the chunk. If theta is known, S has
 * no columns for it. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "liegrad/geometry.h"
#include "machine/internal.h"

enum { NUMBERS = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };

/* ---- axes ---- */

typedef struct axis {
    enum { ALONG, TURN_DIRECTION, TURN_ROTATION } kind;
    uint32_t first; /* index in z of the only number that changes, or of the first of 3 or 9 */
    uint32_t turn;  /* index of the rotation axis, in space for a direction, in the body for a rotation */
} axis;

typedef struct axes {
    uint32_t count, numbers; /* d; numbers of z */
    axis each[NUMBERS];
} axes;

static void add_axes(axes *all, int kind, uint32_t first, uint32_t count) {
    for (uint32_t k = 0; k < count; k++)
        all->each[all->count++] =
            kind == ALONG ? (axis){ALONG, first + k, 0} : (axis){.kind = kind, .first = first, .turn = k};
}

/* Axes in the order of the numbers of a start: places, directions, rotations, velocities. */
static axes axes_of(const lg_machine *machine) {
    axes all = {.numbers = machine->positions + machine->velocities};
    for (int kind = ALONG; kind <= TURN_ROTATION; kind++)
        for (uint32_t i = 0; i < machine->coordinate_count; i++) {
            const lg_coordinate_row *row = lg_coordinate_row_of(machine->coordinates[i].kind);
            const uint32_t first = lg_machine_offsets_of(machine, i).position;
            if (kind == ALONG) add_axes(&all, kind, first, row->places);
            if (kind == TURN_DIRECTION && row->directions > 0) add_axes(&all, kind, first, 3);
            if (kind == TURN_ROTATION && row->rotations > 0) add_axes(&all, kind, first + row->places, 3);
        }
    add_axes(&all, ALONG, machine->positions, machine->velocities);
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
    double *r, *jacobian;
    double loss;
    size_t done; /* rows of r and jacobian that are filled in each window */
} chain;

static size_t chain_numbers(const chain *c) {
    const size_t d = c->axes.count;
    return c->count * (3 * c->axes.numbers + d * d + c->shared + 2 * d * c->columns);
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
}

/* ---- sweeps ---- */

static lg_var joined(lg_tape *tape, lg_var positions, lg_var velocities) {
    const lg_var both[2] = {positions, velocities};
    return lg_concat(tape, both, 2, 1);
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

/* Moves z and S over the interval from point j to point j + 1. */
static lg_status pass_interval(lg_tape *tape, chain *c, uint32_t j, size_t *at) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t n = c->axes.numbers, rows = (uint32_t)c->count;
    const size_t d = c->axes.count;
    lg_machine_vars vars;
    lg_var theta, parts[LG_TAPED_MAX_PARTS];
    lg_tape_reset(tape);
    LG_TRY(bind(tape, c, &theta, &vars));
    lg_machine_flow flow = {.vars = &vars, .scheme = c->problem->scheme, .substeps = c->problem->substeps};
    LG_TRY(lg_machine_space(machine, &flow.space));
    for (size_t s = 0; s < c->count; s++) at[s] = row_of(c, s, j);
    const lg_var from = lg_input_f64(tape, lg_shape2(rows, n), c->z);
    lg_tape_mark_rows(tape, from);
    LG_TRY(lg_machine_record_state(tape, &vars, lg_machine_columns(tape, from, 0, machine->positions),
                                   lg_machine_columns(tape, from, machine->positions, machine->velocities),
                                   parts));
    LG_TRY(lg_machine_record_interval(tape, &flow, &c->problem->log, at, rows, parts));
    const lg_var to = joined(tape, lg_machine_record_positions(tape, &vars, parts),
                             lg_machine_record_velocities(tape, &vars, parts));
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
    const lg_var z = joined(tape, lg_machine_record_positions(tape, &vars, parts),
                            lg_machine_record_velocities(tape, &vars, parts));
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

/* ---- residuals ---- */

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
    const size_t d = c->axes.count;
    double data[NUMBERS], weight[NUMBERS], r[NUMBERS];
    for (size_t s = 0; s < c->count; s++) {
        const size_t row = row_of(c, s, j), first = s * c->rows + c->done;
        const double *z = c->z + s * c->axes.numbers;
        lg_machine_scaled_rows(machine, &c->problem->log, &row, 1, data, data + machine->positions);
        lg_machine_weigh_row(c->problem, row, c->factor, weight, weight + machine->positions);
        for (uint32_t i = 0; i < c->axes.numbers; i++) {
            r[i] = weight[i] * (z[i] - data[i]);
            if (i < machine->positions) c->loss += r[i] * r[i];
        }
        for (size_t i = 0; i < d; i++) {
            const axis *a = &c->axes.each[i];
            const double length = sqrt(square_of(a));
            double *out = c->jacobian + (first + i) * c->columns;
            c->r[first + i] = component(a, z, r) / length;
            k->fill(c->columns, 0.0, out);
            k->axpy(c->columns, length * weight[a->first], c->S + (s * d + i) * c->columns, out);
        }
        double *of_v = c->r + first + d - machine->velocities;
        if (machine->directions > 0)
            keep_across(c, row, of_v, c->jacobian + (first + d - machine->velocities) * c->columns);
        for (uint32_t i = 0; i < machine->velocities; i++) c->loss += of_v[i] * of_v[i];
    }
    c->done += d;
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
            memset(c->jacobian + row * c->columns, 0, c->columns * sizeof *c->jacobian);
            c->jacobian[row * c->columns + column] = weight * slope / p->sigma;
            c->r[row] = r;
            c->loss += r * r;
        }
    }
}

static uint32_t first_residual(const lg_machine_problem *problem) {
    return lg_machine_starts_estimated(problem) ? 0 : 1;
}

size_t lg_machine_linearised_rows(const lg_machine_problem *problem) {
    return (size_t)(problem->window - first_residual(problem)) * axes_of(problem->machine).count +
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
    for (uint32_t i = 0; i < all.numbers; i++) share[i] = share[i] != 0.0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        const lg_machine_offsets at = lg_machine_offsets_of(machine, i);
        const double position = factor * noise->position[i] / problem->position_scale[i],
                     velocity = factor * noise->velocity[i] / problem->velocity_scale[i];
        double *of_q = share + at.position, *of_v = share + machine->positions + at.velocity;
        for (uint32_t k = 0; k < lg_coordinate_positions(kind); k++) of_q[k] *= position * position;
        for (uint32_t k = 0; k < lg_coordinate_row_of(kind)->velocities; k++) of_v[k] *= velocity * velocity;
    }
    for (uint32_t i = 0; i < all.count; i++) {
        const axis *a = &all.each[i];
        const double by = a->kind == TURN_DIRECTION        ? q[a->first + a->turn]
                          : a->first >= machine->positions ? along[a->first - machine->positions]
                                                           : 0.0;
        out[i] = isnan(share[a->first]) ? 0.0 : share[a->first];
        part[i] = isnan(by) ? 0.0 : 1.0 - by * by;
    }
}

static lg_status pass_window(lg_tape *tape, chain *c) {
    size_t at[LG_FIT_CHUNK];
    const uint32_t first = first_residual(c->problem);
    LG_TRY(first_points(tape, c));
    if (first == 0) put_rows(tape->k, c, 0);
    for (uint32_t j = 0; j + 1 < c->problem->window; j++) {
        LG_TRY(pass_interval(tape, c, j, at));
        put_rows(tape->k, c, j + 1);
    }
    return LG_OK;
}

lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian) {
    const lg_machine_problem *problem = user;
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
    const lg_status status = pass_window(tape, &c);
    if (status == LG_OK) put_priors(&c, batch);
    lg_pool_give(tape, memory, bytes);
    *loss = c.loss;
    return status;
}
