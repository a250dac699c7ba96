/* Machines of lines and angles: a step with friction that sticks.
 *
 * On the velocity k acts the friction -c_k s_k, c_k >= 0, s_k the sign of v_k; where v_k = 0, |s_k| <= 1 is
 * such that v_k stays 0 if that is possible. In a mode, all s_k are constant or v_k = 0 ("stuck"). A step
 * goes through segments, each with one mode:
 *   mode    s_k = sign(v_k); where v_k = 0, from the forces of friction that would hold v_k (a linear
 *           complementarity problem, by projected Gauss-Seidel sweeps from the forces that hold all of them;
 *           if these are within the limits, or for one velocity, it is exact)
 *   motion  a classical Runge-Kutta step of M v' = F in q and v, without the stuck rows and columns of M
 *   events  a velocity stops at the root of its cubic Hermite polynomial; a stuck one breaks away where the
 *           parabola through the force that holds it, at the first, third and last stage, reaches the limit.
 *           At the first event the segment ends: q and v are those of the Hermite polynomials, and a stopped
 *           velocity is exactly 0.
 * There are as many segments as friction needs; after the last one, a velocity that still changes its sign
 * is 0. All of this is recorded without branches: a step without events has segments of length 0. The signs
 * are constants of the derivatives, the times of events are not. */
#include <float.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

enum { EVENTS = 3, SWEEPS = 10 };

typedef struct sticking {
    lg_tape *tape;
    const lg_machine_vars *vars;
    const lg_machine_stick *over;
    const lg_var *parts;
    int x;
    uint32_t n, rows, count, at[LG_MACHINE_VELOCITIES]; /* count: velocities that may stick, and which */
    lg_var rubs, none, one;                             /* (1, n): 1 for these velocities; (1, 1): 0 and 1 */
} sticking;

/* Where a segment begins: time and remaining time as parts of the step, (B, 1); `force` (B, n): the signs of
 * velocities that just broke away. */
typedef struct instant {
    lg_var q, v, time, left, force;
} instant;

static sticking begin(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_stick *over,
                      const lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const int x = lg_machine_parts(machine).x;
    sticking k = {.tape = tape,
                  .vars = vars,
                  .over = over,
                  .parts = parts,
                  .x = x,
                  .n = machine->velocities,
                  .rows = lg_rows_of(tape, parts[x])};
    double rubs[LG_MACHINE_VELOCITIES];
    for (uint32_t i = 0; i < k.n; i++) {
        rubs[i] = (machine->sticks >> i & 1U) != 0 ? 1.0 : 0.0;
        if (rubs[i] > 0.0) k.at[k.count++] = i;
    }
    k.rubs = lg_input_f64(tape, lg_shape2(1, k.n), rubs);
    k.none = lg_full(tape, lg_shape2(1, 1), 0.0);
    k.one = lg_full(tape, lg_shape2(1, 1), 1.0);
    return k;
}

/* ---- conditions: 1 or 0 in each element ---- */

static lg_var opposite(const sticking *k, lg_var condition) {
    return lg_sub(k->tape, k->one, condition);
}

static lg_var below(const sticking *k, lg_var a, lg_var b) {
    return opposite(k, lg_ge(k->tape, a, b));
}

static lg_var choose(const sticking *k, lg_var condition, lg_var yes, lg_var no) {
    const lg_shape shape = lg_shape2(k->rows, lg_var_shape(k->tape, condition).dims[1]);
    return lg_select(k->tape, lg_broadcast_to(k->tape, condition, shape),
                     lg_broadcast_to(k->tape, yes, shape), lg_broadcast_to(k->tape, no, shape));
}

/* 1, 0 or -1. */
static lg_var sign3(const sticking *k, lg_var x) {
    return lg_sub(k->tape, lg_ge(k->tape, x, k->none), lg_ge(k->tape, k->none, x));
}

static lg_var least(const sticking *k, lg_var a, lg_var b) {
    return lg_neg(k->tape, lg_max(k->tape, lg_neg(k->tape, a), lg_neg(k->tape, b)));
}

static lg_var plus(const sticking *k, lg_var a, lg_var b, lg_var c) {
    return lg_add(k->tape, a, lg_mul(k->tape, b, c));
}

/* ---- forces and masses ---- */

