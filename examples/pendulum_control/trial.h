/* One start: plant and controller for some time, and what came of it. */
#ifndef TRIAL_H
#define TRIAL_H

#include "controller.h"
#include "latency.h"
#include "plant.h"

typedef struct trial_options {
    double period, duration; /* of control, of the whole run; s */
    double hold, tolerance;  /* success: the angle stays below tolerance in the last `hold` seconds */
    double realtime;         /* so many seconds at the start wait for the clock */
} trial_options;

typedef struct trial_result {
    bool held, finite;
    double caught;     /* when it last began to balance, s; NaN: it did not */
    double worst_held; /* largest angle in the last `hold` seconds, rad */
    double last_angle;
    double most_torque;
    double manifold; /* largest of ||q| - 1| and |q.p| */
} trial_result;

/* A row every so many steps, for the picture. */
typedef struct trace_row {
    double t, learned, energy, angle, torque;
} trace_row;
typedef struct trace {
    trace_row *rows;
    size_t count, room, every;
} trace;

typedef struct trial_times {
    samples paced;    /* controller_step alone, in real time: a period of sleep since the last */
    samples unpaced;  /* the same, the rest of the run, back to back with the simulation: warm caches */
    samples wake;     /* in real time: how late the timer was */
    samples response; /* in real time: from when the step was due until its torque was there */
} trial_times;

/* `state` is the start and becomes the end. `record` may be NULL. Nothing is allocated here. */
trial_result trial_run(const trial_options *options, plant *true_plant, controller *control, double *state,
                       trial_times *times, trace *record);

/* Start `index`: first some that are hard, then anywhere on the sphere with moderate momenta, by the seed. */
const char *trial_start(const plant *true_plant, uint64_t seed, int index, double *state);

/* The same timer with nothing to do, for comparison. */
void empty_loop(double period, double duration, samples *wake);

#endif
