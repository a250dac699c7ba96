/* One step of any scheme: short interpreters over the scheme's data. Implicit kinds are in implicit.c and
 * slgi.c. */
#include "integrators/stepper.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"

/* ---- evaluations and what is kept of them ---- */

/* Times that differ by rounding are the same time. */
static bool same_time(double a, double b, double h) {
    return a == b || fabs(a - b) <= 4.0 * DBL_EPSILON * fmax(fabs(b), fabs(h));
}

static bool remembers(const lg_memo *memo, size_t n, double t, double h, const double *y) {
    return memo->valid && same_time(memo->t, t, h) && memcmp(memo->y, y, n * sizeof(*y)) == 0;
}

static void remember(lg_memo *memo, size_t n, double t, const double *y) {
    memo->valid = true;
    memo->is_packed = false;
    memo->t = t;
    memcpy(memo->y, y, n * sizeof(*y));
}

lg_status lg_stepper_evaluate(lg_stepper *s, double t, const double *y, const double *input, double *out) {
    s->evaluations++;
    return s->ode.field(s->ode.user, t, y, input, out);
}

/* f(t, y) at the start of a step. memo[0] belongs to the start of the step before (which may have been
 * rejected), memo[1] to its end. Dense output finds the start of the step in memo[0].y. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           const double **f) {
    const size_t n = s->ode.space.dim;
    if (!s->memoises || input) {
        lg_stepper_reset(s);
        if (s->scheme->dense_order > 0) memcpy(s->memo[0].y, y, n * sizeof(*y));
        *f = s->k;
        return lg_stepper_evaluate(s, t, y, input, s->k);
    }
    if (!remembers(&s->memo[0], n, t, h, y) && remembers(&s->memo[1], n, t, h, y)) {
        const lg_memo swap = s->memo[0];
        s->memo[0] = s->memo[1];
        s->memo[1] = swap;
    } else if (!remembers(&s->memo[0], n, t, h, y)) {
        s->memo[0].valid = false;
        LG_TRY(lg_stepper_evaluate(s, t, y, input, s->memo[0].value));
        remember(&s->memo[0], n, t, y);
    }
    s->memo[1].valid = false;
    *f = s->memo[0].value;
    return LG_OK;
}

/* ---- linear combinations ---- */

/* out = h sum_j coefficient_j k_j over j < stages; out is a row, none of the k_j */
static void combine(const lg_stepper *s, double h, const double *coefficient, int stages, double *out) {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    int n = 0;
    for (int j = 0; j < stages; j++)
        if (coefficient[j] != 0.0) c[n] = h * coefficient[j], k[n++] = s->row[j];
    if (n > 0)
        s->kernels->stage_sum(s->row_size, n, c, k, out);
    else
        memset(out, 0, s->row_size * sizeof(*out));
}

void lg_stepper_turn(lg_stepper *s, const double *a) {
    if (s->abelian) return;
    const double angle = lg_space_angle(&s->ode.space, a);
    if (angle > s->angle || isnan(angle)) s->angle = angle;
}

/* out = exp(a) . y, and the largest angle so far */
static void apply(lg_stepper *s, const double *a, const double *y, double *out) {
    lg_stepper_turn(s, a);
    lg_space_act(&s->ode.space, a, y, out);
}

/* ---- Runge-Kutta-Munthe-Kaas ---- */

static void rkmk_error(lg_stepper *s, double h) {
    combine(s, h, s->difference, s->scheme->stages, s->sigma);
    lg_space_generator(&s->ode.space, s->sigma, s->y_next, s->error);
}

/* sigma = the exponent of stage `row` (row = stages: of the step), with its commutators */
static void rkmk_exponent(lg_stepper *s, double h, const double *coefficient, int row) {
    const lg_scheme *scheme = s->scheme;
    combine(s, h, coefficient, row, s->sigma);
    for (int i = 0; i < scheme->commutator_count; i++) {
        const lg_commutator *c = &scheme->commutators[i];
        if (c->row != row) continue;
        lg_space_bracket(&s->ode.space, s->row[c->first], s->row[c->second], s->bracket);
        const double weight = h * h * c->weight;
        for (size_t j = 0; j < s->ode.space.algebra_dim; j++) s->sigma[j] += weight * s->bracket[j];
    }
}