/* The inputs at a time, a part of the step. */
static lg_var input_at(const sticking *k, lg_var time) {
    const lg_var *u = k->over->u;
    if (lg_is_none(u[0]) || lg_is_none(u[1])) return u[0];
    const lg_var rise = lg_linear_combination(k->tape, u, (const double[]){-3.0, 4.0, -1.0}, 3),
                 bend = lg_linear_combination(k->tape, u, (const double[]){2.0, -4.0, 2.0}, 3);
    return plus(k, u[0], time, plus(k, rise, time, bend));
}

static lg_status look(const sticking *k, lg_var q, lg_var v, lg_var time, lg_var sign,
                      lg_machine_motion *out) {
    const lg_machine *machine = k->vars->machine;
    lg_var parts[LG_TAPED_MAX_PARTS];
    memcpy(parts, k->parts, sizeof parts);
    parts[k->x] = lg_scale(k->tape, q, 1.0);
    lg_machine_seen seen = {.parts = parts, .v = v, .u = input_at(k, time), .sign = sign, .rows = k->rows};
    if (lg_is_none(seen.u) && machine->input_count > 0) {
        seen.u = lg_full(k->tape, lg_shape2(k->rows, machine->input_count), 0.0);
        lg_tape_mark_rows(k->tape, seen.u);
    }
    return lg_machine_record_motion(k->tape, k->vars, &seen, out);
}

/* M, where it is constant (1, n, n). */
static lg_var mass(const sticking *k, lg_var M) {
    return lg_is_none(M) ? lg_reshape(k->tape, k->vars->mass, lg_shape3(1, k->n, k->n)) : M;
}

/* M^-1 X for X (B, n, m). */
static lg_var solve(const sticking *k, lg_var M, lg_var X) {
    if (!lg_is_none(M)) return lg_spd_solve(k->tape, M, X);
    return lg_matmul(k->tape, lg_reshape(k->tape, k->vars->inverse, lg_shape3(1, k->n, k->n)), X);
}

static lg_var column(const sticking *k, lg_var x) {
    return lg_reshape(k->tape, lg_broadcast_to(k->tape, x, lg_shape2(k->rows, k->n)),
                      lg_shape3(k->rows, k->n, 1));
}

static lg_var row(const sticking *k, lg_var x) {
    return lg_reshape(k->tape, x, lg_shape2(k->rows, k->n));
}

/* v' where the velocities with keep = 0 stay as they are. */
static lg_var accelerate(const sticking *k, const lg_machine_motion *at, lg_var keep) {
    const lg_var F = lg_mul(k->tape, keep, at->F);
    const lg_var down = column(k, keep), across = lg_reshape(k->tape, down, lg_shape3(k->rows, 1, k->n)),
                 unit = lg_mul(k->tape, lg_unit_matrix(k->tape, k->n), opposite(k, across));
    const lg_var held = lg_add(k->tape, lg_mul(k->tape, lg_mul(k->tape, mass(k, at->M), down), across), unit);
    return row(k, lg_spd_solve(k->tape, held, column(k, F)));
}

/* F - M v': the force that friction takes from stuck velocities. */
static lg_var held_force(const sticking *k, const lg_machine_motion *at, lg_var a) {
    return lg_sub(k->tape, at->F, row(k, lg_matmul(k->tape, mass(k, at->M), column(k, a))));
}

/* ---- modes ---- */

/* The unit vectors of the velocities that may stick, (count, n). */
static lg_var selection(const sticking *k) {
    double e[LG_MACHINE_VALUES] = {0.0};
    for (uint32_t i = 0; i < k->count; i++) e[i * k->n + k->at[i]] = 1.0;
    return lg_input_f64(k->tape, lg_shape2(k->count, k->n), e);
}

/* Sweeps over the velocities at rest for the forces r of friction on them, which begin with those that hold
 * all of them; s becomes the signs, 0 where |r| <= c. */
