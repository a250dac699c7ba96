/* own_policy MODEL.h5: learns a policy u = LIMIT tanh(net(x)) that swings a damped pendulum up and holds it
 * there, although the torque is too weak to lift it at once. The cost is computed over STEPS steps of the
 * closed loop and differentiated through all of them. lg-export makes C of the policy in MODEL.h5. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/fit.h>
#include <liegrad/ops.h>
#include <liegrad/taped.h>

enum { STEPS = 200, STARTS = 32 };
static const double LIMIT = 0.6; /* largest torque, relative to the weight's largest torque */
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_policy: %s\n", *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

/* x' = (rate, -sin(angle) - rate/10 + u), x = (angle, rate); the angle is 0 below and pi above. */
static lg_status field(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *f) {
    const lg_var angle = lg_slice(t, in[0], 1, 0, 1), rate = lg_slice(t, in[0], 1, 1, 1);
    const lg_var force = lg_sub(t, lg_sub(t, in[1], lg_sin(t, angle)), lg_scale(t, rate, 0.1));
    f[0] = lg_concat(t, (lg_var[]){rate, force}, 2, 1);
    return lg_tape_status(t);
}

static lg_status policy(void *net, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *u) {
    const lg_var angle = lg_slice(t, x[0], 1, 0, 1), rate = lg_slice(t, x[0], 1, 1, 1);
    const lg_var seen = lg_concat(t, (lg_var[]){lg_sin(t, angle), lg_cos(t, angle), rate}, 3, 1);
    u[0] = lg_scale(t, lg_act(t, lg_mlp_record(t, net, theta[0], 0, seen), LG_TANH), LIMIT);
    return lg_tape_status(t);
}

static lg_status closed(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *next) {
    next[0] = lg_program_call(t, "step", 0, (lg_var[]){in[0], lg_program_call(t, "policy", 0, in), in[1]});
    return lg_tape_status(t);
}

/* The mean of the squares of cos(angle/2) and rate/3 over all steps is the cost; both are 0 at rest above. */
static lg_status cost(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var path = lg_program_call(t, "motion", 1, in); /* (B, STEPS, 2) */
    const lg_var angle = lg_slice(t, path, 2, 0, 1), rate = lg_slice(t, path, 2, 1, 1);
    out[0] = lg_concat(t, (lg_var[]){lg_cos(t, lg_scale(t, angle, 0.5)), lg_scale(t, rate, 1.0 / 3)}, 2, 2);
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    double x[2 * STARTS], h[STARTS], end[2 * STARTS], upright = 0;
    lg_mlp net;
    lg_space space;
    lg_program *program;
    lg_program_fit_result done;
    if (argc != 2) return (void)fputs("usage: own_policy MODEL.h5\n", stderr), 2;
    for (int i = 0; i < STARTS; i++)
        x[2 * i] = 6.2832 * i / STARTS - 3.1416, x[2 * i + 1] = i % 3 - 1, h[i] = 0.1;
    need(lg_mlp_init(&net, 3, (const uint32_t[]){16, 16}, 2, 1, LG_TANH, true));
    need(lg_space_init_rn(&space, 2));
    const lg_port of_x = {"x", lg_shape1(2), .low = -3, .high = 3}, of_u = {"u", lg_shape1(1)},
                  of_h = {"h", lg_shape1(1), .high = 0.1}, out = {.name = "y"};
    const char *const y = "y";
    const lg_carry carry = {"y", "x"};
    const lg_function_spec first[] = {{"field", (lg_port[]){of_x, of_u}, 2, &out, 1, field, NULL},
                                      {"policy", &of_x, 1, &out, 1, policy, &net}};
    const lg_function_spec loop = {"closed", (lg_port[]){of_x, of_h}, 2, &out, 1, closed, NULL},
                           last = {"cost", (lg_port[]){of_x, of_h}, 2, &out, 1, cost, NULL};
    const lg_loop_spec motion = {sizeof motion, "motion", "closed", STEPS, &carry, 1, &y, 1};
    const lg_parameter_spec theta = {.name = "theta", .shape = lg_shape1((uint32_t)lg_mlp_parameters(&net))};
    const lg_program_spec spec = {sizeof spec, &theta, 1, first, 2, "pendulum with a policy"};
    need(lg_program_build(NULL, &spec, &program, &error));
    need(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0, 0.1, &error));
    need(lg_program_add_function(program, &loop, &error));
    need(lg_program_add_loop(program, &motion, &error));
    need(lg_program_add_function(program, &last, &error));
    need(lg_program_fit(NULL, program, "cost", (const double *[]){x, h}, STARTS, NULL,
                        &(lg_fit_starts){4, lg_mlp_draw, &net, 1}, &done, &error));
    for (int i = 0; i < STARTS; i++) x[2 * i] += 0.1; /* other starts than those that it learned from */
    need(lg_program_eval(NULL, program, "motion", STARTS, (const double *[]){x, h}, (double *[]){end, NULL},
                         &error));
    for (int i = 0; i < STARTS; i++) upright += cos(end[2 * i]) < -0.99;
    printf("cost %.3g after %.1f s; after %d steps from other starts %g of %d are upright\n", done.after,
           done.seconds, STEPS, upright, STARTS);
    need(lg_program_save(NULL, argv[1], program, NULL, &error));
    return 0; /* the process ends and frees all memory */
}
