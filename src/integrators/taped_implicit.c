/* Implicit steps on the tape. The unknown x solves x = h f(t + theta h, Y(x)); it is an algebra element for
 * each row of the batch. Y(x) is the stage point, and the end of the step is a function of y and x.
 * taped_root.c solves r(x) = x - h f(t + theta h, Y(x)) = 0. */
#include "integrators/taped_internal.h"

#include <math.h>

#include "liegrad/ops.h"

typedef struct problem {
    lg_tape *tape;
    const lg_scheme *scheme;
    const lg_taped_ode *ode;
    lg_taped_span over;
    double h; /* the whole step; over.h may be a part of it */
    const lg_parts *y;
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
static lg_status residual(void *user, lg_tape *tape, lg_var x, lg_var *out) {
    const problem *s = user;
    const lg_space *space = &s->ode->space;
    lg_parts increment, stage, f;
    LG_TRY(lg_taped_split_algebra(tape, space, x, increment.part));
    kinds[s->scheme->kind].stage(s, &increment, &stage);
    const lg_taped_time t = lg_taped_stage_time(&s->over, s->scheme->theta);
    LG_TRY(s->ode->field(s->ode->user, tape, t, stage.part, s->over.input, f.part));
    if (!lg_taped_fits(tape, space, true, f.part, stage.part, "field")) return lg_tape_status(tape);
    lg_var all = lg_taped_join_algebra(tape, space, f.part);
    *out = lg_taped_moved(tape, x, -s->over.h, lg_taped_by_rows(tape, &s->over, all));
    return lg_tape_status(tape);
}

static void take_part(void *user, int part, int parts) {
    problem *s = user;
    s->over.h = part == parts ? s->h : s->h * part / parts;
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

lg_status lg_taped_implicit_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                 const lg_taped_span *over, const lg_parts *y, lg_parts *out) {
    const uint32_t rows = lg_var_shape(tape, y->part[0]).dims[0];
    problem s = {.tape = tape, .scheme = scheme, .ode = ode, .over = *over, .h = over->h, .y = y};
    lg_root root = {.equations = residual, .user = &s, .part = take_part};
    lg_parts increment;
    lg_var x;
    LG_TRY(size_of(&s, &root.scale));
    lg_scope_push(tape, "implicit stage");
    const lg_var zero = lg_full(tape, lg_shape2(rows, (uint32_t)ode->space.algebra_dim), 0.0);
    const lg_status status = lg_taped_root(tape, &root, zero, &x);
    if (lg_root_failed(status)) (void)lg_tape_fail(tape, status, "implicit step", lg_status_sentence(status));
    lg_scope_pop(tape);
    LG_TRY(status);
    LG_TRY(lg_taped_split_algebra(tape, &ode->space, x, increment.part));
    kinds[scheme->kind].end(&s, &increment, out);
    return lg_tape_status(tape);
}
