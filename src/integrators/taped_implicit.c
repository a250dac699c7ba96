/* Implicit steps on the tape. The unknown x solves x = h f(t + theta h, Y(x)); it is an algebra element for
 * each row of the batch. Y(x) is the stage point, and the end of the step is a function of y and x.
 *
 * Newton's method finds the solution x* as plain numbers; what it records is rewound. With the residual
 * r(x) = x - h f(t + theta h, Y(x)) and the constant matrix K = (dr/dx)^-1 at x*, the tape keeps
 *
 *   x1 = x* - K r(x*),   x2 = x1 - K r(x1).
 *
 * Let x(p) be the solution for the parameters p, with x(p0) = x*. As I - K dr/dx vanishes at (x*, p0), the
 * error x1 - x(p) is of second order in p - p0, and x2 - x(p) is of third order. So the first and second
 * derivatives of x2 with respect to p are exact. */
#include "integrators/taped_internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/ops/lie.h"
#include "autodiff/tape/tape_internal.h"
#include "integrators/stepper.h"

typedef struct problem {
    lg_tape *tape;
    const lg_scheme *scheme;
    const lg_taped_ode *ode;
    lg_taped_span over;
    const lg_parts *y;
    uint32_t batch, n; /* number of rows; numbers in an algebra element */
} problem;

/* ---- stages and ends ---- */

/* out = y + weight x on R^n. A part of y may be a tensor; the part of x is reshaped to it. */
static void flat_moved(const problem *s, double weight, const lg_parts *x, lg_parts *out) {
    const size_t parts = lg_taped_parts(&s->ode->space);
    for (size_t p = 0; p < parts; p++) {
        const lg_var y = s->y->part[p];
        out->part[p] =
            lg_taped_moved(s->tape, y, weight, lg_reshape(s->tape, x->part[p], lg_var_shape(s->tape, y)));
    }
}

/* Y = y + theta x */
static void flat_stage(const problem *s, const lg_parts *x, lg_parts *out) {
    flat_moved(s, s->scheme->theta, x, out);
}

static void flat_end(const problem *s, const lg_parts *x, lg_parts *out) {
    flat_moved(s, 1.0, x, out);
}

/* (q + a dq, p + b dp) on R^2m, with y = (q, p) and x = (dq, dp) */
static lg_var moved_pair(const problem *s, lg_var y, lg_var x, double a, double b) {
    const uint32_t m = lg_var_shape(s->tape, y).dims[1] / 2;
    lg_var half[2] = {lg_slice(s->tape, x, 1, 0, m), lg_slice(s->tape, x, 1, m, m)};
    half[0] = lg_scale(s->tape, half[0], a);
    half[1] = lg_scale(s->tape, half[1], b);
    return lg_add(s->tape, y, lg_concat(s->tape, half, 2, 1));
}

/* The stage of LG_SCHEME_SLGI. On T*SO(3), where Ad_g = g and dexp_{-xi}^T = dexp_xi, with x = (xi, n):
 *   Q = exp(theta xi) Q0, M = dexp_xi(mu0 + m) - theta dexp_{theta xi} m, m = exp(-theta xi) n.
 * On R^2m, where Ad and dexp are the identity: q = q0 + theta dq, p = p0 + (1 - theta) dp. */
static void cotangent_stage(const problem *s, const lg_parts *x, lg_parts *out) {
    lg_tape *tape = s->tape;
    const double theta = s->scheme->theta;
    lg_var xi = x->part[0], part_xi = lg_scale(tape, xi, theta);
    lg_var m = lg_so3_exp_rows(tape, lg_neg(tape, part_xi), x->part[1]);
    lg_var whole = lg_so3_dexp_rows(tape, xi, lg_add(tape, s->y->part[1], m));
    out->part[0] = lg_so3_exp_rows(tape, part_xi, s->y->part[0]);
    out->part[1] = lg_taped_moved(tape, whole, -theta, lg_so3_dexp_rows(tape, part_xi, m));
    if (s->ode->space.factors == 2)
        out->part[2] = moved_pair(s, s->y->part[2], x->part[2], theta, 1.0 - theta);
}

