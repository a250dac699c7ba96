/* A field on SO(3) x R^3 that is partly known and partly learned. The states are the attitude R and the
 * angular velocity w (in space) of a round body that hangs from its centre by a spring and is driven by a
 * torque u.
 *
 * R' = hat(w) R is known; w' = N(R, w, u) is a network. A step is one step of the scheme CF4
 * (lg_taped_step), so R stays a rotation whatever the network returns. The state x is R row by row (9),
 * then w (3).
 */
#include "programs.h"

#include <math.h>

#include <liegrad/networks.h>
#include <liegrad/ops.h>
#include <liegrad/taped.h>

enum { SAMPLES = 2000 };

static const lg_space_factor factors[] = {{.kind = LG_SPACE_SO3, .count = 1},
                                          {.kind = LG_SPACE_RN, .count = 3}};

/* The network; the function that records sets `theta`. */
typedef struct learned {
    lg_mlp net;
    lg_var theta;
} learned;

/* y is R (B, 1, 9) and w (B, 3). `algebra` becomes the rotation's velocity (B, 1, 3) and w' (B, 3). */
static lg_status rate(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                      lg_var *algebra) {
    const learned *l = user;
    const uint32_t rows = lg_var_shape(tape, y[1]).dims[0];
    const lg_var all[] = {lg_reshape(tape, y[0], lg_shape2(rows, 9)), y[1], input};
    (void)t;
    algebra[0] = lg_reshape(tape, y[1], lg_shape3(rows, 1, 3));
    algebra[1] = lg_mlp_record(tape, &l->net, l->theta, 0, lg_concat(tape, all, 3, 1));
    return lg_tape_status(tape);
}

/* Maps x (B, 12), u (B, 3), h (B, 1) to the state after the step (B, 12). */
static lg_var advance(learned *l, lg_tape *tape, const lg_var *in) {
    lg_taped_ode ode = {.field = rate, .user = l};
    const lg_taped_interval over = {.h_rows = in[2], .input = in[1]};
    lg_var y[2];
    if (lg_space_init(&ode.space, factors, 2) != LG_OK ||
        lg_taped_split(tape, &ode.space, in[0], y) != LG_OK ||
        lg_taped_step(tape, lg_scheme_find("cf4"), &ode, &over, y, y) != LG_OK)
        return LG_NONE;
    return lg_taped_join(tape, &ode.space, y);
}

/* ---- the functions that lg_program_build records ---- */

static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    learned *l = user;
    lg_space space;
    lg_var y[2], f[2];
    l->theta = theta[0];
    lg_status status = lg_space_init(&space, factors, 2);
    if (status == LG_OK) status = lg_taped_split(tape, &space, in[0], y);
    if (status == LG_OK) status = rate(l, tape, (lg_taped_time){.value = 0}, y, in[1], f);
    if (status != LG_OK) return status;
    out[0] = lg_reshape(tape, f[0], lg_var_shape(tape, f[1]));
    out[1] = f[1];
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    learned *l = user;
    l->theta = theta[0];
    out[0] = advance(l, tape, in);
    return lg_tape_status(tape);
}

static lg_status loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    learned *l = user;
    l->theta = theta[0];
    out[0] = lg_mean(tape, lg_square(tape, lg_div(tape, lg_sub(tape, advance(l, tape, in), in[3]), in[2])));
    return lg_tape_status(tape);
}

/* ---- data: the ordinary integrator on the true field w' = u - w/2 - e_3 x R e_3 ---- */

static lg_status truth(void *user, double t, const double *x, const double *u, double *f) {
    (void)user;
    (void)t;
    for (int c = 0; c < 3; c++) {
        f[c] = x[9 + c];
        f[3 + c] = u[c] - 0.5 * x[9 + c];
    }
    f[3] += x[5]; /* e_3 x (x_2, x_5, x_8) = (-x_5, x_2, 0) */
    f[4] -= x[2];
    return LG_OK;
}

static struct { double x[SAMPLES][12], u[SAMPLES][3], h[SAMPLES], next[SAMPLES][12]; } data;

static lg_status draw(void) {
    lg_ode ode = {.field = truth};
    lg_stepper *stepper = NULL;
    lg_rng rng;
    lg_rng_seed(&rng, 3, 0);
    lg_status status = lg_space_init(&ode.space, factors, 2);
    if (status == LG_OK) status = lg_stepper_create(NULL, lg_scheme_find("cf4"), &ode, &stepper);
    for (int i = 0; i < SAMPLES && status == LG_OK; i++) {
        double turn[6] = {0}, identity[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
        for (int c = 0; c < 3; c++) {
            turn[c] = lg_rng_normal(&rng);
            turn[3 + c] = lg_rng_normal(&rng); /* identity's w is 0, so this becomes w */
            data.u[i][c] = lg_rng_uniform_in(&rng, -1, 1);
        }
        lg_space_act(&ode.space, turn, identity, data.x[i]);
        data.h[i] = lg_rng_uniform_in(&rng, 0.05, 0.2);
        lg_stepper_reset(stepper);
        status = lg_stepper_step(stepper, 0, data.h[i] / 2, data.x[i], data.u[i], data.next[i]);
        if (status == LG_OK)
            status = lg_stepper_step(stepper, 0, data.h[i] / 2, data.next[i], data.u[i], data.next[i]);
    }
    lg_stepper_destroy(stepper);
    return status;
}

lg_status make_attitude(lg_program **out, training *how, lg_error *error) {
    static const uint32_t hidden[] = {20};
    double theta[15 * 20 + 20 + 20 * 3 + 3];
    learned l;
    lg_rng rng;
    lg_status status = lg_mlp_init(&l.net, 15, hidden, 1, 3, LG_TANH, true);
    if (status == LG_OK && lg_mlp_parameters(&l.net) != sizeof theta / sizeof *theta) status = LG_SHAPE;
    if (status != LG_OK) return status;
    lg_rng_seed(&rng, 3, 1);
    lg_mlp_initialise(&l.net, &rng, theta);
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(12)},
                          {.name = "u", .shape = lg_shape1(3), .unit = "rad/s^2"},
                          {.name = "h", .shape = lg_shape1(1), .unit = "s", .low = 0.05, .high = 0.2},
                          {.name = "next", .shape = lg_shape1(12)}};
    const lg_port f[] = {{.name = "turn", .unit = "rad/s"}, {.name = "w_rate", .unit = "rad/s^2"}},
                  y = {.name = "y"}, mean = {.name = "mean_square"};
    const lg_function_spec functions[] = {{"field", in, 2, f, 2, field, &l},
                                          {"step", in, 3, &y, 1, step, &l},
                                          {"loss", in, 4, &mean, 1, loss, &l}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&l.net)), theta};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = &weights;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = 3;
    spec.description = "attitude of a driven body on a spring, learned";
    status = lg_program_build(NULL, &spec, out, error);
    if (status == LG_OK) status = draw();
    if (status != LG_OK) return status;
    static const double *const columns[] = {data.x[0], data.u[0], data.h, data.next[0]};
    *how = (training){columns, SAMPLES, 600, 100, 1e-2};
    return train(*out, how, NULL, NULL, error);
}
