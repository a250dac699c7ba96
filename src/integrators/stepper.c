/* One step of any scheme: three short interpreters over the scheme's data. */
#include "integrators/stepper.h"

#include <float.h>
#include <math.h>
#include <string.h>

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
    memo->t = t;
    memcpy(memo->y, y, n * sizeof(*y));
}

static lg_status evaluate(lg_stepper *s, double t, const double *y, const double *input, double *out) {
    s->evaluations++;
    return s->ode.field(s->ode.user, t, y, input, out);
}

/* f(t, y) at the start of a step. memo[0] belongs to the start of the step before (which may have been
 * rejected), memo[1] to its end. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           double *f) {
    const size_t n = s->ode.space.dim, m = s->ode.space.algebra_dim;
    if (!s->memoises || input) {
        lg_stepper_reset(s);
        return evaluate(s, t, y, input, f);
    }
    if (!remembers(&s->memo[0], n, t, h, y) && remembers(&s->memo[1], n, t, h, y)) {
        const lg_memo swap = s->memo[0];
        s->memo[0] = s->memo[1];
        s->memo[1] = swap;
    } else if (!remembers(&s->memo[0], n, t, h, y)) {
        s->memo[0].valid = false;
        LG_TRY(evaluate(s, t, y, input, s->memo[0].value));
        remember(&s->memo[0], n, t, y);
    }
    s->memo[1].valid = false;
    memcpy(f, s->memo[0].value, m * sizeof(*f));
    return LG_OK;
}

/* out = h sum_j coefficient_j k_j over j < stages; rows of k have algebra_dim numbers */
static void combine(const lg_stepper *s, double h, const double *coefficient, int stages, double *out) {
    const size_t m = s->ode.space.algebra_dim;
    memset(out, 0, m * sizeof(*out));
    for (int j = 0; j < stages; j++) {
        const double c = h * coefficient[j];
        const double *k = s->k + (size_t)j * m;
        if (coefficient[j] == 0.0) continue;
        for (size_t i = 0; i < m; i++) out[i] += c * k[i];
    }
}

/* out = exp(a) . y, and the largest angle so far */
static void apply(lg_stepper *s, const double *a, const double *y, double *out) {
    const double angle = lg_space_angle(&s->ode.space, a);
    if (angle > s->angle || isnan(angle)) s->angle = angle;
    lg_space_act(&s->ode.space, a, y, out);
}

/* ---- Runge-Kutta-Munthe-Kaas ---- */

static void rkmk_error(lg_stepper *s, double h) {
    const lg_scheme *scheme = s->scheme;
    double difference[LG_SCHEME_MAX_STAGES];
    for (int i = 0; i < scheme->stages; i++) difference[i] = scheme->b[i] - scheme->embedded[i];
    combine(s, h, difference, scheme->stages, s->sigma);
    lg_space_generator(&s->ode.space, s->sigma, s->y_next, s->error);
}

/* With `fsal` the last stage's point is y1 and its f waits in memo[1] for the next step. */
static lg_status rkmk_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const lg_space *space = &s->ode.space;
    LG_TRY(lg_stepper_first(s, t, h, y, input, s->k));
    for (int i = 1; i < scheme->stages; i++) {
        const bool last = scheme->fsal && i == scheme->stages - 1;
        double *point = last ? s->y_next : s->point, *f = last ? s->memo[1].value : s->f;
        combine(s, h, scheme->a[i], i, s->sigma);
        apply(s, s->sigma, y, point);
        LG_TRY(evaluate(s, t + scheme->c[i] * h, point, input, f));
        if (last && !input) remember(&s->memo[1], space->dim, t + h, point);
        lg_space_dexpinv(space, scheme->dexpinv, s->sigma, f, s->k + (size_t)i * space->algebra_dim);
    }
    if (!scheme->fsal) {
        combine(s, h, scheme->b, scheme->stages, s->sigma);
        apply(s, s->sigma, y, s->y_next);
    }
    if (scheme->embedded_order > 0) rkmk_error(s, h);
    return LG_OK;
}

/* ---- commutator-free ---- */

/* out = the point of the row; out is not y nor one of s->point */
static void cf_point(lg_stepper *s, const lg_cf_row *row, double h, const double *y, double *out) {
    const size_t n = s->ode.space.dim;
    const double *from = row->base == LG_CF_START ? y : s->point + (size_t)row->base * n;
    if (row->exponentials == 0) memcpy(out, from, n * sizeof(*out));
    for (int e = 0; e < row->exponentials; e++) {
        combine(s, h, row->coefficient[e], s->scheme->stages, s->sigma);
        apply(s, s->sigma, from, out);
        from = out;
    }
}

