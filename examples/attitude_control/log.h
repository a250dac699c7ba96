/* A log of the true body as an engineer would record it: several runs under torques that excite it, with
 * noise of the sensors. */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "plant.h"

typedef struct log_options {
    int runs;
    double rate, duration;          /* rows a second; seconds of a run */
    double torque;                  /* about the largest of each axis, N m */
    double angle_noise, rate_noise; /* standard deviations, rad and rad/s */
    uint64_t seed;
} log_options;

/* CSV with columns t, run, qw, qx, qy, qz, wx, wy, wz, u1, u2, u3; the torque of a row acts until the next.
 * False: it cannot be written, or memory is short. */
bool log_write(const char *path, const log_options *options);

#endif
