/* The taped interpreter: the same scheme tables as the plain one, points and algebra elements as tuples of
 * variables. */
#include "liegrad/taped.h"

#include "core/core.h"
#include "integrators/series.h"
#include "liegrad/ops.h"

typedef struct point {
    lg_var part[LG_TAPED_MAX_PARTS];
} point;

/* ---- factors ---- */

/* Coefficient c_i(w) of every row, (..., 1), from (..., K + 1). */
static lg_var coefficient(lg_tape *tape, lg_var stumpff, uint32_t i) {
    return lg_slice(tape, stumpff, -1, i, 1);
}

/* b + c1 u x b + c2 u x (u x b) */
static lg_var second_order(lg_tape *tape, lg_var u, lg_var b, lg_var c1, lg_var c2) {
    lg_var ub = lg_cross(tape, u, b);
    lg_var uub = lg_cross(tape, u, ub);
    lg_var sum = lg_add(tape, lg_mul(tape, c1, ub), lg_mul(tape, c2, uub));
    return lg_add(tape, b, sum);
}

/* exp(u, v) . (q, p) = (R q, R p + (V v) x R q), see lg_se3_exp_act */
static void act_ts2(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    lg_var c = lg_stumpff_functions(tape, lg_rownorm2(tape, a[0]), 3);
    lg_var c1 = coefficient(tape, c, 1), c2 = coefficient(tape, c, 2), c3 = coefficient(tape, c, 3);
    lg_var r = second_order(tape, a[0], a[1], c2, c3);
    lg_var q = second_order(tape, a[0], y[0], c1, c2);
    lg_var p = second_order(tape, a[0], y[1], c1, c2);
    out[0] = q;
    out[1] = lg_add(tape, p, lg_cross(tape, r, q));
}

static void act_rn(lg_tape *tape, const lg_var *a, const lg_var *y, lg_var *out) {
    out[0] = lg_add(tape, y[0], a[0]);
}

/* [(u1, v1), (u2, v2)] = (u1 x u2, u1 x v2 + v1 x u2) */
static void bracket_ts2(lg_tape *tape, const lg_var *a, const lg_var *b, lg_var *out) {
    lg_var u = lg_cross(tape, a[0], b[0]);
    lg_var v = lg_add(tape, lg_cross(tape, a[0], b[1]), lg_cross(tape, a[1], b[0]));
    out[0] = u;
    out[1] = v;
}

/* The closed form of lg_se3_dexpinv, (A, a) the first argument and (B, b) the second:
 *   C = B - 1/2 A x B + g2 A x (A x B)
 *   c = b - 1/2 (a x B + A x b) + rho gt2 A x (A x B) + g2 (a x (A x B) + A x (a x B) + A x (A x b)), rho =
 * A.a */
static void dexpinv_ts2(lg_tape *tape, const lg_var *first, const lg_var *second, lg_var *out) {
    lg_var A = first[0], a = first[1], B = second[0], b = second[1];
    lg_var w = lg_rownorm2(tape, A);
    lg_var g2 = lg_dexpinv_coefficient(tape, w, 0);
    lg_var gt2 = lg_scale(tape, lg_dexpinv_coefficient(tape, w, 1), 2.0);
    lg_var rho = lg_rowdot(tape, A, a);
    lg_var AB = lg_cross(tape, A, B), AAB = lg_cross(tape, A, AB);
    lg_var aB = lg_cross(tape, a, B), Ab = lg_cross(tape, A, b);
    lg_var mixed = lg_add(tape, aB, Ab);
    lg_var triple = lg_add(tape, lg_cross(tape, a, AB), lg_cross(tape, A, mixed));
    lg_var half[2] = {B, AB}, half_b[2] = {b, mixed};
    const double weights[2] = {1.0, -0.5};
    out[0] = lg_add(tape, lg_combine(tape, half, weights, 2), lg_mul(tape, g2, AAB));
    lg_var tail = lg_add(tape, lg_mul(tape, lg_mul(tape, rho, gt2), AAB), lg_mul(tape, g2, triple));
    out[1] = lg_add(tape, lg_combine(tape, half_b, weights, 2), tail);
}

/* A row of the table of factors; NULL: abelian, the bracket is zero and dexpinv the identity. */
static const struct {
    size_t parts;
    void (*act)(lg_tape *, const lg_var *a, const lg_var *y, lg_var *out);
    void (*bracket)(lg_tape *, const lg_var *a, const lg_var *b, lg_var *out);
    void (*dexpinv)(lg_tape *, const lg_var *a, const lg_var *b, lg_var *out);
} factors[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {1, act_rn, NULL, NULL},
    [LG_SPACE_TS2] = {2, act_ts2, bracket_ts2, dexpinv_ts2},
};