/* The end of a step of LG_SCHEME_SLGI: (exp(xi) Q0, exp(xi) mu0 + exp((1 - theta) xi) n); on R^2m: y + x. */
static void cotangent_end(const problem *s, const lg_parts *x, lg_parts *out) {
    lg_tape *tape = s->tape;
    lg_var xi = x->part[0], rest = lg_scale(tape, xi, 1.0 - s->scheme->theta);
    lg_var turned = lg_so3_exp_rows(tape, xi, s->y->part[1]);
    lg_parts end;
    end.part[0] = lg_so3_exp_rows(tape, xi, s->y->part[0]);
    end.part[1] = lg_add(tape, turned, lg_so3_exp_rows(tape, rest, x->part[1]));
    end.part[2] = s->ode->space.factors == 2 ? lg_add(tape, s->y->part[2], x->part[2]) : LG_NONE;
    for (size_t p = 0; p < lg_taped_parts(&s->ode->space); p++) out->part[p] = end.part[p];
}

typedef struct kind_row {
    void (*stage)(const problem *s, const lg_parts *x, lg_parts *out);
    void (*end)(const problem *s, const lg_parts *x, lg_parts *out);
} kind_row;

static const kind_row kinds[LG_SCHEME_KINDS] = {
    [LG_SCHEME_IMPLICIT] = {flat_stage, flat_end},
    [LG_SCHEME_SLGI] = {cotangent_stage, cotangent_end},
};

/* *out = r(x) = x - h f(t + theta h, Y(x)), (B, n). */
static lg_status residual(const problem *s, lg_var x, lg_var *out) {
    const lg_space *space = &s->ode->space;
    lg_parts increment, stage, f;
    LG_TRY(lg_taped_split_algebra(s->tape, space, x, increment.part));
    kinds[s->scheme->kind].stage(s, &increment, &stage);
    const lg_taped_time t = lg_taped_stage_time(&s->over, s->scheme->theta);
    LG_TRY(s->ode->field(s->ode->user, s->tape, t, stage.part, s->over.input, f.part));
    if (!lg_taped_fits(s->tape, space, true, f.part, stage.part, "field")) return lg_tape_status(s->tape);
    lg_var all = lg_taped_join_algebra(s->tape, space, f.part);
    *out = lg_taped_moved(s->tape, x, -s->over.h, lg_taped_by_rows(s->tape, &s->over, all));
    return lg_tape_status(s->tape);
}

/* ---- Newton's method on plain numbers ---- */

/* Each of the B rows has its own system of n equations. */
typedef struct newton {
    double *x, *r;   /* (B, n) */
    double *column;  /* (B, n) */
    double *inverse; /* (B, n, n): dr/dx, then its inverse */
    double *seed;    /* (B, n) */
} newton;

bool lg_taped_invert(size_t n, double *a, double *swaps) {
    for (size_t c = 0; c < n; c++) {
        size_t best = c;
        for (size_t i = c + 1; i < n; i++)
            if (fabs(a[i * n + c]) > fabs(a[best * n + c])) best = i;
        swaps[c] = (double)best;
        if (!(fabs(a[best * n + c]) > 0.0)) return false;
        for (size_t j = 0; best != c && j < n; j++) {
            const double kept = a[c * n + j];
            a[c * n + j] = a[best * n + j];
            a[best * n + j] = kept;
        }
        const double pivot = 1.0 / a[c * n + c];
        a[c * n + c] = 1.0;
        for (size_t j = 0; j < n; j++) a[c * n + j] *= pivot;
        for (size_t i = 0; i < n; i++) {
            const double factor = a[i * n + c];
            if (i == c || factor == 0.0) continue;
            a[i * n + c] = 0.0;
            for (size_t j = 0; j < n; j++) a[i * n + j] -= factor * a[c * n + j];
        }
    }
    for (size_t c = n; c-- > 0;) {
        const size_t other = (size_t)swaps[c];
        for (size_t i = 0; other != c && i < n; i++) {
            const double kept = a[i * n + c];
            a[i * n + c] = a[i * n + other];
            a[i * n + other] = kept;
        }
    }
    return true;
}

