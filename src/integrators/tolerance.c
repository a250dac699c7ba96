/* Absolute tolerances of a run that are relative to what they are the tolerances of. */
#include "integrators/stepper.h"

#include <math.h>

#include "integrators/groups.h"

/* out_g = the largest of out_g and |x_i| in group g */
static void widen(const lg_tolerance *tol, const double *x, double *out) {
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++)
        for (; i < tol->end[g]; i++) out[g] = fabs(x[i]) > out[g] ? fabs(x[i]) : out[g];
}

/* For a step of size h. */
static void spread(const lg_tolerance *tol, double part, double h) {
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++) {
        const double atol = part * tol->tried[g] + h * tol->noise[g];
        for (; i < tol->end[g]; i++) tol->atol[i] = atol;
    }
}

/* How far y' moves, by group, when each number of y moves by LG_FIELD_ROUNDING of its group's size.
 * s->error holds y'. */
static lg_status measure_noise(lg_stepper *s, double t) {
    const lg_tolerance *tol = &s->tolerance;
    double *moved = s->run[1], *velocity = s->point;
    size_t i = 0;
    for (size_t g = 0; g < tol->groups; g++)
        for (; i < tol->end[g]; i++)
            moved[i] = s->run[0][i] + lg_rounding_sign(i) * LG_FIELD_ROUNDING * tol->size[g];
    const lg_status status = lg_stepper_evaluate(s, t, moved, NULL, s->bracket);
    if (status != LG_OK) return status == LG_NOT_FINITE ? LG_OK : status;
    lg_space_generator(&s->ode.space, s->bracket, s->run[0], velocity);
    if (!lg_all_finite(s->ode.space.dim, velocity)) return LG_OK;
    for (i = 0; i < s->ode.space.dim; i++) velocity[i] -= s->error[i];
    widen(tol, velocity, tol->noise);
    return LG_OK;
}

lg_status lg_tolerance_begin(lg_stepper *s, const lg_step_controller *control, double t, double span,
                             const double *f) {
    lg_tolerance *tol = &s->tolerance;
    const lg_space *space = s->ode.manifold.factors > 0 ? &s->ode.manifold : &s->ode.space;
    for (size_t i = 0; i < space->dim; i++) tol->atol[i] = control->atol;
    if (control->atol >= 0.0) return LG_OK;
    tol->groups = lg_space_groups(space, tol->end);
    for (size_t g = 0; g < tol->groups; g++) tol->size[g] = tol->tried[g] = tol->noise[g] = 0.0;
    widen(tol, s->run[0], tol->size);
    lg_space_generator(&s->ode.space, f, s->run[0], s->error);
    LG_TRY(measure_noise(s, t));
    widen(tol, s->error, tol->tried);
    const double reach = span * (1.0 - control->rtol / control->atol); /* rtol counts too: y is 0 there */
    for (size_t g = 0; g < tol->groups; g++)
        tol->tried[g] = tol->size[g] > 0.0 ? tol->size[g] : reach * tol->tried[g];
    spread(tol, -control->atol, 0.0);
    return LG_OK;
}

void lg_tolerance_try(lg_stepper *s, const lg_step_controller *control, double h, const double *y_next) {
    lg_tolerance *tol = &s->tolerance;
    if (control->atol >= 0.0) return;
    for (size_t g = 0; g < tol->groups; g++) tol->tried[g] = tol->size[g];
    widen(tol, y_next, tol->tried);
    spread(tol, -control->atol, h);
}

void lg_tolerance_accept(lg_stepper *s) {
    double *swap = s->tolerance.size;
    s->tolerance.size = s->tolerance.tried;
    s->tolerance.tried = swap;
}