static void sweep(const sticking *k, const lg_machine_motion *at, lg_var zero, lg_var *r, lg_var *s) {
    lg_tape *t = k->tape;
    const uint32_t m = k->count;
    const lg_var E =
        lg_broadcast_to(t, lg_reshape(t, selection(k), lg_shape3(1, m, k->n)), lg_shape3(k->rows, m, k->n));
    const lg_var all = lg_concat(t, (lg_var[]){lg_transpose(t, E), column(k, at->F)}, 2, 2);
    /* E^T M^-1 [E, F] */
    const lg_var both = lg_reshape(t, lg_matmul(t, E, solve(k, at->M, all)), lg_shape2(k->rows, m * (m + 1)));
    for (uint32_t i = 0; i < SWEEPS * m; i++) {
        const uint32_t own = i % m, first = own * (m + 1);
        const lg_var c = lg_slice(t, at->c, 1, k->at[own], 1);
        lg_var a = lg_slice(t, both, 1, first + m, 1);
        for (uint32_t j = 0; j < m; j++) a = plus(k, a, r[j], lg_slice(t, both, 1, first + j, 1));
        const lg_var wanted = lg_sub(t, r[own], lg_div(t, a, lg_slice(t, both, 1, first + own, 1)));
        r[own] = lg_mul(t, lg_slice(t, zero, 1, k->at[own], 1), lg_max(t, least(k, wanted, c), lg_neg(t, c)));
        s[own] = lg_sub(t, below(k, wanted, lg_neg(t, c)), below(k, c, wanted));
    }
}

/* The signs (B, n) of the velocities with zero = 1, 0 where they stay at rest. */
static lg_var leaving(const sticking *k, const lg_machine_motion *at, lg_var zero) {
    lg_tape *t = k->tape;
    lg_var r[LG_MACHINE_VELOCITIES], s[LG_MACHINE_VELOCITIES];
    const lg_var held = held_force(k, at, accelerate(k, at, opposite(k, zero))), down = lg_neg(t, at->c);
    if (k->count == 1)
        return lg_stop_gradient(t, lg_mul(t, zero, lg_sub(t, below(k, at->c, held), below(k, held, down))));
    const lg_var first = lg_mul(t, zero, lg_max(t, least(k, lg_neg(t, held), at->c), down));
    for (uint32_t i = 0; i < k->count; i++) r[i] = lg_slice(t, first, 1, k->at[i], 1);
    sweep(k, at, zero, r, s);
    return lg_stop_gradient(t, lg_mul(t, zero, lg_matmul(t, lg_concat(t, s, k->count, 1), selection(k))));
}

/* A mode: the signs, and 1 where a velocity is not stuck. at->F is that of the mode on return. */
typedef struct mode {
    lg_var sign, keep;
} mode;

static lg_status find_mode(const sticking *k, const instant *now, lg_machine_motion *at, mode *out) {
    lg_tape *t = k->tape;
    const lg_var moving = lg_mul(t, k->rubs, sign3(k, now->v)),
                 zero = lg_sub(t, k->rubs, lg_square(t, moving));
    LG_TRY(look(k, now->q, now->v, now->time, moving, at));
    lg_var s = lg_add(t, moving, leaving(k, at, zero));
    if (!lg_is_none(now->force)) s = choose(k, lg_square(t, now->force), now->force, s);
    at->F = lg_sub(t, at->F, lg_mul(t, at->c, lg_sub(t, s, moving)));
    *out = (mode){s, opposite(k, lg_sub(t, k->rubs, lg_square(t, s)))};
    return lg_tape_status(t);
}

/* ---- events ---- */

/* What a segment computes, for its whole remaining time: v' and what friction holds at the first, third and
 * last stage. */
typedef struct segment {
    lg_var h, q, v, a[2], q1, v1, held[3], limit[3];
} segment;

/* The coefficients y of the cubic Hermite polynomial from y0 to y1 with the slopes d0 and d1, over [0, 1]. */
static void cubic(lg_tape *t, lg_var y0, lg_var d0, lg_var y1, lg_var d1, lg_var *y) {
    const lg_var all[3] = {lg_sub(t, y1, y0), d0, d1};
    y[0] = y0;
    y[1] = d0;
    y[2] = lg_linear_combination(t, all, (const double[]){3.0, -2.0, -1.0}, 3);
    y[3] = lg_linear_combination(t, all, (const double[]){-2.0, 1.0, 1.0}, 3);
}

static lg_var value(const sticking *k, const lg_var *y, lg_var x) {
    return plus(k, y[0], x, plus(k, y[1], x, plus(k, y[2], x, y[3])));
}

/* One step of Newton's method, kept in [0, 1], for the root of the polynomial y; `slope` in place of its
 * slope where the signs of both differ. */
static lg_var newton(const sticking *k, const lg_var *y, lg_var slope, lg_var x) {
    lg_tape *t = k->tape;
    const lg_var found = plus(k, y[1], x, plus(k, lg_scale(t, y[2], 2.0), x, lg_scale(t, y[3], 3.0)));
    const lg_var usable = below(k, k->none, lg_mul(t, found, slope));
    const lg_var next = lg_sub(t, x, lg_div(t, value(k, y, x), choose(k, usable, found, slope)));
    return lg_max(t, least(k, next, k->one), k->none);
}

