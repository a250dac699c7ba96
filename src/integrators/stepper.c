/* A stepper: choice of the step form, layout of its memory, and one step of any scheme. */
#include "integrators/stepper.h"

#include <string.h>

#include "core/portions.h"
#include "kernels/kernels.h"

/* ---- memory ---- */

/* A form is an implementation of steps, with what it requires of the space and of the ode's functions. The
 * first row of `forms` with the scheme's kind whose `fits` accepts the scheme and the space is used. */
struct lg_step_form {
    lg_scheme_kind kind;
    bool (*fits)(const lg_scheme *scheme, const lg_space *space); /* NULL: always */
    lg_status (*step)(lg_stepper *s, double t, double h, const double *y, const double *input);
    void (*dense)(const lg_stepper *s, const double *weight, double *y); /* NULL: no dense output */
    /* Requirements: space R^n, ode.field, even dimension with ode.force and ode.velocity, ode.step. */
    bool abelian, field, halves, map;
    /* The memory that the form needs: packed copies, Newton's method, one point per stage. */
    bool packed, newton, points;
};

static bool slgi_fits(const lg_scheme *scheme, const lg_space *space) {
    return lg_slgi_fits(space);
}

static const lg_step_form forms[] = {
    {LG_SCHEME_RKMK, lg_packed_fits, lg_step_packed, lg_dense_packed, .field = true, .packed = true},
    {LG_SCHEME_RKMK, NULL, lg_step_rkmk, lg_dense_rkmk, .field = true},
    {LG_SCHEME_COMMUTATOR_FREE, NULL, lg_step_commutator_free, NULL, .field = true, .points = true},
    {LG_SCHEME_SPLITTING, NULL, lg_step_splitting, NULL, .abelian = true, .halves = true},
    {LG_SCHEME_IMPLICIT, NULL, lg_step_implicit, NULL, .abelian = true, .field = true, .newton = true},
    {LG_SCHEME_SLGI, slgi_fits, lg_step_slgi, NULL, .field = true, .newton = true},
    {LG_SCHEME_VARIATIONAL, NULL, lg_step_variational, NULL, .map = true},
};

/* Returns NULL if no form fits. */
static const lg_step_form *form_of(const lg_scheme *scheme, const lg_space *space) {
    for (size_t i = 0; i < LG_COUNT(forms); i++)
        if (forms[i].kind == scheme->kind && (!forms[i].fits || forms[i].fits(scheme, space)))
            return &forms[i];
    return NULL;
}

static lg_status check_space(const lg_space *given) {
    lg_space space;
    LG_TRY(lg_space_init(&space, given->factor, given->factors));
    return space.dim == given->dim && space.algebra_dim == given->algebra_dim ? LG_OK : LG_INVALID_ARGUMENT;
}

#define NEWTON_MAX ((size_t)1 << 14) /* unknowns; the Jacobian is a full matrix */

static lg_status check(const lg_scheme *scheme, const lg_ode *ode) {
    if (!ode || lg_scheme_check(scheme, NULL) != LG_OK) return LG_INVALID_ARGUMENT;
    LG_TRY(check_space(&ode->space));
    const lg_step_form *needs = form_of(scheme, &ode->space);
    if (!needs) return LG_UNSUPPORTED;
    if ((needs->abelian || scheme->ambient) && !lg_space_is_abelian(&ode->space)) return LG_UNSUPPORTED;
    if (needs->halves && ode->space.dim % 2 != 0) return LG_UNSUPPORTED;
    if (needs->newton && ode->space.algebra_dim > NEWTON_MAX) return LG_UNSUPPORTED;
    if ((needs->field && !ode->field) || (needs->halves && (!ode->force || !ode->velocity)) ||
        (needs->map && !ode->step))
        return LG_INVALID_ARGUMENT;
    if (ode->manifold.factors == 0) return LG_OK;
    LG_TRY(check_space(&ode->manifold));
    return ode->manifold.dim == ode->space.dim ? LG_OK : LG_INVALID_ARGUMENT;
}

static void lay_out_newton(lg_newton *newton, lg_portions *from, size_t m) {
    double **const vectors[] = {&newton->z,    &newton->trial, &newton->residual,
                                &newton->step, &newton->next,  &newton->scale};
    for (size_t i = 0; i < LG_COUNT(vectors); i++) *vectors[i] = lg_portion(from, m, sizeof(double));
    newton->jacobian = lg_portion(from, m * m, sizeof(double));
    newton->pivot = lg_portion(from, m, sizeof(size_t));
}

static void lay_out_tolerance(lg_tolerance *tol, lg_portions *from, size_t n) {
    double **const parts[] = {&tol->atol, &tol->size, &tol->tried, &tol->noise};
    for (size_t i = 0; i < LG_COUNT(parts); i++) *parts[i] = lg_portion(from, n, sizeof(double));
    tol->end = lg_portion(from, n, sizeof(size_t));
}

