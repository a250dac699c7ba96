/* A run from one start: simulates plant and controller and judges the result. */
#ifndef TRIAL_H
#define TRIAL_H

#include "controller.h"
#include "latency.h"
#include "plant.h"

typedef struct trial_options {
    double period, duration; /* control period, duration of the run; s */
    double hold, tolerance;  /* success: the angle stays below `tolerance` in the last `hold` seconds */
    double realtime;         /* seconds at the beginning that run in real time */
} trial_options;

typedef struct trial_result {
    bool held, finite;
    double caught;     /* when BALANCE began for the last time, s; NaN if it is not balancing at the end */
    double worst_held; /* largest angle in the last `hold` seconds, rad */
    double last_angle;
    double most_torque;
    double manifold; /* largest of ||q| - 1| and |q.p| */
} trial_result;

/* A row of the trace, for the plot. One row is kept every `every` steps. */
typedef struct trace_row {
    double t, learned, energy, angle, torque;
} trace_row;
typedef struct trace {
    trace_row *rows;
    size_t count, room, every;
} trace;

typedef struct trial_times {
    /* Duration of controller_step in real time, where it runs after a sleep of up to a period. */
    samples paced;
    /* Duration of controller_step otherwise: back to back with the simulation, with warm caches. */
    samples unpaced;
    samples wake;     /* in real time: how late the timer woke up */
    samples response; /* in real time: from when the step was due until its torque was computed */
} trial_times;

/* Runs one trial without allocating memory. `state` is the start and becomes the end. `record` may be
 * NULL. */
trial_result trial_run(const trial_options *options, plant *true_plant, controller *control, double *state,
                       trial_times *times, trace *record);

/* Sets start number `index` and returns its name. The first ones are hard cases; the others are random,
 * anywhere on the sphere with moderate momenta, drawn with `seed`. */
const char *trial_start(const plant *true_plant, uint64_t seed, int index, double *state);

/* The same timer loop without control, for comparison. */
void empty_loop(double period, double duration, samples *wake);

#endif