/* Stage i >= 1 at `point`. With `fsal` the last stage's point is y1 and its f stays in memo[1] for the next
 * step. */
static lg_status rkmk_stage(lg_stepper *s, int i, double t, double h, const double *point,
                            const double *input) {
    const lg_scheme *scheme = s->scheme;
    const bool last = scheme->fsal && i == scheme->stages - 1;
    double *k = s->k + (size_t)i * s->row_size, *f = last ? s->memo[1].value : k;
    LG_TRY(lg_stepper_evaluate(s, t + scheme->c[i] * h, point, input, f));
    s->row[i] = s->identity ? f : k;
    if (!s->identity) lg_space_dexpinv(&s->ode.space, scheme->dexpinv, s->sigma, f, k);
    if (last && s->memoises && !input) s->memo[1].valid = true, s->memo[1].t = t + h;
    return LG_OK;
}

static lg_status packed_step(lg_stepper *s, double t, double h, const double *y, const double *input);

static lg_status rkmk_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    if (s->packed) return packed_step(s, t, h, y, input);
    LG_TRY(lg_stepper_first(s, t, h, y, input, &s->row[0]));
    if (scheme->fsal) s->y_next = s->memo[1].y;
    for (int i = 1; i < scheme->stages; i++) {
        double *point = scheme->fsal && i == scheme->stages - 1 ? s->y_next : s->point;
        rkmk_exponent(s, h, scheme->a[i], i);
        apply(s, s->sigma, y, point);
        LG_TRY(rkmk_stage(s, i, t, h, point, input));
    }
    if (!scheme->fsal) {
        rkmk_exponent(s, h, scheme->b, scheme->stages);
        apply(s, s->sigma, y, s->y_next);
    }
    if (scheme->embedded_order > 0) rkmk_error(s, h);
    return LG_OK;
}

/* ---- the same for copies of T*S^2, packed ---- */

/* A stage from the k_j of j < stages, of which the last is still to be made when there is an f. */
typedef struct packed_sum {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    int n;
    lg_se3_stage stage;
} packed_sum;

static void packed_begin(packed_sum *p, lg_stepper *s, double h, const double *coefficient, int stages,
                         const double *f) {
    const int known = f ? stages - 1 : stages;
    p->n = 0;
    for (int j = 0; j < known; j++)
        if (coefficient[j] != 0.0) p->c[p->n] = h * coefficient[j], p->k[p->n++] = s->row[j];
    p->stage = (lg_se3_stage){.count = s->ode.space.factor[0].count,
                              .c = p->c,
                              .k = p->k,
                              .y = s->memo[0].packed[0],
                              .f = f,
                              .sigma = s->sigma,
                              .most = s->most};
    if (!f) return;
    p->stage.c_new = h * coefficient[known];
    p->stage.k_new = s->k + (size_t)known * s->row_size;
    s->row[known] = p->stage.k_new;
}

/* The first value, and with it y, packed in memo[0]. */
static lg_status packed_first(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const size_t count = s->ode.space.factor[0].count;
    const double *f;
    lg_memo *memo = &s->memo[0];
    LG_TRY(lg_stepper_first(s, t, h, y, input, &f));
    if (!memo->valid || !memo->is_packed) {
        s->packed->se3_pack(count, y, memo->packed[0]);
        s->packed->se3_pack(count, f, memo->packed[1]);
        memo->is_packed = true;
    }
    s->row[0] = memo->packed[1];
    return LG_OK;
}

static void packed_angle(lg_stepper *s) {
    double w = 0.0;
    for (size_t i = 0; i < LG_SE3_BLOCK; i++)
        if (s->most[i] > w || isnan(s->most[i])) w = s->most[i];
    s->angle = sqrt(w);
}

/* The last k, and the estimated error. */
static void packed_estimate(lg_stepper *s, double h, const double *f) {
    packed_sum sum;
    packed_begin(&sum, s, h, s->difference, s->scheme->stages, f);
    sum.stage.f_packed = f ? s->memo[1].packed[1] : NULL;
    sum.stage.y = s->memo[1].packed[0];
    sum.stage.out = s->error;
    s->packed->se3_estimate(sum.n, &sum.stage);
}

