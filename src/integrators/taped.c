/* The taped interpreter: it uses the same scheme tables as the plain interpreter. Points and algebra elements
 * are tuples of variables. */
#include "integrators/taped_internal.h"

#include "autodiff/tape/tape_internal.h"
#include "integrators/stepper.h"
#include "liegrad/ops.h"

typedef struct run {
    lg_tape *tape;
    const lg_scheme *scheme;
    const lg_taped_ode *ode;
    size_t parts;
    lg_taped_span over; /* the current step */
    bool continues;     /* another step follows: values that it can reuse are kept */
    bool has_first;     /* FSAL: f at the start of this step is known */
    lg_parts first;
    lg_var force; /* splitting: the force at the present q, or LG_NONE */
} run;

static lg_status act(const run *r, const lg_parts *a, const lg_parts *y, lg_parts *out) {
    return lg_taped_act(r->tape, &r->ode->space, a->part, y->part, out->part);
}

/* f(t + c h, y) */
static lg_status field(const run *r, double c, const lg_parts *y, lg_parts *f) {
    const lg_taped_time t = lg_taped_stage_time(&r->over, c);
    LG_TRY(r->ode->field(r->ode->user, r->tape, t, y->part, r->over.input, f->part));
    (void)lg_taped_fits(r->tape, &r->ode->space, true, f->part, y->part, "field");
    return lg_tape_status(r->tape);
}

/* Calls `of`, the force or the velocity, on `half`, which is q or p, and checks the shape of the result. */
static lg_status half_field(const run *r, lg_taped_half_field of, const lg_taped_time *t, lg_var half,
                            lg_var *out) {
    LG_TRY(of(r->ode->user, r->tape, *t, half, r->over.input, out));
    const lg_shape wanted = lg_var_shape(r->tape, half), given = lg_var_shape(r->tape, *out);
    if (lg_is_none(*out) || !lg_same_shape(&wanted, &given))
        (void)lg_tape_fail(r->tape, LG_SHAPE, "field", "a force or velocity must have the shape of q and p");
    return lg_tape_status(r->tape);
}

/* Multiplies the parts of x by the step sizes of the rows, in place; does nothing if the step is constant. */
static void by_rows(const run *r, lg_parts *x) {
    for (size_t p = 0; p < r->parts; p++) x->part[p] = lg_taped_by_rows(r->tape, &r->over, x->part[p]);
}

/* out = h sum_j weight_j k_j over the stages with a nonzero weight. If the step sizes are a variable, h is 1
 * and the caller multiplies by them (by_rows). False if all weights are zero. */
static bool combine(const run *r, const double *weight, const lg_parts *k, int stages, lg_parts *out) {
    int used[LG_SCHEME_MAX_STAGES], n = 0;
    double c[LG_SCHEME_MAX_STAGES];
    for (int j = 0; j < stages; j++)
        if (weight[j] != 0.0) {
            used[n] = j;
            c[n++] = r->over.h * weight[j];
        }
    const bool itself = n == 1 && c[0] == 1.0 && !lg_is_none(r->over.rows);
    for (size_t p = 0; n > 0 && p < r->parts; p++) {
        lg_var terms[LG_SCHEME_MAX_STAGES];
        for (int i = 0; i < n; i++) terms[i] = k[used[i]].part[p];
        out->part[p] = itself ? terms[0] : lg_linear_combination(r->tape, terms, c, (size_t)n);
    }
    return n > 0;
}

/* ---- Runge-Kutta-Munthe-Kaas ---- */

/* sigma = h (sum_j a_j k_j + h sum_i weight_i [k_first, k_second]): the exponent of stage `row`, or of the
 * step if row = stages. *any is false if there are no terms; sigma is then not written. */
static lg_status exponent(const run *r, int row, const lg_parts *k, bool *any, lg_parts *sigma) {
    const lg_scheme *s = r->scheme;
    const bool last = row == s->stages;
    *any = combine(r, last ? s->b : s->a[row], k, row, sigma);
    for (int i = 0; i < s->commutator_count; i++) {
        const lg_commutator *c = &s->commutators[i];
        const double weight = r->over.h * r->over.h * c->weight;
        lg_parts bracket;
        if (c->row != row || c->weight == 0.0) continue;
        LG_TRY(lg_taped_bracket(r->tape, &r->ode->space, k[c->first].part, k[c->second].part, bracket.part));
        by_rows(r, &bracket);
        for (size_t p = 0; p < r->parts; p++)
            sigma->part[p] = *any ? lg_taped_moved(r->tape, sigma->part[p], weight, bracket.part[p])
                                  : lg_scale(r->tape, bracket.part[p], weight);
        *any = true;
    }
    if (*any) by_rows(r, sigma);
    return lg_tape_status(r->tape);
}