static lg_status cf_step(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const size_t n = s->ode.space.dim, m = s->ode.space.algebra_dim;
    for (int i = 0; i < scheme->stages; i++) {
        double *point = s->point + (size_t)i * n, *f = s->k + (size_t)i * m;
        cf_point(s, &scheme->rows[i], h, y, point);
        LG_TRY(i == 0 ? lg_stepper_first(s, t, h, point, input, f)
                      : evaluate(s, t + scheme->c[i] * h, point, input, f));
    }
    cf_point(s, &scheme->rows[scheme->stages], h, y, s->y_next);
    if (scheme->embedded_order > 0) {
        cf_point(s, &scheme->rows[scheme->stages + 1], h, y, s->error);
        for (size_t i = 0; i < n; i++) s->error[i] = s->y_next[i] - s->error[i];
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
            LG_TRY(ode->velocity(ode->user, time, p, input, s->f));
            add_scaled(n, h * scheme->drift[i], s->f, q);
            time += h * scheme->drift[i];
            known = false;
        }
    }
    if (known && !input) remember(force, n, t + h, q);
    return LG_OK;
}

/* ---- memory ---- */

static lg_status check(const lg_scheme *scheme, const lg_ode *ode) {
    lg_space space;
    if (!ode || lg_scheme_check(scheme, NULL) != LG_OK) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_space_init(&space, ode->space.factor, ode->space.factors));
    if (space.dim != ode->space.dim || space.algebra_dim != ode->space.algebra_dim)
        return LG_INVALID_ARGUMENT;
    const bool splitting = scheme->kind == LG_SCHEME_SPLITTING;
    if ((splitting || scheme->ambient) && !lg_space_is_abelian(&space)) return LG_UNSUPPORTED;
    if (splitting && space.dim % 2 != 0) return LG_UNSUPPORTED;
    if (splitting ? !ode->force || !ode->velocity : !ode->field) return LG_INVALID_ARGUMENT;
    return LG_OK;
}

/* Hands out parts of a block; with base NULL it only counts. Parts start on 64-byte boundaries. */
typedef struct lg_carver {
    double *base;
    size_t used;
} lg_carver;

static double *carve(lg_carver *carver, size_t doubles) {
    double *part = carver->base ? carver->base + carver->used : NULL;
    carver->used += (doubles + 7) / 8 * 8;
    return part;
}

#define STEPPER_DOUBLES                                                                                      \
    ((sizeof(lg_stepper) + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT / sizeof(double))

static size_t lay_out(lg_stepper *s, double *memory, const lg_scheme *scheme, const lg_space *space) {
    lg_carver carver = {memory, STEPPER_DOUBLES};
    const size_t n = space->dim, m = space->algebra_dim, stages = (size_t)scheme->stages;
    const bool cf = scheme->kind == LG_SCHEME_COMMUTATOR_FREE;
    s->k = carve(&carver, stages * m);
    s->f = carve(&carver, m);
    s->sigma = carve(&carver, m);
    s->point = carve(&carver, cf ? stages * n : n);
    s->y_next = carve(&carver, n);
    s->error = carve(&carver, n);
    for (int i = 0; i < 2; i++) {
        s->memo[i].y = carve(&carver, n);
        s->memo[i].value = carve(&carver, m);
        s->run[i] = carve(&carver, n);
    }
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
    *s = (lg_stepper){.scheme = scheme, .ode = *ode};
    s->memoises = scheme->embedded_order > 0 || scheme->fsal;
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

bool lg_all_finite(size_t n, const double *x) {
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i])) return false;
    return true;
}

lg_status lg_step(lg_stepper *stepper, double t, double h, const double *y, const double *input,
                  double *y_next) {
    static lg_status (*const step_of[LG_SCHEME_KINDS])(lg_stepper *, double, double, const double *,
                                                       const double *) = {
        [LG_SCHEME_RKMK] = rkmk_step,
        [LG_SCHEME_COMMUTATOR_FREE] = cf_step,
        [LG_SCHEME_SPLITTING] = splitting_step,
    };
    if (!stepper || !y || !y_next) return LG_INVALID_ARGUMENT;
    const size_t n = stepper->ode.space.dim;
    stepper->angle = 0.0;
    LG_TRY(step_of[stepper->scheme->kind](stepper, t, h, y, input));
    if (!lg_all_finite(n, stepper->y_next)) return LG_NOT_FINITE;
    memcpy(y_next, stepper->y_next, n * sizeof(*y_next));
    return LG_OK;
}

void lg_stepper_reset(lg_stepper *stepper) {
    stepper->memo[0].valid = stepper->memo[1].valid = false;
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