/* Each kernel makes the k of the point before and goes on to the next one. */
static lg_status packed_points(lg_stepper *s, double t, double h, const double *input, const double **f) {
    const lg_scheme *scheme = s->scheme;
    const int stages = scheme->stages, points = scheme->fsal ? stages : stages + 1;
    lg_memo *end = &s->memo[1];
    packed_sum sum;
    *f = NULL;
    for (int i = 1; i < points; i++) {
        const bool last = i == points - 1;
        double *value = last ? end->value : s->bracket;
        packed_begin(&sum, s, h, i < stages ? scheme->a[i] : scheme->b, i, *f);
        sum.stage.out = last ? s->y_next : s->point;
        sum.stage.end = last ? end->packed[0] : NULL;
        s->packed->se3_stage(sum.n, &sum.stage);
        *f = NULL;
        if (i == stages) break;
        LG_TRY(lg_stepper_evaluate(s, t + scheme->c[i] * h, sum.stage.out, input, value));
        *f = value;
    }
    return LG_OK;
}

static lg_status packed_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    lg_memo *end = &s->memo[1];
    const double *f;
    LG_TRY(packed_first(s, t, h, y, input));
    memset(s->most, 0, LG_SE3_BLOCK * sizeof(*s->most));
    if (scheme->fsal) s->y_next = end->y;
    const lg_status status = packed_points(s, t, h, input, &f);
    packed_angle(s);
    if (status != LG_OK) return status;
    if (scheme->fsal || scheme->embedded_order > 0) packed_estimate(s, h, f);
    if (scheme->fsal && s->memoises && !input) end->valid = end->is_packed = true, end->t = t + h;
    return LG_OK;
}

static void packed_dense(const lg_stepper *s, const double *weight, double *y) {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    for (int j = 0; j < s->scheme->stages; j++) c[j] = s->h * weight[j], k[j] = s->row[j];
    s->packed->se3_stage(s->scheme->stages, &(lg_se3_stage){.count = s->ode.space.factor[0].count,
                                                            .c = c,
                                                            .k = k,
                                                            .y = s->memo[0].packed[0],
                                                            .sigma = s->sigma,
                                                            .out = s->point,
                                                            .end = s->sigma, /* is not needed any more */
                                                            .most = s->most});
    memcpy(y, s->point, s->ode.space.dim * sizeof(*y));
}

/* ---- commutator-free ---- */

/* out = the point of the row, out not y nor one of `points`; returns out, or the base where there is no
 * exponential. */
static const double *cf_point(lg_stepper *s, const lg_cf_row *row, double h, const double *y,
                              const double *const *points, double *out) {
    const double *from = row->base == LG_CF_START ? y : points[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        combine(s, h, row->coefficient[e], s->scheme->stages, s->sigma);
        apply(s, s->sigma, from, out);
        from = out;
    }
    return from;
}

static lg_status cf_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const size_t n = s->ode.space.dim;
    const double *points[LG_SCHEME_MAX_STAGES];
    for (int i = 0; i < scheme->stages; i++) s->row[i] = s->k + (size_t)i * s->row_size;
    for (int i = 0; i < scheme->stages; i++) {
        points[i] = cf_point(s, &scheme->rows[i], h, y, points, s->point + (size_t)i * n);
        LG_TRY(i == 0 ? lg_stepper_first(s, t, h, points[0], input, &s->row[0])
                      : lg_stepper_evaluate(s, t + scheme->c[i] * h, points[i], input,
                                            s->k + (size_t)i * s->row_size));
    }
    const double *end = cf_point(s, &scheme->rows[scheme->stages], h, y, points, s->y_next);
    if (end != s->y_next) memcpy(s->y_next, end, n * sizeof(*end));
    if (scheme->embedded_order > 0) {
        end = cf_point(s, &scheme->rows[scheme->stages + 1], h, y, points, s->error);
        for (size_t i = 0; i < n; i++) s->error[i] = s->y_next[i] - end[i];
    }
    return LG_OK;
}

/* ---- splitting on R^2n ---- */

static void add_scaled(size_t n, double c, const double *x, double *y) {
    for (size_t i = 0; i < n; i++) y[i] += c * x[i];
}

