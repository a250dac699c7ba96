/* Machines: the motion of windows and its derivatives, from row to row. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/chain.h"

/* ---- memory ---- */

/* Places the arrays one after the other in `memory` (NULL: only counts); returns the number of their
 * elements. */
static size_t place(lg_chain *c, double *memory) {
    const lg_machine *machine = c->problem->machine;
    const size_t n = c->count * c->axes.numbers, d = c->axes.count, S = c->count * d * c->columns,
                 shown = machine->accelerations ? c->count * machine->velocities : 0;
    const struct {
        double **at;
        size_t length;
    } arrays[] = {{&c->z, n},
                  {&c->next, n},
                  {&c->dz, n},
                  {&c->A, c->count * d * d},
                  {&c->apart, c->count * c->shared},
                  {&c->S, S},
                  {&c->moved, S},
                  {&c->a, shown},
                  {&c->of_a, shown * c->columns}};
    size_t sum = 0;
    for (size_t i = 0; i < LG_COUNT(arrays); sum += arrays[i++].length)
        if (memory != NULL) *arrays[i].at = memory + sum;
    return sum;
}

lg_status lg_chain_open(lg_tape *tape, const lg_machine_problem *problem, const double *theta,
                        const uint32_t *samples, size_t first, size_t count, bool derived, lg_chain *c) {
    const lg_machine *machine = problem->machine;
    *c = (lg_chain){.tape = tape,
                    .problem = problem,
                    .theta = theta,
                    .count = count,
                    .shared = lg_machine_shared(problem),
                    .own = lg_machine_own(problem),
                    .axes = lg_row_axes_of(machine)};
    if (derived) c->columns = c->shared + c->own;
    for (size_t s = 0; s < count; s++) c->samples[s] = samples != NULL ? samples[s] : (uint32_t)(first + s);
    c->bytes = place(c, NULL) * sizeof(double);
    c->memory = lg_pool_take(tape, c->bytes);
    if (c->memory == NULL) return lg_tape_status(tape);
    (void)place(c, c->memory);
    return LG_OK;
}

void lg_chain_close(lg_chain *c) {
    if (c->memory != NULL) lg_pool_give(c->tape, c->memory, c->bytes);
    c->memory = NULL;
}

/* Whether derivatives are wanted. */
static bool derives(const lg_chain *c) {
    return c->columns > 0;
}

/* ---- sweeps ---- */

/* Sum over windows of z's component along an axis, which is z . c/|c|^2 with c the change along the axis at
 * c->next, the value of z. */
static lg_var sum_along(const lg_chain *c, lg_var z, const lg_row_axis *a) {
    void *memory;
    const lg_var seed = lg_input_buffer(c->tape, lg_var_shape(c->tape, z), &memory);
    if (lg_is_none(seed)) return seed;
    double along[9];
    memset(memory, 0, c->count * c->axes.numbers * sizeof(double));
    for (size_t s = 0; s < c->count; s++) {
        const size_t at = s * c->axes.numbers;
        lg_row_axis_change(a, c->next + at, along);
        for (uint32_t i = 0; i < lg_row_axis_width(a); i++)
            ((double *)memory)[at + a->first + i] = along[i] / lg_row_axis_square(a);
    }
    return lg_sum(c->tape, lg_mul(c->tape, z, seed));
}

/* The states of the current points on the tape. */
typedef struct recorded {
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var theta, z, parts[LG_TAPED_MAX_PARTS];
} recorded;

/* Row i of the derivatives of `rows` numbers of each window, from the sum of this number over windows: by z
 * along the axes into A (count, rows, d), by theta into the first columns of B (count, rows, columns), whose
 * other columns become 0. */