static lg_status rkmk_stage(run *r, int i, const lg_parts *y, lg_parts *k) {
    const lg_scheme *s = r->scheme;
    lg_parts sigma, at = *y, f;
    bool moved;
    LG_TRY(exponent(r, i, k, &moved, &sigma));
    if (!moved && i == 0 && r->has_first) {
        k[i] = r->first;
        return LG_OK;
    }
    if (moved) LG_TRY(act(r, &sigma, y, &at));
    LG_TRY(field(r, s->c[i], &at, &f));
    if (s->fsal && i + 1 == s->stages) r->first = f;
    if (!moved) {
        k[i] = f;
        return LG_OK;
    }
    return lg_taped_dexpinv(r->tape, &r->ode->space, s->dexpinv, sigma.part, f.part, k[i].part);
}

/* Number of stages up to the last one whose k_j the step's own exponent uses. */
static int rkmk_stages(const lg_scheme *s) {
    int last = 0;
    for (int j = 0; j < s->stages; j++)
        if (s->b[j] != 0.0) last = j;
    for (int i = 0; i < s->commutator_count; i++) {
        const lg_commutator *c = &s->commutators[i];
        if (c->row == s->stages && c->first > last) last = c->first;
        if (c->row == s->stages && c->second > last) last = c->second;
    }
    return last + 1;
}

static lg_status rkmk_step(run *r, lg_parts *y) {
    const lg_scheme *s = r->scheme;
    const bool keeps = s->fsal && r->continues;
    const int stages = keeps ? s->stages : rkmk_stages(s);
    lg_parts k[LG_SCHEME_MAX_STAGES], sigma;
    bool moved;
    for (int i = 0; i < stages; i++) LG_TRY(rkmk_stage(r, i, y, k));
    r->has_first = keeps;
    LG_TRY(exponent(r, s->stages, k, &moved, &sigma));
    return moved ? act(r, &sigma, y, y) : LG_OK;
}

/* ---- commutator-free ---- */

static lg_status cf_point(const run *r, const lg_cf_row *row, const lg_parts *y, const lg_parts *stage,
                          const lg_parts *f, int known, lg_parts *out) {
    *out = row->base == LG_CF_START ? *y : stage[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        lg_parts a;
        if (!combine(r, row->coefficient[e], f, known, &a)) continue;
        by_rows(r, &a);
        LG_TRY(act(r, &a, out, out));
    }
    return LG_OK;
}

/* Number of stages up to the last one that the row uses as a base or with a nonzero coefficient. */
static int cf_stages(const lg_cf_row *row, int stages) {
    int last = row->base == LG_CF_START ? 0 : row->base;
    for (int e = 0; e < row->exponentials; e++)
        for (int j = last + 1; j < stages; j++)
            if (row->coefficient[e][j] != 0.0) last = j;
    return last + 1;
}

static lg_status cf_step(run *r, lg_parts *y) {
    const lg_scheme *s = r->scheme;
    const int stages = cf_stages(&s->rows[s->stages], s->stages);
    lg_parts stage[LG_SCHEME_MAX_STAGES], f[LG_SCHEME_MAX_STAGES], next;
    for (int i = 0; i < stages; i++) {
        LG_TRY(cf_point(r, &s->rows[i], y, stage, f, i, &stage[i]));
        LG_TRY(field(r, s->c[i], &stage[i], &f[i]));
    }
    LG_TRY(cf_point(r, &s->rows[s->stages], y, stage, f, stages, &next));
    *y = next;
    return LG_OK;
}

/* ---- splitting ---- */

/* from + weight h by */
static lg_var moved(const run *r, lg_var from, double weight, lg_var by) {
    return lg_taped_moved(r->tape, from, weight * r->over.h, lg_taped_by_rows(r->tape, &r->over, by));
}

/* One splitting step, in place on q = half[0] and p = half[1]. */
static lg_status kicks_and_drifts(run *r, lg_var *half) {
    const lg_scheme *s = r->scheme;
    const lg_taped_ode *ode = r->ode;
    lg_taped_span at = r->over; /* at.t is the time that q has reached */
    for (int i = 0; i < s->stages; i++) {
        if (s->kick[i] != 0.0) {
            if (lg_is_none(r->force)) LG_TRY(half_field(r, ode->force, &at.t, half[0], &r->force));
            half[1] = moved(r, half[1], s->kick[i], r->force);
        }
        if (s->drift[i] != 0.0) {
            lg_var velocity;
            LG_TRY(half_field(r, ode->velocity, &at.t, half[1], &velocity));
            half[0] = moved(r, half[0], s->drift[i], velocity);
            at.t = lg_taped_stage_time(&at, s->drift[i]);
            r->force = LG_NONE;
        }
    }
    return lg_tape_status(r->tape);
}