/* memo[0] holds the force at the q of the end of the last step. */
static lg_status splitting_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const lg_ode *ode = &s->ode;
    const size_t n = ode->space.dim / 2;
    double *q = s->y_next, *p = s->y_next + n, time = t;
    lg_memo *force = &s->memo[0];
    bool known = !input && remembers(force, n, t, h, y);
    force->valid = false;
    memcpy(q, y, 2 * n * sizeof(*y));
    for (int i = 0; i < scheme->stages; i++) {
        if (scheme->kick[i] != 0.0) {
            if (!known) {
                s->evaluations++;
                LG_TRY(ode->force(ode->user, time, q, input, force->value));
            }
            known = true;
            add_scaled(n, h * scheme->kick[i], force->value, p);
        }
        if (scheme->drift[i] != 0.0) {
            LG_TRY(ode->velocity(ode->user, time, p, input, s->sigma));
            add_scaled(n, h * scheme->drift[i], s->sigma, q);
            time += h * scheme->drift[i];
            known = false;
        }
    }
    if (known && !input) remember(force, n, t + h, q);
    return LG_OK;
}

/* ---- variational ---- */

static lg_status variational_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    (void)input;
    memcpy(s->y_next, y, s->ode.space.dim * sizeof(*y));
    s->evaluations++;
    return s->ode.step(s->ode.user, t, h, s->y_next);
}

/* ---- memory ---- */

static bool uses_newton(const lg_scheme *scheme) {
    return scheme->kind == LG_SCHEME_IMPLICIT || scheme->kind == LG_SCHEME_SLGI;
}

/* What a kind asks of the space and the functions. */
typedef struct lg_kind_needs {
    bool abelian, even, field, halves, step;
} lg_kind_needs;

static const lg_kind_needs needs_of[LG_SCHEME_KINDS] = {
    [LG_SCHEME_RKMK] = {.field = true},
    [LG_SCHEME_COMMUTATOR_FREE] = {.field = true},
    [LG_SCHEME_SPLITTING] = {.abelian = true, .even = true, .halves = true},
    [LG_SCHEME_IMPLICIT] = {.abelian = true, .field = true},
    [LG_SCHEME_SLGI] = {.field = true},
    [LG_SCHEME_VARIATIONAL] = {.step = true},
};

static lg_status check_space(const lg_space *given) {
    lg_space space;
    LG_TRY(lg_space_init(&space, given->factor, given->factors));
    return space.dim == given->dim && space.algebra_dim == given->algebra_dim ? LG_OK : LG_INVALID_ARGUMENT;
}

#define NEWTON_MAX ((size_t)1 << 14) /* the Jacobian is full */

static lg_status check(const lg_scheme *scheme, const lg_ode *ode) {
    if (!ode || lg_scheme_check(scheme, NULL) != LG_OK) return LG_INVALID_ARGUMENT;
    const lg_kind_needs *needs = &needs_of[scheme->kind];
    LG_TRY(check_space(&ode->space));
    if ((needs->abelian || scheme->ambient) && !lg_space_is_abelian(&ode->space)) return LG_UNSUPPORTED;
    if (needs->even && ode->space.dim % 2 != 0) return LG_UNSUPPORTED;
    if (scheme->kind == LG_SCHEME_SLGI && !lg_slgi_fits(&ode->space)) return LG_UNSUPPORTED;
    if (uses_newton(scheme) && ode->space.algebra_dim > NEWTON_MAX) return LG_UNSUPPORTED;
    if ((needs->field && !ode->field) || (needs->halves && (!ode->force || !ode->velocity)) ||
        (needs->step && !ode->step))
        return LG_INVALID_ARGUMENT;
    if (!scheme->project || ode->manifold.factors == 0) return LG_OK;
    LG_TRY(check_space(&ode->manifold));
    return ode->manifold.dim == ode->space.dim ? LG_OK : LG_INVALID_ARGUMENT;
}

/* Hands out parts of a block; with base NULL it only counts. Parts start on 64-byte boundaries. */
typedef struct lg_carver {
    double *base;
    size_t used;
} lg_carver;

static size_t in_blocks(size_t doubles) {
    return (doubles + LG_K_STAGE_BLOCK - 1) / LG_K_STAGE_BLOCK * LG_K_STAGE_BLOCK;
}

