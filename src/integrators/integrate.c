/* Integration: loops over fixed and over adaptive steps. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "integrators/stepper.h"

static inline double dmax(double a, double b) {
    return a > b ? a : b;
}

static double dmin(double a, double b) {
    return a < b ? a : b;
}

/* ---- fixed steps ---- */

lg_status lg_integrate_fixed(lg_stepper *stepper, double t0, double h, size_t steps, const double *inputs,
                             size_t input_dim, size_t every, const double *y0, double *out,
                             lg_run_stats *stats) {
    lg_run_stats run = {0};
    lg_status status = LG_OK;
    if (!stepper || !y0 || !out || steps < 1 || every < 1 || steps % every != 0 || !isfinite(t0) ||
        !isfinite(h) || !lg_all_finite(stepper->ode.space.dim, y0))
        return LG_INVALID_ARGUMENT;
    const size_t n = stepper->ode.space.dim, before = lg_stepper_evaluations(stepper);
    double *y = stepper->run[0];
    memcpy(y, y0, n * sizeof(*y));
    memcpy(out, y0, n * sizeof(*y));
    for (size_t i = 0; i < steps; i++) {
        const double *input = inputs ? inputs + i * input_dim : NULL;
        status = lg_stepper_step(stepper, t0 + (double)i * h, h, y, input, y);
        if (status != LG_OK) break;
        run.steps++;
        run.max_angle = dmax(run.max_angle, lg_stepper_angle(stepper));
        if ((i + 1) % every == 0) memcpy(out + (i + 1) / every * n, y, n * sizeof(*y));
    }
    run.evaluations = lg_stepper_evaluations(stepper) - before;
    if (stats) *stats = run;
    return status;
}

/* ---- step control ---- */

void lg_step_controller_init(lg_step_controller *control) {
    *control = (lg_step_controller){.size = sizeof(lg_step_controller),
                                    .rtol = 1e-6,
                                    .atol = -1e-9,
                                    .safety = 0.9,
                                    .factor_min = 0.2,
                                    .factor_max = 5.0,
                                    .max_angle = 3.14159265358979323846,
                                    .max_steps = 1000000};
}

bool lg_step_controller_valid(const lg_step_controller *c) {
    const double values[] = {c->rtol,       fabs(c->atol), c->safety, c->factor_min,
                             c->factor_max, c->h_initial,  c->h_max,  c->max_angle};
    if (c->steps > 0) return c->size == sizeof(lg_step_controller);
    for (size_t i = 0; i < LG_COUNT(values); i++)
        if (!(values[i] >= 0.0) || !isfinite(values[i])) return false;
    return c->size == sizeof(lg_step_controller) && c->rtol + fabs(c->atol) > 0.0 && c->safety > 0.0 &&
           c->safety < 1.0 && c->factor_min > 0.0 && c->factor_min < 1.0 && c->factor_max > 1.0 &&
           c->max_angle > 0.0 && c->max_steps > 0;
}

lg_step_decision lg_step_controller_decide(const lg_step_controller *control, double exponent, double error,
                                           const lg_step_history *history) {
    const bool turned = !(history->angle <= control->max_angle);
    const bool accept = error <= 1.0 && !turned;
    double factor = control->factor_min; /* kept if the error is infinite or NaN */
    if (error <= DBL_MAX) factor = control->safety * pow(dmax(error, DBL_MIN), -exponent);
    /* The angle is nearly proportional to the step: this limit avoids steps that max_angle would reject. */
    if (history->angle > 0.0) factor = dmin(factor, control->safety * control->max_angle / history->angle);
    if (turned) factor = dmin(factor, 0.5);
    if (isnan(history->angle)) factor = control->factor_min;
    factor = dmin(factor, !accept || history->rejected ? 1.0 : control->factor_max);
    factor = dmax(factor, control->factor_min);
    const double h = history->h * factor;
    return (lg_step_decision){accept, control->h_max > 0.0 ? dmin(h, control->h_max) : h};
}

double lg_error_norm(double rtol, const double *atol, const double *error, const double *y,
                     const double *y_next, size_t dim) {
    return lg_kernels_for(LG_F64)->error_norm(dim, rtol, atol, error, y, y_next);
}

/* ---- adaptive steps ---- */

/* An adaptive run. Step sizes are positive; time advances by sign times the step size. */
typedef struct lg_run {
    lg_stepper *stepper;
    const lg_step_controller *control;
    double exponent;
    double t, t_end, sign;
    double t_before; /* start of the last accepted step */
    double h, h_min;
    bool rejected; /* the last attempt was rejected */
    lg_run_stats stats;
} lg_run;

/* The norm of x relative to the tolerances of a step from y to y_next (lg_error_norm). */
static double norm_at(const lg_run *run, const double *x, const double *y, const double *y_next) {
    const lg_stepper *s = run->stepper;
    return lg_error_norm(run->control->rtol, s->tolerance.atol, x, y, y_next, s->ode.space.dim);
}