static lg_status sweep(lg_chain *c, const recorded *x, lg_var sum, size_t rows, size_t i, double *B) {
    const size_t d = c->axes.count;
    void *const dz = c->dz;
    if (c->shared == 0)
        LG_TRY(lg_backward_set(c->tape, sum, &x->z, 1, &dz));
    else
        LG_TRY(lg_backward_rows(c->tape, sum, x->z, c->dz, x->theta, c->count, c->apart));
    for (size_t s = 0; s < c->count; s++) {
        const size_t row = s * rows + i, at = s * c->axes.numbers;
        for (size_t j = 0; j < d; j++)
            c->A[row * d + j] = lg_row_axis_component(&c->axes.each[j], c->z + at, c->dz + at);
        memcpy(B + row * c->columns, c->apart + s * c->shared, c->shared * sizeof *B);
        memset(B + row * c->columns + c->shared, 0, c->own * sizeof *B);
    }
    return LG_OK;
}

/* B (count, rows, columns) += A S, with the A of `rows` numbers. */
static void follow(const lg_chain *c, size_t rows, double *B) {
    const size_t d = c->axes.count;
    if (!derives(c) || (c->point == 0 && c->own == 0)) return; /* the start is known */
    for (size_t s = 0; s < c->count; s++)
        c->tape->k->gemm(rows, c->columns, d, c->A + s * rows * d, d, 1, c->S + s * d * c->columns,
                         c->columns, B + s * rows * c->columns, c->columns, true);
}

/* Binds the machine's parameters: known ones, or the first parameters of the fit. */
static lg_status bind(const lg_chain *c, recorded *x) {
    x->theta = lg_machine_problem_parameter(c->tape, c->problem, c->theta);
    return lg_machine_begin_flow(c->tape, c->problem, x->theta, &x->vars, &x->flow);
}

static lg_status record_points(const lg_chain *c, recorded *x) {
    lg_tape *tape = c->tape;
    const lg_machine *machine = c->problem->machine;
    const uint32_t n = c->axes.numbers, rows = (uint32_t)c->count;
    lg_tape_reset(tape);
    LG_TRY(bind(c, x));
    x->z = lg_input_f64(tape, lg_shape2(rows, n), c->z);
    lg_tape_mark_rows(tape, x->z);
    LG_TRY(lg_machine_split_row(tape, &x->vars, x->z, x->parts));
    if (c->point == 0)
        return lg_machine_start_bristles(tape, &x->vars, &c->problem->log, c->at, rows, x->parts);
    if (machine->bristles > 0)
        x->parts[lg_machine_parts(machine).z] =
            lg_machine_columns(tape, x->z, n - machine->bristles, machine->bristles);
    return lg_tape_status(tape);
}

/* Fills `next` and A of the intervals from the current points; `moved` becomes (dF/dtheta, 0). */
static lg_status interval(lg_chain *c) {
    lg_tape *tape = c->tape;
    recorded x;
    if (lg_chain_plan_interval(c)) return LG_OK;
    LG_TRY(record_points(c, &x));
    LG_TRY(lg_machine_record_interval(tape, &x.flow, &c->problem->log, c->at, (uint32_t)c->count, x.parts));
    const lg_var to = lg_machine_join_row(tape, &x.vars, x.parts);
    LG_TRY(lg_read(tape, to, c->count * c->axes.numbers, c->next));
    for (uint32_t i = 0; derives(c) && i < c->axes.count; i++) {
        const lg_mark mark = lg_tape_mark(tape);
        LG_TRY(sweep(c, &x, sum_along(c, to, &c->axes.each[i]), c->axes.count, i, c->moved));
        LG_TRY(lg_tape_rewind(tape, mark));
    }
    return LG_OK;
}

/* ---- starts ---- */

/* Moves the starts by their parameters; S becomes the derivative with respect to these, in the last `own`
 * columns. */
