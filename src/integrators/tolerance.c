/* Absolute tolerances of an adaptive run. If atol < 0, they follow the sizes of groups (groups.h). */
#include "integrators/stepper.h"

#include <math.h>

#include "integrators/groups.h"

/* out_g = the largest of out_g and all |x_i| in group g */
static void widen(const lg_tolerance *tol, const double *x, double *out) {
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++)
        for (; i < tol->end[g]; i++) out[g] = fabs(x[i]) > out[g] ? fabs(x[i]) : out[g];
}

/* Sets atol of each number for a step of size h: part tried_g + h noise_g, where g is its group. */
static void spread(const lg_tolerance *tol, double part, double h) {
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++) {
        const double atol = part * tol->tried[g] + h * tol->noise[g];
        for (; i < tol->end[g]; i++) tol->atol[i] = atol;
    }
}

/* Measures tol->noise: for each group the largest change of y' when each number of y moves by
 * LG_VECTOR_FIELD_ROUNDING times its group's size. s->error must hold y'. The noise stays 0 if the field is
 * not finite at the moved state. */
static lg_status measure_noise(lg_stepper *s, double t) {
    const lg_tolerance *tol = &s->tolerance;
    double *moved = s->run[1], *velocity = s->point;
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++)
        for (; i < tol->end[g]; i++)
            moved[i] = s->run[0][i] + lg_rounding_sign(i) * LG_VECTOR_FIELD_ROUNDING * tol->size[g];
    const lg_status status = lg_stepper_evaluate(s, t, moved, NULL, s->bracket);
    if (status != LG_OK) return status == LG_NOT_FINITE ? LG_OK : status;
    lg_space_generator(&s->ode.space, s->bracket, s->run[0], velocity);
    if (!lg_all_finite(s->ode.space.dim, velocity)) return LG_OK;
    for (i = 0; i < s->ode.space.dim; i++) velocity[i] -= s->error[i];
    widen(tol, velocity, tol->noise);
    return LG_OK;
}

/* Sets the tolerances for choosing the first step: (rtol + |atol|) S if atol < 0, otherwise rtol S + atol. S
 * is the size of the whole group, so the direction of y within the group does not matter. If the size is 0, S
 * is `span` times the size of the group's velocity, which tol->tried holds. */
static void spread_first(const lg_tolerance *tol, const lg_step_controller *control, double span) {
    const double relative = control->rtol + fmax(-control->atol, 0.0), absolute = fmax(control->atol, 0.0);
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++) {
        const double size = tol->size[g] > 0.0 ? tol->size[g] : span * tol->tried[g];
        for (; i < tol->end[g]; i++) tol->atol[i] = absolute + relative * size;
    }
}

lg_status lg_tolerance_begin(lg_stepper *s, const lg_step_controller *control, double t, double span,
                             const double *f) {
    lg_tolerance *tol = &s->tolerance;
    tol->groups = lg_space_groups(s->ode.manifold.factors > 0 ? &s->ode.manifold : &s->ode.space, tol->end);
    for (size_t g = 0; g < tol->groups; g++) tol->size[g] = tol->tried[g] = tol->noise[g] = 0.0;
    widen(tol, s->run[0], tol->size);
    lg_space_generator(&s->ode.space, f, s->run[0], s->error);
    widen(tol, s->error, tol->tried);
    spread_first(tol, control, span);
    return control->atol < 0.0 ? measure_noise(s, t) : LG_OK;
}

void lg_tolerance_try(lg_stepper *s, const lg_step_controller *control, double h, const double *y_next) {
    lg_tolerance *tol = &s->tolerance;
    if (control->atol >= 0.0) {
        for (size_t i = 0; i < s->ode.space.dim; i++) tol->atol[i] = control->atol;
        return;
    }
    for (size_t g = 0; g < tol->groups; g++) tol->tried[g] = tol->size[g];
    widen(tol, y_next, tol->tried);
    spread(tol, -control->atol, h);
}

void lg_tolerance_accept(lg_stepper *s) {
    double *swap = s->tolerance.size;
    s->tolerance.size = s->tolerance.tried;
    s->tolerance.tried = swap;
}
