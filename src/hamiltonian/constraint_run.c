/* Motions under constraints of the user: RATTLE, exact flows, samples. liegrad/constraint.h has formulas. */
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "hamiltonian/constraint.h"
#include "kernels/matrix.h"
#include "mechanics/system.h"

LG_AT(lg_stepper_destroy, lg_stepper)

enum { MOST = LG_CONSTRAINT_MOST };

static lg_status needs_motion(const lg_constraint *constraint, lg_error *error) {
    if (constraint->field != NULL) return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED, "the program of the constraint has no function potential (q) -> V");
}

lg_status lg_constraint_energy(const lg_constraint *constraint, const double *state, double *out,
                               lg_error *error) {
    LG_NEEDS(error, constraint, state, out);
    LG_TRY(needs_motion(constraint, error));
    const size_t n = constraint->n;
    LG_CLEAN(lg_constraint_end) lg_constraint_work work = {.of = constraint};
    double u[MOST], v[MOST], H = 0.0;
    memcpy(u, state + n, n * sizeof *u);
    LG_TRY(lg_constraint_begin(constraint, 0.0, state, &work, error));
    lg_constraint_normals(&work, state);
    if (!lg_constraint_clear(&work, constraint->inverse, u)) u[0] = NAN;
    lg_plan_eval(constraint->potential, (const void *[]){state}, (void *[]){&H}, work.plans);
    lg_matrix_multiply(n, 1, n, constraint->inverse, u, v);
    for (size_t i = 0; i < n; i++) H += 0.5 * u[i] * v[i];
    *out = H;
    return LG_OK;
}

/* ---- RATTLE ---- */

typedef struct rattle {
    lg_constraint_work work; /* with G at q */
    double q[MOST], u[MOST];
} rattle;

static void kick(rattle *s, double h) {
    double slope[MOST];
    const lg_constraint *c = s->work.of;
    lg_plan_eval(c->slope, (const void *[]){s->q}, (void *[]){slope}, s->work.plans);
    for (size_t i = 0; i < c->n; i++) s->u[i] -= 0.5 * h * slope[i];
}

/* A kick, a drift by h W u onto g = 0 along W G^T at its start, and a kick. False: Newton's method does not
 * converge. */
static bool step(rattle *s, double h) {
    const lg_constraint *c = s->work.of;
    double normals[MOST * MOST], v[MOST], impulse[MOST];
    memcpy(normals, s->work.G, c->m * c->n * sizeof *normals);
    kick(s, h);
    lg_matrix_multiply(c->n, 1, c->n, c->inverse, s->u, v);
    for (size_t i = 0; i < c->n; i++) s->q[i] += h * v[i];
    if (!lg_constraint_land(&s->work, c->inverse, normals, s->q, impulse)) return false;
    for (size_t i = 0; i < c->n; i++) s->u[i] -= impulse[i] / h;
    kick(s, h);
    return lg_constraint_clear(&s->work, c->inverse, s->u);
}

/* A step of order 2, or of order 4 by Suzuki's composition (1990). */
static lg_status one_step(rattle *s, int order, double h, double t, lg_error *error) {
    const double a = h / (4.0 - cbrt(4.0)), five[] = {a, a, h - 4.0 * a, a, a};
    lg_constraint_view view;
    lg_error why = {LG_OK, ""};
    for (size_t i = 0; i < (order == 2 ? 1 : LG_COUNT(five)); i++) {
        const double part = order == 2 ? h : five[i];
        double from[MOST];
        memcpy(from, s->q, sizeof from);
        if (!step(s, part))
            return lg_fail(
                error, LG_NO_CONVERGENCE,
                "time %g: a step of %g from %s finds no point with g(q) = 0 nearby: the step is too "
                "long, or the normals of the constraint turn by a right angle within it",
                t, part, lg_constraint_show(s->work.of, from).text);
    }
    const lg_status status = lg_constraint_view_of(&s->work, s->q, &view, &why);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "time %g: %s", t + h, why.message);
}

