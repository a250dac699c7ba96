#include "trial.h"

#include <math.h>
#include <time.h>

static int64_t now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* |A - B|^2 = 8 sin^2(angle/2) */
double trial_angle(const double *A, const double *B) {
    double square = 0.0;
    for (int i = 0; i < ATTITUDE; i++) square += (A[i] - B[i]) * (A[i] - B[i]);
    return 2.0 * asin(fmin(1.0, sqrt(square / 8.0)));
}

double trial_norm(const double *x) {
    return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
}

static void judge(const trial_options *options, double t, double angle, trial_result *r) {
    if (!(angle <= options->tolerance))
        r->arrived = NAN;
    else if (isnan(r->arrived))
        r->arrived = t;
    if (t > options->duration - options->hold) r->worst = fmax(r->worst, angle);
}

/* Returns the state that the controller gets: the observer's estimate, or the true state if there is no
 * observer. */
static const double *look(observer *by, const double *state, trial_result *r) {
    if (by == NULL) return state;
    r->finite = observer_look(by, state);
    r->measured = fmax(r->measured, trial_angle(state, by->measured));
    return by->seen;
}

trial_result trial_run(const trial_options *options, plant *truth, controller *control, observer *by,
                       double *state, samples *times) {
    const size_t steps = (size_t)(options->duration / options->period + 0.5);
    trial_result r = {.finite = true, .angle = trial_angle(state, control->target), .arrived = NAN};
    if (by != NULL) r.finite = observer_start(by, state);
    for (size_t n = 0; n < steps && r.finite; n++) {
        double torque[TORQUE];
        const int64_t begin = now();
        const double *seen = look(by, state, &r);
        controller_step(control, seen, seen + ATTITUDE, torque);
        if (times->count < times->room) times->ns[times->count++] = now() - begin;
        r.torque = fmax(r.torque, trial_norm(torque));
        r.rate = fmax(r.rate, trial_norm(state + ATTITUDE));
        r.finite = plant_advance(truth, options->period, torque, state) &&
                   (by == NULL || observer_wait(by, options->period, torque));
        judge(options, (double)(n + 1) * options->period, trial_angle(state, control->target), &r);
    }
    return r;
}
