/* own_ode LOG.csv MODEL.h5: learns x' = f(x, u), x = (angle, rate), from logs of a driven pendulum, such that
 * predictions over STEPS steps agree with the logs, and saves the model. LOG.csv has rows at equal time steps
 * and a column `run`. If there are several runs, the last one is not learned but used for judging. Names, X,
 * widths and STEPS may be changed here: all sizes follow from them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/ops.h>
#include <liegrad/table.h>
#include <liegrad/taped.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))
static const char *const columns[] = {"angle", "rate", "torque"}; /* X states, then the inputs */
static const uint32_t hidden[] = {12, 12};
enum { X = 2, ROW = COUNT(columns), U = ROW - X, STEPS = 8 };
static lg_scaler scale; /* of the columns: networks learn best from numbers near 1 */
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_ode: %s\n", *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

/* Records f (B, X) at in[0] = x (B, X) and in[1] = u (B, U). */
static lg_status field(void *net, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *f) {
    const lg_var row = lg_scaler_record(t, &scale, lg_concat(t, in, 2, 1), false);
    f[0] = lg_mlp_record(t, net, theta[0], 0, row);
    return lg_tape_status(t);
}

/* Records the predictions of STEPS steps, each from the previous one, minus the rows of the window in[0] (B,
 * (STEPS + 1) ROW). in[1] is the time step (B, 1). */
static lg_status miss(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    lg_var x = lg_slice(t, in[0], 1, 0, X), off[STEPS];
    for (uint32_t k = 0; k < STEPS; k++) {
        x = lg_program_call(t, "step", 0, (lg_var[]){x, lg_slice(t, in[0], 1, k * ROW + X, U), in[1]});
        off[k] = lg_sub(t, x, lg_slice(t, in[0], 1, (k + 1) * ROW, X));
    }
    out[0] = lg_concat(t, off, STEPS, 1);
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    lg_mlp net;
    lg_space space;
    lg_program *program;
    lg_table_windows w;
    lg_program_fit_result done;
    lg_fit_options how;
    double held;
    if (argc != 3) return (void)fputs("usage: own_ode LOG.csv MODEL.h5\n", stderr), 2;
    need(lg_table_windows_read(NULL, argv[1], "time", "run", columns, ROW, STEPS, &w, &error));
    need(lg_table_scaler_fit(NULL, w.data.values, ROW, NULL, w.data.rows, &scale));
    need(lg_mlp_init(&net, ROW, hidden, COUNT(hidden), X, LG_TANH, true));
    need(lg_space_init_rn(&space, X));
    const lg_port in[] = {lg_table_port(&w.data, "x", X), lg_table_port(&w.data, "u", U)}, f = {.name = "f"};
    const lg_port window[] = {lg_table_port(&w.data, "rows", (STEPS + 1) * ROW), {"h", lg_shape1(1)}};
    const lg_function_spec the_field = {"field", in, 2, &f, 1, field, &net};
    const lg_function_spec the_miss = {"miss", window, 2, &f, 1, miss, NULL};
    const lg_parameter_spec theta = {.name = "theta", .shape = lg_shape1((uint32_t)lg_mlp_parameters(&net))};
    const lg_program_spec spec = {sizeof spec, &theta, 1, &the_field, 1, "driven pendulum"};
    need(lg_program_build(NULL, &spec, &program, &error));
    need(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0, 0.1, &error));
    need(lg_program_add_function(program, &the_miss, &error));
    need(lg_program_fit_options_init(program, "miss", &how, &error));
    how.prior = 0.1; /* keeps the network from learning the noise of a log */
    need(lg_program_fit(NULL, program, "miss", (const double *[]){w.rows, w.step}, w.count, &how,
                        &(lg_fit_starts){2, lg_mlp_draw, &net, 1}, &done, &error));
    printf("rms error of %d steps %.2g after %.1f s: %s\n", STEPS, sqrt(done.after), done.seconds, done.end);
    need(lg_model_save(NULL, argv[2], "driven", program, &space, NULL, &error));
    if (w.held == 0) return 0;
    const double *rest[] = {w.rows + w.count * (STEPS + 1) * ROW, w.step + w.count};
    need(lg_program_loss(NULL, program, "miss", rest, w.held, &held, &error));
    printf("run %s, not learned: rms error %.2g\n", w.held_run, sqrt(held));
    lg_table_windows_destroy(&w);
    return 0; /* the process ends and frees the other memory */
}