/* Parts of the way at which velocities, with the polynomial y, stop; `cross`: those that do. A velocity that
 * begins at 0 and returns has the other root. */
static lg_var stops(const sticking *k, const segment *g, const lg_var *y, lg_var cross) {
    lg_tape *t = k->tape;
    const lg_var slope = choose(k, cross, lg_sub(t, g->v1, g->v), k->one),
                 fresh = opposite(k, lg_square(t, sign3(k, g->v))),
                 secant = lg_neg(t, lg_div(t, g->v, slope));
    const lg_var x = newton(k, y, slope, choose(k, fresh, k->one, secant));
    const lg_var early = lg_mul(t, fresh, lg_ge(t, lg_full(t, lg_shape2(1, 1), 1e-9), x));
    return choose(k, early, k->one, x);
}

/* Parts of the way at which stuck velocities break away in the direction s; *breaks: those that do. */
static lg_var breakaways(const sticking *k, const segment *g, const mode *in, lg_var *s, lg_var *breaks) {
    lg_tape *t = k->tape;
    lg_var over[3];
    *s = lg_stop_gradient(t, sign3(k, g->held[2]));
    for (int i = 0; i < 3; i++) over[i] = lg_sub(t, lg_mul(t, *s, g->held[i]), g->limit[i]);
    const lg_var stuck = opposite(k, in->keep), rise = lg_sub(t, over[2], over[0]);
    *breaks = lg_mul(t, stuck, lg_mul(t, below(k, k->none, over[2]), below(k, k->none, rise)));
    const lg_var slope = choose(k, *breaks, rise, k->one);
    const lg_var y[4] = {over[0], lg_linear_combination(t, over, (const double[]){-3.0, 4.0, -1.0}, 3),
                         lg_linear_combination(t, over, (const double[]){2.0, -4.0, 2.0}, 3), k->none};
    const lg_var first = lg_max(t, lg_neg(t, lg_div(t, over[0], slope)), k->none);
    return newton(k, y, slope, first);
}

/* Goes to the first event of the segment, or to its end. */
static void go(const sticking *k, const segment *g, const mode *in, lg_var cross, instant *now) {
    lg_tape *t = k->tape;
    lg_var breaks, s, of_q[4], of_v[4];
    const lg_var going = below(k, k->none, now->left);
    cubic(t, g->q, lg_mul(t, g->h, g->v), g->q1, lg_mul(t, g->h, g->v1), of_q);
    cubic(t, g->v, lg_mul(t, g->h, g->a[0]), g->v1, lg_mul(t, g->h, g->a[1]), of_v);
    cross = lg_mul(t, cross, going);
    const lg_var stop = stops(k, g, of_v, cross), away = breakaways(k, g, in, &s, &breaks);
    breaks = lg_mul(t, breaks, going);
    const lg_var when = choose(k, cross, stop, choose(k, breaks, away, lg_scale(t, k->one, 2.0)));
    const lg_var first = lg_neg(t, lg_max_axis(t, lg_neg(t, when), 1, true)), part = least(k, first, k->one),
                 hit = lg_mul(t, lg_add(t, cross, breaks), lg_ge(t, first, when));
    now->q = value(k, of_q, part);
    now->v = choose(k, lg_mul(t, in->keep, opposite(k, hit)), value(k, of_v, part), k->none);
    now->force = lg_mul(t, lg_mul(t, hit, breaks), s);
    now->time = plus(k, now->time, now->left, part);
    now->left = lg_mul(t, now->left, lg_sub(t, k->one, part));
}

/* ---- segments ---- */

static lg_status stage(const sticking *k, lg_var q, lg_var v, lg_var time, const mode *in, lg_var *a,
                       lg_var *held, lg_var *limit) {
    lg_machine_motion at;
    LG_TRY(look(k, q, v, time, in->sign, &at));
    *a = accelerate(k, &at, in->keep);
    if (held != NULL) *held = held_force(k, &at, *a), *limit = at.c;
    return lg_tape_status(k->tape);
}