static lg_status move_starts(lg_chain *c) {
    lg_tape *tape = c->tape;
    const lg_machine *machine = c->problem->machine;
    const size_t d = c->axes.count, own = c->own;
    recorded x;
    void *memory;
    lg_tape_reset(tape);
    const lg_var numbers = lg_input_buffer(tape, lg_shape2((uint32_t)c->count, (uint32_t)own), &memory);
    if (lg_is_none(numbers)) return lg_tape_status(tape);
    for (size_t s = 0; s < c->count; s++)
        memcpy((double *)memory + s * own, c->theta + c->shared + c->samples[s] * own, own * sizeof(double));
    LG_TRY(bind(c, &x));
    x.z = lg_input_f64(tape, lg_shape2((uint32_t)c->count, c->axes.numbers), c->z);
    LG_TRY(lg_machine_move_starts(
        tape, c->problem, &x.vars, numbers, lg_machine_columns(tape, x.z, 0, machine->positions),
        lg_machine_columns(tape, x.z, machine->positions, machine->velocities), x.parts));
    const lg_var z = lg_machine_join_row(tape, &x.vars, x.parts);
    LG_TRY(lg_read(tape, z, c->count * c->axes.numbers, c->next));
    memset(c->S, 0, c->count * d * c->columns * sizeof *c->S);
    for (uint32_t i = 0; derives(c) && i < d; i++) {
        const lg_var sum = sum_along(c, z, &c->axes.each[i]);
        void *const into = c->moved; /* (count, own) */
        LG_TRY(lg_backward_set(tape, sum, &numbers, 1, &into));
        for (size_t s = 0; s < c->count; s++)
            memcpy(c->S + (s * d + i) * c->columns + c->shared, c->moved + s * own, own * sizeof(double));
    }
    memcpy(c->z, c->next, c->count * c->axes.numbers * sizeof *c->z);
    return LG_OK;
}

lg_status lg_chain_first_points(lg_chain *c) {
    const lg_machine *machine = c->problem->machine;
    memset(c->z, 0, c->count * c->axes.numbers * sizeof *c->z);
    for (size_t s = 0; s < c->count; s++) {
        double *z = c->z + s * c->axes.numbers;
        c->at[s] = c->problem->start[c->samples[s]];
        lg_machine_scaled_rows(machine, &c->problem->log, &c->at[s], 1, z, z + machine->positions);
    }
    return c->own > 0 ? move_starts(c) : LG_OK;
}

/* ---- accelerations ---- */

lg_status lg_chain_show(lg_chain *c) {
    lg_tape *tape = c->tape;
    const lg_machine *machine = c->problem->machine;
    recorded x;
    if (!machine->accelerations) return LG_OK;
    LG_TRY(record_points(c, &x));
    const lg_var a =
        lg_machine_record_shown(tape, &x.vars, &c->problem->log, c->at, (uint32_t)c->count, x.parts);
    LG_TRY(lg_read(tape, a, c->count * machine->velocities, c->a));
    for (uint32_t k = 0; derives(c) && k < machine->velocities; k++) {
        const lg_mark mark = lg_tape_mark(tape);
        LG_TRY(sweep(c, &x, lg_sum(tape, lg_slice(tape, a, 1, k, 1)), machine->velocities, k, c->of_a));
        LG_TRY(lg_tape_rewind(tape, mark));
    }
    follow(c, machine->velocities, c->of_a);
    return LG_OK;
}

/* ---- residuals ---- */

void lg_chain_shown(const lg_chain *c, size_t s, double *out) {
    const lg_machine *machine = c->problem->machine;
    memcpy(out, c->z + s * c->axes.numbers, c->axes.numbers * sizeof *out);
    if (machine->accelerations)
        memcpy(out + machine->positions, c->a + s * machine->velocities, machine->velocities * sizeof *out);
}

void lg_chain_read(const lg_chain *c, size_t s, double *positions, double *velocities) {
    const lg_machine *machine = c->problem->machine;
    const double *z = c->z + s * c->axes.numbers;
    memcpy(positions, z, machine->positions * sizeof *z);
    memcpy(velocities, z + machine->positions, machine->velocities * sizeof *z);
    lg_machine_unscale_row(machine, positions, velocities);
}

/* The derivatives of the number on axis i of row s. */
static const double *slopes_of(const lg_chain *c, size_t s, size_t i) {
    const lg_machine *machine = c->problem->machine;
    const uint32_t first = c->axes.each[i].first;
    if (machine->accelerations && first >= machine->positions)
        return c->of_a + (s * machine->velocities + first - machine->positions) * c->columns;
    return c->S + (s * c->axes.count + i) * c->columns;
}

/* Removes the components along the logged directions from the velocities' rows (velocities, columns) of the
 * residuals or the Jacobian. */
