/* A small convolution network with max pooling: is a noisy series a sine, a square wave or a saw?
 *
 * series (64, 1) -> 5 taps, 6 channels, ReLU -> maximum of 4 -> 3 taps, 8 channels, ReLU -> maximum of 4 ->
 * dense -> 3 scores. The weights of each layer are parameters with names.
 */
#include "programs.h"

#include <math.h>

#include <liegrad/core.h>
#include <liegrad/ops.h>

enum { SAMPLES = 600, LENGTH = 64, CLASSES = 3 };

/* Maps x (B, 64, 1) to scores (B, 3). */
static lg_var scores(lg_tape *tape, const lg_var *w, lg_var x) {
    lg_var a = lg_conv1d_dense(tape, x, w[0], w[1], 1, 2, LG_RELU);
    a = lg_max_pool1d(tape, a, 4, 4);
    a = lg_conv1d_dense(tape, a, w[2], w[3], 1, 1, LG_RELU);
    a = lg_max_pool1d(tape, a, 4, 4);
    const lg_shape s = lg_var_shape(tape, a);
    a = lg_reshape(tape, a, lg_shape2(s.dims[0], s.dims[1] * s.dims[2]));
    return lg_dense(tape, a, w[4], w[5], LG_IDENTITY);
}

static lg_status value(void *user, lg_tape *tape, const lg_var *w, const lg_var *in, lg_var *out) {
    (void)user;
    out[0] = scores(tape, w, in[0]);
    return lg_tape_status(tape);
}

static lg_status loss(void *user, lg_tape *tape, const lg_var *w, const lg_var *in, lg_var *out) {
    (void)user;
    out[0] = lg_loss_record(tape, LG_LOSS_CROSS_ENTROPY, scores(tape, w, in[0]), in[1], LG_NONE);
    return lg_tape_status(tape);
}

static struct { double series[SAMPLES][LENGTH], classes[SAMPLES][CLASSES]; } data;

static void draw(void) {
    lg_rng rng;
    lg_rng_seed(&rng, 4, 0);
    for (int i = 0; i < SAMPLES; i++) {
        const int kind = i % CLASSES;
        const double period = lg_rng_uniform_in(&rng, 10, 20), phase = lg_rng_uniform(&rng);
        data.classes[i][kind] = 1;
        for (int t = 0; t < LENGTH; t++) {
            const double s = fmod(t / period + phase, 1.0), sine = sin(6.283185307179586 * s);
            const double shapes[CLASSES] = {1.4 * sine, s < 0.5 ? 1 : -1,
                                            1.7 * (2 * s - 1)}; /* shapes of equal power */
            data.series[i][t] = shapes[kind] + 0.2 * lg_rng_normal(&rng);
        }
    }
}

lg_status make_waveforms(lg_program **out, training *how, lg_error *error) {
    double w1[5 * 1 * 6], b1[6] = {0}, w2[3 * 6 * 8], b2[8] = {0}, w3[32 * 3], b3[3] = {0};
    const lg_parameter_spec weights[] = {
        {"conv1_weight", lg_shape3(5, 1, 6), w1}, {"conv1_bias", lg_shape1(6), b1},
        {"conv2_weight", lg_shape3(3, 6, 8), w2}, {"conv2_bias", lg_shape1(8), b2},
        {"dense_weight", lg_shape2(32, 3), w3},   {"dense_bias", lg_shape1(3), b3}};
    const struct {
        double *w;
        size_t count;
        double bound;
    } fill[] = {{w1, sizeof w1 / sizeof *w1, 0.8},
                {w2, sizeof w2 / sizeof *w2, 0.4},
                {w3, sizeof w3 / sizeof *w3, 0.3}};
    lg_rng rng;
    lg_rng_seed(&rng, 4, 1);
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < fill[k].count; i++)
            fill[k].w[i] = lg_rng_uniform_in(&rng, -fill[k].bound, fill[k].bound);
    const lg_port in[] = {{.name = "series", .shape = lg_shape2(LENGTH, 1)},
                          {.name = "classes", .shape = lg_shape1(CLASSES), .low = 0, .high = 1}};
    const lg_port y = {.name = "scores"}, mean = {.name = "entropy"};
    const lg_function_spec functions[] = {{"value", in, 1, &y, 1, value, NULL},
                                          {"loss", in, 2, &mean, 1, loss, NULL}};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = weights;
    spec.parameter_count = sizeof weights / sizeof *weights;
    spec.functions = functions;
    spec.function_count = 2;
    spec.description = "sine, square wave or saw";
    const lg_status status = lg_program_build(NULL, &spec, out, error);
    if (status != LG_OK) return status;
    draw();
    static const double *const columns[] = {data.series[0], data.classes[0]};
    *how = (training){columns, SAMPLES, 400, 50, 5e-3};
    return train(*out, how, NULL, NULL, error);
}