/* Computes r and dr/dx at w->x: one forward pass (lg_jvp) per column, for all rows of the batch at once. */
static lg_status linearise(const problem *s, newton *w) {
    const size_t n = s->n, count = (size_t)s->batch * n;
    const lg_mark mark = lg_tape_mark(s->tape);
    const lg_shape shape = lg_shape2(s->batch, s->n);
    lg_var x = lg_input_f64(s->tape, shape, w->x), r;
    LG_TRY(residual(s, x, &r));
    LG_TRY(lg_read(s->tape, r, count, w->r));
    const lg_mark recorded = lg_tape_mark(s->tape);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < count; i++) w->seed[i] = i % n == j ? 1.0 : 0.0;
        lg_var direction = lg_input_f64(s->tape, shape, w->seed), moved;
        LG_TRY(lg_jvp(s->tape, &r, 1, &x, &direction, 1, &moved));
        LG_TRY(lg_read(s->tape, moved, count, w->column));
        for (size_t i = 0; i < count; i++) w->inverse[i * n + j] = w->column[i];
        LG_TRY(lg_tape_rewind(s->tape, recorded));
    }
    return lg_tape_rewind(s->tape, mark);
}

/* One Newton step in each row. *moved and *size become the largest |change| and the largest |x_i|. False if a
 * matrix dr/dx is singular. */
static bool improve(const problem *s, newton *w, double *moved, double *size) {
    const size_t n = s->n;
    *moved = *size = 0.0;
    for (size_t b = 0; b < s->batch; b++) {
        double *x = w->x + b * n, *inverse = w->inverse + b * n * n;
        const double *r = w->r + b * n;
        if (!lg_taped_invert(n, inverse, w->column)) return false;
        for (size_t i = 0; i < n; i++) {
            double change = 0.0;
            for (size_t j = 0; j < n; j++) change += inverse[i * n + j] * r[j];
            x[i] -= change;
            *moved = fmax(*moved, isfinite(change) ? fabs(change) : INFINITY);
            *size = fmax(*size, fabs(x[i]));
        }
    }
    return true;
}

/* Newton's method, starting from w->x. It ends when the change of x is no larger than the rounding of x, or
 * when a change that is small relative to x or y no longer falls to a quarter. `state` is the norm of y.
 * Errors: LG_NO_CONVERGENCE, LG_NOT_FINITE (at the first x), both not put on the tape; errors of the
 * field. */
static lg_status iterate(const problem *s, newton *w, double state) {
    enum { LONGEST = 30 };
    const double eps = lg_tape_dtype(s->tape) == LG_F64 ? DBL_EPSILON : FLT_EPSILON;
    double before = INFINITY;
    for (int i = 0; i < LONGEST; i++) {
        double moved, size;
        LG_TRY(linearise(s, w));
        if (i == 0 && !lg_all_finite((size_t)s->batch * s->n, w->r)) return LG_NOT_FINITE;
        if (!improve(s, w, &moved, &size) || !(moved < INFINITY)) return LG_NO_CONVERGENCE;
        if (moved <= 4.0 * eps * size) return LG_OK;
        if (moved >= 0.25 * before && moved <= 1024.0 * eps * fmax(size, state)) return LG_OK;
        before = moved;
    }
    return LG_NO_CONVERGENCE;
}

static bool failed(lg_status status) {
    return status == LG_NO_CONVERGENCE || status == LG_NOT_FINITE;
}

/* Finds x* for the step h. If Newton's method fails, the equation is solved for 4, 16 or 64 increasing step
 * sizes up to h. Each guess is the solution before, scaled by the ratio of the step sizes, as x is nearly
 * proportional to h. */
