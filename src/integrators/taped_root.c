/* Solves equations on a tape, one system for each row of a batch, by Newton's method on plain numbers.
 *
 * x* is the solution and K = (dr/dx)^-1 at x*; both enter the tape as constants. The tape records x1 = x* - K
 * r(x*) and x2 = x1 - K r(x1), which has the first and second derivatives of the solution; taped_implicit.c
 * says why. A row's result does not depend on the other rows. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "integrators/taped_internal.h"

typedef struct newton {
    lg_tape *tape;
    lg_row_equations equations;
    void *user;
    size_t rows, n;
    double eps;
    double *x, *r, *column, *seed; /* (rows, n) */
    double *matrix, *inverse;      /* (rows, n, n): dr/dx and its inverse K */
    double *change;                /* (rows): largest change in the last step; 0: the row is done */
} newton;

/* r and dr/dx at x. Each column takes one forward pass for all rows at once. */
static lg_status linearise(newton *s) {
    const size_t n = s->n, count = s->rows * n;
    const lg_mark mark = lg_tape_mark(s->tape);
    const lg_shape shape = lg_shape2((uint32_t)s->rows, (uint32_t)n);
    const lg_var x = lg_input_f64(s->tape, shape, s->x);
    lg_var r;
    LG_TRY(s->equations(s->user, s->tape, x, &r));
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

static void give_up(newton *s, size_t b) {
    for (size_t i = 0; i < s->n; i++) s->x[b * s->n + i] = (double)NAN;
    s->change[b] = 0.0;
}

/* One Newton step in row b. The row is done when its change is rounding error: a few eps of x, or small and
 * hardly smaller than the change before. */
static void improve(newton *s, size_t b) {
    const size_t n = s->n;
    double *x = s->x + b * n, *K = s->inverse + b * n * n, moved = 0.0, size = 0.0;
    memcpy(K, s->matrix + b * n * n, n * n * sizeof *K);
    const bool regular = lg_taped_invert(n, K, s->column);
    for (size_t i = 0; regular && i < n; i++) {
        double change = 0.0;
        for (size_t j = 0; j < n; j++) change += K[i * n + j] * s->r[b * n + j];
        x[i] -= change;
        moved = fmax(moved, isfinite(change) ? fabs(change) : INFINITY);
        size = fmax(size, fabs(x[i]));
    }
    if (!regular || !(moved < INFINITY)) {
        give_up(s, b);
        return;
    }
    const bool rounding = moved <= 4.0 * s->eps * size ||
                          (moved >= 0.25 * s->change[b] && moved <= 1024.0 * s->eps * fmax(size, 1.0));
    s->change[b] = rounding ? 0.0 : moved;
}

static lg_status solve(newton *s) {
    enum { LONGEST = 30 };
    size_t open = s->rows;
    for (size_t b = 0; b < s->rows; b++) s->change[b] = INFINITY;
    for (int i = 0; i < LONGEST && open > 0; i++) {
        LG_TRY(linearise(s));
        open = 0;
        for (size_t b = 0; b < s->rows; b++) {
            if (s->change[b] > 0.0) improve(s, b);
            open += s->change[b] > 0.0;
        }
    }
    for (size_t b = 0; b < s->rows; b++)
        if (s->change[b] > 0.0) give_up(s, b);
    return LG_OK;
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
    double *memory = lg_payload_allocate(tape, (count * (4 + 2 * s->n) + s->rows) * sizeof(double));
    if (memory == NULL) return lg_tape_status(tape);
    s->x = memory;
    s->r = s->x + count;
    s->column = s->r + count;
    s->seed = s->column + count;
    s->matrix = s->seed + count;
    s->inverse = s->matrix + count * s->n;
    s->change = s->inverse + count * s->n;
    LG_TRY(lg_read(tape, first, count, s->x));
    LG_TRY(solve(s));
    tape->k->convert_in(count, s->x, x_values);
    tape->k->convert_in(count * s->n, s->inverse, inverse_values);
    return lg_tape_rewind(tape, mark);
}

lg_status lg_taped_root(lg_tape *tape, lg_row_equations equations, void *user, lg_var first, lg_var *x) {
    const lg_shape shape = lg_var_shape(tape, first);
    LG_TRY(lg_tape_status(tape));
    newton s = {.tape = tape,
                .equations = equations,
                .user = user,
                .rows = shape.dims[0],
                .n = shape.dims[1],
                .eps = lg_tape_dtype(tape) == LG_F64 ? DBL_EPSILON : FLT_EPSILON};
    lg_var inverse;
    LG_TRY(solution(&s, first, x, &inverse));
    for (int i = 0; i < 2; i++) {
        lg_var r;
        LG_TRY(equations(user, tape, *x, &r));
        const lg_var column = lg_reshape(tape, r, lg_shape3(shape.dims[0], shape.dims[1], 1));
        *x = lg_sub(tape, *x, lg_reshape(tape, lg_matmul(tape, inverse, column), shape));
    }
    return lg_tape_status(tape);
}