static double *carve(lg_carver *carver, size_t doubles) {
    double *part = carver->base ? carver->base + carver->used : NULL;
    carver->used += in_blocks(doubles);
    return part;
}

#define STEPPER_DOUBLES                                                                                      \
    ((sizeof(lg_stepper) + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT / sizeof(double))

static void lay_out_newton(lg_newton *newton, lg_carver *carver, size_t m) {
    double **const vectors[] = {&newton->z,    &newton->trial, &newton->residual,
                                &newton->step, &newton->next,  &newton->scale};
    for (size_t i = 0; i < LG_COUNT(vectors); i++) *vectors[i] = carve(carver, m);
    newton->jacobian = carve(carver, m * m);
    newton->pivot = (size_t *)(void *)carve(carver, m); /* a size_t is not larger than a double */
}

static bool is_packed(const lg_scheme *scheme, const lg_space *space) {
    return scheme->kind == LG_SCHEME_RKMK && scheme->dexpinv == LG_DEXPINV_EXACT &&
           scheme->commutator_count == 0 && space->factors == 1 && space->factor[0].kind == LG_SPACE_TS2;
}

static size_t lay_out(lg_stepper *s, double *memory, const lg_scheme *scheme, const lg_space *space) {
    lg_carver carver = {memory, STEPPER_DOUBLES};
    const size_t stages = (size_t)scheme->stages, block = 6 * (size_t)LG_SE3_BLOCK;
    const bool cf = scheme->kind == LG_SCHEME_COMMUTATOR_FREE, packed = is_packed(scheme, space);
    size_t n = space->dim, m = space->algebra_dim;
    if (packed) n = m = (m + block - 1) / block * block;
    s->row_size = in_blocks(m);
    s->k = carve(&carver, stages * s->row_size);
    s->sigma = carve(&carver, m);
    s->bracket = carve(&carver, m);
    s->point = carve(&carver, cf ? stages * n : n);
    s->y_next = carve(&carver, n);
    s->error = carve(&carver, n);
    for (int i = 0; i < 2; i++) {
        s->memo[i].y = carve(&carver, n);
        s->memo[i].value = carve(&carver, m);
        s->run[i] = carve(&carver, n);
        for (int j = 0; j < 2; j++) s->memo[i].packed[j] = packed ? carve(&carver, m) : NULL;
    }
    s->most = packed ? carve(&carver, LG_SE3_BLOCK) : NULL;
    if (uses_newton(scheme)) lay_out_newton(&s->newton, &carver, m);
    return carver.used * sizeof(double);
}

size_t lg_stepper_size(const lg_scheme *scheme, const lg_ode *ode) {
    lg_stepper layout;
    return check(scheme, ode) == LG_OK ? lay_out(&layout, NULL, scheme, &ode->space) : 0;
}

lg_status lg_stepper_init(void *memory, size_t bytes, const lg_scheme *scheme, const lg_ode *ode,
                          lg_stepper **out) {
    LG_TRY(check(scheme, ode));
    if (!memory || !out || (uintptr_t)memory % LG_ALIGNMENT != 0 || bytes < lg_stepper_size(scheme, ode))
        return LG_INVALID_ARGUMENT;
    lg_stepper *s = memory;
    memset(memory, 0, lg_stepper_size(scheme, ode)); /* also what lies behind a row's numbers */
    *s = (lg_stepper){.scheme = scheme, .ode = *ode};
    s->memoises = scheme->embedded_order > 0 || scheme->fsal;
    s->abelian = lg_space_is_abelian(&ode->space);
    s->identity = scheme->kind == LG_SCHEME_RKMK && (scheme->dexpinv == 0 || s->abelian);
    s->kernels = lg_kernels_for(LG_F64);
    s->packed = is_packed(scheme, &ode->space) ? lg_kernels_for(LG_F64) : NULL;
    for (int i = 0; i < scheme->stages; i++) s->difference[i] = scheme->b[i] - scheme->embedded[i];
    (void)lay_out(s, memory, scheme, &ode->space);
    *out = s;
    return LG_OK;
}

lg_status lg_stepper_create(const lg_context *context, const lg_scheme *scheme, const lg_ode *ode,
                            lg_stepper **out) {
    LG_TRY(check(scheme, ode));
    if (!out) return LG_INVALID_ARGUMENT;
    const size_t bytes = lg_stepper_size(scheme, ode);
    void *memory = lg_alloc(context, 1, bytes);
    if (!memory) return LG_OUT_OF_MEMORY;
    const lg_status status = lg_stepper_init(memory, bytes, scheme, ode, out);
    if (status != LG_OK) lg_free(context, memory);
    return status;
}

void lg_stepper_destroy(const lg_context *context, lg_stepper *stepper) {
    lg_free(context, stepper);
}

/* ---- the step ---- */

/* 0 x is 0 or, where x is not finite, NaN; eight sums, so that they need not wait for each other. */
bool lg_all_finite(size_t n, const double *x) {
    double zero[8] = {0.0}, sum = 0.0;
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; j++) zero[j] += 0.0 * x[i + j];
    for (; i < n; i++) sum += 0.0 * x[i];
    for (int j = 0; j < 8; j++) sum += zero[j];
    return sum == 0.0;
}

