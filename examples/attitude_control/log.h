/* Writes a log of the true body as an engineer would record it: several runs under torques that excite the
 * body, with sensor noise. */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "plant.h"

typedef struct log_options {
    int runs;
    double rate, duration;          /* rows per second; seconds per run */
    double torque;                  /* approximate amplitude per axis, N m */
    double angle_noise, rate_noise; /* standard deviations, rad and rad/s */
    uint64_t seed;
} log_options;

/* Writes a CSV file with the columns t, run, qw, qx, qy, qz, wx, wy, wz, u1, u2, u3. The torque of a row acts
 * until the next row. Returns false if the file cannot be written or memory is short. */
bool log_write(const char *path, const log_options *options);

#endif
