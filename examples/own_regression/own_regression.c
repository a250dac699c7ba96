/* own_regression TABLE.csv MODEL.h5: learns some columns of a table from others, saves the model, loads it
 * again and evaluates it. `lg-export MODEL.h5 --out DIR` turns the model into C. Names, widths and numbers of
 * columns may be changed here: all sizes follow from these arrays. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/fit.h>
#include <liegrad/ops.h>
#include <liegrad/program.h>
#include <liegrad/series.h>
#include <liegrad/table.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))
static const char *const in_names[] = {"angle", "speed", "height"};
static const char *const out_names[] = {"range", "top"};
static const uint32_t hidden[] = {12, 12};
enum { IN = COUNT(in_names), OUT = COUNT(out_names) };
static lg_error error;

static void need(lg_status status) {
    if (status == LG_OK) return;
    (void)fprintf(stderr, "own_regression: %s\n",
                  *error.message ? error.message : lg_status_sentence(status));
    exit(1);
}

typedef struct regression {
    lg_mlp net;
    lg_scaler in, out;
} regression;

/* Records y (B, OUT) at x[0] (B, IN), in the units of the table. */
static lg_status value(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const regression *r = user;
    const lg_var f = lg_mlp_record(t, &r->net, theta[0], 0, lg_scaler_record(t, &r->in, x[0], false));
    y[0] = lg_scaler_record(t, &r->out, f, true);
    return lg_tape_status(t);
}

/* The error that training makes small: the prediction minus the wanted x[1], in standard deviations of the
 * columns. */
static lg_status miss(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const regression *r = user;
    (void)value(user, t, theta, x, y); /* if it fails, the tape keeps the status */
    y[0] = lg_sub(t, lg_scaler_record(t, &r->out, y[0], false), lg_scaler_record(t, &r->out, x[1], false));
    return lg_tape_status(t);
}

int main(int argc, char **argv) {
    regression r;
    lg_table_data x, y;
    lg_program *program;
    lg_program_fit_result done;
    lg_rng rng;
    size_t incomplete;
    double predicted[OUT];
    if (argc != 3) return (void)fputs("usage: own_regression TABLE.csv MODEL.h5\n", stderr), 2;
    need(lg_table_read(NULL, argv[1], in_names, IN, NULL, NULL, &x, &error));
    need(lg_table_read(NULL, argv[1], out_names, OUT, NULL, NULL, &y, &error));
    need(lg_table_keep_complete((lg_table_data *[]){&x, &y}, 2, &incomplete, &error));
    if (incomplete > 0) printf("%zu incomplete rows left out\n", incomplete);
    need(lg_table_scaler_fit(NULL, x.values, IN, NULL, x.rows, &r.in));
    need(lg_table_scaler_fit(NULL, y.values, OUT, NULL, y.rows, &r.out));
    need(lg_mlp_init(&r.net, IN, hidden, COUNT(hidden), OUT, LG_TANH, true));
    double *theta = calloc(lg_mlp_parameters(&r.net), sizeof *theta);
    need(theta != NULL ? LG_OK : LG_OUT_OF_MEMORY);
    lg_rng_seed(&rng, 1, 0);
    lg_mlp_initialise(&r.net, &rng, theta);
    /* The ports have the ranges of the data. With values in these ranges lg_program_build detects code that
     * depends on a value (an `if`) and refuses it. */
    const lg_port in[] = {lg_table_port(&x, "x", IN), lg_table_port(&y, "wanted", OUT)}, out = {.name = "y"};
    const lg_function_spec functions[] = {{"value", in, 1, &out, 1, value, &r},
                                          {"miss", in, 2, &out, 1, miss, &r}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&r.net)), theta};
    const lg_program_spec spec = {sizeof spec, &weights, 1, functions, 2, "where a thrown stone lands"};
    need(lg_program_build(NULL, &spec, &program, &error));
    need(lg_program_fit(NULL, program, "miss", (const double *[]){x.values, y.values}, x.rows, NULL, &done,
                        &error));
    printf("rms error %.2g deviations after %.1f s: %s\n", sqrt(done.after), done.seconds, done.end);
    need(lg_program_save(NULL, argv[2], program, NULL, &error));
    need(lg_program_load(NULL, argv[2], NULL, &program, &error));
    need(lg_program_eval(NULL, program, "value", 1, (const double *[]){x.values}, (double *[]){predicted},
                         &error));
    for (int k = 0; k < OUT; k++)
        printf("row 1: %s %.4g, predicted %.4g\n", out_names[k], y.values[k], predicted[k]);
    return 0; /* the process ends and frees all memory */
}
