/* own_equation LOG.csv MODEL.h5: finds the six parameters of a motor from a log, with their standard errors,
 * and saves the model. The log has voltage, angle and current; the speed is not measured. The equations are
 *   angle' = speed,  J speed' = K current - d speed - c tanh(2 speed),
 *   L current' = voltage - R current - K speed. */
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/ops.h>
#include <liegrad/table.h>
#include <liegrad/taped.h>

enum { R, L, K, J, D, C, PARAMETERS };
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_equation: %s\n", *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

/* The derivative of the state in[0] = (angle, speed, current) at the voltage in[1]. */
static lg_status field(void *none, lg_tape *t, const lg_var *p, const lg_var *in, lg_var *out) {
    const lg_var speed = lg_slice(t, in[0], 1, 1, 1), current = lg_slice(t, in[0], 1, 2, 1);
    const lg_var friction = lg_mul(t, p[C], lg_act(t, lg_scale(t, speed, 2), LG_TANH));
    const lg_var torque = lg_sub(t, lg_mul(t, p[K], current), lg_add(t, lg_mul(t, p[D], speed), friction));
    const lg_var drop = lg_add(t, lg_mul(t, p[R], current), lg_mul(t, p[K], speed));
    const lg_var rates[] = {speed, lg_div(t, torque, p[J]), lg_div(t, lg_sub(t, in[1], drop), p[L])};
    out[0] = lg_concat(t, rates, 3, 1);
    return lg_tape_status(t);
}

/* What is measured: angle and current. */
static lg_status seen(void *none, lg_tape *t, const lg_var *p, const lg_var *in, lg_var *out) {
    out[0] = lg_concat(t, (lg_var[]){lg_slice(t, in[0], 1, 0, 1), lg_slice(t, in[0], 1, 2, 1)}, 2, 1);
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    static const double guess[PARAMETERS] = {1, 0.1, 0.2, 0.05, 0.02, 0.1};
    const lg_shape one = lg_shape1(1);
    const lg_parameter_spec p[PARAMETERS] = {{"R", one, &guess[R]}, {"L", one, &guess[L]},
                                             {"K", one, &guess[K]}, {"J", one, &guess[J]},
                                             {"d", one, &guess[D]}, {"c", one, &guess[C]}};
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(3)}, {.name = "u", .shape = one}},
                  out = {.name = "y"};
    const lg_function_spec functions[] = {{"field", in, 2, &out, 1, field, NULL},
                                          {"seen", in, 1, &out, 1, seen, NULL}};
    const lg_program_spec spec = {sizeof spec, p, PARAMETERS, functions, 2, "motor"};
    double errors[PARAMETERS], noise[2];
    lg_program_log_result found = {.error = errors, .noise = noise};
    lg_table_data t, u, y;
    lg_space space;
    lg_program *motor;
    if (argc != 3) return (void)fputs("usage: own_equation LOG.csv MODEL.h5\n", stderr), 2;
    need(lg_table_read(NULL, argv[1], (const char *[]){"time"}, 1, NULL, NULL, &t, &error));
    need(lg_table_read(NULL, argv[1], (const char *[]){"voltage"}, 1, NULL, NULL, &u, &error));
    need(lg_table_read(NULL, argv[1], (const char *[]){"angle", "current"}, 2, NULL, NULL, &y, &error));
    need(lg_program_build(NULL, &spec, &motor, &error));
    need(lg_space_init_rn(&space, 3));
    need(lg_program_add_step(motor, &space, lg_scheme_find("rk4"), 0.005, 0.02, &error));
    lg_program_log log = {.rows = t.rows, .t = t.values, .u = u.values, .y = y.values, .window = 50};
    need(lg_program_fit_log(NULL, motor, "step", "seen", &log, NULL, &found, &error)); /* short windows */
    log.window = 0; /* then the whole log, from the parameters that are now good */
    need(lg_program_fit_log(NULL, motor, "step", "seen", &log, NULL, &found, &error));
    for (int i = 0; i < PARAMETERS; i++)
        printf("%s = %.5f, standard error %.1e\n", p[i].name, *lg_program_parameter(motor, i).values,
               errors[i]);
    printf("noise: angle %.3f, current %.3f\n", noise[0], noise[1]);
    need(lg_model_save(NULL, argv[2], "driven", motor, &space, NULL, &error));
    return 0; /* the process ends and frees all memory */
}