size_t lg_taped_parts(const lg_space *space) {
    size_t parts = 0;
    for (size_t i = 0; i < space->factors; i++) parts += factors[space->factor[i].kind].parts;
    return parts;
}

lg_status lg_taped_act(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *y, lg_var *out) {
    size_t at = 0;
    for (size_t i = 0; i < space->factors; i++) {
        factors[space->factor[i].kind].act(tape, a + at, y + at, out + at);
        at += factors[space->factor[i].kind].parts;
    }
    return lg_tape_status(tape);
}

/* sum_{k <= K} B_k/k! ad_a^k b; odd ones above 1 are zero */
static void dexpinv_series(lg_tape *tape, lg_space_kind kind, int truncation, const lg_var *a,
                           const lg_var *b, lg_var *out) {
    const size_t parts = factors[kind].parts;
    lg_var power[LG_TAPED_MAX_PARTS], sum[LG_TAPED_MAX_PARTS];
    for (size_t p = 0; p < parts; p++) sum[p] = power[p] = b[p];
    for (int k = 1; k <= truncation; k++) {
        factors[kind].bracket(tape, a, power, power);
        if (lg_dexpinv_series[k] == 0.0) continue;
        for (size_t p = 0; p < parts; p++) {
            lg_var terms[2] = {sum[p], power[p]};
            const double weights[2] = {1.0, lg_dexpinv_series[k]};
            sum[p] = lg_combine(tape, terms, weights, 2);
        }
    }
    for (size_t p = 0; p < parts; p++) out[p] = sum[p];
}

lg_status lg_taped_dexpinv(lg_tape *tape, const lg_space *space, int truncation, const lg_var *a,
                           const lg_var *b, lg_var *out) {
    if (truncation < LG_DEXPINV_EXACT || truncation > LG_DEXPINV_MAX) return LG_INVALID_ARGUMENT;
    size_t at = 0;
    for (size_t i = 0; i < space->factors; i++) {
        lg_space_kind kind = space->factor[i].kind;
        if (factors[kind].dexpinv == NULL)
            for (size_t p = 0; p < factors[kind].parts; p++) out[at + p] = b[at + p];
        else if (truncation == LG_DEXPINV_EXACT)
            factors[kind].dexpinv(tape, a + at, b + at, out + at);
        else
            dexpinv_series(tape, kind, truncation, a + at, b + at, out + at);
        at += factors[kind].parts;
    }
    return lg_tape_status(tape);
}

/* ---- steps ---- */

typedef struct run {
    lg_tape *tape;
    const lg_scheme *scheme;
    const lg_taped_ode *ode;
    size_t parts;
    double h;
    bool has_first; /* FSAL: f at the start of this step is known */
    point first;
    lg_var force; /* splitting: the force at the present q, or LG_NONE */
} run;

/* h sum_j weight_j k_j over the stages with a weight; false when all weights are zero. */
static bool combine(const run *r, const double *weight, const point *k, int stages, point *out) {
    int used[LG_SCHEME_MAX_STAGES], n = 0;
    double c[LG_SCHEME_MAX_STAGES];
    for (int j = 0; j < stages; j++)
        if (weight[j] != 0.0) {
            used[n] = j;
            c[n++] = r->h * weight[j];
        }
    for (size_t p = 0; n > 0 && p < r->parts; p++) {
        lg_var terms[LG_SCHEME_MAX_STAGES];
        for (int i = 0; i < n; i++) terms[i] = k[used[i]].part[p];
        out->part[p] = lg_combine(r->tape, terms, c, (size_t)n);
    }
    return n > 0;
}

static lg_status rkmk_stage(run *r, double t, int i, const point *y, point *k) {
    const lg_scheme *s = r->scheme;
    point sigma, at = *y, f;
    bool moved = combine(r, s->a[i], k, i, &sigma);
    if (!moved && r->has_first) {
        k[i] = r->first;
        return LG_OK;
    }
    if (moved) LG_TRY(lg_taped_act(r->tape, &r->ode->space, sigma.part, y->part, at.part));
    LG_TRY(r->ode->field(r->ode->user, r->tape, t + s->c[i] * r->h, at.part, f.part));
    if (s->fsal && i + 1 == s->stages) r->first = f;
    if (!moved) {
        k[i] = f;
        return LG_OK;
    }
    return lg_taped_dexpinv(r->tape, &r->ode->space, s->dexpinv, sigma.part, f.part, k[i].part);
}

