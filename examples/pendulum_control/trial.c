#include "trial.h"

#include <math.h>
#include <string.h>

#include <liegrad/core.h>

static double norm(const double *x) {
    return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
}

static void control(controller *self, const double *state, double *torque, samples *computing) {
    const int64_t begin = clock_now();
    controller_step(self, state, torque);
    samples_add(computing, clock_now() - begin);
}

static void keep(trace *to, size_t step, const trace_row *row) {
    if (to != NULL && step % to->every == 0 && to->count < to->room) to->rows[to->count++] = *row;
}

/* Updates the result with the state at time t, after a step. */
static void judge(const trial_options *options, double t, const double *state, trial_result *result) {
    const double *q = state, *p = state + 3, angle = pendulum_angle(state);
    result->last_angle = angle;
    if (t > options->duration - options->hold) result->worst_held = fmax(result->worst_held, angle);
    result->manifold =
        fmax(result->manifold, fmax(fabs(norm(q) - 1.0), fabs(q[0] * p[0] + q[1] * p[1] + q[2] * p[2])));
}

trial_result trial_run(const trial_options *options, plant *true_plant, controller *self, double *state,
                       trial_times *times, trace *record) {
    const size_t steps = (size_t)(options->duration / options->period + 0.5);
    const size_t timed = (size_t)(options->realtime / options->period + 0.5);
    const int64_t ns = (int64_t)(1e9 * options->period + 0.5), begin = clock_now() + ns;
    trial_result result = {.finite = true, .caught = NAN};
    double torque[TORQUE];
    mode before = self->mode = SWING_UP;
    for (size_t n = 0; n < steps && result.finite; n++) {
        const int64_t due = begin + (int64_t)n * ns;
        if (n < timed) samples_add(&times->wake, clock_sleep_until(due));
        control(self, state, torque, n < timed ? &times->paced : &times->unpaced);
        if (n < timed) samples_add(&times->response, clock_now() - due);
        if (self->mode == BALANCE && before != BALANCE) result.caught = (double)n * options->period;
        if (self->mode != BALANCE) result.caught = NAN;
        before = self->mode;
        result.most_torque = fmax(result.most_torque, norm(torque));
        const trace_row row = {(double)n * options->period, self->energy, plant_energy(true_plant, state),
                               pendulum_angle(state), norm(torque)};
        keep(record, n, &row);
        result.finite = plant_advance(true_plant, options->period, torque, state);
        judge(options, (double)(n + 1) * options->period, state, &result);
    }
    result.held = result.finite && result.worst_held < options->tolerance && self->mode == BALANCE;
    return result;
}

void empty_loop(double period, double duration, samples *wake) {
    const int64_t ns = (int64_t)(1e9 * period + 0.5), begin = clock_now() + ns;
    const size_t steps = (size_t)(duration / period + 0.5);
    for (size_t n = 0; n < steps; n++) samples_add(wake, clock_sleep_until(begin + (int64_t)n * ns));
}

/* ---- starts: q, and q' relative to sqrt(g/L) ---- */

static const struct {
    const char *name;
    double q[3], rate[3];
} hard[] = {{"hanging at rest", {0.0, 0.0, -1.0}, {0.0, 0.0, 0.0}},
            {"upright, thrown over", {0.0, 0.0, 1.0}, {1.6, 0.0, 0.0}},
            {"near upright, moving sideways", {0.25, 0.0, 1.0}, {0.0, 0.9, 0.0}},
            {"conical, nearly steady", {0.8, 0.0, -0.6}, {0.0, 1.03, 0.0}},
            {"spinning at the equator", {0.0, 1.0, 0.0}, {-2.0, 0.0, 0.0}},
            {"swinging through the bottom, fast", {0.0, 0.0, -1.0}, {0.0, 3.0, 0.0}}};

enum { HARD = sizeof hard / sizeof *hard };

/* p = m L^2 (rate - q (q.rate)), where rate is q' in units of sqrt(g/L). */
static void place(const plant *true_plant, const double *q, const double *rate, double *state) {
    const double length = norm(q), unit = true_plant->mass * sqrt(true_plant->weight / true_plant->mass);
    double along = 0.0;
    for (int i = 0; i < 3; i++) state[i] = q[i] / length;
    for (int i = 0; i < 3; i++) along += state[i] * rate[i];
    for (int i = 0; i < 3; i++) state[3 + i] = unit * (rate[i] - state[i] * along);
}

const char *trial_start(const plant *true_plant, uint64_t seed, int index, double *state) {
    double q[3], rate[3];
    lg_rng rng;
    if (index < HARD) {
        place(true_plant, hard[index].q, hard[index].rate, state);
        return hard[index].name;
    }
    lg_rng_seed(&rng, seed, (uint64_t)index);
    for (int i = 0; i < 3; i++) q[i] = lg_rng_normal(&rng);
    for (int i = 0; i < 3; i++) rate[i] = 0.7 * lg_rng_normal(&rng);
    place(true_plant, q, rate, state);
    return "random";
}
