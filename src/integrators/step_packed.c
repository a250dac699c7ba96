/* RKMK with exact dexpinv on copies of T*S^2. Each stage is one kernel call. Only kernels read k_i and sigma,
 * so these are kept in the kernels' packed layout. */
#include "integrators/stepper.h"

#include <math.h>
#include <string.h>

#include "kernels/kernels.h"

bool lg_packed_fits(const lg_scheme *scheme, const lg_space *space) {
    return scheme->dexpinv == LG_DEXPINV_EXACT && scheme->commutator_count == 0 && space->factors == 1 &&
           space->factor[0].kind == LG_SPACE_TS2;
}

/* Arguments of the kernel that computes a stage's exponent and point from the k_j, j < stages. If f is given,
 * the kernel first computes the last of these k_j from f. */
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
    p->stage.k_new = s->k + (size_t)known * s->row_stride;
    s->row[known] = p->stage.k_new;
}

/* Obtains f(t, y) and keeps it and y in packed form in memo[0]. */
static lg_status packed_first(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const size_t count = s->ode.space.factor[0].count;
    const double *f;
    lg_memo *memo = &s->memo[0];
    LG_TRY(lg_stepper_first(s, t, h, y, input, &f));
    if (!memo->valid || !memo->is_packed) {
        s->kernels->se3_pack(count, y, memo->packed[0]);
        s->kernels->se3_pack(count, f, memo->packed[1]);
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

/* Computes the last k (if f is given) and the estimated error. */
static void packed_estimate(lg_stepper *s, double h, const double *f) {
    packed_sum sum;
    packed_begin(&sum, s, h, s->difference, s->scheme->stages, f);
    sum.stage.f_packed = f ? s->memo[1].packed[1] : NULL;
    sum.stage.y = s->memo[1].packed[0];
    sum.stage.out = s->error;
    s->kernels->se3_estimate(sum.n, &sum.stage);
}

/* Each kernel call first computes k at the previous point from the field's value f there, then the next
 * point. On return *f is the field's value at the last point, or NULL if the last point is not a stage. */
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
        s->kernels->se3_stage(sum.n, &sum.stage);
        *f = NULL;
        if (i == stages) break;
        LG_TRY(lg_stepper_evaluate(s, t + scheme->c[i] * h, sum.stage.out, input, value));
        *f = value;
    }
    return LG_OK;
}

lg_status lg_step_packed(lg_stepper *s, double t, double h, const double *y, const double *input) {
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

void lg_dense_packed(const lg_stepper *s, const double *weight, double *y) {
    const double *k[LG_SCHEME_MAX_STAGES];
    double c[LG_SCHEME_MAX_STAGES];
    for (int j = 0; j < s->scheme->stages; j++) c[j] = s->h * weight[j], k[j] = s->row[j];
    s->kernels->se3_stage(s->scheme->stages, &(lg_se3_stage){.count = s->ode.space.factor[0].count,
                                                             .c = c,
                                                             .k = k,
                                                             .y = s->memo[0].packed[0],
                                                             .sigma = s->sigma,
                                                             .out = s->point,
                                                             .end = s->sigma, /* sigma is no longer needed */
                                                             .most = s->most});
    memcpy(y, s->point, s->ode.space.dim * sizeof(*y));
}
