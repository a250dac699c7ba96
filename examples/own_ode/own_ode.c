/* own_ode LOG.csv MODEL.h5: learns x' = f(x, u), x = (angle, rate), from the log of a driven pendulum with
 * rows at equal times, so that STEPS predictions agree with the log; saves field and step. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/io.h>
#include <liegrad/ops.h>
#include <liegrad/tables.h>
#include <liegrad/taped.h>
#include <liegrad/train.h>

enum { X = 2, STEPS = 8, WINDOWS = 100000, MOST = 1000 };
static double start[WINDOWS][X], h;
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_ode: %s\n", error.message);
    exit(1);
}

/* f (B, X) of in[0] = x (B, X), in[1] = u (B, 1) */
static lg_status field(void *net, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *f) {
    f[0] = lg_mlp_record(t, net, theta[0], 0, lg_concat(t, in, 2, 1));
    return lg_tape_status(t);
}

static lg_status rate(void *none, lg_tape *t, lg_taped_time time, const lg_var *x, lg_var u, lg_var *f) {
    f[0] = lg_program_call(t, "field", 0, (const lg_var[]){x[0], u});
    return lg_tape_status(t);
}

static lg_status step(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *next) {
    lg_taped_ode ode = {.field = rate};
    need(lg_space_init_rn(&ode.space, X));
    return lg_taped_step_over(t, lg_scheme_find("rk4"), &ode, &(lg_taped_interval){.h = h, .input = in[1]},
                              in, next);
}

/* STEPS predictions, one after the other, from in[0] with torques in[1], less what the log has, in[2]. */
static lg_status miss(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    lg_var x[2] = {in[0]}, all[STEPS];
    for (uint32_t k = 0; k < STEPS && lg_tape_status(t) == LG_OK; x[0] = all[k++])
        x[1] = lg_slice(t, in[1], 1, k, 1), (void)step(none, t, theta, x, &all[k]);
    out[0] = lg_sub(t, lg_concat(t, all, STEPS, 1), in[2]);
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    lg_mlp net;
    lg_rng rng;
    lg_table_data time, x, u;
    lg_program *program;
    lg_program_training done;
    double theta[MOST];
    if (argc != 3) return 2;
    need(lg_table_read(NULL, argv[1], (const char *[]){"time"}, 1, NULL, NULL, &time, &error));
    need(lg_table_read(NULL, argv[1], (const char *[]){"angle", "rate"}, X, NULL, NULL, &x, &error));
    need(lg_table_read(NULL, argv[1], (const char *[]){"torque"}, 1, NULL, NULL, &u, &error));
    const size_t all = (x.rows - 1) / STEPS, count = all < WINDOWS ? all : WINDOWS; /* windows, end to end */
    for (size_t w = 0; w < count; w++) memcpy(start[w], x.values + w * STEPS * X, sizeof start[w]);
    h = time.values[1] - time.values[0];
    need(lg_mlp_init(&net, X + 1, (const uint32_t[]){12, 12}, 2, X, LG_TANH, true));
    lg_rng_seed(&rng, 1, 0);
    lg_mlp_initialise(&net, &rng, theta);
    const lg_port in[] = {{"x", lg_shape1(X)}, {"u", lg_shape1(1)}}, y = {"y"};
    const lg_port windows[] = {in[0], {"u", lg_shape1(STEPS)}, {"z", lg_shape1(STEPS * X)}};
    const lg_function_spec functions[] = {{"field", in, 2, &y, 1, field, &net},
                                          {"step", in, 2, &y, 1, step, NULL},
                                          {"miss", windows, 3, &y, 1, miss, NULL}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)), theta};
    const lg_program_spec spec = {sizeof spec, &weights, 1, functions, 3, "driven pendulum"};
    need(lg_program_build(NULL, &spec, &program, &error));
    const double *const data[] = {start[0], u.values, x.values + X};
    need(lg_program_train(NULL, program, "miss", data, count, NULL, &done, &error));
    printf("rms error of %d steps %.2g after %.1f s: %s\n", STEPS, sqrt(done.after), done.seconds, done.end);
    need(lg_program_save(NULL, argv[2], program, NULL, &error));
    return 0; /* what is held goes with the process */
}