/* The state with p = P u, at a point where the rank is high enough. */
static void store(const rattle *s, double *state) {
    const size_t n = s->work.of->n;
    memcpy(state, s->q, n * sizeof *state);
    memcpy(state + n, s->u, n * sizeof *state);
    (void)lg_constraint_clear(&s->work, NULL, state + n);
}

static lg_status run(rattle *s, int order, double h, size_t steps, size_t every, double *out,
                     lg_error *error) {
    const lg_constraint *c = s->work.of;
    lg_constraint_view view;
    LG_TRY(lg_constraint_view_of(&s->work, s->q, &view, error));
    if (!lg_constraint_clear(&s->work, c->inverse, s->u))
        return lg_fail(error, LG_FORMAT, "the constraint is singular at %s",
                       lg_constraint_show(c, s->q).text);
    for (size_t i = 1; i <= steps; i++) {
        if (i % 1024 == 0 && lg_cancelled(c->context)) return lg_fail(error, LG_CANCELLED, "cancelled");
        LG_TRY(one_step(s, order, h, (double)(i - 1) * h, error));
        if (i % every == 0) store(s, out + i / every * 2 * c->n);
    }
    return LG_OK;
}

lg_status lg_constraint_rattle(const lg_constraint *constraint, int order, double h, size_t steps,
                               size_t every, const double *y0, double *out, lg_error *error) {
    LG_NEEDS(error, constraint, y0, out);
    LG_TRY(needs_motion(constraint, error));
    if ((order != 2 && order != 4) || !isfinite(h) || h == 0.0 || steps == 0 || every == 0 ||
        steps % every != 0)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the order must be 2 or 4, the step finite and not 0, and `every` must divide the steps");
    const size_t n = constraint->n;
    rattle s;
    LG_TRY(lg_constraint_begin(constraint, 0.0, y0, &s.work, error));
    memcpy(s.q, y0, n * sizeof *y0);
    memcpy(s.u, y0 + n, n * sizeof *y0);
    memmove(out, y0, 2 * n * sizeof *y0);
    const lg_status status = run(&s, order, h, steps, every, out, error);
    lg_constraint_end(&s.work);
    return status;
}

/* ---- exact flows ---- */

typedef struct flow {
    const lg_constraint *of;
    void *work;
} flow;

static lg_status field(void *user, double t, const double *y, const double *input, double *f) {
    const flow *self = user;
    lg_plan_eval(self->of->field, (const void *[]){y}, (void *[]){f}, self->work);
    for (size_t i = 0; i < 2 * (size_t)self->of->n; i++)
        if (!isfinite(f[i])) return LG_NOT_FINITE;
    return LG_OK;
}

/* Integrates from each time to the next, and projects the point that is reached. */
static lg_status follow(lg_stepper *stepper, const lg_constraint *c, double size, double tolerance,
                        const double *times, size_t count, double *out, lg_error *error) {
    const size_t d = 2 * (size_t)c->n;
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = tolerance;
    control.atol = -tolerance;
    for (size_t i = 1; i < count; i++) {
        double *y = out + i * d;
        const lg_status status =
            lg_integrate_adaptive(stepper, &control, times[i - 1], y - d, times + i, 1, y, NULL);
        if (status != LG_OK)
            return lg_fail(error, status, "from time %g and %s: %s", times[i - 1],
                           lg_constraint_show(c, y - d).text, lg_status_sentence(status));
        LG_TRY(lg_constraint_project(c, size, y, error));
    }
    return LG_OK;
}

lg_status lg_constraint_flow(const lg_constraint *constraint, double tolerance, const double *times,
                             size_t count, const double *y0, double *out, lg_error *error) {
    LG_NEEDS(error, constraint, times, y0, out);
    LG_TRY(needs_motion(constraint, error));
    const size_t n = constraint->n;
    flow self = {.of = constraint};
    lg_ode ode = {.field = field, .user = &self};
    LG_CLEAN(lg_stepper_destroy_at) lg_stepper *stepper = NULL;
    double size = 0.0;
    for (size_t i = 0; i < n; i++) size += y0[i] * y0[i];
    LG_TRY(lg_space_init_rn(&ode.space, 2 * n));
    LG_TRY_SCRATCH(char, work, constraint->context, lg_plan_work_size(constraint->field),
                   lg_no_memory(error));
    self.work = work;
    const lg_status status = lg_stepper_create(constraint->context, lg_scheme_find("dp85"), &ode, &stepper);
    if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
    memmove(out, y0, 2 * n * sizeof *y0);
    return follow(stepper, constraint, sqrt(size), tolerance, times, count, out, error);
}

