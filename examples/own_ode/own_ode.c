/* own_ode LOG.csv MODEL.h5: learns x' = f(x, u), x = (angle, rate), from logs of a driven pendulum, such that
 * predictions over STEPS steps agree with the logs. It saves the functions `field` and `step`. LOG.csv has
 * rows at equal time steps and a column `run`. If there are several runs, the last one is not learned but
 * used for judging. Windows with missing or incomplete rows are left out. Names, X, widths and STEPS may be
 * changed here: all sizes follow from them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/fit.h>
#include <liegrad/integrators.h>
#include <liegrad/ops.h>
#include <liegrad/program.h>
#include <liegrad/table.h>
#include <liegrad/taped.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))
static const char *const columns[] = {"angle", "rate", "torque"}; /* X states, then the inputs */
static const uint32_t hidden[] = {12, 12};
enum { X = 2, ROW = COUNT(columns), U = ROW - X, STEPS = 8, WINDOW = (STEPS + 1) * ROW };
static lg_table_data stamps, rows; /* stamps: time and run; rows: the columns above */
static double h = INFINITY;
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_ode: %s\n", *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

/* Records f (B, X) at in[0] = x (B, X) and in[1] = u (B, U). */
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

/* Predicts STEPS steps, each from the previous one, starting at the first row of the window in[0]. Records
 * the predictions minus the rows of the window. */
static lg_status miss(void *none, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *out) {
    lg_var x[2] = {lg_slice(t, in[0], 1, 0, X)}, next = LG_NONE, off[STEPS] = {LG_NONE};
    for (uint32_t k = 0; k < STEPS && lg_tape_status(t) == LG_OK; k++, x[0] = next) {
        x[1] = lg_slice(t, in[0], 1, k * ROW + X, U), (void)step(none, t, theta, x, &next);
        off[k] = lg_sub(t, next, lg_slice(t, in[0], 1, (k + 1) * ROW, X));
    }
    out[0] = lg_concat(t, off, STEPS, 1);
    return lg_tape_status(t);
}

/* Copies windows to `out`, one after the other, those of the run `held`, or, if `others` is
 * true, those of all other runs. No window
 * spans two runs or a gap. Returns the number of windows. */
static size_t windows(uint32_t held, bool others, double *out) {
    size_t count = 0;
    for (size_t i = 0; i + STEPS < rows.rows; i++) {
        const double seconds = stamps.values[i + STEPS] - stamps.values[i];
        const bool whole = stamps.label[i] == stamps.label[i + STEPS] && fabs(seconds - STEPS * h) < 0.1 * h;
        if (!whole || (stamps.label[i] == held) == others) continue;
        memcpy(out + count++ * WINDOW, rows.values + i * ROW, WINDOW * sizeof *out);
        i += STEPS - 1;
    }
    return count;
}

int main(int argc, char **argv) {
    lg_mlp net;
    lg_rng rng;
    lg_program *program;
    lg_program_fit_result done;
    double square = 0;
    if (argc != 3) return (void)fputs("usage: own_ode LOG.csv MODEL.h5\n", stderr), 2;
    need(lg_table_read(NULL, argv[1], (const char *[]){"time"}, 1, "run", NULL, &stamps, &error));
    need(lg_table_read(NULL, argv[1], columns, ROW, NULL, NULL, &rows, &error));
    need(lg_table_keep_complete((lg_table_data *[]){&stamps, &rows}, 2, NULL, &error));
    for (size_t i = 1; i < rows.rows; i++)
        if (stamps.values[i] > stamps.values[i - 1]) h = fmin(h, stamps.values[i] - stamps.values[i - 1]);
    need(lg_mlp_init(&net, ROW, hidden, COUNT(hidden), X, LG_TANH, true));
    double *theta = calloc(lg_mlp_parameters(&net), sizeof *theta);
    double *data = calloc(rows.rows, WINDOW * sizeof *data),
           *off = calloc(rows.rows, STEPS * X * sizeof *off);
    need(theta != NULL && data != NULL && off != NULL ? LG_OK : LG_OUT_OF_MEMORY);
    lg_rng_seed(&rng, 1, 0);
    lg_mlp_initialise(&net, &rng, theta);
    const lg_port in[] = {lg_table_port(&rows, "x", X), lg_table_port(&rows, "u", U)}, y = {"y"};
    const lg_port window = lg_table_port(&rows, "window", WINDOW);
    const lg_function_spec functions[] = {{"field", in, 2, &y, 1, field, &net},
                                          {"step", in, 2, &y, 1, step, NULL},
                                          {"miss", &window, 1, &y, 1, miss, NULL}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)), theta};
    const lg_program_spec spec = {sizeof spec, &weights, 1, functions, 3, "driven pendulum"};
    need(lg_program_build(NULL, &spec, &program, &error));
    const uint32_t held = stamps.classes > 1 ? stamps.classes - 1 : UINT32_MAX;
    size_t count = windows(held, true, data);
    need(lg_program_fit(NULL, program, "miss", (const double *[]){data}, count, NULL, &done, &error));
    printf("rms error of %d steps %.2g after %.1f s: %s\n", STEPS, sqrt(done.after), done.seconds, done.end);
    need(lg_program_save(NULL, argv[2], program, NULL, &error));
    if ((count = windows(held, false, data)) == 0) return 0;
    need(lg_program_eval(NULL, program, "miss", count, (const double *[]){data}, (double *[]){off}, &error));
    for (size_t i = 0; i < count * STEPS * X; i++) square += off[i] * off[i] / (double)(count * STEPS * X);
    printf("run %s, not learned: rms error %.2g\n", stamps.class_name[held], sqrt(square));
    return 0; /* the process ends and frees all memory */
}
