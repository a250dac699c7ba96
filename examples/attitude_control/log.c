#include "log.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { WAVES = 5 };

/* A torque per axis that is a sum of sines with random frequencies between 0.2 and 3 Hz. */
typedef struct waves {
    double amplitude, frequency[TORQUE][WAVES], phase[TORQUE][WAVES];
} waves;

static waves draw_waves(lg_rng *rng, double torque) {
    waves w = {.amplitude = torque / sqrt(WAVES)};
    for (int i = 0; i < TORQUE; i++)
        for (int k = 0; k < WAVES; k++) {
            w.frequency[i][k] = 6.283185307179586 * lg_rng_uniform_in(rng, 0.2, 3.0);
            w.phase[i][k] = lg_rng_uniform_in(rng, 0.0, 6.283185307179586);
        }
    return w;
}

static void torque_at(const waves *w, double t, double *torque) {
    for (int i = 0; i < TORQUE; i++) {
        torque[i] = 0.0;
        for (int k = 0; k < WAVES; k++)
            torque[i] += w->amplitude * sin(w->frequency[i][k] * t + w->phase[i][k]);
    }
}

/* Finds the quaternion's largest element first and computes the others from it, so that no division by a
 * small number occurs. */
static void quaternion_of(const double *R, double *q) {
    const double four[4] = {1 + R[0] + R[4] + R[8], 1 + R[0] - R[4] - R[8], 1 - R[0] + R[4] - R[8],
                            1 - R[0] - R[4] + R[8]};
    const double pairs[4][4] = {{0, R[7] - R[5], R[2] - R[6], R[3] - R[1]},
                                {R[7] - R[5], 0, R[1] + R[3], R[2] + R[6]},
                                {R[2] - R[6], R[1] + R[3], 0, R[5] + R[7]},
                                {R[3] - R[1], R[2] + R[6], R[5] + R[7], 0}};
    int most = 0;
    for (int i = 1; i < 4; i++)
        if (four[i] > four[most]) most = i;
    const double root = 2.0 * sqrt(four[most]);
    for (int i = 0; i < 4; i++) q[i] = i == most ? 0.25 * root : pairs[most][i] / root;
}

static void write_row(FILE *to, const log_options *options, lg_rng *rng, int run, double t,
                      const double *state, const double *torque) {
    double turn[3], small[9], R[9] = {0.0}, q[4];
    for (int i = 0; i < 3; i++) turn[i] = options->angle_noise * lg_rng_normal(rng);
    plant_attitude(turn, small);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) R[3 * i + j] += state[3 * i + k] * small[3 * k + j];
    quaternion_of(R, q);
    (void)fprintf(to, "%.4f,%d,%.9f,%.9f,%.9f,%.9f", t, run, q[0], q[1], q[2], q[3]);
    for (int i = 0; i < 3; i++)
        (void)fprintf(to, ",%.7f", state[ATTITUDE + i] + options->rate_noise * lg_rng_normal(rng));
    for (int i = 0; i < TORQUE; i++) (void)fprintf(to, ",%.7f", torque[i]);
    (void)fputs("\n", to);
}

bool log_write(const char *path, const log_options *options) {
    const int rows = (int)(options->rate * options->duration + 0.5);
    lg_rng rng;
    plant truth;
    FILE *to = fopen(path, "w");
    bool good = plant_create(&truth) && to != NULL;
    lg_rng_seed(&rng, options->seed, 0);
    if (good) (void)fputs("t,run,qw,qx,qy,qz,wx,wy,wz,u1,u2,u3\n", to);
    for (int run = 0; run < options->runs && good; run++) {
        double state[PLANT_STATE], torque[TORQUE], held[TORQUE];
        const waves w = draw_waves(&rng, options->torque);
        plant_start(&rng, 1.0, state);
        for (int row = 0; row <= rows && good; row++) {
            const double t = row / options->rate;
            torque_at(&w, t, torque);
            for (int i = 0; i < TORQUE; i++) held[i] = round(1e7 * torque[i]) / 1e7; /* as in the file */
            write_row(to, options, &rng, run, t, state, held);
            good = plant_advance(&truth, 1.0 / options->rate, held, state);
        }
    }
    plant_destroy(&truth);
    return to != NULL && fclose(to) == 0 && good;
}
