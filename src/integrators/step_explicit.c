/* Explicit and variational steps: one short interpreter of the scheme's data per kind. */
#include "integrators/stepper.h"

#include <string.h>

#include "kernels/kernels.h"

/* ---- linear combinations ---- */

/* out = h sum_j coefficient_j k_j over j < stages. `out` is a row and must not be one of the k_j. */
static void combine(const lg_stepper *s, double h, const double *coefficient, int stages, double *out) {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    int n = 0;
    for (int j = 0; j < stages; j++)
        if (coefficient[j] != 0.0) c[n] = h * coefficient[j], k[n++] = s->row[j];
    if (n > 0)
        s->kernels->stage_sum(s->row_stride, n, c, k, out);
    else
        memset(out, 0, s->row_stride * sizeof(*out));
}

/* out = exp(a) . y; updates the step's largest rotation angle. */
static void apply(lg_stepper *s, const double *a, const double *y, double *out) {
    lg_stepper_turn(s, a);
    lg_space_act(&s->ode.space, a, y, out);
}

/* ---- Runge-Kutta-Munthe-Kaas ---- */

static void rkmk_error(lg_stepper *s, double h) {
    combine(s, h, s->difference, s->scheme->stages, s->sigma);
    lg_space_generator(&s->ode.space, s->sigma, s->y_next, s->error);
}

/* s->sigma = the exponent of stage `row` with its commutators, or of the step if row = stages. */
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

/* Computes k_i, i >= 1, at the stage point `point`. In an FSAL scheme the last stage point is y1, and f there
 * is kept in memo[1] for the next step. */
static lg_status rkmk_stage(lg_stepper *s, int i, double t, double h, const double *point,
                            const double *input) {
    const lg_scheme *scheme = s->scheme;
    const bool last = scheme->fsal && i == scheme->stages - 1;
    double *k = s->k + (size_t)i * s->row_stride, *f = last ? s->memo[1].value : k;
    LG_TRY(lg_stepper_evaluate(s, t + scheme->c[i] * h, point, input, f));
    s->row[i] = s->identity ? f : k;
    if (!s->identity) lg_space_dexpinv(&s->ode.space, scheme->dexpinv, s->sigma, f, k);
    if (last && s->memoises && !input) s->memo[1].valid = true, s->memo[1].t = t + h;
    return LG_OK;
}

lg_status lg_step_rkmk(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
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

void lg_dense_rkmk(const lg_stepper *s, const double *weight, double *y) {
    combine(s, s->h, weight, s->scheme->stages, s->sigma);
    lg_space_act(&s->ode.space, s->sigma, s->memo[0].y, y);
}

/* ---- commutator-free ---- */

/* Computes the point of a row into `out`, which must be neither y nor one of `points`. Returns `out`, or the
 * row's base point if the row has no exponentials. */
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

lg_status lg_step_commutator_free(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const size_t n = s->ode.space.dim;
    const double *points[LG_SCHEME_MAX_STAGES];
    for (int i = 0; i < scheme->stages; i++) s->row[i] = s->k + (size_t)i * s->row_stride;
    for (int i = 0; i < scheme->stages; i++) {
        points[i] = cf_point(s, &scheme->rows[i], h, y, points, s->point + (size_t)i * n);
        LG_TRY(i == 0 ? lg_stepper_first(s, t, h, points[0], input, &s->row[0])
                      : lg_stepper_evaluate(s, t + scheme->c[i] * h, points[i], input,
                                            s->k + (size_t)i * s->row_stride));
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

/* memo[0] holds the force at the end of the last step, if q has not changed since it was evaluated. */
lg_status lg_step_splitting(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const lg_scheme *scheme = s->scheme;
    const lg_ode *ode = &s->ode;
    const size_t n = ode->space.dim / 2;
    double *q = s->y_next, *p = s->y_next + n, time = t;
    lg_memo *force = &s->memo[0];
    bool known = !input && lg_memo_holds(force, n, t, h, y);
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
    if (known && !input) lg_memo_keep(force, n, t + h, q);
    return LG_OK;
}

/* ---- variational ---- */

lg_status lg_step_variational(lg_stepper *s, double t, double h, const double *y, const double *input) {
    memcpy(s->y_next, y, s->ode.space.dim * sizeof(*y));
    s->evaluations++;
    return s->ode.step(s->ode.user, t, h, s->y_next);
}
