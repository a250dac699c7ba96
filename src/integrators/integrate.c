/* Integration: loops over fixed and over adaptive steps. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "integrators/doubles.inc"
#include "integrators/groups.h"
#include "integrators/stepper.h"

INLINE double dmax(double a, double b) {
    return a > b ? a : b;
}

INLINE double dmin(double a, double b) {
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
    const lg_space *space;
    size_t dim;
    double *y, *next;                /* the state; the end of an attempt */
    double *point, *error, *bracket; /* the stepper's */
    lg_tolerance tolerance;          /* in the stepper's memory */
    lg_run_stats stats;
} lg_run;

/* The norm of x relative to the tolerances of a step from y to `next` (error_norm of kernels.h). */
static double norm_at(const lg_run *run, const double *x, const double *next) {
    return run->stepper->kernels->error_norm(run->dim, run->control->rtol, run->tolerance.atol, x, run->y,
                                             next);
}

static lg_status run_field(const lg_run *run, double after, const double *y, double *out) {
    return lg_stepper_evaluate(run->stepper, run->t + run->sign * after, y, NULL, out);
}

static void run_move(const lg_run *run, double h, const double *f, const double *y, double *out) {
    double *sigma = run->stepper->sigma;
    for (size_t i = 0; i < run->space->algebra_dim; i++) sigma[i] = run->sign * h * f[i];
    lg_space_act(run->space, sigma, y, out);
}

static double run_angle(const lg_run *run, const double *f) {
    return lg_space_angle(run->space, f);
}

static double run_norm(const lg_run *run, const double *x) {
    return norm_at(run, x, run->y);
}

static bool run_finite(const lg_run *run, const double *x) {
    return lg_all_finite(run->dim, x);
}

typedef bool lane_test;
typedef lg_run start_run;
typedef lg_tolerance lane_tolerance;
typedef lg_step_decision lane_decision;
#define lane_le(a, b)              ((a) <= (b))
#define lane_lt(a, b)              ((a) < (b))
#define lane_not(test)             (!(test))
#define lane_choose(test, yes, no) ((test) ? (yes) : (no))
#define lane_min                   dmin
#define lane_max                   dmax
#define lane_abs                   fabs
#define lane_sqrt                  sqrt
#define lane_generate              lg_space_generator
#define lane_power                 pow
#include "integrators/control.inc"

lg_step_decision lg_step_controller_decide(const lg_step_controller *control, double exponent, double error,
                                           const lg_step_history *history) {
    return decide(control, -exponent, history->h, error, true, history->angle, history->rejected);
}

/* Sets run->h and the tolerances. */
static lg_status first_step(lg_run *run) {
    const lg_stepper *s = run->stepper;
    const lg_step_controller *control = run->control;
    const double span = fabs(run->t_end - run->t);
    const double *f;
    double speed;
    run->h = dmin(control->h_initial > 0.0 ? control->h_initial : span,
                  control->h_max > 0.0 ? control->h_max : span);
    run->tolerance.groups =
        lg_space_groups(s->ode.manifold.factors > 0 ? &s->ode.manifold : &s->ode.space, run->tolerance.end);
    LG_TRY(lg_stepper_first(run->stepper, run->t, span, run->y, NULL, &f));
    LG_TRY(begin_tolerance(run, control, span, f));
    if (control->h_initial == 0.0)
        LG_TRY(choose_first_step(run, control, span, run->exponent, run->h_min, f, &speed, &run->h));
    for (size_t i = 0; control->atol >= 0.0 && i < run->dim; i++) run->tolerance.atol[i] = control->atol;
    return LG_OK;
}

static void swap(double **a, double **b) {
    double *kept = *a;
    *a = *b;
    *b = kept;
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
    const lg_status status = lg_stepper_step(s, run->t, run->sign * h, run->y, NULL, run->next);
    if (status == LG_OK) {
        if (run->control->atol < 0.0) try_tolerance(&run->tolerance, run->control->atol, h, run->next);
        error = norm_at(run, s->error, run->next);
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
    swap(&run->y, &run->next);
    swap(&run->tolerance.size, &run->tolerance.tried);
    run->t_before = run->t;
    run->t = clipped ? target : end;
    run->h =
        clipped ? dmax(run->h, decision.h) : decision.h; /* a clipped step must not make later ones shorter */
    run->stats.steps++;
    run->stats.max_angle = dmax(run->stats.max_angle, s->angle);
    if (!run->control->observe) return LG_OK;
    return run->control->observe(run->control->observer, run->t_before, run->sign * h, run->y);
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
    if (time == run->t) {
        memcpy(out, run->y, run->dim * sizeof(*out));
        return LG_OK;
    }
    return lg_stepper_dense(run->stepper, dmin((time - run->t_before) / (run->t - run->t_before), 1.0), out);
}

/* Equal steps. A time this close to the end of a step counts as equal to it. */
static lg_status run_equal(lg_run *run, const double *times, size_t count, double *out) {
    lg_stepper *s = run->stepper;
    const double t0 = run->t, h = (run->t_end - t0) / (double)run->control->steps,
                 near = 1e-9 * fabs(h) + run->h_min;
    for (size_t n = 0, row = 0;; n++) {
        for (; row < count && run->sign * (times[row] - run->t) <= near; row++)
            LG_TRY(state_at(run, run->sign * (run->t - times[row]) <= near ? run->t : times[row],
                            out + row * run->dim));
        if (n == run->control->steps) return LG_OK;
        LG_TRY(lg_stepper_step(s, run->t, h, run->y, NULL, run->y));
        run->t_before = run->t;
        run->t = t0 + (double)(n + 1) * h;
        run->stats.steps++;
        run->stats.max_angle = dmax(run->stats.max_angle, s->angle);
        if (run->control->observe)
            LG_TRY(run->control->observe(run->control->observer, run->t_before, h, run->y));
    }
}

static lg_status run_to_times(lg_run *run, const double *times, size_t count, double *out) {
    if (run->control->steps > 0) return run_equal(run, times, count, out);
    const bool dense = run->control->dense && run->stepper->scheme->dense_order > 0;
    if (run->t_end != run->t) LG_TRY(first_step(run));
    for (size_t i = 0; i < count; i++) {
        while (run->sign * (times[i] - run->t) > 0.0) LG_TRY(attempt(run, dense ? run->t_end : times[i]));
        LG_TRY(state_at(run, times[i], out + i * run->dim));
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
                  .h_min = 4.0 * DBL_EPSILON * dmax(fabs(t0), fabs(t_end)),
                  .space = &stepper->ode.space,
                  .dim = stepper->ode.space.dim,
                  .y = stepper->run[0],
                  .next = stepper->run[1],
                  .point = stepper->point,
                  .error = stepper->error,
                  .bracket = stepper->bracket,
                  .tolerance = stepper->tolerance};
    memcpy(run.y, y0, run.dim * sizeof(*y0));
    const lg_status status = run_to_times(&run, times, count, out);
    run.stats.evaluations = lg_stepper_evaluations(stepper) - before;
    if (stats) *stats = run.stats;
    return status;
}
