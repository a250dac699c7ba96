/* Solves equations on a tape, one system for each row of a batch, by Newton's method on plain numbers; what
 * it records is rewound. With the solution x* and the constant matrix K = (dr/dx)^-1 at x*, the tape keeps
 *
 *   x1 = x* - K r(x*),   x2 = x1 - K r(x1).
 *
 * Let x(p) be the solution for the parameters p, with x(p0) = x*. As I - K dr/dx vanishes at (x*, p0), the
 * error x1 - x(p) is of second order in p - p0, and x2 - x(p) is of third order. So the first and second
 * derivatives of x2 with respect to p are exact.
 *
 * A program's numbers are not known while it is recorded. Then six such steps from the first guess are
 * recorded, each with the inverse at its point. Rows whose last step is above 1e-5 (scale + largest |x|)
 * become infinite or NaN. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "integrators/stepper.h"
#include "integrators/taped_internal.h"
#include "kernels/matrix.h"

typedef struct newton {
    lg_tape *tape;
    const lg_root *of;
    size_t rows, n;
    double eps;
    double *x, *r, *column, *seed; /* (rows, n) */
    double *matrix, *inverse;      /* (rows, n, n): dr/dx and its inverse K */
    double *change;                /* (rows): largest change in the last step; 0: done */
    size_t *pivot;                 /* (n) */
} newton;

/* r and dr/dx at x. Each column takes one forward pass for all rows at once. */
static lg_status linearise(newton *s) {
    const size_t n = s->n, count = s->rows * n;
    const lg_mark mark = lg_tape_mark(s->tape);
    const lg_shape shape = lg_shape2((uint32_t)s->rows, (uint32_t)n);
    const lg_var x = lg_input_f64(s->tape, shape, s->x);
    lg_var r;
    LG_TRY(s->of->equations(s->of->user, s->tape, x, &r));
    LG_TRY(lg_read(s->tape, r, count, s->r));
    const lg_mark recorded = lg_tape_mark(s->tape);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < count; i++) s->seed[i] = i % n == j ? 1.0 : 0.0;
        const lg_var direction = lg_input_f64(s->tape, shape, s->seed);
        lg_var moved;
        LG_TRY(lg_jvp(s->tape, &r, 1, &x, &direction, 1, &moved));
        LG_TRY(lg_read(s->tape, moved, count, s->column));
        for (size_t i = 0; i < count; i++) s->matrix[i * n + j] = s->column[i];
        LG_TRY(lg_tape_rewind(s->tape, recorded));
    }
    return lg_tape_rewind(s->tape, mark);
}

/* One Newton step in row b. The row is done when its change is rounding error: a few eps of x, or small and
 * hardly smaller than the change before. Without a solution it becomes NaN. */
static void improve(newton *s, size_t b, bool last) {
    const size_t n = s->n;
    double *x = s->x + b * n, *K = s->inverse + b * n * n, moved = 0.0, size = 0.0;
    const bool regular = lg_matrix_invert(n, s->matrix + b * n * n, s->pivot, K);
    for (size_t i = 0; i < n && regular; i++) {
        double change = 0.0;
        for (size_t j = 0; j < n; j++) change += K[i * n + j] * s->r[b * n + j];
        x[i] -= change;
        moved = fmax(moved, isfinite(change) ? fabs(change) : INFINITY);
        size = fmax(size, fabs(x[i]));
    }
    const bool found = regular && moved < INFINITY;
    const bool rounding =
        moved <= 4.0 * s->eps * size ||
        (moved >= 0.25 * s->change[b] && moved <= 1024.0 * s->eps * fmax(size, s->of->scale));
    s->change[b] = found && !rounding ? moved : 0.0;
    for (size_t i = 0; (!found || (last && !rounding)) && i < n; i++) x[i] = (double)NAN;
}

static lg_status solve(newton *s) {
    enum { LONGEST = 30 };
    const size_t count = s->rows * s->n;
    size_t open = s->rows;
    for (size_t b = 0; b < s->rows; b++) s->change[b] = INFINITY;
    for (int i = 1; i <= LONGEST && open > 0; i++) {
        LG_TRY(linearise(s));
        if (i == 1 && s->of->part != NULL && !lg_all_finite(count, s->r)) return LG_NOT_FINITE;
        open = 0;
        for (size_t b = 0; b < s->rows; b++) {
            if (s->change[b] > 0.0) improve(s, b, i == LONGEST);
            open += s->change[b] > 0.0;
        }
    }
    return s->of->part != NULL && !lg_all_finite(count, s->x) ? LG_NO_CONVERGENCE : LG_OK;
}

/* Solves for the whole step from x = 0. If Newton's method fails, the equations are solved for 4, 16 or 64
 * increasing parts of the step. Each guess is the solution before, scaled by the ratio of the parts, as x is
 * nearly proportional to the step. */