static size_t lay_out(lg_stepper *s, void *memory, const lg_scheme *scheme, const lg_space *space) {
    const lg_step_form *form = form_of(scheme, space);
    lg_portions from = {memory, 0};
    const size_t stages = (size_t)scheme->stages, one = sizeof(double), block = 6 * (size_t)LG_SE3_BLOCK;
    size_t n = space->dim, m = space->algebra_dim;
    if (form->packed) n = m = (m + block - 1) / block * block;
    s->row_stride = (m + LG_K_STAGE_BLOCK - 1) / LG_K_STAGE_BLOCK * LG_K_STAGE_BLOCK;
    (void)lg_portion(&from, 1, sizeof *s);
    s->k = lg_portion(&from, stages * s->row_stride, one);
    s->sigma = lg_portion(&from, m, one);
    s->bracket = lg_portion(&from, m, one);
    s->point = lg_portion(&from, form->points ? stages * n : n, one);
    s->y_next = lg_portion(&from, n, one);
    s->error = lg_portion(&from, n, one);
    for (int i = 0; i < 2; i++) {
        s->memo[i].y = lg_portion(&from, n, one);
        s->memo[i].value = lg_portion(&from, m, one);
        s->run[i] = lg_portion(&from, n, one);
        for (int j = 0; j < 2; j++) s->memo[i].packed[j] = form->packed ? lg_portion(&from, m, one) : NULL;
    }
    s->most = form->packed ? lg_portion(&from, LG_SE3_BLOCK, one) : NULL;
    if (scheme->embedded_order > 0) lay_out_tolerance(&s->tolerance, &from, space->dim);
    if (form->newton) lay_out_newton(&s->newton, &from, m);
    return from.used;
}

size_t lg_stepper_size(const lg_scheme *scheme, const lg_ode *ode) {
    lg_stepper layout;
    return check(scheme, ode) == LG_OK ? lay_out(&layout, NULL, scheme, &ode->space) : 0;
}

lg_status lg_stepper_init(const lg_scheme *scheme, const lg_ode *ode, lg_stepper **out, void *memory,
                          size_t bytes) {
    LG_TRY(check(scheme, ode));
    if (!out) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_portions_check(memory, bytes, lg_stepper_size(scheme, ode), NULL));
    lg_stepper *s = memory;
    memset(memory, 0, lg_stepper_size(scheme, ode)); /* also zeroes the padding at the end of each row */
    *s = (lg_stepper){.scheme = scheme, .form = form_of(scheme, &ode->space), .ode = *ode};
    s->memoises = scheme->embedded_order > 0 || scheme->fsal;
    s->abelian = lg_space_is_abelian(&ode->space);
    s->identity = scheme->kind != LG_SCHEME_RKMK || scheme->dexpinv == 0 || s->abelian;
    s->kernels = lg_kernels_for(LG_F64);
    for (int i = 0; i < scheme->stages; i++) s->difference[i] = scheme->b[i] - scheme->embedded[i];
    (void)lay_out(s, memory, scheme, &ode->space);
    *out = s;
    return LG_OK;
}

lg_status lg_stepper_create(const lg_context *context, const lg_scheme *scheme, const lg_ode *ode,
                            lg_stepper **out) {
    LG_TRY(check(scheme, ode));
    if (!out) return LG_INVALID_ARGUMENT;
    const size_t size = lg_stepper_size(scheme, ode);
    void *memory = lg_alloc(context, 1, size);
    if (!memory) return LG_OUT_OF_MEMORY;
    const lg_status status = lg_stepper_init(scheme, ode, out, memory, size);
    if (status == LG_OK)
        (*out)->context = context;
    else
        lg_free(context, memory);
    return status;
}

void lg_stepper_destroy(lg_stepper *stepper) {
    if (stepper) lg_free(stepper->context, stepper);
}

/* ---- the step ---- */

static void project(const lg_stepper *s, double *y) {
    if (s->scheme->project && s->ode.manifold.factors > 0) lg_space_project(&s->ode.manifold, y);
}

lg_status lg_stepper_step(lg_stepper *stepper, double t, double h, const double *y, const double *input,
                          double *y_next) {
    if (!stepper || !y || !y_next) return LG_INVALID_ARGUMENT;
    const size_t n = stepper->ode.space.dim;
    stepper->angle = 0.0;
    stepper->dense = false;
    LG_TRY(stepper->form->step(stepper, t, h, y, input));
    if (stepper->scheme->project) /* memo[1] was taken at the point before the projection */
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
    stepper->form->dense(stepper, weight, y);
    project(stepper, y);
    return LG_OK;
}

double lg_stepper_angle(const lg_stepper *stepper) {
    return stepper->angle;
}

size_t lg_stepper_evaluations(const lg_stepper *stepper) {
    return stepper->evaluations;
}