static lg_status rkmk_step(run *r, double t, point *y) {
    const lg_scheme *s = r->scheme;
    point k[LG_SCHEME_MAX_STAGES], sigma;
    for (int i = 0; i < s->stages; i++) LG_TRY(rkmk_stage(r, t, i, y, k));
    r->has_first = s->fsal;
    if (!combine(r, s->b, k, s->stages, &sigma)) return LG_OK;
    point next;
    LG_TRY(lg_taped_act(r->tape, &r->ode->space, sigma.part, y->part, next.part));
    *y = next;
    return LG_OK;
}

static lg_status cf_point(run *r, const lg_cf_row *row, const point *y, const point *stage, const point *f,
                          int known, point *out) {
    *out = row->base == LG_CF_START ? *y : stage[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        point a, next;
        if (!combine(r, row->coefficient[e], f, known, &a)) continue;
        LG_TRY(lg_taped_act(r->tape, &r->ode->space, a.part, out->part, next.part));
        *out = next;
    }
    return LG_OK;
}

static lg_status cf_step(run *r, double t, point *y) {
    const lg_scheme *s = r->scheme;
    point stage[LG_SCHEME_MAX_STAGES], f[LG_SCHEME_MAX_STAGES], next;
    for (int i = 0; i < s->stages; i++) {
        LG_TRY(cf_point(r, &s->rows[i], y, stage, f, i, &stage[i]));
        LG_TRY(r->ode->field(r->ode->user, r->tape, t + s->c[i] * r->h, stage[i].part, f[i].part));
    }
    LG_TRY(cf_point(r, &s->rows[s->stages], y, stage, f, s->stages, &next));
    *y = next;
    return LG_OK;
}

static lg_var moved(const run *r, lg_var from, double weight, lg_var by) {
    lg_var terms[2] = {from, by};
    const double c[2] = {1.0, weight * r->h};
    return lg_combine(r->tape, terms, c, 2);
}

static lg_status splitting_step(run *r, double t, point *y) {
    const lg_scheme *s = r->scheme;
    double time = t; /* of the positions */
    for (int i = 0; i < s->stages; i++) {
        if (s->kick[i] != 0.0) {
            if (lg_is_none(r->force))
                LG_TRY(r->ode->force(r->ode->user, r->tape, time, y->part[0], &r->force));
            y->part[1] = moved(r, y->part[1], s->kick[i], r->force);
        }
        if (s->drift[i] != 0.0) {
            lg_var velocity;
            LG_TRY(r->ode->velocity(r->ode->user, r->tape, time, y->part[1], &velocity));
            y->part[0] = moved(r, y->part[0], s->drift[i], velocity);
            time += r->h * s->drift[i];
            r->force = LG_NONE;
        }
    }
    return lg_tape_status(r->tape);
}

static lg_status check(const lg_scheme *scheme, const lg_taped_ode *ode, size_t steps, size_t every) {
    LG_TRY(lg_scheme_check(scheme, NULL));
    if (steps == 0 || every == 0 || steps % every != 0) return LG_INVALID_ARGUMENT;
    bool splitting = scheme->kind == LG_SCHEME_SPLITTING;
    if ((scheme->ambient || splitting) && !lg_space_is_abelian(&ode->space)) return LG_UNSUPPORTED;
    if (splitting)
        return ode->force != NULL && ode->velocity != NULL && lg_taped_parts(&ode->space) == 2
                   ? LG_OK
                   : LG_INVALID_ARGUMENT;
    return ode->field != NULL ? LG_OK : LG_INVALID_ARGUMENT;
}

lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, double t0,
                             double h, size_t steps, size_t every, const lg_var *y0, lg_var *out) {
    static lg_status (*const step[LG_SCHEME_KINDS])(run *, double, point *) = {
        [LG_SCHEME_RKMK] = rkmk_step,
        [LG_SCHEME_COMMUTATOR_FREE] = cf_step,
        [LG_SCHEME_SPLITTING] = splitting_step,
    };
    LG_TRY(check(scheme, ode, steps, every));
    run r = {.tape = tape,
             .scheme = scheme,
             .ode = ode,
             .parts = lg_taped_parts(&ode->space),
             .h = h,
             .force = LG_NONE};
    point y;
    for (size_t p = 0; p < r.parts; p++) y.part[p] = y0[p];
    for (size_t n = 0; n < steps; n++) {
        LG_TRY(step[scheme->kind](&r, t0 + (double)n * h, &y));
        LG_TRY(lg_tape_status(tape));
        if ((n + 1) % every != 0) continue;
        for (size_t p = 0; p < r.parts; p++) *out++ = y.part[p];
    }
    return LG_OK;
}
