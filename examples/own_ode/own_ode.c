/* own_ode LOG.csv MODEL.h5: learns x' = f(x, u), x = (angle, rate), from logs of a driven pendulum, such that
 * predictions over STEPS steps agree with the logs, and saves the model. LOG.csv has rows at equal time steps
 * and a column `run`. If there are several runs, the last one is not learned but used for judging. Names, X,
 * widths and STEPS may be changed here: all sizes follow from them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

/* ---- windows of the log ---- */

static lg_table_data rows, stamps; /* complete rows of the log: the columns; the times and runs */
/* Windows of STEPS + 1 rows of one run; the last row of a window is the first one of the next. */
static double (*window)[(STEPS + 1) * ROW], *step; /* step: the mean time step of each window */
static size_t windows, held;                       /* windows to learn from; windows of the last run */

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Whether row i + 1 is of the run of row i; h: the time between them. */
static bool follows(size_t i, double *h) {
    *h = stamps.values[i + 1] - stamps.values[i];
    return stamps.label[i] == stamps.label[i + 1];
}

/* The median time step within runs. */
static double usual_step(void) {
    size_t n = 0;
    for (size_t i = 0; i + 1 < stamps.rows; i++) n += follows(i, &step[n]) && step[n] > 0;
    qsort(step, n, sizeof *step, by_size);
    return n > 0 ? step[n / 2] : 0;
}

/* Cuts windows out of the last run, or out of all others. A piece with a gap is no window: each of its steps
 * is between half of h and one and a half h. Returns how many there are. */
static size_t cut(bool last, double h, size_t count) {
    const size_t before = count;
    for (size_t i = 0, k; i + STEPS<stamps.rows; i = k> i ? k : i + 1) {
        double each;
        const bool of_last = stamps.classes > 1 && stamps.label[i] == stamps.classes - 1;
        for (k = i; k < i + STEPS && of_last == last && follows(k, &each) && fabs(each - h) < h / 2;) k++;
        if (k < i + STEPS) continue;
        memcpy(window[count], rows.values + i * ROW, sizeof *window);
        step[count++] = (stamps.values[k] - stamps.values[i]) / STEPS;
    }
    return count - before;
}

static void read_windows(const char *path) {
    const char *time = "time";
    size_t left_out;
    need(lg_table_read(NULL, path, &time, 1, "run", NULL, &stamps, &error));
    need(lg_table_read(NULL, path, columns, ROW, NULL, NULL, &rows, &error));
    need(lg_table_keep_complete((lg_table_data *[]){&stamps, &rows}, 2, &left_out, &error));
    window = calloc(rows.rows / STEPS + 1, sizeof *window);
    step = calloc(rows.rows, sizeof *step);
    if (window == NULL || step == NULL) need(LG_OUT_OF_MEMORY);
    const double h = usual_step();
    windows = cut(false, h, 0);
    held = cut(true, h, windows);
    if (windows > 0) return;
    (void)fprintf(stderr, "own_ode: %s: no %d rows of one run follow each other\n", path, STEPS + 1);
    exit(1);
}

/* ---- the model ---- */

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
    lg_program_fit_result done;
    lg_fit_options how;
    double loss;
    if (argc != 3) return (void)fputs("usage: own_ode LOG.csv MODEL.h5\n", stderr), 2;
    read_windows(argv[1]);
    need(lg_table_scaler_fit(NULL, rows.values, ROW, NULL, rows.rows, &scale));
    need(lg_mlp_init(&net, ROW, hidden, COUNT(hidden), X, LG_TANH, true));
    need(lg_space_init_rn(&space, X));
    const lg_port in[] = {lg_table_port(&rows, "x", X), lg_table_port(&rows, "u", U)}, f = {.name = "f"};
    const lg_port data[] = {lg_table_port(&rows, "rows", (STEPS + 1) * ROW), {"h", lg_shape1(1)}};
    const lg_function_spec the_field = {"field", in, 2, &f, 1, field, &net};
    const lg_function_spec the_miss = {"miss", data, 2, &f, 1, miss, NULL};
    const lg_parameter_spec theta = {.name = "theta", .shape = lg_shape1((uint32_t)lg_mlp_parameters(&net))};
    const lg_program_spec spec = {sizeof spec, &theta, 1, &the_field, 1, "driven pendulum"};
    need(lg_program_build(NULL, &spec, &program, &error));
    need(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0, 0.1, &error));
    need(lg_program_add_function(program, &the_miss, &error));
    need(lg_program_fit_options_init(program, "miss", &how, &error));
    how.prior = 0.1; /* keeps the network from learning the noise of a log */
    need(lg_program_fit(NULL, program, "miss", (const double *[]){*window, step}, windows, &how,
                        &(lg_fit_starts){2, lg_mlp_draw, &net, 1}, &done, &error));
    printf("rms error of %d steps %.2g after %.1f s: %s\n", STEPS, sqrt(done.after), done.seconds, done.end);
    need(lg_model_save(NULL, argv[2], "driven", program, &space, NULL, &error));
    if (held == 0) return 0;
    need(lg_program_loss(NULL, program, "miss", (const double *[]){window[windows], step + windows}, held,
                         &loss, &error));
    printf("run %s, not learned: rms error %.2g\n", stamps.class_name[stamps.classes - 1], sqrt(loss));
    return 0; /* the process ends and frees all memory */
}
