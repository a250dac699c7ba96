/* Explicit and variational steps: one short interpreter of the scheme's data per kind. */
#include "integrators/stepper.h"

#include <string.h>

#include "integrators/doubles.inc"

/* ---- linear combinations ---- */

/* sigma = h sum_j coefficient_j k_j over j < stages */
static void step_combine(const lg_stepper *s, double h, const double *coefficient, int stages) {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    int n = 0;
    for (int j = 0; j < stages; j++)
        if (coefficient[j] != 0.0) c[n] = h * coefficient[j], k[n++] = s->row[j];
    if (n > 0)
        s->kernels->stage_sum(s->row_stride, n, c, k, s->sigma);
    else
        memset(s->sigma, 0, s->row_stride * sizeof(*s->sigma));
}

/* ---- Runge-Kutta-Munthe-Kaas and commutator-free ---- */

/* sigma of this row, with the commutators of the scheme. */
static void step_exponent(lg_stepper *s, double h, int row) {
    const lg_scheme *scheme = s->scheme;
    const bool stage = row < scheme->stages;
    const double *weights = row > scheme->stages ? s->difference : scheme->b;
    step_combine(s, h, stage ? scheme->a[row] : weights, stage ? row : scheme->stages);
    for (int i = 0; i < scheme->commutator_count; i++) {
        const lg_commutator *c = &scheme->commutators[i];
        if (c->row != row) continue;
        lg_space_bracket(&s->ode.space, s->row[c->first], s->row[c->second], s->bracket);
        const double weight = h * h * c->weight;
        for (size_t j = 0; j < s->ode.space.algebra_dim; j++) s->sigma[j] += weight * s->bracket[j];
    }
}

static void step_apply(lg_stepper *s, const double *from, double *out) {
    lg_stepper_turn(s, s->sigma);
    lg_space_act(&s->ode.space, s->sigma, from, out);
}

/* In an FSAL scheme the last stage point is y1, and f there is kept in memo[1] for the next step. */
static lg_status step_value(lg_stepper *s, int i, double h, const double *point) {
    const lg_scheme *scheme = s->scheme;
    const bool last = scheme->kind == LG_SCHEME_RKMK && scheme->fsal && i == scheme->stages - 1;
    double *k = s->k + (size_t)i * s->row_stride, *f = last ? s->memo[1].value : k;
    if (i == 0) return lg_stepper_first(s, s->t, h, point, s->input, &s->row[0]);
    LG_TRY(lg_stepper_evaluate(s, s->t + scheme->c[i] * h, point, s->input, f));
    s->row[i] = s->identity ? f : k;
    if (!s->identity) lg_space_dexpinv(&s->ode.space, scheme->dexpinv, s->sigma, f, k);
    if (last && s->memoises && !s->input) s->memo[1].valid = true, s->memo[1].t = s->t + h;
    return LG_OK;
}

typedef lg_stepper step_run;
#define lane_generate lg_space_generator
#include "integrators/steps.inc"

lg_status lg_step_rkmk(lg_stepper *s, double t, double h, const double *y, const double *input) {
    s->t = t;
    s->input = input;
    LG_TRY(step_value(s, 0, h, y));
    if (s->scheme->fsal) s->y_next = s->memo[1].y;
    return step_rkmk(s, s->scheme, &s->ode.space, h, y, s->y_next);
}

void lg_dense_rkmk(const lg_stepper *s, const double *weight, double *y) {
    step_combine(s, s->h, weight, s->scheme->stages);
    lg_space_act(&s->ode.space, s->sigma, s->memo[0].y, y);
}

lg_status lg_step_commutator_free(lg_stepper *s, double t, double h, const double *y, const double *input) {
    s->t = t;
    s->input = input;
    for (int i = 0; i < s->scheme->stages; i++) s->row[i] = s->k + (size_t)i * s->row_stride;
    return step_free(s, s->scheme, s->ode.space.dim, h, y, s->point, s->y_next);
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
