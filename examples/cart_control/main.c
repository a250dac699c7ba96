/* A controller in single precision that sees noisy positions, on a plant that is heavier than the machine
 * it knows: the observer estimates the velocities, the controller balances, and the adaptation finds
 * payload and friction. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "controller.h"
#include "plant.h"

/* Uniform numbers with the standard deviation 1. */
static double noise(void) {
    static uint32_t state = 1;
    state = state * 1664525u + 1013904223u;
    return ((double)(state >> 8) / (double)(1u << 24) - 0.5) * sqrt(12.0);
}

static void measure(const double *x, float *y) {
    static double work[plant_WORK_SIZE];
    double q[2];
    plant_positions(x, q, work);
    for (int i = 0; i < 2; i++) y[i] = (float)(q[i] + 1e-4 * noise());
}

/* Moves the plant by a period under u. */
static void move(double *x, float u) {
    static double work[plant_WORK_SIZE];
    const double force = (double)u;
    double next[4];
    plant_period(x, &force, next, work);
    for (int i = 0; i < 4; i++) x[i] = next[i];
}

int main(void) {
    static float work[controller_WORK_SIZE], filter[controller_OBSERVE_SIZE], numbers[controller_ADAPT_SIZE];
    float y[controller_GIVEN], before[controller_INPUTS], seen[controller_INPUTS], found[controller_FOUND],
        u = 0;
    double x[4] = {0.2, 0.1, 0, 0}; /* Positions and momenta. */
    measure(x, y);
    controller_observe_start(y, filter);
    controller_adapt_start(numbers);
    printf("time     x  theta   payload  damping  Coulomb  offset\n");
    for (int k = 1; k <= 600; k++) {
        move(x, u);
        measure(x, y);
        controller_observe(y, &u, filter, seen, work);
        if (k > 20) controller_adapt(before, &u, seen, numbers, found, work); /* The observer has settled. */
        if (k % 100 == 0)
            printf("%4.0f %5.2f %6.3f   %7.3f  %7.3f  %7.3f %7.3f\n", k * (double)controller_PERIOD, x[0],
                   x[1], (double)found[3], (double)found[0], (double)found[1], (double)found[2]);
        controller_control(seen, &u, work);
        /* A dither: what is not excited cannot be found. */
        u += 4.0F * (float)(sin(0.4 * k) + sin(0.13 * k));
        for (int i = 0; i < 4; i++) before[i] = seen[i];
    }
    if (fabs(x[1]) < 0.3 && fabs((double)found[3] - 0.6) < 0.1) return 0;
    printf("FAILED: the pole fell, or the payload is not 0.6\n");
    return 1;
}