static lg_status splitting_step(run *r, lg_parts *y) {
    const uint32_t n = (uint32_t)(r->ode->space.dim / 2);
    if (r->parts == 2) return kicks_and_drifts(r, y->part);
    lg_var half[2] = {lg_slice(r->tape, y->part[0], 1, 0, n), lg_slice(r->tape, y->part[0], 1, n, n)};
    LG_TRY(kicks_and_drifts(r, half));
    y->part[0] = lg_concat(r->tape, half, 2, 1);
    return lg_tape_status(r->tape);
}

/* ---- one step of any kind ---- */

static lg_status implicit_step(run *r, lg_parts *y) {
    return lg_taped_implicit_step(r->tape, r->scheme, r->ode, &r->over, y, y);
}

static lg_status project(const run *r, lg_parts *y) {
    const lg_space *space = &r->ode->space, *manifold = &r->ode->manifold;
    lg_parts point;
    LG_TRY(lg_taped_split(r->tape, manifold, lg_taped_join(r->tape, space, y->part), point.part));
    LG_TRY(lg_taped_project(r->tape, manifold, point.part, point.part));
    return lg_taped_split(r->tape, space, lg_taped_join(r->tape, manifold, point.part), y->part);
}

static lg_status step(run *r, lg_parts *y) {
    static lg_status (*const step_of[LG_SCHEME_KINDS])(run *, lg_parts *) = {
        [LG_SCHEME_RKMK] = rkmk_step,           [LG_SCHEME_COMMUTATOR_FREE] = cf_step,
        [LG_SCHEME_SPLITTING] = splitting_step, [LG_SCHEME_IMPLICIT] = implicit_step,
        [LG_SCHEME_SLGI] = implicit_step,
    };
    LG_TRY(step_of[r->scheme->kind](r, y));
    if (r->scheme->project && r->ode->manifold.factors > 0) {
        LG_TRY(project(r, y));
        r->has_first = false; /* r->first is f at the point before the projection */
    }
    return lg_tape_status(r->tape);
}

/* Whether the space can be split into q and p: two factors of equal dimension, or one of even dimension. */
static bool splits(const lg_space *space) {
    const lg_space_factor *f = space->factor;
    return space->factors == 1 ? f[0].count % 2 == 0 : space->factors == 2 && f[0].count == f[1].count;
}

static lg_status refuse(lg_tape *tape, lg_status status, const char *reason) {
    (void)lg_tape_fail(tape, status, "step", reason);
    return lg_tape_status(tape);
}

static lg_status check_space(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode) {
    const lg_scheme_kind kind = scheme->kind;
    const bool flat = scheme->ambient || kind == LG_SCHEME_SPLITTING || kind == LG_SCHEME_IMPLICIT;
    if (kind == LG_SCHEME_VARIATIONAL)
        return refuse(tape, LG_UNSUPPORTED, "a variational scheme cannot be recorded");
    if (tape->calls != NULL && (kind == LG_SCHEME_IMPLICIT || kind == LG_SCHEME_SLGI))
        return refuse(tape, LG_UNSUPPORTED,
                      "the scheme solves equations in each step, which a program cannot do: take an explicit "
                      "scheme, such as cf4, or rk4 on R^n");
    if (flat && !lg_space_is_abelian(&ode->space))
        return refuse(tape, LG_UNSUPPORTED, "the scheme is for R^n only, but the space is not R^n");
    if (kind == LG_SCHEME_SPLITTING && !splits(&ode->space))
        return refuse(tape, LG_UNSUPPORTED, "a splitting scheme needs the space R^n x R^n or R^2n");
    if (kind == LG_SCHEME_SLGI && !lg_slgi_fits(&ode->space))
        return refuse(tape, LG_UNSUPPORTED, "the scheme is for T*G only, but the space is not T*G");
    if (scheme->project && ode->manifold.factors > 0 && ode->manifold.dim != ode->space.dim)
        return refuse(tape, LG_INVALID_ARGUMENT,
                      "the dimension of the manifold differs from the dimension of the space");
    return LG_OK;
}