static lg_status solve(const problem *s, newton *w, double state) {
    enum { PARTS_MAX = 64 };
    const size_t count = (size_t)s->batch * s->n;
    lg_status status = LG_NO_CONVERGENCE;
    for (int parts = 1; parts <= PARTS_MAX && failed(status); parts *= 4) {
        problem piece = *s;
        memset(w->x, 0, count * sizeof(double));
        status = LG_OK;
        for (int part = 1; part <= parts && status == LG_OK; part++) {
            piece.over.h = part == parts ? s->over.h : s->over.h * part / parts;
            for (size_t i = 0; part > 1 && i < count; i++) w->x[i] *= (double)part / (part - 1);
            status = iterate(&piece, w, state);
        }
    }
    if (failed(status)) (void)lg_tape_fail(s->tape, status, "implicit step", lg_status_sentence(status));
    return status;
}

/* ---- the step ---- */

/* *size = the norm of y over all rows */
static lg_status size_of(const problem *s, double *size) {
    const lg_mark mark = lg_tape_mark(s->tape);
    double sum = 0.0;
    for (size_t p = 0; p < lg_taped_parts(&s->ode->space); p++) {
        double one;
        LG_TRY(lg_read(s->tape, lg_sum(s->tape, lg_square(s->tape, s->y->part[p])), 1, &one));
        sum += one;
    }
    *size = sqrt(sum);
    return lg_tape_rewind(s->tape, mark);
}

/* Computes x* (B, n) and K (B, n, n) as constants on the tape. Scratch memory is allocated on the tape and
 * freed by rewinding it. */
static lg_status stage_of(const problem *s, lg_var *x, lg_var *inverse) {
    lg_tape *tape = s->tape;
    const size_t count = (size_t)s->batch * s->n;
    void *x_values = NULL, *inverse_values = NULL;
    *x = lg_input_buffer(tape, lg_shape2(s->batch, s->n), &x_values);
    *inverse = lg_input_buffer(tape, lg_shape3(s->batch, s->n, s->n), &inverse_values);
    LG_TRY(lg_tape_status(tape));
    const lg_mark mark = lg_tape_mark(tape);
    double *memory = lg_payload_allocate(tape, count * (4 + (size_t)s->n) * sizeof(double));
    if (memory == NULL) return lg_tape_status(tape);
    newton w = {.x = memory,
                .r = memory + count,
                .column = memory + 2 * count,
                .seed = memory + 3 * count,
                .inverse = memory + 4 * count};
    double size;
    LG_TRY(size_of(s, &size));
    LG_TRY(solve(s, &w, size));
    tape->k->convert_in(count, w.x, x_values);
    tape->k->convert_in(count * s->n, w.inverse, inverse_values);
    return lg_tape_rewind(tape, mark);
}

/* x <- x - K r(x) */
static lg_status corrected(const problem *s, lg_var inverse, lg_var *x) {
    lg_var r;
    LG_TRY(residual(s, *x, &r));
    lg_var column = lg_reshape(s->tape, r, lg_shape3(s->batch, s->n, 1));
    lg_var change = lg_reshape(s->tape, lg_matmul(s->tape, inverse, column), lg_shape2(s->batch, s->n));
    *x = lg_sub(s->tape, *x, change);
    return lg_tape_status(s->tape);
}

lg_status lg_taped_implicit_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                 const lg_taped_span *over, const lg_parts *y, lg_parts *out) {
    const lg_shape shape = lg_var_shape(tape, y->part[0]);
    problem s = {.tape = tape,
                 .scheme = scheme,
                 .ode = ode,
                 .over = *over,
                 .y = y,
                 .batch = shape.dims[0],
                 .n = (uint32_t)ode->space.algebra_dim};
    lg_var x, inverse;
    lg_parts increment;
    lg_scope_push(tape, "implicit stage");
    const lg_status status = stage_of(&s, &x, &inverse);
    lg_scope_pop(tape);
    LG_TRY(status);
    LG_TRY(corrected(&s, inverse, &x));
    LG_TRY(corrected(&s, inverse, &x));
    LG_TRY(lg_taped_split_algebra(tape, &ode->space, x, increment.part));
    kinds[scheme->kind].end(&s, &increment, out);
    return lg_tape_status(tape);
}
