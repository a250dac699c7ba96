#include "observer.h"

#include <math.h>
#include <stdlib.h>

/* rate_noise: noise of the rates per noise of the angles, 1/s. moment_noise: unknown moments, N m s^1/2. */
static const double rate_noise = 10.0, moment_noise = 0.03;

/* The sensors measure R exp(noise) and Omega + noise. */
static void measure(observer *self, const double *truth) {
    double turn[3], N[ATTITUDE];
    for (int i = 0; i < 3; i++) turn[i] = self->noise * lg_rng_normal(&self->rng);
    plant_attitude(turn, N);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++) sum += truth[3 * i + k] * N[3 * k + j];
            self->measured[3 * i + j] = sum;
        }
        self->measured[ATTITUDE + i] =
            truth[ATTITUDE + i] + rate_noise * self->noise * lg_rng_normal(&self->rng);
    }
}

bool observer_create(observer *self, const lg_model *model, void *work, double noise, uint64_t seed) {
    *self = (observer){.model = model, .work = work, .noise = noise};
    lg_rng_seed(&self->rng, seed, 2);
    const size_t bytes = lg_ekf_size(model, lg_scheme_find("cf4"), PLANT_STATE);
    self->memory = bytes > 0 ? aligned_alloc(64, (bytes + 63) / 64 * 64) : NULL;
    return self->memory != NULL;
}

void observer_destroy(observer *self) {
    free(self->memory);
}

bool observer_start(observer *self, const double *truth) {
    double state[STATE], P[TANGENT * TANGENT] = {0.0}, W[TANGENT * TANGENT] = {0.0};
    lg_sensor sensors[PLANT_STATE];
    lg_ekf_options options;
    for (size_t i = 0; i < PLANT_STATE; i++)
        sensors[i] = i < ATTITUDE
                         ? (lg_sensor){.kind = LG_SENSOR_POSITION, .index = i, .noise = self->noise}
                         : (lg_sensor){LG_SENSOR_VELOCITY, i - ATTITUDE, rate_noise * self->noise, 0.0};
    for (int i = 0; i < TANGENT; i++) {
        P[i * TANGENT + i] = i < 3 ? self->noise * self->noise : 1.0;
        W[i * TANGENT + i] = i < 3 ? 0.0 : moment_noise * moment_noise;
    }
    measure(self, truth);
    if (lg_model_machine_state(self->model, self->measured, self->measured + ATTITUDE, state, self->work) !=
        LG_OK)
        return false;
    lg_ekf_options_init(&options);
    options.scheme = lg_scheme_find("cf4"), options.state = state, options.P = P, options.W = W;
    options.sensors = sensors, options.sensor_count = PLANT_STATE;
    return lg_ekf_init(self->model, &options, &self->filter, self->memory,
                       lg_ekf_size(self->model, options.scheme, PLANT_STATE), NULL) == LG_OK;
}

bool observer_look(observer *self, const double *truth) {
    double P[TANGENT * TANGENT];
    measure(self, truth);
    if (lg_ekf_update(self->filter, self->measured, NULL) != LG_OK) return false;
    lg_ekf_covariance(self->filter, P);
    self->worst = sqrt(fmax(P[0], fmax(P[TANGENT + 1], P[2 * TANGENT + 2])));
    const double *state = lg_ekf_state(self->filter);
    return lg_model_machine_positions(self->model, state, self->seen, self->work) == LG_OK &&
           lg_model_machine_velocities(self->model, state, self->seen + ATTITUDE, self->work) == LG_OK;
}

bool observer_wait(observer *self, double period, const double *torque) {
    return lg_ekf_predict(self->filter, period, torque) == LG_OK;
}