static lg_status solve_parts(newton *s) {
    enum { PARTS_MAX = 64 };
    const size_t count = s->rows * s->n;
    lg_status status = LG_NO_CONVERGENCE;
    for (int parts = 1; parts <= PARTS_MAX && lg_root_failed(status); parts *= 4) {
        memset(s->x, 0, count * sizeof *s->x);
        status = LG_OK;
        for (int part = 1; part <= parts && status == LG_OK; part++) {
            s->of->part(s->of->user, part, parts);
            for (size_t i = 0; part > 1 && i < count; i++) s->x[i] *= (double)part / (part - 1);
            status = solve(s);
        }
    }
    return status;
}

/* Returns x* and K as constants. The work space is payload of the tape; rewinding frees it. */
static lg_status solution(newton *s, lg_var first, lg_var *x, lg_var *inverse) {
    lg_tape *tape = s->tape;
    const size_t count = s->rows * s->n;
    const uint32_t rows = (uint32_t)s->rows, n = (uint32_t)s->n;
    void *x_values = NULL, *inverse_values = NULL;
    *x = lg_input_buffer(tape, lg_shape2(rows, n), &x_values);
    *inverse = lg_input_buffer(tape, lg_shape3(rows, n, n), &inverse_values);
    LG_TRY(lg_tape_status(tape));
    lg_tape_mark_rows(tape, *x);
    lg_tape_mark_rows(tape, *inverse);
    const lg_mark mark = lg_tape_mark(tape);
    const size_t numbers = count * (4 + 2 * s->n) + s->rows;
    double *memory = lg_payload_allocate(tape, numbers * sizeof(double) + s->n * sizeof(size_t));
    if (memory == NULL) return lg_tape_status(tape);
    s->x = memory;
    s->r = s->x + count;
    s->column = s->r + count;
    s->seed = s->column + count;
    s->matrix = s->seed + count;
    s->inverse = s->matrix + count * s->n;
    s->change = s->inverse + count * s->n;
    s->pivot = (size_t *)(void *)(memory + numbers);
    LG_TRY(lg_read(tape, first, count, s->x));
    LG_TRY(s->of->part != NULL ? solve_parts(s) : solve(s));
    tape->k->convert_in(count, s->x, x_values);
    tape->k->convert_in(count * s->n, s->inverse, inverse_values);
    return lg_tape_rewind(tape, mark);
}

bool lg_root_failed(lg_status status) {
    return status == LG_NO_CONVERGENCE || status == LG_NOT_FINITE;
}

/* Records K = (J^T J)^-1 J^T with J = dr/dx, (rows, n, n), where r is a function of x on the tape. n, of
 * the velocities or constraints of a model, is below MOST. */
static lg_status record_inverse(lg_tape *tape, lg_var r, lg_var x, lg_var *K) {
    enum { MOST = 128 };
    const double unit[2 * MOST] = {[MOST] = 1.0};
    const lg_shape shape = lg_var_shape(tape, x);
    const uint32_t n = shape.dims[1];
    lg_var row[MOST];
    for (uint32_t j = 0; j < n; j++) {
        const lg_var along =
            lg_broadcast_to(tape, lg_input_f64(tape, lg_shape2(1, n), unit + MOST - j), shape);
        LG_TRY(lg_jvp(tape, &r, 1, &x, &along, 1, &row[j]));
        row[j] = lg_reshape(tape, row[j], lg_shape3(shape.dims[0], 1, n));
    }
    const lg_var J = lg_joined(tape, row, n); /* transposed */
    *K = lg_spd_solve(tape, lg_matmul_nt(tape, J, J), J);
    return lg_tape_status(tape);
}

lg_status lg_taped_root(lg_tape *tape, const lg_root *of, lg_var first, lg_var *x) {
    const lg_shape shape = lg_var_shape(tape, first);
    const bool program = tape->calls != NULL;
    LG_TRY(lg_tape_status(tape));
    newton s = {.tape = tape,
                .of = of,
                .rows = shape.dims[0],
                .n = shape.dims[1],
                .eps = lg_tape_dtype(tape) == LG_F64 ? DBL_EPSILON : FLT_EPSILON};
    lg_var inverse, change;
    *x = first;
    if (!program) LG_TRY(solution(&s, first, x, &inverse));
    for (int i = 0; i < (program ? 6 : 2); i++) {
        lg_var r;
        LG_TRY(of->equations(of->user, tape, *x, &r));
        if (program) LG_TRY(record_inverse(tape, r, *x, &inverse));
        const lg_var column = lg_reshape(tape, r, lg_shape3(shape.dims[0], shape.dims[1], 1));
        change = lg_reshape(tape, lg_matmul(tape, inverse, column), shape);
        *x = lg_sub(tape, *x, change);
    }
    if (!program) return lg_tape_status(tape);
    const lg_var moved = lg_max_axis(tape, lg_abs(tape, change), 1, true);
    const lg_var size = lg_add_scalar(tape, lg_max_axis(tape, lg_abs(tape, *x), 1, true), of->scale);
    *x = lg_div(tape, *x, lg_ge(tape, lg_scale(tape, size, 1e-5), moved));
    return lg_tape_status(tape);
}