static void keep_across(const lg_chain *c, size_t row, size_t columns, double *rows) {
    double along[LG_MACHINE_VELOCITIES];
    if (c->problem->machine->directions == 0) return;
    lg_machine_along_row(c->problem, row, along);
    for (lg_machine_offsets at = {0}; lg_machine_next(c->problem->machine, &at);)
        for (size_t j = 0; at.directions > 0 && j < columns; j++) {
            const double *q = along + at.velocity;
            double *x = rows + at.velocity * columns + j;
            const double dot = q[0] * x[0] + q[1] * x[columns] + q[2] * x[2 * columns];
            for (size_t m = 0; m < 3; m++) x[m * columns] -= dot * q[m];
        }
}

void lg_chain_add(lg_chain *c, size_t s, double r) {
    c->loss += r * r;
    if (c->losses != NULL) c->losses[s] += r * r;
}

/* Adds the residuals of the current points of all windows to the loss, and writes the rows of r and of the
 * Jacobian: the residual along each axis, and S times the weight. */
static void put_rows(lg_chain *c) {
    const lg_kernels *k = c->tape->k;
    const lg_machine *machine = c->problem->machine;
    const size_t seen = c->axes.seen, numbers = machine->positions + machine->velocities;
    double z[LG_CHAIN_NUMBERS], data[LG_CHAIN_NUMBERS], weight[LG_CHAIN_NUMBERS], r[LG_CHAIN_NUMBERS];
    for (size_t s = 0; s < c->count; s++) {
        const size_t row = c->at[s], first = s * c->rows + c->done;
        lg_chain_shown(c, s, z);
        if (c->against != NULL)
            lg_chain_shown(c->against, s, data);
        else
            lg_machine_shown_row(machine, &c->problem->log, row, data, data + machine->positions);
        lg_machine_weigh_row(c->problem, row, c->factor, weight, weight + machine->positions);
        for (uint32_t i = 0; i < numbers; i++) r[i] = weight[i] * (z[i] - data[i]);
        keep_across(c, row, 1, r + machine->positions);
        for (uint32_t i = 0; i < numbers; i++) lg_chain_add(c, s, r[i]);
        if (c->r == NULL) continue;
        for (size_t i = 0; i < seen; i++) {
            const lg_row_axis *a = &c->axes.each[i];
            const double length = sqrt(lg_row_axis_square(a));
            double *out = c->jacobian + (first + i) * c->columns;
            c->r[first + i] = lg_row_axis_component(a, z, r) / length;
            k->fill(c->columns, 0.0, out);
            k->axpy(c->columns, length * weight[a->first], slopes_of(c, s, i), out);
        }
        keep_across(c, row, c->columns, c->jacobian + (first + seen - machine->velocities) * c->columns);
    }
    c->done += seen;
}

/* ---- whole windows ---- */

uint32_t lg_chain_first(const lg_machine_problem *problem) {
    return lg_machine_starts_estimated(problem) ? 0 : 1;
}

lg_status lg_chain_advance(lg_chain *c) {
    double *spare = c->S;
    LG_TRY(interval(c));
    follow(c, c->axes.count, c->moved);
    c->S = c->moved;
    c->moved = spare;
    memcpy(c->z, c->next, c->count * c->axes.numbers * sizeof *c->z);
    c->point++;
    for (size_t s = 0; s < c->count; s++) c->at[s]++;
    return LG_OK;
}

/* Goes to the first points, or with `on` to the next ones, and puts their rows where they have residuals. */
static lg_status pass_point(lg_chain *c, bool on) {
    for (lg_chain *each = c; each != NULL; each = each->against) {
        LG_TRY((on ? lg_chain_advance : lg_chain_first_points)(each));
        if (each->point >= lg_chain_first(each->problem)) LG_TRY(lg_chain_show(each));
    }
    if (c->point >= lg_chain_first(c->problem)) put_rows(c);
    return LG_OK;
}

lg_status lg_chain_pass_windows(lg_chain *c) {
    LG_TRY(pass_point(c, false));
    while (c->point + 1 < c->problem->window) LG_TRY(pass_point(c, true));
    return LG_OK;
}