static void project(const lg_stepper *s, double *y) {
    if (s->scheme->project && s->ode.manifold.factors > 0) lg_space_project(&s->ode.manifold, y);
}

lg_status lg_step(lg_stepper *stepper, double t, double h, const double *y, const double *input,
                  double *y_next) {
    static lg_status (*const step_of[LG_SCHEME_KINDS])(lg_stepper *, double, double, const double *,
                                                       const double *) = {
        [LG_SCHEME_RKMK] = rkmk_step,           [LG_SCHEME_COMMUTATOR_FREE] = cf_step,
        [LG_SCHEME_SPLITTING] = splitting_step, [LG_SCHEME_IMPLICIT] = lg_step_implicit,
        [LG_SCHEME_SLGI] = lg_step_slgi,        [LG_SCHEME_VARIATIONAL] = variational_step,
    };
    if (!stepper || !y || !y_next) return LG_INVALID_ARGUMENT;
    const size_t n = stepper->ode.space.dim;
    stepper->angle = 0.0;
    stepper->dense = false;
    LG_TRY(step_of[stepper->scheme->kind](stepper, t, h, y, input));
    if (stepper->scheme->project) /* what was found at the end does not hold behind it */
        stepper->memo[1].valid = false;
    project(stepper, stepper->y_next);
    if (!lg_all_finite(n, stepper->y_next)) return LG_NOT_FINITE;
    memcpy(y_next, stepper->y_next, n * sizeof(*y_next));
    stepper->h = h;
    stepper->dense = stepper->scheme->dense_order > 0;
    return LG_OK;
}

lg_status lg_stepper_dense(const lg_stepper *stepper, double s, double *y) {
    double weight[LG_SCHEME_MAX_STAGES];
    if (!stepper || !y || !(s >= 0.0 && s <= 1.0)) return LG_INVALID_ARGUMENT;
    const lg_scheme *scheme = stepper->scheme;
    if (scheme->dense_order < 1) return LG_UNSUPPORTED;
    if (!stepper->dense) return LG_INVALID_ARGUMENT;
    for (int i = 0; i < scheme->stages; i++) {
        weight[i] = 0.0;
        for (int j = LG_DENSE_POWERS - 1; j >= 0; j--) weight[i] = s * (weight[i] + scheme->dense[i][j]);
    }
    if (stepper->packed) {
        packed_dense(stepper, weight, y);
        return LG_OK;
    }
    combine(stepper, stepper->h, weight, scheme->stages, stepper->sigma);
    lg_space_act(&stepper->ode.space, stepper->sigma, stepper->memo[0].y, y);
    project(stepper, y);
    return LG_OK;
}

void lg_stepper_reset(lg_stepper *stepper) {
    for (int i = 0; i < 2; i++) stepper->memo[i].valid = stepper->memo[i].is_packed = false;
}

const double *lg_stepper_error(const lg_stepper *stepper) {
    return stepper->scheme->embedded_order > 0 ? stepper->error : NULL;
}

double lg_stepper_angle(const lg_stepper *stepper) {
    return stepper->angle;
}

size_t lg_stepper_evaluations(const lg_stepper *stepper) {
    return stepper->evaluations;
}