/* *out = |y'(t + h) - y'(t)| / h relative to the tolerance: the difference of the ambient velocities at
 * exp(h f) . y and at y. NaN if the field is not finite at exp(h f) . y. */
static lg_status curvature(const lg_run *run, double h, const double *f, double *out) {
    lg_stepper *s = run->stepper;
    const size_t n = s->ode.space.dim, m = s->ode.space.algebra_dim;
    double *y = s->run[1], *velocity = s->point;
    for (size_t i = 0; i < m; i++) s->sigma[i] = run->sign * h * f[i];
    lg_space_act(&s->ode.space, s->sigma, s->run[0], y);
    const lg_status status = lg_stepper_evaluate(s, run->t + run->sign * h, y, NULL, s->bracket);
    *out = NAN;
    if (status != LG_OK) return status == LG_NOT_FINITE ? LG_OK : status;
    lg_space_generator(&s->ode.space, f, s->run[0], s->error);
    lg_space_generator(&s->ode.space, s->bracket, y, velocity);
    for (size_t i = 0; i < n; i++) s->error[i] = (velocity[i] - s->error[i]) / h;
    *out = norm_at(run, s->error, s->run[0], s->run[0]);
    return LG_OK;
}

/* Chooses the first step after Hairer, Norsett and Wanner, Solving ordinary differential equations I, II.4,
 * but independently of the unit of time. d0, d1, d2 are the norms of y, y' and y'' relative to the
 * tolerances, and w = max(d1 / d0, sqrt(d2 / d0)). The first step h satisfies d0 (h w)^(1/exponent) <= 1, and
 * its rotation angle is at most max_angle / 2. */
static lg_status first_step(lg_run *run) {
    lg_stepper *s = run->stepper;
    const size_t n = s->ode.space.dim;
    const double span = fabs(run->t_end - run->t), least = 1e-6 * span;
    const double *f;
    double second;
    run->h = dmin(run->control->h_initial > 0.0 ? run->control->h_initial : span,
                  run->control->h_max > 0.0 ? run->control->h_max : span);
    LG_TRY(lg_stepper_first(s, run->t, span, s->run[0], NULL, &f));
    LG_TRY(lg_tolerance_begin(s, run->control, run->t, span, f));
    if (run->control->h_initial > 0.0) return LG_OK;
    const double angle = lg_space_angle(&s->ode.space, f);
    lg_space_generator(&s->ode.space, f, s->run[0], s->point);
    if (!lg_all_finite(n, s->point)) return LG_NOT_FINITE;
    const double size = norm_at(run, s->run[0], s->run[0], s->run[0]);
    const double speed = norm_at(run, s->point, s->run[0], s->run[0]);
    double h = 0.01 * size / speed;
    if (!(h >= least)) h = least;
    h = dmin(h, run->h);
    if (angle > 0.0) h = dmin(h, 0.5 * run->control->max_angle / angle);
    LG_TRY(curvature(run, h, f, &second));
    const double rate = dmax(speed / size, sqrt(second / size));
    double limit = 100.0 * h;
    if (size > 0.0 && rate > 0.0) limit = dmin(limit, pow(size, -run->exponent) / rate);
    if (!isfinite(second)) limit = 0.1 * h;
    if (angle > 0.0) limit = dmin(limit, 0.5 * run->control->max_angle / angle);
    run->h = dmax(dmin(limit, run->h), run->h_min);
    return LG_OK;
}

/* Tries one step. If it would reach `target`, it is clipped to end exactly there. Otherwise its size is the
 * difference of the rounded times, so that the sizes of all steps add up to the time. */
static lg_status attempt(lg_run *run, double target) {
    lg_stepper *s = run->stepper;
    const double left = fabs(target - run->t), end = run->t + run->sign * run->h;
    const bool clipped = run->h * (1.0 + 1e-3) >= left;
    const double h = clipped ? left : fabs(end - run->t);
    double error = NAN;
    if (run->stats.steps + run->stats.rejected >= run->control->max_steps) return LG_TOO_MANY_STEPS;
    const lg_status status = lg_stepper_step(s, run->t, run->sign * h, s->run[0], NULL, s->run[1]);
    if (status == LG_OK) {
        lg_tolerance_try(s, run->control, h, s->run[1]);
        error = norm_at(run, s->error, s->run[0], s->run[1]);
    } else if (status != LG_NOT_FINITE)
        return status;
    const lg_step_history history = {h, s->angle, run->rejected};
    const lg_step_decision decision = lg_step_controller_decide(run->control, run->exponent, error, &history);
    run->rejected = !decision.accept;
    if (!decision.accept) {
        run->stats.rejected++;
        run->h = decision.h;
        return run->h >= run->h_min ? LG_OK : status == LG_OK ? LG_STEP_TOO_SMALL : status;
    }
    double *swap = s->run[0];
    s->run[0] = s->run[1];
    s->run[1] = swap;
    lg_tolerance_accept(s);
    run->t_before = run->t;
    run->t = clipped ? target : end;
    run->h =
        clipped ? dmax(run->h, decision.h) : decision.h; /* a clipped step must not make later ones shorter */
    run->stats.steps++;
    run->stats.max_angle = dmax(run->stats.max_angle, s->angle);
    if (!run->control->observe) return LG_OK;
    return run->control->observe(run->control->observer, run->t_before, run->sign * h, s->run[0]);
}