/* Checks all arguments before anything is recorded. */
static lg_status check(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, const lg_var *y) {
    lg_error why;
    LG_TRY(lg_tape_status(tape));
    if (lg_scheme_check(scheme, &why) != LG_OK) return refuse(tape, why.status, why.message);
    LG_TRY(check_space(tape, scheme, ode));
    if (scheme->kind == LG_SCHEME_SPLITTING && (ode->force == NULL || ode->velocity == NULL))
        return refuse(tape, LG_INVALID_ARGUMENT,
                      "a splitting scheme needs `force` and `velocity`, but one of them is NULL");
    if (scheme->kind != LG_SCHEME_SPLITTING && ode->field == NULL)
        return refuse(tape, LG_INVALID_ARGUMENT, "the scheme needs `field`, which is NULL");
    (void)lg_taped_fits(tape, &ode->space, false, y, NULL, "step");
    return lg_tape_status(tape);
}

/* ---- intervals ---- */

/* Fails with `fault` unless x is (batch, columns) or LG_NONE. `columns` 0 allows any number of columns. */
static void check_rows(lg_tape *tape, lg_var x, uint32_t batch, uint32_t columns, const char *fault) {
    const lg_shape s = lg_var_shape(tape, x);
    if (lg_is_none(x) || (s.rank == 2 && s.dims[0] == batch && (columns == 0 || s.dims[1] == columns)))
        return;
    (void)lg_tape_fail(tape, LG_SHAPE, "step", fault);
}

static lg_status make_span(lg_tape *tape, const lg_space *space, const lg_taped_interval *over, lg_var state,
                           lg_taped_span *out) {
    const uint32_t batch = lg_var_shape(tape, state).dims[0];
    const bool constant = lg_is_none(over->h_rows);
    check_rows(tape, over->t.rows, batch, 1,
               "the time must have shape (B, 1), where B is the state's number of rows");
    check_rows(tape, over->t.step, batch, 1,
               "the time must have shape (B, 1), where B is the state's number of rows");
    check_rows(tape, over->h_rows, batch, 1,
               "the step size must have shape (B, 1), where B is the state's number of rows");
    check_rows(tape, over->input, batch, 0,
               "the input must have shape (B, m), where B is the state's number of rows");
    LG_TRY(lg_tape_status(tape));
    *out = (lg_taped_span){
        .t = over->t, .h = constant ? over->h : 1.0, .rows = over->h_rows, .input = over->input};
    if (!constant && !lg_space_is_abelian(space))
        out->tall = lg_reshape(tape, over->h_rows, lg_shape3(batch, 1, 1));
    if (!lg_is_none(over->t.step)) out->t = (lg_taped_time){.rows = lg_taped_time_rows(tape, over->t, batch)};
    return lg_tape_status(tape);
}

/* ---- runs ---- */

static lg_status start(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, const lg_var *y,
                       const lg_var *out, run *r) {
    *r = (run){.tape = tape, .scheme = scheme, .ode = ode, .force = LG_NONE};
    LG_TRY(lg_tape_needs(tape, "step", scheme != NULL && ode != NULL && y != NULL && out != NULL));
    LG_TRY(check(tape, scheme, ode, y));
    r->parts = lg_taped_parts(&ode->space);
    return LG_OK;
}

/* If the step fails with a status that is not on the tape yet (a field may return one), puts it there. */
static lg_status take_step(run *r, lg_parts *y) {
    const lg_status status = step(r, y);
    return status == LG_OK ? LG_OK : refuse(r->tape, status, lg_status_sentence(status));
}

lg_status lg_taped_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                        const lg_taped_interval *over, const lg_var *y, lg_var *out) {
    run r;
    lg_parts next;
    LG_TRY(lg_tape_needs(tape, "step", over != NULL));
    LG_TRY(start(tape, scheme, ode, y, out, &r));
    LG_TRY(make_span(tape, &ode->space, over, y[0], &r.over));
    for (size_t p = 0; p < r.parts; p++) next.part[p] = y[p];
    LG_TRY(take_step(&r, &next));
    for (size_t p = 0; p < r.parts; p++) out[p] = next.part[p];
    return LG_OK;
}

lg_status lg_taped_integrate(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode, double t0,
                             double h, size_t steps, size_t every, const lg_var *y0, lg_var *out) {
    run r;
    lg_parts y;
    LG_TRY(start(tape, scheme, ode, y0, out, &r));
    if (steps == 0 || every == 0 || steps % every != 0)
        return refuse(tape, LG_INVALID_ARGUMENT,
                      "`steps` and `every` must be above 0, and `steps` must be a multiple of `every`");
    for (size_t p = 0; p < r.parts; p++) y.part[p] = y0[p];
    for (size_t n = 0; n < steps; n++) {
        r.continues = n + 1 < steps;
        r.over = (lg_taped_span){.t = {.value = t0 + (double)n * h}, .h = h};
        LG_TRY(take_step(&r, &y));
        if ((n + 1) % every != 0) continue;
        for (size_t p = 0; p < r.parts; p++) *out++ = y.part[p];
    }
    return LG_OK;
}