/* ---- samples ---- */

static const double exact = 1e-13; /* tolerance of samples */

/* Draws a start on T*Q. Points from which Newton's method leaves the range of q are drawn again. */
static lg_status draw_start(const lg_constraint *c, const lg_trajectory_options *how, size_t number,
                            double *state, lg_error *error) {
    enum { DRAWS = 1000 };
    const size_t n = c->n;
    size_t count;
    const lg_port *q = lg_program_inputs(c->own, 0, &count);
    const bool free = q->low == q->high;
    const double low = free ? -1.0 : q->low, high = free ? 1.0 : q->high, slack = 0.5 * (high - low);
    lg_error why = {LG_OK, ""};
    lg_rng rng;
    lg_rng_seed(&rng, how->seed, 2 * (uint64_t)number);
    for (int k = 0; k < DRAWS; k++) {
        double v[MOST];
        bool inside = true;
        for (size_t i = 0; i < n; i++) state[i] = lg_rng_uniform_in(&rng, low, high);
        for (size_t i = 0; i < n; i++) v[i] = lg_rng_uniform_in(&rng, how->low, how->high);
        lg_matrix_multiply(n, 1, n, c->mass, v, state + n);
        const lg_status projected = lg_constraint_project(c, high - low, state, &why);
        if (projected == LG_OUT_OF_MEMORY) return lg_fail(error, projected, "%s", why.message);
        if (projected != LG_OK) continue;
        for (size_t i = 0; i < n; i++) inside = inside && state[i] >= low - slack && state[i] <= high + slack;
        if (inside) return LG_OK;
    }
    return lg_fail(error, why.status == LG_FORMAT ? LG_FORMAT : LG_NO_CONVERGENCE,
                   "no start with g(q) = 0 was found in %d draws of q from %g..%g (the range of input q of "
                   "function constraint)%s%s",
                   DRAWS, low, high, why.status != LG_OK ? ": " : "", why.message);
}

lg_status lg_constraint_generate(const lg_constraint *constraint, const lg_trajectory_options *options,
                                 double *t, double *data, double *hamiltonian, lg_error *error) {
    LG_NEEDS(error, constraint, options, data);
    LG_TRY(needs_motion(constraint, error));
    lg_trajectory_options how = *options;
    how.starts = LG_STARTS_BOX;
    const size_t d = 2 * (size_t)constraint->n;
    const char *fault = lg_trajectory_fault(&how);
    if (fault != NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "%s", fault);
    LG_TRY_SCRATCH(double, grid, constraint->context, how.points,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for times"));
    for (size_t j = 0; j < how.points; j++) grid[j] = how.t_end * (double)j / (double)(how.points - 1);
    if (t != NULL) memcpy(t, grid, how.points * sizeof *t);
    for (size_t i = 0; i < how.trajectories; i++) {
        double *y = data + i * how.points * d, start[2 * MOST];
        if (lg_cancelled(constraint->context)) return lg_fail(error, LG_CANCELLED, "cancelled");
        LG_TRY(draw_start(constraint, &how, how.first + i, start, error));
        LG_TRY(lg_constraint_flow(constraint, exact, grid, how.points, start, y, error));
        if (hamiltonian != NULL) LG_TRY(lg_constraint_energy(constraint, start, &hamiltonian[i], error));
        if (!(how.noise > 0.0)) continue;
        lg_trajectory_disturb(&how, d, how.first + i, y);
        if (how.noise_first) LG_TRY(lg_constraint_project(constraint, 0.0, y, error));
    }
    return LG_OK;
}