static bool times_are_valid(double t0, const double *times, size_t count) {
    const double sign = times[count - 1] >= t0 ? 1.0 : -1.0;
    double before = t0;
    for (size_t i = 0; i < count; before = times[i], i++)
        if (!isfinite(times[i]) || sign * (times[i] - before) < 0.0) return false;
    return isfinite(t0);
}

/* The state at `time`, which must lie in the last step. */
static lg_status state_at(const lg_run *run, double time, double *out) {
    const lg_stepper *s = run->stepper;
    if (time == run->t) {
        memcpy(out, s->run[0], s->ode.space.dim * sizeof(*out));
        return LG_OK;
    }
    return lg_stepper_dense(s, dmin((time - run->t_before) / (run->t - run->t_before), 1.0), out);
}

/* Equal steps. A time this close to the end of a step counts as equal to it. */
static lg_status run_equal(lg_run *run, const double *times, size_t count, double *out) {
    lg_stepper *s = run->stepper;
    const double t0 = run->t, h = (run->t_end - t0) / (double)run->control->steps,
                 near = 1e-9 * fabs(h) + run->h_min;
    for (size_t n = 0, row = 0;; n++) {
        for (; row < count && run->sign * (times[row] - run->t) <= near; row++)
            LG_TRY(state_at(run, run->sign * (run->t - times[row]) <= near ? run->t : times[row],
                            out + row * s->ode.space.dim));
        if (n == run->control->steps) return LG_OK;
        LG_TRY(lg_stepper_step(s, run->t, h, s->run[0], NULL, s->run[0]));
        run->t_before = run->t;
        run->t = t0 + (double)(n + 1) * h;
        run->stats.steps++;
        run->stats.max_angle = dmax(run->stats.max_angle, s->angle);
        if (run->control->observe)
            LG_TRY(run->control->observe(run->control->observer, run->t_before, h, s->run[0]));
    }
}

static lg_status run_to_times(lg_run *run, const double *times, size_t count, double *out) {
    const size_t n = run->stepper->ode.space.dim;
    if (run->control->steps > 0) return run_equal(run, times, count, out);
    const bool dense = run->control->dense && run->stepper->scheme->dense_order > 0;
    if (run->t_end != run->t) LG_TRY(first_step(run));
    for (size_t i = 0; i < count; i++) {
        while (run->sign * (times[i] - run->t) > 0.0) LG_TRY(attempt(run, dense ? run->t_end : times[i]));
        LG_TRY(state_at(run, times[i], out + i * n));
    }
    return LG_OK;
}

lg_status lg_integrate_adaptive(lg_stepper *stepper, const lg_step_controller *control, double t0,
                                const double *y0, const double *times, size_t count, double *out,
                                lg_run_stats *stats) {
    lg_step_controller defaults;
    lg_step_controller_init(&defaults);
    if (!control) control = &defaults;
    if (!stepper || !y0 || !times || !out || count < 1) return LG_INVALID_ARGUMENT;
    if (control->steps == 0 && stepper->scheme->embedded_order < 1) return LG_UNSUPPORTED;
    if (!lg_step_controller_valid(control) || !times_are_valid(t0, times, count) ||
        !lg_all_finite(stepper->ode.space.dim, y0))
        return LG_INVALID_ARGUMENT;
    const size_t before = lg_stepper_evaluations(stepper);
    const double t_end = times[count - 1];
    const int lower = stepper->scheme->embedded_order < stepper->scheme->order
                          ? stepper->scheme->embedded_order
                          : stepper->scheme->order;
    lg_run run = {.stepper = stepper,
                  .control = control,
                  .exponent = 1.0 / (lower + 1),
                  .t = t0,
                  .t_end = t_end,
                  .sign = t_end >= t0 ? 1.0 : -1.0,
                  .h_min = 4.0 * DBL_EPSILON * dmax(fabs(t0), fabs(t_end))};
    memcpy(stepper->run[0], y0, stepper->ode.space.dim * sizeof(*y0));
    const lg_status status = run_to_times(&run, times, count, out);
    run.stats.evaluations = lg_stepper_evaluations(stepper) - before;
    if (stats) *stats = run.stats;
    return status;
}