/* One segment; `last`: the rest of the step. */
static lg_status run_segment(const sticking *k, instant *now, bool last) {
    lg_tape *t = k->tape;
    mode in;
    lg_machine_motion at;
    segment g = {.q = now->q, .v = now->v};
    lg_var a[4], v[4], q;
    LG_TRY(find_mode(k, now, &at, &in));
    v[0] = now->v;
    a[0] = g.a[0] = accelerate(k, &at, in.keep);
    g.h = lg_mul(t, now->left, k->over->h);
    g.held[0] = held_force(k, &at, a[0]), g.limit[0] = at.c;
    const lg_var half = lg_scale(t, g.h, 0.5),
                 middle = plus(k, now->time, now->left, lg_scale(t, k->one, 0.5)),
                 end = lg_add(t, now->time, now->left);
    for (int i = 1; i < 4; i++) {
        const lg_var h = i == 3 ? g.h : half;
        v[i] = plus(k, now->v, h, a[i - 1]);
        q = plus(k, now->q, h, v[i - 1]);
        LG_TRY(stage(k, q, v[i], i == 3 ? end : middle, &in, &a[i], i == 2 ? &g.held[1] : NULL, &g.limit[1]));
    }
    static const double weights[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    g.q1 = plus(k, now->q, g.h, lg_linear_combination(t, v, weights, 4));
    g.v1 = plus(k, now->v, g.h, lg_linear_combination(t, a, weights, 4));
    const lg_var cross = below(k, lg_mul(t, in.sign, g.v1), k->none);
    if (last) {
        now->q = g.q1;
        now->v = choose(k, cross, k->none, g.v1);
        return lg_tape_status(t);
    }
    LG_TRY(stage(k, g.q1, g.v1, end, &in, &g.a[1], &g.held[2], &g.limit[2]));
    go(k, &g, &in, cross, now);
    return lg_tape_status(t);
}

/* ---- steps ---- */

/* M^-1 p, with 0 in place of what cannot be told from 0: 8 roundings of what v is the sum of. */
static lg_var velocities_of(const sticking *k, lg_var M) {
    lg_tape *t = k->tape;
    const lg_machine *machine = k->vars->machine;
    const lg_var p = k->parts[lg_machine_parts(machine).m];
    const lg_var v = row(k, solve(k, M, column(k, p)));
    const lg_var unit = lg_broadcast_to(t, lg_unit_matrix(t, k->n), lg_shape3(k->rows, k->n, k->n));
    const lg_var W = lg_stop_gradient(t, solve(k, M, unit)),
                 size = lg_matmul(t, lg_abs(t, mass(k, M)), lg_abs(t, column(k, v)));
    const lg_var noise = lg_scale(t, row(k, lg_matmul(t, lg_abs(t, W), size)), 8.0 * DBL_EPSILON);
    return choose(k, lg_ge(t, lg_stop_gradient(t, noise), lg_abs(t, v)), k->none, v);
}

static lg_var mass_at(const sticking *k, const lg_var *parts) {
    return lg_is_none(k->vars->mass) ? lg_machine_record_mass(k->tape, k->vars, parts) : LG_NONE;
}

static instant at_start(const sticking *k) {
    const lg_var start = lg_full(k->tape, lg_shape2(k->rows, 1), 0.0);
    lg_tape_mark_rows(k->tape, start);
    return (instant){.q = k->parts[k->x],
                     .v = velocities_of(k, mass_at(k, k->parts)),
                     .time = start,
                     .left = lg_add_scalar(k->tape, start, 1.0),
                     .force = LG_NONE};
}

lg_status lg_machine_stick_step(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_stick *over,
                                lg_var *parts) {
    const sticking k = begin(tape, vars, over, parts);
    const int m = lg_machine_parts(vars->machine).m;
    instant now = at_start(&k);
    const uint32_t events = k.count + 1 < EVENTS ? k.count + 1 : EVENTS;
    for (uint32_t i = 0; i <= events; i++) LG_TRY(run_segment(&k, &now, i == events));
    parts[k.x] = now.q;
    parts[m] = row(&k, lg_matmul(tape, mass(&k, mass_at(&k, parts)), column(&k, now.v)));
    return lg_tape_status(tape);
}

lg_var lg_machine_stick_accelerations(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                      lg_var u) {
    const lg_machine_stick over = {.h = LG_NONE, .u = {u, LG_NONE, LG_NONE}};
    const sticking k = begin(tape, vars, &over, parts);
    const instant now = at_start(&k);
    lg_machine_motion at;
    mode in;
    return find_mode(&k, &now, &at, &in) == LG_OK ? accelerate(&k, &at, in.keep) : LG_NONE;
}
