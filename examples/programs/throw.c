/* A network between scalers: where a stone lands and how high it flies, from angle, speed and height.
 *
 * y = sigma_y N((x - mu_x)/sigma_x) + mu_y. The scalers are recorded as constants, so the inputs and outputs
 * of the saved program are in the units of the data. The network is trained by lg_fit before it becomes a
 * program.
 */
#include "programs.h"

#include <math.h>
#include <stdlib.h>

#include <liegrad/fit.h>
#include <liegrad/ops.h>

enum { SAMPLES = 1000, IN = 3, OUT = 2 };

static double samples_x[SAMPLES * IN], samples_y[SAMPLES * OUT];

typedef struct regression {
    lg_mlp net;
    double mean_x[IN], scale_x[IN], mean_y[OUT], scale_y[OUT];
} regression;

/* Maps x (B, 3) to y (B, 2), in the units of the data. */
static lg_var predict(const regression *r, lg_tape *tape, lg_var theta, lg_var x) {
    const lg_var mean_x = lg_input_f64(tape, lg_shape1(IN), r->mean_x),
                 scale_x = lg_input_f64(tape, lg_shape1(IN), r->scale_x),
                 mean_y = lg_input_f64(tape, lg_shape1(OUT), r->mean_y),
                 scale_y = lg_input_f64(tape, lg_shape1(OUT), r->scale_y);
    const lg_var scaled = lg_div(tape, lg_sub(tape, x, mean_x), scale_x);
    const lg_var y = lg_mlp_record(tape, &r->net, theta, 0, scaled);
    return lg_add(tape, lg_mul(tape, y, scale_y), mean_y);
}

/* Mean square of the difference over all rows, in scaled units. */
static lg_var distance(const regression *r, lg_tape *tape, lg_var y, lg_var wanted) {
    const lg_var scale = lg_input_f64(tape, lg_shape1(OUT), r->scale_y);
    return lg_mean(tape, lg_square(tape, lg_div(tape, lg_sub(tape, y, wanted), scale)));
}

/* ---- the functions that lg_program_build records ---- */

static lg_status value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = predict(user, tape, theta[0], in[0]);
    return lg_tape_status(tape);
}

static lg_status loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = distance(user, tape, predict(user, tape, theta[0], in[0]), in[1]);
    return lg_tape_status(tape);
}

/* ---- the function that lg_fit calls: the contribution of these samples to the loss of the batch ---- */

static lg_status part_of_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                              size_t batch, lg_var *out) {
    const regression *r = user;
    const lg_var all_x = lg_parameter(tape, lg_shape2(SAMPLES, IN), samples_x),
                 all_y = lg_parameter(tape, lg_shape2(SAMPLES, OUT), samples_y);
    const lg_var x = lg_gather(tape, all_x, samples, (uint32_t)count),
                 y = lg_gather(tape, all_y, samples, (uint32_t)count);
    *out = lg_scale(tape, distance(r, tape, predict(r, tape, theta, x), y), (double)count / (double)batch);
    return lg_tape_status(tape);
}

static void scaler(const double *x, size_t width, double *mean, double *scale) {
    for (size_t c = 0; c < width; c++) {
        double sum = 0, squares = 0;
        for (size_t i = 0; i < SAMPLES; i++) sum += x[i * width + c];
        mean[c] = sum / SAMPLES;
        for (size_t i = 0; i < SAMPLES; i++) squares += pow(x[i * width + c] - mean[c], 2);
        scale[c] = sqrt(squares / SAMPLES);
    }
}

static void draw(regression *r) {
    static const double low[IN] = {0.1, 2, 0}, high[IN] = {1.4, 20, 10};
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    for (size_t i = 0; i < SAMPLES; i++) {
        double *x = samples_x + i * IN, *y = samples_y + i * OUT;
        for (int c = 0; c < IN; c++) x[c] = lg_rng_uniform_in(&rng, low[c], high[c]);
        const double g = 9.81, up = x[1] * sin(x[0]), along = x[1] * cos(x[0]);
        y[0] = along / g * (up + sqrt(up * up + 2 * g * x[2]));
        y[1] = x[2] + up * up / (2 * g);
    }
    scaler(samples_x, IN, r->mean_x, r->scale_x);
    scaler(samples_y, OUT, r->mean_y, r->scale_y);
}

static lg_status fit(regression *r, double *theta, lg_error *error) {
    const lg_fit_problem problem = {
        .parameters = lg_mlp_parameters(&r->net), .samples = SAMPLES, .loss = part_of_loss, .user = r};
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_fit_options_init(&options);
    options.epochs = 60;
    options.batch = 50;
    options.adam.lr = 5e-3;
    options.schedule.kind = LG_SCHEDULE_COSINE;
    lg_status status = lg_fit_create(NULL, &problem, &options, theta, &fit, error);
    if (status == LG_OK) status = lg_fit_run(fit, error);
    if (status == LG_OK) lg_fit_parameters(fit, theta);
    lg_fit_destroy(fit);
    return status;
}

lg_status make_throw(lg_program **out, training *how, lg_error *error) {
    static const uint32_t hidden[] = {16, 16};
    regression r;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 1);
    draw(&r);
    lg_status status = lg_mlp_init(&r.net, IN, hidden, 2, OUT, LG_TANH, true);
    double *theta = calloc(lg_mlp_parameters(&r.net), sizeof *theta);
    if (status == LG_OK && theta == NULL) status = LG_OUT_OF_MEMORY;
    if (status == LG_OK) {
        lg_mlp_initialise(&r.net, &rng, theta);
        status = fit(&r, theta, error);
    }
    /* low and high are about the range of the data, so that lg_program_build records with values like the
     * data. */
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(IN), .unit = "rad, m/s, m", .low = 0, .high = 20},
                          {.name = "wanted", .shape = lg_shape1(OUT), .unit = "m", .low = 0, .high = 50}};
    const lg_port y = {.name = "y", .unit = "m"}, mean = {.name = "mean_square"};
    const lg_function_spec functions[] = {{"value", in, 1, &y, 1, value, &r},
                                          {"loss", in, 2, &mean, 1, loss, &r}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&r.net)), theta};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = &weights;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = 2;
    spec.description = "where a thrown stone lands (y_1) and how high it flies (y_2)";
    if (status == LG_OK) status = lg_program_build(NULL, &spec, out, error);
    free(theta);
    static const double *const columns[] = {samples_x, samples_y};
    *how = (training){columns, SAMPLES, 1000, 50, 1e-3};
    return status;
}
