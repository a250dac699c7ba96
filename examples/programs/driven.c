/* A neural differential equation x' = N(x, u) with x = (angle, rate). It is learned from steps of different
 * lengths of a driven pendulum with friction, theta'' = -sin theta - 0.3 theta' + u.
 *
 * The Runge-Kutta step is written with plain operations, and its length h is a variable. So one program
 * serves every sample time, and training differentiates through the step.
 */
#include "programs.h"

#include <math.h>

#include <liegrad/core.h>
#include <liegrad/networks.h>
#include <liegrad/ops.h>

enum { SAMPLES = 2000 };

/* N: maps x (B, 2) and u (B, 1) to x' (B, 2). */
static lg_var rate(const lg_mlp *net, lg_tape *tape, lg_var theta, lg_var x, lg_var u) {
    const lg_var both[] = {x, u};
    return lg_mlp_record(tape, net, theta, 0, lg_concat(tape, both, 2, 1));
}

/* One step of length h (B, 1). */
static lg_var runge_kutta(const lg_mlp *net, lg_tape *tape, lg_var theta, lg_var x, lg_var u, lg_var h) {
    const lg_var half = lg_scale(tape, h, 0.5);
    lg_var k[4];
    k[0] = rate(net, tape, theta, x, u);
    k[1] = rate(net, tape, theta, lg_add(tape, x, lg_mul(tape, half, k[0])), u);
    k[2] = rate(net, tape, theta, lg_add(tape, x, lg_mul(tape, half, k[1])), u);
    k[3] = rate(net, tape, theta, lg_add(tape, x, lg_mul(tape, h, k[2])), u);
    static const double weights[] = {1. / 6, 1. / 3, 1. / 3, 1. / 6};
    return lg_add(tape, x, lg_mul(tape, h, lg_linear_combination(tape, k, weights, 4)));
}

/* ---- the functions that lg_program_build records ---- */

static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = rate(user, tape, theta[0], in[0], in[1]);
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = runge_kutta(user, tape, theta[0], in[0], in[1], in[2]);
    return lg_tape_status(tape);
}

static lg_status loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var next = runge_kutta(user, tape, theta[0], in[0], in[1], in[2]);
    /* Errors are divided by h, so that long steps do not outweigh short ones. */
    out[0] = lg_mean(tape, lg_square(tape, lg_div(tape, lg_sub(tape, next, in[3]), in[2])));
    return lg_tape_status(tape);
}

/* ---- data ---- */

typedef struct samples {
    double x[SAMPLES][2], u[SAMPLES], h[SAMPLES], next[SAMPLES][2];
} samples;

static void draw(samples *s) {
    lg_rng rng;
    lg_rng_seed(&rng, 2, 0);
    for (int i = 0; i < SAMPLES; i++) {
        const int fine = 200;
        double angle = s->x[i][0] = lg_rng_uniform_in(&rng, -2, 2),
               speed = s->x[i][1] = lg_rng_uniform_in(&rng, -2, 2);
        s->u[i] = lg_rng_uniform_in(&rng, -1, 1);
        s->h[i] = lg_rng_uniform_in(&rng, 0.05, 0.3);
        for (int n = 0; n < fine; n++) { /* midpoint rule with much smaller steps */
            const double dt = s->h[i] / fine;
            const double middle = angle + dt / 2 * speed,
                         middle_speed = speed + dt / 2 * (-sin(angle) - 0.3 * speed + s->u[i]);
            angle += dt * middle_speed;
            speed += dt * (-sin(middle) - 0.3 * middle_speed + s->u[i]);
        }
        s->next[i][0] = angle;
        s->next[i][1] = speed;
    }
}

lg_status make_driven(lg_program **out, training *how, lg_error *error) {
    static const uint32_t hidden[] = {16, 16};
    static samples s;
    lg_mlp net;
    lg_rng rng;
    double theta[16 * 3 + 16 + 16 * 16 + 16 + 16 * 2 + 2];
    lg_status status = lg_mlp_init(&net, 3, hidden, 2, 2, LG_TANH, true);
    if (status == LG_OK && lg_mlp_parameters(&net) != sizeof theta / sizeof *theta) status = LG_SHAPE;
    if (status != LG_OK) return status;
    lg_rng_seed(&rng, 2, 1);
    lg_mlp_initialise(&net, &rng, theta);
    const lg_port in[] = {
        {.name = "x", .shape = lg_shape1(2), .unit = "rad, rad/s", .low = -2, .high = 2},
        {.name = "u", .shape = lg_shape1(1), .unit = "rad/s^2"},
        {.name = "h", .shape = lg_shape1(1), .unit = "s", .low = 0.05, .high = 0.3},
        {.name = "next", .shape = lg_shape1(2), .unit = "rad, rad/s", .low = -2, .high = 2}};
    const lg_port f = {.name = "f"}, y = {.name = "y"}, mean = {.name = "mean_square"};
    const lg_function_spec functions[] = {{"field", in, 2, &f, 1, field, &net},
                                          {"step", in, 3, &y, 1, step, &net},
                                          {"loss", in, 4, &mean, 1, loss, &net}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)), theta};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = &weights;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = 3;
    spec.description = "driven pendulum with friction, learned";
    status = lg_program_build(NULL, &spec, out, error);
    if (status != LG_OK) return status;
    draw(&s);
    static const double *const columns[] = {s.x[0], s.u, s.h, s.next[0]};
    *how = (training){columns, SAMPLES, 1000, 100, 1e-2};
    return train(*out, how, NULL, NULL, error);
}
